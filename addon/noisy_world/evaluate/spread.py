# SPDX-License-Identifier: GPL-3.0-or-later
"""How results spread over scenes, seeds and repeats, with 95 % intervals, and whether they differ from clean.

How results spread over scenes, seeds and repeats, whether they differ from clean, and where the spread comes from.

Errors are averaged on the scale of logarithms: their means are geometric, and compared by ratios. All else is averaged
as it is. Tables are worked out for all groups of runs and all measures at once: arrays are (groups, measures), and of
scenes (groups, measures, scenes).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.streams import stream
from .cases import CLEAN
from .study_tables import (
    COUNTS,
    FAILED,
    HEADLINE,
    INCOMPLETE,
    SETTING,
    Row,
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


# 95 % intervals of what a few scenes say about scenes at large, and of what these scenes say about themselves.
#
# Runs in one scene are alike, so the scene is what counts: all its seeds and repeats stay together. With two to eight
# scenes, intervals of bootstrap quantiles (percentile, BCa) are far too narrow, and studentised ones have no end with
# fewer than five (docs/analysis.md has the simulation). So every interval here is an estimate, plus and minus its
# standard error times a quantile of Student's t with one degree of freedom less than there are scenes. The standard
# error of a mean over scenes is in closed form what a bootstrap of scenes gives times sqrt(S / (S - 1)); that of any
# other number comes from such a bootstrap (Cameron, Gelbach and Miller 2008 on few clusters; Davison and Hinkley 1997,
# 3.8, on resampling whole clusters only).
#
# Arrays have a scene in each place of their last axis, NaN where it has no value; what is said has the other axes.


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
        values = table.reindex(index).to_numpy(dtype=np.float64)
        return values.reshape(len(self.names), len(every), len(self.measures)).transpose(0, 2, 1)


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

ErrorsOfCells: TypeAlias = dict[Any, dict[Any, list[float]]]
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


def moments_of(cells: ErrorsOfCells) -> Moments:
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
    components: dict[str, float] = dict.fromkeys(LEVELS, float("nan"))
    known = [place for place in range(3) if moments.freedom[place] > 0.0]
    if known:
        chosen = np.ix_(known, known)
        solved = np.linalg.solve(moments.times[chosen], moments.squares[known])
        components |= {LEVELS[place]: float(value) for place, value in zip(known, solved, strict=True)}
    return components


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


def _cells_of(runs: "DataFrame", measure: str) -> ErrorsOfCells:
    cells: ErrorsOfCells = {}
    known = runs[runs[measure].notna()].sort_values(["scene", "seed"], kind="stable")
    for scene, seed, value in zip(known["scene"], known["seed"], log_errors(known[measure]).tolist(), strict=True):
        cells.setdefault(scene, {}).setdefault(seed, []).append(value)
    return cells


def _pooled(settings: Sequence[ErrorsOfCells]) -> Moments:
    every = list(map(moments_of, settings))
    seeded = [moments for moments in every if moments.freedom[1] > 0.0] or every
    total = sum(seeded[1:], seeded[0])
    others = [moments for moments in every if not any(moments is one for one in seeded)]
    for moments in others:  # their scenes hold no seed's effect, if no seed changes their files: their repeats alone
        repeats = np.array([0.0, 0.0, 1.0])
        total += Moments(moments.squares * repeats, moments.freedom * repeats, moments.times * np.diag(repeats))
    return total


def _row(settings: Sequence[ErrorsOfCells], moments: Moments) -> dict[str, Any]:
    values = components_of(moments)
    bounded = {level: max(value, 0.0) for level, value in values.items() if np.isfinite(value)}
    whole = sum(bounded.values())
    row: dict[str, Any] = {
        "n": sum(
            len(values_of_seed) for cells in settings for seeds in cells.values() for values_of_seed in seeds.values()
        ),
        "n_scenes": len({scene for cells in settings for scene in cells}),
    }
    for level, freedom in zip(LEVELS, moments.freedom.tolist(), strict=True):
        known = level in bounded
        row[f"{level}_factor"] = float(np.exp(np.sqrt(bounded[level]))) if known else float("nan")
        row[f"{level}_share"] = bounded[level] / whole if known and whole > 0.0 else float("nan")
        row[f"{level}_freedom"] = int(freedom)
    return row
