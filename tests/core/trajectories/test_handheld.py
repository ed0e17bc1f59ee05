# SPDX-License-Identifier: GPL-3.0-or-later
import os
import subprocess
import sys

import numpy as np
import pytest
from cases import cases
from refusals import refused

from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.geometry import rotation_angle_rad, rotation_error
from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.trajectories.handheld import handheld_path

ROOM = ((0.0, 0.0, 0.0), (6.0, 4.0, 2.6))
PILLAR = ((2.5, 0.0, 0.0), (3.0, 2.2, 2.6))  # leaves a passage of 1.8 m
TABLE = ((4.2, 2.9, 0.0), (4.8, 3.5, 0.7))
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def as_mesh(vertices_m, faces):
    faces = np.asarray(faces, dtype=np.int32)
    starts = np.arange(len(faces), dtype=np.int32) * faces.shape[1]
    return Mesh(np.asarray(vertices_m, dtype=np.float64), None, faces.ravel(), starts)


def boxes(*corners):
    """Boxes of six quads each: no vertex but the corners."""
    vertices = [[[x, y, z] for x in (a[0], b[0]) for y in (a[1], b[1]) for z in (a[2], b[2])] for a, b in corners]
    return as_mesh(np.reshape(vertices, (-1, 3)), np.concatenate([QUADS + 8 * i for i in range(len(corners))]))


def merged(*meshes):
    firsts = np.cumsum([0] + [len(m.vertices_m) for m in meshes])
    quads = [m.corner_vertices.reshape(-1, 4) + first for m, first in zip(meshes, firsts, strict=False)]
    return as_mesh(np.concatenate([m.vertices_m for m in meshes]), np.concatenate(quads))


def sheet(x, y, z):
    """A grid of small quads over two of the axes, the third one a number: how a scan looks."""
    grid = np.stack(np.broadcast_arrays(*np.meshgrid(x, y, z, indexing="ij")), axis=-1)
    rows, columns = (n for n in grid.shape[:3] if n > 1)
    index = np.arange(rows * columns).reshape(rows, columns)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    return as_mesh(grid.reshape(-1, 3), quads)


def distance_to_box_m(points_m, box):
    low, high = np.array(box)
    return np.linalg.norm(np.maximum(np.maximum(low - points_m, points_m - high), 0.0), axis=1)


def positions(trajectory):
    return trajectory.c2w[:, :3, 3]


def view_to_wall_m(trajectory, room):
    """How far the walls of an empty box are, level, in the middle of the view."""
    low, high = np.array(room)[:, :2]
    forward = trajectory.c2w[:, :2, 2] / np.linalg.norm(trajectory.c2w[:, :2, 2], axis=1, keepdims=True)
    wall = np.where(forward > 0, high, low)
    return np.min((wall - positions(trajectory)[:, :2]) / np.where(forward == 0, 1e-9, forward), axis=1)


@pytest.fixture(scope="module", params=[(0, False), (1, True), (7, False)])
def furnished(request):
    seed, revisit = request.param
    return handheld_path(boxes(ROOM, PILLAR, TABLE), seed=seed, frames=2000, revisit=revisit)


def share_that_comes_back(path, hz=20):
    """The share of frames after 20 s that see, from within 40 cm and 30 degrees, what a frame 20 s before saw."""
    points_m, forward = positions(path), path.c2w[:, :3, 2]
    late = range(20 * hz, len(points_m))
    return np.mean([
        np.any(
            (np.linalg.norm(points_m[: k - 20 * hz + 1] - points_m[k], axis=1) < 0.4)
            & (forward[: k - 20 * hz + 1] @ forward[k] > np.cos(np.deg2rad(30)))
        )
        for k in late
    ])  # fmt: skip


@pytest.mark.one_python
def test_a_path_that_revisits_comes_back_far_more_often():
    hall = boxes(((0.0, 0.0, 0.0), (10.0, 8.0, 3.0)), ((4.0, 3.0, 0.0), (6.0, 5.0, 1.0)))
    plain, looped = (handheld_path(hall, seed=1, frames=500, rate_hz=5, revisit=revisit) for revisit in (False, True))
    assert share_that_comes_back(looped, 5) > max(0.4, 1.5 * share_that_comes_back(plain, 5))
    np.testing.assert_array_equal(plain.c2w[:75], looped.c2w[:75])  # there is nothing to come back to yet


