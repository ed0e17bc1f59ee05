# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths and what belongs to them, made smooth."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float64: TypeAlias = NDArray[np.float64]


def blurred(rows: Float64, sigma: float) -> Float64:
    """(N, C) -> (N, C): each column blurred with a Gaussian of sigma rows, cut at 3 sigma; the ends are repeated."""
    reach = int(3.0 * sigma)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    padded = np.pad(rows, ((reach, reach), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, kernel, mode="valid") for column in padded.T], axis=-1)
