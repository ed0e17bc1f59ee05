# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of runs, of sequences and of a study, as analyses take them and as people are shown them."""

import csv
import io
import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from math import isfinite
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError, StorageError, one_line
from ..core.file_access import read_text
from ..core.packages import need
from ..perturbations import registry
from .cases import CLEAN, Case, Condition, Outcome, SystemRun, cell_of, read_run_record, text_of
from .indicators import INDICATORS
from .map_metrics import MAP_METRICS, MAP_PREFIX
from .metrics import (
    COMPLETE,
    FAILED,
    INCOMPLETE,
    IS_INCOMPLETE,
    METRICS,
    OVER_CLEAN,
    OVER_CLEAN_METRICS,
    PAPER_METRICS,
    PAPER_PREFIX,
    THRESHOLDS_OVER_CLEAN,
    Metric,
    is_success_over_clean,
    result_of,
    success_over_clean_name,
)
from .study_results import (
    FORMAT,
    MAP,
    PAPER,
    PROCESSORS,
    RECORD,
    STRICT,
    STUDY,
    VERSIONS,
    ResultsFolder,
    is_record,
    merged,
    of_any_processor,
    read_indicators,
    read_scores,
    read_study,
    why_not,
)

if TYPE_CHECKING:
    from pandas import DataFrame


Float64: TypeAlias = NDArray[np.float64]

TRACKED = ("tracked_share", "strict.tracked_share")
"""The share of the frames that a run tracked, by the name that the study's protocol gives it."""
RESULT = "result"
LEFT_OUT = (
    f"A run that {IS_INCOMPLETE} is incomplete: its errors are those of the frames that it did not give up, so they "
    "are in no mean, median or ratio."
)
"""A sentence for every table whose errors are of complete runs alone."""
LEAST_ERROR = 1e-9
"""In metres, degrees or radians: errors are checked to this, so a smaller one, an exact 0 too, counts as this."""

SETTING = ["setting", "perturbation", "mode", "severity"]
SEQUENCE = ["scene", "setting", "seed"]
TEXTS = ("scene", "setting", "perturbation", "mode", "system", "outcome", "failure", RESULT)
ATE = "ate_rmse_m"
CLEAN_ATE = "clean_ate_rmse_m"
NOT_MEASURES = {*TEXTS, "severity", "seed", "repeat", "frames", FAILED, INCOMPLETE, CLEAN_ATE}
ERRORS = (ATE, "ate_m", "paper.ate_m")
"""The error that ranks and correlations take, the first of these that a table has: a study may be by protocol paper."""
SCORES = ("success_auc", "f1_auc")
SUCCESS = "success_10cm"
"""What counts as a success where runs are counted: an ATE below 10 cm, with enough of the frames tracked."""
SUCCESS_OVER_CLEAN = success_over_clean_name(10.0)
"""The same beside the clean error: an ATE below ten times that."""
HEADLINE = (
    *(FAILED, INCOMPLETE, SUCCESS, SUCCESS_OVER_CLEAN, ATE, "ate_m", "rpe_1frame_rmse_m", "tracked_share", "sr"),
    *SCORES,
)
"""Measures of the tests and of the tables by groups; of them, those that a table has."""
COUNTS = ["n_runs", "n_failed", "n_incomplete", "n", "n_scenes"]
OVER = [*COUNTS, "ate_m", "clean_ate_m", "over_clean", "least", "most"]


def metric_of(column: str) -> Metric | None:
    """Return the metric of a table's column, `ate_rmse_m`, `paper.sr` or `map.accuracy_m`; None for another column."""
    by_prefix: dict[str, Mapping[str, Metric]] = {PAPER_PREFIX: PAPER_METRICS, MAP_PREFIX: MAP_METRICS}
    for prefix, metrics in by_prefix.items():
        if column.startswith(prefix):
            return metrics.get(column.removeprefix(prefix))
    return METRICS.get(column) or OVER_CLEAN_METRICS.get(column)


