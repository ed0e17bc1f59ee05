# SPDX-License-Identifier: GPL-3.0-or-later
"""How results spread over scenes, seeds and repeats, whether they differ from clean, and where the spread comes from.

Errors are averaged on the scale of logarithms: their means are geometric, and compared by ratios. All else is averaged
as it is. Tables are worked out for all groups of runs and all measures at once: arrays are (groups, measures), and of
scenes (groups, measures, scenes).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .cases import CLEAN
from .intervals import (
    Interval,
    SceneValues,
    clipped,
    difference_here_interval,
    exponential,
    here_interval,
    mean_interval,
    mean_over_scenes,
    mean_p,
    share_interval,
)
from .run_tables import (
    COUNTS,
    FAILED,
    HEADLINE,
    INCOMPLETE,
    SETTING,
    groups,
    is_averaged_in_logs,
    is_error,
    is_score,
    is_share,
    log_errors,
    table_of,
    worst_if_failed,
)

if TYPE_CHECKING:
    from pandas import DataFrame, Index

Float64: TypeAlias = NDArray[np.float64]
Row: TypeAlias = dict[str, Any]

MEAN = ["average", "mean", "low", "high", "here_low", "here_high"]
EXTREMES = ["median", "minimum", "maximum"]
SPREAD = [*COUNTS, *MEAN, *EXTREMES, "standard_deviation"]
DIFFERENCE = [
    *("n", "n_scenes", "average", "mean", "clean_mean", "difference", "low", "high", "here_low", "here_high"),
    *("ratio", "ratio_low", "ratio_high", "p", "p_holm"),
]
CURVE = ["system", "perturbation", "mode", "severity"]


def spread_table(runs: "DataFrame", measures: Sequence[str]) -> "DataFrame":
    """Return the spread of each measure for each system and setting, the columns SPREAD.

    mean: of the scenes' means, so that scenes weigh alike; average: which kind; low, high: its interval over scenes at
    large; here_*: over other seeds (or repeats, where there is one seed) in these scenes. The others are over all runs
    that have a value; the standard deviation of an error is the factor by which it spreads.
    """
    grouped = GroupedRuns.of(runs, ["system", *SETTING], measures)
    return grouped.table({**grouped.counts(), **grouped.means(grouped.cells()), **grouped.extremes()}, SPREAD)


def grouped_table(runs: "DataFrame", measures: Sequence[str], by: Sequence[str]) -> "DataFrame":
    """Return each system's perturbed runs, grouped by columns: measures over all settings of a group, with intervals.

    In a scene and seed, settings weigh alike: their runs are averaged first. Clean runs are left out.
    """
    grouped = GroupedRuns.of(runs[runs["perturbation"] != CLEAN], ["system", *by], measures)
    columns = {"n_settings": grouped.settings, **grouped.counts(), **grouped.means(grouped.cells_over_settings())}
    return grouped.table({**columns, **grouped.extremes()}, ["n_settings", *COUNTS, *MEAN, *EXTREMES])


def curve_table(runs: "DataFrame", measures: Sequence[str]) -> "DataFrame":
    """Return failure curves: each measure over severity for each system, perturbation and mode; clean is severity 0.

    Perturbations without severities are not in it.
    """
    from pandas import concat

    is_clean = runs["perturbation"] == CLEAN
    graded = runs[runs["severity"].notna() & ~is_clean]
    lines = graded[CURVE[:-1]].drop_duplicates()
    clean = lines.merge(runs[is_clean].drop(columns=CURVE[1:]), on="system").assign(severity=0.0)
    grouped = GroupedRuns.of(concat([clean[list(graded)], graded], ignore_index=True), CURVE, measures)
    alone, averaged = grouped.means(grouped.cells()), grouped.means(grouped.cells_over_settings())
    means = {name: np.where(grouped.settings > 1, averaged[name], alone[name]) for name in MEAN}
    return grouped.table({**grouped.counts(), **means, **grouped.extremes()}, [*COUNTS, *MEAN, *EXTREMES])


def difference_table(runs: "DataFrame", measures: Sequence[str]) -> "DataFrame":
    """Return how each setting differs from clean in the same scenes, for each system and measure, columns DIFFERENCE.

    Of an error, the ratio of the geometric means, if no clean one is 0, which here_* then are of; of all else the
    difference. Scenes without a value on one side are left out. n: values of these runs. p: of no difference over
    scenes at large, whose interval low, high or ratio_low, ratio_high is; p_holm: Holm's correction of p over the
    settings of one system and measure.
    """
    is_clean = runs["perturbation"] == CLEAN
    grouped = GroupedRuns.of(runs[~is_clean], ["system", *SETTING], measures)
    clean = GroupedRuns.of(runs[is_clean], ["system"], measures)
    ours, theirs = grouped.cells(), clean.cells()
    place = {name: number for number, name in enumerate(clean.names["system"])}
    at = grouped.names["system"].map(place).fillna(-1).to_numpy(dtype=int)  # the last is that of no clean runs
    scenes = grouped.scene_values(ours)
    others = clean.scene_values(theirs, scenes=sorted(set(grouped.runs["scene"])))
    others = SceneValues(*(np.pad(part, ((0, 1), (0, 0), (0, 0)), constant_values=np.nan)[at] for part in others))
    both = np.isfinite(scenes.mean) & np.isfinite(others.mean)
    scenes, others = (SceneValues(*(np.where(both, part, np.nan) for part in each)) for each in (scenes, others))
    apart = scenes.mean - others.mean
    means, clean_means = mean_over_scenes(scenes.mean), mean_over_scenes(others.mean)
    ends, here = mean_interval(apart), difference_here_interval(scenes, others)
    logs = grouped.in_logs
    least = runs[is_clean].groupby("system")[list(measures)].min().reindex(grouped.names["system"])
    without = logs & (least.to_numpy(dtype=np.float64) == 0.0)
    ratio, of_ratio, of_here = _exp(means - clean_means, logs), exponential(ends), exponential(here)
    columns = {
        "n": np.where(both, grouped.counted(ours), 0).sum(axis=-1),
        "n_scenes": both.sum(axis=-1),
        "average": grouped.average,
        "mean": _exp(means, logs),
        "clean_mean": _exp(clean_means, logs),
        "difference": np.where(logs, np.nan, means - clean_means),
        "low": np.where(logs, np.nan, ends.low),
        "high": np.where(logs, np.nan, ends.high),
        "ratio": np.where(logs & ~without, ratio, np.nan),
        "p": np.where(without, np.nan, mean_p(apart)),
    }
    for end in ("low", "high"):
        columns[f"ratio_{end}"] = np.where(logs & ~without, getattr(of_ratio, end), np.nan)
        in_scale = np.where(logs, getattr(of_here, end), getattr(here, end))
        columns[f"here_{end}"] = np.where(without, np.nan, in_scale)
    table = grouped.table(columns, DIFFERENCE)
    table["p_holm"] = table.groupby(["system", "measure"])["p"].transform(lambda family: holm(family.to_numpy()))
    return table


class GroupedRuns(NamedTuple):
    """Runs in groups: by the values of some columns, those without a value first.

    names: a row for each group. numbers: (N,) the group of each run. values: (N, M) measures, errors as logarithms.
    """

    runs: "DataFrame"
    names: "DataFrame"
    numbers: NDArray[np.int64]
    values: "DataFrame"

    @classmethod
    def of(cls, runs: "DataFrame", keys: Sequence[str], measures: Sequence[str]) -> "GroupedRuns":
        """Group runs."""
        names = runs[list(keys)].drop_duplicates()
        order = names.reset_index(drop=True).sort_values(list(keys), na_position="first").index.to_numpy()
        met = runs.groupby(list(keys), dropna=False, sort=False).ngroup().to_numpy()  # as they come
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(len(order))
        columns = {name: log_errors(runs[name]) if is_averaged_in_logs(name) else runs[name] for name in measures}
        values = runs[[]].assign(**columns)
        return cls(runs, names.iloc[order].reset_index(drop=True), rank[met], values.where(np.isfinite(values)))

    @property
    def measures(self) -> list[str]:
        """The measures' names."""
        return list(map(str, self.values.columns))

    @property
    def in_logs(self) -> NDArray[np.bool_]:
        """(1, M): which are errors, as logarithms."""
        return np.array([[is_averaged_in_logs(name) for name in self.measures]])

    @property
    def average(self) -> NDArray[Any]:
        """(1, M): which mean is taken of each."""
        return np.where(self.in_logs, "geometric", "arithmetic").astype(object)

    @property
    def settings(self) -> NDArray[np.int64]:
        """(G, 1): how many settings each group has."""
        return np.asarray(self.runs.groupby(self.numbers)["setting"].nunique(), dtype=np.int64)[:, None]

    def table(self, columns: Mapping[str, Any], order: Sequence[str]) -> "DataFrame":
        """Return a row for each group and measure. columns: arrays that go with (G, M)."""
        shape = len(self.names), len(self.measures)
        if not shape[0]:
            return table_of([], [*self.names.columns, "measure", *order])
        table = self.names.loc[self.names.index.repeat(shape[1])].reset_index(drop=True)
        table["measure"] = np.tile(np.array(self.measures, dtype=object), shape[0])
        filled = {name: np.broadcast_to(columns.get(name, np.nan), shape).ravel() for name in order}
        return table.assign(**filled)

    def counts(self) -> dict[str, Any]:
        """Return how many runs there are, failed or are incomplete, and have a value, in how many scenes."""
        ended = self.runs.groupby(self.numbers)[[FAILED, INCOMPLETE]].sum().to_numpy().astype(int)
        known = self.values.notna().groupby([self.numbers, self.runs["scene"]]).sum()
        return {
            "n_runs": np.bincount(self.numbers, minlength=len(self.names))[:, None],
            "n_failed": ended[:, :1],
            "n_incomplete": ended[:, 1:],
            "n": known.groupby(level=0).sum().to_numpy(),
            "n_scenes": (known > 0).groupby(level=0).sum().to_numpy(),
        }

    def extremes(self) -> dict[str, Any]:
        """Return median, least and largest of the runs that have a value, and their standard deviation."""
        raw = self.runs[self.measures].where(self.values.notna()).groupby(self.numbers)
        deviation = self.values.groupby(self.numbers).std().to_numpy()
        return {
            "median": raw.median().to_numpy(),
            "minimum": raw.min().to_numpy(),
            "maximum": raw.max().to_numpy(),
            "standard_deviation": _exp(deviation, self.in_logs),
        }

    def cells(self) -> "DataFrame":
        """Return the values by group, scene and seed: a row for each repeat."""
        keys = self.runs[["scene", "seed"]].assign(group=self.numbers)
        return self.values.set_index([keys["group"], keys["scene"], keys["seed"]])

    def cells_over_settings(self) -> "DataFrame":
        """Return one value for each group, scene and seed: the mean of its settings' means.

        A setting that was run with fewer seeds than others is the same for all (nothing in it is random), so its mean
        stands for the missing ones.
        """
        keys = [self.numbers, self.runs["scene"], self.runs["setting"], self.runs["seed"]]
        means = self.values.groupby(keys).mean()
        means.index.names = ["group", "scene", "setting", "seed"]
        settings = means.groupby(level=["group", "scene", "setting"]).mean()
        levels: Any = means.index
        seeds = levels.droplevel("setting").unique()
        every = settings.index.to_frame(index=False).merge(seeds.to_frame(index=False), on=["group", "scene"])
        levels = every.set_index(["group", "scene", "setting", "seed"]).index
        of_setting = settings.reindex(levels.droplevel("seed")).set_axis(levels)
        over = means.reindex(levels).fillna(of_setting).groupby(level=["group", "scene", "seed"]).mean()
        met = means.notna().groupby(level=["group", "scene", "seed"]).any()  # some setting was run with the seed
        return over.where(met.reindex(over.index))

    def counted(self, cells: "DataFrame") -> NDArray[np.int64]:
        """(G, M, S): how many values there are of each scene."""
        return np.nan_to_num(self._of_scenes(cells.notna().groupby(level=["group", "scene"]).sum())).astype(int)

    def scene_values(self, cells: "DataFrame", scenes: Sequence[str] | None = None) -> SceneValues:
        """Return what each scene says, (G, M, S). scenes: by default those of the runs, in order."""
        means = cells.groupby(level=["group", "scene", "seed"]).mean().groupby(level=["group", "scene"])
        repeats = cells.groupby(level=["group", "scene"])
        several = means.count() > 1
        size = means.count().where(several, repeats.count())
        variance = means.var().where(several, repeats.var()) / size
        return SceneValues(*(self._of_scenes(part, scenes) for part in (means.mean(), variance, size - 1.0)))

    def means(self, cells: "DataFrame") -> dict[str, Any]:
        """Return the means over scenes with both of their intervals, the columns MEAN."""
        scenes, logs = self.scene_values(cells), self.in_logs
        mean, here, runs = mean_over_scenes(scenes.mean), here_interval(scenes), self.counted(cells).sum(axis=-1)
        score, share, error = (
            np.array([[tells(name) for name in self.measures]]) for tells in (is_score, is_share, is_error)
        )
        of_shares = share_interval(np.where(score[..., None], scenes.mean, np.nan), np.where(share, runs, np.inf))
        at_large = mean_interval(scenes.mean)
        columns: dict[str, Any] = {"average": self.average, "mean": _exp(mean, logs)}
        for prefix, plain in (("", at_large), ("here_", here)):
            positive = clipped(plain, 0.0, np.inf)
            of_score = of_shares if prefix == "" else clipped(plain)
            for name, *ends in zip(Interval._fields, plain, positive, of_score, exponential(plain), strict=True):
                columns[f"{prefix}{name}"] = np.select([logs, score, error], [ends[3], ends[2], ends[1]], ends[0])
        return columns

    def _of_scenes(self, table: "DataFrame", scenes: Sequence[str] | None = None) -> Float64:
        """Return a table of groups and scenes, a column for each measure, as (G, M, S)."""
        from pandas import MultiIndex

        every = sorted(set(self.runs["scene"])) if scenes is None else scenes
        index = MultiIndex.from_product([range(len(self.names)), every])
        found = table.reindex(index).to_numpy(dtype=np.float64)
        return found.reshape(len(self.names), len(every), len(self.measures)).transpose(0, 2, 1)


