# SPDX-License-Identifier: GPL-3.0-or-later
"""Results over many settings: of each system, by perturbation, by mode, by severity; and curves over severity."""

from typing import TYPE_CHECKING, Any

from .run_table import CLEAN, FAILED, SETTING
from .spread import COUNTS, spread_of

if TYPE_CHECKING:
    from pandas import DataFrame

SHOWN = ["mean", "low", "high", "here_low", "here_high", "median", "minimum", "maximum"]
GROUPED = ["n_settings", *COUNTS, *SHOWN]
CURVE = ["system", "perturbation", "mode", "severity", "measure", *COUNTS, *SHOWN]


def grouped_table(runs: "DataFrame", measures: list[str], by: list[str]) -> "DataFrame":
    """Return each system's perturbed runs, grouped by columns: measures over all settings of a group, with intervals.

    In a scene and seed, settings weigh alike: their runs are averaged first. Clean runs are left out.
    """
    from pandas import DataFrame

    keys = ["system", *by]
    rows: list[dict[str, Any]] = []
    for key, group in runs[runs["perturbation"] != CLEAN].groupby(keys, sort=True, dropna=False):
        for measure in measures:
            row = spread_of(group, measure) | over_settings(group, measure)
            named = {**dict(zip(keys, key, strict=True)), "measure": measure, "n_settings": group["setting"].nunique()}
            rows.append({**named, **{name: row[name] for name in GROUPED if name in row}})
    return DataFrame(rows, columns=[*keys, "measure", *GROUPED])


def over_settings(runs: "DataFrame", measure: str) -> dict[str, Any]:
    """Return mean and intervals of a measure over settings: of each scene and seed, the mean of its settings' means.

    A setting that was run with fewer seeds than others is the same for all (nothing in it is random), so its mean
    stands for the missing ones.
    """
    known = runs[runs[measure].notna()]
    if not len(known):
        return {}
    table = known.pivot_table(index=["scene", "seed"], columns="setting", values=measure, aggfunc="mean", sort=True)
    filled = table.groupby(level="scene").transform(lambda column: column.fillna(column.mean()))
    mean = filled.mean(axis=1).rename(measure).reset_index()
    mean[FAILED] = 0.0
    spread = spread_of(mean, measure)
    return {name: spread[name] for name in ("mean", "low", "high", "here_low", "here_high")}


def curve_table(runs: "DataFrame", measures: list[str]) -> "DataFrame":
    """Return failure curves: each measure over severity for each system, perturbation and mode; clean is severity 0.

    Perturbations without severities are not in it.
    """
    from pandas import DataFrame

    rows: list[dict[str, Any]] = []
    graded = runs[runs["severity"].notna() & (runs["perturbation"] != CLEAN)]
    for (system, perturbation, mode), group in graded.groupby(["system", "perturbation", "mode"], sort=True):
        clean = runs[(runs["perturbation"] == CLEAN) & (runs["system"] == system)]
        steps = [(0.0, clean)] if len(clean) else []
        steps += [(float(str(severity)), of_one) for severity, of_one in group.groupby("severity", sort=True)]
        for severity, of_one in steps:
            named = {"system": system, "perturbation": perturbation, "mode": mode, "severity": severity}
            for measure in measures:
                row = spread_of(of_one, measure) | (over_settings(of_one, measure) if _several(of_one) else {})
                rows.append({**named, "measure": measure, **{name: row[name] for name in (*COUNTS, *SHOWN)}})
    return DataFrame(rows, columns=CURVE)


def _several(runs: "DataFrame") -> bool:
    return len(runs[SETTING].drop_duplicates()) > 1
