# SPDX-License-Identifier: GPL-3.0-or-later
"""Metrics of trajectories: how far an estimate is from the truth, and how much of it there is."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from ..core.errors import NoisyWorldError
from ..core.packages import Door, Registry
from .pose_errors import (
    CONDITIONING,
    DECIDED,
    WELL_CONDITIONED,
    Compared,
    Delta,
    Protocol,
    consecutive_pairs,
    relative_errors,
    spread_of,
)

# What a metric is: a number with a name, a unit, the better direction and its meaning; one of paths has a function.


Better: TypeAlias = Literal["lower", "higher", ""]
Compute: TypeAlias = Callable[[Compared], float | None]


@dataclass(frozen=True)
class Metric:
    """A number that is said of a run. unit: "" where it has none. better: "" where neither way is.

    label: a heading. meaning: a sentence or two, with formula and source where they are not plain. misleads: when it
    does, in a few words.
    """

    name: str
    label: str
    unit: str
    better: Better
    meaning: str
    misleads: str = field(default="", kw_only=True)


@dataclass(frozen=True)
class TrajectoryMetric(Metric):
    """A metric of an estimate that lies over the truth; a column of a study's tables.

    compute: what was compared -> a finite number, or None where it has no value. of_failed: whether compute is asked
    about failed runs too, of which `failure` says why, and whose poses are not aligned; else such a run has no value.

    Raises ValueError for a name that is none, another `better`, and a label or meaning that is empty.
    """

    compute: Compute
    of_failed: bool = False

    def __post_init__(self) -> None:
        check_described(self)


def check_described(metric: Metric) -> None:
    """Raise ValueError for a name that is none, another `better`, and a label or meaning that is empty."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", metric.name):
        raise ValueError(f"{metric.name!r} is no name: small letters, digits and underscores, a letter first")
    if metric.better not in get_args(Better):
        raise ValueError(f"{metric.name}: better is {metric.better!r}, but has to be lower, higher or empty")
    if not (metric.label and metric.meaning):
        raise ValueError(f"{metric.name}: needs a label and a meaning")


# Scores from 0 to 1 that count what a run lost as well as what it erred, so that a failed run is a 0, not a gap.


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


# Every metric of a trajectory by its name, ours and those of installed packages, and how each is computed.


_STATISTICS = {
    "rmse": ("RMSE", "the root of the mean square"),
    "mean": ("mean", "the mean"),
    "median": ("median", "the median"),
    "max": ("max", "the largest"),
    "std": ("std", "the standard deviation"),
}
_DELTAS: dict[Delta, tuple[str, str, str]] = {
    "1frame": (
        "1 frame",
        "from one frame to the next",
        "trembling counts more than drift; a higher frame rate makes it smaller",
    ),
    "1s": ("1 s", "of one second", "faster motion makes it larger"),
    "1m": ("1 m", "of one metre of the true path", "a camera that turns on the spot has no such pairs"),
}
_STURM = "Sturm et al., IROS 2012."
_JUMPS = "it knows tracked frames alone: a system that gives up early looks good; one jump dominates it"
_MIXED = "the mean is never more than the RMSE: a table may not mix them"


def success_name(threshold_m: float) -> str:
    """Return the name of the metric of success below a threshold."""
    return f"success_{threshold_m * 100:g}cm"


def _of_ate() -> list[TrajectoryMetric]:
    metrics = []
    for key, (label, meaning) in _STATISTICS.items():
        distance = "the distances between estimated and true positions, after alignment, over the tracked frames"
        source = f" The absolute trajectory error; {_STURM}" if key == "rmse" else ""
        metrics.append(
            TrajectoryMetric(
                f"ate_{key}_m",
                f"ATE {label}",
                "m",
                "lower",
                f"{meaning} of {distance}.{source}",
                lambda compared, key=key: getattr(compared.position, key),
                misleads=_JUMPS if key == "rmse" else _MIXED,
            )
        )
    for key in ("rmse", "mean", "median", "max"):
        label, meaning = _STATISTICS[key]
        angle = "the angles between estimated and true rotations, after alignment"
        line = (
            f" Where conditioning is below {DECIDED:g}, positions alone do not decide the turn, and full poses do."
            if key == "rmse"
            else ""
        )
        metrics.append(
            TrajectoryMetric(
                f"ate_rotation_{key}_deg",
                f"ATE rotation {label}",
                "deg",
                "lower",
                f"{meaning} of {angle}.{line}",
                lambda compared, key=key: getattr(compared.rotation, key),
                misleads="a camera mounted or stated with other axes adds the same angle everywhere",
            )
        )
    return metrics


