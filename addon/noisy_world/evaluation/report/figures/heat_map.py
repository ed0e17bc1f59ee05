# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings x systems: how well each system did in each setting, and how many of its runs failed."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .drawing import GREY, Picture, drawing, shortened, svg_bytes

ROW_IN = 0.19
COLUMN_IN = 1.15


def heat_map(
    settings: Sequence[str],
    systems: Sequence[str],
    values: NDArray[np.float64],
    texts: Sequence[Sequence[str]],
    label: str,
) -> Picture:
    """Draw a cell for each setting and system.

    values: (settings, systems), from 0 (bad) to 1 (good); NaN is drawn grey. texts: written into the cells. label: of
    the scale.
    """
    import matplotlib as mpl

    height_in = ROW_IN * len(settings) + 0.9
    with drawing(2.6 + COLUMN_IN * max(2, len(systems)), height_in) as figure:
        axes = figure.subplots()
        colours = mpl.colormaps["cividis"].with_extremes(bad=GREY)
        image = axes.imshow(values, cmap=colours, vmin=0.0, vmax=1.0, aspect="auto", interpolation="nearest")
        for row, line in enumerate(texts):
            for column, text in enumerate(line):
                dark = np.isnan(values[row, column]) or values[row, column] < 0.5
                axes.text(column, row, text, ha="center", va="center", fontsize=7, color="white" if dark else "black")
        axes.set_xticks(range(len(systems)), [shortened(name, 22) for name in systems], rotation=0)
        axes.set_yticks(range(len(settings)), [shortened(name, 40) for name in settings])
        axes.tick_params(length=0, top=True, labeltop=True, bottom=False, labelbottom=False)
        for spine in axes.spines.values():
            spine.set_visible(False)
        bar = figure.colorbar(image, ax=axes, fraction=0.05, aspect=max(8.0, height_in * 6), pad=0.02)
        bar.set_label(label)
        bar.outline.set_visible(False)
        svg = svg_bytes(figure)
    said = label[0].upper() + label[1:]
    about = f"{said} of each system in each setting, dark is bad; beside it, how many of the runs failed."
    return Picture("heat_map", "Settings and systems", about, svg)
