# SPDX-License-Identifier: GPL-3.0-or-later
"""Rain and snow as numbers: how many particles of which size a cubic metre holds, and what those too small to see veil.

Sizes are distributed exponentially, N(D) = n0 exp(-D / scale), in particles a cubic metre and a metre of diameter.
A particle is seen by itself where it spans at least an angle; all others, between it and the camera, are a veil. So at
depth z the veil is made of the diameters below angle * z.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

EXTINCTION_EFFICIENCY = 2.0  # of particles much larger than light's wavelength (van de Hulst, 1957)


@dataclass(frozen=True)
class Precipitation:
    """Particles in the air. n0_m4: per cubic metre and metre of diameter. scale_m: the mean diameter."""

    n0_m4: float
    scale_m: float

    @property
    def count_m3(self) -> float:
        """Particles of all sizes in a cubic metre."""
        return self.n0_m4 * self.scale_m

    @property
    def extinction_per_m(self) -> float:
        """Of all sizes: the integral of N(D) 2 pi (D / 2)^2."""
        return EXTINCTION_EFFICIENCY * math.pi / 4 * self.n0_m4 * 2 * self.scale_m**3

    def sized(self, size: float) -> "Precipitation":
        """Return as many particles, each `size` times as large."""
        return Precipitation(self.n0_m4 / size, self.scale_m * size)


def rain(rate_mm_h: float) -> Precipitation:
    """Marshall and Palmer, The distribution of raindrops with size, 1948: 8000 exp(-4.1 R^-0.21 D) per m^3 and mm."""
    return Precipitation(8e6, rate_mm_h**0.21 / 4.1 * 1e-3)


FLAKE_DENSITY_KG_M3 = 100.0  # chosen: dry flakes; the usual ten to one of fresh snow to water
SWOLLEN = (1000.0 / FLAKE_DENSITY_KG_M3) ** (1 / 3)  # a flake's diameter over that of the drop it melts to


def snow(rate_mm_h: float) -> Precipitation:
    """Gunn and Marshall, The distribution with size of aggregate snowflakes, 1958, of water's millimetres an hour.

    3800 R^-0.87 exp(-2.55 R^-0.48 D) per m^3 and mm of the melted diameter D.
    """
    return Precipitation(3.8e6 * rate_mm_h**-0.87, rate_mm_h**0.48 / 2.55 * 1e-3).sized(SWOLLEN)


def drop_speed_m_s(diameter_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Atlas, Srivastava and Sekhon, Doppler radar characteristics of precipitation, 1973: 9.65 - 10.3 exp(-0.6 D)."""
    return np.maximum(np.float32(9.65) - np.float32(10.3) * np.exp(diameter_m * np.float32(-600.0)), np.float32(0.0))


def flake_speed_m_s(diameter_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Locatelli and Hobbs, Fall speeds and masses of solid precipitation particles, 1974: 0.8 D^0.16, aggregates."""
    return np.float32(0.8) * (diameter_m * np.float32(1e3)) ** np.float32(0.16)


def veil_depth(
    distance_m: NDArray[np.float32], air: Precipitation, least_rad: float, reach_m: float
) -> NDArray[np.float32]:
    """Return the optical depth of what is not seen by itself, from the camera to each distance.

    distance_m: any shape, metres. least_rad: the least angle that a particle seen by itself spans. reach_m: none is
    seen by itself beyond.

    Of the extinction at depth z diameters below least_rad * z have the share P(3, k z), k = least_rad / scale, P the
    regularised incomplete gamma function: the integral to Z is Z P(3, k Z) - 3 / k P(4, k Z). It is written as a sum
    of e^-x with a polynomial, and as a series where that would lose digits.
    """
    import cv2

    rate = least_rad / air.scale_m
    near_m = np.minimum(distance_m, np.float32(reach_m))
    x = near_m * np.float32(rate)
    decayed = np.asarray(cv2.exp(-x), np.float32).reshape(x.shape)
    # k times the integral: x P(3, x) - 3 P(4, x) = x - 3 + e^-x (x^2 / 2 + 2 x + 3), which is x^4 / 24 and less.
    closed = x - 3 + decayed * ((x / 2 + 2) * x + 3)
    if (x < SMALL).any():
        closed = np.where(x < SMALL, _series(x), closed)
    integral = closed / np.float32(rate)
    found = (integral + (distance_m - near_m)) * np.float32(air.extinction_per_m)
    return found.astype(np.float32, copy=False)


SMALL = 0.3  # below it the series is the better one in float32


def _series(x: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return x P(3, x) - 3 P(4, x) by its first four terms."""
    squared = x * x
    found = squared * squared * (1 / 24 - x * (1 / 40 - x * (1 / 120 - x * np.float32(1 / 504))))
    return found.astype(np.float32, copy=False)
