# SPDX-License-Identifier: GPL-3.0-or-later
"""How results spread over scenes, seeds and repeats: means with intervals, and differences to clean, scene by scene.

Errors are averaged on the scale of logarithms: their means are geometric, and compared by ratios. All else is averaged
as it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, isnan
from statistics import fmean
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .cases import CLEAN
from .intervals import (
    Interval,
    clipped,
    difference_here_interval,
    exponential,
    here_interval,
    mean_interval,
    mean_p,
    share_interval,
)
from .run_tables import (
    FAILED,
    HEADLINE,
    INCOMPLETE,
    SETTING,
    Columns,
    is_averaged_in_logs,
    is_error,
    is_score,
    is_share,
    log_errors,
    table_of,
    worst_if_failed,
)

if TYPE_CHECKING:
    from pandas import DataFrame


# Whether a setting differs from clean: tests, corrected for their number, with the size of the effect.


Float64: TypeAlias = NDArray[np.float64]
Row: TypeAlias = dict[str, Any]
Unit: TypeAlias = tuple[Any, ...]  # a scene, or a scene and a seed

TESTS = [
    *("unit", "n", "n_clean", "mean", "clean_mean", "welch_t", "welch_freedom", "welch_p", "welch_p_holm", "hedges_g"),
    *("n_pairs", "wilcoxon_w", "wilcoxon_p", "wilcoxon_p_holm", "rank_biserial"),
]
UNITS = {"scene": ["scene"], "scene and seed": ["scene", "seed"]}


def against_clean_table(runs: Columns, measures: Sequence[str]) -> "DataFrame":
    """Return Welch's test and Wilcoxon's signed-rank test of each setting against clean.

    Each is done twice: a value for each scene, which speaks for scenes at large, and a value for each scene and seed,
    which speaks for these scenes only, as seeds of one scene are no independent scenes. Welch's is of the logarithms of
    errors, and their means are geometric. Holm's correction is over the
    settings of one system, measure and unit.
    """
    rows: list[Row] = []
    for (system,), of_system in runs.groups(["system"]):
        is_clean = of_system["perturbation"] == CLEAN
        clean, perturbed = of_system.where(is_clean), of_system.where(~is_clean)
        for measure in measures:
            for unit, keys in UNITS.items():
                family = [
                    {"system": system, **dict(zip(SETTING, key, strict=True)), "measure": measure, "unit": unit}
                    | _tested(group, clean, measure, keys)
                    for key, group in perturbed.groups(SETTING)
                ]
                _correct(family)
                rows += family
    return table_of(rows, ["system", *SETTING, "measure", *TESTS])


def _tested(runs: Columns, clean: Columns, measure: str, keys: list[str]) -> Row:
    sample, reference = _units(runs, measure, keys), _units(clean, measure, keys)
    row = welch(sample, reference) | wilcoxon(*_paired(runs, clean, measure, keys))
    if is_averaged_in_logs(measure):
        row |= {name: float(np.exp(row[name])) for name in ("mean", "clean_mean")}
    return row


def welch(sample: ArrayLike, clean: ArrayLike) -> Row:
    """Return Welch's t-test of two samples (two-sided) and Hedges' g, the difference over the pooled deviation.

    NaN with fewer than two values on a side, or where neither varies.
    """
    from scipy.stats import ttest_ind_from_stats

    first, second = np.asarray(sample, dtype=np.float64), np.asarray(clean, dtype=np.float64)
    row: Row = {"n": len(first), "n_clean": len(second)}
    row["mean"] = float(np.mean(first)) if len(first) else float("nan")
    row["clean_mean"] = float(np.mean(second)) if len(second) else float("nan")
    nothing = dict.fromkeys(("welch_t", "welch_freedom", "welch_p", "hedges_g"), float("nan"))
    if len(first) < 2 or len(second) < 2:
        return row | nothing
    variances = _variance(first), _variance(second)
    squared = variances[0] / len(first), variances[1] / len(second)
    if not sum(variances) > 0.0:
        return row | nothing
    deviations = np.sqrt(variances)
    result: Any = ttest_ind_from_stats(
        *(row["mean"], deviations[0], len(first)), *(row["clean_mean"], deviations[1], len(second)), equal_var=False
    )
    freedom = len(first) + len(second) - 2
    pooled = np.sqrt(((len(first) - 1) * variances[0] + (len(second) - 1) * variances[1]) / freedom)
    small_samples = 1.0 - 3.0 / (4.0 * freedom - 1.0)  # Hedges 1981
    return row | {
        "welch_t": float(result.statistic),
        "welch_freedom": sum(squared) ** 2 / (squared[0] ** 2 / (len(first) - 1) + squared[1] ** 2 / (len(second) - 1)),
        "welch_p": float(result.pvalue),
        "hedges_g": small_samples * (row["mean"] - row["clean_mean"]) / float(pooled),
    }


def _variance(values: Float64) -> float:
    """Return the sample variance; 0 where values differ by rounding alone."""
    variance = float(np.var(values, ddof=1))
    return variance if variance > (1e-12 * float(np.max(np.abs(values)))) ** 2 else 0.0


def wilcoxon(sample: ArrayLike, clean: ArrayLike) -> Row:
    """Return Wilcoxon's signed-rank test of pairs (two-sided), and the matched-pairs rank-biserial correlation.

    Values may be infinite: a failed run is worse than any other, and two failed runs are equal. Pairs that are equal
    are left out, as Wilcoxon did. The correlation is 1 where every value is above its clean one, -1 where below.
    """
    from scipy.stats import rankdata
    from scipy.stats import wilcoxon as signed_rank

    first, second = np.asarray(sample, dtype=np.float64), np.asarray(clean, dtype=np.float64)
    same = first == second
    difference = first[~same] - second[~same]
    row: Row = {"n_pairs": len(first)} | dict.fromkeys(("wilcoxon_w", "wilcoxon_p", "rank_biserial"), float("nan"))
    if not len(difference):
        return row
    finite = np.abs(difference[np.isfinite(difference)])
    beyond = 2.0 * float(finite.max(initial=1.0))
    difference = np.clip(difference, -beyond, beyond)
    ranks = rankdata(np.abs(difference))
    up, down = float(ranks[difference > 0.0].sum()), float(ranks[difference < 0.0].sum())
    row |= {"wilcoxon_w": min(up, down), "rank_biserial": (up - down) / (up + down)}
    result: Any = signed_rank(difference)
    return row | {"wilcoxon_p": float(result.pvalue)}


def holm(p: ArrayLike) -> Float64:
    """(K,) p-values, NaN where there was no test -> the same after Holm's correction (1979); NaN stays NaN."""
    values = np.asarray(p, dtype=np.float64)
    out = np.full(len(values), np.nan)
    tested = np.flatnonzero(np.isfinite(values))
    order = tested[np.argsort(values[tested], kind="stable")]
    out[order] = np.minimum(np.maximum.accumulate(values[order] * np.arange(len(order), 0, -1)), 1.0)
    return out


