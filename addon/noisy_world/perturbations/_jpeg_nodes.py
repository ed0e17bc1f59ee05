# SPDX-License-Identifier: GPL-3.0-or-later
"""What JPEG does to an image between encoding and decoding, as nodes.

After ITU-T T.81 and JFIF 1.02, and libjpeg where they leave a choice: every step rounds where libjpeg rounds.
What is left is its integer cosine transform, which now and then rounds to the neighbour; and the chroma of frames less
than five pixels wide, which it enlarges without interpolation.

All is done to three planes, the channels of one image: the upper half of luma, the lower half, and both chromas at half
size side by side. They have equal sizes, so each node works for all of them. Rows go downwards in them, as blocks are
counted; in Blender's images they go upwards.
"""

from dataclasses import dataclass

from ..core.graph import Graph, GroupInput, Socket, Value
from ..core.groups import Canvas
from ._block_dct import BUNDLES, RUN, cosines, frequencies, pixels, sample

# The standard's tables for quality 50 (K.1 and K.2): a row for each vertical frequency.
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
CENTRE = 128.0  # of a byte: the transform is of differences from it
AWAY_FROM_ZERO = 1 + 2e-5  # so that what lies halfway between two steps goes where libjpeg rounds it
PIXEL_CENTRE = (0.5, 0.5, 1.0)


def compressed(canvas: Canvas, quality: Socket) -> Socket:
    """Return the canvas's image after JPEG at libjpeg's `quality`, 4:2:0."""
    with canvas.graph.section("Three planes"):
        frame = _frame(canvas)
        place = _places(canvas.graph, frame.columns, frame.rows, "Planes")
    with canvas.graph.section("Bytes of YCbCr"):
        planes = _planes(frame, _ycc(canvas), place)
    decoded = _decoded(frame, planes, place, quality)
    with canvas.graph.section("Back to RGB"):
        return _rgb(canvas, frame, decoded)


@dataclass(frozen=True)
class _Frame:
    """Sizes in pixels, one number each.

    width, height: of the frame that is compressed. columns, rows: of its planes. scale: pixels of the image that
    arrives for one of the frame.
    """

    graph: Graph
    width: Socket
    height: Socket
    columns: Socket
    rows: Socket
    scale: Socket

    @property
    def half(self) -> tuple[Socket, Socket]:
        """Width and height of a chroma."""
        return self.graph.math("CEIL", self.width * 0.5), self.graph.math("CEIL", self.height * 0.5)


def _frame(canvas: Canvas) -> _Frame:
    graph = canvas.graph
    scale = graph.math("MINIMUM", canvas.scale, 1.0, label="No block larger than 8 pixels")
    width = graph.math("ROUND", canvas.width_px / scale, label="Width")
    height = graph.math("ROUND", canvas.height_px / scale, label="Height")
    columns = graph.math("CEIL", width / 16.0) * 16.0
    rows = graph.math("CEIL", height / 16.0) * 8.0
    return _Frame(graph, width, height, columns, rows, scale)


def _places(graph: Graph, width: Value, height: Value, label: str) -> Socket:
    """Return an image of this size of its pixels' columns and rows."""
    inputs = {"Size": graph.vector(width, height)}
    blank = graph.node("CompositorNodeBlankImage", inputs, label=label).out("Image", "color")
    return graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Pixel", "vector")


def _ycc(canvas: Canvas) -> Socket:
    """Return bytes of Y, Cb and Cr (JFIF: ITU-R BT.601, full range)."""
    graph = canvas.graph
    levels = graph.math("FLOOR", graph.math("MULTIPLY_ADD", canvas.image, 255.0, 0.5), label="Bytes")
    luma = graph.math("DOT_PRODUCT", levels, (0.299, 0.587, 0.114), label="Y") + 0.5
    # libjpeg rounds a half of chroma down.
    half = CENTRE + 0.49999
    blue = graph.math("DOT_PRODUCT", levels, (-0.168735892, -0.331264108, 0.5), label="Cb") + half
    red = graph.math("DOT_PRODUCT", levels, (0.5, -0.418687589, -0.081312411), label="Cr") + half
    return graph.math("FLOOR", graph.vector(luma, blue, red))


