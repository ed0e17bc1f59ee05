# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of a study and its record: made from its folders, joined of pieces, and shown in short."""

import csv
import io
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from typing import Any, TypeAlias, TypeVar

from ..core.dependencies import need
from ..core.errors import InputError, StorageError, one_line
from ..core.file_access import read_text
from ..perturbations import registry
from .cases import Case, Condition, SystemRun, cell_of, text_of
from .metrics import COMPLETE, FAILED, INCOMPLETE, METRICS, PAPER_METRICS, result_of
from .run_files import Outcome, read_run_record
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
        found = self._found.get(name) or Condition.of_name(name)
        condition = {"perturbation": found.perturbation, "mode": found.mode, "severity": found.severity}
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
    found = read_indicators(results, case)
    return {**conditions.columns(case), **found}


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
    found: dict[str, dict[str, str]] = {}
    for run in results.runs():
        made = read_run_record(results.of_run(run))
        said = {} if made is None else made.versions
        known = found.setdefault(run.system, {})
        if problem := _other_versions({run.system: known}, {run.system: said}):
            remedy = "remove the runs of one, and run 'noisy-world evaluate' again"
            raise StorageError(problem, file=results.of_run(run), remedy=remedy)
        known.update(said)
    return found


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
    found: list[Any] = []
    for each in processors:
        if each is not None and each not in found:
            found.append(each)
    return found


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
    said = ", ".join(f"{count} {result}" for count, result in ended if count)
    if not values:
        return said
    middle = statistics.median(values)
    text = f"{middle * 1000:.1f} mm" if name.endswith("_m") else f"{middle:.2f}"
    return text if len(values) == len(rows) else f"{text} ({said or f'{len(values)} of {len(rows)}'})"
