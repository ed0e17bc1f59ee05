# SPDX-License-Identifier: GPL-3.0-or-later
"""Snow by depth: flakes at their distances, hidden behind what is nearer, and a veil of those too small to see."""

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
from ._air import FLAKE, around_by_depth
from ._arrays import QUICKLY, by_camera
from ._falling_nodes import Laws, build_falling
from ._particles import SWOLLEN, flake_speed_m_s, snow
from ._weather import GIVEN_AIR, Falling, Kind, fallen_on, limits_of, mirrored_air

BRIGHTNESS = 2.5  # with which it has the sky's own colour, or the colour that is given


@dataclass(frozen=True)
class SnowDepth(Falling):
    """Flakes that fall through the scene, each as large, fast, blurred and bright as its distance makes it.

    Sizes follow Gunn and Marshall (1958), speeds Locatelli and Hobbs (1974). What is too small to be seen by itself
    veils by Koschmieder's law. A flake is white among surfaces that reflect 40 %, so 2.5 times as bright as their mean.
    """

    rate_mm_h: float = key("water that falls, as snow", default=2.0, unit="mm/h", minimum=0.01, maximum=500)
    brightness: float = key("a flake's light, times the scene's mean", default=BRIGHTNESS, minimum=0, maximum=100)
    wind_m_s: float = key("wind to the right", default=0.6, unit="m/s", minimum=-50, maximum=50)
    gusts_m_s: float = key(
        "standard deviation of each flake's own velocity", default=0.25, unit="m/s", minimum=0, maximum=10
    )
    shutter_ms: float = key("how long the shutter is open", default=8.0, unit="ms", minimum=0, maximum=1000)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "rate_mm_h": "Higher: more and larger flakes, and what is far goes white",
        "brightness": "Higher: flakes and the white in the distance get lighter",
        "wind_m_s": "Further from 0: flakes fly further to the right, or to the left below 0",
        "gusts_m_s": "Higher: flakes go their own ways, and no two streaks lie alike",
        "shutter_ms": "Higher: flakes become longer and fainter streaks",
    }


KIND = Kind(snow, flake_speed_m_s, BRIGHTNESS)


def apply(rgb: NDArray[np.float32], parameters: SnowDepth, context: FrameContext) -> NDArray[np.float32]:
    """Let it snow on (H, W, 3), by the context's planar depth (H, W), metres; 0 is void."""
    return fallen_on(KIND, rgb, parameters, context)


def even_air(linear: NDArray[np.float32], parameters: SnowDepth, context: FrameContext) -> EvenAir:
    """Return what falls behind what mirrors, before light (H, W, 3)."""
    return mirrored_air(KIND, linear, parameters, context)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Draw four shells of flakes, and the veil."""
    return build_falling(canvas, given, LAWS)


def _sizes(graph: Graph, rate_mm_h: Socket) -> tuple[Socket, Socket]:
    many = graph.math("POWER", rate_mm_h, -0.87) * (3.8 / SWOLLEN)
    return many, graph.math("POWER", rate_mm_h, 0.48) * (SWOLLEN / 2.55)


def _speed(graph: Graph, diameter_mm: Socket) -> Socket:
    return graph.math("POWER", diameter_mm, 0.16) * 0.8


LAWS = Laws("Snow", _sizes, _speed, BRIGHTNESS, FLAKE, 1.25, 4.0)

PERTURBATION = ColourPerturbation(
    name="snow_depth",
    label="Snow by depth",
    stage="environment",
    order=22,
    parameters=SnowDepth,
    newly=QUICKLY,
    severities={"rate_mm_h": (0.5, 1.0, 2.0, 4.0, 8.0)},
    source="our own: from light to very heavy snowfall; sizes: Gunn and Marshall, 1958",
    about=About(
        "Lets flakes fall through the scene; near ones are large, fast and out of focus",
        "flakes at their distances, and a veil; needs depth",
        caption="flakes at their distances. A room holds few of them.",
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
