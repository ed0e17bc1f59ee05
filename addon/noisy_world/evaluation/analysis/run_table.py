# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of runs and of sequences, as the analyses take them."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..measured import metric_of
from ..metrics import PAPER_METRICS
from ..metrics.over_clean import OVER_CLEAN, OVER_CLEAN_METRICS, success_over_clean_name
from .columns import Columns
from .indicators import INDICATORS
from .over_clean import CLEAN_ATE, with_over_clean

if TYPE_CHECKING:
    from pandas import DataFrame

CLEAN = "clean"
SETTING = ["setting", "perturbation", "mode", "severity"]
SEQUENCE = ["scene", "setting", "seed"]
TEXTS = ("scene", "setting", "perturbation", "mode", "system", "outcome", "failure")
NOT_MEASURES = {*TEXTS, "severity", "seed", "repeat", "frames", "failed", CLEAN_ATE}
FAILED = "failed"
ERRORS = ("ate_rmse_m", "ate_m", "paper.ate_m")
"""The error that ranks and correlations take, the first of these that a table has: a study may be by protocol paper."""
SCORES = ("success_auc", "f1_auc")
SUCCESS = "success_10cm"
"""What counts as a success where runs are counted: an ATE below 10 cm, with enough of the frames tracked."""
SUCCESS_OVER_CLEAN = success_over_clean_name(10.0)
"""The same beside the clean error: an ATE below ten times that."""
HEADLINE = (
    FAILED,
    SUCCESS,
    SUCCESS_OVER_CLEAN,
    "ate_rmse_m",
    "ate_m",
    "rpe_1frame_rmse_m",
    "tracked_share",
    "sr",
    *SCORES,
)
"""Measures of the tests and of the tables by groups; of them, those that a table has."""


def tidy_runs(runs: "DataFrame") -> Columns:
    """Return the table of runs, sorted, its texts and numbers as such, with a column `failed`, 0 or 1.

    A run failed where its outcome is another than finished, or its score says a word. Where such a run has no value of
    a score between 0 and 1 that counts what was lost (success, AUC, tracked share), it is 0.
    """
    table = _tidy(with_over_clean(runs))
    failed = (table["failure"] != "") | (table["outcome"] != "finished")
    table = table.with_column(FAILED, failed.astype(np.float64))
    for name in measures_of(table):
        if name in OVER_CLEAN_METRICS:
            continue  # a run without a clean one beside it has none, failed or not
        if name.startswith("success_") or name in (*SCORES, "f1_auc_rotation", "tracked_share"):
            table = table.with_column(name, np.where(failed & np.isnan(table[name]), 0.0, table[name]))
    return table


def tidy_sequences(sequences: "DataFrame") -> Columns:
    """Return the table of sequences, sorted, its texts and numbers as such."""
    return _tidy(sequences)


def _tidy(given: "DataFrame") -> Columns:
    import pandas

    table = given.copy()
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
    return Columns.of(table.sort_values([*SEQUENCE, "system", "repeat"], kind="stable"))


def measures_of(table: Columns) -> list[str]:
    """Return the columns with measures of runs, in the table's order, `failed` first."""
    return [FAILED, *(name for name in table.names if name not in NOT_MEASURES)]


def headline_of(table: Columns) -> list[str]:
    """Return the measures of HEADLINE that a table has."""
    return [name for name in HEADLINE if name in table]


def indicators_in(table: Columns) -> list[str]:
    """Return the columns of a table of sequences that tell an indicator's mean over frames."""
    return [f"{name}_mean" for name in INDICATORS if f"{name}_mean" in table]


def is_share(measure: str) -> bool:
    """Tell whether a measure of a run is 0 or 1, so that its mean is a share of runs."""
    return measure == FAILED or (measure.startswith("success_") and measure != "success_auc")


def is_score(measure: str) -> bool:
    """Tell whether a measure lies between 0 and 1."""
    return is_share(measure) or measure in (*SCORES, "f1_auc_rotation", "tracked_share", "bad_pose_share")


def is_error(measure: str) -> bool:
    """Tell whether a measure is an error, better the smaller it is, whose logarithm is looked at."""
    if measure == OVER_CLEAN:
        return True
    metric = metric_of(measure) or PAPER_METRICS.get(measure)
    return metric is not None and metric.better == "lower" and metric.unit in ("m", "deg", "rad")


def errors_of(runs: Columns) -> NDArray[np.float64]:
    """Return the ATE of runs, infinite where one failed; 0 for the others where no error is known."""
    name = next((name for name in ERRORS if name in runs), None)
    return np.where(runs[FAILED] == 1.0, np.inf, 0.0) if name is None else worst_if_failed(runs, name)


def worst_if_failed(table: Columns, measure: str) -> NDArray[np.float64]:
    """Return a column of errors, infinite where a run failed or has none: for ranks, which need no number."""
    known = np.isfinite(table[measure]) & (table[FAILED] == 0.0)
    return np.where(known, table[measure], np.inf)
