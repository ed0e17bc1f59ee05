# SPDX-License-Identifier: GPL-3.0-or-later
"""What a second eye to the right does not see of a depth image: of a stereo camera, or a projector's light."""

import math

import numpy as np
from numpy.typing import NDArray

from ._bands import bands


def shadowed(disparity_px: NDArray[np.float32], scale: float = 1.0) -> NDArray[np.bool_]:
    """Return the mask (H, W) of pixels that something nearer hides from an eye at one baseline to the right.

    disparity_px: (H, W), focal length x baseline / depth, 0 where depth is void: that hides nothing. scale: how many
    pixels of this image are one of it. A pixel at column x is at column x - disparity of the second view. Behind an
    edge the shadow is f b (1 / z_near - 1 / z_far) wide, rounded to whole pixels; behind what is narrower than that it
    ends where the thing ends, to within two pixels. Surfaces that the second eye sees shortened to less than a half
    count as hidden.
    """
    hidden = np.empty(disparity_px.shape, np.bool_)
    reach = 0
    for band, of_band in zip(bands(hidden), bands(disparity_px), strict=True):
        reach = max(reach, _overtaken(of_band * np.float32(scale), band))
    flat = hidden.reshape(-1)
    places = np.flatnonzero(hidden)
    flat[places] = disparity_px.reshape(-1).take(places) > 0
    places = np.flatnonzero(hidden)
    if places.size:
        flat[places] = _covered(disparity_px, np.float32(scale), places, reach)
    return hidden


def _overtaken(disparity_px: NDArray[np.float32], hidden: NDArray[np.bool_]) -> int:
    """Mark in `hidden`, for rows (H, W), which pixels something to their right lies left of in the second view.

    Returns how far to the right that can be: it has more disparity by as much as it lies farther right, but for the
    half pixel from a centre to an edge. Void lies at its own column there and so is in front of nothing.
    """
    seen = np.arange(disparity_px.shape[1], dtype=np.float32) - disparity_px
    reach = int(min(disparity_px.max(), disparity_px.shape[1])) + 2
    edge = _least_right(seen, reach)
    edge -= np.float32(0.5)
    np.greater(seen, edge, out=hidden)
    return reach


def _least_right(values: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Return the least of at least `reach` values to the right of each (H, W), as far as there are so many.

    That is the least of as many neighbours as the root of them, and then of such groups.
    """
    import cv2

    group = math.isqrt(reach) + 1
    groups = np.zeros((1, 1 + group * group), np.uint8)
    groups[:, 1::group] = 1
    least = cv2.erode(values, np.ones((1, group), np.uint8), anchor=(0, 0))
    return np.asarray(cv2.erode(least, groups, anchor=(0, 0)), np.float32).reshape(values.shape)


def _covered(
    disparity_px: NDArray[np.float32], scale: np.float32, places: NDArray[np.intp], reach: int
) -> NDArray[np.bool_]:
    """Return (N,), for the pixels at `places` of the image, whether another is in front of them in the second view.

    Of pixels that meet there the one farther right is the nearer one, so in a row drawn from left to right the last one
    stays (McMillan, An image-based approach to three-dimensional computer graphics, 1997). Only those that are at most
    `reach` and some pixels to the right can be.
    """
    import cv2

    height, width = disparity_px.shape
    asked = np.zeros((height, width), np.uint8)
    asked.reshape(-1)[places] = 1
    near = cv2.dilate(asked, np.ones((1, reach + 6), np.uint8), anchor=(reach + 5, 0))
    column, cells = _drawn(disparity_px, scale, np.flatnonzero(np.asarray(near).view(np.bool_)))
    # A column at the left for what is left of the second view, and one at the right as everything has neighbours.
    front = np.full(height * (width + 2), -1, np.int32)
    front[cells] = column
    column, cells = _drawn(disparity_px, scale, places)
    # Outside its own neighbours: the next pixel of the same surface is in the next cell.
    behind = np.maximum(front.take(cells), front.take(cells + 1)) >= column + 2
    inner = cells % (width + 2) > 1
    behind |= (front.take(cells - 1) >= column + 2) & inner
    return behind | (cells % (width + 2) == 0)


def _drawn(
    disparity_px: NDArray[np.float32], scale: np.float32, places: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the columns (N,) of pixels, and their places in the second view, which has a column more at each side."""
    width = disparity_px.shape[1]
    rows = places // width
    column = places - rows * width
    seen = column.astype(np.float32)
    seen -= disparity_px.reshape(-1).take(places) * scale
    cells = np.rint(seen, out=seen).astype(np.intp)
    np.maximum(cells, -1, out=cells)
    cells += 1
    cells += rows * (width + 2)
    return column, cells
