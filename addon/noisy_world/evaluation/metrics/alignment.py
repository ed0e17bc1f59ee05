# SPDX-License-Identifier: GPL-3.0-or-later
"""The transformation that lays an estimate's positions over the true ones, as the two have different world frames."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import pose, quat_wxyz_from_rotation

Float64: TypeAlias = NDArray[np.float64]


WELL_CONDITIONED = 10.0
"""Second extent of a path over the ATE below which a path is marked: a turn by 6 degrees about itself moves the
positions by less than they err."""
DECIDED = 60.0
"""The same, from which on positions alone decide how an estimate is turned: a turn by a degree moves them by more than
they err. Below, full poses do, whose rotations err by less than that."""
OPEN = 3.0  # chosen: errors of a path are no noise without memory, and may hide a turn larger than they are

CONDITIONING = "conditioning"
"""The metric that says how well a path does."""


class Alignment(StrEnum):
    """How an estimate is laid over the truth before it is compared."""

    NONE = "none"  # not at all: both are in one frame
    FIRST_POSE = "first_pose"  # the first pose that both have becomes equal
    SE3 = "se3"  # rotation and translation that make the squared distances of the positions least
    SIM3 = "sim3"  # and a scale


@dataclass(frozen=True, eq=False)
class Similarity:
    """A rotation, a translation and a scale: y = scale * rotation @ x + translation.

    rotation: (3, 3) float64. translation: (3,) float64, metres.
    """

    rotation: Float64
    translation: Float64
    scale: float = 1.0

    @property
    def matrix(self) -> Float64:
        """(4, 4): its upper left is scale * rotation."""
        return pose(self.scale * self.rotation, self.translation)


IDENTITY = Similarity(np.eye(3), np.zeros(3))


def stands_still(positions: Float64) -> bool:
    """Tell whether positions (N, 3), N >= 1, are one position but for float64's rounding."""
    return bool(np.ptp(positions, axis=0).max() <= _rounding(positions))


def first_pose_alignment(estimate: Float64, truth: Float64) -> Similarity:
    """(4, 4) c2w, (4, 4) c2w -> the rigid transformation that takes the first to the second."""
    rotation = truth[:3, :3] @ estimate[:3, :3].T
    return Similarity(rotation, truth[:3, 3] - rotation @ estimate[:3, 3])


def least_squares_alignment(estimate: Float64, truth: Float64, *, with_scale: bool) -> Similarity:
    """(N, 3), (N, 3), N >= 1 -> the transformation of the first that makes the mean squared distance least.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns", PAMI 13(4), 1991,
    equations 34 to 43. A mirror image is never taken. Raises ValueError with a scale where one of the two stands still,
    as then no scale fits. Where the positions lie in a line, or nearly, they do not say how they are turned about it:
    one of the rotations that fit equally well is taken, and `full_pose_alignment` finds a better one.
    """
    mean_estimate, mean_truth = estimate.mean(axis=0), truth.mean(axis=0)
    from_mean_e, from_mean_t = estimate - mean_estimate, truth - mean_truth
    # In units of their own extents, so that neither large nor tiny coordinates leave float64's range.
    unit_e, unit_t = (float(np.abs(points).max()) or 1.0 for points in (from_mean_e, from_mean_t))
    points_e, points_t = from_mean_e / unit_e, from_mean_t / unit_t
    left, spread, right = np.linalg.svd(points_t.T @ points_e / len(points_e))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    still = stands_still(estimate) or stands_still(truth)
    rotation = np.eye(3) if still else (left * signs) @ right
    scale = 1.0
    if with_scale:
        if still:
            raise ValueError("positions that are all the same have no scale")
        scale = float(spread @ signs / np.mean(np.sum(points_e**2, axis=1))) * (unit_t / unit_e)
    return Similarity(rotation, mean_truth - scale * (rotation @ mean_estimate), scale)


@dataclass(frozen=True, eq=False)
class Conditioning:
    """How well a path says how an estimate is to be laid over it.

    extents_m: (3,) standard deviations of the true positions along their principal axes, the largest first. axes:
    (3, 3) these axes, a row each. error_m: the RMSE of the positions, not below float64's rounding.
    """

    extents_m: Float64
    axes: Float64
    error_m: float

    @property
    def ratio(self) -> float:
        """The second extent over the RMSE: a turn by its inverse, in radians, moves positions as far as they err."""
        return float(self.extents_m[1]) / self.error_m

    def open_rad(self, axis: Float64) -> float:
        """(3,) of length 1 -> how far positions leave a turn about it open: OPEN times what moves them as they err."""
        across_m = float(np.linalg.norm(self.extents_m[:, None] * (self.axes - np.outer(self.axes @ axis, axis))))
        return np.pi if OPEN * self.error_m >= np.pi * across_m else OPEN * self.error_m / across_m

    @property
    def decided(self) -> Literal["all", "direction", "nothing"]:
        """What of the rotation the positions decide: all of it, the direction of a line alone, or nothing."""
        if self.ratio >= DECIDED:
            return "all"
        return "direction" if self.extents_m[0] >= DECIDED * self.error_m else "nothing"


