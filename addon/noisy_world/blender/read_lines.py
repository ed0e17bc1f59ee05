# SPDX-License-Identifier: GPL-3.0-or-later
"""Lines of a frame that are read one after another: each band of them is rendered at its own moment, by a border."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.bending import Bending
from ..core.trajectories.frame_request import Shutter

BANDS_PER_PX = 32.0  # of what moves most while the image is read: a line is at most 1/64 px off; chosen


@dataclass(frozen=True)
class Band:
    """Lines of an image (height, width) that see the same moment. after_s: the moment, after the frame's time stamp."""

    rows: slice
    columns: slice
    after_s: float


def bands_of(readout: Shutter, size_px: tuple[int, int], travel_px: float) -> list[Band]:
    """Return the bands of an image that is read, in the image's order. size_px: width, height.

    travel_px: how far anything goes on the image meanwhile, at most; it decides how many bands there are.
    """
    width, height = size_px
    upright = readout.direction in ("right", "left")
    count = width if upright else height
    times_s = readout.line_times_s(count)
    number = min(count, max(1, math.ceil(travel_px * BANDS_PER_PX)))
    bands = []
    for part in np.array_split(np.arange(count), number):
        lines, after_s = slice(int(part[0]), int(part[-1]) + 1), float(times_s[part].mean())
        bands.append(Band(slice(0, height), lines, after_s) if upright else Band(lines, slice(0, width), after_s))
    return bands


def whole(size_px: tuple[int, int]) -> Band:
    """Return all of an image, at the frame's time stamp. size_px: width, height."""
    return Band(slice(0, size_px[1]), slice(0, size_px[0]), 0.0)


def behind_lens(band: Band, bending: Bending | None) -> tuple[Band, Bending | None]:
    """Return what is rendered of a pinhole for a band behind a lens, and what bends it; the band itself without one."""
    if bending is None:
        return band, None
    rows, columns, part = bending.part(band.rows, band.columns)
    return replace(band, rows=rows, columns=columns), part


def joined(
    bands: Sequence[Band], size_px: tuple[int, int], passes_of: Callable[[Band], dict[str, NDArray[np.float32]]]
) -> dict[str, NDArray[np.float32]]:
    """Return the passes (H, W) of a frame. passes_of: gives those of a band's lines, by name."""
    found: dict[str, NDArray[np.float32]] = {}
    for band in bands:
        for name, pixels in passes_of(band).items():
            image = found.setdefault(name, np.empty((size_px[1], size_px[0]), np.float32))
            image[band.rows, band.columns] = pixels
    return found


@contextmanager
def bordered(scene: bpy.types.Scene, size_px: tuple[int, int], band: Band | None) -> Iterator[tuple[slice, slice]]:
    """Let the scene render a band alone; give what of the rendered image is asked for. None: the whole image.

    size_px: width, height of the frame, at the left top of the scene's image.
    """
    if band is None:
        yield slice(size_px[1]), slice(size_px[0])
        return
    render = scene.render
    # A quarter of a pixel beyond the pixels' edges, so that however it is rounded no neighbour is taken.
    left, right = ((at + 0.25) / render.resolution_x for at in (band.columns.start, band.columns.stop))
    top, bottom = ((render.resolution_y - at + 0.25) / render.resolution_y for at in (band.rows.start, band.rows.stop))
    render.border_min_x, render.border_max_x = left, right
    render.border_min_y, render.border_max_y = bottom, top
    render.use_border = render.use_crop_to_border = True
    try:
        yield slice(None), slice(None)
    finally:
        render.use_border = False