def _of_rpe() -> list[TrajectoryMetric]:
    metrics = []
    for key, (label, meaning, misleads) in _DELTAS.items():
        pairs = f"T^-1 E of true motions T and estimated E {meaning}, over all pairs of tracked frames"
        metrics.append(
            TrajectoryMetric(
                f"rpe_{key}_rmse_m",
                f"RPE {label}",
                "m",
                "lower",
                f"the RMSE of the lengths of {pairs}. {_STURM}",
                lambda compared, key=key: _rmse(compared.motions[key].errors_m),
                misleads=misleads,
            )
        )
        metrics.append(
            TrajectoryMetric(
                f"rpe_{key}_rmse_deg",
                f"RPE {label}, rotation",
                "deg",
                "lower",
                f"the RMSE of the angles of {pairs}.",
                lambda compared, key=key: _rmse(compared.motions[key].errors_deg),
                misleads=misleads,
            )
        )
    return metrics


def _rmse(errors: NDArray[np.float64]) -> float | None:
    return spread_of(errors).rmse if errors.size else None


def _losses(compared: Compared) -> Losses:
    return losses_of(compared.tracked, compared.truth.stamps_s)


def _scored(compute: Compute) -> Compute:
    """Return a function that has no value where the truth stands still: then no system could have a score."""
    return lambda compared: None if compared.failure == "truth_stands_still" else compute(compared)


_COVERAGE = [
    TrajectoryMetric(
        "tracked_share",
        "tracked frames",
        "",
        "higher",
        "the share of the true frames that have an estimated pose.",
        lambda compared: compared.tracked_share,
        of_failed=True,
        misleads="a wrong pose counts as tracked; of a system that gives keyframes alone it is low",
    ),
    TrajectoryMetric(
        "path_share",
        "path length",
        "",
        "higher",
        "the length of the aligned estimated path over that of the whole true path: what the paper calls success rate. "
        "Above 1 where the estimate trembles or strays.",
        _scored(lambda compared: 0.0 if compared.failure else compared.path_share),
        of_failed=True,
        misleads="trembling and straying lengthen it, up to and beyond 1",
    ),
    TrajectoryMetric(
        "initialisation_s",
        "initialisation",
        "s",
        "lower",
        "the time from the first frame to the first tracked one.",
        lambda compared: _losses(compared).initialisation_s,
        of_failed=True,
    ),
    TrajectoryMetric(
        "losses",
        "losses",
        "",
        "lower",
        "how often tracking was lost after the first tracked frame.",
        lambda compared: float(_losses(compared).count),
        of_failed=True,
        misleads="means nothing where a system gives keyframes alone",
    ),
    TrajectoryMetric(
        "longest_loss_s",
        "longest loss",
        "s",
        "lower",
        "the longest time from a tracked frame to the next, or to the end.",
        lambda compared: _losses(compared).longest_s,
        of_failed=True,
        misleads="means nothing where a system gives keyframes alone",
    ),
    TrajectoryMetric(
        "bad_pose_share",
        "bad poses",
        "",
        "lower",
        f"the share of the frames without a pose, or with one off by {BAD_POSE_M:g} m or more. Li et al., VRIH 2019.",
        _scored(lambda compared: bad_pose_share(compared.position_errors_m, len(compared.truth))),
        of_failed=True,
        misleads="0.1 m is much on a table and little in a street",
    ),
    TrajectoryMetric(
        "scale",
        "scale",
        "",
        "",
        "true length over estimated length as Sim(3) alignment finds it; of a system with depth it should be 1.",
        lambda compared: None if compared.still or not compared.by else compared.by.scale * compared.remaining_scale,
        misleads="of an estimate that is wrong altogether it means nothing",
    ),
    TrajectoryMetric(
        CONDITIONING,
        "conditioning",
        "",
        "",
        "the second extent of the true path, the standard deviation of its positions along its second principal axis, "
        f"over ate_rmse_m. Below {WELL_CONDITIONED:g} positions hardly say how the path is turned about itself.",
        lambda compared: compared.conditioning.ratio if compared.conditioning else None,
        misleads="it is no error: a better system has a larger one on the same path",
    ),
]

