# SPDX-License-Identifier: GPL-3.0-or-later
"""What a second eye to the right does not see of a depth image: of a stereo camera, or a projector's light."""

import numpy as np
from numpy.typing import NDArray

from ._bands import bands


def shadowed(disparity_px: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return the mask (H, W) of pixels that something nearer hides from an eye at one baseline to the right.

    disparity_px: (H, W), focal length x baseline / depth, 0 where depth is void: that hides nothing. A pixel at column
    x is at column x - disparity of the second view. Behind an edge the shadow is f b (1 / z_near - 1 / z_far) wide,
    rounded to whole pixels; behind what is narrower than that it ends where the thing ends, to within two pixels.
    Surfaces that the second eye sees shortened to less than a half count as hidden.
    """
    hidden = np.zeros(disparity_px.shape, np.bool_)
    if disparity_px.shape[1] > 1:
        for band, of_band in zip(bands(hidden), bands(disparity_px), strict=True):
            _shadow(of_band, band)
    return hidden


def _shadow(disparity_px: NDArray[np.float32], hidden: NDArray[np.bool_]) -> None:
    """Write the mask of some rows into `hidden`."""
    seen = np.arange(disparity_px.shape[1], dtype=np.float32) - disparity_px
    # What hides a pixel has more disparity by as much as it lies farther right, but for the half pixel below.
    reach = int(min(disparity_px.max(), disparity_px.shape[1])) + 2
    # Of what lies to the right, the leftmost edge in the second view; half a pixel is the way from centre to edge.
    # Void lies at its own column there and so hides nothing.
    np.greater(seen[:, :-1], _least_right(seen[:, 1:], reach) - np.float32(0.5), out=hidden[:, :-1])
    hidden &= disparity_px > 0
    rows = np.flatnonzero(hidden.any(axis=1))
    if rows.size:
        hidden[rows] &= _covered(seen[rows], disparity_px[rows] > 0, hidden[rows], reach)


def _least_right(values: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Return the least of each value (H, W) and at least `reach` to its right, as far as there are so many."""
    least, width = values.copy(), 1
    while width <= min(reach, values.shape[1] - 1):
        np.minimum(least[:, :-width], least[:, width:], out=least[:, :-width])
        width *= 2
    return least


def _covered(
    seen: NDArray[np.float32], known: NDArray[np.bool_], asked: NDArray[np.bool_], reach: int
) -> NDArray[np.bool_]:
    """Return, for the pixels that are asked about, whether another is in front of them in the second view.

    Of pixels that meet there the one farther right is the nearer one, so in a row drawn from left to right the last one
    stays (McMillan, An image-based approach to three-dimensional computer graphics, 1997). Only those that are at most
    `reach` and some pixels to the right can be.
    """
    import cv2

    height, width = seen.shape
    right = np.ones((1, reach + 6), np.uint8)
    near = np.asarray(cv2.dilate(asked.view(np.uint8), right, anchor=(reach + 5, 0)), np.uint8).reshape(seen.shape)
    places = np.flatnonzero(near.view(np.bool_) & known)
    row, column = np.divmod(places, width)
    cells = np.rint(seen.reshape(-1)[places]).astype(np.intp)
    inside = cells >= 0
    cells += row * width
    front = np.full((height, width), -1.0, np.float32)
    front.reshape(-1)[cells[inside]] = column[inside]
    front = np.asarray(cv2.dilate(front, np.ones((1, 3), np.uint8)), np.float32).reshape(seen.shape)
    # Outside its own neighbours: the next pixel of the same surface is in the next cell. Left of all is hidden.
    behind = front.reshape(-1)[np.where(inside, cells, 0)] >= column + 2
    covered = np.zeros(seen.shape, np.bool_)
    covered.reshape(-1)[places] = behind | ~inside
    return covered & asked
