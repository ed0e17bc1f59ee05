# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass blur: the scene through textured glass."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..core.perturbation import Frame, Perturbation
from ..core.schema import key
from ._kernels import gaussian


@dataclass(frozen=True)
class GlassBlur:
    """Blur, take every pixel from a random place nearby a few times, blur again.

    After ImageNet-C, whose loop means to swap a pixel with one at whole offsets in [-max_delta, max_delta), and copies
    it. The loop runs from the last pixel to the first, in place: what it takes from further on has been replaced
    already, so that offsets add up. Here each pixel draws that sum at once, over the whole frame; what lies outside has
    the border's value.
    """

    sigma_px: float = key(
        "standard deviation of the blur before and after", default=1.0, unit="px", minimum=0, maximum=20
    )
    max_delta_px: int = key("how far away one copy takes a pixel from", default=2, unit="px", minimum=0, maximum=10)
    iterations: int = key("how many times", default=3, minimum=0, maximum=20)


def apply(rgb: NDArray[np.float32], parameters: GlassBlur, frame: Frame) -> NDArray[np.float32]:
    """Blur and shuffle (H, W, 3)."""
    import cv2

    image = gaussian(rgb, parameters.sigma_px)
    if parameters.max_delta_px:
        generator, taken = frame.pattern_stream(), np.empty_like(image)
        for _ in range(parameters.iterations):
            places = _places(rgb.shape[0], rgb.shape[1], parameters.max_delta_px, generator)
            taken = cv2.remap(image, places, None, cv2.INTER_NEAREST, dst=taken, borderMode=cv2.BORDER_REPLICATE)
            image, taken = taken, image
    return gaussian(image, parameters.sigma_px)


def _places(height: int, width: int, delta: int, generator: np.random.Generator) -> NDArray[np.int16]:
    """Return (H, W, 2) columns and rows: where each pixel is taken from."""
    count = height * width
    choice = generator.bit_generator.random_raw((count + 3) // 4).view(np.uint16)[:count]
    # One look-up of 32 bits fetches the column and the row.
    places = np.take(_offsets(delta), choice, mode="clip").view(np.int16).reshape(height, width, 2)
    places += _grid(height, width)
    return places


@lru_cache(maxsize=2)
def _grid(height: int, width: int) -> NDArray[np.int16]:
    """Return (H, W, 2): each pixel's own column and row; read-only."""
    grid = np.empty((height, width, 2), dtype=np.int16)
    grid[..., 0] = np.arange(width)
    grid[..., 1] = np.arange(height)[:, None]
    grid.flags.writeable = False
    return grid


@lru_cache(maxsize=8)
def _offsets(delta: int) -> NDArray[np.int32]:
    """Return 65536 equally likely offsets, each two int16 (columns, rows) seen as one int32; read-only."""
    shares = offset_shares(delta)
    reach = shares.shape[0] // 2
    ends = np.rint(np.cumsum(shares) / shares.sum() * 65536).astype(np.int64)
    cells = np.repeat(np.arange(shares.size), np.diff(ends, prepend=0))
    rows, columns = np.divmod(cells, shares.shape[1])
    offsets = np.stack([columns - reach, rows - reach], axis=-1).astype(np.int16).view(np.int32).ravel()
    offsets.flags.writeable = False
    return offsets


def offset_shares(delta: int, copies: int = 10) -> NDArray[np.float64]:
    """Return how likely each offset is, (rows, columns) about the middle, for a loop in place from last to first.

    delta: a copy's offsets are whole, uniform in [-delta, delta). One that leads further on (down, or right in the same
    row) goes on from there; at most `copies` are followed, which is all but 1 in 1,000.
    """
    reach = delta * copies
    onward = np.zeros((2 * reach + 1, 2 * reach + 1))
    onward[reach, reach] = 1.0
    stopped = np.zeros_like(onward)
    for _ in range(copies):
        moved = np.zeros_like(onward)
        for row in range(-delta, delta):
            for column in range(-delta, delta):
                goes_on = row > 0 or (row == 0 and column > 0)
                target = moved if goes_on else stopped
                target += np.roll(onward, (row, column), (0, 1)) / (4 * delta**2)
        onward = moved
    return stopped


PERTURBATION = Perturbation(
    name="glass_blur",
    label="Glass blur",
    category="lens",
    parameters=GlassBlur,
    severities={
        "sigma_px": (0.7, 0.9, 1.0, 1.1, 1.5),
        "max_delta_px": (1, 2, 2, 3, 4),
        "iterations": (2, 1, 3, 2, 2),
    },
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    apply=apply,
    temporals=("fresh", "fixed"),
    counts=frozenset({"max_delta_px", "iterations"}),
)
