# The README gives `make demo` and `make test`; each sets everything up by itself. `make help` lists the rest.
# Python 3.13 from the path or, where that is how it is had, from uv.
PYTHON ?= $(shell python3.13 -c 'import sys; print(sys.executable)' 2>/dev/null || uv python find 3.13 2>/dev/null)
# Python 3.11, for what we compare with; a shim for another version is passed over.
PYTHON311 = $(shell for python in python3.11 /usr/bin/python3.11; do $$python -c 'import sys; print(sys.executable)' 2>/dev/null && break; done)
BLENDER ?= blender
VENV := .venv
PY := $(VENV)/bin/python
ENVIRONMENT := @sh headless/tools/environment.sh
PINNED := --require-hashes --only-binary :all: -r

INSTALL_ORB_SLAM3 = $(PY) headless/systems.py install orb_slam3 $(if $(PYTHON_SLAM),--python "$(PYTHON_SLAM)")

# pip leaves it to the first import to compile a module: where an environment tells Python to keep nothing of it, each of
# the thousands of processes that the tests start would compile all that it imports, for more than half of its time.
unexport PYTHONDONTWRITEBYTECODE

define NEEDS_PYTHON
test -n "$(PYTHON)" || { echo "make: Python 3.13 is needed; get it, with 'uv python install 3.13' for instance, or say PYTHON=/path/to/it" >&2; exit 1; }; \
"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 13))' 2>/dev/null || { echo "make: $(PYTHON) is no Python 3.13, which is needed; say PYTHON=/path/to/one" >&2; exit 1; }
endef

.DEFAULT_GOAL := help
.PHONY: release-check help venv demo picture gallery thumbnails pages rooms screenshots assets example film extension ice wheel docs test test-all test-below test-above test-lowest test-bare fuzz bench benchmark lint format lock slam-env blender-env peer-env corruptions-env clean

help: ## list the targets
	@grep -hE '^[a-z0-9-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

venv: $(VENV)/.installed ## make .venv with the pinned packages

$(VENV)/.installed: requirements/base.lock
	@$(NEEDS_PYTHON)
	PYTHONPATH=addon "$(PYTHON)" -m noisy_world.cli.system_libraries # before half a gigabyte is downloaded
	$(ENVIRONMENT) "$(PYTHON)" $(VENV) $(PINNED) $<
	PYTHONPATH=addon $(PY) -m noisy_world.cli.system_libraries # what the package at hand is really linked against
	touch $@

demo: venv ## render presets/demo.yaml into out/demo
	$(PY) headless/generate.py presets/demo.yaml --out out/demo --overwrite

picture: demo ## draw the README's picture anew
	$(PY) -c "import cv2; cv2.imwrite('docs/demo.jpg', cv2.imread('out/demo/overview.png'), [cv2.IMWRITE_JPEG_QUALITY, 88])"

ice: venv ## draw the ice of frost and lens_frost anew
	$(PY) headless/pictures/draw_ice.py
	$(PY) headless/pictures/draw_frost.py

rooms: venv ## draw docs/rooms.jpg anew: the embedded rooms
	$(PY) headless/pictures/docs_pictures.py rooms docs/rooms.jpg

gallery: venv ## draw the pictures of docs/gallery anew: every perturbation, at three strengths
	$(PY) headless/pictures/gallery.py docs/gallery

thumbnails: venv ## draw the panel's small pictures of presets and perturbations anew, from the gallery's
	$(PY) headless/pictures/thumbnails.py docs/gallery addon/noisy_world/panel/thumbnails

screenshots: blender-env example ## photograph Blender's window into docs: BLENDER=/path/to/blender, a display, ImageMagick
	$(BLENDER) --factory-startup -P headless/pictures/screenshots.py -- docs

assets: venv ## write the asset library of node groups for Blender's asset browser
	$(PY) headless/tools/assets.py

example: venv ## write out/example/street.blend: a lit street with four node groups behind its render, ready to play
	$(PY) headless/pictures/example.py

film: venv ## render the street's path and write docs/street.mp4 and .webp anew: a quarter of an hour on two idle cores
	$(PY) headless/pictures/street.py out/film/frames --samples 5
	$(PY) headless/pictures/film.py docs/street --frames out/film/frames
	$(PY) headless/pictures/moving_picture.py docs/street.mp4 docs/street.webp

extension: venv ## build and validate the extension's zips for every platform into dist; BLENDER=... uses its tool
	$(PY) headless/tools/package.py $(if $(filter file,$(origin BLENDER)),,--blender $(BLENDER))

release-check: wheel extension ## install what was built, under each Python 3.11 to 3.14 here and in BLENDER=..., and run it
	$(PY) headless/tools/release_check.py $(if $(filter file,$(origin BLENDER)),,--blender $(BLENDER))

