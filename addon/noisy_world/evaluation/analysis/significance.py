# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a setting differs from clean: tests, corrected for their number, with the size of the effect."""

from collections.abc import Sequence
from math import isnan
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..study.cases import CLEAN
from .columns import Columns, table_of
from .log_scale import log_errors
from .run_table import SETTING, is_averaged_in_logs, is_error, worst_if_failed

if TYPE_CHECKING:
    from pandas import DataFrame

Float64: TypeAlias = NDArray[np.float64]
Row: TypeAlias = dict[str, Any]
Unit: TypeAlias = tuple[Any, ...]  # a scene, or a scene and a seed

TESTS = [
    *("unit", "n", "n_clean", "mean", "clean_mean", "welch_t", "welch_freedom", "welch_p", "welch_p_holm", "hedges_g"),
    *("n_pairs", "wilcoxon_w", "wilcoxon_p", "wilcoxon_p_holm", "rank_biserial"),
]
UNITS = {"scene": ["scene"], "scene and seed": ["scene", "seed"]}


def against_clean_table(runs: Columns, measures: Sequence[str]) -> "DataFrame":
    """Return Welch's test and Wilcoxon's signed-rank test of each setting against clean.

    Each is done twice: a value for each scene, which speaks for scenes at large, and a value for each scene and seed,
    which speaks for these scenes only, as seeds of one scene are no independent scenes. Welch's is of the logarithms of
    errors, and their means are geometric. Holm's correction is over the
    settings of one system, measure and unit.
    """
    rows: list[Row] = []
    for (system,), of_system in runs.groups(["system"]):
        is_clean = of_system["perturbation"] == CLEAN
        clean, perturbed = of_system.where(is_clean), of_system.where(~is_clean)
        for measure in measures:
            for unit, keys in UNITS.items():
                family = [
                    {"system": system, **dict(zip(SETTING, key, strict=True)), "measure": measure, "unit": unit}
                    | _tested(group, clean, measure, keys)
                    for key, group in perturbed.groups(SETTING)
                ]
                _correct(family)
                rows += family
    return table_of(rows, ["system", *SETTING, "measure", *TESTS])


def _tested(runs: Columns, clean: Columns, measure: str, keys: list[str]) -> Row:
    sample, reference = _units(runs, measure, keys), _units(clean, measure, keys)
    row = welch(sample, reference) | wilcoxon(*_paired(runs, clean, measure, keys))
    if is_averaged_in_logs(measure):
        row |= {name: float(np.exp(row[name])) for name in ("mean", "clean_mean")}
    return row


def welch(sample: ArrayLike, clean: ArrayLike) -> Row:
    """Return Welch's t-test of two samples (two-sided) and Hedges' g, the difference over the pooled deviation.

    NaN with fewer than two values on a side, or where neither varies.
    """
    from scipy.stats import ttest_ind_from_stats

    first, second = np.asarray(sample, dtype=np.float64), np.asarray(clean, dtype=np.float64)
    row: Row = {"n": len(first), "n_clean": len(second)}
    row["mean"] = float(np.mean(first)) if len(first) else float("nan")
    row["clean_mean"] = float(np.mean(second)) if len(second) else float("nan")
    nothing = dict.fromkeys(("welch_t", "welch_freedom", "welch_p", "hedges_g"), float("nan"))
    if len(first) < 2 or len(second) < 2:
        return row | nothing
    variances = _variance(first), _variance(second)
    squared = variances[0] / len(first), variances[1] / len(second)
    if not sum(variances) > 0.0:
        return row | nothing
    deviations = np.sqrt(variances)
    result: Any = ttest_ind_from_stats(
        *(row["mean"], deviations[0], len(first)), *(row["clean_mean"], deviations[1], len(second)), equal_var=False
    )
    freedom = len(first) + len(second) - 2
    pooled = np.sqrt(((len(first) - 1) * variances[0] + (len(second) - 1) * variances[1]) / freedom)
    small_samples = 1.0 - 3.0 / (4.0 * freedom - 1.0)  # Hedges 1981
    return row | {
        "welch_t": float(result.statistic),
        "welch_freedom": sum(squared) ** 2 / (squared[0] ** 2 / (len(first) - 1) + squared[1] ** 2 / (len(second) - 1)),
        "welch_p": float(result.pvalue),
        "hedges_g": small_samples * (row["mean"] - row["clean_mean"]) / float(pooled),
    }


