# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of runs and of sequences, as the analyses take them."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..metrics import metric_of
from .indicators import INDICATORS

if TYPE_CHECKING:
    from pandas import DataFrame, Series

CLEAN = "clean"
SETTING = ["setting", "perturbation", "mode", "severity"]
SEQUENCE = ["scene", "setting", "seed"]
TEXTS = ("scene", "setting", "perturbation", "mode", "system", "outcome", "failure")
NOT_MEASURES = {*TEXTS, "severity", "seed", "repeat", "frames", "failed"}
FAILED = "failed"
ERROR = "ate_rmse_m"
SCORES = ("success_auc", "f1_auc")
HEADLINE = (FAILED, ERROR, "rpe_1frame_rmse_m", "tracked_share", *SCORES)
"""Measures of the tests and of the tables by groups; of them, those that a table has."""


def tidy_runs(runs: "DataFrame") -> "DataFrame":
    """Return the table of runs, sorted, its texts and numbers as such, with a column `failed`, 0 or 1.

    A run failed where its outcome is another than finished, or its score says a word. Where such a run has no value of
    a score between 0 and 1 that counts what was lost (success, AUC, tracked share), it is 0.
    """
    table = _tidy(runs)
    failed = (table["failure"] != "") | (table["outcome"] != "finished")
    table[FAILED] = failed.astype(float)
    for name in measures_of(table):
        if name.startswith("success_") or name in (*SCORES, "f1_auc_rotation", "tracked_share"):
            table.loc[failed & table[name].isna(), name] = 0.0
    return table


def tidy_sequences(sequences: "DataFrame") -> "DataFrame":
    """Return the table of sequences, sorted, its texts and numbers as such."""
    return _tidy(sequences)


def _tidy(given: "DataFrame") -> "DataFrame":
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
    return table.sort_values([*SEQUENCE, "system", "repeat"], kind="stable").reset_index(drop=True)


def measures_of(table: "DataFrame") -> list[str]:
    """Return the columns with measures of runs, in the table's order, `failed` first."""
    return [FAILED, *(str(name) for name in table.columns if name not in NOT_MEASURES)]


def headline_of(table: "DataFrame") -> list[str]:
    """Return the measures of HEADLINE that a table has."""
    return [name for name in HEADLINE if name in table]


def indicators_in(table: "DataFrame") -> list[str]:
    """Return the columns of a table of sequences that tell an indicator's mean over frames."""
    return [f"{name}_mean" for name in INDICATORS if f"{name}_mean" in table]


def is_share(measure: str) -> bool:
    """Tell whether a measure of a run is 0 or 1, so that its mean is a share of runs."""
    return measure == FAILED or (measure.startswith("success_") and measure != "success_auc")


def is_score(measure: str) -> bool:
    """Tell whether a measure lies between 0 and 1."""
    return is_share(measure) or measure in (*SCORES, "f1_auc_rotation", "tracked_share", "bad_pose_share")


def is_error(measure: str) -> bool:
    """Tell whether a measure is a length or an angle that is better the smaller it is: its logarithm is looked at."""
    metric = metric_of(measure)
    return metric is not None and metric.better == "lower" and metric.unit in ("m", "deg", "rad")


def worst_if_failed(table: "DataFrame", measure: str) -> "Series":
    """Return a column of errors, infinite where a run failed or has none: for ranks, which need no number."""
    return table[measure].where(table[measure].notna() & (table[FAILED] == 0.0), np.inf)


def log_of(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return natural logarithms; NaN of what is not positive."""
    out = np.full(values.shape, np.nan)
    return np.log(values, out=out, where=values > 0.0)
