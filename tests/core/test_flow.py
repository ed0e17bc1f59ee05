# SPDX-License-Identifier: GPL-3.0-or-later
"""Optical flow and what is hidden, against closed forms: a plane's homography, a room, a sphere before a wall."""

import numpy as np
from analytic import box_depth, look_at, plane_depth, rays, sphere_depth
from cases import cases

from noisy_world.channels.flow import CHANNEL, OCCLUDED, OUTSIDE, SEEN, VOID
from noisy_world.channels.channel import View
from noisy_world.core.geometry import Intrinsics

CAMERA = Intrinsics(121, 83, 90.0, 70.0, 55.5, 44.25)  # an odd size, and a middle of its own
SHAPE = (CAMERA.height_px, CAMERA.width_px)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)


def inside(x, y):
    return (x >= -0.5) & (x <= SHAPE[1] - 0.5) & (y >= -0.5) & (y <= SHAPE[0] - 0.5)


def flow_of(here_m, there_m, here, there):
    views = (
        View(np.where(np.isfinite(depth_m), depth_m, 0).astype(np.float32), c2w, CAMERA)
        for depth_m, c2w in ((here_m, here), (there_m, there))
    )
    flow = CHANNEL.of_views(*views)
    assert flow.dtype == np.float32
    assert flow.shape == (*SHAPE, 3)
    return flow[..., 0], flow[..., 1], flow[..., 2]


