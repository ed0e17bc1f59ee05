# SPDX-License-Identifier: GPL-3.0-or-later
"""What falling rain and snow share: their parameters, and their execution on arrays.

Each pixel's light is image * t + light * (1 - t), linear, with t the transmission of the streaks before its depth and
of the veil of all particles too small to be seen by themselves, as Koschmieder's law has it.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import ClassVar, Literal, TypeAlias

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from ...core.camera_motion import camera_state_of
from ...core.geometry import Intrinsics
from ...core.mirrored import EvenAir
from ...core.node_graph import BroughtImage, Graph, Socket
from ...core.schema import Choice, key
from ...core.srgb import LUMINANCE, decoded, encoded
from ...core.streams import stream
from ..kinds import FrameContext
from ._air import AIR_TOOLTIPS, air_colour_key, air_key, air_light, around_key, colour_of, lamps_key
from ._arrays import (
    HALF_PX,
    SKY_M,
    by_bands,
    camera_of,
    frame_rate_key,
    halved_nearest,
    quick_key,
    three_channels,
    view_key,
)
from ._particles import NEAR_M, Air, AirCamera, Particles, Precipitation, affordable, in_sight, slopes_of, veil_depth

# Streaks: what particles leave on an image while the shutter is open.


Float32: TypeAlias = NDArray[np.float32]

Piece: TypeAlias = tuple[NDArray[np.int32], Float32]
"""Of pixels that streaks hide: index, and the share of light hidden."""

PIECE = 1 << 15  # pixels that are looked at together; chosen, so that their arrays stay in the processor's cache
MOST_FOUND = 1 << 23  # hidden pixels that are kept before they are summed; chosen: 100 MB
LEAST_WIDTH_PX = 1.0  # of a streak as it is drawn; thinner ones are fainter instead
QUICK_LEAST = 1.4  # times that at half the size: less, and thin streaks are beads; more, and they fade; chosen
SOFTNESS = 0.7  # of a streak's edge, as a share of its width; chosen: flakes are no disks, and a lens's blur is soft
MOST_OPAQUE = 0.999  # so that its logarithm is finite


@dataclass(frozen=True)
class Lens:
    """A thin lens. aperture_m: its diameter; 0 is a pinhole. focus_m: the depth of what is sharp.

    least_px: the width that streaks behind it are drawn with at least, and how far their edges go at least.
    """

    aperture_m: float
    focus_m: float
    least_px: float = LEAST_WIDTH_PX


@dataclass(frozen=True)
class Streaks:
    """Capsules on the image. start_px, end_px: (N, 2). width_px, opacity, depth_m: (N,). least_px: as of the lens."""

    start_px: Float32
    end_px: Float32
    width_px: Float32
    opacity: Float32
    depth_m: Float32
    least_px: float = LEAST_WIDTH_PX


def streaks_of(particles: Particles, view: AirCamera, lens: Lens) -> Streaks:
    """Project particles over an exposure.

    A particle of width w that moves by l covers its track, l long and as wide as the blurred particle, W; a point there
    sees it for the share of the exposure that conserves its area: (pi w^2 / 4) / (l W + pi W^2 / 4). It is the mean
    over the track of what Garg and Nayar (Vision and rain, 2007) give, a drop's diameter over its speed and the
    exposure.
    """
    half = particles.velocity_m_s * np.float32(view.exposure_s / 2)
    depth_m = particles.position_m[:, 2]
    # What comes nearer than the hood while the shutter is open stays there: a point at the lens has no image.
    ends = [
        _projected((particles.position_m + sign * half).astype(np.float32, copy=False), view)
        for sign in (np.float32(-1), np.float32(1))
    ]
    focal_px = np.float32(np.sqrt(view.focal_px[0] * view.focal_px[1]))
    seen_px = particles.diameter_m * focal_px / depth_m
    blur_px = np.float32(lens.aperture_m) * focal_px * np.abs(1 / depth_m - np.float32(1 / lens.focus_m))
    width_px = np.maximum(np.hypot(seen_px, blur_px), np.float32(lens.least_px))
    length_px = np.hypot(*(ends[1] - ends[0]).T)
    quarter = np.float32(np.pi / 4)
    opacity = quarter * seen_px**2 / (length_px * width_px + quarter * width_px**2)
    opacity = np.minimum(opacity, np.float32(MOST_OPAQUE))
    return Streaks(ends[0], ends[1], width_px, opacity, depth_m, lens.least_px)


def _projected(position_m: Float32, view: AirCamera) -> Float32:
    z_m = np.maximum(position_m[:, 2:], np.float32(NEAR_M / 2))
    found = position_m[:, :2] / z_m * np.array(view.focal_px, np.float32) + np.array(view.middle_px, np.float32)
    return found.astype(np.float32, copy=False)


def optical_depth(streaks: Streaks, depth_m: Float32) -> Float32:
    """Return (H, W): the sum of -log(1 - opacity) of the streaks before each pixel's depth, infinite where it is void.

    depth_m: (H, W). A streak counts where it is nearer. Its edge is a ramp about it, at least a pixel
    wide.
    """
    total: NDArray[np.float64] | None = None
    found, pending = list[Piece](), 0
    for piece in _pieces(streaks, depth_m):
        found.append(piece)
        pending += len(piece[0])
        if pending > MOST_FOUND:
            total, found, pending = _summed(total, found, depth_m.size), [], 0
    total = _summed(total, found, depth_m.size)
    return total.astype(np.float32).reshape(depth_m.shape)


def _summed(before: NDArray[np.float64] | None, found: list[Piece], count: int) -> NDArray[np.float64]:
    """Return (count,): what is hidden of each pixel, one streak after another. before: by those that came first."""
    if not found:
        return np.zeros(count) if before is None else before
    pixels, opacities = (np.concatenate(parts) for parts in zip(*found, strict=True))
    hidden = -np.log1p(-opacities)
    if before is not None:  # it comes first, so that a sum is the same however many pieces there are
        pixels, hidden = np.concatenate([np.arange(count), pixels]), np.concatenate([before, hidden])
    return np.bincount(pixels, hidden, count)


@dataclass(frozen=True)
class _Walks:
    """How streaks are walked: (N,) each, along the axis, rows or columns, that they extend further along.

    first, steps: the walk's pixels. across: pixels looked at beside each, as far as the streak's edge and its round
    ends may reach. along, beside: the streak's start on the two axes. run, rise: from there to its end. slope: rise /
    run. aside: how far it reaches across. squared: of its length. pace, side: what a step along and one across add to a
    pixel's index. limit: pixels of the image across.
    """

    first: NDArray[np.int32]
    steps: NDArray[np.int32]
    across: NDArray[np.int32]
    along: Float32
    beside: Float32
    run: Float32
    rise: Float32
    slope: Float32
    aside: Float32
    squared: Float32
    reach: Float32
    ramp: Float32
    pace: NDArray[np.int32]
    side: NDArray[np.int32]
    limit: NDArray[np.int32]


def _walks(streaks: Streaks, size_px: tuple[int, int]) -> _Walks:
    width, height = size_px
    (x, y), (dx, dy) = streaks.start_px.T, (streaks.end_px - streaks.start_px).T
    steep = np.abs(dy) >= np.abs(dx)
    along, beside = np.where(steep, y, x), np.where(steep, x, y)
    run, rise = np.where(steep, dy, dx), np.where(steep, dx, dy)
    back = run < 0
    along, beside = np.where(back, along + run, along), np.where(back, beside + rise, beside)
    run, rise = np.abs(run), np.where(back, -rise, rise)
    ramp = np.maximum(streaks.width_px * np.float32(SOFTNESS), np.float32(streaks.least_px))
    reach = (streaks.width_px + ramp) * np.float32(0.5)
    slope = np.divide(rise, run, out=np.zeros_like(run), where=run > 0)
    aside = reach * np.sqrt(1 + slope * slope)
    walked = np.where(steep, height, width).astype(np.float32)
    first = np.clip(np.ceil(along - reach), 0, walked).astype(np.int32)
    last = np.clip(np.floor(along + run + reach) + 1, 0, walked).astype(np.int32)
    return _Walks(
        first,
        np.maximum(last - first, 0),
        (2 * aside + 1).astype(np.int32),
        along,
        beside,
        run,
        rise,
        slope,
        aside,
        np.maximum(run * run + rise * rise, np.float32(1e-12)),
        reach,
        ramp,
        np.where(steep, width, 1).astype(np.int32),
        np.where(steep, 1, width).astype(np.int32),
        np.where(steep, width, height).astype(np.int32),
    )


def _pieces(streaks: Streaks, depth_m: Float32) -> Iterator[Piece]:
    """Yield what some streaks at a time hide: those that are looked at equally far across."""
    height, width = depth_m.shape
    walks = _walks(streaks, (width, height))
    across = _rounded_up(walks.across)
    for count in np.unique(across):
        same = np.flatnonzero((across == count) & (walks.steps > 0))
        ends = np.cumsum(walks.steps[same]) * int(count)
        at = 0
        while at < len(same):
            to = max(int(np.searchsorted(ends, (ends[at - 1] if at else 0) + PIECE)), at + 1)
            yield from _piece(streaks, walks, same[at:to], int(count), depth_m)
            at = to


def _rounded_up(count: NDArray[np.int32]) -> NDArray[np.int32]:
    """Round numbers above 8 up to next ones of which at most the highest three bits are set, so that few differ."""
    fine = np.maximum(np.frexp(count.astype(np.float32))[1] - 3, 0)
    return ((count + (1 << fine) - 1) >> fine) << fine


def _piece(streaks: Streaks, walks: _Walks, some: NDArray[np.intp], across: int, depth_m: Float32) -> Iterator[Piece]:
    """Yield the pixels that some streaks hide, and how much. across: the pixels looked at beside each step."""
    steps = walks.steps[some]
    who = np.repeat(some, steps)
    within = np.arange(len(who), dtype=np.int32) - np.repeat(np.cumsum(steps, dtype=np.int32) - steps, steps)
    run, rise, squared = walks.run[who], walks.rise[who], walks.squared[who]
    row = within + walks.first[who]
    ahead = row.astype(np.float32) - walks.along[who]
    start = walks.beside[who]
    begin = np.ceil(start + ahead * walks.slope[who] - walks.aside[who])
    number = np.arange(across, dtype=np.float32)[:, None]
    apart = (begin - start) + number
    # Distance from the capsule's axis.
    share = apart * (rise / squared)
    share += ahead * (run / squared)
    np.clip(share, 0, 1, out=share)
    apart -= share * rise
    apart *= apart
    share *= -run
    share += ahead
    share *= share
    apart += share
    covered = np.subtract(walks.reach[who], np.sqrt(apart, out=apart), out=apart)
    covered /= walks.ramp[who]
    hidden = np.minimum(covered, np.float32(1), out=covered)
    hidden *= streaks.opacity[who]
    # Pixels before the first are beyond the limit, as numbers without a sign.
    place = begin.astype(np.int32) + number.astype(np.int32)
    seen = hidden > 0
    seen &= place.view(np.uint32) < walks.limit[who].view(np.uint32)
    place *= walks.side[who]
    place += row * walks.pace[who]
    z_m, flat = streaks.depth_m[who], depth_m.ravel()
    for there, indices, hides in zip(seen, place, hidden, strict=True):
        found = np.flatnonzero(there)
        pixel = indices[found]
        before = np.flatnonzero(z_m[found] < flat[pixel])
        yield pixel[before], hides[found[before]]


@dataclass(frozen=True)
class Falling:
    """The parameters of all that falls."""

    rate_mm_h: float = key("water that falls", default=1.0, unit="mm/h", minimum=0.01, maximum=500)
    size: float = key("a particle's diameter, times the measured one", default=1.0, minimum=0.05, maximum=20)
    brightness: float = key("its light, times the scene's mean", default=1.0, minimum=0, maximum=100)
    tint: float = key("how far its light has the colour of the scene's mean", default=0.25, minimum=0, maximum=1)
    wind_m_s: float = key("wind to the right", default=0.0, unit="m/s", minimum=-50, maximum=50)
    gusts_m_s: float = key(
        "standard deviation of each particle's own velocity", default=0.0, unit="m/s", minimum=0, maximum=10
    )
    fall: float = key("speed of fall, times that in still air", default=1.0, minimum=0, maximum=10)
    shutter_ms: float = key("how long the shutter is open", default=5.0, unit="ms", minimum=0, maximum=1000)
    aperture_mm: float = key("diameter of the lens; 0 is a pinhole", default=2.0, unit="mm", minimum=0, maximum=100)
    focus_m: float = key(
        "planar depth of what is sharp", default=5.0, unit="m", minimum=0.1, maximum=10000, slider=(0.1, 10)
    )
    least_mrad: float = key(
        "what spans less is not drawn but veils", default=1.0, unit="mrad", minimum=0.2, maximum=100
    )
    reach_m: float = key("what is farther is not drawn but veils", default=20.0, unit="m", minimum=0.5, maximum=200)
    air: Literal["auto", "scene", "mean", "colour"] = air_key(
        "mean", "of the frame", Choice("Mean", "The mean of the picture")
    )
    air_red: float = air_colour_key("red", 0.5)
    air_green: float = air_colour_key("green", 0.5)
    air_blue: float = air_colour_key("blue", 0.5)
    air_around: bool = around_key()
    lamps: float = lamps_key()
    leave_sky: bool = key("no veil over the sky", default=False)
    void_m: float = key("void counts as this far", default=500.0, unit="m", minimum=0.1, maximum=100000)
    view_deg: float = view_key()
    frame_rate_hz: float = frame_rate_key()
    coarse: bool = quick_key("draw streaks at half the frame's size: softer ones, in half the time")
    TOOLTIPS: ClassVar[Mapping[str, str]] = AIR_TOOLTIPS | {
        "size": "Higher: every particle is larger",
        "tint": "Higher: particles take more of the color of the scene",
        "fall": "Higher: they fall faster, in longer streaks",
        "aperture_mm": "Higher: particles out of focus become larger, fainter disks",
        "focus_m": "How far away particles are sharp; nearer and further ones are blurred",
        "least_mrad": "Higher: fewer small particles are drawn, and the veil in the distance gets denser instead",
        "reach_m": "Lower: less of what is far is drawn, and the veil takes its place",
        "void_m": "Higher: where nothing is, the veil gets denser",
        "view_deg": "Higher: a wider view, so particles are smaller in it",
        "coarse": "On: thin streaks are softer, and it takes half the time",
        "frame_rate_hz": "Lower: with the pattern Drift, particles move further from frame to frame",
    }


GIVEN_AIR = {f"air_{name}": ("air", "colour") for name in ("red", "green", "blue")}
"""What giving a colour implies."""


@dataclass(frozen=True)
class Kind:
    """Rain or snow. particles: of a rate in mm/h. speed_m_s: of fall in still air, by the diameter in metres.

    brightness: that with which it has the very colour of the sky, or that which is given.
    """

    particles: Callable[[float], Precipitation]
    speed_m_s: Callable[[Float32], Float32]
    brightness: float

    def air(self, parameters: Falling) -> Air:
        """Return what falls."""
        return Air(
            self.particles(parameters.rate_mm_h).sized(parameters.size),
            parameters.least_mrad * 1e-3,
            parameters.reach_m,
            # A larger particle falls no faster than the measured one that it stands for.
            lambda diameter_m: (
                self.speed_m_s(diameter_m * np.float32(1 / parameters.size)) * np.float32(parameters.fall)
            ),
            parameters.wind_m_s,
            parameters.gusts_m_s,
        )


def fallen_on(kind: Kind, rgb: Float32, parameters: Falling, context: FrameContext) -> Float32:
    """Let it fall on (H, W, 3), by the context's planar depth (H, W), metres; 0 is void, as is a sky."""
    import cv2

    height, width = context.depth_m.shape
    air = drawn_air(kind, parameters, camera_of(context.intrinsics, (width, height), parameters.view_deg))
    surface = (context.depth_m > 0) & (context.depth_m <= SKY_M)
    depth_m = np.where(surface, context.depth_m, np.float32(parameters.void_m))
    opaque = (_softly if parameters.coarse else streaks_on)(air, depth_m, parameters, context)
    linear = by_bands(rgb, rgb.dtype, decoded)
    # A row of it: three numbers beside an image take ten times as long.
    light = np.tile(_light(linear, kind, parameters, context), depth_m.shape[1])

    def veiled(band: Float32, band_depth_m: Float32, band_opaque: Float32, veiled_here: NDArray[np.bool_]) -> Float32:
        veil = veil_depth(band_depth_m, air.particles, air.least_rad, air.reach_m)
        veil *= veiled_here
        veil += band_opaque
        seen = three_channels(np.asarray(cv2.exp(-veil), np.float32).reshape(veil.shape))
        rows = band.reshape(len(band), -1)
        rows -= light
        rows *= seen.reshape(rows.shape)
        rows += light
        return encoded(band)

    return by_bands(linear, rgb.dtype, veiled, depth_m, opaque, surface | (not parameters.leave_sky))


