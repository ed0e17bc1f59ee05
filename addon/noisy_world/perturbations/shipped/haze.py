# SPDX-License-Identifier: GPL-3.0-or-later
"""Haze: what is far away fades and turns blue, and its own light reddens, as short waves scatter more."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.mirrored import EvenAir
from ...core.node_graph import Socket
from ...core.schema import Choice, key
from ...core.srgb import LUMINANCE, decoded, encoded
from ...core.visibility import EXTINCTION
from ..groups import Canvas, convert
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._air import (
    AIR_TOOLTIPS,
    DROP,
    GIVEN_AIR,
    air_colour_key,
    air_key,
    air_light,
    air_nodes,
    around_by_depth,
    around_key,
    colour_of,
    kept_sky,
    lamp_light_nodes,
    lamps_key,
    sky_in,
)
from ._arrays import QUICKLY, by_bands, by_camera, quick_key, view_key

VISUAL_NM = 550.0  # where visibility is meant: the eye is most sensitive
# Dominant wavelengths of Rec. 709's primaries against its white.
CHANNELS_NM = (611.4, 549.1, 464.2)


@dataclass(frozen=True)
class Haze:
    """Koschmieder's law by wavelength: light * t + airlight * (1 - t), linear, with a transmission t for each channel.

    Extinction is proportional to wavelength^-angstrom (Angstrom, 1929): 4 for clear air (Rayleigh), about 1.3 for haze,
    0 for fog. The light that haze scatters into view has been scattered before in part, and is as much bluer.
    """

    visibility_m: float = key(
        "distance at which 5 % of the contrast is left, at 550 nm", default=250.0, unit="m", above=0, maximum=1e6
    )
    angstrom: float = key(
        "how much more short waves scatter: wavelength to minus this power", default=1.3, minimum=0, maximum=4.1
    )
    airlight: float = key("grey of the haze's light, sRGB-encoded", default=0.8, minimum=0, maximum=10)
    blueness: float = key("share of the haze's light that was scattered before", default=0.5, minimum=0, maximum=1)
    air: Literal["auto", "scene", "grey", "colour"] = air_key(
        "grey", "airlight, bluer", Choice("Grey", "As light as Airlight, and bluer by Blueness")
    )
    air_red: float = air_colour_key("red", 0.8)
    air_green: float = air_colour_key("green", 0.8)
    air_blue: float = air_colour_key("blue", 0.8)
    air_around: bool = around_key()
    lamps: float = lamps_key()
    leave_sky: bool = key("void stays as it is", default=False)
    void_m: float = key(
        "void and what is farther count as this far", default=100000.0, unit="m", minimum=0.1, maximum=1e6
    )
    view_deg: float = view_key()
    coarse: bool = quick_key("blur the light of lamps by larger blocks where that is wide: as good, in less time")
    TOOLTIPS: ClassVar[Mapping[str, str]] = AIR_TOOLTIPS | {
        "visibility_m": "Lower: the haze gets denser, and hides what is nearer",
        "angstrom": "Higher: the distance gets bluer, and lamps in it redder; 0 is gray, as fog",
        "airlight": "Higher: the haze gets lighter; 0 is smoke, 1 is white",
        "blueness": "Higher: the haze itself gets bluer",
        "void_m": "Lower: more of the sky is seen through the haze",
        "coarse": "On: light of lamps is blurred by larger blocks, in less time",
        "view_deg": "Higher: as through a wider lens; a known camera decides it",
    }

    def extinction_per_m(self) -> NDArray[np.float64]:
        """Return (3,): of red, green and blue."""
        return EXTINCTION / self.visibility_m * _bluer(self.angstrom)

    def light(self, grey: float | None = None) -> NDArray[np.float64]:
        """Return (3,): the linear light of haze without end; its luminance is that of the grey, by default the own."""
        colour = _bluer(self.angstrom * self.blueness)
        if grey is None:
            grey = float(decoded(np.array([self.airlight], np.float32))[0])
        return grey * colour / (colour @ LUMINANCE)


def _bluer(power: float) -> NDArray[np.float64]:
    return (VISUAL_NM / np.array(CHANNELS_NM)) ** power


def apply(rgb: NDArray[np.float32], parameters: Haze, context: FrameContext) -> NDArray[np.float32]:
    """Haze (H, W, 3) by the context's planar depth (H, W), metres; 0 and NaN are void."""
    import cv2

    rates = -parameters.extinction_per_m()
    light = np.tile(_air_of(rgb, parameters, context).astype(np.float32), rgb.shape[1])
    farthest_m = np.float32(parameters.void_m)

    def hazed(band: NDArray[np.float32], depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        distance_m = np.where(depth_m > 0, np.minimum(depth_m, farthest_m), farthest_m)
        if parameters.leave_sky:
            distance_m[sky_in(depth_m)] = 0
        seen = [np.asarray(cv2.exp(distance_m * np.float32(rate)), np.float32) for rate in rates]
        linear = decoded(band)
        rows = linear.reshape(len(band), -1)
        rows -= light
        rows *= np.asarray(cv2.merge(seen), np.float32).reshape(rows.shape)
        rows += light
        return encoded(linear)

    return by_bands(rgb, rgb.dtype, hazed, context.depth_m)


def _air_of(rgb: NDArray[np.float32], parameters: Haze, context: FrameContext) -> NDArray[np.float64]:
    if parameters.air == "colour":
        return colour_of(parameters.air_red, parameters.air_green, parameters.air_blue)
    if parameters.air == "grey" or (parameters.air == "auto" and not context.lit):
        return parameters.light()
    own = air_light(decoded(rgb), context.depth_m, around=parameters.air_around)
    return own.over(parameters.light(float(own.surfaces @ LUMINANCE)))


def even_air(linear: NDArray[np.float32], parameters: Haze, context: FrameContext) -> EvenAir:
    """Return the haze behind what mirrors, before light (H, W, 3)."""
    light = _air_of(encoded(linear), parameters, context)
    return EvenAir(light, parameters.extinction_per_m(), 0.0 if parameters.leave_sky else parameters.void_m)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Mix with the airlight by a transmission for each channel."""
    graph, depth_m = canvas.graph, canvas.depth_m
    assert depth_m is not None
    with graph.section("Transmission"):
        # Maximum returns its first operand where the second is NaN.
        known_m = graph.math("MAXIMUM", 0.0, depth_m)
        void = graph.math("LESS_THAN", known_m, 1e-12)
        far_m = graph.math("MULTIPLY_ADD", void, given["void_m"], known_m)
        distance_m = graph.math("MINIMUM", far_m, given["void_m"]) * kept_sky(canvas, given)
        rate = graph.math("DIVIDE", -EXTINCTION, given["visibility_m"], label="Koschmieder")
        ratios = [VISUAL_NM / wave for wave in CHANNELS_NM]
        rates = [rate * graph.math("POWER", ratio, given["angstrom"]) for ratio in ratios]
        depths = [distance_m * each for each in rates]
        seen = graph.vector(*(graph.math("EXPONENT", each) for each in depths))
    own = air_nodes(canvas, given)
    with graph.section("Airlight"):
        power = given["angstrom"] * given["blueness"]
        colour = graph.vector(*(graph.math("POWER", ratio, power) for ratio in ratios))
        bright = graph.math("DOT_PRODUCT", colour, LUMINANCE)
        grey = convert(graph, graph.vector(*[given["airlight"]] * 3), "sRGB", "Linear Rec.709")
        hue = colour / graph.vector(bright, bright, bright)
        mean = graph.math("DOT_PRODUCT", own.surfaces, LUMINANCE)
        air = own.chosen(grey * hue, graph.vector(mean, mean, mean) * hue)
    with graph.section("Over the image"):
        hazed = graph.mix(air, canvas.image, seen)
    if canvas.never_lit:
        return hazed
    with graph.section("Lamps: the haze before each pixel"):
        thick, hidden = depths[1] * -1.0, 1.0 - seen.y
    lamps = lamp_light_nodes(canvas, given, air, DROP, thick)
    with graph.section("Lamps over the image"):
        return hazed + lamps.veil(hidden)


PERTURBATION = ColourPerturbation(
    name="haze",
    label="Haze",
    stage="environment",
    order=18,
    parameters=Haze,
    newly=QUICKLY,
    severities={"visibility_m": (1000, 500, 250, 120, 60)},
    source=(
        "our own: from haze (WMO: 1 km and more) to smoke; Koschmieder, 1924; Angstrom, On the atmospheric "
        "transmission of sun radiation and on dust in the air, 1929; Narasimhan and Nayar, Vision and the atmosphere, "
        "2002"
    ),
    about=About(
        "Fades what is far and turns it blue, as dry air does",
        "what is far fades and turns blue, by Koschmieder's law at three wavelengths; needs depth",
        caption="what is far fades and turns blue. A room is too small for it; [below](#on-a-lit-street) is a street.",
    ),
    apply=apply,
    nodes=Nodes(build, linear=True, draws_lit=True, by_camera=by_camera),
    needs_depth=True,
    by_depth=around_by_depth,
    implied=GIVEN_AIR | {"blueness": ("air", "grey")},
    repeatable=True,
    even_air=even_air,
)
