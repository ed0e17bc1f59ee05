# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of lamps on what floats in the air, as nodes; `_lamp_light` says why."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..core.linear_light import LUMINANCE
from ..core.node_graphs.graph import Socket, Value
from ..core.node_graphs.groups import Canvas
from ._air_light import KNEE, LEAST
from ._block_nodes import blocks_of, gaussian
from ._halved_nodes import extra_of, halved, with_extra
from ._lamp_light import DIFFUSE, VOLUMES, WIDTHS_RAD


@dataclass(frozen=True)
class LampLight:
    """Light of lamps at each pixel. particles: of particles before it. most: the share of it that even air can have."""

    particles: Socket
    most: Socket

    def veil(self, hidden: Socket) -> Socket:
        """Return the light of even air. hidden: the share of the light behind it that it takes, up to each pixel."""
        share = hidden.graph.math("MINIMUM", hidden, self.most)
        return self.particles * hidden.graph.vector(share, share, share)


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
        small = halved(canvas, image, graph.choose(on, depth, 0.0, "float"), on)
        luminance = graph.math("MAXIMUM", graph.math("DOT_PRODUCT", small.canvas.image, LUMINANCE), 0.0)
        usual = graph.math("DOT_PRODUCT", air, LUMINANCE)
        ratio = luminance * graph.math("DIVIDE", 1.0, graph.math("MAXIMUM", usual * KNEE, LEAST))
        squared = graph.math("MULTIPLY", ratio, ratio)
        fourth = graph.math("MULTIPLY", squared, squared)
        arrives = graph.math("DIVIDE", fourth / (fourth + 1.0), graph.math("MULTIPLY_ADD", small.extra, DIFFUSE, 1.0))
        lit_up = 1.0 - graph.math("EXPONENT", small.extra * -2.0)
        bright = small.canvas.image * graph.vector(arrives, arrives, arrives)
        smaller = halved(small.canvas, bright, luminance * arrives * lit_up, on)
        blocks = blocks_of(smaller.canvas, on)
        lamps = blocks.means(smaller.canvas.image)
        lamps = with_extra(lamps * graph.vector(*[blocks.inside] * 3), extra_of(lamps) * blocks.inside)
    with graph.section("Lamps: their light around them"):
        half = graph.math("TANGENT", view_deg * (math.pi / 360))
        focal = smaller.canvas.width_px * 0.5 / half / blocks.side
        strength = graph.vector(*[given["lamps"] * scattering] * 3)
        total: Value = (0.0, 0.0, 0.0)
        of_air: Value = 0.0
        for width, volume in zip(WIDTHS_RAD, VOLUMES, strict=True):
            around = gaussian(lamps, focal * width)
            total = graph.math("MULTIPLY_ADD", around, (volume, volume, volume), total)
            of_air = graph.math("MULTIPLY_ADD", extra_of(around), volume, of_air)
        assert isinstance(total, Socket)
        assert isinstance(of_air, Socket)
        most = of_air / graph.math("MAXIMUM", graph.math("DOT_PRODUCT", total, LUMINANCE), LEAST)
        found = blocks.over(with_extra(total * strength, most), canvas.image)
        return LampLight(found, extra_of(found))
