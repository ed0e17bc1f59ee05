# SPDX-License-Identifier: GPL-3.0-or-later
"""What the runs of systems say together: from the tables of runs and of sequences to named tables with captions."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.dependencies import need
from ..dataset.loader import OpenedSequence
from .cases import CLEAN
from .indicators import AGAINST_CLEAN, IMAGES, MOTION, motion_of
from .intervals import bootstrap_interval, mean_interval
from .metrics import IS_INCOMPLETE
from .prediction import indicator_correlations, perturbation_correlations, prediction_tables, system_correlations
from .run_tables import (
    LEFT_OUT,
    SCORES,
    SETTING,
    groups,
    headline_of,
    measures_of,
    over_clean_table,
    table_of,
    tidy_runs,
    tidy_sequences,
)
from .spread import against_clean_table, curve_table, difference_table, grouped_table, spread_table, variance_table

if TYPE_CHECKING:
    from pandas import DataFrame, Series


DEPTH = ("depth_missing", "depth_median_m", "depth_noise_m", "depth_error_m")
PICTURES = tuple(name for name in (*IMAGES, *AGAINST_CLEAN) if name not in DEPTH)
COLUMNS = [
    *SETTING,
    "indicator",
    "n",
    "n_scenes",
    "mean",
    "low",
    "high",
    "minimum",
    "maximum",
    "low_frames",
    "high_frames",
]

DEPTH_BIN_M = 0.25
FARTHEST_M = 10.0


_INTERVALS = (
    "means of errors are geometric; low and high: 95 % for scenes at large; here_low and here_high: for other seeds in "
    "these scenes"
)

CAPTIONS = {
    "over_clean": "ATE over that of the same system on clean frames of the same scenes and seeds: geometric means of n "
    f"runs. Runs that failed, or are incomplete ({IS_INCOMPLETE}), are in no ratio.",
    "spread": f"Every measure of each system and setting, over scenes, seeds and repeats; {_INTERVALS}. {LEFT_OUT}",
    "variance": "Where the spread of errors comes from: the factor by which another scene, another seed and another "
    "run on the same files change an error (exp of a standard deviation), and its share of the variance. Nested random "
    "effects of the logarithms, by moments; freedom: the degrees that a factor stands on. Without repeats a seed's "
    "factor holds the system's own chance, without seeds a scene's holds theirs; all: over the perturbed settings.",
    "differences": f"Every measure against clean, scene by scene; of errors the ratio to it; {_INTERVALS}.",
    "tests": "Tests against clean, two-sided, Holm's correction over settings. Welch's: of logarithms of errors, "
    "without runs that failed or are incomplete; Wilcoxon's: with them as the worst.",
    "curves": f"Failure curves: measures over severity, clean at 0; {_INTERVALS}.",
    "systems": f"Each system over all perturbed settings, which weigh alike in a scene; {_INTERVALS}.",
    "by_perturbation": f"Each system and perturbation over its severities and modes; {_INTERVALS}.",
    "by_mode": f"Each system and mode over perturbations and severities; {_INTERVALS}.",
    "by_severity": f"Each system and severity over perturbations and modes; {_INTERVALS}.",
    "robustness": "Score over the own clean score (mRR), error over the baseline's (mCE); 95 %, bootstrap of scenes.",
    "perturbation_correlations": "Spearman: ATE under two perturbations, over systems, scenes and severities.",
    "system_correlations": "Spearman: ATE of two systems, over scenes and settings; failed and incomplete runs are "
    "worst.",
    "indicator_correlations": "Pearson: ATE, log10 ATE with what sequences are like; Spearman: failed and incomplete "
    "runs as worst.",
    "prediction": "Predicting runs without success (the outcome is not 1) in scenes that the model was not fitted on; "
    "auc_low, auc_high: 95 % for scenes at large.",
    "prediction_coefficients": "That model, fitted to all scenes: above 0, more of the feature goes with failure.",
    "predictions": "The predicted probability of no success on each sequence, by the model without its scene.",
    "images": "What the images of each setting are like, over its sequences; frames are sampled.",
    "depth": "What the depth of each setting is like, over its sequences; frames are sampled.",
    "motion": "How fast the camera moves and turns in each setting, from the true poses.",
}
"""One line for each table of analyse, in the order in which they are shown."""


def analyse(runs: "DataFrame", sequences: "DataFrame") -> dict[str, "DataFrame"]:
    """Return every table of CAPTIONS from the tables of runs and of sequences (tables/runs.csv, tables/sequences.csv).

    The same tables give the same results, whatever their rows' order. Cells without a value are NaN; a table that
    nothing can be said in has columns and no rows. Raises MissingDependencyError without the extra evaluate.
    """
    need(["scipy", "pandas"], "evaluate")
    table, about = tidy_runs(runs), tidy_sequences(sequences)
    headline, measures = headline_of(table), measures_of(table)
    folds, coefficients, predicted = prediction_tables(table, about)
    found = {
        "over_clean": over_clean_table(table, ["system", *SETTING]),
        "spread": spread_table(table, measures),
        "variance": variance_table(table),
        "differences": difference_table(table, measures),
        "tests": against_clean_table(table, headline),
        "curves": curve_table(table, headline),
        "systems": grouped_table(table, headline, []),
        "by_perturbation": grouped_table(table, headline, ["perturbation"]),
        "by_mode": grouped_table(table, headline, ["mode"]),
        "by_severity": grouped_table(table, headline, ["severity"]),
        "robustness": robustness_table(table),
        "perturbation_correlations": perturbation_correlations(table),
        "system_correlations": system_correlations(table),
        "indicator_correlations": indicator_correlations(table, about),
        "prediction": folds,
        "prediction_coefficients": coefficients,
        "predictions": predicted,
        **sequences_tables(about),
    }
    return {name: found[name] for name in CAPTIONS}


def sequences_tables(sequences: "DataFrame") -> dict[str, "DataFrame"]:
    """Return the tables images, depth and motion: each indicator of each setting, over its sequences.

    mean, low, high: of the scenes' means, with the interval over scenes at large; minimum, maximum: of the sequences'
    means; low_frames, high_frames: means of the sequences' 5 % and 95 % quantiles of frames.
    """
    parts = {"images": PICTURES, "depth": DEPTH, "motion": MOTION}
    rows: dict[str, list[dict[str, Any]]] = {part: [] for part in parts}
    for key, group in groups(sequences, SETTING):
        for part, names in parts.items():
            named = dict(zip(SETTING, key, strict=True))
            rows[part] += [named | _of_indicator(group, name) for name in names if f"{name}_mean" in group]
    return {part: table_of([row for row in rows[part] if row["n"]], COLUMNS) for part in parts}


def _of_indicator(sequences: "DataFrame", name: str) -> dict[str, Any]:
    known = sequences[np.isfinite(sequences[f"{name}_mean"])]
    values = known[f"{name}_mean"]
    of_scenes = values.groupby([known["scene"], known["seed"]]).mean().groupby(level="scene").mean()
    row = {"indicator": name, "n": len(known), "n_scenes": len(of_scenes), "mean": of_scenes.mean()}
    row |= {**mean_interval(of_scenes)._asdict(), "minimum": values.min(), "maximum": values.max()}
    for end in ("low", "high"):
        row[f"{end}_frames"] = known[f"{name}_{end}"].mean() if f"{name}_{end}" in known else float("nan")
    return row


def depth_distribution(sequence: OpenedSequence, *, every: int = 10) -> "DataFrame":
    """Return how a sequence's depth is distributed: the share of the pixels that have depth in each bin, and how many.

    Bins of 25 cm up to 10 m; the last is what lies beyond, its to_m infinite. Columns: from_m, to_m, share, pixels.
    every: of the frames. The share of pixels without depth is the indicator depth_missing. Raises ValueError for every
    < 1.
    """
    from pandas import DataFrame

    if every < 1:
        raise ValueError(f"every is 1 or more, not {every}")
    edges = np.append(np.arange(0.0, FARTHEST_M + DEPTH_BIN_M / 2.0, DEPTH_BIN_M), np.inf)
    counts = np.zeros(len(edges) - 1, dtype=np.int64)
    for frame in list(sequence)[::every]:
        depth_m = frame.depth_m
        places = (depth_m[depth_m > 0.0] / DEPTH_BIN_M).astype(np.int64)
        counts += np.bincount(np.minimum(places, len(counts) - 1), minlength=len(counts))
    shares = counts / counts.sum() if counts.sum() else np.full(len(counts), np.nan)
    return DataFrame({"from_m": edges[:-1], "to_m": edges[1:], "share": shares, "pixels": counts})


def motion_distribution(sequence: OpenedSequence) -> "DataFrame":
    """Return quantiles of a sequence's motion over its frames: columns quantile and those of motion_of."""
    from pandas import DataFrame

    frames = list(sequence)
    columns = motion_of(np.stack([frame.c2w for frame in frames]), [frame.stamp_s for frame in frames])
    quantiles = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
    found: dict[str, Any] = {"quantile": quantiles}
    for name, values in columns.items():
        known = values[np.isfinite(values)]
        found[name] = np.quantile(known, quantiles) if known.size else np.full(len(quantiles), np.nan)
    return DataFrame(found)


