# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise of depth from frames alone: its deviation by distance and incidence, steps, and correlation in space and time.

What is left of planes in inverse depth, in which they are linear, over small blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics
from .depth_holes import HoleFrame, depth_holes
from .figure import BLOCKS, Figure, blocks_of, jackknifed
from .footage import Float32, Float64, RecordingView

# Chosen, as all below.
SIDE, WIDE_SIDE = 9, 24  # of blocks in pixels: for the deviation, and for correlation
EDGE = 0.15  # times its distance: a block that spans more is an edge
DISTANCES_M = (0.3, 0.5, 0.8, 1.1, 1.4, 1.7, 2.0, 2.5, 3.0, 3.6, 4.5, 6.0, 8.0, 12.0)
LEAST_BLOCKS = 40
LEAST_BEND, LEAST_BEND_OF_SLOPES = 0.6, 0.25  # times the noise: what blocks may leave that bend
BENDS = 0.02  # relative error of a deviation by what is no plane, found on known noise
FLATTEST = 0.4  # share of the wide blocks that is taken for planes
LAGS_PX = (1, 2, 4)
QUIET = 0.3  # quantile of blocks' deviations by slope: surfaces that bend are above
# That quantile of independent pixels' deviations over the mean (of chi, by its normal limit).
QUIETER = 1 - 0.5244 / (2 * (SIDE * SIDE - 3)) ** 0.5
TOLD_SHIFT_PX, TOLD_PART = 0.5, 0.1  # a shift that has to change variance by such a part, from slope to slope
SLOPES = 6  # groups of slopes at a distance
ACROSS_STEPS = 1.5  # steps of depth's numbers that a block has to span: on fewer, rounding hides noise
ANGLES_DEG = (0, 20, 40, 50, 60, 65, 70, 75, 80)
OFTEN = 8  # pixels that have a value, before it counts for the steps
CURVE, BY_LAG, BY_ANGLE = "depth_noise_m", "depth_correlation", "depth_noise_over_head_on"
SHIFT = "depth_shift_px"
HEAD_ON = ("depth_noise_head_on_offset_m", "depth_noise_head_on_quadratic_per_m")


