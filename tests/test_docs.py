# SPDX-License-Identifier: GPL-3.0-or-later
"""The pages: links lead somewhere, the reference names modules that exist, the tutorial's files do what it says."""

import ast
import importlib
import importlib.util
import re
import shutil
import statistics
import sys
import tomllib
from dataclasses import fields
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from reading import grade
from worlds import ROOT, generate, write_world

from noisy_world.cli.command import COMMANDS
from noisy_world.dataset.plan import read_settings
from noisy_world.preset.keys import PresetSpec, read_preset
from noisy_world.perturbations import registry
from noisy_world.dataset.plan import make_plan

INCLUDING = ("changelog.md", "contributing.md", "security.md")  # pages that are another file
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
sys.path.append(str(ROOT / "docs/examples"))


def text_of(page):
    """A page's text without its code, in which brackets are no links."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"`[^`\n]*`", "code", text)


def anchors_of(page):
    """The names of a page's headings, as GitHub and MkDocs make them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[\s]+", "-", re.sub(r"[^\w\s-]", "", title.lower()).strip()) for title in titles}


def broken_links(page):
    """The links of a page to files or headings that are not there."""
    found = []
    for target in re.findall(r"\]\(([^)\s]+)\)", text_of(page)):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name) if name else page
        if not file.exists() or (anchor and anchor not in anchors_of(file)):
            found.append(target)
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    assert broken_links(page) == []


def test_a_broken_link_would_be_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# One two\n\n[a](page.md#one-two) [b](page.md#three) ![c](none.jpg) `[d](code)`\n")
    assert broken_links(page) == ["page.md#three", "none.jpg"]


def test_examples_are_shown():
    # A formatter takes the line for Python where the block says so, and then nothing is shown.
    included = [
        line for page in PAGES for line in re.findall(r"^--8.*", page.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert len(included) > 5
    for line in included:
        assert (ROOT / re.fullmatch(r'--8<-- "(.+)"', line)[1]).is_file()


def test_every_page_is_in_the_sites_contents():
    config = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))

    def pages(entry):
        if isinstance(entry, str):
            yield entry
        for item in entry.values() if isinstance(entry, dict) else entry if isinstance(entry, list) else ():
            yield from pages(item)

    named = set(pages(config["nav"]))
    assert named == {page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")}


def test_the_home_page_leads_to_every_page():
    linked = set(re.findall(r"\]\(([\w/]+\.md)", (ROOT / "docs/index.md").read_text(encoding="utf-8")))
    assert linked == {page.name for page in (ROOT / "docs").glob("*.md")} - {"index.md"} | {"reference/index.md"}


def test_the_reference_names_modules_that_exist():
    named = re.findall(r"^::: (\S+)", "\n".join(page.read_text(encoding="utf-8") for page in PAGES), re.MULTILINE)
    assert len(named) > 5
    assert [name for name in named if importlib.util.find_spec(name) is None] == []


def unmarked_examples(docstring):
    """The paragraphs of a docstring that are code, and are not indented: the site would set them as prose."""
    for paragraph in docstring.split("\n\n"):
        try:
            lines = ast.parse(paragraph).body
        except SyntaxError:
            continue
        if any(not isinstance(line, ast.Expr) or isinstance(line.value, ast.Call) for line in lines):
            yield paragraph


def test_the_references_examples_are_code():
    named = re.findall(r"^::: (\S+)", "\n".join(page.read_text(encoding="utf-8") for page in PAGES), re.MULTILINE)
    sources = [Path(importlib.util.find_spec(name).origin).read_text(encoding="utf-8") for name in named]
    nodes = [node for source in sources for node in ast.walk(ast.parse(source))]
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docstrings = [text for node in nodes if isinstance(node, kinds) and (text := ast.get_docstring(node))]
    assert [example for text in docstrings for example in unmarked_examples(text)] == []
    assert len(re.findall(r"\n\n    \S", "\n".join(docstrings))) >= 3
    assert list(unmarked_examples("Text.\n\nfrom a import b\n\n    b(1)")) == ["from a import b"]


def test_every_extra_is_named_where_it_is_installed():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    text = (ROOT / "docs/install.md").read_text(encoding="utf-8")
    assert [name for name in extras if f"`{name}`" not in text] == []


def test_commands_and_files_on_the_pages_exist():
    """What a reader types: subcommands, targets of Make, files of the repository. The changelog tells of older ones."""
    pages = {
        page: page.read_text(encoding="utf-8") for page in PAGES if page.name not in ("CHANGELOG.md", "changelog.md")
    }
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z0-9-]+):", makefile, re.MULTILINE))
    commands, makes, files = ([], [], [])
    for page, text in pages.items():
        name = page.relative_to(ROOT).as_posix()
        code = "\n".join(re.findall(r"^    .*$|^```.*?^```|`[^`\n]+`", text, re.MULTILINE | re.DOTALL))
        commands += [(name, word) for word in re.findall(r"\bnoisy-world ([a-z][a-z-]+)", code)]
        makes += [(name, word) for word in re.findall(r"(?:^ *|`|; |: )make ([a-z][a-z0-9-]+)", code, re.MULTILINE)]
        files += [
            (name, file)
            for file in re.findall(r"(?<![\w/.~-])((?:headless|presets|addon|docs|tests)/[\w/.-]*\w)", code)
            if not (ROOT / file).exists() and not file.startswith("addon/noisy_world/assets/")  # make assets writes it
        ]
    assert len(commands) > 50
    assert len(makes) > 30
    assert [found for found in commands if found[1] not in {*COMMANDS, "holes"}] == []  # which docs/extend.md adds
    assert [found for found in makes if found[1] not in targets] == []
    assert files == []


