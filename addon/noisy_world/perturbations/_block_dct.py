# SPDX-License-Identifier: GPL-3.0-or-later
"""The discrete cosine transform of 8 x 8 blocks as node groups, three channels at once.

The eight pixels of a run are gathered into images an eighth as long; so each coefficient is an image of its own, in
which a block is one pixel, and calculating with it costs next to nothing. The way back weighs the coefficients,
enlarged to whole blocks, with cosines. Orthonormal, as JPEG's (ITU-T T.81, A.3.3), rows and columns apart; forwards
with libjpeg's constants, so that what lies near the middle between two steps is rounded to the same one.
"""

import math
from collections.abc import Sequence

from ..core.node_graphs.graph import Graph, GroupInput, Socket, Value

SIZE = 8
RUN = range(SIZE)
# sqrt(2) cos((2k + 1) u pi / 16) in 8192ths, as libjpeg's 13-bit constants add up: a row for each u, k from 0 to 3.
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


def sample(graph: Graph, image: Socket, place: Value, interpolation: str = "Nearest") -> Socket:
    """Return the image at places (x, y, 1) from 0 to 1, its border replicated; as large as the image of places.

    What stands for the 1 weighs the result.
    """
    inputs = {"Image": image, "UV": place, "Interpolation": interpolation}
    extension = {"Extension X": "Extend", "Extension Y": "Extend"}
    return graph.node("CompositorNodeMapUV", inputs | extension).out("Image", "color")


def frequencies() -> Graph:
    """Describe the group that turns runs of eight pixels into eight images of coefficients."""
    graph = Graph("NW DCT frequencies", "The eight DCT coefficients of each run of eight pixels")
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
    """Describe the group of the cosines that coefficients 1 to 7 weigh at each pixel of a run."""
    graph = Graph("NW DCT cosines", "What each coefficient adds to the pixels of a run")
    place = graph.input(GroupInput("Place", "float", 0.0, "The pixel's number, from 0"))
    with graph.section("Angle"):
        within = graph.math("FLOORED_MODULO", place, 8.0)
        double = graph.math("COSINE", graph.math("MULTIPLY_ADD", within, math.pi / 8, math.pi / 16)) * 2.0
    with graph.section("Multiples of the angle"):
        found: list[Value] = [0.5, double * 0.25]
        for u in range(2, SIZE):
            found.append(double * found[u - 1] - found[u - 2])
    with graph.section("Three at once"):
        for name, places in BUNDLES.items():
            three = [*(found[u] for u in places), 0.0, 0.0][:3]
            graph.output(name, graph.vector(*three), "vector")
    return graph


BUNDLES = {"Cosines 1-3": (1, 2, 3), "Cosines 4-6": (4, 5, 6), "Cosine 7": (7,)}


def pixels() -> Graph:
    """Describe the group that turns eight images of coefficients into runs of eight pixels."""
    graph = Graph("NW DCT pixels", "Runs of eight pixels from their DCT coefficients")
    place = graph.input(GroupInput("Place", "vector", _NOTHING, "Where each pixel is in its image, from 0 to 1"))
    bundles = [graph.input(GroupInput(name, "vector", _NOTHING, "What the coefficients add")) for name in BUNDLES]
    given = [graph.input(GroupInput(f"{u}", "color", _BLACK, "A coefficient of each run")) for u in RUN]
    with graph.section("Whole blocks"):
        wide = [sample(graph, item, place) for item in given]
    with graph.section("Weigh"):
        weights: list[Value] = [_weight(0)]
        for bundle, places in zip(bundles, BUNDLES.values(), strict=True):
            weights += [getattr(bundle, axis) for axis, _ in zip("xyz", places, strict=False)]
        graph.output("Image", _weighted(graph, wide, weights))
    return graph
