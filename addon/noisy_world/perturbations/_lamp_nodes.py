# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of lamps on what floats in the air, as nodes; `_lamp_light` says why."""

import math

from ..core.node_graphs.graph import Socket, Value
from ..core.node_graphs.groups import Canvas
from ._block_nodes import blocks_of, blurred
from ._lamp_light import VOLUMES, WIDTHS_RAD


def lamp_light_nodes(canvas: Canvas, view_deg: Socket, air: Socket, scattering: float) -> Socket:
    """Return the light at each pixel of what is brighter than the air's light, C / a of it; nothing where not lit.

    view_deg: horizontal field of view. scattering: C.
    """
    graph = canvas.graph
    with graph.section("Lamps: what is brighter than the air"):
        on = graph.math("GREATER_THAN", canvas.lit, 0.5)
        image = graph.choose(on, canvas.image, (0.0, 0.0, 0.0))
        bright = graph.math("MAXIMUM", graph.math("SUBTRACT", image, air), (0.0, 0.0, 0.0))
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
        return blocks.back(total)
