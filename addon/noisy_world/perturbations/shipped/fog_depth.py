# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog by depth: the further away a surface is, the more it fades into the airlight."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.camera_motion import CameraState, camera_state_of
from ...core.mirrored import EvenAir
from ...core.node_graph import Graph, GroupInput, Socket, Value
from ...core.schema import Choice, key
from ...core.srgb import LUMINANCE, decoded, encoded
from ...core.streams import stream
from ...core.visibility import EXTINCTION
from ..groups import Canvas, convert, seed_of
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._air import (
    AIR_TOOLTIPS,
    BLOCK_PX,
    DROP,
    FAR_M,
    GIVEN_AIR,
    MARGIN,
    air_colour_key,
    air_key,
    air_light,
    air_nodes,
    air_of_rooms,
    around_key,
    blocks_of,
    blurred,
    colour_of,
    kept_sky,
    lamp_light_nodes,
    lamps_key,
    looked_up,
    reach_of,
    sky_in,
)
from ._arrays import (
    QUICKLY,
    by_bands,
    by_camera,
    camera_of,
    frame_rate_key,
    quick_key,
    three_channels,
    view_key,
)

# Parameters of fog by depth.


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
    reach: float = key(
        "severities' visibilities are as many times those",
        default=1.0,
        minimum=0.001,
        maximum=1000,
        slider=(0.1, 10),
        later=True,
    )
    airlight: float = key("grey that the fog is made of, sRGB-encoded", default=0.8, minimum=0, maximum=1)
    air: Literal["auto", "scene", "grey", "colour"] = air_key(
        "grey", "airlight", Choice("Grey", "A grey as light as Airlight")
    )
    air_red: float = air_colour_key("red", 0.8)
    air_green: float = air_colour_key("green", 0.8)
    air_blue: float = air_colour_key("blue", 0.8)
    air_tint: float = key(
        "how far surfaces colour the light of the air that comes from the scene; 0 is as light, and grey",
        default=1.0,
        minimum=0,
        maximum=1,
        later=True,
    )
    air_around: bool = around_key()
    lamps: float = lamps_key()
    leave_sky: bool = key("void stays as it is", default=False)
    void_m: float = key(
        "void counts as this far; 0 is without end", default=0.0, unit="m", minimum=0, maximum=1e6, later=True
    )
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
    view_deg: float = view_key()
    frame_rate_hz: float = frame_rate_key()
    coarse: bool = quick_key("blur the light of lamps by larger blocks where that is wide: as good, in less time")
    TOOLTIPS: ClassVar[Mapping[str, str]] = AIR_TOOLTIPS | {
        "air_tint": "Lower: fog in a room of brick or wood is grey, not brown as smoke",
        "visibility_m": "Lower: the fog gets denser, and hides what is nearer",
        "outdoors": "On: severities are those of streets, where one sees further than in rooms",
        "reach": "Higher: severities are of a scene in which one sees further",
        "airlight": "Higher: the fog gets lighter; 0 is smoke, 1 is white",
        "void_m": "Lower, above 0: more of the sky is seen through the fog, as through a window",
        "falloff_m": "Above 0 the fog lies on the ground: lower, and roofs and sky come out of it",
        "camera_height_m": "Higher: the camera stands more above low fog, and sees more",
        "unevenness": "Higher: the fog comes in clumps, with clearer air between",
        "clump_m": "Higher: larger clumps",
        "wind_m_s": "Further from 0: with the pattern Drift, clumps move faster to the right, or to the left below 0",
        "glow": "Higher: lamps glow more in the fog",
        "glow_width_deg": "Higher: wider and softer glows",
        "view_deg": "Higher: as through a wider lens; a known camera decides it",
        "coarse": "On: light of lamps is blurred by larger blocks, in less time",
        "frame_rate_hz": "Lower: with the pattern Drift, more time passes from frame to frame",
    }


def is_even(parameters: FogDepth) -> bool:
    """Tell whether the fog is the same everywhere and does not glow."""
    return parameters.falloff_m == 0 and parameters.unevenness == 0 and parameters.glow == 0


# The glow around bright lights in fog: light that droplets send a little aside, again and again.
#
# Light scattered n times by small angles has gone aside by the square root of n times as much, so the glow's width
# grows with the root of the optical depth (Narasimhan and Nayar, Shedding light on the weather, 2003, solve it
# exactly for a point; the shape here is Gaussian). No light is added: what glows is what the fog has taken from the
# direct beam.


