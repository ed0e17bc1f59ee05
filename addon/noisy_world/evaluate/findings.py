# SPDX-License-Identifier: GPL-3.0-or-later
"""What the study found, before anything else: what broke each system, and by how much.

Settings are ranked by the error over clean. Where half of the runs or more failed or are incomplete, there is no path
to speak of, so the setting ranks before all others, by that share, and no ratio is said of it.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from statistics import median
from typing import TYPE_CHECKING, Any

from ..core.file_access import finite_number
from .cases import CLEAN
from .figures import Bar, RankPanel, ranking
from .metrics import FAILED, METRICS, OVER_CLEAN
from .report_sections import FEWEST, LABELS, Analyses, with_interval
from .report_tables import NOTHING, Column, Results, Table, cell_text, column_of, records
from .study_results import EXPECTED
from .study_tables import LEFT_OUT, RESULT, SUCCESS, SUCCESS_OVER_CLEAN, complete_runs
from .systems import ExpectedClean

if TYPE_CHECKING:
    from pandas import DataFrame

    from .figures import Picture


ERROR = "ate_rmse_m"
MOST_SYSTEMS_SAID = 3
MOST_BARS = 14
DIGITS = 3
NO_BREAK = "\u00a0"
UNLIKE = 4.0  # the largest ratio of single runs over the least from which on both are said


@dataclass(frozen=True)
class Ranked:
    """A setting under a system. over_clean: None where nothing can be compared; ratios: of single runs.

    ate_m, clean_ate_m: the geometric means whose ratio over_clean is.
    """

    setting: str
    runs: int
    failed: int
    incomplete: int
    over_clean: float | None
    ate_m: float
    clean_ate_m: float
    ratios: tuple[float, ...]

    @property
    def broke(self) -> bool:
        """Whether half of the runs or more failed or are incomplete."""
        return 2 * (self.failed + self.incomplete) >= self.runs

    @property
    def endings(self) -> str:
        """How many runs failed or are incomplete; "" where none is."""
        texts = [
            f"{word} {count}" for word, count in (("failed", self.failed), ("incomplete", self.incomplete)) if count
        ]
        return f"{', '.join(texts)} of {self.runs}" if texts else ""

    @property
    def rank(self) -> tuple[float, float, float]:
        """What settings are sorted by, the worst first."""
        share = (self.failed + self.incomplete) / self.runs
        return (-share if self.broke else 0.0, -(self.over_clean or 0.0), -share)


@dataclass(frozen=True)
class SystemFindings:
    """What was found of a system. settings: the worst first. clean_runs: how many, of which clean_failed failed.

    compared: whether some clean run is one that others can be compared with. clean_m: the median ATE of the complete
    clean runs, largest: setting and ATE of the largest error of the other complete ones; None where none has one.
    """

    system: str
    settings: tuple[Ranked, ...]
    clean_runs: int
    clean_failed: int
    compared: bool
    clean_m: float | None
    largest: tuple[str, float] | None


def findings_of(results: Results, table: "DataFrame") -> list[SystemFindings]:
    """Return what was found of each system, that with the worst first. table: over_clean of the analyses."""
    findings = [_of_system(results, str(system), table) for system in sorted(set(results.runs["system"]))]
    return sorted(findings, key=lambda item: (not item.settings, *(item.settings[0].rank if item.settings else ())))


def sentences(findings: Sequence[SystemFindings]) -> list[str]:
    """Return a sentence for each system, of the first few."""
    lines = [_sentence(item) for item in findings[:MOST_SYSTEMS_SAID]]
    more = len(findings) - len(lines)
    return [*lines, *([f"{more} more system{'s' if more > 1 else ''}: see the figure and the tables."] if more else [])]


def ranking_picture(findings: Sequence[SystemFindings]) -> "Picture | None":
    """Draw the ranking of each system; None where nothing is compared with clean."""
    panels = [
        RankPanel(
            item.system,
            "" if item.clean_m is None else f"clean: {length(item.clean_m)}",
            tuple(_bar(ranked) for ranked in item.settings[:MOST_BARS]),
            max(0, len(item.settings) - MOST_BARS),
        )
        for item in findings
        if item.compared and item.settings
    ]
    return ranking(panels) if panels else None


def length(value_m: float) -> str:
    """Return a length of an error as one reads it: in millimetres below a metre."""
    return (
        f"{cell_text(value_m, DIGITS)}{NO_BREAK}m"
        if value_m >= 1.0
        else f"{cell_text(1e3 * value_m, DIGITS)}{NO_BREAK}mm"
    )


def times(ratio: float) -> str:
    """Return a ratio as text."""
    return f"\u00d7{NO_BREAK}{cell_text(ratio, DIGITS if ratio < 1000 else 4)}"


def _of_system(results: Results, system: str, table: "DataFrame") -> SystemFindings:
    runs = results.runs[results.runs["system"] == system]
    clean, noisy = runs[runs["perturbation"] == CLEAN], runs[runs["perturbation"] != CLEAN]
    clean_complete = complete_runs(clean)
    ratios: dict[str, list[float]] = {}
    if OVER_CLEAN in noisy:
        for setting, ratio in noisy[["setting", OVER_CLEAN]].itertuples(index=False, name=None):
            ratios.setdefault(setting, []).extend([ratio] if isfinite(ratio) else [])
    settings = [_ranked(row, ratios) for row in records(table[table["system"] == system])]
    clean_m = clean_complete[ERROR].median() if ERROR in clean else float("nan")
    return SystemFindings(
        system,
        tuple(sorted(settings, key=lambda ranked: (*ranked.rank, ranked.setting))),
        len(clean),
        int(clean["failed"].sum()),
        OVER_CLEAN in clean and bool(clean[OVER_CLEAN].notna().any()),
        float(clean_m) if isfinite(clean_m) else None,
        _largest(complete_runs(noisy)),
    )


def _largest(runs: "DataFrame") -> tuple[str, float] | None:
    if ERROR not in runs or not runs[ERROR].notna().any():
        return None
    row = runs.sort_values(ERROR, kind="stable", na_position="first").iloc[-1]
    return str(row["setting"]), float(row[ERROR])


def _ranked(row: Mapping[str, Any], ratios: Mapping[str, Sequence[float]]) -> Ranked:
    setting, over = str(row["setting"]), float(row["over_clean"])
    return Ranked(
        setting,
        runs=int(row["n_runs"]),
        failed=int(row["n_failed"]),
        incomplete=int(row["n_incomplete"]),
        over_clean=over if isfinite(over) else None,
        ate_m=float(row["ate_m"]),
        clean_ate_m=float(row["clean_ate_m"]),
        ratios=tuple(ratios.get(setting, ())),
    )


def _bar(ranked: Ranked) -> Bar:
    if ranked.broke or ranked.over_clean is None:
        return Bar(ranked.setting, None, ranked.endings or "no clean run beside it", ranked.broke, ranked.ratios)
    text = f"{times(ranked.over_clean)}{_range(ranked)}{f', {ranked.endings}' if ranked.endings else ''}"
    return Bar(ranked.setting, ranked.over_clean, text, broke=False, runs=ranked.ratios)


def _range(ranked: Ranked) -> str:
    """Return from where to where the ratios of single runs go, where they are not alike."""
    least, most = min(ranked.ratios), max(ranked.ratios)
    return f" ({cell_text(least, 2)} to {cell_text(most, 2)})" if most > UNLIKE * least else ""


def _sentence(item: SystemFindings) -> str:
    name = item.system
    if not item.settings and item.clean_m is not None:
        return f"{name} was run on clean frames alone: a median ATE of {length(item.clean_m)}."
    if not item.compared:
        return _without_clean(item)
    worst = item.settings[0]
    compared = next((ranked for ranked in item.settings if not ranked.broke and ranked.over_clean is not None), None)
    if worst.broke:
        also = "" if compared is None else f"; of the others, {_ratio(compared)}"
        return f"Worst for {name}: {worst.setting}, where it {_broke(worst)}{also}."
    if compared is None:
        return f"{name} has no setting that can be compared with a clean run."
    if (compared.over_clean or 0.0) < 1.0:
        return f"Nothing made {name} worse than clean: the nearest is {_ratio(compared)}."
    also = f"; it {_broke(compared)}, which no ratio counts" if compared.endings else ""
    return f"Worst for {name}: {_ratio(compared)}{also}."


def _ratio(ranked: Ranked) -> str:
    """Return a setting with its error over clean. It has one."""
    errors = f"{length(ranked.ate_m)} instead of {length(ranked.clean_ate_m)}"
    return f"{ranked.setting}, {times(ranked.over_clean or 0.0)} its error on clean frames ({errors})"


def _broke(ranked: Ranked) -> str:
    endings = (("failed", ranked.failed), ("was incomplete", ranked.incomplete))
    counts = [f"{word} in {count}" for word, count in endings if count]
    return f"{' and '.join(counts)} of {ranked.runs} run{'s' if ranked.runs > 1 else ''}"


def _without_clean(item: SystemFindings) -> str:
    if item.clean_failed and 2 * item.clean_failed >= item.clean_runs:
        beginning = f"{item.system} failed on clean frames already, in {item.clean_failed} of {item.clean_runs} runs"
    elif item.clean_runs:
        beginning = f"{item.system} was incomplete on clean frames already"
    else:
        beginning = f"{item.system} was not run on clean frames"
    if item.largest is None:
        return f"{beginning}, and no other run is complete."
    setting, error_m = item.largest
    return f"{beginning}, so nothing tells what noise did: its largest ATE is {length(error_m)}, {setting}."


# A row for each setting and system: what came of its runs, and mean, least and largest of the main metrics with n.


MAIN = ("ate_rmse_m", "rpe_1s_rmse_m", "rpe_1s_rmse_deg", "tracked_share", "success_auc", "f1_auc")
MAIN_OF_MAPS = ("map.accuracy_m", "map.completion_m", "map.completion_ratio_5cm", "map.depth_l1_m", "map.psnr_db")
SETTING = ("setting", "perturbation", "mode", "severity")
COUNTED_RUNS = ("runs", "failed", "incomplete")
PARTS = {"mean": "mean", "min": "minimum", "max": "maximum", "n": "n"}
"""Of a metric's spread: the ends of the columns here, and the columns of the analyses."""


