# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of the air before a scene, estimated from the scene, on arrays.

Where there is sky the air has the sky's own colour, as what is far fades into the horizon; elsewhere that of the mean
of the surfaces. Both are means that a lamp hardly moves: each pixel weighs 1 / (1 + (l / (4 m))^4), with l its
luminance and m a first mean, that of fourth roots to the fourth power. The weights are smooth, so the light is even
from frame to frame. Of lit frames, which arrays give to nodes, the mean of 16 pixels is one.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.linear_light import LUMINANCE, decoded
from ._void import SKY_M

Float32: TypeAlias = NDArray[np.float32]
Float64: TypeAlias = NDArray[np.float64]

# The contrast of a black object that is left at the distance called visibility (WMO's meteorological optical range).
CONTRAST_THRESHOLD = 0.05
EXTINCTION = -math.log(CONTRAST_THRESHOLD)
GIVEN_AIR = {f"air_{name}": ("air", "colour") for name in ("red", "green", "blue")} | {"airlight": ("air", "grey")}
"""What giving a grey or a colour implies."""
AIR_TOOLTIPS = {
    "air": "Whether its light comes from the scene, is a gray, or is the color below",
    "air_red": "Higher: redder light, where Air is Color",
    "air_green": "Higher: greener light, where Air is Color",
    "air_blue": "Higher: bluer light, where Air is Color",
    "lamps": "Higher: on lit scenes, lamps light more of the air around them; 0 is none",
    "leave_sky": "On: the sky keeps its colors",
}

KNEE = 4.0  # times the first mean; what is as bright weighs a half; chosen
WHOLE_SKY = 0.02  # share of the frame; less sky counts in part, so that none appears at once; chosen
NIGHT = 1e-4  # luminance of a sky that counts half; a black one is none; chosen
LEAST = 1e-9  # below it nothing is divided by


@dataclass(frozen=True)
class AirLight:
    """What the scene says of the air's light. surfaces, sky: (3,) linear. share: of the sky's in it, 0 to 1."""

    surfaces: Float64
    sky: Float64
    share: float

    def over(self, surfaces: Float64) -> Float64:
        """Return (3,): the sky's colour and another one than the surfaces', mixed by the share."""
        return surfaces + (self.sky - surfaces) * self.share


def sky_in(depth_m: Float32) -> NDArray[np.bool_]:
    """Return where a depth image (H, W), metres, shows sky: void, or what is farther than any surface."""
    return ~((depth_m > 0) & (depth_m <= SKY_M))


def air_light(linear: Float32, depth_m: Float32) -> AirLight:
    """Return the light of the air before (H, W, 3) of linear light, with its depth (H, W), metres."""
    sky = sky_in(depth_m)
    own = robust_mean(linear[sky])
    bright = float(own @ LUMINANCE)
    share = min(float(sky.mean()) / WHOLE_SKY, 1.0) * bright / (bright + NIGHT)
    return AirLight(robust_mean(linear[~sky]), own, share)


def robust_mean(linear: Float32) -> Float64:
    """Return (3,): the mean of light (N, 3) that lamps hardly move; 0 of no pixels."""
    if not len(linear):
        return np.zeros(3)
    luminance = np.maximum(linear @ np.array(LUMINANCE, np.float32), np.float32(0))
    first = float(np.sqrt(np.sqrt(luminance)).mean(dtype=np.float64)) ** 4
    ratio = luminance * np.float32(1 / max(KNEE * first, LEAST))
    weight = 1 / (1 + np.square(np.square(ratio)))
    return (weight[:, None] * linear).mean(axis=0, dtype=np.float64) / max(weight.mean(dtype=np.float64), LEAST)


def colour_of(red: float, green: float, blue: float) -> Float64:
    """Return (3,): linear light of a colour that is sRGB-encoded."""
    return decoded(np.array([red, green, blue], np.float32)).astype(np.float64)
