# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies that carry the camera: their motion against closed forms and published figures, and the walls."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refused

from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.geometry import opencv_from_robot_c2w, pose, rotation_from_euler_deg, rotvec_from_rotation
from noisy_world.core.trajectory import evenly_stamped
from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.trajectories.bodies import BODIES, RATE_HZ, embodied
from noisy_world.trajectories.handheld import handheld_path
from noisy_world.trajectories.room_map import first_narrow

QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
LONG_S = 40


pytestmark = pytest.mark.one_python


def straight(speed_m_s, seconds=LONG_S, height_m=1.6, turn_deg=30.0, from_m=(0.0, 0.0)):
    """A level way along a line, looking along it, at 10 Hz."""
    at_s = np.arange(0.0, seconds + 0.05, 0.1)
    angle = np.deg2rad(turn_deg)
    xy_m = np.array(from_m) + np.outer(at_s * speed_m_s, [np.cos(angle), np.sin(angle)])
    facing = np.broadcast_to(rotation_from_euler_deg(0, 0, turn_deg), (len(at_s), 3, 3))
    return evenly_stamped(
        opencv_from_robot_c2w(pose(facing, np.column_stack([xy_m, np.full(len(at_s), height_m)]))), 10
    )


def beside(path, route, hz=100.0):
    """What a body adds to its route, in the route's axes (forward, left, up), and turns (roll, pitch, yaw), degrees."""
    at_s = np.arange(5.0, route.stamps_s[-1] - 5.0, 1.0 / hz)
    mean, own = route.poses_at(at_s), path.poses_at(at_s)
    axes = np.stack([mean[:, :3, 2], -mean[:, :3, 0], -mean[:, :3, 1]], axis=-1)
    own_axes = np.stack([own[:, :3, 2], -own[:, :3, 0], -own[:, :3, 1]], axis=-1)
    moved = np.einsum("nji,nj->ni", axes, own[:, :3, 3] - mean[:, :3, 3])
    return moved, np.rad2deg(rotvec_from_rotation(np.swapaxes(axes, 1, 2) @ own_axes))


def strongest_hz(values, hz=100.0):
    spectrum = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values))))
    return np.fft.rfftfreq(len(values), 1 / hz)[np.argmax(spectrum)]


@pytest.mark.parametrize("speed_m_s", [0.8, 1.3, 1.7])
def test_steps_follow_the_walk_ratio(speed_m_s):
    route = straight(speed_m_s)
    moved, turned = beside(embodied(route, "walker", seed=3), route)
    steps_hz = np.sqrt(60 * speed_m_s / 0.0065) / 60  # 0.0065 m for each step a minute
    assert strongest_hz(moved[:, 2]) == pytest.approx(steps_hz, abs=0.03)
    assert strongest_hz(moved[:, 1]) == pytest.approx(steps_hz / 2, abs=0.03)
    assert 0.005 < np.ptp(moved[:, 2]) / 2 < 0.04  # 2 to 4 cm at a quick pace, less at a slow one
    assert 0.010 < np.ptp(moved[:, 1]) / 2 < 0.02
    assert np.abs(turned).max() < 2.5


def test_running_is_what_was_measured():
    route = straight(3.0)
    path = embodied(route, "runner", seed=1)
    moved, _ = beside(path, route)
    assert 2.6 < strongest_hz(moved[:, 2]) < 3.4
    assert 0.06 < np.ptp(moved[:, 2]) < 0.10
    at_s = np.arange(5.0, 55.0, 0.001)
    up = np.gradient(np.gradient(path.poses_at(at_s)[:, 2, 3], at_s), at_s)
    assert 12.0 < np.abs(up[5:-5]).max() < 40.0  # impacts of 1 to 4 g at the head
    heights = np.abs(np.fft.rfft(up[5:-5] * np.hanning(len(up) - 10)))
    hz = np.fft.rfftfreq(len(up) - 10, 0.001)
    assert heights[(hz > 14) & (hz < 21)].max() > 0.01 * heights.max()
    assert heights[hz > 25].max() < 0.01 * heights.max()