def _exp(values: Float64, logs: NDArray[np.bool_]) -> Float64:
    """Return values, of which some are logarithms, on their own scales."""
    return np.exp(values, out=np.array(values), where=np.broadcast_to(logs, values.shape))


# --- whether a setting differs from clean ---

TESTS = [
    *("unit", "n", "n_clean", "mean", "clean_mean", "welch_t", "welch_freedom", "welch_p", "welch_p_holm", "hedges_g"),
    *("n_pairs", "wilcoxon_w", "wilcoxon_p", "wilcoxon_p_holm", "rank_biserial"),
]
UNITS = {"scene": ["scene"], "scene and seed": ["scene", "seed"]}


def against_clean_table(runs: "DataFrame", measures: Sequence[str]) -> "DataFrame":
    """Return Welch's test and Wilcoxon's signed-rank test of each setting against clean.

    Each is done twice: a value for each scene, which speaks for scenes at large, and a value for each scene and seed,
    which speaks for these scenes only, as seeds of one scene are no independent scenes. Welch's is of the logarithms of
    errors, and their means are geometric. Holm's correction is over the
    settings of one system, measure and unit.
    """
    rows: list[Row] = []
    tested, ranked = _columns(runs, measures)
    for (system,), of_system in groups(runs, ["system"]):
        is_clean = of_system["perturbation"] == CLEAN
        clean = of_system.index[is_clean]
        settings = list(groups(of_system[~is_clean], SETTING))
        for unit, keys in UNITS.items():
            clean_means = _by_unit(tested, runs, clean, keys).mean().to_numpy().T
            clean_medians = _by_unit(ranked, runs, clean, keys).median()
            of_scenes = _by_unit(ranked, runs, clean, ["scene"]).median()
            for key, group in settings:
                means = _by_unit(tested, runs, group.index, keys).mean().to_numpy().T
                medians = _by_unit(ranked, runs, group.index, keys).median()
                pairs = zip(medians.to_numpy().T, _clean_values(medians.index, clean_medians, of_scenes).T, strict=True)
                named = {"system": system, **dict(zip(SETTING, key, strict=True)), "unit": unit}
                for measure, mean, of_measure, (ours, theirs) in zip(measures, means, clean_means, pairs, strict=True):
                    row = welch(mean[~np.isnan(mean)], of_measure[~np.isnan(of_measure)])
                    if is_averaged_in_logs(measure):
                        row |= {name: float(np.exp(row[name])) for name in ("mean", "clean_mean")}
                    both = ~np.isnan(ours) & ~np.isnan(theirs)
                    rows.append({**named, "measure": measure, **row, **wilcoxon(ours[both], theirs[both])})
    table = table_of(rows, ["system", *SETTING, "measure", *TESTS])
    for test in ("welch", "wilcoxon"):
        families = table.groupby(["system", "measure", "unit"])[f"{test}_p"]
        table[f"{test}_p_holm"] = families.transform(lambda family: holm(family.to_numpy())).astype(float)
    order = table["measure"].map({name: place for place, name in enumerate(measures)})
    keys = table.assign(_order=order).sort_values(["system", "_order", "unit"], kind="stable").index
    return table.loc[keys].reset_index(drop=True)


