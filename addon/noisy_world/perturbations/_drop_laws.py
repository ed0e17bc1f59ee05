# SPDX-License-Identifier: GPL-3.0-or-later
"""Position, size, drying and running of drops on the glass; shared by both executions of lens_drops.

Drops of a class of diameters, an octave each, have cells of their own, and a drop lies within its cell. A cell's clock
goes round as its drop dries; each turn draws, by a hash of cell and turn, whether a drop lands, where, and how large.
A strip of the glass has a clock of its own by which a drop grows, runs down, and leaves beads behind. So any frame
follows from its number alone. Lengths are in pixels of the reference width; y is counted from the top.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from ..core.schema import key

# --- classes of diameters; multiples of the median diameter ---

LARGEST = 4.0  # of the first class; the others are halves of the one before
CLASSES = 4
CELL_WIDTH = 1.15  # of the largest diameter of the class
CELL_HEIGHT = 1.35
TALL = (1.18, 1.1, 1.05, 1.0)  # height of a drop over its width: large ones sag
SAG = (0.2, 0.12, 0.05, 0.0)  # how much wider than its middle a drop is at its foot, and narrower at its head
ROW_SHIFT = 0.38  # of a cell's width from row to row, so that cells form no columns
START = (8.21, 9.47, 8.83, 9.62)  # cells before the frame's corner: numbers of cells stay above 0
TURNS = 4096  # cells along a row that numbers of a turn do not repeat in
PRESENT = 0.6180339887  # the golden ratio's: shares of turns with a drop are spread evenly
CLEAR = 2.0  # square of the distance, in radii, up to which a drop has taken in its smaller neighbours
UNMARKED = 0.6  # share of what is taken that leaves no rim where a drop is cut back
LOGISTIC = 1.702  # a logistic curve of this steepness is the normal distribution's within 0.01

# --- the glass's unevenness, which makes drops irregular: waves in x and y; multiples of the median diameter ---

WAVES = ((0.3, 1.2), (0.08, 0.5))  # amplitude, and length / 2 pi
SWING = math.fsum(amplitude for amplitude, _ in WAVES)
SLANT = 0.8  # of the second wave's length in the other direction

# --- running drops; multiples of the median diameter ---

STRIP = 4.6  # width of a strip
STRIP_START = 8.37
REST = 0.2  # share of its turn in which a drop grows before it runs
BELOW = 1.35  # heights of the frame after which it has gone
HIGHEST, LOWEST = -0.3, 0.6  # heights of the frame between which it begins
RUN_RADIUS = (0.7, 0.5)  # least, and what is added at most
SMALL_AT_REST = 0.3  # square of its radius when it lands, of the one with which it runs
STICK = ((0.015, 5.0), (0.005, 13.0))  # stick and slip: amplitude and waves along the way; slopes stay below 1
ASIDE = 0.3  # of a strip's width: how far a way lies beside the strip's middle
WINDING = ((0.16, 2.1), (0.3, 6.5))  # amplitude, and length / 2 pi
TAIL = 0.5  # height above its middle is shortened to this before its distance is taken
TAPER = 0.3
TRAIL = 22.0  # length of what it leaves
TRACK = 0.75  # of its radius: half the width of what it wipes
BEADS = 0.85  # from bead to bead
BEAD_START = 64.0
BEAD_RADIUS = (0.13, 0.3)

# --- looks ---

HALVINGS = 4  # from the frame to what drops show: they make it so much smaller that fewer would leave out lamps

GLINT_AT = (-0.33, -0.42)  # of a drop's radius: to the left and above
GLINT_RADIUS = 0.2


@dataclass(frozen=True)
class LensDrops:
    """Drops of water on the glass before the lens, which refract the scene, run down and dry.

    The glass is out of focus, so drops are soft; what is beside them stays sharp. Diameters are log-normal. A large
    drop keeps its surroundings clear, and one that runs leaves a trail of beads. Works on linear light.
    """

    coverage: float = key("share of the glass under drops", default=0.14, minimum=0, maximum=0.5)
    size_px: float = key(
        "median diameter of a drop that has just landed", default=22.0, unit="px", minimum=4, maximum=400
    )
    spread: float = key("standard deviation of the diameter's logarithm", default=0.6, minimum=0.2, maximum=2)
    focus_px: float = key("radius of the blur of a point on the glass", default=5.0, unit="px", minimum=0, maximum=60)
    contact_deg: float = key(
        "angle at which a drop's surface meets the glass", default=60.0, unit="deg", minimum=5, maximum=90
    )
    rim: float = key(
        "light of a rim through which none passes, times the scene's mean", default=0.15, minimum=0, maximum=10
    )
    glint: float = key("light of the reflection on a drop, times the scene's mean", default=2.0, minimum=0, maximum=100)
    runs: float = key("share of the glass's strips down which a drop runs", default=0.25, minimum=0, maximum=1)
    run_px: float = key(
        "drift: how far such a drop runs down a frame", default=3.0, unit="px", minimum=0, maximum=1000, slider=(0, 10)
    )
    drying: float = key(
        "drift: share of the drops that dry, and land anew, a frame", default=0.003, minimum=0, maximum=1
    )
    view_deg: float = key(
        "horizontal field of view, where the camera is unknown", default=90.0, unit="deg", minimum=1, maximum=170
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "coverage": "Higher: more drops on the glass",
        "size_px": "Higher: larger drops, and fewer",
        "spread": "Higher: drops differ more in size",
        "focus_px": "Higher: drops, and what they show, get softer; 0 is a lens that focuses on the glass",
        "contact_deg": "Higher: steeper drops, which show more of the scene and have darker rims",
        "rim": "Higher: lighter rims; 0 is black",
        "glint": "Higher: a brighter highlight on each drop",
        "runs": "Higher: more drops run down",
        "run_px": "Higher: with the pattern Drift, drops run faster",
        "drying": "Higher: with the pattern Drift, drops dry and land more often",
        "view_deg": "Higher: a wider view, so a drop shows what is nearer to it in the picture",
    }


@dataclass(frozen=True)
class OfClass:
    """A class's mean area of a drop, with what has dried, and its cell's, over the square of the median diameter."""

    area: float
    cell: float


def of_class(number: int) -> OfClass:
    """Return the areas of class 0 to 3.

    Inside an octave the logarithm of the diameter d is uniform: the mean of d^2 is 3 / (8 ln 2) of the largest's. As a
    drop dries its area falls steadily to 0, as evaporation has it (the d^2 law), so half is left on average.
    """
    largest = LARGEST * 0.5**number
    area = math.pi / 4 * 3 / (8 * math.log(2)) * largest**2 * TALL[number] / 2
    return OfClass(area, largest**2 * CELL_WIDTH * CELL_HEIGHT)


def drying_rate(number: int) -> float:
    """Return how often a class's drops dry, of the median's rate: a drop lasts in proportion to its diameter."""
    return 2.0 ** (number - (CLASSES - 1) / 2)
