# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors on the scale of logarithms, on which they are averaged: those of two rooms differ by a factor."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEAST_ERROR = 1e-9
"""In metres, degrees or radians: errors are checked to this, so a smaller one, an exact 0 too, counts as this."""


def log_errors(errors: ArrayLike) -> NDArray[np.float64]:
    """Return natural logarithms of errors, which are 0 or more; NaN stays."""
    return np.log(np.maximum(np.asarray(errors, dtype=np.float64), LEAST_ERROR))


def geometric_mean(errors: ArrayLike) -> float:
    """Return the geometric mean of errors, all alike in weight; NaN of none."""
    logs = log_errors(errors)
    return float(np.exp(logs.mean())) if logs.size else float("nan")


def geometric_deviation(errors: ArrayLike) -> float:
    """Return the factor by which errors spread, exp of the standard deviation of their logarithms; NaN below two."""
    logs = log_errors(errors)
    return float(np.exp(logs.std(ddof=1))) if logs.size > 1 else float("nan")
