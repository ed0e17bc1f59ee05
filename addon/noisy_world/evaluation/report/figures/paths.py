# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths from above: the true one in grey, the estimated one aligned to it and coloured by its error."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .drawing import GREY, NARROW_IN, Picture, drawing, shortened, svg_bytes

SIZE_IN = 2.3  # of a panel
ACROSS, ACROSS_NARROW = 4, 2


@dataclass(frozen=True)
class PathPanel:
    """The path of one run. true_m: (N, 3), all frames. estimated_m: (M, 3), aligned, M >= 0; error_m: (M,).

    lines: of text above it.
    """

    lines: tuple[str, ...]
    true_m: NDArray[np.float64]
    estimated_m: NDArray[np.float64]
    error_m: NDArray[np.float64]


def paths(panels: Sequence[PathPanel]) -> Picture:
    """Draw a panel for each path; all share one scale of colours, which is logarithmic."""
    about = (
        "Paths seen from above: the true one in grey, its beginning as a dot, and the estimated positions after "
        "alignment, coloured by their error."
    )
    wide, narrow = (_drawn(panels, most_across) for most_across in (ACROSS, ACROSS_NARROW))
    return Picture("paths", "Paths and their errors", about, wide, narrow)


def _drawn(panels: Sequence[PathPanel], most_across: int) -> bytes:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    errors = np.concatenate([panel.error_m for panel in panels]) if panels else np.zeros(0)
    errors = errors[np.isfinite(errors) & (errors > 0)]
    low, high = decades(errors)
    norm = LogNorm(low, high, clip=True)
    rows = max(1, math.ceil(len(panels) / most_across))
    across = min(most_across, max(1, len(panels)))
    with drawing(max(NARROW_IN, SIZE_IN * across + 0.8), (SIZE_IN + 0.25) * rows + 0.3) as figure:
        grid = figure.subplots(rows, across, squeeze=False)
        for axes, panel in zip(grid.flat, panels, strict=False):
            axes.plot(panel.true_m[:, 0], panel.true_m[:, 1], color=GREY, linewidth=2.5, alpha=0.5)
            axes.plot(*panel.true_m[0, :2], marker="o", markersize=4, color=GREY)
            if len(panel.estimated_m):
                axes.scatter(
                    panel.estimated_m[:, 0],
                    panel.estimated_m[:, 1],
                    c=np.maximum(panel.error_m, low),
                    s=3,
                    cmap="plasma",
                    norm=norm,
                    linewidths=0,
                    rasterized=len(panel.estimated_m) > 2000,
                )
            axes.set_title("\n".join(shortened(line, 36) for line in panel.lines), fontsize=6.5)
            axes.set_aspect("equal", adjustable="datalim")
            axes.tick_params(labelsize=6)
            axes.locator_params(nbins=4)
        for axes in list(grid.flat)[len(panels) :]:
            axes.set_visible(False)
        figure.supxlabel("world x [m]", fontsize=7)
        figure.supylabel("world y [m]", fontsize=7)
        bar = figure.colorbar(ScalarMappable(norm, "plasma"), ax=grid, fraction=0.03, pad=0.01)
        bar.ax.yaxis.set_major_formatter("{x:g}")
        bar.set_label("error of position [m]")
        return svg_bytes(figure)


def decades(errors: NDArray[np.float64]) -> tuple[float, float]:
    """Return whole powers of ten around the errors, at least one decade apart and at most five."""
    if not len(errors):
        return 0.001, 1.0
    high = 10.0 ** math.ceil(math.log10(float(errors.max())))
    low = 10.0 ** math.floor(math.log10(float(np.quantile(errors, 0.02))))
    return max(min(low, high / 10), high / 1e5), high
