# SPDX-License-Identifier: GPL-3.0-or-later
"""A depth sensor with a camera of its own in Blender's engines: against the room's planes, and beside a lens."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import box_depth
from cases import cases
from engines import need_gl
from shutters import CAMERA, HIGH, LOW, coloured_room, paths

from noisy_world.core.geometry import Intrinsics, pose, rotation_from_euler_deg
from noisy_world.core.lens import Distortion
from noisy_world.render.source import RenderOptions
from noisy_world.trajectories.rig import Sensor, sensor_trajectory
from noisy_world.sources.renderers import open_session

DEPTH = Intrinsics(50, 31, 40.0, 37.0, 22.0, 16.5)
LENS = Distortion("radial-tangential", (-0.25, 0.06, 0.002, -0.001))
PLACE = pose(rotation_from_euler_deg(2.0, -3.0, 1.0), np.array([0.1, -0.02, 0.03]))


@cases(
    ("engine", "lens", "within"),
    [
        ("cycles", None, 2e-6),
        ("cycles", LENS, 2e-6),
        ("workbench", None, 2e-3),
        ("embree", None, 2e-6),
        ("embree", LENS, 2e-6),
    ],
)
def test_depth_is_seen_through_its_own_camera(engine, lens, within):
    if engine == "embree":
        pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
    need_gl(engine)
    own = paths("rotation")
    sensors = replace(own, depth=sensor_trajectory(own.rgb, Sensor(PLACE)))
    options = RenderOptions(near_m=0.01, far_m=100.0, samples=1, seed=0, engine=engine)
    deep = replace(options, depth_camera=DEPTH, through_glass=True)
    with open_session(coloured_room(smooth=True), "room", own, CAMERA, options, lens=lens) as session:
        plain = session.frame(own.request(1))
    with open_session(coloured_room(smooth=True), "room", sensors, CAMERA, deep, lens=lens) as session:
        first, second = (session.frame(sensors.request(number)) for number in (1, 1))
    for frame in (first, second):  # it looks through one camera and then the other, again and again
        np.testing.assert_array_equal(frame.rgb, plain.rgb)
        np.testing.assert_array_equal(frame.behind_glass_m, plain.depth_m)
        expected_m, sure = box_depth(DEPTH, sensors.request(1).depth_c2w, LOW, HIGH)
        assert frame.depth_m.shape == expected_m.shape
        assert sure.mean() > 0.5
        assert np.abs(frame.depth_m / expected_m - 1)[sure].max() < within
