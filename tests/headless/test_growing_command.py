# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset grows by the command line, as a user types it: a recording is perturbed, so no Blender is needed."""

import cv2
import numpy as np
import pytest
import yaml
from worlds import content, generate, generate_here

CAMERA = {"width": 32, "height": 24, "fx": 16.0, "fy": 16.0, "cx": 15.5, "cy": 11.5}
THREE = [
    {"name": "clean"},
    {"name": "fog", "perturb": [{"fog": {"severity": 3}}]},
    {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 2}}, {"depth_gaussian_noise": None}]},
]
FOURTH = {"name": "dim", "perturb": [{"brightness": {"severity": 5}}]}


@pytest.fixture
def preset(tmp_path):
    results = tmp_path / "recording/results"
    results.mkdir(parents=True)
    rng = np.random.default_rng(5)
    for k in range(4):
        cv2.imwrite(str(results / f"frame{k:06d}.png"), rng.integers(0, 256, (24, 32, 3), np.uint8))
        cv2.imwrite(str(results / f"depth{k:06d}.png"), rng.integers(1, 60000, (24, 32), np.uint16))
    poses = "".join(f"1 0 0 {k} 0 1 0 0 0 0 1 0 0 0 0 1\n" for k in range(4))
    (tmp_path / "recording/traj.txt").write_text(poses)
    return write(tmp_path / "preset.yaml", THREE)


def write(path, settings, **keys):
    document = {
        "scenes": [{"name": "box", "sequence": "recording"}],
        "camera": CAMERA,
        "render": {"backend": "reference"},
        "settings": settings,
        "output": {"layout": "replica", "image": "png"},
        **keys,
    }
    path.write_text(yaml.safe_dump(document))
    return path


def marks(folder):
    files = [path for path in folder.glob("*/**/*") if path.is_file()]
    return {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in files}


def test_a_fourth_setting_is_added_and_a_changed_one_refused(preset, tmp_path):
    out = tmp_path / "out"
    generate_here(preset, "--out", out)
    three = marks(out)
    write(preset, [FOURTH, *THREE])
    result = generate_here(preset, "--out", out)
    assert "4 frames rendered" in result.stdout
    four = marks(out)
    assert {path: four[path] for path in three} == three
    assert {path.relative_to(out).parts[0] for path in four.keys() - three.keys()} == {"dim"}
    generate_here(preset, "--out", tmp_path / "at_once")
    assert content(out) == content(tmp_path / "at_once")

    result = generate_here(preset, "--out", out, "--set", "settings.2.perturb.0.fog.severity=4", check=False)
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()
    assert line == (
        f"generate.py: {out}: holds another dataset: settings: fog (severity) was 3, is 4; give it another name, "
        "choose another folder with --out, or replace the dataset with --overwrite"
    )
    assert marks(out) == four

    result = generate_here(preset, "--out", out, "--set", "settings=[{name: clean}]")
    assert "what this preset does not name stays as it is: dim/box, fog/box, noise/box" in result.stderr
    assert marks(out) == four


def test_processes_add_frames_to_a_dataset(preset, tmp_path):
    out = tmp_path / "out"
    generate_here(preset, "--out", out, "--frames", "1:3")
    images = {path: mark for path, mark in marks(out).items() if path.parent.name == "results"}
    write(preset, [*THREE, FOURTH])
    generate(preset, "--out", out, "--jobs", 2)
    assert {path: marks(out)[path] for path in images} == images
    generate_here(preset, "--out", tmp_path / "at_once")
    assert content(out) == content(tmp_path / "at_once")
