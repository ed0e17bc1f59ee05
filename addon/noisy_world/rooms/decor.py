# SPDX-License-Identifier: GPL-3.0-or-later
"""The small and hanging things of the living room, where they belong."""

from . import patterns as pt
from . import pictures as pic
from .furniture import COFFEE_AT_M, CONSOLE_AT_M, SIDEBOARD_AT_M, TABLE_AT_M
from .plants import flowers, potted_palm, trailing_plant
from .shell import LAMPS_M, X1, Y0, Y1, Z1
from .surfaces import Piece, Point, box, joined, placed, rect, rounded_box, shadeless
from .things import clock, floor_lamp, framed, fruit_bowl, mug, open_carton, pendant, place_setting, pouf, rug, toys


def _hung() -> list[Piece]:
    gold, dark = pt.wood("#c9a35e", "#8a6630", 730), pt.wood("#4a3325", "#2a1c14", 731)
    pale = pt.wood("#e0cfae", "#b89a6c", 732)
    valley = ("#6f9fc4", "#f4d9ae", "#fff4d2", "#9fb0bd", "#7f9a94", "#5f8060", "#7d8f45", "#3f5a3a")
    dusk = ("#35446e", "#e88a5c", "#ffe2a0", "#8a5a78", "#6b4264", "#43304e", "#2b2438")
    autumn = ("#9fb7c4", "#f2dcb4", "#fff0c8", "#b9a98f", "#c98a4a", "#b0552f", "#8a7a35", "#6b3f26")
    sea = ("#8fc0d8", "#f7efe0", "#ffffff", "#6aa6b8", "#3f86a0", "#2c6680", "#e2c890", "#c9a868")
    east, west, north, south = -90.0, 90.0, 0.0, 180.0
    x_west = -3.25
    return [
        placed(framed(1.15, 0.72, pic.landscape(1.15, 0.72, 740, valley), gold), (X1, -0.95, 1.62), east),
        placed(framed(0.46, 0.62, pic.circles(0.46, 741), dark, mat_m=0.05), (X1, 0.32, 1.58), east),
        placed(framed(0.62, 0.5, pic.blocks(0.62, 0.5, 742), dark), (X1, 1.25, 1.78), east),
        placed(framed(0.5, 0.36, pic.landscape(0.5, 0.36, 743, sea), pale, mat_m=0.04), (X1, 1.25, 1.19), east),
        placed(
            framed(0.42, 0.6, pic.botanical(0.42, 0.6, 744, "#3f6045"), gold, mat_m=0.03), (x_west, 1.72, 1.62), west
        ),
        placed(
            framed(0.42, 0.6, pic.botanical(0.42, 0.6, 745, "#7a4a35"), gold, mat_m=0.03), (x_west, -1.75, 1.62), west
        ),
        placed(framed(0.34, 0.44, pic.blocks(0.34, 0.44, 746), pale, mat_m=0.035), (0.40, Y1, 1.85), north),
        placed(framed(0.9, 0.5, pic.landscape(0.9, 0.5, 753, autumn), dark), (-1.30, Y0, 1.78), south),
        placed(framed(0.4, 0.52, pic.circles(0.4, 748), pale, mat_m=0.04), (0.30, Y0, 1.72), south),
        placed(
            framed(0.34, 0.46, pic.botanical(0.34, 0.46, 749, "#2f4f63"), dark, mat_m=0.03), (-2.62, Y0, 1.55), south
        ),
        placed(framed(0.46, 0.34, pic.landscape(0.46, 0.34, 750, sea), gold, mat_m=0.03), (1.15, Y0, 1.88), south),
        placed(framed(0.46, 0.34, pic.landscape(0.46, 0.34, 751, dusk), gold, mat_m=0.03), (1.15, Y0, 1.38), south),
    ]


def _on(place_m: Point, dx: float, dy: float, z: float) -> Point:
    return (place_m[0] + dx, place_m[1] + dy, z)


def _tableware() -> list[Piece]:
    red, blue = (
        pt.terrazzo("#c9553c", ["#f3e6d0"], 880, chip_m=0.02),
        pt.stripes(["#3d6470", "#e9dfc9"], [0.013, 0.009], 881),
    )
    cover = pic.landscape(0.22, 0.3, 882, ("#35446e", "#e88a5c", "#ffe2a0", "#8a5a78", "#2b2438"))
    magazine = box((-0.11, -0.15, 0), (0.11, 0.15, 0.006), 0.03, pt.plain("#ded5c3", 884), skip="zZ")
    magazine += rect((-0.11, -0.15, 0.006), (0.22, 0, 0), (0, 0.3, 0), 0.0085, cover)
    remote = rounded_box(
        (-0.02, -0.08, 0),
        (0.02, 0.08, 0.016),
        0.006,
        0.008,
        pt.checks(["#2a2828", "#2a2828", "#2a2828", "#b9b4aa"], 0.011, 883),
    )
    coffee, table, board = 0.4325, 0.7525, 0.8405
    return [
        placed(fruit_bowl(890), _on(COFFEE_AT_M, -0.32, 0.1, coffee)),
        placed(mug(red), _on(COFFEE_AT_M, 0.02, 0.14, coffee), 40.0),
        placed(mug(blue), _on(COFFEE_AT_M, -0.1, -0.17, coffee), 200.0),
        placed(shadeless(magazine), _on(COFFEE_AT_M, -0.36, -0.14, coffee), 68.0),
        placed(shadeless(remote), _on(COFFEE_AT_M, 0.06, -0.2, coffee), 100.0),
        placed(flowers(), _on(TABLE_AT_M, 0.02, 0.02, table)),
        placed(place_setting(), _on(TABLE_AT_M, -0.38, -0.26, table)),
        placed(place_setting(), _on(TABLE_AT_M, -0.36, 0.27, table), 180.0),
        placed(mug(blue), _on(TABLE_AT_M, -0.1, 0.26, table), 20.0),
        placed(mug(red), _on(TABLE_AT_M, 0.36, -0.22, table), 120.0),
        placed(fruit_bowl(891), _on(SIDEBOARD_AT_M, -0.22, 0.15, board)),
        placed(trailing_plant(), _on(SIDEBOARD_AT_M, -0.24, 0.52, board), -90.0),
    ]


def decor() -> Piece:
    """All small and hanging things, where they belong in the room."""
    palm = placed(potted_palm(), (0.42, 2.02, 0.0), 25.0)
    shelf_plant = placed(trailing_plant(), (-3.02, 0.82, 2.2215), 90.0)
    cactus = placed(trailing_plant(), (CONSOLE_AT_M[0] - 0.78, CONSOLE_AT_M[1] + 0.2, 0.5205), 180.0)
    return joined(
        [
            placed(rug(), (-1.25, 0.30, 0.0)),
            *_hung(),
            placed(clock(), (X1 - 0.035, 0.32, 2.17), -90.0),
            floor_lamp(LAMPS_M[0][:3]),
            pendant(LAMPS_M[1][:3], Z1),
            palm,
            shelf_plant,
            cactus,
            *_tableware(),
            placed(open_carton(), (0.45, -2.1, 0.0), 170.0),
            placed(toys(), (0.35, -1.15, 0.0)),
            placed(pouf(), (-2.35, -0.75, 0.0)),
        ]
    )
