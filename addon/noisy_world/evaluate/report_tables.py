# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's input, which a results folder holds, and its tables, as CSV, Parquet, LaTeX and shown."""

import base64
import importlib.util
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from io import BytesIO, StringIO
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError, one_line
from ..core.file_access import read_json, read_text
from ..core.packages import PACKAGE
from ..core.schema import quoted
from .cases import CLEAN, cell_of, text_of
from .map_metrics import MAP_PREFIX
from .metrics import FAILED, INCOMPLETE, IS_INCOMPLETE, PAPER_METRICS, PAPER_PREFIX
from .study_results import KIND, RECORD, STUDY, is_record, read_study
from .study_results import ResultsFolder as StudyFolder
from .study_tables import RESULT, complete_runs, metric_of, with_over_clean, with_results

if TYPE_CHECKING:
    from jinja2 import Environment
    from pandas import DataFrame, Series


# What a results folder holds, read for the report, and the runs that it draws.


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


# Texts that users chose, such as names of scenes, as LaTeX and Markdown show them; HTML is the template engine's.


_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    **{letter: f"\\{letter}" for letter in "&%$#_{}"},
    "\u2013": "--",
    "\u00a0": "~",
    "…": r"\ldots{}",
    "±": r"$\pm$",
    "\u2020": r"$\dagger$",
    "\u00d7": r"$\times$",
    "↑": r"$\uparrow$",
    "↓": r"$\downarrow$",
}
_LATEX_LETTERS = re.compile("[" + re.escape("".join(_LATEX)) + "]")
_MARKDOWN_LETTERS = re.compile(r"[\\`*_{}\[\]<>#|~!&$]")


def latex(text: str) -> str:
    """Return a text as LaTeX shows it, in a document of UTF-8."""
    shown = _LATEX_LETTERS.sub(lambda match: _LATEX[match[0]], _line(text))
    return f"{{}}{shown}" if shown.startswith(("[", "*")) else shown  # which would belong to the \\ of the row before


def markdown(text: str) -> str:
    """Return a text as Markdown shows it, in a cell of a table too."""
    return _MARKDOWN_LETTERS.sub(lambda match: f"\\{match[0]}", _line(text))


def _line(text: str) -> str:
    """Return a text of one line that keeps its no-break spaces, which Python does not count as printable."""
    return "\u00a0".join(map(one_line, text.split("\u00a0")))


NOTHING = "\u2013"
"""What stands where there is no value."""
DIGITS = 4  # significant, of a number that is shown; the files have all
ARROWS = {"lower": "↓", "higher": "↑", "": ""}


def cell_text(value: Any, digits: int = DIGITS) -> str:
    """Return a value as a cell shows it: a number to some significant digits, nothing as a dash."""
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Integral):
        return str(int(value))
    if isinstance(value, Real):
        number = float(value)
        if math.isnan(number):
            return NOTHING
        if math.isinf(number):
            return "∞" if number > 0 else "-∞"
        rounded = f"{number:.{digits}g}"
        return f"{number:.0f}" if "e+" in rounded and abs(number) < 1e15 else rounded.replace("e-0", "e-")
    return str(value) or NOTHING


@dataclass(frozen=True)
class Column:
    """A column as it is shown.

    name: of the data's column by which rows are sorted. label: its heading, unit: of its numbers. better: "lower",
    "higher" or "". meaning: a sentence, shown where the pointer rests. text: what a cell shows of a row; by default the
    value of `name`.
    """

    name: str
    label: str
    unit: str = ""
    better: str = ""
    meaning: str = ""
    text: Callable[[Mapping[str, Any]], str] | None = None

    def cell(self, row: Mapping[str, Any]) -> str:
        """Return what a row's cell shows."""
        return cell_text(row.get(self.name)) if self.text is None else self.text(row)

    @property
    def heading(self) -> str:
        """The label with an arrow towards what is better, and the unit."""
        unit = f" [{self.unit}]" if self.unit else ""
        return f"{self.label}{ARROWS.get(self.better, '')}{unit}"


@dataclass(frozen=True)
class Table:
    """A table. name: of its files. caption: a sentence or more on what the numbers are. frame: the data, in order.

    page: the rows that are shown where all would be too many to read; None: all.
    """

    name: str
    title: str
    caption: str
    frame: "DataFrame"
    columns: tuple[Column, ...]
    page: "DataFrame | None" = None

    @property
    def read(self) -> "DataFrame":
        """The rows that are shown."""
        return self.frame if self.page is None else self.page

    def rows(self, most: int | None = None) -> list[list[tuple[str, str]]]:
        """Return the cells of each row that is shown, or of the first: the text, and the value that it is sorted by."""
        return [
            [(column.cell(row), _sort_value(row.get(column.name))) for column in self.columns]
            for row in records(self.read.head(most) if most is not None else self.read)
        ]

    @property
    def numeric(self) -> list[bool]:
        """Which columns are numbers, and stand right-aligned."""
        return [
            column.name in self.frame.columns and self.frame[column.name].dtype.kind in "iufb"
            for column in self.columns
        ]


