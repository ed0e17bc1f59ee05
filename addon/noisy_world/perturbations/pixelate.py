# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixelate: a resolution that is too low."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..core.images import rgb_bytes
from ..core.perturbation import Frame, Perturbation
from ..core.schema import key

LARGEST_BLOCK_PX = 256  # of which bytes add up within 16 bits
HALF_UP = np.float32(2**-10)  # of a byte: above float32's noise, below what parts other means from half a byte


@dataclass(frozen=True)
class Pixelate:
    """Blocks of whole pixels, each its mean: PIL's BOX down to int(size x factor), nearest at pixel centres up.

    As ImageNet-C, whose means round half up (here a thousandth of a byte on every mean), but once and not twice.
    """

    factor: float = key("size of the small image, of the frame's", default=0.4, minimum=0.001, maximum=1)


def apply(rgb: NDArray[np.float32], parameters: Pixelate, _frame: Frame) -> NDArray[np.float32]:
    """Pixelate (H, W, 3)."""
    rows, columns = (_Blocks.along(size, parameters.factor) for size in rgb.shape[:2])
    means = _sums(rgb, rows, columns, np.float32)
    means *= _shares(rows, columns)
    means += HALF_UP / np.float32(255)
    return _spread(means, rows, columns)


def apply_bytes(rgb: NDArray[np.uint8], parameters: Pixelate, _frame: Frame) -> NDArray[np.uint8]:
    """Pixelate (H, W, 3) bytes."""
    rows, columns = (_Blocks.along(size, parameters.factor) for size in rgb.shape[:2])
    if rows.sizes.max() * columns.sizes.max() > LARGEST_BLOCK_PX:
        return rgb_bytes(apply(rgb / np.float32(255), parameters, _frame))
    means = _sums(rgb, rows, columns, np.uint16) * _shares(rows, columns)
    means += np.float32(0.5) + HALF_UP
    return _spread(means.astype(np.uint8), rows, columns)


@dataclass(frozen=True, eq=False)
class _Blocks:
    """The blocks along one side: where each starts, how many pixels it has, and which one each pixel shows."""

    starts: NDArray[np.int64]
    sizes: NDArray[np.int64]
    shown: NDArray[np.int64]

    @staticmethod
    @lru_cache(maxsize=16)
    def along(pixels: int, factor: float) -> "_Blocks":
        """Divide a side: a pixel belongs to the block that its centre lies in, on a border to the first.

        Which one it shows there is left to float64's rounding, as in PIL, which steps from centre to centre: at a
        factor of 0.4 that is every fifth pixel, and going always one way is 0.5 or 1.2 dB away from ImageNet-C.
        """
        blocks = max(int(pixels * factor), 1)
        owner = ((2 * np.arange(pixels) + 1) * blocks - 1) // (2 * pixels)
        steps = np.full(pixels, blocks / pixels)
        steps[0] /= 2
        shown = np.minimum(np.cumsum(steps).astype(np.int64), blocks - 1)
        return _Blocks(np.searchsorted(owner, np.arange(blocks)), np.bincount(owner), shown)


def _sums[T: np.generic](image: NDArray[T], rows: _Blocks, columns: _Blocks, dtype: DTypeLike) -> NDArray[T]:
    """Add up the blocks; returns them transposed: (columns, rows, 3)."""
    import cv2

    # Whole rows are what numpy gathers fast: the columns' turn comes after a transposition.
    return _row_sums(cv2.transpose(_row_sums(image, rows, dtype)), columns, dtype)


def _row_sums[T: np.generic](image: NDArray[T], blocks: _Blocks, dtype: DTypeLike) -> NDArray[T]:
    sums = image[blocks.starts].astype(dtype, copy=False)
    smallest = int(blocks.sizes.min())
    for place in range(1, smallest):
        np.add(sums, image[blocks.starts + place], out=sums)
    for place in range(smallest, int(blocks.sizes.max())):
        larger = np.flatnonzero(blocks.sizes > place)
        sums[larger] += image[blocks.starts[larger] + place]
    return sums


def _shares(rows: _Blocks, columns: _Blocks) -> NDArray[np.float32]:
    return (1 / np.multiply.outer(columns.sizes, rows.sizes)).astype(np.float32)[..., None]


def _spread[T: np.generic](blocks: NDArray[T], rows: _Blocks, columns: _Blocks) -> NDArray[T]:
    """Show transposed blocks (columns, rows, 3) as (H, W, 3)."""
    import cv2

    return cv2.transpose(blocks[columns.shown])[rows.shown]  # type: ignore[return-value]


PERTURBATION = Perturbation(
    name="pixelate",
    label="Pixelate",
    category="post",
    parameters=Pixelate,
    severities={"factor": (0.6, 0.5, 0.4, 0.3, 0.25)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    apply=apply,
    apply_bytes=apply_bytes,
)