def _correct(family: list[Row]) -> None:
    for test in ("welch", "wilcoxon"):
        for row, corrected in zip(family, holm([row[f"{test}_p"] for row in family]), strict=True):
            row[f"{test}_p_holm"] = float(corrected)


def _units(runs: Columns, measure: str, keys: list[str]) -> Float64:
    """Return a value for each unit: the mean of its runs that have one; of an error, of their logarithms."""
    values = log_errors(runs[measure]) if is_averaged_in_logs(measure) else runs[measure]
    return np.array([np.mean(found) for found in _by_unit(runs, values, keys).values()])


def _paired(runs: Columns, clean: Columns, measure: str, keys: list[str]) -> tuple[Float64, Float64]:
    """Return the units' values and those of clean beside them: its own seed's, or else the mean of its scene's.

    A unit's value is the median of its runs; of errors a failed run's is infinite.
    """
    mine, theirs = _medians(runs, measure, keys), _medians(clean, measure, keys)
    of_scene = _medians(clean, measure, ["scene"])
    pairs = []
    for unit, value in mine.items():
        other = theirs.get(unit, of_scene.get(unit[:1]))
        if other is not None:
            pairs.append((value, other))
    both = np.array(pairs, dtype=np.float64).reshape(-1, 2)
    return both[:, 0], both[:, 1]


def _medians(runs: Columns, measure: str, keys: list[str]) -> dict[Unit, float]:
    values = worst_if_failed(runs, measure) if is_error(measure) else runs[measure]
    return {unit: float(np.median(found)) for unit, found in _by_unit(runs, values, keys).items()}