def csv_bytes(frame: "DataFrame") -> bytes:
    """Return the data as comma-separated values, numbers to their last digit; no text is a formula."""
    safe = frame.map(lambda value: cell_of(value) if isinstance(value, str) else value)
    return safe.rename(columns=lambda name: cell_of(str(name))).to_csv(index=False, lineterminator="\n").encode()


def parquet_bytes(frame: "DataFrame") -> bytes | None:
    """Return the data as Parquet; None where pyarrow is not installed."""
    if importlib.util.find_spec("pyarrow") is None:
        return None
    target = BytesIO()
    frame.to_parquet(target, engine="pyarrow", index=False)
    return target.getvalue()


def markdown_table(table: Table, longest: int) -> str:
    """Return the table in Markdown; of a longer one the first rows, and how many more there are."""
    from tabulate import tabulate

    rows = [[markdown(text) for text, _ in row] for row in table.rows(longest)]
    heads = [markdown(column.heading) for column in table.columns]
    alignment = ["right" if number else "left" for number in table.numeric]
    text = tabulate(rows, heads, tablefmt="pipe", disable_numparse=True, colalign=alignment if rows else None)
    more = len(table.frame) - len(rows)
    return f"{text}\n\n{more} more rows: tables/{table.name}.csv" if more else text


def latex_table(table: Table) -> str:
    """Return the table as a LaTeX table, for the package booktabs."""
    head = [latex(column.heading) for column in table.columns]
    body = [[latex(text) for text, _ in row] for row in table.rows()]
    return latex_tabular(table.name, table.caption, "".join("lr"[number] for number in table.numeric), [head], body)


def latex_tabular(
    name: str, caption: str, alignment: str, heads: Sequence[Sequence[str]], body: Sequence[Sequence[str]]
) -> str:
    """Return a LaTeX table. heads, body: rows of cells that are LaTeX already. caption: plain text."""

    return (
        environment()
        .get_template("table.tex.j2")
        .render(name=name, caption=latex(caption), alignment=alignment, heads=heads, body=body)
    )


def _sort_value(value: Any) -> str:
    """Return a value as the page's script compares it: numbers as such, nothing as nothing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return repr(float(value)) if isinstance(value, Real) else str(value)


# The report's templates: HTML escapes by itself; Markdown and LaTeX by the filters of their names.


FOLDER = PACKAGE / "evaluate" / "templates"


@cache
def environment() -> "Environment":
    """Return the environment of the templates in FOLDER; a name that a template is not given is an error."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

    made = Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=select_autoescape(("html.j2",)),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters["markdown"] = markdown
    made.filters["latex"] = latex
    made.filters["base64"] = lambda data: base64.b64encode(data).decode("ascii")
    return made


# What columns mean: headings, units and sentences for the metrics of runs and for what the tables share.


SHARED = {
    column.name: column
    for column in (
        Column("scene", "scene"),
        Column("setting", "setting", meaning="what was done to the sequence, by the preset's name"),
        Column("perturbation", "perturbation"),
        Column("mode", "mode", meaning="static: one severity; dynamic: drawn anew for each frame"),
        Column("severity", "severity", meaning="1 to 5; none where parameters take its place"),
        Column("seed", "seed"),
        Column("system", "system"),
        Column("repeat", "repeat"),
        Column("outcome", "outcome", meaning="how the system's process ended"),
        Column("failure", "failure", meaning="why the estimate has no score"),
        Column(RESULT, "result", meaning=f"complete, incomplete ({IS_INCOMPLETE}) or failed"),
        Column("runs", "runs", meaning="all of them, failed and incomplete ones too"),
        Column("n", "n"),
        Column("failed", "failed", better="lower", meaning="runs that gave no estimate, or one that cannot be scored"),
        Column("incomplete", "incomplete", better="lower", meaning=f"runs that {IS_INCOMPLETE}"),
        Column("frames", "frames"),
        Column("seconds", "time", "s", meaning="on the wall"),
        Column("processor_s", "processor time", "s"),
        Column("peak_memory_bytes", "peak memory", "bytes"),
    )
}


def column_of(name: str) -> Column:
    """Return how a column of a table is shown; one that nobody described has its name for a heading."""
    if name in SHARED:
        return SHARED[name]
    metric = metric_of(name)
    if metric is None:
        return Column(name, name)
    label = f"map {metric.label}" if name.startswith(MAP_PREFIX) else metric.label
    return Column(name, label, metric.unit, metric.better, metric.meaning)
