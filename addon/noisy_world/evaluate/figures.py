# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's figures of many runs: curves, heat map, ranking, correlations, and how every figure looks."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from io import BytesIO
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .metrics import IS_INCOMPLETE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure
    from matplotlib.typing import RcKeyType
    from pandas import DataFrame, Series


# Okabe and Ito's colours, which people with any common kind of colour blindness tell apart; without yellow, which is
# hard to see on white (Color Universal Design, 2008).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
GREY = "#888888"
NARROW_IN = 4.4  # the width of a phone at about the size of its letters
DECIMALS = 5  # of positions, as shares of the figure: a hundredth of a point
STYLE: "dict[RcKeyType, Any]" = {
    "svg.fonttype": "path",  # letters as outlines: the same on every machine
    "svg.hashsalt": "noisy-world",
    "font.family": "DejaVu Sans",  # comes with matplotlib
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "text.parse_math": False,  # a dollar sign in a name is a dollar sign
}


@dataclass(frozen=True)
class Picture:
    """A figure of the report. name: of its file, without the ending. about: what it shows, for who does not see it.

    narrow: the same for a phone, NARROW_IN wide; b"" where the figure is narrow already.
    """

    name: str
    title: str
    about: str
    svg: bytes
    narrow: bytes = b""


@contextmanager
def drawing(width_in: float, height_in: float) -> Iterator["Figure"]:
    """Give a figure of a size in inches, in the report's style."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context():
        mpl.rcdefaults()  # whatever a user's own style is
        for name, value in STYLE.items():
            mpl.rcParams[name] = value
        yield Figure(figsize=(width_in, height_in), layout="constrained")


def fixed_layout(figure: "Figure") -> None:
    """Lay a figure out for good.

    What is laid out is rounded: its last digits differ from one time to the next, and names in the file hang on them.
    """
    from matplotlib.transforms import Bbox

    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        axes.set_position(Bbox(np.round(axes.get_position(original=True).get_points(), DECIMALS)))


def svg_bytes(figure: "Figure") -> bytes:
    """Return a figure as SVG, without the date and the name of the program. To be called inside `drawing`."""
    fixed_layout(figure)
    target = BytesIO()
    figure.savefig(target, format="svg", metadata={"Date": None, "Creator": None})
    return target.getvalue()


def line_styles(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return a colour and a marker for each name; beyond seven, pairs of them differ."""
    styles = {}
    for index, name in enumerate(names):
        marker = MARKERS[(index + index // len(COLOURS)) % len(MARKERS)]
        styles[name] = COLOURS[index % len(COLOURS)], marker
    return styles


def unused(axes: Sequence["Axes"], count: int) -> None:
    """Hide the axes behind the first `count`."""
    for item in axes[count:]:
        item.set_visible(False)


def shortened(text: str, longest: int) -> str:
    """Return a text that fits a place: what is left out in its middle is an ellipsis."""
    if len(text) <= longest:
        return text
    front = (longest - 1) // 2
    return f"{text[:front]}…{text[len(text) - (longest - 1 - front) :]}"


# Curves over severity, such as the share of runs that failed: panels for perturbations, lines for systems.


ACROSS, ACROSS_NARROW = 4, 2
SIZE_IN = (2.25, 1.75)  # of a panel
STATIC, DYNAMIC = "static", "dynamic"

Looks: TypeAlias = dict[str, tuple[str, str]]


ENDS, HERE_ENDS = ["low", "high"], ["here_low", "here_high"]
LINE = ["perturbation", "system", "mode"]
"""Columns of points that name their line."""


def curves(points: "DataFrame", name: str, title: str, label: str, *, over_clean: bool = False) -> Picture:
    """Draw a panel for each perturbation: static severities with a solid line, dynamic ones dashed.

    points: columns LINE, severity (0 is clean) and value, between 0 and 1 or, with over_clean, an error over clean on a
    logarithmic scale, infinite where half of the runs or more failed or are incomplete. low, high, here_low, here_high:
    where they are there, the ends of 95 % intervals for scenes at large, and for other seeds in these scenes.
    """
    points = points.reindex(columns=[*LINE, "severity", "value", *ENDS, *HERE_ENDS]).sort_values("severity")
    drawn = _CurveFigure(points, label, _limits(points["value"]) if over_clean else None)
    about = (
        f"{title} (0 is clean), a panel for each perturbation, a line for each system; static severities are solid, "
        "dynamic ones dashed."
    )
    if over_clean and not np.isfinite(points["value"]).all():
        about += " A cross at the top: half of the runs or more failed or are incomplete."
    if points[HERE_ENDS].notna().any(axis=None):
        about += " The band is the 95 % interval for other seeds in these scenes."
    if points[ENDS].notna().any(axis=None):
        about += " Dotted lines are the 95 % interval for scenes at large."
    return Picture(name, title, about, drawn.svg(ACROSS), drawn.svg(ACROSS_NARROW) if drawn.wide else b"")


def _limits(values: "Series") -> tuple[float, float]:
    known = values[np.isfinite(values) & (values > 0.0)]
    return min([1.0, *known]) / 1.5, max([10.0, *known]) * 2.5


@dataclass(frozen=True)
class _CurveFigure:
    """A figure of curves. limits: of the logarithmic scale; None: it goes from 0 to 1."""

    points: "DataFrame"
    label: str
    limits: tuple[float, float] | None

    @property
    def wide(self) -> bool:
        """Whether it has more panels than a phone has place for."""
        return self.points["perturbation"].nunique() > ACROSS_NARROW

    def svg(self, most_across: int) -> bytes:
        """Draw the panels, so many side by side."""
        perturbations = sorted(set(self.points["perturbation"]))
        systems = line_styles(sorted(set(self.points["system"])))
        rows = math.ceil(len(perturbations) / most_across)
        across = math.ceil(len(perturbations) / rows)  # five are three and two, not four and one
        with drawing(max(NARROW_IN, SIZE_IN[0] * across), SIZE_IN[1] * rows + 0.5) as figure:
            grid = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False)
            panels = list(grid.flat)
            for index, (axes, perturbation) in enumerate(zip(panels, perturbations, strict=False)):
                self._panel(axes, perturbation, systems)
                if index + across >= len(perturbations):
                    axes.set_xlabel("severity")
                    axes.tick_params(labelbottom=True)
            unused(panels, len(perturbations))
            for axes in grid[:, 0]:
                axes.set_ylabel(self.label)
            _legend(figure, systems, set(self.points["mode"]))
            return svg_bytes(figure)

    def _panel(self, axes: "Axes", name: str, systems: Looks) -> None:
        lines = dict(list(self.points[self.points["perturbation"] == name].groupby(["system", "mode"])))
        for number, (system, (colour, marker)) in enumerate(systems.items()):
            shift = 0.05 * (number - (len(systems) - 1) / 2)  # equal curves stay apart
            for mode, style in ((STATIC, "-"), (DYNAMIC, "--")):
                if (line := lines.get((system, mode))) is not None:
                    _line(axes, line.assign(severity=line["severity"] + shift), (colour, marker, style))
        axes.set_title(shortened(name, 34))
        axes.set(xticks=range(6), xlim=(-0.3, 5.3))
        if self.limits is None:
            axes.set_ylim(-0.05, 1.05)
        else:
            axes.set_yscale("log")
            axes.set_ylim(*self.limits)
            axes.yaxis.set_major_formatter("\u00d7 {x:g}")
            axes.minorticks_off()  # which take more time than all else
        axes.grid(visible=True, axis="y", linewidth=0.3)


def _line(axes: "Axes", line: "DataFrame", drawn_as: tuple[str, str, str]) -> None:
    """Draw a line with its intervals. drawn_as: colour, marker and style."""
    colour, marker, style = drawn_as
    x, y = (line[name].to_numpy(dtype=np.float64) for name in ("severity", "value"))
    axes.plot(x, np.where(np.isfinite(y), y, np.nan), color=colour, marker=marker, linestyle=style, markersize=3)
    failed = x[np.isinf(y)]
    axes.plot(failed, [0.95] * len(failed), "x", color=colour, transform=axes.get_xaxis_transform())
    here, large = (line[ends].to_numpy(dtype=np.float64).T for ends in (HERE_ENDS, ENDS))
    if np.isfinite(here[0]).any():
        axes.fill_between(x, here[0], here[1], color=colour, alpha=0.2, linewidth=0)
    for ends in large:
        if np.isfinite(ends).any():
            axes.plot(x, ends, ":", color=colour, linewidth=0.7, alpha=0.8)


def _legend(figure: "Figure", systems: Looks, modes: set[str]) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, marker=marker, markersize=4, label=shortened(name, 40))
        for name, (colour, marker) in systems.items()
    ]
    if DYNAMIC in modes:
        handles.append(Line2D([], [], color="k", linestyle="-", label=STATIC))
        handles.append(Line2D([], [], color="k", linestyle="--", label=DYNAMIC))
    figure.legend(handles=handles, loc="outside upper center", ncols=min(3, len(handles)))


