# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth from rays against surfaces whose depth is known in closed form, in float64; what is void, and what is not."""

import numpy as np
import pytest

pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
pytestmark = pytest.mark.usefixtures("way_of_casting")

from analytic import (
    CAMERAS,
    box_depth,
    box_mesh,
    look_at,
    plane_depth,
    plane_mesh,
    quads_mesh,
    sphere_depth,
    sphere_mesh,
)
from cases import cases
from ray_tools import OPTIONS, cast

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import evenly_stamped
from noisy_world.render.ray_session import RaySession

SMALL = Intrinsics(120, 80, 60.0, 60.0, 59.5, 39.5)
LEVEL = look_at([0.2, -0.1, 0.3], [1.0, 0.4, 0.2])
VIEWS = [LEVEL, look_at([0.1, 0.2, -0.3], [0.1, 0.2, 1.0]), look_at([0.2, -0.1, 0.3], [1.0, 0.4, 0.2], roll_deg=180)]


def worst_error(depth_m, expected_m, inside):
    assert inside.sum() > 0.3 * inside.size, "the test sees too little"
    assert (depth_m[inside] > 0).all(), "a hole where there is a surface"
    return (np.abs(depth_m - expected_m)[inside] / expected_m[inside]).max()


@pytest.mark.one_python
@cases("camera", CAMERAS.values())
@cases("view", VIEWS)
def test_slanted_plane(camera, view):
    normal = view[:3, :3] @ np.array([0.5, 0.3, -0.8])
    normal /= np.linalg.norm(normal)
    point = view[:3, 3] + 2.5 * view[:3, 2]
    expected = plane_depth(camera, view, point, normal)
    depth = cast(plane_mesh(point, normal, half_size_m=60), view, camera).depth_m
    assert worst_error(depth, expected, np.isfinite(expected) & (expected < 40)) < 1e-5


@cases("towards", [[0.0, 1.0, 0.0], [-0.05, 0.3, -1.0], [0.0, 0.2, 1.0], [0.02, -1.0, 0.1]])
@cases("roll_deg", [0, 180, 37])
def test_along_a_wall_10_cm_away(towards, roll_deg):
    camera = Intrinsics(300, 170, 150.0, 150.0, 149.5, 84.5)
    eye = np.array([0.3, -0.7, 0.9])
    low, high = eye - np.array([0.1, 2.5, 1.5]), eye + np.array([4.0, 3.0, 2.2])
    view = look_at(eye, eye + towards, roll_deg)
    expected, sure = box_depth(camera, view, low, high)
    assert worst_error(cast(box_mesh(low, high), view, camera).depth_m, expected, sure) < 1e-5


def test_sphere():
    camera = CAMERAS["fx above fy"]
    centre = LEVEL[:3, 3] + 3.0 * LEVEL[:3, 2]
    expected, sure = sphere_depth(camera, LEVEL, centre, 2.0)
    depth = cast(sphere_mesh(centre, 2.0, rings=400), LEVEL, camera).depth_m
    # a ring's chord stands 2 (1 - cos(pi / 400)) = 6e-5 m from the arc, and a ray at 11 degrees goes 5 times as far
    assert worst_error(depth, expected, sure) < 3e-4
    assert (depth[~np.isfinite(expected)] == 0).all()


@cases("offset_m", [1e3, 1e5])
def test_far_from_the_origin(offset_m):
    view, shift = LEVEL.copy(), np.array([offset_m, -offset_m, offset_m / 2])
    view[:3, 3] += shift
    low, high = np.array([-1.5, -2.0, -1.0]) + shift, np.array([3.5, 2.5, 1.5]) + shift
    expected, sure = box_depth(SMALL, view, low, high)
    assert worst_error(cast(box_mesh(low, high), view, SMALL).depth_m, expected, sure) < 1e-5