def settings_table(results: Results, of_all: "DataFrame") -> Table:
    """Return the table. of_all: `spread` of the analyses, whose means are shown."""
    import pandas as pd

    runs = in_order(results.runs)
    metrics = main_metrics(runs)
    known = of_all[of_all["measure"].isin(metrics)]
    spreads = {(row["setting"], row["system"], row["measure"]): row for row in records(known)}
    rows = []
    for (setting, system), group in runs.groupby(["setting", "system"], sort=False):
        row: dict[str, Any] = {name: group.iloc[0][name] for name in SETTING}
        row |= {
            "setting": setting,
            "system": system,
            "scenes": group["scene"].nunique(),
            "seeds": group["seed"].nunique(),
        }
        row |= {**counts(group), "endings": endings(records_of(group))}
        for name in metrics:
            spread = spreads.get((setting, system, name), {"n": 0})
            row |= {f"{name}.{part}": spread.get(column, float("nan")) for part, column in PARTS.items()}
        rows.append(row)
    columns = [column_of(name) for name in ("setting", "system", *COUNTED_RUNS)]
    columns += [Column("endings", "endings", meaning="how many runs ended how")]
    columns += [spread_column(name) for name in metrics]
    caption = (
        "Mean (least to largest; n) over scenes, which weigh alike, seeds and repeats; of errors the geometric mean."
    )
    caption += " A failed run has no error, and counts as 0 in success AUC and F1 AUC." if runs["failed"].any() else ""
    caption += f" {LEFT_OUT} It counts as 0 in success AUC." if runs["incomplete"].any() else ""
    return Table("settings", "Every setting and system", caption, pd.DataFrame(rows), tuple(columns))


