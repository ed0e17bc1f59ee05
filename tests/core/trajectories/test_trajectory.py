# SPDX-License-Identifier: GPL-3.0-or-later
import math
from functools import partial

import numpy as np
import pytest
from cases import cases
from refusals import refused
from scipy.interpolate import CubicSpline

from noisy_world.core.geometry import pose, rotation_angle_rad, rotation_error, rotation_from_euler_deg
from noisy_world.core.trajectory import Trajectory, convert_convention, evenly_stamped, resample, subsample


def turning(angles_deg, positions_m=None):
    """Poses turned about world z, which hand-written expectations are easy for."""
    angles_deg = np.asarray(angles_deg, dtype=np.float64)
    positions_m = np.zeros((len(angles_deg), 3)) if positions_m is None else positions_m
    return pose(rotation_from_euler_deg(0.0, 0.0, angles_deg), positions_m)


def heading_deg(trajectory):
    return np.degrees(np.arctan2(trajectory.c2w[:, 1, 0], trajectory.c2w[:, 0, 0]))


def test_even_stamps():
    trajectory = evenly_stamped(turning([0, 1, 2]))
    assert len(trajectory) == 3
    np.testing.assert_array_equal(trajectory.stamps_s, [0.0, 0.05, 0.1])
    np.testing.assert_array_equal(evenly_stamped(turning([0, 1]), 30.0).stamps_s, [0.0, 1 / 30])


def test_trajectory_is_a_copy_that_cannot_be_written():
    c2w = turning([0, 1, 2])
    trajectory = evenly_stamped(c2w)
    c2w[:] = 0.0
    np.testing.assert_array_equal(trajectory.c2w, turning([0, 1, 2]))
    for array in (trajectory.c2w, trajectory.stamps_s):
        assert array.dtype == np.float64
        refused(array.fill, 1.0, names="read-only", error=ValueError)


@cases(
    ("c2w", "stamps_s", "says"),
    [
        (np.zeros((0, 4, 4)), [], "N >= 1"),
        (np.eye(4), [0.0], "N, 4, 4"),
        (turning([0, 1]), [0.0], "as many"),
        (turning([0, 1]), [1.0, 1.0], "increase"),
        (turning([0, 1]), [1.0, 0.5], "increase"),
        (turning([0, 1]), [0.0, math.nan], "finite"),
        (np.full((2, 4, 4), math.inf), [0.0, 1.0], "finite"),
    ],
)
def test_no_trajectory(c2w, stamps_s, says):
    refused(Trajectory, c2w, stamps_s, names=says, error=ValueError)


def test_subsample_keeps_stamps():
    trajectory = evenly_stamped(turning(np.arange(10.0)), 10.0)
    part = subsample(trajectory, start=1, stop=8, every=3)
    np.testing.assert_array_equal(part.stamps_s, trajectory.stamps_s[[1, 4, 7]])
    np.testing.assert_array_equal(part.c2w, trajectory.c2w[[1, 4, 7]])
    assert len(subsample(trajectory)) == 10
    assert len(subsample(trajectory, stop=1000)) == 10
    np.testing.assert_array_equal(subsample(trajectory, every=8).stamps_s, [0.0, 0.8])


@cases("choice", [{"start": -1}, {"stop": -1}, {"every": 0}, {"start": 10}, {"stop": 0}, {"start": 5, "stop": 5}])
def test_subsample_of_nothing(choice):
    with pytest.raises(ValueError, match=r"no frame is left|must be"):
        subsample(evenly_stamped(turning(np.arange(10.0))), **choice)


def test_cuts_stay_between_the_frames_that_are_kept():
    path = Trajectory(np.tile(np.eye(4), (6, 1, 1)), np.arange(6.0), shots=np.array([0, 0, 1, 1, 1, 2]))
    for kept, cuts in (
        (subsample(path, every=2), [True, False]),
        (path.followed(np.array([0, 1, 3, 5])), [False, True, True]),
    ):
        assert [kept.cuts_between(frame, frame + 1) for frame in range(len(kept) - 1)] == cuts