def _by_unit(runs: Columns, values: Float64, keys: list[str]) -> dict[Unit, list[float]]:
    """Return values by unit, in order, NaN left out."""
    found: dict[Unit, list[float]] = {}
    for unit, value in sorted(zip(runs.rows(keys), values.tolist(), strict=True), key=lambda row: row[0]):
        if not isnan(value):
            found.setdefault(unit, []).append(value)
    return found


Cells: TypeAlias = dict[str, dict[int, list[float]]]
"""Values by scene and seed, one for each repeat; of errors their logarithms."""

GEOMETRIC, ARITHMETIC = "geometric", "arithmetic"
COUNTS = ["n_runs", "n_failed", "n_incomplete", "n", "n_scenes"]
MEAN = ["average", "mean", "low", "high", "here_low", "here_high"]
SPREAD = [*COUNTS, *MEAN, "median", "minimum", "maximum", "standard_deviation"]
DIFFERENCE = [
    *("n", "n_scenes", "average", "mean", "clean_mean", "difference", "low", "high", "here_low", "here_high"),
    *("ratio", "ratio_low", "ratio_high", "p", "p_holm"),
]


def spread_of(runs: Columns, measure: str) -> Row:
    """Return how a measure spreads over runs, the columns SPREAD.

    mean: of the scenes' means, so that scenes weigh alike; average: which kind; low, high: its interval over scenes at
    large; here_*: over other seeds (or repeats, where there is one seed) in these scenes. The others are over all runs
    that have a value; the standard deviation of an error is the factor by which it spreads.
    """
    values = runs[measure][np.isfinite(runs[measure])]
    row: Row = dict.fromkeys(SPREAD, float("nan"))
    cells = cells_of(runs, measure)
    row |= {"n_runs": len(runs), "n": len(values), "n_scenes": len(cells), "average": average_of(measure)}
    row |= {f"n_{name}": int(runs[name].sum()) for name in (FAILED, INCOMPLETE)}
    if not len(values):
        return row
    row |= means_with_intervals(cells, measure)
    row |= {"median": float(np.median(values)), "minimum": float(values.min()), "maximum": float(values.max())}
    if len(values) > 1:
        in_logs = is_averaged_in_logs(measure)
        deviation = float(np.std(log_errors(values) if in_logs else values, ddof=1))
        row["standard_deviation"] = float(np.exp(deviation)) if in_logs else deviation
    return row


def average_of(measure: str) -> str:
    """Return which mean is taken of a measure."""
    return GEOMETRIC if is_averaged_in_logs(measure) else ARITHMETIC


def means_with_intervals(cells: Cells, measure: str) -> Row:
    """Return the mean over scenes with both of its intervals, the columns MEAN."""
    units = units_of(cells)
    of_scenes = _means(units)
    mean, here = float(np.mean(of_scenes)), here_interval(units)
    if is_averaged_in_logs(measure):
        (low, high), (here_low, here_high) = exponential(mean_interval(of_scenes)), exponential(here)
        mean = float(np.exp(mean))
    else:
        runs = sum(len(values) for seeds in cells.values() for values in seeds.values())
        (low, high), (here_low, here_high) = _interval(of_scenes, runs, measure), _possible(here, measure)
    row = {"average": average_of(measure), "mean": mean, "low": low, "high": high}
    return row | {"here_low": here_low, "here_high": here_high}


def difference_of(runs: Columns, clean: Columns, measure: str) -> Row:
    """Return how a measure differs from clean in the same scenes, the columns DIFFERENCE.

    Of an error, the ratio of the geometric means, if no clean one is 0, which here_* then are of; of all else the
    difference. Scenes without a
    value on one side are left out. n: values of these runs. p: of no difference over scenes at large, whose interval
    low, high or ratio_low, ratio_high is; p_holm is left to `difference_table`.
    """
    row: Row = dict.fromkeys(DIFFERENCE, float("nan"))
    mine, theirs = cells_of(runs, measure), cells_of(clean, measure)
    scenes = [scene for scene in mine if scene in theirs]
    row |= {"n": sum(len(values) for scene in scenes for values in mine[scene].values()), "n_scenes": len(scenes)}
    row["average"] = average_of(measure)
    if not scenes:
        return row
    ours, others = (units_of({scene: cells[scene] for scene in scenes}) for cells in (mine, theirs))
    means, clean_means = _means(ours), _means(others)
    row |= {"mean": float(np.mean(means)), "clean_mean": float(np.mean(clean_means))}
    difference = row["mean"] - row["clean_mean"]
    ends, here = mean_interval(means - clean_means), difference_here_interval(ours, others)
    row["p"] = mean_p(means - clean_means)
    if not is_averaged_in_logs(measure):
        row |= {"difference": difference, "low": ends.low, "high": ends.high}
        return row | dict(zip(("here_low", "here_high"), here, strict=True))
    row |= {name: float(np.exp(row[name])) for name in ("mean", "clean_mean")}
    if (clean[measure] == 0.0).any():
        return row | {"p": float("nan")}
    row["ratio"] = float(np.exp(difference))
    row["ratio_low"], row["ratio_high"] = exponential(ends)
    row["here_low"], row["here_high"] = exponential(here)
    return row


