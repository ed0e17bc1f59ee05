# SPDX-License-Identifier: GPL-3.0-or-later
"""The library: one array, and the frames of a sequence, the same as a preset makes."""

import json
import sys
from pathlib import Path

import cv2
from cases import cases
import fake_session
import numpy as np
import pytest
from refusals import refused
from worlds import ROOT, write_world
from runs import run

from noisy_world.perturbations.kinds import ColourPerturbation, DepthPerturbation
from noisy_world.core.geometry import Intrinsics
from noisy_world.images.pixels import quantise_depth, rgb_bytes
from noisy_world.dataset.plan import make_plan
from noisy_world.preset.keys import read_preset
from noisy_world.perturb import apply, frames
from noisy_world.perturbations import registry

RGB = [name for name, item in registry().items() if isinstance(item, ColourPerturbation)]
DEPTH = [name for name, item in registry().items() if isinstance(item, DepthPerturbation)]
MIXED = [
    {"gaussian_noise": {"severity": 2, "mode": "dynamic"}},
    {"contrast": {"severity": 3}},
    {"depth_gaussian_noise": {"severity": 3}},
    {"desync": {"offset": 2, "edge": "drop"}},
    {"faster_motion": {"factor": 2}},
]


def test_the_taxonomy_of_the_paper_is_whole():
    of_paper = [[name for name in names if registry()[name].source.startswith("paper")] for names in (RGB, DEPTH)]
    assert [len(names) for names in of_paper] == [16, 4]


@pytest.fixture(scope="module")
def picture():
    rng = np.random.default_rng(4)
    return cv2.GaussianBlur(rng.integers(0, 256, (60, 90, 3)).astype(np.uint8), (0, 0), 2)


@cases("name", RGB)
def test_bytes_and_floats_agree(name, picture):
    before = picture.copy()
    seen = {}
    if registry()[name].needs_depth:
        refused(apply, picture, name, severity=3, names=[name, "depth_m"], error=TypeError)
        seen["depth_m"] = np.linspace(0, 6, 60 * 90, dtype=np.float32).reshape(60, 90)
    low = apply(picture, name, severity=3, seed=5, frame=7, **seen)
    high = apply((picture / np.float32(255)).astype(np.float32), name, severity=3, seed=5, frame=7, **seen)
    assert (low.dtype, low.shape) == (np.uint8, picture.shape)
    assert (high.dtype, high.shape) == (np.float32, picture.shape)
    assert 0 <= high.min() <= high.max() <= 1
    assert np.array_equal(low, rgb_bytes(high))
    assert np.array_equal(picture, before)
    assert np.array_equal(apply(picture, name, severity=3, seed=5, frame=7, **seen), low)
    assert np.array_equal(low, picture) == (name == "white_balance"), "the picture is grey on average"
    assert np.array_equal(apply(picture, name, severity=0), picture)
    item = registry()[name]
    if item.temporals and not item.is_repeatable(item.at_severity(3)):
        still = item.temporals[0] == "fixed"
        assert np.array_equal(apply(picture, name, severity=3, seed=5, frame=8, **seen), low) == still
        assert not np.array_equal(apply(picture, name, severity=3, seed=6, frame=7, **seen), low)


@cases("name", DEPTH)
def test_depth_keeps_its_kind(name):
    depth_m = np.linspace(0.1, 9, 60 * 90, dtype=np.float32).reshape(60, 90)
    depth_m[20:30, 40:60] = 0
    before = depth_m.copy()
    seen = {"intrinsics": Intrinsics(90, 60, 50, 50, 44.5, 29.5)}
    if registry()[name].needs_rgb:
        refused(apply, depth_m, name, severity=5, **seen, names=[name, "rgb"], error=TypeError)
        seen["rgb"] = np.full((60, 90, 3), 128, np.uint8)
    found = apply(depth_m, name, severity=5, seed=1, **seen)
    assert (found.dtype, found.shape) == (np.float32, depth_m.shape)
    assert not found[20:30, 40:60].any()
    assert np.array_equal(depth_m, before)
    assert np.array_equal(apply(depth_m, name, severity=0), depth_m)


def test_what_apply_refuses(picture):
    refused(apply, picture, "fogg", severity=3, names=["fogg", "'fog'"])
    refused(apply, picture, "fog", severity=9, names="severity")
    refused(apply, picture, "desync", offset=3, names="desync", error=TypeError)


def test_the_iterator_gives_what_a_preset_writes(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
    world = write_world(tmp_path / "world", frames=9, size=(40, 32))

    run(world, tmp_path / "clean")
    folder = tmp_path / "clean/clean/box"
    preset = {
        "seed": 11,
        "scenes": [{"name": "box", "sequence": str(folder)}],
        "camera": {"width": 40, "height": 32, "fx": 20, "fy": 20, "cx": 19.5, "cy": 15.5},
        "render": {"backend": "reference"},
        "settings": [{"name": "mixed", "perturb": MIXED}],
        "output": {"image": "png"},
    }
    (tmp_path / "p.yaml").write_text(json.dumps(preset))
    run(tmp_path / "p.yaml", tmp_path / "out")
    out = tmp_path / "out/mixed/box"
    found = list(frames(folder, MIXED, seed=11, setting="mixed"))
    poses = np.loadtxt(out / "traj.txt").reshape(-1, 4, 4)
    assert len(found) == len(poses) == 3
    for item, pose in zip(found, poses, strict=True):
        rgb = cv2.imread(str(out / f"results/frame{item.index:06d}.png"))[..., ::-1]
        steps = cv2.imread(str(out / f"results/depth{item.index:06d}.png"), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(item.rgb, rgb)
        assert np.array_equal(quantise_depth(item.depth_m, 6553.5), steps)
        assert np.array_equal(item.c2w, pose)
    refused(frames, folder, [{"motion_deviation": None}], names="motion_deviation")


@cases("path", [path for path in sorted((ROOT / "presets").rglob("*.yaml")) if not path.name.startswith("noisy_")])
def test_presets_that_are_shipped_can_be_planned(path):
    plan = make_plan(read_preset(path))
    assert plan.settings[0].name == "clean"
    if path.parent.name == "perturbations":
        names = {step.perturbation.name for setting in plan.settings for step in setting.steps}
        assert names == {path.stem}


def test_every_perturbation_has_a_preset_of_its_own():
    assert {path.stem for path in Path(ROOT / "presets/perturbations").iterdir()} == set(registry())


def test_the_mixed_preset_is_the_paper_s_table():
    plan = make_plan(read_preset(ROOT / "presets/mixed.yaml"))
    # Rows of the table "Effect of mixed perturbations": in which of the six compositions each takes part.
    table = {
        "snow": [1, 2, 3, 4, 5, 6],
        "motion_blur": [2, 3, 4, 5, 6],
        "gaussian_noise": [3, 4, 5, 6],
        "jpeg_compression": [4, 5, 6],
        "depth_gaussian_noise": [5, 6],
        "desync": [6],
    }
    for number, setting in enumerate(plan.settings):
        there = {step.perturbation.name for step in setting.steps}
        assert there == {name for name, columns in table.items() if number in columns}
        assert {step.severity for step in setting.steps if step.perturbation.severities} <= {3.0}