Float32: TypeAlias = NDArray[np.float32]

WIDTHS = (0.5, 1.0, 2.0, 4.0)  # of the Gaussians, in those of an optical depth of 1


def glow_of(taken: Float32, depth: Float32, parameters: FogDepth, focal_px: float) -> Float32:
    """Return (H, W, 3): the glow of the light that fog has taken from the direct beam, which is not changed.

    taken: (H, W, 3), linear, what it was brighter than the airlight; what was darker does not glow. depth: (H, W),
    optical. focal_px: of the camera.
    """
    import cv2

    height, width = depth.shape
    ones = np.ones((height, width), np.float32)
    lamps, thick = (block_means(image) for image in (np.maximum(taken, np.float32(0)), depth))
    thick /= np.maximum(block_means(ones), np.float32(1e-6))
    unit_px = focal_px * np.tan(np.radians(parameters.glow_width_deg)) / BLOCK_PX
    total = np.zeros_like(lamps)
    for share, wide in zip(shares(thick), WIDTHS, strict=True):
        part = lamps * np.asarray(cv2.merge([share] * 3), np.float32).reshape(lamps.shape)
        total += block_blurred(part, float(wide * unit_px))
    total *= np.float32(parameters.glow)
    grown = cv2.resize(total, (total.shape[1] * BLOCK_PX, total.shape[0] * BLOCK_PX), interpolation=cv2.INTER_LINEAR)
    bottom = len(grown) - BLOCK_PX
    return np.asarray(grown, np.float32)[bottom - height : bottom, BLOCK_PX : BLOCK_PX + width].reshape(
        height, width, 3
    )


def shares(depth: Float32) -> list[Float32]:
    """Return for each width how much of the light goes there: between the two that are nearest to the depth's root."""
    place = np.clip(np.log2(np.maximum(depth, np.float32(1e-6))) * np.float32(0.5) + 1, 0, len(WIDTHS) - 1)
    return [np.maximum(1 - np.abs(place - np.float32(k)), np.float32(0)) for k in range(len(WIDTHS))]


def block_means(image: Float32) -> Float32:
    """Return the means of blocks of 8 x 8 from the lower left, with nothing beyond the image and a block around it."""
    import cv2

    height, width = image.shape[:2]
    above, right = -height % BLOCK_PX + BLOCK_PX, -width % BLOCK_PX + BLOCK_PX
    whole = cv2.copyMakeBorder(image, above, BLOCK_PX, BLOCK_PX, right, cv2.BORDER_CONSTANT)
    size = whole.shape[1] // BLOCK_PX, whole.shape[0] // BLOCK_PX
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.float32)