def test_a_trot_rocks_as_the_simulated_one():
    route = straight(0.49, height_m=0.45)
    moved, turned = beside(embodied(route, "quadruped", seed=0), route)
    assert strongest_hz(moved[:, 2]) == pytest.approx(4.0, abs=0.03)
    assert turned[:, 0].std() == pytest.approx(0.66, rel=0.1)
    assert turned[:, 1].std() == pytest.approx(0.22, rel=0.1)


def test_a_rover_rises_as_four_wheels_on_its_floor():
    """Variances from ISO 8608's spectrum, and how four wheels filter it: both sides are independent."""
    wave = np.geomspace(0.2, 8.0, 20001)
    density = 16e-6 * (wave / 0.1) ** -2
    rise = np.trapezoid(density * np.cos(np.pi * wave * 0.5) ** 2, wave) / 2
    pitch = np.trapezoid(density * (2 * np.sin(np.pi * wave * 0.5) / 0.5) ** 2, wave) / 2
    found = []
    for seed in range(8):
        route = straight(0.5, height_m=0.4)
        moved, turned = beside(embodied(route, "rover", seed=seed), route)
        found.append([moved[:, 2].var(), np.deg2rad(turned[:, 1]).var()])
    np.testing.assert_allclose(np.mean(found, axis=0), [rise, pitch], rtol=0.2)


def test_a_drone_leans_into_its_acceleration():
    at_s = np.arange(0.0, 8.05, 0.1)
    xy_m = np.column_stack([0.25 * 2.0 * at_s**2, np.zeros_like(at_s)])  # 1 m/s^2
    places = np.column_stack([xy_m, np.full(len(at_s), 1.4)])
    route = evenly_stamped(opencv_from_robot_c2w(pose(np.broadcast_to(np.eye(3), (len(at_s), 3, 3)), places)), 10)
    leans = []
    for seed in range(8):
        forward = embodied(route, "drone", seed=seed).poses_at(np.arange(2.0, 6.0, 0.01))[:, :3, 2]
        leans.append(-np.rad2deg(np.arcsin(forward[:, 2])).mean())
    assert np.mean(leans) == pytest.approx(np.rad2deg(np.arctan(1 / 9.80665)), abs=0.2)


