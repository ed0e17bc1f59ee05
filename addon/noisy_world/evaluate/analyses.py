# SPDX-License-Identifier: GPL-3.0-or-later
"""What the runs of systems say together: named tables of what goes together and what predicts an error."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.packages import need
from ..dataset.loader import OpenedSequence
from .cases import CLEAN
from .indicators import AGAINST_CLEAN, IMAGES, MOTION, motion_of
from .metrics import IS_INCOMPLETE, success_over_clean_name
from .spread import (
    NO_INTERVAL,
    Interval,
    against_clean_table,
    bootstrap_interval,
    clipped,
    curve_table,
    difference_table,
    grouped_table,
    mean_interval,
    spread_table,
    variance_table,
)
from .study_tables import (
    LEFT_OUT,
    SCORES,
    SEQUENCE,
    SETTING,
    SUCCESS,
    Row,
    errors_of,
    groups,
    headline_of,
    indicators_in,
    measures_of,
    over_clean_table,
    table_of,
    tidy_runs,
    tidy_sequences,
)

if TYPE_CHECKING:
    from pandas import DataFrame, Series


# What goes together: perturbations and systems with one another, errors with what sequences are like.
#
# And whether that tells if a system will fail on a sequence: a small model, tested on other scenes.


Float64: TypeAlias = NDArray[np.float64]

ALL = "all"
PAIRS = ["mode", "a", "b", "n", "n_scenes", "spearman", "p"]
INDICATED = [
    *("system", "perturbation", "indicator", "n", "n_scenes", "pearson", "low", "high", "p"),
    *("pearson_log10", "low_log10", "high_log10", "p_log10", "n_ranked", "spearman", "spearman_p"),
]
FEWEST = 4
"""Pairs of values below which no correlation is given."""


def perturbation_correlations(runs: "DataFrame") -> "DataFrame":
    """Return Spearman's correlation of the ATE under each two perturbations: over systems, scenes and severities.

    The modes apart; "" are perturbations without modes. A failed run is worse than any other.
    """
    rows = []
    for (mode,), of_mode in groups(runs[runs["perturbation"] != CLEAN], ["mode"]):
        rows += _pairs(mode, of_mode, ["system", "scene", "severity"], "perturbation")
    return table_of(rows, PAIRS)


def system_correlations(runs: "DataFrame") -> "DataFrame":
    """Return Spearman's correlation of the ATE of each two systems: over scenes and perturbed settings, each mode.

    Mode "all" is over all settings. A failed run is worse than any other.
    """
    perturbed = runs[runs["perturbation"] != CLEAN]
    rows = _pairs(ALL, perturbed, ["scene", "setting"], "system")
    for (mode,), of_mode in groups(perturbed, ["mode"]):
        rows += _pairs(mode, of_mode, ["scene", "setting"], "system")
    return table_of(rows, PAIRS)


def indicator_correlations(runs: "DataFrame", sequences: "DataFrame") -> "DataFrame":
    """Return Pearson's correlation of ATE and log10 ATE with each indicator's mean, for each system.

    Over all sequences (perturbation "all") and those of each perturbation with the clean ones. Pearson's leaves out
    runs without an error; Spearman's counts them as worse than any other. Intervals are Fisher's, as if sequences were
    independent.
    """
    rows = []
    for (system,), of_system in groups(runs, ["system"]):
        joined = with_indicators(of_system, sequences, indicators_in(sequences))
        clean = joined["perturbation"] == CLEAN
        chosen = {ALL: joined}
        for name in sorted(set(joined["perturbation"][~clean])):
            chosen[name] = joined[clean | (joined["perturbation"] == name)]
        for perturbation, group in chosen.items():
            for name in indicators_in(sequences):
                row = {"system": system, "perturbation": perturbation, "indicator": name.removesuffix("_mean")}
                rows.append(row | _with_indicator(group, name))
    return table_of(rows, INDICATED)


def with_indicators(runs: "DataFrame", sequences: "DataFrame", names: list[str]) -> "DataFrame":
    """Return a row for each sequence that was run: SEQUENCE, perturbation, columns of its indicators, and its error.

    error: the median ATE of the runs, infinite for a failed one.
    """
    errors = runs[[*SEQUENCE, "perturbation"]].assign(error=errors_of(runs))
    medians = errors.groupby([*SEQUENCE, "perturbation"], as_index=False)["error"].median()
    last = sequences.drop_duplicates(SEQUENCE, keep="last")
    return medians.merge(last[[*SEQUENCE, *names]], on=SEQUENCE)


def pearson(x: ArrayLike, y: ArrayLike) -> tuple[float, float, float, float]:
    """Return Pearson's correlation, the ends of Fisher's 95 % interval and the p-value; NaN where it has none."""
    from scipy.stats import pearsonr

    a, b = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if len(a) < FEWEST or _constant(a) or _constant(b):
        return float("nan"), float("nan"), float("nan"), float("nan")
    result: Any = pearsonr(a, b)
    low, high = result.confidence_interval(0.95)
    return float(result.statistic), float(low), float(high), float(result.pvalue)


def spearman(x: ArrayLike, y: ArrayLike) -> tuple[float, float]:
    """Return Spearman's correlation and its p-value by Student's t; NaN where it has none. Infinity is a value."""
    from scipy.stats import rankdata, spearmanr

    a, b = rankdata(np.asarray(x, dtype=np.float64)), rankdata(np.asarray(y, dtype=np.float64))
    if len(a) < FEWEST or _constant(a) or _constant(b):
        return float("nan"), float("nan")
    result: Any = spearmanr(a, b)
    return float(result.statistic), float(result.pvalue)


def _with_indicator(group: "DataFrame", name: str) -> dict[str, Any]:
    known = group[np.isfinite(group[name])]
    values, errors = known[name].to_numpy(), known["error"].to_numpy()
    finite = np.isfinite(errors)
    positive = finite & (errors > 0.0)
    row: dict[str, Any] = {"n": int(finite.sum()), "n_scenes": known["scene"].nunique(), "n_ranked": len(known)}
    logs = np.log10(errors[positive])
    for suffix, indicated, of in (("", values[finite], errors[finite]), ("_log10", values[positive], logs)):
        columns = (f"pearson{suffix}", f"low{suffix}", f"high{suffix}", f"p{suffix}")
        row |= dict(zip(columns, pearson(indicated, of), strict=True))
    row["spearman"], row["spearman_p"] = spearman(values, errors)
    return row


def _pairs(mode: str, runs: "DataFrame", cell: list[str], compared: str) -> list[dict[str, Any]]:
    """Return Spearman's correlations of the errors of each two values of a column, over the cells that both have."""
    errors = runs[[compared, *cell]].assign(error=errors_of(runs))
    table = errors.groupby([*cell, compared], dropna=False)["error"].median().unstack(compared)
    rows = []
    for a, b in combinations(table.columns, 2):
        both = table[[a, b]].dropna()
        rho, p = spearman(both[a], both[b])
        row = {"mode": mode, "a": a, "b": b, "n": len(both)}
        scenes = both.index.get_level_values("scene").nunique()
        rows.append({**row, "n_scenes": scenes, "spearman": rho, "p": p})
    return rows


