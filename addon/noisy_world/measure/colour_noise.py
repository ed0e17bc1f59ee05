# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise of colour against intensity, from frames alone: what is left of smooth surfaces over small blocks.

A block of noise alone leaves a variance that is spread as chi-squared; texture and edges leave more. So the lowest
variances of each intensity tell: where the share below 0.7 sigma^2 is to that below 0.88 sigma^2 as chi-squared has it.

Texture lies in low frequencies, noise of independent pixels in all alike. So where neighbours' noise is not alike, the
upper half of a block's frequencies tells it. Where it is, that may be texture, or noise that was denoised: all
frequencies tell the value, and the upper half how low it may be.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .figure import BLOCKS, WITHIN, Figure, blocks_of, jackknifed
from .footage import Float32, Float64, RecordingView

# Chosen, as all below.
SIDE = 8  # of a block in pixels
TERMS = 2 * SIDE  # of a surface of second order, and of what rows and columns have of their own
FREE = SIDE * SIDE - TERMS
UPPER = 8  # the least sum of a cosine's half waves across and down a block, in the upper half of its frequencies
LEVELS = np.linspace(8.0, 248.0, 13)  # edges of the bins of intensity, of 255
CLIPPED = 2.5  # deviations that black and white have to be away
LOW, HIGH = 0.7, 0.88  # times sigma^2: below these the two shares are taken
LEAST_BLOCKS = 300  # of an intensity, in all frames
LEAST_BELOW = 30  # of them below HIGH sigma^2
LEAST_TOLD = 0.3  # of 255: of less, rounding leaves nothing
LEAST_SIGMA, MOST_SIGMA, TRIED = 0.05, 120.0, 400
SMOOTHER = 0.3  # share of a frame's blocks in which red is looked at
SMOOTHEST = 0.1  # share of the blocks that are looked at where none is of noise alone
# Relative error of a deviation by what texture adds to the smoothest blocks, found on known noise: the first over the
# share of blocks that have none, within the others.
TEXTURE, LEAST_ERROR, MOST_ERROR = 0.012, 0.025, 0.15
UPPER_ERROR = 0.025  # the same of the upper frequencies
LEAST_LEVELS = 3  # intensities that tell photons from even noise
ROUNDED = 1 / 12  # variance of what rounding to whole numbers adds
TOGETHER = 0.8  # correlation of red and green that no sensor's own noise has
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

    upper: (N,) variance by the upper frequencies. red, together: (N,) variance of red, and its product with green; NaN
    but for the smoother blocks.
    """

    mean: Float64
    variance: Float64
    upper: Float64
    beside: Float64
    red: Float64
    together: Float64
    frame: Float64


@dataclass(frozen=True)
class _Level:
    """Noise at an intensity.

    at: the intensity, of 255. count: of blocks. sigma, error: by all frequencies, of 255. upper, upper_error: by the
    upper half. noise: (N,) which blocks are of noise alone.
    """

    at: float
    count: int
    sigma: float
    error: float
    upper: float
    upper_error: float
    noise: NDArray[np.bool_]


def colour_noise(footage: RecordingView, frames: Sequence[int], *, jpeg: bool = False) -> ColourNoise:
    """Return the noise of colour in some frames. Raises InputError where one of them is damaged.

    jpeg: whether they were JPEGs: these take more of the noise of dark places, and of a chroma that is halved, so what
    is left has no law of its sensor.
    """
    blocks = _joined(_of_frame(footage.look(frame).colour, number) for number, frame in enumerate(frames))
    groups = blocks_of(len(frames))[blocks.frame.astype(int)]
    bins = (
        (blocks.mean >= low) & (blocks.mean < high) & (blocks.variance > 0) for low, high in pairwise(LEVELS.tolist())
    )
    levels = [level for here in bins if (level := _level(blocks, here, groups)) is not None]
    # Near black and white those blocks alone are whole whose noise is small by chance.
    levels = [level for level in levels if CLIPPED * level.sigma < min(level.at, 255 - level.at)] or levels
    if not levels:
        return _without_noise(blocks)
    plainly = np.any([level.noise for level in levels], axis=0)
    count = int(plainly.sum())
    correlation = _correlation(blocks, plainly)
    beside = Figure.within("colour_noise_correlation", correlation, 1 / max(count, 1) ** 0.5, count, "blocks")
    channels = _between_channels(blocks, plainly, groups)
    alike = correlation > CORRELATED
    curve = tuple((level.at, _on_curve(level, alike=alike)) for level in levels)
    remark = ""
    if alike:
        remark = (
            f"neighbours' noise of colour is correlated by {correlation:.2f}: it was denoised, compressed or resampled "
            "after it arose, and what is left is less than the sensor's own"
        )
    elif channels.sure_beyond(CORRELATED):
        remark = (
            f"noise of red and green is correlated by {channels.value:.2f}: colour was compressed, denoised or made of "
            "a mosaic after noise arose, and each channel has less than the sensor's own"
        )
    law = _law_figures(levels, alike=alike)
    why = ""
    if jpeg:
        why = "a JPEG took part of it, and another part at each intensity: what is left stands at the intensities"
    elif alike and channels.sure_beyond(TOGETHER):
        curve = ()
        why = "what smooth blocks vary by is alike in red and green, as texture is, or noise that was compressed"
    if why:
        law = Figure.none(law[0].name, why), Figure.none(law[1].name, why)
    return ColourNoise(curve, *law, beside, channels, remark)


def _level(blocks: _Blocks, here: NDArray[np.bool_], groups: NDArray[np.int64]) -> _Level | None:
    """Return the noise of some blocks, of one intensity; None where it is hidden."""
    sigma = _sigma(blocks.variance[here]) if here.sum() >= LEAST_BLOCKS else None
    if sigma is None or sigma < LEAST_TOLD:
        return None
    upper = _sigma(blocks.upper[here], _cosines().shape[1])

    def apart(variances: Float64, free: int, whole: float) -> float:
        parts = [_sigma(variances[here & (groups != group)], free) for group in range(BLOCKS)]
        return jackknifed(np.array([whole if part is None else part for part in parts]))

    plain = _plain_share(blocks.variance[here], sigma)
    by_texture = sigma * min(max(TEXTURE / plain, LEAST_ERROR), MOST_ERROR)
    error = float(np.hypot(apart(blocks.variance, FREE, sigma), by_texture))
    upper_error = error
    if upper is None:
        upper = sigma
    else:
        upper_error = float(np.hypot(apart(blocks.upper, _cosines().shape[1], upper), UPPER_ERROR * upper))
        if sigma < upper + upper_error:  # there is no texture: what all frequencies say is more exact
            share = error**-2 / (error**-2 + upper_error**-2)
            upper, upper_error = upper + share * (sigma - upper), min(error, upper_error)
    noise = here & (np.abs(blocks.variance / (sigma**2 + ROUNDED) - 1) < 0.4)
    return _Level(float(np.mean(blocks.mean[here])), int(here.sum()), sigma, error, upper, upper_error, noise)


def _on_curve(level: _Level, *, alike: bool) -> Figure:
    """Return a level as a figure. alike: whether neighbours' noise is, so that texture cannot be told from it."""
    name = f"{CURVE}_at_{level.at:.0f}"
    by_upper = Figure.within(name, level.upper, level.upper_error, level.count, "blocks").on(CURVE, level.at)
    if not alike:
        return by_upper
    return _down_to(Figure.within(name, level.sigma, level.error, level.count, "blocks"), by_upper).on(CURVE, level.at)


