# SPDX-License-Identifier: GPL-3.0-or-later
"""Dirt on the front glass: dust, grease and scratches, and the glare and streaks of bright light on them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.linear_light import decoded, encoded
from ..core.node_graphs.graph import Socket
from ..core.node_graphs.groups import Canvas
from ..core.perturbing.about import About, Example
from ..core.perturbing.kinds import ColourPerturbation, FrameContext
from ..core.schema import key
from ._bands import by_bands
from ._dirt_nodes import build_dirt
from ._dirt_tile import TEXEL_PX, tile
from ._glare import HALVINGS, Spread, glare_of
from ._glass import reduced
from ._patterns import kept_for_sequence, three_channels
from ._white_noise import white_noise

Float32: TypeAlias = NDArray[np.float32]

ABSORBED = 0.6  # of what dust takes away; it scatters the rest; chosen


@dataclass(frozen=True)
class LensDirt:
    """Dust, smears of grease and scratches on the glass before the lens, out of focus.

    image * (1 - absorbed - scattered) + scattered * glare, as Gu, Ramamoorthi, Belhumeur and Nayar (2009) have it, in
    linear light: glare is the image spread far, so lamps light up the dirt around them and draw streaks.
    """

    dust: float = key("share of light that the densest speck takes away", default=0.35, minimum=0, maximum=1)
    smudges: float = key("share of light that the thickest grease scatters", default=0.35, minimum=0, maximum=1)
    scratches: float = key("share of light that the deepest scratch scatters", default=0.25, minimum=0, maximum=1)
    size: float = key("size of all dirt, times its own", default=1.0, minimum=0.25, maximum=8)
    reach_px: float = key("how far scattered light reaches", default=110.0, unit="px", minimum=8, maximum=2000)
    streaks: float = key("share of scattered light that is drawn out to streaks", default=0.35, minimum=0, maximum=1)
    wiped_deg: float = key(
        "direction in which the glass was wiped, across which streaks run; 0 is to the right, 90 down",
        default=25.0,
        unit="deg",
        minimum=-180,
        maximum=180,
    )
    glare: float = key("scattered light, times what is taken away for it", default=1.0, minimum=0, maximum=20)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "dust": "Higher: darker specks of dust",
        "smudges": "Higher: thicker grease; bright light spreads over it",
        "scratches": "Higher: deeper scratches, which light up near lamps",
        "size": "Higher: all dirt is larger",
        "reach_px": "Higher: lamps light up dirt further away from them",
        "streaks": "Higher: lamps draw streaks instead of halos",
        "wiped_deg": "Turns the streaks, which run across the direction of wiping",
        "glare": "Higher: dirt shines more than it takes away; 1 is as it is, 0 only takes away",
    }


def apply(rgb: Float32, parameters: LensDirt, context: FrameContext) -> Float32:
    """Look at (H, W, 3) through dirt."""
    import cv2

    linear = by_bands(rgb, rgb.dtype, decoded)
    spread = Spread(parameters.reach_px / 2**HALVINGS, parameters.streaks, math.radians(parameters.wiped_deg + 90))
    small = glare_of(reduced(linear, HALVINGS), spread)
    glare = np.asarray(cv2.resize(small, rgb.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)

    def dirty(band: Float32, band_glare: Float32, band_dirt: Float32) -> Float32:
        absorbed, scattered = lost(band_dirt, parameters)
        seen = band_glare.reshape(band.shape) * three_channels(scattered * np.float32(parameters.glare))
        seen += three_channels(1 - absorbed - scattered).reshape(band.shape) * band
        return encoded(seen)

    return by_bands(linear, rgb.dtype, dirty, glare, dirt_before(context, rgb.shape[:2], parameters.size))


def lost(dirt: Float32, parameters: LensDirt) -> tuple[Float32, Float32]:
    """Return which share of light dirt (..., 3) absorbs and which it scatters, each without the last axis."""
    dust, grease, scratched = (dirt[..., k] for k in range(3))
    absorbed = dust * np.float32(parameters.dust * ABSORBED)
    scattered = dust * np.float32(parameters.dust * (1 - ABSORBED)) + grease * np.float32(parameters.smudges)
    scattered += scratched * np.float32(parameters.scratches)
    return absorbed, np.minimum(scattered, 1 - absorbed)


@kept_for_sequence
def dirt_before(context: FrameContext, shape: tuple[int, int], size: float) -> Float32:
    """Return (H, W, 3): dust, grease and scratches before each pixel, in [0, 1]."""
    import cv2

    drawn = white_noise(context)
    start, turned = drawn.numbers(0), drawn.numbers(1)
    dirt = tile()
    matrix = np.zeros((2, 3))
    for axis, side in enumerate(dirt.shape[1::-1]):
        step = (1 if turned[axis] < 0.5 else -1) / (TEXEL_PX * size)  # one of two is mirrored
        matrix[axis, axis] = step
        matrix[axis, 2] = start[axis] * side + 0.5 * step - 0.5
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpAffine(
        dirt.astype(np.float32), matrix, (shape[1], shape[0]), flags=flags, borderMode=cv2.BORDER_WRAP
    )
    before = np.asarray(seen, np.float32).reshape(*shape, 3)
    before *= np.float32(1 / 255)
    before.flags.writeable = False
    return before


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Look the dirt up in a picture, spread the image's light, and mix."""
    return build_dirt(canvas, given, ABSORBED)


PERTURBATION = ColourPerturbation(
    name="lens_dirt",
    label="Lens dirt",
    stage="lens",
    order=62,
    parameters=LensDirt,
    severities={
        "dust": (0.1, 0.2, 0.35, 0.55, 0.8),
        "smudges": (0.1, 0.2, 0.35, 0.55, 0.8),
        "scratches": (0.08, 0.15, 0.25, 0.4, 0.6),
    },
    source="our own: from a lens that was wiped to one that never was",
    about=About(
        "Puts dust, grease and scratches on the front glass, which light up near lamps",
        "dust, grease and scratches on the front glass, and the glare of lamps on them",
        caption="dust, grease and scratches on the front glass.",
        example=Example(
            said="Dust, grease and scratches on the lens in the embedded room, clean and at severities 1, 3 and 5."
        ),
    ),
    apply=apply,
    build=build,
    lit_by_nodes=True,
    linear=True,
    temporals=("fixed", "fresh"),
)
