# SPDX-License-Identifier: GPL-3.0-or-later
"""Which perturbations are alike to systems, which systems fail together, and what of a sequence goes with errors."""

from itertools import combinations
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..study.cases import CLEAN
from .columns import Columns, Key, hashable, table_of
from .run_table import SEQUENCE, errors_of, indicators_in

if TYPE_CHECKING:
    from pandas import DataFrame

Float64: TypeAlias = NDArray[np.float64]

ALL = "all"
PAIRS = ["mode", "a", "b", "n", "n_scenes", "spearman", "p"]
INDICATED = [
    *("system", "perturbation", "indicator", "n", "n_scenes", "pearson", "low", "high", "p"),
    *("pearson_log10", "low_log10", "high_log10", "p_log10", "n_ranked", "spearman", "spearman_p"),
]
FEWEST = 4
"""Pairs of values below which no correlation is given."""


def perturbation_correlations(runs: Columns) -> "DataFrame":
    """Return Spearman's correlation of the ATE under each two perturbations: over systems, scenes and severities.

    The modes apart; "" are perturbations without modes. A failed run is worse than any other.
    """
    rows = []
    for (mode,), of_mode in runs.where(runs["perturbation"] != CLEAN).groups(["mode"]):
        rows += _pairs(mode, of_mode, ["system", "scene", "severity"], "perturbation")
    return table_of(rows, PAIRS)


def system_correlations(runs: Columns) -> "DataFrame":
    """Return Spearman's correlation of the ATE of each two systems: over scenes and perturbed settings, each mode.

    Mode "all" is over all settings. A failed run is worse than any other.
    """
    perturbed = runs.where(runs["perturbation"] != CLEAN)
    rows = _pairs(ALL, perturbed, ["scene", "setting"], "system")
    for (mode,), of_mode in perturbed.groups(["mode"]):
        rows += _pairs(mode, of_mode, ["scene", "setting"], "system")
    return table_of(rows, PAIRS)


def indicator_correlations(runs: Columns, sequences: Columns) -> "DataFrame":
    """Return Pearson's correlation of ATE and log10 ATE with each indicator's mean, for each system.

    Over all sequences (perturbation "all") and those of each perturbation with the clean ones. Pearson's leaves out
    runs without an error; Spearman's counts them as worse than any other. Intervals are Fisher's, as if sequences were
    independent.
    """
    rows = []
    for (system,), of_system in runs.groups(["system"]):
        joined = with_indicators(of_system, sequences, indicators_in(sequences))
        clean = joined["perturbation"] == CLEAN
        chosen = {ALL: joined}
        for name in sorted(set(joined["perturbation"][~clean])):
            chosen[name] = joined.where(clean | (joined["perturbation"] == name))
        for perturbation, group in chosen.items():
            for name in indicators_in(sequences):
                row = {"system": system, "perturbation": perturbation, "indicator": name.removesuffix("_mean")}
                rows.append(row | _with_indicator(group, name))
    return table_of(rows, INDICATED)


def with_indicators(runs: Columns, sequences: Columns, names: list[str]) -> Columns:
    """Return a row for each sequence that was run: SEQUENCE, perturbation, columns of its indicators, and its error.

    error: the median ATE of the runs, infinite for a failed one.
    """
    places = {key: place for place, key in enumerate(sequences.rows(SEQUENCE))}
    found = [(key, group) for key, group in runs.groups([*SEQUENCE, "perturbation"]) if key[:3] in places]
    at = np.array([places[key[:3]] for key, _ in found], dtype=np.int64)
    columns = {
        name: np.array([key[place] for key, _ in found]) for place, name in enumerate((*SEQUENCE, "perturbation"))
    }
    columns |= {name: sequences[name][at] for name in names}
    columns["error"] = np.array([float(np.median(errors_of(group))) for _, group in found])
    return Columns(columns, len(found))


def pearson(x: ArrayLike, y: ArrayLike) -> tuple[float, float, float, float]:
    """Return Pearson's correlation, the ends of Fisher's 95 % interval and the p-value; NaN where it has none."""
    from scipy.stats import pearsonr

    a, b = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if len(a) < FEWEST or _constant(a) or _constant(b):
        return float("nan"), float("nan"), float("nan"), float("nan")
    found: Any = pearsonr(a, b)
    low, high = found.confidence_interval(0.95)
    return float(found.statistic), float(low), float(high), float(found.pvalue)


def spearman(x: ArrayLike, y: ArrayLike) -> tuple[float, float]:
    """Return Spearman's correlation and its p-value by Student's t; NaN where it has none. Infinity is a value."""
    from scipy.stats import rankdata, spearmanr

    a, b = rankdata(np.asarray(x, dtype=np.float64)), rankdata(np.asarray(y, dtype=np.float64))
    if len(a) < FEWEST or _constant(a) or _constant(b):
        return float("nan"), float("nan")
    found: Any = spearmanr(a, b)
    return float(found.statistic), float(found.pvalue)


def _with_indicator(group: Columns, name: str) -> dict[str, Any]:
    known = group.where(np.isfinite(group[name]))
    values, errors = known[name], known["error"]
    finite = np.isfinite(errors)
    positive = finite & (errors > 0.0)
    row: dict[str, Any] = {"n": int(finite.sum()), "n_scenes": len(set(known["scene"])), "n_ranked": len(known)}
    logs = np.log10(errors[positive])
    for suffix, given, of in (("", values[finite], errors[finite]), ("_log10", values[positive], logs)):
        columns = (f"pearson{suffix}", f"low{suffix}", f"high{suffix}", f"p{suffix}")
        row |= dict(zip(columns, pearson(given, of), strict=True))
    row["spearman"], row["spearman_p"] = spearman(values, errors)
    return row


def _pairs(mode: str, runs: Columns, cell: list[str], compared: str) -> list[dict[str, Any]]:
    """Return Spearman's correlations of the errors of each two values of a column, over the cells that both have."""
    errors: dict[str, dict[Key, float]] = {}
    for (name, *key), group in runs.groups([compared, *cell]):
        place = hashable(key)
        errors.setdefault(str(name), {})[place] = float(np.median(errors_of(group)))
    rows = []
    scene = cell.index("scene")
    for a, b in combinations(sorted(errors), 2):
        both = [place for place in errors[a] if place in errors[b]]
        rho, p = spearman(*([errors[name][place] for place in both] for name in (a, b)))
        row = {"mode": mode, "a": a, "b": b, "n": len(both), "n_scenes": len({place[scene] for place in both})}
        rows.append({**row, "spearman": rho, "p": p})
    return rows


def _constant(values: Any) -> bool:
    """Tell whether values do not vary, but for rounding."""
    return float(np.ptp(values)) <= 1e-13 * float(np.max(np.abs(values), initial=0.0))
