# SPDX-License-Identifier: GPL-3.0-or-later
"""Anti-aliasing: a pixel whose colour is not its neighbours' becomes the mean light of a grid of rays through it.

The grid is regular and the same for every pixel (a box filter over the pixel), so nothing is random. Means are those of
linear light, as a sensor and Cycles take them; void is black. Where colours are alike a pixel keeps its centre's.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.scenes.srgb import encoded, quick_light

# Of a display-encoded component, nominally [0, 1]. Chosen, in the embedded rooms at 9 samples: .1 gives 1 dB more for a
# fifth more rays, .2 takes 1.5 dB for a sixth fewer. Jumps of depth between pixels would add a tenth of a dB.
CONTRAST = 0.15
PIXELS_AT_ONCE = 4096  # bounds the memory; chosen


@dataclass(frozen=True)
class RayGrid:
    """The rays through a pixel beside that of its centre, in order.

    right_px, down_px: (S,) float64, where they go, from the centre. samples: of which the mean is made, with the
    centre's where `centred`.
    """

    right_px: NDArray[np.float64]
    down_px: NDArray[np.float64]
    samples: int
    centred: bool


def grid_of(samples: int) -> RayGrid:
    """Return the grid of so many samples, a square number above 1; the middle one of an odd number is the centre."""
    side = round(samples**0.5)
    assert side * side == samples > 1, samples
    places_px = (np.arange(side) + 0.5) / side - 0.5
    down_px, right_px = (values.ravel() for values in np.meshgrid(places_px, places_px, indexing="ij"))
    beside = np.arange(samples) != samples // 2 if side % 2 else np.full(samples, True)
    return RayGrid(right_px[beside], down_px[beside], samples, centred=bool(side % 2))


def uneven_pixels(rgb: NDArray[np.float32]) -> NDArray[np.intp]:
    """Return the pixels of an image (H, W, 3) that differ from a neighbour by more than CONTRAST, row by row.

    They are places in the image's H x W pixels. Neighbours share a side.
    """
    import cv2

    uneven = np.zeros(rgb.shape[:2], dtype=np.bool_)
    for here, there in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
        if rgb[here].size:
            alike = cv2.inRange(cv2.absdiff(rgb[here], rgb[there]), (0.0,) * 3, (CONTRAST,) * 3)
            differs = alike.reshape(uneven[here].shape) == 0
            uneven[here] |= differs
            uneven[there] |= differs
    return np.flatnonzero(uneven)


def mean_colours(centre: NDArray[np.float32], beside: NDArray[np.float32], grid: RayGrid) -> NDArray[np.float32]:
    """Return the colours (N, 3) of pixels: centre (N, 3) and beside (N, S, 3) are those of the grid's rays.

    All are display-encoded and within [0, 1], or taken to its ends.
    """
    light = quick_light(beside)
    mean = quick_light(centre) if grid.centred else np.zeros_like(centre)
    for ray in range(light.shape[1]):  # one after another, in a third of the time of numpy's sum along the axis
        mean += light[:, ray]
    mean /= np.float32(grid.samples)
    return np.asarray(encoded(mean), dtype=np.float32)
