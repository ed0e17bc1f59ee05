# SPDX-License-Identifier: GPL-3.0-or-later
"""What a results folder holds, read for the report, and the runs that it draws."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError
from ..core.file_access import read_text
from ..core.json_text import read_json
from ..core.schema import quoted
from .cases import CLEAN, text_of
from .metrics import FAILED, INCOMPLETE, PAPER_METRICS, PAPER_PREFIX
from .run_tables import complete_runs, with_over_clean, with_results
from .study_results import KIND, RECORD, STUDY, is_record, read_study
from .study_results import ResultsFolder as StudyFolder

if TYPE_CHECKING:
    from pandas import DataFrame, Series


KEY = ("scene", "setting", "seed")
"""What names a sequence."""
RUN_KEY = (*KEY, "system", "repeat")
TEXTS = ("scene", "setting", "perturbation", "mode", "seed", "system", "outcome", "failure", "result")
FOLDERS = ("scene", "setting", "seed", "system")
"""Columns whose texts name folders."""
LONGEST_NAME_BYTES = 250  # file systems take 255 bytes, and "seed-" stands before a seed
RUN_COLUMNS = ("scene", "setting", "perturbation", "mode", "severity", "seed", "system", "repeat", "outcome", "failure")
SEQUENCE_COLUMNS = ("scene", "setting", "perturbation", "mode", "severity", "seed")
STRICT_PREFIX = "strict."
REMEDY = "the folder that 'noisy-world evaluate --out' wrote is needed"


@dataclass(frozen=True)
class Results:
    """A results folder.

    study: study.json, {} where there is none. runs: a row for each run, in the order of RUN_KEY; texts are never NaN,
    numbers are float64 with NaN where there is none; `result`, `failed` and `incomplete` say what came of it, and the
    columns of OVER_CLEAN_METRICS compare it with clean. sequences: a row for each sequence. missing: a sentence for
    each thing that the report has to do without. of_record: whether it is the record of a study, without what single
    runs left.
    """

    folder: Path
    study: Mapping[str, Any]
    runs: "DataFrame"
    sequences: "DataFrame"
    missing: tuple[str, ...] = field(default=())
    of_record: bool = False

    @property
    def complete(self) -> "DataFrame":
        """The runs that neither failed nor are incomplete: those whose errors are averaged."""
        return complete_runs(self.runs)

    def run_folder(self, run: Mapping[str, Any]) -> Path:
        """Return the folder of a run, given as a row of `runs`."""
        return self._sequence_folder("runs", run) / str(run["system"]) / f"repeat-{int(run['repeat'])}"

    def sequence_folder(self, run: Mapping[str, Any]) -> Path:
        """Return the folder of the sequence that a run was on, or that a row of `sequences` tells of."""
        return self._sequence_folder("sequences", run)

    def _sequence_folder(self, kind: str, row: Mapping[str, Any]) -> Path:
        return self.folder / kind / str(row["scene"]) / str(row["setting"]) / f"seed-{row['seed']}"


def read_results(folder: Path) -> Results:
    """Read a results folder.

    Raises InputError where it holds no table of runs or one that cannot be read, StorageError for a damaged study.json.
    """
    path = folder / "tables" / "runs.csv"
    if not path.is_file():
        raise InputError(path, "is not there", remedy=REMEDY)
    runs = read_table(path, RUN_COLUMNS)
    if runs.empty:
        raise InputError(path, "holds no run yet", remedy="let 'noisy-world evaluate' finish a run first")
    for line, repeat in enumerate(runs["repeat"].tolist(), start=2):
        if not float(repeat).is_integer():
            raise InputError(path, "is no whole number", where=f"line {line}, column 'repeat'", remedy=REMEDY)
    runs = runs.sort_values(list(RUN_KEY), kind="stable", ignore_index=True, key=_natural)
    runs = _strict_first(runs)
    runs = with_over_clean(with_results(runs))
    missing = []
    sequences_path = folder / "tables" / "sequences.csv"
    if sequences_path.is_file():
        sequences = read_table(sequences_path, SEQUENCE_COLUMNS)
    else:
        missing.append("tables/sequences.csv is not there: nothing is said of what was done to the sequences.")
        sequences = runs[list(SEQUENCE_COLUMNS)].drop_duplicates(list(KEY))
    sequences = sequences.sort_values(list(KEY), kind="stable", ignore_index=True, key=_natural)
    study, of_record = _study(folder, missing)
    if of_record:
        missing.append("this is a record: paths, errors over time and frames are in the folders of its pieces.")
    missing += _missing_runs(runs, sequences)
    return Results(folder, study, runs, sequences, tuple(missing), of_record)


def read_table(path: Path, needed: Sequence[str]) -> "DataFrame":
    """Read a table of comma-separated values: names are texts, whatever they look like, all else is numbers.

    Raises InputError for a table without a needed column, and for text where a number should be.
    """
    table = read_texts(path)
    table = table.rename(columns=text_of)
    for name in needed:
        if name not in table.columns:
            raise InputError(path, f"has no column {name!r}", remedy=REMEDY)
    for name in table.columns:
        if name in TEXTS:
            table[name] = table[name].map(text_of)
        else:
            table[name] = _numbers(table[name].tolist(), path, name)
    for name in FOLDERS:
        if name in needed:
            _check_folders(table[name].tolist(), path, name)
    return table


def _check_folders(names: list[str], path: Path, column: str) -> None:
    """Raise InputError for a name that is none of a folder: what it leads to would be read."""
    for line, name in enumerate(names, start=2):
        if name in ("", ".", "..") or "/" in name or not name.isprintable() or len(name.encode()) > LONGEST_NAME_BYTES:
            raise InputError(path, f"{quoted(name)} is no name", where=f"line {line}, column {column!r}", remedy=REMEDY)


def read_texts(path: Path) -> "DataFrame":
    """Return a table of comma-separated values as texts. Raises InputError where it cannot be read."""
    import pandas as pd

    try:
        text = read_text(path)
        table = pd.read_csv(StringIO(text), dtype=str, keep_default_na=False)
    except (OSError, UnicodeError, pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        raise InputError(path, f"cannot be read: {str(error) or 'it is empty'}", remedy=REMEDY) from error
    if (at := text.find("\0")) >= 0:  # where pandas 2 ends a name without a word
        raise InputError(path, "holds a NUL", where=f"line {text.count(chr(10), 0, at) + 1}", remedy=REMEDY)
    return table


def records(table: "DataFrame") -> Iterator[dict[str, Any]]:
    """Yield the rows of a table as mappings."""
    for row in table.to_dict("records"):
        yield {str(name): value for name, value in row.items()}


def read_object(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file. Raises InputError where there is none."""
    try:
        value = read_json(path)
    except FileNotFoundError:
        raise InputError(path, "is not there", remedy=REMEDY) from None
    except ValueError as error:
        raise InputError(path, str(error), remedy=REMEDY) from error
    if not isinstance(value, dict):
        raise InputError(path, f"is no JSON object but {json.dumps(value)[:40]}", remedy=REMEDY)
    return value


