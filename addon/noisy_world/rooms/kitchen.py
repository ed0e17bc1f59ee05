# SPDX-License-Identifier: GPL-3.0-or-later
"""A fitted kitchen along a wall: units, worktop, sink, stove, wall units, fridge. Its back is at y = 0."""

import numpy as np

from . import patterns as pt
from .books import vase
from .finishes import tiles
from .papers import noticeboard
from .pictures import landscape
from .surfaces import Painter, Piece, box, disc, joined, lathe, placed, rect, rod, rounded_box, shadeless, tube
from .things import BLACK, mug

_CHROME = pt.plain("#b9bcbd", 1600, grain=0.12)
_ENAMEL = pt.plain("#ece9e1", 1601, grain=0.06)
TOP_M = 0.92
DEPTH_M = 0.62


def units(count: int, face: Painter, worktop: Painter, stove: int, sink: int) -> Piece:
    """Base units of 0.6 m from x = 0 on; the numbers of those that carry the stove and the sink."""
    width = 0.6 * count
    parts = [
        box((0.0, -DEPTH_M + 0.04, 0.1), (width, 0.0, TOP_M - 0.04), 0.025, face, skip="YzZ"),
        shadeless(box((0.02, -DEPTH_M + 0.09, 0.0), (width - 0.02, -0.02, 0.1), 0.03, BLACK, skip="YzZ")),
        shadeless(rounded_box((-0.01, -DEPTH_M, TOP_M - 0.04), (width + 0.01, 0.0, TOP_M), 0.008, 0.0125, worktop)),
    ]
    for k in range(count):
        x = 0.6 * k
        if k == stove:
            parts.append(placed(_stove(), (x, 0.0, 0.0)))
            continue
        split = 0.68 if k % 2 else 0.14
        for low, high in ((0.12, split), (split + 0.01, TOP_M - 0.055)):
            if high - low > 0.05:
                front = (x + 0.006, -DEPTH_M + 0.02, low), (x + 0.594, -DEPTH_M + 0.04, high)
                parts.append(shadeless(box(*front, 0.018, face, skip="Y")))
                z = high - 0.05
                parts.append(shadeless(rod((x + 0.2, -DEPTH_M, z), (x + 0.4, -DEPTH_M, z), 0.007, 0.02, _CHROME)))
        if k == sink:
            parts.append(placed(_sink(), (x + 0.3, -0.32, TOP_M)))
    return joined(parts)


def _stove() -> Piece:
    glass = pt.plain("#3a3735", 1610, grain=0.16)
    parts = [
        box((0.006, -DEPTH_M + 0.015, 0.12), (0.594, -DEPTH_M + 0.04, TOP_M - 0.05), 0.02, _ENAMEL, skip="Y"),
        box((0.06, -DEPTH_M + 0.008, 0.22), (0.54, -DEPTH_M + 0.015, 0.6), 0.02, glass, skip="Y"),
        rod((0.06, -DEPTH_M - 0.02, 0.66), (0.54, -DEPTH_M - 0.02, 0.66), 0.01, 0.02, _CHROME),
        box((0.03, -0.58, TOP_M), (0.57, -0.06, TOP_M + 0.006), 0.016, glass, skip="z"),
    ]
    for x, y, r in ((0.17, -0.19, 0.075), (0.42, -0.19, 0.095), (0.17, -0.44, 0.095), (0.42, -0.44, 0.075)):
        parts.append(lathe((x, y, TOP_M + 0.006), [(r, 0.0), (r + 0.012, 0.006), (r - 0.02, 0.006)], 28, _CHROME))
    for k in range(5):
        knob = rod(
            (0.1 + 0.1 * k, -DEPTH_M - 0.01, 0.77), (0.1 + 0.1 * k, -DEPTH_M + 0.02, 0.77), 0.022, 0.01, BLACK, sides=12
        )
        parts += [knob, rect((0.085 + 0.1 * k, -DEPTH_M - 0.0101, 0.755), (0.03, 0, 0), (0, 0, 0.03), 0.01, BLACK)]
    pot = pt.stripes(["#b5442f", "#b5442f", "#e9dfc9"], [0.06, 0.02, 0.012], 1611)
    parts.append(
        lathe(
            (0.42, -0.19, TOP_M + 0.013),
            [(0.1, 0), (0.11, 0.02), (0.11, 0.14), (0.1, 0.145)],
            36,
            lambda u, v: pot(v, u),
            cell_m=0.009,
        )
    )
    parts.append(disc((0.42, -0.19, TOP_M + 0.155), 0.108, 0.012, pt.plain("#b5442f", 1612)))
    parts.append(lathe((0.42, -0.19, TOP_M + 0.155), [(0.012, 0), (0.02, 0.025), (0.008, 0.035)], 12, BLACK))
    return shadeless(joined(parts))


