# SPDX-License-Identifier: GPL-3.0-or-later
"""Mean resilience rates and mean corruption errors of systems, with intervals over scenes."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..metrics import Rate, corruption_error, resilience_rate
from .intervals import Interval, bootstrap_interval
from .run_table import CLEAN, SCORES

if TYPE_CHECKING:
    from pandas import DataFrame

type Float64 = NDArray[np.float64]
type Resampled = Callable[[Float64], Float64]  # (B, S) how often each scene is taken -> (B, P) rates

BASELINE = "rgbd_odometry"
ALL = "all"
ROBUSTNESS = [
    *("system", "score", "perturbation", "n_perturbations", "n_scenes", "n_cells"),
    *("mrr", "mrr_low", "mrr_high", "baseline", "mce", "mce_low", "mce_high"),
]


class _Cells(NamedTuple):
    """Scores of a system: (S, P) sums over the cells (setting) of each scene and perturbation, and their numbers."""

    scenes: list[str]
    perturbations: list[str]
    sums: Float64
    counts: Float64


def robustness_table(runs: "DataFrame") -> "DataFrame":
    """Return mRR and mCE of each system and score: over all perturbations, and the rate of each one.

    The scores of a cell (scene and setting) are the mean of its runs. mRR compares with the system's own clean cells in
    the same scenes, mCE with the baseline's errors (1 - score) in the cells that both have: rgbd_odometry, or the first
    system by name where it was not run.
    """
    from pandas import DataFrame

    rows: list[dict[str, Any]] = []
    systems = sorted(runs["system"].unique())
    baseline = BASELINE if BASELINE in systems else next(iter(systems), "")
    for score in (name for name in SCORES if name in runs):
        cells = runs.groupby(["system", "scene", "setting", "perturbation"], sort=True)[score].mean().dropna()
        for system in (name for name in systems if name in cells.index.get_level_values("system")):
            rows += _of_system(cells, str(system), baseline, score)
    return DataFrame(rows, columns=ROBUSTNESS)


def _of_system(cells: Any, system: str, baseline: str, score: str) -> list[dict[str, Any]]:
    own = cells[system]
    is_clean = own.index.get_level_values("perturbation") == CLEAN
    clean, perturbed = own[is_clean].groupby(level="scene").mean(), own[~is_clean]
    compared = perturbed[perturbed.index.get_level_values("scene").isin(clean.index)]
    names = sorted(perturbed.index.get_level_values("perturbation").unique())
    rows = {
        name: {"system": system, "score": score, "perturbation": name, "baseline": baseline}
        | dict.fromkeys(("mrr", "mrr_low", "mrr_high", "mce", "mce_low", "mce_high"), float("nan"))
        | {"n_perturbations": 1 if name != ALL else len(names), "n_cells": 0, "n_scenes": 0}
        for name in (ALL, *names)
    }
    for name in rows:
        chosen = perturbed if name == ALL else perturbed.xs(name, level="perturbation", drop_level=False)
        rows[name]["n_cells"] = len(chosen)
        rows[name]["n_scenes"] = chosen.index.get_level_values("scene").nunique()
    _add_resilience(rows, compared, clean, (system, score))
    if baseline in cells.index.get_level_values("system"):
        theirs = cells[baseline]
        both = perturbed.index.intersection(theirs.index)
        _add_corruption(rows, 1.0 - perturbed.loc[both], 1.0 - theirs.loc[both], (system, score))
    return list(rows.values())


def _add_resilience(rows: dict[str, Any], perturbed: Any, clean: Any, names: tuple[str, str]) -> None:
    if not len(perturbed):
        return
    found = _cells(perturbed)
    own_clean = clean.loc[found.scenes].to_numpy()
    given = {name: _values(perturbed, name) for name in found.perturbations}
    rate = resilience_rate(given, float(np.mean(own_clean)))

    def rates(taken: Float64) -> Float64:
        of_clean = (taken @ own_clean / taken.sum(axis=1))[:, None]
        return _ratio(_ratio(taken @ found.sums, taken @ found.counts), of_clean)

    _fill(rows, "mrr", rate, found, rates, names)


def _add_corruption(rows: dict[str, Any], errors: Any, baseline: Any, names: tuple[str, str]) -> None:
    if not len(errors):
        return
    mine, theirs = _cells(errors), _cells(baseline)
    rate = corruption_error(
        {name: _values(errors, name) for name in mine.perturbations},
        {name: _values(baseline, name) for name in mine.perturbations},
    )
    _fill(rows, "mce", rate, mine, lambda taken: _ratio(taken @ mine.sums, taken @ theirs.sums), names)


def _fill(
    rows: dict[str, Any], column: str, rate: Rate, cells: _Cells, rates: Resampled, names: tuple[str, str]
) -> None:
    """Write a rate with its interval into the row of all perturbations and into each one's."""
    kept = [cells.perturbations.index(name) for name in rate.by_perturbation]
    if rate.value is None:
        return
    scenes = len(cells.scenes)
    mean = bootstrap_interval(lambda taken: rates(taken)[:, kept].mean(axis=1), scenes, column, *names, ALL)
    _write(rows[ALL], column, rate.value, mean)
    for name, place in zip(rate.by_perturbation, kept, strict=True):
        one = bootstrap_interval(lambda taken, place=place: rates(taken)[:, place], scenes, column, *names, name)
        _write(rows[name], column, rate.by_perturbation[name], one)


def _write(row: dict[str, Any], column: str, value: float, interval: Interval) -> None:
    row |= {column: value, f"{column}_low": max(interval.low, 0.0), f"{column}_high": interval.high}


def _cells(values: Any) -> _Cells:
    table = (
        values.groupby(level=["scene", "perturbation"]).agg(["sum", "count"]).unstack("perturbation", fill_value=0.0)
    )
    sums, counts = table["sum"].sort_index(axis=1), table["count"].sort_index(axis=1)
    return _Cells(list(sums.index), list(sums.columns), sums.to_numpy(float), counts.to_numpy(float))


def _values(values: Any, perturbation: str) -> list[float]:
    return values.xs(perturbation, level="perturbation").sort_index().to_list()


def _ratio(above: Float64, below: Float64) -> Float64:
    """Return a quotient; NaN where it would be divided by 0."""
    out = np.full(np.broadcast_shapes(above.shape, below.shape), np.nan)
    return np.divide(above, below, out=out, where=np.broadcast_to(below, out.shape) > 0.0)
