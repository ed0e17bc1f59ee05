# SPDX-License-Identifier: GPL-3.0-or-later
"""Drops on the glass, on arrays: painted by size on the glass's image, which is blurred and laid over the frame."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Graph, Socket
from ...core.schema import key
from ...core.srgb import decoded
from ..kinds import FrameContext
from ._arrays import by_bands, view_key
from ._glass import Pane, blurred, laid_over, pane, reduced, shown_at
from ._noise import WhiteNoise, white_noise

# Position, size, drying and running of drops on the glass; shared by both executions of lens_drops.
#
# Drops of a class of diameters, an octave each, have cells of their own, and a drop lies within its cell. A cell's
# clock goes round as its drop dries; each turn draws, by a hash of cell and turn, whether a drop lands, where, and
# how large. A strip of the glass has a clock of its own by which a drop grows, runs down, and leaves beads behind. So
# any frame follows from its number alone. Lengths are in pixels of the reference width; y is counted from the top.


# --- classes of diameters; multiples of the median diameter ---

LARGEST = 4.0  # of the first class; the others are halves of the one before
CLASSES = 4
CELL_WIDTH = 1.15  # of the largest diameter of the class
CELL_HEIGHT = 1.35
TALL = (1.18, 1.1, 1.05, 1.0)  # height of a drop over its width: large ones sag
SAG = (0.2, 0.12, 0.05, 0.0)  # how much wider than its middle a drop is at its foot, and narrower at its head
ROW_SHIFT = 0.38  # of a cell's width from row to row, so that cells form no columns
START = (8.21, 9.47, 8.83, 9.62)  # cells before the frame's corner: numbers of cells stay above 0
TURNS = 4096  # cells along a row that numbers of a turn do not repeat in
PRESENT = 0.6180339887  # the golden ratio's: shares of turns with a drop are spread evenly
CLEAR = 2.0  # square of the distance, in radii, up to which a drop has taken in its smaller neighbours
UNMARKED = 0.6  # share of what is taken that leaves no rim where a drop is cut back
LOGISTIC = 1.702  # a logistic curve of this steepness is the normal distribution's within 0.01

# --- the glass's unevenness, which makes drops irregular: waves in x and y; multiples of the median diameter ---

WAVES = ((0.3, 1.2), (0.08, 0.5))  # amplitude, and length / 2 pi
SWING = math.fsum(amplitude for amplitude, _ in WAVES)
SLANT = 0.8  # of the second wave's length in the other direction

# --- running drops; multiples of the median diameter ---

STRIP = 4.6  # width of a strip
STRIP_START = 8.37
REST = 0.2  # share of its turn in which a drop grows before it runs
BELOW = 1.35  # heights of the frame after which it has gone
HIGHEST, LOWEST = -0.3, 0.6  # heights of the frame between which it begins
RUN_RADIUS = (0.7, 0.5)  # least, and what is added at most
SMALL_AT_REST = 0.3  # square of its radius when it lands, of the one with which it runs
STICK = ((0.015, 5.0), (0.005, 13.0))  # stick and slip: amplitude and waves along the way; slopes stay below 1
ASIDE = 0.3  # of a strip's width: how far a way lies beside the strip's middle
WINDING = ((0.16, 2.1), (0.3, 6.5))  # amplitude, and length / 2 pi
TAIL = 0.5  # height above its middle is shortened to this before its distance is taken
TAPER = 0.3
TRAIL = 22.0  # length of what it leaves
TRACK = 0.75  # of its radius: half the width of what it wipes
BEADS = 0.85  # from bead to bead
BEAD_START = 64.0
BEAD_RADIUS = (0.13, 0.3)

# --- looks ---

HALVINGS = 4  # from the frame to what drops show: they make it so much smaller that fewer would leave out lamps

GLINT_AT = (-0.33, -0.42)  # of a drop's radius: to the left and above
GLINT_RADIUS = 0.2
CAUSTIC_AT, CAUSTIC_WIDTH = 0.78, 0.2  # of a drop's radius: where light gathers, and half how wide; chosen


@dataclass(frozen=True)
class LensDrops:
    """Drops of water on the glass before the lens, which refract the scene, run down and dry.

    The glass is out of focus, so drops are soft; what is beside them stays sharp. Diameters are log-normal. A large
    drop keeps its surroundings clear, and one that runs leaves a trail of beads. Works on linear light.
    """

    coverage: float = key("share of the glass under drops", default=0.14, minimum=0, maximum=0.5)
    size_px: float = key(
        "median diameter of a drop that has just landed", default=22.0, unit="px", minimum=4, maximum=400
    )
    spread: float = key("standard deviation of the diameter's logarithm", default=0.6, minimum=0.2, maximum=2)
    focus_px: float = key("radius of the blur of a point on the glass", default=5.0, unit="px", minimum=0, maximum=60)
    contact_deg: float = key(
        "angle at which a drop's surface meets the glass", default=60.0, unit="deg", minimum=5, maximum=90
    )
    rim: float = key(
        "light of a rim through which none passes, times the scene's mean", default=0.15, minimum=0, maximum=10
    )
    glint: float = key("light of the reflection on a drop, times the scene's mean", default=2.0, minimum=0, maximum=100)
    caustic: float = key(
        "light that gathers in a crescent at a drop's lower edge, times what is seen there; 0 is none",
        default=0.0,
        minimum=0,
        maximum=20,
        later=True,
    )
    runs: float = key("share of the glass's strips down which a drop runs", default=0.25, minimum=0, maximum=1)
    run_px: float = key(
        "drift: how far such a drop runs down a frame", default=3.0, unit="px", minimum=0, maximum=1000, slider=(0, 10)
    )
    drying: float = key(
        "drift: share of the drops that dry, and land anew, a frame", default=0.003, minimum=0, maximum=1
    )
    view_deg: float = view_key()
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "coverage": "Higher: more drops on the glass",
        "size_px": "Higher: larger drops, and fewer",
        "spread": "Higher: drops differ more in size",
        "focus_px": "Higher: drops, and what they show, get softer; 0 is a lens that focuses on the glass",
        "contact_deg": "Higher: steeper drops, which show more of the scene and have darker rims",
        "rim": "Higher: lighter rims; 0 is black",
        "glint": "Higher: a brighter highlight on each drop",
        "caustic": "Higher: a brighter crescent at each drop's lower edge, where light from above gathers",
        "runs": "Higher: more drops run down",
        "run_px": "Higher: with the pattern Drift, drops run faster",
        "drying": "Higher: with the pattern Drift, drops dry and land more often",
        "view_deg": "Higher: a wider view, so a drop shows what is nearer to it in the picture",
    }


@dataclass(frozen=True)
class OfClass:
    """A class's mean area of a drop, with what has dried, and its cell's, over the square of the median diameter."""

    area: float
    cell: float


def of_class(number: int) -> OfClass:
    """Return the areas of class 0 to 3.

    Inside an octave the logarithm of the diameter d is uniform: the mean of d^2 is 3 / (8 ln 2) of the largest's. As a
    drop dries its area falls steadily to 0, as evaporation has it (the d^2 law), so half is left on average.
    """
    largest = LARGEST * 0.5**number
    area = math.pi / 4 * 3 / (8 * math.log(2)) * largest**2 * TALL[number] / 2
    return OfClass(area, largest**2 * CELL_WIDTH * CELL_HEIGHT)


def drying_rate(number: int) -> float:
    """Return how often a class's drops dry, of the median's rate: a drop lasts in proportion to its diameter."""
    return 2.0 ** (number - (CLASSES - 1) / 2)


# What is seen through a drop of water on a pane: a spherical cap that bends the light, on arrays and as nodes.
#
# A ray that meets the pane at a right angle goes on straight to the drop's surface, whose normal is tilted there by
# alpha: sin(alpha) = rho sin(contact angle), with rho the distance from the drop's middle as a share of its radius.
# By Snell's law it leaves at beta, sin(beta) = n sin(alpha), bent towards the drop's axis by beta - alpha. What
# passes follows Fresnel's equations for unpolarised light; beyond the critical angle nothing does. Halimeh and Roser,
# "Raindrop detection on car windshields using geometric-photometric environment construction and intensity-based
# correlation", 2009, and von Bernuth, Volk and Bringmann, "Rendering physically correct raindrops on windshields for
# robustness verification of camera-based object recognition", 2018, trace rays through the same cap.


T = TypeVar("T")

Float32: TypeAlias = NDArray[np.float32]

WATER = 1.333  # refractive index
LEAST = 1e-6  # of a cosine's square: keeps roots and quotients finite at the critical angle


@dataclass(frozen=True)
class Bent(Generic[T]):
    """Of each ray: tangent of the angle by which it is bent towards the drop's axis, and the share of its light."""

    tangent: T
    passes: T


