# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors over time, above what was done to each frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .drawing import NARROW_IN, Picture, drawing, line_styles, shortened, svg_bytes

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
    about = (
        "The error of the position of every frame over time, after alignment, on a logarithmic scale; a gap is where a "
        "system was not tracking. Lines at the bottom mark that too. Strips below show what "
        "was done to each frame and what was measured of it, dark is small and bright is large; where only some frames "
        "were looked at, a value holds until the next."
    )
    wide, narrow = (_drawn(panels, width_in) for width_in in (WIDTH_IN, NARROW_IN))
    return Picture("over_time", "Errors over time", about, wide, narrow)


def _drawn(panels: Sequence[TimePanel], width_in: float) -> bytes:
    from matplotlib.lines import Line2D

    systems = line_styles(sorted({name for panel in panels for name in panel.errors_m}))
    heights = [PLOT_IN + STRIP_IN * len(panel.strips) + GAP_IN for panel in panels]
    with drawing(width_in, sum(heights) + 0.3) as figure:
        parts = figure.add_gridspec(len(panels), 1, height_ratios=heights)
        for index, panel in enumerate(panels):
            ratios = [PLOT_IN, *([STRIP_IN * len(panel.strips)] if panel.strips else [])]
            grid = parts[index].subgridspec(len(ratios), 1, height_ratios=ratios).subplots(sharex=True, squeeze=False)
            _errors(grid[0, 0], panel, systems)
            if panel.strips:
                grid[0, 0].tick_params(bottom=False)
                _strips(grid[1, 0], panel)
            grid[-1, 0].set_xlabel("time [s]")
        handles = [Line2D([], [], color=colour, label=shortened(name, 40)) for name, (colour, _) in systems.items()]
        figure.legend(handles=handles, loc="outside upper center", ncols=min(3, max(1, len(handles))))
        return svg_bytes(figure)


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
    axes.minorticks_off()
    axes.set_ylabel("error [m]")
    axes.set_title(shortened(panel.title, 60), loc="left")
    axes.grid(visible=True, linewidth=0.3)


def _strips(axes: "Axes", panel: TimePanel) -> None:
    """Draw a row of colours for each strip, from its least to its largest value, which stand beside it."""
    times_s, count = panel.times_s, len(panel.strips)
    end_s = float(times_s[-1] + (times_s[-1] - times_s[0]) / max(1, len(times_s) - 1)) if len(times_s) > 1 else 1.0
    rows = np.full((count, len(times_s)), np.nan)
    for row, values in enumerate(panel.strips.values()):
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
        rows[row] = (values - low) / (high - low if high > low else 1.0)
        said = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
        place = 1.0 - (row + 0.5) / count
        axes.text(1.005, place, said, transform=axes.transAxes, va="center", fontsize=6)
    extent = (float(times_s[0]), end_s, float(count), 0.0)
    axes.imshow(rows, aspect="auto", interpolation="nearest", cmap="viridis", vmin=0.0, vmax=1.0, extent=extent)
    for row in range(1, count):
        axes.axhline(row, color="white", linewidth=3.0)
    axes.set_yticks(np.arange(count) + 0.5, [shortened(name, 24) for name in panel.strips], fontsize=6)
    axes.tick_params(axis="y", length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