def _planes(frame: _Frame, ycc: Socket, place: Socket) -> Socket:
    """Return the three planes, less the centre of a byte. The frame's border is replicated, as libjpeg does."""
    graph = frame.graph
    per_pixel = 1.0 / graph.vector(frame.width, -frame.height, 1.0)
    top = (0.0, 1.0, 0.0)
    upper = graph.math("MULTIPLY_ADD", place + PIXEL_CENTRE, per_pixel, top)
    lower = upper - graph.vector(0.0, frame.rows / frame.height)
    luma = [sample(graph, ycc, where).r for where in (upper, lower)]

    middle = frame.columns * 0.5
    is_red = graph.math("GREATER_THAN", place.x, middle - 0.5, label="Cr is right of Cb")
    column = place.x - is_red * middle
    row = graph.math("MINIMUM", place.y, frame.half[1] - 1.0)
    corner = graph.math("MULTIPLY_ADD", graph.vector(column, row), 2.0, 1.0, label="Between four pixels")
    mean = sample(graph, ycc, graph.math("MULTIPLY_ADD", corner, per_pixel, top), "Bilinear")
    # libjpeg rounds the mean of four down and up in turns; an eighth keeps clear of the quarters.
    is_odd = graph.math("FLOORED_MODULO", column, 2.0)
    chroma = graph.mix(mean.g, mean.b, is_red) + graph.math("MULTIPLY_ADD", is_odd, 0.25, 0.25 + 0.125)
    return graph.math("FLOOR", graph.vector(*luma, chroma)) - CENTRE


def _decoded(frame: _Frame, planes: Socket, place: Socket, quality: Socket) -> Socket:
    """Return the planes as bytes, out of their quantised coefficients."""
    graph = frame.graph
    with graph.section("Rows to frequencies"):
        size = graph.vector(frame.columns, frame.rows, 1.0)
        starts = _places(graph, frame.columns / 8.0, frame.rows, "Runs of a row")
        first = graph.math("MULTIPLY_ADD", starts, (8.0, 1.0, 1.0), PIXEL_CENTRE) / size
        inputs = {"Image": planes, "First": first, "Step": graph.vector(1.0 / frame.columns, 0.0)}
        rows = graph.group(frequencies(), inputs, name="Rows to frequencies")
    with graph.section("Columns of coefficients"):
        size = graph.vector(frame.columns / 8.0, frame.rows, 1.0)
        starts = _places(graph, frame.columns / 8.0, frame.rows / 8.0, "Blocks")
        first = graph.math("MULTIPLY_ADD", starts, (1.0, 8.0, 1.0), PIXEL_CENTRE) / size
        tall = _places(graph, frame.columns / 8.0, frame.rows, "Runs of a row")
        shared = {"First": first, "Step": graph.vector(0.0, 1.0 / frame.rows), "Percent": _percent(quality)}
        shared |= _weights(graph, tall, tall.y)
        column, columns = _column(), {}
        for u in RUN:
            entries = {f"Entry {v}": (LUMA[v][u], LUMA[v][u], CHROMA[v][u]) for v in RUN}
            inputs = {"Image": rows.out(f"{u}", "vector")} | entries | shared
            columns[f"{u}"] = graph.group(column, inputs, name=f"Horizontal frequency {u}").out("Image", "color")
    with graph.section("Frequencies to rows"):
        inputs = columns | _weights(graph, place, place.x)
        values = graph.group(pixels(), inputs, name="Frequencies to rows").out("Image", "color")
        return graph.clamp(graph.math("FLOOR", values + (CENTRE + 0.5)), 0.0, 255.0)


def _weights(graph: Graph, place: Socket, along: Socket) -> dict[str, Socket]:
    """Return what the group of pixels asks for: where they are, and their cosines along an axis."""
    made = graph.group(cosines(), {"Place": along}, name="Cosines")
    normalised = graph.node("CompositorNodeImageCoordinates", {"Image": place}).out("Normalized", "vector")
    return {name: made.out(name, "vector") for name in BUNDLES} | {"Place": normalised + (0.0, 0.0, 1.0)}


def _percent(quality: Socket) -> Socket:
    """Return libjpeg's scale of the tables (jpeg_quality_scaling)."""
    graph = quality.graph
    coarse, fine = graph.math("FLOOR", 5000.0 / quality), 200.0 - 2.0 * quality
    return graph.mix(fine, coarse, graph.math("LESS_THAN", quality, 50.0))


