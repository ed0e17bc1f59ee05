# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog by depth: the further away a surface is, the more it fades into the airlight."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.node_graphs.graph import Socket
from ..core.node_graphs.groups import Canvas, convert
from ..core.perturbing.kinds import ColourPerturbation, FrameContext
from ..core.schema import key
from ._patterns import three_channels

# The contrast of a black object that is left at the distance called visibility (WMO's meteorological optical range).
CONTRAST_THRESHOLD = 0.05
_EXTINCTION = -math.log(CONTRAST_THRESHOLD)


@dataclass(frozen=True)
class FogDepth:
    """Koschmieder's law: image * t + airlight * (1 - t), with t = 0.05^(distance / visibility), in linear light.

    The fog is homogeneous. Planar depth is used as the distance, so the corners of a wide view get a little too little
    fog. Void counts as infinitely far: pure airlight.
    """

    visibility_m: float = key(
        "distance at which 5 % of the contrast is left", default=15.0, unit="m", above=0, maximum=100000
    )
    airlight: float = key("grey that the fog is made of, sRGB-encoded", default=0.8, minimum=0, maximum=1)


def apply(rgb: NDArray[np.float32], parameters: FogDepth, context: FrameContext) -> NDArray[np.float32]:
    """Fog (H, W, 3) by the context's planar depth (H, W), metres; 0 and NaN are void, infinite is allowed."""
    depth_m = context.depth_m
    distance_m = np.where(depth_m > 0, depth_m, np.float32(np.inf))
    seen = three_channels(np.exp(distance_m * np.float32(-_EXTINCTION / parameters.visibility_m)))
    light = _decoded(rgb)
    air = _decoded(np.array([parameters.airlight], dtype=np.float32))
    light -= air
    light *= seen
    light += air
    return _encoded(light)


def _decoded(encoded: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return linear light of sRGB-encoded values (IEC 61966-2-1)."""
    power = ((np.maximum(encoded, 0) + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    return np.where(encoded <= np.float32(0.04045), encoded / np.float32(12.92), power)


def _encoded(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return sRGB-encoded values of linear light."""
    power = np.maximum(light, 0) ** np.float32(1 / 2.4) * np.float32(1.055) - np.float32(0.055)
    return np.where(light <= np.float32(0.0031308), light * np.float32(12.92), power)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Mix with the airlight by depth, between decoding and encoding."""
    graph, depth_m = canvas.graph, canvas.depth_m
    assert depth_m is not None
    with graph.section("Transmission"):
        # Maximum returns its first operand where the second is NaN.
        known = graph.math("GREATER_THAN", graph.math("MAXIMUM", 0.0, depth_m), 0.0, label="Not void")
        rate = graph.math("DIVIDE", -_EXTINCTION, given["visibility_m"], label="Koschmieder")
        seen = graph.math("EXPONENT", graph.math("MAXIMUM", 0.0, depth_m) * rate) * known
    with graph.section("Airlight, in linear light"):
        grey = given["airlight"]
        air = convert(graph, graph.vector(grey, grey, grey), "sRGB", "Linear Rec.709")
        light = convert(graph, canvas.image, "sRGB", "Linear Rec.709")
        fogged = graph.mix(air, light, seen)
        return convert(graph, fogged, "Linear Rec.709", "sRGB")


PERTURBATION = ColourPerturbation(
    name="fog_depth",
    label="Fog by depth",
    stage="environment",
    order=20,
    parameters=FogDepth,
    severities={"visibility_m": (50, 25, 15, 10, 6)},
    source="our own; the law: Koschmieder, Theorie der horizontalen Sichtweite, 1924",
    apply=apply,
    repeatable=True,
    build=build,
    needs_depth=True,
)