def bent(rho: Float32, contact_sine: float) -> Bent[Float32]:
    """Return what a cap does at rho, the share of its radius, in [0, 1]."""
    sine = rho * np.float32(contact_sine)
    inside, outside, beyond = _cosines(sine)
    out_sine = np.minimum(sine * np.float32(WATER), np.float32(1))
    turned = outside * inside + out_sine * sine
    tangent = (out_sine * inside - outside * sine) / turned
    across = (WATER * inside - outside) / (WATER * inside + outside)
    along = (WATER * outside - inside) / (WATER * outside + inside)
    passes = 1 - (across * across + along * along) / 2
    return Bent(tangent.astype(np.float32), (passes * beyond).astype(np.float32))


def _cosines(sine: Float32) -> tuple[Float32, Float32, Float32]:
    """Return the cosines of alpha and beta, and 1 where light leaves, 0 beyond the critical angle."""
    squared = sine * sine
    left = 1 - np.float32(WATER**2) * squared
    inside = np.sqrt(np.maximum(1 - squared, np.float32(LEAST)))
    return inside, np.sqrt(np.maximum(left, np.float32(LEAST))), (left > 0).astype(np.float32)


def bent_nodes(graph: Graph, rho_squared: Socket, contact_sine: Socket) -> Bent[Socket]:
    """Return the same as nodes, by the square of rho."""
    squared = rho_squared * (contact_sine * contact_sine)
    sine = graph.math("SQRT", squared)
    left = graph.math("MULTIPLY_ADD", squared, -(WATER**2), 1.0)
    inside = graph.math("SQRT", graph.math("MAXIMUM", 1.0 - squared, LEAST))
    outside = graph.math("SQRT", graph.math("MAXIMUM", left, LEAST))
    out_sine = graph.math("MINIMUM", sine * WATER, 1.0)
    turned = graph.math("MULTIPLY_ADD", outside, inside, out_sine * sine)
    tangent = (out_sine * inside - outside * sine) / turned
    across = graph.math("MULTIPLY_ADD", inside, WATER, outside * -1.0)
    across = across / graph.math("MULTIPLY_ADD", inside, WATER, outside)
    along = graph.math("MULTIPLY_ADD", outside, WATER, inside * -1.0)
    along = along / graph.math("MULTIPLY_ADD", outside, WATER, inside)
    both = graph.math("MULTIPLY_ADD", across, across, along * along)
    passes = graph.math("MULTIPLY_ADD", both, -0.5, 1.0) * (left > 0.0)
    return Bent(tangent, passes)


