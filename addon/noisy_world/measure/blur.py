# SPDX-License-Identifier: GPL-3.0-or-later
"""How sharp edges are: what the camera's motion smears of them while the shutter is open, and what the lens does.

An edge's slope at two scales tells how wide it is across itself. Motion widens edges across it, by its way during the
exposure, and leaves those along it alone; a lens out of focus widens all alike. So the exposure is that share of the
way from frame to frame, by which width grows with the way across an edge.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .figure import BLOCKS, WITHIN, Figure, blocks_of, jackknifed
from .footage import Float32, Float64, RecordingView, linear_of_bytes

# Chosen, as all below.
FINE_PX, COARSE_PX = 1.0, 2.0  # standard deviations of the two scales
STEP = 1 / 3  # px^2: variance of what a central difference over two pixels adds to both
LEAST_SLOPE = 4.0 / 255  # a pixel, at the coarse scale, in linear light
OVER_NOISE = 1.2  # slope over the deviation of noise, whose own fine slopes are a fifth of it
ALIKE = 0.3  # relative difference of slopes on either side of an edge: lines and corners have more
BESIDE_PX, BEYOND_PX = 2.3, 4.5  # how far from an edge slopes are compared, and have to be over
BORDER_PX = 8
LOST = 1.5  # times the usual gap: longer ones have lost a frame
MOST_EDGES = 5000  # of a frame
FLOW_PX = 400  # the width at which motion is followed, at most
LEAST_EDGES = 2000
CLIPPED_PX2 = 4.0  # variance of an edge: wider ones count as this
WIDEST_PX = 2.6  # deviation of the lens: more is looked at in a smaller image
FARTHEST_PX = 5.5  # way of an edge: more is looked at in a smaller image
LEVELS = 3
WAYS_CLIPPED_PX = 10.0
CHANNELS = np.array([[0.3, 0.4, 0.3]], np.float32)  # of red, green and blue
STILL_PX = 1.0  # way across an edge during the exposure, or that of a tenth of the edges: their widths tell the lens
ANGLES, CONTRASTS = 6, 4  # classes of edges within which width is compared
SHARES = np.linspace(-0.6, 1.3, 39)  # exposures that are tried, of the interval; below 0 wider edges move less
LEAST_SURE = 0.35  # half an interval of an exposure's share that tells nothing
# The sharper edges tell the lens, as a scene has soft ones of its own. LENS_PX2 is its variance by theirs, EDGES_PX2,
# of known blurs on known rooms with and without noise; SMALLER what smaller images show of it. SCENES_PX2 and SCENES
# are how far scenes differ in it: whatever it is, at the recorded size and in smaller images, and of it.
SHARPER = 0.3
EDGES_PX2, LENS_PX2 = (-0.33, 0.0, 1.48, 2.45, 3.4, 5.5), (-0.5, 0.0, 2.25, 4.0, 6.25, 11.0)
SMALLER, SCENES_PX2, SCENES = 0.78, (0.34, 0.45), 0.15
LENS_ERROR = 0.06  # of a deviation: a disk's slope is less than a Gaussian's
EXPOSURE_ERROR = 0.07  # of its square, found on known ones
WIDTH_ERROR_PX2 = 0.1  # variance by which near and far things, which move differently, are differently sharp

NAMES = ("exposure_share", "exposure_ms", "motion_blur_px", "motion_blur_most_px", "defocus_sigma_px")
"""Figures of blur.