def _down_to(figure: Figure, other: Figure) -> Figure:
    """Return a figure whose interval reaches down to that of another."""
    if figure.low is None or other.low is None:
        return figure
    return replace(figure, low=min(figure.low, other.low))


def _law_figures(levels: Sequence[_Level], *, alike: bool) -> tuple[Figure, Figure]:
    """Return both parts of the law of variance against intensity."""
    at = np.array([level.at for level in levels])
    by_upper = _law(at, *(np.array([getattr(each, name) for each in levels]) for name in ("upper", "upper_error")))
    if not alike:
        return by_upper
    by_all = _law(at, *(np.array([getattr(each, name) for each in levels]) for name in ("sigma", "error")))
    even, slope = (_down_to(one, other) for one, other in zip(by_all, by_upper, strict=True))
    return even, slope


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
    beside = _correlation(blocks, smooth)
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
    """Return orthonormal surfaces, rows and columns of a block (64, TERMS).

    And how neighbours are correlated in what these leave of a block of noise.
    """
    v, u = np.mgrid[:SIDE, :SIDE].reshape(2, -1)
    middle = (SIDE - 1) / 2
    terms = [*(v == np.arange(SIDE)[:, None]), *(u == np.arange(SIDE)[:, None]), (u - middle) * (v - middle)]
    vectors, sizes, _ = np.linalg.svd(np.stack(terms, axis=1).astype(np.float64), full_matrices=False)
    basis = vectors[:, sizes > 1e-9]
    left = np.eye(SIDE * SIDE) - basis @ basis.T
    cube = left.reshape(SIDE, SIDE, SIDE, SIDE)
    here = np.arange(SIDE - 1)
    beside = sum(float(cube[row, here, row, here + 1].sum()) for row in range(SIDE)) / (SIDE * (SIDE - 1))
    return basis.astype(np.float32), beside / (float(np.trace(left)) / (SIDE * SIDE))


