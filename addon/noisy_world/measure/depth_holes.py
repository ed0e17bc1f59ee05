# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels without depth by cause: the border, shadows, edges, dark colour, incidence and distance; and their clumps.

Away from the border and from shadows a law of two numbers is fitted, which is that of the sensors here: a pixel is void
where cos(incidence) / z^2, times a reflectance that is drawn, is too little.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics
from ..images.measured_depth import completed_m
from ..perturbations.shipped._depth_devices import cosine_of_incidence
from .figure import BLOCKS, Figure, blocks_of, jackknifed
from .footage import Float32, Float64

# Chosen, as all below.
EDGE = 0.05  # relative step of depth between neighbours that is an edge
JUMP = 0.15  # likewise, of one whose shadow or flying pixels are looked at
STEEP = 0.015  # relative step of inverse depth a pixel that a surface may have over a hole
BESIDE_PX = 13  # side of the square in which a hole is beside an edge
DARK = 40  # of 255
BORDER = 0.9  # share of the frames in which a pixel is void that is one of the border
STEP_PX = 2  # of the pixels of which holes' law and clumps are measured
SMOOTH_PX = 9  # side of the square over which depth is smoothed for incidence
LEAST_JUMPS, LEAST_VOID, LEAST_PIXELS = 200, 60, 400
TOO_FEW = 0.003  # share of void away from the border below which no law is fitted
BINS = 32  # of light
SPREAD = 0.1, 10.0  # of reflectance's logarithm that are told
MOST_FRAMES = 32  # that holes stay for
LAGS_PX = (2, 4, 6, 8, 12, 16, 24, 32, 48, 64)
ANGLES_DEG = (0, 30, 45, 60, 70, 80, 90)
DISTANCES_M = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.6, 4.5, 6.0, 8.0, 12.0)
GREYS = (0, 20, 40, 60, 100, 160, 256)
CONTRASTS = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 256.0)  # of 255: standard deviation of grey over 7 x 7 pixels
SIDES = ("left", "right", "top", "bottom")
SHARES = ("holes_at_border_share", "holes_beside_edges_share", "holes_in_dark_share", "holes_elsewhere_share")
BASELINE, FLYING = "shadow_baseline_m", "flying_pixels_share"
LAW = ("hole_least_light", "hole_light_spread", "hole_clump_px", "hole_clump_frames")


@dataclass(frozen=True)
class HoleFrame:
    """One frame: planar depth (H, W) in metres, 0 = void, grey (H, W), and where the next frame is void, or None."""

    depth_m: Float32
    grey: NDArray[np.uint8]
    void_after: NDArray[np.bool_] | None


def depth_holes(frames: Sequence[HoleFrame], camera: Intrinsics) -> tuple[Figure, ...]:
    """Return the figures of holes. camera: of the frames.

    holes_..._share: of all pixels, each counted once: the border, else beside edges, else in dark, else elsewhere.
    holes_at_..., curves: the share of pixels at an incidence in degrees, distance in metres, grey or contrast of 255,
    that is void, away from the border and edges. border_SIDE_px: strips that are void in all frames. shadow_baseline_m:
    that of the second eye or projector whose shadow is to the left of what is near, below 0 to the right.
    flying_pixels_share: of edges crossed along rows, those with a pixel between both surfaces. hole_least_light,
    hole_light_spread, hole_clump_px, hole_clump_frames: least_light, reflectance_spread, clump_px and clump_frames of
    the sensors' law.
    """
    names = (*SHARES, *(f"border_{side}_px" for side in SIDES), BASELINE, FLYING, *LAW)
    if not frames:
        return tuple(Figure.none(name, "there is no depth") for name in names)
    border = np.mean([frame.depth_m <= 0 for frame in frames], axis=0) > BORDER
    strips = _strips(border)
    left, right, top, bottom = strips
    inside = np.zeros_like(border)
    inside[top : border.shape[0] - bottom, left : border.shape[1] - right] = True
    parts = [_parts(frame, border, inside, camera) for frame in frames]
    baseline = _baseline([part.jumps for part in parts], camera)
    # Where edges have no shadow, holes beside them are of the law too.
    without_edges = baseline.value is None or baseline.value != 0
    return (
        *_shares([part.shares for part in parts]),
        *(Figure.exact(f"border_{side}_px", wide, len(frames)) for side, wide in zip(SIDES, strips, strict=True)),
        baseline,
        _flying([part.flying for part in parts]),
        *_law(parts, without_edges=without_edges),
        *_curves(parts),
    )


