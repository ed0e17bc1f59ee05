# SPDX-License-Identifier: GPL-3.0-or-later
"""Parameters of fog by depth."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from ..core.schema import Choice, key
from ._air_light import AIR_TOOLTIPS
from ._lamp_light import lamps_key


@dataclass(frozen=True)
class FogDepth:
    """Koschmieder's law: image * t + airlight * (1 - t), with t = 0.05^(distance / visibility), in linear light.

    Planar depth is used as the distance, so the corners of a wide view get a little too little fog. Void counts as
    infinitely far. The fog is even, unless falloff, unevenness or glow are above 0.
    """

    visibility_m: float = key(
        "distance at which 5 % of the contrast is left", default=15.0, unit="m", above=0, maximum=100000
    )
    outdoors: bool = key("severities are 1000, 500, 200, 100 and 50 m, as of streets, instead of rooms", default=False)
    airlight: float = key("grey that the fog is made of, sRGB-encoded", default=0.8, minimum=0, maximum=1)
    air: Literal["auto", "scene", "grey", "colour"] = key(
        "where its light comes from: auto is scene on lit scenes, whose light is not clipped, else grey; scene: the "
        "sky's colour where there is sky, else a mean that lamps do not move; grey: airlight; colour: as given",
        default="auto",
        choices={
            "auto": Choice("Automatic", "Scene on lit scenes, whose light is not clipped, else Grey"),
            "scene": Choice("Scene", "The sky's colour where there is sky, else a mean that lamps do not move"),
            "grey": Choice("Grey", "A grey as light as Airlight"),
            "colour": Choice("Colour", "As given below"),
        },
    )
    air_red: float = key("red of its light, sRGB-encoded", default=0.8, minimum=0, maximum=20)
    air_green: float = key("green of its light, sRGB-encoded", default=0.8, minimum=0, maximum=20)
    air_blue: float = key("blue of its light, sRGB-encoded", default=0.8, minimum=0, maximum=20)
    lamps: float = lamps_key()
    leave_sky: bool = key("void stays as it is", default=False)
    falloff_m: float = key(
        "height in which the fog thins to 37 %; 0 is as dense everywhere", default=0.0, unit="m", minimum=0, maximum=1e5
    )
    camera_height_m: float = key(
        "height of the first camera above where visibility is meant", default=1.5, unit="m", minimum=-1e5, maximum=1e5
    )
    unevenness: float = key(
        "standard deviation of the fog's density, relative; 0 is even", default=0.0, minimum=0, maximum=1
    )
    clump_m: float = key("size of the largest clumps", default=8.0, unit="m", minimum=0.1, maximum=10000)
    wind_m_s: float = key("wind to the right, which carries clumps", default=1.0, unit="m/s", minimum=-50, maximum=50)
    glow: float = key("share of the light that fog takes from lamps and that glows", default=0.0, minimum=0, maximum=1)
    glow_width_deg: float = key(
        "how wide a glow is at an optical depth of 1", default=2.0, unit="deg", minimum=0.1, maximum=20
    )
    view_deg: float = key(
        "horizontal field of view, where the camera is unknown", default=90.0, unit="deg", minimum=1, maximum=170
    )
    frame_rate_hz: float = key(
        "frames a second, by which it drifts", default=20.0, unit="Hz", minimum=0.001, maximum=100000
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = AIR_TOOLTIPS | {
        "visibility_m": "Lower: the fog gets denser, and hides what is nearer",
        "outdoors": "On: severities are those of streets, where one sees further than in rooms",
        "airlight": "Higher: the fog gets lighter; 0 is smoke, 1 is white",
        "falloff_m": "Above 0 the fog lies on the ground: lower, and roofs and sky come out of it",
        "camera_height_m": "Higher: the camera stands more above low fog, and sees more",
        "unevenness": "Higher: the fog comes in clumps, with clearer air between",
        "clump_m": "Higher: larger clumps",
        "wind_m_s": "Further from 0: with the pattern Drift, clumps move faster to the right, or to the left below 0",
        "glow": "Higher: lamps glow more in the fog",
        "glow_width_deg": "Higher: wider and softer glows",
        "view_deg": "Higher: as through a wider lens; a known camera decides it",
        "frame_rate_hz": "Lower: with the pattern Drift, more time passes from frame to frame",
    }


def is_even(parameters: FogDepth) -> bool:
    """Tell whether the fog is the same everywhere and does not glow."""
    return parameters.falloff_m == 0 and parameters.unevenness == 0 and parameters.glow == 0
