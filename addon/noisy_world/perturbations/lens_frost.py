# SPDX-License-Identifier: GPL-3.0-or-later
"""Frost on the lens: ferns of ice that grow on the glass before it, from the border inwards."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.linear_light import LUMINANCE, decoded, encoded
from ..core.perturbing.about import About, Example
from ..core.perturbing.kinds import ColourPerturbation, FrameContext
from ..core.schema import key
from ._bands import by_bands
from ._crystals import (
    AGING,
    BODY_RELIEF,
    DARKEST,
    GLINT_FROM,
    GLINT_SLOPE,
    HALVINGS,
    HEIGHT_PX,
    LIGHT_SHARE,
    LIGHTEST,
    MEAN_SHARE,
    RIDGE_OPACITY,
    RIDGE_RELIEF,
    RISE,
    SHADE,
    SHORT_SIDE_PX,
    START_PX,
    WIDTH_PX,
    Level,
    atlas,
    level_of,
)
from ._frost_nodes import build
from ._patterns import three_channels
from ._white_noise import white_noise

Float32: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True)
class LensFrost:
    """Ice crystals that grow on the glass from its border inwards, with branches; the middle stays clear.

    Ridges displace what is behind them and glint; ice scatters light, so it shows that of its surroundings.
    """

    coverage: float = key("how far it has grown; 1 is as far as it gets", default=0.55, minimum=0, maximum=1)
    opacity: float = key("optical depth of the thickest ice", default=1.6, minimum=0, maximum=20)
    brightness: float = key("light that ice scatters, times that around it", default=1.6, minimum=0, maximum=20)
    tint: float = key("how far that light has the surroundings' colour", default=0.8, minimum=0, maximum=1)
    refraction_px: float = key("how far a slope of 1 displaces", default=10.0, unit="px", minimum=0, maximum=200)
    glint: float = key("light of glints, times that around them", default=1.0, minimum=0, maximum=50)
    growth_per_s: float = key(
        "drift: how much coverage it gains; below 0 it thaws", default=0.03, unit="1/s", minimum=-10, maximum=10
    )
    frame_rate_hz: float = key(
        "frames a second, by which it grows", default=20.0, unit="Hz", minimum=0.001, maximum=100000
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "coverage": "Higher: ferns of ice reach further from the border towards the middle",
        "opacity": "Higher: the ice gets denser, and hides what is behind it",
        "brightness": "Higher: the ice gets lighter",
        "tint": "Higher: the ice has the colors of what is around it; 0 is white ice",
        "refraction_px": "Higher: crystals displace what is behind them further",
        "glint": "Higher: brighter glints on the crystals' edges",
        "growth_per_s": "Higher: with the pattern Drift, ice grows faster; below 0 it thaws",
        "frame_rate_hz": "Higher: with the pattern Drift, ice grows less from frame to frame",
    }


@dataclass(frozen=True)
class FrostPane:
    """What is drawn for a pattern.

    start_px: the column of the strip at which the first side begins. flipped: which sides show it backwards: top,
    bottom, left, right. light_rad: where the light comes from, 0 to the right, downwards.
    """

    start_px: int
    flipped: tuple[bool, bool, bool, bool]
    light_rad: float


def pane_of(uniform: NDArray[np.float64]) -> FrostPane:
    """Return what three uniform numbers in [0, 1) draw."""
    sides = int(uniform[1] * 16)
    flipped = (bool(sides & 8), bool(sides & 4), bool(sides & 2), bool(sides & 1))
    start_px = int(uniform[0] * (WIDTH_PX // START_PX)) * START_PX
    return FrostPane(start_px, flipped, -math.pi * (0.25 + 0.5 * float(uniform[2])))


def apply(rgb: Float32, parameters: LensFrost, context: FrameContext) -> Float32:
    """Let frost grow before (H, W, 3)."""
    import cv2

    # On lit frames what the nodes draw; on others the draws of before, whose bytes stay.
    drawn = white_noise(context).numbers(0) if context.lit else context.pattern_stream().random(3)
    pane = pane_of(np.asarray(drawn, np.float64))
    grown_s = context.drift_frames / parameters.frame_rate_hz
    grown = min(max(parameters.coverage + parameters.growth_per_s * grown_s, 0.0), 1.0)
    linear = by_bands(rgb, rgb.dtype, decoded)
    ridge, body = ice_on(rgb.shape[:2], grown, pane)
    right, down = slopes(ridge, body, SHORT_SIDE_PX / min(rgb.shape[:2]))
    behind = _refracted(linear, right, down, parameters.refraction_px)
    light = _light_around(linear, parameters.tint)
    towards = np.float32(math.cos(pane.light_rad)), np.float32(math.sin(pane.light_rad))

    def frosted(band: Float32, around: Float32, *ice: Float32) -> Float32:
        ridge, body, right, down = ice
        thick = np.asarray(cv2.addWeighted(ridge, -RIDGE_OPACITY, body, -1.0, 0.0), np.float32).reshape(ridge.shape)
        seen = np.asarray(cv2.exp(thick * np.float32(parameters.opacity)), np.float32).reshape(thick.shape)
        lean = right * towards[0] + down * towards[1]
        white = np.asarray(np.clip(lean * np.float32(SHADE), DARKEST, LIGHTEST), np.float32)
        white += np.float32(1)
        white *= (np.float32(1) - seen) * np.float32(parameters.brightness)
        glints = np.clip(lean * np.float32(GLINT_SLOPE) - np.float32(GLINT_FROM), 0, 1)
        white += glints * glints * np.float32(parameters.glint)
        band *= three_channels(seen)
        band += around * three_channels(white)
        return encoded(band)

    return by_bands(behind, rgb.dtype, frosted, light, ridge, body, right, down)


def ice_on(size: tuple[int, int], grown: float, pane: FrostPane) -> tuple[Float32, Float32]:
    """Return (H, W) each: thickness of ridges and of the ice about them, from 0 to 1.

    grown: how far they have grown, from 0 to 1.
    """
    height, width = size
    zoom = SHORT_SIDE_PX / min(size)
    level = level_of(zoom)
    planes = np.zeros((2, height, width), np.float32)
    deep = min(math.ceil(HEIGHT_PX / zoom), (min(size) + 1) // 2)
    for number, flipped in enumerate(pane.flipped):
        start = (pane.start_px + number * (WIDTH_PX // 4)) // level.shrunk
        length = width if number < 2 else height
        parts = _aged(_part(level, zoom / level.shrunk, start, (deep, length)), grown * (1 + RISE))
        for plane, part in zip(planes, parts, strict=True):
            turned = part[:, ::-1] if flipped else part
            if number >= 2:
                turned = turned.T
            shown = (plane[:deep], plane[-deep:], plane[:, :deep], plane[:, -deep:])[number]
            last = (np.s_[:], np.s_[::-1], np.s_[:], np.s_[:, ::-1])[number]
            np.maximum(shown, turned[last], out=shown)
    return planes[0], planes[1]


def _part(level: Level, step: float, start: int, size: tuple[int, int]) -> Float32:
    """Return (3, *size) of a level from a column on; step: its pixels in one of the frame, interpolated linearly."""
    deep, length = size
    strip = atlas()[:, level.top : level.top + level.rows]
    if step == 1:
        part = strip[:, :deep].take(np.arange(start, start + length) % WIDTH_PX, axis=2)
        return part * np.float32(1 / 255)
    # OpenCV's warps round places to 1/32 pixel in versions before 5, so here they are not used.
    columns, right = _places(length, step)
    rows, below = _places(deep, step)
    first, second = (strip.take((start + columns + k) % WIDTH_PX, axis=2) for k in (0, 1))
    part = first * (np.float32(1) - right) + second * right
    upper, lower = (part.take(np.clip(rows + k, 0, level.rows - 1), axis=1) for k in (0, 1))
    below = (below * np.float32(1 / 255))[:, None]
    return np.asarray(upper * (np.float32(1 / 255) - below) + lower * below, np.float32)


def _places(count: int, step: float) -> tuple[NDArray[np.int64], Float32]:
    """Return for pixels of a frame the pixel of the strip before each one's middle, and how far it is behind that."""
    places = (np.arange(count) + 0.5) * step - 0.5
    before = np.floor(places).astype(np.int64)
    return before, (places - before).astype(np.float32)