@pytest.mark.one_python
def test_stays_clear_of_walls_and_furniture(furnished):
    # Against the true surfaces, not against the points that the planner saw.
    at_m = positions(furnished)
    walls_m = np.minimum(at_m - ROOM[0], np.array(ROOM[1]) - at_m).min()
    assert walls_m >= 0.45
    assert distance_to_box_m(at_m, PILLAR).min() >= 0.45
    assert distance_to_box_m(at_m, TABLE).min() >= 0.45
    assert at_m[:, 2].min() >= 1.2
    assert at_m[:, 2].max() <= 1.7


@pytest.mark.one_python
@pytest.mark.parametrize("seed", [0, 3, 7])
def test_a_hand_that_wanders_gives_extent_in_three_axes_and_stays_clear(seed):
    room = boxes(ROOM, PILLAR, TABLE)
    plain, strayed = (handheld_path(room, seed=seed, frames=200, wander_m=wander_m) for wander_m in (0.0, 0.3))
    at_m = positions(strayed)
    extents_m = np.sqrt(np.sort(np.linalg.eigvalsh(np.cov(at_m.T, bias=True))))  # the least first
    assert np.sqrt(np.linalg.eigvalsh(np.cov(positions(plain).T, bias=True)).min()) < 0.03
    assert extents_m[0] > 0.05
    assert extents_m[1] > 0.1
    assert np.minimum(at_m - ROOM[0], np.array(ROOM[1]) - at_m).min() >= 0.45
    assert min(distance_to_box_m(at_m, PILLAR).min(), distance_to_box_m(at_m, TABLE).min()) >= 0.45
    assert 1.2 <= at_m[:, 2].min() < at_m[:, 2].max() <= 1.7
    assert np.linalg.norm(np.diff(at_m, axis=0), axis=1).max() * 20 < 1.0
    np.testing.assert_array_equal(plain.c2w[:, :3, :3], strayed.c2w[:, :3, :3])  # it looks where it looked


def test_walks_through_the_whole_room(furnished):
    at_m = positions(furnished)
    assert (at_m[:, 0] < 2.0).any()  # both sides of the pillar
    assert (at_m[:, 0] > 3.5).any()
    assert np.ptp(at_m[:, 0]) > 3.0
    assert np.ptp(at_m[:, 1]) > 1.5


def test_moves_smoothly(furnished):
    rate_hz = 20.0
    velocity_m_s = np.diff(positions(furnished), axis=0) * rate_hz
    speed_m_s = np.linalg.norm(velocity_m_s, axis=1)
    assert speed_m_s[:2].max() < 0.2  # from rest, the bob aside
    assert speed_m_s.max() < 0.7
    assert 0.3 < np.median(speed_m_s) < 0.55
    assert np.linalg.norm(np.diff(velocity_m_s, axis=0) * rate_hz, axis=1).max() < 2.0


def test_turns_smoothly_and_stays_level(furnished):
    rotation = furnished.c2w[:, :3, :3]
    turn_deg_s = np.degrees(rotation_angle_rad(rotation[:-1], rotation[1:])) * 20.0
    assert turn_deg_s.max() < 40.0
    assert np.abs(np.diff(turn_deg_s)).max() < 5.0  # no jerk from frame to frame
    right, down, forward = (rotation[:, :, axis] for axis in range(3))
    pitch_deg = np.degrees(np.arcsin(forward[:, 2]))
    assert pitch_deg.min() > -18.5
    assert pitch_deg.max() < 2.5
    assert np.degrees(np.arcsin(np.abs(right[:, 2]))).max() < 3.0
    assert (down[:, 2] < -0.9).all()  # not upside down
    assert rotation_error(rotation).max() < 1e-14
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0, atol=1e-14)
    np.testing.assert_array_equal(furnished.c2w[:, 3], np.tile([0, 0, 0, 1], (2000, 1)))
    np.testing.assert_array_equal(furnished.stamps_s, np.arange(2000) / 20.0)


