# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/perturbations.md and docs/gallery.md have what the registry has; the example of one's own works as it stands."""

import os
import re
import tomllib
from dataclasses import fields
from fnmatch import fnmatch

import cv2
import installed_package
import numpy as np
from worlds import ROOT, generate, need_blender, write_world

from noisy_world.perturbations import registry

PAGE = (ROOT / "docs" / "perturbations.md").read_text(encoding="utf-8")
GALLERY = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
YOURS = (ROOT / "docs" / "your_perturbation.md").read_text(encoding="utf-8")
OWN = [item for item in registry().values() if item.distribution is None]


def block(language):
    """The first block of code in a language on the page about one's own."""
    return re.search(rf"```{language}\n(.*?)```", YOURS, re.DOTALL)[1]


def test_the_table_has_every_perturbation_in_its_place():
    rows = re.findall(r"^\| (\w+) (\d+) \| `(\w+)` \| .* \| (.*) \|$", PAGE, re.MULTILINE)
    assert [(stage, int(order), name) for stage, order, name, _ in rows] == [
        (item.stage, item.order, item.name) for item in OWN
    ]
    for (_, _, name, told), item in zip(rows, OWN, strict=True):
        known = {field.name for field in fields(item.parameters)}
        patterns = re.findall(r"`([^`]+)`", told)
        assert all(any(fnmatch(field, pattern) for field in known) for pattern in patterns), name
        assert all(any(fnmatch(field, pattern) for pattern in patterns) for field in item.severities), name


def test_the_gallery_shows_every_perturbation():
    shown = re.findall(r"^### (.+)\n\n`(\w+)`(, ours)?[^!]*!\[.+\]\(gallery/(\w+)\.jpg\)$", GALLERY, re.MULTILINE)
    assert [(label, name, name, bool(ours)) for label, name, ours, _ in shown] == [
        (item.label, item.name, picture, item.source.startswith("our own"))
        for item, (*_, picture) in zip(OWN, shown, strict=True)
    ]
    files = {file.stem for file in (ROOT / "docs/gallery").iterdir()}
    assert files == {item.name for item in OWN} | {"clean", "room"}
    heads = re.findall(r"^## (.+)$", GALLERY, re.MULTILINE)[:-1]
    assert [head.lower().removesuffix("-processing") for head in heads] == list(dict.fromkeys(i.stage for i in OWN))


def test_the_gallery_is_light():
    assert sum(file.stat().st_size for file in (ROOT / "docs/gallery").iterdir()) < 1_000_000


def test_the_example_works_as_it_stands(tmp_path):
    need_blender()
    project = tomllib.loads(block("toml"))["project"]
    modules = {"__init__.py": "", "stereo_steps.py": block("python")}
    entry_points = project["entry-points"]["noisy_world.perturbations"]
    site = installed_package.install(tmp_path / "site", project["name"], project["version"], entry_points, modules)
    settings = [{"name": "clean"}, {"name": "s", "perturb": [{"stereo_steps": {"severity": 4, "noise_px": 0}}]}]
    preset = write_world(tmp_path / "world", frames=1, settings=settings)
    generate(preset, "--out", tmp_path / "out", env=os.environ | {"PYTHONPATH": str(site)})
    clean_m, made_m = (
        cv2.imread(str(tmp_path / f"out/{name}/box/results/depth000000.png"), cv2.IMREAD_UNCHANGED) / 6553.5
        for name in ("clean", "s")
    )
    # fx is 32 px and the baseline 5 cm: 1.6 px m, in halves of a pixel.
    disparity_px = np.round(1.6 / clean_m / 0.5) * 0.5
    sure = np.abs(1.6 / clean_m / 0.5 % 1 - 0.5) > 0.001
    expected_m = np.divide(1.6, disparity_px, out=np.zeros_like(clean_m), where=disparity_px > 0)
    assert np.abs(made_m - expected_m)[sure].max() < 1 / 6553.5
    assert len(np.unique(made_m)) < 6 < len(np.unique(clean_m))