def _constant(values: Any) -> bool:
    """Tell whether values do not vary, but for rounding."""
    return float(np.ptp(values)) <= 1e-13 * float(np.max(np.abs(values), initial=0.0))


# --- can the data alone tell? ---

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
    for (system,), of_system in groups(runs, ["system"]):
        for outcome in outcomes:
            labelled = _labelled(of_system, sequences, names, outcome)
            if not len(labelled):
                continue
            key = {"system": system, "outcome": outcome}
            features, failed = transformed(labelled, names), labelled["failed"].to_numpy()
            scenes = labelled["scene"].to_numpy()
            chance, base = held_out_predictions(features, failed, scenes)
            folds += [{**key, **row} for row in _folds(failed, chance, base, scenes, system)]
            model = fit_failure_model(features, failed)
            for name, *values in zip(names, model.coefficients, model.mean, model.deviation, strict=True):
                row = dict(zip(("coefficient", "mean", "standard_deviation"), map(float, values), strict=True))
                coefficients.append({**key, "feature": name, **row, "n": len(failed)})
            for place, *values in zip(
                labelled[SEQUENCE].itertuples(index=False, name=None), failed, chance, base, strict=True
            ):
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
        ends = auc_interval(failed, chance, scenes, system) if scene == ALL else NO_INTERVAL
        row |= {"n_scenes": len(set(scenes[chosen])), "auc_low": ends.low, "auc_high": ends.high}
        yield row | judged(failed, chance, base, chosen)


