# SPDX-License-Identifier: GPL-3.0-or-later
"""How results spread over scenes, seeds and repeats: means with intervals, and differences to clean, scene by scene."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .intervals import (
    Interval,
    clipped,
    difference_here_interval,
    geometric_interval,
    here_interval,
    mean_interval,
    share_interval,
)
from .run_table import CLEAN, FAILED, SETTING, is_error, is_score, is_share, log_of

if TYPE_CHECKING:
    from pandas import DataFrame

type Float64 = NDArray[np.float64]
type Row = dict[str, Any]

COUNTS = ["n_runs", "n_failed", "n", "n_scenes"]
SPREAD = [
    *COUNTS,
    *("mean", "low", "high", "here_low", "here_high"),
    *("median", "minimum", "maximum", "standard_deviation"),
    *("geometric_mean", "geometric_low", "geometric_high"),
]
DIFFERENCE = [
    *("n_scenes", "mean", "clean_mean", "difference", "low", "high", "here_low", "here_high"),
    *("ratio", "ratio_low", "ratio_high"),
]


def spread_of(runs: "DataFrame", measure: str) -> Row:
    """Return how a measure spreads over runs, the columns SPREAD.

    mean: of the scenes' means, so that scenes weigh alike; low, high: its interval over scenes at large; here_*: over
    other seeds (or repeats, where there is one seed) in these scenes. The others are over all runs that have a value.
    """
    known = runs[runs[measure].notna()]
    values = known[measure].to_numpy()
    row: Row = dict.fromkeys(SPREAD, float("nan"))
    row |= {"n_runs": len(runs), "n_failed": int(runs[FAILED].sum()), "n": len(known)}
    row["n_scenes"] = int(known["scene"].nunique())
    if not len(values):
        return row
    groups = units_of_scenes(known, measure)
    of_scenes = np.array([np.mean(group) for group in groups.values()])
    runs_of_scenes = known.groupby("scene")[measure].size().to_numpy()
    row["mean"] = float(np.mean(of_scenes))
    row["low"], row["high"] = _interval(of_scenes, runs_of_scenes, measure)
    row["here_low"], row["here_high"] = _possible(here_interval(list(groups.values())), measure)
    row |= {"median": float(np.median(values)), "minimum": float(values.min()), "maximum": float(values.max())}
    row["standard_deviation"] = float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")
    if is_error(measure) and bool((values > 0.0).all()):
        logs = np.array([np.mean(group) for group in units_of_scenes(known, measure, logs=True).values()])
        row["geometric_mean"] = float(np.exp(np.mean(logs)))
        row["geometric_low"], row["geometric_high"] = geometric_interval(logs)
    return row


def difference_of(runs: "DataFrame", clean: "DataFrame", measure: str) -> Row:
    """Return how a measure differs from clean in the same scenes, the columns DIFFERENCE.

    ratio: of the geometric means, for errors that are positive in all of these runs. Scenes without a value on one side
    are left out.
    """
    row: Row = dict.fromkeys(DIFFERENCE, float("nan"))
    mine, theirs = units_of_scenes(runs, measure), units_of_scenes(clean, measure)
    scenes = [scene for scene in mine if scene in theirs]
    row["n_scenes"] = len(scenes)
    if not scenes:
        return row
    ours, others = [mine[scene] for scene in scenes], [theirs[scene] for scene in scenes]
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


def units_of_scenes(runs: "DataFrame", measure: str, *, logs: bool = False) -> dict[str, Float64]:
    """Return for each scene what is independent there: a mean of each seed, or where there is one seed, its repeats."""
    known = runs[runs[measure].notna()]
    found: dict[str, Float64] = {}
    for scene, of_scene in known.groupby("scene", sort=True):
        values = of_scene[measure].to_numpy(dtype=np.float64)
        values = log_of(values) if logs else values
        seeds, which = np.unique(of_scene["seed"].to_numpy(), return_inverse=True)
        if len(seeds) > 1:
            values = np.bincount(which, weights=values) / np.bincount(which)
        found[str(scene)] = values
    return found


def spread_table(runs: "DataFrame", measures: list[str]) -> "DataFrame":
    """Return the spread of each measure for each system and setting."""
    from pandas import DataFrame

    keys = ["system", *SETTING]
    rows = [
        {**dict(zip(keys, key, strict=True)), "measure": measure, **spread_of(group, measure)}
        for key, group in runs.groupby(keys, sort=True, dropna=False)
        for measure in measures
    ]
    return DataFrame(rows, columns=[*keys, "measure", *SPREAD])


def difference_table(runs: "DataFrame", measures: list[str]) -> "DataFrame":
    """Return how each setting differs from clean, for each system and measure, scene by scene."""
    from pandas import DataFrame

    keys = ["system", *SETTING]
    rows = []
    for system, of_system in runs.groupby("system", sort=True):
        is_clean = of_system["perturbation"] == CLEAN
        reference = of_system[is_clean]
        for key, group in of_system[~is_clean].groupby(SETTING, sort=True, dropna=False):
            shared = {"system": system, **dict(zip(SETTING, key, strict=True))}
            rows += [{**shared, "measure": name, **difference_of(group, reference, name)} for name in measures]
    return DataFrame(rows, columns=[*keys, "measure", *DIFFERENCE])


def _means(groups: list[Float64]) -> Float64:
    return np.array([np.mean(group) for group in groups])


def _interval(of_scenes: Float64, runs_of_scenes: Float64, measure: str) -> Interval:
    if is_share(measure):
        return share_interval(of_scenes, runs_of_scenes)
    return _possible(mean_interval(of_scenes), measure)


def _possible(interval: Interval, measure: str) -> Interval:
    if is_score(measure):
        return clipped(interval)
    return clipped(interval, 0.0, np.inf) if is_error(measure) else interval