def mirrored_air(kind: Kind, linear: Float32, parameters: Falling, context: FrameContext) -> EvenAir:
    """Return what falls behind surfaces that mirror, before light (H, W, 3): all of it veils there, none is drawn."""
    light = _light(linear, kind, parameters, context).astype(np.float64)
    rates_per_m = np.full(3, kind.air(parameters).particles.extinction_per_m)
    return EvenAir(light, rates_per_m, 0.0 if parameters.leave_sky else parameters.void_m)


@lru_cache(maxsize=64)
def drawn_air(kind: Kind, parameters: Falling, camera: Intrinsics) -> Air:
    """Return what falls, and is drawn by itself, before a camera: no more than can be afforded."""
    slopes = slopes_of(*_lens(camera))
    return affordable(kind.air(parameters), slopes, parameters.shutter_ms * 1e-3)


def limits_of(kind: Kind, parameters: Falling, camera: Intrinsics) -> str:
    """Return what is drawn less of before a camera than the parameters ask for, "" where nothing."""
    least_mrad = drawn_air(kind, parameters, camera).least_rad * 1e3
    if least_mrad <= parameters.least_mrad * (1 + 1e-9):
        return ""
    return (
        f"falls through more air than a frame can be drawn of, as the camera sees so wide: what spans less than "
        f"{least_mrad:.3g} mrad is not drawn but veils, instead of {parameters.least_mrad:g} mrad (least_mrad)"
    )