# Settings x systems: how well each system did in each setting, and what came of its runs.


FAR = 1e30  # beyond any error over clean
ROW_IN = 0.19
COLUMN_IN = 1.15


class Scale(Enum):
    """What colours stand for: a score from 0 (bad) to 1, or an error over clean, infinite where it broke."""

    SCORE = "mean success AUC"
    OVER_CLEAN = "error over clean"


def heat_map(
    settings: Sequence[str],
    systems: Sequence[str],
    values: NDArray[np.float64],
    texts: Sequence[Sequence[str]],
    scale: Scale,
) -> Picture:
    """Draw a cell for each setting and system.

    values: (settings, systems); NaN is drawn grey. texts: written into the cells.
    """
    values = np.where(np.isinf(values), FAR, values)  # matplotlib has no colour for what is infinite
    height_in = ROW_IN * len(settings) + 0.9
    norm, colours = _colours(values, scale)
    with drawing(2.6 + COLUMN_IN * max(2, len(systems)), height_in) as figure:
        axes = figure.subplots()
        image = axes.imshow(values, cmap=colours, norm=norm, aspect="auto", interpolation="nearest")
        for row, line in enumerate(texts):
            for column, text in enumerate(line):
                red, green, blue, _ = colours(norm(values[row, column]))
                dark = 0.299 * red + 0.587 * green + 0.114 * blue < 0.5
                ink = "white" if dark else "black"
                axes.text(column, row, shortened(text, 24), ha="center", va="center", fontsize=7, color=ink)
        axes.set_xticks(range(len(systems)), [shortened(name, 22) for name in systems], rotation=0)
        axes.set_yticks(range(len(settings)), [shortened(name, 40) for name in settings])
        axes.tick_params(length=0, top=True, labeltop=True, bottom=False, labelbottom=False)
        for spine in axes.spines.values():
            spine.set_visible(False)
        bar = figure.colorbar(image, ax=axes, fraction=0.05, aspect=max(8.0, height_in * 6), pad=0.02)
        bar.set_label(scale.value)
        bar.outline.set_visible(False)
        if scale is Scale.OVER_CLEAN:
            bar.ax.yaxis.set_major_formatter("\u00d7 {x:g}")
            bar.ax.yaxis.set_minor_formatter("")
        svg = svg_bytes(figure)
    return Picture("heat_map", "Settings and systems", about_cells(scale), svg)


