# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise of colour against intensity, from frames alone: what is left of smooth surfaces over small blocks.

A block of noise alone leaves a variance that is spread as chi-squared; texture and edges leave more. So the lowest
variances of each intensity tell: where the share below 0.7 sigma^2 is to that below 0.88 sigma^2 as chi-squared has it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .figure import BLOCKS, WITHIN, Figure, blocks_of, jackknifed
from .footage import Float32, Float64, RecordingView

# Chosen, as all below.
SIDE = 8  # of a block in pixels
TERMS = 6  # of a surface of second order
FREE = SIDE * SIDE - TERMS
LEVELS = np.linspace(8.0, 248.0, 13)  # edges of the bins of intensity, of 255
LOW, HIGH = 0.7, 0.88  # times sigma^2: below these the two shares are taken
LEAST_BLOCKS = 300  # of an intensity, in all frames
LEAST_BELOW = 30  # of them below HIGH sigma^2
LEAST_SIGMA, MOST_SIGMA, TRIED = 0.05, 120.0, 400
SMOOTHER = 0.3  # share of a frame's blocks in which red is looked at
SMOOTHEST = 0.1  # share of the blocks that are looked at where none is of noise alone
# Relative error of a deviation by what texture adds to the smoothest blocks, found on known noise: the first over the
# share of blocks that have none, within the others.
TEXTURE, LEAST_ERROR, MOST_ERROR = 0.012, 0.015, 0.15
ROUNDED = 1 / 12  # variance of what rounding to whole numbers adds
CORRELATED = 0.2  # neighbours' noise: more is no noise of a sensor's own pixels

CURVE = "colour_noise"
BETWEEN = "colour_noise_between_channels"


