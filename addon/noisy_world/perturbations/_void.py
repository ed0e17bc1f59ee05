# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a depth image has no depth."""

import numpy as np
from numpy.typing import NDArray


def without_void(depth_m: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return a copy (H, W) with 0 wherever there is no depth (0, negative, infinite, no number), and where there is."""
    valid = (depth_m > 0) & (depth_m < np.inf)
    return np.where(valid, depth_m, np.float32(0)), valid