def cell_colours(values: NDArray[np.float64], scale: Scale) -> list[list[str]]:
    """Return the colours of a heat map's cells as "#rrggbb", (settings, systems)."""
    from matplotlib.colors import to_hex

    values = np.where(np.isinf(values), FAR, values)
    norm, colours = _colours(values, scale)
    return [[to_hex(colours(norm(value))) for value in row] for row in values]


def about_cells(scale: Scale) -> str:
    """Return what the colours of a heat map say, in a sentence."""
    label = scale.value[0].upper() + scale.value[1:]
    failed = (
        "red: half of the runs or more failed or are incomplete"
        if scale is Scale.OVER_CLEAN
        else "beside it, how many of the runs failed or are incomplete"
    )
    return f"{label} of each system in each setting, dark is bad; {failed}."


def _colours(values: NDArray[np.float64], scale: Scale) -> "tuple[Normalize, Colormap]":
    """Return what takes a value to a place on the scale, and the colours along it."""
    import matplotlib as mpl
    from matplotlib.colors import LogNorm, Normalize

    if scale is Scale.SCORE:
        return Normalize(0.0, 1.0), mpl.colormaps["cividis"].with_extremes(bad=GREY)
    known = values[(values > 0.0) & (values < FAR)]
    high = max(10.0, float(known.max(initial=1.0)))
    return LogNorm(1.0, high), mpl.colormaps["cividis_r"].with_extremes(bad="#dddddd", over="#D55E00")


