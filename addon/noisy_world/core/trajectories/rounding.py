# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses to what is meaningful of them, so that the same preset draws the same images everywhere.

Two versions of numpy, or two processors, give sines, products of matrices and decompositions whose last bits differ,
and an image shows a pixel at an edge otherwise for that. What is rounded here is far coarser than those, and far finer
than anything that is measured or seen.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry import pose, quat_wxyz_from_rotation
from .body_motion import BodyMotion
from .curve import Curve, motion_of
from .trajectory import Trajectory

Float64 = NDArray[np.float64]

DECIMALS = 9  # of metres and ratios of a quaternion's components: a nanometre, and 2e-9 rad
FAR_M = 1e6  # from here on floats hold no nanometres that mean anything
FAR_DECIMALS = 6


def rounded_numbers(values: ArrayLike) -> Float64:
    """Return numbers of any shape to 9 decimals, without negative zeros; to 6 from a million on."""
    values = np.asarray(values, dtype=np.float64)
    near = np.abs(values) < FAR_M
    return np.where(near, np.round(values, DECIMALS), np.round(values, FAR_DECIMALS)) + 0.0


def rounded_poses(c2w: ArrayLike) -> Float64:
    """(..., 4, 4) rigid -> (..., 4, 4): metres to 9 decimals, rotations to the nearest of a grid of quaternions.

    The grid's quaternions have one component of 1, the largest, and three others of 9 decimals; the rotation is theirs
    in the arithmetic that is equal everywhere. What is rounded already stays as it is, as do quarter turns.
    """
    c2w = np.asarray(c2w, dtype=np.float64)
    quat = quat_wxyz_from_rotation(c2w[..., :3, :3])
    largest = np.take_along_axis(quat, np.argmax(np.abs(quat), axis=-1)[..., None], axis=-1)
    w, x, y, z = np.moveaxis(np.round(quat / largest, DECIMALS) + 0.0, -1, 0)
    squared = w * w + x * x + y * y + z * z
    rows = [
        [w * w + x * x - (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w + y * y - (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w + z * z - (x * x + y * y)],
    ]
    rotation = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2) / squared[..., None, None]
    return pose(rotation + 0.0, rounded_numbers(c2w[..., :3, 3]))


@dataclass(frozen=True, eq=False)
class RoundedCurve:
    """A curve whose poses are rounded. Its motion is not, as derivatives are of the curve."""

    curve: Curve

    def pose_at(self, times_s: ArrayLike) -> Float64:
        """(...) seconds -> (..., 4, 4)."""
        return rounded_poses(self.curve.pose_at(times_s))

    def motion_at(self, times_s: Float64) -> BodyMotion:
        """(N,) seconds -> the motion then."""
        return motion_of(self.curve, times_s)


def rounded_path(path: Trajectory) -> Trajectory:
    """Return a path whose poses are rounded, and all that lie between them."""
    if isinstance(path.curve, RoundedCurve):
        return path
    curve = None if path.independent else RoundedCurve(path.continuous)
    return replace(path, c2w=rounded_poses(path.c2w), curve=curve)
