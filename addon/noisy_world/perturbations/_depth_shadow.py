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
    # Of what lies to the right, the leftmost edge in the second view; half a pixel is the way from centre to edge.
    # Void lies at its own column there and so hides nothing.
    edges = np.minimum.accumulate(seen[:, :0:-1], axis=1)[:, ::-1]
    np.greater(seen[:, :-1], edges - np.float32(0.5), out=hidden[:, :-1])
    hidden &= disparity_px > 0
    rows = np.flatnonzero(hidden.any(axis=1))
    if rows.size:
        hidden[rows] &= _covered(seen[rows], disparity_px[rows] > 0, hidden[rows])


def _covered(seen: NDArray[np.float32], known: NDArray[np.bool_], asked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return, for the pixels that are asked about, whether another is in front of them in the second view.

    Of pixels that meet there the one farther right is the nearer one, so in a row drawn from left to right the last one
    stays (McMillan, An image-based approach to three-dimensional computer graphics, 1997).
    """
    import cv2

    height, width = seen.shape
    cells = np.rint(seen).astype(np.int32)
    inside = known & (cells >= 0)
    cells += (np.arange(height, dtype=np.int32) * width)[:, None]
    front = np.full((height, width), -1.0, np.float32)
    columns = np.broadcast_to(np.arange(width, dtype=np.float32), seen.shape)
    front.reshape(-1)[cells[inside]] = columns[inside]
    front = np.asarray(cv2.dilate(front, np.ones((1, 3), np.uint8)), np.float32).reshape(seen.shape)
    covered = np.zeros(seen.shape, np.bool_)
    place = asked & inside
    # Outside its own neighbours: the next pixel of the same surface is in the next cell.
    covered[place] = front.reshape(-1)[cells[place]] >= columns[place] + 2
    covered |= asked & ~inside
    return covered
