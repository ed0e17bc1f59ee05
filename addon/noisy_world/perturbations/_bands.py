# SPDX-License-Identifier: GPL-3.0-or-later
"""Working on an image in bands of rows."""

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.images import as_float, rgb_bytes

T = TypeVar("T", bound=np.generic)
U = TypeVar("U", bound=np.generic)
Level = TypeVar("Level", np.float32, np.uint8)  # of a colour: from 0 to 1, or a byte

# 32 rows x any width x 3 codes of 16 bits fill whole 64-bit words of Philox, so bands draw what whole frames would.
ROWS = 32


def bands(image: NDArray[T]) -> Iterator[NDArray[T]]:
    """Yield bands of 32 rows from the top down, the last one of what is left."""
    for top in range(0, len(image), ROWS):
        yield image[top : top + ROWS]


def by_bands(
    image: NDArray[T], dtype: np.dtype[U], perturb: Callable[..., NDArray[Any]], *others: NDArray[Any]
) -> NDArray[U]:
    """Apply `perturb`, which returns arrays of `dtype`, to bands of 32 rows from the top down; return the whole image.

    others: images as high as this one, whose bands `perturb` is given too. A band's intermediate arrays stay in the
    processor's cache; those of a whole frame are allocated anew each time. Measured: shot noise takes 9 ms by bands and
    22 ms on the whole frame, brightness 2 ms and 7 ms.
    """
    result = np.empty(image.shape, dtype)
    for parts in zip(*map(bands, (result, image, *others)), strict=True):
        parts[0][:] = perturb(*parts[1:])
    return result


def colour_by_bands(
    rgb: NDArray[Level], perturb: Callable[..., NDArray[np.float32]], *others: NDArray[Any]
) -> NDArray[Level]:
    """Apply `perturb`, which takes and returns float colour, to bands of (H, W, 3), float32 or uint8, as `by_bands`.

    Bytes are made float before it and rounded after it, as on the whole image, in half the time.
    """
    if rgb.dtype != np.uint8:
        return by_bands(rgb, rgb.dtype, perturb, *others)
    return by_bands(rgb, rgb.dtype, lambda band, *parts: rgb_bytes(perturb(as_float(band), *parts)), *others)
