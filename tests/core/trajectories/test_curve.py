# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths in continuous time, against scipy's splines, closed forms and finite differences."""

import math
from dataclasses import replace

import numpy as np
import pytest
from cases import cases
from refusals import refused
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from noisy_world.core.camera_motion import DeviatingCurve, Pulses, Sines
from noisy_world.core.curve import MountedCurve, NaturalSpline, RotationSpline, WarpedCurve, angular_motion, motion_of
from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.frame_request import FrameRequest, SensorPaths, Shutter
from noisy_world.core.geometry import pose
from noisy_world.core.trajectory import Trajectory, evenly_stamped, resample, subsample
from noisy_world.trajectories.rig import Sensor, sensor_trajectory

GENERATOR = np.random.default_rng(5)
KNOTS = np.cumsum(GENERATOR.uniform(0.3, 2.0, 12))
TURNS = Rotation.from_rotvec(np.cumsum(GENERATOR.normal(size=(12, 3)) * 0.5, axis=0))


def turning_path(times_s, rate_deg_s=40.0, axis=(0.6, 0.0, 0.8), at_m=(0.0, 0.0, 0.0)):
    """A camera that turns steadily about an axis and goes steadily along x."""
    times_s = np.asarray(times_s, dtype=np.float64)
    turned = Rotation.from_rotvec(np.radians(rate_deg_s) * times_s[..., None] * np.array(axis))
    return pose(turned.as_matrix(), np.array(at_m) + times_s[..., None] * np.array([0.5, 0.0, 0.0]))


def test_positions_are_scipy_s_natural_spline():
    values = GENERATOR.normal(size=(12, 3))
    ours, theirs = NaturalSpline(KNOTS, values), CubicSpline(KNOTS, values, bc_type="natural")
    inside = np.linspace(KNOTS[0], KNOTS[-1], 999)
    np.testing.assert_allclose(ours.at(inside), theirs(inside), atol=1e-13)
    np.testing.assert_array_equal(ours.at(KNOTS), values)
    beyond = values[-1] + 3.0 * theirs(KNOTS[-1], 1)
    np.testing.assert_allclose(ours.at(KNOTS[-1] + 3.0), beyond, atol=1e-12)
    np.testing.assert_allclose(ours.at(KNOTS[0] - 3.0), values[0] - 3.0 * theirs(KNOTS[0], 1), atol=1e-12)


def test_turns_about_one_axis_are_the_natural_spline_of_the_angle():
    angle_rad = np.cumsum(GENERATOR.uniform(-2.0, 2.0, 12))
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    spline = RotationSpline(KNOTS, Rotation.from_rotvec(angle_rad[:, None] * axis).as_matrix())
    inside = np.linspace(KNOTS[0], KNOTS[-1], 999)
    wanted = CubicSpline(KNOTS, angle_rad, bc_type="natural")(inside)
    np.testing.assert_allclose(spline.at(inside), Rotation.from_rotvec(wanted[:, None] * axis).as_matrix(), atol=1e-11)
    theirs = CubicSpline(KNOTS, angle_rad, bc_type="natural")
    for end, beyond in ((0, -0.7), (-1, 0.9)):  # it goes on as fast as at each end
        wanted = angle_rad[end] + beyond * theirs(KNOTS[end], 1)
        found = spline.at(KNOTS[end] + beyond)
        np.testing.assert_allclose(found, Rotation.from_rotvec(wanted * axis).as_matrix(), atol=1e-11)


