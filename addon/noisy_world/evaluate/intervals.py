# SPDX-License-Identifier: GPL-3.0-or-later
"""95 % intervals of what a few scenes say about scenes at large, and of what these scenes say about themselves.

Runs in one scene are alike, so the scene is what counts: all its seeds and repeats stay together. With two to eight
scenes, intervals of bootstrap quantiles (percentile, BCa) are far too narrow, and studentised ones have no end with
fewer than five (docs/analysis.md has the simulation). So every interval here is an estimate, plus and minus its
standard error times a quantile of Student's t with one degree of freedom less than there are scenes. The standard
error of a mean over scenes is in closed form what a bootstrap of scenes gives times sqrt(S / (S - 1)); that of any
other number comes from such a bootstrap (Cameron, Gelbach and Miller 2008 on few clusters; Davison and Hinkley 1997,
3.8, on resampling whole clusters only).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.streams import stream

Float64: TypeAlias = NDArray[np.float64]

LEVEL = 0.95
RESAMPLES = 2000
LARGEST_LOG = 700.0
"""Whose exponential float64 still holds."""


class Interval(NamedTuple):
    """low, high: its ends; NaN where there is none."""

    low: float
    high: float


NONE = Interval(float("nan"), float("nan"))


def mean_interval(of_scenes: ArrayLike) -> Interval:
    """(S,) a value of each scene -> the interval of their mean over scenes at large.

    None with fewer than two scenes, and where they all have one value: then their spread says nothing.
    Covers as said where the scenes' values are normal, whatever S is; for values with a long tail to one side, such as
    an ATE, take their logarithms and `exponential` of the interval.
    """
    values = np.asarray(of_scenes, dtype=np.float64)
    if len(values) < 2 or np.ptp(values) <= 1e-12 * np.max(np.abs(values)):
        return NONE
    half = _quantile_t(len(values) - 1) * float(np.std(values, ddof=1)) / np.sqrt(len(values))
    return _around(float(np.mean(values)), half)


def mean_p(of_scenes: ArrayLike) -> float:
    """(S,) a value of each scene -> the two-sided p of their mean being 0 over scenes at large, by Student's t.

    It is below 0.05 where 0 is outside of `mean_interval`, and NaN where there is no such interval.
    """
    from scipy.special import stdtr

    values = np.asarray(of_scenes, dtype=np.float64)
    if not np.isfinite(mean_interval(values).low):
        return float("nan")
    error = float(np.std(values, ddof=1)) / np.sqrt(len(values))
    return float(2.0 * stdtr(len(values) - 1, -abs(float(np.mean(values))) / error))


def exponential(interval: Interval) -> Interval:
    """Return the interval of a geometric mean, of a ratio: from that of its logarithm; no end is below 0."""
    return Interval(*(float(np.exp(min(end, LARGEST_LOG))) for end in interval))


def share_interval(shares: ArrayLike, runs: float = np.inf) -> Interval:
    """(S,) a mean of each scene of numbers from 0 to 1 -> the interval of their mean over scenes at large.

    Wilson's score interval (1927) with Student's t in place of the normal quantile and, in place of the number of runs,
    how many independent ones would spread as the scenes do (Korn and Graubard 1998): at least the number of scenes, as
    where all agree their spread says nothing, and at most that of the runs, where each is a 0 or a 1. Covers what is
    said or more, much more with few scenes.
    """
    values = np.asarray(shares, dtype=np.float64)
    scenes = len(values)
    if scenes < 2:
        return NONE
    share, variance = float(np.mean(values)), float(np.var(values, ddof=1)) / scenes
    independent = share * (1.0 - share) / variance if variance > 1e-24 else 0.0
    independent = max(float(scenes), min(independent, float(runs)))
    t2 = _quantile_t(scenes - 1) ** 2
    middle = (share + t2 / (2.0 * independent)) / (1.0 + t2 / independent)
    half = np.sqrt(t2 * (share * (1.0 - share) / independent + t2 / (4.0 * independent**2))) / (1.0 + t2 / independent)
    return Interval(max(0.0, float(middle - half)), min(1.0, float(middle + half)))


def here_interval(groups: Sequence[ArrayLike]) -> Interval:
    """A group of values for each scene, one a seed -> the interval of the mean over these very scenes, for other seeds.

    Each scene has a variance of its own. Welch's degrees of freedom (Biometrika 34, 1947), between those of one scene
    and of all: with two or three seeds a scene, Satterthwaite's are too few, and hold the truth in 98 %. None where a
    scene has a single value, or where no scene's values differ.
    """
    parts = _parts(groups)
    if not parts:
        return NONE
    variances, freedoms = _of_mean(parts, len(groups))
    total = float(np.sum(variances))
    if not total > 0.0:
        return NONE
    freedom = total**2 / float(np.sum(variances**2 / (freedoms + 2.0))) - 2.0
    freedom = float(np.clip(freedom, np.min(freedoms), np.sum(freedoms)))
    return _around(float(np.mean([np.mean(part) for part in parts])), _quantile_t(freedom) * np.sqrt(total))


def difference_here_interval(groups: Sequence[ArrayLike], others: Sequence[ArrayLike]) -> Interval:
    """As here_interval, of the mean over scenes of the difference of two groups of each scene.

    others: as many as groups. Groups with a single value there count as exact. Satterthwaite's degrees of freedom
    (1946), as in Welch's test.
    """
    samples, subtracted = _parts(groups), [np.asarray(group, dtype=np.float64) for group in others]
    if not samples:
        return NONE
    variances, freedoms = _of_mean([*samples, *(part for part in subtracted if len(part) > 1)], len(samples))
    total = float(np.sum(variances))
    if not total > 0.0:
        return NONE
    mean = float(np.mean([np.mean(sample) for sample in samples]) - np.mean([np.mean(part) for part in subtracted]))
    return _around(mean, _quantile_t(total**2 / float(np.sum(variances**2 / freedoms))) * np.sqrt(total))


def _parts(groups: Sequence[ArrayLike]) -> list[Float64]:
    """Return the groups as arrays; none where one has a single value, whose spread is not known."""
    parts = [np.asarray(group, dtype=np.float64) for group in groups]
    return [] if any(len(part) < 2 for part in parts) else parts


def _of_mean(parts: Sequence[Float64], scenes: int) -> tuple[Float64, Float64]:
    """Return what each part adds to the variance of the mean over scenes, and its degrees of freedom."""
    variances = np.array([np.var(part, ddof=1) / len(part) for part in parts]) / scenes**2
    return variances, np.array([len(part) - 1.0 for part in parts])


def bootstrap_interval(
    statistic: Callable[[Float64], Float64], scenes: int, *names: str, resamples: int = RESAMPLES
) -> Interval:
    """Return the interval of any number over scenes at large, by a bootstrap of whole scenes; none with fewer than two.

    statistic: (B, S) how often each scene is taken -> (B,) the number, NaN where it has none. names: what the interval
    is of, which seeds the resampling.
    """
    if scenes < 2:
        return NONE
    value = float(statistic(np.ones((1, scenes)))[0])
    taken = stream("analysis", *names).multinomial(scenes, np.full(scenes, 1.0 / scenes), size=resamples)
    found = statistic(taken.astype(np.float64))
    found = found[np.isfinite(found)]
    if not np.isfinite(value) or len(found) < resamples / 2:
        return NONE
    error = float(np.std(found)) * np.sqrt(scenes / (scenes - 1))
    return _around(value, _quantile_t(scenes - 1) * error)


def clipped(interval: Interval, least: float = 0.0, most: float = 1.0) -> Interval:
    """Return an interval within what is possible."""
    return Interval(float(np.clip(interval.low, least, most)), float(np.clip(interval.high, least, most)))


def _around(value: float, half: float) -> Interval:
    return Interval(float(value - half), float(value + half))


def _quantile_t(freedom: float) -> float:
    from scipy.special import stdtrit

    return float(stdtrit(freedom, (1.0 + LEVEL) / 2.0))