wheel: venv ## build the Python package's wheel into dist
	$(PY) -m pip wheel --quiet --disable-pip-version-check --no-build-isolation --no-deps --wheel-dir dist .

docs: $(VENV)-docs/.installed ## build the docs' site into out/docs; a broken link and a misspelt word are errors
	$(VENV)-docs/bin/codespell *.md docs/*.md docs/reference docs/examples presets addon headless
	NO_MKDOCS_2_WARNING=1 $(VENV)-docs/bin/mkdocs build --quiet
	@! grep -rlE '<(script|link|img|iframe)[^>]* (src|href)="?https?:' out/docs --include='*.html' || { echo "make: these pages fetch from elsewhere" >&2; exit 1; }
	@echo "wrote out/docs/index.html"

$(VENV)-docs/.installed: requirements/docs.lock
	@$(NEEDS_PYTHON)
	$(ENVIRONMENT) "$(PYTHON)" $(VENV)-docs $(PINNED) $<
	touch $@

# What stands below Blender, whose branches are counted: 95 % of the perturbations' and of what stands below them.
BELOW_BLENDER := tests/core tests/perturbations tests/pipeline tests/sources tests/rays tests/recipes
# Every perturbation acts under the oldest packages too, through the library; its figures are tested under the newest.
BELOW_BLENDER_LOWEST := tests/core tests/sources tests/recipes tests/rays tests/pipeline/test_perturb_library.py
# Blender imports the meshes of three, and core makes of them what they are; estimates have the one reader of poses;
# a measured twin is written and read as a device; mutated files reach refusals that no table has.
COUNTED := $(BELOW_BLENDER) tests/blender/test_imported_colours.py tests/blender/test_imported_meshes.py tests/blender/test_imported_refusals.py \
	tests/evaluation/systems/test_estimate_readers.py tests/evaluation/test_one_reader.py tests/measure/test_twin.py tests/test_fuzz.py

$(VENV)/.extras: requirements/extras.lock $(VENV)/.installed
	$(ENVIRONMENT) "$(PYTHON)" $(VENV) --only-binary :all: --no-binary jsonpath-rw --require-hashes -r $< # all wheels but one
	touch $(VENV)/.installed $@

$(VENV)/.evaluate: requirements/evaluate.lock $(VENV)/.installed
	$(ENVIRONMENT) "$(PYTHON)" $(VENV) $(PINNED) $<
	touch $(VENV)/.installed $@

# Several processes share the tests, a file at a time; tests/conftest.py says which files are the first. Many a long test
# above Blender waits for a window or a cluster, so there is a process more than processors, each of which collects all.
PYTEST := $(PY) -m pytest --dist loadfile --no-loadscope-reorder --maxprocesses 4 --numprocesses
ONE_MORE = $$($(PY) -c 'import os; print(min(4, 1 + os.cpu_count()))')

# `make test` leaves out what is marked long, and does not count branches, which takes as long again. `make test-all`
# and .ci/run do both.
LONG_TOO := SELECTED= COUNT_BRANCHES=yes
SELECTED := -m "not long"

test: test-below test-above ## run the tests, but for the long ones

test-all: ## run all tests; count the branches that they take of perturbations and of what stands below them
	$(MAKE) test-below test-above $(LONG_TOO)

test-below: $(VENV)/.extras
	$(PYTEST) logical $(SELECTED) $(if $(COUNT_BRANCHES),--cov --cov-report=) $(COUNTED)
ifdef COUNT_BRANCHES
	$(PY) -m coverage report --omit='addon/noisy_world/perturbations/*,*/simulation.py'
	$(PY) -m coverage report --include='addon/noisy_world/perturbations/*'
endif

test-above: $(VENV)/.extras
	$(PYTEST) $(if $(SELECTED),logical,$(ONE_MORE)) $(SELECTED) tests $(COUNTED:%=--ignore=%)

# What the library does without Blender, under the oldest Python and with the oldest packages that it works with.
test-lowest: .venv-lowest/.installed ## run tests of what needs no Blender under Python 3.11, with the lowest versions of all packages
	.venv-lowest/bin/python -m pytest -m "not one_python and not long" -o cache_dir=.pytest_cache_lowest $(BELOW_BLENDER_LOWEST) tests/evaluation/analysis # kept rooms are each Python's own

.venv-lowest/.installed: requirements/lowest.lock
	@test -n "$(PYTHON311)" || { echo "make: no Python 3.11 is here" >&2; exit 1; }
	$(ENVIRONMENT) "$(PYTHON311)" .venv-lowest $(PINNED) $<
	touch $@

test-bare: ## run `make demo` and `make test` on a bare Debian, as a new user has it: needs root and debootstrap
	headless/tools/bare_debian.sh

