# SPDX-License-Identifier: GPL-3.0-or-later
"""Light by one bounce in a corner of two walls, against an integral over the other wall in float64."""

import math

import numpy as np
import pytest
from analytic import plane_depth

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.srgb import encoded
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations import registry
from noisy_world.perturbations.shipped.time_of_flight import SPEED_OF_LIGHT_M_S

CAMERA = Intrinsics(320, 240, 240.0, 240.0, 159.5, 119.5)
ALBEDO, FAR_M, PATCH_PX = 0.6, 2.0, 8
TURN_M = SPEED_OF_LIGHT_M_S / (2 * 20e6)
# The normals of two walls that meet in a vertical line ahead: z = 2 + side x.
WALLS = {side: np.array([side, 0.0, -1.0]) / math.sqrt(2) for side in (-1, 1)}


def corner():
    both = [plane_depth(CAMERA, np.eye(4), np.array([0.0, 0.0, FAR_M]), -normal) for normal in WALLS.values()]
    return np.minimum(*both).astype(np.float32)


def measured(depth_m, **values):
    rgb = np.full((*depth_m.shape, 3), encoded(np.float32(ALBEDO)), np.float32)
    context = FrameContext(0, (1, "a", "b"), intrinsics=CAMERA, read_rgb=lambda: rgb)
    item = registry()["time_of_flight"]
    given = {"noise": 0, "spread": 0, "unambiguous_m": 0, "frequency_mhz": 20, "min_m": 0, "max_m": 50, "jump_m": 0}
    return item.apply(
        depth_m, item.parameters(**{**given, "least_electrons": 0, "most_electrons": 1e9, **values}), context
    )


def integrated_m(row, column, depth_m):
    """The range that direct light and one bounce off the other wall give together, seen from a pixel."""
    ray = np.array([(column - CAMERA.cx_px) / CAMERA.fx_px, (row - CAMERA.cy_px) / CAMERA.fy_px, 1.0])
    place = ray * float(depth_m[row, column])
    own, other = (WALLS[1], WALLS[-1]) if place[0] < 0 else (WALLS[-1], WALLS[1])
    # The other wall: from the corner on to its side, as far as the image shows it.
    along = np.array([-np.sign(place[0]), 0.0, -1.0]) / math.sqrt(2)
    size_m = 0.004
    s, t = np.meshgrid(np.arange(0, 2.4, size_m) + size_m / 2, np.arange(-1.6, 1.6, size_m) + size_m / 2)
    points = np.array([0.0, 0.0, FAR_M]) + s[..., None] * along + t[..., None] * np.array([0.0, 1.0, 0.0])
    u = points[..., 0] / points[..., 2] * CAMERA.fx_px + CAMERA.cx_px
    v = points[..., 1] / points[..., 2] * CAMERA.fy_px + CAMERA.cy_px
    seen = (points[..., 2] > 0.05) & (abs(u - 159.5) < 160) & (abs(v - 119.5) < 120)
    length = np.linalg.norm(points, axis=-1)
    way = points - place
    distance = np.linalg.norm(way, axis=-1)
    lit = np.maximum(-(points @ other), 0) / length**3
    form = np.maximum(-(way @ other), 0) * np.maximum(way @ own, 0) / (math.pi * distance**4)
    weight = ALBEDO * lit * form * seen * size_m**2
    range_m = np.linalg.norm(place)
    phasor = (-(place @ own) / range_m**3) * np.exp(2j * np.pi * range_m / TURN_M)
    phasor += (weight * np.exp(1j * np.pi * (length + distance + range_m) / TURN_M)).sum()
    return np.angle(phasor) % (2 * np.pi) * TURN_M / (2 * np.pi)


def test_a_corner_is_deeper_by_what_an_integral_over_the_other_wall_gives():
    depth_m = corner()
    plain, found = measured(depth_m), measured(depth_m, multipath=1)
    np.testing.assert_allclose(plain, depth_m, rtol=1e-4)
    for row, column in [(120, 60), (120, 110), (120, 135), (60, 190), (190, 215), (100, 260), (120, 175), (120, 156)]:
        ray = np.linalg.norm([(column - CAMERA.cx_px) / CAMERA.fx_px, (row - CAMERA.cy_px) / CAMERA.fy_px, 1.0])
        expected_m = integrated_m(row, column, depth_m) - float(depth_m[row, column]) * ray
        got_m = float(found[row, column] - depth_m[row, column]) * ray
        assert expected_m > 0.004
        assert got_m == pytest.approx(expected_m, rel=0.02 if abs(column - 159.5) > 2 * PATCH_PX else 0.06)


def test_a_wall_alone_sends_nothing_to_itself():
    depth_m = np.full((240, 320), 2.0, np.float32)
    np.testing.assert_allclose(measured(depth_m, multipath=1), measured(depth_m), atol=2e-4)