def is_share(measure: str) -> bool:
    """Tell whether a measure of a run is 0 or 1, so that its mean is a share of runs."""
    return measure in (FAILED, INCOMPLETE) or (measure.startswith("success_") and measure != "success_auc")


def is_score(measure: str) -> bool:
    """Tell whether a measure lies between 0 and 1."""
    return is_share(measure) or measure in (*SCORES, "f1_auc_rotation", "tracked_share", "bad_pose_share")


def is_error(measure: str) -> bool:
    """Tell whether a measure is an error, better the smaller it is, whose logarithm is looked at."""
    if measure == OVER_CLEAN:
        return True
    metric = metric_of(measure) or PAPER_METRICS.get(measure)
    return metric is not None and metric.better == "lower" and metric.unit in ("m", "deg", "rad")


def is_averaged_in_logs(measure: str) -> bool:
    """Tell whether a measure is an error whose mean is geometric, and that an incomplete run does not have.

    Those of protocol paper are not: its means are arithmetic, with 1.0 for a failed run and whatever was tracked.
    """
    return is_error(measure) and measure not in PAPER_METRICS and not measure.startswith(PAPER_PREFIX)


def log_errors(errors: ArrayLike) -> Float64:
    """Return natural logarithms of errors, which are 0 or more; NaN stays.

    Errors are averaged on this scale: those of two rooms differ by a factor.
    """
    return np.log(np.maximum(np.asarray(errors, dtype=np.float64), LEAST_ERROR))


def geometric_mean(errors: ArrayLike) -> float:
    """Return the geometric mean of errors, all alike in weight; NaN of none."""
    logs = log_errors(errors)
    return float(np.exp(logs.mean())) if logs.size else float("nan")


def geometric_deviation(errors: ArrayLike) -> float:
    """Return the factor by which errors spread, exp of the standard deviation of their logarithms; NaN below two."""
    logs = log_errors(errors)
    return float(np.exp(logs.std(ddof=1))) if logs.size > 1 else float("nan")


def with_results(runs: "DataFrame") -> "DataFrame":
    """Return a table of runs with RESULT, and with `failed` and `incomplete`, True or False.

    A run failed where its outcome is another than finished, or its score says a word. Without a share of tracked frames
    none is incomplete.
    """
    failure, outcome = (runs[name].astype(object).fillna("").astype(str).tolist() for name in ("failure", "outcome"))
    failed = [bool(word) or ending != "finished" for word, ending in zip(failure, outcome, strict=True)]
    results = np.array(list(map(result_of, failed, tracked_shares(runs).tolist())), dtype=object)
    return runs.assign(**{RESULT: results, FAILED: results == FAILED, INCOMPLETE: results == INCOMPLETE})


def tracked_shares(runs: "DataFrame") -> Float64:
    """(N,) the share of the frames that each run tracked; NaN where it is not known."""
    name = next((name for name in TRACKED if name in runs), None)
    return np.full(len(runs), np.nan) if name is None else runs[name].to_numpy(dtype=np.float64)


def complete_runs(runs: "DataFrame") -> "DataFrame":
    """Return the complete ones of a table that `with_results` gave."""
    return runs[runs[RESULT] == COMPLETE]


def with_over_clean(runs: "DataFrame") -> "DataFrame":
    """Return a table of runs with the columns of OVER_CLEAN_METRICS, and CLEAN_ATE, what they stand on.

    runs: with what `with_results` adds. The clean error of a run is the median of its system's clean runs in its scene,
    of its own seed; a scene that has a single clean seed stands for all, as no seed changes its clean frames. It has
    none where half of these runs or more failed or are incomplete, or where it is 0. Without a column of ATE by
    protocol strict, the table is as it was.
    """
    if ATE not in runs or not len(runs):
        return runs
    ate_m = runs[ATE].to_numpy(dtype=np.float64)
    holds = (runs[RESULT] == COMPLETE).to_numpy(dtype=bool) & np.isfinite(ate_m)
    clean_m = _clean_errors(runs, np.where(holds, ate_m, np.inf))
    over = np.where(holds & np.isfinite(clean_m), ate_m / clean_m, np.nan)
    successes = {
        success_over_clean_name(times): [
            float(is_success_over_clean(value if isfinite(value) else None, times)) if isfinite(clean) else np.nan
            for value, clean in zip(over.tolist(), clean_m.tolist(), strict=True)
        ]
        for times in THRESHOLDS_OVER_CLEAN
    }
    return runs.assign(**{CLEAN_ATE: clean_m, OVER_CLEAN: over, **successes})


