# SPDX-License-Identifier: GPL-3.0-or-later
"""Finding the pixels of a depth image that have no depth (void)."""

import numpy as np
from numpy.typing import NDArray

# Farther than any surface: a renderer's Depth pass has 1e10 where it saw none.
SKY_M = 1e9


def without_void(depth_m: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return a copy (H, W) with 0 for all that is no depth (negative, infinite, NaN), and the mask (H, W) of depths."""
    valid = (depth_m > 0) & (depth_m < np.inf)
    return np.where(valid, depth_m, np.float32(0)), valid
