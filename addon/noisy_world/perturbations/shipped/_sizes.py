# SPDX-License-Identifier: GPL-3.0-or-later
"""A frame at other sizes as nodes: halved for what is blurred widely, or as at its full size in a small preview.

Previews of a reduced size: what a group does at the frame's own size, shown small, where that differs.

At the reference width, and above it, nothing is enlarged: the same nodes give the same values, and those that are for
previews get a single value, which takes no time.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ...core.node_graph import Kind, Socket
from ..groups import Canvas
from ._glass import sampled, share_of

SMALLEST = 0.999  # a scale from which on an image has the frame's own size
# How much of the slope inside an enlarged pixel is put back. Chosen: between 1, which is linear, and 2, so that a
# preview of JPEG is most like the frame, as edges are steeper than what is left of them.
SLOPE = 1.5
_EXTEND = {"Extension X": "Extend", "Extension Y": "Extend"}


@dataclass(frozen=True)
class FullSize:
    """A canvas of the frame's own size, or the group's own, and the way back.

    canvas: where a preview's image is enlarged. pixel: each of its pixels' column and row, from the lower left.
    smaller: 1 for a preview, else 0.
    """

    canvas: Canvas
    pixel: Socket
    preview: Canvas
    smaller: Socket

    def given(self, sizes_px: Socket) -> Socket:
        """Return a size in the preview's pixels in those of the frame."""
        return sizes_px * (self.canvas.scale / self.preview.scale)

    def back(self, result: Socket) -> Socket:
        """Return an image of the frame's size in the preview's: at each pixel the mean of four places in it."""
        graph = self.preview.graph
        with graph.section("Back to the preview's size"):
            kind: Kind = "float" if result.kind == "float" else "color"
            large = graph.choose(self.smaller, result, 0.0, kind)
            shown = _normalized(self.preview.image)
            middle = graph.math("ADD", graph.choose(self.smaller, shown, (0.0, 0.0, 0.0), "vector"), (0.0, 0.0, 1.0))
            size = graph.vector(self.preview.width_px, self.preview.height_px, 1.0)
            total = None
            for x, y in ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)):
                where = middle + graph.vector(x, y) / size
                part = _looked_up(large, where, "Bilinear")
                total = part if total is None else total + part
            assert total is not None
            mean = total * (0.25, 0.25, 0.25)
            return graph.choose(self.smaller, mean.x if kind == "float" else mean, result, kind)


def full_size(canvas: Canvas) -> FullSize:
    """Return the canvas of the frame's own size; the same values where the group's image has it."""
    graph = canvas.graph
    with graph.section("At the frame's own size"):
        smaller = graph.math("LESS_THAN", canvas.scale, SMALLEST, label="Is it a preview?")
        scale = graph.choose(smaller, 1.0, canvas.scale, "float")
        size = graph.vector(canvas.width_px, canvas.height_px)
        frame = graph.math("ROUND", size / graph.vector(canvas.scale, canvas.scale, 1.0))
        frame = graph.choose(smaller, frame, size, "vector")
        blank_size = graph.choose(smaller, frame, (1.0, 1.0, 0.0), "vector")
        blank = graph.node("CompositorNodeBlankImage", {"Size": blank_size}).out("Image", "color")
        image = graph.choose(smaller, _enlarged(canvas, blank, size), canvas.image)
        pixel = graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Pixel", "vector")
        from_top = graph.math("MULTIPLY_ADD", pixel, (1.0, -1.0, 0.0), graph.vector(0.0, frame.y - 1.0))
        position = graph.choose(smaller, from_top, canvas.position_px, "vector")
        own = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Pixel", "vector")
        pixel = graph.choose(smaller, pixel, own, "vector")
    full = replace(canvas, image=image, width_px=frame.x, height_px=frame.y, scale=scale, position_px=position)
    return FullSize(full, pixel, canvas, smaller)