def test_looks_everywhere(furnished):
    forward = furnished.c2w[:, :3, 2]
    yaw_deg = np.degrees(np.arctan2(forward[:, 1], forward[:, 0])) % 360
    share = np.histogram(yaw_deg, bins=8, range=(0, 360))[0] / 2000
    assert share.min() > 0.02
    assert share.max() < 0.4


def test_hand_shakes(furnished):
    # What a moving average of a second leaves over: millimetres and tenths of degrees, not nothing.
    at_m = positions(furnished)
    smooth_m = np.stack([np.convolve(column, np.ones(21) / 21, mode="valid") for column in at_m.T], axis=1)
    rest_m = np.abs(at_m[10:-10, 2] - smooth_m[:, 2])
    assert 2e-4 < rest_m.std() < 5e-3


@pytest.mark.one_python
def test_looks_toward_open_space_rather_than_at_near_walls():
    paths = [handheld_path(boxes(ROOM), seed=seed, frames=2000) for seed in range(3)]
    looked_m = np.concatenate([view_to_wall_m(path, ROOM) for path in paths])
    rng = np.random.default_rng(0)
    angle = rng.uniform(0, 2 * np.pi, len(looked_m))
    blind = np.concatenate([path.c2w for path in paths])
    blind[:, :2, 2] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    at_random_m = view_to_wall_m(type(paths[0])(blind, np.arange(len(blind))), ROOM)
    assert np.mean(looked_m) > 1.15 * np.mean(at_random_m)
    assert np.mean(looked_m < 1.0) < 0.75 * np.mean(at_random_m < 1.0)


def test_same_seed_same_bytes_in_another_process():
    script = (
        f"import sys; sys.path[:0] = {sys.path!r}\n"
        "from test_handheld import *\n"
        "sys.stdout.write(handheld_path(boxes(ROOM, PILLAR), seed=3, frames=300).c2w.tobytes().hex())"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "12345"}
    other = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert handheld_path(boxes(ROOM, PILLAR), seed=3, frames=300).c2w.tobytes().hex() == other.stdout


def test_other_seeds_walk_elsewhere():
    paths = [positions(handheld_path(boxes(ROOM), seed=seed, frames=400)) for seed in (0, 1, 2)]
    for a, b in ((0, 1), (0, 2), (1, 2)):
        assert np.linalg.norm(paths[a] - paths[b], axis=1).mean() > 0.5


@pytest.mark.one_python
def test_clear_of_every_vertex_of_a_scan():
    # Floor and four walls as small noisy quads, without a ceiling, a hole in the floor, a shelf that juts out.
    step = np.arange(0.0, 5.01, 0.04)
    up = np.arange(0.0, 2.41, 0.04)
    floor = sheet(step, step, 0.0)
    hole = np.linalg.norm(floor.vertices_m[:, :2] - [1.5, 2.5], axis=1) < 0.25
    kept = ~hole[floor.corner_vertices.reshape(-1, 4)].any(axis=1)
    floor = as_mesh(floor.vertices_m, floor.corner_vertices.reshape(-1, 4)[kept])
    walls = [sheet(0.0, step, up), sheet(5.0, step, up), sheet(step, 0.0, up), sheet(step, 5.0, up)]
    shelf = sheet(np.arange(3.5, 5.0, 0.04), np.arange(2.0, 3.0, 0.04), 1.4)
    scan = merged(floor, *walls, shelf)
    noise = np.random.default_rng(0).normal(0.0, 0.008, scan.vertices_m.shape)
    scan = as_mesh(scan.vertices_m + noise - [2.0, 3.0, 1.5], scan.corner_vertices.reshape(-1, 4))
    at_m = positions(handheld_path(scan, seed=0, frames=1500))
    nearest_m = min(np.linalg.norm(scan.vertices_m - here, axis=1).min() for here in at_m[::5])
    assert nearest_m >= 0.45
    assert (np.abs(at_m[:, 2] + 1.5 - 1.45) < 0.3).all()  # above a floor at -1.5
    # The hole of half a metre is floor: nothing that needs clearance.
    assert np.linalg.norm(at_m[:, :2] - [-0.5, -0.5], axis=1).min() < 0.4