@dataclass(frozen=True)
class DepthNoise:
    """What was measured of depth. curve: (distance in metres, deviation in metres), a figure for each.

    law: offset in metres and what a square metre adds, by deviation = offset + quadratic z^2. sideways: by how many
    pixels the place deviates that a pixel shows, which roughens what is seen at an angle (`depth_shift_px`), the law
    without that (`depth_noise_head_on_...`), and how often the deviation is that law's at an incidence
    (`depth_noise_over_head_on_at_N_deg`). steps: of the numbers: constant in metres, or in inverse metres. correlation:
    at LAGS_PX, deviation of 4 x 4 means over the pixels', and from frame to frame. holes: as `depth_holes` has them.
    """

    curve: tuple[tuple[float, Figure], ...]
    law: tuple[Figure, ...]
    sideways: tuple[Figure, ...]
    steps: tuple[Figure, ...]
    correlation: tuple[Figure, ...]
    holes: tuple[Figure, ...]

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All of them."""
        curve = (figure for _, figure in self.curve)
        return (*self.law, *curve, *self.sideways, *self.steps, *self.correlation, *self.holes)


def depth_noise(footage: RecordingView, frames: Sequence[int]) -> DepthNoise:
    """Return the noise of depth in some frames, and of the ones after them. Raises InputError for a damaged file."""
    planes: list[Planes] = []
    wide: list[tuple[Float64, Float64, Float64]] = []
    seen: list[HoleFrame] = []
    for frame in frames:
        look = footage.look(frame)
        if look.depth_m is None:
            continue
        found = _planes(look.depth_m, SIDE)
        planes.append(replace(found, left=np.sqrt((found.left**2).sum(axis=(1, 2)) / (SIDE * SIDE - 3))))
        after = footage.look(frame + 1).depth_m if frame + 1 < len(footage) else None
        fresh = after is not None and not np.array_equal(look.depth_m, after)
        wide.append(_wide(look.depth_m, after if fresh else None))
        seen.append(HoleFrame(look.depth_m, look.grey, after <= 0 if after is not None and fresh else None))
    planes = _flat(planes)
    curve, law = _by_distance([each.z for each in planes], [each.left for each in planes])
    steps = _steps([each.depth_m for each in seen])
    sideways = _sideways(planes, footage.camera, steps[1].value or 0.0)
    return DepthNoise(curve, law, sideways, steps, _correlations(wide), depth_holes(seen, footage.camera))


@dataclass(frozen=True)
class Planes:
    """Blocks of depth without void or edge.

    z: (N,) metres in the middle. left: (N, side, side), what planes leave in metres, to the first order. slope: (N, 2),
    change of inverse depth a pixel across and down. bend: (N,), second differences of the neighbours' means in metres;
    infinite without neighbours. which: (N,) blocks by number.
    """

    z: Float64
    left: Float64
    slope: Float64
    bend: Float64
    which: NDArray[np.int64]


@cache
def _left_of_plane(side: int) -> tuple[Float64, Float64]:
    """Return the projections onto what a plane leaves of a block (side^2, side^2), and onto the plane (3, side^2)."""
    v, u = np.mgrid[:side, :side] - (side - 1) / 2
    terms = np.stack([np.ones(u.size), u.ravel(), v.ravel()], axis=1)
    inverse = np.linalg.pinv(terms)
    return np.eye(side * side) - terms @ inverse, inverse


def _planes(depth_m: Float32, side: int) -> Planes:
    high, wide = depth_m.shape[0] // side, depth_m.shape[1] // side
    cut = depth_m[: high * side, : wide * side].reshape(high, side, wide, side).swapaxes(1, 2).reshape(-1, side * side)
    lowest, highest = cut.min(axis=1), cut.max(axis=1)
    whole = np.flatnonzero((lowest > 0) & (highest - lowest < EDGE * highest))
    per_m = 1 / cut[whole].astype(np.float64)
    left, plane = _left_of_plane(side)
    middle, *slope = plane @ per_m.T
    z = 1 / middle
    inner = np.full(high * wide, np.inf)
    inner[whole] = middle
    means = np.pad(inner.reshape(high, wide), 1, constant_values=np.inf)
    around = means[1:-1, 2:] + means[1:-1, :-2], means[2:, 1:-1] + means[:-2, 1:-1]
    bends = [each.reshape(-1)[whole] - 2 * middle for each in around]
    residual = (-(per_m @ left) * (z**2)[:, None]).reshape(-1, side, side)
    return Planes(z, residual, np.stack(slope, axis=1), np.hypot(*bends) * z**2, whole)


def _flat(planes: Sequence[Planes]) -> list[Planes]:
    """Return the blocks that do not bend, by their neighbours, so that their own noise does not choose them.

    At distances where these are too few, all are returned. Two planes that meet in a block leave a tenth of the bend.
    """
    if not planes:
        return []
    z, spread, bend = (np.concatenate([getattr(each, name) for each in planes]) for name in ("z", "left", "bend"))
    kept = np.ones(len(z), np.bool_)
    for low, high in pairwise(DISTANCES_M):
        here = np.flatnonzero((z >= low) & (z < high))
        flat = here[bend[here] < 10 * LEAST_BEND * np.median(spread[here])] if len(here) else here
        if len(flat) >= LEAST_BLOCKS:
            flat = here[bend[here] < 10 * LEAST_BEND * np.median(spread[flat])]
        if len(flat) >= LEAST_BLOCKS:
            kept[here] = False
            kept[flat] = True
    parts = np.split(kept, np.cumsum([len(each.z) for each in planes])[:-1])
    return [
        Planes(*(getattr(each, field.name)[part] for field in fields(Planes)))
        for each, part in zip(planes, parts, strict=True)
    ]


def _by_distance(
    distance: list[Float64], spread: list[Float64]
) -> tuple[tuple[tuple[float, Figure], ...], tuple[Figure, ...]]:
    names = ("depth_noise_offset_m", "depth_noise_quadratic_per_m")
    whole_z, whole_s = (np.concatenate(parts) if parts else np.zeros(0) for parts in (distance, spread))
    groups = np.concatenate(
        [np.full(len(part), blocks_of(len(distance))[at]) for at, part in enumerate(distance)] or [[]]
    )
    curve: list[tuple[float, Figure]] = []
    rows: list[tuple[float, float, float, Float64]] = []
    for low, high in pairwise(DISTANCES_M):
        here = (whole_z >= low) & (whole_z < high)
        if here.sum() < LEAST_BLOCKS:
            continue
        z, sigma = float(np.median(whole_z[here])), float(np.median(whole_s[here]))
        parts = [whole_s[here & (groups != group)] for group in range(BLOCKS)]
        left_out = np.array([np.median(part) if len(part) else sigma for part in parts])
        count = int(here.sum())
        error = float(np.hypot(jackknifed(left_out), BENDS * sigma))
        figure = Figure.within(f"{CURVE}_at_{z:.2f}_m", sigma, error, count, "blocks")
        curve.append((z, figure.on(CURVE, z)))
        rows.append((z, sigma, count**0.5, left_out))
    if len(rows) < 2:
        return tuple(curve), tuple(Figure.none(name, "planes are seen at too few distances") for name in names)
    z, sigma, weight = (np.array([row[place] for row in rows]) for place in range(3))
    fitted = _law(z, sigma, weight)
    left_out = np.array([_law(z, np.array([row[3][group] for row in rows]), weight) for group in range(BLOCKS)])
    law = [
        Figure.within(name, float(fitted[place]), jackknifed(left_out[:, place]), len(rows), "distances")
        for place, name in enumerate(names)
    ]
    return tuple(curve), tuple(law)


def _law(z: Float64, sigma: Float64, weight: Float64) -> Float64:
    scaled = weight / np.maximum(sigma, 1e-9)
    terms = np.stack([np.ones_like(z), z**2], axis=1)
    offset, quadratic = np.linalg.lstsq(terms * scaled[:, None], sigma * scaled, rcond=None)[0]
    if offset < 0:
        return np.array([0.0, np.sum(scaled**2 * sigma * z**2) / np.sum(scaled**2 * z**4)])
    if quadratic < 0:
        return np.array([np.sum(scaled**2 * sigma) / np.sum(scaled**2), 0.0])
    return np.array([offset, quadratic])


# --- what incidence adds ---


def _sideways(planes: Sequence[Planes], camera: Intrinsics, step_per_m: float) -> tuple[Figure, ...]:
    """Return the figures of `sideways`: squares of deviations are linear in those of slopes, at each distance apart."""
    counts = [len(each.z) for each in planes]
    if sum(counts) < SLOPES * LEAST_BLOCKS:
        return tuple(Figure.none(name, "too few planes are seen") for name in (SHIFT, *HEAD_ON))
    names = ("z", "left", "slope", "bend")
    z, spread, slope, bend = (np.concatenate([getattr(each, name) for each in planes]) for name in names)
    groups = np.repeat(blocks_of(len(planes)), counts)
    steep = np.hypot(*slope.T)
    told = (steep * SIDE >= ACROSS_STEPS * step_per_m) & (bend < 10 * LEAST_BEND_OF_SLOPES * _typical(z, spread))
    per_px = steep * z**2  # metres a pixel
    square, rows = _shift(z[told], spread[told], per_px[told])
    if rows < 1:
        why = "surfaces are seen at too few angles for their noise"
        return tuple(Figure.none(name, why) for name in (SHIFT, *HEAD_ON))
    kept = [groups != group for group in range(BLOCKS)]
    squares = [_shift(z[told & each], spread[told & each], per_px[told & each])[0] for each in kept]
    error = float(np.hypot(jackknifed(np.array(squares)), 2 * BENDS * square))
    within = Figure.within(SHIFT, square, error, int(told.sum()), "blocks")
    low, high = (None if each is None else max(each, 0.0) ** 0.5 for each in (within.low, within.high))
    shift = replace(within, value=max(square, 0.0) ** 0.5, low=low, high=high)
    law = _head_on(z, spread, per_px, square)
    laws = np.array([_head_on(z[at], spread[at], per_px[at], each) for at, each in zip(kept, squares, strict=True)])
    if not np.isfinite(law).all():
        none = [Figure.none(name, "planes are seen at too few distances") for name in HEAD_ON]
        return shift, *none
    errors = [float(np.hypot(jackknifed(column), BENDS * value)) for column, value in zip(laws.T, law, strict=True)]
    figures = [
        Figure.within(name, float(value), error, len(z), "blocks")
        for name, value, error in zip(HEAD_ON, law, errors, strict=True)
    ]
    over = spread / np.maximum(law[0] + law[1] * z**2, 1e-9)
    return shift, *figures, *_by_angle(planes, over, groups, camera)


def _shift(z: Float64, spread: Float64, per_px: Float64) -> tuple[float, int]:
    """Return the square of the shift in pixels, and how many distances tell it; 0, 0 where none does."""
    found: list[float] = []
    for low, high in pairwise(DISTANCES_M):
        here = np.flatnonzero((z >= low) & (z < high))
        if len(here) < SLOPES * LEAST_BLOCKS:
            continue
        # In inverse depth, in which a plane has one slope: what grows with the distance is none of the shift's.
        slopes, per_m = per_px[here] / z[here] ** 2, spread[here] / z[here] ** 2
        parts = np.array_split(np.argsort(slopes), SLOPES)
        x = np.array([float(np.median(slopes[part] ** 2)) for part in parts])
        y = np.array([(float(np.quantile(per_m[part], QUIET)) / QUIETER) ** 2 for part in parts])
        if np.ptp(x) * TOLD_SHIFT_PX**2 < TOLD_PART * np.median(y):
            continue
        weight = 1 / np.maximum(y, 1e-18) ** 2
        x0, y0 = np.average(x, weights=weight), np.average(y, weights=weight)
        found.append(float(np.sum(weight * (x - x0) * (y - y0)) / np.sum(weight * (x - x0) ** 2)))
    return (float(np.median(found)), len(found)) if found else (0.0, 0)


def _typical(z: Float64, spread: Float64) -> Float64:
    """Return the median deviation at the distance of each block (N,)."""
    bins = np.digitize(z, DISTANCES_M)
    typical = np.array(
        [np.median(spread[bins == at]) if (bins == at).any() else 0.0 for at in range(len(DISTANCES_M) + 1)]
    )
    return typical[bins]


def _head_on(z: Float64, spread: Float64, per_px: Float64, square: float) -> Float64:
    """Return the law's offset and quadratic (2,) without what the shift adds; NaN where distances are too few."""
    found: list[tuple[float, float, float]] = []
    for low, high in pairwise(DISTANCES_M):
        here = (z >= low) & (z < high)
        if here.sum() >= LEAST_BLOCKS:
            sigma = float(np.median(spread[here]))
            added = max(square, 0.0) * float(np.median(per_px[here] ** 2))
            found.append((float(np.median(z[here])), max(sigma**2 - added, 0.1 * sigma**2) ** 0.5, here.sum() ** 0.5))
    return _law(*np.array(found).T) if len(found) > 1 else np.full(2, np.nan)