fuzz: venv ## try mutated inputs: CASES=20000 SEED=0; evo, plyfile and Pillow are asked too, where they are installed
	$(PY) tests/fuzz_inputs.py --cases $(or $(CASES),20000) --seed $(or $(SEED),0)

benchmark: $(VENV)/.evaluate ## evaluate SLAM systems in two rooms into out/benchmark: a quarter of an hour; ORB-SLAM3 too with Python 3.11 or 3.12
	@systems=rgbd_odometry,plain_odometry; \
	if $(INSTALL_ORB_SLAM3); then systems=$$systems,orb_slam3; \
	else echo "benchmark: without ORB-SLAM3, for the reason above" >&2; fi; \
	$(PY) headless/evaluate.py presets/benchmark.yaml --systems $$systems --repeats 1 --out out/benchmark

bench: $(VENV)/.bench ## measure speed against error on this machine into out/bench; beside peers where they can be had
	-$(MAKE) peer-env
	$(PY) headless/bench/report.py --out out/bench
	$(PY) headless/bench/cost.py --out out/bench

$(VENV)/.bench: requirements/bench.lock $(VENV)/.installed
	$(ENVIRONMENT) "$(PYTHON)" $(VENV) $(PINNED) $<
	touch $(VENV)/.installed $@

pages: venv ## write anew what pages and presets say of perturbations, channels, layouts and the like
	$(PY) headless/tools/pages.py

lint: $(VENV)/.extras ## check style, layers, formatting, types, and that `make pages` would change nothing
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	NODE_OPTIONS=--max-semi-space-size=128 $(VENV)/bin/pyright --pythonpath $(PY) # a tenth less time: short-lived objects
	$(PY) headless/tools/pages.py --check

format: venv ## format the code
	$(VENV)/bin/ruff check --fix .
	$(VENV)/bin/ruff format .

blender-env: venv ## install the packages that a Blender program lacks, beside the project: BLENDER=/path/to/blender
	$(PY) headless/tools/blender_env.py $(BLENDER)

peer-env: .venv-peer/.installed ## an environment with Open3D and pyrender, to compare with; needs Python 3.11

.venv-peer/.installed: tests/peer/requirements.txt
	@test -n "$(PYTHON311)" || { echo "make: Open3D needs Python 3.11, which is not here" >&2; exit 1; }
	$(ENVIRONMENT) "$(PYTHON311)" .venv-peer --only-binary :all: --no-deps -r $<
	touch $@

corruptions-env: .venv-corruptions/.installed ## an environment with imagecorruptions, to compare with; needs Python 3.11

.venv-corruptions/.installed: tests/peer/corruptions.txt
	@test -n "$(PYTHON311)" || { echo "make: imagecorruptions needs Python 3.11, which is not here" >&2; exit 1; }
	$(ENVIRONMENT) "$(PYTHON311)" .venv-corruptions -r $<
	touch $@

slam-env: venv ## environments of other systems; PYTHON_SLAM=/path/to/python where 3.11 or 3.12 is not found; ORB_SLAM2=, ORB_SLAM3= sources
	$(INSTALL_ORB_SLAM3)
	$(if $(ORB_SLAM2),$(PY) headless/systems.py install orb_slam2 --source "$(ORB_SLAM2)")
	$(if $(ORB_SLAM3),$(PY) headless/systems.py install orb_slam3_source --source "$(ORB_SLAM3)")

lock: ## pin the newest packages that pyproject.toml allows; needs uv
	uv pip compile pyproject.toml --extra blender --group dev --universal --python-version 3.13 --generate-hashes --no-annotate --no-header --upgrade -o requirements/base.lock
	uv pip compile --group pyproject.toml:extras --constraints requirements/base.lock --universal --python-version 3.13 --generate-hashes --no-annotate --no-header --upgrade -o requirements/extras.lock
	uv pip compile --group pyproject.toml:evaluate --constraints requirements/base.lock --universal --python-version 3.13 --generate-hashes --no-annotate --no-header --upgrade -o requirements/evaluate.lock
	uv pip compile --group pyproject.toml:bench --constraints requirements/base.lock --universal --python-version 3.13 --generate-hashes --no-annotate --no-header --upgrade -o requirements/bench.lock
	uv pip compile pyproject.toml --group lowest --resolution lowest-direct --universal --python-version 3.11 --generate-hashes --no-annotate --no-header --upgrade -o requirements/lowest.lock
	uv pip compile --group pyproject.toml:docs --constraints requirements/base.lock --universal --python-version 3.13 --generate-hashes --no-annotate --no-header --upgrade -o requirements/docs.lock

clean: ## remove what the targets made
	rm -rf $(VENV) $(VENV)-docs $(VENV)-slam .venv-lowest .venv-peer .venv-corruptions .blender-env out dist .coverage .pytest_cache .pytest_cache_lowest .ruff_cache
