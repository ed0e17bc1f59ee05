# SPDX-License-Identifier: GPL-3.0-or-later
"""Mean resilience rates and mean corruption errors of systems, with intervals over scenes."""

from collections.abc import Callable, Container
from statistics import fmean
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..metrics import Rate, corruption_error, resilience_rate
from ..study.cases import CLEAN
from .columns import Columns, table_of
from .intervals import Interval, bootstrap_interval
from .run_table import SCORES

if TYPE_CHECKING:
    from pandas import DataFrame

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