@dataclass(frozen=True)
class _Part:
    """One frame's. shares: (4,). jumps: (N, 2), void pixels that lie in a jump along a row, and it in inverse depth.

    flying: how many edges have a pixel between, and how many have none. Of every STEP_PX-th pixel (h, w): void,
    void_after, inside (the strips), beside (edges), cosine, depth_m, grey and contrast.
    """

    shares: Float64
    jumps: Float64
    flying: tuple[int, int]
    void: NDArray[np.bool_]
    void_after: NDArray[np.bool_] | None
    inside: NDArray[np.bool_]
    beside: NDArray[np.bool_]
    cosine: Float32
    depth_m: Float32
    grey: NDArray[np.uint8]
    contrast: Float32


def _parts(frame: HoleFrame, border: NDArray[np.bool_], inside: NDArray[np.bool_], camera: Intrinsics) -> _Part:
    import cv2

    depth_m, void = frame.depth_m, frame.depth_m <= 0
    per_m = _bridged_per_m(depth_m, completed_m(depth_m))
    square = np.ones((3, 3), np.uint8)
    step = cv2.dilate(per_m, square) > (1 + EDGE) * cv2.erode(per_m, square)
    beside = cv2.dilate(step.astype(np.uint8), np.ones((BESIDE_PX, BESIDE_PX), np.uint8)) > 0
    at_border, at_edge = void & border, void & ~border & beside
    in_dark = void & ~border & ~beside & (frame.grey < DARK)
    shares = [float(part.mean()) for part in (at_border, at_edge, in_dark, void & ~border & ~beside & ~in_dark)]
    smooth_m = 1 / cv2.blur(per_m, (SMOOTH_PX, SMOOTH_PX))
    grey = frame.grey.astype(np.float32)
    mean = cv2.blur(grey, (7, 7))
    contrast = np.sqrt(np.maximum(cv2.blur(grey * grey, (7, 7)) - mean * mean, 0))
    at = (slice(STEP_PX // 2, None, STEP_PX),) * 2
    small_m = np.ascontiguousarray(smooth_m[at], np.float32)
    middle = (camera.cx_px - STEP_PX // 2) / STEP_PX, (camera.cy_px - STEP_PX // 2) / STEP_PX
    coarse = Intrinsics(small_m.shape[1], small_m.shape[0], camera.fx_px / STEP_PX, camera.fy_px / STEP_PX, *middle)
    return _Part(
        np.array(shares),
        _jumps(depth_m[::2]),
        _edges(depth_m[::2]),
        void[at],
        None if frame.void_after is None else frame.void_after[at],
        inside[at],
        beside[at],
        cosine_of_incidence(small_m, coarse),
        small_m,
        frame.grey[at],
        np.asarray(contrast[at], np.float32),
    )


def _bridged_per_m(depth_m: Float32, filled_m: Float32) -> Float32:
    """Return inverse depth (H, W): within holes of one surface linear along the row, as on a plane, else as filled.

    At the ends of rows it is that of the nearest pixel.
    """
    flat = depth_m.ravel()
    known = np.flatnonzero(flat > 0)
    per_m = (1 / np.maximum(filled_m.ravel(), 0.05)).astype(np.float32)
    if len(known) < 2:
        return per_m.reshape(depth_m.shape)
    missing = np.flatnonzero(flat <= 0)
    after = np.clip(np.searchsorted(known, missing), 1, len(known) - 1)
    one, other = known[after - 1], known[after]
    row, of_one, of_other = (places // depth_m.shape[1] for places in (missing, one, other))
    near, far = per_m[one], per_m[other]
    whole = (of_one == row) & (of_other == row)
    per_m[missing] = np.where(
        whole, per_m[missing], np.where(of_one == row, near, np.where(of_other == row, far, per_m[missing]))
    )
    whole &= np.abs(near - far) < np.maximum(JUMP, STEEP * (other - one)) * np.minimum(near, far)
    part = (missing - one)[whole] / (other - one)[whole]
    per_m[missing[whole]] = near[whole] + part * (far - near)[whole]
    return per_m.reshape(depth_m.shape)


def _shares(shares: list[Float64]) -> Sequence[Figure]:
    every = np.array(shares)
    errors = every.std(axis=0) / len(every) ** 0.5
    values = zip(SHARES, every.mean(axis=0), errors, strict=True)
    return [Figure.within(name, float(value), float(error), len(every)) for name, value, error in values]


def _strips(border: NDArray[np.bool_]) -> tuple[int, ...]:
    """Return how wide the strips at the four SIDES are that are void in all frames, in pixels."""
    columns, rows = border.mean(axis=0) > BORDER, border.mean(axis=1) > BORDER
    seen = [np.flatnonzero(~lines) for lines in (columns, columns[::-1], rows, rows[::-1])]
    return tuple(int(lines[0]) if lines.size else 0 for lines in seen)


# --- edges: shadows, and pixels in the air ---


def _jumps(rows_m: Float32) -> Float64:
    """Return (N, 2) of jumps along rows (H, W): void pixels between both sides, and the jump of inverse depth."""
    row, column = np.nonzero(rows_m > 0)
    z = rows_m[row, column].astype(np.float64)
    one, other = z[:-1], z[1:]
    jump = (row[1:] == row[:-1]) & (np.abs(other - one) > JUMP * np.minimum(one, other))
    wide = column[1:] - column[:-1] - 1
    return np.stack([wide[jump].astype(np.float64), (1 / other - 1 / one)[jump]], axis=1)


def _baseline(jumps: list[Float64], camera: Intrinsics) -> Figure:
    """Return the baseline of which shadows are as wide as seen, of most of what edges jump."""
    groups = np.repeat(blocks_of(len(jumps)), [len(each) for each in jumps])
    wide, per_m = np.concatenate(jumps).T
    sides = [per_m * side > 0 for side in (1, -1)]
    if min(int(mine.sum()) for mine in sides) < LEAST_JUMPS:
        return Figure.none(BASELINE, "too few edges are seen")
    found = [_middle(wide[mine] / np.abs(per_m[mine]), np.abs(per_m[mine])) for mine in sides]
    side = int(found[1] > found[0])
    value, mine, sign = found[side], sides[side], (1.0, -1.0)[side]
    if np.median(wide[mine]) < 1:
        return Figure(BASELINE, 0.0, 0.0, 1 / camera.fx_px, int(mine.sum()), "edges")
    wide, per_m, groups = wide[mine], np.abs(per_m[mine]), groups[mine]
    kept = [groups != group for group in range(BLOCKS)]
    left_out = np.array([_middle(wide[each] / per_m[each], per_m[each]) for each in kept])
    # A shadow's width is whole pixels, and other holes are beside it.
    error = float(np.hypot(jackknifed(left_out), 0.5 / np.median(per_m)))
    return Figure.within(BASELINE, sign * value / camera.fx_px, error / camera.fx_px, len(wide), "edges")


def _middle(values: Float64, weights: Float64) -> float:
    """Return the median of weighted values (N,)."""
    order = np.argsort(values)
    sums = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(sums, sums[-1] / 2)]) if len(values) else 0.0


def _edges(rows_m: Float32) -> tuple[int, int]:
    """Return how many edges along rows (H, W) have a pixel between two flat surfaces, and how many have none."""
    z = rows_m
    known = z > 0
    alike = (np.abs(z[:, 1:] - z[:, :-1]) < EDGE / 2 * z[:, 1:]) & known[:, 1:] & known[:, :-1]

    def jumps(apart: int) -> NDArray[np.bool_]:
        one, other = z[:, 1 : -1 - apart], z[:, 1 + apart : -1]
        flat = alike[:, : -1 - apart] & alike[:, 1 + apart :]
        return flat & (np.abs(other - one) > JUMP * np.minimum(one, other))

    between = jumps(2)
    one, here, other = z[:, 1:-3][between], z[:, 2:-2][between], z[:, 3:-1][between]
    share = (here - one) / (other - one)
    return int(((here > 0) & (share > 0.1) & (share < 0.9)).sum()), int(jumps(1).sum())


def _flying(counts: list[tuple[int, int]]) -> Figure:
    flying, sharp = np.array(counts, np.float64).T
    if flying.sum() + sharp.sum() < LEAST_JUMPS:
        return Figure.none(FLYING, "too few edges have depth at both sides")
    groups = blocks_of(len(counts))

    def share(kept: NDArray[np.bool_]) -> float:
        return float(flying[kept].sum() / max(flying[kept].sum() + sharp[kept].sum(), 1))

    left_out = np.array([share(groups != group) for group in range(BLOCKS)])
    whole = share(groups >= 0)
    error = jackknifed(left_out)
    return Figure.within(FLYING, whole, error, int(flying.sum() + sharp.sum()), "edges")


# --- the law of light, and clumps ---


def _law(parts: Sequence[_Part], *, without_edges: bool) -> Sequence[Figure]:
    """Return the figures of LAW. without_edges: leave out what is beside edges, where shadows are."""
    masks = [part.inside & ~part.beside if without_edges else part.inside for part in parts]
    void = np.concatenate([part.void[mask] for part, mask in zip(parts, masks, strict=True)])
    if len(void) < LEAST_PIXELS or void.sum() < LEAST_VOID or void.mean() < TOO_FEW:
        return [Figure.none(name, "there are too few holes away from the border and from shadows") for name in LAW]
    light = [np.log(np.maximum(part.cosine, 0.02) / np.maximum(part.depth_m, 0.05) ** 2) for part in parts]
    bounds = np.quantile(
        np.concatenate([each[mask] for each, mask in zip(light, masks, strict=True)]), np.linspace(0, 1, BINS + 1)
    )
    bins = [np.clip(np.searchsorted(bounds, each) - 1, 0, BINS - 1) for each in light]
    counted = np.zeros((len(parts), 3, BINS))
    for row, part, mask, each, place in zip(counted, parts, masks, light, bins, strict=True):
        for number, weights in enumerate((None, part.void[mask], each[mask])):
            row[number] = np.bincount(place[mask], weights, BINS)
    groups = blocks_of(len(parts))
    found = _probit(*counted.sum(axis=0))
    left_out = np.array([_probit(*counted[groups != group].sum(axis=0)) for group in range(BLOCKS)])
    samples = int(void.sum())
    errors = [jackknifed(column) for column in left_out.T]
    least = Figure.within(LAW[0], float(found[0]), errors[0], samples, "void pixels").exponential
    spread = Figure.within(LAW[1], float(found[1]), errors[1], samples, "void pixels").exponential
    middle = counted.sum(axis=0)[2] / np.maximum(counted.sum(axis=0)[0], 1)
    thresholds = (found[0] - middle) / np.exp(found[1])  # of the normal number below which a pixel is void
    return [least, spread, *_clumps(parts, masks, bins, thresholds)]


def _probit(count: Float64, void: Float64, light: Float64) -> Float64:
    """Return the logarithms of the least light and of reflectance's spread. count, void, light: sums (BINS,)."""
    seen = count > 0
    count, void, light = count[seen], void[seen], light[seen] / count[seen]
    normal = NormalDist()
    whole = float(np.clip(void.sum() / count.sum(), 1e-6, 1 - 1e-6))
    steep, level = 0.0, normal.inv_cdf(whole)
    limits = -1 / SPREAD[0], -1 / SPREAD[1]
    for _ in range(40):
        at = np.clip(level + steep * light, -6, 6)
        share = np.array([normal.cdf(each) for each in at])
        density = np.exp(-at * at / 2) / np.sqrt(2 * np.pi)
        weight = count * density**2 / np.maximum(share * (1 - share), 1e-12)
        aim = at + (void / count - share) / np.maximum(density, 1e-9)
        terms = np.stack([np.ones_like(light), light], axis=1) * np.sqrt(weight)[:, None]
        level, steep = np.linalg.lstsq(terms, aim * np.sqrt(weight), rcond=None)[0]
        if not limits[0] <= steep <= limits[1]:
            steep = float(np.clip(steep, *limits))
            level = float(np.sum(weight * (aim - steep * light)) / np.sum(weight))
    return np.array([-level / steep, np.log(-1 / steep)])


def _clumps(
    parts: Sequence[_Part], masks: Sequence[NDArray[np.bool_]], bins: Sequence[NDArray[np.int64]], thresholds: Float64
) -> Sequence[Figure]:
    """Return how large clumps are in pixels, and for how many frames they stay, by pairs that are both void."""
    likeness = _Likeness.of(thresholds)
    pairs = [_pairs_within(part, mask, place) for part, mask, place in zip(parts, masks, bins, strict=True)]
    groups = blocks_of(len(parts))
    both, of = (
        np.array([each[0] for each in pairs]),
        np.array([each[1] for each in pairs]),
    )  # (n, lags), (n, lags, BINS, BINS)

    def size(kept: NDArray[np.bool_]) -> float:
        alike = [
            likeness.correlation(one, other)
            for one, other in zip(both[kept].sum(axis=0), of[kept].sum(axis=0), strict=True)
        ]
        return _reach(np.array(LAGS_PX, np.float64), np.array(alike))

    value = size(groups >= 0)
    error = jackknifed(np.array([size(groups != group) for group in range(BLOCKS)]))
    samples = int(sum(part.void[mask].sum() for part, mask in zip(parts, masks, strict=True)))
    wide = Figure.within(LAW[2], value, error, samples, "void pixels")
    later = [
        _counted(place, place, mask, part.void, part.void_after)
        for part, mask, place in zip(parts, masks, bins, strict=True)
        if part.void_after is not None
    ]
    if not later:
        return wide, Figure.none(LAW[3], "frames after one another are equal, or have no depth")

    def stay(kept: Sequence[int]) -> float:
        alike = likeness.correlation(sum(later[at][0] for at in kept), np.sum([later[at][1] for at in kept], axis=0))
        return float(-np.log(max(1 - alike, 1 / MOST_FRAMES)))

    of_block = blocks_of(len(later))
    left_out = [stay([at for at in range(len(later)) if of_block[at] != group]) for group in range(BLOCKS)]
    return wide, Figure.within(
        LAW[3], stay(range(len(later))), jackknifed(np.array(left_out)), samples, "void pixels"
    ).exponential


def _pairs_within(part: _Part, mask: NDArray[np.bool_], place: NDArray[np.int64]) -> tuple[list[float], list[Float64]]:
    both: list[float] = []
    of: list[Float64] = []
    for lag in (each // STEP_PX for each in LAGS_PX):
        here, there = (slice(None), slice(None, -lag)), (slice(None), slice(lag, None))
        count, histogram = _counted(
            place[here], place[there], mask[here] & mask[there], part.void[here], part.void[there]
        )
        both.append(count)
        of.append(histogram)
    return both, of


def _counted(
    one: NDArray[np.int64],
    other: NDArray[np.int64],
    seen: NDArray[np.bool_],
    void: NDArray[np.bool_],
    also: NDArray[np.bool_],
) -> tuple[float, Float64]:
    """Return how many pairs of pixels are both void, and how many (BINS, BINS) there are of each two bins of light."""
    pairs = np.bincount((one * BINS + other)[seen], minlength=BINS * BINS).reshape(BINS, BINS)
    return float((void & also & seen).sum()), pairs.astype(np.float64)


@cache
def _correlations() -> Float64:
    return np.linspace(0, 0.995, 200)


@dataclass(frozen=True)
class _Likeness:
    """How often two normal numbers are both below their thresholds, by their correlation.

    below: (BINS,) how often one is. density: (correlations, BINS^2), their common density at each two thresholds, which
    is the derivative of that by the correlation (Plackett, 1954).
    """

    below: Float64
    density: Float64

    @classmethod
    def of(cls, thresholds: Float64) -> "_Likeness":
        normal = NormalDist()
        below = np.array([normal.cdf(float(each)) for each in np.clip(thresholds, -7, 7)])
        one, other = (each.ravel() for each in np.meshgrid(thresholds, thresholds, indexing="ij"))
        tried = _correlations()[:, None]
        square = 1 - tried**2
        exponents = -(one**2 - 2 * tried * one * other + other**2) / (2 * square)
        return cls(below, np.exp(exponents) / (2 * np.pi * np.sqrt(square)))

    def correlation(self, both: float, pairs: Float64) -> float:
        """Return the correlation by which `both` of the pairs (BINS, BINS) are below their thresholds."""
        if pairs.sum() <= 0:
            return 0.0
        tried, density = _correlations(), self.density @ pairs.ravel()
        steps = (density[1:] + density[:-1]) / 2 * np.diff(tried)
        expected = float(self.below @ pairs @ self.below) + np.concatenate([[0.0], np.cumsum(steps)])
        return float(np.interp(both, expected, tried))


def _reach(lags_px: Float64, alike: Float64) -> float:
    """Return the distance at which exp(-(lag / px)^2) fits correlations best; 0 where neighbours hardly have any."""
    if alike[0] < 0.05:
        return 0.0
    tried = np.geomspace(1, 150, 300)
    misfit = ((np.exp(-((lags_px[None, :] / tried[:, None]) ** 2)) - alike) ** 2).sum(axis=1)
    return float(tried[int(np.argmin(misfit))])


# --- curves ---


def _curves(parts: Sequence[_Part]) -> Sequence[Figure]:
    made: list[Figure] = []
    kept = [part.inside & ~part.beside for part in parts]
    for name, limits, values in (
        ("holes_at_{:.0f}_deg", ANGLES_DEG, [np.degrees(np.arccos(part.cosine)) for part in parts]),
        ("holes_at_{:.2f}_m", DISTANCES_M, [part.depth_m for part in parts]),
        ("holes_at_grey_{:.0f}", GREYS, [part.grey for part in parts]),
        ("holes_at_contrast_{:.1f}", CONTRASTS, [part.contrast for part in parts]),
    ):
        curve = name.split("_{")[0]
        curve = {"holes_at": "holes_at_deg" if "deg" in name else "holes_at_m"}.get(curve, curve)
        for low, high in pairwise(limits):
            rows = np.zeros((len(parts), 2))
            for row, part, mask, value in zip(rows, parts, kept, values, strict=True):
                here = mask & (value >= low) & (value < high)
                row[:] = here.sum(), (part.void & here).sum()
            count, void = rows.sum(axis=0)
            if count < LEAST_PIXELS:
                continue
            groups = blocks_of(len(parts))
            left = [rows[groups != group].sum(axis=0) for group in range(BLOCKS)]
            error = jackknifed(np.array([each[1] / max(each[0], 1) for each in left]))
            at = (low + min(high, 2 * low + 20)) / 2
            made.append(Figure.within(name.format(at), float(void / count), error, int(count), "pixels").on(curve, at))
    return made
