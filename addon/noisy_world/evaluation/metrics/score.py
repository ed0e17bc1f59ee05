# SPDX-License-Identifier: GPL-3.0-or-later
"""A trajectory scored: an estimate against the true path."""

from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from ...core.trajectories.trajectory import Trajectory
from ..estimate import Estimate
from .alignment import (
    IDENTITY,
    Alignment,
    Similarity,
    aligned_poses,
    first_pose_alignment,
    least_squares_alignment,
    stands_still,
)
from .association import MAX_DIFFERENCE_S, associate_poses
from .compared import Compared
from .frame_errors import FrameErrors
from .names import metrics_of, value_of
from .protocols import PROTOCOLS, Protocol
from .rotation_order import rotation_notes
from .success import RunResult, result_of

Values: TypeAlias = dict[str, float | None]

FEWEST_POSES = 3
"""Two poses and one can always be laid over the truth."""
LARGEST_M = 1e100
"""Positions beyond it leave float64's range when they are squared."""

FAILURES = {
    "no_poses": "the estimate holds no pose",
    "no_common_stamps": "no pose of the estimate belongs to a true frame, by their stamps",
    "too_few_poses": f"fewer than {FEWEST_POSES} poses belong to true frames, so any estimate would fit",
    "stands_still": "all estimated positions are one, while the camera moved",
    "truth_stands_still": "the camera stood still, so an estimate's scale cannot be found",
    "diverged": f"a position lies beyond {LARGEST_M:g}",
}
"""What Score.failure may say, but for ""."""


@dataclass(frozen=True, eq=False)
class Score:
    """What is said of one estimate.

    protocol: its name. alignment: how the estimate was laid over the truth, by: with what; None where the run failed.
    failure: "" or one of FAILURES. poses: of the estimate that were scored; frames: of the truth; matched: how many of
    both belong together, their stamps max_difference_s apart at most. values: by the names of METRICS (or
    PAPER_METRICS), each finite; None where a metric has none. frame_errors: of every true frame. notes: what a user
    should know, one sentence each.
    """

    protocol: str
    alignment: Alignment
    by: Similarity | None
    failure: str
    poses: int
    frames: int
    matched: int
    max_difference_s: float
    values: Values
    frame_errors: FrameErrors = field(repr=False)
    notes: tuple[str, ...] = ()

    @property
    def result(self) -> RunResult:
        """What came of the run: complete, incomplete or failed."""
        return result_of(bool(self.failure), self.matched / self.frames)


def score_trajectory(
    estimate: Estimate,
    truth: Trajectory,
    protocol: str | Protocol = "strict",
    *,
    monocular: bool = False,
    keyframes: Estimate | None = None,
    max_difference_s: float | None = None,
    alignment: Alignment | None = None,
) -> Score:
    """Score an estimate against the true path of all the frames that the system was given.

    protocol: its name, or one of your own. monocular: whether the system had no depth, so its scale is free. keyframes:
    those of the run, which protocol paper scores instead. max_difference_s, alignment: instead of the protocol's.
    A run that failed is a result with a word, never an exception. Raises ValueError for a protocol that does not exist.
    """
    if isinstance(protocol, str):
        if protocol not in PROTOCOLS:
            raise ValueError(f"protocol is one of {', '.join(PROTOCOLS)}, not {protocol!r}")
        protocol = PROTOCOLS[protocol]
    how = protocol.alignment(monocular=monocular) if alignment is None else alignment
    scored = keyframes if protocol.keyframes and keyframes is not None else estimate
    within_s = protocol.max_difference_s if max_difference_s is None else max_difference_s
    matched = compare_poses(scored, truth, protocol, how, within_s)
    values = {name: value_of(metric, matched) for name, metric in metrics_of(protocol).items()}
    errors, counts = _frame_errors(matched), (len(scored), len(truth), len(matched.frames))
    notes = rotation_notes(matched)
    return Score(protocol.name, how, matched.by, matched.failure, *counts, within_s, values, errors, notes)


def compare_poses(
    scored: Estimate,
    truth: Trajectory,
    protocol: Protocol = PROTOCOLS["strict"],
    how: Alignment = Alignment.SE3,
    within_s: float = MAX_DIFFERENCE_S,
) -> Compared:
    """Return an estimate laid over the truth, or why it cannot be: what metrics are computed from."""
    rows, frames = associate_poses(scored.stamps_s, truth.stamps_s, within_s)
    matched = Compared(scored.c2w[rows], truth, frames, protocol)
    if failure := _failure(scored, matched, how):
        return replace(matched, failure=failure)
    by = _alignment(matched, how)
    return replace(matched, estimate=aligned_poses(matched.estimate, by), by=by, rotation_known=by.rotation_known)


def _failure(scored: Estimate, matched: Compared, how: Alignment) -> str:
    if len(scored) == 0:
        return "no_poses"
    if len(matched.frames) == 0:
        return "no_common_stamps"
    if len(matched.frames) < FEWEST_POSES:
        return "too_few_poses"
    if np.abs(matched.estimate[:, :3, 3]).max() > LARGEST_M:
        return "diverged"
    true_still = stands_still(matched.true[:, :3, 3])
    if true_still:
        return "truth_stands_still" if how is Alignment.SIM3 else ""
    return "stands_still" if stands_still(matched.estimate[:, :3, 3]) else ""


def _alignment(matched: Compared, how: Alignment) -> Similarity:
    if how is Alignment.NONE:
        return IDENTITY
    if how is Alignment.FIRST_POSE:
        return first_pose_alignment(matched.estimate[0], matched.true[0])
    with_scale = how is Alignment.SIM3
    return least_squares_alignment(matched.estimate[:, :3, 3], matched.true[:, :3, 3], with_scale=with_scale)


def _frame_errors(matched: Compared) -> FrameErrors:
    count = len(matched.truth)
    error_m, rotation_deg, position_m = np.full(count, np.nan), np.full(count, np.nan), np.full((count, 3), np.nan)
    if not matched.failure:
        error_m[matched.frames] = matched.position_errors_m
        position_m[matched.frames] = matched.estimate[:, :3, 3]
        if matched.rotation_known:
            rotation_deg[matched.frames] = matched.rotation_errors_deg
    return FrameErrors(matched.truth.stamps_s, matched.tracked, error_m, rotation_deg, position_m)
