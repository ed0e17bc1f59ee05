# SPDX-License-Identifier: GPL-3.0-or-later
"""How results spread over scenes, seeds and repeats: means with intervals, and differences to clean, scene by scene.

Errors are averaged on the scale of logarithms: their means are geometric, and compared by ratios. All else is averaged
as it is.
"""

from math import isfinite
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..study.cases import CLEAN
from .columns import Columns, table_of
from .intervals import (
    Interval,
    clipped,
    difference_here_interval,
    exponential,
    here_interval,
    mean_interval,
    mean_p,
    share_interval,
)
from .log_scale import log_errors
from .run_table import FAILED, INCOMPLETE, SETTING, is_averaged_in_logs, is_error, is_score, is_share
from .significance import holm

if TYPE_CHECKING:
    from pandas import DataFrame

Float64: TypeAlias = NDArray[np.float64]
Row: TypeAlias = dict[str, Any]
Cells: TypeAlias = dict[str, dict[int, list[float]]]
"""Values by scene and seed, one for each repeat; of errors their logarithms."""

GEOMETRIC, ARITHMETIC = "geometric", "arithmetic"
COUNTS = ["n_runs", "n_failed", "n_incomplete", "n", "n_scenes"]
MEAN = ["average", "mean", "low", "high", "here_low", "here_high"]
SPREAD = [*COUNTS, *MEAN, "median", "minimum", "maximum", "standard_deviation"]
DIFFERENCE = [
    *("n", "n_scenes", "average", "mean", "clean_mean", "difference", "low", "high", "here_low", "here_high"),
    *("ratio", "ratio_low", "ratio_high", "p", "p_holm"),
]


def spread_of(runs: Columns, measure: str) -> Row:
    """Return how a measure spreads over runs, the columns SPREAD.

    mean: of the scenes' means, so that scenes weigh alike; average: which kind; low, high: its interval over scenes at
    large; here_*: over other seeds (or repeats, where there is one seed) in these scenes. The others are over all runs
    that have a value; the standard deviation of an error is the factor by which it spreads.
    """
    values = runs[measure][np.isfinite(runs[measure])]
    row: Row = dict.fromkeys(SPREAD, float("nan"))
    cells = cells_of(runs, measure)
    row |= {"n_runs": len(runs), "n": len(values), "n_scenes": len(cells), "average": average_of(measure)}
    row |= {f"n_{name}": int(runs[name].sum()) for name in (FAILED, INCOMPLETE)}
    if not len(values):
        return row
    row |= means_with_intervals(cells, measure)
    row |= {"median": float(np.median(values)), "minimum": float(values.min()), "maximum": float(values.max())}
    if len(values) > 1:
        in_logs = is_averaged_in_logs(measure)
        deviation = float(np.std(log_errors(values) if in_logs else values, ddof=1))
        row["standard_deviation"] = float(np.exp(deviation)) if in_logs else deviation
    return row


def average_of(measure: str) -> str:
    """Return which mean is taken of a measure."""
    return GEOMETRIC if is_averaged_in_logs(measure) else ARITHMETIC


def means_with_intervals(cells: Cells, measure: str) -> Row:
    """Return the mean over scenes with both of its intervals, the columns MEAN."""
    units = units_of(cells)
    of_scenes = _means(units)
    mean, here = float(np.mean(of_scenes)), here_interval(units)
    if is_averaged_in_logs(measure):
        (low, high), (here_low, here_high) = exponential(mean_interval(of_scenes)), exponential(here)
        mean = float(np.exp(mean))
    else:
        runs = sum(len(values) for seeds in cells.values() for values in seeds.values())
        (low, high), (here_low, here_high) = _interval(of_scenes, runs, measure), _possible(here, measure)
    row = {"average": average_of(measure), "mean": mean, "low": low, "high": high}
    return row | {"here_low": here_low, "here_high": here_high}


def difference_of(runs: Columns, clean: Columns, measure: str) -> Row:
    """Return how a measure differs from clean in the same scenes, the columns DIFFERENCE.

    Of an error, the ratio of the geometric means, if no clean one is 0, which here_* then are of; of all else the
    difference. Scenes without a
    value on one side are left out. n: values of these runs. p: of no difference over scenes at large, whose interval
    low, high or ratio_low, ratio_high is; p_holm is left to `difference_table`.
    """
    row: Row = dict.fromkeys(DIFFERENCE, float("nan"))
    mine, theirs = cells_of(runs, measure), cells_of(clean, measure)
    scenes = [scene for scene in mine if scene in theirs]
    row |= {"n": sum(len(values) for scene in scenes for values in mine[scene].values()), "n_scenes": len(scenes)}
    row["average"] = average_of(measure)
    if not scenes:
        return row
    ours, others = (units_of({scene: cells[scene] for scene in scenes}) for cells in (mine, theirs))
    means, clean_means = _means(ours), _means(others)
    row |= {"mean": float(np.mean(means)), "clean_mean": float(np.mean(clean_means))}
    difference = row["mean"] - row["clean_mean"]
    ends, here = mean_interval(means - clean_means), difference_here_interval(ours, others)
    row["p"] = mean_p(means - clean_means)
    if not is_averaged_in_logs(measure):
        row |= {"difference": difference, "low": ends.low, "high": ends.high}
        return row | dict(zip(("here_low", "here_high"), here, strict=True))
    row |= {name: float(np.exp(row[name])) for name in ("mean", "clean_mean")}
    if (clean[measure] == 0.0).any():
        return row | {"p": float("nan")}
    row["ratio"] = float(np.exp(difference))
    row["ratio_low"], row["ratio_high"] = exponential(ends)
    row["here_low"], row["here_high"] = exponential(here)
    return row


def cells_of(runs: Columns, measure: str) -> Cells:
    """Return the values of a measure by scene and seed, both in order; runs without one are left out."""
    found: Cells = {}
    values = log_errors(runs[measure]) if is_averaged_in_logs(measure) else runs[measure]
    rows = zip(runs.rows(("scene", "seed")), values.tolist(), strict=True)
    for (scene, seed), value in sorted(rows, key=lambda row: row[0]):
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
    """Return how each setting differs from clean, for each system and measure, scene by scene.

    p_holm: Holm's correction of p over the settings of one system and measure.
    """
    keys = ["system", *SETTING]
    rows = []
    for (system,), of_system in runs.groups(["system"]):
        is_clean = of_system["perturbation"] == CLEAN
        reference = of_system.where(is_clean)
        of_settings: list[Row] = []
        for key, group in of_system.where(~is_clean).groups(SETTING):
            shared = {"system": system, **dict(zip(SETTING, key, strict=True))}
            of_settings += [{**shared, "measure": name, **difference_of(group, reference, name)} for name in measures]
        for name in measures:
            family = [row for row in of_settings if row["measure"] == name]
            for row, corrected in zip(family, holm([row["p"] for row in family]), strict=True):
                row["p_holm"] = float(corrected)
        rows += of_settings
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
