# SPDX-License-Identifier: GPL-3.0-or-later
"""What pixels have of their own, and what rows have together: hot pixels, and noise of rows and columns.

A pixel that differs from its neighbours in all frames, while what is seen there changes, is the sensor's.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .figure import BLOCKS, Figure, blocks_of, jackknifed
from .footage import Float64, RecordingView

# Chosen, as all below.
LEAST_FRAMES = 8
MOVED = 3.0  # of 255: mean difference between frames, below which they show the same
BRIGHTER = 8.0  # of 255: a hot pixel over its neighbours, in the median frame
SURE = 6.0  # times the spread of what pixels have over their neighbours in the median frame
EVERY = 2  # pixels of a row of which one is looked at for rows' noise: enough, in half the time
NOISY = 24.0  # of 255, that hot pixels have to be brighter by in strong noise, and may be missed
HIDDEN = 0.5  # of what hot pixels are brighter by: where they have to be by more, others are missed
SMOOTH = 0.5  # share of the pixels of a row that count: those that least differ from the rows beside it
FLOOR, RELATIVE = 0.35, 0.05  # error, of 255 and relative, by what lies along rows in what is seen; found on known rows

HOT, ROWS, COLUMNS = "hot_pixel_share", "row_noise_std", "column_noise_std"


def fixed_noise(footage: RecordingView, frames: Sequence[int], *, jpeg: bool = False) -> tuple[Figure, ...]:
    """Return hot pixels, and the noise of rows and columns, of some frames that are apart.

    jpeg: whether they were JPEGs. Raises InputError where one of them is damaged.
    """
    images = [footage.colour(frame) for frame in frames]
    hot = Figure.none(HOT, "a JPEG spreads single pixels over those beside them") if jpeg else _hot(images)
    return hot, _lines(images, ROWS), _lines([image.swapaxes(0, 1) for image in images], COLUMNS)


def _hot(images: Sequence[NDArray[np.uint8]]) -> Figure:
    """Return the share of pixels of which a channel stands out in the median frame."""
    if len(images) < LEAST_FRAMES:
        return Figure.none(HOT, "there are too few frames")
    moved = [float(np.mean(np.abs(one[::4, ::4].astype(int) - other[::4, ::4]))) for one, other in pairwise(images)]
    if np.median(moved) < MOVED:
        return Figure.none(HOT, "the camera stands still: what stays may be what it sees")
    over = [_over_neighbours(image) for image in images]
    some = np.median(np.stack([each[::4, ::4] for each in over]), axis=0)
    limit = max(BRIGHTER, SURE * 1.4826 * float(np.median(np.abs(some))))
    # Where the median is over the limit, half of the frames are.
    often = np.sum([each > limit for each in over], axis=0, dtype=np.uint8) >= len(over) // 2
    chosen = np.nonzero(often)
    hot = np.zeros(often.shape, np.bool_)
    bright = np.median(np.stack([each[chosen] for each in over]), axis=0)
    hot[chosen] = bright > limit
    if limit > NOISY and limit > HIDDEN * float(np.median(bright[bright > limit]) if hot.any() else 0.0):
        return Figure.none(HOT, f"noise hides what is less than {limit:.0f} of 255 brighter than its neighbours")
    hot = hot.any(axis=2)
    count = int(hot.sum())
    # Poisson's interval of so many that were found, by the normal approximation of its root.
    low, high = (max(count**0.5 + side * 0.98, 0.0) ** 2 / hot.size for side in (-1, 1))
    return Figure(HOT, count / hot.size, low if count else 0.0, max(high, 3.0 / hot.size), hot.size, "pixels")


def _over_neighbours(image: NDArray[np.uint8]) -> NDArray[np.int16]:
    """Return by how much each value of an image is over the second largest of the four beside it, (H, W, 3), of 255.

    So edges and lines in what is seen do not count.
    """
    import cv2

    padded = cv2.copyMakeBorder(image, 1, 1, 1, 1, cv2.BORDER_REFLECT_101)
    up, down, left, right = padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]
    between = cv2.min(cv2.max(up, down), cv2.max(left, right))
    second = cv2.max(between, cv2.max(cv2.min(up, down), cv2.min(left, right)))
    return np.asarray(cv2.subtract(image, second, dtype=cv2.CV_16S), np.int16)


def _lines(images: Sequence[NDArray[np.uint8]], name: str) -> Figure:
    """Return the deviation of what all pixels of a row share, of full scale, beyond what their own noise makes."""
    variances = np.array([_of_rows(image[..., 1]) for image in images])
    if len(images) < LEAST_FRAMES or not np.isfinite(variances).all():
        return Figure.none(name, "there are too few frames")
    groups = blocks_of(len(images))
    std = _root(variances)
    error = jackknifed(np.array([_root(variances[groups != group]) for group in range(BLOCKS)]))
    return Figure.within(name, std / 255, float(np.hypot(error, FLOOR + RELATIVE * std)) / 255, len(images))


def _root(variances: Float64) -> float:
    return float(np.sqrt(max(float(np.median(variances)), 0.0)))


def _of_rows(image: NDArray[np.uint8]) -> float:
    """Return the variance of rows' own brightness, of 255^2: second differences of rows less what pixels make."""
    values = image[:, ::EVERY].astype(np.float32)
    bent = values[1:-1] - (values[:-2] + values[2:]) / 2
    cut = int(bent.shape[1] * (1 - SMOOTH) / 2)
    middle = np.partition(bent, (cut, bent.shape[1] - cut - 1), axis=1)[:, cut : bent.shape[1] - cut]
    shared = middle.mean(axis=1)
    spread = 1.4826 * np.median(np.abs(bent - shared[:, None]), axis=1)
    by_pixels = float(np.median(spread) ** 2) * 1.2 / bent.shape[1]
    of_rows = 1.4826 * float(np.median(np.abs(shared)))
    return (of_rows**2 - by_pixels) / 1.5
