# SPDX-License-Identifier: GPL-3.0-or-later
"""The transformation that lays an estimate's positions over the true ones, as the two have different world frames."""

from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import pose

Float64: TypeAlias = NDArray[np.float64]


class Alignment(StrEnum):
    """How an estimate is laid over the truth before it is compared."""

    NONE = "none"  # not at all: both are in one frame
    FIRST_POSE = "first_pose"  # the first pose that both have becomes equal
    SE3 = "se3"  # rotation and translation that make the squared distances of the positions least
    SIM3 = "sim3"  # and a scale


@dataclass(frozen=True, eq=False)
class Similarity:
    """A rotation, a translation and a scale: y = scale * rotation @ x + translation.

    rotation: (3, 3) float64. translation: (3,) float64, metres. rotation_known: whether the positions decide the
    rotation; where they lie in a line or stand still, one of those that fit equally well was taken, so positions are
    laid well, and the cameras' rotations arbitrarily.
    """

    rotation: Float64
    translation: Float64
    scale: float = 1.0
    rotation_known: bool = True

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
    as then no scale fits.
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
    noise = max(_rounding(estimate) / unit_e, _rounding(truth) / unit_t)
    known = not still and bool(spread[1] > noise * spread[0])
    return Similarity(rotation, mean_truth - scale * (rotation @ mean_estimate), scale, known)


def aligned_poses(c2w: Float64, by: Similarity) -> Float64:
    """(N, 4, 4) -> (N, 4, 4): camera-to-world in the truth's world frame; rotations stay rotations."""
    return pose(by.rotation @ c2w[:, :3, :3], by.scale * (c2w[:, :3, 3] @ by.rotation.T) + by.translation)


def _rounding(positions: Float64) -> float:
    """Return by how much equal positions may differ once they were transformed in float64."""
    return 64.0 * float(np.finfo(np.float64).eps * np.abs(positions).max())