def _aged(part: Float32, time: float) -> tuple[Float32, Float32]:
    """Return ridge and body at a time, of (3, ...) ridge, time and body."""
    ridge, since, body = part
    age = np.maximum(np.float32(time) - since, 0)
    ridge *= np.minimum(age * np.float32(1 / RISE), 1)
    body *= np.minimum(age * np.float32(1 / AGING), 1)
    return ridge, body


def slopes(ridge: Float32, body: Float32, zoom: float) -> tuple[Float32, Float32]:
    """Return how steeply ice, (H, W) each, rises to the right and downwards, in a pixel of the strip; 0 at the ends."""
    relief = np.float32(RIDGE_RELIEF / zoom) * ridge
    relief += np.float32(BODY_RELIEF / zoom) * body
    right, down = np.zeros_like(relief), np.zeros_like(relief)
    np.subtract(relief[:, 1:], relief[:, :-1], out=right[:, :-1])
    np.subtract(relief[1:], relief[:-1], out=down[:-1])
    return right, down


def _refracted(linear: Float32, right: Float32, down: Float32, refraction_px: float) -> Float32:
    """Return (H, W, 3), each pixel taken from where the slope of the ice before it leads."""
    import cv2

    height, width = right.shape
    columns = right * np.float32(refraction_px) + np.arange(width, dtype=np.float32)
    rows = down * np.float32(refraction_px) + np.arange(height, dtype=np.float32)[:, None]
    taken = cv2.remap(linear, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(taken, np.float32).reshape(linear.shape)


def _light_around(linear: Float32, tint: float) -> Float32:
    """Return (H, W, 3): the light about each pixel, which its ice scatters, in part without its colour."""
    import cv2

    height, width = linear.shape[:2]
    small = linear
    for _ in range(HALVINGS):
        odd = small.shape[0] % 2, small.shape[1] % 2
        small = cv2.copyMakeBorder(small, 0, odd[0], 0, odd[1], cv2.BORDER_REPLICATE)
        small = np.asarray(cv2.resize(small, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.float32)
    sigma_px = LIGHT_SHARE * min(height, width) / 2**HALVINGS
    reach_px = math.ceil(3 * sigma_px)  # where Blender cuts it off
    kernel_px = 2 * reach_px + 1, 2 * reach_px + 1
    blurred = cv2.GaussianBlur(small, kernel_px, sigma_px, borderType=cv2.BORDER_REPLICATE)
    blurred = np.asarray(blurred, np.float32).reshape(small.shape)
    blurred += np.float32(MEAN_SHARE) * (np.array(cv2.mean(small)[:3], np.float32) - blurred)
    grey = three_channels(blurred @ np.array(LUMINANCE, np.float32))
    light = grey + np.float32(tint) * (blurred - grey)
    large = cv2.resize(light, None, fx=2**HALVINGS, fy=2**HALVINGS, interpolation=cv2.INTER_LINEAR)
    return np.asarray(large, np.float32)[:height, :width]


PERTURBATION = ColourPerturbation(
    name="lens_frost",
    label="Lens frost",
    stage="lens",
    order=58,
    parameters=LensFrost,
    severities={"coverage": (0.22, 0.38, 0.55, 0.78, 1.0), "opacity": (1.0, 1.3, 1.6, 2.0, 2.5)},
    source="our own: from a frosted border to a pane that is iced over but for its middle",
    about=About(
        "Grows crystals of ice on the glass, from its border inwards",
        "ferns of ice that grow on the glass from the border inwards",
        caption="ferns of ice that grow from the border inwards.",
        example=Example(
            said="Frost on the lens in the embedded room, clean and at severities 1, 3 and 5, and while it grows.",
            settings=(
                "{sweep: {perturb: [lens_frost], severities: [1, 3, 5]}}",
                "{name: lens_frost_grows, perturb: [{lens_frost: {severity: 1, temporal: drift, frame_rate_hz: 1}}]}",
            ),
        ),
    ),
    apply=apply,
    version=2,  # ice comes in patches, and takes more of the light behind it
    build=build,
    lit_by_nodes=True,
    linear=True,
    temporals=("fresh", "fixed", "drift"),
)