# The sheet that drops are painted on: for each pixel of the glass's image, where in which drop it lies.


Indices: TypeAlias = NDArray[np.intp]
Turns: TypeAlias = tuple[np.float32, ...]


@dataclass(frozen=True)
class DropSheet:
    """All arrays are (h * w,). x_px, y_px: each pixel's place on the even glass, in pixels of the frame.

    rho_squared: square of the distance from the middle of its drop, in radii; 1 where there is none. aside, down: the
    direction from there. taken: from 1 on, drops painted later are not there; between 0 and 1 they are cut back.
    """

    pane: Pane
    x_px: Float32
    y_px: Float32
    rho_squared: Float32
    aside: Float32
    down: Float32
    taken: Float32

    @classmethod
    def of(cls, pane: Pane, size_px: float, turns: Turns) -> "DropSheet":
        """Return a sheet without drops. size_px: their median diameter. turns: as `uneven` has them."""
        x, y = uneven(pane, size_px, turns)
        zeros = [np.zeros(x.size, np.float32) for _ in range(3)]
        return cls(pane, x.ravel(), y.ravel(), np.ones(x.size, np.float32), *zeros)

    def paint(self, pixels: Indices, aside: Float32, down: Float32) -> None:
        """Paint drops where none is yet. pixels: (M,), each once; aside, down: from its drop's middle, in radii."""
        taken = self.taken.take(pixels)
        squared = aside * aside
        squared += down * down
        squared += taken
        (inside,) = np.nonzero(squared < 1)
        chosen = pixels.take(inside)
        self.rho_squared[chosen] = squared.take(inside) - taken.take(inside) * np.float32(UNMARKED)
        self.aside[chosen], self.down[chosen] = aside.take(inside), down.take(inside)
        self.taken[pixels] = np.maximum(taken, np.float32(CLEAR) - squared)


