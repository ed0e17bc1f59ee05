# SPDX-License-Identifier: GPL-3.0-or-later
"""The record of a study: what was evaluated and the tables of runs and sequences, without what single runs left.

It is small enough to be kept with a project. A study that is run in pieces, on several machines or days, is put
together from their folders of results and records.
"""

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from typing import Any, TypeAlias, TypeVar

from ...core.errors import InputError, StorageError
from ...core.regular_files import read_text
from ..csv_cells import text_of
from .cases import Case, SystemRun
from .identity import merged, of_any_processor, why_not
from .results import STUDY, ResultsFolder
from .run_files import read_run_record
from .tables import CASE_COLUMNS, RUNS, SEQUENCE_COLUMNS, SEQUENCES, csv_text, run_columns, with_others, write_tables
from .written import FORMAT, RECORD, is_record, read_study

VERSIONS = "versions"
"""In a record's study: by system what its runs say of the versions that they used."""
PROCESSORS = "processors"
"""In a record's study: the kinds of processors whose frames it has."""
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
        _check_record(results, study)
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


def _check_record(results: ResultsFolder, study: Mapping[str, Any]) -> None:
    versions, processors = study.get(VERSIONS), study.get(PROCESSORS)
    if not isinstance(processors, list):
        raise StorageError(f"study.{PROCESSORS}: is no list", file=results.folder / STUDY, remedy=DAMAGED)
    if not isinstance(versions, dict) or not all(_is_texts(said) for said in versions.values()):
        raise StorageError(f"study.{VERSIONS}: is no mapping of systems", file=results.folder / STUDY, remedy=DAMAGED)


def _is_texts(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(each, str) for each in value.values())