def cells_of(runs: Columns, measure: str) -> Cells:
    """Return the values of a measure by scene and seed, both in order; runs without one are left out."""
    found: Cells = {}
    values = log_errors(runs[measure]) if is_averaged_in_logs(measure) else runs[measure]
    rows = zip(runs.rows(("scene", "seed")), values.tolist(), strict=True)
    for (scene, seed), value in sorted(rows, key=lambda row: row[0]):
        if isfinite(value):
            found.setdefault(scene, {}).setdefault(seed, []).append(value)
    return found


def units_of(cells: Cells) -> list[Float64]:
    """Return for each scene what is independent there: a mean of each seed, or where there is one seed, its repeats."""
    return [
        np.array([sum(values) / len(values) for values in seeds.values()])
        if len(seeds) > 1
        else np.array(next(iter(seeds.values())))
        for seeds in cells.values()
    ]


def means_of_scenes(table: Columns, measure: str) -> Float64:
    """Return the mean of each scene: of its seeds' means."""
    return _means(units_of(cells_of(table, measure)))


def spread_table(runs: Columns, measures: list[str]) -> "DataFrame":
    """Return the spread of each measure for each system and setting."""
    keys = ["system", *SETTING]
    rows = [
        {**dict(zip(keys, key, strict=True)), "measure": measure, **spread_of(group, measure)}
        for key, group in runs.groups(keys)
        for measure in measures
    ]
    return table_of(rows, [*keys, "measure", *SPREAD])


def difference_table(runs: Columns, measures: list[str]) -> "DataFrame":
    """Return how each setting differs from clean, for each system and measure, scene by scene.

    p_holm: Holm's correction of p over the settings of one system and measure.
    """
    keys = ["system", *SETTING]
    rows = []
    for (system,), of_system in runs.groups(["system"]):
        is_clean = of_system["perturbation"] == CLEAN
        reference = of_system.where(is_clean)
        of_settings: list[Row] = []
        for key, group in of_system.where(~is_clean).groups(SETTING):
            shared = {"system": system, **dict(zip(SETTING, key, strict=True))}
            of_settings += [{**shared, "measure": name, **difference_of(group, reference, name)} for name in measures]
        for name in measures:
            family = [row for row in of_settings if row["measure"] == name]
            for row, corrected in zip(family, holm([row["p"] for row in family]), strict=True):
                row["p_holm"] = float(corrected)
        rows += of_settings
    return table_of(rows, [*keys, "measure", *DIFFERENCE])


def _means(groups: list[Float64]) -> Float64:
    return np.array([np.mean(group) for group in groups])


def _interval(of_scenes: Float64, runs: int, measure: str) -> Interval:
    if is_score(measure):
        return share_interval(of_scenes, runs if is_share(measure) else np.inf)
    return _possible(mean_interval(of_scenes), measure)


def _possible(interval: Interval, measure: str) -> Interval:
    if is_score(measure):
        return clipped(interval)
    return clipped(interval, 0.0, np.inf) if is_error(measure) else interval


# Results over many settings: of each system, by perturbation, by mode, by severity; and curves over severity.


SHOWN = [*MEAN, "median", "minimum", "maximum"]
GROUPED = ["n_settings", *COUNTS, *SHOWN]
CURVE = ["system", "perturbation", "mode", "severity", "measure", *COUNTS, *SHOWN]