@pytest.mark.parametrize("kind", BODIES)
def test_a_body_is_its_own_and_the_same_again(kind):
    route = straight(1.0, seconds=12)
    first, again, other = (embodied(route, kind, seed=seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first.c2w, again.c2w)
    assert np.abs(first.c2w - other.c2w).max() > 1e-4
    np.testing.assert_array_equal(first.stamps_s, route.stamps_s)
    np.testing.assert_allclose(first.poses_at(first.stamps_s), first.c2w, atol=1e-12)
    still = embodied(route, kind, seed=4, motion=0.0)
    np.testing.assert_allclose(still.c2w[:, :3, 3], route.c2w[:, :3, 3], atol=1e-9)
    np.testing.assert_allclose(still.c2w[:, :3, :3], route.c2w[:, :3, :3], atol=1e-9)


@pytest.mark.parametrize("kind", BODIES)
def test_the_path_is_smooth_between_its_poses(kind):
    """Velocity and angular velocity have no jump anywhere: over a tenth of a knot they change by little."""
    route = handheld_path(box_room(), seed=2, frames=200, speed_m_s=0.6, **BODIES[kind].route)
    curve = embodied(route, kind, seed=2).continuous
    at_s = np.arange(0.0, 9.9, 0.1 / RATE_HZ)
    poses = curve.pose_at(at_s)
    velocity = np.diff(poses[:, :3, 3], axis=0) * 10 * RATE_HZ
    assert np.abs(np.diff(velocity, axis=0)).max() < 0.03  # 60 m/s^2
    rate = rotvec_from_rotation(np.swapaxes(poses[:-1, :3, :3], 1, 2) @ poses[1:, :3, :3]) * 10 * RATE_HZ
    assert np.abs(np.diff(rate, axis=0)).max() < 0.05
    assert np.rad2deg(np.abs(rate)).max() < 150


@pytest.mark.parametrize("kind", BODIES)
def test_where_the_route_stands_so_does_who_walks(kind):
    route = straight(0.0, seconds=3)
    moved = embodied(route, kind, seed=0).c2w[:, :3, 3] - route.c2w[:, :3, 3]
    if kind == "drone":  # which never stands
        assert 0.001 < np.abs(moved).max() < 0.03
    else:
        assert np.ptp(moved, axis=0).max() < 1e-12


@pytest.mark.parametrize("kind", BODIES)
def test_one_pose_and_far_away(kind):
    alone = embodied(straight(0.0, seconds=0), kind, seed=0)
    assert len(alone) == 1
    assert np.isfinite(alone.c2w).all()
    here, far = (embodied(straight(1.0, seconds=5, from_m=(at, -at)), kind, seed=1) for at in (0.0, 1e5))
    np.testing.assert_allclose(far.c2w[:, :3, 3] - here.c2w[:, :3, 3], [[1e5, -1e5, 0]] * len(far), atol=1e-6)


def test_routes_that_no_body_can_follow():
    route = straight(1.0, seconds=5)
    for wrong, named in (
        (replace(route, independent="they are drawn"), "drawn"),
        (replace(route, posed=np.arange(len(route)) != 3), "1 of its poses are unknown"),
        (replace(route, stamps_s=route.stamps_s * 2000), "at most 5,000 s"),
    ):
        refused(embodied, wrong, "walker", seed=0, names=named, error=NoisyWorldError)


def boxes(*corners):
    vertices = [[[x, y, z] for x in (a[0], b[0]) for y in (a[1], b[1]) for z in (a[2], b[2])] for a, b in corners]
    faces = np.concatenate([QUADS + 8 * i for i in range(len(corners))]).astype(np.int32)
    starts = np.arange(len(faces), dtype=np.int32) * 4
    return Mesh(np.reshape(vertices, (-1, 3)).astype(np.float64), None, faces.ravel(), starts)


def box_room():
    return boxes(((0.0, 0.0, 0.0), (6.0, 4.0, 2.6)), ((2.5, 0.0, 0.0), (3.0, 1.2, 2.6)))


ROOM = ((-0.8, -0.8, 0.0), (6.4, 0.8, 2.6))
TABLE = ((4.0, -0.6, 0.68), (5.0, 0.6, 0.7))  # its top alone
LAMP = ((4.0, -0.1, 1.5), (4.2, 0.1, 1.6))
SILL = ((4.0, -0.8, 0.0), (4.1, 0.8, 0.04))


@pytest.mark.parametrize(
    ("thing", "stopped"),
    [
        (TABLE, {"walker", "runner"}),  # the others go below, or above
        (LAMP, {"walker", "runner", "drone"}),
        (SILL, {"rover"}),  # the others step over 4 cm
    ],
)
def test_what_stands_in_the_way(thing, stopped):
    for kind, body in BODIES.items():
        route = straight(1.0, seconds=5, height_m=body.height_m, turn_deg=0.0)
        narrow = first_narrow(boxes(ROOM, thing), embodied(route, kind, seed=0, motion=0.0), body)
        assert (narrow is not None) == (kind in stopped), kind
        if narrow is not None:
            assert narrow.place_m[0] == pytest.approx(4.0 - body.radius_m, abs=0.06)
            assert narrow.time_s == pytest.approx(narrow.place_m[0], abs=0.01)
            assert 0 <= body.radius_m - narrow.gap_m < 0.05


@pytest.mark.parametrize(("seed", "kind"), [*enumerate(BODIES)])
def test_routes_in_the_embedded_room_touch_nothing(room, seed, kind):
    body = BODIES[kind]
    route = handheld_path(room, seed=seed, frames=400, speed_m_s=0.8, **body.route)
    path = embodied(route, kind, seed=seed)
    assert first_narrow(room, path, body) is None
    # And by the mesh's vertices, which lie close: none between the knees and the head is nearer than the shoulders.
    places_m = path.poses_at(np.arange(0.0, path.stamps_s[-1], 0.5))[:, :3, 3]
    floor_m = np.median(room.vertices_m[room.vertices_m[:, 2] < 0.05, 2])
    low_m = floor_m + 0.15 if body.stands else places_m[:, 2].min() - 0.1
    vertices_m = room.vertices_m[(room.vertices_m[:, 2] > low_m) & (room.vertices_m[:, 2] < places_m[:, 2].min() + 0.1)]
    for place_m in places_m:
        assert np.linalg.norm(vertices_m[:, :2] - place_m[:2], axis=1).min() > body.radius_m
    assert np.linalg.norm(np.diff(places_m[:, :2], axis=0), axis=1).sum() > 4.0
