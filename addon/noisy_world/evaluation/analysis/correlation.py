# SPDX-License-Identifier: GPL-3.0-or-later
"""Which perturbations are hard in the same way, which systems fail together, and what of a sequence goes with errors."""

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from .run_table import CLEAN, ERROR, FAILED, SEQUENCE, indicators_in, worst_if_failed

if TYPE_CHECKING:
    from pandas import DataFrame

ALL = "all"
PAIRS = ["mode", "a", "b", "n", "n_scenes", "spearman", "p"]
INDICATED = [
    *("system", "perturbation", "indicator", "n", "n_scenes", "pearson", "low", "high", "p"),
    *("pearson_log10", "low_log10", "high_log10", "p_log10", "n_ranked", "spearman", "spearman_p"),
]
FEWEST = 4
"""Pairs of values below which no correlation is given."""


def perturbation_correlations(runs: "DataFrame") -> "DataFrame":
    """Return Spearman's correlation of the ATE under each two perturbations: over systems, scenes and severities.

    The modes apart; "" are perturbations without modes. A failed run is worse than any other.
    """
    tables = []
    perturbed = _with_error(runs[runs["perturbation"] != CLEAN])
    for mode, of_mode in perturbed.groupby("mode", sort=True):
        table = of_mode.pivot_table(
            index=["system", "scene", "severity"], columns="perturbation", values="error", aggfunc=_median, dropna=False
        )
        tables += list(_pairs(str(mode), table.dropna(how="all")))
    return _table(tables, PAIRS)


def system_correlations(runs: "DataFrame") -> "DataFrame":
    """Return Spearman's correlation of the ATE of each two systems: over scenes and perturbed settings, each mode.

    Mode "all" is over all settings. A failed run is worse than any other.
    """
    tables = []
    perturbed = _with_error(runs[runs["perturbation"] != CLEAN])
    modes = [(ALL, perturbed)] + [(str(mode), group) for mode, group in perturbed.groupby("mode", sort=True)]
    for mode, of_mode in modes:
        table = of_mode.pivot_table(
            index=["scene", "setting"], columns="system", values="error", aggfunc=_median, dropna=False
        )
        tables += list(_pairs(mode, table.dropna(how="all")))
    return _table(tables, PAIRS)


def indicator_correlations(runs: "DataFrame", sequences: "DataFrame") -> "DataFrame":
    """Return Pearson's correlation of ATE and log10 ATE with each indicator's mean, for each system.

    Over all sequences (perturbation "all") and those of each perturbation with the clean ones. Pearson's leaves out runs
    without an error; Spearman's counts them as worse than any other. Intervals are Fisher's, as if sequences were
    independent.
    """
    rows = []
    names = indicators_in(sequences)
    means = (
        _with_error(runs)
        .groupby(["system", *SEQUENCE, "perturbation"], sort=True, as_index=False)["error"]
        .agg(_median)
    )
    joined = means.merge(sequences[[*SEQUENCE, *names]], on=SEQUENCE, how="inner")
    for system, of_system in joined.groupby("system", sort=True):
        clean = of_system["perturbation"] == CLEAN
        chosen = {ALL: of_system}
        chosen |= {name: of_system[clean | (of_system["perturbation"] == name)] for name in _perturbed(of_system)}
        for perturbation, group in chosen.items():
            for name in names:
                found = _with_indicator(group, name)
                rows.append(
                    {"system": system, "perturbation": perturbation, "indicator": name.removesuffix("_mean"), **found}
                )
    return _table(rows, INDICATED)


def pearson(x: ArrayLike, y: ArrayLike) -> tuple[float, float, float, float]:
    """Return Pearson's correlation, the ends of Fisher's 95 % interval and the p-value; NaN where it has none."""
    from scipy.stats import pearsonr

    a, b = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if len(a) < FEWEST or _constant(a) or _constant(b):
        return (float("nan"),) * 4
    found: Any = pearsonr(a, b)
    low, high = found.confidence_interval(0.95)
    return float(found.statistic), float(low), float(high), float(found.pvalue)


def spearman(x: ArrayLike, y: ArrayLike) -> tuple[float, float]:
    """Return Spearman's correlation and its p-value (t approximation); NaN where it has none. Values may be infinite."""
    from scipy.stats import rankdata, spearmanr

    a, b = rankdata(np.asarray(x, dtype=np.float64)), rankdata(np.asarray(y, dtype=np.float64))
    if len(a) < FEWEST or _constant(a) or _constant(b):
        return float("nan"), float("nan")
    found: Any = spearmanr(a, b)
    return float(found.statistic), float(found.pvalue)


def _with_indicator(group: "DataFrame", name: str) -> dict[str, Any]:
    known = group[group[name].notna()]
    values, errors = known[name].to_numpy(dtype=np.float64), known["error"].to_numpy(dtype=np.float64)
    finite = np.isfinite(errors)
    positive = finite & (errors > 0.0)
    row: dict[str, Any] = {"n": int(finite.sum()), "n_scenes": known["scene"].nunique(), "n_ranked": len(known)}
    logs = np.log10(errors[positive])
    for suffix, given, of in (("", values[finite], errors[finite]), ("_log10", values[positive], logs)):
        columns = (f"pearson{suffix}", f"low{suffix}", f"high{suffix}", f"p{suffix}")
        row |= dict(zip(columns, pearson(given, of), strict=True))
    row["spearman"], row["spearman_p"] = spearman(values, errors)
    return row


def _pairs(mode: str, table: "DataFrame") -> Iterator[dict[str, Any]]:
    names = sorted(str(name) for name in table.columns)
    scenes = table.index.get_level_values("scene")
    for a, b in combinations(names, 2):
        both = (table[a].notna() & table[b].notna()).to_numpy()
        rho, p = spearman(table[a].to_numpy()[both], table[b].to_numpy()[both])
        row = {"mode": mode, "a": a, "b": b, "n": int(both.sum()), "n_scenes": scenes[both].nunique()}
        yield {**row, "spearman": rho, "p": p}


def _with_error(runs: "DataFrame") -> "DataFrame":
    if ERROR not in runs:
        return runs.assign(error=np.where(runs[FAILED] == 1.0, np.inf, np.nan))
    return runs.assign(error=worst_if_failed(runs, ERROR))


def _perturbed(runs: "DataFrame") -> list[str]:
    return sorted(name for name in runs["perturbation"].unique() if name != CLEAN)


def _median(values: "Any") -> float:
    """Return the median; pandas' own takes infinite values for missing ones in some versions."""
    return float(np.median(np.asarray(values, dtype=np.float64)))


def _constant(values: Any) -> bool:
    """Tell whether values do not vary, but for rounding."""
    return float(np.ptp(values)) <= 1e-13 * float(np.max(np.abs(values), initial=0.0))


def _table(rows: list[dict[str, Any]], columns: list[str]) -> "DataFrame":
    from pandas import DataFrame

    return DataFrame(rows, columns=columns)
