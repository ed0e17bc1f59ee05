# SPDX-License-Identifier: GPL-3.0-or-later
"""Automatic white balance: gains of red, green and blue by the mean colour of earlier frames, late and in error."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import log2
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket
from ...core.schema import key
from ...core.srgb import LUMINANCE, decoded, encoded
from ..groups import Canvas
from ..kinds import (
    About,
    Automatic,
    ByFrame,
    ColourPerturbation,
    EarlierFrame,
    Example,
    FrameContext,
    FrameValue,
    Nodes,
)
from ._arrays import by_bands
from .auto_exposure import lag_span_s, lagged

GAINS = ("red_gain", "green_gain", "blue_gain")


@dataclass(frozen=True)
class WhiteBalance:
    """A grey world is asked for: gains, in stops, that bring the mean light of earlier clean frames towards grey.

    It goes to what the last frame asks for as 1 - exp(-t / lag), in linear light, and begins settled. Gains leave the
    luminance of grey as it is.
    """

    strength: float = key("share of the mean colour that is taken away", default=0.6, minimum=0, maximum=1)
    lag_s: float = key("time constant of following", default=0.8, unit="s", minimum=0, maximum=5)
    most_stops: float = key("most that red or blue is changed against green", default=1.5, minimum=0, maximum=4)
    warmth_stops: float = key("error: red over blue", default=0.0, minimum=-4, maximum=4)
    tint_stops: float = key(
        "error: red and blue over green; below 0 all is greener", default=0.0, minimum=-4, maximum=4
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "strength": "Higher: scenes of one color get grayer",
        "lag_s": "Higher: colors stay wrong for longer",
        "most_stops": "Lower: strongly colored light stays so",
        "warmth_stops": "Higher: too red; below 0 too blue",
        "tint_stops": "Higher: too purple; below 0 too green",
    }


def decides(parameters: WhiteBalance, context: FrameContext) -> Mapping[str, float]:
    """Return the gains of red, green and blue of a frame."""

    def wanted(frame: EarlierFrame) -> NDArray[np.float64]:
        mean = np.maximum(frame.light.astype(np.float64).mean(axis=(0, 1)), 1e-9)
        return np.clip(parameters.strength * np.log2(mean[1] / mean), -parameters.most_stops, parameters.most_stops)

    stops = lagged(context, parameters.lag_s, wanted, ("white_balance", parameters))
    warm = parameters.warmth_stops / 2
    gains = 2.0 ** (stops + np.array([warm + parameters.tint_stops, 0.0, parameters.tint_stops - warm]))
    gains /= gains @ np.array(LUMINANCE)
    return dict(zip(GAINS, gains.tolist(), strict=True))


def apply(rgb: NDArray[np.float32], _parameters: WhiteBalance, context: FrameContext) -> NDArray[np.float32]:
    """Balance (H, W, 3)."""
    decided = context.decided
    gains = np.array([decided[name] for name in GAINS], np.float32)
    return by_bands(rgb, rgb.dtype, lambda band: encoded(decoded(band) * gains))


def stops_of(_parameters: WhiteBalance, context: FrameContext) -> Mapping[str, float]:
    """Return the gains of a frame in stops."""
    return {name: log2(context.decided[name]) for name in GAINS}


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Multiply the light by its gains."""
    graph = canvas.graph
    with graph.section("Gains"):
        gains = [graph.math("POWER", 2.0, given[name]) for name in GAINS]
    with graph.section("Light"):
        return canvas.image * graph.vector(*gains)


PERTURBATION = ColourPerturbation(
    name="white_balance",
    label="White balance",
    stage="sensor",
    order=8,
    parameters=WhiteBalance,
    severities={"strength": (0.2, 0.4, 0.6, 0.8, 1.0)},
    source="our own: chosen, up to a world that is grey on average (Buchsbaum, 1980)",
    about=About(
        "Turns the colours of what was seen before towards grey, late and never quite",
        "gains of red, green and blue by the mean colour of the frames before, with a lag and errors",
        example=Example(render="{backend: reference}"),
    ),
    apply=apply,
    on_light=True,
    automatic=Automatic(looks_back_s=lambda parameters: lag_span_s(parameters.lag_s), decides=decides),
    nodes=Nodes(
        build,
        linear=True,
        by_frame=ByFrame(
            {
                "red_gain": FrameValue("Stops by which red light is raised", 0.4, -16.0, 16.0),
                "green_gain": FrameValue("Stops by which green light is raised", 0.0, -16.0, 16.0),
                "blue_gain": FrameValue("Stops by which blue light is raised", -0.4, -16.0, 16.0),
            },
            stops_of,
        ),
    ),
)
