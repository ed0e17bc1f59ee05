# SPDX-License-Identifier: GPL-3.0-or-later
"""How results spread over scenes, seeds and repeats: means with intervals, and differences to clean, scene by scene."""

from math import isfinite
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .columns import Columns, table_of
from .intervals import (
    Interval,
    clipped,
    difference_here_interval,
    geometric_interval,
    here_interval,
    mean_interval,
    share_interval,
)
from .run_table import CLEAN, FAILED, SETTING, is_error, is_score, is_share

if TYPE_CHECKING:
    from pandas import DataFrame

Float64: TypeAlias = NDArray[np.float64]
Row: TypeAlias = dict[str, Any]
Cells: TypeAlias = dict[str, dict[int, list[float]]]  # values by scene and seed, one for each repeat

COUNTS = ["n_runs", "n_failed", "n", "n_scenes"]
SPREAD = [
    *COUNTS,
    *("mean", "low", "high", "here_low", "here_high"),
    *("median", "minimum", "maximum", "standard_deviation"),
    *("geometric_mean", "geometric_low", "geometric_high"),
]
DIFFERENCE = [
    *("n", "n_scenes", "mean", "clean_mean", "difference", "low", "high", "here_low", "here_high"),
    *("ratio", "ratio_low", "ratio_high"),
]


def spread_of(runs: Columns, measure: str) -> Row:
    """Return how a measure spreads over runs, the columns SPREAD.

    mean: of the scenes' means, so that scenes weigh alike; low, high: its interval over scenes at large; here_*: over
    other seeds (or repeats, where there is one seed) in these scenes. The others are over all runs that have a value.
    """
    values = runs[measure][np.isfinite(runs[measure])]
    row: Row = dict.fromkeys(SPREAD, float("nan"))
    cells = cells_of(runs, measure)
    row |= {"n_runs": len(runs), "n_failed": int(runs[FAILED].sum()), "n": len(values), "n_scenes": len(cells)}
    if not len(values):
        return row
    row |= means_with_intervals(cells, measure)
    row |= {"median": float(np.median(values)), "minimum": float(values.min()), "maximum": float(values.max())}
    row["standard_deviation"] = float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")
    if is_error(measure) and bool((values > 0.0).all()):
        logs = _means([np.log(group) for group in units_of(cells)])
        row["geometric_mean"] = float(np.exp(np.mean(logs)))
        row["geometric_low"], row["geometric_high"] = geometric_interval(logs)
    return row


def means_with_intervals(cells: Cells, measure: str) -> Row:
    """Return the mean over scenes with both of its intervals: mean, low, high, here_low, here_high."""
    units = units_of(cells)
    of_scenes = _means(units)
    runs = sum(len(values) for seeds in cells.values() for values in seeds.values())
    low, high = _interval(of_scenes, runs, measure)
    here_low, here_high = _possible(here_interval(units), measure)
    mean = float(np.mean(of_scenes))
    return {"mean": mean, "low": low, "high": high, "here_low": here_low, "here_high": here_high}


def difference_of(runs: Columns, clean: Columns, measure: str) -> Row:
    """Return how a measure differs from clean in the same scenes, the columns DIFFERENCE.

    ratio: of the geometric means, for errors that are positive in all of these runs. Scenes without a value on one side
    are left out. n: values of these runs.
    """
    row: Row = dict.fromkeys(DIFFERENCE, float("nan"))
    mine, theirs = cells_of(runs, measure), cells_of(clean, measure)
    scenes = [scene for scene in mine if scene in theirs]
    row |= {"n": sum(len(values) for scene in scenes for values in mine[scene].values()), "n_scenes": len(scenes)}
    if not scenes:
        return row
    ours, others = (units_of({scene: cells[scene] for scene in scenes}) for cells in (mine, theirs))
    means, clean_means = _means(ours), _means(others)
    row |= {"mean": float(np.mean(means)), "clean_mean": float(np.mean(clean_means))}
    row["difference"] = row["mean"] - row["clean_mean"]
    row["low"], row["high"] = mean_interval(means - clean_means)
    row["here_low"], row["here_high"] = difference_here_interval(ours, others)
    if is_error(measure) and all((group > 0.0).all() for group in (*ours, *others)):
        logs = _means([np.log(group) for group in ours]) - _means([np.log(group) for group in others])
        row["ratio"] = float(np.exp(np.mean(logs)))
        row["ratio_low"], row["ratio_high"] = geometric_interval(logs)
    return row


def cells_of(runs: Columns, measure: str) -> Cells:
    """Return the values of a measure by scene and seed, both in order; runs without one are left out."""
    found: Cells = {}
    for scene, seed, value in sorted(runs.rows(("scene", "seed", measure)), key=lambda row: row[:2]):
        if isfinite(value):
            found.setdefault(scene, {}).setdefault(seed, []).append(value)
    return found


def units_of(cells: Cells) -> list[Float64]:
    """Return for each scene what is independent there: a mean of each seed, or where there is one seed, its repeats."""
    return [
        np.array([sum(values) / len(values) for values in seeds.values()])
        if len(seeds) > 1
        else np.array(next(iter(seeds.values())))
        for seeds in cells.values()
    ]


def means_of_scenes(table: Columns, measure: str) -> Float64:
    """Return the mean of each scene: of its seeds' means."""
    return _means(units_of(cells_of(table, measure)))


def spread_table(runs: Columns, measures: list[str]) -> "DataFrame":
    """Return the spread of each measure for each system and setting."""
    keys = ["system", *SETTING]
    rows = [
        {**dict(zip(keys, key, strict=True)), "measure": measure, **spread_of(group, measure)}
        for key, group in runs.groups(keys)
        for measure in measures
    ]
    return table_of(rows, [*keys, "measure", *SPREAD])


def difference_table(runs: Columns, measures: list[str]) -> "DataFrame":
    """Return how each setting differs from clean, for each system and measure, scene by scene."""
    keys = ["system", *SETTING]
    rows = []
    for (system,), of_system in runs.groups(["system"]):
        is_clean = of_system["perturbation"] == CLEAN
        reference = of_system.where(is_clean)
        for key, group in of_system.where(~is_clean).groups(SETTING):
            shared = {"system": system, **dict(zip(SETTING, key, strict=True))}
            rows += [{**shared, "measure": name, **difference_of(group, reference, name)} for name in measures]
    return table_of(rows, [*keys, "measure", *DIFFERENCE])


def _means(groups: list[Float64]) -> Float64:
    return np.array([np.mean(group) for group in groups])


def _interval(of_scenes: Float64, runs: int, measure: str) -> Interval:
    if is_score(measure):
        return share_interval(of_scenes, runs if is_share(measure) else np.inf)
    return _possible(mean_interval(of_scenes), measure)


def _possible(interval: Interval, measure: str) -> Interval:
    if is_score(measure):
        return clipped(interval)
    return clipped(interval, 0.0, np.inf) if is_error(measure) else interval