_SUCCESS = [
    *(
        TrajectoryMetric(
            success_name(threshold_m),
            f"success at {threshold_m * 100:g} cm",
            "",
            "higher",
            f"1 where ate_rmse_m is below {threshold_m:g} m and {LEAST_TRACKED:g} of the frames or more are tracked.",
            _scored(
                lambda compared, threshold_m=threshold_m: float(
                    is_success(compared.ate_m, compared.tracked_share, threshold_m)
                )
            ),
            of_failed=True,
            misleads=f"the share {LEAST_TRACKED:g} is chosen",
        )
        for threshold_m in THRESHOLDS_M
    ),
    TrajectoryMetric(
        "success_auc",
        "success AUC",
        "",
        "higher",
        f"the area under the curve of success over thresholds from 0 to {LARGEST_ATE_M:g} m: 1 - ATE / "
        f"{LARGEST_ATE_M:g} m, 0 for a run that failed or tracked less than {LEAST_TRACKED:g} of the frames. As ETH3D "
        "ranks; Schöps et al., CVPR 2019.",
        _scored(lambda compared: success_auc(compared.ate_m, compared.tracked_share)),
        of_failed=True,
        misleads="below 1 cm all systems look alike",
    ),
    TrajectoryMetric(
        "f1_auc",
        "F1 AUC",
        "",
        "higher",
        "the area under the curve of the F1 score of motions of one second over thresholds of their error from 0 to "
        f"{LARGEST_RPE_M:g} m: precision over the estimate's motions, recall over the truth's, so lost frames count. "
        "Zhao et al., SubT-MRS, CVPR 2024.",
        _scored(lambda compared: f1_auc(compared.motions["1s"].errors_m, compared.motions["1s"].true, LARGEST_RPE_M)),
        of_failed=True,
        misleads="it sees drift within a second, no jump that loop closure would mend; faster motion lowers it",
    ),
    TrajectoryMetric(
        "f1_auc_rotation",
        "F1 AUC, rotation",
        "",
        "higher",
        f"the same of their angles, from 0 to {LARGEST_RPE_DEG:g} degrees.",
        _scored(
            lambda compared: f1_auc(compared.motions["1s"].errors_deg, compared.motions["1s"].true, LARGEST_RPE_DEG)
        ),
        of_failed=True,
        misleads="it sees drift within a second, no jump that loop closure would mend; faster motion lowers it",
    ),
]

DOOR = Door("noisy_world.metrics", "metric", "METRIC", (TrajectoryMetric,))


_LISTED = (*_of_ate(), *_of_rpe(), *_COVERAGE, *_SUCCESS)

METRICS = Registry(DOOR, __package__, listed=_LISTED)
"""What protocol strict gives, in the order in which it is shown; then those of installed packages."""


def _paper_rpe_rad(compared: Compared) -> float | None:
    if compared.failure:
        return compared.protocol.failed
    # Between poses that follow one another among those that are scored, however far apart.
    _, degrees = relative_errors(compared.estimate, compared.true, consecutive_pairs(len(compared.frames)))
    return float(np.deg2rad(spread_of(degrees).rmse))


