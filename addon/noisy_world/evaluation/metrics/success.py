# SPDX-License-Identifier: GPL-3.0-or-later
"""Scores from 0 to 1 that count what a run lost as well as what it erred, so that a failed run is a 0, not a gap."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Float64: TypeAlias = NDArray[np.float64]
RunResult: TypeAlias = Literal["complete", "incomplete", "failed"]

THRESHOLDS_M = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Of the ATE, below which a run counts as a success."""
LEAST_TRACKED = 0.8
"""The share of the frames that a run has to track to be complete, and so a success. Chosen; the paper's code has a
filter at 0.8 of the path's length, which it leaves out."""
COMPLETE: Literal["complete"] = "complete"
INCOMPLETE: Literal["incomplete"] = "incomplete"
FAILED: Literal["failed"] = "failed"
IS_INCOMPLETE = f"tracked less than {100 * LEAST_TRACKED:g} % of the frames"
"""What `incomplete` means, in words."""
LARGEST_ATE_M = 1.0
"""Where the area under the success curve ends: what the paper calls completely unacceptable."""
LARGEST_RPE_M = 0.1
LARGEST_RPE_DEG = 5.0
"""Where the area under the F1 curve ends, for motions of a second. Chosen."""
BAD_POSE_M = 0.1
"""The error from which on a pose counts as bad. Chosen."""


def result_of(failed: bool, tracked_share: float) -> RunResult:
    """Return what came of a run. failed: it gave no estimate, or one that cannot be scored.

    An incomplete run has an estimate of less than LEAST_TRACKED of the frames; a NaN share is not known to be less.
    """
    return FAILED if failed else INCOMPLETE if tracked_share < LEAST_TRACKED else COMPLETE


def is_success(ate_m: float | None, tracked_share: float, threshold_m: float) -> bool:
    """Tell whether a run's ATE is below a threshold and it tracked LEAST_TRACKED of the frames."""
    return ate_m is not None and ate_m < threshold_m and tracked_share >= LEAST_TRACKED


def success_auc(ate_m: float | None, tracked_share: float, largest_m: float = LARGEST_ATE_M) -> float:
    """Return the area under the curve of success over thresholds from 0 to largest_m, as a share of the whole.

    The curve of one run is a step at its ATE, so the area is 1 - ATE / largest_m, and 0 for a run that never succeeds.
    The mean over runs is the area under their curve: ETH3D's ranking (Schöps et al., "BAD SLAM", CVPR 2019).
    """
    if ate_m is None or tracked_share < LEAST_TRACKED:
        return 0.0
    return max(0.0, 1.0 - ate_m / largest_m)


def f1_auc(errors: Float64, true_pairs: int, largest: float) -> float | None:
    """Return the area under the curve of F1 over thresholds from 0 to largest, as a share of the whole.

    errors: (P,) relative errors of the pairs that the estimate has; true_pairs: how many the truth has, None where it
    has none. At a threshold, precision is the share of the estimate's pairs whose error is below it, recall that of the
    truth's: F1 = 2 n / (P + true_pairs) with n errors below, whose area is the sum of 1 - error / largest.
    Zhao et al., "SubT-MRS", CVPR 2024, with relative errors as in "SuperLoc", ICRA 2025; thresholds weigh alike here.
    """
    if true_pairs == 0:
        return None
    below = np.clip(1.0 - errors / largest, 0.0, None)
    return 2.0 * float(below.sum()) / (len(errors) + true_pairs)


@dataclass(frozen=True)
class Losses:
    """When a run did not track.

    initialisation_s: from the first frame to the first that is tracked; None where none is. count: how often tracking
    was lost after that, at the end too. longest_s: the longest time from a tracked frame to the next one, or to the
    last frame; 0 where nothing was lost.
    """

    initialisation_s: float | None
    count: int
    longest_s: float


def losses_of(tracked: NDArray[np.bool_], stamps_s: Float64) -> Losses:
    """(N,), (N,) of all frames, N >= 1 -> when they were not tracked."""
    rows = np.flatnonzero(tracked)
    if not rows.size:
        return Losses(None, 0, 0.0)
    ends = rows if rows[-1] == len(tracked) - 1 else np.append(rows, len(tracked))
    gaps = np.flatnonzero(np.diff(ends) > 1)
    until = np.minimum(ends[gaps + 1], len(tracked) - 1)
    lasted_s = stamps_s[until] - stamps_s[ends[gaps]]
    return Losses(float(stamps_s[rows[0]] - stamps_s[0]), len(gaps), float(lasted_s.max()) if gaps.size else 0.0)


def bad_pose_share(errors_m: Float64, frames: int) -> float:
    """Return the share of the frames that have no pose, or one that errs by BAD_POSE_M.

    errors_m: (P,) of those with one. eval-vislam's bad pose ratio: Li et al., "Survey and evaluation of monocular
    visual-inertial SLAM algorithms for augmented reality", VRIH 2019.
    """
    return 1.0 - int(np.count_nonzero(errors_m < BAD_POSE_M)) / frames
