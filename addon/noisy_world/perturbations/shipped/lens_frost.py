# SPDX-License-Identifier: GPL-3.0-or-later
"""Frost on the lens: ferns of ice that grow on the glass before it, from the border inwards."""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.file_access import read_bytes
from ...core.node_graph import BroughtImage, Graph, Socket, Value
from ...core.schema import key
from ...core.srgb import LUMINANCE, decoded, encoded
from ...core.streams import stream
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, Example, FrameContext, Nodes
from ._arrays import by_bands, three_channels
from ._noise import white_noise
from ._sizes import full_size, with_full_sizes

# Ice grown from a pane's edge by `headless/pictures/draw_frost.py`: its thickness, and when it grew.
#
# The strip is grown once, beside one edge, with its ends joined. Each side of a frame shows another part of it.


T = TypeVar("T", bound=np.generic)

Float32: TypeAlias = NDArray[np.float32]

WIDTH_PX, HEIGHT_PX = 3072, 320  # along the edge, and from it inwards
TIME_SHRUNK = 4  # the map of times is so many times smaller
# The shorter side of a frame that shows the strip pixel for pixel. Larger and smaller frames show as much of it, and
# strips of opposite sides never meet.
SHORT_SIDE_PX = 680.0
FERN, FEATHER = "fern", "feather"  # how ice grows: with straight branches, or in plumes that curl
LEVELS = 3  # the strip in its own size, half and a quarter of it
START_PX = 1 << (LEVELS - 1)  # a side's part starts at a multiple of this, which is a whole pixel of every level

# Chosen by eye, after photographs. Times are shares of the whole growth.
RISE, AGING = 0.12, 0.9  # from when a ridge comes until it is whole, and until the ice about it is
RIDGE_OPACITY, RIDGE_RELIEF, BODY_RELIEF = 1.0, 1.0, 0.35  # of ridges and of the ice about them; that of the body is 1
SHADE, DARKEST, LIGHTEST = 0.5, -0.2, 0.3  # how much lighter ice is that leans to the light, and its limits
GLINT_SLOPE, GLINT_FROM = 4.0, 0.8  # a glint begins at the slope 0.8 / 4
LIGHT_SHARE = 0.035  # standard deviation of what lights a piece of ice, in shorter sides of the frame
MEAN_SHARE = 0.25  # of the whole frame's mean in that light
HALVINGS = 3  # of the image, before it is blurred for that
HALO = ((2.0, 0.6), (5.0, 0.4))  # how many times as wide a halo's light goes, and the shares that do; chosen

# What lies between the ridges, chosen by eye: ice about each ridge, haze over a fern, and rime along the edge, grainy.
_NEAR, _WIDE, _RIME = (1.04, 2.6), (0.65, 9.0), (0.72, 55.0)  # share of the ridges' thickness, and pixels
_GRAIN = (0.25, 0.9)  # standard deviation, and pixels
# Along the edge ice comes here sooner, there later, so that the first ice is in patches: share of the whole growth, and
# the waves along the strip, which close at its ends.
_LATER, _PATCHES = 0.45, (5, 8, 13)
_FADE_PX = 40.0  # it gets thinner so far before the strip's end


def map_file(name: str, habit: str = "fern") -> Path:
    """Return the path of a map: thickness or time. habit: fern or feather."""
    return Path(__file__).parent / "ice" / f"{habit}_{name}.png"


@dataclass(frozen=True)
class Level:
    """Where the strip lies in the atlas, `shrunk` times smaller: rows [top, top + rows), repeated along them."""

    shrunk: int
    top: int
    rows: int


@lru_cache(maxsize=1)
def levels() -> tuple[Level, ...]:
    """Return the levels; above each there is one more row, equal to its first."""
    found, top = [], 1
    for power in range(LEVELS):
        rows = HEIGHT_PX >> power
        found.append(Level(1 << power, top, rows))
        top += rows + 1
    return tuple(found)