def test_stays_in_an_l_shaped_room():
    # Two boxes' worth of floor, no roof over the missing corner x > 3, y > 3.
    outline = np.array([[0, 0], [6, 0], [6, 3], [3, 3], [3, 6], [0, 6]], dtype=np.float64)
    vertices = np.concatenate([np.column_stack([outline, np.full(6, z)]) for z in (0.0, 2.6)])
    walls = [[i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6] for i in range(6)]
    floors = [[0, 1, 2, 3], [0, 3, 4, 5], [6, 7, 8, 9], [6, 9, 10, 11]]
    at_m = positions(handheld_path(as_mesh(vertices, walls + floors), seed=0, frames=3000))
    corner = ((3.0, 3.0, -1.0), (9.0, 9.0, 9.0))
    assert distance_to_box_m(at_m, corner).min() >= 0.45
    assert at_m[:, 0].max() > 4.0  # both arms
    assert at_m[:, 1].max() > 4.0


@pytest.mark.one_python
def test_squeezes_around_the_ends_of_thin_walls():
    # Ways of half a metre that turn about with 0.1 m to spare: the widest curve would cut through the walls.
    room = ((0.0, 0.0, 0.0), (3.0, 1.8, 2.6))
    walls = [((0.0, 0.55, 0.0), (2.4, 0.6, 2.6)), ((0.6, 1.2, 0.0), (3.0, 1.25, 2.6))]
    for seed in range(3):
        at_m = positions(handheld_path(boxes(room, *walls), seed=seed, frames=2000, clearance_m=0.1))
        assert min(distance_to_box_m(at_m, wall).min() for wall in walls) >= 0.1
        assert at_m[:, 1].min() < 0.5
        assert at_m[:, 1].max() > 1.3
        acceleration_m_s2 = np.linalg.norm(np.diff(at_m, axis=0, n=2), axis=1) * 400.0
        assert acceleration_m_s2.max() < 1.3  # slower where it bends tighter


def test_faces_of_any_number_of_corners():
    twelve = np.stack([np.cos(np.arange(12) * np.pi / 6), np.sin(np.arange(12) * np.pi / 6)], axis=1) * 3.0
    vertices = np.concatenate([np.column_stack([twelve, np.full(12, z)]) for z in (0.0, 2.5)])
    sides = [[i, (i + 1) % 12, (i + 1) % 12 + 12, i + 12] for i in range(12)]
    corners = np.concatenate([np.arange(24), np.ravel(sides)]).astype(np.int32)
    starts = np.concatenate([[0, 12], 24 + 4 * np.arange(12)]).astype(np.int32)
    at_m = positions(handheld_path(Mesh(vertices, None, corners, starts), seed=0, frames=1000))
    assert np.linalg.norm(at_m[:, :2], axis=1).max() <= 3.0 * np.cos(np.pi / 12) - 0.45 + 0.05
    assert np.ptp(at_m[:, 0]) > 2.0


def test_ignores_the_garden():
    # A larger piece of ground outside, half a metre lower, without a roof.
    garden = sheet(np.arange(-8.0, -0.3, 0.1), np.arange(-2.0, 3.0, 0.1), -0.5)
    at_m = positions(handheld_path(merged(boxes(ROOM), garden), seed=0, frames=1000))
    assert (at_m[:, 0] > 0.45).all()
    assert (at_m[:, 2] >= 1.2).all()


def test_bounds_are_kept():
    bounds_m = np.array([[1.0, 1.0, 1.3], [3.0, 2.5, 1.45]])
    at_m = positions(handheld_path(boxes(ROOM), seed=0, frames=1500, bounds_m=bounds_m))
    assert (at_m >= bounds_m[0]).all()
    assert (at_m <= bounds_m[1]).all()
    assert np.ptp(at_m[:, 0]) > 1.0


@pytest.mark.one_python
def test_bounds_choose_a_room_of_a_wide_mesh():
    # A plane of a square kilometre is refused, or cut where the bounds say.
    plain = boxes(((-500.0, -500.0, -0.1), (500.0, 500.0, 0.0)))
    with pytest.raises(NoisyWorldError, match=r"spans 100\d x 100\d m; give bounds_m"):
        handheld_path(plain, seed=0, frames=10)
    room = merged(plain, boxes(ROOM))
    at_m = positions(handheld_path(room, seed=0, frames=100, bounds_m=[[0, 0, -9], [6, 4, 9]]))
    assert np.minimum(at_m[:, :2], np.array([6.0, 4.0]) - at_m[:, :2]).min() >= 0.45


