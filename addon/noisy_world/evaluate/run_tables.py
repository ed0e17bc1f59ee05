# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of runs and of sequences as analyses take them: what came of each run, errors over clean, measures."""

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .cases import CLEAN
from .indicators import INDICATORS
from .map_metrics import MAP_METRICS, MAP_PREFIX
from .metrics import (
    COMPLETE,
    FAILED,
    INCOMPLETE,
    IS_INCOMPLETE,
    METRICS,
    OVER_CLEAN,
    OVER_CLEAN_METRICS,
    PAPER_METRICS,
    PAPER_PREFIX,
    THRESHOLDS_OVER_CLEAN,
    Metric,
    is_success_over_clean,
    result_of,
    success_over_clean_name,
)

if TYPE_CHECKING:
    from pandas import DataFrame

Float64: TypeAlias = NDArray[np.float64]

TRACKED = ("tracked_share", "strict.tracked_share")
"""The share of the frames that a run tracked, by the name that the study's protocol gives it."""
RESULT = "result"
LEFT_OUT = (
    f"A run that {IS_INCOMPLETE} is incomplete: its errors are those of the frames that it did not give up, so they "
    "are in no mean, median or ratio."
)
"""A sentence for every table whose errors are of complete runs alone."""
LEAST_ERROR = 1e-9
"""In metres, degrees or radians: errors are checked to this, so a smaller one, an exact 0 too, counts as this."""

SETTING = ["setting", "perturbation", "mode", "severity"]
SEQUENCE = ["scene", "setting", "seed"]
TEXTS = ("scene", "setting", "perturbation", "mode", "system", "outcome", "failure", RESULT)
ATE = "ate_rmse_m"
CLEAN_ATE = "clean_ate_rmse_m"
NOT_MEASURES = {*TEXTS, "severity", "seed", "repeat", "frames", FAILED, INCOMPLETE, CLEAN_ATE}
ERRORS = (ATE, "ate_m", "paper.ate_m")
"""The error that ranks and correlations take, the first of these that a table has: a study may be by protocol paper."""
SCORES = ("success_auc", "f1_auc")
SUCCESS = "success_10cm"
"""What counts as a success where runs are counted: an ATE below 10 cm, with enough of the frames tracked."""
SUCCESS_OVER_CLEAN = success_over_clean_name(10.0)
"""The same beside the clean error: an ATE below ten times that."""
HEADLINE = (
    *(FAILED, INCOMPLETE, SUCCESS, SUCCESS_OVER_CLEAN, ATE, "ate_m", "rpe_1frame_rmse_m", "tracked_share", "sr"),
    *SCORES,
)
"""Measures of the tests and of the tables by groups; of them, those that a table has."""
COUNTS = ["n_runs", "n_failed", "n_incomplete", "n", "n_scenes"]
OVER = [*COUNTS, "ate_m", "clean_ate_m", "over_clean", "least", "most"]


def metric_of(column: str) -> Metric | None:
    """Return the metric of a table's column, `ate_rmse_m`, `paper.sr` or `map.accuracy_m`; None for another column."""
    by_prefix: dict[str, Mapping[str, Metric]] = {PAPER_PREFIX: PAPER_METRICS, MAP_PREFIX: MAP_METRICS}
    for prefix, metrics in by_prefix.items():
        if column.startswith(prefix):
            return metrics.get(column.removeprefix(prefix))
    return METRICS.get(column) or OVER_CLEAN_METRICS.get(column)


def is_share(measure: str) -> bool:
    """Tell whether a measure of a run is 0 or 1, so that its mean is a share of runs."""
    return measure in (FAILED, INCOMPLETE) or (measure.startswith("success_") and measure != "success_auc")


def is_score(measure: str) -> bool:
    """Tell whether a measure lies between 0 and 1."""
    return is_share(measure) or measure in (*SCORES, "f1_auc_rotation", "tracked_share", "bad_pose_share")


def is_error(measure: str) -> bool:
    """Tell whether a measure is an error, better the smaller it is, whose logarithm is looked at."""
    if measure == OVER_CLEAN:
        return True
    metric = metric_of(measure) or PAPER_METRICS.get(measure)
    return metric is not None and metric.better == "lower" and metric.unit in ("m", "deg", "rad")


