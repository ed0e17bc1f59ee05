# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of lamps on what floats in the air, as nodes; `_lamp_light` says why."""

import math
from collections.abc import Mapping

from ..core.node_graphs.graph import Socket, Value
from ..core.node_graphs.groups import Canvas
from ._block_nodes import blocks_of, blurred
from ._lamp_light import DIFFUSE, VOLUMES, WIDTHS_RAD


def lamp_light_nodes(
    canvas: Canvas, given: Mapping[str, Socket], air: Socket, scattering: float, depth: Value = 0.0
) -> Socket:
    """Return the light at each pixel of what is brighter than the air's light, C / a of it; nothing where not lit.

    given: the parameters `lamps` and `view_deg`. scattering: C. depth: optical, of the air before each pixel.
    """
    graph, view_deg = canvas.graph, given["view_deg"]
    with graph.section("Lamps: what is brighter than the air"):
        on = graph.math("MULTIPLY", graph.math("GREATER_THAN", canvas.lit, 0.5), given["lamps"] > 0.0)
        image = graph.choose(on, canvas.image, (0.0, 0.0, 0.0))
        bright = graph.math("MAXIMUM", graph.math("SUBTRACT", image, air), (0.0, 0.0, 0.0))
        if isinstance(depth, Socket):
            arrives = graph.math("DIVIDE", 1.0, graph.math("MULTIPLY_ADD", depth, DIFFUSE, 1.0))
            bright = bright * graph.vector(arrives, arrives, arrives)
        bright = graph.choose(on, bright, (0.0, 0.0, 0.0))
        blocks = blocks_of(canvas, on)
        lamps = blocks.means(bright) * graph.vector(*[blocks.inside] * 3)
    with graph.section("Lamps: their light around them"):
        half = graph.math("TANGENT", view_deg * (math.pi / 360))
        focal = canvas.width_px * 0.5 / half / blocks.side
        total: Value = (0.0, 0.0, 0.0)
        for width, volume in zip(WIDTHS_RAD, VOLUMES, strict=True):
            share = volume * scattering
            total = blurred(lamps * (share, share, share), focal * width, total)
        assert isinstance(total, Socket)
        return blocks.back(total) * graph.vector(*[given["lamps"]] * 3)
