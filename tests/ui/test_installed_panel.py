# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbations of installed packages in the panel: in menus, on the path and the camera, in previews and presets."""

import json
import os
import subprocess
import sys
from pathlib import Path

import installed_package
import numpy as np
import pytest
from worlds import ROOT, generate, path_poses, write_world

from noisy_world.core.streams import stream

COUNT = 6
SETTING = {
    "name": "perturbed",
    "perturb": [
        {"lift": {"severity": 3}},
        {"stutter": {}},
        {"warm": {"severity": 4}},
        {"grazing": {"jitter_m": 0.0}},
        {"backwards": {"skip_last": True}},
    ],
}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    site = tmp_path_factory.mktemp("site")
    source = (ROOT / "docs/examples/my_lab/my_lab/corridor.py").read_text(encoding="utf-8")
    corridor = {"__init__.py": "", "corridor.py": source}
    installed_package.install(site, "my-lab", "1.0", {"corridor": "my_lab.corridor:SOURCE"}, corridor, kind="sources")
    return installed_package.install(site)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("world")
    write_world(made, frames=COUNT, settings=[{"name": "clean"}, SETTING], render={"backend": "compositor"})
    return made


@pytest.fixture(scope="module")
def told(site, folder):
    script = Path(__file__).parent / "panel_with_package.py"
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(site), str(ROOT / "addon"), str(ROOT / "tests/support")])
    }
    result = subprocess.run(
        [sys.executable, str(script), str(folder)], capture_output=True, text=True, env=environment, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    (line,) = [line for line in result.stdout.splitlines() if line.startswith("TOLD ")]
    return json.loads(line.removeprefix("TOLD "))


def lifted(height_m, shiver_m):
    moved = path_poses(COUNT)
    moved[:, 2, 3] += height_m
    for k, pose in enumerate(moved):
        pose[0, 3] += shiver_m * stream(3, "box", "perturbed", "lift", 0, frame=k).standard_normal()
    return moved


ROUNDED = 3e-9  # poses are rounded to a nanometre and 2e-9 rad


def near(keys, poses):
    return np.abs(np.array(keys) - poses).max() < 1e-5  # keys are float32


def test_menus_offer_what_has_no_field_of_its_own(told):
    assert told["menus"] == {"motion": ["lift", "stutter"], "pairing": ["backwards"]}
    assert told["order"] == ["lift", "stutter", "fog"]
    assert "Lift is in the list already: it acts only once" in told["refused"][0]
    assert len(told["refused"]) == 1


def test_the_camera_and_the_lines_follow_the_list(told):
    assert near(told["clean keys"], path_poses(COUNT))
    assert told["keys with fog"] == told["clean keys"]
    assert near(told["added keys"], lifted(0.3, 0.0))
    assert near(told["slid keys"], lifted(0.25, 0.5))
    assert np.abs(np.array(told["lines"]) - lifted(0.25, 0.5)).max() < ROUNDED
    assert told["keys when off"] == told["clean keys"]
    assert told["lines when off"] is None
    assert np.abs(np.array(told["stuttering lines"]) - path_poses(COUNT)[[0, 0, 2, 2, 4, 4]]).max() < ROUNDED


def test_a_preset_comes_into_the_panel_and_out_again(told, site, folder):
    assert told["opened"] == SETTING["perturb"]
    assert near(told["opened keys"], lifted(0.3, 0.0))
    generate(folder / "saved.yaml", "--out", folder / "out", env=os.environ | {"PYTHONPATH": str(site)})
    written = np.loadtxt(folder / "out/perturbed/box/traj.txt").reshape(-1, 4, 4)
    assert np.abs(written - lifted(0.3, 0.0)[[0, 0, 2, 2, 4]]).max() < ROUNDED


def test_previews_show_what_is_written(told, folder):
    assert told["shows"] == [[0, 0, 2, 2, 4, 4], 4]
    assert told["depth"].startswith("Color of frame 0, depth of")
    assert "grazing" in told["depth"]
    import cv2

    written = cv2.imread(str(folder / "out/perturbed/box/results/frame000002.png"))
    assert abs(told["red"] - written[..., 2].mean()) < 1.5


def test_what_is_wrong_leaves_the_panel_as_it_is(told):
    assert told["keys stay"]
    assert told["gone"].startswith("InputError: Noisy World panel: perturbations: ")
    assert "'gone'" in told["gone"]
    assert told["has depth steps"] is False


def test_a_source_has_its_fields(told):
    name, label, meaning = told["source"]
    assert (name, label, meaning) == ("corridor", "Corridor", "A corridor of striped walls, along which a camera sways")
    assert told["source fields"] == {"width_m": "Width", "frames": "Frames (frames)"}
    scene = {"name": "hall", "corridor": {"width_m": 3.3, "frames": 7}}
    assert told["source entry"] == scene
    assert told["source taken"] == [2.5, 5, "hall"]
    assert told["source frames"] == 5
    assert told["source depth"] == pytest.approx(2.5 / 2 / 0.5, rel=1e-4)
    assert told["source error"] == "Scene > Width: is 0 m, out of range; allowed: above 0, at most 100 m"