def auc_interval(failed: Float64, score: Float64, scenes: NDArray[Any], *names: str) -> Interval:
    """Return the interval of an AUC over scenes at large, by a bootstrap of whole scenes, within 0 and 1.

    Scenes that are taken several times count as often in each pair. NaN where scores or scenes are too few.
    """
    every = sorted(set(scenes))
    if not np.isfinite(score).all() or not every:
        return NO_INTERVAL
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


def transformed(table: "DataFrame", names: Sequence[str]) -> Float64:
    """Return features as the model sees them: the logarithm of those that FEATURES says; NaN stays."""
    columns = [np.log(np.maximum(table[name], 0.0) + BOTTOM) if FEATURES[name] else table[name] for name in names]
    return np.array(columns, dtype=np.float64).reshape(len(names), len(table)).T


def _labelled(runs: "DataFrame", sequences: "DataFrame", names: list[str], outcome: str) -> "DataFrame":
    """Return the sequences that a system was run on, with indicators and whether half of the runs or more failed."""
    if outcome == TWICE_CLEAN:
        runs = runs[(runs["perturbation"] != CLEAN) & runs[outcome].notna()]
    lost = 1.0 - runs[outcome].fillna(0.0) if outcome in runs else runs["failed"]
    shares = lost.groupby([runs[name] for name in SEQUENCE]).mean().rename("share").reset_index()
    joined = with_indicators(runs, sequences, names).merge(shares, on=SEQUENCE)
    return joined.assign(failed=(joined["share"] >= 0.5).astype(float))


def _standardised(features: ArrayLike, mean: Float64, deviation: Float64) -> Float64:
    given = np.asarray(features, dtype=np.float64)
    scaled = np.divide(given - mean, deviation, out=np.zeros_like(given), where=deviation > 0.0)
    return np.where(np.isfinite(scaled), scaled, 0.0)


DEPTH = ("depth_missing", "depth_median_m", "depth_noise_m", "depth_error_m")
PICTURES = tuple(name for name in (*IMAGES, *AGAINST_CLEAN) if name not in DEPTH)
COLUMNS = [
    *SETTING,
    "indicator",
    "n",
    "n_scenes",
    "mean",
    "low",
    "high",
    "minimum",
    "maximum",
    "low_frames",
    "high_frames",
]

DEPTH_BIN_M = 0.25
FARTHEST_M = 10.0


_INTERVALS = (
    "means of errors are geometric; low and high: 95 % for scenes at large; here_low and here_high: for other seeds in "
    "these scenes"
)

