# SPDX-License-Identifier: GPL-3.0-or-later
"""Images of blocks as nodes: means that are blurred widely for little, and put back over the frame.

Blur repeats an image's edge, so a block of nothing is put around: what leaves the frame is gone, and none comes in.
"""

from dataclasses import dataclass

from ..core.node_graphs.graph import Graph, Socket, Value
from ..core.node_graphs.groups import Canvas

BLOCK_PX = 8  # blocks whose means are blurred
MARGIN = 3.0  # standard deviations to which light may go


@dataclass(frozen=True)
class FrameBlocks:
    """FrameBlocks over a frame. side: of one, pixels. columns, rows: with those of nothing around; 1 where not wanted.

    first: where the lower left pixel of each lies, from 0 to 1. inside: the share of each that lies in the frame.
    """

    canvas: Canvas
    on: Socket
    side: Socket
    columns: Socket
    rows: Socket
    first: Socket
    inside: Socket

    def means(self, image: Socket) -> Socket:
        """Return an image's means in the blocks' parts that lie in the frame."""
        graph = self.canvas.graph
        means = graph.node("CompositorNodePixelate", {"Color": image, "Size": self.side}).out("Color", "color")
        return looked_up(graph, means, self.first, "Nearest", "Clip")

    def back(self, means: Socket) -> Socket:
        """Return an image of the blocks over the frame, smoothly."""
        graph, side = self.canvas.graph, self.side
        blocks = graph.vector(self.columns * side, self.rows * side, 1.0)
        pixel = graph.node("CompositorNodeImageCoordinates", {"Image": self.canvas.image}).out("Pixel", "vector")
        pixel = graph.choose(self.on, pixel, (0.0, 0.0, 0.0), "vector")
        at = graph.math("DIVIDE", pixel + graph.vector(side + 0.5, side + 0.5, 1.0), blocks)
        return looked_up(graph, means, at, "Bilinear")

    def over(self, means: Socket, image: Socket) -> Socket:
        """Return an image of the blocks, with its alpha, over an image that shows what the frame does, smoothly."""
        graph, side = self.canvas.graph, self.side
        per_block = [graph.math("DIVIDE", 1.0, each * side) for each in (self.columns, self.rows)]
        scale = graph.vector(self.canvas.width_px * per_block[0], self.canvas.height_px * per_block[1])
        share = graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Normalized", "vector")
        share = graph.choose(self.on, share, (0.0, 0.0, 0.0), "vector")
        at = graph.math("MULTIPLY_ADD", share, scale, graph.vector(side * per_block[0], side * per_block[1], 1.0))
        return looked_up(graph, means, at, "Bilinear")


def blocks_of(canvas: Canvas, on: Socket) -> FrameBlocks:
    """Return the frame's blocks. on: 1 where they are wanted; otherwise they are one, and cost nothing."""
    graph = canvas.graph
    side = graph.math("MAXIMUM", graph.math("ROUND", canvas.scale * float(BLOCK_PX)), 1.0)
    columns, rows = (
        graph.math("MULTIPLY_ADD", graph.math("CEIL", each / side) + 1.0, on, 1.0)
        for each in (canvas.width_px, canvas.height_px)
    )
    blank = graph.node("CompositorNodeBlankImage", {"Size": graph.vector(columns, rows)}).out("Image", "color")
    block = graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Pixel", "vector") - (1.0, 1.0, 0.0)
    size = graph.vector(canvas.width_px, canvas.height_px, 1.0)
    sides = graph.vector(side, side, 0.0)
    first = graph.math("DIVIDE", graph.math("MULTIPLY_ADD", block, sides, (0.5, 0.5, 1.0)), size)
    # FrameBlocks that the frame's edge cuts hold as much less light.
    left = graph.math("SUBTRACT", 1.0, first) * size + (0.5, 0.5, 0.0)
    share = graph.clamp(graph.math("DIVIDE", left, sides))
    return FrameBlocks(canvas, on, side, columns, rows, first, share.x * share.y)


def blurred(image: Socket, sigma: Socket, before: Value) -> Socket:
    """Return an image, blurred by a Gaussian, added to what was before."""
    return image.graph.math("ADD", gaussian(image, sigma), before)


def gaussian(image: Socket, sigma: Socket) -> Socket:
    """Return an image, with its alpha, blurred by a Gaussian."""
    graph, reach = image.graph, sigma * MARGIN
    inputs = {"Image": image, "Size": graph.vector(reach, reach), "Type": "Gaussian", "Separable": True}
    return graph.node("CompositorNodeBlur", inputs).out("Image", "color")


def looked_up(graph: Graph, image: Socket, where: Socket, interpolation: str, beyond: str = "Extend") -> Socket:
    """Return an image's values at places from 0 to 1."""
    inputs = {"Image": image, "UV": where, "Interpolation": interpolation}
    inputs |= {"Extension X": beyond, "Extension Y": beyond}
    return graph.node("CompositorNodeMapUV", inputs).out("Image", "vector")
