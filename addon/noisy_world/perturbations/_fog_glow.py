# SPDX-License-Identifier: GPL-3.0-or-later
"""The glow around bright lights in fog: light that droplets send a little aside, again and again.

Light scattered n times by small angles has gone aside by the square root of n times as much, so the glow's width grows
with the root of the optical depth (Narasimhan and Nayar, Shedding light on the weather, 2003, solve it exactly for a
point; the shape here is Gaussian). No light is added: what glows is what the fog has taken from the direct beam.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._block_nodes import BLOCK_PX, MARGIN
from ._fog_parameters import FogDepth

Float32: TypeAlias = NDArray[np.float32]

WIDTHS = (0.5, 1.0, 2.0, 4.0)  # of the Gaussians, in those of an optical depth of 1


def glow_of(taken: Float32, depth: Float32, parameters: FogDepth, focal_px: float) -> Float32:
    """Return (H, W, 3): the glow of the light that fog has taken from the direct beam, which is not changed.

    taken: (H, W, 3), linear, what it was brighter than the airlight; what was darker does not glow. depth: (H, W),
    optical. focal_px: of the camera.
    """
    import cv2

    height, width = depth.shape
    ones = np.ones((height, width), np.float32)
    lamps, thick = (block_means(image) for image in (np.maximum(taken, np.float32(0)), depth))
    thick /= np.maximum(block_means(ones), np.float32(1e-6))
    unit_px = focal_px * np.tan(np.radians(parameters.glow_width_deg)) / BLOCK_PX
    total = np.zeros_like(lamps)
    for share, wide in zip(shares(thick), WIDTHS, strict=True):
        part = lamps * np.asarray(cv2.merge([share] * 3), np.float32).reshape(lamps.shape)
        total += block_blurred(part, float(wide * unit_px))
    total *= np.float32(parameters.glow)
    grown = cv2.resize(total, (total.shape[1] * BLOCK_PX, total.shape[0] * BLOCK_PX), interpolation=cv2.INTER_LINEAR)
    bottom = len(grown) - BLOCK_PX
    return np.asarray(grown, np.float32)[bottom - height : bottom, BLOCK_PX : BLOCK_PX + width].reshape(
        height, width, 3
    )


def shares(depth: Float32) -> list[Float32]:
    """Return for each width how much of the light goes there: between the two that are nearest to the depth's root."""
    place = np.clip(np.log2(np.maximum(depth, np.float32(1e-6))) * np.float32(0.5) + 1, 0, len(WIDTHS) - 1)
    return [np.maximum(1 - np.abs(place - np.float32(k)), np.float32(0)) for k in range(len(WIDTHS))]


def block_means(image: Float32) -> Float32:
    """Return the means of blocks of 8 x 8 from the lower left, with nothing beyond the image and a block around it."""
    import cv2

    height, width = image.shape[:2]
    above, right = -height % BLOCK_PX + BLOCK_PX, -width % BLOCK_PX + BLOCK_PX
    whole = cv2.copyMakeBorder(image, above, BLOCK_PX, BLOCK_PX, right, cv2.BORDER_CONSTANT)
    size = whole.shape[1] // BLOCK_PX, whole.shape[0] // BLOCK_PX
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.float32)


def block_blurred(image: Float32, sigma: float) -> Float32:
    """Blur by a Gaussian; what leaves the image is gone, and none comes in."""
    import cv2

    side = 2 * int(np.ceil(MARGIN * sigma)) + 1
    found = cv2.GaussianBlur(image, (side, side), sigma, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(found, np.float32).reshape(image.shape)
