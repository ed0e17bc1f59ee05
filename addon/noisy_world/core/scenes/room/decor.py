# SPDX-License-Identifier: GPL-3.0-or-later
"""What makes the room lived in: rug, pictures, lamps, plants, clock, tableware, toys."""

from dataclasses import replace

import numpy as np

from . import patterns as pt
from . import pictures as pic
from .furniture import COFFEE_AT_M, CONSOLE_AT_M, SIDEBOARD_AT_M, TABLE_AT_M
from .light import LAMPS
from .plants import flowers, potted_palm, trailing_plant
from .shell import X1, Y0, Y1, Z1
from .surfaces import (
    Array,
    Painter,
    Piece,
    Point,
    ball,
    box,
    disc,
    joined,
    lathe,
    placed,
    rect,
    rod,
    rounded_box,
    shadeless,
    sheet,
    tilted,
    tube,
)

_BRASS = pt.plain("#b8924a", 700, grain=0.14)
_BLACK = pt.plain("#35322f", 701, grain=0.2)


def _rug() -> Piece:
    length, width = 2.6, 1.8
    u, v = np.meshgrid(np.arange(275) * (length / 274), np.arange(190) * (width / 189))
    z = 0.011 + 0.002 * pt.noise(u / 0.3, v / 0.3, 710)
    top = sheet(np.stack([u - length / 2, v - width / 2, z], -1), pic.rug(length, width, 711)(u, v))
    hem = box(
        (-length / 2, -width / 2, 0.002), (length / 2, width / 2, 0.011), 0.02, pt.plain("#7c3022", 712), skip="zZ"
    )
    wool = pt.plain("#e6d8bb", 713, grain=0.1, patch=0.0)
    tassels = []
    for k in range(61):
        y = -width / 2 + 0.015 + k * (width - 0.03) / 60
        for side in (-1, 1):
            x = side * length / 2
            tip = (x + side * 0.055, y + pt.pick(k, 714 + side, -0.012, 0.012), 0.004)
            tassels.append(tube([(x, y, 0.008), (x + side * 0.03, y, 0.006), tip], 0.0035, 5, wool))
    return Piece((top,)) + shadeless(joined([hem, *tassels]))


def _framed(width_m: float, height_m: float, paint: Painter, frame: Painter, *, mat_m: float = 0.0) -> Piece:
    """A picture hung flat on a wall at y = 0, its centre at the origin, facing -y."""
    w, h, rim = width_m / 2, height_m / 2, 0.03
    image = rect((-w, -0.012, -h), (width_m, 0, 0), (0, 0, height_m), 0.0094, paint)
    a, b = w + mat_m, h + mat_m
    parts = [image]
    if mat_m:
        card = pt.plain("#f3ecdc", 720, grain=0.02)
        for low, high in (((-a, -b), (a, -h)), ((-a, h), (a, b)), ((-a, -h), (-w, h)), ((w, -h), (a, h))):
            u_edge, v_edge = (high[0] - low[0], 0, 0), (0, 0, high[1] - low[1])
            parts.append(rect((low[0], -0.014, low[1]), u_edge, v_edge, 0.03, card))
    for low, high in (
        ((-a - rim, -b - rim), (a + rim, -b)),
        ((-a - rim, b), (a + rim, b + rim)),
        ((-a - rim, -b), (-a, b)),
        ((a, -b), (a + rim, b)),
    ):
        parts.append(box((low[0], -0.028, low[1]), (high[0], -0.002, high[1]), 0.018, frame, skip="Y"))
    return shadeless(joined(parts))


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
        placed(_framed(1.15, 0.72, pic.landscape(1.15, 0.72, 740, valley), gold), (X1, -0.95, 1.62), east),
        placed(_framed(0.46, 0.62, pic.circles(0.46, 741), dark, mat_m=0.05), (X1, 0.32, 1.58), east),
        placed(_framed(0.62, 0.5, pic.blocks(0.62, 0.5, 742), dark), (X1, 1.25, 1.78), east),
        placed(_framed(0.5, 0.36, pic.landscape(0.5, 0.36, 743, sea), pale, mat_m=0.04), (X1, 1.25, 1.19), east),
        placed(
            _framed(0.42, 0.6, pic.botanical(0.42, 0.6, 744, "#3f6045"), gold, mat_m=0.03), (x_west, 1.72, 1.62), west
        ),
        placed(
            _framed(0.42, 0.6, pic.botanical(0.42, 0.6, 745, "#7a4a35"), gold, mat_m=0.03), (x_west, -1.75, 1.62), west
        ),
        placed(_framed(0.34, 0.44, pic.blocks(0.34, 0.44, 746), pale, mat_m=0.035), (0.40, Y1, 1.85), north),
        placed(_framed(0.9, 0.5, pic.landscape(0.9, 0.5, 753, autumn), dark), (-1.30, Y0, 1.78), south),
        placed(_framed(0.4, 0.52, pic.circles(0.4, 748), pale, mat_m=0.04), (0.30, Y0, 1.72), south),
        placed(
            _framed(0.34, 0.46, pic.botanical(0.34, 0.46, 749, "#2f4f63"), dark, mat_m=0.03), (-2.62, Y0, 1.55), south
        ),
        placed(_framed(0.46, 0.34, pic.landscape(0.46, 0.34, 750, sea), gold, mat_m=0.03), (1.15, Y0, 1.88), south),
        placed(_framed(0.46, 0.34, pic.landscape(0.46, 0.34, 751, dusk), gold, mat_m=0.03), (1.15, Y0, 1.38), south),
    ]