def with_full_sizes(full: FullSize, given: Mapping[str, Socket], *names: str) -> dict[str, Socket]:
    """Return what is given, with these sizes in pixels of the frame."""
    return {name: full.given(value) if name in names else value for name, value in given.items()}


def _enlarged(canvas: Canvas, blank: Socket, size: Socket) -> Socket:
    """Return the image in the size of `blank`: each pixel with a slope from its neighbours, which keeps its mean."""
    graph = canvas.graph
    whole = size * (1.0, 1.0, 0.0)
    place = graph.math("MULTIPLY", _normalized(blank), whole)
    middle = graph.math("ADD", graph.math("FLOOR", place), (0.5, 0.5, 0.0))
    side = graph.math("ADD", size, (0.0, 0.0, 1.0))
    upright = graph.math("ADD", middle, (0.0, 0.0, 1.0)) / side
    aside = graph.math("SUBTRACT", place, middle) / side
    before, after = (_looked_up(canvas.image, where, "Bilinear") for where in (upright - aside, upright + aside))
    own = _looked_up(canvas.image, upright, "Nearest")
    # The same limit both ways, so that the mean stays: beside a lamp, dark pixels would become dark and bright halves.
    most = graph.math("ABSOLUTE", own)
    slope = graph.math("MINIMUM", (after - before) * ((SLOPE / 2,) * 3), most)
    return own + graph.math("MAXIMUM", slope, most * (-1.0, -1.0, -1.0))


def _normalized(image: Socket) -> Socket:
    """Return each pixel's place, from 0 to 1 along the sides."""
    return image.graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Normalized", "vector")


def _looked_up(image: Socket, where: Socket, interpolation: str) -> Socket:
    inputs = {"Image": image, "UV": where, "Interpolation": interpolation, **_EXTEND}
    return image.graph.node("CompositorNodeMapUV", inputs).out("Image", "color")


# Half the frame's size, for what may be softer.


@dataclass(frozen=True)
class Coarser:
    """Half the frame's size where `quick`, a bool of the group, is on, else the frame's own.

    scale: as a canvas has it. blank: an image of half the size; one pixel where that is not asked for. share: where the
    frame's pixels are, from 0 to 1 along the sides.
    """

    width_px: Socket
    height_px: Socket
    scale: Socket
    blank: Socket
    share: Socket
    quick: Socket

    def taken(self, value: Socket) -> Socket:
        """Return a number at each pixel of the frame at those of this size."""
        where = value.graph.math("ADD", _normalized(self.blank), (0.0, 0.0, 1.0))
        return value.graph.choose(self.quick, _looked_up(value, where, "Nearest").r, value, "float")

    def back(self, value: Socket) -> Socket:
        """Return a number at each pixel of this size at those of the frame, between pixels."""
        graph = value.graph
        asked = graph.choose(self.quick, value, 0.0, "float")
        return graph.choose(self.quick, sampled(asked, self.share).r, value, "float")


def coarser(canvas: Canvas, quick: Socket) -> Coarser:
    """Return half the frame's size where `quick`, a bool of the group, is on."""
    graph = canvas.graph
    with graph.section("Half the size"):
        sides = [graph.math("FLOOR", side * 0.5 + 0.5) for side in (canvas.width_px, canvas.height_px)]
        size = graph.choose(quick, graph.vector(*sides), (1.0, 1.0, 0.0), "vector")
        blank = graph.node("CompositorNodeBlankImage", {"Size": size}).out("Image", "color")
        width, height = (
            graph.choose(quick, *ends, "float") for ends in zip(sides, (canvas.width_px, canvas.height_px), strict=True)
        )
        scale = graph.choose(quick, canvas.scale * (sides[0] / canvas.width_px), canvas.scale, "float")
        return Coarser(width, height, scale, blank, _normalized(canvas.image), quick)


# A frame at half its size or less as nodes, for what is only a mean or is blurred widely: a quarter of the pixels.


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
