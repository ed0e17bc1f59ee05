# SPDX-License-Identifier: GPL-3.0-or-later
"""The sun seen through heavy air: how wide its disc becomes, and how much of its light arrives."""

import math
from dataclasses import dataclass

from ..core.visibility import EXTINCTION

ASYMMETRY = 0.85
"""The mean cosine by which drops of fog turn light; of the same in docs/weather.md's lamps."""

WIDEST_RAD = math.pi  # of a sun lamp's disc


@dataclass(frozen=True)
class SunAir:
    """Even air that the sun's light comes through. It scatters all that it takes, as drops of fog do.

    visibility_m: where 5 % of the contrast is left. path_m: the way of the light through it.
    """

    visibility_m: float
    path_m: float

    @property
    def optical_depth(self) -> float:
        """The mean number of times that light is scattered on the way."""
        return EXTINCTION * self.path_m / self.visibility_m

    @property
    def spread_rad(self) -> float:
        """The diameter of an even disc that spreads as much as the air does, in radians.

        Scattering multiplies the mean cosine of light's direction by exp(-t (1 - g)), t the optical depth and g the
        asymmetry (Goudsmit and Saunderson, Multiple scattering of electrons, 1940). For small angles their mean square
        is 2 t (1 - g); that of the directions in an even disc of a diameter d is d^2 / 8.
        """
        return math.sqrt(8 * 2 * self.optical_depth * (1 - ASYMMETRY))

    def angle_rad(self, own_rad: float) -> float:
        """Return the angular diameter of a sun's disc whose own is given, in radians, at most half a turn."""
        return min(WIDEST_RAD, math.hypot(own_rad, self.spread_rad))

    @property
    def stops(self) -> float:
        """By how many powers of two the sun's light changes: the share exp(-t (1 - g)) arrives.

        What is scattered forward counts as not scattered (the similarity relation: van de Hulst, Multiple light
        scattering, 1980).
        """
        return -self.optical_depth * (1 - ASYMMETRY) / math.log(2)
