# SPDX-License-Identifier: GPL-3.0-or-later
"""Every metric of a trajectory by its name, ours and those of installed packages, and how each is computed."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import NoisyWorldError
from ...core.installed import Door, Registry
from .alignment import CONDITIONING, DECIDED, WELL_CONDITIONED
from .compared import Compared, Delta
from .errors import consecutive_pairs, relative_errors, spread_of
from .metric import Compute, Metric, TrajectoryMetric
from .protocols import Protocol
from .success import (
    BAD_POSE_M,
    LARGEST_ATE_M,
    LARGEST_RPE_DEG,
    LARGEST_RPE_M,
    LEAST_TRACKED,
    THRESHOLDS_M,
    Losses,
    bad_pose_share,
    f1_auc,
    is_success,
    losses_of,
    success_auc,
)

_STATISTICS = {
    "rmse": ("RMSE", "the root of the mean square"),
    "mean": ("mean", "the mean"),
    "median": ("median", "the median"),
    "max": ("max", "the largest"),
    "std": ("std", "the standard deviation"),
}
_DELTAS: dict[Delta, tuple[str, str]] = {
    "1frame": ("1 frame", "from one frame to the next"),
    "1s": ("1 s", "of one second"),
    "1m": ("1 m", "of one metre of the true path"),
}
_STURM = "Sturm et al., IROS 2012."


def success_name(threshold_m: float) -> str:
    """Return the name of the metric of success below a threshold."""
    return f"success_{threshold_m * 100:g}cm"


def _of_ate() -> list[TrajectoryMetric]:
    found = []
    for key, (label, said) in _STATISTICS.items():
        distance = "the distances between estimated and true positions, after alignment, over the tracked frames"
        source = f" The absolute trajectory error; {_STURM}" if key == "rmse" else ""
        found.append(
            TrajectoryMetric(
                f"ate_{key}_m",
                f"ATE {label}",
                "m",
                "lower",
                f"{said} of {distance}.{source}",
                lambda compared, key=key: getattr(compared.position, key),
            )
        )
    for key in ("rmse", "mean", "median", "max"):
        label, said = _STATISTICS[key]
        angle = "the angles between estimated and true rotations, after alignment"
        line = (
            f" Where conditioning is below {DECIDED:g}, positions alone do not decide the turn, and full poses do."
            if key == "rmse"
            else ""
        )
        found.append(
            TrajectoryMetric(
                f"ate_rotation_{key}_deg",
                f"ATE rotation {label}",
                "deg",
                "lower",
                f"{said} of {angle}.{line}",
                lambda compared, key=key: getattr(compared.rotation, key),
            )
        )
    return found


def _of_rpe() -> list[TrajectoryMetric]:
    found = []
    for key, (label, said) in _DELTAS.items():
        pairs = f"T^-1 E of true motions T and estimated E {said}, over all pairs of tracked frames"
        found.append(
            TrajectoryMetric(
                f"rpe_{key}_rmse_m",
                f"RPE {label}",
                "m",
                "lower",
                f"the RMSE of the lengths of {pairs}. {_STURM}",
                lambda compared, key=key: _rmse(compared.motions[key].errors_m),
            )
        )
        found.append(
            TrajectoryMetric(
                f"rpe_{key}_rmse_deg",
                f"RPE {label}, rotation",
                "deg",
                "lower",
                f"the RMSE of the angles of {pairs}.",
                lambda compared, key=key: _rmse(compared.motions[key].errors_deg),
            )
        )
    return found


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
    ),
    TrajectoryMetric(
        "longest_loss_s",
        "longest loss",
        "s",
        "lower",
        "the longest time from a tracked frame to the next, or to the end.",
        lambda compared: _losses(compared).longest_s,
        of_failed=True,
    ),
    TrajectoryMetric(
        "bad_pose_share",
        "bad poses",
        "",
        "lower",
        f"the share of the frames without a pose, or with one off by {BAD_POSE_M:g} m or more. Li et al., VRIH 2019.",
        _scored(lambda compared: bad_pose_share(compared.position_errors_m, len(compared.truth))),
        of_failed=True,
    ),
    TrajectoryMetric(
        "scale",
        "scale",
        "",
        "",
        "true length over estimated length as Sim(3) alignment finds it; of a system with depth it should be 1.",
        lambda compared: None if compared.still or not compared.by else compared.by.scale * compared.remaining_scale,
    ),
    TrajectoryMetric(
        CONDITIONING,
        "conditioning",
        "",
        "",
        "the second extent of the true path, the standard deviation of its positions along its second principal axis, "
        f"over ate_rmse_m. Below {WELL_CONDITIONED:g} positions hardly say how the path is turned about itself.",
        lambda compared: compared.conditioning.ratio if compared.conditioning else None,
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
    ),
]

DOOR = Door("noisy_world.metrics", "metric", "METRIC", (TrajectoryMetric,))

METRICS = Registry(DOOR, lambda: (*_of_ate(), *_of_rpe(), *_COVERAGE, *_SUCCESS))
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