def _by_angle(planes: Sequence[Planes], over: Float64, groups: NDArray[np.int64], camera: Intrinsics) -> list[Figure]:
    """Return how often the deviation is that of surfaces seen head on, (N,) blocks' over, at angles of incidence."""
    z, slope, which = (np.concatenate([getattr(each, name) for each in planes]) for name in ("z", "slope", "which"))
    row, column = np.divmod(which, camera.width_px // SIDE)
    x, y = (column + 0.5) * SIDE - 0.5 - camera.cx_px, (row + 0.5) * SIDE - 0.5 - camera.cy_px
    right, down = slope.T
    towards = 1 / z - x * right - y * down
    ray = np.sqrt((x / camera.fx_px) ** 2 + (y / camera.fy_px) ** 2 + 1)
    length = np.sqrt(towards**2 + (right * camera.fx_px) ** 2 + (down * camera.fy_px) ** 2) * ray
    angle_deg = np.degrees(np.arccos(np.clip(1 / z / length, 0, 1)))
    made: list[Figure] = []
    for low, high in pairwise(ANGLES_DEG):
        here = (angle_deg >= low) & (angle_deg < high)
        if here.sum() < LEAST_BLOCKS:
            continue
        value = float(np.median(over[here]))
        parts = [over[here & (groups != group)] for group in range(BLOCKS)]
        left_out = np.array([np.median(part) if len(part) else value for part in parts])
        error = float(np.hypot(jackknifed(left_out), BENDS * value))
        at = float(np.median(angle_deg[here]))
        figure = Figure.within(f"{BY_ANGLE}_at_{at:.0f}_deg", value, error, int(here.sum()), "blocks")
        made.append(figure.on(BY_ANGLE, at))
    return made


# --- correlation ---


def _wide(depth_m: Float32, after_m: Float32 | None) -> tuple[Float64, Float64, Float64]:
    """Return of wide blocks (N,) their relative spread, products by lag, of means and squares (N, 5), and in time."""
    planes = _planes(depth_m, WIDE_SIDE)
    left = planes.left
    square = (left**2).mean(axis=(1, 2))
    lags = [(left[:, :, lag:] * left[:, :, :-lag]).mean(axis=(1, 2)) for lag in LAGS_PX]
    means = left.reshape(-1, WIDE_SIDE // 4, 4, WIDE_SIDE // 4, 4).mean(axis=(2, 4))
    sums = np.stack([*lags, (means**2).mean(axis=(1, 2)), square], axis=1)
    time = np.full((len(left), 3), np.nan)
    if after_m is not None:
        later = _planes(after_m, WIDE_SIDE)
        _, here, there = np.intersect1d(planes.which, later.which, return_indices=True)
        time[here, 0] = (left[here] * later.left[there]).mean(axis=(1, 2))
        time[here, 1], time[here, 2] = square[here], (later.left[there] ** 2).mean(axis=(1, 2))
    return np.sqrt(square) / planes.z**2, sums, time


def _correlations(wide: list[tuple[Float64, Float64, Float64]]) -> tuple[Figure, ...]:
    names = [
        *(f"depth_correlation_{lag}_px" for lag in LAGS_PX),
        "depth_4x4_mean_over_pixel_std",
        "depth_correlation_1_frame",
    ]
    rough, sums, time = (
        np.concatenate([part[place] for part in wide]) if wide else np.zeros((0, 5)) for place in range(3)
    )
    if len(rough) < LEAST_BLOCKS:
        return tuple(Figure.none(name, "too few planes are seen") for name in names)
    groups = np.repeat(blocks_of(len(wide)), [len(part[0]) for part in wide])
    flat = rough < np.quantile(rough, FLATTEST)

    def values(chosen: NDArray[np.bool_]) -> Float64:
        total = sums[chosen].sum(axis=0)
        lags = total[: len(LAGS_PX)] / max(total[-1], 1e-18)
        taken = _taken_by_planes(lags)
        lags = lags * (1 - taken) + taken
        means = max(total[-2] / max(total[-1], 1e-18) * (1 - taken) + taken, 0.0)
        both = chosen & np.isfinite(time[:, 0])
        product, one, other = time[both].sum(axis=0) if both.any() else (np.nan, 1.0, 1.0)
        return np.array([*lags, np.sqrt(means), product / np.sqrt(max(one * other, 1e-36))])

    found = values(flat)
    left_out = np.array([values(flat & (groups != group)) for group in range(BLOCKS)])
    count = int(flat.sum())
    figures = [
        Figure.within(name, float(found[place]), jackknifed(left_out[:, place]), count, "blocks")
        if np.isfinite(found[place])
        else Figure.none(name, "frames after one another are equal, or show no plane alike")
        for place, name in enumerate(names)
    ]
    by_lag = [figure.on(BY_LAG, lag) for figure, lag in zip(figures, LAGS_PX, strict=False)]
    return (*by_lag, *figures[len(LAGS_PX) :])


def _taken_by_planes(correlations: Float64) -> float:
    """Return the share of correlated noise's variance that a plane takes with it, of correlations at LAGS_PX.

    A plane has three numbers, and so many independent ones a block has as areas within which noise is alike.
    """
    most = LAGS_PX[-1]
    v, u = np.mgrid[-most : most + 1, -most : most + 1]
    logarithms = np.log([1.0, *np.clip(correlations, 0.005, 1)])
    area = float(np.exp(np.interp(np.hypot(u, v), [0, *LAGS_PX], logarithms, right=-np.inf)).sum())
    return min(3 * area / WIDE_SIDE**2, 0.5)


# --- steps ---


def _steps(images: list[Float32]) -> tuple[Figure, ...]:
    """Return the steps of depth: the smallest in metres, and that of a disparity in inverse metres, if it has one."""
    names = ("depth_step_m", "depth_step_per_m")
    values = np.concatenate([image[image > 0].ravel()[::3] for image in images]) if images else np.zeros(0)
    if len(values) < 1000:
        return tuple(Figure.none(name, "there is little depth") for name in names)
    found, counts = np.unique(values, return_counts=True)
    found = found[counts >= OFTEN].astype(np.float64)
    if len(found) < 20 or len(found) > 0.3 * len(values):
        return tuple(Figure.none(name, "numbers are too fine to have steps") for name in names)
    gaps, middle = np.diff(found), (found[1:] + found[:-1]) / 2
    smallest = float(np.quantile(gaps, 0.02))
    exact = Figure(names[0], smallest, smallest, smallest, len(found), "numbers")
    # A disparity's steps grow with the square of the distance; those of numbers in metres do not.
    far = middle > np.quantile(middle, 0.5)
    per_m = gaps[far] / middle[far] ** 2
    growing = float(np.median(gaps[far])) > 1.8 * smallest
    if not growing or far.sum() < 20:
        return exact, Figure.none(names[1], "steps do not grow with the distance")
    step = float(np.median(per_m))
    error = 1.2533 * float(np.std(per_m)) / far.sum() ** 0.5
    return exact, Figure.within(names[1], step, error, int(far.sum()), "numbers")