def test_resample_between_poses():
    positions_m = np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, 0]])
    trajectory = Trajectory(turning([0, 30, 90], positions_m), [10.0, 11.0, 13.0])
    new = resample(trajectory, 2.0)
    np.testing.assert_array_equal(new.stamps_s, [10, 10.5, 11, 11.5, 12, 12.5, 13])
    np.testing.assert_allclose(heading_deg(new), [0, 15, 30, 45, 60, 75, 90], atol=1e-12)
    expected_m = CubicSpline([10, 11, 13], positions_m, bc_type="natural")(new.stamps_s)
    np.testing.assert_allclose(new.c2w[:, :3, 3], expected_m, atol=1e-14)
    np.testing.assert_array_equal(new.c2w[[0, 2, 6]], trajectory.c2w)
    assert rotation_error(new.c2w[:, :3, :3]).max() < 1e-15
    np.testing.assert_array_equal(new.c2w[:, 3], np.tile([0, 0, 0, 1], (7, 1)))


def test_resample_ends_at_the_last_stamp_or_before():
    trajectory = evenly_stamped(turning([0, 10]), 1.0)
    np.testing.assert_array_equal(resample(trajectory, 0.4).stamps_s, [0.0])
    np.testing.assert_array_equal(resample(trajectory, 1.5).stamps_s, [0.0, 1 / 1.5])
    # 1 / 30 rounded to six digits, as TUM files hold it, is still there at 30 Hz.
    rounded = Trajectory(turning([0, 1, 2]), [0.0, 0.033333, 0.066666])
    np.testing.assert_array_equal(resample(rounded, 30.0).stamps_s, np.arange(3) / 30)
    np.testing.assert_array_equal(resample(rounded, 30.0).c2w[-1], rounded.c2w[-1])


def test_resample_at_the_same_rate_changes_nothing():
    trajectory = evenly_stamped(turning(np.linspace(0, 900, 200)), 20.0)
    same = resample(trajectory, 20.0)
    np.testing.assert_array_equal(same.stamps_s, trajectory.stamps_s)
    np.testing.assert_allclose(same.c2w, trajectory.c2w, rtol=0, atol=1e-13)


def test_resample_takes_the_shorter_way_across_the_half_turn():
    new = resample(evenly_stamped(turning([170, 190]), 1.0), 4.0)
    np.testing.assert_allclose(np.mod(heading_deg(new), 360), [170, 175, 180, 185, 190], atol=1e-12)


def test_resample_with_unix_stamps_far_from_the_origin():
    far_m = np.array([[1e5, -1e5, 0.0], [1e5 + 0.1, -1e5, 0.0]])
    new = resample(Trajectory(turning([0, 10], far_m), [1.6e9, 1.6e9 + 0.1]), 100.0)
    assert len(new) == 11
    np.testing.assert_allclose(new.c2w[:, 0, 3] - 1e5, np.linspace(0, 0.1, 11), rtol=0, atol=1e-6)
    np.testing.assert_allclose(heading_deg(new), np.linspace(0, 10, 11), atol=1e-4)


def test_one_pose_can_be_resampled_and_subsampled():
    one = Trajectory(turning([40], [[1, 2, 3]]), [7.0])
    for same in (resample(one, 20.0), subsample(one, every=5)):
        np.testing.assert_array_equal(same.c2w, one.c2w)
        np.testing.assert_array_equal(same.stamps_s, [7.0])


@cases("rate_hz", [0.0, -20.0, math.nan, math.inf])
def test_no_rate(rate_hz):
    trajectory = evenly_stamped(turning([0, 1]))
    refused(resample, trajectory, rate_hz, names="hertz", error=ValueError)
    refused(evenly_stamped, trajectory.c2w, rate_hz, names="hertz", error=ValueError)


