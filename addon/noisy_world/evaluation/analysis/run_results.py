# SPDX-License-Identifier: GPL-3.0-or-later
"""What came of each run: failed, incomplete or complete; and which of its numbers may be averaged."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..metrics.success import COMPLETE, FAILED, INCOMPLETE, IS_INCOMPLETE, result_of

if TYPE_CHECKING:
    from pandas import DataFrame

TRACKED = ("tracked_share", "strict.tracked_share")
"""The share of the frames that a run tracked, by the name that the study's protocol gives it."""
RESULT = "result"
LEFT_OUT = (
    f"A run that {IS_INCOMPLETE} is incomplete: its errors are those of the frames that it did not give up, so they "
    "are in no mean, median or ratio."
)
"""A sentence for every table whose errors are of complete runs alone."""


def with_results(runs: "DataFrame") -> "DataFrame":
    """Return a table of runs with RESULT, and with `failed` and `incomplete`, True or False.

    A run failed where its outcome is another than finished, or its score says a word. Without a share of tracked frames
    none is incomplete.
    """
    failure, outcome = (runs[name].astype(object).fillna("").astype(str).tolist() for name in ("failure", "outcome"))
    failed = [bool(word) or ending != "finished" for word, ending in zip(failure, outcome, strict=True)]
    results = list(map(result_of, failed, tracked_shares(runs).tolist()))
    is_one = {name: np.array([result == name for result in results], dtype=bool) for name in (FAILED, INCOMPLETE)}
    return runs.assign(**{RESULT: np.array(results, dtype=object), **is_one})


def tracked_shares(runs: "DataFrame") -> NDArray[np.float64]:
    """(N,) the share of the frames that each run tracked; NaN where it is not known."""
    name = next((name for name in TRACKED if name in runs), None)
    return np.full(len(runs), np.nan) if name is None else runs[name].to_numpy(dtype=np.float64)


def complete_runs(runs: "DataFrame") -> "DataFrame":
    """Return the complete ones of a table that `with_results` gave."""
    return runs[runs[RESULT] == COMPLETE]
