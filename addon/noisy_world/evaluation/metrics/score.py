# SPDX-License-Identifier: GPL-3.0-or-later
"""A trajectory scored: an estimate against the true path."""

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

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
from .association import Rows, associate_poses
from .errors import (
    Pairs,
    consecutive_pairs,
    pairs_apart,
    path_length_m,
    position_errors_m,
    relative_errors,
    rotation_errors_deg,
    spread_of,
    travelled_m,
)
from .frame_errors import FrameErrors
from .names import METRICS, success_name
from .protocols import PROTOCOLS, Protocol
from .success import (
    LARGEST_RPE_DEG,
    LARGEST_RPE_M,
    THRESHOLDS_M,
    bad_pose_share,
    f1_auc,
    is_success,
    losses_of,
    success_auc,
)

Float64: TypeAlias = NDArray[np.float64]
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
    PAPER_METRICS), each finite; None where a metric has none. frame_errors: of every true frame.
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
    rows, frames = associate_poses(scored.stamps_s, truth.stamps_s, within_s)
    matched = _Matched(scored.c2w[rows], truth, frames)
    failure = _failure(scored, matched, how)
    by = None if failure else _alignment(matched, how)
    if by is not None:
        matched = _Matched(aligned_poses(matched.estimate, by), truth, frames, rotation_known=by.rotation_known)
    values = _strict(matched, by, failure) if protocol.kind == "strict" else _paper(matched, failure, protocol)
    errors = _frame_errors(matched, failure)
    return Score(protocol.name, how, by, failure, len(scored), len(truth), len(rows), within_s, values, errors)


@dataclass(frozen=True, eq=False)
class _Matched:
    """The poses (P, 4, 4) that belong to frames (P,) of the truth; in its world frame once they are aligned."""

    estimate: Float64
    truth: Trajectory
    frames: Rows
    rotation_known: bool = True

    @property
    def true(self) -> Float64:
        """(P, 4, 4): the true poses of the same frames."""
        return self.truth.c2w[self.frames]

    @property
    def tracked(self) -> NDArray[np.bool_]:
        """(N,): which frames of the truth have a pose."""
        found = np.zeros(len(self.truth), dtype=bool)
        found[self.frames] = True
        return found

    def relative(self, pairs: Pairs) -> tuple[Float64, Float64]:
        """Return the relative errors, metres and degrees, of those pairs of true frames that both have a pose."""
        row_of = np.full(len(self.truth), -1)
        row_of[self.frames] = np.arange(len(self.frames))
        both = row_of[pairs]
        return relative_errors(self.estimate, self.true, both[(both >= 0).all(axis=1)])


def _failure(scored: Estimate, matched: _Matched, how: Alignment) -> str:
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


def _alignment(matched: _Matched, how: Alignment) -> Similarity:
    if how is Alignment.NONE:
        return IDENTITY
    if how is Alignment.FIRST_POSE:
        return first_pose_alignment(matched.estimate[0], matched.true[0])
    return _fitted(matched, with_scale=how is Alignment.SIM3)


def _fitted(matched: _Matched, *, with_scale: bool) -> Similarity:
    return least_squares_alignment(matched.estimate[:, :3, 3], matched.true[:, :3, 3], with_scale=with_scale)


# --- strict ---


def _strict(matched: _Matched, by: Similarity | None, failure: str) -> Values:
    values: Values = dict.fromkeys(METRICS)
    values |= _coverage(matched)
    if failure == "truth_stands_still":
        return values
    if by is not None:
        values |= _absolute(matched, by)
    values |= _relative(matched, failure)
    ate_m, tracked_share = values["ate_rmse_m"], float(matched.tracked.mean())
    for threshold_m in THRESHOLDS_M:
        values[success_name(threshold_m)] = float(is_success(ate_m, tracked_share, threshold_m))
    values["success_auc"] = success_auc(ate_m, tracked_share)
    errors_m = np.zeros(0) if failure else position_errors_m(matched.estimate, matched.true)
    values["bad_pose_share"] = bad_pose_share(errors_m, len(matched.truth))
    values["path_share"] = 0.0 if failure else _path_share(matched)
    return values