def is_averaged_in_logs(measure: str) -> bool:
    """Tell whether a measure is an error whose mean is geometric, and that an incomplete run does not have.

    Those of protocol paper are not: its means are arithmetic, with 1.0 for a failed run and whatever was tracked.
    """
    return is_error(measure) and measure not in PAPER_METRICS and not measure.startswith(PAPER_PREFIX)


def log_errors(errors: ArrayLike) -> Float64:
    """Return natural logarithms of errors, which are 0 or more; NaN stays.

    Errors are averaged on this scale: those of two rooms differ by a factor.
    """
    return np.log(np.maximum(np.asarray(errors, dtype=np.float64), LEAST_ERROR))


def geometric_mean(errors: ArrayLike) -> float:
    """Return the geometric mean of errors, all alike in weight; NaN of none."""
    logs = log_errors(errors)
    return float(np.exp(logs.mean())) if logs.size else float("nan")


def geometric_deviation(errors: ArrayLike) -> float:
    """Return the factor by which errors spread, exp of the standard deviation of their logarithms; NaN below two."""
    logs = log_errors(errors)
    return float(np.exp(logs.std(ddof=1))) if logs.size > 1 else float("nan")


def with_results(runs: "DataFrame") -> "DataFrame":
    """Return a table of runs with RESULT, and with `failed` and `incomplete`, True or False.

    A run failed where its outcome is another than finished, or its score says a word. Without a share of tracked frames
    none is incomplete.
    """
    failure, outcome = (runs[name].astype(object).fillna("").astype(str).tolist() for name in ("failure", "outcome"))
    failed = [bool(word) or ending != "finished" for word, ending in zip(failure, outcome, strict=True)]
    results = np.array(list(map(result_of, failed, tracked_shares(runs).tolist())), dtype=object)
    return runs.assign(**{RESULT: results, FAILED: results == FAILED, INCOMPLETE: results == INCOMPLETE})


def tracked_shares(runs: "DataFrame") -> Float64:
    """(N,) the share of the frames that each run tracked; NaN where it is not known."""
    name = next((name for name in TRACKED if name in runs), None)
    return np.full(len(runs), np.nan) if name is None else runs[name].to_numpy(dtype=np.float64)


def complete_runs(runs: "DataFrame") -> "DataFrame":
    """Return the complete ones of a table that `with_results` gave."""
    return runs[runs[RESULT] == COMPLETE]


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


def _clean_errors(runs: "DataFrame", worst_if_failed_m: Float64) -> Float64:
    """(N,) errors, infinite for runs that are no success -> (N,) the clean error of each run; NaN for none."""
    from pandas import MultiIndex

    clean = runs.assign(error_m=worst_if_failed_m)[(runs["perturbation"] == CLEAN).to_numpy()]
    of_seeds = clean.groupby(["system", "scene", "seed"])["error_m"].median()
    of_scenes = of_seeds.groupby(level=["system", "scene"]).agg(["first", "size"])
    of_scenes = of_scenes["first"].where(of_scenes["size"] == 1)
    own = of_seeds.reindex(MultiIndex.from_frame(runs[["system", "scene", "seed"]])).to_numpy()
    shared = of_scenes.reindex(MultiIndex.from_frame(runs[["system", "scene"]])).to_numpy()
    clean_m = np.where(np.isnan(own), shared, own)
    return np.where((clean_m > 0.0) & np.isfinite(clean_m), clean_m, np.nan)


def tidy_runs(runs: "DataFrame") -> "DataFrame":
    """Return the table of runs, sorted, its texts and numbers as such, with columns `failed` and `incomplete`, 0 or 1.

    Where a run that failed has no value of a score between 0 and 1 that counts what was lost (success, AUC, tracked
    share), it is 0. An incomplete run has no error: it would be that of the frames that it did not give up.
    """
    table = tidy_sequences(with_over_clean(with_results(runs)))
    failed, incomplete = table[FAILED] == 1.0, table[INCOMPLETE] == 1.0
    for name in measures_of(table):
        if is_averaged_in_logs(name):
            table[name] = table[name].mask(incomplete)
        if name in OVER_CLEAN_METRICS:
            continue  # a run without a clean one beside it has none, failed or not
        if name.startswith("success_") or name in (*SCORES, "f1_auc_rotation", "tracked_share"):
            table[name] = table[name].mask(failed & table[name].isna(), 0.0)
    return table


