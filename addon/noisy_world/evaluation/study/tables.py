# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of a study, made from its folders alone: a row for each run, and one for each sequence."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

from ...perturbations import registry
from ..csv_cells import cell_of
from ..metrics.names import METRICS, PAPER_METRICS
from ..metrics.success import result_of
from ..outcome import Outcome
from .cases import Case, Condition, SystemRun
from .results import ResultsFolder
from .run_files import read_run_record
from .scoring import MAP, PAPER, STRICT
from .written import read_indicators, read_scores, read_study

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