# --- robustness ---
#
# Kong et al., "Robo3D: Towards robust and reliable 3D perception against corruptions", ICCV 2023, with the corruption
# error after Hendrycks and Dietterich, ICLR 2019. Scores go from 0 (worst) to 1, such as `success_auc`; an error is
# 1 - score there.

Float64: TypeAlias = NDArray[np.float64]
Row: TypeAlias = dict[str, Any]

BASELINE = "rgbd_odometry"
ALL = "all"
ROBUSTNESS = [
    *("system", "score", "perturbation", "n_perturbations", "n_scenes", "n_cells"),
    *("mrr", "mrr_low", "mrr_high", "baseline", "mce", "mce_low", "mce_high"),
]


def robustness_table(runs: "DataFrame") -> "DataFrame":
    """Return mRR and mCE of each system and score: over all perturbations, and the rate of each one.

    The scores of a cell (scene and setting) are the mean of its runs. mRR compares with the system's own clean cells in
    the same scenes, mCE with the baseline's errors (1 - score) in the cells that both have: rgbd_odometry, or the first
    system by name where it was not run. The baseline has none, as it would be compared with itself.
    """
    rows: list[Row] = []
    systems = sorted(set(runs["system"]))
    baseline = BASELINE if BASELINE in systems else next(iter(systems), "")
    for score in (name for name in SCORES if name in runs):
        known = runs[runs[score].notna()]
        cells = known.groupby(["system", "perturbation", "scene", "setting"])[score].mean()
        for system in systems:
            against = baseline if system != baseline else ""
            own, theirs = (
                cells[cells.index.get_level_values("system") == name].droplevel("system") for name in (system, against)
            )
            rows += _of_system(own, theirs, (system, score, against))
    return table_of(rows, ROBUSTNESS)


