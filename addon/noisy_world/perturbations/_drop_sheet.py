# SPDX-License-Identifier: GPL-3.0-or-later
"""The sheet that drops are painted on: for each pixel of the glass's image, where in which drop it lies."""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._drop_laws import CLEAR, SLANT, UNMARKED, WAVES
from ._glass import Pane
from ._white_noise import WhiteNoise

Float32: TypeAlias = NDArray[np.float32]
Indices: TypeAlias = NDArray[np.intp]
Turns: TypeAlias = tuple[np.float32, ...]


@dataclass(frozen=True)
class DropSheet:
    """All arrays are (h * w,). x_px, y_px: each pixel's place on the even glass, in pixels of the frame.

    rho_squared: square of the distance from the middle of its drop, in radii; 1 where there is none. aside, down: the
    direction from there. taken: from 1 on, drops painted later are not there; between 0 and 1 they are cut back.
    """

    pane: Pane
    x_px: Float32
    y_px: Float32
    rho_squared: Float32
    aside: Float32
    down: Float32
    taken: Float32

    @classmethod
    def of(cls, pane: Pane, size_px: float, turns: Turns) -> "DropSheet":
        """Return a sheet without drops. size_px: their median diameter. turns: as `uneven` has them."""
        x, y = uneven(pane, size_px, turns)
        zeros = [np.zeros(x.size, np.float32) for _ in range(3)]
        return cls(pane, x.ravel(), y.ravel(), np.ones(x.size, np.float32), *zeros)

    def paint(self, pixels: Indices, aside: Float32, down: Float32) -> None:
        """Paint drops where none is yet. pixels: (M,), each once; aside, down: from its drop's middle, in radii."""
        taken = self.taken.take(pixels)
        squared = aside * aside
        squared += down * down
        squared += taken
        (inside,) = np.nonzero(squared < 1)
        chosen = pixels.take(inside)
        self.rho_squared[chosen] = squared.take(inside) - taken.take(inside) * np.float32(UNMARKED)
        self.aside[chosen], self.down[chosen] = aside.take(inside), down.take(inside)
        self.taken[pixels] = np.maximum(taken, np.float32(CLEAR) - squared)


def turns_of(noise: WhiteNoise) -> Turns:
    """Draw the phases of the glass's waves, radians."""
    first, second, third = noise.numbers(30)
    return tuple(np.float32(2 * math.pi * item) for item in (first, second, third, noise.numbers(31)[0]))


def uneven(pane: Pane, size_px: float, turns: Turns) -> tuple[Float32, Float32]:
    """Return (h, w) x and y of each pixel on the even glass, in pixels of the frame: waves make the drops irregular.

    turns: four, the waves' phases.
    """
    one = np.float32
    x, y = pane.x_px[None, :], pane.y_px[:, None]
    (large, long), (small, short) = (
        (one(amplitude * size_px), one(1 / (length * size_px))) for amplitude, length in WAVES
    )
    slant = one(short * SLANT)
    across = np.sin(y * long + turns[0]) * large + x
    across += np.sin(y * short + turns[1] + x * slant) * small
    up = np.sin(x * long + turns[2]) * large + y
    up += np.sin(x * short + turns[3] - y * slant) * small
    return across, up
