# SPDX-License-Identifier: GPL-3.0-or-later
"""Blur of the camera's motion against the mean light of 256 frames, and against an edge's spread in closed form."""

from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")

from analytic import look_at
from cases import cases
from ray_tools import OPTIONS, polygons
from shutters import CAMERA, coloured_room, moved, paths, psnr_db, room_session
from srgb import encoded, linear

from noisy_world.core.geometry import Intrinsics
from noisy_world.perturbations.kinds import SceneAround
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.dataset.rendering import ExposedSource
from noisy_world.core.lens import PINHOLE, Distortion, Optics
from noisy_world.core.camera_motion import travel_px
from noisy_world.core.schema import ConfigPath
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import Trajectory
from noisy_world.perturbations import registry
from noisy_world.perturbations.shipped.camera_motion_blur import CameraMotionBlur, apply, moment_count, openness
from noisy_world.render.ray_session import RaySession

SHUTTER_S = 0.016
SPEED = {"linear": 12.0, "rotation": 12.0, "roll": 12.0, "vibration": 1.0}  # blurs of 5 to 20 pixels


def blurred(session, sensors, *more, camera=CAMERA, optics=PINHOLE, **parameters):
    """The frame of the path's middle pose, as a render exposes it."""
    blur = {"camera_motion_blur": {"shutter_ms": 1000 * SHUTTER_S, **parameters}}
    steps = parse_steps([*more, blur], ConfigPath("test"), registry())
    scene = SimpleNamespace(source=SimpleNamespace(capabilities=SimpleNamespace(moving=False)))
    render = SimpleNamespace(exposure=steps, camera=camera, measured_camera=camera, scene=scene, optics=optics)
    return ExposedSource(session, render).frame(sensors.request(len(sensors) // 2))


@pytest.mark.parametrize("motion", ["linear", "rotation", "roll", "vibration"])
def test_blur_is_the_mean_light_of_the_exposure(motion):
    sensors = paths(motion, 81, 4000.0, SPEED[motion])
    with room_session(sensors, mesh=coloured_room(smooth=True)) as session:
        made = blurred(session, sensors)
        places = (np.arange(256) + 0.5) / 256
        frames = (session.frame(sensors.at(SHUTTER_S * (place - 0.5))).rgb for place in places)
        true = encoded(np.mean([linear(rgb.astype(np.float64)) for rgb in frames], axis=0))
        sharp = session.frame(sensors.request(40))
    assert psnr_db(made.rgb, true) > 50  # the bar
    assert psnr_db(sharp.rgb, true) < 40
    assert np.array_equal(made.depth_m, sharp.depth_m)
    (note,) = made.exposure
    shown_s = SPEED[motion] * np.linspace(-0.5, 0.5, 33) * SHUTTER_S
    assert note["moments"] == moment_count(
        travel_px(sharp.depth_m, sensors.rgb.c2w[40], moved(motion, shown_s), CAMERA, CAMERA),
        CameraMotionBlur(),
    )


@cases("ramp", [0.0, 0.5, 1.0])
def test_an_edge_spreads_as_the_shutter_is_open(ramp):
    # A bright board beside a dark one, 1 m away; the camera goes by 24 pixels to the right within the exposure.
    camera, length_px = Intrinsics(64, 4, 100.0, 100.0, 31.5, 1.5), 24.0
    eye = look_at([0, 0, 0], [0, 1, 0])
    stamps_s = np.arange(-2, 3) * SHUTTER_S
    c2w = np.repeat(eye[None], 5, axis=0)
    c2w[:, 0, 3] = stamps_s / SHUTTER_S * length_px / camera.fx_px
    boards = [[[x, 1, -1], [x + 9, 1, -1], [x + 9, 1, 1], [x, 1, 1]] for x in (0.0, -9.0)]
    mesh = polygons(boards, [np.full((4, 3), value) for value in (230, 20)])
    sensors = SensorPaths(Trajectory(c2w, stamps_s))
    with room_session(sensors, camera, mesh, samples=64) as session:
        made = blurred(session, sensors, camera=camera, ramp=ramp)
    dark, bright = linear(np.array([20, 230]) / 255)
    seen = (linear(made.rgb[1, :, 0].astype(np.float64)) - dark) / (bright - dark)
    # A pixel is bright for as long as the edge is to its left: the opened share, meant over the pixel's width.
    fine = np.linspace(0, 1, 20001)
    height = openness((fine[1:] + fine[:-1]) / 2, ramp)
    opened = np.concatenate([[0], np.cumsum(height)]) / height.sum()
    pixels = np.arange(64)[:, None] - 31.5 + (np.arange(50) + 0.5) / 50 - 0.5
    true = np.interp(pixels / length_px + 0.5, fine, opened).mean(axis=1)
    assert np.abs(seen - true).max() < 0.01  # the bar
    spread, wanted = (np.diff(values) @ np.diff(values) for values in (seen, true))
    assert spread == pytest.approx(wanted, rel=0.01)


def test_moments_are_odd_bounded_and_of_the_blur():
    usual = CameraMotionBlur()
    assert [moment_count(px, usual) for px in (0, 0.1, 2, 2.1, 19, 1e9)] == [1, 3, 3, 5, 21, 129]
    assert moment_count(19, CameraMotionBlur(moments_per_px=0.8)) == 17
    assert [moment_count(50, CameraMotionBlur(most_moments=most)) for most in (1, 2, 3, 4)] == [1, 1, 3, 3]


def test_a_pole_between_the_pixels_of_the_grid_is_not_missed():
    """A camera that goes sideways: what is z away goes f s / z on the image."""
    depth_m = np.full((180, 320), 4.0, np.float32)
    depth_m[:, 166] = 0.4
    camera = Intrinsics(320, 180, 300.0, 300.0, 159.5, 89.5)
    path = np.tile(np.eye(4), (33, 1, 1))
    path[:, 0, 3] = np.linspace(-0.01, 0.01, 33)
    assert travel_px(depth_m, np.eye(4), path, camera, camera) == pytest.approx(300 * 0.02 / 0.4, rel=1e-6)
    depth_m[:, 166] = 4.0
    assert travel_px(depth_m, np.eye(4), path, camera, camera) == pytest.approx(300 * 0.02 / 4.0, rel=1e-6)


def test_what_is_brighter_than_white_stays_so_in_the_mean():
    # A lamp of sixteen times white for one of three moments: encoded by sRGB's curve, which goes on above 1.
    lamp, dark = np.float32(1.055 * 16 ** (1 / 2.4) - 0.055), np.float32(0)

    def take(seconds, _channels):
        value = lamp if abs(seconds) < 1e-9 else dark
        return SimpleNamespace(rgb=np.full((2, 2, 3), value), depth_m=np.ones((2, 2), np.float32))

    rgb, _ = apply(SceneAround(take, lambda times_s: 3.0), CameraMotionBlur(most_moments=3))
    assert rgb == pytest.approx(1.055 * (16 / 3) ** (1 / 2.4) - 0.055, rel=1e-5)


def test_depth_is_of_the_moment_that_is_asked_for():
    sensors = paths("linear", 81, rate_hz=4000.0)
    with room_session(sensors) as session:
        for depth, stamp, after_s in (("start", "middle", -0.5), ("end", "middle", 0.5), ("middle", "start", 0.5)):
            made = blurred(session, sensors, depth=depth, stamp=stamp)
            there = session.frame(sensors.at(after_s * SHUTTER_S))
            np.testing.assert_array_equal(made.depth_m, there.depth_m)
            assert made.exposure[0]["moments"] % 2 == 1  # depth's own moment is none of light
        still = SensorPaths(Trajectory(np.repeat(sensors.rgb.c2w[:1], 5, axis=0), np.arange(5.0)))
        same = blurred(session, still)
        assert same.exposure[0]["moments"] == 1
        assert np.array_equal(same.rgb, session.frame(still.request(2)).rgb)


@pytest.mark.parametrize("lens", [None, Distortion("radial-tangential", (-0.28, 0.07, 2e-3, -1e-3))])
def test_blur_and_rolling_shutter_are_one_exposure_of_each_row_behind_a_lens_too(lens):
    sensors = paths("rotation", 81, 2000.0, SPEED["rotation"])
    readout = {"readout_ms": 12.0, "direction": "down"}
    room = coloured_room(smooth=True)
    with RaySession(room, sensors, CAMERA, OPTIONS, lens) as session:
        made = blurred(session, sensors, {"rolling_shutter": readout}, optics=Optics(distortion=lens))
        true = np.empty((CAMERA.height_px, CAMERA.width_px, 3))
        for row in range(0, CAMERA.height_px, 5):
            middle_s = 0.012 * ((row + 0.5) / CAMERA.height_px - 0.5)
            times_s = middle_s + SHUTTER_S * ((np.arange(64) + 0.5) / 64 - 0.5)
            light = [linear(session.frame(sensors.at(time_s)).rgb[row].astype(np.float64)) for time_s in times_s]
            true[row] = encoded(np.mean(light, axis=0))
    rows = slice(0, CAMERA.height_px, 5)
    assert psnr_db(made.rgb[rows], true[rows]) > 50
    rolling, blur = made.exposure
    assert rolling["lines"]["last"]["after_s"] == pytest.approx(0.006 * (1 - 1 / CAMERA.height_px))
    assert blur["shutter"] == asdict(registry()["camera_motion_blur"].shutter(CameraMotionBlur()))
    assert blur["moments"] > 3
    assert "moments" not in rolling