def moved(right_m=0.0, down_m=0.0, forward_m=0.0, about=(0, 0, 1), angle_deg=0.0):
    """The pose of the next camera in the first one: a translation, and a turn about an axis, by Rodrigues."""
    x, y, z = np.asarray(about) / np.linalg.norm(about)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(angle_deg)
    pose = np.eye(4)
    pose[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    pose[:3, 3] = right_m, down_m, forward_m
    return pose


MOTIONS = [
    {"right_m": 0.08, "down_m": -0.03},
    {"forward_m": 0.3},
    {"about": (0, 1, 0), "angle_deg": 4.0},
    {"about": (0, 0, 1), "angle_deg": 25.0},  # roll
    {"right_m": -0.05, "down_m": 0.02, "forward_m": -0.1, "about": (1, -2, 3), "angle_deg": 7.0},
]


@cases("motion", MOTIONS)
def test_a_plane_goes_by_its_homography(motion):
    step, here = moved(**motion), look_at([2.0, -1.0, 1.5], [4.0, 0.5, 1.2], roll_deg=11)
    normal, distance_m = np.array([0.4, -0.3, -0.87]) / np.linalg.norm([0.4, -0.3, -0.87]), 2.5
    there = here @ step
    point, world_normal = here[:3, 3] - distance_m * here[:3, :3] @ normal, here[:3, :3] @ normal
    depths_m = [plane_depth(CAMERA, c2w, point, world_normal) for c2w in (here, there)]
    dx, dy, hidden = flow_of(*depths_m, here, there)

    back = np.linalg.inv(step)
    homography = (
        CAMERA.matrix @ (back[:3, :3] - np.outer(back[:3, 3], normal) / distance_m) @ np.linalg.inv(CAMERA.matrix)
    )
    x, y, w = np.einsum("ij,jhw->ihw", homography, np.stack([U, V, np.ones(SHAPE)]))
    x, y = x / w, y / w
    seen = np.isfinite(depths_m[0])
    assert seen.mean() > 0.7
    assert max(np.abs(dx - (x - U))[seen].max(), np.abs(dy - (y - V))[seen].max()) < 1e-3
    assert (hidden[~seen] == VOID).all()
    assert not dx[~seen].any()
    assert np.array_equal(hidden[seen], np.where(inside(x, y), SEEN, OUTSIDE)[seen])


@cases("motion", MOTIONS)
def test_nothing_hides_anything_in_an_empty_room(motion):
    """Between the rows of pixels, its corners lie deeper than any pixel says."""
    low, high, step = [-2.0, -1.5, 0.0], [2.0, 1.5, 2.5], moved(**motion)
    for yaw in np.arange(0, 2 * np.pi, 0.7):
        here = look_at([0.3, 0.2, 1.1], [0.3 + np.cos(yaw), 0.2 + np.sin(yaw), 1.4])
        there = here @ step
        depths_m = [box_depth(CAMERA, c2w, low, high)[0] for c2w in (here, there)]
        dx, dy, hidden = flow_of(*depths_m, here, there)
        assert np.array_equal(hidden, np.where(inside(U + dx, V + dy), SEEN, OUTSIDE))


CENTRE, RADIUS = np.array([0.1, 2.0, 0.05]), 0.8
WALL = (np.array([0.0, 4.0, 0.0]), np.array([0.2, -1.0, 0.1]))


def sphere_and_wall(c2w):
    sphere_m, _ = sphere_depth(CAMERA, c2w, CENTRE, RADIUS)
    return np.minimum(sphere_m, plane_depth(CAMERA, c2w, *WALL)), np.isfinite(sphere_m)


def sphere_hides(eye, points):
    """Whether the sphere lies between points (..., 3) and an eye: where the way enters it before it ends."""
    way = points - eye
    a, b = np.einsum("...k,...k", way, way), np.einsum("...k,k", way, eye - CENTRE)
    square = b**2 - a * ((eye - CENTRE) @ (eye - CENTRE) - RADIUS**2)
    enters = (-b - np.sqrt(np.maximum(square, 0))) / a
    return (square > 0) & (enters < 1 - 1e-6)


AROUND = {"right_m": -1.2, "about": (0, 1, 0), "angle_deg": 30.0}


@cases("motion", [{"right_m": 0.3}, {"down_m": 0.25, "forward_m": 0.2, "angle_deg": 10.0}, AROUND])
def test_what_a_sphere_hides_is_told_up_to_its_outline(motion):
    here = look_at([0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    there = here @ moved(**motion)
    here_m, on_sphere = sphere_and_wall(here)
    there_m, _ = sphere_and_wall(there)
    dx, dy, hidden = flow_of(here_m, there_m, here, there)
    points = here[:3, 3] + here_m[..., None] * rays(CAMERA, here)
    expected = np.where(inside(U + dx, V + dy), np.where(sphere_hides(there[:3, 3], points), OCCLUDED, SEEN), OUTSIDE)
    assert (expected[~on_sphere] == OCCLUDED).sum() > 50  # of the wall, and of the sphere itself
    assert (expected[on_sphere] == OCCLUDED).sum() > (50 if motion is AROUND else -1)
    assert np.array_equal(hidden == OUTSIDE, expected == OUTSIDE)

    # Between four pixels one may see the wall: so near the outline, what the sphere hides may be told as seen.
    meets = []
    for angle in np.arange(0, 2 * np.pi, np.pi / 8):
        near = np.stack(
            [
                (U + dx + 1.5 * np.cos(angle) - CAMERA.cx_px) / CAMERA.fx_px,
                (V + dy + 1.5 * np.sin(angle) - CAMERA.cy_px) / CAMERA.fy_px,
                np.ones(SHAPE),
            ],
            axis=-1,
        )
        meets.append(sphere_hides(there[:3, 3], there[:3, 3] + 10 * near @ there[:3, :3].T))
    beside = ~np.all(meets, axis=0)
    assert np.array_equal(hidden[~beside], expected[~beside])
    assert (hidden[hidden != expected] == SEEN).all()
    assert (hidden != expected).sum() < 0.2 * (expected == OCCLUDED).sum() + 40


def test_the_next_frames_void_tells_nothing_and_behind_the_camera_is_outside():
    here, there_m = np.eye(4), np.full(SHAPE, 2.0)
    there_m[:40] = 0
    dx, dy, hidden = flow_of(np.full(SHAPE, 2.0), there_m, here, here)
    assert (hidden[:39] == VOID).all()  # the row after lies beside pixels with depth
    assert (hidden[40:] == SEEN).all()
    assert max(np.abs(dx).max(), np.abs(dy).max()) < 1e-6
    dx, dy, hidden = flow_of(np.full(SHAPE, 2.0), np.full(SHAPE, 2.0), here, moved(forward_m=3.0))
    assert (hidden == OUTSIDE).all()
    assert not dx.any()
    assert not dy.any()
    assert (CHANNEL.of_last(CAMERA) == [0, 0, VOID]).all()


def test_what_moves_is_where_the_renderer_says_and_hidden_where_nothing_brings_it_back():
    """All goes 3 px right and 2 up, but for a block of the next view that stays: it lies before what goes there."""
    depth_m, ahead = np.full(SHAPE, 2, np.float32), np.tile(np.float32([3, -2]), (*SHAPE, 1))
    nearer_m, back = depth_m.copy(), -ahead
    nearer_m[30:50, 40:60], back[30:50, 40:60] = 1, 0
    views = (View(depth_m, np.eye(4), CAMERA, ahead), View(nearer_m, np.eye(4), CAMERA, back))
    dx, dy, hidden = np.moveaxis(CHANNEL.of_views(*views), -1, 0)
    assert (dx == 3).all()
    assert (dy == -2).all()
    lands_x, lands_y = U + 3, V - 2
    assert ((hidden == OUTSIDE) == ~inside(lands_x, lands_y)).all()
    within = (abs(lands_x - 49.5) < 7) & (abs(lands_y - 39.5) < 7)
    beyond = (abs(lands_x - 49.5) > 13) | (abs(lands_y - 39.5) > 13)
    assert (hidden[within] == OCCLUDED).all()
    assert (hidden[beyond & inside(lands_x, lands_y)] == SEEN).all()
