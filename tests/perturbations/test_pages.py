# SPDX-License-Identifier: GPL-3.0-or-later
"""The example of docs/your_perturbation.md works as it stands."""

import os
import re
import tomllib

import cv2
import installed_package
import numpy as np
from worlds import ROOT, generate, need_blender, write_world

YOURS = (ROOT / "docs" / "your_perturbation.md").read_text(encoding="utf-8")


def block(language):
    """The first block of code in a language on the page about one's own."""
    return re.search(rf"```{language}\n(.*?)```", YOURS, re.DOTALL)[1]


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
