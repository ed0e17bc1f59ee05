# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of the air before a scene as nodes: what `_air_light` calculates. Where it is not used it costs nothing."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..core.linear_light import LUMINANCE
from ..core.node_graphs.graph import Graph, Socket, Value
from ..core.node_graphs.groups import Canvas, convert
from ._air_light import KNEE, LEAST, NIGHT, WHOLE_SKY
from ._halved_nodes import halved
from ._void import SKY_M

CHANNELS = ("Red", "Green", "Blue")


@dataclass(frozen=True)
class AirSockets:
    """What the scene says of the air's light, as `AirLight`, and how the light is chosen, each 1 or 0.

    estimated: from the scene. given: as a colour, `colour`. plain: as where nothing else is known.
    """

    surfaces: Socket
    sky: Socket
    share: Socket
    estimated: Socket
    given: Socket
    plain: Socket
    colour: Socket

    def chosen(self, plain: Value, surfaces: Value, over: float = 1.0) -> Socket:
        """Return the light. plain: where it is neither estimated nor given. surfaces: in place of the surfaces' own.

        over: by how much the sky's and the given colour are divided.
        """
        graph = self.share.graph
        parts = (
            (graph.mix(surfaces, self.sky * (1 / over, 1 / over, 1 / over), _wide(self.share)), self.estimated),
            (self.colour * (1 / over, 1 / over, 1 / over), self.given),
            (plain, self.plain),
        )
        total: Value = (0.0, 0.0, 0.0)
        for light, share in parts:
            total = graph.math("MULTIPLY_ADD", light, _wide(share), total)
        assert isinstance(total, Socket)
        return total


def air_nodes(canvas: Canvas, given: Mapping[str, Socket]) -> AirSockets:
    """Return the light of the air, by the parameters `air`, `air_red`, `air_green` and `air_blue`."""
    graph, depth_m = canvas.graph, canvas.depth_m
    assert depth_m is not None
    with graph.section("The air: what is sky"):
        auto, scene, plain, colour = graph.chosen(given["air"])
        lit = canvas.lit
        estimated = scene + auto * lit
        used = estimated > 0.5
        image = graph.choose(used, canvas.image, (0.0, 0.0, 0.0, 1.0))
        sky = graph.choose(used, _sky(graph, depth_m), 0.0, "float")
        pixel = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Pixel", "vector")
        sky = graph.math("MULTIPLY_ADD", pixel.x, 0.0, sky)  # an image even where Depth is one number
        if not canvas.never_lit:  # means of sixteen pixels do as well
            small = halved(canvas, image, sky, used, times=2)
            image, sky = small.canvas.image, small.extra
        luminance = graph.math("MAXIMUM", graph.math("DOT_PRODUCT", image, LUMINANCE), 0.0)
        others = graph.math("SUBTRACT", 1.0, sky)
    surfaces, _ = _robust_mean(canvas, image, luminance, others)
    own, part = _robust_mean(canvas, image, luminance, sky)
    with graph.section("The air: its light"):
        bright = graph.math("DOT_PRODUCT", own, LUMINANCE)
        seen = graph.math("MINIMUM", part / WHOLE_SKY, 1.0)
        share = seen * bright / (bright + NIGHT)
        encoded = graph.vector(*(given[f"air_{name}"] for name in ("red", "green", "blue")))
        light = convert(graph, encoded, "sRGB", "Linear Rec.709")
        rest = plain + auto * graph.math("SUBTRACT", 1.0, lit)
        return AirSockets(surfaces, own, share, estimated, colour, rest, light)


def kept_sky(canvas: Canvas, given: Mapping[str, Socket]) -> Socket:
    """Return 0 where the sky is left as it is, else 1."""
    graph, depth_m = canvas.graph, canvas.depth_m
    assert depth_m is not None
    return graph.math("SUBTRACT", 1.0, _sky(graph, depth_m) * given["leave_sky"])


def _sky(graph: Graph, depth_m: Socket) -> Socket:
    known_m = graph.math("MAXIMUM", 0.0, depth_m)  # its first operand where the second is NaN
    return graph.math("MAXIMUM", graph.math("LESS_THAN", known_m, 1e-12), graph.math("GREATER_THAN", known_m, SKY_M))


def _robust_mean(canvas: Canvas, image: Socket, luminance: Socket, mask: Socket) -> tuple[Socket, Socket]:
    """Return the mean of the image where the mask is 1, as `robust_mean`, and the mask's share of the frame."""
    graph = canvas.graph
    with graph.section("The air: a mean that lamps hardly move"):
        part = _mean(mask, "Red")
        root = graph.math("SQRT", graph.math("SQRT", luminance))
        first = graph.math("POWER", _mean(root * mask, "Red") / graph.math("MAXIMUM", part, LEAST), 4.0)
        ratio = luminance / graph.math("MAXIMUM", first * KNEE, LEAST)
        weight = mask / (graph.math("POWER", ratio, 4.0) + 1.0)
        weighted = image * _wide(weight)
        total = graph.vector(*(_mean(weighted, name) for name in CHANNELS))
        return total / _wide(graph.math("MAXIMUM", _mean(weight, "Red"), LEAST)), part


def _mean(image: Socket, channel: str) -> Socket:
    return image.graph.node("CompositorNodeLevels", {"Image": image, "Channel": channel}).out("Mean", "float")


def _wide(value: Socket) -> Socket:
    return value.graph.vector(value, value, value)