def in_order(runs: "DataFrame") -> "DataFrame":
    """Return runs by setting: clean first, then perturbations by name, mode and severity."""
    first = (runs["perturbation"] != CLEAN).astype(int)
    keys = ["_first", "perturbation", "mode", "severity", "setting", "system"]
    return runs.assign(_first=first).sort_values(keys, kind="stable", ignore_index=True).drop(columns="_first")


def main_metrics(runs: "DataFrame") -> list[str]:
    """Return which of the main metrics, and of installed packages, the runs have; of maps where one was scored."""
    installed = [name for name in METRICS if METRICS.distribution(name)]
    of_maps = [name for name in MAIN_OF_MAPS if name in runs.columns and runs[name].notna().any()]
    return [name for name in (*MAIN, *installed) if name in runs.columns] + of_maps


def counts(group: "DataFrame") -> dict[str, int]:
    """Return how many runs there are, and how many of them failed or are incomplete: COUNTED_RUNS."""
    return {"runs": len(group), **{name: int(group[name].sum()) for name in COUNTED_RUNS[1:]}}


def records_of(group: "DataFrame") -> list[tuple[str, str, str]]:
    """Return outcome, failure and result of each run."""
    return list(group[["outcome", "failure", RESULT]].itertuples(index=False, name=None))


