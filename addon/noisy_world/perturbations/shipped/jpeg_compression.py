# SPDX-License-Identifier: GPL-3.0-or-later
"""JPEG compression: blocks, ringing and smeared colours."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Graph, GroupInput, Socket, Value
from ...core.schema import key
from ...images.pixels import as_float, rgb_bytes
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._sizes import full_size

# The discrete cosine transform of 8 x 8 blocks as node groups, three channels at once.
#
# The eight pixels of a run (part of a row or a column) are gathered into eight images that are an eighth as long. So
# each coefficient is an image in which a block is one pixel, and calculating with it is cheap. The inverse transform
# gives eight images again, which are joined at the end: looking pixels up is what takes time. The transform is
# orthonormal, as JPEG's (ITU-T T.81, A.3.3), and separable: first rows, then columns. The forward transform uses
# libjpeg's integer constants, so that coefficients close to a tie between two quantisation steps are rounded as
# libjpeg rounds them.


SIZE = 8  # of JPEG's blocks (ITU-T T.81, A.1.1)
RUN = range(SIZE)
# sqrt(2) cos((2k + 1) u pi / 16) in 8192ths, as sums of libjpeg's 13-bit constants (jfdctint.c) give it, which differs
# from the rounded cosine by 1 at times. A row for each frequency u, k from 0 to 3.
COSINES = (
    (8192, 8192, 8192, 8192),
    (11363, 9633, 6437, 2260),
    (10703, 4433, -4433, -10703),
    (9633, -2259, -11362, -6436),
    (8192, -8192, -8192, 8192),
    (6437, -11362, 2261, 9633),
    (4433, -10704, 10704, -4433),
    (2260, -6436, 9633, -11363),
)
_NOTHING = (0.0, 0.0, 0.0)
_BLACK = (0.0, 0.0, 0.0, 1.0)


def sample(graph: Graph, image: Socket, position: Value, interpolation: str = "Nearest") -> Socket:
    """Return the image's values at `position`, an image of (x, y, weight); x and y from 0 to 1, weight 1 or a factor.

    The result is as large as `position`. The image's border is replicated.
    """
    inputs = {"Image": image, "UV": position, "Interpolation": interpolation}
    extension = {"Extension X": "Extend", "Extension Y": "Extend"}
    return graph.node("CompositorNodeMapUV", inputs | extension).out("Image", "color")


def frequencies() -> Graph:
    """Describe the group that turns runs of eight pixels into eight images of coefficients."""
    graph = Graph("DCT Frequencies", "The eight DCT coefficients of each run of eight pixels", alone=True)
    image = graph.input(GroupInput("Image", "color", _BLACK, "The pixels"))
    first = graph.input(GroupInput("First", "vector", _NOTHING, "Where each run's first pixel is, from 0 to 1"))
    step = graph.input(GroupInput("Step", "vector", _NOTHING, "From one pixel of a run to the next"))
    with graph.section("The eight pixels"):
        pixels = [sample(graph, image, graph.math("MULTIPLY_ADD", step, float(k), first)) for k in RUN]
    with graph.section("Mirrored pairs"):
        sums = [pixels[k] + pixels[7 - k] for k in range(4)]
        differences = [pixels[k] - pixels[7 - k] for k in range(4)]
    with graph.section("Cosines"):
        for u in RUN:
            weights = [cosine / 8192 / math.sqrt(SIZE) for cosine in COSINES[u]]
            graph.output(f"{u}", _weighted(graph, differences if u % 2 else sums, weights), "vector")
    return graph


def _weighted(graph: Graph, values: Sequence[Socket], weights: Sequence[Value]) -> Socket:
    total = values[0] * weights[0]
    for value, weight in zip(values[1:], weights[1:], strict=True):
        total = graph.math("MULTIPLY_ADD", value, weight, total)
    return total


@cache
def inverse() -> NDArray[np.float32]:
    """Return (8, 8): what coefficient u (column) adds to pixel k (row), each computed in single precision."""
    angle = np.arange(SIZE, dtype=np.float32) * np.float32(math.pi / 8) + np.float32(math.pi / 16)
    double = np.array([math.cos(value) for value in angle], np.float32) * np.float32(2)
    found = [np.full(SIZE, 0.5, np.float32), double * np.float32(0.25)]
    for u in range(2, SIZE):
        found.append(double * found[u - 1] - found[u - 2])  # cosines of multiples of the angle
    return np.stack([np.full(SIZE, math.sqrt(1 / 8), np.float32), *found[1:]], axis=1)


def pixels() -> Graph:
    """Describe the group that turns eight images of coefficients into eight images, one for each pixel of a run."""
    graph = Graph("DCT Pixels", "The eight pixels of each run from its DCT coefficients", alone=True)
    given = [graph.input(GroupInput(f"{u}", "vector", _NOTHING, "A coefficient of each run")) for u in RUN]
    with graph.section("Cosines"):
        for k in RUN:
            weights = [float(weight) for weight in inverse()[k]]
            graph.output(f"{k}", _weighted(graph, given, weights), "vector", "A pixel of each run")
    return graph


def interleaved(images: Sequence[Socket], size: Socket, axis: Literal["x", "y"]) -> Socket:
    """Return the one image of a size in which runs of pixels along an axis come from so many images, one from each.

    Two halves are joined, each made alike of every second image: that looks up fewer pixels than all at once.
    """
    if len(images) == 1:
        return images[0]
    graph = size.graph
    short = size * ((0.5, 1.0, 1.0) if axis == "x" else (1.0, 0.5, 1.0))
    halves = [interleaved(images[first::2], short, axis) for first in range(2)]
    position = _positions(size, "Runs")
    odd = graph.math("FLOORED_MODULO", getattr(position, axis), 2.0)
    place = graph.node("CompositorNodeImageCoordinates", {"Image": position}).out("Normalized", "vector")
    first, second = (sample(graph, half, graph.math("ADD", place, (0.0, 0.0, 1.0))) for half in halves)
    inputs = {"Factor_Float": odd, "A_Color": first, "B_Color": second}
    return graph.node("ShaderNodeMix", inputs, {"data_type": "RGBA"}).out("Result_Color", "color")


def joined(images: Sequence[Socket], places: Sequence[Socket]) -> Socket:
    """Return the one image whose pixels are taken from several: of each at its places, whose weight is 0 elsewhere."""
    graph = images[0].graph
    total: Socket | None = None
    for image, place in zip(images, places, strict=True):
        part = sample(graph, image, place)
        total = part if total is None else total + part
    assert total is not None
    return total


def places(position: Socket, along: Socket, per_part: int) -> list[Socket]:
    """Return for `joined` where an image's parts lie: each run of eight pixels is cut into parts of so many.

    position: each pixel's own column and row in the joined image. along: that of the two along which runs lie.
    """
    graph = position.graph
    normalised = graph.node("CompositorNodeImageCoordinates", {"Image": position}).out("Normalized", "vector")
    within = graph.math("FLOORED_MODULO", along, float(SIZE))
    found = []
    for first in range(0, SIZE, per_part):
        here = (within > first - 0.5) * (within < first + per_part - 0.5)
        found.append(graph.vector(normalised.x, normalised.y, here))
    return found


# What encoding to JPEG and decoding again do to an image, as nodes.
#
# This follows ITU-T T.81 and JFIF 1.02, and libjpeg where these leave a choice: every step rounds as libjpeg's
# default ("slow integer") transforms do. Two differences are left: single precision rounds a tie the other way now
# and then, and libjpeg enlarges the chroma of frames less than five pixels wide without interpolation.
#
# The work is done on three planes, the channels of one image: the upper half of luma, its lower half, and both
# chromas at half size side by side. The planes have equal sizes, so each node works on all three. Their rows are
# counted downwards, as JPEG counts blocks; Blender counts the rows of images upwards.


# ITU-T T.81, tables K.1 and K.2, which libjpeg uses unscaled at quality 50: a row for each vertical frequency.
LUMA = (
    (16, 11, 10, 16, 24, 40, 51, 61),
    (12, 12, 14, 19, 26, 58, 60, 55),
    (14, 13, 16, 24, 40, 57, 69, 56),
    (14, 17, 22, 29, 51, 87, 80, 62),
    (18, 22, 37, 56, 68, 109, 103, 77),
    (24, 35, 55, 64, 81, 104, 113, 92),
    (49, 64, 78, 87, 103, 121, 120, 101),
    (72, 92, 95, 98, 112, 100, 103, 99),
)
CHROMA = (
    (17, 18, 24, 47, 99, 99, 99, 99),
    (18, 21, 26, 66, 99, 99, 99, 99),
    (24, 26, 56, 99, 99, 99, 99, 99),
    (47, 66, 99, 99, 99, 99, 99, 99),
    *(((99,) * 8),) * 4,
)
CENTRE = 128.0  # subtracted from a byte before the transform (T.81, A.3.1)
# libjpeg rounds a tie between two quantisation steps away from zero. Coefficients are multiples of 1/8, 1024 at most:
# this factor moves a tie beyond float32's resolution, and nothing by more than 0.02.
AWAY_FROM_ZERO = 1 + 2e-5
# libjpeg keeps 2 fractional bits (PASS1_BITS) between rows and columns, of values sqrt(8) times the orthonormal ones.
BETWEEN_PASSES = 1 / (4 * math.sqrt(8))
PIXEL_CENTRE = (0.5, 0.5, 1.0)  # added to (column, row, 0): the position of the pixel's centre
TOP = (0.0, 1.0, 0.0)  # the unit vector from row to row
PACKED = 3  # bytes that float32 holds exactly as one number, so that one look-up fetches so many pixels


def compressed(canvas: Canvas, quality: Socket) -> Socket:
    """Return the canvas's image after JPEG at libjpeg's `quality`, 4:2:0."""
    with canvas.graph.section("Sizes"):
        frame = _frame(canvas)
    with canvas.graph.section("Bytes of YCbCr in three planes"):
        position = _positions(frame.planes, "Planes")
        planes = _planes(frame, _ycc(canvas), position)
    decoded = _decoded(frame, planes, position, quality, canvas.white)
    with canvas.graph.section("Back to RGB"):
        return _rgb(canvas, frame, decoded)


@dataclass(frozen=True)
class _JpegFrame:
    """The sizes that the compression works with: (width, height, 1) in pixels.

    scale: pixels of the image per pixel of the frame, 1 at most. frame: the image that is compressed. planes: one of
    the three planes, whole blocks. chroma: the frame's chroma, half its size.
    """

    scale: Socket
    frame: Socket
    planes: Socket
    chroma: Socket


def _frame(canvas: Canvas) -> _JpegFrame:
    graph = canvas.graph
    scale = graph.math("MINIMUM", canvas.scale, 1.0, label="No block larger than 8 pixels")
    size = graph.math("ROUND", graph.vector(canvas.width_px, canvas.height_px) / scale)
    blocks, pairs = graph.math("CEIL", size / 16.0), graph.math("CEIL", size / 2.0)
    frame = graph.math("ADD", size, (0.0, 0.0, 1.0), label="Frame")
    planes = graph.math("MULTIPLY_ADD", blocks, (16.0, 8.0, 0.0), (0.0, 0.0, 1.0), label="Planes")
    return _JpegFrame(scale, frame, planes, graph.math("ADD", pairs, (0.0, 0.0, 1.0), label="Chroma"))


def _positions(size: Socket, label: str) -> Socket:
    """Return an image of this size, each pixel of which holds its own column, its row and 0."""
    blank = size.graph.node("CompositorNodeBlankImage", {"Size": size}, label=label).out("Image", "color")
    return size.graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Pixel", "vector")


def _ycc(canvas: Canvas) -> Socket:
    """Return bytes of Y, Cb and Cr (JFIF: ITU-R BT.601, full range)."""
    graph = canvas.graph
    levels = graph.math("FLOOR", graph.math("MULTIPLY_ADD", canvas.image, 255.0, 0.5), label="Bytes")
    # As libjpeg (jccolor.c): ties of luma are rounded up, those of chroma down, by (2^15 - 1) / 2^16.
    ycc: Value = _fixed(0.5, CENTRE + 0.499985, CENTRE + 0.499985)
    ycc = graph.math("MULTIPLY_ADD", levels.r, _fixed(0.299, -0.16874, 0.5), ycc)
    ycc = graph.math("MULTIPLY_ADD", levels.g, _fixed(0.587, -0.33126, -0.41869), ycc)
    ycc = graph.math("MULTIPLY_ADD", levels.b, _fixed(0.114, 0.5, -0.08131), ycc)
    return graph.math("FLOOR", ycc, label="Y, Cb, Cr")


def _fixed(*values: float) -> tuple[float, ...]:
    """Return the values as libjpeg's fixed-point numbers of 16 fractional bits hold them."""
    return tuple(round(value * 65536) / 65536 for value in values)