def test_near_and_far_are_planes_as_a_camera_has_them():
    # Three boards head on, the first two within the near plane: what stands behind them is seen, the far one is not.
    # At the image's corners a ray is 1.6 times as long as its depth, so a range along rays would show.
    eye = look_at([0, 0, 0], [0, 1, 0])
    boards = [[[-9, y, -9], [9, y, -9], [9, y, 9], [-9, y, 9]] for y in (0.2, 0.29, 0.5)]
    mesh = quads_mesh(boards, [[255, 0, 0], [0, 255, 0], [0, 0, 255]])
    seen = cast(mesh, eye, SMALL, near_m=0.3, far_m=0.51)
    assert np.allclose(seen.depth_m, 0.5, rtol=1e-6)
    assert (seen.rgb == [0, 0, 1]).all()
    assert not cast(mesh, eye, SMALL, near_m=0.3, far_m=0.49).depth_m.any()
    assert not cast(mesh, eye, SMALL, near_m=0.3, far_m=0.49).rgb.any()
    assert np.allclose(cast(mesh, eye, SMALL, near_m=0.28, far_m=0.49).depth_m, 0.29, rtol=1e-6)


def test_walls_are_seen_from_both_sides_and_void_is_black():
    low, high = np.array([-1.0, -1.0, -1.0]), np.array([1.0, 1.0, 1.0])
    outside = look_at([0, -4, 0], [0, 1, 0])
    seen = cast(box_mesh(low, high), outside, SMALL)
    hit = seen.depth_m > 0
    assert np.allclose(seen.depth_m[hit], 3.0, rtol=1e-6)
    # 2 m at 3 m with 60 px a metre: pixel centres from -20 to 20 px around the middle, 40 of them
    assert hit.sum() == 40 * 40
    assert np.allclose(seen.rgb[hit], 128 / 255)
    assert not seen.rgb[~hit].any()
    assert cast(box_mesh(low, high), look_at([0, 0, 0], [0, 1, 0]), SMALL).depth_m.all()


def test_two_sensors_see_from_two_places():
    low, high = np.array([-1.5, -2.0, -1.0]), np.array([3.5, 2.5, 1.5])
    other = look_at([1.0, 0.5, 0.1], [-1.0, 0.2, 0.0])
    mesh = box_mesh(low, high)
    both = cast(mesh, LEVEL, SMALL, depth_c2w=other)
    expected, sure = box_depth(SMALL, other, low, high)
    assert worst_error(both.depth_m, expected, sure) < 1e-5
    alone = cast(mesh, LEVEL, SMALL, channels={"rgb"})
    assert alone.depth_m is None
    assert np.array_equal(both.rgb, alone.rgb)
    assert cast(mesh, other, SMALL, channels={"depth"}).rgb is None


def test_the_number_of_threads_decides_no_value():
    mesh = sphere_mesh(np.array([3.0, 0.8, 0.2]), 1.0, 60)
    one, three = (cast(mesh, LEVEL, SMALL, threads=count) for count in (1, 3))
    assert np.array_equal(one.depth_m, three.depth_m)
    assert np.array_equal(one.rgb, three.rgb)


@cases("size_px", [(1, 1), (3, 7), (200_000, 1)])
def test_any_size(size_px):
    focal_px = float(max(size_px))
    camera = Intrinsics(*size_px, focal_px, focal_px, (size_px[0] - 1) / 2, (size_px[1] - 1) / 2)
    seen = cast(box_mesh([-1, -1, -1], [1, 1, 1]), look_at([0, 0, 0], [0, 1, 0]), camera)
    assert seen.depth_m.shape == size_px[::-1]
    assert seen.depth_m.all()


def test_a_session_serves_paths_around_the_same_point():
    mesh = box_mesh([-1, -1, -1], [1, 1, 1])

    def at(x_m):
        return SensorPaths(evenly_stamped(look_at([x_m, 0, 0], [x_m, 1, 0])[None]))

    with RaySession(mesh, at(0.0), SMALL, OPTIONS) as session:
        assert session.serves(at(0.5), OPTIONS)
        assert not session.serves(at(500.0), OPTIONS)
