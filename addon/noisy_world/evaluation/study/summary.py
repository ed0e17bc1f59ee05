# SPDX-License-Identifier: GPL-3.0-or-later
"""A short table of a study for a terminal: what each system made of each perturbation."""

import csv
import statistics
from collections.abc import Iterable
from io import StringIO
from typing import TypeAlias

from ...core.errors import one_line
from ...core.extras import need
from ...core.regular_files import read_text
from ..csv_cells import text_of
from ..metrics.names import METRICS, PAPER_METRICS
from ..metrics.success import COMPLETE, FAILED, INCOMPLETE
from .results import ResultsFolder
from .tables import RUNS

NEEDED = ("tabulate",)

SHOWN = {"strict": ("ate_rmse_m", "tracked_share"), "paper": ("ate_m", "sr")}
"""What is shown by each protocol: the first is the error, in metres; by strict that of complete runs alone."""
OF_COMPLETE = SHOWN["strict"][0]
Cells: TypeAlias = dict[str, str]


def summary_text(results: ResultsFolder, protocol: str) -> str:
    """Return the table: a row for each perturbation and severity, for each system medians over scenes, seeds, repeats.

    Raises MissingDependencyError without the extra `evaluate`.
    """
    need(NEEDED, "evaluate")
    from tabulate import tabulate

    written = csv.DictReader(StringIO(read_text(results.tables / RUNS)))
    rows = [{name: one_line(text_of(cell)) for name, cell in row.items()} for row in written]
    systems = list(dict.fromkeys(row["system"] for row in rows))
    groups: dict[tuple[str, ...], list[Cells]] = {}
    for row in rows:
        groups.setdefault((row["setting"],), []).append(row)
    metrics = SHOWN[protocol]
    known = METRICS if protocol == "strict" else PAPER_METRICS
    header = ["setting", *(f"{system}\n{known[name].label}" for system in systems for name in metrics), "runs"]
    table = [
        [
            setting,
            *(_median(rows_of(found, system), name) for system in systems for name in metrics),
            len(found),
        ]
        for (setting,), found in groups.items()
    ]
    return tabulate(table, header, disable_numparse=True)


def rows_of(rows: Iterable[Cells], system: str) -> list[Cells]:
    """Return the rows of a system."""
    return [row for row in rows if row["system"] == system]


def _median(rows: list[Cells], name: str) -> str:
    """Return the median of a metric: an error in millimetres; and of the runs without one how many ended how."""
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