def test_angular_velocity_and_acceleration_have_no_jump():
    spline = RotationSpline(KNOTS, TURNS.as_matrix())
    np.testing.assert_allclose(spline.at(KNOTS), TURNS.as_matrix(), atol=1e-15)
    step = 1e-4

    def acceleration(at):
        around = spline.at(at[:, None] + step * np.arange(-1, 2))
        turned = Rotation.from_matrix((around[:, :-1].swapaxes(-1, -2) @ around[:, 1:]).reshape(-1, 3, 3)).as_rotvec()
        return np.diff(turned.reshape(-1, 2, 3), axis=1)[:, 0] / step**2

    before, after = acceleration(KNOTS - 2 * step), acceleration(KNOTS + 2 * step)
    assert np.abs(before[1:-1]).max() > 1.0
    # What four steps of the jerk in the intervals beside a knot explain, and no more.
    np.testing.assert_allclose(before, after, atol=4 * step * 20)
    np.testing.assert_allclose(before[0], 0.0, atol=1e-6)
    np.testing.assert_allclose(after[-1], 0.0, atol=1e-6)


@cases("rate_deg_s", [0.0, 40.0, -170.0])
@cases("origin_m", [0.0, 1e5])
def test_a_steady_turn_stays_steady_between_and_beyond_the_poses(rate_deg_s, origin_m):
    stamps_s = np.array([0.0, 0.5, 0.6, 1.5, 2.0])
    path = Trajectory(turning_path(stamps_s, rate_deg_s, at_m=(origin_m, -origin_m, 0.0)), stamps_s)
    for time_s in (-0.4, 0.25, 0.55, 1.9, 2.3):
        wanted = turning_path(time_s, rate_deg_s, at_m=(origin_m, -origin_m, 0.0))
        np.testing.assert_allclose(path.pose_at(time_s), wanted, atol=1e-13 + 1e-15 * origin_m)
    np.testing.assert_array_equal(path.pose_at(0.6), path.c2w[2])


def test_turns_about_changing_axes_have_no_jump_in_their_acceleration():
    spline, near_s = RotationSpline(KNOTS, TURNS.as_matrix()), 1e-9
    (rate, change), (later, change_later) = (spline.rates_at(KNOTS[1:-1] + by_s) for by_s in (-near_s, near_s))
    np.testing.assert_allclose(rate, later, rtol=0, atol=1e-7)
    np.testing.assert_allclose(change, change_later, rtol=0, atol=1e-7)
    np.testing.assert_allclose(spline.rates_at(KNOTS[[0, -1]])[1], np.zeros((2, 3)), atol=1e-9)


def test_angular_motion_has_no_jump_where_its_series_ends():
    along = np.array([[2.0, -1.0, 2.0]]) / 3.0
    first, second = np.array([[0.5, 0.7, -0.3]]), np.array([[0.1, -0.4, 0.2]])
    near, far = (angular_motion(along * angle_rad, first, second) for angle_rad in (0.03 - 1e-13, 0.03 + 1e-13))
    for series, exact in zip(near, far, strict=True):
        np.testing.assert_allclose(series, exact, rtol=0, atol=1e-10)


def test_half_turns_between_poses_and_a_single_pose():
    path = evenly_stamped(turning_path([0.0, 1.0], 180.0, (0.0, 0.0, 1.0)), 1.0)
    turned = Rotation.from_matrix(path.pose_at(0.5)[:3, :3]).magnitude()
    assert turned == pytest.approx(math.pi / 2, abs=1e-12)
    alone = evenly_stamped(turning_path([0.3]), 1.0)
    np.testing.assert_array_equal(alone.pose_at(17.0), alone.c2w[0])