def _clock() -> Piece:
    """A round wall clock about the origin, facing -y: a drum with a dial, built lying down and stood up."""
    dial = disc((0, 0, 0), 0.17, 0.008, pic.clock_face(0.17))
    rim = lathe((0, 0, -0.03), [(0.168, 0), (0.186, 0.01), (0.186, 0.03), (0.168, 0.042)], 48, _BLACK, cell_m=0.008)
    ink = pt.plain("#1f1c1a", 760)
    hands = [
        placed(box((-0.006, -0.02, 0.006), (0.006, 0.085, 0.010), 0.006, ink), (0, 0, 0), 58.0),
        placed(box((-0.004, -0.025, 0.012), (0.004, 0.13, 0.015), 0.006, ink), (0, 0, 0), -60.0),
    ]
    return _stood(shadeless(joined([dial, rim, *hands])))


def _stood(piece: Piece) -> Piece:
    return tilted(piece, 0, 90.0)


def _floor_lamp() -> Piece:
    x, y, z, _ = LAMPS[0]
    shade = pt.stripes(["#ffe7b0", "#f0cb86"], [0.044, 0.022], 770)
    parts = [
        lathe((x, y, 0), [(0.15, 0.0), (0.15, 0.012), (0.13, 0.022), (0.012, 0.026)], 32, _BLACK, cell_m=0.012),
        rod((x, y, 0.02), (x, y, z - 0.06), 0.0095, 0.015, _BRASS),
        lathe((x, y, z - 0.16), [(0.21, 0.0), (0.14, 0.30)], 80, shade, cell_m=0.012, glow=0.9),
        _glowing(ball((x, y, z), 0.035, 0.02, pt.plain("#fff8e2", 771, grain=0.0, patch=0.0))),
        tube([(x, y, z - 0.06), (x, y, z - 0.03)], 0.014, 8, _BRASS),
        tube([(x + 0.03, y, z - 0.04), (x + 0.03, y, z - 0.16), (x + 0.03, y, z - 0.25)], 0.0022, 5, _BRASS),
    ]
    spokes = [
        rod((x, y, z - 0.045), (x + 0.19 * a, y + 0.19 * b, z - 0.1), 0.003, 0.03, _BRASS, sides=5)
        for a, b in ((1, 0), (-0.5, 0.86), (-0.5, -0.86))
    ]
    return shadeless(joined([*parts, *spokes]))


def _pendant() -> Piece:
    x, y, z, _ = LAMPS[1]
    outline = [(0.25, 0.0), (0.235, 0.05), (0.18, 0.13), (0.09, 0.185), (0.03, 0.20), (0.026, 0.25)]
    low = z - 0.03
    bands = pt.stripes(
        ["#2f5a55", "#c9a35e", "#2f5a55", "#244843", "#2f5a55", "#c9a35e"], [0.12, 0.012, 0.05, 0.008, 0.06, 0.012], 780
    )

    def rings(u: Array, v: Array) -> Array:
        return bands(v + 0.11, u)

    glow = pt.plain("#ffedc4", 781, grain=0.03)
    parts = [
        lathe((x, y, low), outline, 48, rings, cell_m=0.01),
        lathe((x, y, low), [(r - 0.004, h) for r, h in reversed(outline[:5])], 48, glow, cell_m=0.015, glow=0.9),
        tube([(x, y, low + 0.25), (x, y, low + 0.6), (x, y, Z1 - 0.03)], 0.005, 6, _BLACK),
        lathe((x, y, Z1 - 0.035), [(0.01, 0.0), (0.05, 0.012), (0.055, 0.035)], 20, _BRASS),
        _glowing(ball((x, y, z + 0.03), 0.04, 0.02, pt.plain("#fff8e2", 782, grain=0.0, patch=0.0))),
    ]
    lid = disc((x, y, low + 0.25), 0.026, 0.01, _BLACK)
    return shadeless(joined([*parts, lid]))


def _glowing(piece: Piece) -> Piece:
    return Piece(tuple(replace(s, glow=1.0) for s in piece.sheets))