def conditioning_of(truth: Float64, error_m: float) -> Conditioning:
    """(N, 3), N >= 3, the true positions, and the RMSE of the estimated ones -> how they condition an alignment."""
    from_mean = truth - truth.mean(axis=0)
    _, sizes, axes = np.linalg.svd(from_mean, full_matrices=False)
    least_m = max(_rounding(truth), float(np.finfo(np.float64).tiny))
    return Conditioning(sizes / np.sqrt(len(truth)), axes, max(error_m, least_m))


def full_pose_alignment(estimate: Float64, truth: Float64, by: Similarity, known: Conditioning) -> Similarity:
    """(N, 4, 4), (N, 4, 4) c2w -> the alignment whose rotation follows from rotations where positions leave it open.

    by: the alignment of the positions, which is returned where they decide the rotation (`Conditioning.decided`). Of a
    path that is nearly a line, they say its direction, and the rotations the turn about it that makes the mean squared
    chordal distance of the rotations least; of one that hardly moves, the rotations say all, by the same measure. A
    turn moves positions by OPEN times what they err at most: rotations that contradict the path do not turn it.
    """
    if known.decided == "all":
        return by
    # The mean of R_true R_estimate^T: the least squares over turns T maximise the trace of T^T times it.
    mean = np.einsum("nij,nkj->ik", truth[:, :3, :3], by.rotation @ estimate[:, :3, :3]) / len(truth)
    if known.decided == "direction":
        axis, angle_rad = known.axes[0], _best_angle_rad(known.axes[0], mean)
    else:
        axis, angle_rad = _axis_angle(_turn(mean))
    most_rad = known.open_rad(axis)
    rotation = _turn_about(axis, float(np.clip(angle_rad, -most_rad, most_rad))) @ by.rotation
    means = estimate[:, :3, 3].mean(axis=0), truth[:, :3, 3].mean(axis=0)
    return Similarity(rotation, means[1] - by.scale * (rotation @ means[0]), by.scale)


def _turn(mean: Float64) -> Float64:
    """(3, 3) -> the rotation T whose trace of T^T times it is largest."""
    left, _, right = np.linalg.svd(mean)
    return (left * [1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))]) @ right


def _best_angle_rad(axis: Float64, mean: Float64) -> float:
    """(3,), (3, 3) -> the angle of the rotation about an axis of length 1 for which that trace is largest."""
    sine = float(np.sum(_cross(axis) * mean))  # of the trace of T^T times the mean: the part that goes with the sine
    return float(np.arctan2(sine, np.trace(mean) - axis @ mean @ axis))


def _axis_angle(turn: Float64) -> tuple[Float64, float]:
    """(3, 3) -> (3,) of length 1, and radians from 0 to pi."""
    quat_wxyz = quat_wxyz_from_rotation(turn)
    length = float(np.linalg.norm(quat_wxyz[1:]))
    if length == 0.0:
        return np.array([1.0, 0.0, 0.0]), 0.0
    sign = 1.0 if quat_wxyz[0] >= 0.0 else -1.0
    return sign * quat_wxyz[1:] / length, 2.0 * float(np.arctan2(length, sign * quat_wxyz[0]))


def _turn_about(axis: Float64, angle_rad: float) -> Float64:
    """(3,) of length 1 -> (3, 3), by Rodrigues' formula."""
    cross = _cross(axis)
    return np.eye(3) + np.sin(angle_rad) * cross + (1.0 - np.cos(angle_rad)) * cross @ cross


def _cross(axis: Float64) -> Float64:
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def aligned_poses(c2w: Float64, by: Similarity) -> Float64:
    """(N, 4, 4) -> (N, 4, 4): camera-to-world in the truth's world frame; rotations stay rotations."""
    return pose(by.rotation @ c2w[:, :3, :3], by.scale * (c2w[:, :3, 3] @ by.rotation.T) + by.translation)


def _rounding(positions: Float64) -> float:
    """Return by how much equal positions may differ once they were transformed in float64."""
    return 64.0 * float(np.finfo(np.float64).eps * np.abs(positions).max())
