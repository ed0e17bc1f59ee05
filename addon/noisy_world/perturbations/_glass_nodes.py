# SPDX-License-Identifier: GPL-3.0-or-later
"""A pane of glass before the lens as nodes, as `_glass` has it on arrays."""

from dataclasses import dataclass

from ..core.node_graphs.graph import Graph, Socket
from ..core.node_graphs.groups import Canvas
from ._glass import COARSEST, LEAST_BLUR_PX, PER_BLUR, SIGMA

CHANNELS = ("Red", "Green", "Blue")
_EXTEND = {"Interpolation": "Bilinear", "Extension X": "Extend", "Extension Y": "Extend"}


@dataclass(frozen=True)
class GlassNodes:
    """The glass's image. x_px, y_px: each pixel's place in the frame, at the reference width, from the upper left.

    width_px, height_px: of the frame, at the reference width. sigma_px: of the blur, in pixels of the glass's image.
    """

    x_px: Socket
    y_px: Socket
    width_px: Socket
    height_px: Socket
    sigma_px: Socket


def glass_nodes(canvas: Canvas, focus_px: Socket) -> GlassNodes:
    """Make the glass's image. focus_px: radius of its blur, at the reference width."""
    graph = canvas.graph
    width, height = canvas.width_px / canvas.scale, canvas.height_px / canvas.scale
    with graph.section("Glass"):
        # No finer than the image, where that is a small preview.
        coarse = graph.clamp(focus_px * PER_BLUR, 1.0, COARSEST)
        coarse = graph.math("MAXIMUM", coarse, 1.0 / canvas.scale)
        finer = graph.math("DIVIDE", 1.0, coarse)
        share = share_of(graph, _whole(graph.vector(width, height) * graph.vector(finer, finer)))
        x = share.x * width
        y = graph.math("MULTIPLY_ADD", share.y, height * -1.0, height)
        sigma = graph.math("MAXIMUM", focus_px, LEAST_BLUR_PX) * SIGMA / coarse
    return GlassNodes(x, y, width, height, sigma)


def share_of(graph: Graph, size_px: Socket) -> Socket:
    """Return where the pixels of a new image of a size, whole numbers, lie: from 0 to 1 along its sides."""
    blank = graph.node("CompositorNodeBlankImage", {"Size": size_px}).out("Image", "color")
    return graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Normalized", "vector")


def sampled(image: Socket, share: Socket) -> Socket:
    """Return an image at places from 0 to 1 along its sides, x and y of a vector, between its pixels."""
    where = image.graph.math("MULTIPLY_ADD", share, (1.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return image.graph.node("CompositorNodeMapUV", {"Image": image, "UV": where, **_EXTEND}).out("Image", "color")


def _whole(size_px: Socket) -> Socket:
    """Return a size in whole pixels, one at least."""
    graph = size_px.graph
    return graph.math("MAXIMUM", graph.math("FLOOR", size_px + (0.5, 0.5, 0.0)), (1.0, 1.0, 0.0))


def reduced_nodes(canvas: Canvas, times: int) -> Socket:
    """Return the image halved so many times, each pixel the mean of four."""
    graph, image = canvas.graph, canvas.image
    with graph.section("The scene, smaller"):
        size = graph.vector(canvas.width_px, canvas.height_px) / graph.vector(canvas.scale, canvas.scale, 1.0)
        for _ in range(times):
            size = _whole(size * (0.5, 0.5, 0.0))
            image = sampled(image, share_of(graph, size))
    return image


def mean_of(image: Socket) -> Socket:
    """Return the mean of an image's channels, one vector."""
    graph = image.graph
    levels = [
        graph.node("CompositorNodeLevels", {"Image": image, "Channel": name}) for name in ("Red", "Green", "Blue")
    ]
    return graph.vector(*(node.out("Mean", "float") for node in levels))


def laid_over_nodes(canvas: Canvas, glass: GlassNodes, light: Socket, cover: Socket) -> Socket:
    """Blur what is on the glass, light times cover and cover, and lay it over the image, of linear light."""
    graph = canvas.graph
    with graph.section("Blur of the glass"):
        inputs = {"Image": light, "Alpha": cover, "Type": "Replace Alpha"}
        layer = graph.node("CompositorNodeSetAlpha", inputs).out("Image", "color")
        reach = glass.sigma_px * 3.0
        inputs = {"Image": layer, "Size": graph.vector(reach, reach), "Type": "Gaussian", "Separable": True}
        blurred = graph.node("CompositorNodeBlur", inputs).out("Image", "color")
    with graph.section("Over the image"):
        share = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Normalized", "vector")
        large = sampled(blurred, share)
        alpha = graph.node("CompositorNodeSeparateColor", {"Image": large}, {"mode": "RGB"}).out("Alpha", "float")
        left = 1.0 - alpha
        return graph.math("MULTIPLY_ADD", canvas.image, graph.vector(left, left, left), large)
