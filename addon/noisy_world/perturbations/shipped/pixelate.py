# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixelate: a resolution that is too low."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Graph, GroupInput, Socket, Value
from ...core.schema import key
from ...images.pixels import as_float, rgb_bytes
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes

T = TypeVar("T", bound=np.integer | np.floating)

LARGEST_BLOCK_PX = 256  # pixels whose bytes are summed in 16 bits: 256 x 255 = 65,280
# Of a byte, added to a mean so that ties round up: above float32's error, below the distance from a tie of any mean
# that is no tie.
HALF_UP = np.float32(2**-10)
# Cells along a side of a square: the Pixelate node takes a square's time for each pixel, minutes for large blocks. Of
# larger blocks the group takes this many samples along each side. Chosen.
LARGEST_SIDE = 20.0
# A number of blocks that lacks less than this counts as whole: float32 holds a factor and a product no more exactly.
WHOLE = 2**-6
# At factor 0.4 (two blocks for five pixels) the centre of a pixel lies on every other border of two blocks. There PIL,
# which adds up float steps, shows the block after the border at first, and changes between after and before at these
# borders (found by running PIL). Other factors have few such centres or none.
TURNS = (2.5, 4.5, 20.5, 74.5, 302.5, 1204.5, 4820.5)


@dataclass(frozen=True)
class Pixelate:
    """Blocks of whole pixels, each its mean: PIL's BOX down to int(size x factor), nearest at pixel centres up.

    As ImageNet-C, but means are rounded once instead of twice. Ties round up, by a thousandth of a byte on every mean.
    """

    factor: float = key("width and height of the small image, of the frame's", default=0.4, minimum=0.001, maximum=1)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "factor": "Lower: larger squares of one color",
    }


def apply(rgb: NDArray[np.float32], parameters: Pixelate, _context: FrameContext) -> NDArray[np.float32]:
    """Pixelate (H, W, 3)."""
    rows, columns = (_Blocks.along(size, parameters.factor) for size in rgb.shape[:2])
    means = _sums(rgb, rows, columns, np.float32)
    means *= _shares(rows, columns)
    means += HALF_UP / np.float32(255)
    return _spread(means, rows, columns)


def apply_bytes(rgb: NDArray[np.uint8], parameters: Pixelate, _context: FrameContext) -> NDArray[np.uint8]:
    """Pixelate (H, W, 3) bytes."""
    rows, columns = (_Blocks.along(size, parameters.factor) for size in rgb.shape[:2])
    if rows.sizes.max() * columns.sizes.max() > LARGEST_BLOCK_PX:
        return rgb_bytes(apply(as_float(rgb), parameters, _context))
    means = np.multiply(_sums(rgb, rows, columns, np.uint16), _shares(rows, columns), dtype=np.float32)
    means += np.float32(0.5) + HALF_UP
    return _spread(means.astype(np.uint8), rows, columns)


@dataclass(frozen=True, eq=False)
class _Blocks:
    """The blocks along one side of the frame.

    starts: each block's first pixel. sizes: its number of pixels. shown: the block that each pixel of the frame shows.
    """

    starts: NDArray[np.int64]
    sizes: NDArray[np.int64]
    shown: NDArray[np.int64]

    @staticmethod
    @lru_cache(maxsize=16)
    def along(pixels: int, factor: float) -> "_Blocks":
        """Divide a side into blocks: a pixel belongs to the block in which its centre lies, on a border to the first.

        Which block a pixel on a border shows is decided by TURNS, as PIL does. Always choosing one side instead would
        be 0.5 or 1.2 dB away from ImageNet-C.
        """
        blocks = max(int(pixels * factor + WHOLE), 1)
        centre = (2 * np.arange(pixels) + 1) * blocks  # unit: a block divided by 2 x pixels, so all is whole
        owner = (centre - 1) // (2 * pixels)
        border, beyond = np.divmod(centre, 2 * pixels)
        before = (beyond == 0) & (np.searchsorted(TURNS, border) % 2 == 1)
        shown = np.minimum(border - before, blocks - 1)
        return _Blocks(np.searchsorted(owner, np.arange(blocks)), np.bincount(owner), shown)


