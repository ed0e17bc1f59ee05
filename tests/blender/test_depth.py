# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendered depth and colour against surfaces whose depth is known in closed form, in float64."""

from dataclasses import replace

import numpy as np
import pytest

from analytic import (
    CAMERAS,
    box_depth,
    box_mesh,
    look_at,
    plane_depth,
    plane_mesh,
    rays,
    sphere_depth,
    sphere_mesh,
)
from cases import cases

from noisy_world.render.mesh_session import Session
from noisy_world.core.geometry import Intrinsics
from noisy_world.render.source import RenderOptions
from noisy_world.core.frame_request import SensorPaths
from noisy_world.core.trajectory import evenly_stamped

OPTIONS = RenderOptions(near_m=0.01, far_m=1000.0, samples=1, seed=0)
POINTS = {
    "level": look_at([0.2, -0.1, 0.3], [1.0, 0.4, 0.2]),
    "straight up": look_at([0.1, 0.2, -0.3], [0.1, 0.2, 1.0]),
    "straight down": look_at([0.1, 0.2, 0.3], [0.1, 0.2, -1.0]),
    "rolled 180": look_at([0.2, -0.1, 0.3], [1.0, 0.4, 0.2], roll_deg=180),
}


def render(mesh, c2w, camera, options=OPTIONS):
    paths = SensorPaths(evenly_stamped(np.asarray(c2w)[None]))
    with Session(mesh, "test", paths, camera, options) as session:
        return session.frame(paths.request(0))


def relative_error(depth_m, expected_m, *, inside):
    assert inside.sum() > 0.3 * inside.size or inside.sum() > 10_000, "the test sees too little"
    assert (depth_m[inside] > 0).all(), "a hole where there is a surface"
    return np.abs(depth_m[inside] - expected_m[inside]) / expected_m[inside]


def slanted_plane_error(camera, view):
    """The relative error of a plane that crosses the view at 45 degrees or so, whatever the view."""
    normal = view[:3, :3] @ np.array([0.5, 0.3, -0.8])
    normal /= np.linalg.norm(normal)
    point = view[:3, 3] + 2.5 * view[:3, 2]
    expected = plane_depth(camera, view, point, normal)
    depth = render(plane_mesh(point, normal, half_size_m=60), view, camera).depth_m
    return relative_error(depth, expected, inside=np.isfinite(expected) & (expected < 40)).max()


@cases("camera", CAMERAS.values())
@cases("view", POINTS.values())
def test_slanted_plane(camera, view):
    assert slanted_plane_error(camera, view) < 1e-5


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("towards", [[0.0, 1.0, 0.0], [-0.05, 0.3, -1.0], [0.0, 0.2, 1.0], [0.02, -1.0, 0.1]])
def test_grazing_box(towards, samples):
    # 10 cm off one wall of a room, looking along it: rays meet it at down to 1 degree. Upside down, a share of a pixel
    # to one side shows as one to the other.
    camera = Intrinsics(300, 170, 150.0, 150.0, 149.5, 84.5)
    eye = np.array([0.3, -0.7, 0.9])
    low, high = eye - np.array([0.1, 2.5, 1.5]), eye + np.array([4.0, 3.0, 2.2])
    for roll_deg in (0, 180, 37):
        view = look_at(eye, eye + towards, roll_deg)
        expected, sure = box_depth(camera, view, low, high)
        assert _smallest_sine(camera, view, low, expected) < 0.05
        depth = render(box_mesh(low, high), view, camera, replace(OPTIONS, samples=samples)).depth_m
        assert relative_error(depth, expected, inside=sure).max() < 1e-5, f"rolled by {roll_deg} degrees"


def _smallest_sine(camera, view, low, depth):
    direction = rays(camera, view)
    on_wall = np.isclose(view[0, 3] + depth * direction[..., 0], low[0])
    return (np.abs(direction[..., 0]) / np.linalg.norm(direction, axis=-1))[on_wall].min()


def test_sphere():
    camera = CAMERAS["off centre"]
    view = POINTS["level"]
    centre = view[:3, 3] + 3.0 * view[:3, 2]
    expected, sure = sphere_depth(camera, view, centre, 1.2)
    depth = render(sphere_mesh(centre, 1.2, rings=1700), view, camera).depth_m
    assert relative_error(depth, expected, inside=sure).max() < 1e-5


@cases("offset_m", [0.0, 1e3, 1e4, 1e5])
def test_far_from_the_origin(offset_m):
    view = POINTS["level"].copy()
    view[:3, 3] += np.array([offset_m, -offset_m, offset_m / 2])
    assert slanted_plane_error(CAMERAS["replica"], view) < 1e-5
