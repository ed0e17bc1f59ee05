# SPDX-License-Identifier: GPL-3.0-or-later
"""The repeating tile of particles that the node groups of rain and snow look up.

Every texel holds the particle nearest to it: where it is, in units, and two numbers of its own. Streaks are put in
place by stretching the tile, as points that are independent of each other stay so when they are stretched.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from ..core.node_graphs.graph import BroughtImage
from ..core.streams import stream

UNITS = 128  # along a side, so 16,384 particles; chosen, so that a frame seldom shows one twice
TEXELS = 4  # of a unit; chosen: a texel's nearest particle is that of nearly all its points
EXCESS = 16.0  # greatest, of an exponential distribution of mean 1
_EDGE = 8 * TEXELS  # no texel's nearest particle is farther
# Particles a unit of area: where several lie in a texel, one is kept.
DENSITY = TEXELS**2 * (1 - math.exp(-1 / TEXELS**2))
LEVELS = 1024  # of the cube root of a particle's place in its shell: near a camera, area and so places grow as cubes

# Boundaries of the shells in depth, as multiples of the depth at which the mean particle spans the least angle; chosen,
# so that particles near the camera, which are large on the image, are few in theirs: where two cover a pixel, the one
# whose middle is nearer is seen. Beyond the last are 1.4 % of all.
SHELLS = (0.02, 0.35, 1.1, 2.7, 8.0)


def _tile() -> NDArray[np.float32]:
    """Return (512, 512, 3): u and v of the nearest particle, from the lower left; its level + excess / EXCESS."""
    drawn = stream("tile of falling particles")
    count = UNITS * UNITS
    points = drawn.random((count, 2)) * UNITS
    place = np.floor(np.cbrt((drawn.permutation(count) + 0.5) / count) * LEVELS)
    excess = np.minimum(drawn.standard_exponential(count), EXCESS * (1 - 1e-3))
    nearest = _nearest(points)
    found = np.empty((*nearest.shape, 3), np.float32)
    found[..., :2] = points[nearest]
    found[..., 2] = (place + excess / EXCESS)[nearest]
    return found[::-1]


def _nearest(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return (rows, columns): the number of the point nearest to each texel, across the edges; the last in a texel."""
    import cv2

    side = UNITS * TEXELS
    column, row = np.floor(points * TEXELS).astype(int).T
    number = np.full((side, side), -1)
    number[row, column] = np.arange(len(points))
    around = np.pad(number, _EDGE, mode="wrap")
    free = (around < 0).astype(np.uint8)
    _, labels = cv2.distanceTransformWithLabels(free, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    labels = np.asarray(labels, np.int64)
    by_label = np.zeros(int(labels.max()) + 1, np.int64)
    by_label[labels[free == 0]] = around[free == 0]
    return by_label[labels[_EDGE:-_EDGE, _EDGE:-_EDGE]]


TILE = BroughtImage("Falling Particles", "1", _tile)


@dataclass(frozen=True)
class Shell:
    """A range of depths.

    share: of all particles seen. middle: their mean depth, as a multiple. places: polynomial from a level, 0 to 1, to a
    multiple.
    """

    share: float
    places: tuple[float, ...]
    middle: float


@lru_cache(maxsize=1)
def shells() -> tuple[Shell, ...]:
    """Return the shells from near to far.

    Particles seen at depth x have the density x^2 e^-x / 2: area grows, and fewer are large enough.
    """
    found = []
    for low, high in pairwise(SHELLS):
        x = np.linspace(low, high, 4001)
        below = np.concatenate([[0.0], np.cumsum(np.diff(x) * _middles(x**2 * np.exp(-x) / 2))])
        quantiles = np.interp(np.linspace(0, 1, 1001), below / below[-1], x)
        fit = Polynomial.fit(np.cbrt(np.linspace(0, 1, 1001)), quantiles, 3).convert()
        found.append(Shell(float(below[-1]), tuple(float(c) for c in fit.coef), float(quantiles.mean())))
    return tuple(found)


def _middles(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return (values[1:] + values[:-1]) / 2
