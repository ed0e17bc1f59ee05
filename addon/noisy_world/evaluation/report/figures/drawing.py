# SPDX-License-Identifier: GPL-3.0-or-later
"""How every figure looks, and how it becomes bytes."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.typing import RcKeyType

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
    found = {}
    for index, name in enumerate(names):
        marker = MARKERS[(index + index // len(COLOURS)) % len(MARKERS)]
        found[name] = COLOURS[index % len(COLOURS)], marker
    return found


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
