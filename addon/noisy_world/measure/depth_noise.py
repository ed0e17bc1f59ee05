# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise of depth from frames alone: its deviation by distance, steps, correlation in space and time, and holes.

What is left of planes in inverse depth, in which they are linear, over small blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..images.measured_depth import completed_m
from .figure import BLOCKS, Figure, blocks_of, jackknifed
from .footage import Float32, Float64, RecordingView

# Chosen, as all below.
SIDE, WIDE_SIDE = 9, 24  # of blocks in pixels: for the deviation, and for correlation
EDGE = 0.15  # times its distance: a block that spans more is an edge
DISTANCES_M = (0.3, 0.5, 0.8, 1.1, 1.4, 1.7, 2.0, 2.5, 3.0, 3.6, 4.5, 6.0, 8.0, 12.0)
LEAST_BLOCKS = 40
BENDS = 0.02  # relative error of a deviation by what is no plane, found on known noise
FLATTEST = 0.4  # share of the wide blocks that is taken for planes
LAGS_PX = (1, 2, 4)
SHADOW_PX = 13  # side of the square in which a hole is beside an edge
DARK = 40  # of 255
OFTEN = 8  # pixels that have a value, before it counts for the steps
CURVE, BY_LAG = "depth_noise_m", "depth_correlation"
BORDER = 0.9  # share of the frames in which a pixel is void that is one of the border


@dataclass(frozen=True)
class DepthNoise:
    """What was measured of depth. curve: (distance in metres, deviation in metres), a figure for each.

    law: offset in metres and what a square metre adds, by deviation = offset + quadratic z^2. steps: of the numbers:
    constant in metres, or in inverse metres. correlation: at LAGS_PX, deviation of 4 x 4 means over the pixels', and
    from frame to frame. holes: shares of pixels by what they are beside.
    """

    curve: tuple[tuple[float, Figure], ...]
    law: tuple[Figure, ...]
    steps: tuple[Figure, ...]
    correlation: tuple[Figure, ...]
    holes: tuple[Figure, ...]

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All of them."""
        return (*self.law, *(figure for _, figure in self.curve), *self.steps, *self.correlation, *self.holes)


def depth_noise(footage: RecordingView, frames: Sequence[int]) -> DepthNoise:
    """Return the noise of depth in some frames, and of the ones after them. Raises InputError for a damaged file."""
    distance: list[Float64] = []
    spread: list[Float64] = []
    wide: list[tuple[Float64, Float64, Float64]] = []
    images: list[Float32] = []
    greys: list[NDArray[np.uint8]] = []
    for frame in frames:
        look = footage.look(frame)
        if look.depth_m is None:
            continue
        images.append(look.depth_m)
        greys.append(look.grey)
        z, left, _ = _planes(look.depth_m, SIDE)
        distance.append(z)
        spread.append(np.sqrt((left**2).sum(axis=(1, 2)) / (SIDE * SIDE - 3)))
        after = footage.look(frame + 1).depth_m if frame + 1 < len(footage) else None
        wide.append(_wide(look.depth_m, after))
    curve, law = _by_distance(distance, spread)
    return DepthNoise(curve, law, _steps(images), _correlations(wide), _holes(images, greys))


@cache
def _left_of_plane(side: int) -> tuple[Float64, Float64]:
    """Return the projection onto what a plane leaves of a block (side^2, side^2), and that onto its middle."""
    v, u = np.mgrid[:side, :side] - (side - 1) / 2
    terms = np.stack([np.ones(u.size), u.ravel(), v.ravel()], axis=1)
    inverse = np.linalg.pinv(terms)
    return np.eye(side * side) - terms @ inverse, inverse[0]


def _planes(depth_m: Float32, side: int) -> tuple[Float64, Float64, NDArray[np.int64]]:
    """Return the distance (N,) of blocks without void or edge, what planes leave of them in metres, and which they are.

    What is left: (N, side, side), in depth, to the first order.
    """
    high, wide = depth_m.shape[0] // side, depth_m.shape[1] // side
    cut = depth_m[: high * side, : wide * side].reshape(high, side, wide, side).swapaxes(1, 2).reshape(-1, side * side)
    lowest, highest = cut.min(axis=1), cut.max(axis=1)
    whole = np.flatnonzero((lowest > 0) & (highest - lowest < EDGE * highest))
    per_m = 1 / cut[whole].astype(np.float64)
    left, middle = _left_of_plane(side)
    z = 1 / (per_m @ middle)
    return z, (-(per_m @ left) * (z**2)[:, None]).reshape(-1, side, side), whole


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


# --- correlation ---


def _wide(depth_m: Float32, after_m: Float32 | None) -> tuple[Float64, Float64, Float64]:
    """Return of wide blocks (N,) their relative spread, products by lag, of means and squares (N, 5), and in time."""
    z, left, which = _planes(depth_m, WIDE_SIDE)
    square = (left**2).mean(axis=(1, 2))
    lags = [(left[:, :, lag:] * left[:, :, :-lag]).mean(axis=(1, 2)) for lag in LAGS_PX]
    means = left.reshape(-1, WIDE_SIDE // 4, 4, WIDE_SIDE // 4, 4).mean(axis=(2, 4))
    sums = np.stack([*lags, (means**2).mean(axis=(1, 2)), square], axis=1)
    time = np.full((len(z), 3), np.nan)
    if after_m is not None and not np.array_equal(depth_m, after_m):
        _, later, other = _planes(after_m, WIDE_SIDE)
        _, here, there = np.intersect1d(which, other, return_indices=True)
        time[here, 0] = (left[here] * later[there]).mean(axis=(1, 2))
        time[here, 1], time[here, 2] = square[here], (later[there] ** 2).mean(axis=(1, 2))
    return np.sqrt(square) / z**2, sums, time


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


# --- holes ---


def _holes(images: list[Float32], greys: list[NDArray[np.uint8]]) -> tuple[Figure, ...]:
    """Return the shares of pixels without depth: at the border, beside edges, where colour is dark, and elsewhere."""
    import cv2

    names = ("holes_at_border_share", "holes_beside_edges_share", "holes_in_dark_share", "holes_elsewhere_share")
    if not images:
        return tuple(Figure.none(name, "there is no depth") for name in names)
    border = np.mean([image <= 0 for image in images], axis=0) > BORDER
    rows: list[list[float]] = []
    for depth_m, grey in zip(images, greys, strict=True):
        void = depth_m <= 0
        filled_m = completed_m(depth_m)
        square = np.ones((3, 3), np.uint8)
        step = cv2.dilate(filled_m, square) > (1 + EDGE / 3) * np.maximum(cv2.erode(filled_m, square), 1e-3)
        beside = cv2.dilate(step.astype(np.uint8), np.ones((SHADOW_PX, SHADOW_PX), np.uint8)) > 0
        dark = grey < DARK
        at_border = void & border
        at_edge = void & ~border & beside
        in_dark = void & ~border & ~beside & dark
        parts = (at_border, at_edge, in_dark, void & ~at_border & ~at_edge & ~in_dark)
        rows.append([float(part.mean()) for part in parts])
    shares = np.array(rows)
    return tuple(
        Figure.within(
            name, float(shares[:, place].mean()), float(shares[:, place].std()) / len(shares) ** 0.5, len(shares)
        )
        for place, name in enumerate(names)
    )