def endings(of: Iterable[tuple[str, str, str]]) -> str:
    """Return how many runs ended how: complete or incomplete; of failed ones the outcome of the system's process or,
    where it finished, why its estimate has no score.
    """
    counted = Counter(
        result if result != FAILED else failure or outcome if outcome == "finished" else outcome
        for outcome, failure, result in of
    )
    return ", ".join(f"{count} {name}" for name, count in sorted(counted.items(), key=lambda item: (-item[1], item[0])))


def spread_column(name: str) -> Column:
    """Return how the four numbers of a metric are shown: in one cell."""
    metric = column_of(name)

    def text(row: Mapping[str, Any]) -> str:
        mean, least, largest, count = (row[f"{name}.{part}"] for part in ("mean", "min", "max", "n"))
        if not count:
            return NOTHING
        return f"{cell_text(mean, 3)} ({cell_text(least, 3)} to {cell_text(largest, 3)}; {count})"

    return Column(f"{name}.mean", metric.label, metric.unit, metric.better, metric.meaning, text)


# Whether each system reached on clean frames what its definition expects, and the mark of all that it did not.
#
# A ratio to a clean error that the baseline made says little of noise, and depth seems not to matter to a system that
# errs in scale without any noise. So the report begins with such a system, and marks its name wherever a ratio stands.


MARK = "\u2020"
AS_EXPECTED = "clean_as_expected"
"""The column of the files of tables that says of each row's system what the mark says."""
SCALE = "scale"
MOST_SAID = 4  # scenes in a sentence


@dataclass(frozen=True)
class CleanScene:
    """A system's clean runs in a scene. ate_m, scale: medians of complete ones, or None. wrong: what is, in words."""

    system: str
    scene: str
    runs: int
    ate_m: float | None
    scale: float | None
    expected: str
    wrong: str