def _sums(image: NDArray[Any], rows: _Blocks, columns: _Blocks, dtype: type[T]) -> NDArray[T]:
    """Sum the pixels of each block; return the sums transposed: (columns, rows, 3)."""
    import cv2

    # numpy gathers whole rows fast, so the image is transposed before the columns are summed.
    return _row_sums(np.asarray(cv2.transpose(_row_sums(image, rows, dtype)), dtype), columns, dtype)


def _row_sums(image: NDArray[Any], blocks: _Blocks, dtype: type[T]) -> NDArray[T]:
    sums = image[blocks.starts].astype(dtype, copy=False)
    smallest = int(blocks.sizes.min())
    for position in range(1, smallest):
        np.add(sums, image[blocks.starts + position], out=sums)
    for position in range(smallest, int(blocks.sizes.max())):
        larger = np.flatnonzero(blocks.sizes > position)
        sums[larger] += image[blocks.starts[larger] + position]
    return sums


@lru_cache(maxsize=4)
def _shares(rows: _Blocks, columns: _Blocks) -> NDArray[np.float32]:
    """Return by what the sums of blocks are multiplied, (columns, rows, 1), read-only."""
    shares = (1 / np.multiply.outer(columns.sizes, rows.sizes)).astype(np.float32)[..., None]
    shares.flags.writeable = False
    return shares


def _spread(blocks: NDArray[T], rows: _Blocks, columns: _Blocks) -> NDArray[T]:
    """Show transposed blocks (columns, rows, 3) as (H, W, 3)."""
    import cv2

    return np.asarray(cv2.transpose(blocks[columns.shown]), blocks.dtype)[rows.shown]


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Copy every block into a square of equal size, average the squares with the Pixelate node, and show each block.

    A block with fewer pixels than its square has cells leaves the other cells empty; its pixels weigh more instead.
    """
    graph, scale = canvas.graph, canvas.scale
    with graph.section("Blocks"):
        size = graph.vector(canvas.width_px, canvas.height_px)
        frame = graph.math("ROUND", size / graph.vector(scale, scale, 1.0))
        blocks = graph.math("FLOOR", graph.math("MULTIPLY_ADD", frame, given["factor"], WHOLE))
        blocks = graph.math("MAXIMUM", blocks, 1.0, label="Blocks")
        grid = graph.math("MAXIMUM", frame, size, label="Pixels to divide")
        largest = graph.math("CEIL", grid / blocks)
        side = graph.math("MAXIMUM", largest.x, largest.y)
        side = graph.math("MINIMUM", side, LARGEST_SIDE, label="Side of a square")
        squares = blocks * side
    with graph.section("A square for each block"):
        blank = graph.node("CompositorNodeBlankImage", {"Size": squares}).out("Image", "color")
        cell = _flipped(_pixel(blank), squares)
        block = graph.math("FLOOR", graph.math("MULTIPLY_ADD", cell, 1.0 / side, 0.5 / side))
        border = graph.math("DIVIDE", 0.25, blocks) + 0.5
        start, past = _whole_and_rest(block, grid, blocks, border)
        pixels = graph.math("FLOOR", past + grid / blocks)
        position = cell - block * side
        filled = pixels / side
        weight = (position < pixels) / graph.math("MINIMUM", filled, 1.0)
        where = graph.math("MULTIPLY_ADD", position + 0.5, graph.math("MAXIMUM", filled, 1.0), start)
        spread = _look_up(canvas.image, where, grid, weight.x * weight.y)
    with graph.section("Means"):
        node = graph.node("CompositorNodePixelate", {"Color": spread, "Size": side})
        means = node.out("Color", "color")
    with graph.section("Show"):
        centre = canvas.position_px + 0.5
        way = _way_at_border(centre * (blocks / frame)) * graph.math("DIVIDE", 0.25, frame)
        shown = graph.math("MINIMUM", _whole_and_rest(centre, blocks, frame, way)[0], blocks - 1.0)
        return _look_up(means, graph.math("MULTIPLY_ADD", shown, side, 0.5), squares, 1.0) + float(HALF_UP / 255)


def _pixel(image: Socket) -> Socket:
    return image.graph.node("CompositorNodeImageCoordinates", {"Image": image}).out("Pixel", "vector")


def _flipped(pixel: Socket, size: Socket) -> Socket:
    """Return the pixel's position with rows counted from the top."""
    graph = pixel.graph
    return graph.math("MULTIPLY_ADD", pixel, (1.0, -1.0, 0.0), graph.vector(0.0, size.y - 1.0))


