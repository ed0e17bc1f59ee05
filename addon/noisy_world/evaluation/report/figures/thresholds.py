# SPDX-License-Identifier: GPL-3.0-or-later
"""Thresholds by system: a panel for each parameter of a perturbation, in its unit."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...thresholds.search import Found, Verdict
from .drawing import GREY, Picture, drawing, line_styles, shortened, svg_bytes, unused

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDE_IN, ACROSS = 7.2, 2
ROW_IN, HEAD_IN = 0.3, 0.75


@dataclass(frozen=True)
class ThresholdBar:
    """What was found of a system."""

    system: str
    found: Found


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


def _row(panel: "Axes", row: int, found: Found, colour: str, marker: str) -> None:
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


def _outward(found: Found, end: float) -> str:
    """Return the marker that points out of the range at one of its ends; to the right is worse."""
    return ">" if end == found.axis.worst else "<"


def _arrow(panel: "Axes", row: int, at: float, colour: str, *, outward: str, hollow: bool) -> None:
    face = "white" if hollow else colour
    panel.plot([at], [row], marker=outward, color=colour, markerfacecolor=face, markersize=9, linestyle="", zorder=4,
               clip_on=False)  # fmt: skip