exposure_share: of the interval between frames, how long the shutter is open; exposure_ms: the same in milliseconds,
`shutter_ms` of `camera_motion_blur`. motion_blur_px, motion_blur_most_px: the way on the image during it, at the size
that was recorded: the median over the image, and what 19 of 20 places stay below. defocus_sigma_px: standard deviation
along one axis of what the lens and pixels spread of a point: half of `radius_px` of `defocus_blur`, and `sigma_px` of
a Gaussian.
"""


@dataclass(frozen=True)
class _Edges:
    """N edges. ratio: (N,) slope at the fine scale over that at the coarse. across: (N,) how far they move across
    themselves from frame to frame, in pixels. kind: (N,) class of angle and contrast. frame: (N,) which.
    """

    ratio: Float64
    across: Float64
    kind: NDArray[np.int64]
    frame: NDArray[np.int64]


def blur_figures(footage: RecordingView, frames: Sequence[int]) -> tuple[Figure, ...]:
    """Return how blurred colour is in some frames, each of which has one before and one after it.

    Raises InputError where one of them is damaged.
    """
    if len(frames) < BLOCKS:
        return tuple(Figure.none(name, "too few frames follow one another") for name in NAMES)
    seen = [_Frame(footage, frame) for frame in frames]
    found: list[_Widths] = []
    for level in range(LEVELS):
        edges = _joined([each.edges(level, number) for number, each in enumerate(seen)])
        if len(edges.ratio) < LEAST_EDGES / 2**level:
            continue  # noise may hide edges that a smaller image shows
        found.append(_widths(edges, 2.0**level, len(seen)))
        if level and len(found) > 1 and not found[-1].wide:
            break
    if not found:
        return tuple(Figure.none(name, "too few edges are seen") for name in NAMES)
    ways_px = np.concatenate([each.ways_px() for each in seen])
    near = [each for each in found if each.way_px <= FARTHEST_PX] or found[-1:]
    exposure = min(near, key=lambda each: each.error)
    return (*_exposure(exposure, ways_px, len(seen), footage.rate_hz), _defocus(near, len(seen)))


def evenly_between(frames: Sequence[int], stamps_s: Float64) -> list[int]:
    """Return those of some frames that have one before and one after them, with no frame lost between, by stamps (N,).

    Each frame is moved inwards to the nearest that has both neighbours.
    """
    inner = np.unique(np.clip(frames, 1, len(stamps_s) - 2))
    gaps_s = np.diff(stamps_s)
    whole = gaps_s < LOST * float(np.median(gaps_s))
    return inner[whole[inner - 1] & whole[inner]].tolist()


@dataclass(frozen=True)
class _Widths:
    """Of an image that is `times` smaller: the exposure's square and its error; the variance of what the lens spreads,
    and its error; the way during the exposure that a tenth of the edges surpass.
    """

    times: float
    square: float
    error: float
    variance: float
    variance_error: float
    way_px: float

    @property
    def wide(self) -> bool:
        """Whether a smaller image tells more."""
        return self.soft or self.way_px > FARTHEST_PX

    @property
    def soft(self) -> bool:
        """Whether a smaller image tells more of the lens."""
        return self.variance > WIDEST_PX**2


def _widths(edges: _Edges, times: float, count: int) -> _Widths:
    groups = blocks_of(count)[edges.frame]
    sums = np.array([_sums(edges, groups, _square(share)) for share in SHARES.tolist()])  # (tried, block, kind, 4)
    square = _crossing(_covariances(sums.sum(axis=1)))
    left_out = np.array([_crossing(_covariances(sums.sum(axis=1) - sums[:, block])) for block in range(BLOCKS)])
    way = float(np.quantile(edges.across, 0.9))
    error = math.hypot(jackknifed(left_out), EXPOSURE_ERROR * square, 12 * WIDTH_ERROR_PX2 / max(way, 1e-3) ** 2)
    share = math.sqrt(max(square, 0.0))
    still = share * edges.across < max(STILL_PX, share * float(np.quantile(edges.across, 0.1)))
    widths, whose = _variance(edges.ratio[still], share * edges.across[still]), groups[still]
    smaller = int(times > 1)
    sharp = float(np.quantile(widths, SHARPER))
    by_block = np.array([float(np.quantile(widths[whose != block], SHARPER)) for block in range(BLOCKS)])
    lens, *left_out = [
        each / SMALLER if smaller else float(np.interp(each, EDGES_PX2, LENS_PX2)) for each in (sharp, *by_block)
    ]
    by_frames = jackknifed(np.array(left_out))
    lens_error = math.hypot(by_frames, SCENES_PX2[smaller], SCENES * lens, 2 * LENS_ERROR * lens)
    return _Widths(times, square, error, lens, lens_error, share * way)


def _exposure(found: _Widths, ways_px: Float32, count: int, rate_hz: float | None) -> Iterator[Figure]:
    low, share, high = (math.sqrt(max(found.square + side * WITHIN * found.error, 0.0)) for side in (-1, 0, 1))
    middle_px, most_px = np.quantile(ways_px, (0.5, 0.95)).tolist()
    scales = 1.0, 1e3 / rate_hz if rate_hz else None, middle_px, most_px
    for name, scale in zip(NAMES, scales, strict=False):
        if (high - low) / 2 > LEAST_SURE:
            why = f"what is seen moves too little for it, by {middle_px:.2g} px from frame to frame"
            yield Figure.none(name, why)
        elif scale is None:
            yield Figure.none(name, "there are no time stamps")
        else:
            yield Figure(name, scale * share, scale * low, scale * high, count)


def _defocus(levels: Sequence[_Widths], count: int) -> Figure:
    found = next((each for each in levels if not each.soft), levels[-1])
    ends = [max(found.variance + side * WITHIN * found.variance_error, 0.0) for side in (-1, 0, 1)]
    low, value, high = (found.times * math.sqrt(end) for end in ends)
    return Figure(NAMES[-1], value, low, high, count)


# --- edges ---


class _Frame:
    """A frame in linear light, and how what it shows moves."""

    def __init__(self, footage: RecordingView, frame: int) -> None:
        import cv2

        around = [footage.colour(frame + later) for later in (-1, 0, 1)]
        high, wide = around[1].shape[:2]
        size_px = (wide, high) if wide <= FLOW_PX else (FLOW_PX, round(high * FLOW_PX / wide))
        small = [
            cv2.cvtColor(cv2.resize(image, size_px, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
            for image in around
        ]
        flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
        ahead, back = (np.asarray(flow.calc(small[1], small[end], np.zeros((0, 0)))) for end in (2, 0))
        self._way = np.asarray((ahead - back) / 2 * (wide / size_px[0]), np.float32)
        # All channels have less noise together than one.
        self._light = np.asarray(cv2.transform(linear_of_bytes()[around[1]], CHANNELS), np.float32)

    def ways_px(self) -> Float32:
        """Return (N,): how far what is seen moves from frame to frame, evenly over the image."""
        return np.asarray(np.linalg.norm(self._way[::8, ::8], axis=2).ravel(), np.float32)

    def edges(self, level: int, number: int) -> _Edges:
        """Return the edges of the image, halved so often."""
        import cv2

        light = self._light
        for _ in range(level):
            light = np.asarray(cv2.resize(light, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.float32)
        ratio, slope, at, across = _edges(light)
        if len(ratio) > MOST_EDGES:
            chosen = np.linspace(0, len(ratio) - 1, MOST_EDGES).astype(int)
            ratio, slope, at, across = ratio[chosen], slope[chosen], at[chosen], across[chosen]
        high, wide = self._way.shape[:2]
        place = ((at + 0.5) * (wide / light.shape[1], high / light.shape[0])).astype(int)
        way_px = self._way[place[:, 1].clip(0, high - 1), place[:, 0].clip(0, wide - 1)]
        way_px = np.asarray(way_px / 2**level, np.float32)
        angle = (np.arctan2(across[:, 1], across[:, 0]) % np.pi / np.pi * ANGLES).astype(int) % ANGLES
        contrast = np.log2(np.maximum(slope / LEAST_SLOPE, 1)).astype(int).clip(0, CONTRASTS - 1)
        moved = np.abs((way_px * across).sum(axis=1))
        return _Edges(ratio, moved, angle * CONTRASTS + contrast, np.full(len(ratio), number))


def _joined(parts: Sequence[_Edges]) -> _Edges:
    names = ("ratio", "across", "kind", "frame")
    return _Edges(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _edges(light: Float32) -> tuple[Float64, Float64, NDArray[np.int64], Float64]:
    """Return of edges in an image (H, W) the ratio and the slope, (N,), place and direction across, (N, 2), x and y.

    Edges alone: where slopes on either side are alike, at both scales.
    """
    import cv2

    fine = np.asarray(cv2.GaussianBlur(light, (0, 0), FINE_PX), np.float32)
    coarse = np.asarray(cv2.GaussianBlur(fine, (0, 0), math.sqrt(COARSE_PX**2 - FINE_PX**2)), np.float32)
    slopes = [_slopes(image) for image in (fine, coarse)]
    steep = np.hypot(*slopes[1])
    candidate = steep > max(LEAST_SLOPE, OVER_NOISE * _noise(light))  # noise alone looks like sharp edges
    candidate[:BORDER_PX] = candidate[-BORDER_PX:] = False
    candidate[:, :BORDER_PX] = candidate[:, -BORDER_PX:] = False
    y, x = np.nonzero(candidate)
    slope = steep[y, x]
    across = np.stack([image[y, x] for image in slopes[1]], axis=1) / slope[:, None]
    step = np.rint(across * 1.306).astype(int)  # to one of eight neighbours
    ridge = (slope >= steep[y + step[:, 1], x + step[:, 0]]) & (slope > steep[y - step[:, 1], x - step[:, 0]])
    y, x, slope, across = y[ridge], x[ridge], slope[ridge], across[ridge]

    def along(scale: int, far_px: float) -> Float32:
        step = np.rint(across * far_px).astype(int)
        right, down = (image[y + step[:, 1], x + step[:, 0]] for image in slopes[scale])
        return np.asarray(right * across[:, 0] + down * across[:, 1], np.float32)

    sharp = along(0, 0.0)
    alike = np.ones(len(slope), np.bool_)
    for scale, here in enumerate((sharp, slope)):
        one, other = along(scale, BESIDE_PX), along(scale, -BESIDE_PX)
        alike &= np.abs(one - other) < ALIKE * here
    alike &= np.minimum(along(0, BESIDE_PX), along(0, -BESIDE_PX)) > -0.05 * sharp
    alike &= np.minimum(along(1, BEYOND_PX), along(1, -BEYOND_PX)) > -0.1 * slope
    at = np.stack([x, y], axis=1)[alike]
    return ((sharp / slope)[alike].astype(np.float64), slope[alike].astype(np.float64), at, across[alike])


def _noise(light: Float32) -> float:
    """Return the deviation of white noise in an image, by the median of second differences (after Immerkaer, 1996)."""
    import cv2

    kernel = np.outer((1, -2, 1), (1, -2, 1)).astype(np.float32) / 6
    return 1.4826 * float(np.median(np.abs(cv2.filter2D(light, -1, kernel)[::3, ::3])))


def _slopes(image: Float32) -> tuple[Any, Any]:
    """Return central differences of an image (H, W) to the right and down."""
    import cv2

    kernel = np.array([[-0.5, 0.0, 0.5]], np.float32)
    return cv2.filter2D(image, -1, kernel), cv2.filter2D(image, -1, kernel.T)


# --- widths ---

_VARIANCES = np.concatenate([np.linspace(-0.9, 1, 39), np.geomspace(1.05, 60, 60)])
_WAYS_PX = np.linspace(0, 14, 57)
_RATIOS = np.linspace(1.0, 2.6, 161)


@cache
def _table() -> Float64:
    """Return (ways, ratios): the variance of an edge by its way during the exposure and by its ratio of slopes.

    An edge of variance v, smeared evenly over l, has in its middle the slope (2 Phi(l / 2s) - 1) / l, with s^2 = v plus
    the variance of the scale at which it is taken.
    """
    rows: list[Float64] = []
    for way in _WAYS_PX.tolist():
        ratio = [_middle(way, variance + FINE_PX**2) / _middle(way, variance + COARSE_PX**2) for variance in _VARIANCES]
        rows.append(np.interp(-_RATIOS, -np.maximum.accumulate(np.array(ratio)[::-1])[::-1], _VARIANCES))
    return np.array(rows)


def _middle(way_px: float, variance: float) -> float:
    deviation = math.sqrt(variance + STEP)
    if way_px < 1e-3:
        return 1 / (deviation * math.sqrt(2 * math.pi))
    return math.erf(way_px / (2 * math.sqrt(2) * deviation)) / way_px


def _variance(ratio: Float64, way_px: Float64) -> Float64:
    """Return the variances of edges without their motion (N,), by ratios of slopes and ways during the exposure."""
    table = _table()
    row = np.clip(way_px / _WAYS_PX[1], 0, len(_WAYS_PX) - 1.001)
    column = np.clip((ratio - _RATIOS[0]) / (_RATIOS[1] - _RATIOS[0]), 0, len(_RATIOS) - 1.001)
    i, j = row.astype(int), column.astype(int)
    down, right = row - i, column - j
    above, below = (table[i + one, j] * (1 - right) + table[i + one, j + 1] * right for one in (0, 1))
    return above * (1 - down) + below * down


def _square(share: float) -> float:
    return share * abs(share)


def _sums(edges: _Edges, groups: NDArray[np.int64], square: float) -> Float64:
    """Return (BLOCKS, kinds, 4): count, squares of ways, variances, and their product, for an exposure's square."""
    if square > 0:
        variance = _variance(edges.ratio, math.sqrt(square) * edges.across)
    else:
        variance = _variance(edges.ratio, np.zeros(len(edges.ratio))) - square * edges.across**2 / 12
    variance = np.clip(variance, -CLIPPED_PX2, CLIPPED_PX2)
    ways = np.minimum(edges.across, WAYS_CLIPPED_PX) ** 2
    kinds = ANGLES * CONTRASTS
    place = groups * kinds + edges.kind
    sums = [
        np.bincount(place, weights, BLOCKS * kinds) for weights in (np.ones(len(ways)), ways, variance, ways * variance)
    ]
    return np.stack(sums, axis=-1).reshape(BLOCKS, kinds, 4)


def _covariances(sums: Float64) -> Float64:
    """Return (tried,) of widths and ways within kinds: of sums (tried, kinds, 4)."""
    count, ways, variances, product = np.moveaxis(sums, -1, 0)
    return (product - ways * variances / np.maximum(count, 1)).sum(axis=1)


def _crossing(covariances: Float64) -> float:
    """Return the square of the exposure at which widths no longer grow with ways; the end beyond which it would be."""
    squares = np.array([_square(share) for share in SHARES.tolist()])
    for (one, before), (other, after) in pairwise(zip(squares.tolist(), covariances.tolist(), strict=True)):
        if before > 0 >= after:
            return one + (other - one) * before / (before - after)
    return float(squares[0] if covariances[0] <= 0 else squares[-1])