def _columns(runs: "DataFrame", measures: Sequence[str]) -> "tuple[DataFrame, DataFrame]":
    """Return what means and ranks are taken of: logarithms of errors, and errors in which a failed run is infinite."""
    logs = {name: log_errors(runs[name]) if is_averaged_in_logs(name) else runs[name] for name in measures}
    ranks = {name: worst_if_failed(runs, name) if is_error(name) else runs[name] for name in measures}
    return runs[[]].assign(**logs), runs[[]].assign(**ranks)


def _by_unit(values: "DataFrame", runs: "DataFrame", chosen: Any, keys: list[str]) -> Any:
    return values.loc[chosen].groupby([runs.loc[chosen, name] for name in keys])


def _clean_values(units: "Index", clean: "DataFrame", of_scenes: "DataFrame") -> Float64:
    """Return the clean value beside each unit's: its own seed's, or else that of all its scene's runs."""
    own, scenes = clean.reindex(units).to_numpy(), of_scenes.reindex(units.get_level_values("scene")).to_numpy()
    return np.where(np.isnan(own), scenes, own)


def welch(sample: ArrayLike, clean: ArrayLike) -> Row:
    """Return Welch's t-test of two samples (two-sided) and Hedges' g, the difference over the pooled deviation.

    NaN with fewer than two values on a side, or where neither varies.
    """
    from scipy.stats import ttest_ind_from_stats

    first, second = np.asarray(sample, dtype=np.float64), np.asarray(clean, dtype=np.float64)
    row: Row = {"n": len(first), "n_clean": len(second)}
    row["mean"] = float(np.mean(first)) if len(first) else float("nan")
    row["clean_mean"] = float(np.mean(second)) if len(second) else float("nan")
    row |= dict.fromkeys(("welch_t", "welch_freedom", "welch_p", "hedges_g"), float("nan"))
    if len(first) < 2 or len(second) < 2:
        return row
    variances = _variance(first), _variance(second)
    squared = variances[0] / len(first), variances[1] / len(second)
    if not sum(variances) > 0.0:
        return row
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


