# SPDX-License-Identifier: GPL-3.0-or-later
"""95 % intervals of what a few scenes say about scenes at large, and of what these scenes say about themselves.

Runs in one scene are alike, so the scene is what counts: all its seeds and repeats stay together. With two to eight
scenes, intervals of bootstrap quantiles (percentile, BCa) are far too narrow, and studentised ones have no end with
fewer than five (docs/analysis.md has the simulation). So every interval here is an estimate, plus and minus its
standard error times a quantile of Student's t with one degree of freedom less than there are scenes. The standard
error of a mean over scenes is in closed form what a bootstrap of scenes gives times sqrt(S / (S - 1)); that of any
other number comes from such a bootstrap (Cameron, Gelbach and Miller 2008 on few clusters; Davison and Hinkley 1997,
3.8, on resampling whole clusters only).

Arrays have a scene in each place of their last axis, NaN where it has no value; what is said has the other axes.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.streams import stream

Float64: TypeAlias = NDArray[np.float64]

LEVEL = 0.95
RESAMPLES = 2000
LARGEST_LOG = 700.0
"""Whose exponential float64 still holds."""


class Interval(NamedTuple):
    """low, high: its ends, (...); NaN where there is none."""

    low: Any
    high: Any


NO_INTERVAL = Interval(float("nan"), float("nan"))


class SceneValues(NamedTuple):
    """What each scene says of a measure, (..., S).

    mean: over its seeds. variance: of that mean, by the spread of its seeds (or repeats, where there is one seed), NaN
    where there is a single value. freedom: the degrees of freedom of the variance.
    """

    mean: Float64
    variance: Float64
    freedom: Float64


def mean_over_scenes(of_scenes: ArrayLike) -> Float64:
    """(..., S) -> (...): the mean over the scenes that have a value; NaN of none."""
    return _moments(of_scenes)[1]


def mean_interval(of_scenes: ArrayLike) -> Interval:
    """(..., S) a value of each scene -> the interval of their mean over scenes at large.

    None with fewer than two scenes, and where they all have one value: then their spread says nothing.
    Covers as said where the scenes' values are normal, whatever S is; for values with a long tail to one side, such as
    an ATE, take their logarithms and `exponential` of the interval.
    """
    scenes, mean, error = _moments(of_scenes)
    return _around(mean, _quantile_t(scenes - 1) * error)


def mean_p(of_scenes: ArrayLike) -> Float64:
    """(..., S) a value of each scene -> the two-sided p of their mean being 0 over scenes at large, by Student's t.

    It is below 0.05 where 0 is outside of `mean_interval`, and NaN where there is no such interval.
    """
    from scipy.special import stdtr

    scenes, mean, error = _moments(of_scenes)
    return 2.0 * stdtr(scenes - 1, -np.abs(mean) / error)


def exponential(interval: Interval) -> Interval:
    """Return the interval of a geometric mean, of a ratio: from that of its logarithm; no end is below 0."""
    return Interval(*(np.exp(np.minimum(end, LARGEST_LOG)) for end in interval))


def share_interval(shares: ArrayLike, runs: ArrayLike = np.inf) -> Interval:
    """(..., S) a mean of each scene of numbers from 0 to 1 -> the interval of their mean over scenes at large.

    runs: (...) how many there are. Wilson's score interval (1927) with Student's t in place of the normal quantile and,
    in place of the number of runs, how many independent ones would spread as the scenes do (Korn and Graubard 1998): at
    least the number of scenes, as where all agree their spread says nothing, and at most that of the runs, where each
    is a 0 or a 1. Covers what is said or more, much more with few scenes.
    """
    values = np.asarray(shares, dtype=np.float64)
    scenes, share = np.isfinite(values).sum(axis=-1), mean_over_scenes(values)
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = np.nansum((values - share[..., None]) ** 2, axis=-1) / (scenes - 1) / scenes
        independent = np.where(variance > 1e-24, share * (1.0 - share) / variance, 0.0)
        independent = np.maximum(scenes, np.minimum(independent, runs))
        t2 = np.where(scenes > 1, _quantile_t(scenes - 1) ** 2, np.nan)
        middle = (share + t2 / (2.0 * independent)) / (1.0 + t2 / independent)
        half = np.sqrt(t2 * (share * (1.0 - share) / independent + t2 / (4.0 * independent**2)))
        half = half / (1.0 + t2 / independent)
    return clipped(_around(middle, half))


def here_interval(scenes: SceneValues) -> Interval:
    """Return the interval of the mean over these very scenes, for other seeds.

    Each scene has a variance of its own. Welch's degrees of freedom (Biometrika 34, 1947), between those of one scene
    and of all: with two or three seeds a scene, Satterthwaite's are too few, and hold the truth in 98 %. None where a
    scene has a single value, or where no scene's values differ.
    """
    parts, total = _parts(scenes)
    total = np.where(total > 0.0, total, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = total**2 / np.nansum(parts**2 / (scenes.freedom + 2.0), axis=-1) - 2.0
    known = np.isfinite(parts)
    fewest = np.min(scenes.freedom, axis=-1, initial=np.inf, where=known)
    freedom = np.clip(freedom, fewest, np.sum(scenes.freedom, axis=-1, where=known))
    return _around(mean_over_scenes(scenes.mean), _quantile_t(freedom) * np.sqrt(total))


def difference_here_interval(scenes: SceneValues, others: SceneValues) -> Interval:
    """As here_interval, of the mean over scenes of the difference of two values of each scene.

    others: the same scenes. Where one has a single value there, it counts as exact. Satterthwaite's degrees of freedom
    (1946), as in Welch's test.
    """
    parts, total = _parts(scenes)
    beside = np.nan_to_num(others.variance / _counted(scenes.mean)[..., None] ** 2)
    total = total + beside.sum(axis=-1)
    total = np.where(total > 0.0, total, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.nansum(parts**2 / scenes.freedom, axis=-1)
        squares = squares + np.nansum(np.where(beside > 0.0, beside**2 / others.freedom, 0.0), axis=-1)
        half = _quantile_t(total**2 / squares) * np.sqrt(total)
    return _around(mean_over_scenes(scenes.mean) - mean_over_scenes(others.mean), half)


def bootstrap_interval(
    statistic: Callable[[Float64], Float64], scenes: int, *names: str, resamples: int = RESAMPLES
) -> Interval:
    """Return the interval of any number over scenes at large, by a bootstrap of whole scenes; none with fewer than two.

    statistic: (B, S) how often each scene is taken -> (B,) the number, NaN where it has none. names: what the interval
    is of, which seeds the resampling.
    """
    if scenes < 2:
        return NO_INTERVAL
    value = float(statistic(np.ones((1, scenes)))[0])
    taken = stream("analysis", *names).multinomial(scenes, np.full(scenes, 1.0 / scenes), size=resamples)
    numbers = statistic(taken.astype(np.float64))
    numbers = numbers[np.isfinite(numbers)]
    if not np.isfinite(value) or len(numbers) < resamples / 2:
        return NO_INTERVAL
    error = float(np.std(numbers)) * np.sqrt(scenes / (scenes - 1))
    return _around(value, float(_quantile_t(scenes - 1)) * error)


def clipped(interval: Interval, least: float = 0.0, most: float = 1.0) -> Interval:
    """Return an interval within what is possible."""
    return Interval(*(np.clip(end, least, most) for end in interval))


def _moments(of_scenes: ArrayLike) -> tuple[NDArray[np.int64], Float64, Float64]:
    """Return of how many scenes there is a value, the mean, and its standard error, NaN where all have one value."""
    values = np.asarray(of_scenes, dtype=np.float64)
    scenes, known = _counted(values), np.isfinite(values)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.sum(values, axis=-1, where=known) / scenes
        error = np.sqrt(np.sum((values - mean[..., None]) ** 2, axis=-1, where=known) / (scenes - 1) / scenes)
    least, most = (
        np.min(values, axis=-1, where=known, initial=np.inf),
        np.max(values, axis=-1, where=known, initial=-np.inf),
    )
    differ = (scenes > 1) & (most - least > 1e-12 * np.maximum(np.abs(least), np.abs(most)))
    return scenes, mean, np.where(differ, error, np.nan)


def _counted(of_scenes: Float64) -> NDArray[np.int64]:
    return np.isfinite(of_scenes).sum(axis=-1)


def _parts(scenes: SceneValues) -> tuple[Float64, Float64]:
    """Return what each scene adds to the variance of the mean over scenes (..., S), and the sum; NaN for none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = scenes.variance / _counted(scenes.mean)[..., None] ** 2
    whole = (np.isfinite(parts) == np.isfinite(scenes.mean)).all(axis=-1)
    return parts, np.where(whole, np.nansum(parts, axis=-1), np.nan)


def _around(value: Any, half: Any) -> Interval:
    return Interval(value - half, value + half)


def _quantile_t(freedom: ArrayLike) -> Float64:
    from scipy.special import stdtrit

    return stdtrit(np.asarray(freedom, dtype=np.float64), (1.0 + LEVEL) / 2.0)