CAPTIONS = {
    "over_clean": "ATE over that of the same system on clean frames of the same scenes and seeds: geometric means of n "
    f"runs. Runs that failed, or are incomplete ({IS_INCOMPLETE}), are in no ratio.",
    "spread": f"Every measure of each system and setting, over scenes, seeds and repeats; {_INTERVALS}. {LEFT_OUT}",
    "variance": "Where the spread of errors comes from: the factor by which another scene, another seed and another "
    "run on the same files change an error (exp of a standard deviation), and its share of the variance. Nested random "
    "effects of the logarithms, by moments; freedom: the degrees that a factor stands on. Without repeats a seed's "
    "factor holds the system's own chance, without seeds a scene's holds theirs; all: over the perturbed settings.",
    "differences": f"Every measure against clean, scene by scene; of errors the ratio to it; {_INTERVALS}.",
    "tests": "Tests against clean, two-sided, Holm's correction over settings. Welch's: of logarithms of errors, "
    "without runs that failed or are incomplete; Wilcoxon's: with them as the worst.",
    "curves": f"Failure curves: measures over severity, clean at 0; {_INTERVALS}.",
    "systems": f"Each system over all perturbed settings, which weigh alike in a scene; {_INTERVALS}.",
    "by_perturbation": f"Each system and perturbation over its severities and modes; {_INTERVALS}.",
    "by_mode": f"Each system and mode over perturbations and severities; {_INTERVALS}.",
    "by_severity": f"Each system and severity over perturbations and modes; {_INTERVALS}.",
    "robustness": "Score over the own clean score (mRR), error over the baseline's (mCE); 95 %, bootstrap of scenes.",
    "perturbation_correlations": "Spearman: ATE under two perturbations, over systems, scenes and severities.",
    "system_correlations": "Spearman: ATE of two systems, over scenes and settings; failed and incomplete runs are "
    "worst.",
    "indicator_correlations": "Pearson: ATE, log10 ATE with what sequences are like; Spearman: failed and incomplete "
    "runs as worst.",
    "prediction": "Predicting runs without success (the outcome is not 1) in scenes that the model was not fitted on; "
    "auc_low, auc_high: 95 % for scenes at large.",
    "prediction_coefficients": "That model, fitted to all scenes: above 0, more of the feature goes with failure.",
    "predictions": "The predicted probability of no success on each sequence, by the model without its scene.",
    "images": "What the images of each setting are like, over its sequences; frames are sampled.",
    "depth": "What the depth of each setting is like, over its sequences; frames are sampled.",
    "motion": "How fast the camera moves and turns in each setting, from the true poses.",
}
"""One line for each table of analyse, in the order in which they are shown."""


def analyse(runs: "DataFrame", sequences: "DataFrame") -> dict[str, "DataFrame"]:
    """Return every table of CAPTIONS from the tables of runs and of sequences (tables/runs.csv, tables/sequences.csv).

    The same tables give the same results, whatever their rows' order. Cells without a value are NaN; a table that
    nothing can be said in has columns and no rows. Raises MissingDependencyError without the extra evaluate.
    """
    need(["scipy", "pandas"], "evaluate")
    table, about = tidy_runs(runs), tidy_sequences(sequences)
    headline, measures = headline_of(table), measures_of(table)
    folds, coefficients, predicted = prediction_tables(table, about)
    tables = {
        "over_clean": over_clean_table(table, ["system", *SETTING]),
        "spread": spread_table(table, measures),
        "variance": variance_table(table),
        "differences": difference_table(table, measures),
        "tests": against_clean_table(table, headline),
        "curves": curve_table(table, headline),
        "systems": grouped_table(table, headline, []),
        "by_perturbation": grouped_table(table, headline, ["perturbation"]),
        "by_mode": grouped_table(table, headline, ["mode"]),
        "by_severity": grouped_table(table, headline, ["severity"]),
        "robustness": robustness_table(table),
        "perturbation_correlations": perturbation_correlations(table),
        "system_correlations": system_correlations(table),
        "indicator_correlations": indicator_correlations(table, about),
        "prediction": folds,
        "prediction_coefficients": coefficients,
        "predictions": predicted,
        **sequences_tables(about),
    }
    return {name: tables[name] for name in CAPTIONS}


def sequences_tables(sequences: "DataFrame") -> dict[str, "DataFrame"]:
    """Return the tables images, depth and motion: each indicator of each setting, over its sequences.

    mean, low, high: of the scenes' means, with the interval over scenes at large; minimum, maximum: of the sequences'
    means; low_frames, high_frames: means of the sequences' 5 % and 95 % quantiles of frames.
    """
    parts = {"images": PICTURES, "depth": DEPTH, "motion": MOTION}
    rows: dict[str, list[dict[str, Any]]] = {part: [] for part in parts}
    for key, group in groups(sequences, SETTING):
        for part, names in parts.items():
            named = dict(zip(SETTING, key, strict=True))
            rows[part] += [named | _of_indicator(group, name) for name in names if f"{name}_mean" in group]
    return {part: table_of([row for row in rows[part] if row["n"]], COLUMNS) for part in parts}