@cases("count", [1, 2, 3])
@cases("asked", [0, 1, 4])
def test_every_curve_takes_any_number_of_times_and_of_poses(count, asked):
    stamps_s, times_s = np.arange(count) / 4, np.linspace(-0.3, 0.9, asked)
    path = Trajectory(turning_path(stamps_s), stamps_s)
    spline = NaturalSpline(stamps_s, np.stack([stamps_s, 2 * stamps_s], axis=-1))
    speed = np.array([1.0, 2.0]) if count > 1 else np.zeros(2)
    np.testing.assert_allclose(spline.at(times_s), times_s[:, None] * speed, atol=1e-12)
    first, second = spline.derivatives_at(times_s)
    np.testing.assert_allclose(first, np.broadcast_to(speed, (asked, 2)), atol=1e-12)
    np.testing.assert_allclose(second, np.zeros((asked, 2)), atol=1e-12)
    signals = [Sines(*np.ones((3, 3, 2))), Pulses(np.array([0.1]), 0.2, np.ones((1, 3)))]
    curves = [
        (path.continuous, 1.0),
        (WarpedCurve(path.continuous, NaturalSpline(stamps_s, 2 * stamps_s[:, None])), 2.0),
        (MountedCurve(path.continuous, np.eye(4)), 1.0),
    ]
    for curve, pace in curves:
        moved = np.array([turning_path(pace * time_s) for time_s in times_s if count > 1]).reshape(-1, 4, 4)
        wanted = moved if count > 1 else np.broadcast_to(path.c2w[0], (asked, 4, 4))
        np.testing.assert_allclose(curve.pose_at(times_s), wanted, atol=1e-12)
        motion = motion_of(curve, times_s)
        rate_rad_s = np.radians(40.0) * pace if count > 1 else 0.0
        np.testing.assert_allclose(np.linalg.norm(motion.rate_rad_s, axis=-1), np.full(asked, rate_rad_s), atol=1e-9)
    for signal in signals:
        deviating = DeviatingCurve(path.continuous, 0.0, signal, signal)
        assert deviating.pose_at(times_s).shape == (asked, 4, 4)
        assert motion_of(deviating, times_s).rate_rad_s.shape == (asked, 3)
    assert path.poses_at(times_s).shape == (asked, 4, 4)
    assert replace(path, independent="each stands by itself").poses_at(times_s[:0]).shape == (0, 4, 4)
    assert path.known_at(times_s).shape == (asked,)


def test_a_clock_that_changes_its_speed_accelerates_a_steady_camera():
    # At 0.5 m/s along x and 40 degrees a second: of both, the acceleration is the clock's own.
    read_s = np.array([0.0, 0.2, 1.0, 1.3, 1.9])
    clock = NaturalSpline(np.arange(5.0), read_s[:, None])
    theirs, times_s = CubicSpline(np.arange(5.0), read_s, bc_type="natural"), np.linspace(0.3, 3.7, 7)
    path = Trajectory(turning_path(np.arange(4.0)), np.arange(4.0)).continuous
    motion = motion_of(WarpedCurve(path, clock), times_s)
    axis = np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(motion.acceleration_m_s2, theirs(times_s, 2)[:, None] * [0.5, 0, 0], atol=1e-9)
    turning = np.radians(40.0) * theirs(times_s, 2)[:, None] * axis
    np.testing.assert_allclose(motion.angular_acceleration_rad_s2, turning, atol=1e-9)


def test_parts_of_a_path_lie_on_it():
    stamps_s = np.arange(40) / 20
    shaken = pose(TURNS.as_matrix()[np.arange(40) % 12], GENERATOR.normal(size=(40, 3)))
    path = Trajectory(shaken, stamps_s)
    part = subsample(path, start=3, every=4)
    np.testing.assert_array_equal(part.pose_at(0.42), path.pose_at(0.42))
    np.testing.assert_allclose(resample(path, 7.0).pose_at(0.42), path.pose_at(0.42), atol=1e-12)
    faster = path.followed(np.arange(0, 40, 2))
    for time_s in (0.0, 0.3, 0.31, 0.77):
        np.testing.assert_allclose(faster.pose_at(time_s), path.pose_at(2 * time_s), atol=1e-12)
    sensor = Sensor(turning_path(0.7, at_m=(0.1, 0.2, 0.3)))
    np.testing.assert_allclose(
        sensor_trajectory(path, sensor).pose_at(0.42), path.pose_at(0.42) @ sensor.robot_from_sensor, atol=1e-15
    )


