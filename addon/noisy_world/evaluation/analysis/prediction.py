# SPDX-License-Identifier: GPL-3.0-or-later
"""Can a sequence's indicators tell whether a system will fail on it? A small model, tested on other scenes."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .run_table import SEQUENCE

if TYPE_CHECKING:
    from pandas import DataFrame

type Float64 = NDArray[np.float64]

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

SUCCESS = "success_10cm"
BOTTOM = 1e-3

FOLDS = ["system", "held_out", "n", "n_failed", "n_fitted", "base_rate", "auc", "brier", "brier_base", "skill"]
COEFFICIENTS = ["system", "feature", "coefficient", "mean", "standard_deviation", "n"]
PREDICTED = ["system", *SEQUENCE, "failed", "predicted", "base_rate"]
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


def prediction_tables(runs: "DataFrame", sequences: "DataFrame") -> tuple["DataFrame", "DataFrame", "DataFrame"]:
    """Return how well failure is predicted in scenes that the model has not seen, its coefficients, and each prediction.

    A run failed where success_10cm is not 1. The unit is a sequence: repeats of a system on it are averaged, and a half
    or more of failures is one. Each scene in turn is left out of the fit and predicted; row "all" is over all of them.
    base_rate is the share of failures in the fit, brier_base the Brier score of saying nothing else, skill 1 - brier /
    brier_base. The coefficients are those of the fit to all scenes.
    """
    from pandas import DataFrame

    folds, coefficients, predicted = [], [], []
    names = [name for name in FEATURES if name in sequences]
    for system, of_system in _labelled(runs, sequences, names).groupby("system", sort=True):
        features = transformed(of_system[names])
        failed, scenes = of_system["failed"].to_numpy(), of_system["scene"].to_numpy()
        chance, base = held_out_predictions(features, failed, scenes)
        for scene in [*sorted(set(scenes)), ALL]:
            chosen = np.ones(len(scenes), bool) if scene == ALL else scenes == scene
            fitted = 0 if scene == ALL else int((~chosen).sum())
            folds.append(
                {"system": system, "held_out": scene, **judged(failed, chance, base, chosen), "n_fitted": fitted}
            )
        model = fit_failure_model(features, failed)
        for name, *values in zip(names, model.coefficients, model.mean, model.deviation, strict=True):
            row = dict(zip(("coefficient", "mean", "standard_deviation"), map(float, values), strict=True))
            coefficients.append({"system": system, "feature": name, **row, "n": len(failed)})
        shown = of_system[["system", *SEQUENCE, "failed"]].assign(predicted=chance, base_rate=base)
        predicted += shown.to_dict("records")
    return (
        DataFrame(folds, columns=FOLDS),
        DataFrame(coefficients, columns=COEFFICIENTS),
        DataFrame(predicted, columns=PREDICTED),
    )


def held_out_predictions(features: Float64, failed: Float64, scenes: NDArray[Any]) -> tuple[Float64, Float64]:
    """Return for each sequence the probability by a model that was fitted to the other scenes, and their share of failures.

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
    row: dict[str, Any] = {"n": len(y), "n_failed": int(y.sum())}
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


def transformed(features: "DataFrame") -> Float64:
    """Return features as the model sees them: the logarithm of those that FEATURES says; NaN stays."""
    columns = []
    for name in features.columns:
        values = features[name].to_numpy(dtype=np.float64)
        columns.append(np.log(np.maximum(values, 0.0) + BOTTOM) if FEATURES[str(name)] else values)
    return np.column_stack(columns) if columns else np.zeros((len(features), 0))


def _labelled(runs: "DataFrame", sequences: "DataFrame", names: list[str]) -> "DataFrame":
    success = runs[SUCCESS].fillna(0.0) if SUCCESS in runs else 1.0 - runs["failed"]
    labelled = runs.assign(failed=1.0 - success)
    shares = labelled.groupby(["system", *SEQUENCE], sort=True, as_index=False)["failed"].mean()
    shares["failed"] = (shares["failed"] >= 0.5).astype(float)
    return shares.merge(sequences[[*SEQUENCE, *names]], on=SEQUENCE, how="inner")


def _standardised(features: ArrayLike, mean: Float64, deviation: Float64) -> Float64:
    given = np.asarray(features, dtype=np.float64)
    scaled = np.divide(given - mean, deviation, out=np.zeros_like(given), where=deviation > 0.0)
    return np.where(np.isfinite(scaled), scaled, 0.0)
