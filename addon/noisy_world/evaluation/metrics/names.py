# SPDX-License-Identifier: GPL-3.0-or-later
"""Every metric of a trajectory by its name: what it says, in which unit, and which way is better."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from .success import BAD_POSE_M, LARGEST_ATE_M, LARGEST_RPE_DEG, LARGEST_RPE_M, LEAST_TRACKED, THRESHOLDS_M

Better: TypeAlias = Literal["lower", "higher", ""]


@dataclass(frozen=True)
class Metric:
    """A number that is said of a run. unit: "" where it has none. better: "" where neither way is.

    label: a heading. meaning: a sentence or two, with formula and source where they are not plain.
    """

    name: str
    label: str
    unit: str
    better: Better
    meaning: str


_STATISTICS = {
    "rmse": ("RMSE", "the root of the mean square"),
    "mean": ("mean", "the mean"),
    "median": ("median", "the median"),
    "max": ("max", "the largest"),
    "std": ("std", "the standard deviation"),
}
_DELTAS = {
    "1frame": ("1 frame", "from one frame to the next"),
    "1s": ("1 s", "of one second"),
    "1m": ("1 m", "of one metre of the true path"),
}
_STURM = "Sturm et al., IROS 2012."


def success_name(threshold_m: float) -> str:
    """Return the name of the metric of success below a threshold."""
    return f"success_{threshold_m * 100:g}cm"


def _of_ate() -> list[Metric]:
    found = []
    for key, (label, said) in _STATISTICS.items():
        distance = "the distances between estimated and true positions, after alignment, over the tracked frames"
        source = f" The absolute trajectory error; {_STURM}" if key == "rmse" else ""
        found.append(Metric(f"ate_{key}_m", f"ATE {label}", "m", "lower", f"{said} of {distance}.{source}"))
    for key in ("rmse", "mean", "median", "max"):
        label, said = _STATISTICS[key]
        angle = "the angles between estimated and true rotations, after the alignment of the positions"
        none = (
            " No value where the positions lie in a line, as they do not decide the rotation then."
            if key == "rmse"
            else ""
        )
        found.append(
            Metric(f"ate_rotation_{key}_deg", f"ATE rotation {label}", "deg", "lower", f"{said} of {angle}.{none}")
        )
    return found


def _of_rpe() -> list[Metric]:
    found = []
    for key, (label, said) in _DELTAS.items():
        pairs = f"T^-1 E of true motions T and estimated E {said}, over all pairs of tracked frames"
        found.append(
            Metric(f"rpe_{key}_rmse_m", f"RPE {label}", "m", "lower", f"the RMSE of the lengths of {pairs}. {_STURM}")
        )
        found.append(
            Metric(
                f"rpe_{key}_rmse_deg", f"RPE {label}, rotation", "deg", "lower", f"the RMSE of the angles of {pairs}."
            )
        )
    return found


_COVERAGE = [
    Metric(
        "tracked_share", "tracked frames", "", "higher", "the share of the true frames that have an estimated pose."
    ),
    Metric(
        "path_share",
        "path length",
        "",
        "higher",
        "the length of the aligned estimated path over that of the whole true path: what the paper calls success rate. "
        "Above 1 where the estimate trembles or strays.",
    ),
    Metric(
        "initialisation_s", "initialisation", "s", "lower", "the time from the first frame to the first tracked one."
    ),
    Metric("losses", "losses", "", "lower", "how often tracking was lost after the first tracked frame."),
    Metric(
        "longest_loss_s",
        "longest loss",
        "s",
        "lower",
        "the longest time from a tracked frame to the next, or to the end.",
    ),
    Metric(
        "bad_pose_share",
        "bad poses",
        "",
        "lower",
        f"the share of the frames without a pose, or with one off by {BAD_POSE_M:g} m or more. Li et al., VRIH 2019.",
    ),
    Metric(
        "scale",
        "scale",
        "",
        "",
        "true length over estimated length as Sim(3) alignment finds it; of a system with depth it should be 1.",
    ),
]

_SUCCESS = [
    *(
        Metric(
            success_name(threshold_m),
            f"success at {threshold_m * 100:g} cm",
            "",
            "higher",
            f"1 where ate_rmse_m is below {threshold_m:g} m and {LEAST_TRACKED:g} of the frames or more are tracked.",
        )
        for threshold_m in THRESHOLDS_M
    ),
    Metric(
        "success_auc",
        "success AUC",
        "",
        "higher",
        f"the area under the curve of success over thresholds from 0 to {LARGEST_ATE_M:g} m: 1 - ATE / "
        f"{LARGEST_ATE_M:g} m, 0 for a run that failed or tracked less than {LEAST_TRACKED:g} of the frames. As ETH3D "
        "ranks; Schöps et al., CVPR 2019.",
    ),
    Metric(
        "f1_auc",
        "F1 AUC",
        "",
        "higher",
        "the area under the curve of the F1 score of motions of one second over thresholds of their error from 0 to "
        f"{LARGEST_RPE_M:g} m: precision over the estimate's motions, recall over the truth's, so lost frames count. "
        "Zhao et al., SubT-MRS, CVPR 2024.",
    ),
    Metric(
        "f1_auc_rotation",
        "F1 AUC, rotation",
        "",
        "higher",
        f"the same of their angles, from 0 to {LARGEST_RPE_DEG:g} degrees.",
    ),
]

METRICS: dict[str, Metric] = {item.name: item for item in (*_of_ate(), *_of_rpe(), *_COVERAGE, *_SUCCESS)}
"""What protocol strict gives, in the order in which it is shown."""

PAPER_METRICS: dict[str, Metric] = {
    item.name: item
    for item in (
        Metric("ate_m", "ATE (paper)", "m", "lower", "what the paper prints as ATE; a failed run is 1.0."),
        Metric(
            "rpe_rad",
            "RPE (paper)",
            "rad",
            "lower",
            "what the paper prints as RPE in metres: the RMSE of the rotation errors between consecutive poses, in "
            "radians; a failed run is 1.0.",
        ),
        Metric(
            "sr",
            "SR (paper)",
            "",
            "higher",
            "what the paper prints as success rate: path_share of its poses; 0 for a failed run.",
        ),
    )
}
"""What protocol paper gives; in tables their names begin with `paper.`."""

PAPER_PREFIX = "paper."
