# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of runs and of sequences, as the analyses take them."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..measured import metric_of
from ..metrics import PAPER_METRICS, PAPER_PREFIX
from ..metrics.over_clean import OVER_CLEAN, OVER_CLEAN_METRICS, success_over_clean_name
from ..metrics.success import FAILED, INCOMPLETE
from .columns import Columns
from .indicators import INDICATORS
from .over_clean import CLEAN_ATE, with_over_clean
from .run_results import RESULT, with_results

if TYPE_CHECKING:
    from pandas import DataFrame

SETTING = ["setting", "perturbation", "mode", "severity"]
SEQUENCE = ["scene", "setting", "seed"]
TEXTS = ("scene", "setting", "perturbation", "mode", "system", "outcome", "failure", RESULT)
NOT_MEASURES = {*TEXTS, "severity", "seed", "repeat", "frames", FAILED, INCOMPLETE, CLEAN_ATE}
ERRORS = ("ate_rmse_m", "ate_m", "paper.ate_m")
"""The error that ranks and correlations take, the first of these that a table has: a study may be by protocol paper."""
SCORES = ("success_auc", "f1_auc")
SUCCESS = "success_10cm"
"""What counts as a success where runs are counted: an ATE below 10 cm, with enough of the frames tracked."""
SUCCESS_OVER_CLEAN = success_over_clean_name(10.0)
"""The same beside the clean error: an ATE below ten times that."""
HEADLINE = (
    FAILED,
    INCOMPLETE,
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
    """Return the table of runs, sorted, its texts and numbers as such, with columns `failed` and `incomplete`, 0 or 1.

    Where a run that failed has no value of a score between 0 and 1 that counts what was lost (success, AUC, tracked
    share), it is 0. An incomplete run has no error: it would be that of the frames that it did not give up.
    """
    table = _tidy(with_over_clean(with_results(runs)))
    failed, incomplete = table[FAILED] == 1.0, table[INCOMPLETE] == 1.0
    for name in measures_of(table):
        if is_averaged_in_logs(name):
            table = table.with_column(name, np.where(incomplete, np.nan, table[name]))
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
    """Return the columns with measures of runs, in the table's order, `failed` and `incomplete` first."""
    return [FAILED, INCOMPLETE, *(name for name in table.names if name not in NOT_MEASURES)]


def headline_of(table: Columns) -> list[str]:
    """Return the measures of HEADLINE that a table has."""
    return [name for name in HEADLINE if name in table]


def indicators_in(table: Columns) -> list[str]:
    """Return the columns of a table of sequences that tell an indicator's mean over frames."""
    return [f"{name}_mean" for name in INDICATORS if f"{name}_mean" in table]


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


def errors_of(runs: Columns) -> NDArray[np.float64]:
    """Return the ATE of runs, infinite where one failed or is incomplete; 0 for the others without any column of it."""
    name = next((name for name in ERRORS if name in runs), None)
    return np.where(runs[FAILED] + runs[INCOMPLETE] > 0.0, np.inf, 0.0) if name is None else worst_if_failed(runs, name)


def worst_if_failed(table: Columns, measure: str) -> NDArray[np.float64]:
    """Return a column of errors, infinite where a run failed or has none: for ranks, which need no number.

    An incomplete run has none, so it ranks with those that failed.
    """
    known = np.isfinite(table[measure]) & (table[FAILED] == 0.0)
    return np.where(known, table[measure], np.inf)