def _left(values: Float32) -> Float32:
    """Return what surfaces, rows and columns leave of blocks, (N, 64) each."""
    basis = _surface()[0]
    return np.asarray(values - (values @ basis) @ basis.T, np.float32)


def _of_frame(image: NDArray[np.uint8], number: int) -> _Blocks:
    red, green = (_cut(image[..., channel]) for channel in (0, 1))
    inside = (green.min(axis=1) > 0) & (green.max(axis=1) < 255)
    values = green[inside].astype(np.float32)
    left = _left(values)
    square = left.reshape(-1, SIDE, SIDE)
    variance = np.einsum("ij,ij->i", left, left).astype(np.float64) / FREE
    waves = values @ _cosines()
    upper = np.einsum("ij,ij->i", waves, waves).astype(np.float64) / waves.shape[1]
    of_red, together = np.full((2, len(values)), np.nan)
    if len(values):
        smooth = variance <= np.quantile(variance, SMOOTHER)
        other = _left(red[inside][smooth].astype(np.float32))
        of_red[smooth] = (other**2).sum(axis=1) / FREE
        together[smooth] = (other * left[smooth]).sum(axis=1) / FREE
    beside = np.einsum("ijk,ijk->i", square[:, :, 1:], square[:, :, :-1]).astype(np.float64) / (SIDE * (SIDE - 1))
    return _Blocks(
        values.mean(axis=1).astype(np.float64),
        variance,
        upper,
        beside,
        of_red,
        together,
        np.full(len(values), float(number)),
    )


