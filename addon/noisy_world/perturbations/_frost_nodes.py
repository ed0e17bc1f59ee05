# SPDX-License-Identifier: GPL-3.0-or-later
"""Frost on the lens as a node group: the strip of ice looked up for two sides at once, aged, lit and looked through."""

import math
from collections.abc import Mapping

from ..core.linear_light import LUMINANCE
from ..core.node_graphs.graph import Graph, Socket, Value
from ..core.node_graphs.groups import Canvas
from ._crystals import (
    AGING,
    BODY_RELIEF,
    DARKEST,
    GLINT_FROM,
    GLINT_SLOPE,
    HALVINGS,
    LIGHT_SHARE,
    LIGHTEST,
    MEAN_SHARE,
    RIDGE_OPACITY,
    RIDGE_RELIEF,
    RISE,
    SHADE,
    SHORT_SIDE_PX,
    START_PX,
    WIDTH_PX,
    atlas_picture,
    levels,
)
from ._full_size import full_size, with_full_sizes

_CHANNELS = ("Red", "Green", "Blue")
_EXTEND = {"Extension X": "Extend", "Extension Y": "Extend"}


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Displace the image, of linear light, by the slope of ice, and add what the ice scatters."""
    full = full_size(canvas)
    frosted, icy = _frosted(full.canvas, full.pixel, with_full_sizes(full, given, "refraction_px"))
    shown, covered = full.back(frosted), full.back(icy)
    with canvas.graph.section("Where ice is"):
        # Enlarging and looking up change a lamp's edge a little: where no ice is, the image is as it was.
        return canvas.graph.blend(canvas.image, shown, covered > 0.0)


def _frosted(canvas: Canvas, pixel: Socket, given: Mapping[str, Socket]) -> tuple[Socket, Socket]:
    """Return the image behind ice, and what is above 0 where ice is; pixel: each pixel's column and row, from below."""
    graph = canvas.graph
    with graph.section("Draws"):
        drawn = canvas.random(0)
        light_rad = graph.math("MULTIPLY_ADD", drawn.z, -0.5 * math.pi, -0.25 * math.pi)
    with graph.section("Growth"):
        gained = canvas.drift_frames / given["frame_rate_hz"] * given["growth_per_s"]
        time = graph.clamp(gained + given["coverage"]) * (1 + RISE)
    short_px = graph.math("MINIMUM", canvas.width_px, canvas.height_px)
    zoom = graph.math("DIVIDE", SHORT_SIDE_PX, short_px, label="Pixels of the strip in one")
    with graph.section("Pixels"):
        flipped = graph.vector(0.5, canvas.height_px - 0.5)
        centre = graph.math("MULTIPLY_ADD", pixel, (1.0, -1.0, 0.0), flipped, label="Centres, from the upper left")
    ice = _ice(canvas, drawn, centre, zoom, time)
    with graph.section("Slopes"):
        relief = graph.math("DOT_PRODUCT", ice, (RIDGE_RELIEF, 0.0, BODY_RELIEF))
        # The sum is positioned as its first operand is, so that is the relief that is not moved.
        right = graph.math("MULTIPLY_ADD", relief, -1.0, _neighbour(relief, 1.0, 0.0))
        down = graph.math("MULTIPLY_ADD", relief, -1.0, _neighbour(relief, 0.0, 1.0))
        slope = graph.vector(right, down) / _thrice(graph, zoom)
    with graph.section("Refraction"):
        source = graph.math("MULTIPLY_ADD", slope, _thrice(graph, given["refraction_px"]), centre)
        behind = _looked_up(canvas.image, source, graph.vector(canvas.width_px, canvas.height_px))
    light = _light_around(canvas, centre, given["tint"], short_px)
    with graph.section("Scattering"):
        depth = _thrice(graph, given["opacity"] * -1.0) * (RIDGE_OPACITY, 0.0, 1.0)
        seen = graph.math("EXPONENT", graph.math("DOT_PRODUCT", ice, depth))
        towards = graph.vector(graph.math("COSINE", light_rad), graph.math("SINE", light_rad))
        lean = graph.math("DOT_PRODUCT", slope, towards)
        shade = graph.clamp(lean * SHADE, DARKEST, LIGHTEST) + 1.0
        white = (1.0 - seen) * shade * given["brightness"]
        glints = graph.clamp(graph.math("MULTIPLY_ADD", lean, GLINT_SLOPE, -GLINT_FROM))
        white = graph.math("MULTIPLY_ADD", glints * glints, given["glint"], white)
    with graph.section("Over the image"):
        frosted = graph.math("MULTIPLY_ADD", light, _thrice(graph, white), behind * _thrice(graph, seen))
        return frosted, graph.math("DOT_PRODUCT", ice, (1.0, 0.0, 1.0)) + graph.math("LENGTH", slope)


