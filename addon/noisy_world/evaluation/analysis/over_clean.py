# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors over clean: of each run, and of each setting; runs that failed or are incomplete are counted, in no ratio."""

from collections.abc import Mapping
from math import exp, isfinite
from statistics import fmean, median
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..metrics.over_clean import OVER_CLEAN, THRESHOLDS_OVER_CLEAN, is_success_over_clean, success_over_clean_name
from ..metrics.success import COMPLETE
from ..study.cases import CLEAN
from .columns import Columns, table_of
from .log_scale import log_errors
from .run_results import RESULT

if TYPE_CHECKING:
    from pandas import DataFrame

ATE = "ate_rmse_m"
CLEAN_ATE = "clean_ate_rmse_m"
COUNTS = ["n_runs", "n_failed", "n_incomplete", "n", "n_scenes"]
OVER = [*COUNTS, "ate_m", "clean_ate_m", "over_clean", "least", "most"]


def with_over_clean(runs: "DataFrame") -> "DataFrame":
    """Return a table of runs with the columns of OVER_CLEAN_METRICS, and CLEAN_ATE, what they stand on.

    runs: with what `with_results` adds. The clean error of a run is the median of its system's clean runs in its scene,
    of its own seed; a scene that has a single clean seed stands for all, as no seed changes its clean frames. It has
    none where half of these runs or more failed or are incomplete, or where it is 0. Without a column of ATE by
    protocol strict, the table is as it was.
    """
    if ATE not in runs or not len(runs):
        return runs
    ate_m = runs[ATE].to_numpy(dtype=np.float64)
    holds = (runs[RESULT] == COMPLETE).to_numpy(dtype=bool) & np.isfinite(ate_m)
    clean_m = _clean_errors(runs, np.where(holds, ate_m, np.inf))
    over = np.where(holds & np.isfinite(clean_m), ate_m / clean_m, np.nan)
    successes = {
        success_over_clean_name(times): [
            float(is_success_over_clean(value if isfinite(value) else None, times)) if isfinite(clean) else np.nan
            for value, clean in zip(over.tolist(), clean_m.tolist(), strict=True)
        ]
        for times in THRESHOLDS_OVER_CLEAN
    }
    return runs.assign(**{CLEAN_ATE: clean_m, OVER_CLEAN: over, **successes})


def over_clean_table(runs: Columns, by: list[str]) -> "DataFrame":
    """Return a row for each group of perturbed runs: how many failed or are incomplete, and the error over clean.

    over_clean: of the geometric means ate_m and clean_ate_m of the n runs that have a ratio, in which scenes weigh
    alike, and seeds in a scene; least, most: of these runs.
    """
    rows = []
    if OVER_CLEAN in runs:
        for key, group in runs.where(runs["perturbation"] != CLEAN).groups(by):
            rows.append({**dict(zip(by, key, strict=True)), **_of_group(group)})
    return table_of(rows, [*by, *OVER])


def _of_group(runs: Columns) -> dict[str, Any]:
    known = np.isfinite(runs[OVER_CLEAN])
    compared = runs.where(known)
    row: dict[str, Any] = dict.fromkeys(OVER, float("nan"))
    row |= {"n_runs": len(runs), "n": len(compared), "n_scenes": len(set(compared["scene"]))}
    row |= {f"n_{name}": int(runs[name].sum()) for name in ("failed", "incomplete")}
    if len(compared):
        row |= {"ate_m": _geometric_mean(compared, ATE), "clean_ate_m": _geometric_mean(compared, CLEAN_ATE)}
        row["over_clean"] = row["ate_m"] / row["clean_ate_m"]
        row |= {"least": float(compared[OVER_CLEAN].min()), "most": float(compared[OVER_CLEAN].max())}
    return row


def _geometric_mean(runs: Columns, column: str) -> float:
    logs: dict[str, dict[int, list[float]]] = {}
    for (scene, seed), value in zip(runs.rows(["scene", "seed"]), log_errors(runs[column]).tolist(), strict=True):
        logs.setdefault(scene, {}).setdefault(seed, []).append(value)
    return exp(fmean(fmean(map(fmean, seeds.values())) for seeds in logs.values()))


def _clean_errors(runs: "DataFrame", worst_if_failed_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) errors, infinite for runs that are no success -> (N,) the clean error of each run; NaN for none."""
    found: dict[tuple[str, str], dict[Any, list[float]]] = {}
    keys = list(runs[["system", "scene", "seed", "perturbation"]].itertuples(index=False, name=None))
    for (system, scene, seed, perturbation), error_m in zip(keys, worst_if_failed_m.tolist(), strict=True):
        if perturbation == CLEAN:
            found.setdefault((system, scene), {}).setdefault(seed, []).append(error_m)
    return np.array([_reference(found.get((system, scene), {}), seed) for system, scene, seed, _ in keys])


def _reference(of_seeds: Mapping[Any, list[float]], seed: Any) -> float:
    errors_m = of_seeds.get(seed, next(iter(of_seeds.values())) if len(of_seeds) == 1 else None)
    middle_m = float("inf") if errors_m is None else median(errors_m)
    return middle_m if 0.0 < middle_m < float("inf") else float("nan")
