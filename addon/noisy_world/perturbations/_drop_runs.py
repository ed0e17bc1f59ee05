# SPDX-License-Identifier: GPL-3.0-or-later
"""Drops that run down the glass, on arrays: what they wipe, and the beads that they leave."""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._drop_laws import (
    ASIDE,
    BEAD_RADIUS,
    BEAD_START,
    BEADS,
    BELOW,
    HIGHEST,
    LOWEST,
    PRESENT,
    REST,
    RUN_RADIUS,
    SMALL_AT_REST,
    STICK,
    STRIP,
    STRIP_START,
    SWING,
    TAIL,
    TAPER,
    TRACK,
    TRAIL,
    TURNS,
    WINDING,
    LensDrops,
)
from ._drop_sheet import DropSheet
from ._white_noise import WhiteNoise

Float32: TypeAlias = NDArray[np.float32]
Indices: TypeAlias = NDArray[np.intp]


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