def _variance(values: Float64) -> float:
    """Return the sample variance; 0 where values differ by rounding alone."""
    variance = float(np.var(values, ddof=1))
    return variance if variance > (1e-12 * float(np.max(np.abs(values)))) ** 2 else 0.0


def wilcoxon(sample: ArrayLike, clean: ArrayLike) -> Row:
    """Return Wilcoxon's signed-rank test of pairs (two-sided), and the matched-pairs rank-biserial correlation.

    Values may be infinite: a failed run is worse than any other, and two failed runs are equal. Pairs that are equal
    are left out, as Wilcoxon did. The correlation is 1 where every value is above its clean one, -1 where below.
    """
    from scipy.stats import rankdata
    from scipy.stats import wilcoxon as signed_rank

    first, second = np.asarray(sample, dtype=np.float64), np.asarray(clean, dtype=np.float64)
    same = first == second
    difference = first[~same] - second[~same]
    row: Row = {"n_pairs": len(first)} | dict.fromkeys(("wilcoxon_w", "wilcoxon_p", "rank_biserial"), float("nan"))
    if not len(difference):
        return row
    finite = np.abs(difference[np.isfinite(difference)])
    beyond = 2.0 * float(finite.max(initial=1.0))
    difference = np.clip(difference, -beyond, beyond)
    ranks = rankdata(np.abs(difference))
    up, down = float(ranks[difference > 0.0].sum()), float(ranks[difference < 0.0].sum())
    row |= {"wilcoxon_w": min(up, down), "rank_biserial": (up - down) / (up + down)}
    result: Any = signed_rank(difference)
    return row | {"wilcoxon_p": float(result.pvalue)}


def holm(p: ArrayLike) -> Float64:
    """(K,) p-values, NaN where there was no test -> the same after Holm's correction (1979); NaN stays NaN."""
    values = np.asarray(p, dtype=np.float64)
    out = np.full(len(values), np.nan)
    tested = np.flatnonzero(np.isfinite(values))
    order = tested[np.argsort(values[tested], kind="stable")]
    out[order] = np.minimum(np.maximum.accumulate(values[order] * np.arange(len(order), 0, -1)), 1.0)
    return out


def _correct(family: list[Row]) -> None:
    for test in ("welch", "wilcoxon"):
        for row, corrected in zip(family, holm([row[f"{test}_p"] for row in family]), strict=True):
            row[f"{test}_p_holm"] = float(corrected)


def _units(runs: Columns, measure: str, keys: list[str]) -> Float64:
    """Return a value for each unit: the mean of its runs that have one; of an error, of their logarithms."""
    values = log_errors(runs[measure]) if is_averaged_in_logs(measure) else runs[measure]
    return np.array([np.mean(found) for found in _by_unit(runs, values, keys).values()])


def _paired(runs: Columns, clean: Columns, measure: str, keys: list[str]) -> tuple[Float64, Float64]:
    """Return the units' values and those of clean beside them: its own seed's, or else the mean of its scene's.

    A unit's value is the median of its runs; of errors a failed run's is infinite.
    """
    mine, theirs = _medians(runs, measure, keys), _medians(clean, measure, keys)
    of_scene = _medians(clean, measure, ["scene"])
    pairs = []
    for unit, value in mine.items():
        other = theirs.get(unit, of_scene.get(unit[:1]))
        if other is not None:
            pairs.append((value, other))
    both = np.array(pairs, dtype=np.float64).reshape(-1, 2)
    return both[:, 0], both[:, 1]


def _medians(runs: Columns, measure: str, keys: list[str]) -> dict[Unit, float]:
    values = worst_if_failed(runs, measure) if is_error(measure) else runs[measure]
    return {unit: float(np.median(found)) for unit, found in _by_unit(runs, values, keys).items()}


def _by_unit(runs: Columns, values: Float64, keys: list[str]) -> dict[Unit, list[float]]:
    """Return values by unit, in order, NaN left out."""
    found: dict[Unit, list[float]] = {}
    for unit, value in sorted(zip(runs.rows(keys), values.tolist(), strict=True), key=lambda row: row[0]):
        if not isnan(value):
            found.setdefault(unit, []).append(value)
    return found