def tidy_sequences(sequences: "DataFrame") -> "DataFrame":
    """Return the table of sequences, or of runs, sorted, its texts and numbers as such."""
    import pandas

    table = sequences.copy()
    for name in TEXTS:
        if name not in table:
            table[name] = ""
        table[name] = table[name].astype(object).where(table[name].notna(), "").astype(str)
    for name in ("severity", "seed", "repeat"):
        if name not in table:
            table[name] = np.nan
    for name in table.columns:
        if name not in TEXTS:
            table[name] = pandas.to_numeric(table[name], errors="coerce").astype(float)
    for name in ("seed", "repeat"):
        table[name] = table[name].fillna(0).astype(int)
    return table.sort_values([*SEQUENCE, "system", "repeat"], kind="stable", ignore_index=True)


def measures_of(table: "DataFrame") -> list[str]:
    """Return the columns with measures of runs, in the table's order, `failed` and `incomplete` first."""
    return [FAILED, INCOMPLETE, *(str(name) for name in table.columns if name not in NOT_MEASURES)]


def headline_of(table: "DataFrame") -> list[str]:
    """Return the measures of HEADLINE that a table has."""
    return [name for name in HEADLINE if name in table]


def indicators_in(table: "DataFrame") -> list[str]:
    """Return the columns of a table of sequences that tell an indicator's mean over frames."""
    return [f"{name}_mean" for name in INDICATORS if f"{name}_mean" in table]


def errors_of(runs: "DataFrame") -> Float64:
    """Return the ATE of runs, infinite where one failed or is incomplete; 0 for the others without any column of it."""
    name = next((name for name in ERRORS if name in runs), None)
    return np.where(runs[FAILED] + runs[INCOMPLETE] > 0.0, np.inf, 0.0) if name is None else worst_if_failed(runs, name)


def worst_if_failed(table: "DataFrame", measure: str) -> Float64:
    """Return a column of errors, infinite where a run failed or has none: for ranks, which need no number.

    An incomplete run has none, so it ranks with those that failed.
    """
    return np.where(np.isfinite(table[measure]) & (table[FAILED] == 0.0), table[measure], np.inf)


def groups(table: "DataFrame", names: Sequence[str]) -> "Iterator[tuple[tuple[Any, ...], DataFrame]]":
    """Yield the values of some columns in order, those without a value first, with the rows that have them."""
    ordered = table.sort_values(list(names), kind="stable", na_position="first")
    for key, group in ordered.groupby(list(names), sort=False, dropna=False):
        yield key if isinstance(key, tuple) else (key,), group


def table_of(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> "DataFrame":
    """Return rows as a pandas table with these columns, which are there even where it is empty."""
    from pandas import DataFrame

    return DataFrame(list(rows), columns=list(columns))


def over_clean_table(runs: "DataFrame", by: list[str]) -> "DataFrame":
    """Return a row for each group of perturbed runs: how many failed or are incomplete, and the error over clean.

    over_clean: of the geometric means ate_m and clean_ate_m of the n runs that have a ratio, in which scenes weigh
    alike, and seeds in a scene; least, most: of these runs.
    """
    rows = []
    if OVER_CLEAN in runs:
        for key, group in groups(runs[runs["perturbation"] != CLEAN], by):
            rows.append({**dict(zip(by, key, strict=True)), **_over_clean(group)})
    return table_of(rows, [*by, *OVER])


def _over_clean(runs: "DataFrame") -> dict[str, Any]:
    compared = runs[runs[OVER_CLEAN].notna()]
    row: dict[str, Any] = dict.fromkeys(OVER, float("nan"))
    row |= {"n_runs": len(runs), "n": len(compared), "n_scenes": compared["scene"].nunique()}
    row |= {f"n_{name}": int(runs[name].sum()) for name in (FAILED, INCOMPLETE)}
    if len(compared):
        logs = compared[["scene", "seed"]].assign(**{name: log_errors(compared[name]) for name in (ATE, CLEAN_ATE)})
        means = logs.groupby(["scene", "seed"]).mean().groupby(level="scene").mean().mean()
        row |= {"ate_m": float(np.exp(means[ATE])), "clean_ate_m": float(np.exp(means[CLEAN_ATE]))}
        row["over_clean"] = row["ate_m"] / row["clean_ate_m"]
        row |= {"least": float(compared[OVER_CLEAN].min()), "most": float(compared[OVER_CLEAN].max())}
    return row