def _of_system(own: "Series", theirs: "Series", names: tuple[str, str, str]) -> list[Row]:
    """Return a row for all perturbations, and for each. own, theirs: scores by perturbation, scene and setting."""
    is_clean = own.index.get_level_values("perturbation") == CLEAN
    perturbed, clean = own[~is_clean], own[is_clean].groupby(level="scene").mean()
    rows: dict[str, Row] = {}
    every = perturbed.index.to_frame(index=False)
    for name in (ALL, *sorted(set(every["perturbation"]))):
        there = every if name == ALL else every[every["perturbation"] == name]
        counts = {f"n_{of}s": there[of].nunique() for of in ("perturbation", "scene")} | {"n_cells": len(there)}
        named = dict(zip(("system", "score", "baseline"), names, strict=True))
        rows[name] = {**named, "perturbation": name, **counts}
    held = perturbed[perturbed.index.get_level_values("scene").isin(clean.index)]
    _fill(rows, "mrr", held, names[:2], lambda taken, sums: _resilience(taken, sums, held, clean))
    both = perturbed[perturbed.index.isin(theirs.index)]
    below = _sums(1.0 - theirs.reindex(both.index))
    _fill(rows, "mce", 1.0 - both, names[:2], lambda taken, sums: _ratio(taken @ sums, taken @ below))
    return list(rows.values())


def _resilience(taken: Float64, sums: Float64, scores: "Series", clean: "Series") -> Float64:
    """(B, S), (S, P) -> (B, P): for each perturbation the mean of its scores over the mean clean one."""
    scenes = sorted(set(scores.index.get_level_values("scene")))
    of_clean = (taken @ clean.reindex(scenes).to_numpy() / taken.sum(axis=1))[:, None]
    return _ratio(_ratio(taken @ sums, taken @ _sums(scores.notna().astype(float))), of_clean)


def _sums(cells: "Series") -> Float64:
    """Return (S, P): the sum over the settings of each scene and perturbation, both in order."""
    return cells.groupby(level=["scene", "perturbation"]).sum().unstack("perturbation").fillna(0.0).to_numpy()


def _fill(
    rows: dict[str, Row],
    column: str,
    cells: "Series",
    names: tuple[str, str],
    rates: Callable[[Float64, Float64], Float64],
) -> None:
    """Write a rate with its interval into the row of all perturbations and into each one's.

    rates: (B, S) how often each scene is taken, and (S, P) sums -> (B, P) the rate of each perturbation.
    """
    if cells.empty:
        return
    sums, scenes = _sums(cells), cells.index.get_level_values("scene").nunique()
    perturbations = sorted(set(cells.index.get_level_values("perturbation")))
    once = rates(np.ones((1, scenes)), sums)[0]
    kept = np.flatnonzero(np.isfinite(once))
    parts = {perturbations[place]: np.array([place]) for place in kept}
    for name, places in {ALL: kept, **parts}.items() if len(kept) else ():
        interval = bootstrap_interval(
            lambda taken, at=places: rates(taken, sums)[:, at].mean(axis=1), scenes, column, *names, name
        )
        ends = {f"{column}_low": np.maximum(interval.low, 0.0), f"{column}_high": interval.high}
        rows[name] |= {column: float(once[places].mean()), **ends}


def _ratio(above: Float64, below: Float64) -> Float64:
    """Return a quotient; NaN where it would be divided by 0."""
    out = np.full(np.broadcast_shapes(above.shape, below.shape), np.nan)
    return np.divide(above, below, out=out, where=np.broadcast_to(below, out.shape) > 0.0)
