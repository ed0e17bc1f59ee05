# SPDX-License-Identifier: GPL-3.0-or-later
"""Glare of a dirty lens: scattered light with long tails, partly as streaks.

The point spread is a sum of Gaussians, near, middle and far, of sum 1: the light is spread, none is lost. Grease that
was wiped has grooves along the wiping, which scatter across them: a lamp's streak is at right angles to it.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._kernels import gaussian

Float32: TypeAlias = NDArray[np.float32]

HALVINGS = 3  # from the frame to the image that is spread
# Share, and standard deviation as a multiple of the reach; chosen.
PARTS = ((0.5, 0.1), (0.3, 0.4), (0.2, 1.5))
ALONG, ACROSS = 1.6, 0.05  # standard deviations of a streak, of the reach


@dataclass(frozen=True)
class Spread:
    """How light is spread. reach_px: how far, in pixels of the image given. streaks: the share that is drawn out.

    turn_rad: the streaks' direction, from the right downwards.
    """

    reach_px: float
    streaks: float
    turn_rad: float


def glare_of(small: Float32, spread: Spread) -> Float32:
    """Return the scattered light of an image (h, w, 3) of linear light, of the same shape."""
    total = np.zeros_like(small)
    for share, times in PARTS:
        total += gaussian(small, times * spread.reach_px) * np.float32(share * (1 - spread.streaks))
    total += streaked(small, spread) * np.float32(spread.streaks)
    return total


def streaked(small: Float32, spread: Spread) -> Float32:
    """Return an image drawn out along a direction: turned, blurred along its rows, and turned back."""
    import cv2

    height, width = small.shape[:2]
    side = math.ceil(math.hypot(width, height))
    cosine, sine = math.cos(spread.turn_rad), math.sin(spread.turn_rad)
    # Where a pixel of the turned image lies in the image.
    turned = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0]])
    turned[:, 2] = (width - 1) / 2, (height - 1) / 2
    turned[:, 2] -= turned[:, :2] @ [(side - 1) / 2, (side - 1) / 2]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    wide = cv2.warpAffine(small, turned, (side, side), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    sigmas = [max(times * spread.reach_px, 1e-3) for times in (ALONG, ACROSS)]
    sizes = [2 * int(4 * sigma + 0.5) + 1 for sigma in sigmas]
    drawn = cv2.GaussianBlur(wide, sizes, sigmas[0], sigmaY=sigmas[1], borderType=cv2.BORDER_REPLICATE)
    back = cv2.invertAffineTransform(turned)
    found = cv2.warpAffine(drawn, back, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32).reshape(small.shape)
