# SPDX-License-Identifier: GPL-3.0-or-later
"""A pane of glass before the lens, out of focus, on arrays: what is on it is drawn smaller, blurred, and laid over.

The lens sees each pixel's point of the scene, which is in focus, through a disc of the glass. What is on the glass
therefore blurs, its outlines and what they show alike, and what is beside it stays sharp:
image * (1 - blurred cover) + blurred light.
"""

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Graph, Socket
from ...core.srgb import encoded
from ..groups import Canvas
from ._arrays import bands, gaussian, three_channels

Float32: TypeAlias = NDArray[np.float32]

COARSEST = 3.0  # pixels of the frame to one of the glass's image, at most; chosen
PER_BLUR = 0.6  # pixels of the frame to one of the glass's image, for each pixel of the blur's radius
LEAST_BLUR_PX = 1.0  # the radius that smooths outlines on a sharp glass
LEAST_COVER = 1e-4  # of a pixel: less is not seen
SIGMA = 0.5  # of a disc's radius: its standard deviation along a line


@dataclass(frozen=True)
class Pane:
    """The glass's image. x_px (w,), y_px (h,): where its pixels are in the frame, from the upper left corner.

    size_px: width and height of the frame. coarse: pixels of the frame to one of its own.
    """

    size_px: tuple[int, int]
    x_px: Float32
    y_px: Float32
    coarse: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.y_px), len(self.x_px)

    def rows(self, first: int, end: int) -> "Pane":
        """Return some of its rows."""
        return replace(self, y_px=self.y_px[first:end])


def pane(shape: tuple[int, int], focus_px: float) -> Pane:
    """Return the glass's image before a frame of (H, W), for the radius of its blur."""
    coarse = coarseness(focus_px)
    width, height = (max(1, int(side / coarse + 0.5)) for side in (shape[1], shape[0]))
    x = (np.arange(width, dtype=np.float32) + np.float32(0.5)) * np.float32(shape[1] / width)
    y = (np.arange(height, dtype=np.float32) + np.float32(0.5)) * np.float32(shape[0] / height)
    return Pane((shape[1], shape[0]), x, y, coarse)


def coarseness(focus_px: float) -> float:
    """Return how many pixels of the frame one of the glass's image stands for: what is blurred needs few."""
    return min(max(focus_px * PER_BLUR, 1.0), COARSEST)


def reduced(linear: Float32, times: int) -> Float32:
    """Return (H, W, 3) halved so many times, each pixel the mean of four."""
    import cv2

    for _ in range(times):
        size = tuple(max(1, int(side / 2 + 0.5)) for side in linear.shape[1::-1])
        linear = np.asarray(cv2.resize(linear, size, interpolation=cv2.INTER_LINEAR), np.float32)
    return linear


def shown_at(small: Float32, x_px: Float32, y_px: Float32, size_px: tuple[int, int]) -> Float32:
    """Return (N, 3): the light of a small image of the frame at N places of the frame, mirrored at its borders."""
    import cv2

    count = len(x_px)
    rows = -(-count // 256)
    maps = []
    for places, frame_px, side in zip((x_px, y_px), size_px, small.shape[1::-1], strict=True):
        table = np.zeros(rows * 256, np.float32)
        table[:count] = mirrored(places, frame_px) * np.float32(side / frame_px) - np.float32(0.5)
        maps.append(table.reshape(rows, 256))
    found = cv2.remap(small, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32).reshape(-1, 3)[:count]


def mirrored(place: Float32, length: float) -> Float32:
    """Fold positions back at both ends of [0, length]."""
    return np.float32(length) - np.abs(place % np.float32(2 * length) - np.float32(length))


def blurred(layer: Float32, glass: Pane, focus_px: float) -> Float32:
    """Blur what is on the glass, (h, w, 4): light times cover, and cover."""
    return gaussian(layer, max(focus_px, LEAST_BLUR_PX) * SIGMA / glass.coarse)


def laid_over(rgb: Float32, linear: Float32, layer: Float32) -> Float32:
    """Lay the glass's image, (h, w, 4), over a frame (H, W, 3), given encoded and as linear light; return it encoded.

    Where nothing is on the glass the frame stays as it is.
    """
    import cv2

    large = np.asarray(cv2.resize(layer, rgb.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)
    result = rgb.copy()
    for band, band_linear, band_layer in zip(bands(result), bands(linear), bands(large), strict=True):
        cover = np.ascontiguousarray(band_layer[..., 3])
        there = (cover > LEAST_COVER).astype(np.uint8)
        if there.any():
            light = np.asarray(cv2.cvtColor(band_layer, cv2.COLOR_BGRA2BGR), np.float32).reshape(band.shape)
            light += band_linear
            seen = three_channels(cover).reshape(band.shape)
            seen *= band_linear
            light -= seen
            cv2.copyTo(encoded(light), there, band)
    return result


# A pane of glass before the lens as nodes, as `_glass` has it on arrays.


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
    return sampled_at(image, image.graph.math("MULTIPLY_ADD", share, (1.0, 1.0, 0.0), (0.0, 0.0, 1.0)))


def sampled_at(image: Socket, where: Socket) -> Socket:
    """Return what `sampled` does, at places that have 1 as their third number."""
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