@dataclass(frozen=True)
class ColourNoise:
    """The green channel's noise. curve: (intensity of 255, its deviation of 255), a figure for each.

    gaussian_std, per_photon: of variance = gaussian_std^2 + per_photon * intensity, both of full scale. correlation:
    between horizontal neighbours. between_channels: of red and green in the same pixels. remark: what has to be said of
    it; "" for nothing.
    """

    curve: tuple[tuple[float, Figure], ...]
    gaussian_std: Figure
    per_photon: Figure
    correlation: Figure
    between_channels: Figure
    remark: str = ""

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All of them."""
        return (
            self.gaussian_std,
            self.per_photon,
            self.correlation,
            self.between_channels,
            *(figure for _, figure in self.curve),
        )


@dataclass(frozen=True)
class _Blocks:
    """Of blocks: mean, variance that is left and product of horizontal neighbours that are left, (N,); their frame.

    red, together: (N,) variance of red, and its product with green; NaN but for the smoother blocks.
    """

    mean: Float64
    variance: Float64
    beside: Float64
    red: Float64
    together: Float64
    frame: Float64


def colour_noise(footage: RecordingView, frames: Sequence[int]) -> ColourNoise:
    """Return the noise of colour in some frames. Raises InputError where one of them is damaged."""
    blocks = _joined(_of_frame(footage.look(frame).colour, number) for number, frame in enumerate(frames))
    groups = blocks_of(len(frames))[blocks.frame.astype(int)]
    curve: list[tuple[float, Figure]] = []
    whole: list[tuple[float, float, float]] = []
    parted: list[list[tuple[float, float, float]]] = [[] for _ in range(BLOCKS)]
    kept: list[tuple[float, Float64]] = []
    textures: list[tuple[float, float]] = []
    plainly = np.zeros(len(blocks.mean), np.bool_)
    for low, high in pairwise(LEVELS.tolist()):
        here = (blocks.mean >= low) & (blocks.mean < high)
        if here.sum() < LEAST_BLOCKS or (sigma := _sigma(blocks.variance[here])) is None:
            continue
        level = float(np.mean(blocks.mean[here]))
        parts = [_sigma(blocks.variance[here & (groups != group)]) for group in range(BLOCKS)]
        known = np.array([sigma if part is None else part for part in parts])
        plain = _plain_share(blocks.variance[here], sigma)
        texture = min(max(TEXTURE / plain, LEAST_ERROR), MOST_ERROR)
        error = float(np.hypot(jackknifed(known), texture * sigma))
        figure = Figure.within(f"{CURVE}_at_{level:.0f}", sigma, error, int(here.sum()), "blocks")
        curve.append((level, figure.on(CURVE, level)))
        weight = float(np.sqrt(here.sum())) * plain
        textures.append((texture, weight))
        whole.append((level, sigma, weight))
        for group, value in enumerate(known.tolist()):
            parted[group].append((level, value, weight))
        noise = here & (np.abs(blocks.variance / (sigma**2 + ROUNDED) - 1) < 0.4)
        plainly |= noise
        kept.append((float(noise.sum()), np.array([blocks.beside[noise].sum(), blocks.variance[noise].sum()])))
    if not curve:
        return _without_noise(blocks)
    count = int(sum(number for number, _ in kept))
    correlation = _correlation(kept)
    fitted, left_out = _law(whole), np.array([_law(part) for part in parted])
    variance = float(np.mean([(sigma / 255) ** 2 for _, sigma, _ in whole]))
    by_texture = float(np.average([share for share, _ in textures], weights=[weight for _, weight in textures]))
    apart = by_texture * variance**0.5, 2 * by_texture * variance
    constant_error, slope_error = _law_errors(curve, count=len(whole))
    gaussian = float(fitted[0])
    # An error of the constant part is one of its root; what one part takes, the other lacks.
    even = constant_error / max(2 * gaussian, constant_error**0.5) if constant_error > 0 else 0.0
    law = [
        Figure.within(
            name,
            float(fitted[place]),
            float(np.sqrt(jackknifed(left_out[:, place]) ** 2 + apart[place] ** 2 + joint**2)),
            len(curve),
            "intensities",
        )
        for place, (name, joint) in enumerate(
            (("colour_gaussian_std", even), ("colour_variance_per_intensity", slope_error))
        )
    ]
    if len(curve) < 3:
        law[1] = Figure.none(law[1].name, "too few intensities are seen")
    error = 1 / max(count, 1) ** 0.5
    beside = Figure.within("colour_noise_correlation", correlation, error, count, "blocks")
    channels = _between_channels(blocks, plainly, groups)
    remark = ""
    if correlation > CORRELATED:
        remark = (
            f"neighbours' noise of colour is correlated by {correlation:.2f}: it was denoised, compressed or resampled "
            "after it arose, and what is left is less than the sensor's own"
        )
    elif channels.sure_beyond(CORRELATED):
        remark = (
            f"noise of red and green is correlated by {channels.value:.2f}: colour was compressed, denoised or made of "
            "a mosaic after noise arose, and each channel has less than the sensor's own"
        )
    return ColourNoise(tuple(curve), law[0], law[1], beside, channels, remark)


def _without_noise(blocks: _Blocks) -> ColourNoise:
    """Return what is known where no intensity has noise of independent pixels."""
    names = ("colour_gaussian_std", "colour_variance_per_intensity", "colour_noise_correlation")
    if len(blocks.variance) < LEAST_BLOCKS:
        why = "too few blocks are neither black nor white"
        gaussian, slope, beside = (Figure.none(name, why) for name in names)
        return ColourNoise((), gaussian, slope, beside, Figure.none(BETWEEN, why))
    smooth = blocks.variance <= np.quantile(blocks.variance, SMOOTHEST)
    most = float(np.sqrt(np.median(blocks.variance[smooth])))
    count = int(smooth.sum())
    beside = _correlation([(float(count), np.array([blocks.beside[smooth].sum(), blocks.variance[smooth].sum()]))])
    why = f"noise of independent pixels is hidden: even smooth blocks vary otherwise, by {most:.2g} of 255"
    gaussian, slope = (Figure.none(name, why) for name in names[:2])
    remark = (
        f"colour has no noise of independent pixels above {most:.2g} of 255: it was denoised or compressed below it, "
        f"or never had any (neighbours in smooth blocks are correlated by {beside:.2f})"
    )
    beside = Figure.exact(names[2], beside, count, "blocks")
    return ColourNoise((), gaussian, slope, beside, Figure.none(BETWEEN, why), remark)


def _between_channels(blocks: _Blocks, chosen: NDArray[np.bool_], groups: NDArray[np.int64]) -> Figure:
    """Return how noise of red and green is correlated, in blocks that are of noise alone."""
    known = chosen & np.isfinite(blocks.red) & (blocks.red > 0)
    if known.sum() < LEAST_BELOW:
        return Figure.none(BETWEEN, "too few blocks are smooth in red and green")
    if np.allclose(blocks.red[known], blocks.variance[known]):
        return Figure.none(BETWEEN, "images are grey")
    # Where red is textured and green is not, red's variance is no noise's: the middle block tells.
    each = blocks.together[known] / np.sqrt(blocks.red[known] * blocks.variance[known])
    parts = [each[groups[known] != group] for group in range(BLOCKS)]
    error = jackknifed(np.array([float(np.median(part if len(part) else each)) for part in parts]))
    return Figure.within(BETWEEN, float(np.median(each)), error, len(each), "blocks")


@cache
def _surface() -> tuple[Float32, float]:
    """Return orthonormal surfaces of a block (64, TERMS), and neighbours' correlation in what they leave of it."""
    v, u = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    terms = np.stack([np.ones(u.size), u.ravel(), v.ravel(), u.ravel() ** 2, v.ravel() ** 2, (u * v).ravel()], axis=1)
    basis = np.linalg.qr(terms)[0]
    left = np.eye(SIDE * SIDE) - basis @ basis.T
    cube = left.reshape(SIDE, SIDE, SIDE, SIDE)
    here = np.arange(SIDE - 1)
    beside = sum(float(cube[row, here, row, here + 1].sum()) for row in range(SIDE)) / (SIDE * (SIDE - 1))
    return basis.astype(np.float32), beside / (float(np.trace(left)) / (SIDE * SIDE))


