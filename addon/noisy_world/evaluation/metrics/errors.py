# SPDX-License-Identifier: GPL-3.0-or-later
"""Absolute and relative errors of poses, and which pairs of poses the relative ones compare.

Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012: the absolute trajectory error (ATE)
compares poses after alignment, the relative pose error (RPE) motions between two poses.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import rotation_angle_rad

Float64: TypeAlias = NDArray[np.float64]
Pairs: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True)
class ErrorStatistics:
    """What is said of many errors: root of the mean square, mean, median, largest, standard deviation (of all)."""

    rmse: float
    mean: float
    median: float
    max: float
    std: float


def spread_of(errors: Float64) -> ErrorStatistics:
    """(N,), N >= 1, finite -> their statistics."""
    return ErrorStatistics(
        float(np.sqrt(np.mean(np.square(errors)))),
        float(errors.mean()),
        float(np.median(errors)),
        float(errors.max()),
        float(errors.std()),
    )


def position_errors_m(estimate: Float64, truth: Float64) -> Float64:
    """(N, 4, 4), (N, 4, 4) c2w in one frame -> (N,) distances of the positions."""
    return np.linalg.norm(estimate[:, :3, 3] - truth[:, :3, 3], axis=1)


def rotation_errors_deg(estimate: Float64, truth: Float64) -> Float64:
    """(N, 4, 4), (N, 4, 4) c2w in one frame -> (N,) angles between the rotations, 0 to 180."""
    return np.rad2deg(rotation_angle_rad(truth[:, :3, :3], estimate[:, :3, :3]))


def path_length_m(positions: Float64) -> float:
    """(N, 3) -> the sum of the distances from each to the next."""
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())


def travelled_m(positions: Float64) -> Float64:
    """(N, 3) -> (N,): the length of the path up to each position, from 0."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])


# --- relative ---


def relative_errors(estimate: Float64, truth: Float64, pairs: Pairs) -> tuple[Float64, Float64]:
    """(N, 4, 4), (N, 4, 4), (P, 2) rows -> (P,) metres and (P,) degrees.

    With the motion from pose i to pose j as T_i^-1 T_j: the length and the angle of what remains of the estimated
    motion after the true one is undone. A rigid transformation of either world frame changes nothing; a scale does.
    """
    turn_e, shift_e = _motions(estimate, pairs)
    turn_t, shift_t = _motions(truth, pairs)
    return np.linalg.norm(shift_e - shift_t, axis=1), np.rad2deg(rotation_angle_rad(turn_t, turn_e))


def _motions(c2w: Float64, pairs: Pairs) -> tuple[Float64, Float64]:
    first, second = c2w[pairs[:, 0]], c2w[pairs[:, 1]]
    back = np.swapaxes(first[:, :3, :3], -1, -2)
    # The difference comes before the rotation: far from the origin that keeps digits.
    shift = (back @ (second[:, :3, 3] - first[:, :3, 3])[:, :, None])[:, :, 0]
    return back @ second[:, :3, :3], shift


def consecutive_pairs(count: int) -> Pairs:
    """Return the pairs (P, 2) of each of so many poses with the next one."""
    rows = np.arange(max(count - 1, 0))
    return np.stack([rows, rows + 1], axis=1)


def pairs_apart(along: Float64, delta: float, tolerance: float) -> Pairs:
    """Return the pairs (P, 2), i < j, where j is the row whose along[j] - along[i] comes nearest to delta.

    along: (N,), not decreasing: the path up to each pose, or its stamp. A row has a pair where that is within the
    tolerance of delta. Of rows that come equally near, the first counts, as with evo's all_pairs.
    """
    rows = np.arange(max(len(along) - 1, 0))
    if not rows.size:
        return np.zeros((0, 2), dtype=np.int64)
    wanted = along[rows] + delta
    after = np.clip(np.searchsorted(along, wanted), rows + 1, len(along) - 1)
    below = np.maximum(after - 1, rows + 1)
    before = np.maximum(np.searchsorted(along, along[below]), rows + 1)  # the first of those that are equal
    off_before, off_after = (np.abs(along[found] - along[rows] - delta) for found in (before, after))
    chosen = np.where(off_before <= off_after, before, after)
    close = np.minimum(off_before, off_after) <= tolerance
    return np.stack([rows, chosen], axis=1)[close]