def _strict_first(runs: "DataFrame") -> "DataFrame":
    """Return runs whose columns are named as under protocol strict, whichever protocol the study chose."""
    if not any(str(name).startswith(STRICT_PREFIX) for name in runs.columns):
        return runs
    names = {name: f"{PAPER_PREFIX}{name}" for name in PAPER_METRICS if name in runs.columns}
    names |= {name: name.removeprefix(STRICT_PREFIX) for name in runs.columns if name.startswith(STRICT_PREFIX)}
    return runs.rename(columns=names)


def _natural(column: "Series") -> "Series":
    """Return what a column is sorted by: seeds as numbers, where they are."""
    return column.str.zfill(20) if column.name == "seed" else column


def _finite(text: str) -> float:
    """Return a number. Raises ValueError for infinity and NaN, too: no table that is written here holds them."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError("is not finite")
    return number


def _numbers(texts: list[str], path: Path, column: str) -> "list[float]":
    numbers = []
    for line, text in enumerate(texts, start=2):
        try:
            numbers.append(_finite(text) if text else float("nan"))
        except ValueError:
            where = f"line {line}, column {column!r}"
            raise InputError(path, f"{text[:40]!r} is no number", where=where, remedy=REMEDY) from None
    return numbers


def _study(folder: Path, missing: list[str]) -> tuple[dict[str, Any], bool]:
    """Return what was evaluated, {} where that is not there, and whether the folder is the record of a study."""
    if not (folder / STUDY).is_file():
        missing.append(f"{STUDY} is not there: what was evaluated is told from the tables alone.")
        return {}, False
    results = StudyFolder(folder)
    of_record = is_record(results)
    return read_study(results, RECORD if of_record else KIND), of_record


def _missing_runs(runs: "DataFrame", sequences: "DataFrame") -> list[str]:
    """Tell which systems have no run on a sequence that others were run on."""
    done = set(runs[[*KEY, "system"]].itertuples(index=False, name=None))
    systems = sorted(set(runs["system"]))
    every = sorted(
        set(sequences[list(KEY)].itertuples(index=False, name=None)) | {tuple(key[:3]) for key in done},
    )
    lines = []
    for system in systems:
        lacking = [key for key in every if (*key, system) not in done]
        if lacking:
            first = ", ".join(f"{scene}/{setting}/seed-{seed}" for scene, setting, seed in lacking[:3])
            more = ", ..." if len(lacking) > 3 else ""
            lines.append(f"{system} has no run on {len(lacking)} of {len(every)} sequences: {first}{more}.")
    return lines


# Chooses the runs that are drawn: a system's clean, median, worst, incomplete and failed ones.


ERROR = "ate_rmse_m"
MOST_SYSTEMS = 6
MOST_SEQUENCES = 6


@dataclass(frozen=True)
class Pick:
    """A run, as a row of the table of runs, and why it was chosen."""

    run: dict[str, Any]
    why: str


def picked_runs(results: Results) -> list[Pick]:
    """Return for each system a clean run, the median and the worst other complete one, an incomplete and a failed one.

    Where there are more systems than MOST_SYSTEMS, those that come first by name.
    """
    picks = []
    for system in sorted(set(results.runs["system"]))[:MOST_SYSTEMS]:
        runs = results.runs[results.runs["system"] == system]
        picks += _of_system(runs)
    return picks


def picked_sequences(results: Results) -> list[list[dict[str, Any]]]:
    """Return for some sequences their first repeats: a clean one, then those with the largest errors and most failures.

    No two are of one setting.
    """
    runs = results.runs[results.runs["repeat"] == results.runs["repeat"].min()]
    groups = []
    for _, group in runs.groupby(list(KEY), sort=False):
        rows = list(records(group))
        largest = max((row.get(ERROR, float("nan")) for row in rows if row.get(ERROR, -1.0) >= 0), default=0.0)
        groups.append((int(group["failed"].sum()), largest, rows))
    clean = [group for group in groups if group[2][0]["perturbation"] == CLEAN]
    # Dynamic ones first: there is something to see in what was done to each frame.
    noisy = [group for group in groups if group[2][0]["perturbation"] != CLEAN and group[0] < len(group[2])]
    noisy.sort(key=lambda group: (-(group[2][0]["mode"] == "dynamic"), -group[1], -group[0]))
    chosen, seen = clean[:1], {CLEAN}
    for group in noisy:
        setting = group[2][0]["setting"]
        if setting not in seen and len(chosen) < MOST_SEQUENCES:
            seen.add(setting)
            chosen.append(group)
    return [rows for _, _, rows in chosen]


def _of_system(runs: "DataFrame") -> list[Pick]:
    scored = complete_runs(runs)
    if ERROR in scored:
        scored = scored[scored[ERROR].notna()].sort_values(ERROR, kind="stable")
    clean = list(records(scored[scored["perturbation"] == CLEAN]))
    noisy = list(records(scored[scored["perturbation"] != CLEAN]))
    incomplete, failed = (list(records(runs[runs[name]])) for name in (INCOMPLETE, FAILED))
    picks = _first(clean[(len(clean) - 1) // 2 :], "clean")
    picks += _first(noisy[(len(noisy) - 1) // 2 :], "median") if len(noisy) > 1 else []
    picks += _first(noisy[-1:], "worst complete")
    return picks + _first(incomplete, INCOMPLETE) + _first(failed, FAILED)


def _first(rows: Sequence[dict[str, Any]], why: str) -> list[Pick]:
    return [Pick(rows[0], why)] if rows else []
