# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings ranked by the error over clean: a panel for each system, the worst on top."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...metrics.success import IS_INCOMPLETE
from .drawing import COLOURS, GREY, NARROW_IN, Picture, drawing, shortened, svg_bytes, unused

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDE_IN, SYSTEMS_ACROSS = 9.0, 2
BAR_ROW_IN, HEAD_IN = 0.2, 0.62
MARK = 10.0  # times the clean error: a success below
BEHIND = {"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8}
BLUE, RED = COLOURS[0], COLOURS[1]


@dataclass(frozen=True)
class Bar:
    """A setting. over_clean: None where it has no ratio. said: beside the bar. broke: whether it has failed.

    runs: the ratios of single runs.
    """

    label: str
    over_clean: float | None
    said: str
    broke: bool
    runs: tuple[float, ...]


@dataclass(frozen=True)
class RankPanel:
    """A system's settings, the worst first. clean: what is said of its clean error. more: settings left out."""

    title: str
    clean: str
    bars: tuple[Bar, ...]
    more: int


def ranking(panels: Sequence[RankPanel]) -> Picture:
    """Draw a panel for each system; all share one scale, which is logarithmic."""
    across = min(SYSTEMS_ACROSS, len(panels))
    about = (
        "The error (ATE) of each system in each setting over its error on clean frames of the same scenes and seeds, "
        "the worst on top: bars are geometric means, dots single runs; the median clean error in brackets. "
        "Hatched: half of the runs or more failed (no path, or none that can be scored) or are "
        f"incomplete ({IS_INCOMPLETE}), which is no ratio."
    )
    wide = _drawn(panels, WIDE_IN if across > 1 else 0.72 * WIDE_IN, across)
    return Picture("ranking", "What broke each system, and by how much", about, wide, _drawn(panels, NARROW_IN, 1))


def _drawn(panels: Sequence[RankPanel], width_in: float, across: int) -> bytes:
    rows = math.ceil(len(panels) / across)
    most = [max(len(panel.bars) for panel in panels[row * across : (row + 1) * across]) for row in range(rows)]
    heights = [HEAD_IN + BAR_ROW_IN * count for count in most]
    low, high = _limits(panels)
    with drawing(width_in, sum(heights)) as figure:
        grid = figure.subplots(rows, across, squeeze=False, height_ratios=heights)
        for place, (axes, panel) in enumerate(zip(grid.flat, panels, strict=False)):
            _panel(axes, panel, low, high, most[place // across])
        unused(list(grid.flat), len(panels))
        return svg_bytes(figure)


def _limits(panels: Sequence[RankPanel]) -> tuple[float, float]:
    """Return the ends of the scale: what is to be said beside the longest bar has its place too."""
    drawn = [bar for panel in panels for bar in panel.bars if not bar.broke]
    ratios = [ratio for bar in drawn for ratio in (*bar.runs, bar.over_clean) if ratio]
    low, high = min([1.0, *ratios]), max([MARK, *ratios])
    return low / 1.15, high * (high / low) ** 0.62


def numbered_decades(low: float, high: float) -> list[float]:
    """Return where the scale is numbered: powers of ten with 1 among them, so few that their numbers stand apart."""
    first, last = math.ceil(math.log10(low)), math.floor(math.log10(high))
    step = 1 if last - first <= 3 else 2
    return [10.0**power for power in range(first, last + 1) if power % step == 0]


def _panel(axes: "Axes", panel: RankPanel, low: float, high: float, rows: int) -> None:
    """Draw a panel; rows: for how many bars it has room, so that those of all panels are equally thick."""
    from matplotlib.ticker import FixedLocator

    axes.set_xscale("log")
    axes.set_xlim(low, high)
    bars = panel.bars
    axes.set_ylim(rows - 0.4, -0.6)
    axes.axvline(1.0, color="black", linewidth=0.8)
    axes.axvline(MARK, color=GREY, linewidth=0.8, linestyle="--", zorder=0)
    for row, bar in enumerate(bars):
        _bar(axes, row, bar, high)
    axes.set_yticks(range(len(bars)), [shortened(bar.label, 30) for bar in bars])
    axes.tick_params(axis="y", length=0)
    axes.xaxis.set_major_locator(FixedLocator(numbered_decades(low, high)))
    axes.xaxis.set_major_formatter("\u00d7 {x:g}")
    axes.minorticks_off()
    axes.spines["left"].set_visible(False)
    title = f"{shortened(panel.title, 30)}{f'   ({panel.clean})' if panel.clean else ''}"
    axes.set_title(title, loc="left", fontsize=9.0)
    more = f"; {panel.more} more setting{'s' if panel.more > 1 else ''} below these" if panel.more else ""
    axes.set_xlabel(f"error over clean{more}", fontsize=7.0)


def _bar(axes: "Axes", row: int, bar: Bar, high: float) -> None:
    after = 1.0
    if bar.broke:
        axes.barh(row, high, height=0.66, facecolor="#f6d9c6", edgecolor=RED, hatch="////", linewidth=0.0)
        axes.text(1.25, row, bar.said, va="center", fontsize=7.5, bbox=BEHIND)
        return
    if bar.over_clean is not None:
        axes.barh(
            row, bar.over_clean - 1.0, left=1.0, height=0.66, color=BLUE, alpha=0.55 if bar.over_clean < MARK else 1
        )
        after = max(1.0, bar.over_clean, *bar.runs)
        axes.plot(bar.runs, [row] * len(bar.runs), ".", color="black", markersize=3.5, alpha=0.7)
    axes.annotate(
        bar.said, (after, row), xytext=(4, 0), textcoords="offset points", va="center", fontsize=7.5, bbox=BEHIND
    )
