# SPDX-License-Identifier: GPL-3.0-or-later
"""Room 0, a living room: the room itself, and the small and hanging things where they belong.

The room itself: floor, walls, ceiling, windows with the garden behind them, curtains, door.

X runs along the long side (east), Y across it (north, where the windows are), Z up; the floor is z = 0.
"""

import numpy as np

from . import finishes as pic
from . import surfaces as pt
from .finishes import garden
from .furniture import COFFEE_AT_M, CONSOLE_AT_M, SIDEBOARD_AT_M, TABLE_AT_M, furniture
from .light import Lighting, Window
from .openings import REVEAL_M, TRIM, Hole, curtains, door, outdoors, window
from .surfaces import Array, Painter, Piece, Point, box, joined, placed, rect, rounded_box, shadeless, sheet, thing
from .things import (
    clock,
    floor_lamp,
    flowers,
    framed,
    fruit_bowl,
    mug,
    open_carton,
    pendant,
    place_setting,
    potted_palm,
    pouf,
    rug,
    toys,
    trailing_plant,
)

# A living room of 6.5 m x 5 m, 2.7 m high: designed, not measured.
INTERIOR_MIN_M: Point = (-3.25, -2.5, 0.0)
INTERIOR_MAX_M: Point = (3.25, 2.5, 2.7)
# Openings as (x low, x high, z low, z high): two in the north wall, one for the door in the south wall.
WINDOWS_M = ((-2.3, -0.3, 0.98, 2.3), (1.05, 2.45, 0.98, 2.3))
DOOR_M = (1.95, 2.85, 0.0, 2.06)
DADO_M = 0.9  # top of the panelling
WALL_CELL_M = 0.016  # distance of the walls' vertices, which carry the texture; chosen: detail against size

X0, Y0, Z0 = INTERIOR_MIN_M
X1, Y1, Z1 = INTERIOR_MAX_M

LAMPS_M = ((-2.86, 2.06, 1.55, 0.24), (1.75, 0.35, 1.62, 0.26))  # x, y, z and the strength of each
LIGHTING = Lighting(INTERIOR_MIN_M, INTERIOR_MAX_M, tuple(Window(1, 1, Y1, w) for w in WINDOWS_M), LAMPS_M)


@thing("floor")
def _floor() -> Piece:
    paint = pt.planks("#c99c6b", "#8f6238", "#3d2817", 10)
    return rect((X0, Y0, 0), (X1 - X0, 0, 0), (0, Y1 - Y0, 0), 0.024, paint, v_m=pt.plank_rows(Y1 - Y0, 4))


@thing("ceiling")
def _ceiling() -> Piece:
    boards = pt.planks("#f1e7d3", "#d2bd9a", "#8a7757", 40)
    flat = rect((X0, Y1, Z1), (X1 - X0, 0, 0), (0, Y0 - Y1, 0), 0.034, boards, v_m=pt.plank_rows(Y1 - Y0, 2))
    beam = pt.wood("#8a623d", "#4f3420", 41)
    beams = [
        box((x - 0.075, Y0, Z1 - 0.13), (x + 0.075, Y1, Z1), 0.03, beam, skip="yYZ")
        for x in (-2.5, -1.25, 0, 1.25, 2.5)
    ]
    return joined([flat, *beams])


@thing("wall")
def _wall(
    start: Point,
    along: Point,
    z_m: tuple[float, float],
    holes: tuple[Hole, ...],
    painted: tuple[float, Painter, Array | None],
) -> Piece:
    """A wall from start along (x, y, length) with holes (from, to, low, high); painted: cell_m, painter, columns_m."""
    dx, dy, length = along
    z_low, z_high = z_m
    cell_m, paint, columns_m = painted
    parts: list[Piece] = []

    def part(a: float, b: float, low: float, high: float) -> None:
        if b - a > 1e-6 and high - low > 1e-6:
            corner = (start[0] + dx * a, start[1] + dy * a, low)
            u_edge, v_edge = (dx * (b - a), dy * (b - a), 0.0), (0.0, 0.0, high - low)
            u_m = None if columns_m is None else _between(columns_m, a, b)
            parts.append(rect(corner, u_edge, v_edge, cell_m, paint, u_m=u_m, start_m=(a, low)))

    at = 0.0
    for a, b, low, high in sorted(holes):
        part(at, a, z_low, z_high)
        part(a, b, z_low, min(max(low, z_low), z_high))
        part(a, b, max(min(high, z_high), z_low), z_high)
        at = b
    part(at, length, z_low, z_high)
    return joined(parts)


def _between(columns_m: Array, low: float, high: float) -> Array:
    """The columns from low to high, both ends included, measured from low."""
    inner = columns_m[(columns_m > low + 0.002) & (columns_m < high - 0.002)]
    return np.concatenate([[0.0], inner - low, [high - low]])