def _of_indicator(sequences: "DataFrame", name: str) -> dict[str, Any]:
    known = sequences[np.isfinite(sequences[f"{name}_mean"])]
    values = known[f"{name}_mean"]
    of_scenes = values.groupby([known["scene"], known["seed"]]).mean().groupby(level="scene").mean()
    row = {"indicator": name, "n": len(known), "n_scenes": len(of_scenes), "mean": of_scenes.mean()}
    row |= {**mean_interval(of_scenes)._asdict(), "minimum": values.min(), "maximum": values.max()}
    for end in ("low", "high"):
        row[f"{end}_frames"] = known[f"{name}_{end}"].mean() if f"{name}_{end}" in known else float("nan")
    return row


def depth_distribution(sequence: OpenedSequence, *, every: int = 10) -> "DataFrame":
    """Return how a sequence's depth is distributed: the share of the pixels that have depth in each bin, and how many.

    Bins of 25 cm up to 10 m; the last is what lies beyond, its to_m infinite. Columns: from_m, to_m, share, pixels.
    every: of the frames. The share of pixels without depth is the indicator depth_missing. Raises ValueError for every
    < 1.
    """
    from pandas import DataFrame

    if every < 1:
        raise ValueError(f"every is 1 or more, not {every}")
    edges = np.append(np.arange(0.0, FARTHEST_M + DEPTH_BIN_M / 2.0, DEPTH_BIN_M), np.inf)
    counts = np.zeros(len(edges) - 1, dtype=np.int64)
    for frame in list(sequence)[::every]:
        depth_m = frame.depth_m
        places = (depth_m[depth_m > 0.0] / DEPTH_BIN_M).astype(np.int64)
        counts += np.bincount(np.minimum(places, len(counts) - 1), minlength=len(counts))
    shares = counts / counts.sum() if counts.sum() else np.full(len(counts), np.nan)
    return DataFrame({"from_m": edges[:-1], "to_m": edges[1:], "share": shares, "pixels": counts})


def motion_distribution(sequence: OpenedSequence) -> "DataFrame":
    """Return quantiles of a sequence's motion over its frames: columns quantile and those of motion_of."""
    from pandas import DataFrame

    frames = list(sequence)
    columns = motion_of(np.stack([frame.c2w for frame in frames]), [frame.stamp_s for frame in frames])
    quantiles = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
    columns_of: dict[str, Any] = {"quantile": quantiles}
    for name, values in columns.items():
        known = values[np.isfinite(values)]
        columns_of[name] = np.quantile(known, quantiles) if known.size else np.full(len(quantiles), np.nan)
    return DataFrame(columns_of)


# --- robustness ---
#
# Kong et al., "Robo3D: Towards robust and reliable 3D perception against corruptions", ICCV 2023, with the corruption
# error after Hendrycks and Dietterich, ICLR 2019. Scores go from 0 (worst) to 1, such as `success_auc`; an error is
# 1 - score there.

BASELINE = "rgbd_odometry"
ROBUSTNESS = [
    *("system", "score", "perturbation", "n_perturbations", "n_scenes", "n_cells"),
    *("mrr", "mrr_low", "mrr_high", "baseline", "mce", "mce_low", "mce_high"),
]


def robustness_table(runs: "DataFrame") -> "DataFrame":
    """Return mRR and mCE of each system and score: over all perturbations, and the rate of each one.

    The scores of a cell (scene and setting) are the mean of its runs. mRR compares with the system's own clean cells in
    the same scenes, mCE with the baseline's errors (1 - score) in the cells that both have: rgbd_odometry, or the first
    system by name where it was not run. The baseline has none, as it would be compared with itself.
    """
    rows: list[Row] = []
    systems = sorted(set(runs["system"]))
    baseline = BASELINE if BASELINE in systems else next(iter(systems), "")
    for score in (name for name in SCORES if name in runs):
        known = runs[runs[score].notna()]
        cells = known.groupby(["system", "perturbation", "scene", "setting"])[score].mean()
        for system in systems:
            against = baseline if system != baseline else ""
            own, theirs = (
                cells[cells.index.get_level_values("system") == name].droplevel("system") for name in (system, against)
            )
            rows += _of_system(own, theirs, (system, score, against))
    return table_of(rows, ROBUSTNESS)


