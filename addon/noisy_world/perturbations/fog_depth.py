# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog by depth: the further away a surface is, the more it fades into the airlight."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..core.node_graphs.graph import Socket
from ..core.node_graphs.groups import Canvas, convert
from ..core.perturbing.about import About
from ..core.perturbing.kinds import ColourPerturbation, FrameContext
from ._air_light import EXTINCTION, GIVEN_AIR, sky_in
from ._air_light_nodes import air_nodes, kept_sky
from ._bands import by_bands
from ._fog_air import air_of, fogged
from ._fog_nodes import clumps_nodes, distance_nodes, glow_nodes, thinned_nodes
from ._fog_parameters import FogDepth, is_even
from ._lamp_light import DROP
from ._lamp_nodes import lamp_light_nodes
from ._patterns import three_channels
from ._view import by_camera


def apply(rgb: NDArray[np.float32], parameters: FogDepth, context: FrameContext) -> NDArray[np.float32]:
    """Fog (H, W, 3) by the context's planar depth (H, W), metres; 0 and NaN are void, infinite is allowed."""
    if not is_even(parameters):
        return fogged(rgb, parameters, context)
    air = air_of(rgb, parameters, context)
    rate = np.float32(-EXTINCTION / parameters.visibility_m)

    def veiled(band: NDArray[np.float32], depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        distance_m = np.where(depth_m > 0, depth_m, np.float32(np.inf))
        if parameters.leave_sky:
            distance_m[sky_in(depth_m)] = 0
        light = _decoded(band)
        light -= air
        light *= three_channels(np.exp(distance_m * rate)).reshape(light.shape)
        light += air
        return _encoded(light)

    return by_bands(rgb, rgb.dtype, veiled, context.depth_m)


def _decoded(encoded: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return linear light of sRGB-encoded values (IEC 61966-2-1)."""
    power = ((np.maximum(encoded, 0) + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    return np.where(encoded <= np.float32(0.04045), encoded / np.float32(12.92), power)


def _encoded(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return sRGB-encoded values of linear light."""
    power = np.maximum(light, 0) ** np.float32(1 / 2.4) * np.float32(1.055) - np.float32(0.055)
    return np.where(light <= np.float32(0.0031308), light * np.float32(12.92), power)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Mix with the airlight by depth, and add the glow."""
    graph = canvas.graph
    with graph.section("Transmission"):
        rate = graph.math("DIVIDE", -EXTINCTION, given["visibility_m"], label="Koschmieder")
        distance_m = distance_nodes(canvas, given) * kept_sky(canvas, given)
    thinned = thinned_nodes(canvas, given, distance_m)
    clumps = clumps_nodes(canvas, given, distance_m)
    with graph.section("What is seen"):
        depth = distance_m * rate * (thinned * clumps)
        seen = graph.math("EXPONENT", depth)
    own = air_nodes(canvas, given)
    with graph.section("Airlight"):
        grey = given["airlight"]
        plain = convert(graph, graph.vector(grey, grey, grey), "sRGB", "Linear Rec.709")
        air = own.chosen(plain, own.surfaces)
    glow = glow_nodes(canvas, given, air, depth)
    with graph.section("Over the image"):
        fogged_over = graph.math("ADD", graph.mix(air, canvas.image, seen), glow)
    if canvas.never_lit:
        return fogged_over
    with graph.section("Lamps: the fog before each pixel"):
        thick, hidden = depth * -1.0, 1.0 - seen
    lamps = lamp_light_nodes(canvas, given, air, DROP, thick)
    with graph.section("Lamps over the image"):
        return fogged_over + lamps.veil(hidden)


PERTURBATION = ColourPerturbation(
    name="fog_depth",
    label="Fog by depth",
    stage="environment",
    order=20,
    parameters=FogDepth,
    severities={"visibility_m": (50, 25, 15, 10, 6)},
    other_severities={"outdoors": {"visibility_m": (1000, 500, 200, 100, 50)}},
    source="our own; the law: Koschmieder, Theorie der horizontalen Sichtweite, 1924",
    about=About(
        "Hides what is far behind lit air; it may lie on the ground, come in clumps, and glow around lamps",
        "attenuation and airlight by planar depth (Koschmieder), thinner with height, uneven, with glow around "
        "lamps; needs depth",
        caption="fog that hides what is far before what is near.",
    ),
    apply=apply,
    build=build,
    lit_by_nodes=True,
    linear=True,
    needs_depth=True,
    implied=GIVEN_AIR | {"glow": ("lamps", 0.0)},
    uses_motion=True,
    by_camera=by_camera,
    repeats=is_even,
    temporals=("fresh", "fixed", "drift"),
)
