# SPDX-License-Identifier: GPL-3.0-or-later
"""Drops on the glass, on arrays: painted by size on the glass's image, which is blurred and laid over the frame."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.linear_light import decoded
from ..core.perturbing.kinds import FrameContext
from ._bands import by_bands
from ._drop_laws import (
    CELL_HEIGHT,
    CELL_WIDTH,
    CLASSES,
    GLINT_AT,
    GLINT_RADIUS,
    HALVINGS,
    LARGEST,
    LOGISTIC,
    PRESENT,
    ROW_SHIFT,
    SAG,
    START,
    SWING,
    TALL,
    TURNS,
    LensDrops,
    drying_rate,
    of_class,
)
from ._drop_optics import bent
from ._drop_runs import beads_of, paint_runs, runs_on
from ._drop_sheet import DropSheet, turns_of
from ._glass import Pane, blurred, laid_over, pane, reduced, shown_at
from ._white_noise import WhiteNoise, white_noise

Float32: TypeAlias = NDArray[np.float32]

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
    light = (
        shown_at(small, np.asarray(x, np.float32), np.asarray(y, np.float32), sheet.pane.size_px) * cap.passes[:, None]
    )
    apart = (aside * rho - np.float32(GLINT_AT[0])) ** 2 + (down * rho - np.float32(GLINT_AT[1])) ** 2
    spot = np.maximum(1 - apart * np.float32(GLINT_RADIUS**-2), np.float32(0))
    own = (1 - cap.passes) * np.float32(parameters.rim) + spot * np.float32(parameters.glint)
    layer[pixels, :3] = light + own[:, None] * mean
    layer[pixels, 3] = 1
    return layer.reshape(*sheet.pane.shape, 4)