def block_blurred(image: Float32, sigma: float) -> Float32:
    """Blur by a Gaussian; what leaves the image is gone, and none comes in."""
    import cv2

    side = 2 * int(np.ceil(MARGIN * sigma)) + 1
    found = cv2.GaussianBlur(image, (side, side), sigma, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(found, np.float32).reshape(image.shape)


# Uneven fog: a field of waves in the world, of which both executions know the mean between any two depths.
#
# The field is the sum of amplitude x cos(k . place + phase). Amplitudes go with the cube root of the
# wavelength, as turbulence makes them (Kolmogorov, The local structure of turbulence, 1941), and fog lies in layers, so
# waves are flatter than wide. A wave's mean along a ray between two depths is a cosine in their middle times
# sin(x) / x. It is taken in slabs of depth on a coarse grid of rays, as all of it is smooth, and put together for each
# pixel by its own depth.


Float64: TypeAlias = NDArray[np.float64]

OCTAVES = 3
WAVES = 18  # six an octave; chosen: fewer are seen as waves
FLATTER = 2.5  # than wide; chosen, as fog banks look
# Edges of the slabs, as shares of the visibility: farther, less than 3 % of the light comes through. Chosen.
EDGES = (0.0, 0.04, 0.1, 0.2, 0.4, 0.7, 1.2)
GRID_PX = 8  # a ray for so many pixels along a side
KEY_BITS = 12  # of the seed and of the frame that a phase takes at a time, so that float32 keeps its fraction


@dataclass(frozen=True)
class Wave:
    """A wave of the field, of clumps of 1 m.

    vector: (right, forward, up) radians a metre. amplitude: so that the field's standard deviation is 1. turns: the
    phase's turns for the lower and the higher bits of the seed, and for those of the frame.
    """

    vector: tuple[float, float, float]
    amplitude: float
    turns: tuple[float, float, float]


@lru_cache(maxsize=1)
def waves() -> tuple[Wave, ...]:
    """Return the waves, the longest first. Their numbers have few digits, so they are equal on all processors."""
    drawn = stream("waves of fog")
    per_octave = WAVES // OCTAVES
    lengths = [2.0 ** -(k / per_octave) for k in range(WAVES)]
    amplitudes = np.cbrt(lengths)
    amplitudes *= math.sqrt(2 / (amplitudes @ amplitudes))
    found = []
    for length, amplitude in zip(lengths, amplitudes, strict=True):
        angle, up = 2 * math.pi * drawn.random(), 2 * drawn.random() - 1
        flat = math.sqrt(1 - up * up)
        size = 2 * math.pi / length
        vector = flat * math.cos(angle) * size, flat * math.sin(angle) * size, up * size * FLATTER
        turns = tuple(round(float(value), 6) for value in drawn.random(3))
        x, y, z = (round(value, 4) for value in vector)
        found.append(Wave((x, y, z), round(float(amplitude), 6), (turns[0], turns[1], turns[2])))
    return tuple(found)


@dataclass(frozen=True)
class Bank:
    """Uneven fog as a camera stands in it.

    clump_m: the longest wavelength. blown_m: how far the wind has carried it to the right. reach_m: the visibility.
    key: (3,) whole numbers, of which the phases are made: `key_of`.
    """

    clump_m: float
    blown_m: float
    reach_m: float
    key: tuple[int, int, int]


def key_of(seed: int, frame: int) -> tuple[int, int, int]:
    """Return lower and higher bits of a seed below 2^24, and the lower bits of a frame's number."""
    return seed % (1 << KEY_BITS), seed >> KEY_BITS, frame % (1 << KEY_BITS)


def phases_rad(bank: Bank, camera_state: CameraState) -> Float64:
    """Return (N,): each wave's phase at the camera."""
    right, down, forward = camera_state.position_m
    place = np.array([right - bank.blown_m, forward, -down]) / bank.clump_m
    parts = np.array(bank.key, np.float32) * np.array([wave.turns for wave in waves()], np.float32)
    turns = (parts - np.floor(parts)).sum(axis=1, dtype=np.float64)
    return 2 * np.pi * turns + np.array([wave.vector for wave in waves()]) @ place


def slab_means(bank: Bank, camera_state: CameraState, rays: Float32) -> Float32:
    """Return (slabs, H, W): the field's mean in each slab along rays (3, H, W), right, down, forward, of depth 1."""
    axes = camera_state.rotation
    directions = np.array([axes[0], axes[2], -axes[1]])  # right, forward, up of the air, by the camera's axes
    edges_m = np.array(EDGES) * bank.reach_m
    middles_m = ((edges_m[1:] + edges_m[:-1]) / 2).astype(np.float32)[:, None, None]
    halves_m = ((edges_m[1:] - edges_m[:-1]) / 2).astype(np.float32)[:, None, None]
    found = np.zeros((len(middles_m), *rays.shape[1:]), np.float32)
    for wave, phase in zip(waves(), phases_rad(bank, camera_state), strict=True):
        x, y, z = (np.array(wave.vector) / bank.clump_m @ directions).astype(np.float32)
        rate = x * rays[0] + y * rays[1] + z * rays[2]  # radians for a metre of depth
        # numpy's sinc is of pi x.
        evened = np.sinc(rate * halves_m * np.float32(1 / np.pi))
        evened *= np.cos(rate * middles_m + np.float32(phase % (2 * np.pi)))
        evened *= np.float32(wave.amplitude)
        found += evened
    return found


def mean_before(means: Float32, reach_m: float, distance_m: Float32) -> Float32:
    """Return (H, W): the field's mean from the camera to each distance, from slabs of a coarse grid (slabs, h, w).

    What is beyond the last slab is like what is before it.
    """
    import cv2

    height, width = distance_m.shape
    edges_m = np.array(EDGES, np.float32) * np.float32(reach_m)
    near_m = np.minimum(distance_m, edges_m[-1])
    total = np.zeros_like(near_m)
    for mean, begin_m, end_m in zip(means, edges_m[:-1], edges_m[1:], strict=True):
        part = np.clip(near_m, begin_m, end_m)
        part -= begin_m
        part *= np.asarray(cv2.resize(mean, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
        total += part
    total /= np.maximum(near_m, np.float32(1e-6))
    return total


# Fog that is no even layer: thinner with height, uneven, and lit up around lamps; on arrays.
#
# Along a ray whose height above the camera is k z at depth z, the density exp(-height / falloff) has the integral
# exp(-camera's height / falloff) z (1 - e^-u) / u, u = k z / falloff.


FARTHEST = 100.0  # visibilities: void counts as this far, where no light is left of an even fog
STEEPEST = 80.0  # of u: fog that a ray goes down into is no denser, as float32 ends there


def fogged(rgb: Float32, parameters: FogDepth, context: FrameContext) -> Float32:
    """Fog (H, W, 3)."""
    import cv2

    depth = optical_depth(parameters, context, rgb.shape[:2])
    light = by_bands(rgb, rgb.dtype, decoded)
    air = air_of(rgb, parameters, context)
    seen = np.asarray(cv2.exp(-depth), np.float32)
    light -= air
    through = light * np.asarray(cv2.merge([seen] * 3), np.float32)
    if parameters.glow > 0:
        camera = camera_of(context.intrinsics, (rgb.shape[1], rgb.shape[0]), parameters.view_deg)
        through += glow_of((light - through).astype(np.float32, copy=False), depth, parameters, camera.fx_px)
    through += air
    return by_bands(through, rgb.dtype, encoded)


def air_of(rgb: Float32, parameters: FogDepth, context: FrameContext) -> Float32:
    """Return the fog's own linear light before (H, W, 3): (3,), or (1,) where it is grey."""
    if parameters.air == "colour":
        return colour_of(parameters.air_red, parameters.air_green, parameters.air_blue).astype(np.float32)
    if parameters.air == "grey" or (parameters.air == "auto" and not context.lit):
        return decoded(np.array([parameters.airlight], np.float32))
    own = air_light(decoded(rgb), context.depth_m, around=parameters.air_around)
    grey = float(own.surfaces @ LUMINANCE)
    return own.over(own.surfaces - (own.surfaces - grey) * (1 - parameters.air_tint)).astype(np.float32)


def even_air(linear: Float32, parameters: FogDepth, context: FrameContext) -> EvenAir:
    """Return the fog behind what mirrors, before light (H, W, 3): as dense everywhere as visibility says."""
    light = np.broadcast_to(air_of(encoded(linear), parameters, context), (3,)).astype(np.float64)
    rates_per_m = np.full(3, EXTINCTION / parameters.visibility_m)
    return EvenAir(light, rates_per_m, 0.0 if parameters.leave_sky else parameters.void_m or math.inf)


def optical_depth(parameters: FogDepth, context: FrameContext, size: tuple[int, ...]) -> Float32:
    """Return (H, W): the fog's optical depth before each pixel of the context's depth."""
    farthest_m = np.float32(FARTHEST * parameters.visibility_m)
    depth_m = context.depth_m
    void_m = np.minimum(np.float32(parameters.void_m or np.inf), farthest_m)
    distance_m = np.where(depth_m > 0, np.minimum(depth_m, farthest_m), void_m)
    if parameters.leave_sky:
        distance_m[sky_in(depth_m)] = 0
    camera_state = camera_state_of(context.motion)
    found = distance_m * np.float32(EXTINCTION / parameters.visibility_m)
    if parameters.falloff_m > 0:
        found *= thinned(distance_m, parameters, camera_state, pixel_rays(parameters, context, size, 1))
    if parameters.unevenness > 0:
        bank = Bank(
            parameters.clump_m,
            parameters.wind_m_s * context.drift_frames / parameters.frame_rate_hz,
            parameters.visibility_m,
            key_of(seed_of(context.identifiers), context.index if context.temporal == "fresh" else 0),
        )
        means = slab_means(bank, camera_state, pixel_rays(parameters, context, size, GRID_PX))
        mean = mean_before(means, bank.reach_m, distance_m)
        mean *= np.float32(parameters.unevenness)
        # 1 + mean, but 1 / (1 - mean) below 0: fog thins, and never to less than nothing.
        found *= np.maximum(mean, np.float32(0)) + 1 / (1 - np.minimum(mean, np.float32(0)))
    return found


def thinned(distance_m: Float32, parameters: FogDepth, camera_state: CameraState, rays: Float32) -> Float32:
    """Return (H, W): the mean density from the camera to each distance, where it is 1 at height 0.

    rays: (3, H, W) of depth 1.
    """
    down = camera_state.rotation[1].astype(np.float32)
    height_m = parameters.camera_height_m - camera_state.position_m[1]
    rise = rays[0] * -down[0] - rays[1] * down[1] - down[2]
    rise *= distance_m
    rise *= np.float32(1 / parameters.falloff_m)
    u = np.clip(rise, np.float32(-STEEPEST), None, out=rise)
    here = np.float32(math.exp(-max(height_m / parameters.falloff_m, -STEEPEST)))
    flat = np.abs(u) < np.float32(1e-3)
    mean = -np.expm1(-u) / np.where(flat, np.float32(1), u)
    return np.where(flat, 1 - u / 2, mean) * here


def pixel_rays(parameters: FogDepth, context: FrameContext, size: tuple[int, ...], step: int) -> Float32:
    """Return (3, H, W): right, down, forward of depth 1 through every pixel, or through a grid `step` pixels apart."""
    height, width = size[:2]
    camera = camera_of(context.intrinsics, (width, height), parameters.view_deg)
    columns, rows = (grid_points(count, step) for count in (width, height))
    x = (columns - camera.cx_px) / camera.fx_px
    y = (rows - camera.cy_px) / camera.fy_px
    found = np.ones((3, len(rows), len(columns)), np.float32)
    found[0], found[1] = x, y[:, None]
    return found


def grid_points(count: int, step: int) -> NDArray[np.float64]:
    """Return where the points of a grid over `count` pixels lie, in pixels, so that resizing puts them back."""
    points = -(-count // step)
    return (np.arange(points, dtype=np.float64) + 0.5) * np.float64(count / points) - 0.5


# Fog that is no even layer, as nodes: what `_fog_air`, `_fog_waves` and `_fog_glow` calculate.
#
# What is switched off is exactly 1, or 0, and is calculated for a single pixel.


SERIES = 0.03  # below it (1 - e^-u) / u is a series, as the difference loses digits

Given: TypeAlias = Mapping[str, Socket]


def distance_nodes(canvas: Canvas, given: Given) -> Socket:
    """Return the distance to each pixel; void and what is farther than all fog is there."""
    graph, depth_m = canvas.graph, canvas.depth_m
    assert depth_m is not None
    # Maximum returns its first operand where the second is NaN.
    known_m = graph.math("MAXIMUM", 0.0, depth_m)
    farthest_m = given["visibility_m"] * FARTHEST
    void = graph.math("LESS_THAN", known_m, 1e-30, label="Void")
    void_m = graph.choose(given["void_m"] > 0.0, given["void_m"], farthest_m, "float")
    return graph.math("MINIMUM", graph.math("MULTIPLY_ADD", void, void_m, known_m), farthest_m)


def thinned_nodes(canvas: Canvas, given: Given, distance_m: Socket) -> Socket:
    """Return the mean density on the way to each pixel, as it thins with height."""
    graph, camera = canvas.graph, canvas.camera
    assert camera is not None
    with graph.section("Thinner with height"):
        on = given["falloff_m"] > 0.0
        falloff_m = graph.math("MAXIMUM", given["falloff_m"], 1e-3)
        size = graph.vector(canvas.width_px, canvas.height_px, 1.0)
        right, up = _slopes(canvas, given, _pixels(canvas, on), size)
        rise = graph.math("MULTIPLY_ADD", right, camera.right.z, camera.back.z * -1.0)
        rise = graph.math("MULTIPLY_ADD", up, camera.up.z, rise)
        way_m = graph.choose(on, distance_m, 1.0, "float")
        u = graph.math("MAXIMUM", rise * way_m / falloff_m, -STEEPEST)
        small = graph.math("LESS_THAN", graph.math("ABSOLUTE", u), SERIES)
        closed = (1.0 - graph.math("EXPONENT", u * -1.0)) / u
        series = graph.math("MULTIPLY_ADD", graph.math("MULTIPLY_ADD", u, 1 / 6, -0.5), u, 1.0)
        height_m = camera.location.z + given["camera_height_m"]
        here = graph.math("EXPONENT", graph.math("MAXIMUM", height_m / falloff_m, -STEEPEST) * -1.0)
        return graph.math("MULTIPLY_ADD", graph.mix(closed, series, small) * here - 1.0, on, 1.0)


def _pixels(canvas: Canvas, on: Socket) -> Socket:
    """Return each pixel's place in the frame, from the lower left; one number where it is not wanted."""
    graph = canvas.graph
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Pixel", "vector")
    return graph.choose(on, pixel, (0.0, 0.0, 0.0), "vector")


def _slopes(canvas: Canvas, given: Given, pixel: Socket, size: Socket) -> tuple[Socket, Socket]:
    """Return right and up, of depth 1, through the pixels of an image of a size that shows what the frame does."""
    graph = canvas.graph
    half = graph.math("TANGENT", given["view_deg"] * (math.pi / 360))
    tall = half * canvas.height_px / canvas.width_px
    # From the left and from below, -1 to 1.
    place = graph.math("SUBTRACT", graph.math("DIVIDE", pixel * 2.0 + (1.0, 1.0, 1.0), size), (1.0, 1.0, 1.0))
    return place.x * half, place.y * tall


# --- uneven ---


def clumps_nodes(canvas: Canvas, given: Given, distance_m: Socket) -> Socket:
    """Return the mean density on the way to each pixel, as clumps make it."""
    graph, camera = canvas.graph, canvas.camera
    assert camera is not None
    assert canvas.seed is not None
    assert canvas.key is not None
    with graph.section("Clumps: rays of a coarse grid"):
        on = given["unevenness"] > 0.0
        grid = [_grid_side(graph, side / canvas.scale, on) for side in (canvas.width_px, canvas.height_px)]
        blank = graph.node("CompositorNodeBlankImage", {"Size": graph.vector(*grid)}).out("Image", "color")
        pixel = graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Pixel", "vector")
        right, up = _slopes(canvas, given, pixel, graph.vector(grid[0], grid[1], 1.0))
        ray = graph.math("MULTIPLY_ADD", camera.right, graph.vector(right, right, right), camera.back * -1.0)
        ray = graph.math("MULTIPLY_ADD", camera.up, graph.vector(up, up, up), ray)
    with graph.section("Clumps: waves"):
        blown_m = given["wind_m_s"] * canvas.drift_frames / given["frame_rate_hz"]
        clump_m = given["clump_m"]
        place = (camera.location - graph.vector(blown_m, 0.0)) / graph.vector(clump_m, clump_m, clump_m)
        bits = float(1 << KEY_BITS)
        high = graph.math("FLOOR", canvas.seed / bits)
        key = graph.vector(canvas.seed - high * bits, high, graph.math("MODULO", canvas.key, bits))
        reach = given["visibility_m"] / clump_m
        near: Value = (0.0, 0.0, 0.0)
        far: Value = (0.0, 0.0, 0.0)
        part = _wave_graph()
        inputs = {"Ray": ray, "Place": place, "Key": key, "Reach": reach}
        for number, wave in enumerate(waves()):
            own = {"Vector": wave.vector, "Amplitude": wave.amplitude, "Turns": wave.turns, "Near": near, "Far": far}
            made = graph.group(part, inputs | own, name=f"Wave {number + 1}")
            near, far = made.out("Near", "vector"), made.out("Far", "vector")
    with graph.section("Clumps before each pixel"):
        size = graph.vector(canvas.width_px, canvas.height_px, 1.0)
        where = graph.math("DIVIDE", _pixels(canvas, on) + (0.5, 0.5, 1.0), size)
        reach_m = given["visibility_m"]
        way_m = graph.choose(on, distance_m, 1.0, "float")
        near_m = graph.math("MINIMUM", way_m, reach_m * EDGES[-1])
        total: Value = 0.0
        for means, edges in ((near, EDGES[:4]), (far, EDGES[3:])):
            assert isinstance(means, Socket)
            begin, end = (graph.vector(*(reach_m * edge for edge in some)) for some in (edges[:3], edges[1:]))
            length = graph.vector(near_m, near_m, near_m)
            within = graph.math("MINIMUM", graph.math("MAXIMUM", length, begin), end) - begin
            total = graph.math("DOT_PRODUCT", within, looked_up(graph, means, where, "Bilinear")) + total
        mean = total / graph.math("MAXIMUM", near_m, 1e-6) * given["unevenness"]
        # 1 + mean, but 1 / (1 - mean) below 0.
        return graph.math("MAXIMUM", mean, 0.0) + graph.math("DIVIDE", 1.0, 1.0 - graph.math("MINIMUM", mean, 0.0))


def _grid_side(graph: Graph, side_px: Socket, on: Socket, step: float = GRID_PX) -> Socket:
    """Return how many points a side has; one where the grid is not wanted."""
    return graph.math("MULTIPLY_ADD", graph.math("CEIL", side_px * (1 / step)) - 1.0, on, 1.0)


def _wave_graph() -> Graph:
    """Describe a wave: its means in the six slabs, along each ray, in clumps instead of metres."""
    graph = Graph("NW Fog wave", "Adds a wave of the density of fog, evened out in slabs of depth", alone=True)

    def vector(name: str, text: str) -> Socket:
        return graph.input(GroupInput(name, "vector", (0.0, 0.0, 0.0), text))

    ray, place = vector("Ray", "Direction of each pixel"), vector("Place", "The camera's, in clumps")
    key, turns = vector("Key", "Of the pattern"), vector("Turns", "The phase's for each part of the key")
    along = vector("Vector", "Radians a clump")
    near, far = vector("Near", "Sum of the waves before it"), vector("Far", "Likewise, of the farther slabs")
    amplitude = graph.input(GroupInput("Amplitude", "float", 1.0, "How strong it is"))
    reach = graph.input(GroupInput("Reach", "float", 1.0, "Visibility in clumps"))
    with graph.section("Wave"):
        phase = graph.math("DOT_PRODUCT", graph.math("FRACTION", key * turns), (1.0, 1.0, 1.0)) * (2 * math.pi)
        phase = graph.math("DOT_PRODUCT", along, place) + phase
        rate = graph.math("DOT_PRODUCT", ray, along) * reach
        rates, phases = graph.vector(rate, rate, rate), graph.vector(phase, phase, phase)
        strong = graph.vector(amplitude, amplitude, amplitude)
    for name, before, edges in (("Near", near, EDGES[:4]), ("Far", far, EDGES[3:])):
        middles = tuple((a + b) / 2 for a, b in pairwise(edges))
        halves = tuple((b - a) / 2 for a, b in pairwise(edges))
        with graph.section(name):
            wave = graph.math("COSINE", graph.math("MULTIPLY_ADD", rates, middles, phases))
            half = graph.math("MAXIMUM", graph.math("ABSOLUTE", rates * halves), (1e-4, 1e-4, 1e-4))
            evened = wave * graph.math("SINE", half) / half
            graph.output(name, graph.math("MULTIPLY_ADD", evened, strong, before), "vector", "With it")
    return graph


# --- glow ---


def glow_nodes(canvas: Canvas, given: Given, air: Socket, depth: Socket) -> Socket:
    """Return the glow of what is brighter than the airlight. depth: optical, below 0."""
    graph = canvas.graph
    with graph.section("Glow: what fog takes"):
        on = given["glow"] > 0.0
        thick = graph.choose(on, depth * -1.0, 0.0, "float")
        excess = graph.math("SUBTRACT", graph.choose(on, canvas.image, (0.0, 0.0, 0.0)), air)
        lost = 1.0 - graph.math("EXPONENT", thick * -1.0)
        bright = graph.math("MAXIMUM", excess * graph.vector(lost, lost, lost), (0.0, 0.0, 0.0))
        blocks = blocks_of(canvas, on)
        lamps, thickness = (blocks.means(image) for image in (bright, thick))
        lamps = lamps * graph.vector(*[blocks.inside] * 3)
    with graph.section("Glow: blur"):
        half = graph.math("TANGENT", given["view_deg"] * (math.pi / 360))
        unit = graph.math("TANGENT", given["glow_width_deg"] * (math.pi / 180)) / half * canvas.width_px * 0.5
        unit = unit / blocks.side
        root = graph.math("LOGARITHM", graph.math("MAXIMUM", thickness.x, 1e-6), 2.0)
        place = graph.clamp(graph.math("MULTIPLY_ADD", root, 0.5, 1.0), 0.0, float(len(WIDTHS) - 1))
        total: Value = (0.0, 0.0, 0.0)
        for number, width in enumerate(WIDTHS):
            share = graph.math("MAXIMUM", 1.0 - graph.math("ABSOLUTE", place - float(number)), 0.0)
            total = blurred(lamps * graph.vector(share, share, share), unit * width, total)
    with graph.section("Glow: over the frame"):
        assert isinstance(total, Socket)
        strength = given["glow"]
        return blocks.back(total) * graph.vector(strength, strength, strength)


def apply(rgb: NDArray[np.float32], parameters: FogDepth, context: FrameContext) -> NDArray[np.float32]:
    """Fog (H, W, 3) by the context's planar depth (H, W), metres; 0 and NaN are void, infinite is allowed."""
    if not is_even(parameters):
        return fogged(rgb, parameters, context)
    air = air_of(rgb, parameters, context)
    rate = np.float32(-EXTINCTION / parameters.visibility_m)

    def veiled(band: NDArray[np.float32], depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        distance_m = np.where(depth_m > 0, depth_m, np.float32(parameters.void_m or np.inf))
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
        grey = graph.math("DOT_PRODUCT", own.surfaces, LUMINANCE)
        apart = graph.math("SUBTRACT", own.surfaces, graph.vector(grey, grey, grey))
        less = graph.math("SUBTRACT", given["air_tint"], 1.0)
        surfaces = graph.math("MULTIPLY_ADD", apart, graph.vector(less, less, less), own.surfaces)
        air = own.chosen(plain, surfaces)
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


ROOM_M, STREET_M = 3.0, 40.0  # what is so far keeps 55 % of its contrast at severity 3, by either table; chosen


def by_depth(depth_m: Float32) -> tuple[Mapping[str, Any], str]:
    """Return whether severities are those of streets or of rooms, and by how much they reach further.

    They are those of streets by how far a tenth of what a frame shows is. They reach so far that half of it keeps at
    least 55 % of its contrast at severity 3, in a cupboard as in a valley. depth_m: (H, W), 0 = void, which says
    nothing: of a recording it was not measured.
    """
    far_m, middle_m, farthest_m = reach_of(depth_m)
    if not far_m:
        return {"outdoors": False}, "Indoors: visibilities of rooms, as no depth is known"
    outdoors = far_m > FAR_M
    reach = float(f"{np.clip(middle_m / (STREET_M if outdoors else ROOM_M), 0.001, 1000):.2g}")
    which = "Outdoors: visibilities of streets" if outdoors else "Indoors: visibilities of rooms"
    why = f"a tenth of what is seen is farther than {far_m:.3g} m, and half than {middle_m:.3g} m"
    air = {"air_around": False} if outdoors else air_of_rooms(farthest_m)
    return {"outdoors": outdoors, "reach": reach, **air}, f"{which}, times {reach:g}, as {why}"


PERTURBATION = ColourPerturbation(
    name="fog_depth",
    label="Fog by depth",
    stage="environment",
    order=20,
    parameters=FogDepth,
    severities={"visibility_m": (50, 25, 15, 10, 6)},
    other_severities={"outdoors": {"visibility_m": (1000, 500, 200, 100, 50)}},
    stretched={"visibility_m": "reach"},
    source="our own; the law: Koschmieder, Theorie der horizontalen Sichtweite, 1924",
    about=About(
        "Hides what is far behind lit air; it may lie on the ground, come in clumps, and glow around lamps",
        "attenuation and airlight by planar depth (Koschmieder), thinner with height, uneven, with glow around "
        "lamps; needs depth",
    ),
    apply=apply,
    nodes=Nodes(build, linear=True, draws_lit=True, by_camera=by_camera),
    needs_depth=True,
    by_depth=by_depth,
    newly={"air_tint": 0.25, **QUICKLY},
    implied=GIVEN_AIR | {"glow": ("lamps", 0.0)},
    uses_motion=True,
    repeats=is_even,
    even_air=even_air,
    temporals=("fresh", "fixed", "drift"),
)
