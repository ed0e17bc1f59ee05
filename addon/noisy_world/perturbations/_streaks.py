# SPDX-License-Identifier: GPL-3.0-or-later
"""Streaks: what particles leave on an image while the shutter is open."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._particles import NEAR_M, AirCamera, Particles

Float32: TypeAlias = NDArray[np.float32]

Piece: TypeAlias = tuple[NDArray[np.int32], Float32]
"""Of pixels that streaks hide: index, and the share of light hidden."""

PIECE = 1 << 15  # pixels that are looked at together; chosen, so that their arrays stay in the processor's cache
MOST_FOUND = 1 << 23  # hidden pixels that are kept before they are summed; chosen: 100 MB
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
    width_px = np.maximum(np.hypot(seen_px, blur_px), np.float32(LEAST_WIDTH_PX))
    length_px = np.hypot(*(ends[1] - ends[0]).T)
    quarter = np.float32(np.pi / 4)
    opacity = quarter * seen_px**2 / (length_px * width_px + quarter * width_px**2)
    return Streaks(ends[0], ends[1], width_px, np.minimum(opacity, np.float32(MOST_OPAQUE)), depth_m)


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
    ramp = np.maximum(streaks.width_px * np.float32(SOFTNESS), np.float32(1))
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
