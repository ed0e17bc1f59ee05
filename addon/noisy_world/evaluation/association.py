# SPDX-License-Identifier: GPL-3.0-or-later
"""Which pose of an estimate belongs to which frame of the truth, decided by their time stamps."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float64: TypeAlias = NDArray[np.float64]
Rows: TypeAlias = NDArray[np.int64]

MAX_DIFFERENCE_S = 0.01
"""How far the stamps of a pose and its frame may lie apart: evo's default, and that of the paper's code."""


def associate_poses(
    estimate_s: Float64, truth_s: Float64, max_difference_s: float = MAX_DIFFERENCE_S
) -> tuple[Rows, Rows]:
    """Return the rows (K,) of the poses and (K,) of the frames that belong together, both increasing.

    estimate_s (M,), truth_s (N,): seconds, strictly increasing. A pose and a frame belong together where each is the
    other's nearest and their stamps differ by max_difference_s at most; of two that are equally near, the earlier
    counts. So each is used once, and a pose that is not its frame's nearest is left out, rather than given to the next
    frame. evo gives the same pairs, but uses a pose or a frame twice where max_difference_s is more than half of what
    lies between two stamps. Raises ValueError for a difference that is negative or not finite.
    """
    if not (np.isfinite(max_difference_s) and max_difference_s >= 0.0):
        raise ValueError(f"max_difference_s is 0 or more, not {max_difference_s}")
    if len(estimate_s) == 0 or len(truth_s) == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    frame_of_pose = _nearest(estimate_s, truth_s)
    pose_of_frame = _nearest(truth_s, estimate_s)
    poses = np.arange(len(estimate_s))
    close = np.abs(estimate_s - truth_s[frame_of_pose]) <= max_difference_s
    kept = np.flatnonzero(close & (pose_of_frame[frame_of_pose] == poses))
    return kept, frame_of_pose[kept]


def _nearest(of_s: Float64, among_s: Float64) -> Rows:
    """(M,), (N,), N >= 1 -> (M,): the row of the nearest stamp, the earlier of two that are equally near."""
    after = np.clip(np.searchsorted(among_s, of_s), 0, len(among_s) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(np.abs(of_s - among_s[before]) <= np.abs(among_s[after] - of_s), before, after)