def turns_of(noise: WhiteNoise) -> Turns:
    """Draw the phases of the glass's waves, radians."""
    first, second, third = noise.numbers(30)
    return tuple(np.float32(2 * math.pi * item) for item in (first, second, third, noise.numbers(31)[0]))


def uneven(pane: Pane, size_px: float, turns: Turns) -> tuple[Float32, Float32]:
    """Return (h, w) x and y of each pixel on the even glass, in pixels of the frame: waves make the drops irregular.

    turns: four, the waves' phases.
    """
    one = np.float32
    x, y = pane.x_px[None, :], pane.y_px[:, None]
    (large, long), (small, short) = (
        (one(amplitude * size_px), one(1 / (length * size_px))) for amplitude, length in WAVES
    )
    slant = one(short * SLANT)
    across = np.sin(y * long + turns[0]) * large + x
    across += np.sin(y * short + turns[1] + x * slant) * small
    up = np.sin(x * long + turns[2]) * large + y
    up += np.sin(x * short + turns[3] - y * slant) * small
    return across, up


# Drops that run down the glass, on arrays: what they wipe, and the beads that they leave.


@dataclass(frozen=True)
class Runs:
    """A running drop for each strip, (N,). first: the first strip's number. there: whether it has one.

    number: of the strip's turn, which beads are drawn by. begin_px, at_px: rows where it began, and where it is.
    radius_px: its own. middle_px: its way's column. winding: (2, N) phases of the way's waves, radians.
    """

    first: int
    there: NDArray[np.bool_]
    number: Float32
    begin_px: Float32
    at_px: Float32
    radius_px: Float32
    middle_px: Float32
    winding: Float32


def runs_on(size_px: tuple[int, int], parameters: LensDrops, noise: WhiteNoise, frames: int) -> Runs:
    """Return what runs down a glass of width and height."""
    one = np.float32
    width_px, height_px = size_px
    strip_px = STRIP * parameters.size_px
    first = math.floor(STRIP_START) - 1
    strip = np.arange(first, math.floor(width_px / strip_px + STRIP_START) + 2, dtype=np.float32)
    phase, pace, often = noise.random(8, strip, np.zeros_like(strip))
    way_px = height_px * BELOW / (1 - REST)
    turned = (pace * one(0.8) + one(0.6)) * (one(frames) * one(parameters.run_px / way_px)) + phase
    turn = np.floor(turned)
    age = turned - turn
    there = (often + turn * one(PRESENT)) % one(1) < one(parameters.runs)
    number = turn * one(TURNS) + strip
    high, beside, large = noise.random(9, number, np.zeros_like(strip))
    begin_px = one(height_px) * (high * one(LOWEST - HIGHEST) + one(HIGHEST))
    gone = np.maximum((age - one(REST)) * one(1 / (1 - REST)), 0)
    way = gone
    for amplitude, waves in STICK:
        way = way + np.sin(gone * one(2 * math.pi * waves)) * one(amplitude)
    at_px = begin_px + way * (one(height_px * BELOW) - begin_px)
    rested = np.minimum(age * one(1 / REST), 1)
    grown = np.sqrt(rested * one(1 - SMALL_AT_REST) + one(SMALL_AT_REST))
    radius_px = (large * one(RUN_RADIUS[1]) + one(RUN_RADIUS[0])) * grown * one(parameters.size_px)
    middle_px = (strip + (beside - one(0.5)) * one(ASIDE) + one(0.5 - STRIP_START)) * one(strip_px)
    winding = np.stack([beside, high]) * one(4 * math.pi)
    made = (np.asarray(item, np.float32) for item in (number, begin_px, at_px, radius_px, middle_px, winding))
    return Runs(first, there, *made)


@dataclass(frozen=True)
class Beads:
    """What running drops have left: rows of places, a place for each strip. Arrays are (rows * strips,).

    first: the first row's number. left: whether a bead is there. middle_px: its row on the glass. aside_px: from the
    way. per_px: 1 / radius.
    """

    first: int
    left: NDArray[np.bool_]
    middle_px: Float32
    aside_px: Float32
    per_px: Float32


