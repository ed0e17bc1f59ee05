# SPDX-License-Identifier: GPL-3.0-or-later
"""The room itself: floor, walls, ceiling, windows with the garden behind them, curtains, door.

X runs along the long side (east), Y across it (north, where the windows are), Z up; the floor is z = 0.
"""

import numpy as np

from . import patterns as pt
from .pictures import garden
from .surfaces import Array, Painter, Piece, Point, ball, box, joined, rect, rod, shadeless, sheet, tube

# A living room of 6.5 m x 5 m, 2.7 m high: designed, not measured.
INTERIOR_MIN_M: Point = (-3.25, -2.5, 0.0)
INTERIOR_MAX_M: Point = (3.25, 2.5, 2.7)
# Openings as (x low, x high, z low, z high): two in the north wall, one for the door in the south wall.
WINDOWS_M = ((-2.3, -0.3, 0.98, 2.3), (1.05, 2.45, 0.98, 2.3))
DOOR_M = (1.95, 2.85, 0.0, 2.06)
DADO_M = 0.9  # top of the panelling
REVEAL_M = 0.16  # depth of the windows in the wall
WALL_CELL_M = 0.016  # distance of the walls' vertices, which carry the texture; chosen: detail against size

X0, Y0, Z0 = INTERIOR_MIN_M
X1, Y1, Z1 = INTERIOR_MAX_M

_PAINTED = pt.plain("#e9e4d6", 300, grain=0.04, patch=0.04)
_TRIM = pt.wood("#efe9da", "#d8cfba", 301)


def _floor() -> Piece:
    paint = pt.planks("#c99c6b", "#8f6238", "#3d2817", 10)
    return rect((X0, Y0, 0), (X1 - X0, 0, 0), (0, Y1 - Y0, 0), 0.024, paint, v_m=pt.plank_rows(Y1 - Y0, 4))


def _ceiling() -> Piece:
    boards = pt.planks("#f1e7d3", "#d2bd9a", "#8a7757", 40)
    flat = rect((X0, Y1, Z1), (X1 - X0, 0, 0), (0, Y0 - Y1, 0), 0.034, boards, v_m=pt.plank_rows(Y1 - Y0, 2))
    beam = pt.wood("#8a623d", "#4f3420", 41)
    beams = [
        box((x - 0.075, Y0, Z1 - 0.13), (x + 0.075, Y1, Z1), 0.03, beam, skip="yYZ")
        for x in (-2.5, -1.25, 0, 1.25, 2.5)
    ]
    return joined([flat, *beams])


type Hole = tuple[float, float, float, float]


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


def _cornice(start: Point, end: tuple[float, float]) -> Piece:
    low = (min(start[0], end[0]), min(start[1], end[1]))
    high = (max(start[0], end[0]), max(start[1], end[1]))
    if high[1] - low[1] > 1:
        return shadeless(box((X0, low[1], Z1 - 0.07), (X0 + 0.04, high[1], Z1), 0.025, _TRIM, skip="xyYZ"))
    y = (Y1 - 0.04, Y1) if low[1] > 0 else (Y0, Y0 + 0.04)
    return shadeless(box((low[0], y[0], Z1 - 0.07), (high[0], y[1], Z1), 0.025, _TRIM, skip="xXZ"))


def _brick_wall() -> Piece:
    """The east wall: bricks that stand 4 mm proud of their mortar."""
    u_m, v_m = pt.brick_grid(Y1 - Y0, Z1)
    u, v = np.meshgrid(u_m, v_m)
    face, _, _ = pt.brick_depth(u, v)
    wall = sheet(np.stack([X1 - 0.004 * face, Y0 + u, v], -1), pt.bricks(90)(u, v))
    flipped = sheet(wall.points_m[:, ::-1], wall.rgb[:, ::-1])
    skirting = box((X1 - 0.02, Y0, 0.0), (X1, Y1, 0.12), 0.025, pt.wood("#8a623d", "#4f3420", 91), skip="XyYz")
    return Piece((flipped,)) + shadeless(skirting)


