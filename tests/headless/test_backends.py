# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings perturbed in the compositor and by the reference: one dataset, whatever makes it and in whatever order."""

import json
import os
import subprocess

import cv2
import numpy as np
import pytest
from worlds import GENERATE, ROOT, content, generate, generate_here, write_world

BLENDER = os.environ.get("NOISY_WORLD_BLENDER", "")
COUNT = 5
SETTINGS = [
    {"name": "clean"},
    {"name": "bright", "perturb": [{"brightness": {"severity": 2}}]},
    {"name": "bright_reference", "backend": "reference", "perturb": [{"brightness": {"severity": 2}}]},
    {"name": "bright_again", "perturb": [{"brightness": {"severity": 2}}]},
    {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 4, "mode": "dynamic"}}]},
    {"name": "noise_2", "stream": "noise", "perturb": [{"gaussian_noise": {"severity": 2}}]},
    {"name": "foggy", "perturb": [{"fog_depth": {"severity": 3}}, {"depth_random_missing": {"severity": 2}}]},
    {"name": "late", "perturb": [{"desync": {"offset": 1}}, {"faster_motion": {"factor": 2}}, {"snow": None}]},
    {"name": "shaky", "perturb": [{"motion_deviation": {"rotation_deg": 2}}, {"glass_blur": {"severity": 1}}]},
]


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("world")
    return write_world(folder, frames=COUNT, size=(96, 64), settings=SETTINGS, render={"engine": "cycles"})


@pytest.fixture(scope="module")
def out(world, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out") / "data"
    generate_here(world, "--out", folder)
    return folder


def colour(folder, setting, frame):
    return cv2.imread(str(folder / setting / f"box/results/frame{frame:06d}.png")).astype(int)


def test_what_each_backend_made_is_said(out):
    settings = json.loads((out / "manifest.json").read_text())["identity"]["settings"]
    backends = {name: setting["backend"] for name, setting in settings.items() if setting["backend"]}
    assert backends.pop("bright_reference") == "reference"
    assert backends == dict.fromkeys(
        ["bright", "bright_again", "noise", "noise_2", "foggy", "late", "shaky"], "compositor"
    )
    (note,) = json.loads((out / "noise/box/frames.jsonl").read_text().splitlines()[1])["perturbed"]["rgb"]
    assert note["name"] == "gaussian_noise"
    assert 0 <= note["node_seed"] < 2**24


def test_both_backends_agree_where_nothing_is_random(out):
    for frame in range(COUNT):
        one, other = colour(out, "bright", frame), colour(out, "bright_reference", frame)
        assert np.abs(one - other).max() <= 1
        assert np.abs(one - colour(out, "clean", frame)).max() > 10


def test_settings_share_what_one_backend_made(out):
    def file(setting, frame):
        return out / setting / f"box/results/frame{frame:06d}.png"

    for frame in range(COUNT):
        assert file("bright", frame).samefile(file("bright_again", frame))
        assert not file("bright", frame).samefile(file("bright_reference", frame))
    drawn, static = (
        [json.loads(line)["perturbed"]["rgb"][0] for line in (out / name / "box/frames.jsonl").read_text().splitlines()]
        for name in ("noise", "noise_2")
    )
    levels = [note["severity"] for note in drawn]
    assert 2 in levels
    assert set(levels) != {2}
    for frame, level in enumerate(levels):
        assert file("noise", frame).samefile(file("noise_2", frame)) == (level == 2)
        assert drawn[frame]["node_seed"] == static[frame]["node_seed"]


def test_jobs_and_choices_of_frames_change_no_byte(world, out, tmp_path):
    whole = content(out)
    generate(world, "--out", tmp_path / "two", "--jobs", 2)
    assert content(tmp_path / "two") == whole
    generate_here(world, "--out", tmp_path / "part", "--frames", "2:4")
    part = {name: data for name, data in content(tmp_path / "part").items() if "results" in name}
    assert len(part) >= 20
    assert all(whole[name] == data for name, data in part.items())


def test_a_lost_file_comes_back(world, out):
    before = content(out)
    lost = out / "noise/box/results/frame000003.png"
    lost.unlink()
    generate_here(world, "--out", out)
    assert content(out) == before


def test_a_sequence_that_exists_goes_through_the_compositor_too(world, out, tmp_path):
    preset = {
        "seed": 3,
        "scenes": [{"name": "box", "sequence": str(out / "clean/box")}],
        "camera": {"width": 96, "height": 64, "fx": 48, "fy": 48, "cx": 47.5, "cy": 31.5},
        "settings": [item for item in SETTINGS if item["name"] in ("noise", "foggy")],
        "output": {"image": "png"},
    }
    (tmp_path / "preset.json").write_text(json.dumps(preset))
    generate_here(tmp_path / "preset.json", "--out", tmp_path / "again")
    for frame in range(COUNT):
        # Stored frames are bytes, rendered ones float: half a step apart before the perturbation.
        assert np.abs(colour(tmp_path / "again", "noise", frame) - colour(out, "noise", frame)).max() <= 1
        assert np.abs(colour(tmp_path / "again", "foggy", frame) - colour(out, "foggy", frame)).max() <= 1


def test_depth_of_another_sensor_is_refused(world, tmp_path):
    rig = {"rgb": {}, "depth": {"translation_m": [0.1, 0, 0]}}
    result = generate_here(world, "--out", tmp_path / "rig", "--set", f"rig={json.dumps(rig)}", check=False)
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()
    assert "foggy" in line
    assert "rig.depth" in line


@pytest.mark.skipif(not BLENDER, reason="NOISY_WORLD_BLENDER names no Blender program")
def test_a_blender_program_makes_the_same_pixels(world, out, tmp_path):
    command = [BLENDER, "-b", "--factory-startup", "-P", str(GENERATE), "--", str(world), "--out", str(tmp_path / "b")]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, cwd=ROOT)
    assert result.returncode == 0, result.stderr
    for setting in ("bright", "noise", "foggy"):
        for frame in range(COUNT):
            assert np.abs(colour(tmp_path / "b", setting, frame) - colour(out, setting, frame)).max() <= 1
