# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes of Blender's compositor that look at more than one pixel, on arrays: (H, W), the bottom row first."""

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .array_math import Held, Number, Triple

Image: TypeAlias = NDArray[np.float32]


def size_of(value: Held) -> tuple[int, int]:
    """Return the height and width of an image; 1 and 1 of a single value."""
    shape = np.broadcast_shapes(*(np.shape(part) for part in (value if isinstance(value, tuple) else (value,))))
    return (shape[0], shape[1]) if len(shape) == 2 else (1, 1)


def whole(value: Number, size: tuple[int, int]) -> Image:
    """Return an image of this size, of whatever the value is."""
    return np.ascontiguousarray(np.broadcast_to(np.asarray(value, np.float32), size))


def by_channel(value: Held, function: Callable[[Image], Image]) -> Held:
    """Do the same to each channel of an image."""
    size = size_of(value)
    if not isinstance(value, tuple):
        return function(whole(value, size))
    x, y, z, *alpha = (function(whole(part, size)) for part in value)
    return (x, y, z, alpha[0]) if alpha else (x, y, z)


def coordinates(image: Held) -> Triple:
    """Return each pixel's column and row, from the lower left."""
    height, width = size_of(image)
    x, y = np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)
    return whole(x, (height, width)), whole(y[:, None], (height, width)), np.float32(0)


def looked_up(image: Held, where: Triple, interpolation: str, beyond: tuple[str, str]) -> Held:
    """Return an image's values at places, 0 to 1 along its sides, as Map UV does. beyond: along x and y."""
    height, width = size_of(image)
    at = size_of(where)
    place = [whole(part, at) * np.float32(side) for part, side in zip(where[:2], (width, height), strict=True)]
    sides = (width, height)
    if interpolation == "Nearest":
        columns, rows = (
            _inside(np.floor(part).astype(np.int64), side, how)
            for part, side, how in zip(place, sides, beyond, strict=True)
        )
        taken = [((columns, rows), None)]
    else:
        place = [part - np.float32(0.5) for part in place]
        corner = [np.floor(part) for part in place]
        part = [item - low for item, low in zip(place, corner, strict=True)]
        ends = [
            [_inside(low.astype(np.int64) + step, side, how) for step in (0, 1)]
            for low, side, how in zip(corner, sides, beyond, strict=True)
        ]
        shares = [(1 - item, item) for item in part]
        taken = [((ends[0][i], ends[1][j]), shares[0][i] * shares[1][j]) for j in (0, 1) for i in (0, 1)]

    def channel(values: Image) -> Image:
        total = np.zeros(at, np.float32)
        for ((column, there_x), (row, there_y)), share in taken:
            found = values[row, column]
            if there_x is not None or there_y is not None:
                found = found * ((True if there_x is None else there_x) & (True if there_y is None else there_y))
            total = found if share is None else total + found * share
        return np.asarray(total, np.float32)

    return by_channel(image, channel)


def _inside(index: NDArray[np.int64], side: int, beyond: str) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
    """Return indices that an image has, and where they were ones: None where what is beyond is no matter."""
    if beyond == "Repeat":
        return index % side, None
    kept = np.clip(index, 0, side - 1)
    return kept, (kept == index) if beyond == "Clip" else None


def mean(image: Number) -> np.float32:
    """Return the mean of all pixels."""
    return np.float32(np.mean(image, dtype=np.float64))


def block_means(image: Held, side: Number) -> Held:
    """Return the means of blocks from the lower left, each at all its pixels, as Pixelate does."""
    step = max(int(side), 1)

    def channel(values: Image) -> Image:
        height, width = values.shape
        rows, columns = np.arange(0, height, step), np.arange(0, width, step)
        total = np.add.reduceat(np.add.reduceat(values.astype(np.float64), rows, axis=0), columns, axis=1)
        counts = np.diff([*rows, height])[:, None] * np.diff([*columns, width])
        return (total / counts).astype(np.float32).repeat(step, 0)[:height].repeat(step, 1)[:, :width]

    return by_channel(image, channel)


def blurred(image: Held, size_px: Triple) -> Held:
    """Blur with a Gaussian whose sigma is a third of the size, cut off there, as Blur does with rows and columns."""
    import cv2

    across, along = (_weights(float(part)) for part in size_px[:2])
    return by_channel(
        image,
        lambda values: np.asarray(
            cv2.sepFilter2D(values, cv2.CV_32F, across, along, borderType=cv2.BORDER_REPLICATE), np.float32
        ),
    )


def _weights(size_px: float) -> NDArray[np.float64]:
    if size_px <= 0:
        return np.ones(1)
    places = np.arange(-math.ceil(size_px), math.ceil(size_px) + 1)
    weights = np.exp(-4.5 * (places / size_px) ** 2)
    return weights / weights.sum()


def displaced(image: Held, by: Triple, interpolation: str, beyond: tuple[str, str]) -> Held:
    """Return an image moved by so many pixels to the right and up, as Displace does."""
    height, width = size_of(image)
    columns, rows = (np.arange(side, dtype=np.float32) for side in (width, height))
    half = np.float32(0.5)
    x = (columns + half - np.asarray(by[0], np.float32)) / np.float32(width)
    y = (rows[:, None] + half - np.asarray(by[1], np.float32)) / np.float32(height)
    where = whole(x, (height, width)), whole(y, (height, width)), np.float32(1)
    return looked_up(image, where, interpolation, beyond)


def flipped(image: Held, axes: tuple[int, ...]) -> Held:
    """Return an image mirrored along axes: 0 upside down, 1 left to right."""
    return by_channel(image, lambda values: np.ascontiguousarray(np.flip(values, axes)))


def normalized(image: Number) -> Number:
    """Return an image from 0 at its least to 1 at its greatest value, as Normalize does."""
    low, high = np.min(image), np.max(image)
    return (image - low) * (np.float32(1) / (high - low) if high > low else np.float32(0))


def slopes(image: Held) -> Held:
    """Return the length of Sobel's two differences, as Filter does; the border is repeated."""
    import cv2

    def channel(values: Image) -> Image:
        right, up = (
            cv2.Sobel(values, cv2.CV_32F, *order, borderType=cv2.BORDER_REPLICATE) for order in ((1, 0), (0, 1))
        )
        return np.asarray(np.sqrt(right * right + up * up), np.float32)

    return by_channel(image, channel)


def boxed(image: Held, size_px: Triple) -> Held:
    """Return means of rectangles that reach so many pixels to each side, as Blur does with Flat."""
    import cv2

    sides = [2 * int(part) + 1 for part in size_px[:2]]
    return by_channel(
        image, lambda values: np.asarray(cv2.blur(values, sides, borderType=cv2.BORDER_REPLICATE), np.float32)
    )
