# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise of depth from frames alone: its deviation by distance and incidence, steps, and correlation in space and time.

What is left of planes in inverse depth, in which they are linear, over small blocks. Of a camera that moves it is what
two frames have not in common there: a surface's own relief is in both, and noise in one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics
from .depth_blocks import LEAST_BLOCKS, SIDE, DepthBlocks, Other, Registered, blocks_in
from .depth_holes import HoleFrame, depth_holes
from .figure import BLOCKS, Figure, blocks_of, jackknifed
from .footage import Float32, Float64, RecordingView

# Chosen, as all below.
WIDE_SIDES = 24, 12  # of blocks in pixels, for correlation: smaller ones where holes leave few; SIDE for the deviation
DISTANCES_M = (0.3, 0.5, 0.8, 1.1, 1.4, 1.7, 2.0, 2.5, 3.0, 3.6, 4.5, 6.0, 8.0, 12.0)
MOST_BLOCKS = 1200  # of a frame, that are looked for in another
REPEATED = (
    0.35  # times the noise's variance: blocks that two frames have more in common, or are as much against, count not
)
OUTLIER = 4.0  # times the noise's variance: a wide block of more is an edge
LEAST_SHARE = 0.5  # of the frames, that have another one from which relief is told
LEAST_TOLD = 0.9  # of the deviation, that changes from frame to frame, where relief is not told from noise
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
LEAST_CORRELATION = 0.05  # less at all lags is noise of independent pixels
FARTHEST_PX = 40.0
ROUNDS, SAME = 5, 0.003  # in which what planes take is found, and a change of it that is none
ANGLES_DEG = (0, 20, 40, 50, 60, 65, 70, 75, 80)
OFTEN = 8  # pixels that have a value, before it counts for the steps
CURVE, BY_LAG, BY_ANGLE = "depth_noise_m", "depth_correlation", "depth_noise_over_head_on"
SHIFT = "depth_shift_px"
LAW = ("depth_noise_offset_m", "depth_noise_quadratic_per_m")
HEAD_ON = ("depth_noise_head_on_offset_m", "depth_noise_head_on_quadratic_per_m")
LAWS = (*LAW, *HEAD_ON)


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


def depth_noise(footage: RecordingView, frames: Sequence[int], registered: Registered | None = None) -> DepthNoise:
    """Return the noise of depth in some frames, and of the ones after them. Raises InputError for a damaged file.

    registered: by which the same surfaces are found in other frames; None for surfaces without relief.
    """
    planes: list[Planes] = []
    told_by: list[_Seen] = []
    seen: list[HoleFrame] = []
    for frame in frames:
        look = footage.look(frame)
        if look.depth_m is None:
            continue
        after = footage.look(frame + 1).depth_m if frame + 1 < len(footage) else None
        fresh = after if after is not None and not np.array_equal(look.depth_m, after) else None
        small = blocks_in(look.depth_m, SIDE)
        other = None if registered is None else registered.other(frame, small)
        planes.append(_planes(small, other, registered))
        told_by.append(_Seen(frame, look.depth_m, fresh, other))
        seen.append(HoleFrame(look.depth_m, look.grey, None if fresh is None else fresh <= 0))
    apart = np.mean([each.apart for each in planes]) >= LEAST_SHARE if planes else False
    changing = _by_distance([each for each in planes if each.compared])[0]
    told = _told_share(planes)
    planes = [each for each in planes if each.apart] if apart else [each.with_relief for each in planes]
    wide = _wide(told_by, registered, apart=bool(apart))
    planes = _even(planes)
    curve, law = _by_distance(planes)
    steps = _steps([each.depth_m for each in seen])
    sideways = _sideways(planes, footage.camera, steps[1].value or 0.0)
    correlation = _correlations(wide)
    if registered is not None and not apart:
        least = [figure.value / z**2 for z, figure in changing if figure.value is not None]
        curve = tuple((z, _at_most(figure, min(least, default=0.0) * z**2)) for z, figure in curve)
        law, sideways = (
            tuple(_at_most(each, told * (each.value or 0.0)) if each.name in LAWS else each for each in figures)
            for figures in (law, sideways)
        )
        if told < LEAST_TOLD:
            why = "the camera hardly moves, so that a surface's relief is not told from noise that stays"
            correlation = tuple(Figure.none(figure.name, why) for figure in correlation)
    return DepthNoise(curve, law, sideways, steps, correlation, depth_holes(seen, footage.camera))