def _coverage(matched: _Matched) -> Values:
    losses = losses_of(matched.tracked, matched.truth.stamps_s)
    return {
        "tracked_share": float(matched.tracked.mean()),
        "initialisation_s": losses.initialisation_s,
        "losses": float(losses.count),
        "longest_loss_s": losses.longest_s,
    }


def _absolute(matched: _Matched, by: Similarity) -> Values:
    still = stands_still(matched.estimate[:, :3, 3]) or stands_still(matched.true[:, :3, 3])
    found: Values = {"scale": None if still else by.scale * _fitted(matched, with_scale=True).scale}
    position = spread_of(position_errors_m(matched.estimate, matched.true))
    found |= {f"ate_{key}_m": getattr(position, key) for key in ("rmse", "mean", "median", "max", "std")}
    if matched.rotation_known:
        rotation = spread_of(rotation_errors_deg(matched.estimate, matched.true))
        found |= {f"ate_rotation_{key}_deg": getattr(rotation, key) for key in ("rmse", "mean", "median", "max")}
    return found


def _relative(matched: _Matched, failure: str) -> Values:
    """Return RPE and F1-AUC. The pairs are those of the truth, so they are the same for every system."""
    stamps_s = matched.truth.stamps_s
    frame_s = float(np.median(np.diff(stamps_s))) if len(stamps_s) > 1 else 0.0
    pairs = {
        "1frame": consecutive_pairs(len(stamps_s)),
        "1s": pairs_apart(stamps_s - stamps_s[0], 1.0, frame_s / 2),
        "1m": pairs_apart(travelled_m(matched.truth.c2w[:, :3, 3]), 1.0, 0.1),
    }
    found: Values = {}
    for key, chosen in pairs.items():
        metres, degrees = (np.zeros(0), np.zeros(0)) if failure else matched.relative(chosen)
        if metres.size:
            found[f"rpe_{key}_rmse_m"] = spread_of(metres).rmse
            found[f"rpe_{key}_rmse_deg"] = spread_of(degrees).rmse
        if key == "1s":
            found["f1_auc"] = f1_auc(metres, len(chosen), LARGEST_RPE_M)
            found["f1_auc_rotation"] = f1_auc(degrees, len(chosen), LARGEST_RPE_DEG)
    return found


def _path_share(matched: _Matched) -> float | None:
    whole_m = path_length_m(matched.truth.c2w[:, :3, 3])
    return path_length_m(matched.estimate[:, :3, 3]) / whole_m if whole_m > 0.0 else None


# --- paper ---


def _paper(matched: _Matched, failure: str, protocol: Protocol) -> Values:
    if failure:
        return {"ate_m": protocol.failed, "rpe_rad": protocol.failed, "sr": 0.0}
    position = spread_of(position_errors_m(matched.estimate, matched.true))
    # Between poses that follow one another among those that are scored, however far apart.
    _, degrees = relative_errors(matched.estimate, matched.true, consecutive_pairs(len(matched.frames)))
    rpe_rad = float(np.deg2rad(spread_of(degrees).rmse))
    return {"ate_m": getattr(position, protocol.statistic), "rpe_rad": rpe_rad, "sr": _path_share(matched)}


# --- frames ---


def _frame_errors(matched: _Matched, failure: str) -> FrameErrors:
    count = len(matched.truth)
    error_m, rotation_deg, position_m = np.full(count, np.nan), np.full(count, np.nan), np.full((count, 3), np.nan)
    if not failure:
        error_m[matched.frames] = position_errors_m(matched.estimate, matched.true)
        position_m[matched.frames] = matched.estimate[:, :3, 3]
        if matched.rotation_known:
            rotation_deg[matched.frames] = rotation_errors_deg(matched.estimate, matched.true)
    return FrameErrors(matched.truth.stamps_s, matched.tracked, error_m, rotation_deg, position_m)