def _window(x_low: float, x_high: float, z_low: float, z_high: float, seed: int) -> Piece:
    """Reveal, sill, frame and glazing bars of a window in the north wall."""
    depth, width, height = REVEAL_M, x_high - x_low, z_high - z_low
    parts = [
        rect((x_low, Y1, z_low), (width, 0, 0), (0, depth, 0), 0.02, _PAINTED),
        rect((x_low, Y1 + depth, z_high), (width, 0, 0), (0, -depth, 0), 0.02, _PAINTED),
        rect((x_low, Y1, z_low), (0, depth, 0), (0, 0, height), 0.02, _PAINTED),
        rect((x_high, Y1 + depth, z_low), (0, -depth, 0), (0, 0, height), 0.02, _PAINTED),
        box(
            (x_low - 0.03, Y1 - 0.044, z_low - 0.03),
            (x_high + 0.03, Y1 + 0.05, z_low + 0.004),
            0.016,
            pt.wood("#c99c6b", "#8f6238", seed),
        ),
    ]
    front, back = Y1 + 0.07, Y1 + 0.125

    def bar(a: float, b: float, low: float, high: float, inset: float = 0.0) -> None:
        parts.append(box((a, front + inset, low), (b, back - inset, high), 0.04, _TRIM, glow=0.3))

    rim = 0.055
    bar(x_low, x_low + rim, z_low, z_high)
    bar(x_high - rim, x_high, z_low, z_high)
    bar(x_low + rim, x_high - rim, z_low, z_low + rim)
    bar(x_low + rim, x_high - rim, z_high - rim, z_high)
    for x in _mullions(x_low, x_high):
        bar(x - 0.022, x + 0.022, z_low + rim, z_high - rim, 0.004)
    for k in (1, 2):
        z = z_low + height * k / 3
        bar(x_low + rim, x_high - rim, z - 0.011, z + 0.011, 0.014)
    return shadeless(joined(parts))


def _mullions(x_low: float, x_high: float) -> list[float]:
    count = round((x_high - x_low) / 0.5)
    return [x_low + (x_high - x_low) * k / count for k in range(1, count)]


def pane_bars_m(window: tuple[float, float, float, float]) -> tuple[list[float], list[float]]:
    """Centres of a window's upright (x) and level (z) glazing bars, for the sun's pattern on the floor."""
    x_low, x_high, z_low, z_high = window
    return _mullions(x_low, x_high), [z_low + (z_high - z_low) * k / 3 for k in (1, 2)]


def _outdoors() -> Piece:
    """The garden: a glowing box behind the north wall whose picture is right from the middle of the room."""
    low, high = np.array([-3.3, Y1 + REVEAL_M, -0.5]), np.array([3.5, Y1 + 1.3, 3.3])
    eye = np.array([0.1, 0.6, 1.55])
    size = high - low
    corners = (
        ((low[0], high[1], low[2]), (size[0], 0, 0), (0, 0, size[2]), 0.0345),
        ((low[0], low[1], low[2]), (0, size[1], 0), (0, 0, size[2]), 0.06),
        ((high[0], high[1], low[2]), (0, -size[1], 0), (0, 0, size[2]), 0.04),
        ((low[0], low[1], low[2]), (size[0], 0, 0), (0, size[1], 0), 0.04),
        ((low[0], high[1], high[2]), (size[0], 0, 0), (0, -size[1], 0), 0.04),
    )
    parts: list[Piece] = []
    for corner, u_edge, v_edge, cell in corners:
        c, a, b = (np.array(x, np.float64) for x in (corner, u_edge, v_edge))
        a, b = a / abs(a).sum(), b / abs(b).sum()

        def paint(u: Array, v: Array, c: Array = c, a: Array = a, b: Array = b) -> Array:
            away = c + u[..., None] * a + v[..., None] * b - eye
            return garden(away[..., 0] / away[..., 1], away[..., 2] / away[..., 1])

        parts.append(rect(tuple(c), u_edge, v_edge, cell, paint, glow=1.0))
    return joined(parts)


