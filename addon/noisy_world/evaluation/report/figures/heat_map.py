# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings x systems: how well each system did in each setting, and what came of its runs."""

from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .drawing import GREY, Picture, drawing, shortened, svg_bytes

if TYPE_CHECKING:
    from matplotlib.colors import Colormap, Normalize

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
    said = scale.value[0].upper() + scale.value[1:]
    failed = (
        "red: half of the runs or more failed or are incomplete"
        if scale is Scale.OVER_CLEAN
        else "beside it, how many of the runs failed or are incomplete"
    )
    about = f"{said} of each system in each setting, dark is bad; {failed}."
    return Picture("heat_map", "Settings and systems", about, svg)


def _colours(values: NDArray[np.float64], scale: Scale) -> "tuple[Normalize, Colormap]":
    """Return what takes a value to a place on the scale, and the colours along it."""
    import matplotlib as mpl
    from matplotlib.colors import LogNorm, Normalize

    if scale is Scale.SCORE:
        return Normalize(0.0, 1.0), mpl.colormaps["cividis"].with_extremes(bad=GREY)
    known = values[(values > 0.0) & (values < FAR)]
    high = max(10.0, float(known.max(initial=1.0)))
    return LogNorm(1.0, high), mpl.colormaps["cividis_r"].with_extremes(bad="#dddddd", over="#D55E00")