def _mug(paint: Painter) -> Piece:
    t = np.arange(9) / 8.0 * np.pi
    handle = [(0.038 + 0.026 * float(np.sin(a)), 0.0, 0.05 - 0.028 * float(np.cos(a))) for a in t]
    body = lathe(
        (0, 0, 0), [(0.034, 0), (0.040, 0.01), (0.040, 0.095), (0.036, 0.096), (0.036, 0.07)], 24, paint, cell_m=0.007
    )
    return joined([body, disc((0, 0, 0.078), 0.0365, 0.009, pt.plain("#4a2d1a", 810)), tube(handle, 0.0055, 6, paint)])


def _fruit_bowl(seed: int) -> Piece:
    glaze = pt.stripes(["#2f5a6b", "#e9dfc9", "#2f5a6b", "#c9a35e"], [0.02, 0.012, 0.02, 0.012], seed)

    def rings(u: Array, v: Array) -> Array:
        return glaze(v, u)

    parts = [
        lathe(
            (0, 0, 0),
            [(0.05, 0), (0.06, 0.012), (0.13, 0.06), (0.15, 0.09), (0.143, 0.09), (0.11, 0.05), (0.02, 0.03)],
            36,
            rings,
            cell_m=0.008,
        )
    ]
    for k, (x, y, z, r, code) in enumerate(
        (
            (0.05, 0.02, 0.085, 0.042, "#d9842f"),
            (-0.045, 0.04, 0.085, 0.042, "#c23b2f"),
            (0.0, -0.055, 0.085, 0.042, "#9ab542"),
            (0.005, 0.012, 0.135, 0.041, "#d9842f"),
            (0.075, -0.05, 0.095, 0.032, "#e3c04a"),
        )
    ):
        parts.append(ball((x, y, z), r, 0.008, pt.plain(code, seed + k, grain=0.12, grain_m=0.008, patch=0.2)))
    return shadeless(joined(parts))


def _place_setting() -> Piece:
    cloth = pt.checks(["#efe3cb", "#c9714e", "#e6d0a8"], 0.02, 830)
    plate = pt.stripes(["#f4efe2", "#f4efe2", "#3d6470", "#f4efe2"], [0.09, 0.02, 0.01, 0.02], 831)

    def rings(u: Array, v: Array) -> Array:
        return plate(v, u)

    steel = pt.plain("#a9a7a2", 832, grain=0.1)
    mat = box((-0.21, -0.15, 0.0), (0.21, 0.15, 0.004), 0.009, cloth, skip="z")
    dish = lathe((0, 0, 0.004), [(0.07, 0.0), (0.12, 0.016), (0.117, 0.018), (0.072, 0.006)], 40, rings, cell_m=0.008)
    well = disc((0, 0, 0.0105), 0.074, 0.008, pt.terrazzo("#f4efe2", ["#3d6470", "#c9714e"], 833, chip_m=0.03))
    tools = [box((x, -0.09, 0.005), (x + 0.014, 0.1, 0.008), 0.012, steel, skip="z") for x in (-0.165, 0.15)]
    return shadeless(joined([mat, dish, well, *tools]))


def _open_carton() -> Piece:
    card = pt.plain("#bb9162", 840, grain=0.08)
    label = pt.checks(["#f0e6d0", "#3a3230", "#f0e6d0", "#c25a3c"], 0.02, 841)
    w, d, h = 0.24, 0.18, 0.30
    parts = [box((-w, -d, 0.0), (w, d, h), 0.016, card, skip="Z")]
    parts.append(rect((-0.1, -d - 0.002, 0.1), (0.2, 0, 0), (0, 0, 0.12), 0.008, label))
    parts.append(rect((-w, -d, 0.02), (2 * w, 0, 0), (0, 2 * d, 0), 0.03, card))
    flap = 0.14
    for corner, u_edge, v_edge in (
        ((-w, -d, h), (2 * w, 0, 0), (0, -0.8 * flap, 0.45 * flap)),
        ((w, d, h), (-2 * w, 0, 0), (0, 0.9 * flap, -0.35 * flap)),
        ((w, -d, h), (0, 2 * d, 0), (0.7 * flap, 0, 0.6 * flap)),
        ((-w, d, h), (0, -2 * d, 0), (-0.95 * flap, 0, 0.1 * flap)),
    ):
        parts.append(rect(corner, u_edge, v_edge, 0.02, card))
    cuddly = [
        ball((-0.05, 0.02, 0.28), 0.09, 0.012, pt.plain("#c98f5c", 842, grain=0.2)),
        ball((-0.11, 0.0, 0.36), 0.035, 0.012, pt.plain("#a8703f", 843, grain=0.2)),
        ball((0.02, 0.0, 0.36), 0.035, 0.012, pt.plain("#a8703f", 843, grain=0.2)),
    ]
    tube_ = rod(
        (0.12, 0.05, 0.03),
        (0.17, 0.08, 0.52),
        0.025,
        0.015,
        pt.stripes(["#e9dfc9", "#3d6470"], [0.03, 0.03], 844),
        sides=12,
    )
    return joined([parts[0], *map(shadeless, parts[1:]), *map(shadeless, cuddly), shadeless(tube_)])