def grouped_table(runs: Columns, measures: list[str], by: list[str]) -> "DataFrame":
    """Return each system's perturbed runs, grouped by columns: measures over all settings of a group, with intervals.

    In a scene and seed, settings weigh alike: their runs are averaged first. Clean runs are left out.
    """
    keys = ["system", *by]
    rows: list[dict[str, Any]] = []
    for key, group in runs.where(runs["perturbation"] != CLEAN).groups(keys):
        for measure in measures:
            row = spread_of(group, measure) | over_settings(group, measure)
            named = {**dict(zip(keys, key, strict=True)), "measure": measure, "n_settings": len(set(group["setting"]))}
            rows.append({**named, **{name: row[name] for name in GROUPED if name in row}})
    return table_of(rows, [*keys, "measure", *GROUPED])


def over_settings(runs: Columns, measure: str) -> dict[str, Any]:
    """Return mean and intervals of a measure over settings: of each scene and seed, the mean of its settings' means.

    A setting that was run with fewer seeds than others is the same for all (nothing in it is random), so its mean
    stands for the missing ones.
    """
    settings = [cells_of(group, measure) for _, group in runs.groups(["setting"])]
    found: Cells = {}
    for scene in sorted({scene for cells in settings for scene in cells}):
        there = [cells[scene] for cells in settings if scene in cells]
        means = [{seed: fmean(values) for seed, values in seeds.items()} for seeds in there]
        for seed in sorted({seed for of_setting in means for seed in of_setting}):
            of_seed = [of_setting.get(seed, fmean(of_setting.values())) for of_setting in means]
            found.setdefault(scene, {})[seed] = [fmean(of_seed)]
    return means_with_intervals(found, measure) if found else {}


def curve_table(runs: Columns, measures: list[str]) -> "DataFrame":
    """Return failure curves: each measure over severity for each system, perturbation and mode; clean is severity 0.

    Perturbations without severities are not in it.
    """
    rows: list[dict[str, Any]] = []
    graded = runs.where(np.isfinite(runs["severity"]) & (runs["perturbation"] != CLEAN))
    for (system, perturbation, mode), group in graded.groups(["system", "perturbation", "mode"]):
        clean = runs.where((runs["perturbation"] == CLEAN) & (runs["system"] == system))
        steps = [(0.0, clean)] if len(clean) else []
        steps += [(severity, of_one) for (severity,), of_one in group.groups(["severity"])]
        for severity, of_one in steps:
            named = {"system": system, "perturbation": perturbation, "mode": mode, "severity": severity}
            for measure in measures:
                row = spread_of(of_one, measure) | (over_settings(of_one, measure) if _several(of_one) else {})
                rows.append({**named, "measure": measure, **{name: row[name] for name in (*COUNTS, *SHOWN)}})
    return table_of(rows, CURVE)


def _several(runs: Columns) -> bool:
    return len(set(runs["setting"])) > 1


# Where the spread of an error comes from: the scene, the seed, or the system's own chance on equal files.
#
# Random effects, nested: repeats on the files of one seed, seeds in a scene, scenes in a setting, whose effect is
# fixed. Components are estimated by the method of moments (Henderson's method 1, Biometrics 9, 1953; Searle, Casella
# and McCulloch, Variance Components, 1992, 5.3), which needs no normal values, no equal numbers and no iteration.


ALL = "all"
LEVELS = ("scene", "seed", "repeat")
VARIANCE = [
    *("system", "setting", "measure", "n", "n_scenes"),
    *(f"{level}_factor" for level in LEVELS),
    *(f"{level}_share" for level in LEVELS),
    *(f"{level}_freedom" for level in LEVELS),
]


@dataclass(frozen=True)
class Moments:
    """Sums of squares of nested groups, and how many times each component is in what they are expected to be.

    squares, freedom: (3,) between scenes, between seeds in a scene, between repeats of a seed. times: (3, 3), a row for
    each sum of squares, a column for each component.
    """

    squares: Float64
    freedom: Float64
    times: Float64

    def __add__(self, other: "Moments") -> "Moments":
        return Moments(self.squares + other.squares, self.freedom + other.freedom, self.times + other.times)


