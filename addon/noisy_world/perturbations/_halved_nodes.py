# SPDX-License-Identifier: GPL-3.0-or-later
"""A frame at half its size or less as nodes, for what is only a mean or is blurred widely: a quarter of the pixels."""

from dataclasses import dataclass, replace

from ..core.node_graphs.graph import Socket
from ..core.node_graphs.groups import Canvas
from ._glass_nodes import sampled, share_of


@dataclass(frozen=True)
class Halved:
    """A smaller frame. canvas: of it, with its image. extra: the number that came along."""

    canvas: Canvas
    extra: Socket


def halved(canvas: Canvas, image: Socket, extra: Socket, on: Socket, times: int = 1) -> Halved:
    """Return an image, and a number at each pixel, of half the frame's size, so many times: each the mean of four.

    on: 1 where they are wanted; otherwise they are one pixel, and cost nothing.
    """
    graph, small = canvas.graph, with_extra(image, extra)
    for _ in range(times):
        sides = [
            graph.math("MULTIPLY_ADD", graph.math("MAXIMUM", graph.math("ROUND", side * 0.5), 1.0) - 1.0, on, 1.0)
            for side in (canvas.width_px, canvas.height_px)
        ]
        small = sampled(small, share_of(graph, graph.vector(*sides)))
        canvas = replace(canvas, image=small, width_px=sides[0], height_px=sides[1], scale=canvas.scale * 0.5)
    return Halved(canvas, extra_of(small))


def with_extra(image: Socket, extra: Socket) -> Socket:
    """Return an image with a number at each pixel in the place of its alpha."""
    inputs = {"Image": image, "Alpha": extra, "Type": "Replace Alpha"}
    return image.graph.node("CompositorNodeSetAlpha", inputs).out("Image", "color")


def extra_of(image: Socket) -> Socket:
    """Return the number that `with_extra` gave an image."""
    node = image.graph.node("CompositorNodeSeparateColor", {"Image": image}, {"mode": "RGB"})
    return node.out("Alpha", "float")
