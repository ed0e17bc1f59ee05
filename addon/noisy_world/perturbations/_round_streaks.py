# SPDX-License-Identifier: GPL-3.0-or-later
"""The streaks of round particles on lit frames: soft and round however near, and no longer than some of their widths.

A particle out of focus is drawn as a paraboloid, 2 (1 - r^2) of its mean in its blurred disc, which is smooth at the
edge. While the shutter is open it goes along a line, so a point at y beside that line and x along it, in radii, sees
the mean over the run, of half its length h: with c^2 = 1 - y^2, a = max(x - h, -c) and b = min(x + h, c) it is
(b - a) (c^2 - (a^2 + a b + b^2) / 3) / h, the integral of the paraboloid over the chord that passed. Its mean over the
image is that of the particle's own area, so what a streak hides does not depend on blur and run.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float64: TypeAlias = NDArray[np.float64]

LEAST_ROUND_PX = 2.0  # of a particle's width as it is drawn, so that pixels sample it evenly; it is fainter instead
SHORTEST = 0.02  # of half a run, in radii, so that its quotient is exact in float32


def streak_profile(along: Float64, beside: Float64, half: float) -> Float64:
    """Return what is seen of a particle of mean 1, at places in radii. half: of its run, in radii."""
    left = np.maximum(1 - beside**2, 0)
    begin = np.maximum(along - half, -np.sqrt(left))
    end = np.maximum(np.minimum(along + half, np.sqrt(left)), begin)
    return (end - begin) * (left - (begin**2 + begin * end + end**2) / 3) / half
