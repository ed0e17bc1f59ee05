# SPDX-License-Identifier: GPL-3.0-or-later
"""How obliquely the rays of a depth image meet its surfaces."""

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics
from ._bands import ROWS
from ._void import quotient

TINY = 1e-30


def cosine_of_incidence(depth_m: NDArray[np.float32], camera: Intrinsics) -> NDArray[np.float32]:
    """Return (H, W): the cosine of the angle between each ray and the surface's normal, in (0, 1]; 1 where void.

    depth_m: (H, W) planar depth, 0 = void. On a plane 1 / depth is linear in the pixels, so its differences give the
    normal exactly. Of the differences to both neighbours the smaller one is taken: the other may cross an edge.
    """
    height, width = depth_m.shape
    padded = np.zeros((height + 2, width + 2), np.float32)  # outside is void: a large difference, taken if it is alone
    padded[1:-1, 1:-1] = quotient(1.0, depth_m, depth_m > 0)
    x = (np.arange(width) - camera.cx_px).astype(np.float32)
    y = (np.arange(height) - camera.cy_px).astype(np.float32)[:, None]
    fx, fy = np.float32(camera.fx_px), np.float32(camera.fy_px)
    ray = np.square(x / fx) + np.float32(1)
    found = np.empty_like(depth_m)
    for top in range(0, height, ROWS):
        rows = slice(top, min(top + ROWS, height))
        band = padded[top : rows.stop + 2]
        here = band[1:-1, 1:-1]
        right = _smaller(band[1:-1, 2:] - here, here - band[1:-1, :-2], width)
        down = _smaller(band[2:, 1:-1] - here, here - band[:-2, 1:-1], height)
        towards = here - x * right - y[rows] * down
        right *= fx
        down *= fy
        length = towards * towards
        length += right * right
        length += down * down
        length *= ray + np.square(y[rows] / fy)
        np.sqrt(length, out=length)
        length += np.float32(TINY)  # void has none
        np.divide(here, length, out=length)
        length[here == 0] = 1
        found[rows] = np.minimum(length, np.float32(1))
    return found


def _smaller(one: NDArray[np.float32], other: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    """Return the one nearer to 0, element by element; 0 along a side of a single pixel, which has no neighbours."""
    if count == 1:
        return np.zeros_like(one)
    return np.where(np.abs(one) < np.abs(other), one, other)
