# SPDX-License-Identifier: GPL-3.0-or-later
"""Streaks: what particles leave on an image while the shutter is open."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._particles import NEAR_M, Particles, View

type Float32 = NDArray[np.float32]

type Piece = tuple[NDArray[np.intp], Float32, Float32, Float32]
"""Of pixels that streaks cover: index, share covered; depth and opacity of the streak."""

PIECE = 1 << 16  # pixels that are looked at together; chosen, so that their arrays stay in the processor's cache
LEAST_WIDTH_PX = 1.0  # of a streak as it is drawn; thinner ones are fainter instead
SOFTNESS = 0.7  # of a streak's edge, as a share of its width; chosen: flakes are no disks, and a lens's blur is soft
MOST_OPAQUE = 0.999  # so that its logarithm is finite


@dataclass(frozen=True)
class Lens:
    """A thin lens. aperture_m: its diameter; 0 is a pinhole. focus_m: the depth of what is sharp."""

    aperture_m: float
    focus_m: float


@dataclass(frozen=True)
class Streaks:
    """Capsules on the image. start_px, end_px: (N, 2). width_px, opacity, depth_m: (N,)."""

    start_px: Float32
    end_px: Float32
    width_px: Float32
    opacity: Float32
    depth_m: Float32


def streaks_of(particles: Particles, view: View, lens: Lens) -> Streaks:
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
    width_px = np.maximum(np.hypot(seen_px, blur_px), np.float32(LEAST_WIDTH_PX))
    length_px = np.hypot(*(ends[1] - ends[0]).T)
    quarter = np.float32(np.pi / 4)
    opacity = quarter * seen_px**2 / (length_px * width_px + quarter * width_px**2)
    return Streaks(ends[0], ends[1], width_px, np.minimum(opacity, np.float32(MOST_OPAQUE)), depth_m)


def _projected(position_m: Float32, view: View) -> Float32:
    z_m = np.maximum(position_m[:, 2:], np.float32(NEAR_M / 2))
    found = position_m[:, :2] / z_m * np.array(view.focal_px, np.float32) + np.array(view.middle_px, np.float32)
    return found.astype(np.float32, copy=False)


def optical_depth(streaks: Streaks, depth_m: Float32) -> Float32:
    """Return (H, W): the sum of -log(1 - opacity) of the streaks before each pixel's depth, infinite where it is void.

    depth_m: (H, W). A streak counts where it is nearer. Its edge is a ramp about it, at least a pixel
    wide.
    """
    height, width = depth_m.shape
    pixels, depths = [], []
    for piece in _pieces(streaks, (width, height)):
        pixel, share, z_m, opacity = piece
        before = z_m < depth_m.ravel()[pixel]
        pixels.append(pixel[before])
        depths.append(-np.log1p(-opacity[before] * share[before]))
    if not pixels:
        return np.zeros((height, width), np.float32)
    total = np.bincount(np.concatenate(pixels), np.concatenate(depths), height * width)
    return total.astype(np.float32).reshape(height, width)


def _pieces(streaks: Streaks, size_px: tuple[int, int]) -> Iterator[Piece]:
    """Yield the pixels that some streaks at a time cover.

    A streak is walked along the axis, rows or columns, that it extends further along. Across, it is looked at as far
    as its edge and its round ends may reach.
    """
    run = streaks.end_px - streaks.start_px
    steep = np.abs(run[:, 1]) >= np.abs(run[:, 0])
    # Along the walk first, then across.
    start = np.where(steep[:, None], streaks.start_px[:, ::-1], streaks.start_px)
    run = np.where(steep[:, None], run[:, ::-1], run)
    backwards = run[:, :1] < 0
    start, run = np.where(backwards, start + run, start), np.where(backwards, -run, run)
    slope = np.divide(run[:, 1], run[:, 0], out=np.zeros_like(run[:, 0]), where=run[:, 0] > 0)
    ramp = np.maximum(streaks.width_px * np.float32(SOFTNESS), np.float32(1))
    reach = (streaks.width_px + ramp) / 2
    aside = reach * np.sqrt(1 + slope * slope)
    limit = np.where(steep, size_px[1], size_px[0]).astype(np.float32)
    first = np.clip(np.ceil(start[:, 0] - reach), 0, limit).astype(np.int32)
    last = np.clip(np.floor(start[:, 0] + run[:, 0] + reach) + 1, 0, limit).astype(np.int32)
    across = (2 * aside + 1).astype(np.int32)
    counts = np.maximum(last - first, 0) * across
    ends = np.cumsum(counts)
    squared = np.maximum(run[:, 0] ** 2 + run[:, 1] ** 2, np.float32(1e-12))
    at = 0
    while at < len(counts):
        done = ends[at - 1] if at else 0
        to = max(int(np.searchsorted(ends, done + PIECE)), at + 1)
        chosen = np.arange(at, to)
        count = counts[at:to]
        at = to
        total = int(count.sum())
        if not total:
            continue
        who = np.repeat(chosen, count)
        place = (np.arange(total) - np.repeat(np.cumsum(count) - count, count)).astype(np.int32)
        step, beside = np.divmod(place, across[who])
        along = first[who] + step
        relative = along - start[who, 0]
        side = np.ceil(start[who, 1] + relative * slope[who] - aside[who]) + beside
        aside_px = side - start[who, 1]
        # Distance from the capsule's axis.
        share = np.clip((relative * run[who, 0] + aside_px * run[who, 1]) / squared[who], 0, 1)
        distance = np.hypot(relative - share * run[who, 0], aside_px - share * run[who, 1])
        covered = np.minimum((reach[who] - distance) / ramp[who], 1)
        side = side.astype(np.int32)
        up = steep[who]
        column, row = np.where(up, side, along), np.where(up, along, side)
        inside = (covered > 0) & (side >= 0) & (side < np.where(up, size_px[0], size_px[1]))
        yield (
            (row * size_px[0] + column)[inside],
            covered[inside].astype(np.float32),
            streaks.depth_m[who][inside],
            streaks.opacity[who][inside],
        )