def _clean_errors(runs: "DataFrame", worst_if_failed_m: Float64) -> Float64:
    """(N,) errors, infinite for runs that are no success -> (N,) the clean error of each run; NaN for none."""
    from pandas import MultiIndex

    clean = runs.assign(error_m=worst_if_failed_m)[(runs["perturbation"] == CLEAN).to_numpy()]
    of_seeds = clean.groupby(["system", "scene", "seed"])["error_m"].median()
    of_scenes = of_seeds.groupby(level=["system", "scene"]).agg(["first", "size"])
    of_scenes = of_scenes["first"].where(of_scenes["size"] == 1)
    own = of_seeds.reindex(MultiIndex.from_frame(runs[["system", "scene", "seed"]])).to_numpy()
    shared = of_scenes.reindex(MultiIndex.from_frame(runs[["system", "scene"]])).to_numpy()
    clean_m = np.where(np.isnan(own), shared, own)
    return np.where((clean_m > 0.0) & np.isfinite(clean_m), clean_m, np.nan)


def tidy_runs(runs: "DataFrame") -> "DataFrame":
    """Return the table of runs, sorted, its texts and numbers as such, with columns `failed` and `incomplete`, 0 or 1.

    Where a run that failed has no value of a score between 0 and 1 that counts what was lost (success, AUC, tracked
    share), it is 0. An incomplete run has no error: it would be that of the frames that it did not give up.
    """
    table = tidy_sequences(with_over_clean(with_results(runs)))
    failed, incomplete = table[FAILED] == 1.0, table[INCOMPLETE] == 1.0
    for name in measures_of(table):
        if is_averaged_in_logs(name):
            table[name] = table[name].mask(incomplete)
        if name in OVER_CLEAN_METRICS:
            continue  # a run without a clean one beside it has none, failed or not
        if name.startswith("success_") or name in (*SCORES, "f1_auc_rotation", "tracked_share"):
            table[name] = table[name].mask(failed & table[name].isna(), 0.0)
    return table


def tidy_sequences(sequences: "DataFrame") -> "DataFrame":
    """Return the table of sequences, or of runs, sorted, its texts and numbers as such."""
    import pandas

    table = sequences.copy()
    for name in TEXTS:
        if name not in table:
            table[name] = ""
        table[name] = table[name].astype(object).where(table[name].notna(), "").astype(str)
    for name in ("severity", "seed", "repeat"):
        if name not in table:
            table[name] = np.nan
    for name in table.columns:
        if name not in TEXTS:
            table[name] = pandas.to_numeric(table[name], errors="coerce").astype(float)
    for name in ("seed", "repeat"):
        table[name] = table[name].fillna(0).astype(int)
    return table.sort_values([*SEQUENCE, "system", "repeat"], kind="stable", ignore_index=True)


def measures_of(table: "DataFrame") -> list[str]:
    """Return the columns with measures of runs, in the table's order, `failed` and `incomplete` first."""
    return [FAILED, INCOMPLETE, *(str(name) for name in table.columns if name not in NOT_MEASURES)]


def headline_of(table: "DataFrame") -> list[str]:
    """Return the measures of HEADLINE that a table has."""
    return [name for name in HEADLINE if name in table]


def indicators_in(table: "DataFrame") -> list[str]:
    """Return the columns of a table of sequences that tell an indicator's mean over frames."""
    return [f"{name}_mean" for name in INDICATORS if f"{name}_mean" in table]


def errors_of(runs: "DataFrame") -> Float64:
    """Return the ATE of runs, infinite where one failed or is incomplete; 0 for the others without any column of it."""
    name = next((name for name in ERRORS if name in runs), None)
    return np.where(runs[FAILED] + runs[INCOMPLETE] > 0.0, np.inf, 0.0) if name is None else worst_if_failed(runs, name)


