# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors over time, above what was done to each frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .drawing import Picture, drawing, look, shortened, svg_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH_IN = 9.0
PLOT_IN, STRIP_IN, GAP_IN = 1.5, 0.17, 0.55
SMALLEST_M = 1e-5  # errors below are drawn here: the scale is logarithmic


@dataclass(frozen=True)
class TimePanel:
    """Runs on one sequence.

    title: what sequence. times_s: (N,), from its beginning. errors_m: (N,) by system, NaN where it was not tracked.
    strips: (N,) by name, what was done to each frame or measured of it, NaN where nothing is known.
    """

    title: str
    times_s: NDArray[np.float64]
    errors_m: Mapping[str, NDArray[np.float64]]
    strips: Mapping[str, NDArray[np.float64]]


def over_time(panels: Sequence[TimePanel]) -> Picture:
    """Draw the panels one below the other."""
    from matplotlib.lines import Line2D

    systems = look(sorted({name for panel in panels for name in panel.errors_m}))
    heights = [PLOT_IN + STRIP_IN * len(panel.strips) + GAP_IN for panel in panels]
    with drawing(WIDTH_IN, sum(heights) + 0.3) as figure:
        parts = figure.add_gridspec(len(panels), 1, height_ratios=heights)
        for index, panel in enumerate(panels):
            ratios = [PLOT_IN, *([STRIP_IN] * len(panel.strips))]
            grid = parts[index].subgridspec(len(ratios), 1, height_ratios=ratios).subplots(sharex=True, squeeze=False)
            _errors(grid[0, 0], panel, systems)
            for axes in grid[:-1, 0]:
                axes.tick_params(bottom=False)
            for axes, (name, values) in zip(grid[1:, 0], panel.strips.items(), strict=True):
                _strip(axes, panel.times_s, name, values)
            grid[-1, 0].set_xlabel("time [s]")
        handles = [Line2D([], [], color=colour, label=shortened(name, 40)) for name, (colour, _) in systems.items()]
        figure.legend(handles=handles, loc="outside upper center", ncols=min(5, max(1, len(handles))))
        svg = svg_bytes(figure)
    about = (
        "The error of the position of every frame over time, after alignment, on a logarithmic scale; a gap is where a "
        "system was not tracking. Lines at the bottom mark that too. Strips below show what "
        "was done to each frame and what was measured of it, dark is small and bright is large; where only some frames "
        "were looked at, a value holds until the next."
    )
    return Picture("over_time", "Errors over time", about, svg)


def _errors(axes: "Axes", panel: TimePanel, systems: dict[str, tuple[str, str]]) -> None:
    top = 1.0
    for index, (name, (colour, _)) in enumerate(systems.items()):
        if name not in panel.errors_m:
            continue
        error_m = np.maximum(panel.errors_m[name], SMALLEST_M)
        axes.plot(panel.times_s, error_m, color=colour, linewidth=1.0)
        # Below the curves, a line of the system's colour where it was lost.
        lost = np.where(np.isnan(error_m), 0.05 + 0.045 * index, np.nan)
        axes.plot(panel.times_s, lost, color=colour, linewidth=2.0, transform=axes.get_xaxis_transform())
        if np.isfinite(error_m).any():
            top = max(top, float(np.nanmax(error_m)))
    axes.set_yscale("log")
    axes.set_ylim(SMALLEST_M, top * 2)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_ylabel("error [m]")
    axes.set_title(shortened(panel.title, 110), loc="left")
    axes.grid(visible=True, linewidth=0.3)


def _strip(axes: "Axes", times_s: NDArray[np.float64], name: str, values: NDArray[np.float64]) -> None:
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    end_s = float(times_s[-1] + (times_s[-1] - times_s[0]) / max(1, len(times_s) - 1)) if len(times_s) > 1 else 1.0
    axes.imshow(
        values[None, :],
        aspect="auto",
        interpolation="nearest",
        cmap="viridis",
        vmin=low,
        vmax=high if high > low else low + 1.0,
        extent=(float(times_s[0]), end_s, 0.0, 1.0),
    )
    axes.set_yticks([])
    said = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
    axes.set_ylabel(shortened(name, 24), rotation=0, ha="right", va="center", fontsize=6)
    axes.text(1.005, 0.5, said, transform=axes.transAxes, va="center", fontsize=6)
    for spine in axes.spines.values():
        spine.set_visible(False)
