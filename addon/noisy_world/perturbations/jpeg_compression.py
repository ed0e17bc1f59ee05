# SPDX-License-Identifier: GPL-3.0-or-later
"""JPEG compression: blocks, ringing and smeared colours."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.graph import Graph, GroupInput, Socket, Value
from ..core.groups import Canvas
from ..core.images import rgb_bytes
from ..core.perturbation import Frame, Perturbation
from ..core.schema import key
from ._block_dct import RUN, cosines, frequencies, pixels, sample

# The standard's tables for quality 50 (ITU-T T.81, K.1 and K.2).
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
CENTRE = 128.0  # of a byte: coefficients are of the differences from it
AWAY_FROM_ZERO = 1 + 2e-5  # so that what lies halfway between two steps is rounded as libjpeg does


@dataclass(frozen=True)
class JpegCompression:
    """Encoded and decoded, 4:2:0, libjpeg's tables, as ImageNet-C. The image is rounded to bytes on the way."""

    quality: int = key("libjpeg's quality", default=15, minimum=1, maximum=100)


def apply(rgb: NDArray[np.float32], parameters: JpegCompression, _frame: Frame) -> NDArray[np.float32]:
    """Compress (H, W, 3)."""
    return apply_bytes(rgb_bytes(rgb), parameters, _frame) / np.float32(255)