def _cut(channel: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the blocks of a channel (H, W), (N, SIDE^2)."""
    high, wide = channel.shape[0] // SIDE, channel.shape[1] // SIDE
    cut = channel[: high * SIDE, : wide * SIDE].reshape(high, SIDE, wide, SIDE)
    return cut.swapaxes(1, 2).reshape(-1, SIDE * SIDE)


def _joined(parts: Iterable[_Blocks]) -> _Blocks:
    held = list(parts)
    names = ("mean", "variance", "upper", "beside", "red", "together", "frame")
    return _Blocks(*(np.concatenate([getattr(part, name) for part in held]) for name in names))


@cache
def _shares(free: int) -> tuple[float, float]:
    """Return the shares of chi-squared below LOW and HIGH times its mean, by degrees of freedom."""
    values = np.random.default_rng(0).chisquare(free, 400_000) / free
    return float(np.mean(values < LOW)), float(np.mean(values < HIGH))


@cache
def _cosines() -> Float32:
    """Return the cosines of a block's upper frequencies (64, K), orthonormal (as the discrete cosine transform)."""
    at = np.arange(SIDE)
    waves = np.cos(np.pi * (at[:, None] + 0.5) * at / SIDE) * np.sqrt((1 + (at > 0)) / SIDE)
    both = np.einsum("yv,xu->yxvu", waves, waves).reshape(SIDE * SIDE, -1)
    return np.asarray(both[:, (at[:, None] + at).ravel() >= UPPER], np.float32)


def _sigma(variances: Float64, free: int = FREE) -> float | None:
    """Return the deviation of the noise that the lowest of variances (N,) are of; None where they tell none.

    free: of how many degrees of freedom each is.
    """
    ordered = np.sort(variances)
    tried = np.geomspace(LEAST_SIGMA, MOST_SIGMA, TRIED)
    low, whole = (np.searchsorted(ordered, times * tried**2) for times in (LOW, HIGH))
    enough = whole >= max(LEAST_BELOW, 0.01 * len(ordered))
    ratio = low / np.maximum(whole, 1) - np.divide(*_shares(free))
    crossing = np.flatnonzero(enough[1:] & (ratio[1:] >= 0) & (ratio[:-1] < 0))
    if not len(crossing):
        return None
    at = int(crossing[0])
    part = -ratio[at] / max(ratio[at + 1] - ratio[at], 1e-9)
    variance = float(tried[at] * (tried[at + 1] / tried[at]) ** part) ** 2
    return float(np.sqrt(max(variance - ROUNDED, LEAST_SIGMA**2)))


def _plain_share(variances: Float64, sigma: float) -> float:
    """Return the share of variances (N,) that are of noise of a deviation alone, above 0."""
    return max(float(np.mean(variances < HIGH * (sigma**2 + ROUNDED))) / _shares(FREE)[1], 0.01)


def _law(at: Float64, sigma: Float64, error: Float64) -> tuple[Figure, Figure]:
    """Fit variance = gaussian^2 + slope * intensity, of full scale, both >= 0, to levels (N,) of 255."""
    names = "colour_gaussian_std", "colour_variance_per_intensity"
    x, y, errors = at / 255, (sigma / 255) ** 2, 2 * sigma * error / 255**2
    few = len(x) < LEAST_LEVELS
    terms = np.stack([np.ones_like(x), x], axis=1)[:, : 1 if few else 2] / errors[:, None]
    covariance = np.linalg.pinv(terms.T @ terms)
    constant, *slopes = (covariance @ terms.T @ (y / errors)).tolist()
    constant_error, *slope_errors = np.sqrt(np.diag(covariance)).tolist()
    if few:
        # All of it may be photons': the even part is that much at most.
        high = float(np.sqrt(constant + WITHIN * constant_error))
        even = Figure(names[0], float(np.sqrt(constant)), 0.0, high, len(x), "intensities")
        return even, Figure.none(names[1], "too few intensities are seen")
    slope, slope_error = slopes[0], slope_errors[0]
    if slope < 0:
        constant, slope = float(np.average(y, weights=errors**-2)), 0.0
    elif constant < 0:
        constant, slope = 0.0, float(np.sum(x * y / errors**2) / np.sum((x / errors) ** 2))
    low, value, high = (np.sqrt(max(constant + side * WITHIN * constant_error, 0.0)) for side in (-1, 0, 1))
    even = Figure(names[0], float(value), float(low), float(high), len(x), "intensities")
    low, high = (max(slope + side * WITHIN * slope_error, 0.0) for side in (-1, 1))
    return even, Figure(names[1], slope, low, high, len(x), "intensities")


def _correlation(blocks: _Blocks, chosen: NDArray[np.bool_]) -> float:
    """Return neighbours' correlation of the noise in some blocks, against that which the fit alone makes."""
    beside, variance = blocks.beside[chosen].sum(), blocks.variance[chosen].sum()
    by_fit = _surface()[1]
    measured = float(beside / max(variance * FREE / (SIDE * SIDE), 1e-12))
    return (measured - by_fit) / (1 - by_fit)
