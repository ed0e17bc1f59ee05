# SPDX-License-Identifier: GPL-3.0-or-later
"""The streaks of round particles on lit frames: soft and round however near, and no longer than some of their widths.

A particle out of focus is drawn as a paraboloid, 2 (1 - r^2) of its mean in its blurred disc of radius b, which is
smooth at the edge. While the shutter is open it runs a way of l: its streak is the paraboloid over an ellipse, b across
and sqrt(b^2 + l^2 / 2) along, which has the variances of what the run makes of the disc, and is as faint as it is
larger. So what a streak hides does not depend on blur and run, and its direction takes no root.
"""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float64: TypeAlias = NDArray[np.float64]

LEAST_ROUND_PX = 2.0  # of a particle's width as it is drawn, so that pixels sample it evenly; it is fainter instead
SPREAD = math.sqrt(0.5)  # of a run


def streak_profile(along: Float64, beside: Float64, run: float) -> Float64:
    """Return what is seen of a particle of mean 1, at places in radii. run: likewise."""
    squared = 1 + (SPREAD * run) ** 2
    return 2 * np.maximum(1 - along**2 / squared - beside**2, 0) / np.sqrt(squared)