def test_pages_are_read_once():
    guides = [page for page in (ROOT / "docs").glob("*.md") if page.name not in INCLUDING]
    grades = {page.name: grade(page.read_text(encoding="utf-8")) for page in guides}
    assert statistics.median(grades.values()) <= 10, sorted(grades.items(), key=lambda item: -item[1])[:9]
    # Nine words of a syllable each, in two sentences.
    assert grade("The cat sat on the mat. It was fat.") == pytest.approx(0.39 * 4.5 + 11.8 - 15.59)
    hard = "Methodological heterogeneity notwithstanding, characterisation necessitates considerable imagination."
    assert grade(hard) > 20


def presets_shown():
    """The blocks of YAML on the pages that are presets, or parts of one; by page and number."""
    keys = {field.name for field in fields(PresetSpec)}
    for page in PAGES:
        blocks = re.findall(r"^```yaml\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
        for number, block in enumerate(blocks):
            found = None if "--8<--" in block else yaml.safe_load(block)
            if isinstance(found, list) and all(isinstance(item, dict) and "perturb" in item for item in found):
                found = {"settings": found}
            if isinstance(found, dict) and set(found) <= keys:
                yield (
                    f"{page.stem}{number}",
                    {"scenes": [{"name": "a", "mesh": "a.ply", "trajectory": "a.txt"}]} | found,
                )


def test_presets_on_the_pages_are_presets(tmp_path):
    shown = list(presets_shown())
    assert len(shown) > 8
    for file in (ROOT / "presets").glob("*mixed.yaml"):  # which a page includes
        shutil.copy(file, tmp_path)
    (tmp_path / "masks").mkdir()
    cv2.imwrite(str(tmp_path / "masks/left.png"), np.eye(4, dtype=np.uint8))
    for name, found in shown:
        path = tmp_path / f"{name}.yaml"
        path.write_text(yaml.safe_dump(found))
        assert read_settings(read_preset(path), registry()), name


def test_python_on_the_pages_imports_what_there_is():
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    imported = []
    for block in re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        nodes = [node for node in ast.walk(ast.parse(block)) if isinstance(node, ast.ImportFrom)]
        imported += [(node.module, item.name) for node in nodes for item in node.names]
    # Blocks that are indented are of several languages.
    indented = re.findall(r"^    from (noisy_world[.\w]*) import ([\w, ]+)$", text, re.MULTILINE)
    imported += [(module, name) for module, names in indented for name in names.split(", ")]
    ours = [(module, name) for module, name in imported if module.startswith("noisy_world")]
    assert len(ours) > 5
    assert [pair for pair in ours if not hasattr(importlib.import_module(pair[0]), pair[1])] == []


def test_the_workflow_publishes_what_make_docs_builds():
    site = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"), yaml.BaseLoader)["site_dir"]
    steps = yaml.safe_load((ROOT / ".github/workflows/pages.yml").read_text(encoding="utf-8"))["jobs"]["build"]["steps"]
    assert "make docs" in [step.get("run") for step in steps]
    assert steps[-1]["with"]["path"] == site


def test_what_other_programs_read_is_yaml():
    files = [*ROOT.glob(".github/**/*.yml"), ROOT / ".pre-commit-config.yaml"]
    assert len(files) >= 6
    assert all(isinstance(yaml.safe_load(file.read_text(encoding="utf-8")), dict) for file in files)


def test_the_citation_and_the_pages_are_of_this_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert citation["version"] == manifest["version"]
    named = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs/examples").glob("*.yaml")]
    versions = re.findall(
        r"noisy[_-]world[:-](\d+\.\d+\.\d+)", "\n".join(file.read_text(encoding="utf-8") for file in named)
    )
    assert versions
    assert set(versions) == {manifest["version"]}


def test_the_address_stands_in_one_place_and_everything_follows(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "headless"))
    pages = importlib.import_module("tools.pages")
    told = ("README.md", "CITATION.cff", "pyproject.toml", "mkdocs.yml")
    before = {name: (ROOT / name).read_text(encoding="utf-8") for name in told}
    monkeypatch.setattr(pages, "project_address", lambda: "https://example.org/noisy-world")
    made = {path.relative_to(ROOT).as_posix(): text for path, text in pages.made_files(ROOT)}
    assert [name for name in told if "https://example.org/noisy-world" not in made[name]] == []
    assert yaml.safe_load(made["CITATION.cff"])["repository-code"] == "https://example.org/noisy-world"
    assert tomllib.loads(made["pyproject.toml"])["project"]["urls"] == {"Repository": "https://example.org/noisy-world"}
    for name, (start, line) in pages.ADDRESSED.items():
        assert pages.with_address(made[name], start, line, "") == before[name]


