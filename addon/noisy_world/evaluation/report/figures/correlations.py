# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrices of rank correlations: what goes together with what, a panel for each mode."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .drawing import Picture, drawing, shortened, svg_bytes

CELL_IN = 0.36
MARGIN_IN = 1.6
MOST = 40  # names in a panel whose values are written into the cells


@dataclass(frozen=True)
class Correlation:
    """The correlation of two names, which is symmetric; NaN where there is none. n: pairs of values."""

    mode: str
    one: str
    other: str
    value: float
    n: int


def correlation_matrices(found: Sequence[Correlation], name: str, title: str) -> Picture:
    """Draw a matrix for each mode."""
    modes = sorted({item.mode for item in found})
    names = {
        mode: sorted({part for item in found if item.mode == mode for part in (item.one, item.other)}) for mode in modes
    }
    most = max(len(of_mode) for of_mode in names.values())
    side_in = max(1.4, CELL_IN * most) + MARGIN_IN
    with drawing(side_in * len(modes) + 0.6, side_in) as figure:
        grid = figure.subplots(1, len(modes), squeeze=False)
        image = None
        for axes, mode in zip(grid[0], modes, strict=True):
            of_mode = names[mode]
            values = np.full((len(of_mode), len(of_mode)), np.nan)
            for item in (item for item in found if item.mode == mode):
                row, column = of_mode.index(item.one), of_mode.index(item.other)
                values[row, column] = values[column, row] = item.value
            image = axes.imshow(values, cmap="RdBu_r", vmin=-1.0, vmax=1.0, interpolation="nearest")
            for row, column in np.argwhere(np.isfinite(values)) if len(of_mode) <= MOST else ():
                ink = "white" if abs(values[row, column]) > 0.6 else "black"
                axes.text(column, row, f"{values[row, column]:.2f}", ha="center", va="center", fontsize=6, color=ink)
            labels = [shortened(text, 24) for text in of_mode]
            axes.set_xticks(range(len(labels)), labels, rotation=90)
            axes.set_yticks(range(len(labels)), labels)
            axes.tick_params(length=0)
            axes.set_title(mode)
            for spine in axes.spines.values():
                spine.set_visible(False)
        if image is not None:
            bar = figure.colorbar(image, ax=grid, fraction=0.03, pad=0.01)
            bar.set_label("Spearman's correlation of ATE")
        svg = svg_bytes(figure)
    about = f"{title}: Spearman's rank correlation of ATE, a panel for each mode; the table below has n and p."
    return Picture(name, title, about, svg)
