# SPDX-License-Identifier: GPL-3.0-or-later
"""What the runs of systems say together: intervals, tests, correlations, indicators, a prediction of failure."""

from collections.abc import Callable, Container
from statistics import fmean
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.dependencies import need
from ..dataset.loader import OpenedSequence
from .cases import CLEAN
from .indicators import AGAINST_CLEAN, IMAGES, INDICATORS, MOTION, Indicators, indicators_of, motion_of
from .intervals import Interval, bootstrap_interval, mean_interval
from .metrics import IS_INCOMPLETE, Rate, corruption_error, resilience_rate
from .prediction import indicator_correlations, perturbation_correlations, prediction_tables, system_correlations
from .run_tables import (
    LEFT_OUT,
    SCORES,
    SETTING,
    Columns,
    headline_of,
    measures_of,
    over_clean_table,
    table_of,
    tidy_runs,
    tidy_sequences,
)
from .spread import (
    against_clean_table,
    curve_table,
    difference_table,
    grouped_table,
    means_of_scenes,
    spread_table,
    variance_table,
)

if TYPE_CHECKING:
    from pandas import DataFrame


# What the sequences of a dataset are like: images, depth and motion of each setting, and distributions of depth.


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


def sequences_tables(sequences: Columns) -> dict[str, "DataFrame"]:
    """Return the tables images, depth and motion: each indicator of each setting, over its sequences.

    mean, low, high: of the scenes' means, with the interval over scenes at large; minimum, maximum: of the sequences'
    means; low_frames, high_frames: means of the sequences' 5 % and 95 % quantiles of frames.
    """
    parts = {"images": PICTURES, "depth": DEPTH, "motion": MOTION}
    return {
        part: _table(sequences, [name for name in names if f"{name}_mean" in sequences])
        for part, names in parts.items()
    }


def _table(sequences: Columns, names: list[str]) -> "DataFrame":
    rows: list[dict[str, Any]] = []
    for key, group in sequences.groups(SETTING):
        for name in names:
            known = group.where(np.isfinite(group[f"{name}_mean"]))
            values, of_scenes = known[f"{name}_mean"], means_of_scenes(known, f"{name}_mean")
            row: dict[str, Any] = {**dict(zip(SETTING, key, strict=True)), "indicator": name, "n": len(known)}
            if not len(values):
                continue
            row |= {"n_scenes": len(of_scenes), "mean": float(np.mean(of_scenes))}
            row["low"], row["high"] = mean_interval(of_scenes)
            row |= {"minimum": float(values.min()), "maximum": float(values.max())}
            for end in ("low", "high"):
                column = f"{name}_{end}"
                row[f"{end}_frames"] = float(known[column].mean()) if column in known else float("nan")
            rows.append(row)
    return table_of(rows, COLUMNS)


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


# Mean resilience rates and mean corruption errors of systems, with intervals over scenes.


Float64: TypeAlias = NDArray[np.float64]
Row: TypeAlias = dict[str, Any]

BASELINE = "rgbd_odometry"
ALL = "all"
ROBUSTNESS = [
    *("system", "score", "perturbation", "n_perturbations", "n_scenes", "n_cells"),
    *("mrr", "mrr_low", "mrr_high", "baseline", "mce", "mce_low", "mce_high"),
]


class _Cells(NamedTuple):
    """Scores or errors of a system by scene, perturbation and setting: the mean of the runs of each."""

    values: dict[tuple[str, str, str], float]

    @property
    def scenes(self) -> list[str]:
        return sorted({scene for scene, _, _ in self.values})

    @property
    def perturbations(self) -> list[str]:
        return sorted({perturbation for _, perturbation, _ in self.values})

    def among(self, cells: Container[tuple[str, str, str]]) -> "_Cells":
        """Return those whose keys are among others."""
        return _Cells({key: value for key, value in self.values.items() if key in cells})

    def of(self, perturbation: str) -> list[float]:
        """Return the values of a perturbation, in order; of all under ALL."""
        return [value for (_, name, _), value in self.values.items() if perturbation in (name, ALL)]

    def sums(self) -> tuple[Float64, Float64]:
        """Return (S, P) sums over the settings of each scene and perturbation, and how many there are."""
        scenes, names = self.scenes, self.perturbations
        sums, counts = np.zeros((len(scenes), len(names))), np.zeros((len(scenes), len(names)))
        for (scene, name, _), value in self.values.items():
            place = scenes.index(scene), names.index(name)
            sums[place] += value
            counts[place] += 1.0
        return sums, counts


def robustness_table(runs: Columns) -> "DataFrame":
    """Return mRR and mCE of each system and score: over all perturbations, and the rate of each one.

    The scores of a cell (scene and setting) are the mean of its runs. mRR compares with the system's own clean cells in
    the same scenes, mCE with the baseline's errors (1 - score) in the cells that both have: rgbd_odometry, or the first
    system by name where it was not run. The baseline has none, as it would be compared with itself.
    """
    rows: list[Row] = []
    systems = sorted(set(runs["system"]))
    baseline = BASELINE if BASELINE in systems else next(iter(systems), "")
    for score in (name for name in SCORES if name in runs):
        cells = {system: _cells_of(runs.where(runs["system"] == system), score) for system in systems}
        for system in systems:
            against = baseline if system != baseline else ""
            rows += _of_system(cells[system], cells.get(against, _Cells({})), (system, score, against))
    return table_of(rows, ROBUSTNESS)