@dataclass(frozen=True)
class CleanGate:
    """The clean runs of the systems that say what is expected of them."""

    scenes: tuple[CleanScene, ...]

    @property
    def marked(self) -> frozenset[str]:
        """The systems that have a scene in which they did not reach it."""
        return frozenset(scene.system for scene in self.scenes if scene.wrong)

    def name(self, system: str) -> str:
        """Return a system's name, with the mark where it has one."""
        return f"{system} {MARK}" if system in self.marked else system

    @property
    def sentences(self) -> list[str]:
        """A sentence for each system that did not reach it, which stands before all findings."""
        return [self._sentence(system) for system in sorted(self.marked)]

    def _sentence(self, system: str) -> str:
        every = [scene for scene in self.scenes if scene.system == system]
        wrong = [scene for scene in every if scene.wrong]
        listed = "; ".join(f"{scene.scene} {scene.wrong}" for scene in wrong[:MOST_SAID])
        more = f"; {len(wrong) - MOST_SAID} more" if len(wrong) > MOST_SAID else ""
        return (
            f"{MARK} {system} does not reach on clean frames what its definition expects ({every[0].expected}), in "
            f"{len(wrong)} of {len(every)} scene{'s' if len(every) > 1 else ''}: {listed}{more}. Its ratios to clean "
            f"are marked {MARK}: they are over an error that noise has no part in."
        )

    def of_frames(self, tables: "Mapping[str, DataFrame]") -> "dict[str, DataFrame]":
        """Return tables of the analyses with marked names of systems, as figures show them."""
        return {
            name: table.assign(system=table["system"].map(self.name)) if "system" in table else table
            for name, table in tables.items()
        }

    def of_table(self, table: Table) -> Table:
        """Return a table whose names of systems are marked, and whose file says so in a column of its own."""
        if "system" not in table.frame or not self.marked:
            return table
        columns = tuple(
            replace(column, text=self._cell) if column.name == "system" else column for column in table.columns
        )
        as_expected = [0 if system in self.marked else 1 for system in table.frame["system"]]
        return replace(table, columns=columns, frame=table.frame.assign(**{AS_EXPECTED: as_expected}))

    def _cell(self, row: Mapping[str, Any]) -> str:
        return self.name(str(row["system"]))

    @property
    def table(self) -> Table:
        """A row for each system and scene."""
        from pandas import DataFrame

        names = ["system", "scene", "runs", ERROR, SCALE, "expected", "wrong"]
        rows = [(at.system, at.scene, at.runs, at.ate_m, at.scale, at.expected, at.wrong) for at in self.scenes]
        columns = [column_of("system"), column_of("scene"), Column("runs", "clean runs"), column_of(ERROR)]
        columns += [column_of(SCALE), Column("expected", "expected"), Column("wrong", "what is not as expected")]
        caption = "Medians of complete clean runs in each scene, beside what the system's definition expects of them."
        return Table("clean", "On clean frames", caption, DataFrame(rows, columns=names), tuple(columns))


def clean_gate(results: Results) -> CleanGate:
    """Hold the clean runs of each system against what study.json says that its definition expects."""
    scenes: list[CleanScene] = []
    for system, definition in sorted(results.study.get("systems", {}).items()):
        expected = _expected(definition)
        if expected is not None:
            runs = results.runs[(results.runs["system"] == system) & (results.runs["perturbation"] == CLEAN)]
            scenes += [_scene(system, str(scene), group, expected) for scene, group in runs.groupby("scene")]
    return CleanGate(tuple(scenes))


def _expected(definition: Any) -> ExpectedClean | None:
    """Return what a system's entry in study.json says of clean runs; None where it says nothing, or no number."""
    entry = definition.get(EXPECTED) if isinstance(definition, Mapping) else None
    ate_m = finite_number(entry.get("ate_m")) if isinstance(entry, Mapping) else None
    return None if ate_m is None or entry is None else ExpectedClean(ate_m, finite_number(entry.get("scale_off")))


def _scene(system: str, scene: str, runs: "DataFrame", expected: ExpectedClean) -> CleanScene:
    complete = complete_runs(runs)
    ended = len(runs) - len(complete)
    ate_m, scale = _median(complete, ERROR), _median(complete, SCALE)
    lost = [f"failed or was incomplete in {ended} of {len(runs)} clean runs"] if 2 * ended >= len(runs) else []
    wrong = ", ".join([*lost, *expected.unmet(ate_m, scale)])
    return CleanScene(system, scene, len(runs), ate_m, scale, expected.text, wrong)


def _median(runs: "DataFrame", name: str) -> float | None:
    """Return the median of the runs that have a value, None where none has."""
    known = runs[name].dropna().tolist() if name in runs else []
    return median(known) if known else None


# The report's first table: the main results, a row for each system.


SCORES = (SUCCESS, SUCCESS_OVER_CLEAN, "success_auc", "f1_auc")
RATED = "success_auc"
ALL = "all"


