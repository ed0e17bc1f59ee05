# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog that is no even layer: thinner with height, uneven, and lit up around lamps; on arrays.

Along a ray whose height above the camera is k z at depth z, the density exp(-height / falloff) has the integral
exp(-camera's height / falloff) z (1 - e^-u) / u, u = k z / falloff.
"""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.linear_light import decoded, encoded
from ..core.node_graphs.group_inputs import seed_of
from ..core.perturbing.kinds import FrameContext
from ..core.trajectories.camera_state import CameraState, camera_state_of
from ._air_light import EXTINCTION, air_light, colour_of, sky_in
from ._bands import by_bands
from ._fog_glow import glow_of
from ._fog_parameters import FogDepth
from ._fog_waves import GRID_PX, Bank, key_of, mean_before, slab_means
from ._view import camera_of

Float32: TypeAlias = NDArray[np.float32]

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
    own = air_light(decoded(rgb), context.depth_m)
    return own.over(own.surfaces).astype(np.float32)


def optical_depth(parameters: FogDepth, context: FrameContext, size: tuple[int, ...]) -> Float32:
    """Return (H, W): the fog's optical depth before each pixel of the context's depth."""
    farthest_m = np.float32(FARTHEST * parameters.visibility_m)
    depth_m = context.depth_m
    distance_m = np.where(depth_m > 0, np.minimum(depth_m, farthest_m), farthest_m)
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