def _curtain(x_low: float, x_high: float, seed: int) -> Piece:
    """A gathered curtain with a hem just above the floor."""
    top, bottom, folds = 2.44, 0.03, 5
    print_ = pt.stripes(
        ["#e8dcc0", "#d9a441", "#e8dcc0", "#b5653a", "#e8dcc0", "#5f7f78"], [0.05, 0.03, 0.05, 0.016, 0.05, 0.03], seed
    )
    u, v = np.meshgrid(np.arange(47) / 46.0, np.arange(111) / 110.0)
    swing = 0.5 + 0.5 * (1 - v)
    fold = np.sin(2 * np.pi * (folds * u + 0.15 * pt.noise(2 * u, 2 * v, seed) + 0.1 * seed))
    x = x_low + (x_high - x_low) * (0.5 + (u - 0.5) * (0.92 + 0.16 * abs(v - 0.5)))
    y = Y1 - 0.085 - 0.034 * swing * fold
    cloth = sheet(np.stack([x, y, bottom + (top - bottom) * v], -1), print_(u * 1.1, v * 2.4))
    low, high = (x_low + 0.02, Y1 - 0.048, bottom), (x_high - 0.02, Y1 - 0.02, top)
    return Piece((cloth,), ((low, high),))


def _curtains(x_low: float, x_high: float, seed: int) -> Piece:
    brass = pt.plain("#a8803e", 310, grain=0.12)
    y, z, a, b = Y1 - 0.085, 2.47, x_low - 0.52, x_high + 0.52
    parts = [_curtain(x_low - 0.45, x_low + 0.08, seed), _curtain(x_high - 0.08, x_high + 0.45, seed + 1)]
    parts += [
        rod((a, y, z), (b, y, z), 0.012, 0.02, brass),
        ball((a, y, z), 0.028, 0.012, brass),
        ball((b, y, z), 0.028, 0.012, brass),
    ]
    angle = np.arange(13) * (2 * np.pi / 12)
    for k in range(7):
        for x in (a + 0.1 + 0.075 * k, b - 0.1 - 0.075 * k):
            ring = [(x, y + 0.02 * np.cos(t), z - 0.008 + 0.022 * np.sin(t)) for t in angle]
            parts.append(tube(ring, 0.003, 5, brass))
    return joined([*parts[:2], *map(shadeless, parts[2:])])


def _door() -> Piece:
    x_low, x_high, _, top = DOOR_M
    leaf = pt.plain("#6f918b", 330, grain=0.06, grain_m=0.022, patch=0.1, fleck=0.08)
    back, front = Y0 - 0.045, Y0 - 0.01
    parts = [box((x_low, back, 0.008), (x_high, front, top), 0.022, leaf, skip="yzZ")]
    middle = (x_low + x_high) / 2
    for low, high in ((0.16, 0.62), (0.76, 1.3), (1.42, 1.92)):
        for a, b in ((x_low + 0.12, middle - 0.05), (middle + 0.05, x_high - 0.12)):
            parts.append(box((a, front, low), (b, front + 0.008, high), 0.022, leaf, skip="y"))
            parts.append(
                box((a + 0.05, front + 0.008, low + 0.05), (b - 0.05, front + 0.016, high - 0.05), 0.02, leaf, skip="y")
            )
    for a, b, low, high in (
        (x_low - 0.09, x_low, 0.0, top + 0.09),
        (x_high, x_high + 0.09, 0.0, top + 0.09),
        (x_low, x_high, top, top + 0.09),
    ):
        parts.append(box((a, Y0 - 0.06, low), (b, Y0 + 0.025, high), 0.024, _TRIM))
    parts.append(box((x_low, Y0 - 0.06, -0.01), (x_high, Y0 + 0.01, 0.008), 0.018, pt.wood("#8a623d", "#4f3420", 331)))
    brass = pt.plain("#c19a4b", 332, grain=0.12)
    x = x_low + 0.07
    parts.append(box((x - 0.02, front, 0.93), (x + 0.02, front + 0.006, 1.13), 0.01, brass, skip="y"))
    parts.append(
        tube(
            [
                (x, front, 1.06),
                (x, front + 0.05, 1.06),
                (x + 0.02, front + 0.06, 1.06),
                (x + 0.13, front + 0.06, 1.055),
            ],
            0.009,
            8,
            brass,
        )
    )
    return shadeless(joined(parts))


def shell() -> Piece:
    """Everything that is built in."""
    windows = [_window(*w, 340 + k) for k, w in enumerate(WINDOWS_M)]
    curtains = [_curtains(w[0], w[1], 350 + 10 * k) for k, w in enumerate(WINDOWS_M)]
    return joined([_floor(), _ceiling(), _walls(), *windows, _outdoors(), *curtains, _door()])
