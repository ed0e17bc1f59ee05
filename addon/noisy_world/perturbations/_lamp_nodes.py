# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of lamps on what floats in the air, as nodes; `_lamp_light` says why."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..core.linear_light import LUMINANCE
from ..core.node_graphs.graph import Socket, Value
from ..core.node_graphs.groups import Canvas
from ._air_light import KNEE, LEAST
from ._block_nodes import blocks_of, blurred
from ._lamp_light import DIFFUSE, VOLUMES, WIDTHS_RAD


@dataclass(frozen=True)
class LampLight:
    """Light of lamps at each pixel. particles: of particles before it. air: the most that even air can have of it."""

    particles: Socket
    air: Socket

    def veil(self, hidden: Socket) -> Socket:
        """Return the light of even air. hidden: the share of the light behind it that it takes, up to each pixel."""
        return hidden.graph.math("MINIMUM", self.particles * hidden.graph.vector(hidden, hidden, hidden), self.air)


def lamp_light_nodes(
    canvas: Canvas, given: Mapping[str, Socket], air: Socket, scattering: float, depth: Socket
) -> LampLight:
    """Return the light at each pixel of what outshines the air's light, C / a of it; nothing where not lit.

    air: its light, which makes a lamp of what `_air_light` weighs little. given: the parameters `lamps` and `view_deg`.
    scattering: C. depth: optical, of the even air before each pixel.
    """
    graph, view_deg = canvas.graph, given["view_deg"]
    with graph.section("Lamps: what outshines the air"):
        on = graph.math("MULTIPLY", graph.math("GREATER_THAN", canvas.lit, 0.5), given["lamps"] > 0.0)
        image = graph.choose(on, canvas.image, (0.0, 0.0, 0.0))
        luminance = graph.math("MAXIMUM", graph.math("DOT_PRODUCT", image, LUMINANCE), 0.0)
        usual = graph.math("DOT_PRODUCT", air, LUMINANCE)
        ratio = luminance / graph.math("MAXIMUM", usual * KNEE, LEAST)
        weight = graph.math("DIVIDE", 1.0, graph.math("POWER", ratio, 4.0) + 1.0)
        share = graph.choose(on, 1.0 - weight, 0.0, "float")
        bright = image * graph.vector(share, share, share)
        arrives = graph.math("DIVIDE", 1.0, graph.math("MULTIPLY_ADD", depth, DIFFUSE, 1.0))
        bright = graph.choose(on, bright * graph.vector(arrives, arrives, arrives), (0.0, 0.0, 0.0))
        lit_up = 1.0 - graph.math("EXPONENT", graph.choose(on, depth, 0.0, "float") * -2.0)
        through_air = bright * graph.vector(lit_up, lit_up, lit_up)
        blocks = blocks_of(canvas, on)
        inside = graph.vector(*[blocks.inside] * 3)
        lamps, of_air = (blocks.means(image) * inside for image in (bright, through_air))
    with graph.section("Lamps: their light around them"):
        half = graph.math("TANGENT", view_deg * (math.pi / 360))
        focal = canvas.width_px * 0.5 / half / blocks.side
        strength = graph.vector(*[given["lamps"] * scattering] * 3)
        around = []
        for image in (lamps, of_air):
            total: Value = (0.0, 0.0, 0.0)
            for width, volume in zip(WIDTHS_RAD, VOLUMES, strict=True):
                total = blurred(image * (volume, volume, volume), focal * width, total)
            assert isinstance(total, Socket)
            around.append(blocks.back(total) * strength)
        return LampLight(around[0], around[1])
