# SPDX-License-Identifier: GPL-3.0-or-later
"""Metrics as a table for the terminal, a row each: what it is, its value and unit, and which is better."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..evaluation.metrics import Metric


def metric_lines(metrics: "Iterable[tuple[str, Metric, float | None]]") -> list[str]:
    """Return the lines of a table, its head first. metrics: name, metric and value, None where it has none."""
    rows = [("metric", "value", "", "better", "name")]
    rows += [(metric.label, _number(value), metric.unit, metric.better, name) for name, metric, value in metrics]
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    return [
        f"{label:<{widths[0]}}  {value:>{widths[1]}} {unit:<{widths[2]}}  {better:<{widths[3]}}  {name}"
        for label, value, unit, better, name in rows
    ]


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e6 else f"{value:.5g}"
