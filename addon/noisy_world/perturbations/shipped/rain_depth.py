# SPDX-License-Identifier: GPL-3.0-or-later
"""Rain by depth: streaks at their distances, hidden behind what is nearer, and a veil of drops too small to see."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.mirrored import EvenAir
from ...core.node_graph import Graph, Socket
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._air import DROP, around_by_depth
from ._arrays import QUICKLY, by_camera
from ._falling_nodes import Laws, build_falling
from ._particles import drop_speed_m_s, rain
from ._weather import GIVEN_AIR, Falling, Kind, fallen_on, limits_of, mirrored_air

BRIGHTNESS = 3.0  # with which it has the sky's own colour, or the colour that is given


@dataclass(frozen=True)
class RainDepth(Falling):
    """Drops that fall through the scene, each a streak as long, wide, blurred and faint as its distance makes it.

    Sizes follow Marshall and Palmer (1948), speeds Atlas (1973). What is too small to be seen by itself veils by
    Koschmieder's law. A drop shows nearly the whole scene, upside down, so it is about as bright as its mean, and
    brighter under a sky that the image does not show (Garg and Nayar, 2007).
    """

    rate_mm_h: float = key("rain that falls", default=25.0, unit="mm/h", minimum=0.01, maximum=500)
    brightness: float = key("a drop's light, times the scene's mean", default=BRIGHTNESS, minimum=0, maximum=100)
    wind_m_s: float = key("wind to the right", default=1.0, unit="m/s", minimum=-50, maximum=50)
    gusts_m_s: float = key(
        "standard deviation of each drop's own velocity", default=0.25, unit="m/s", minimum=0, maximum=10
    )
    shutter_ms: float = key("how long the shutter is open", default=2.5, unit="ms", minimum=0, maximum=1000)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "rate_mm_h": "Higher: more and larger drops, and what is far goes gray",
        "brightness": "Higher: streaks and the gray in the distance get lighter",
        "wind_m_s": "Further from 0: streaks lean further to the right, or to the left below 0",
        "gusts_m_s": "Higher: drops go their own ways, and no two streaks lie alike",
        "shutter_ms": "Higher: streaks get longer and fainter",
    }


KIND = Kind(rain, drop_speed_m_s, BRIGHTNESS)


def apply(rgb: NDArray[np.float32], parameters: RainDepth, context: FrameContext) -> NDArray[np.float32]:
    """Let it rain on (H, W, 3), by the context's planar depth (H, W), metres; 0 is void."""
    return fallen_on(KIND, rgb, parameters, context)


def even_air(linear: NDArray[np.float32], parameters: RainDepth, context: FrameContext) -> EvenAir:
    """Return what falls behind what mirrors, before light (H, W, 3)."""
    return mirrored_air(KIND, linear, parameters, context)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Draw four shells of drops, and the veil."""
    return build_falling(canvas, given, LAWS)


def _sizes(graph: Graph, rate_mm_h: Socket) -> tuple[float, Socket]:
    return 8.0, graph.math("POWER", rate_mm_h, 0.21) / 4.1


def _speed(graph: Graph, diameter_mm: Socket) -> Socket:
    return graph.math("MAXIMUM", graph.math("EXPONENT", diameter_mm * -0.6) * -10.3 + 9.65, 0.0)


LAWS = Laws("Rain", _sizes, _speed, BRIGHTNESS, DROP, 1.6, 24.0)

PERTURBATION = ColourPerturbation(
    name="rain_depth",
    label="Rain by depth",
    stage="environment",
    order=24,
    parameters=RainDepth,
    # Streaks as of a film by day; of 2.5 ms they are as short as snow's. Larger drops make up for their faintness.
    newly={"shutter_ms": 8.0, "size": 1.5, **QUICKLY},
    severities={"rate_mm_h": (2.5, 10.0, 25.0, 50.0, 100.0)},
    source="our own: light, moderate, heavy, violent rain, and a cloudburst; sizes: Marshall and Palmer, 1948",
    about=About(
        "Lets drops fall through the scene; near ones are long and wide streaks",
        "streaks of drops at their distances, and a veil; needs depth",
    ),
    apply=apply,
    nodes=Nodes(build, linear=True, draws_lit=True, by_camera=by_camera),
    needs_depth=True,
    by_depth=around_by_depth,
    even_air=even_air,
    implied=GIVEN_AIR,
    uses_motion=True,
    goes_with_camera=True,
    temporals=("fresh", "fixed", "drift"),
    limits=partial(limits_of, KIND),
)