def level_of(zoom: float) -> Level:
    """Return the level whose pixels are nearest to a frame's in size; zoom: pixels of the strip in one of the frame."""
    return levels()[sum(zoom > 2 ** (power - 0.5) for power in range(1, LEVELS))]


@lru_cache(maxsize=2)
def atlas(habit: str = FERN) -> NDArray[np.uint8]:
    """Return (3, rows, WIDTH_PX), read-only: ridge, time and body, 0 to 255, of all levels below each other.

    Ridge: thickness of the crystals' ridges when they are old. Time: when ice comes. Body: of what lies between them.
    """
    import cv2

    ridge = _read("thickness", habit)
    time = cv2.resize(
        _wrapped(_read("time", habit), 2), None, fx=TIME_SHRUNK, fy=TIME_SHRUNK, interpolation=cv2.INTER_LINEAR
    )
    strip = np.dstack(
        [ridge, _in_patches(np.asarray(time[:, 2 * TIME_SHRUNK : -2 * TIME_SHRUNK], np.uint8)), _body(ridge)]
    )
    parts = []
    for level in levels():
        small = cv2.resize(strip, (WIDTH_PX // level.shrunk, level.rows), interpolation=cv2.INTER_AREA)
        repeated = np.tile(small, (1, level.shrunk, 1))
        parts += [repeated[:1], repeated]
    made = np.ascontiguousarray(np.concatenate(parts).transpose(2, 0, 1))
    made.flags.writeable = False
    return made


def atlas_picture(habit: str = FERN) -> BroughtImage:
    """Return the atlas as node groups take it."""
    digest = hashlib.sha256(b"".join(read_bytes(map_file(name, habit)) for name in ("thickness", "time"))).hexdigest()
    name = "NW Frost on a lens" if habit == FERN else "NW Feathers of frost on a lens"
    return BroughtImage(name, f"2 {digest[:16]}", lambda: atlas(habit).transpose(1, 2, 0))


def _in_patches(time: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return times of which those of some stretches of the edge are later; the last is as late as before."""
    along = np.linspace(0, 2 * np.pi, WIDTH_PX, endpoint=False)
    phases = stream("patches of frost").random(len(_PATCHES)) * 2 * np.pi
    waves = sum(np.cos(count * along + phase) for count, phase in zip(_PATCHES, phases, strict=True))
    rank = np.argsort(np.argsort(waves)) / (WIDTH_PX - 1)  # as many columns of each lateness
    return np.rint(time * (1 - _LATER) + 255 * _LATER * rank).astype(np.uint8)


def _read(name: str, habit: str) -> NDArray[np.uint8]:
    import cv2

    encoded = np.frombuffer(read_bytes(map_file(name, habit)), dtype=np.uint8)
    return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE), np.uint8)


def _body(ridge: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the ice between ridges."""
    thickness = ridge.astype(np.float32)
    body = sum(np.float32(share) * _blurred(thickness, width_px) for share, width_px in (_NEAR, _WIDE))
    depth_px = np.arange(HEIGHT_PX, dtype=np.float32)[:, None] + np.float32(0.5)
    body = body + np.float32(255 * _RIME[0]) * np.exp(depth_px / np.float32(-_RIME[1]))
    grain = _blurred(stream("grains of frost").standard_normal(ridge.shape, dtype=np.float32), _GRAIN[1])
    body *= np.clip(1 + np.float32(_GRAIN[0]) * grain / grain.std(), 0.35, 2)
    # Beyond the last row there is no ice.
    body *= np.clip((np.float32(HEIGHT_PX - 8) - depth_px) / np.float32(_FADE_PX), 0, 1)
    return np.rint(np.clip(body, 0, 255)).astype(np.uint8)


def _blurred(strip: Float32, sigma_px: float) -> Float32:
    import cv2

    reach = int(4 * sigma_px) + 1
    blurred = np.asarray(cv2.GaussianBlur(_wrapped(strip, reach), (0, 0), sigma_px), np.float32)
    return blurred[:, reach:-reach]


def _wrapped(strip: NDArray[T], columns: int) -> NDArray[T]:
    return np.pad(strip, ((0, 0), (columns, columns)), mode="wrap")


# Frost on the lens as a node group: the strip of ice looked up for two sides at once, aged, lit and looked through.


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
    ferns, feathers = (graph.picture(atlas_picture(habit)) for habit in (FERN, FEATHER))
    ice = _ice(canvas, graph.choose(given["feathers"], feathers, ferns), drawn, (centre, zoom, time))
    with graph.section("Slopes"):
        relief = graph.math("DOT_PRODUCT", ice, (RIDGE_RELIEF, 0.0, BODY_RELIEF))
        # The sum is positioned as its first operand is, so that is the relief that is not moved.
        right = graph.math("MULTIPLY_ADD", relief, -1.0, _neighbour(relief, 1.0, 0.0))
        down = graph.math("MULTIPLY_ADD", relief, -1.0, _neighbour(relief, 0.0, 1.0))
        slope = graph.vector(right, down) / _thrice(graph, zoom)
    with graph.section("Refraction"):
        source = graph.math("MULTIPLY_ADD", slope, _thrice(graph, given["refraction_px"]), centre)
        behind = _looked_up(canvas.image, source, graph.vector(canvas.width_px, canvas.height_px))
    light = _light_around(canvas, centre, given, short_px)
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


def _ice(canvas: Canvas, strips: Socket, drawn: Socket, place: tuple[Socket, Socket, Socket]) -> Socket:
    """Return (ridge, 0, body) at each pixel: the thickest of the ice from its nearest sides.

    x is of left and right, y of top and bottom. strips: the atlas. place: each pixel's centre, pixels of the strip in
    one, and how far ice has grown.
    """
    graph, (centre, zoom, time) = canvas.graph, place
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
            inputs = {"Image": strips, "UV": where, "Interpolation": "Bilinear"}
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


def _light_around(canvas: Canvas, centre: Socket, given: Mapping[str, Socket], short_px: Socket) -> Socket:
    """Return the light about each pixel, which its ice scatters: of the image, made smaller and blurred."""
    graph = canvas.graph
    with graph.section("Light around"):
        small, size = canvas.image, graph.vector(canvas.width_px, canvas.height_px, 1.0)
        for _ in range(HALVINGS):
            small, size = _halved(small, size)
        blur_px = short_px * (3 * LIGHT_SHARE / 2**HALVINGS)
        blurred = _spread_nodes(small, blur_px)
        halo = given["halo"]
        far = graph.choose(halo > 0.0, small, (0.0, 0.0, 0.0, 1.0))  # one colour costs nothing
        for times, share in HALO:
            wide = _spread_nodes(far, blur_px * times) - blurred
            blurred = graph.math("MULTIPLY_ADD", wide, _thrice(graph, halo * share), blurred)
        levels_of = [graph.node("CompositorNodeLevels", {"Image": small, "Channel": name}) for name in _CHANNELS]
        mean = graph.vector(*(node.out("Mean", "float") for node in levels_of))
        both = graph.mix(blurred, mean, (MEAN_SHARE,) * 3)
        grey = _thrice(graph, graph.math("DOT_PRODUCT", both, LUMINANCE))
        light = graph.mix(grey, both, _thrice(graph, given["tint"]))
        return _looked_up(light, centre * (2.0**-HALVINGS, 2.0**-HALVINGS, 0.0), size)


def _spread_nodes(image: Socket, reach_px: Socket) -> Socket:
    graph = image.graph
    inputs = {"Image": image, "Size": graph.vector(reach_px, reach_px), "Type": "Gaussian", "Separable": True}
    return graph.node("CompositorNodeBlur", inputs).out("Image", "color")


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


@dataclass(frozen=True)
class LensFrost:
    """Ice crystals that grow on the glass from its border inwards, with branches; the middle stays clear.

    Ridges displace what is behind them and glint; ice scatters light, so it shows that of its surroundings.
    """

    coverage: float = key("how far it has grown; 1 is as far as it gets", default=0.55, minimum=0, maximum=1)
    opacity: float = key("optical depth of the thickest ice", default=1.6, minimum=0, maximum=20)
    brightness: float = key("light that ice scatters, times that around it", default=1.6, minimum=0, maximum=20)
    tint: float = key("how far that light has the surroundings' colour", default=0.8, minimum=0, maximum=1)
    refraction_px: float = key("how far a slope of 1 displaces", default=10.0, unit="px", minimum=0, maximum=200)
    glint: float = key("light of glints, times that around them", default=1.0, minimum=0, maximum=50)
    feathers: bool = key(
        "ice grows in plumes that curl, as where water ran down the glass before; else its branches are straight",
        default=False,
        later=True,
    )
    halo: float = key(
        "share of the light that comes from further away, so that a bright lamp has a halo without an edge",
        default=0.0,
        minimum=0,
        maximum=1,
        later=True,
    )
    growth_per_s: float = key(
        "drift: how much coverage it gains; below 0 it thaws", default=0.03, unit="1/s", minimum=-10, maximum=10
    )
    frame_rate_hz: float = key(
        "frames a second, by which it grows", default=20.0, unit="Hz", minimum=0.001, maximum=100000
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "coverage": "Higher: ferns of ice reach further from the border towards the middle",
        "opacity": "Higher: the ice gets denser, and hides what is behind it",
        "brightness": "Higher: the ice gets lighter",
        "tint": "Higher: the ice has the colors of what is around it; 0 is white ice",
        "refraction_px": "Higher: crystals displace what is behind them further",
        "glint": "Higher: brighter glints on the crystals' edges",
        "feathers": "On: plumes of ice that curl; off: ferns with straight branches",
        "halo": "Higher: bright lamps behind the ice shine further around",
        "growth_per_s": "Higher: with the pattern Drift, ice grows faster; below 0 it thaws",
        "frame_rate_hz": "Higher: with the pattern Drift, ice grows less from frame to frame",
    }


@dataclass(frozen=True)
class FrostPane:
    """What is drawn for a pattern.

    start_px: the column of the strip at which the first side begins. flipped: which sides show it backwards: top,
    bottom, left, right. light_rad: where the light comes from, 0 to the right, downwards.
    """

    start_px: int
    flipped: tuple[bool, bool, bool, bool]
    light_rad: float


def pane_of(uniform: NDArray[np.float64]) -> FrostPane:
    """Return what three uniform numbers in [0, 1) draw."""
    sides = int(uniform[1] * 16)
    flipped = (bool(sides & 8), bool(sides & 4), bool(sides & 2), bool(sides & 1))
    start_px = int(uniform[0] * (WIDTH_PX // START_PX)) * START_PX
    return FrostPane(start_px, flipped, -math.pi * (0.25 + 0.5 * float(uniform[2])))


def apply(rgb: Float32, parameters: LensFrost, context: FrameContext) -> Float32:
    """Let frost grow before (H, W, 3)."""
    import cv2

    # On lit frames what the nodes draw; on others the draws of before, whose bytes stay.
    drawn = white_noise(context).numbers(0) if context.lit else context.pattern_stream().random(3)
    pane = pane_of(np.asarray(drawn, np.float64))
    grown_s = context.drift_frames / parameters.frame_rate_hz
    grown = min(max(parameters.coverage + parameters.growth_per_s * grown_s, 0.0), 1.0)
    linear = by_bands(rgb, rgb.dtype, decoded)
    ridge, body = ice_on(rgb.shape[:2], grown, pane, FEATHER if parameters.feathers else FERN)
    right, down = slopes(ridge, body, SHORT_SIDE_PX / min(rgb.shape[:2]))
    behind = _refracted(linear, right, down, parameters.refraction_px)
    light = _lens_frost_light_around(linear, parameters.tint, parameters.halo)
    towards = np.float32(math.cos(pane.light_rad)), np.float32(math.sin(pane.light_rad))

    def frosted(band: Float32, around: Float32, *ice: Float32) -> Float32:
        ridge, body, right, down = ice
        thick = np.asarray(cv2.addWeighted(ridge, -RIDGE_OPACITY, body, -1.0, 0.0), np.float32).reshape(ridge.shape)
        seen = np.asarray(cv2.exp(thick * np.float32(parameters.opacity)), np.float32).reshape(thick.shape)
        lean = right * towards[0] + down * towards[1]
        white = np.asarray(np.clip(lean * np.float32(SHADE), DARKEST, LIGHTEST), np.float32)
        white += np.float32(1)
        white *= (np.float32(1) - seen) * np.float32(parameters.brightness)
        glints = np.clip(lean * np.float32(GLINT_SLOPE) - np.float32(GLINT_FROM), 0, 1)
        white += glints * glints * np.float32(parameters.glint)
        band *= three_channels(seen)
        band += around * three_channels(white)
        return encoded(band)

    return by_bands(behind, rgb.dtype, frosted, light, ridge, body, right, down)


def ice_on(size: tuple[int, int], grown: float, pane: FrostPane, habit: str = FERN) -> tuple[Float32, Float32]:
    """Return (H, W) each: thickness of ridges and of the ice about them, from 0 to 1.

    grown: how far they have grown, from 0 to 1.
    """
    height, width = size
    zoom = SHORT_SIDE_PX / min(size)
    level = level_of(zoom)
    planes = np.zeros((2, height, width), np.float32)
    deep = min(math.ceil(HEIGHT_PX / zoom), (min(size) + 1) // 2)
    for number, flipped in enumerate(pane.flipped):
        start = (pane.start_px + number * (WIDTH_PX // 4)) // level.shrunk
        length = width if number < 2 else height
        part = _part(level, zoom / level.shrunk, start, (deep, length), habit)
        parts = _aged(part, grown * (1 + RISE))
        for plane, part in zip(planes, parts, strict=True):
            turned = part[:, ::-1] if flipped else part
            if number >= 2:
                turned = turned.T
            shown = (plane[:deep], plane[-deep:], plane[:, :deep], plane[:, -deep:])[number]
            last = (np.s_[:], np.s_[::-1], np.s_[:], np.s_[:, ::-1])[number]
            np.maximum(shown, turned[last], out=shown)
    return planes[0], planes[1]


def _part(level: Level, step: float, start: int, size: tuple[int, int], habit: str = FERN) -> Float32:
    """Return (3, *size) of a level from a column on; step: its pixels in one of the frame, interpolated linearly."""
    deep, length = size
    strip = atlas(habit)[:, level.top : level.top + level.rows]
    if step == 1:
        part = strip[:, :deep].take(np.arange(start, start + length) % WIDTH_PX, axis=2)
        return part * np.float32(1 / 255)
    # OpenCV's warps round places to 1/32 pixel in versions before 5, so here they are not used.
    columns, right = _places(length, step)
    rows, below = _places(deep, step)
    first, second = (strip.take((start + columns + k) % WIDTH_PX, axis=2) for k in (0, 1))
    part = first * (np.float32(1) - right) + second * right
    upper, lower = (part.take(np.clip(rows + k, 0, level.rows - 1), axis=1) for k in (0, 1))
    below = (below * np.float32(1 / 255))[:, None]
    return np.asarray(upper * (np.float32(1 / 255) - below) + lower * below, np.float32)


def _places(count: int, step: float) -> tuple[NDArray[np.int64], Float32]:
    """Return for pixels of a frame the pixel of the strip before each one's middle, and how far it is behind that."""
    places = (np.arange(count) + 0.5) * step - 0.5
    before = np.floor(places).astype(np.int64)
    return before, (places - before).astype(np.float32)


def _aged(part: Float32, time: float) -> tuple[Float32, Float32]:
    """Return ridge and body at a time, of (3, ...) ridge, time and body."""
    ridge, since, body = part
    age = np.maximum(np.float32(time) - since, 0)
    ridge *= np.minimum(age * np.float32(1 / RISE), 1)
    body *= np.minimum(age * np.float32(1 / AGING), 1)
    return ridge, body


def slopes(ridge: Float32, body: Float32, zoom: float) -> tuple[Float32, Float32]:
    """Return how steeply ice, (H, W) each, rises to the right and downwards, in a pixel of the strip; 0 at the ends."""
    relief = np.float32(RIDGE_RELIEF / zoom) * ridge
    relief += np.float32(BODY_RELIEF / zoom) * body
    right, down = np.zeros_like(relief), np.zeros_like(relief)
    np.subtract(relief[:, 1:], relief[:, :-1], out=right[:, :-1])
    np.subtract(relief[1:], relief[:-1], out=down[:-1])
    return right, down


def _refracted(linear: Float32, right: Float32, down: Float32, refraction_px: float) -> Float32:
    """Return (H, W, 3), each pixel taken from where the slope of the ice before it leads."""
    import cv2

    height, width = right.shape
    columns = right * np.float32(refraction_px) + np.arange(width, dtype=np.float32)
    rows = down * np.float32(refraction_px) + np.arange(height, dtype=np.float32)[:, None]
    taken = cv2.remap(linear, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(taken, np.float32).reshape(linear.shape)


def _lens_frost_light_around(linear: Float32, tint: float, halo: float) -> Float32:
    """Return (H, W, 3): the light about each pixel, which its ice scatters, in part without its colour."""
    import cv2

    height, width = linear.shape[:2]
    small = linear
    for _ in range(HALVINGS):
        odd = small.shape[0] % 2, small.shape[1] % 2
        small = cv2.copyMakeBorder(small, 0, odd[0], 0, odd[1], cv2.BORDER_REPLICATE)
        small = np.asarray(cv2.resize(small, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.float32)
    sigma_px = LIGHT_SHARE * min(height, width) / 2**HALVINGS
    blurred = _spread(small, sigma_px)
    for times, share in HALO if halo else ():
        blurred = blurred + np.float32(halo * share) * (_spread(small, sigma_px * times) - blurred)
    blurred += np.float32(MEAN_SHARE) * (np.array(cv2.mean(small)[:3], np.float32) - blurred)
    grey = three_channels(blurred @ np.array(LUMINANCE, np.float32))
    light = grey + np.float32(tint) * (blurred - grey)
    large = cv2.resize(light, None, fx=2**HALVINGS, fy=2**HALVINGS, interpolation=cv2.INTER_LINEAR)
    return np.asarray(large, np.float32)[:height, :width]


def _spread(image: Float32, sigma_px: float) -> Float32:
    """Return an image (H, W, 3) blurred by a Gaussian."""
    import cv2

    reach_px = math.ceil(3 * sigma_px)  # where Blender cuts it off
    kernel_px = 2 * reach_px + 1, 2 * reach_px + 1
    made = cv2.GaussianBlur(image, kernel_px, sigma_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(made, np.float32).reshape(image.shape)


PERTURBATION = ColourPerturbation(
    name="lens_frost",
    label="Lens frost",
    stage="lens",
    order=58,
    parameters=LensFrost,
    severities={"coverage": (0.22, 0.38, 0.55, 0.78, 1.0), "opacity": (1.0, 1.3, 1.6, 2.0, 2.5)},
    source="our own: from a frosted border to a pane that is iced over but for its middle",
    about=About(
        "Grows crystals of ice on the glass, from its border inwards",
        "ferns of ice that grow on the glass from the border inwards",
        example=Example(
            text="Frost on the lens in the embedded room, clean and at severities 1, 3 and 5, and while it grows.",
            settings=(
                "{sweep: {perturb: [lens_frost], severities: [1, 3, 5]}}",
                "{name: lens_frost_grows, perturb: [{lens_frost: {severity: 1, temporal: drift, frame_rate_hz: 1}}]}",
            ),
        ),
    ),
    apply=apply,
    newly={"feathers": True, "halo": 0.3},
    version=2,  # ice comes in patches, and takes more of the light behind it
    nodes=Nodes(build, linear=True, draws_lit=True),
    temporals=("fresh", "fixed", "drift"),
    tinted=True,
)