# --- the tutorial ---


def test_the_tutorials_preset_is_what_the_tutorial_says():
    plan = make_plan(read_preset(ROOT / "docs/examples/tour.yaml", []), None)
    assert [sequence.folder for sequence in plan.sequences] == ["clean/room", "noisy/room", "late_depth/room"]
    assert len(plan.renders) == 1


def test_the_tutorials_tracker_follows_a_clean_sequence(tmp_path):
    import odometry

    preset = write_world(tmp_path / "world", frames=180, size=(160, 120), output={"layout": "tum", "image": "png"})
    generate(preset, "--out", tmp_path / "out", "--frames", "0:8")
    tracked_m, true_m, lost = odometry.track(tmp_path / "out/clean/box", 80.0, 80.0, 79.5, 59.5)
    assert (len(true_m), lost) == (8, 0)
    walked_m = np.linalg.norm(np.diff(true_m, axis=0), axis=1).sum()
    assert odometry.absolute_error_m(tracked_m, true_m) < 0.02 * walked_m


def test_the_tutorials_error_is_that_of_an_aligned_path():
    import odometry

    rng = np.random.default_rng(4)
    path = rng.normal(size=(50, 3))
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    moved = path @ rotation.T + [3.0, -1.0, 2.0]
    assert odometry.absolute_error_m(moved, path) == pytest.approx(0, abs=1e-12)
    # A mirrored path is no rotation of it, and one that is twice as large stays so.
    assert odometry.absolute_error_m(path * [1, 1, -1], path) > 0.1
    centred = path - path.mean(axis=0)
    assert odometry.absolute_error_m(2 * path, path) == pytest.approx(np.sqrt((centred**2).sum(axis=1).mean()))