PAPER_METRICS: dict[str, TrajectoryMetric] = {
    item.name: item
    for item in (
        TrajectoryMetric(
            "ate_m",
            "ATE (paper)",
            "m",
            "lower",
            "what the paper prints as ATE; a failed run is 1.0.",
            lambda compared: (
                compared.protocol.failed
                if compared.failure
                else getattr(compared.position, compared.protocol.statistic)
            ),
            of_failed=True,
        ),
        TrajectoryMetric(
            "rpe_rad",
            "RPE (paper)",
            "rad",
            "lower",
            "what the paper prints as RPE in metres: the RMSE of the rotation errors between consecutive poses, in "
            "radians; a failed run is 1.0.",
            _paper_rpe_rad,
            of_failed=True,
        ),
        TrajectoryMetric(
            "sr",
            "SR (paper)",
            "",
            "higher",
            "what the paper prints as success rate: path_share of its poses; 0 for a failed run.",
            lambda compared: 0.0 if compared.failure else compared.path_share,
            of_failed=True,
        ),
    )
}
"""What protocol paper gives; in tables their names begin with `paper.`."""

PAPER_PREFIX = "paper."


def metrics_of(protocol: Protocol) -> Mapping[str, TrajectoryMetric]:
    """Return the metrics that a protocol gives, by name."""
    return METRICS if protocol.kind == "strict" else PAPER_METRICS


def value_of(metric: TrajectoryMetric, compared: Compared) -> float | None:
    """Return a metric's value; None where it has none.

    Raises NoisyWorldError, naming it and its package, for what is neither None nor a finite number.
    """
    if compared.failure and not metric.of_failed:
        return None
    return checked_value(metric, metric.compute(compared), METRICS)


def checked_value(metric: Metric, value: Any, registry: Registry[Any]) -> float | None:
    """Return what a metric of a registry gave as a number; None where it has no value.

    Raises NoisyWorldError, naming it and its package, for what is neither None nor a finite number.
    """
    if value is None:
        return None
    if isinstance(value, (int, float, np.integer, np.floating)) and np.isfinite(value):
        return float(value)
    whose = registry.distribution(metric.name) if registry.get(metric.name) is metric else None
    raise NoisyWorldError(
        f"{f'{whose}: ' if whose else ''}the metric {metric.name} gave {str(value)[:40]}, but has to give a finite "
        "number, or None where it has no value"
    )


# A run's error over the clean one of the same system in the same scene, and success by that.
#
# A threshold in metres says whether a path is good enough for a task; it sees nothing of noise where a system errs by
# millimetres. What noise did is seen beside the error without it, whatever a system's accuracy is.


OVER_CLEAN = "ate_over_clean"
THRESHOLDS_OVER_CLEAN = (2.0, 5.0, 10.0)
"""Times the clean ATE below which a run counts as a success. Chosen: twice, and an order of magnitude."""


def success_over_clean_name(times: float) -> str:
    """Return the name of the metric of success below so many times the clean error."""
    return f"success_{times:g}x_clean"


def is_success_over_clean(over_clean: float | None, times: float) -> bool:
    """Tell whether a run is a success. over_clean: None for one that failed or is incomplete."""
    return over_clean is not None and over_clean < times


OVER_CLEAN_METRICS: dict[str, Metric] = {
    item.name: item
    for item in (
        Metric(
            OVER_CLEAN,
            "ATE over clean",
            "",
            "lower",
            "ate_rmse_m over that of the same system on the clean frames of the same scene and seed; none for a run "
            f"that failed or is incomplete (tracked less than {LEAST_TRACKED:g} of the frames), or whose clean run is.",
        ),
        *(
            Metric(
                success_over_clean_name(times),
                f"success at {times:g} \u00d7 clean",
                "",
                "higher",
                f"1 where {OVER_CLEAN} is below {times:g}; 0 for a run that failed or is incomplete (tracked less than "
                f"{LEAST_TRACKED:g} of the frames).",
            )
            for times in THRESHOLDS_OVER_CLEAN
        ),
    )
}
"""What is said of a run beside the clean ones of its study, by column."""