@thing("wall")
def _panelling(start: Point, along: Point, gaps: tuple[tuple[float, float], ...]) -> Piece:
    """Skirting board and dado rail on a wall, left out at the gaps (from, to)."""
    dx, dy, length = along
    nx, ny = dy, -dx
    painter = pt.plain("#e4e4d6", 320, grain=0.05, grain_m=0.03, patch=0.0, fleck=0.12)
    hidden = {(1, 0): "Y", (-1, 0): "y", (0, 1): "x"}[round(dx), round(dy)]

    def bar(a: float, b: float, low: float, high: float, out: float) -> Piece:
        p = (start[0] + dx * a, start[1] + dy * a)
        q = (start[0] + dx * b + nx * out, start[1] + dy * b + ny * out)
        low_m = (min(p[0], q[0]), min(p[1], q[1]), low)
        return box(low_m, (max(p[0], q[0]), max(p[1], q[1]), high), 0.03, painter, skip=hidden)

    parts: list[Piece] = []
    at = 0.0
    for a, b in (*sorted(gaps), (length, length)):
        if a - at > 0.05:
            parts += [bar(at, a, 0.0, 0.11, 0.018), bar(at, a, 0.11, 0.125, 0.010)]
            parts += [bar(at, a, DADO_M - 0.065, DADO_M - 0.022, 0.014), bar(at, a, DADO_M - 0.022, DADO_M, 0.032)]
        at = b
    return shadeless(joined(parts))


def _walls() -> Piece:
    cream = pt.wallpaper("#efe6d0", "#8fa58a", "#c98a5b", 60)
    forest = pt.wallpaper("#2f5a55", "#c9a35e", "#e8d6a8", 61)
    lower = pt.beadboard("#d2d9c6", "#76826f", 62)
    boards_m = pt.plank_rows(X1 - X0, 3)
    north, south, west = (X0, Y1, 0.0), (X1, Y0, 0.0), (X0, Y0, 0.0)
    north_holes = tuple((a - X0, b - X0, low, high) for a, b, low, high in WINDOWS_M)
    door = (X1 - DOOR_M[1], X1 - DOOR_M[0], DOOR_M[2], DOOR_M[3])
    runs = (
        (north, (1.0, 0.0, X1 - X0), north_holes, cream, ()),
        (south, (-1.0, 0.0, X1 - X0), (door,), cream, ((door[0] - 0.09, door[1] + 0.09),)),
        (west, (0.0, 1.0, Y1 - Y0), (), forest, ()),
    )
    parts: list[Piece] = []
    for start, along, holes, paper, gaps in runs:
        parts.append(_wall(start, along, (DADO_M, Z1), holes, (WALL_CELL_M, paper, None)))
        parts.append(_wall(start, along, (0.0, DADO_M), holes, (0.028, lower, boards_m)))
        parts.append(_panelling(start, along, gaps))
        ends = (start[0] + along[0] * along[2], start[1] + along[1] * along[2])
        parts.append(_cornice(start, ends))
    return joined([*parts, _brick_wall()])


@thing("wall")
def _cornice(start: Point, end: tuple[float, float]) -> Piece:
    low = (min(start[0], end[0]), min(start[1], end[1]))
    high = (max(start[0], end[0]), max(start[1], end[1]))
    if high[1] - low[1] > 1:
        return shadeless(box((X0, low[1], Z1 - 0.07), (X0 + 0.04, high[1], Z1), 0.025, TRIM, skip="xyYZ"))
    y = (Y1 - 0.04, Y1) if low[1] > 0 else (Y0, Y0 + 0.04)
    return shadeless(box((low[0], y[0], Z1 - 0.07), (high[0], y[1], Z1), 0.025, TRIM, skip="xXZ"))


@thing("wall")
def _brick_wall() -> Piece:
    """The east wall: bricks that stand 4 mm proud of their mortar."""
    u_m, v_m = pt.brick_grid(Y1 - Y0, Z1)
    u, v = np.meshgrid(u_m, v_m)
    face, _, _ = pt.brick_depth(u, v)
    wall = sheet(np.stack([X1 - 0.004 * face, Y0 + u, v], -1), pt.bricks(90)(u, v))
    flipped = sheet(wall.points_m[:, ::-1], wall.rgb[:, ::-1])
    skirting = box((X1 - 0.02, Y0, 0.0), (X1, Y1, 0.12), 0.025, pt.wood("#8a623d", "#4f3420", 91), skip="XyYz")
    return Piece((flipped,)) + shadeless(skirting)


def shell() -> Piece:
    """Everything that is built in."""
    windows = [window(w, Y1, 340 + k) for k, w in enumerate(WINDOWS_M)]
    hangings = [curtains(w[0], w[1], Y1, 350 + 10 * k) for k, w in enumerate(WINDOWS_M)]
    garden_ = outdoors((-3.3, Y1 + REVEAL_M, -0.5), (3.5, Y1 + 1.3, 3.3), (0.1, 0.6, 1.55), garden)
    return joined([_floor(), _ceiling(), _walls(), *windows, garden_, *hangings, door(DOOR_M, Y0)])


# The small and hanging things of the living room, where they belong.


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


def living_room() -> tuple[Piece, Lighting]:
    """Everything in it, and its light."""
    return shell() + furniture() + decor(), LIGHTING