def beads_of(runs: Runs, height_px: int, parameters: LensDrops, noise: WhiteNoise) -> Beads:
    """Return what running drops have left on a glass of a height."""
    one, size_px = np.float32, parameters.size_px
    step_px, swing_px = BEADS * size_px, SWING * size_px
    first = math.floor(BEAD_START - swing_px / step_px)
    end = math.floor((height_px + swing_px) / step_px + BEAD_START) + 1
    row = np.arange(first, end, dtype=np.float32)[:, None]
    number, beads = np.broadcast_arrays(runs.number, row)
    drawn = noise.random(10, number.ravel(), beads.ravel())
    thick, beside, low = (item.reshape(beads.shape) for item in drawn)
    middle_px = (low * one(0.5) + one(0.25 - BEAD_START) + beads) * one(step_px)
    fade = np.clip(1 - (runs.at_px - middle_px) * one(1 / (TRAIL * size_px)), 0, 1)
    radius_px = (thick * thick * one(BEAD_RADIUS[1]) + one(BEAD_RADIUS[0])) * one(size_px) * np.sqrt(fade)
    left = (middle_px < runs.at_px - one(1.3) * runs.radius_px) & (middle_px > runs.begin_px) & (fade > 0)
    aside_px = (beside - one(0.5)) * one(0.5 * size_px)
    made = (middle_px, aside_px, 1 / np.maximum(radius_px, one(1e-3)))
    return Beads(first, left.ravel(), *(np.asarray(item, np.float32).ravel() for item in made))


def paint_runs(sheet: DropSheet, runs: Runs, beads: Beads, parameters: LensDrops) -> None:
    """Paint the running drops, their beads and their tracks."""
    one, size_px = np.float32, parameters.size_px
    # The pixels of strips that have one, between where it began and where it is.
    strip = (sheet.x_px * one(1 / (STRIP * size_px)) + one(STRIP_START)).astype(np.intp) - runs.first
    top_px = np.where(runs.there, runs.begin_px - 4 * runs.radius_px, one(np.inf))
    seen = (sheet.y_px > top_px.take(strip)) & (sheet.y_px < (runs.at_px + 2 * runs.radius_px).take(strip))
    (pixels,) = np.nonzero(seen)
    strip, y_px = strip.take(pixels), sheet.y_px.take(pixels)
    aside_px = sheet.x_px.take(pixels) - runs.middle_px.take(strip)
    for (amplitude, length), phase in zip(WINDING, runs.winding, strict=True):
        aside_px -= np.sin(y_px * one(1 / (length * size_px)) + phase.take(strip)) * one(amplitude * size_px)
    per_px = (1 / runs.radius_px).take(strip)
    at_px, begin_px = runs.at_px.take(strip), runs.begin_px.take(strip)
    behind_px = at_px - y_px
    _paint_drop(sheet, pixels, np.multiply(aside_px, per_px), np.multiply(behind_px, per_px))
    bead = (y_px * one(1 / (BEADS * size_px)) + one(BEAD_START)).astype(np.intp) - beads.first
    _paint_beads(sheet, beads, bead * len(runs.number) + strip, (pixels, aside_px, y_px))
    fresh = np.clip(2 - behind_px * one(2 / (TRAIL * size_px)), 0, 1)
    across = aside_px * per_px * one(1 / TRACK)
    wiped = np.clip(3 - 3 * across * across, 0, 1) * fresh * ((behind_px > 0) & (y_px > begin_px))
    sheet.taken[pixels] = np.maximum(sheet.taken.take(pixels), wiped)


def _paint_drop(sheet: DropSheet, pixels: Indices, aside: Float32, behind: Float32) -> None:
    """Paint running drops, drawn out above. aside, behind: (M,) from the middle, in radii."""
    above = np.maximum(behind, 0)
    narrow = 1 - np.float32(TAPER) * np.minimum(above * np.float32(0.5), 1)
    sheet.paint(pixels, aside / narrow, above * np.float32(1 - TAIL) - behind)


def _paint_beads(sheet: DropSheet, beads: Beads, own: Indices, where: tuple[Indices, Float32, Float32]) -> None:
    """Paint what running drops have left. own: (M,) the bead of each pixel. where: pixels, from the way, and rows."""
    pixels, aside_px, y_px = where
    (kept,) = np.nonzero(beads.left.take(own))
    own = own.take(kept)
    per_px = beads.per_px.take(own)
    aside = (aside_px.take(kept) - beads.aside_px.take(own)) * per_px
    sheet.paint(pixels.take(kept), aside, (y_px.take(kept) - beads.middle_px.take(own)) * per_px)