def _left(values: Float32) -> Float32:
    """Return what a surface of second order leaves of blocks, (N, 64) each."""
    basis = _surface()[0]
    return np.asarray(values - (values @ basis) @ basis.T, np.float32)


def _of_frame(image: NDArray[np.uint8], number: int) -> _Blocks:
    red, green = (_cut(image[..., channel]) for channel in (0, 1))
    inside = (green.min(axis=1) > 0) & (green.max(axis=1) < 255)
    values = green[inside].astype(np.float32)
    left = _left(values)
    square = left.reshape(-1, SIDE, SIDE)
    variance = np.einsum("ij,ij->i", left, left).astype(np.float64) / FREE
    of_red, together = np.full((2, len(values)), np.nan)
    if len(values):
        smooth = variance <= np.quantile(variance, SMOOTHER)
        other = _left(red[inside][smooth].astype(np.float32))
        of_red[smooth] = (other**2).sum(axis=1) / FREE
        together[smooth] = (other * left[smooth]).sum(axis=1) / FREE
    beside = np.einsum("ijk,ijk->i", square[:, :, 1:], square[:, :, :-1]).astype(np.float64) / (SIDE * (SIDE - 1))
    return _Blocks(
        values.mean(axis=1).astype(np.float64), variance, beside, of_red, together, np.full(len(values), float(number))
    )