def _column() -> Graph:
    """Describe the group that quantises a horizontal frequency: a column of the tables."""
    graph = Graph("NW JPEG column", "One horizontal frequency, quantised at its eight vertical frequencies")
    nothing = (0.0, 0.0, 0.0)
    image = graph.input(GroupInput("Image", "color", (*nothing, 1.0), "Its coefficient of each row of eight pixels"))
    first = graph.input(GroupInput("First", "vector", nothing, "Where each block's first row is, from 0 to 1"))
    step = graph.input(GroupInput("Step", "vector", nothing, "From one row of a block to the next"))
    weights = {
        name: graph.input(GroupInput(name, "vector", nothing, "For the way back")) for name in ("Place", *BUNDLES)
    }
    percent = graph.input(GroupInput("Percent", "float", 100.0, "How coarse: 100 is quality 50"))
    meaning = "The tables' entry at quality 50: luma, luma, chroma"
    entries = [graph.input(GroupInput(f"Entry {v}", "vector", (16.0, 16.0, 17.0), meaning)) for v in RUN]
    with graph.section("Columns to frequencies"):
        split = graph.group(frequencies(), {"Image": image, "First": first, "Step": step})
    with graph.section("Quantise"):
        quantise, rounded = _quantise(), {}
        for v in RUN:
            inputs = {"Coefficient": split.out(f"{v}", "vector"), "Entry": entries[v], "Percent": percent}
            rounded[f"{v}"] = graph.group(quantise, inputs).out("Coefficient", "vector")
    with graph.section("Frequencies to columns"):
        graph.output("Image", graph.group(pixels(), weights | rounded).out("Image", "color"))
    return graph


def _quantise() -> Graph:
    """Describe the group that rounds a coefficient of every block to a multiple of the table's entry."""
    graph = Graph("NW JPEG quantise", "A coefficient of every block, rounded to a multiple of its step")
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


def _rgb(canvas: Canvas, frame: _Frame, decoded: Socket) -> Socket:
    """Unpack the planes, enlarge the chroma as libjpeg does, and convert (JFIF)."""
    graph = canvas.graph
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Pixel", "vector")
    where = _place_of(canvas, frame, pixel, frame.columns, frame.rows)
    is_lower = graph.math("GREATER_THAN", where.y, 1.0, label="Lower half")
    both = sample(graph, decoded, where - graph.vector(0.0, is_lower), "Bilinear")
    luma = graph.mix(both.r, both.g, is_lower)

    width, height = frame.half
    small = _places(graph, width, height, "Chroma") + PIXEL_CENTRE
    where_blue = small / graph.vector(frame.columns, frame.rows, 1.0)
    blue, red = (sample(graph, decoded, where_blue + (shift, 0.0, 0.0)).b for shift in (0.0, 0.5))
    where = _place_of(canvas, frame, pixel, width * 2.0, height * 2.0)
    wide = sample(graph, graph.vector(blue, red), where, "Bilinear")
    # libjpeg rounds the weighted mean up and down in turns; half a sixteenth keeps clear of the sixteenths.
    is_odd = graph.math("FLOORED_MODULO", pixel.x, 2.0)
    chroma = graph.math("FLOOR", wide + graph.math("MULTIPLY_ADD", is_odd, -1 / 16, 0.5 + 1 / 32)) - CENTRE
    less_blue = graph.math("MULTIPLY_ADD", chroma.x, -0.344136286, luma)
    rgb = graph.vector(
        graph.math("MULTIPLY_ADD", chroma.y, 1.402, luma, label="Red"),
        graph.math("MULTIPLY_ADD", chroma.y, -0.714136286, less_blue, label="Green"),
        graph.math("MULTIPLY_ADD", chroma.x, 1.772, luma, label="Blue"),
    )
    return graph.math("FLOOR", rgb + 0.5) / 255.0


def _place_of(canvas: Canvas, frame: _Frame, pixel: Socket, columns: Value, rows: Value) -> Socket:
    """Return the places, from 0 to 1, of the image's pixels in one of so many of the frame's, rows downwards."""
    graph = canvas.graph
    per_column, per_row = 1.0 / (columns * frame.scale), 1.0 / (rows * frame.scale)
    start = graph.vector(per_column * 0.5, per_row * (canvas.height_px - 0.5), 1.0)
    return graph.math("MULTIPLY_ADD", pixel, graph.vector(per_column, -per_row), start)
