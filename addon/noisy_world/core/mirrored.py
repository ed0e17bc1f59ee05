# SPDX-License-Identifier: GPL-3.0-or-later
"""What water, wet floors and mirrors of a frame show, and how it looks through even air."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float32: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True)
class EvenAir:
    """Air that is the same everywhere.

    light: (3,) linear, of air without end. rates_per_m: (3,), its extinction of red, green and blue. sky_m: how far sky
    counts; 0 where it stays as it is, infinite where nothing is left of it.
    """

    light: NDArray[np.float64]
    rates_per_m: NDArray[np.float64]
    sky_m: float


@dataclass(frozen=True, eq=False)
class Mirrored:
    """What the surfaces of a lit frame mirror, pixel by pixel. All are float32.

    share: (H, W, 3) of the frame's light, from 0 to 1. reflectance: (H, W, 3), what a surface gives back of light that
    comes evenly from all that it mirrors. distance_m: (H, W), from the surface on, the mean of what is not sky. sky:
    (H, W), the share of sky in what is mirrored.
    """

    share: Float32
    reflectance: Float32
    distance_m: Float32
    sky: Float32

    def changed(self, change: Callable[[Float32], Float32]) -> "Mirrored":
        """Return it with each image changed alike, as by a lens or to another size."""
        return Mirrored(*(change(getattr(self, item.name)) for item in fields(self)))

    def through(self, air: EvenAir, mirrored: Float32) -> Float32:
        """Return light (H, W, 3) that comes from the mirroring surfaces, with air before what they mirror.

        The way behind a surface takes from what it mirrors, and adds light of the air, of which it mirrors its
        reflectance (Koschmieder's law, once more).
        """
        rates = air.rates_per_m.astype(np.float32)
        seen = np.exp(-self.distance_m[..., None] * rates) * (1 - self.sky[..., None])
        seen += self.sky[..., None] * np.exp(-np.float32(air.sky_m) * rates)
        through = mirrored * seen + self.reflectance * air.light.astype(np.float32) * (1 - seen)
        return np.asarray(through, np.float32)
