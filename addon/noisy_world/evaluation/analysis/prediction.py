# SPDX-License-Identifier: GPL-3.0-or-later
"""Can a sequence's indicators tell whether a system will fail on it? A small model, tested on other scenes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..metrics.over_clean import success_over_clean_name
from ..study.cases import CLEAN
from .columns import Columns, table_of
from .correlation import with_indicators
from .intervals import NONE, Interval, bootstrap_interval, clipped
from .run_table import SEQUENCE, SUCCESS

if TYPE_CHECKING:
    from pandas import DataFrame

Float64: TypeAlias = NDArray[np.float64]

FEATURES = {
    "orb_tracked_low": True,
    "image_noise_mean": True,
    "laplacian_variance_mean": True,
    "contrast_mean": False,
    "depth_missing_mean": False,
    "depth_noise_m_mean": True,
    "speed_mps_high": True,
    "rotation_speed_degps_high": True,
}
"""What the model sees, all measured without a clean counterpart; True: its logarithm (of 1e-3 more)."""

PENALTY = 1.0
"""On the squared length of the coefficients of standardised features: a normal prior of standard deviation 1."""

BOTTOM = 1e-3

TWICE_CLEAN = success_over_clean_name(2.0)
OUTCOMES = (SUCCESS, TWICE_CLEAN)
"""The successes that are predicted, each by itself: an error below 10 cm, and one below twice the clean one."""

FOLDS = [
    *("system", "outcome", "held_out", "n", "n_scenes", "n_without_success", "n_fitted", "base_rate"),
    *("auc", "auc_low", "auc_high", "brier", "brier_base", "skill"),
]
COEFFICIENTS = ["system", "outcome", "feature", "coefficient", "mean", "standard_deviation", "n"]
PREDICTED = ["system", "outcome", *SEQUENCE, "without_success", "predicted", "base_rate"]
ALL = "all"


@dataclass(frozen=True, eq=False)
class FailureModel:
    """A logistic regression on standardised features.

    mean, deviation: (K,) of the features it was fitted on; a feature that did not vary has deviation 0 and no part.
    """

    intercept: float
    coefficients: Float64
    mean: Float64
    deviation: Float64

    def probability(self, features: ArrayLike) -> Float64:
        """(N, K) features -> (N,) probabilities of failure; a feature that is NaN counts as its mean."""
        from scipy.special import expit

        return expit(self.intercept + _standardised(features, self.mean, self.deviation) @ self.coefficients)


def fit_failure_model(features: ArrayLike, failed: ArrayLike, penalty: float = PENALTY) -> FailureModel:
    """(N, K) features and (N,) 0 or 1 (or shares of runs) -> the model with the largest penalised likelihood.

    Minimises the sum of the losses plus penalty / 2 times the squared length of the coefficients; the intercept is free
    where both outcomes occur, and held by one more observation of half a failure where only one does.
    """
    from scipy.optimize import minimize
    from scipy.special import expit

    given, target = np.asarray(features, dtype=np.float64), np.asarray(failed, dtype=np.float64)
    known = np.isfinite(given)
    counts = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, given, 0.0).sum(axis=0) / counts
    deviation = np.sqrt(np.where(known, (given - mean) ** 2, 0.0).sum(axis=0) / counts)
    deviation = np.where(deviation > 1e-9 * np.maximum(np.abs(mean), 1e-9), deviation, 0.0)
    x, start = _standardised(given, mean, deviation), np.zeros(given.shape[1] + 1)
    held = 1.0 if target.min(initial=1.0) == target.max(initial=0.0) else 0.0

    def loss(parameters: Float64) -> tuple[float, Float64]:
        score = parameters[0] + x @ parameters[1:]
        wrong = expit(score) - target
        value = np.sum(np.logaddexp(0.0, score) - target * score) + 0.5 * penalty * np.sum(parameters[1:] ** 2)
        value += held * (np.logaddexp(0.0, parameters[0]) - 0.5 * parameters[0])
        slope = np.concatenate(
            ([wrong.sum() + held * (expit(parameters[0]) - 0.5)], x.T @ wrong + penalty * parameters[1:])
        )
        return float(value), slope

    best: Any = minimize(loss, start, jac=True, method="L-BFGS-B", options={"gtol": 1e-9, "ftol": 1e-14})
    return FailureModel(float(best.x[0]), np.asarray(best.x[1:]), mean, deviation)


def prediction_tables(runs: Columns, sequences: Columns) -> tuple["DataFrame", "DataFrame", "DataFrame"]:
    """Return how well failure is predicted in scenes that the model has not seen, coefficients, and each prediction.

    A failure is a run without the success that `outcome` names, of OUTCOMES those that the runs have; an incomplete one
    too. Clean sequences have no part in what is over clean. The unit is a sequence: repeats of a system on it
    are averaged, and a half or more of failures is one. Each scene in turn is left out of the fit and predicted; row
    "all" is over all of them, with the interval of the AUC over scenes at large. base_rate is the share of failures in
    the fit, brier_base the Brier score of saying nothing else, skill 1 - brier / brier_base. The coefficients are those
    of the fit to all scenes.
    """
    folds, coefficients, predicted = [], [], []
    names = [name for name in FEATURES if name in sequences]
    outcomes = [name for name in OUTCOMES if name in runs and np.isfinite(runs[name]).any()] or [SUCCESS]
    for (system,), of_system in runs.groups(["system"]):
        for outcome in outcomes:
            labelled = _labelled(of_system, sequences, names, outcome)
            if not len(labelled):
                continue
            key = {"system": system, "outcome": outcome}
            features, failed, scenes = transformed(labelled, names), labelled["failed"], labelled["scene"]
            chance, base = held_out_predictions(features, failed, scenes)
            folds += [{**key, **row} for row in _folds(failed, chance, base, scenes, system)]
            model = fit_failure_model(features, failed)
            for name, *values in zip(names, model.coefficients, model.mean, model.deviation, strict=True):
                row = dict(zip(("coefficient", "mean", "standard_deviation"), map(float, values), strict=True))
                coefficients.append({**key, "feature": name, **row, "n": len(failed)})
            for place, *values in zip(labelled.rows(SEQUENCE), failed, chance, base, strict=True):
                row = dict(zip(("without_success", "predicted", "base_rate"), map(float, values), strict=True))
                predicted.append({**key, **dict(zip(SEQUENCE, place, strict=True)), **row})
    return table_of(folds, FOLDS), table_of(coefficients, COEFFICIENTS), table_of(predicted, PREDICTED)


def _folds(
    failed: Float64, chance: Float64, base: Float64, scenes: NDArray[Any], system: str
) -> Iterator[dict[str, Any]]:
    """Yield what is said of each scene that was left out, and of all."""
    for scene in [*sorted(set(scenes)), ALL]:
        chosen = np.ones(len(scenes), bool) if scene == ALL else scenes == scene
        row = {"held_out": scene, "n_fitted": np.nan if scene == ALL else int((~chosen).sum())}
        ends = auc_interval(failed, chance, scenes, system) if scene == ALL else NONE
        row |= {"n_scenes": len(set(scenes[chosen])), "auc_low": ends.low, "auc_high": ends.high}
        yield row | judged(failed, chance, base, chosen)


def auc_interval(failed: Float64, score: Float64, scenes: NDArray[Any], *names: str) -> Interval:
    """Return the interval of an AUC over scenes at large, by a bootstrap of whole scenes, within 0 and 1.

    Scenes that are taken several times count as often in each pair. NaN where scores or scenes are too few.
    """
    every = sorted(set(scenes))
    if not np.isfinite(score).all() or not every:
        return NONE
    bad = [score[(failed == 1.0) & (scenes == scene)] for scene in every]
    good = [score[(failed == 0.0) & (scenes == scene)] for scene in every]
    ahead = np.array([[_pairs_in_order(one, other) for other in good] for one in bad])
    n_bad, n_good = (np.array([float(len(part)) for part in parts]) for parts in (bad, good))

    def of_taken(taken: Float64) -> Float64:
        with np.errstate(invalid="ignore"):
            return np.einsum("bs,st,bt->b", taken, ahead, taken) / ((taken @ n_bad) * (taken @ n_good))

    return clipped(bootstrap_interval(of_taken, len(every), "auc", *names))


def _pairs_in_order(bad: Float64, good: Float64) -> float:
    """Return in how many pairs the first is above the second, ties half."""
    above = bad[:, None] - good[None, :]
    return float((above > 0.0).sum() + 0.5 * (above == 0.0).sum())


def held_out_predictions(features: Float64, failed: Float64, scenes: NDArray[Any]) -> tuple[Float64, Float64]:
    """Return for each sequence the probability by a model fitted to the other scenes, and their share of failures.

    NaN with a single scene.
    """
    chance, base = np.full(len(failed), np.nan), np.full(len(failed), np.nan)
    for scene in sorted(set(scenes)):
        out = scenes == scene
        if not out.all():
            chance[out] = fit_failure_model(features[~out], failed[~out]).probability(features[out])
            base[out] = failed[~out].mean()
    return chance, base


def judged(failed: Float64, chance: Float64, base: Float64, chosen: NDArray[np.bool_]) -> dict[str, Any]:
    """Return n, AUC and Brier scores of predictions, those chosen that there are."""
    kept = chosen & np.isfinite(chance)
    y, p, rate = failed[kept], chance[kept], base[kept]
    row: dict[str, Any] = {"n": len(y), "n_without_success": int(y.sum())}
    row |= dict.fromkeys(("base_rate", "brier", "brier_base", "skill"), float("nan")) | {"auc": auc(y, p)}
    if len(y):
        row |= {"base_rate": float(rate.mean()), "brier": float(np.mean((p - y) ** 2))}
        row["brier_base"] = float(np.mean((rate - y) ** 2))
        row["skill"] = 1.0 - row["brier"] / row["brier_base"] if row["brier_base"] > 0.0 else float("nan")
    return row


def auc(failed: ArrayLike, score: ArrayLike) -> float:
    """Return the chance that a failure scores above a success, ties half (Mann and Whitney); NaN without both."""
    from scipy.stats import rankdata

    y, ranks = np.asarray(failed, dtype=bool), rankdata(np.asarray(score, dtype=np.float64))
    bad, good = int(y.sum()), int((~y).sum())
    return float((ranks[y].sum() - bad * (bad + 1) / 2.0) / (bad * good)) if bad and good else float("nan")


def transformed(table: Columns, names: Sequence[str]) -> Float64:
    """Return features as the model sees them: the logarithm of those that FEATURES says; NaN stays."""
    found = np.zeros((len(table), len(names)))
    for place, name in enumerate(names):
        values = table[name]
        found[:, place] = np.log(np.maximum(values, 0.0) + BOTTOM) if FEATURES[name] else values
    return found


def _labelled(runs: Columns, sequences: Columns, names: list[str], outcome: str) -> Columns:
    """Return the sequences that a system was run on, with indicators and whether half of the runs or more failed."""
    if outcome == TWICE_CLEAN:
        runs = runs.where((runs["perturbation"] != CLEAN) & np.isfinite(runs[outcome]))
    joined = with_indicators(runs, sequences, names)
    failed = 1.0 - np.nan_to_num(runs[outcome]) if outcome in runs else runs["failed"]
    shares = {key: np.mean(group["lost"]) for key, group in runs.with_column("lost", failed).groups(SEQUENCE)}
    return joined.with_column("failed", np.array([float(shares[key] >= 0.5) for key in joined.rows(SEQUENCE)]))


def _standardised(features: ArrayLike, mean: Float64, deviation: Float64) -> Float64:
    given = np.asarray(features, dtype=np.float64)
    scaled = np.divide(given - mean, deviation, out=np.zeros_like(given), where=deviation > 0.0)
    return np.where(np.isfinite(scaled), scaled, 0.0)
