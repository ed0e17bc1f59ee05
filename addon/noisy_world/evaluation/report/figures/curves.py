# SPDX-License-Identifier: GPL-3.0-or-later
"""Curves over severity, such as the share of runs that failed: panels for perturbations, lines for systems."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .drawing import Picture, drawing, look, shortened, svg_bytes, unused

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ACROSS = 4
SIZE_IN = (2.25, 1.75)  # of a panel
STATIC, DYNAMIC = "static", "dynamic"

type Looks = dict[str, tuple[str, str]]


@dataclass(frozen=True)
class CurvePoint:
    """A value between 0 and 1 at one severity, 0 being clean. n: runs.

    large, here: the ends of its 95 % intervals for scenes at large, and for other seeds in these scenes; NaN for none.
    """

    perturbation: str
    system: str
    mode: str
    severity: float
    value: float
    large: tuple[float, float]
    here: tuple[float, float]
    n: int


def curves(points: Sequence[CurvePoint], name: str, title: str, label: str) -> Picture:
    """Draw a panel for each perturbation: static severities with a solid line, dynamic ones dashed."""
    perturbations = sorted({point.perturbation for point in points})
    systems = look(sorted({point.system for point in points}))
    across = min(ACROSS, len(perturbations))
    rows = math.ceil(len(perturbations) / across)
    with drawing(max(4.5, SIZE_IN[0] * across), SIZE_IN[1] * rows + 0.5) as figure:
        grid = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False)
        panels = list(grid.flat)
        for index, (axes, perturbation) in enumerate(zip(panels, perturbations, strict=False)):
            _panel(axes, perturbation, [point for point in points if point.perturbation == perturbation], systems)
            if index + across >= len(perturbations):
                axes.set_xlabel("severity")
                axes.tick_params(labelbottom=True)
        unused(panels, len(perturbations))
        for axes in grid[:, 0]:
            axes.set_ylabel(label)
        _legend(figure, systems, {point.mode for point in points})
        svg = svg_bytes(figure)
    about = (
        f"{title} (0 is clean), a panel for each perturbation, a line for each system; static severities are solid, "
        "dynamic ones dashed. The band is the 95 % interval for other seeds in these scenes; dotted lines are that for "
        "scenes at large, which few scenes leave wide."
    )
    return Picture(name, title, about, svg)


def _panel(axes: "Axes", name: str, points: Sequence[CurvePoint], systems: Looks) -> None:
    for number, (system, (colour, marker)) in enumerate(systems.items()):
        for mode, style in ((STATIC, "-"), (DYNAMIC, "--")):
            line = [point for point in points if (point.system, point.mode) == (system, mode)]
            if not line:
                continue
            line.sort(key=lambda point: point.severity)
            shift = 0.05 * (number - (len(systems) - 1) / 2)  # equal curves stay apart
            x = [point.severity + shift for point in line]
            axes.plot(x, [point.value for point in line], style, color=colour, marker=marker, markersize=3)
            low, high = zip(*(point.here for point in line), strict=True)
            axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0)
            for ends in zip(*(point.large for point in line), strict=True):
                axes.plot(x, ends, ":", color=colour, linewidth=0.7, alpha=0.8)
    axes.set_title(shortened(name, 34))
    axes.set(ylim=(-0.05, 1.05), xticks=range(6), xlim=(-0.3, 5.3))
    axes.grid(visible=True, axis="y", linewidth=0.3)


def _legend(figure: "Figure", systems: Looks, modes: set[str]) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, marker=marker, markersize=4, label=shortened(name, 40))
        for name, (colour, marker) in systems.items()
    ]
    if DYNAMIC in modes:
        handles.append(Line2D([], [], color="k", linestyle="-", label=STATIC))
        handles.append(Line2D([], [], color="k", linestyle="--", label=DYNAMIC))
    figure.legend(handles=handles, loc="outside upper center", ncols=min(4, len(handles)))