@dataclass(frozen=True)
class Planes:
    """Blocks of a frame's depth.

    z: (N,) metres in the middle. spread: (N,) deviation of noise in metres. repeated: (N,) mean product of what planes
    leave in both frames, square metres. slope: (N, 2), change of inverse depth a pixel across and down. bend: (N,),
    second differences of the neighbours' means in metres; infinite without neighbours. which: (N,) blocks by number.
    whole: (N,) deviation with relief. compared: whether spread is of two frames. apart: whether so relief is told from
    noise.
    """

    z: Float64
    spread: Float64
    repeated: Float64
    slope: Float64
    bend: Float64
    which: NDArray[np.int64]
    whole: Float64
    compared: bool
    apart: bool

    @property
    def with_relief(self) -> "Planes":
        """These, of one frame alone."""
        return replace(self, spread=self.whole, repeated=0 * self.whole)

    def taken(self, rows: NDArray[np.bool_]) -> "Planes":
        """Return some of them."""
        named = {
            each.name: getattr(self, each.name)[rows] for each in fields(self) if each.name not in ("compared", "apart")
        }
        return replace(self, **named)


def _planes(blocks: DepthBlocks, other: Other | None, registered: Registered | None) -> Planes:
    freedom = SIDE * SIDE - 3
    if other is None or registered is None:
        whole = np.sqrt((blocks.left**2).sum(axis=1) / freedom) * blocks.z**2
        bend = blocks.bend * blocks.z**2
        return Planes(blocks.z, whole, 0 * whole, blocks.slope, bend, blocks.which, whole, compared=False, apart=False)
    thin = blocks.taken(np.arange(0, len(blocks), len(blocks) // MOST_BLOCKS + 1))
    there = registered.again(thin, other)
    here = thin.taken(there.rows)
    square = here.z**4
    apart = np.sqrt(((here.left - there.left) ** 2).sum(axis=1) / (2 * freedom) * square)
    repeated = (here.left * there.left).sum(axis=1) / freedom * square
    whole = np.sqrt((here.left**2).sum(axis=1) / freedom * square)
    # Of noise that grows with the square of the distance, between both.
    z = ((square + there.z**4) / 2) ** 0.25
    return Planes(
        z, apart, repeated, here.slope, here.bend * here.z**2, here.which, whole, compared=True, apart=other.enough
    )


def _told_share(planes: Sequence[Planes]) -> float:
    """Return which share of the deviation changes from frame to frame."""
    both = [np.column_stack([each.spread, each.whole]) for each in planes if each.compared]
    if not both:
        return 0.0
    spread, whole = np.concatenate(both).T
    return float(min(np.median(spread) / max(np.median(whole), 1e-12), 1.0))


def _at_most(figure: Figure, least: float) -> Figure:
    """Return a figure that is so only if surfaces have no relief: at least so much of it is noise."""
    return figure if figure.low is None else replace(figure, low=min(figure.low, least))


def _even(planes: Sequence[Planes]) -> list[Planes]:
    """Return the blocks that do not bend, by their neighbours, so that their own noise does not choose them; and of
    these such as two frames have little in common.

    At distances where these are too few, more are returned. Two planes that meet in a block leave a tenth of the bend.
    """
    if not planes:
        return []
    names = ("z", "spread", "bend", "repeated")
    z, spread, bend, repeated = (np.concatenate([getattr(each, name) for each in planes]) for name in names)
    kept = np.ones(len(z), np.bool_)
    for low, high in pairwise(DISTANCES_M):
        here = np.flatnonzero((z >= low) & (z < high))
        if not len(here):
            continue
        found = here
        for _ in range(2):
            found = _or_all(found, here[bend[here] < 10 * LEAST_BEND * np.median(spread[found])])
        found = _or_all(found, found[np.abs(repeated[found]) < REPEATED * np.median(spread[found]) ** 2])
        kept[here] = False
        kept[found] = True
    parts = np.split(kept, np.cumsum([len(each.z) for each in planes])[:-1])
    return [each.taken(part) for each, part in zip(planes, parts, strict=True)]


def _or_all(rows: NDArray[np.intp], fewer: NDArray[np.intp]) -> NDArray[np.intp]:
    return fewer if len(fewer) >= LEAST_BLOCKS else rows


def _by_distance(planes: Sequence[Planes]) -> tuple[tuple[tuple[float, Figure], ...], tuple[Figure, ...]]:
    whole_z, whole_s = (
        np.concatenate([getattr(each, name) for each in planes]) if planes else np.zeros(0) for name in ("z", "spread")
    )
    groups = np.repeat(blocks_of(len(planes)), [len(each.z) for each in planes])
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
        return tuple(curve), tuple(Figure.none(name, "planes are seen at too few distances") for name in LAW)
    z, sigma, weight = (np.array([row[place] for row in rows]) for place in range(3))
    fitted = _law(z, sigma, weight)
    left_out = np.array([_law(z, np.array([row[3][group] for row in rows]), weight) for group in range(BLOCKS)])
    law = [
        Figure.within(name, float(fitted[place]), jackknifed(left_out[:, place]), len(rows), "distances")
        for place, name in enumerate(LAW)
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
    names = ("z", "spread", "slope", "bend")
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


@dataclass(frozen=True)
class Wide:
    """Wide blocks of a frame. sums: (N, 5), products by lag, of means of 4 x 4 pixels, and of pixels. time: (N, 3),
    products of both frames after one another, of the one and of the other; NaN where there are none.
    spread, repeated: (N,) as Planes has them, of inverse depth. plain, plain_time: sums and time of one frame alone.
    """

    side: int
    sums: Float64
    time: Float64
    spread: Float64
    repeated: Float64
    plain: Float64
    plain_time: Float64
    apart: bool

    @property
    def with_relief(self) -> "Wide":
        """These, of one frame alone."""
        whole = np.sqrt(self.plain[:, -1])
        return replace(self, sums=self.plain, time=self.plain_time, spread=whole, repeated=0 * whole)


@dataclass(frozen=True)
class _Seen:
    """A frame, its depth and that of the one after, and another frame of the same surfaces."""

    frame: int
    depth_m: Float32
    after_m: Float32 | None
    other: Other | None


def _wide(seen: Sequence[_Seen], registered: Registered | None, *, apart: bool) -> list[Wide]:
    """Return frames' wide blocks, of the largest side of which there are enough. apart: as `Planes` has it."""
    found: list[Wide] = []
    for side in WIDE_SIDES:
        found = [_wide_of(each, registered, side) for each in seen]
        found = [each for each in found if each.apart] if apart else [each.with_relief for each in found]
        if sum(len(each.spread) for each in found) >= LEAST_BLOCKS:
            break
    return found


def _wide_of(seen: _Seen, registered: Registered | None, side: int) -> Wide:
    """Return what of wide blocks tells how pixels' noise goes together.

    Products are of what planes leave here and what is left of that without the other frame's: noise of that is another.
    """
    other = seen.other
    apart = other is not None and other.enough
    here, noise, spread, repeated = _left(blocks_in(seen.depth_m, side), other, registered)
    plain, sums = _sums(here.left, here.left, side), _sums(here.left, noise, side)
    times = [np.full((len(here), 3), np.nan) for _ in range(2)]
    if seen.after_m is not None:
        if other is not None and registered is not None:
            other = registered.after(seen.frame, blocks_in(seen.after_m, SIDE), other)
        later, later_noise, _, _ = _left(blocks_in(seen.after_m, side), other, registered)
        _, one, two = np.intersect1d(here.which, later.which, return_indices=True)
        for time, other_noise, own in ((times[0], later_noise, noise), (times[1], later.left, here.left)):
            time[one, 0] = (here.left[one] * other_noise[two]).mean(axis=1)
            time[one, 1] = (here.left[one] * own[one]).mean(axis=1)
            time[one, 2] = (later.left[two] * other_noise[two]).mean(axis=1)
    return Wide(side, sums, times[0], spread, repeated, plain, times[1], apart)


def _left(
    blocks: DepthBlocks, other: Other | None, registered: Registered | None
) -> tuple[DepthBlocks, Float32, Float64, Float64]:
    """Return blocks, what is left of them without what another frame has there, its deviation, and what is in both."""
    if other is None or registered is None:
        whole = np.sqrt((blocks.left**2).mean(axis=1, dtype=np.float64))
        return blocks, blocks.left, whole, 0 * whole
    there = registered.again(blocks, other)
    here = blocks.taken(there.rows)
    noise = here.left - there.left
    spread = np.sqrt((noise**2).mean(axis=1, dtype=np.float64) / 2)
    return here, noise, spread, (here.left * there.left).mean(axis=1, dtype=np.float64)


def _sums(left: Float32, noise: Float32, side: int) -> Float64:
    """Return (N, 5), as Wide has them, of two (N, pixels)."""
    one, other = (each.reshape(-1, side, side) for each in (left, noise))
    lags = [
        ((one[:, :, lag:] * other[:, :, :-lag]) + (one[:, :, :-lag] * other[:, :, lag:])).mean(axis=(1, 2)) / 2
        for lag in LAGS_PX
    ]
    means = [each.reshape(-1, side // 4, 4, side // 4, 4).mean(axis=(2, 4)) for each in (one, other)]
    products = [*lags, (means[0] * means[1]).mean(axis=(1, 2)), (one * other).mean(axis=(1, 2))]
    return np.stack(products, axis=1).astype(np.float64)


def _correlations(wide: Sequence[Wide]) -> tuple[Figure, ...]:
    names = [
        *(f"depth_correlation_{lag}_px" for lag in LAGS_PX),
        "depth_4x4_mean_over_pixel_std",
        "depth_correlation_1_frame",
    ]
    if sum(len(each.spread) for each in wide) < LEAST_BLOCKS:
        return tuple(Figure.none(name, "too few planes are seen") for name in names)
    parts = ("sums", "time", "spread", "repeated")
    sums, time, spread, repeated = (np.concatenate([getattr(each, name) for each in wide]) for name in parts)
    groups = np.repeat(blocks_of(len(wide)), [len(each.spread) for each in wide])
    if repeated.any():
        # Relief is taken out already: only edges are left out, and what of the noise is in both.
        usual = np.median(spread) ** 2
        inner = np.flatnonzero(spread**2 < OUTLIER * usual)
        found = _or_all(inner, inner[np.abs(repeated[inner]) < REPEATED * usual])
        flat = np.isin(np.arange(len(spread)), found)
    else:
        flat = spread < np.quantile(spread, FLATTEST)

    def values(chosen: NDArray[np.bool_]) -> Float64:
        total = sums[chosen].sum(axis=0)
        lags = total[: len(LAGS_PX)] / max(total[-1], 1e-18)
        shared, taken = _taken_by_planes(lags, wide[0].side)
        lags = lags * (1 - taken) + taken
        means = max(total[-2] / max(total[-1], 1e-18) * (1 - taken) + taken, 0.0)
        both = chosen & np.isfinite(time[:, 0])
        product, one, other = time[both].sum(axis=0) if both.any() else (np.nan, 1.0, 1.0)
        later = product / np.sqrt(max(one * other, 1e-36))
        # Planes take of what is shared alone, and only that stays.
        later *= (1 - taken) / (1 - taken / shared) if taken > 0 else 1.0
        return np.array([*lags, np.sqrt(means), later])

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


def _taken_by_planes(correlations: Float64, side: int) -> tuple[float, float]:
    """Return the share of noise's variance that is shared, and that which planes take with them, by what they left.

    correlations: at LAGS_PX, of what planes left.
    """
    taken, share = 0.0, 0.0
    for _ in range(ROUNDS):
        px, share = shared_by(LAGS_PX, correlations * (1 - taken) + taken)
        before, taken = taken, share * (1 - left_share(side, round(4 * px) / 4)) if px > 0 else 0.0
        if abs(before - taken) < SAME:
            break
    return share, taken


def shared_by(lags_px: Sequence[float], correlations: Sequence[float] | Float64) -> tuple[float, float]:
    """Return the distance in pixels at which noise is correlated by 1 / e, and which share of its variance is so.

    0, 0 where pixels have their own.
    """
    if max(correlations) < LEAST_CORRELATION:
        return 0.0, 0.0
    distance, measured = np.asarray(lags_px, np.float64), np.asarray(correlations, np.float64)
    tried = np.geomspace(0.7, FARTHEST_PX, 200)
    shapes = np.exp(-((distance[None, :] / tried[:, None]) ** 2))
    shares = np.clip((shapes @ measured) / (shapes**2).sum(axis=1), 0, 1)
    best = int(np.argmin(((shares[:, None] * shapes - measured) ** 2).sum(axis=1)))
    return float(tried[best]), float(shares[best])


@cache
def left_share(side: int, px: float) -> float:
    """Return the share of shared noise's variance that planes leave of blocks, over that of independent pixels."""
    if px <= 0:
        return 1.0
    # A Gaussian is one of the columns times one of the rows, and so are a plane's terms.
    at = np.arange(side) - (side - 1) / 2
    along = np.exp(-((at[:, None] - at) ** 2) / px**2)
    flat, slope = np.full(side, side**-0.5), at / np.sqrt(np.sum(at**2))
    level, tilt = flat @ along @ flat, slope @ along @ slope
    return float((side * side - level * level - 2 * level * tilt) / (side * side - 3))


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
