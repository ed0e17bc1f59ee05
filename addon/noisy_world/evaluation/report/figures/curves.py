# SPDX-License-Identifier: GPL-3.0-or-later
"""Curves over severity, such as the share of runs that failed: panels for perturbations, lines for systems."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from .drawing import NARROW_IN, Picture, drawing, line_styles, shortened, svg_bytes, unused

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ACROSS, ACROSS_NARROW = 4, 2
SIZE_IN = (2.25, 1.75)  # of a panel
STATIC, DYNAMIC = "static", "dynamic"

Looks: TypeAlias = dict[str, tuple[str, str]]


@dataclass(frozen=True)
class CurvePoint:
    """A value at one severity, 0 being clean. n: runs.

    value: between 0 and 1, or an error over clean, which is infinite where half of the runs or more failed or are
    incomplete. large, here: the ends of its 95 % intervals for scenes at large, and for other seeds in these scenes;
    NaN for none."""

    perturbation: str
    system: str
    mode: str
    severity: float
    value: float
    large: tuple[float, float] = (math.nan, math.nan)
    here: tuple[float, float] = (math.nan, math.nan)
    n: int = 0


def curves(points: Sequence[CurvePoint], name: str, title: str, label: str, *, over_clean: bool = False) -> Picture:
    """Draw a panel for each perturbation: static severities with a solid line, dynamic ones dashed.

    over_clean: values are errors over clean, on a logarithmic scale, rather than between 0 and 1.
    """
    drawn = _CurveFigure(points, label, _limits(points) if over_clean else None)
    about = (
        f"{title} (0 is clean), a panel for each perturbation, a line for each system; static severities are solid, "
        "dynamic ones dashed."
    )
    if over_clean:
        about += " A cross at the top: half of the runs or more failed or are incomplete."
    if any(math.isfinite(end) for point in points for end in point.here):
        about += " The band is the 95 % interval for other seeds in these scenes."
    if any(math.isfinite(end) for point in points for end in point.large):
        about += " Dotted lines are the 95 % interval for scenes at large."
    return Picture(name, title, about, drawn.svg(ACROSS), drawn.svg(ACROSS_NARROW) if drawn.wide else b"")


def _limits(points: Sequence[CurvePoint]) -> tuple[float, float]:
    known = [point.value for point in points if math.isfinite(point.value) and point.value > 0.0]
    return min([1.0, *known]) / 1.5, max([10.0, *known]) * 2.5


@dataclass(frozen=True)
class _CurveFigure:
    """A figure of curves. limits: of the logarithmic scale; None: it goes from 0 to 1."""

    points: Sequence[CurvePoint]
    label: str
    limits: tuple[float, float] | None

    @property
    def wide(self) -> bool:
        """Whether it has more panels than a phone has place for."""
        return len({point.perturbation for point in self.points}) > ACROSS_NARROW

    def svg(self, most_across: int) -> bytes:
        """Draw the panels, so many side by side."""
        perturbations = sorted({point.perturbation for point in self.points})
        systems = line_styles(sorted({point.system for point in self.points}))
        across = min(most_across, len(perturbations))
        rows = math.ceil(len(perturbations) / across)
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
            _legend(figure, systems, {point.mode for point in self.points})
            return svg_bytes(figure)

    def _panel(self, axes: "Axes", name: str, systems: Looks) -> None:
        for number, (system, (colour, marker)) in enumerate(systems.items()):
            shift = 0.05 * (number - (len(systems) - 1) / 2)  # equal curves stay apart
            for mode, style in ((STATIC, "-"), (DYNAMIC, "--")):
                key = (name, system, mode)
                line = [point for point in self.points if (point.perturbation, point.system, point.mode) == key]
                if line:
                    line.sort(key=lambda point: point.severity)
                    _line(axes, [point.severity + shift for point in line], line, (colour, marker, style))
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


def _line(axes: "Axes", x: Sequence[float], line: Sequence[CurvePoint], drawn_as: tuple[str, str, str]) -> None:
    """Draw a line with its intervals. drawn_as: colour, marker and style."""
    colour, marker, style = drawn_as
    y = [point.value if math.isfinite(point.value) else math.nan for point in line]
    axes.plot(x, y, color=colour, marker=marker, linestyle=style, markersize=3)
    failed = [at for at, point in zip(x, line, strict=True) if math.isinf(point.value)]
    axes.plot(failed, [0.95] * len(failed), "x", color=colour, transform=axes.get_xaxis_transform())
    low, high = zip(*(point.here for point in line), strict=True)
    if any(map(math.isfinite, low)):
        axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0)
    for ends in zip(*(point.large for point in line), strict=True):
        if any(map(math.isfinite, ends)):
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