def _planes(frame: _JpegFrame, ycc: Socket, position: Socket) -> Socket:
    """Return the three planes minus CENTRE. The frame's border is replicated, as libjpeg does."""
    graph = ycc.graph
    per_pixel = graph.math("DIVIDE", (1.0, -1.0, 1.0), frame.frame)
    upper = graph.math("MULTIPLY_ADD", position + PIXEL_CENTRE, per_pixel, TOP)
    lower = upper - frame.planes * TOP / frame.frame
    upper_luma, lower_luma = (sample(graph, ycc, where).r for where in (upper, lower))

    half = frame.planes * (0.5, 0.0, 0.0)
    is_red = position.x > half.x - 0.5
    pair = position - half * graph.vector(is_red, is_red, is_red)
    last = graph.math("MULTIPLY_ADD", frame.chroma, TOP, (1e6, -1.0, 0.0), label="Last row")
    corner = graph.math("MULTIPLY_ADD", graph.math("MINIMUM", pair, last), 2.0, 1.0, label="Between four pixels")
    mean = sample(graph, ycc, graph.math("MULTIPLY_ADD", corner, per_pixel, TOP), "Bilinear")
    # libjpeg adds 1/4 and 1/2 in turns before it rounds the mean of four down (h2v2_downsample). Means are multiples of
    # 1/4; the further 1/8 keeps them clear of whole numbers, where float32 might fall to either side.
    is_odd = graph.math("FLOORED_MODULO", pair.x, 2.0)
    rounding = graph.math("MULTIPLY_ADD", is_odd, 0.25, 0.25 + 0.125)
    chroma = graph.mix(mean.g, mean.b, is_red) + rounding
    return graph.math("FLOOR", graph.vector(upper_luma, lower_luma, chroma)) - CENTRE