def _sink() -> Piece:
    parts = [
        box((-0.24, -0.2, 0.0), (0.24, 0.2, 0.004), 0.014, _CHROME, skip="z"),
        box((-0.2, -0.16, 0.004), (0.2, 0.16, 0.0045), 0.014, pt.plain("#8b8f90", 1620, grain=0.2), skip="z"),
        lathe((0, 0, 0.0045), [(0.028, 0.0), (0.02, 0.003)], 16, BLACK),
    ]
    bow = [(0.0, 0.23, 0.0), (0.0, 0.23, 0.26), (0.0, 0.18, 0.31), (0.0, 0.1, 0.29), (0.0, 0.08, 0.24)]
    parts += [tube(bow, 0.012, 10, _CHROME), rod((0.0, 0.23, 0.1), (0.08, 0.23, 0.13), 0.008, 0.02, _CHROME)]
    return shadeless(joined(parts))


def wall_units(count: int, face: Painter, *, low_m: float = 1.48, high_m: float = 2.2) -> Piece:
    """Cupboards on the wall from x = 0 on, 0.6 m each."""
    width, d = 0.6 * count, 0.34
    parts = [box((0.0, -d, low_m), (width, 0.0, high_m), 0.022, face, skip="Y")]
    for k in range(count):
        a, b = 0.6 * k + 0.006, 0.6 * k + 0.594
        parts.append(shadeless(box((a, -d - 0.02, low_m + 0.006), (b, -d, high_m - 0.006), 0.018, face, skip="Y")))
        inner = (a + 0.07, -d - 0.028, low_m + 0.08), (b - 0.07, -d - 0.02, high_m - 0.08)
        parts.append(shadeless(box(*inner, 0.018, face, skip="Y")))
        x = b - 0.03 if k % 2 == 0 else a + 0.03
        parts.append(shadeless(rod((x, -d - 0.035, low_m + 0.05), (x, -d - 0.035, low_m + 0.19), 0.007, 0.02, _CHROME)))
    return joined(parts)


def fridge(code: str) -> Piece:
    """A round-edged fridge with magnets and notes on its door, 0.62 m wide."""
    coat = pt.plain(code, 1630, grain=0.06, patch=0.06)
    parts = [rounded_box((-0.31, -0.6, 0.03), (0.31, 0.0, 1.78), 0.05, 0.019, coat, arc=3)]
    parts.append(shadeless(box((-0.29, -0.56, 0.0), (0.29, -0.04, 0.05), 0.03, BLACK, skip="zZ")))
    parts.append(shadeless(box((-0.305, -0.603, 1.2), (0.305, -0.598, 1.215), 0.02, BLACK, skip="Y")))
    for low, high in ((0.85, 1.13), (1.28, 1.5)):
        parts.append(shadeless(rod((-0.25, -0.64, low), (-0.25, -0.64, high), 0.011, 0.02, _CHROME)))
        parts += [shadeless(rod((-0.25, -0.64, z), (-0.25, -0.6, z), 0.009, 0.02, _CHROME)) for z in (low, high)]
    for k, (x, z, w, h) in enumerate(
        ((-0.05, 0.75, 0.15, 0.2), (0.12, 0.9, 0.12, 0.16), (0.0, 1.32, 0.2, 0.14), (-0.1, 0.5, 0.21, 0.15))
    ):
        tone = landscape(w, h, 1640 + k, ("#5d8fc4", "#f6d9a8", "#fff2cc", "#a8b45c", "#3a5a3c", "#c9714e"))
        parts.append(
            rect((x, -0.603, z), (w, 0, 0), (0, 0, h), 0.0095, tone if k % 2 else noticeboard(9.0, 9.0, 1650 + k))
        )
    return joined(parts)


