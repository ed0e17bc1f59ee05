# SPDX-License-Identifier: GPL-3.0-or-later
"""The discrete cosine transform of 8 x 8 blocks as node groups, three channels at once.

The eight pixels of a run (part of a row or a column) are gathered into eight images that are an eighth as long. So each
coefficient is an image in which a block is one pixel, and calculating with it is cheap. The inverse transform enlarges
the coefficients to whole blocks and sums them, weighted by cosines. The transform is orthonormal, as JPEG's (ITU-T
T.81, A.3.3), and separable: first rows, then columns. The forward transform uses libjpeg's integer constants, so that
coefficients close to a tie between two quantisation steps are rounded as libjpeg rounds them.
"""

import math
from collections.abc import Sequence

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
    graph = Graph("DCT Frequencies", "The eight DCT coefficients of each run of eight pixels")
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


def _weight(u: int) -> float:
    return math.sqrt(1 / 8) if u == 0 else 0.5


def _weighted(graph: Graph, values: Sequence[Socket], weights: Sequence[Value]) -> Socket:
    total = values[0] * weights[0]
    for value, weight in zip(values[1:], weights[1:], strict=True):
        total = graph.math("MULTIPLY_ADD", value, weight, total)
    return total


def cosines() -> Graph:
    """Describe the group that gives the cosines by which coefficients 1 to 7 are weighted at each pixel of a run."""
    graph = Graph("DCT Cosines", "What each coefficient adds to the pixels of a run")
    position = graph.input(GroupInput("Place", "float", 0.0, "The pixel's number, from 0"))
    with graph.section("Angle"):
        within = graph.math("FLOORED_MODULO", position, 8.0)
        double = graph.math("COSINE", graph.math("MULTIPLY_ADD", within, math.pi / 8, math.pi / 16)) * 2.0
    with graph.section("Multiples of the angle"):
        found: list[Value] = [0.5, double * 0.25]
        for u in range(2, SIZE):
            found.append(double * found[u - 1] - found[u - 2])
    with graph.section("Three at once"):
        for name, positions in BUNDLES.items():
            three = [*(found[u] for u in positions), 0.0, 0.0][:3]
            graph.output(name, graph.vector(*three), "vector")
    return graph


# A socket carries three numbers, so seven cosines take three sockets; the name of each, and its coefficients.
BUNDLES = {"Cosines 1-3": (1, 2, 3), "Cosines 4-6": (4, 5, 6), "Cosine 7": (7,)}


def pixels() -> Graph:
    """Describe the group that turns eight images of coefficients into runs of eight pixels."""
    graph = Graph("DCT Pixels", "Runs of eight pixels from their DCT coefficients")
    position = graph.input(GroupInput("Place", "vector", _NOTHING, "Where each pixel is in its image, from 0 to 1"))
    bundles = [graph.input(GroupInput(name, "vector", _NOTHING, "What the coefficients add")) for name in BUNDLES]
    given = [graph.input(GroupInput(f"{u}", "color", _BLACK, "A coefficient of each run")) for u in RUN]
    with graph.section("Whole blocks"):
        wide = [sample(graph, item, position) for item in given]
    with graph.section("Weigh"):
        weights: list[Value] = [_weight(0)]
        for bundle, positions in zip(bundles, BUNDLES.values(), strict=True):
            weights += [getattr(bundle, axis) for axis, _ in zip("xyz", positions, strict=False)]
        graph.output("Image", _weighted(graph, wide, weights))
    return graph
