# SPDX-License-Identifier: GPL-3.0-or-later
"""Where success falls to one half: a psychometric function, its posterior on a grid, and the most telling next trial.

The chance that a system fails at a place u, from 0 (the mildest value of a search) to 1 (the worst), is

    P(u) = g + (1 - g - l) logistic(b (u - t) + c),    c = logit((1/2 - g) / (1 - g - l)),

so that it is one half at the threshold t, whatever the slope b and the lapses: g of the runs fail where nothing is
done, l succeed whatever is done. The posterior of (t, b, g, l) is kept on a grid (Kontsevich and Tyler, "Bayesian
adaptive estimation of psychometric slope and threshold", Vision Research 39, 1999); the next trial is at the place
after which the entropy of t alone is expected to be least, as slope and lapses are a nuisance here (Prins, "The
psi-marginal adaptive method", Journal of Vision 13(7):3, 2013; Watson, "QUEST+", Journal of Vision 17(3):10, 2017).
"""

from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float64: TypeAlias = NDArray[np.float64]

STEP = 0.0125
THRESHOLDS = np.round(np.arange(-0.5, 1.5 + STEP / 2, STEP), 6)
"""(T,): what the threshold may be; beyond 0 and 1 it is not in the range that is searched."""
RISES = np.geomspace(0.02, 1.5, 8)
"""What it takes for the chance to rise from a tenth to nine tenths, without lapses. Chosen."""
LAPSES = (0.005, 0.03, 0.08)
"""Of each kind, with equal weights. Chosen."""
RISE_LOGITS = 2.0 * np.log(9.0)
LEVEL = 0.95


def chance_of_failure(places: Float64, threshold: float, rise: float, fails: float, holds: float) -> Float64:
    """Return P(u) (S,) at places (S,). rise: from a tenth to nine tenths. fails, holds: lapses g and l."""
    middle = (0.5 - fails) / (1.0 - fails - holds)
    logit = RISE_LOGITS / rise * (places - threshold) + np.log(middle / (1.0 - middle))
    return fails + (1.0 - fails - holds) / (1.0 + np.exp(-np.clip(logit, -700.0, 700.0)))


@cache
def chances(places: tuple[float, ...]) -> Float64:
    """Return P (T, S, N) of each threshold, each of the S places, and each combination of rise and lapses."""
    rest = [(rise, fails, holds) for rise in RISES.tolist() for fails in LAPSES for holds in LAPSES]
    at = np.array(places)
    found = [[chance_of_failure(at, threshold, *each) for each in rest] for threshold in THRESHOLDS.tolist()]
    return np.ascontiguousarray(np.moveaxis(np.array(found), 2, 1))


def prior(known: Float64) -> Float64:
    """Return the posterior before the first trial (T, N): all alike. known: what `chances` returned."""
    thresholds, _, others = known.shape
    return np.full((thresholds, others), 1.0 / (thresholds * others))


def updated(posterior: Float64, chance: Float64, *, failed: bool) -> Float64:
    """Return the posterior (T, N) after a trial. chance: (T, N), of a failure at its place."""
    found = posterior * (chance if failed else 1.0 - chance)
    return found / found.sum()


def next_place(posterior: Float64, known: Float64) -> int:
    """Return which of the S places the trial is at after which the threshold's entropy is expected to be least."""
    fails = np.matmul(known, posterior[:, :, None])[:, :, 0].T  # (S, T): joint with a failure
    # Sums differ in their last digits from machine to machine, and equals must not.
    return int(np.argmin(np.round(_entropy(fails) + _entropy(posterior.sum(axis=1) - fails), 9)))


def _entropy(joint: Float64) -> Float64:
    """(S, T) of one outcome -> (S,): the entropy of the threshold after it, times the outcome's chance."""
    joint = np.maximum(joint, 1e-300)
    return (joint * np.log(joint.sum(axis=1, keepdims=True) / joint)).sum(axis=1)


def quantile(posterior: Float64, share: float) -> float:
    """Return the threshold below which a share of the posterior lies; each grid point stands for STEP around it."""
    below = np.concatenate([[0.0], np.cumsum(posterior.sum(axis=1))])
    edges = np.append(THRESHOLDS - STEP / 2, THRESHOLDS[-1] + STEP / 2)
    return float(np.interp(share, below / below[-1], edges))


def interval(posterior: Float64) -> tuple[float, float]:
    """Return the ends between which the threshold lies with a probability of LEVEL, with equal shares on both sides."""
    return quantile(posterior, (1.0 - LEVEL) / 2.0), quantile(posterior, (1.0 + LEVEL) / 2.0)