def _cells_of(runs: Columns, score: str) -> _Cells:
    found: dict[tuple[str, str, str], float] = {}
    for key, cell in runs.where(np.isfinite(runs[score])).groups(["scene", "perturbation", "setting"]):
        found[(str(key[0]), str(key[1]), str(key[2]))] = float(np.mean(cell[score]))
    return _Cells(found)


def _of_system(own: _Cells, theirs: _Cells, names: tuple[str, str, str]) -> list[Row]:
    system, score, baseline = names
    perturbed = own.among({key for key in own.values if key[1] != CLEAN})
    clean = {
        scene: fmean(value for key, value in own.values.items() if key[:2] == (scene, CLEAN))
        for scene in sorted({key[0] for key in own.values if key[1] == CLEAN})
    }
    rows: dict[str, Row] = {}
    for name in (ALL, *perturbed.perturbations):
        there = [key for key in perturbed.values if name in (key[1], ALL)]
        counts = {"n_scenes": len({key[0] for key in there}), "n_cells": len(there)}
        counts["n_perturbations"] = len({key[1] for key in there})
        row: Row = {"system": system, "score": score, "perturbation": name, "baseline": baseline, **counts}
        rows[name] = row | dict.fromkeys(("mrr", "mrr_low", "mrr_high", "mce", "mce_low", "mce_high"), float("nan"))
    _add_resilience(rows, perturbed.among({key for key in perturbed.values if key[0] in clean}), clean, names[:2])
    both = perturbed.among(theirs.values)
    _add_corruption(rows, both, theirs.among(both.values), names[:2])
    return list(rows.values())


def _add_resilience(rows: dict[str, Row], perturbed: _Cells, clean: dict[str, float], names: tuple[str, str]) -> None:
    if not perturbed.values:
        return
    own_clean = np.array([clean[scene] for scene in perturbed.scenes])
    given = {name: perturbed.of(name) for name in perturbed.perturbations}
    sums, counts = perturbed.sums()

    def rates(taken: Float64) -> Float64:
        of_clean = (taken @ own_clean / taken.sum(axis=1))[:, None]
        return _ratio(_ratio(taken @ sums, taken @ counts), of_clean)

    rate = resilience_rate(given, float(np.mean(own_clean)))
    _fill(rows, "mrr", _Rates(rate, perturbed, rates), names)


def _add_corruption(rows: dict[str, Row], scores: _Cells, baseline: _Cells, names: tuple[str, str]) -> None:
    if not scores.values:
        return
    mine = _Cells({key: 1.0 - value for key, value in scores.values.items()})
    theirs = _Cells({key: 1.0 - value for key, value in baseline.values.items()})
    rate = corruption_error(
        {name: mine.of(name) for name in mine.perturbations}, {name: theirs.of(name) for name in theirs.perturbations}
    )
    above, below = mine.sums()[0], theirs.sums()[0]
    _fill(rows, "mce", _Rates(rate, mine, lambda taken: _ratio(taken @ above, taken @ below)), names)


class _Rates(NamedTuple):
    """rate: of all scenes. resampled: (B, S) how often each scene is taken -> (B, P) the rate of each perturbation."""

    rate: Rate
    cells: _Cells
    resampled: Callable[[Float64], Float64]


def _fill(rows: dict[str, Row], column: str, rates: _Rates, names: tuple[str, str]) -> None:
    """Write a rate with its interval into the row of all perturbations and into each one's."""
    rate, scenes = rates.rate, len(rates.cells.scenes)
    kept = [rates.cells.perturbations.index(name) for name in rate.by_perturbation]
    if rate.value is None:
        return
    mean = bootstrap_interval(lambda taken: rates.resampled(taken)[:, kept].mean(axis=1), scenes, column, *names, ALL)
    _write(rows[ALL], column, rate.value, mean)
    for name, place in zip(rate.by_perturbation, kept, strict=True):
        one = bootstrap_interval(lambda taken, at=place: rates.resampled(taken)[:, at], scenes, column, *names, name)
        _write(rows[name], column, rate.by_perturbation[name], one)


def _write(row: Row, column: str, value: float, interval: Interval) -> None:
    row |= {column: value, f"{column}_low": float(np.maximum(interval.low, 0.0)), f"{column}_high": interval.high}


def _ratio(above: Float64, below: Float64) -> Float64:
    """Return a quotient; NaN where it would be divided by 0."""
    out = np.full(np.broadcast_shapes(above.shape, below.shape), np.nan)
    return np.divide(above, below, out=out, where=np.broadcast_to(below, out.shape) > 0.0)


# All analyses at once: from the tables of runs and of sequences to named tables with captions.


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


__all__ = [
    "CAPTIONS",
    "INDICATORS",
    "Indicators",
    "analyse",
    "depth_distribution",
    "indicators_of",
    "motion_distribution",
]
