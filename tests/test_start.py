# SPDX-License-Identifier: GPL-3.0-or-later
"""What is imported is what is used, by the library and each subcommand. Images are given memory that is there."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec

import pytest
from worlds import ROOT, generate_here, write_world

OTHERS = (  # other sources than a PLY and a path, other places than a folder
    "bpy", "tarfile", "urllib.request", "noisy_world.rooms", "noisy_world.scenes.gltf",
    "noisy_world.trajectories.handheld", "noisy_world.sources.lit_scene",
    "noisy_world.sources.blender_process", "noisy_world.dataset.address_run",
)  # fmt: skip
FILES = ("cv2", "yaml", "OpenEXR", "importlib.metadata", "noisy_world.layouts",
         "noisy_world.layouts.stored_recording", "noisy_world.scenes.ply", "noisy_world.preset.keys",
         "noisy_world.dataset", "noisy_world.sources", "noisy_world.perturbations.shipped.fog")  # fmt: skip

PERTURBED = """
import platform
import numpy as np
from noisy_world.perturb import apply
image = np.full((480, 640, 3), 99, np.uint8)
for _ in range(3):
    apply(image, "glass_blur", 3)
if platform.libc_ver()[0] == "glibc":  # whose freed memory is kept: no page of it is asked for again
    from resource import RUSAGE_SELF, getrusage
    before = getrusage(RUSAGE_SELF).ru_minflt
    apply(image, "glass_blur", 3)
    pages = getrusage(RUSAGE_SELF).ru_minflt - before
    assert pages < 300, f"{pages} new pages for an image of {image.nbytes // 4096}"
"""


PROGRAM = """
import json, sys
from noisy_world.cli.command import main
try:
    main(sys.argv[1:])
except SystemExit:
    pass
print()
print(json.dumps([name.removeprefix("noisy_world.") for name in sys.modules]))
"""
ARRAYS = ["numpy", "cv2", "yaml", "OpenEXR", "scipy", "pandas"]
PARTS = ["perturbations", "layouts", "channels", "preset", "scenes", "images", "sources", "dataset", "render", "nodes"]


def python_without(modules, code):
    """Run code in a process in which to import one of the modules is an error."""
    assert [name for name in modules if name.startswith("noisy_world") and not find_spec(name)] == []
    refusing = f"import sys\nsys.path[:0] = [{str(ROOT / 'addon')!r}]\nsys.modules.update(dict.fromkeys({modules!r}))\n"
    done = subprocess.run([sys.executable, "-c", refusing + code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_library_of_perturbations_loads_no_files_and_no_sources():
    python_without([*OTHERS, *FILES], "import noisy_world.perturb")
    python_without([*OTHERS, "yaml", "OpenEXR", "noisy_world.dataset", "noisy_world.sources"], PERTURBED)


def test_a_run_loads_the_sources_and_the_perturbations_that_it_has(tmp_path):
    pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
    size, render = (16, 12), {"engine": "embree", "samples": 1, "backend": "reference"}
    noisy = [{"name": "s", "perturb": [{"gaussian_noise": {"severity": 1}}, {"depth_random_missing": {"severity": 1}}]}]
    preset = write_world(tmp_path / "world", frames=1, size=size, render=render, settings=noisy)
    modules = loaded("generate", preset, "--out", tmp_path / "out")
    assert not set(OTHERS).intersection(f"noisy_world.{name}" for name in modules)
    assert not {"bpy", "tarfile", "urllib.request"}.intersection(modules)
    shipped = [name.rpartition(".")[2] for name in modules if name.startswith("perturbations.shipped.")]
    assert sorted(name for name in shipped if not name.startswith("_")) == ["depth_random_missing", "gaussian_noise"]


def loaded(*words):
    """The names of the modules that a command line loads, ours without the package's name."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "addon")}
    command = [sys.executable, "-c", PROGRAM, *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize(
    "words",
    [["--version"], ["--help"], ["score", "--help"], ["generate", "nowhere.yaml"], ["list", "presets"]],
    ids=" ".join,
)
def test_what_needs_no_arrays_loads_none(words):
    modules = loaded(*words)
    assert not {*ARRAYS, *PARTS} & set(modules)


def test_a_subcommand_loads_no_other():
    ours = {name for name in loaded("--version") if name.startswith("cli.")}
    assert ours == {"cli.arguments", "cli.command", "cli.entry", "cli.system_libraries"}


def test_status_loads_no_perturbation_no_plan_and_no_source(tmp_path):
    pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
    noisy = {"name": "fog", "perturb": [{"fog": {"severity": 3}}]}
    render = {"engine": "embree", "backend": "reference"}
    preset = write_world(
        tmp_path / "world", frames=2, size=(16, 12), settings=[{"name": "clean"}, noisy], render=render
    )
    generate_here(preset, "--out", tmp_path / "out")
    modules = loaded("status", tmp_path / "out")
    assert "dataset.dataset_status" in modules
    assert not [
        name for name in modules if name.split(".")[0] in ("perturbations", "sources", "render", "nodes", "rooms")
    ]
    assert not {"dataset.plan", "dataset.estimate", "preset.keys", "cv2", "yaml", "bpy"} & set(modules)