# Settings ranked by the error over clean: a panel for each system, the worst on top.


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
        "the worst on top: bars are geometric means, dots single runs; the median clean error in brackets."
    )
    if any(bar.broke for panel in panels for bar in panel.bars):
        about += (
            " Hatched: half of the runs or more failed (no path, or none that can be scored) or are "
            f"incomplete ({IS_INCOMPLETE}), which is no ratio."
        )
    wide = _drawn(panels, WIDE_IN if across > 1 else 0.72 * WIDE_IN, across)
    return Picture("ranking", "What broke each system, and by how much", about, wide, _drawn(panels, NARROW_IN, 1))


def _drawn(panels: Sequence[RankPanel], width_in: float, across: int) -> bytes:
    rows = math.ceil(len(panels) / across)
    most = [max(len(panel.bars) for panel in panels[row * across : (row + 1) * across]) for row in range(rows)]
    heights = [HEAD_IN + BAR_ROW_IN * count for count in most]
    low, high = _ranking_limits(panels)
    with drawing(width_in, sum(heights)) as figure:
        grid = figure.subplots(rows, across, squeeze=False, height_ratios=heights)
        for place, (axes, panel) in enumerate(zip(grid.flat, panels, strict=False)):
            _panel(axes, panel, low, high, most[place // across])
        unused(list(grid.flat), len(panels))
        return svg_bytes(figure)


def _ranking_limits(panels: Sequence[RankPanel]) -> tuple[float, float]:
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


# Matrices of rank correlations: what goes together with what, a panel for each mode.


CELL_IN = 0.36
MARGIN_IN = 1.6
MOST = 40  # names in a panel whose values are written into the cells


def correlation_matrices(table: "DataFrame", name: str, title: str) -> Picture:
    """Draw a matrix for each mode. table: columns mode, a, b, whose correlation is symmetric, and spearman."""
    modes = sorted(set(table["mode"]))
    names = {mode: sorted(set(table.loc[table["mode"] == mode, ["a", "b"]].to_numpy().ravel())) for mode in modes}
    most = max(len(of_mode) for of_mode in names.values())
    side_in = max(1.4, CELL_IN * most) + MARGIN_IN
    with drawing(side_in * len(modes) + 0.6, side_in) as figure:
        grid = figure.subplots(1, len(modes), squeeze=False)
        image = None
        for axes, mode in zip(grid[0], modes, strict=True):
            of_mode = names[mode]
            values = np.full((len(of_mode), len(of_mode)), np.nan)
            rows = table.loc[table["mode"] == mode, ["a", "b", "spearman"]]
            for one, other, value in rows.itertuples(index=False, name=None):
                row, column = of_mode.index(one), of_mode.index(other)
                values[row, column] = values[column, row] = value
            image = axes.imshow(values, cmap="RdBu_r", vmin=-1.0, vmax=1.0, interpolation="nearest")
            for row, column in np.argwhere(np.isfinite(values)) if len(of_mode) <= MOST else ():
                ink = "white" if abs(values[row, column]) > 0.6 else "black"
                axes.text(column, row, f"{values[row, column]:.2f}", ha="center", va="center", fontsize=6, color=ink)
            labels = [shortened(text, 24) for text in of_mode]
            axes.set_xticks(range(len(labels)), labels, rotation=90)
            axes.set_yticks(range(len(labels)), labels)
            axes.tick_params(length=0)
            axes.set_title(mode or "no mode")
            for spine in axes.spines.values():
                spine.set_visible(False)
        if image is not None:
            bar = figure.colorbar(image, ax=grid, fraction=0.03, pad=0.01)
            bar.set_label("Spearman's correlation of ATE")
        svg = svg_bytes(figure)
    about = f"{title}: Spearman's rank correlation of ATE, a panel for each mode; the table below has n and p."
    return Picture(name, title, about, svg)