# One camera at (1, 2, 3), level, looking along world +y with its right side to +x, in six conventions by hand.
LOOKING_ALONG_Y = {
    ("c2w", "opencv"): [[1, 0, 0, 1], [0, 0, 1, 2], [0, -1, 0, 3]],
    ("c2w", "opengl"): [[1, 0, 0, 1], [0, 0, -1, 2], [0, 1, 0, 3]],
    ("c2w", "robot"): [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3]],
    ("c2w", "ned"): [[0, 1, 0, 1], [1, 0, 0, 2], [0, 0, -1, 3]],
    ("w2c", "ned"): [[0, 1, 0, -2], [1, 0, 0, -1], [0, 0, -1, 3]],
    ("w2c", "opencv"): [[1, 0, 0, -1], [0, 0, -1, 3], [0, 1, 0, -2]],
    ("w2c", "opengl"): [[1, 0, 0, -1], [0, 0, 1, -3], [0, -1, 0, 2]],
    ("w2c", "robot"): [[0, 1, 0, -2], [-1, 0, 0, 1], [0, 0, 1, -3]],
}


@cases(("direction", "axes"), LOOKING_ALONG_Y)
def test_conventions(direction, axes):
    expected = np.vstack([LOOKING_ALONG_Y["c2w", "opencv"], [0, 0, 0, 1]])
    given = np.vstack([LOOKING_ALONG_Y[direction, axes], [0, 0, 0, 1]])
    converted = convert_convention(np.stack([given, given]), direction=direction, axes=axes)
    np.testing.assert_array_equal(converted, np.stack([expected, expected]))
    # What is in front of the camera, above it and to its right, in the world.
    front, above, right = (converted[0] @ [*v, 1.0] for v in ([0, 0, 2], [0, -1, 0], [1, 0, 0]))
    np.testing.assert_array_equal([front[:3], above[:3], right[:3]], [[1, 4, 3], [1, 2, 4], [2, 2, 3]])


def test_conventions_of_any_pose():
    c2w = pose(rotation_from_euler_deg([10, 20], [-40, 80], [170, -60]), [[1, 2, 3], [-4, 5, 6]])
    w2c = np.linalg.inv(c2w)
    np.testing.assert_allclose(convert_convention(w2c, direction="w2c", axes="opencv"), c2w, atol=1e-14)
    # NeRF's well-known recipe: y and z columns negated.
    recipe = c2w * [1, -1, -1, 1]
    np.testing.assert_allclose(convert_convention(recipe, direction="c2w", axes="opengl"), c2w, atol=1e-15)
    np.testing.assert_allclose(
        convert_convention(np.linalg.inv(recipe), direction="w2c", axes="opengl"), c2w, atol=1e-14
    )
    assert rotation_angle_rad(c2w[0, :3, :3], c2w[1, :3, :3]) > 0.1


def test_unknown_conventions():
    convert = partial(convert_convention, np.eye(4))
    refused(convert, direction="camera", axes="opencv", names="c2w, w2c", error=ValueError)
    refused(convert, direction="c2w", axes="blender", names="opencv, opengl, robot", error=ValueError)


@cases(
    ("span_s", "rate_hz", "says"),
    [
        (1e9, 20.0, "20 Hz over the path's 1e+09 s makes 2e+10 poses, more than 1,000,000"),
        (1e11, 1e4, "makes 1e+15 poses"),
        (100.0, 1e4, "makes 1e+06 poses, more than 1,000,000"),
        (1.7e308, 1e308, "makes inf poses"),
    ],
)
def test_resample_refuses_absurd_numbers_of_poses(span_s, rate_hz, says):
    still = Trajectory(np.tile(np.eye(4), (2, 1, 1)), [0.0, span_s])
    refused(resample, still, rate_hz, names=says, error=ValueError)
    assert len(resample(Trajectory(np.eye(4)[None], [span_s]), rate_hz)) == 1  # a span of 0
