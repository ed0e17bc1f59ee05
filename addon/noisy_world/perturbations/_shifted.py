# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth that each pixel takes from a place near its own."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ._quantiles import look_up, normal_quantiles, uniform_codes

LARGEST = 32767  # of 16 bits with a sign


def shifted_places(
    generator: np.random.Generator, shape: tuple[int, int], sigma_px: float
) -> tuple[NDArray[np.signedinteger], NDArray[np.signedinteger]]:
    """Return rows and columns (H, W): each pixel's own, moved by rounded normal numbers, inside the image.

    They have 16 bits where these suffice, else 32.
    """
    steps = _steps(sigma_px)
    short = max(shape) + int(steps[-1]) <= LARGEST
    rows = _moved(look_up(uniform_codes(generator, shape), steps), short=short)
    rows += np.arange(shape[0], dtype=rows.dtype)[:, None]
    columns = _moved(look_up(uniform_codes(generator, shape), steps), short=short)
    columns += np.arange(shape[1], dtype=columns.dtype)
    return _kept(rows, shape[0]), _kept(columns, shape[1])


def taken(
    image: NDArray[np.float32], rows: NDArray[np.signedinteger], columns: NDArray[np.signedinteger]
) -> NDArray[np.float32]:
    """Return image[rows, columns], in a fifth of the time for places of 16 bits, in a third for others."""
    import cv2

    if rows.dtype == np.int16:
        places = cv2.merge([columns, rows])
        return np.asarray(cv2.remap(image, places, np.empty(0), cv2.INTER_NEAREST), np.float32).reshape(rows.shape)
    flat = rows * np.int32(image.shape[1])
    flat += columns
    return image.reshape(-1).take(flat)


def _moved(steps: NDArray[np.int16], *, short: bool) -> NDArray[np.signedinteger]:
    return steps if short else steps.astype(np.int32)


@lru_cache(maxsize=8)
def _steps(sigma_px: float) -> NDArray[np.int16]:
    return np.floor(normal_quantiles() * sigma_px + 0.5).astype(np.int16)


def _kept(places: NDArray[np.signedinteger], count: int) -> NDArray[np.signedinteger]:
    np.clip(places, 0, count - 1, out=places)
    return places