def apply_bytes(rgb: NDArray[np.uint8], parameters: JpegCompression, _frame: Frame) -> NDArray[np.uint8]:
    """Compress (H, W, 3) bytes."""
    import cv2

    options = [cv2.IMWRITE_JPEG_QUALITY, parameters.quality]
    options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420]
    _, encoded = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), options)
    return cv2.imdecode(encoded, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Do what libjpeg does to the pixels between encoding and decoding; every step rounded where it rounds.

    The three channels in between are the upper half of luma, the lower half, and both chromas side by side at half
    size: they have equal sizes, and all is done to the three at once. Rows go downwards in them, as blocks are counted.
    A smaller image is enlarged to the reference width first and the result made small again, so that blocks keep their
    places and their content; a larger one has blocks of 8 of its own pixels.
    """
    graph = canvas.graph
    with graph.section("Frame in blocks"):
        frame = _frame(canvas)
        place = frame.places("The three planes", frame.padded_width, frame.half_rows)
    with graph.section("Bytes of YCbCr"):
        planes = _planes(graph, _ycc(graph, canvas.image), frame, place)
    decoded = _quantised(graph, planes, frame, place, given["quality"])
    with graph.section("Decoded bytes"):
        decoded = graph.clamp(graph.math("FLOOR", decoded + (CENTRE + 0.5)), 0.0, 255.0)
    with graph.section("Back to RGB"):
        return _rgb(canvas, frame, decoded)


@dataclass(frozen=True)
class _Frame:
    """Sizes in pixels of the frame and of what it is compressed as; one number each."""

    graph: Graph
    width: Socket
    height: Socket
    padded_width: Socket
    half_rows: Socket
    unit: Socket

    def places(self, label: str, width: Value, height: Value) -> Socket:
        """Return an image of this size of its pixels' columns and rows."""
        return places(self.graph, width, height, label)


def places(graph: Graph, width: Value, height: Value, label: str) -> Socket:
    """Return an image of this size of its pixels' columns and rows."""
    size = graph.vector(width, height)
    blank = graph.node("CompositorNodeBlankImage", {"Size": size}, label=label).out("Image", "color")
    return graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Pixel", "vector")


def _frame(canvas: Canvas) -> _Frame:
    graph = canvas.graph
    unit = graph.math("MINIMUM", canvas.scale, 1.0)
    width = graph.math("ROUND", canvas.width_px / unit, label="Width")
    height = graph.math("ROUND", canvas.height_px / unit, label="Height")
    padded = graph.math("CEIL", width / 16.0) * 16.0
    return _Frame(graph, width, height, padded, graph.math("CEIL", height / 16.0) * 8.0, unit)


def _ycc(graph: Graph, image: Socket) -> Socket:
    """Return bytes of Y, Cb and Cr (ITU-R BT.601, full range)."""
    levels = graph.math("FLOOR", graph.math("MULTIPLY_ADD", image, 255.0, 0.5))
    luma = graph.math("DOT_PRODUCT", levels, (0.299, 0.587, 0.114)) + 0.5
    blue = graph.math("DOT_PRODUCT", levels, (-0.168735892, -0.331264108, 0.5)) + (CENTRE + 0.49999)
    red = graph.math("DOT_PRODUCT", levels, (0.5, -0.418687589, -0.081312411)) + (CENTRE + 0.49999)
    return graph.math("FLOOR", graph.vector(luma, blue, red))


def _planes(graph: Graph, ycc: Socket, frame: _Frame, place: Socket) -> Socket:
    """Return the three planes, less the centre."""
    column, row = place.x, place.y
    # The image's rows go upwards.
    size = graph.vector(frame.width, -frame.height, 1.0)
    below = graph.vector(0.0, 1.0)
    upper = graph.math("MULTIPLY_ADD", place + (0.5, 0.5, 1.0), 1.0 / size, below)
    lower = upper + graph.vector(0.0, -1.0 * frame.half_rows / frame.height)
    right = graph.math("MULTIPLY", frame.padded_width, 0.5)
    is_red = graph.math("GREATER_THAN", column, right - 0.5)
    chroma_column = column - is_red * right
    last = graph.math("CEIL", frame.height * 0.5) - 1.0
    chroma = graph.vector(chroma_column, graph.math("MINIMUM", row, last))
    corner = graph.math("MULTIPLY_ADD", graph.math("MULTIPLY_ADD", chroma, 2.0, 1.0), 1.0 / size, below)
    mean = sample(graph, ycc, corner, "Bilinear")
    # libjpeg rounds the mean of four down and up in turns.
    odd = graph.math("FLOORED_MODULO", chroma_column, 2.0)
    half_size = graph.mix(mean.g, mean.b, is_red) + graph.math("MULTIPLY_ADD", odd, 0.25, 0.375)
    luma = [sample(graph, ycc, where).r for where in (upper, lower)]
    return graph.math("FLOOR", graph.vector(*luma, half_size)) - CENTRE


def _quantised(graph: Graph, planes: Socket, frame: _Frame, place: Socket, quality: Socket) -> Socket:
    with graph.section("Rows to frequencies"):
        split, across = frequencies(), _runs(graph, frame, along="x")
        rows = graph.group(split, {"Image": planes, **across}, name="Rows to frequencies")
    with graph.section("Columns of coefficients"):
        # libjpeg's jpeg_quality_scaling.
        low = graph.math("FLOOR", 5000.0 / quality)
        percent = graph.choose(quality < 50.0, low, 200.0 - 2.0 * quality, "float")
        tall = places(graph, frame.padded_width * 0.125, frame.half_rows, "A run is a pixel wide")
        shared = _runs(graph, frame, along="y") | _cosines(graph, tall, tall.y) | {"Percent": percent}
        column = _column()
        done = {}
        for u in RUN:
            entries = {f"Entry {v}": (LUMA[v][u], LUMA[v][u], CHROMA[v][u]) for v in RUN}
            inputs = {"Image": rows.out(f"{u}", "vector")} | entries | shared
            done[f"{u}"] = graph.group(column, inputs, name=f"Coefficients {u}").out("Image", "color")
    with graph.section("Frequencies to rows"):
        inputs = done | _cosines(graph, place, place.x)
        return graph.group(pixels(), inputs, name="Frequencies to rows").out("Image", "color")


def _runs(graph: Graph, frame: _Frame, along: str) -> dict[str, Socket]:
    """Return where the runs along an axis begin, and their step."""
    columns, rows = frame.padded_width, frame.half_rows
    if along == "x":
        place = places(graph, columns * 0.125, rows, "A run is a pixel wide")
        size = graph.vector(columns, rows, 1.0)
        return {
            "First": graph.math("MULTIPLY_ADD", place, (8.0, 1.0, 0.0), (0.5, 0.5, 1.0)) / size,
            "Step": graph.vector(1.0 / columns, 0.0),
        }
    place = places(graph, columns * 0.125, rows * 0.125, "A block is a pixel")
    size = graph.vector(columns * 0.125, rows, 1.0)
    return {
        "First": graph.math("MULTIPLY_ADD", place, (1.0, 8.0, 0.0), (0.5, 0.5, 1.0)) / size,
        "Step": graph.vector(0.0, 1.0 / rows),
    }


def _cosines(graph: Graph, place: Socket, along: Socket) -> dict[str, Socket]:
    """Return the cosines along an axis, and where each pixel is from 0 to 1."""
    made = graph.group(cosines(), {"Place": along}, name="")
    found = {name: made.out(name, "vector") for name in ("Cosines 1-3", "Cosines 4-6", "Cosine 7")}
    normalised = graph.node("CompositorNodeImageCoordinates", {"Image": place}).out("Normalized", "vector")
    return found | {"Place": normalised + (0.0, 0.0, 1.0)}


def _quantise() -> Graph:
    """Describe the group that rounds a coefficient of every block to a multiple of its table's entry."""
    graph = Graph("NW JPEG quantise", "A coefficient of every block, rounded to a multiple of its quantisation step")
    value = graph.input(GroupInput("Coefficient", "vector", (0.0, 0.0, 0.0), "Of every block"))
    entry = graph.input(GroupInput("Entry", "vector", (16.0, 16.0, 17.0), "The tables' entries at quality 50"))
    percent = graph.input(GroupInput("Percent", "float", 100.0, "The tables' scale"))
    with graph.section("Step"):
        scaled = graph.math("FLOOR", graph.math("MULTIPLY_ADD", entry, percent, 50.0) / 100.0)
        step = graph.clamp(scaled, 1.0, 255.0)
    with graph.section("Round"):
        # libjpeg's transform gives whole eighths.
        eighths = graph.math("SNAP", value + 1 / 16, 1 / 8)
        nearest = graph.math("MULTIPLY_ADD", eighths, AWAY_FROM_ZERO, step * 0.5)
        graph.output("Coefficient", graph.math("SNAP", nearest, step), "vector")
    return graph


def _column() -> Graph:
    """Describe the group that does all to the eight coefficients of one column of the tables."""
    graph = Graph("NW JPEG column", "One horizontal frequency: its eight coefficients, quantised")
    image = graph.input(GroupInput("Image", "color", (0.0, 0.0, 0.0, 1.0), "The rows' coefficient"))
    names = ("First", "Step", "Place", "Cosines 1-3", "Cosines 4-6", "Cosine 7")
    given = {name: graph.input(GroupInput(name, "vector", (0.0, 0.0, 0.0), "As in its groups")) for name in names}
    percent = graph.input(GroupInput("Percent", "float", 100.0, "The tables' scale"))
    meaning = "Of the tables at quality 50: luma, luma, chroma"
    entries = [graph.input(GroupInput(f"Entry {v}", "vector", (16.0, 16.0, 17.0), meaning)) for v in RUN]
    with graph.section("Columns to frequencies"):
        inputs = {"Image": image, "First": given.pop("First"), "Step": given.pop("Step")}
        split = graph.group(frequencies(), inputs)
    with graph.section("Quantise"):
        quantise = _quantise()
        rounded = {}
        for v in RUN:
            inputs = {"Coefficient": split.out(f"{v}", "vector"), "Entry": entries[v], "Percent": percent}
            rounded[f"{v}"] = graph.group(quantise, inputs).out("Coefficient", "vector")
    with graph.section("Frequencies to columns"):
        graph.output("Image", graph.group(pixels(), given | rounded).out("Image", "color"))
    return graph


def _rgb(canvas: Canvas, frame: _Frame, decoded: Socket) -> Socket:
    """Unpack the planes, enlarge the chroma as libjpeg does, and convert."""
    graph = canvas.graph
    half_width = graph.math("CEIL", frame.width * 0.5)
    half_height = graph.math("CEIL", frame.height * 0.5)
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Pixel", "vector")
    in_planes = _normalised(canvas, frame, pixel, frame.padded_width, frame.half_rows)
    is_lower = graph.math("GREATER_THAN", in_planes.y, 1.0)
    luma = sample(graph, decoded, in_planes - graph.vector(0.0, is_lower), "Bilinear")
    luma = graph.mix(luma.r, luma.g, is_lower)

    small = frame.places("Half size", half_width, half_height)
    size = graph.vector(frame.padded_width, frame.half_rows, 1.0)
    blue_place = (small + (0.5, 0.5, 1.0)) / size
    chroma = graph.vector(sample(graph, decoded, blue_place).b, sample(graph, decoded, blue_place + (0.5, 0.0, 0.0)).b)
    wide = sample(graph, chroma, _normalised(canvas, frame, pixel, half_width * 2.0, half_height * 2.0), "Bilinear")
    # libjpeg rounds the weighted mean down and up in turns.
    odd = graph.math("FLOORED_MODULO", pixel.x, 2.0)
    wide = graph.math("FLOOR", wide + graph.math("MULTIPLY_ADD", odd, -1 / 16, 0.5 + 1 / 32)) - CENTRE
    red = graph.math("MULTIPLY_ADD", wide.y, 1.402, luma)
    green = graph.math("MULTIPLY_ADD", wide.x, -0.344136286, graph.math("MULTIPLY_ADD", wide.y, -0.714136286, luma))
    blue = graph.math("MULTIPLY_ADD", wide.x, 1.772, luma)
    return graph.math("FLOOR", graph.vector(red, green, blue) + 0.5) / 255.0


def _normalised(canvas: Canvas, frame: _Frame, pixel: Socket, columns: Value, rows: Value) -> Socket:
    """Return where the image's pixels are in one of so many pixels of the reference width, whose rows go downwards."""
    graph = canvas.graph
    per_column, per_row = 1.0 / (columns * frame.unit), 1.0 / (rows * frame.unit)
    start = graph.vector(0.5 * per_column, (canvas.height_px - 0.5) * per_row, 1.0)
    return graph.math("MULTIPLY_ADD", pixel, graph.vector(per_column, -per_row), start)


PERTURBATION = Perturbation(
    name="jpeg_compression",
    label="JPEG compression",
    category="post",
    parameters=JpegCompression,
    severities={"quality": (25, 18, 15, 10, 7)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    apply=apply,
    build=build,
    apply_bytes=apply_bytes,
    counts=frozenset({"quality"}),
)
