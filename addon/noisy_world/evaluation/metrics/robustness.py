# SPDX-License-Identifier: GPL-3.0-or-later
"""Robustness: a system's results under perturbations relative to its clean ones and to a baseline.

Kong et al., "Robo3D: Towards robust and reliable 3D perception against corruptions", ICCV 2023, with the corruption
error after Hendrycks and Dietterich, ICLR 2019. Scores go from 0 (worst) to 1, such as `success_auc`; an error is
1 - score there, and may be any other number that is not negative.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Rate:
    """A mean over perturbations. value: None where none has a rate. by_perturbation: the rate of each, sorted by name.

    excluded: perturbations that have none, as what they would be divided by is 0 or missing.
    """

    value: float | None
    by_perturbation: dict[str, float] = field(default_factory=dict)
    excluded: tuple[str, ...] = ()


def resilience_rate(scores: Mapping[str, Sequence[float]], clean: float | None) -> Rate:
    """Return mRR: for each perturbation the mean of its scores over clean, and the mean of these. 1 is unimpaired.

    scores: of each perturbation, over its severities (and scenes, modes, seeds). clean: the mean score without one.
    Robo3D divides the sum of three severities by three times the clean score; with more or fewer it is the mean.
    """
    filled = {name: scores[name] for name in sorted(scores) if len(scores[name])}
    if not clean:
        return Rate(None, {}, tuple(sorted(scores)))
    rates = {name: sum(values) / (len(values) * clean) for name, values in filled.items()}
    return _mean(rates, scores)


def corruption_error(errors: Mapping[str, Sequence[float]], baseline: Mapping[str, Sequence[float]]) -> Rate:
    """Return mCE: for each perturbation the sum of errors over the baseline's, and the mean of these. 1 is its equal.

    errors, baseline: of each perturbation, in the same runs (scenes, severities, modes, seeds). A perturbation that the
    baseline lacks, or whose errors there sum to 0, is left out. Raises ValueError where the numbers of runs differ.
    """
    rates: dict[str, float] = {}
    for name in sorted(errors):
        mine, theirs = errors[name], baseline.get(name, ())
        if theirs and len(mine) != len(theirs):
            raise ValueError(f"{name}: {len(mine)} errors cannot be compared with {len(theirs)} of the baseline")
        if theirs and sum(theirs) > 0.0:
            rates[name] = sum(mine) / sum(theirs)
    return _mean(rates, errors)


def _mean(rates: dict[str, float], given: Mapping[str, Sequence[float]]) -> Rate:
    value = sum(rates.values()) / len(rates) if rates else None
    return Rate(value, rates, tuple(name for name in sorted(given) if name not in rates))