def _ice(canvas: Canvas, drawn: Socket, centre: Socket, zoom: Socket, time: Socket) -> Socket:
    """Return (ridge, 0, body) at each pixel: the thickest of the ice from its nearest sides.

    x is of left and right, y of top and bottom.
    """
    graph = canvas.graph
    atlas = atlas_picture()
    rows = float(levels()[-1].top + levels()[-1].rows)
    with graph.section("Level of the strip"):
        smaller = [zoom > 2 ** (power - 0.5) for power in range(1, len(levels()))]
        shrunk, top, last = (_by_level(graph, smaller, name) for name in ("shrunk", "top", "last"))
        step = zoom / shrunk
    with graph.section("Sides"):
        start = graph.math("FLOOR", drawn.x * (WIDTH_PX // START_PX)) * float(START_PX)
        sides = graph.math("MINIMUM", graph.math("FLOOR", drawn.y * 16.0), 15.0)
        way, first = [], []
        for number, length in enumerate((canvas.width_px, canvas.width_px, canvas.height_px, canvas.height_px)):
            halved = sides / 2.0 ** (3 - number)
            flipped = graph.math("FLOOR", halved) - graph.math("FLOOR", halved / 2.0) * 2.0
            way.append(step * (1.0 - flipped * 2.0) / WIDTH_PX)
            begins = (start + number * (WIDTH_PX / 4)) / shrunk
            first.append((begins + flipped * length * step) / WIDTH_PX)
        size = graph.vector(canvas.width_px, canvas.height_px)
        # -1 at the left and the top, 1 at the right and the bottom: chooses between two values by one multiplication.
        side = graph.math("SIGN", graph.math("MULTIPLY_ADD", size, (-0.5, -0.5, 0.0), centre))
        near = graph.math("MINIMUM", centre, size - centre)
        along = graph.vector(centre.y, centre.x)
        along = graph.math("MULTIPLY_ADD", along, _between(side, way), _between(side, first))
        inwards = graph.math("MULTIPLY_ADD", near, _thrice(graph, step / -rows), _thrice(graph, 1.0 - top / rows))
        inwards = graph.math("MAXIMUM", inwards, _thrice(graph, 1.0 - last / rows))
    ages = []
    for axis, name in (("x", "Left and right"), ("y", "Top and bottom")):
        with graph.section(name):
            where = graph.vector(getattr(along, axis), getattr(inwards, axis), 1.0)
            inputs = {"Image": graph.picture(atlas), "UV": where, "Interpolation": "Bilinear"}
            inputs |= {"Extension X": "Repeat", "Extension Y": "Extend"}
            found = graph.node("CompositorNodeMapUV", inputs).out("Image", "color")
            age = graph.math("MAXIMUM", time - found.y, 0.0)
            share = graph.math("MINIMUM", graph.vector(age * (1 / RISE), 0.0, age * (1 / AGING)), (1.0, 1.0, 1.0))
            ages.append(found * share)
    with graph.section("Both"):
        return graph.math("MAXIMUM", *ages)


def _by_level(graph: Graph, smaller: list[Socket], name: str) -> Socket:
    """Return what the level that is looked up has. name: shrunk, top, or last, the middle of its last row."""
    values = [{"shrunk": item.shrunk, "top": item.top, "last": item.top + item.rows - 0.5}[name] for item in levels()]
    result: Value = float(values[0])
    for is_smaller, before, after in zip(smaller, values[:-1], values[1:], strict=True):
        result = graph.math("MULTIPLY_ADD", is_smaller, float(after - before), result)
    assert isinstance(result, Socket), "there are several levels"
    return result


def _between(side: Socket, values: list[Socket]) -> Socket:
    """Return the values of top, bottom, left and right where `side` says."""
    graph = side.graph
    top, bottom, left, right = values
    middle = graph.vector((left + right) * 0.5, (top + bottom) * 0.5)
    half = graph.vector((right - left) * 0.5, (bottom - top) * 0.5)
    return graph.math("MULTIPLY_ADD", side, half, middle)


def _neighbour(image: Socket, right_px: float, down_px: float) -> Socket:
    """Return the image moved, so that each pixel has the value of one to its right or below it."""
    inputs = {"Image": image, "Displacement": (-right_px, down_px), "Interpolation": "Nearest", **_EXTEND}
    return image.graph.node("CompositorNodeDisplace", inputs).out("Image", "float")


def _light_around(canvas: Canvas, centre: Socket, tint: Socket, short_px: Socket) -> Socket:
    """Return the light about each pixel, which its ice scatters: of the image, made smaller and blurred."""
    graph = canvas.graph
    with graph.section("Light around"):
        small, size = canvas.image, graph.vector(canvas.width_px, canvas.height_px, 1.0)
        for _ in range(HALVINGS):
            small, size = _halved(small, size)
        blur_px = short_px * (3 * LIGHT_SHARE / 2**HALVINGS)
        inputs = {"Image": small, "Size": graph.vector(blur_px, blur_px), "Type": "Gaussian", "Separable": True}
        blurred = graph.node("CompositorNodeBlur", inputs).out("Image", "color")
        levels_of = [graph.node("CompositorNodeLevels", {"Image": small, "Channel": name}) for name in _CHANNELS]
        mean = graph.vector(*(node.out("Mean", "float") for node in levels_of))
        both = graph.mix(blurred, mean, (MEAN_SHARE,) * 3)
        grey = _thrice(graph, graph.math("DOT_PRODUCT", both, LUMINANCE))
        light = graph.mix(grey, both, _thrice(graph, tint))
        return _looked_up(light, centre * (2.0**-HALVINGS, 2.0**-HALVINGS, 0.0), size)


def _halved(image: Socket, size: Socket) -> tuple[Socket, Socket]:
    """Return means of 2 x 2 pixels, from the upper left, and the size; an odd side's last pixels count twice."""
    graph = image.graph
    smaller = graph.math("CEIL", size * (0.5, 0.5, 1.0))
    blank = graph.node("CompositorNodeBlankImage", {"Size": smaller}).out("Image", "color")
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Pixel", "vector")
    odd = graph.math("MULTIPLY_ADD", smaller, (0.0, -2.0, 0.0), size * (0.0, 1.0, 0.0))
    between = graph.math("MULTIPLY_ADD", pixel, (2.0, 2.0, 0.0), graph.math("ADD", odd, (1.0, 1.0, 1.0)))
    inputs = {"Image": image, "UV": between / size, "Interpolation": "Bilinear", **_EXTEND}
    return graph.node("CompositorNodeMapUV", inputs).out("Image", "color"), smaller


def _looked_up(image: Socket, place_px: Socket, size_px: Socket) -> Socket:
    """Return the image's values at places, pixels from its upper left; beyond its borders, those of the border."""
    graph = image.graph
    # A thousandth of a pixel inside: rounded to a hair outside the border's middle, Blender takes the row before it.
    inside = graph.math("MINIMUM", place_px, graph.math("SUBTRACT", size_px, (0.501, 0.501, 0.0)))
    inside = graph.math("MAXIMUM", inside, (0.501, 0.501, 0.0))
    across = graph.vector(1.0, -1.0) / size_px
    where = graph.math("MULTIPLY_ADD", inside, across, (0.0, 1.0, 1.0))
    inputs = {"Image": image, "UV": where, "Interpolation": "Bilinear", **_EXTEND}
    return graph.node("CompositorNodeMapUV", inputs).out("Image", "color")


def _thrice(graph: Graph, value: Socket) -> Socket:
    return graph.vector(value, value, value)
