# SPDX-License-Identifier: GPL-3.0-or-later
"""An estimate laid over the truth: alignment, and absolute and relative errors of its poses."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import pose, quat_wxyz_from_rotation, rotation_angle_rad, rotation_from_quat_wxyz
from ..core.trajectory import Trajectory
from .estimates import MAX_DIFFERENCE_S, Rows

# The transformation that lays an estimate's positions over the true ones, as the two have different world frames.


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


# Absolute and relative errors of poses, and which pairs of poses the relative ones compare.
#
# Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012: the absolute trajectory error (ATE)
# compares poses after alignment, the relative pose error (RPE) motions between two poses.


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
    off_before, off_after = (np.abs(along[candidates] - along[rows] - delta) for candidates in (before, after))
    chosen = np.where(off_before <= off_after, before, after)
    close = np.minimum(off_before, off_after) <= tolerance
    return np.stack([rows, chosen], axis=1)[close]


# Protocols: what is decided before a number is calculated, said by name.
#
# `strict` is ours. `paper` does what the published code of the paper does, faults included, as nothing that was
# published can be compared otherwise.


Kind: TypeAlias = Literal["strict", "paper"]

DEFINITIONS = 2
"""Raised when equal estimates get other values. Results of before are read, but take no runs of these.

1: pairs within 0.02 s, coverage in samples of the truth, rotations and maps laid by positions alone.
"""


@dataclass(frozen=True)
class Protocol:
    """How a run is scored.

    kind: which values it gives. rgbd, monocular: the alignment of a system with depth, and of one without.
    statistic: of ate_m, of kind paper. keyframes: whether a run's keyframes are scored, where it has them.
    failed: what errors of a failed run are; None: nothing. faults: by name, what is not as one would expect.
    """

    name: str
    meaning: str
    kind: Kind
    rgbd: Alignment
    monocular: Alignment
    statistic: Literal["rmse", "mean"] = "rmse"
    keyframes: bool = False
    failed: float | None = None
    max_difference_s: float = MAX_DIFFERENCE_S
    faults: tuple[tuple[str, str], ...] = ()

    def alignment(self, *, monocular: bool) -> Alignment:
        """Return the alignment of a system."""
        return self.monocular if monocular else self.rgbd


_FAILED_IS_ONE = (
    "failed_is_1",
    "a run without a trajectory, or with fewer than three poses, has ATE and RPE 1.0 and SR 0",
)
_NOT_CAPPED = (
    "errors_not_capped",
    "the ATE of a run that did not fail may exceed 1.0, so it can be worse than a failure",
)
_SCALED = ("sim3_with_depth", "the scale is fitted although depth tells it, which hides an error of scale")
_KEYFRAMES = ("keyframes_only", "only keyframes are compared, so frames between them and lost frames cost nothing")
_RPE = ("rpe_is_rotation", "RPE, printed in metres, is the rotation between consecutive keyframes in radians")
_SR = (
    "sr_is_path_share",
    "SR is the length of the aligned keyframes' path over that of the true path; drift raises it",
)
_MEAN = ("mean_not_rmse", "ATE is the mean of the errors, which is never more than the RMSE")

PROTOCOLS: dict[str, Protocol] = {
    protocol.name: protocol
    for protocol in (
        Protocol(
            "strict",
            "SE(3) with depth and Sim(3) without, all frames, RMSE; a failed run has no error, and coverage is said",
            "strict",
            Alignment.SE3,
            Alignment.SIM3,
        ),
        Protocol(
            "paper",
            "as the paper's code does it for ORB-SLAM3: Sim(3), keyframes, RMSE",
            "paper",
            Alignment.SIM3,
            Alignment.SIM3,
            keyframes=True,
            failed=1.0,
            faults=(_FAILED_IS_ONE, _NOT_CAPPED, _SCALED, _KEYFRAMES, _RPE, _SR),
        ),
        Protocol(
            "paper_go_slam",
            "as the paper's code does it for GO-SLAM: Sim(3), all frames, RMSE",
            "paper",
            Alignment.SIM3,
            Alignment.SIM3,
            failed=1.0,
            faults=(_FAILED_IS_ONE, _NOT_CAPPED, _SCALED, _RPE, _SR),
        ),
        Protocol(
            "paper_mean",
            "as the paper's code does it for iMAP, NICE-SLAM, Co-SLAM and SplaTAM: SE(3), all frames, mean",
            "paper",
            Alignment.SE3,
            Alignment.SE3,
            statistic="mean",
            failed=1.0,
            faults=(_FAILED_IS_ONE, _NOT_CAPPED, _MEAN, _RPE, _SR),
        ),
    )
}
"""Every protocol by name. The paper prints RPE and SR of ORB-SLAM3 alone; of others they are by the same formulas."""


_MEAN_SYSTEMS = ("imap", "nice_slam", "co_slam", "coslam", "splatam")


def paper_protocol(system: str) -> Protocol:
    """Return the protocol by which the paper scores a system of this name: `paper` for one that it does not score."""
    name = system.lower().replace("-", "_")
    if name.startswith("go_slam"):
        return PROTOCOLS["paper_go_slam"]
    return PROTOCOLS["paper_mean" if name.startswith(_MEAN_SYSTEMS) else "paper"]


Delta: TypeAlias = Literal["1frame", "1s", "1m"]


@dataclass(frozen=True, eq=False)
class Compared:
    """The poses of an estimate that belong to frames of the truth.

    estimate: (P, 4, 4) float64, camera-to-world, laid over the truth by `by`; in its own world where the run failed.
    truth: the true path of all N frames that the system was given. frames: (P,) rows of the truth, increasing: which
    frame each pose belongs to. protocol: how it was laid over the truth. by: with what; None where the run failed.
    failure: "", or why the run has no errors. by_poses: what lays the cameras' rotations, and a map, over the truth: it
    is `by` where the positions decide the rotation, else full poses do. conditioning: how well the path does.
    """

    estimate: Float64
    truth: Trajectory
    frames: Rows
    protocol: Protocol
    by: Similarity | None = None
    failure: str = ""
    by_poses: Similarity | None = None
    conditioning: Conditioning | None = None

    @cached_property
    def true(self) -> Float64:
        """(P, 4, 4): the true poses of the same frames."""
        return self.truth.c2w[self.frames]

    @cached_property
    def tracked(self) -> NDArray[np.bool_]:
        """(N,): which frames of the truth have a pose."""
        mask = np.zeros(len(self.truth), dtype=bool)
        mask[self.frames] = True
        return mask

    @property
    def tracked_share(self) -> float:
        """The share of the true frames that have a pose."""
        return float(self.tracked.mean())

    @cached_property
    def position_errors_m(self) -> Float64:
        """(P,): the distances of estimated and true positions; (0,) where the run failed."""
        return np.zeros(0) if self.failure else position_errors_m(self.estimate, self.true)

    @cached_property
    def rotation_errors_deg(self) -> Float64:
        """(P,): the angles between estimated rotations, laid by `by_poses`, and true ones; (0,) if the run failed."""
        if self.by is None or self.by_poses is None:
            return np.zeros(0)
        if self.by_poses is self.by:
            return rotation_errors_deg(self.estimate, self.true)
        laid = np.array(self.estimate)
        laid[:, :3, :3] = (self.by_poses.rotation @ self.by.rotation.T) @ laid[:, :3, :3]
        return rotation_errors_deg(laid, self.true)

    @cached_property
    def position(self) -> ErrorStatistics:
        """Statistics of the distances, of a run that did not fail."""
        return spread_of(self.position_errors_m)

    @cached_property
    def rotation(self) -> ErrorStatistics:
        """Statistics of the angles, of a run that did not fail."""
        return spread_of(self.rotation_errors_deg)

    @property
    def ate_m(self) -> float | None:
        """The RMSE of the positions; None where the run failed."""
        return None if self.failure else self.position.rmse

    @property
    def still(self) -> bool:
        """Whether the estimate or the truth stands still, so that no scale can be found."""
        return stands_still(self.estimate[:, :3, 3]) or stands_still(self.true[:, :3, 3])

    @cached_property
    def remaining_scale(self) -> float:
        """The scale that Sim(3) alignment finds beside that of the protocol's; nothing may stand still."""
        return least_squares_alignment(self.estimate[:, :3, 3], self.true[:, :3, 3], with_scale=True).scale

    @property
    def path_share(self) -> float | None:
        """The length of the estimated path over that of the whole true path; None where that is 0."""
        whole_m = path_length_m(self.truth.c2w[:, :3, 3])
        return path_length_m(self.estimate[:, :3, 3]) / whole_m if whole_m > 0.0 else None

    def relative(self, pairs: Pairs) -> tuple[Float64, Float64]:
        """Return the relative errors, metres and degrees, of those pairs (K, 2) of true frames that both have a pose.

        None of either where the run failed.
        """
        if self.failure:
            return np.zeros(0), np.zeros(0)
        row_of = np.full(len(self.truth), -1)
        row_of[self.frames] = np.arange(len(self.frames))
        both = row_of[pairs]
        return relative_errors(self.estimate, self.true, both[(both >= 0).all(axis=1)])

    @cached_property
    def motions(self) -> "dict[Delta, Motions]":
        """The relative errors from frame to frame, over one second, and over one metre of the true path.

        The pairs are those of the truth, so they are the same for every system.
        """
        stamps_s = self.truth.stamps_s
        frame_s = float(np.median(np.diff(stamps_s))) if len(stamps_s) > 1 else 0.0
        pairs: dict[Delta, Pairs] = {
            "1frame": consecutive_pairs(len(stamps_s)),
            "1s": pairs_apart(stamps_s - stamps_s[0], 1.0, frame_s / 2),
            "1m": pairs_apart(travelled_m(self.truth.c2w[:, :3, 3]), 1.0, 0.1),
        }
        return {name: Motions(len(chosen), *self.relative(chosen)) for name, chosen in pairs.items()}


