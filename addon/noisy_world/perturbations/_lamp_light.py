# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of lamps on what floats in the air before them, estimated from the picture.

A lamp of radiance L that covers the solid angle w, seen z away at the angle a from a ray, lights what is at the
distance d from it by L w z^2 / d^2. Over all places on the ray this is L w (2 C) pi / a divided by pi 2 z / z, so the
particles' mean light is C L w / a: with C = 1/8 for those that scatter to all sides alike (the integral in closed form:
Sun, Ramamoorthi, Narasimhan and Nayar, A practical analytic single scattering model for real time rendering, 2005). In
general C is half the integral of the phase function over the angle of scattering, as each angle has an equal share of
1 / a. A drop of water that is looked through (Snell, Fresnel, once through; Garg and Nayar, Vision and rain, 2007)
throws light forward, and has C = 0.256.

Even air with an extinction of b a metre takes 1 - exp(-b x) of the light up to a depth x, and so has that share of it,
but no more than 1 - exp(-2 b z): beyond twice the lamp's distance hardly any of its light is left.

Through fog of the optical depth t the share 1 / (1 + 0.75 (1 - g) t) of a lamp's light arrives at all, most of it
scattered many times (Eddington's approximation for a layer that absorbs nothing); g = 0.85 of water's droplets.

C / a is a sum of Gaussians, each twice as wide as the one before: of width s and volume ln(2) s C sqrt(8 pi). The
widest has twice that, for all that would be wider: from 0.02 to 0.4 radians the sum is right within 6 %.
"""

import math

from ..core.schema import key

FLAKE, DROP = 0.125, 0.256
DIFFUSE = 0.75 * (1 - 0.85)
WIDTHS_RAD = (0.8, 0.4, 0.2, 0.1, 0.05, 0.025, 0.0125)
VOLUMES = tuple(math.log(2) * math.sqrt(8 * math.pi) * width * (2 if width == 0.8 else 1) for width in WIDTHS_RAD)


def lamps_key() -> float:
    """Return the parameter that says how strong that light is."""
    return key("light of lamps in the air, on lit scenes, times its estimate", default=1.0, minimum=0, maximum=100)
