# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames whose lines are seen one after another, against images put together line by line from single frames."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
pytestmark = pytest.mark.usefixtures("way_of_casting")

from analytic import box_depth
from cases import cases
from shutters import CAMERA, HIGH, LOW, TURNS_DEG_S, moved, paths, psnr_db, room_session

from noisy_world.core.frame_request import RequestedRays, Shutter
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import Trajectory

READOUT_S = 0.04


def line_by_line(session, sensors, shutter):
    """Colour and depth, each line from a frame of its own."""
    rows = shutter.direction in ("down", "up")
    count = CAMERA.height_px if rows else CAMERA.width_px
    rgb, depth_m = np.empty((CAMERA.height_px, CAMERA.width_px, 3)), np.empty((CAMERA.height_px, CAMERA.width_px))
    for line, after_s in enumerate(shutter.line_times_s(count)):
        frame, place = session.frame(sensors.at(after_s)), np.s_[line] if rows else np.s_[:, line]
        rgb[place], depth_m[place] = frame.rgb[place], frame.depth_m[place]
    return rgb, depth_m


@pytest.mark.parametrize("motion", TURNS_DEG_S)
@cases("direction", ["down", "up", "right", "left"])
def test_each_line_is_seen_from_where_the_camera_is_then(motion, direction):
    sensors, shutter = paths(motion), Shutter.centred(0.0, READOUT_S, direction)
    with room_session(sensors) as session:
        instant = session.frame(sensors.request(1))
        seen = session.frame(replace(sensors.request(1), rays=RequestedRays(shutter)))
        rgb, depth_m = line_by_line(session, sensors, shutter)
    assert psnr_db(seen.rgb, rgb) > 65  # the bar
    assert (np.abs(seen.depth_m - depth_m) / depth_m).max() < 1e-6
    assert psnr_db(instant.rgb, rgb) < 25  # the camera moves by pixels meanwhile
    rows = direction in ("down", "up")
    places = shutter.line_times_s(CAMERA.height_px if rows else CAMERA.width_px)
    for line in range(0, len(places), 7):
        true_m, sure = box_depth(CAMERA, moved(motion, places[line]), LOW, HIGH)
        place = np.s_[line] if rows else np.s_[:, line]
        error = np.abs(seen.depth_m[place] / true_m[place] - 1)[sure[place]]
        assert error.size > 10
        assert error.max() < 1e-6


@cases("samples", [9, 16])
def test_more_rays_through_a_pixel_are_of_its_line_too(samples):
    sensors, shutter = paths("rotation"), Shutter.centred(0.0, READOUT_S)
    with room_session(sensors, samples=samples) as session:
        seen = session.frame(replace(sensors.request(1), rays=RequestedRays(shutter)))
        rgb, _ = line_by_line(session, sensors, shutter)
    # Which pixels are uneven is told from the image itself, so a few are others than in single frames.
    assert psnr_db(seen.rgb, rgb) > 40
    same = np.abs(seen.rgb - rgb).max(axis=-1) < 1e-6
    assert same.mean() > 0.97
    assert seen.colour_rays > CAMERA.width_px * CAMERA.height_px * 1.5


def test_depth_is_of_one_moment_or_from_another_place():
    sensors, shutter = paths("linear"), Shutter(0.0, 0.0, READOUT_S)
    with room_session(sensors) as session:
        instant = session.frame(sensors.request(1))
        seen = session.frame(replace(sensors.request(1), rays=RequestedRays(shutter, depth_rolls=False)))
        rolled = session.frame(replace(sensors.request(1), rays=RequestedRays(shutter)))
    assert np.array_equal(seen.depth_m, instant.depth_m)
    assert np.array_equal(seen.rgb, rolled.rgb)
    beside = sensors.rgb.c2w.copy()
    beside[:, :3, 3] += [0.05, 0.0, 0.02]
    both = SensorPaths(sensors.rgb, Trajectory(beside, sensors.rgb.stamps_s))
    with room_session(both) as session:
        apart = session.frame(replace(both.request(1), rays=RequestedRays(shutter)))
        _, depth_m = line_by_line(session, both, shutter)
    assert np.array_equal(apart.rgb, rolled.rgb)
    assert (np.abs(apart.depth_m - depth_m) / depth_m).max() < 1e-6
    assert not np.array_equal(apart.depth_m, rolled.depth_m)