def _decoded(frame: _JpegFrame, planes: Socket, position: Socket, quality: Socket, white: Socket | float) -> Socket:
    """Transform the planes, quantise the coefficients, transform back; return the planes as whole numbers 0 to 255.

    Where `white` is above 1, they go as far beyond both ends: the code is that of T.81 for samples of more bits.
    """
    graph = planes.graph
    with graph.section("Rows to frequencies"):
        starts = _positions(frame.planes * (1 / 8, 1.0, 1.0), "Runs of a row")
        first = graph.math("MULTIPLY_ADD", starts, (8.0, 1.0, 1.0), PIXEL_CENTRE) / frame.planes
        inputs = {"Image": planes, "First": first, "Step": graph.math("DIVIDE", (1.0, 0.0, 0.0), frame.planes)}
        rows = graph.group(frequencies(), inputs, name="Rows to frequencies")
    with graph.section("Columns of coefficients"):
        runs = frame.planes * (1 / 8, 1.0, 1.0)
        starts = _positions(frame.planes * (1 / 8, 1 / 8, 1.0), "Blocks")
        shared = {
            "First": graph.math("MULTIPLY_ADD", starts, (1.0, 8.0, 1.0), PIXEL_CENTRE) / runs,
            "Step": graph.math("DIVIDE", TOP, runs),
            "Percent": _percent(quality),
        }
        column, columns = _column(), []
        for u in RUN:
            entries = {f"Entry {v}": (LUMA[v][u], LUMA[v][u], CHROMA[v][u]) for v in RUN}
            inputs = {"Image": rows.out(f"{u}", "vector")} | entries | shared
            columns.append(graph.group(column, inputs, name=f"Horizontal frequency {u}"))
    packed = 1 if isinstance(white, Socket) else PACKED
    with graph.section("Frequencies to rows"):
        limits = {"Lowest": (1.0 - white) * 255.0, "Highest": white * 255.0}
        row, made = _row(packed), []
        for y in RUN:
            inputs = {f"{u}": columns[u].out(f"{y}", "vector") for u in RUN}
            made.append(graph.group(row, inputs | limits, name=f"Row {y} of the blocks"))
    with graph.section("Rows of the blocks"):
        parts = [
            interleaved([item.out(f"{part}", "vector") for item in made], runs, "y")
            for part in range(-(-SIZE // packed))
        ]
    with graph.section("Pixels of the rows"):
        if packed == 1:
            return interleaved(parts, frame.planes, "x")
        whole = joined(parts, places(position, position.x, packed))
        return _unpacked(whole, position.x)


def _row(packed: int) -> Graph:
    """Describe the group that makes one row of every block: so many pixels side by side to a number."""
    graph = Graph("JPEG Row", "One row of every block from its horizontal frequencies, rounded to whole numbers")
    given = {f"{u}": graph.input(GroupInput(f"{u}", "vector", _NOTHING, "A horizontal frequency")) for u in RUN}
    lowest = graph.input(GroupInput("Lowest", "float", 0.0, "The least value"))
    highest = graph.input(GroupInput("Highest", "float", 255.0, "The greatest value"))
    with graph.section("Frequencies to pixels"):
        values = graph.group(pixels(), given)
    with graph.section("Round"):
        thrice = [graph.vector(bound, bound, bound) for bound in (lowest, highest)]
        rounded = [
            graph.clamp(graph.math("FLOOR", values.out(f"{k}", "vector") + (CENTRE + 0.5)), *thrice) for k in RUN
        ]
    with graph.section("Pack"):
        for part, first in enumerate(range(0, SIZE, packed)):
            total = rounded[first]
            for place, value in enumerate(rounded[first + 1 : first + packed], start=1):
                total = graph.math("MULTIPLY_ADD", value, 256.0**place, total)
            graph.output(f"{part}", total, "vector", "Pixels side by side, the first in the lowest byte")
    return graph


def _unpacked(packed: Socket, column: Socket) -> Socket:
    """Return the byte of each pixel out of the number of those side by side. column: the pixel's."""
    graph = packed.graph
    within = graph.math("FLOORED_MODULO", graph.math("FLOORED_MODULO", column, float(SIZE)), float(PACKED))
    share = 1.0 - (within > 0.5) * (1 - 2.0**-8) - (within > 1.5) * (2.0**-8 - 2.0**-16)
    lowest = graph.math("FLOOR", packed * graph.vector(share, share, share))
    return lowest - graph.math("FLOOR", lowest * 2.0**-8) * 256.0


def _percent(quality: Socket) -> Socket:
    """Return libjpeg's scale of the tables in percent (jpeg_quality_scaling)."""
    graph = quality.graph
    coarse, fine = graph.math("FLOOR", 5000.0 / quality), 200.0 - 2.0 * quality
    return graph.mix(fine, coarse, graph.math("LESS_THAN", quality, 50.0))


def _column() -> Graph:
    """Describe the group that quantises one horizontal frequency, which is one column of the tables."""
    graph = Graph("JPEG Column", "One horizontal frequency, quantised at its eight vertical frequencies")
    nothing = (0.0, 0.0, 0.0)
    image = graph.input(GroupInput("Image", "color", (*nothing, 1.0), "Its coefficient of each row of eight pixels"))
    first = graph.input(GroupInput("First", "vector", nothing, "Where each block's first row is, from 0 to 1"))
    step = graph.input(GroupInput("Step", "vector", nothing, "From one row of a block to the next"))
    percent = graph.input(GroupInput("Percent", "float", 100.0, "How coarse: 100 is quality 50"))
    meaning = "The tables' entry at quality 50: luma, luma, chroma"
    entries = [graph.input(GroupInput(f"Entry {v}", "vector", (16.0, 16.0, 17.0), meaning)) for v in RUN]
    with graph.section("Columns to frequencies"):
        split = graph.group(frequencies(), {"Image": _between_passes(image), "First": first, "Step": step})
    with graph.section("Quantise"):
        quantise, rounded = _quantise(), {}
        for v in RUN:
            inputs = {"Coefficient": split.out(f"{v}", "vector"), "Entry": entries[v], "Percent": percent}
            rounded[f"{v}"] = graph.group(quantise, inputs).out("Coefficient", "vector")
    with graph.section("Frequencies to columns"):
        made = graph.group(pixels(), rounded)
        for y in RUN:
            graph.output(f"{y}", _between_passes(made.out(f"{y}", "vector")), "vector", "A row of every block")
    return graph


def _between_passes(image: Socket) -> Socket:
    """Round to BETWEEN_PASSES, as libjpeg's transforms do between rows and columns."""
    return image.graph.math("SNAP", image + BETWEEN_PASSES / 2, BETWEEN_PASSES)


def _quantise() -> Graph:
    """Describe the group that rounds a coefficient of every block to a multiple of the table's entry."""
    graph = Graph("JPEG Quantize", "A coefficient of every block, rounded to a multiple of its step")
    value = graph.input(GroupInput("Coefficient", "vector", (0.0, 0.0, 0.0), "Of every block"))
    entry = graph.input(GroupInput("Entry", "vector", (16.0, 16.0, 17.0), "The tables' entry at quality 50"))
    percent = graph.input(GroupInput("Percent", "float", 100.0, "How coarse: 100 is quality 50"))
    with graph.section("Step"):
        scaled = graph.math("FLOOR", graph.math("MULTIPLY_ADD", entry, percent, 50.0) / 100.0)
        step = graph.clamp(scaled, 1.0, 255.0)
    with graph.section("Round"):
        eighths = graph.math("SNAP", value + 1 / 16, 1 / 8, label="libjpeg's precision")
        nearest = graph.math("MULTIPLY_ADD", eighths, AWAY_FROM_ZERO, step * 0.5)
        graph.output("Coefficient", graph.math("SNAP", nearest, step), "vector")
    return graph


def _rgb(canvas: Canvas, frame: _JpegFrame, decoded: Socket) -> Socket:
    """Unpack the planes, enlarge the chroma as libjpeg does, and convert (JFIF)."""
    graph = canvas.graph
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Pixel", "vector")
    corner = graph.vector(0.5, canvas.height_px - 0.5, frame.scale)
    centre = graph.math("MULTIPLY_ADD", pixel, (1.0, -1.0, 0.0), corner) / frame.scale
    where = centre / frame.planes
    is_lower = graph.math("FLOOR", where.y)
    halves = sample(graph, decoded, where - graph.vector(0.0, is_lower), "Bilinear")
    luma = graph.mix(halves.r, halves.g, is_lower)

    blue = (_positions(frame.chroma, "Chroma") + PIXEL_CENTRE) / frame.planes
    red = blue + (0.5, 0.0, 0.0)
    small = graph.vector(*(sample(graph, decoded, half).b for half in (blue, red)))
    wide = sample(graph, small, centre / (frame.chroma * (2.0, 2.0, 1.0)), "Bilinear")
    # libjpeg adds 8/16 and 7/16 in turns before it rounds the weighted mean down (h2v2_fancy_upsample). Means are
    # multiples of 1/16; the further 1/32 keeps them clear of whole numbers, where float32 might fall to either side.
    is_odd = graph.math("FLOORED_MODULO", pixel.x, 2.0)
    rounding = graph.math("MULTIPLY_ADD", is_odd, -1 / 16, 0.5 + 1 / 32)
    chroma = graph.math("FLOOR", wide + rounding) - CENTRE
    rgb = graph.math("MULTIPLY_ADD", chroma.x, _fixed(0.0, -0.34414, 1.772), luma + 0.5, label="With Cb")
    rgb = graph.math("MULTIPLY_ADD", chroma.y, _fixed(1.402, -0.71414, 0.0), rgb, label="With Cr")
    return graph.math("FLOOR", rgb) / 255.0


@dataclass(frozen=True)
class JpegCompression:
    """Encoded and decoded, 4:2:0, libjpeg's tables, as ImageNet-C. The image is rounded to bytes on the way."""

    quality: int = key("quality as libjpeg counts it: lower is coarser", default=15, minimum=1, maximum=100)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "quality": "Lower: coarser blocks of 8 pixels, and blurrier colors",
    }


def apply(rgb: NDArray[np.float32], parameters: JpegCompression, _context: FrameContext) -> NDArray[np.float32]:
    """Compress (H, W, 3)."""
    return as_float(apply_bytes(rgb_bytes(rgb), parameters, _context))


def apply_bytes(rgb: NDArray[np.uint8], parameters: JpegCompression, _context: FrameContext) -> NDArray[np.uint8]:
    """Compress (H, W, 3) bytes."""
    import cv2

    options = [cv2.IMWRITE_JPEG_QUALITY, parameters.quality]
    options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420]
    _, encoded = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), options)
    decoded = cv2.imdecode(encoded, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
    return np.asarray(decoded, np.uint8)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Do to the pixels what encoding and decoding do, with all 64 coefficients of each block.

    A preview is enlarged to the reference width, by slopes between its pixels, and its result made small again. So its
    blocks look as they do in the frame, and it takes as long as the frame. An image larger than the reference width has
    blocks of 8 of its own pixels.
    """
    full = full_size(canvas)
    return full.back(compressed(full.canvas, given["quality"]))


PERTURBATION = ColourPerturbation(
    name="jpeg_compression",
    label="JPEG compression",
    stage="post",
    order=30,
    parameters=JpegCompression,
    severities={"quality": (25, 18, 15, 10, 7)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Leaves the blocks and rings of strong compression",
        "encoded and decoded by libjpeg",
        of_paper=True,
    ),
    apply=apply,
    repeatable=True,
    nodes=Nodes(build),
    apply_bytes=apply_bytes,
    counts=frozenset({"quality"}),
)
