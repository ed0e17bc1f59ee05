# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of the report: numbers as data, and how each is shown; written as CSV, Parquet, LaTeX and Markdown."""

import base64
import importlib.util
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

from ..core.dependencies import PACKAGE
from ..core.errors import one_line
from .cases import cell_of
from .map_metrics import MAP_PREFIX
from .metrics import IS_INCOMPLETE
from .report_input import records
from .run_tables import RESULT, metric_of

if TYPE_CHECKING:
    from jinja2 import Environment
    from pandas import DataFrame


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
    shown = _LATEX_LETTERS.sub(lambda found: _LATEX[found[0]], _line(text))
    return f"{{}}{shown}" if shown.startswith(("[", "*")) else shown  # which would belong to the \\ of the row before


def markdown(text: str) -> str:
    """Return a text as Markdown shows it, in a cell of a table too."""
    return _MARKDOWN_LETTERS.sub(lambda found: f"\\{found[0]}", _line(text))


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