def _cut(channel: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the blocks of a channel (H, W), (N, SIDE^2)."""
    high, wide = channel.shape[0] // SIDE, channel.shape[1] // SIDE
    cut = channel[: high * SIDE, : wide * SIDE].reshape(high, SIDE, wide, SIDE)
    return cut.swapaxes(1, 2).reshape(-1, SIDE * SIDE)


def _joined(parts: Iterable[_Blocks]) -> _Blocks:
    held = list(parts)
    names = ("mean", "variance", "beside", "red", "together", "frame")
    return _Blocks(*(np.concatenate([getattr(part, name) for part in held]) for name in names))


@cache
def _shares() -> tuple[float, float]:
    """Return the shares of chi-squared below LOW and HIGH times its mean, by FREE degrees of freedom."""
    values = np.random.default_rng(0).chisquare(FREE, 400_000) / FREE
    return float(np.mean(values < LOW)), float(np.mean(values < HIGH))


def _sigma(variances: Float64) -> float | None:
    """Return the deviation of the noise that the lowest of variances (N,) are of; None where they tell none."""
    ordered = np.sort(variances)
    tried = np.geomspace(LEAST_SIGMA, MOST_SIGMA, TRIED)
    low, whole = (np.searchsorted(ordered, times * tried**2) for times in (LOW, HIGH))
    enough = whole >= max(LEAST_BELOW, 0.01 * len(ordered))
    ratio = low / np.maximum(whole, 1) - _shares()[0] / _shares()[1]
    crossing = np.flatnonzero(enough[1:] & (ratio[1:] >= 0) & (ratio[:-1] < 0))
    if not len(crossing):
        return None
    at = int(crossing[0])
    part = -ratio[at] / max(ratio[at + 1] - ratio[at], 1e-9)
    variance = float(tried[at] * (tried[at + 1] / tried[at]) ** part) ** 2
    return float(np.sqrt(max(variance - ROUNDED, LEAST_SIGMA**2)))


def _plain_share(variances: Float64, sigma: float) -> float:
    """Return the share of variances (N,) that are of noise of a deviation alone, above 0."""
    return max(float(np.mean(variances < HIGH * (sigma**2 + ROUNDED))) / _shares()[1], 0.01)


def _law(points: list[tuple[float, float, float]]) -> Float64:
    """Fit (3,) intensity, deviation, weight by variance = gaussian^2 + slope * intensity, of full scale; both >= 0."""
    level, sigma, weight = (np.array(column) for column in zip(*points, strict=True))
    x, y = level / 255, (sigma / 255) ** 2
    scaled = weight / y  # relative errors of the variance are alike
    terms = np.stack([np.ones_like(x), x], axis=1)
    if len(x) < 3:
        return np.array([float(np.sqrt(np.average(y, weights=weight))), 0.0])
    constant, slope = np.linalg.lstsq(terms * scaled[:, None], y * scaled, rcond=None)[0]
    if slope < 0:
        constant, slope = np.average(y, weights=scaled**2), 0.0
    elif constant < 0:
        constant, slope = 0.0, np.sum(scaled**2 * x * y) / np.sum(scaled**2 * x * x)
    return np.array([float(np.sqrt(constant)), float(slope)])


def _law_errors(curve: Sequence[tuple[float, Figure]], count: int) -> tuple[float, float]:
    """Return the errors of both parts of the law, together, by those of its points; 0 of fewer than three."""
    if count < 3:
        return 0.0, 0.0
    level, sigma, error = (
        np.array(column)
        for column in zip(*((at, figure.value, figure.half_width / WITHIN) for at, figure in curve), strict=True)
    )
    terms = np.stack([np.ones_like(level), level / 255], axis=1)
    of_variance = 2 * sigma * np.maximum(error, LEAST_ERROR * sigma) / 255**2
    weighted = terms / of_variance[:, None]
    constant, slope = np.sqrt(np.diag(np.linalg.pinv(weighted.T @ weighted))).tolist()
    return float(constant), float(slope)


def _correlation(kept: list[tuple[float, Float64]]) -> float:
    """Return neighbours' correlation of the noise, against that which the fit alone makes."""
    beside, variance = np.sum([sums for _, sums in kept], axis=0)
    by_fit = _surface()[1]
    measured = float(beside / max(variance * FREE / (SIDE * SIDE), 1e-12))
    return (measured - by_fit) / (1 - by_fit)
