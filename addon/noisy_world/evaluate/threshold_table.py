# SPDX-License-Identifier: GPL-3.0-or-later
"""The thresholds of a folder of searches: a table, and a figure by system in the physical unit."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.atomic_files import storage_errors
from .figures import GREY, Picture, drawing, line_styles, shortened, svg_bytes, unused
from .report_sections import Section
from .report_tables import NOTHING, SHARED, Column, Table, cell_text
from .study_results import ResultsFolder
from .study_tables import csv_text
from .thresholds import ENDING, Axis, SearchFile, SearchResult, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# Thresholds by system: a panel for each parameter of a perturbation, in its unit.


WIDE_IN, ACROSS = 7.2, 2
ROW_IN, HEAD_IN = 0.3, 0.75


@dataclass(frozen=True)
class ThresholdBar:
    """What was found of a system."""

    system: str
    found: SearchResult


def thresholds(bars: Sequence[ThresholdBar]) -> Picture:
    """Draw each threshold with its interval; an arrow stands for what lies beyond what was searched."""
    panels: dict[str, list[ThresholdBar]] = {}
    for bar in bars:
        panels.setdefault(bar.found.axis.name, []).append(bar)
    styles = line_styles(sorted({bar.system for bar in bars}))
    about = (
        "The value at which success falls to one half, of each system, with its 95 % interval; to the right is worse. "
        "A grey line is the range that was searched. An arrow: the threshold, or an end of its interval, lies beyond."
    )
    rows = math.ceil(len(panels) / ACROSS)
    height_in = rows * (HEAD_IN + ROW_IN * max(map(len, panels.values()), default=0))
    with drawing(WIDE_IN, height_in) as figure:
        axes = figure.subplots(rows, ACROSS, squeeze=False).ravel().tolist()
        for panel, item in zip(axes, panels.values(), strict=False):
            _panel(panel, item, styles)
        unused(axes, len(panels))
        return Picture("thresholds", "Where success falls to one half", about, svg_bytes(figure))


def _panel(panel: "Axes", bars: list[ThresholdBar], styles: dict[str, tuple[str, str]]) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis = bars[0].found.axis
    if all(bar.found.axis.logarithmic for bar in bars):
        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        panel.xaxis.set_minor_formatter(NullFormatter())
    for row, bar in enumerate(bars):
        _row(panel, row, bar.found, *styles[bar.system])
    panel.set_yticks(range(len(bars)), [shortened(bar.system, 24) for bar in bars])
    panel.set_ylim(len(bars) - 0.4, -0.6)
    panel.set_title(f"{axis.perturbation}: {axis.parameter}{f' [{axis.unit}]' if axis.unit else ''}", loc="left")
    if axis.worst < axis.mild:
        panel.invert_xaxis()


def _row(panel: "Axes", row: int, found: SearchResult, colour: str, marker: str) -> None:
    axis = found.axis
    panel.plot([axis.mild, axis.worst], [row, row], color=GREY, linewidth=0.5, alpha=0.6, zorder=1)
    if found.verdict in (Verdict.HOLDS, Verdict.FAILS):
        end = axis.worst if found.verdict is Verdict.HOLDS else axis.mild
        _arrow(panel, row, end, colour, outward=_outward(found, end), hollow=True)
        return
    ends = [axis.mild if found.mild is None else found.mild, axis.worst if found.worst is None else found.worst]
    panel.plot(ends, [row, row], color=colour, linewidth=2.0, zorder=2, solid_capstyle="butt")
    for value, end in ((found.mild, axis.mild), (found.worst, axis.worst)):
        if value is None:
            _arrow(panel, row, end, colour, outward=_outward(found, end), hollow=False)
    if found.threshold is not None:
        panel.plot([found.threshold], [row], marker=marker, color=colour, markersize=5, linestyle="", zorder=3)


def _outward(found: SearchResult, end: float) -> str:
    """Return the marker that points out of the range at one of its ends; to the right is worse."""
    return ">" if end == found.axis.worst else "<"


def _arrow(panel: "Axes", row: int, at: float, colour: str, *, outward: str, hollow: bool) -> None:
    face = "white" if hollow else colour
    panel.plot([at], [row], marker=outward, color=colour, markerfacecolor=face, markersize=9, linestyle="", zorder=4,
               clip_on=False)  # fmt: skip


COLUMNS = (
    *("perturbation", "parameter", "unit", "system", "verdict", "threshold", "mild_end", "worst_end", "runs"),
    *("searched_from", "searched_to", "success"),
)


@dataclass(frozen=True)
class SystemThreshold:
    """What a search that has ended found, of a system. success: the metric."""

    system: str
    found: SearchResult
    success: str


def read_thresholds(folder: Path) -> list[SystemThreshold]:
    """Return what the searches in a folder have found, by perturbation and system. Raises StorageError."""
    found: list[SystemThreshold] = []
    for file in sorted(folder.glob(f"*/*{ENDING}")):
        content = SearchFile(ResultsFolder(file.parent), file.name.removesuffix(ENDING)).read()
        if content is not None and content["found"] is not None:
            identity, values = content["identity"], content["found"]
            at = {**values, "axis": Axis(**values["axis"]), "verdict": Verdict(values["verdict"])}
            found.append(SystemThreshold(identity["system"]["name"], SearchResult(**at), identity["success"]))
    return sorted(found, key=lambda item: (item.found.axis.name, item.system))


def drawn(found: list[SystemThreshold]) -> Picture:
    """Draw thresholds by system, a panel for each parameter."""
    return thresholds([ThresholdBar(item.system, item.found) for item in found])


def write_thresholds(folder: Path) -> list[Path]:
    """Write thresholds.csv and thresholds.svg from the searches in a folder; return the files. Raises StorageError."""
    found = read_thresholds(folder)
    files = {"thresholds.csv": csv_text(map(row_of, found), COLUMNS).encode(), "thresholds.svg": drawn(found).svg}
    for name, data in files.items():
        with storage_errors(folder / name):
            (folder / name).write_bytes(data)
    return [folder / name for name in files]


def row_of(item: SystemThreshold) -> dict[str, Any]:
    """Return a row of the table, by COLUMNS."""
    found, axis = item.found, item.found.axis
    return {
        "perturbation": axis.perturbation,
        "parameter": axis.parameter,
        "unit": axis.unit,
        "system": item.system,
        "verdict": str(found.verdict),
        "threshold": found.threshold,
        "mild_end": found.mild,
        "worst_end": found.worst,
        "runs": found.runs,
        "success": item.success,
        "searched_from": axis.mild,
        "searched_to": axis.worst,
    }


# Where each system breaks, from searches for thresholds that were kept in the study's folder.


FOLDER = "thresholds"
"""In a results folder, that of the searches."""
DIGITS = 3


def threshold_text(row: Mapping[str, Any]) -> str:
    """Return what was found, of a row of the table: "14.9 [11.6, 18.8] frames", or beyond which value it lies."""
    unit = f" {row['unit']}" if row["unit"] else ""
    mildest, worst = (cell_text(row[name], DIGITS) for name in ("searched_from", "searched_to"))
    if row["verdict"] == Verdict.HOLDS:
        return f"beyond {worst}{unit}"
    if row["verdict"] == Verdict.FAILS:
        return f"before {mildest}{unit}"
    threshold, low, high = (cell_text(row[name], DIGITS) for name in ("threshold", "mild_end", "worst_end"))
    low = f"before {mildest}" if low == NOTHING else low
    high = f"beyond {worst}" if high == NOTHING else high
    return f"{threshold} [{low}, {high}]{unit}"


COLUMNS_SHOWN = (
    *(SHARED["perturbation"], Column("parameter", "parameter"), SHARED["system"]),
    Column(
        "threshold",
        "threshold",
        meaning="the value at which success falls to one half; in brackets its 95 % interval",
        text=threshold_text,
    ),
    Column("runs", "runs", meaning="that the search took"),
    Column("success", "success", meaning="the metric that says what a success is"),
)


def threshold_section(results: Path) -> Section | None:
    """Return what the searches in a results folder have found; None where none has ended. Raises StorageError."""
    import pandas as pd

    found = read_thresholds(results / FOLDER)
    if not found:
        return None
    frame = pd.DataFrame(list(map(row_of, found)), columns=list(COLUMNS))
    caption = "The value of a perturbation at which a system's success falls to one half, with its 95 % interval."
    table = Table(FOLDER, "Where each system breaks", caption, frame, COLUMNS_SHOWN)
    return Section(FOLDER, "Thresholds", pictures=[drawn(found)], tables=[table])
