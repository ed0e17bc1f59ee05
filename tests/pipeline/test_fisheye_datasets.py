# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets of a fisheye that sees sideways: what is written, read back, and made a pinhole's again."""

import json

import cv2
import numpy as np
import pytest
import yaml
from analytic import box_depth, look_at
from cases import cases
from worlds import HIGH, LOW, write_replica, write_world
from runs import run

pytest.importorskip("embreex", reason="embreex is not installed: make .venv/.extras brings it")

import noisy_world
from noisy_world.layouts import find_sequence
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.lens import Distortion

SIZE, SCALE = (64, 48), 6553.5
CAMERA = Intrinsics(*SIZE, 20.0, 20.0, 31.5, 23.5)
KEYS = {"model": "equidistant", "k1": -0.01, "k2": 0.002}
LENS = Distortion("equidistant", (-0.01, 0.002, 0.0, 0.0))
POSES = np.stack([look_at([-0.4 + 0.1 * n, 0.1, 1.2], [1.0, 0.4, 1.0]) for n in range(3)])
SETTINGS = [
    {"name": "clean"},
    {"name": "rolling", "perturb": [{"rolling_shutter": {"readout_ms": 10}}]},
    {"name": "blurred", "perturb": [{"camera_motion_blur": {"shutter_ms": 40}}]},
]


def world(folder, *, settings=SETTINGS, layout="replica", **distortion):
    preset = write_world(
        folder, size=SIZE, settings=list(settings), render={"engine": "embree", "backend": "reference"},
        output={"layout": layout, "image": "png"},
    )  # fmt: skip
    write_replica(folder / "traj.txt", POSES)
    document = yaml.safe_load(preset.read_text())
    document["camera"] |= {"fx": 20.0, "fy": 20.0, "distortion": KEYS | distortion}
    preset.write_text(yaml.safe_dump(document))
    return preset


def angle():
    """(H, W): from the axis, radians, by the polynomial on a fine grid; and the rays (H, W, 3)."""
    u, v = np.meshgrid(np.arange(64), np.arange(48))
    x, y = (u - 31.5) / 20, (v - 23.5) / 20
    fine = np.linspace(0, np.pi, 400_001)
    theta = np.interp(np.hypot(x, y), fine * (1 - 0.01 * fine**2 + 0.002 * fine**4), fine)
    azimuth = np.arctan2(y, x)
    rays = np.stack([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)], axis=-1)
    return theta, rays


def depth_of(out, frame, name="clean"):
    return cv2.imread(str(out / name / f"box/results/depth{frame:06d}.png"), cv2.IMREAD_UNCHANGED) / SCALE


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fisheye")
    preset = world(folder)
    run(preset, folder / "out")
    return preset, folder / "out"


def test_depth_is_planar_up_to_85_degrees_and_void_beyond(made):
    theta, rays = angle()
    deep = theta < np.radians(85)
    assert theta.max() > np.radians(100)
    for frame in range(3):
        local = rays @ POSES[frame][:3, :3].T
        with np.errstate(divide="ignore"):
            away = np.sort(np.where(local > 0, HIGH - POSES[frame][:3, 3], LOW - POSES[frame][:3, 3]) / local, axis=-1)
        sure = away[..., 1] - away[..., 0] > 0.05
        depth_m = depth_of(made[1], frame)
        assert np.abs(depth_m - away[..., 0] * rays[..., 2])[deep & sure].max() < 0.5 / SCALE + 2e-5
        assert not depth_m[~deep].any()
        rgb = cv2.imread(str(made[1] / f"clean/box/results/frame{frame:06d}.png"))
        assert rgb[~deep].any(axis=-1).all(), "colour has no end there"


def test_blur_counts_what_is_beside_the_camera(made):
    line = json.loads((made[1] / "blurred/box/frames.jsonl").read_text().splitlines()[1])
    # It goes 2 m/s for 40 ms past a floor and walls that are 1.2 m away at least: 1.3 px of 20 a radian.
    assert line["perturbed"]["exposure"][0]["moments"] == 3


def test_a_frame_alone_is_that_of_the_run(made, tmp_path):
    run(made[0], tmp_path / "alone", frames=slice(1, 2))
    for name in ("clean", "rolling", "blurred"):
        for kind in ("frame", "depth"):
            file = f"{name}/box/results/{kind}000001.png"
            assert (tmp_path / "alone" / file).read_bytes() == (made[1] / file).read_bytes()


@cases("layout", ["replica", "tum", "euroc", "vslamlab"])
def test_layouts_and_readers_tell_its_lens_and_its_void(tmp_path, layout):
    folder = tmp_path / layout
    folder.mkdir()
    run(world(folder, settings=SETTINGS[:1], layout=layout), folder / "out")
    assert find_sequence(folder / "out/clean/box").optics.distortion == LENS
    opened = noisy_world.open(folder / "out")["clean/box"]
    assert opened.distortion == LENS
    deep = angle()[0] < np.radians(85)
    np.testing.assert_array_equal(opened[1].depth_m > 0, deep)


def test_undistorted_it_is_the_pinholes_and_whole(made, tmp_path):
    """A pinhole of the same intrinsics sees 116 degrees across, all of which the fisheye saw."""
    run(world(tmp_path, settings=SETTINGS[:1], undistort=True), tmp_path / "out")
    assert find_sequence(tmp_path / "out/clean/box").optics.plain
    for frame in range(3):
        true_m, sure = box_depth(CAMERA, POSES[frame], LOW, HIGH)
        depth_m = depth_of(tmp_path / "out", frame)
        assert (depth_m > 0).all()
        assert np.median(np.abs(depth_m / true_m - 1)[sure]) < 0.03  # of the nearest pixel