def _lens(camera: Intrinsics) -> tuple[tuple[float, float], tuple[float, float], tuple[int, int]]:
    """Return focal lengths, middle and size of the image in pixels, each along x and y."""
    return (camera.fx_px, camera.fy_px), (camera.cx_px, camera.cy_px), (camera.width_px, camera.height_px)


def _light(linear: Float32, kind: Kind, parameters: Falling, context: FrameContext) -> Float32:
    """Return (3,): the linear light of what falls before (H, W, 3) of linear light."""
    if parameters.air == "colour":
        given = colour_of(parameters.air_red, parameters.air_green, parameters.air_blue)
        return (given * (parameters.brightness / kind.brightness)).astype(np.float32)
    if parameters.air == "mean" or (parameters.air == "auto" and not context.lit):
        return light_of(linear, parameters)
    air = air_light(linear, context.depth_m, around=parameters.air_around)
    own = kind.brightness * _greyed(air.surfaces, parameters.tint)
    return (air.over(own) * (parameters.brightness / kind.brightness)).astype(np.float32)


def light_of(linear: Float32, parameters: Falling) -> Float32:
    """Return (3,): the linear light of what falls before (H, W, 3) of linear light.

    The mean's colour is in part the surfaces', not the light's, so it is made grey but for a share.
    """
    import cv2

    return (parameters.brightness * _greyed(np.array(cv2.mean(linear)[:3]), parameters.tint)).astype(np.float32)


