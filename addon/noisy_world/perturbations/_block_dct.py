# SPDX-License-Identifier: GPL-3.0-or-later
"""The discrete cosine transform of 8 x 8 blocks as node groups, three channels at once.

The eight pixels of a run (part of a row or a column) are gathered into eight images that are an eighth as long. So each
coefficient is an image in which a block is one pixel, and calculating with it is cheap. The inverse transform gives
eight images again, which are joined at the end: looking pixels up is what takes time. The transform is orthonormal, as
JPEG's (ITU-T T.81, A.3.3), and separable: first rows, then columns. The forward transform uses libjpeg's integer
constants, so that coefficients close to a tie between two quantisation steps are rounded as libjpeg rounds them.
"""

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..core.node_graphs.graph import Graph, GroupInput, Socket, Value

SIZE = 8  # of JPEG's blocks (ITU-T T.81, A.1.1)
RUN = range(SIZE)
# sqrt(2) cos((2k + 1) u pi / 16) in 8192ths, as sums of libjpeg's 13-bit constants (jfdctint.c) give it, which differs
# from the rounded cosine by 1 at times. A row for each frequency u, k from 0 to 3.
COSINES = (
    (8192, 8192, 8192, 8192),
    (11363, 9633, 6437, 2260),
    (10703, 4433, -4433, -10703),
    (9633, -2259, -11362, -6436),
    (8192, -8192, -8192, 8192),
    (6437, -11362, 2261, 9633),
    (4433, -10704, 10704, -4433),
    (2260, -6436, 9633, -11363),
)
_NOTHING = (0.0, 0.0, 0.0)
_BLACK = (0.0, 0.0, 0.0, 1.0)


def sample(graph: Graph, image: Socket, position: Value, interpolation: str = "Nearest") -> Socket:
    """Return the image's values at `position`, an image of (x, y, weight); x and y from 0 to 1, weight 1 or a factor.

    The result is as large as `position`. The image's border is replicated.
    """
    inputs = {"Image": image, "UV": position, "Interpolation": interpolation}
    extension = {"Extension X": "Extend", "Extension Y": "Extend"}
    return graph.node("CompositorNodeMapUV", inputs | extension).out("Image", "color")


def frequencies() -> Graph:
    """Describe the group that turns runs of eight pixels into eight images of coefficients."""
    graph = Graph("DCT Frequencies", "The eight DCT coefficients of each run of eight pixels", alone=True)
    image = graph.input(GroupInput("Image", "color", _BLACK, "The pixels"))
    first = graph.input(GroupInput("First", "vector", _NOTHING, "Where each run's first pixel is, from 0 to 1"))
    step = graph.input(GroupInput("Step", "vector", _NOTHING, "From one pixel of a run to the next"))
    with graph.section("The eight pixels"):
        pixels = [sample(graph, image, graph.math("MULTIPLY_ADD", step, float(k), first)) for k in RUN]
    with graph.section("Mirrored pairs"):
        sums = [pixels[k] + pixels[7 - k] for k in range(4)]
        differences = [pixels[k] - pixels[7 - k] for k in range(4)]
    with graph.section("Cosines"):
        for u in RUN:
            weights = [cosine / 8192 / math.sqrt(SIZE) for cosine in COSINES[u]]
            graph.output(f"{u}", _weighted(graph, differences if u % 2 else sums, weights), "vector")
    return graph


def _weighted(graph: Graph, values: Sequence[Socket], weights: Sequence[Value]) -> Socket:
    total = values[0] * weights[0]
    for value, weight in zip(values[1:], weights[1:], strict=True):
        total = graph.math("MULTIPLY_ADD", value, weight, total)
    return total


@cache
def inverse() -> NDArray[np.float32]:
    """Return (8, 8): what coefficient u (column) adds to pixel k (row), each computed in single precision."""
    angle = np.arange(SIZE, dtype=np.float32) * np.float32(math.pi / 8) + np.float32(math.pi / 16)
    double = np.array([math.cos(value) for value in angle], np.float32) * np.float32(2)
    found = [np.full(SIZE, 0.5, np.float32), double * np.float32(0.25)]
    for u in range(2, SIZE):
        found.append(double * found[u - 1] - found[u - 2])  # cosines of multiples of the angle
    return np.stack([np.full(SIZE, math.sqrt(1 / 8), np.float32), *found[1:]], axis=1)


def pixels() -> Graph:
    """Describe the group that turns eight images of coefficients into eight images, one for each pixel of a run."""
    graph = Graph("DCT Pixels", "The eight pixels of each run from its DCT coefficients", alone=True)
    given = [graph.input(GroupInput(f"{u}", "color", _BLACK, "A coefficient of each run")) for u in RUN]
    with graph.section("Cosines"):
        for k in RUN:
            weights = [float(weight) for weight in inverse()[k]]
            graph.output(f"{k}", _weighted(graph, given, weights), "vector", "A pixel of each run")
    return graph


def joined(images: Sequence[Socket], places: Sequence[Socket]) -> Socket:
    """Return the one image whose pixels are taken from several: of each at its places, whose weight is 0 elsewhere."""
    graph = images[0].graph
    total: Socket | None = None
    for image, place in zip(images, places, strict=True):
        part = sample(graph, image, place)
        total = part if total is None else total + part
    assert total is not None
    return total


def places(position: Socket, along: Socket, per_part: int) -> list[Socket]:
    """Return for `joined` where an image's parts lie: each run of eight pixels is cut into parts of so many.

    position: each pixel's own column and row in the joined image. along: that of the two along which runs lie.
    """
    graph = position.graph
    normalised = graph.node("CompositorNodeImageCoordinates", {"Image": position}).out("Normalized", "vector")
    within = graph.math("FLOORED_MODULO", along, float(SIZE))
    found = []
    for first in range(0, SIZE, per_part):
        here = (within > first - 0.5) * (within < first + per_part - 0.5)
        found.append(graph.vector(normalised.x, normalised.y, here))
    return found