ROWS = 48  # of a band of the glass's image; chosen so that its arrays stay in the processor's cache


def seen_through(rgb: Float32, parameters: LensDrops, context: FrameContext) -> Float32:
    """Return (H, W, 3) as it is seen through drops."""
    linear = by_bands(rgb, rgb.dtype, decoded)
    glass = pane(rgb.shape[:2], parameters.focus_px)
    camera = context.intrinsics
    focal_px = rgb.shape[1] / 2 / math.tan(math.radians(parameters.view_deg) / 2) if camera is None else camera.fx_px
    small = reduced(linear, HALVINGS)
    mean = small.mean(axis=(0, 1))
    layer = np.empty((*glass.shape, 4), np.float32)
    for top, sheet in sheets(glass, parameters, white_noise(context), context.drift_frames):
        band = refracted(small, mean, sheet, focal_px, parameters)
        layer[top : top + len(band)] = band
    return laid_over(rgb, linear, blurred(layer, glass, parameters.focus_px))


def sheets(glass: Pane, parameters: LensDrops, noise: WhiteNoise, frames: int) -> Iterator[tuple[int, DropSheet]]:
    """Yield bands of the glass's image, each with its first row, and which drops are there.

    frames: how many the drops have moved on. A band's arrays stay in the processor's cache, which halves the time.
    """
    runs, turns = runs_on(glass.size_px, parameters, noise, frames), turns_of(noise)
    beads = beads_of(runs, glass.size_px[1], parameters, noise)
    classes = [cells_of(number, parameters, glass.size_px, noise, frames) for number in range(CLASSES)]
    for top in range(0, glass.shape[0], ROWS):
        sheet = DropSheet.of(glass.rows(top, top + ROWS), parameters.size_px, turns)
        paint_runs(sheet, runs, beads, parameters)
        for cells in classes:
            paint_class(sheet, cells)
        yield top, sheet


def shares(parameters: LensDrops) -> list[float]:
    """Return for each class the share of its cells that hold a drop."""
    curve = [1 / (1 + math.exp(-LOGISTIC * times * math.log(2) / parameters.spread)) for times in (0, 1, 2)]
    inner, outer = curve[1] - curve[0], curve[2] - curve[1]
    often = [outer, inner, inner, outer]
    classes = [of_class(number) for number in range(CLASSES)]
    area = math.fsum(share * item.area for share, item in zip(often, classes, strict=True))
    dense = -math.log(1 - parameters.coverage) / area
    return [min(1.0, dense * share * item.cell) for share, item in zip(often, classes, strict=True)]


@dataclass(frozen=True)
class Cells:
    """A class's cells: rows and columns of them, from a first row and column, and the N drops in them.

    number: of the class. size_px: width and height of a cell, in pixels of the frame. first: row and column. columns:
    in a row. drop: (rows * columns,) the cell's drop, -1 where there is none. aside_px, down_px: (N,) a drop's middle,
    from the cell's left and top. per_px: (N,) 1 / radius.
    """

    number: int
    size_px: tuple[float, float]
    first: tuple[int, int]
    columns: int
    drop: NDArray[np.intp]
    aside_px: Float32
    down_px: Float32
    per_px: Float32


def cells_of(number: int, parameters: LensDrops, glass_px: tuple[int, int], noise: WhiteNoise, frames: int) -> Cells:
    """Return what is in the cells of a class before a glass of width and height."""
    one = np.float32
    largest_px = LARGEST * 0.5**number * parameters.size_px
    width_px, height_px = CELL_WIDTH * largest_px, CELL_HEIGHT * largest_px
    start, swing_px = START[number], SWING * parameters.size_px
    first = math.floor(start - swing_px / height_px)
    rows = range(first, math.floor((glass_px[1] + swing_px) / height_px + start) + 1)
    left = math.floor(start - swing_px / width_px + first * ROW_SHIFT)
    right = math.floor((glass_px[0] + swing_px) / width_px + start + rows[-1] * ROW_SHIFT)
    row, column = np.meshgrid(np.array(rows, np.float32), np.arange(left, right + 1, dtype=np.float32), indexing="ij")
    row, column = row.ravel(), column.ravel()
    phase, pace, often = noise.random(2 * number, column, row)
    turned = (pace + one(0.5)) * (one(frames) * one(parameters.drying * drying_rate(number))) + phase
    turn = np.floor(turned)
    (there,) = np.nonzero((often + turn * one(PRESENT)) % one(1) < one(shares(parameters)[number]))
    scale, right_share, low = noise.random(2 * number + 1, (turn * one(TURNS) + column)[there], row[there])
    diameter_px = np.power(one(0.5), scale) * one(largest_px)
    aside_px = right_share * one(width_px) + diameter_px * (one(0.5) - right_share)
    down_px = low * one(height_px) + diameter_px * (one(0.5) - low) * one(TALL[number])
    per_px = one(2) / (diameter_px * np.sqrt(1 - (turned - turn)[there]))
    place = np.full(row.size, -1, np.intp)
    place[there] = np.arange(len(there))
    made = (np.asarray(item, np.float32) for item in (aside_px, down_px, per_px))
    return Cells(number, (width_px, height_px), (first, left), right + 1 - left, place, *made)