def _toys() -> Piece:
    """A tower of blocks and some that fell, a ball."""
    codes = ("#d9482f", "#e8b13c", "#3f7fa6", "#5f9a50", "#e8dcc4", "#c9714e")
    size = 0.075
    spots = (
        (0, 0, 0, 5),
        (0.08, 0.0, 0, 20),
        (0.04, 0.01, 1, 35),
        (0.035, 0.0, 2, -10),
        (0.26, 0.12, 0, 40),
        (-0.14, 0.16, 0, 70),
        (0.17, -0.19, 0, 15),
        (-0.22, -0.08, 0, 28),
    )
    parts = []
    for k, (x, y, level, yaw) in enumerate(spots):
        paint = pt.plain(codes[k % 6], 850 + k, grain=0.1, grain_m=0.009, patch=0.0, fleck=0.2)
        block = rounded_box((-size / 2, -size / 2, 0), (size / 2, size / 2, size), 0.005, 0.0094, paint)
        parts.append(placed(block, (x, y, level * (size + 0.0005) + 0.001), yaw))
    sections = pt.stripes(["#d9482f", "#f3ead6", "#3f7fa6", "#f3ead6"], [0.06, 0.06, 0.06, 0.06], 860)
    return joined([*parts, ball((0.42, -0.28, 0.11), 0.11, 0.01, sections)])


def _pouf() -> Piece:
    knit = pt.stripes(["#e0b14e", "#d9a743", "#b8842f"], [0.022, 0.022, 0.0168], 870)
    body = lathe(
        (0, 0, 0.002),
        [(0.2, 0), (0.27, 0.06), (0.29, 0.18), (0.26, 0.31), (0.18, 0.365), (0.06, 0.375)],
        90,
        knit,
        cell_m=0.013,
    )
    lid = disc((0, 0, 0.3765), 0.062, 0.012, pt.plain("#b8842f", 871))
    return shadeless(joined([body, lid])) + Piece((), (((-0.22, -0.22, 0.0), (0.22, 0.22, 0.33)),))


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
        placed(_fruit_bowl(890), _on(COFFEE_AT_M, -0.32, 0.1, coffee)),
        placed(_mug(red), _on(COFFEE_AT_M, 0.02, 0.14, coffee), 40.0),
        placed(_mug(blue), _on(COFFEE_AT_M, -0.1, -0.17, coffee), 200.0),
        placed(shadeless(magazine), _on(COFFEE_AT_M, -0.36, -0.14, coffee), 68.0),
        placed(shadeless(remote), _on(COFFEE_AT_M, 0.06, -0.2, coffee), 100.0),
        placed(flowers(), _on(TABLE_AT_M, 0.02, 0.02, table)),
        placed(_place_setting(), _on(TABLE_AT_M, -0.38, -0.26, table)),
        placed(_place_setting(), _on(TABLE_AT_M, -0.36, 0.27, table), 180.0),
        placed(_mug(blue), _on(TABLE_AT_M, -0.1, 0.26, table), 20.0),
        placed(_mug(red), _on(TABLE_AT_M, 0.36, -0.22, table), 120.0),
        placed(_fruit_bowl(891), _on(SIDEBOARD_AT_M, -0.22, 0.15, board)),
        placed(trailing_plant(), _on(SIDEBOARD_AT_M, -0.24, 0.52, board), -90.0),
    ]


def decor() -> Piece:
    """All small and hanging things, where they belong in the room."""
    palm = placed(potted_palm(), (0.42, 2.02, 0.0), 25.0)
    shelf_plant = placed(trailing_plant(), (-3.02, 0.82, 2.2215), 90.0)
    cactus = placed(trailing_plant(), (CONSOLE_AT_M[0] - 0.78, CONSOLE_AT_M[1] + 0.2, 0.5205), 180.0)
    return joined(
        [
            placed(_rug(), (-1.25, 0.30, 0.0)),
            *_hung(),
            placed(_clock(), (X1 - 0.035, 0.32, 2.17), -90.0),
            _floor_lamp(),
            _pendant(),
            palm,
            shelf_plant,
            cactus,
            *_tableware(),
            placed(_open_carton(), (0.45, -2.1, 0.0), 170.0),
            placed(_toys(), (0.35, -1.15, 0.0)),
            placed(_pouf(), (-2.35, -0.75, 0.0)),
        ]
    )