def _greyed(mean: NDArray[np.float64], tint: float) -> NDArray[np.float64]:
    grey = mean @ LUMINANCE
    return grey + tint * (mean - grey)


def streaks_on(air: Air, depth_m: Float32, parameters: Falling, context: FrameContext) -> Float32:
    """Return (H, W): the optical depth of the streaks before each pixel."""
    time_s = context.drift_frames / parameters.frame_rate_hz
    view = view_of(depth_m, parameters, context)
    hashed = int(context.pattern_stream().integers(2**64, dtype=np.uint64))
    particles = in_sight(air, view, hashed, time_s)
    least_px = LEAST_WIDTH_PX * (QUICK_LEAST / 2 if parameters.coarse else 1.0)
    streaks = streaks_of(particles, view, Lens(parameters.aperture_mm * 1e-3, parameters.focus_m, least_px))
    return optical_depth(streaks, depth_m)


def _softly(air: Air, depth_m: Float32, parameters: Falling, context: FrameContext) -> Float32:
    """Return what `streaks_on` does, of streaks that are drawn at half the size."""
    import cv2

    small_m = halved_nearest(depth_m)
    camera = camera_of(context.intrinsics, depth_m.shape[1::-1], parameters.view_deg)
    seen = np.exp(-streaks_on(air, small_m, parameters, replace(context, intrinsics=_resized(camera, small_m.shape))))
    large = np.asarray(cv2.resize(seen, depth_m.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)
    return -np.log(np.maximum(large.reshape(depth_m.shape), np.float32(1e-30)))


def _resized(camera: Intrinsics, shape: tuple[int, ...]) -> Intrinsics:
    """Return a camera whose image has (H, W): it sees the same."""
    x, y = shape[1] / camera.width_px, shape[0] / camera.height_px
    middle = (camera.cx_px + HALF_PX) * x - HALF_PX, (camera.cy_px + HALF_PX) * y - HALF_PX
    return Intrinsics(shape[1], shape[0], camera.fx_px * x, camera.fy_px * y, *middle)


def view_of(depth_m: Float32, parameters: Falling, context: FrameContext) -> AirCamera:
    """Return the camera of a frame in the air.

    Without a path the camera is level and at rest. A pattern that is fixed goes with the camera; others stay in the air
    while it moves.
    """
    height, width = depth_m.shape
    camera = camera_of(context.intrinsics, (width, height), parameters.view_deg)
    lens = (*_lens(camera), float(depth_m.max()), parameters.shutter_ms * 1e-3)
    camera_state = camera_state_of(None if context.temporal == "fixed" else context.motion)
    return AirCamera(
        camera_state.rotation, camera_state.position_m, camera_state.velocity_m_s, camera_state.turning_rad_s, *lens
    )


# The repeating tile of particles that the node groups of rain and snow look up.
#
# Every texel holds the particle nearest to it: where it is, in units, and two numbers of its own. Streaks are put in
# place by stretching the tile, as points that are independent of each other stay so when they are stretched.


UNITS = 128  # along a side, so 16,384 particles; chosen, so that a frame seldom shows one twice
TEXELS = 4  # of a unit; chosen: a texel's nearest particle is that of nearly all its points
EXCESS = 16.0  # greatest, of an exponential distribution of mean 1
_EDGE = 8 * TEXELS  # no texel's nearest particle is farther
# Particles a unit of area: where several lie in a texel, one is kept.
DENSITY = TEXELS**2 * (1 - math.exp(-1 / TEXELS**2))
LEVELS = 1024  # of the cube root of a particle's place in its shell: near a camera, area and so places grow as cubes

# Boundaries of the shells in depth, as multiples of the depth at which the mean particle spans the least angle; chosen,
# so that particles near the camera, which are large on the image, are few in theirs: where two cover a pixel, the one
# whose middle is nearer is seen. Beyond the last are 1.4 % of all.
SHELLS = (0.02, 0.35, 1.1, 2.7, 8.0)


def _tile() -> NDArray[np.float32]:
    """Return (512, 512, 3): u and v of the nearest particle, from the lower left; its level + excess / EXCESS."""
    drawn = stream("tile of falling particles")
    count = UNITS * UNITS
    points = drawn.random((count, 2)) * UNITS
    place = np.floor(np.cbrt((drawn.permutation(count) + 0.5) / count) * LEVELS)
    excess = np.minimum(drawn.standard_exponential(count), EXCESS * (1 - 1e-3))
    nearest = _nearest(points)
    found = np.empty((*nearest.shape, 3), np.float32)
    found[..., :2] = points[nearest]
    found[..., 2] = (place + excess / EXCESS)[nearest]
    return found[::-1]


def _nearest(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return (rows, columns): the number of the point nearest to each texel, across the edges; the last in a texel."""
    import cv2

    side = UNITS * TEXELS
    column, row = np.floor(points * TEXELS).astype(int).T
    number = np.full((side, side), -1)
    number[row, column] = np.arange(len(points))
    around = np.pad(number, _EDGE, mode="wrap")
    free = (around < 0).astype(np.uint8)
    _, labels = cv2.distanceTransformWithLabels(free, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    labels = np.asarray(labels, np.int64)
    by_label = np.zeros(int(labels.max()) + 1, np.int64)
    by_label[labels[free == 0]] = around[free == 0]
    return by_label[labels[_EDGE:-_EDGE, _EDGE:-_EDGE]]


TILE = BroughtImage("Falling Particles", "1", _tile)


@dataclass(frozen=True)
class Shell:
    """A range of depths.

    share: of all particles seen. middle: their mean depth, as a multiple. places: polynomial from a level, 0 to 1, to a
    multiple.
    """

    share: float
    places: tuple[float, ...]
    middle: float


@lru_cache(maxsize=1)
def shells() -> tuple[Shell, ...]:
    """Return the shells from near to far.

    Particles seen at depth x have the density x^2 e^-x / 2: area grows, and fewer are large enough.
    """
    found = []
    for low, high in pairwise(SHELLS):
        x = np.linspace(low, high, 4001)
        below = np.concatenate([[0.0], np.cumsum(np.diff(x) * _middles(x**2 * np.exp(-x) / 2))])
        quantiles = np.interp(np.linspace(0, 1, 1001), below / below[-1], x)
        fit = Polynomial.fit(np.cbrt(np.linspace(0, 1, 1001)), quantiles, 3).convert()
        found.append(Shell(float(below[-1]), tuple(float(c) for c in fit.coef), float(quantiles.mean())))
    return tuple(found)


def _middles(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return (values[1:] + values[:-1]) / 2


# How large a particle is on the image, as nodes.


def area_and_width(graph: Graph, taken: Mapping[str, Socket], large: Socket, nearness: Socket) -> tuple[Socket, Socket]:
    """Return the square of a particle's size on the image, and its streak's width, blurred by the lens, in pixels."""
    size_px = large * (taken["Mean"] * taken["Focal length"] * 1e-3) * nearness
    aperture_px = taken["Aperture"] * taken["Focal length"]
    blur_px = (nearness - graph.math("DIVIDE", 1.0, taken["Focus"])) * aperture_px
    area = graph.math("MULTIPLY", size_px, size_px)
    wide = graph.math("SQRT", graph.math("MULTIPLY_ADD", blur_px, blur_px, area))
    return area, graph.math("MAXIMUM", wide, taken["Least width"])