def test_far_from_the_origin():
    far = np.array([1e5, -1e5, 300.0])
    there = handheld_path(boxes((far + ROOM[0], far + ROOM[1])), seed=0, frames=500)
    at_m = positions(there) - far
    assert np.minimum(at_m, np.array(ROOM[1]) - at_m).min() >= 0.45 - 1e-9
    assert np.linalg.norm(np.diff(at_m, axis=0), axis=1).max() < 0.04


@pytest.mark.one_python
def test_low_ceiling_moves_the_camera_down():
    low = ((0.0, 0.0, 0.0), (6.0, 4.0, 2.0))
    for seed in range(4):
        at_m = positions(handheld_path(boxes(low), seed=seed, frames=100))
        assert at_m[:, 2].max() <= 2.0 - 0.45
        assert at_m[:, 2].min() >= 1.2


@cases("rate_hz", [5.0, 30.0, 100.0])
def test_rates(rate_hz):
    path = handheld_path(boxes(ROOM), seed=0, frames=300, rate_hz=rate_hz)
    np.testing.assert_array_equal(path.stamps_s, np.arange(300) / rate_hz)
    rotation = path.c2w[:, :3, :3]
    assert (np.degrees(rotation_angle_rad(rotation[:-1], rotation[1:])) * rate_hz).max() < 40.0
    assert (np.linalg.norm(np.diff(positions(path), axis=0), axis=1) * rate_hz).max() < 0.7


def test_speed_and_clearance_are_followed():
    path = handheld_path(boxes(ROOM), seed=0, frames=600, speed_m_s=1.0, clearance_m=0.8)
    at_m = positions(path)
    assert np.minimum(at_m, np.array(ROOM[1]) - at_m).min() >= 0.8
    assert 0.6 < np.median(np.linalg.norm(np.diff(at_m, axis=0), axis=1)) * 20.0 < 1.1


def test_one_frame():
    one = handheld_path(boxes(ROOM), seed=0, frames=1)
    np.testing.assert_array_equal(one.stamps_s, [0.0])
    assert np.minimum(positions(one), np.array(ROOM[1]) - positions(one)).min() >= 0.45


def test_small_room_is_enough():
    at_m = positions(handheld_path(boxes(((0, 0, 0), (1.9, 1.7, 2.6))), seed=0, frames=2000))
    assert np.minimum(at_m[:, :2], np.array([1.9, 1.7]) - at_m[:, :2]).min() >= 0.45


@cases(
    ("given", "says"),
    [
        ({"clearance_m": 2.5}, ("0.00 m2", "lower clearance_m")),
        ({"eye_height_m": (2.4, 2.5)}, "change eye_height_m"),
        ({"bounds_m": [[0, 0, 3], [6, 4, 4]]}, ("eye_height_m", "outside of bounds_m")),
        ({"bounds_m": [[50, 0, 0], [60, 4, 3]]}, "nothing within bounds_m"),
    ],
)
def test_no_room(given, says):
    refused(handheld_path, boxes(ROOM), seed=0, frames=10, **given, names=says, error=NoisyWorldError)


def test_mesh_without_vertices_or_faces():
    for vertices, named in ((0, "nothing within"), (1, "free space")):
        mesh = Mesh(np.zeros((vertices, 3)), None, np.zeros(0, np.int32), np.zeros(0, np.int32))
        refused(handheld_path, mesh, seed=0, frames=10, names=named, error=NoisyWorldError)


@cases(
    "given",
    [
        {"frames": 0}, {"rate_hz": 0.0}, {"speed_m_s": 0.0}, {"clearance_m": -0.1}, {"eye_height_m": (1.7, 1.2)},
        {"bounds_m": [[0, 0, 0], [1, 1, 0]]}, {"bounds_m": [0, 0, 0, 1, 1, 1]},
    ],
)  # fmt: skip
def test_numbers_that_make_no_sense(given):
    with pytest.raises(ValueError, match=r"positive|bounds_m"):
        handheld_path(boxes(ROOM), **{"seed": 0, "frames": 10, **given})
