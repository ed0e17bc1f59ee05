# SPDX-License-Identifier: GPL-3.0-or-later
"""Dirt on the lens as nodes."""

import math
from collections.abc import Mapping
from typing import TypeAlias

from ..core.node_graphs.graph import Graph, Socket
from ..core.node_graphs.groups import Canvas
from ._dirt_tile import SIZE, SOFT_TILE, TEXEL_PX, TILE
from ._glare import ACROSS, ALONG, HALVINGS, PARTS
from ._glass_nodes import reduced_nodes, sampled, share_of

Given: TypeAlias = Mapping[str, Socket]


def build_dirt(canvas: Canvas, given: Given, absorbed_share: float) -> Socket:
    """Look at an image of linear light through dirt. given: a socket for each parameter of lens_dirt."""
    graph = canvas.graph
    with graph.section("Pixels"):
        share = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Normalized", "vector")
    dirt = _dirt(canvas, given["size"], share)
    with graph.section("What is lost"):
        dust = dirt.x
        absorbed = dust * (given["dust"] * absorbed_share)
        scattered = graph.math("MULTIPLY_ADD", dirt.y, given["smudges"], dust * (given["dust"] * (1 - absorbed_share)))
        scattered = graph.math("MULTIPLY_ADD", dirt.z, given["scratches"], scattered)
        scattered = graph.math("MINIMUM", scattered, 1.0 - absorbed)
    spread = _glare(canvas, given)
    with graph.section("Over the image"):
        glare = sampled(spread, share)
        lit, left = scattered * given["glare"], 1.0 - absorbed - scattered
        seen = canvas.image * graph.vector(left, left, left)
        return graph.math("MULTIPLY_ADD", glare, graph.vector(lit, lit, lit), seen)


def _dirt(canvas: Canvas, size: Socket, share: Socket) -> Socket:
    """Return dust, grease and scratches before each pixel, as `dirt_before` does."""
    graph = canvas.graph
    with graph.section("Dirt"):
        frame_px = graph.vector(canvas.width_px, canvas.height_px) / graph.vector(canvas.scale, canvas.scale, 1.0)
        shown = frame_px * (1 / (SIZE[0] * TEXEL_PX), 1 / (SIZE[1] * TEXEL_PX), 0.0) / graph.vector(size, size, 1.0)
        start, turned = canvas.random(0), canvas.random(1)
        # 1 or -1: a half of them is mirrored.
        way = graph.math(
            "MULTIPLY_ADD", graph.math("LESS_THAN", turned, (0.5, 0.5, 0.0)), (2.0, 2.0, 0.0), (-1.0, -1.0, 0.0)
        )
        # Rows are counted from the top, the picture's and the frame's shares from below.
        from_top = graph.math("MULTIPLY_ADD", share, (1.0, -1.0, 0.0), (0.0, 1.0, 0.0))
        place = graph.math("MULTIPLY_ADD", from_top, shown * way, start)
        where = graph.math("MULTIPLY_ADD", place, (1.0, -1.0, 0.0), (0.0, 0.0, 1.0))
        drawn = graph.picture(SOFT_TILE if canvas.always_lit else TILE)
        if not canvas.never_lit and not canvas.always_lit:
            drawn = graph.choose(graph.math("GREATER_THAN", canvas.lit, 0.5), graph.picture(SOFT_TILE), drawn)
        inputs = {"Image": drawn, "UV": where, "Interpolation": "Bilinear"}
        inputs |= {"Extension X": "Repeat", "Extension Y": "Repeat"}
        return graph.node("CompositorNodeMapUV", inputs).out("Image", "color")


def _glare(canvas: Canvas, given: Given) -> Socket:
    """Return the scattered light, on a smaller image, as `glare_of` does."""
    graph = canvas.graph
    small = reduced_nodes(canvas, HALVINGS)
    with graph.section("Glare"):
        reach = given["reach_px"] / canvas.scale * (0.5**HALVINGS)
        total = _streaked(graph, small, reach, given["wiped_deg"]) * graph.vector(*[given["streaks"]] * 3)
        spread = 1.0 - given["streaks"]
        for share, times in PARTS:
            part = _blurred(small, reach * times, reach * times)
            weight = spread * share
            total = graph.math("MULTIPLY_ADD", part, graph.vector(weight, weight, weight), total)
    return total


def _streaked(graph: Graph, small: Socket, reach: Socket, wiped_deg: Socket) -> Socket:
    """Return the image drawn out across the wiping: turned, blurred along its rows, turned back."""
    turn = graph.math("MULTIPLY_ADD", wiped_deg, math.pi / 180, math.pi / 2)
    cosine, sine = graph.math("COSINE", turn), graph.math("SINE", turn)
    size = graph.node("CompositorNodeImageInfo", {"Image": small}).out("Resolution", "vector")
    side = graph.math("CEIL", graph.math("LENGTH", size * (1.0, 1.0, 0.0)))
    square = graph.vector(side, side)
    aside = graph.math("MULTIPLY", share_of(graph, square) - (0.5, 0.5, 0.0), square)
    # Counted from below, a turn to the right and down is one to the right and up.
    x = graph.math("MULTIPLY_ADD", aside.x, cosine, aside.y * sine)
    y = graph.math("MULTIPLY_ADD", aside.y, cosine, aside.x * sine * -1.0)
    turned = sampled(small, graph.vector(x, y) / size + (0.5, 0.5, 0.0))
    drawn = _blurred(turned, reach * ALONG, reach * ACROSS)
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": small}).out("Normalized", "vector")
    aside = graph.math("MULTIPLY", pixel - (0.5, 0.5, 0.0), size)
    x = graph.math("MULTIPLY_ADD", aside.x, cosine, aside.y * sine * -1.0)
    y = graph.math("MULTIPLY_ADD", aside.y, cosine, aside.x * sine)
    return sampled(drawn, graph.vector(x, y) / square + (0.5, 0.5, 0.0))


def _blurred(image: Socket, across_px: Socket, up_px: Socket) -> Socket:
    size = image.graph.vector(across_px * 3.0, up_px * 3.0)
    inputs = {"Image": image, "Size": size, "Type": "Gaussian", "Separable": True}
    return image.graph.node("CompositorNodeBlur", inputs).out("Image", "color")