def splashback(width_m: float, codes: list[str], seed: int, *, low_m: float = TOP_M, high_m: float = 1.48) -> Piece:
    """Tiles on the wall between worktop and wall units, from x = 0 on."""
    paint = tiles(codes, "#d9d3c6", (0.15, 0.07), seed, bond=0.5)
    return rect((0.0, -0.006, low_m), (width_m, 0, 0), (0, 0, high_m - low_m), 0.0125, paint)


def clutter() -> Piece:
    """What stands on a worktop of 2.4 m from x = 0 on: jars, a board, a kettle, mugs, a knife block."""
    oak = pt.wood("#c9a06c", "#94683c", 1660)
    parts: list[Piece] = []
    for k, (code, h) in enumerate((("#c9714e", 0.24), ("#e9dfc9", 0.2), ("#4f7f88", 0.17), ("#e0b14e", 0.14))):
        jar = pt.stripes([code, code, "#f3ead6"], [0.05, 0.02, 0.012], 1661 + k)
        outline = [(0.055, 0.0), (0.06, 0.02), (0.06, h), (0.045, h + 0.015), (0.015, h + 0.02), (0.015, h + 0.04)]
        parts.append(
            placed(
                lathe((0, 0, 0), outline, 24, lambda u, v, jar=jar: jar(v, u), cell_m=0.01),
                (0.12 + 0.14 * k, -0.12, 0.0),
            )
        )
    board = rounded_box((-0.15, -0.012, 0.0), (0.15, 0.012, 0.38), 0.01, 0.014, oak)
    parts.append(placed(board, (0.86, -0.07, 0.0), 4.0))
    kettle = pt.plain("#b5442f", 1670, grain=0.1)
    parts.append(
        placed(
            lathe(
                (0, 0, 0),
                [(0.1, 0), (0.11, 0.04), (0.09, 0.15), (0.05, 0.19), (0.0401, 0.2), (0.012, 0.2), (0.012, 0.22)],
                30,
                kettle,
                cell_m=0.01,
            ),
            (1.15, -0.2, 0.0),
        )
    )
    grip = [
        (1.15 + 0.09 * float(np.cos(a)), -0.2, 0.17 + 0.11 * float(np.sin(a))) for a in np.linspace(0.3, np.pi - 0.3, 9)
    ]
    parts.append(tube(grip, 0.009, 6, BLACK))
    glazes = [
        pt.terrazzo(code, ["#f3e6d0"], 1680 + k, chip_m=0.02)
        for k, code in enumerate(("#3d6470", "#c9553c", "#e0b14e"))
    ]
    parts += [
        placed(mug(glaze), (1.42 + 0.13 * k, -0.16 - 0.05 * (k % 2), 0.0), 60.0 * k) for k, glaze in enumerate(glazes)
    ]
    parts.append(
        placed(vase(1, 0.28, pt.checks(["#2f5a6b", "#e9dfc9", "#2f5a6b", "#c9a35e"], 0.03, 1690)), (1.95, -0.15, 0.0))
    )
    parts.append(placed(rounded_box((-0.05, -0.09, 0.0), (0.05, 0.09, 0.2), 0.01, 0.014, oak), (2.2, -0.14, 0.0)))
    parts += [rod((2.17 + 0.03 * k, -0.14, 0.2), (2.17 + 0.03 * k, -0.16, 0.28), 0.009, 0.02, BLACK) for k in range(3)]
    return shadeless(joined(parts))