def worst_if_failed(table: "DataFrame", measure: str) -> Float64:
    """Return a column of errors, infinite where a run failed or has none: for ranks, which need no number.

    An incomplete run has none, so it ranks with those that failed.
    """
    return np.where(np.isfinite(table[measure]) & (table[FAILED] == 0.0), table[measure], np.inf)


def groups(table: "DataFrame", names: Sequence[str]) -> "Iterator[tuple[tuple[Any, ...], DataFrame]]":
    """Yield the values of some columns in order, those without a value first, with the rows that have them."""
    ordered = table.sort_values(list(names), kind="stable", na_position="first")
    for key, group in ordered.groupby(list(names), sort=False, dropna=False):
        yield key if isinstance(key, tuple) else (key,), group


def table_of(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> "DataFrame":
    """Return rows as a pandas table with these columns, which are there even where it is empty."""
    from pandas import DataFrame

    return DataFrame(list(rows), columns=list(columns))


def over_clean_table(runs: "DataFrame", by: list[str]) -> "DataFrame":
    """Return a row for each group of perturbed runs: how many failed or are incomplete, and the error over clean.

    over_clean: of the geometric means ate_m and clean_ate_m of the n runs that have a ratio, in which scenes weigh
    alike, and seeds in a scene; least, most: of these runs.
    """
    rows = []
    if OVER_CLEAN in runs:
        for key, group in groups(runs[runs["perturbation"] != CLEAN], by):
            rows.append({**dict(zip(by, key, strict=True)), **_over_clean(group)})
    return table_of(rows, [*by, *OVER])


def _over_clean(runs: "DataFrame") -> dict[str, Any]:
    compared = runs[runs[OVER_CLEAN].notna()]
    row: dict[str, Any] = dict.fromkeys(OVER, float("nan"))
    row |= {"n_runs": len(runs), "n": len(compared), "n_scenes": compared["scene"].nunique()}
    row |= {f"n_{name}": int(runs[name].sum()) for name in (FAILED, INCOMPLETE)}
    if len(compared):
        logs = compared[["scene", "seed"]].assign(**{name: log_errors(compared[name]) for name in (ATE, CLEAN_ATE)})
        means = logs.groupby(["scene", "seed"]).mean().groupby(level="scene").mean().mean()
        row |= {"ate_m": float(np.exp(means[ATE])), "clean_ate_m": float(np.exp(means[CLEAN_ATE]))}
        row["over_clean"] = row["ate_m"] / row["clean_ate_m"]
        row |= {"least": float(compared[OVER_CLEAN].min()), "most": float(compared[OVER_CLEAN].max())}
    return row


# The tables of a study and its record: made from its folders, joined of pieces, and shown in short.


RUNS, SEQUENCES = "runs.csv", "sequences.csv"
Row: TypeAlias = dict[str, Any]


def write_tables(results: ResultsFolder) -> None:
    """Write runs.csv and sequences.csv. Raises StorageError where a file in the folder is damaged."""
    study = read_study(results)
    conditions = _Conditions(study["subject"]["settings"])
    rows = [_run_row(results, run, conditions, study["protocol"]) for run in results.runs()]
    results.write(results.tables / RUNS, csv_text(rows, run_columns(rows, study["protocol"])))
    described = [_sequence_row(results, case, conditions) for case in results.cases()]
    results.write(results.tables / SEQUENCES, csv_text(described, with_others(SEQUENCE_COLUMNS, described)))


CASE_COLUMNS = ("scene", "setting", "perturbation", "mode", "severity", "seed")
SEQUENCE_COLUMNS = (*CASE_COLUMNS, "frames")
RUN_COLUMNS = (
    *CASE_COLUMNS,
    *("system", "repeat", "outcome", "failure", "result", "frames", "seconds", "processor_s", "peak_memory_bytes"),
)


class _Conditions:
    """What is done in each setting, by its name."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        known = registry()
        self._found = {name: Condition.of(setting, known) for name, setting in settings.items()}

    def columns(self, case: Case) -> Row:
        name = case.setting
        known = self._found.get(name) or Condition.of_name(name)
        condition = {"perturbation": known.perturbation, "mode": known.mode, "severity": known.severity}
        return {"scene": case.scene, "setting": name, **condition, "seed": case.seed}


def _run_row(results: ResultsFolder, run: SystemRun, conditions: _Conditions, protocol: str) -> Row:
    folder = results.of_run(run)
    record = read_run_record(folder)
    scores = read_scores(results, run)
    row: Row = conditions.columns(run.case)
    row |= {"system": run.system, "repeat": run.repeat, "failure": scores["failure"]}
    if record is not None:
        row |= {"outcome": str(record.outcome), "frames": record.frames, "seconds": record.seconds}
        row |= {"processor_s": record.processor_s, "peak_memory_bytes": record.peak_memory_bytes}
    for kind in (STRICT, PAPER, MAP):
        row |= {_column(kind, name, protocol): value for name, value in scores.get(kind, {}).items()}
    failed = record is None or record.outcome is not Outcome.FINISHED or bool(scores["failure"])
    tracked_share = scores.get(STRICT, {}).get("tracked_share")
    row["result"] = result_of(failed, float("nan") if tracked_share is None else tracked_share)
    return row


def _column(kind: str, name: str, protocol: str) -> str:
    """Return the column of a value: those of the study's protocol go by their names alone."""
    return name if kind == protocol else f"{kind}.{name}"


def run_columns(rows: Sequence[Row], protocol: str) -> list[str]:
    """Return the columns of runs.csv: those of every run, the metrics in their order, then what else there is."""
    strict = [_column(STRICT, name, protocol) for name in METRICS]
    paper = [_column(PAPER, name, protocol) for name in PAPER_METRICS]
    metrics = [*strict, *paper] if protocol == STRICT else [*paper, *strict]
    return with_others((*RUN_COLUMNS, *metrics), rows)


def _sequence_row(results: ResultsFolder, case: Case, conditions: _Conditions) -> Row:
    indicators = read_indicators(results, case)
    return {**conditions.columns(case), **indicators}


def with_others(first: Iterable[str], rows: Iterable[Row]) -> list[str]:
    """Return column names: the given ones, then what else the rows have, sorted."""
    known = list(first)
    return [*known, *sorted({name for row in rows for name in row} - set(known))]


def csv_text(rows: Iterable[Row], columns: Sequence[str], *, as_read: bool = False) -> str:
    """Return rows as CSV; what is None is an empty cell, a number has all its digits, no text is a formula.

    as_read: whether the values are cells of such a table, and stay as they are.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(map(cell_of, columns))
    table.writerows([[row.get(name, "") if as_read else _cell(row.get(name)) for name in columns] for row in rows])
    return text.getvalue()


def _cell(value: Any) -> Any:
    return "" if value is None else cell_of(value) if isinstance(value, str) else value


# The record of a study: what was evaluated and the tables of runs and sequences, without what single runs left.
#
# It is small enough to be kept with a project. A study that is run in pieces, on several machines or days, is put
# together from their folders of results and records.


TIMES = ("seconds", "processor_s", "peak_memory_bytes")
"""Columns of runs.csv in which two runs with the same outcome differ."""
DAMAGED = "copy its folder again"

Cells: TypeAlias = dict[str, str]
"""A row of a table: cells as they stand in the file, by column."""
_Named = TypeVar("_Named", Case, SystemRun)


@dataclass(frozen=True)
class StudyRecord:
    """A study in short. study: as in study.json, with VERSIONS and PROCESSORS. runs, sequences: the tables' rows."""

    study: Mapping[str, Any]
    runs: Mapping[SystemRun, Cells]
    sequences: Mapping[Case, Cells]


def read_record(results: ResultsFolder) -> StudyRecord:
    """Return the record of a study from its folder of results, whose tables are written anew, or from a record's.

    Raises InputError where there is no study, StorageError where a file is damaged, and where runs of one system used
    different versions.
    """
    if not (results.folder / STUDY).is_file():
        remedy = "a folder that 'noisy-world evaluate' wrote is needed, or the record of a study"
        raise InputError(results.folder, "holds no study", remedy=remedy)
    if is_record(results):
        study = read_study(results, RECORD)
    else:
        write_tables(results)
        study = read_study(results)
        subject = study["subject"]
        study = {**study, VERSIONS: _versions(results), PROCESSORS: _one(subject.get("processor"))}
    runs = _rows(results, RUNS, (*CASE_COLUMNS, "system", "repeat"), _run_of)
    return StudyRecord(study, runs, _rows(results, SEQUENCES, CASE_COLUMNS, _case_of))


def joined(pieces: Sequence[tuple[ResultsFolder, StudyRecord]]) -> StudyRecord:
    """Return the record of the study that pieces are parts of. A run that several hold alike counts once.

    Raises StorageError, in a line that names the piece, where two are of different studies, where a system's versions
    differ, and where a run or a sequence is there twice and differs.
    """
    (_, first), *others = pieces
    study, runs, sequences = dict(first.study), dict(first.runs), dict(first.sequences)
    for results, piece in others:
        problem = why_not(study, dict(piece.study)) or _other_versions(study[VERSIONS], piece.study[VERSIONS])
        problem = problem or _twice(runs, piece.runs, TIMES)
        if not problem and not of_any_processor(study["subject"]):
            problem = _twice(sequences, piece.sequences)
        if problem:
            raise StorageError(f"is no piece of the study that the first one is of: {problem}", file=results.folder)
        versions = {**study[VERSIONS], **piece.study[VERSIONS]}
        here = _one(*study[PROCESSORS], *piece.study[PROCESSORS])
        study = {**merged(study, dict(piece.study)), VERSIONS: versions, PROCESSORS: here}
        runs, sequences = {**piece.runs, **runs}, {**piece.sequences, **sequences}
    return StudyRecord(study, runs, sequences)


def write_record(record: StudyRecord, results: ResultsFolder) -> None:
    """Write a record into a folder. Raises StorageError where that holds anything but a record."""
    there = results.folder.is_dir() and any(item.name != results.work.name for item in results.folder.iterdir())
    if there and not ((results.folder / STUDY).is_file() and is_record(results)):
        raise StorageError("is not empty and holds no record", file=results.folder, remedy="name another with --out")
    runs = [record.runs[run] for run in sorted(record.runs)]
    sequences = [record.sequences[case] for case in sorted(record.sequences)]
    columns = run_columns(runs, record.study["protocol"])
    results.write(results.tables / RUNS, csv_text(runs, columns, as_read=True))
    columns = with_others(SEQUENCE_COLUMNS, sequences)
    results.write(results.tables / SEQUENCES, csv_text(sequences, columns, as_read=True))
    results.write_json(results.folder / STUDY, {"kind": RECORD, "format": FORMAT, "study": dict(record.study)})


def _rows(
    results: ResultsFolder, name: str, needed: Sequence[str], named: Callable[[Cells], _Named]
) -> dict[_Named, Cells]:
    """Return the rows of a table by what they tell of."""
    path = results.tables / name
    try:
        lines = list(csv.reader(StringIO(read_text(path), newline=""), strict=True))
        columns = [text_of(cell) for cell in lines[0]] if lines else []
        if missing := [column for column in needed if column not in columns]:
            raise StorageError(f"has no column {missing[0]!r}", file=path, remedy=DAMAGED)
        rows = [dict(zip(columns, cells, strict=True)) for cells in lines[1:]]
        return {named(row): row for row in rows}
    except (OSError, ValueError, csv.Error) as error:
        raise StorageError(f"cannot be read: {error}", file=path, remedy=DAMAGED) from error


def _case_of(row: Cells) -> Case:
    return Case.parse(f"{text_of(row['scene'])}/{text_of(row['setting'])}/seed-{row['seed']}")


def _run_of(row: Cells) -> SystemRun:
    return SystemRun(_case_of(row), text_of(row["system"]), int(row["repeat"]))


def _versions(results: ResultsFolder) -> dict[str, dict[str, str]]:
    """Return by system the versions that its runs used."""
    of_systems: dict[str, dict[str, str]] = {}
    for run in results.runs():
        made = read_run_record(results.of_run(run))
        versions = {} if made is None else made.versions
        known = of_systems.setdefault(run.system, {})
        if problem := _other_versions({run.system: known}, {run.system: versions}):
            remedy = "remove the runs of one, and run 'noisy-world evaluate' again"
            raise StorageError(problem, file=results.of_run(run), remedy=remedy)
        known.update(versions)
    return of_systems


def _other_versions(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Return the first version in which the same system differs, or ""."""
    return next(
        (
            f"{system} ran with {name} {there[system][name]} there, and with {here[system][name]} here"
            for system in sorted(there.keys() & here.keys())
            for name in sorted(there[system].keys() & here[system].keys())
            if there[system][name] != here[system][name]
        ),
        "",
    )


def _twice(there: Mapping[Any, Cells], here: Mapping[Any, Cells], apart: Iterable[str] = ()) -> str:
    """Return what both hold and differs, or "". apart: columns that do not count."""
    for named in sorted(there.keys() & here.keys()):
        left, right = there[named], here[named]
        for column in sorted({*left, *right} - set(apart)):
            if left.get(column, "") != right.get(column, ""):
                return f"{named.name} is in both with another {column}"
    return ""


def _one(*processors: Any) -> list[Any]:
    """Return each kind of processor once; None, where none is known, is left out."""
    kinds: list[Any] = []
    for each in processors:
        if each is not None and each not in kinds:
            kinds.append(each)
    return kinds


# A short table of a study for a terminal: what each system made of each perturbation.


NEEDED = ("tabulate",)

SHOWN = {"strict": ("ate_rmse_m", "tracked_share"), "paper": ("ate_m", "sr")}
"""What is shown by each protocol: the first is the error, in metres; by strict that of complete runs alone."""
OF_COMPLETE = SHOWN["strict"][0]


def summary_text(results: ResultsFolder, protocol: str) -> str:
    """Return the table: a row for each perturbation and severity, for each system medians over scenes, seeds, repeats.

    Raises MissingDependencyError without the extra `evaluate`.
    """
    need(NEEDED, "evaluate")
    from tabulate import tabulate

    written = csv.DictReader(StringIO(read_text(results.tables / RUNS)))
    rows = [{name: one_line(text_of(cell)) for name, cell in row.items()} for row in written]
    systems = list(dict.fromkeys(row["system"] for row in rows))
    groups: dict[str, list[Cells]] = {}
    for row in rows:
        groups.setdefault(row["setting"], []).append(row)
    metrics = SHOWN[protocol]
    known = METRICS if protocol == "strict" else PAPER_METRICS
    header = ["setting", *(f"{system}\n{known[name].label}" for system in systems for name in metrics), "runs"]
    table = [
        [setting, *(_median(of, system, name) for system in systems for name in metrics), len(of)]
        for setting, of in groups.items()
    ]
    return tabulate(table, header, disable_numparse=True)


def _median(of_setting: list[Cells], system: str, name: str) -> str:
    """Return the median of a metric: an error in millimetres; and of the runs without one how many ended how."""
    rows = [row for row in of_setting if row["system"] == system]
    counted = [row for row in rows if row["result"] == COMPLETE] if name == OF_COMPLETE else rows
    values = [float(row[name]) for row in counted if row[name]]
    if not rows:
        return ""
    ended = [(sum(row["result"] == result for row in rows), result) for result in (FAILED, INCOMPLETE)]
    endings = ", ".join(f"{count} {result}" for count, result in ended if count)
    if not values:
        return endings
    middle = statistics.median(values)
    text = f"{middle * 1000:.1f} mm" if name.endswith("_m") else f"{middle:.2f}"
    return text if len(values) == len(rows) else f"{text} ({endings or f'{len(values)} of {len(rows)}'})"