def headline_table(results: Results, analyses: Analyses, findings: Sequence[SystemFindings]) -> Table:
    """Return the table. findings: of each system."""
    import pandas as pd

    worst = {item.system: _worst(item) for item in findings}
    rows = []
    for system, group in results.runs.groupby("system", sort=True):
        row: dict[str, Any] = {"system": system, **counts(group)}
        row |= {
            "endings": endings(records_of(group)),
            "worst": worst[str(system)],
            "n_scenes": group["scene"].nunique(),
        }
        if ERROR in group:
            errors = complete_runs(group)[ERROR]
            row |= {f"{ERROR}.median": errors.median(), f"{ERROR}.n": int(errors.notna().sum())}
        rows.append(row | _scores(analyses["systems"], str(system)) | _rates(analyses["robustness"], str(system)))
    frame = pd.DataFrame(rows)
    columns = [column_of("system"), *map(column_of, COUNTED_RUNS), Column("endings", "endings")]
    columns.append(Column("worst", "worst setting", meaning="and its error over that on clean frames"))
    if ERROR in results.runs:
        columns.append(_headline_median())
    columns += [_interval(name, column_of(name)) for name in SCORES if name in frame]
    columns += [
        _interval(name, Column(name, LABELS[name][0], better=better, meaning=LABELS[name][1]))
        for name, better in _RATES
        if name in frame and frame[name].notna().any()
    ]
    columns.append(Column("n_scenes", "scenes", meaning="which the intervals stand on"))
    return Table("headline", "Systems", _caption(analyses), frame, tuple(columns))


_RATES = (("mrr", "higher"), ("mce", "lower"))


def _worst(item: SystemFindings) -> str:
    """Return the worst setting, and by how much."""
    if not item.settings:
        return ""
    worst = item.settings[0]
    if worst.broke or worst.over_clean is None:
        return f"{worst.setting}, {worst.endings}" if worst.endings else ""
    return f"{worst.setting}, {times(worst.over_clean)}"


def _caption(analyses: Analyses) -> str:
    table = analyses["robustness"]
    baselines = sorted({name for name in table["baseline"] if name}) if len(table) else []
    against = f" mCE is against {baselines[0]}." if baselines else ""
    return (
        "All scenes, settings, seeds and repeats. Success, success AUC and F1 AUC are means over the perturbed "
        "settings, in which a failed run is 0, and in all but F1 AUC an incomplete one; mRR and mCE are of success "
        "AUC, over perturbations. In brackets: 95 % "
        f"intervals for scenes at large, of {FEWEST} scenes or more.{against} The median of ATE is over the n "
        "complete runs, clean ones too."
    )


def _scores(table: "DataFrame", system: str) -> dict[str, float]:
    scores: dict[str, float] = {}
    for name in SCORES:
        rows = table[(table["system"] == system) & (table["measure"] == name)]
        if len(rows):
            row = rows.iloc[0]
            scores |= {name: row["mean"], f"{name}_low": row["low"], f"{name}_high": row["high"]}
            scores[f"{name}_n"] = row["n_scenes"]
    return scores


def _rates(table: "DataFrame", system: str) -> dict[str, float]:
    rows = table[(table["system"] == system) & (table["score"] == RATED) & (table["perturbation"] == ALL)]
    if not len(rows):
        return {}
    row = rows.iloc[0]
    rates = {name: row[name] for rate, _ in _RATES for name in (rate, f"{rate}_low", f"{rate}_high")}
    return rates | {f"{rate}_n": row["n_scenes"] for rate, _ in _RATES}


def _interval(name: str, column: Column) -> Column:
    def text(row: Mapping[str, Any]) -> str:
        return with_interval(row[name], row[f"{name}_low"], row[f"{name}_high"], row[f"{name}_n"])

    return replace(column, text=text)


def _headline_median() -> Column:
    metric = column_of(ERROR)

    def text(row: Mapping[str, Any]) -> str:
        return f"{cell_text(row[f'{ERROR}.median'], 3)} (n {row[f'{ERROR}.n']})" if row[f"{ERROR}.n"] else NOTHING

    return Column(f"{ERROR}.median", f"median {metric.label}", metric.unit, "lower", metric.meaning, text)