# --- where the spread comes from ---
#
# Random effects, nested: repeats on the files of one seed, seeds in a scene, scenes in a setting, whose effect is
# fixed.
# Components are estimated by the method of moments (Henderson's method 1, Biometrics 9, 1953; Searle, Casella and
# McCulloch, Variance Components, 1992, 5.3), which needs no normal values, no equal numbers and no iteration.

Cells: TypeAlias = dict[Any, dict[Any, list[float]]]
"""Logarithms of errors by scene and seed, one for each repeat."""

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


def variance_table(runs: "DataFrame") -> "DataFrame":
    """Return the components of the errors of each system: in each setting, and over all perturbed ones (ALL).

    Factors are exp of a component's standard deviation, shares those of the components that are known; a component
    below 0 counts as 0. ALL takes scenes and seeds from the settings that were run with several seeds, if some were,
    and the repeats of all.
    """
    rows = []
    measures = [name for name in HEADLINE if name in runs and is_averaged_in_logs(name)]
    for (system,), of_system in groups(runs, ["system"]):
        for measure in measures:
            cells = {key: _cells_of(group, measure) for key, group in groups(of_system, SETTING)}
            cells = {key: each for key, each in cells.items() if each}
            perturbed = [each for key, each in cells.items() if key[1] != CLEAN]
            named = {"system": system, "measure": measure}
            rows += [named | {"setting": key[0]} | _row([each], moments_of(each)) for key, each in cells.items()]
            if len(perturbed) > 1:
                rows.append(named | {"setting": ALL} | _row(perturbed, _pooled(perturbed)))
    return table_of([row for row in rows if any(row[f"{level}_freedom"] for level in LEVELS)], VARIANCE)


def _cells_of(runs: "DataFrame", measure: str) -> Cells:
    cells: Cells = {}
    known = runs[runs[measure].notna()].sort_values(["scene", "seed"], kind="stable")
    for scene, seed, value in zip(known["scene"], known["seed"], log_errors(known[measure]).tolist(), strict=True):
        cells.setdefault(scene, {}).setdefault(seed, []).append(value)
    return cells


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
