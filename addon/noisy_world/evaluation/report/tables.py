# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of the report: numbers as data, and how each is shown; written as CSV, Parquet, LaTeX and Markdown."""

import importlib.util
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

from ..csv_cells import cell_of
from .escaping import latex, markdown
from .reading import records

if TYPE_CHECKING:
    from pandas import DataFrame

NOTHING = "\u2013"
"""What stands where there is no value."""
DIGITS = 4  # significant, of a number that is shown; the files have all
ARROWS = {"lower": "↓", "higher": "↑", "": ""}


def shown(value: Any, digits: int = DIGITS) -> str:
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
        return shown(row.get(self.name)) if self.text is None else self.text(row)

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
    from .templating import environment

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
