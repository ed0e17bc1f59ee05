# SPDX-License-Identifier: GPL-3.0-or-later
"""Results over many settings: of each system, by perturbation, by mode, by severity; and curves over severity."""

from statistics import fmean
from typing import TYPE_CHECKING, Any

import numpy as np

from ..study.cases import CLEAN
from .columns import Columns, table_of
from .spread import COUNTS, MEAN, Cells, cells_of, means_with_intervals, spread_of

if TYPE_CHECKING:
    from pandas import DataFrame

SHOWN = [*MEAN, "median", "minimum", "maximum"]
GROUPED = ["n_settings", *COUNTS, *SHOWN]
CURVE = ["system", "perturbation", "mode", "severity", "measure", *COUNTS, *SHOWN]


def grouped_table(runs: Columns, measures: list[str], by: list[str]) -> "DataFrame":
    """Return each system's perturbed runs, grouped by columns: measures over all settings of a group, with intervals.

    In a scene and seed, settings weigh alike: their runs are averaged first. Clean runs are left out.
    """
    keys = ["system", *by]
    rows: list[dict[str, Any]] = []
    for key, group in runs.where(runs["perturbation"] != CLEAN).groups(keys):
        for measure in measures:
            row = spread_of(group, measure) | over_settings(group, measure)
            named = {**dict(zip(keys, key, strict=True)), "measure": measure, "n_settings": len(set(group["setting"]))}
            rows.append({**named, **{name: row[name] for name in GROUPED if name in row}})
    return table_of(rows, [*keys, "measure", *GROUPED])


def over_settings(runs: Columns, measure: str) -> dict[str, Any]:
    """Return mean and intervals of a measure over settings: of each scene and seed, the mean of its settings' means.

    A setting that was run with fewer seeds than others is the same for all (nothing in it is random), so its mean
    stands for the missing ones.
    """
    settings = [cells_of(group, measure) for _, group in runs.groups(["setting"])]
    found: Cells = {}
    for scene in sorted({scene for cells in settings for scene in cells}):
        there = [cells[scene] for cells in settings if scene in cells]
        means = [{seed: fmean(values) for seed, values in seeds.items()} for seeds in there]
        for seed in sorted({seed for of_setting in means for seed in of_setting}):
            of_seed = [of_setting.get(seed, fmean(of_setting.values())) for of_setting in means]
            found.setdefault(scene, {})[seed] = [fmean(of_seed)]
    return means_with_intervals(found, measure) if found else {}


def curve_table(runs: Columns, measures: list[str]) -> "DataFrame":
    """Return failure curves: each measure over severity for each system, perturbation and mode; clean is severity 0.

    Perturbations without severities are not in it.
    """
    rows: list[dict[str, Any]] = []
    graded = runs.where(np.isfinite(runs["severity"]) & (runs["perturbation"] != CLEAN))
    for (system, perturbation, mode), group in graded.groups(["system", "perturbation", "mode"]):
        clean = runs.where((runs["perturbation"] == CLEAN) & (runs["system"] == system))
        steps = [(0.0, clean)] if len(clean) else []
        steps += [(severity, of_one) for (severity,), of_one in group.groups(["severity"])]
        for severity, of_one in steps:
            named = {"system": system, "perturbation": perturbation, "mode": mode, "severity": severity}
            for measure in measures:
                row = spread_of(of_one, measure) | (over_settings(of_one, measure) if _several(of_one) else {})
                rows.append({**named, "measure": measure, **{name: row[name] for name in (*COUNTS, *SHOWN)}})
    return table_of(rows, CURVE)


def _several(runs: Columns) -> bool:
    return len(set(runs["setting"])) > 1