@dataclass(frozen=True, eq=False)
class Motions:
    """Relative errors over pairs of frames. true: how many pairs the truth has. errors_m, errors_deg: (K,)."""

    true: int
    errors_m: Float64
    errors_deg: Float64


# The errors of a run frame by frame, and the file that holds them: `errors.csv`.


COLUMNS = ("index", "stamp_s", "tracked", "error_m", "rotation_error_deg", "x_m", "y_m", "z_m")


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Of every true frame: (N,) stamps in seconds, whether it has a pose, and how far that is off.

    error_m, rotation_error_deg: (N,), after alignment; NaN where the frame has no pose, and where the run failed.
    position_m: (N, 3) the estimated position in the true world frame.
    """

    stamp_s: Float64
    tracked: NDArray[np.bool_]
    error_m: Float64
    rotation_error_deg: Float64
    position_m: Float64

    def __len__(self) -> int:
        return len(self.stamp_s)


def frame_errors_text(errors: FrameErrors) -> str:
    """Return the errors as CSV: a row for each frame, an empty cell where a number is missing; tracked is 1 or 0."""
    columns = (np.arange(len(errors)), errors.stamp_s, errors.tracked, errors.error_m, errors.rotation_error_deg)
    named: dict[str, NDArray[Any]] = dict(zip(COLUMNS, (*columns, *errors.position_m.T), strict=True))
    return columns_text(named, {"index": 0, "stamp_s": 9, "tracked": 0})


def columns_text(columns: Mapping[str, NDArray[Any]], decimals: Mapping[str, int]) -> str:
    """Return columns of numbers as CSV, an empty cell where one is missing. decimals: of some columns, else all."""
    cells = [[_cell(number, decimals.get(name)) for number in values.tolist()] for name, values in columns.items()]
    return "".join(f"{','.join(row)}\n" for row in (columns, *zip(*cells, strict=True)))


def _cell(number: float, decimals: int | None) -> str:
    if not math.isfinite(number):
        return ""
    return repr(number) if decimals is None else f"{number:.{decimals}f}"


# Whether an estimate's rotations look as if its quaternions were written in another order than they were read.


WRONG_DEG = 30.0  # chosen: the median error of rotations from which on they cannot be those of the positions
SMALL_SHARE = 0.1  # chosen: of the path's extent, below which an ATE says that the positions are right
BETTER = 5.0  # chosen: times that the other order has to make the error smaller
TURNED_DEG = 150.0  # chosen: a median error from which on the camera looks the other way


def rotation_notes(matched: Compared) -> tuple[str, ...]:
    """Return a sentence where the positions fit and the rotations do not, as of quaternions w x y z read as x y z w.

    matched: an estimate that lies over the truth. Rotations are those of full poses, so that a path which does not say
    how it is turned about itself accuses nobody.
    """
    by, known = matched.by, matched.conditioning
    if by is None or known is None or matched.rotation.median < WRONG_DEG:
        return ()
    rotation = matched.rotation
    extent_m = float(np.linalg.norm(np.ptp(matched.true[:, :3, 3], axis=0)))
    if matched.position.rmse > SMALL_SHARE * extent_m:
        return ()
    note = f"the positions fit and the rotations are off by {rotation.median:.0f} degrees (median)"
    other = _read_w_first(matched.estimate, by.rotation)
    if by is not matched.by_poses:
        other = aligned_poses(other, full_pose_alignment(other, matched.true, IDENTITY, known))
    other_deg = float(np.median(rotation_errors_deg(other, matched.true)))
    if other_deg * BETTER < rotation.median:
        return (
            f"{note}, but by {other_deg:.2g} if the quaternions are taken for w x y z: they look as if they were "
            "written w first and read as x y z w. Write them w last, as TUM's format has them, or as EuRoC's table",
        )
    if rotation.median > TURNED_DEG:
        return (f"{note}: its cameras may have other axes (--axes), or its quaternions another order than x y z w",)
    return ()


def _read_w_first(aligned: NDArray[np.float64], alignment: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P, 4, 4) after an alignment (3, 3) -> the same with the numbers x y z w of each rotation taken for w x y z."""
    poses = np.array(aligned)
    read_xyzw = np.roll(quat_wxyz_from_rotation(alignment.T @ aligned[:, :3, :3]), -1, axis=1)
    poses[:, :3, :3] = alignment @ rotation_from_quat_wxyz(read_xyzw)
    return poses