def moments_of(cells: Cells) -> Moments:
    """Return the moments of values by scene and seed, at least one."""
    runs = [[np.array(values) for values in seeds.values()] for seeds in cells.values()]
    of_seeds = [np.array([len(values) for values in seeds], dtype=np.float64) for seeds in runs]
    of_scenes = np.array([sizes.sum() for sizes in of_seeds])
    count = float(of_scenes.sum())
    means = [np.array([values.mean() for values in seeds]) for seeds in runs]
    scene_means = np.array([(m * sizes).sum() / sizes.sum() for m, sizes in zip(means, of_seeds, strict=True)])
    mean = float((scene_means * of_scenes).sum() / count)
    between_scenes = float((of_scenes * (scene_means - mean) ** 2).sum())
    between_seeds = sum(
        float((sizes * (m - at) ** 2).sum()) for m, sizes, at in zip(means, of_seeds, scene_means, strict=True)
    )
    between_repeats = sum(float(((values - values.mean()) ** 2).sum()) for seeds in runs for values in seeds)
    within = np.array([(sizes**2).sum() for sizes in of_seeds])
    per_scene = float((within / of_scenes).sum())
    scenes, seeds = len(runs), sum(map(len, runs))
    freedom = np.array([scenes - 1.0, seeds - scenes, count - seeds])
    times = np.zeros((3, 3))
    times[0] = count - float((of_scenes**2).sum()) / count, per_scene - float(within.sum()) / count, freedom[0]
    times[1, 1:] = count - per_scene, freedom[1]
    times[2, 2] = freedom[2]
    return Moments(np.array([between_scenes, between_seeds, between_repeats]), freedom, times)


def components_of(moments: Moments) -> dict[str, float]:
    """Return the variance of each of LEVELS; below 0 where chance made it so.

    NaN for one that nothing varied in: it is then a part of the one above it that is known, as seeds that were run once
    hold the system's own chance.
    """
    found: dict[str, float] = dict.fromkeys(LEVELS, float("nan"))
    known = [place for place in range(3) if moments.freedom[place] > 0.0]
    if known:
        chosen = np.ix_(known, known)
        solved = np.linalg.solve(moments.times[chosen], moments.squares[known])
        found |= {LEVELS[place]: float(value) for place, value in zip(known, solved, strict=True)}
    return found


def variance_table(runs: Columns) -> "DataFrame":
    """Return the components of the errors of each system: in each setting, and over all perturbed ones (ALL).

    Factors are exp of a component's standard deviation, shares those of the components that are known; a component
    below 0 counts as 0. ALL takes scenes and seeds from the settings that were run with several seeds, if some were,
    and the repeats of all.
    """
    rows = []
    measures = [name for name in HEADLINE if name in runs and is_averaged_in_logs(name)]
    for (system,), of_system in runs.groups(["system"]):
        for measure in measures:
            cells = {key: cells_of(group, measure) for key, group in of_system.groups(SETTING)}
            cells = {key: found for key, found in cells.items() if found}
            perturbed = [found for key, found in cells.items() if key[1] != CLEAN]
            named = {"system": system, "measure": measure}
            rows += [named | {"setting": key[0]} | _row([found], moments_of(found)) for key, found in cells.items()]
            if len(perturbed) > 1:
                rows.append(named | {"setting": ALL} | _row(perturbed, _pooled(perturbed)))
    return table_of([row for row in rows if any(row[f"{level}_freedom"] for level in LEVELS)], VARIANCE)


def _pooled(settings: Sequence[Cells]) -> Moments:
    every = list(map(moments_of, settings))
    seeded = [moments for moments in every if moments.freedom[1] > 0.0] or every
    total = sum(seeded[1:], seeded[0])
    others = [moments for moments in every if not any(moments is one for one in seeded)]
    for moments in others:  # their scenes hold no seed's effect, if no seed changes their files: their repeats alone
        repeats = np.array([0.0, 0.0, 1.0])
        total += Moments(moments.squares * repeats, moments.freedom * repeats, moments.times * np.diag(repeats))
    return total


def _row(settings: Sequence[Cells], moments: Moments) -> dict[str, Any]:
    values = components_of(moments)
    bounded = {level: max(value, 0.0) for level, value in values.items() if np.isfinite(value)}
    whole = sum(bounded.values())
    row: dict[str, Any] = {
        "n": sum(len(found) for cells in settings for seeds in cells.values() for found in seeds.values()),
        "n_scenes": len({scene for cells in settings for scene in cells}),
    }
    for level, freedom in zip(LEVELS, moments.freedom.tolist(), strict=True):
        known = level in bounded
        row[f"{level}_factor"] = float(np.exp(np.sqrt(bounded[level]))) if known else float("nan")
        row[f"{level}_share"] = bounded[level] / whole if known and whole > 0.0 else float("nan")
        row[f"{level}_freedom"] = int(freedom)
    return row