def _of_system(own: "Series", theirs: "Series", names: tuple[str, str, str]) -> list[Row]:
    """Return a row for all perturbations, and for each. own, theirs: scores by perturbation, scene and setting."""
    is_clean = own.index.get_level_values("perturbation") == CLEAN
    perturbed, clean = own[~is_clean], own[is_clean].groupby(level="scene").mean()
    rows: dict[str, Row] = {}
    every = perturbed.index.to_frame(index=False)
    for name in (ALL, *sorted(set(every["perturbation"]))):
        there = every if name == ALL else every[every["perturbation"] == name]
        counts = {f"n_{of}s": there[of].nunique() for of in ("perturbation", "scene")} | {"n_cells": len(there)}
        named = dict(zip(("system", "score", "baseline"), names, strict=True))
        rows[name] = {**named, "perturbation": name, **counts}
    held = perturbed[perturbed.index.get_level_values("scene").isin(clean.index)]
    _fill(rows, "mrr", held, names[:2], lambda taken, sums: _resilience(taken, sums, held, clean))
    both = perturbed[perturbed.index.isin(theirs.index)]
    below = _sums(1.0 - theirs.reindex(both.index))
    _fill(rows, "mce", 1.0 - both, names[:2], lambda taken, sums: _ratio(taken @ sums, taken @ below))
    return list(rows.values())


def _resilience(taken: Float64, sums: Float64, scores: "Series", clean: "Series") -> Float64:
    """(B, S), (S, P) -> (B, P): for each perturbation the mean of its scores over the mean clean one."""
    scenes = sorted(set(scores.index.get_level_values("scene")))
    of_clean = (taken @ clean.reindex(scenes).to_numpy() / taken.sum(axis=1))[:, None]
    return _ratio(_ratio(taken @ sums, taken @ _sums(scores.notna().astype(float))), of_clean)


def _sums(cells: "Series") -> Float64:
    """Return (S, P): the sum over the settings of each scene and perturbation, both in order."""
    return cells.groupby(level=["scene", "perturbation"]).sum().unstack("perturbation").fillna(0.0).to_numpy()


def _fill(
    rows: dict[str, Row],
    column: str,
    cells: "Series",
    names: tuple[str, str],
    rates: Callable[[Float64, Float64], Float64],
) -> None:
    """Write a rate with its interval into the row of all perturbations and into each one's.

    rates: (B, S) how often each scene is taken, and (S, P) sums -> (B, P) the rate of each perturbation.
    """
    if cells.empty:
        return
    sums, scenes = _sums(cells), cells.index.get_level_values("scene").nunique()
    perturbations = sorted(set(cells.index.get_level_values("perturbation")))
    once = rates(np.ones((1, scenes)), sums)[0]
    kept = np.flatnonzero(np.isfinite(once))
    parts = {perturbations[place]: np.array([place]) for place in kept}
    for name, places in {ALL: kept, **parts}.items() if len(kept) else ():
        interval = bootstrap_interval(
            lambda taken, at=places: rates(taken, sums)[:, at].mean(axis=1), scenes, column, *names, name
        )
        ends = {f"{column}_low": np.maximum(interval.low, 0.0), f"{column}_high": interval.high}
        rows[name] |= {column: float(once[places].mean()), **ends}


def _ratio(above: Float64, below: Float64) -> Float64:
    """Return a quotient; NaN where it would be divided by 0."""
    out = np.full(np.broadcast_shapes(above.shape, below.shape), np.nan)
    return np.divide(above, below, out=out, where=np.broadcast_to(below, out.shape) > 0.0)