def _whole_and_rest(index: Socket, numerator: Socket, denominator: Socket, more: Socket) -> tuple[Socket, Socket]:
    """Divide index x numerator / denominator + more into a whole number and a rest from 0 to 1."""
    inputs = {"Index": index, "Numerator": numerator, "Denominator": denominator, "More": more}
    made = index.graph.group(_division(), inputs)
    return made.out("Whole", "vector"), made.out("Rest", "vector")


@cache
def _division() -> Graph:
    graph = Graph("Whole and Rest", "Divides Index x Numerator / Denominator + More into a whole number and a rest")
    index, numerator, denominator, more = (
        graph.input(GroupInput(name, "vector", (1.0, 1.0, 1.0), meaning))
        for name, meaning in (
            ("Index", "A whole or half number"),
            ("Numerator", "Of the ratio: a whole number"),
            ("Denominator", "Of the ratio: a whole number"),
            ("More", "Added to the product"),
        )
    )
    # float32 holds the ratio too coarsely for the whole part of the product to be right, so it is split in two.
    with graph.section("The ratio in two parts"):
        coarse = graph.math("FLOOR", numerator * 1024.0 / denominator) * (1 / 1024)
        fine = (numerator - coarse * denominator) / denominator
    with graph.section("Product"):
        product = index * coarse
        whole = graph.math("FLOOR", product)
        rest = graph.math("MULTIPLY_ADD", index, fine, product - whole) + more
    with graph.section("Carry over"):
        graph.output("Whole", whole + graph.math("FLOOR", rest), "vector", "A whole number")
        graph.output("Rest", graph.math("FRACTION", rest), "vector", "From 0 to 1")
    return graph


def _way_at_border(border: Socket) -> Socket:
    """Return 1 where a pixel centred on this border of blocks shows the block after it, -1 where the block before."""
    return border.graph.group(_border(), {"Border": border}).out("Way", "vector")


@cache
def _border() -> Graph:
    graph = Graph("Border of Blocks", "Tells which block a pixel shows whose centre lies on the border of two")
    border = graph.input(GroupInput("Border", "vector", (1.0, 1.0, 1.0), "The border's number"))
    first, *others = TURNS
    product = first - border
    for turn in others:
        product = product * (border - turn)
    graph.output("Way", graph.math("SIGN", product), "vector", "1: the block after the border; -1: the one before")
    return graph


def _look_up(image: Socket, position: Socket, size: Socket, weight: Value) -> Socket:
    """Return `weight` times the pixel at a position (x from the left, y from the top) of an image of this size."""
    graph = image.graph
    share = graph.math("DIVIDE", (1.0, -1.0, 0.0), size)
    uv = graph.math("MULTIPLY_ADD", position, share, graph.vector(0.0, 1.0, weight))
    inputs = {"Image": image, "UV": uv, "Interpolation": "Nearest"}
    return graph.node("CompositorNodeMapUV", inputs, label="Look up").out("Image", "color")


PERTURBATION = ColourPerturbation(
    name="pixelate",
    label="Pixelate",
    stage="post",
    order=40,
    parameters=Pixelate,
    severities={"factor": (0.6, 0.5, 0.4, 0.3, 0.25)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Turns the image into large squares",
        "blocks of pixels averaged",
        of_paper=True,
    ),
    apply=apply,
    version=2,  # float colour is rounded before it
    repeatable=True,
    nodes=Nodes(build),
    apply_bytes=apply_bytes,
)