def paint_class(sheet: DropSheet, cells: Cells) -> None:
    """Paint the drops of a class where no larger one is."""
    one = np.float32
    width_px, height_px = cells.size_px
    start = one(START[cells.number])
    v = sheet.y_px * one(1 / height_px)
    v += start
    row = np.floor(v)
    u = sheet.x_px * one(1 / width_px)
    u += start
    u += row * one(ROW_SHIFT)
    column = np.floor(u)
    first = cells.first[0] * cells.columns + cells.first[1]
    cell = (row * one(cells.columns) + (column - one(first))).astype(np.intp)
    drop = cells.drop.take(cell)
    (pixels,) = np.nonzero(drop >= 0)
    drop = drop.take(pixels)
    per_px = cells.per_px.take(drop)
    u -= column
    v -= row
    aside = (u.take(pixels) * one(width_px) - cells.aside_px.take(drop)) * per_px
    down = (v.take(pixels) * one(height_px) - cells.down_px.take(drop)) * per_px
    down *= one(1 / TALL[cells.number])
    aside *= 1 - one(SAG[cells.number]) * down
    sheet.paint(pixels, aside, down)


def crescent(rho: Float32, down: Float32) -> Float32:
    """Return how much light gathers at rho, the share of a drop's radius: a crescent at its lower edge, 1 at most.

    What a drop shows there comes from above; the steeper the surface, the more of that a place gathers, until none
    passes. down: of the direction from the drop's middle.
    """
    near = np.maximum(1 - np.square((rho - np.float32(CAUSTIC_AT)) * np.float32(1 / CAUSTIC_WIDTH)), np.float32(0))
    return near * near * np.square(np.maximum(down, np.float32(0)))


def refracted(small: Float32, mean: Float32, sheet: DropSheet, focal_px: float, parameters: LensDrops) -> Float32:
    """Return (h, w, 4): the light of the drops before each pixel of the glass, and where drops are.

    small: the frame made smaller, linear light. mean: (3,) its mean. focal_px: of the camera.
    """
    pixels = np.flatnonzero(sheet.rho_squared < 1)
    layer = np.zeros((sheet.rho_squared.size, 4), np.float32)
    if not pixels.size:
        return layer.reshape(*sheet.pane.shape, 4)
    rho = np.sqrt(sheet.rho_squared.take(pixels))
    aside, down = sheet.aside.take(pixels), sheet.down.take(pixels)
    length = np.maximum(np.hypot(aside, down), np.float32(1e-6))
    aside, down = aside / length, down / length
    cap = bent(rho, math.sin(math.radians(parameters.contact_deg)))
    far_px = cap.tangent * np.float32(focal_px)
    row, column = np.divmod(pixels, sheet.pane.shape[1])
    x, y = sheet.pane.x_px[column] - aside * far_px, sheet.pane.y_px[row] - down * far_px
    passes = cap.passes + crescent(rho, np.asarray(down, np.float32)) * np.float32(parameters.caustic)
    light = shown_at(small, np.asarray(x, np.float32), np.asarray(y, np.float32), sheet.pane.size_px) * passes[:, None]
    apart = (aside * rho - np.float32(GLINT_AT[0])) ** 2 + (down * rho - np.float32(GLINT_AT[1])) ** 2
    spot = np.maximum(1 - apart * np.float32(GLINT_RADIUS**-2), np.float32(0))
    own = (1 - cap.passes) * np.float32(parameters.rim) + spot * np.float32(parameters.glint)
    layer[pixels, :3] = light + own[:, None] * mean
    layer[pixels, 3] = 1
    return layer.reshape(*sheet.pane.shape, 4)