def test_what_is_unknown_stays_unknown():
    posed = np.array([True, True, False, True, True])
    path = Trajectory(turning_path(np.arange(5.0)), np.arange(5.0), posed=posed)
    np.testing.assert_array_equal(subsample(path, every=2).known, [True, False, True])
    np.testing.assert_array_equal(resample(path, 2.0).known, [True] * 3 + [False] * 3 + [True] * 3)
    np.testing.assert_allclose(path.pose_at(0.5), turning_path(0.5), atol=1e-13)  # the unknown pose bends nothing
    refused(path.pose_at, 1.5, names="unknown", error=NoisyWorldError)
    alone = replace(path, posed=None, independent="a shake moves each pose by itself")
    np.testing.assert_array_equal(alone.pose_at(1.0), path.c2w[1])
    refused(alone.pose_at, 0.5, names="0.5 s, between the frames: a shake", error=NoisyWorldError)
    assert subsample(alone, every=2).independent == alone.independent
    # What is made of a path knows no more than the path does.
    rows, sensor = np.array([0, 2, 3]), Sensor(turning_path(1.0))
    for part in (path.at(rows, np.arange(3.0)), path.followed(rows), sensor_trajectory(path, sensor).followed(rows)):
        np.testing.assert_array_equal(part.known, [True, False, True])
        for time_s in (0.5, 1.5):
            refused(part.pose_at, time_s, names="unknown", error=NoisyWorldError)
    for part in (alone.at(rows, np.arange(3.0)), alone.followed(rows), sensor_trajectory(alone, sensor)):
        assert part.independent == alone.independent
    np.testing.assert_array_equal(path.known_at([0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0]), [1, 1, 0, 0, 0, 1, 1])


def test_requests_follow_the_paths():
    path = evenly_stamped(turning_path(np.arange(10) / 20), 20.0)
    paths = SensorPaths(path, depth=sensor_trajectory(path, Sensor(turning_path(1.0))))
    request = paths.request(4)
    assert (request.index, request.time_s) == (4, 0.2)
    np.testing.assert_array_equal(request.rgb_c2w, path.c2w[4])
    later = request.after(0.013)
    assert (later.index, later.time_s) == (None, pytest.approx(0.213))
    np.testing.assert_allclose(later.rgb_c2w, turning_path(0.213), atol=1e-13)
    np.testing.assert_allclose(later.depth_c2w, turning_path(0.213) @ turning_path(1.0), atol=1e-13)
    again = later.after(-0.05)  # seconds after seconds
    assert (again.index, again.time_s) == (None, pytest.approx(0.163))
    np.testing.assert_allclose(again.rgb_c2w, turning_path(0.163), atol=1e-13)
    assert request.after(0.0) is request
    # Followed twice as fast, from 0.1 s on the source's clock, the sensors are there when it says.
    clock = NaturalSpline(path.stamps_s[:4], 0.1 + 2 * path.stamps_s[:4, None])
    faster = SensorPaths(path.followed(np.arange(2, 10, 2)), clock=clock).request(1).after(0.01).after(0.02)
    assert faster.time_s == pytest.approx(0.26)
    np.testing.assert_allclose(faster.rgb_c2w, turning_path(0.26), atol=1e-13)
    still = FrameRequest(0, 1.0, np.eye(4), np.eye(4)).after(0.5)
    assert (still.index, still.time_s) == (None, 1.5)
    refused(lambda: still.frame, names="no frame at 1.5 s", error=NoisyWorldError)


def test_shutters():
    rolling = Shutter.centred(0.002, 0.01)
    times_s = rolling.line_times_s(5)
    np.testing.assert_allclose(times_s, [-0.004, -0.002, 0.0, 0.002, 0.004], atol=1e-18)
    np.testing.assert_allclose(replace(rolling, direction="up").line_times_s(5), times_s[::-1])
    assert rolling.opens_s == pytest.approx(-0.006)
    np.testing.assert_array_equal(Shutter().line_times_s(3), [0.0, 0.0, 0.0])
    for wrong in ({"exposure_s": -1.0}, {"readout_s": math.nan}):
        refused(Shutter, **wrong, names="second", error=ValueError)
