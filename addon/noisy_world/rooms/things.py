# SPDX-License-Identifier: GPL-3.0-or-later
"""What makes a room lived in: rug, frames, lamps, clock, tableware, toys. Each about its own origin."""

from dataclasses import replace

import numpy as np

from . import patterns as pt
from . import pictures as pic
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

BRASS = pt.plain("#b8924a", 700, grain=0.14)
BLACK = pt.plain("#35322f", 701, grain=0.2)


RUG = pic.rug(2.6, 1.8, 711)


def rug(paint: Painter = RUG, hem_code: str = "#7c3022", size_m: tuple[float, float] = (2.6, 1.8)) -> Piece:
    """A rug about the origin with tassels at its short sides; painted from its corner on."""
    length, width = size_m
    columns, rows = round(length / 0.0095), round(width / 0.0095)
    u, v = np.meshgrid(np.arange(columns + 1) * (length / columns), np.arange(rows + 1) * (width / rows))
    z = 0.011 + 0.002 * pt.noise(u / 0.3, v / 0.3, 710)
    top = sheet(np.stack([u - length / 2, v - width / 2, z], -1), paint(u, v))
    hem = box(
        (-length / 2, -width / 2, 0.002), (length / 2, width / 2, 0.011), 0.02, pt.plain(hem_code, 712), skip="zZ"
    )
    wool = pt.plain("#e6d8bb", 713, grain=0.1, patch=0.0)
    tassels = []
    count = round((width - 0.03) / 0.0295)
    for k in range(count + 1):
        y = -width / 2 + 0.015 + k * (width - 0.03) / count
        for side in (-1, 1):
            x = side * length / 2
            tip = (x + side * 0.055, y + pt.pick(k, 714 + side, -0.012, 0.012), 0.004)
            tassels.append(tube([(x, y, 0.008), (x + side * 0.03, y, 0.006), tip], 0.0035, 5, wool))
    return Piece((top,)) + shadeless(joined([hem, *tassels]))


def framed(width_m: float, height_m: float, paint: Painter, frame: Painter, *, mat_m: float = 0.0) -> Piece:
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


def clock() -> Piece:
    """A round wall clock about the origin, facing -y: a drum with a dial, built lying down and stood up."""
    dial = disc((0, 0, 0), 0.17, 0.008, pic.clock_face(0.17))
    rim = lathe((0, 0, -0.03), [(0.168, 0), (0.186, 0.01), (0.186, 0.03), (0.168, 0.042)], 48, BLACK, cell_m=0.008)
    ink = pt.plain("#1f1c1a", 760)
    hands = [
        placed(box((-0.006, -0.02, 0.006), (0.006, 0.085, 0.010), 0.006, ink), (0, 0, 0), 58.0),
        placed(box((-0.004, -0.025, 0.012), (0.004, 0.13, 0.015), 0.006, ink), (0, 0, 0), -60.0),
    ]
    return tilted(shadeless(joined([dial, rim, *hands])), 0, 90.0)


SHADE = pt.stripes(["#ffe7b0", "#f0cb86"], [0.044, 0.022], 770)


def floor_lamp(bulb_m: Point, shade: Painter = SHADE) -> Piece:
    """A lamp that stands on the floor below its bulb."""
    x, y, z = bulb_m
    parts = [
        lathe((x, y, 0), [(0.15, 0.0), (0.15, 0.012), (0.13, 0.022), (0.012, 0.026)], 32, BLACK, cell_m=0.012),
        rod((x, y, 0.02), (x, y, z - 0.06), 0.0095, 0.015, BRASS),
        lathe((x, y, z - 0.16), [(0.21, 0.0), (0.14, 0.30)], 80, shade, cell_m=0.012, glow=0.9),
        _glowing(ball((x, y, z), 0.035, 0.02, pt.plain("#fff8e2", 771, grain=0.0, patch=0.0))),
        tube([(x, y, z - 0.06), (x, y, z - 0.03)], 0.014, 8, BRASS),
        tube([(x + 0.03, y, z - 0.04), (x + 0.03, y, z - 0.16), (x + 0.03, y, z - 0.25)], 0.0022, 5, BRASS),
    ]
    spokes = [
        rod((x, y, z - 0.045), (x + 0.19 * a, y + 0.19 * b, z - 0.1), 0.003, 0.03, BRASS, sides=5)
        for a, b in ((1, 0), (-0.5, 0.86), (-0.5, -0.86))
    ]
    return shadeless(joined([*parts, *spokes]))


PENDANT_CODES = ["#2f5a55", "#c9a35e", "#2f5a55", "#244843", "#2f5a55", "#c9a35e"]


def pendant(bulb_m: Point, ceiling_m: float, codes: list[str] = PENDANT_CODES) -> Piece:
    """A lamp with a striped shade of metal, on a cord from the ceiling."""
    x, y, z = bulb_m
    outline = [(0.25, 0.0), (0.235, 0.05), (0.18, 0.13), (0.09, 0.185), (0.03, 0.20), (0.026, 0.25)]
    low = z - 0.03
    middle = min(low + 0.6, (low + 0.25 + ceiling_m) / 2)
    bands = pt.stripes(codes, [0.12, 0.012, 0.05, 0.008, 0.06, 0.012], 780)

    def rings(u: Array, v: Array) -> Array:
        return bands(v + 0.11, u)

    glow = pt.plain("#ffedc4", 781, grain=0.03)
    parts = [
        lathe((x, y, low), outline, 48, rings, cell_m=0.01),
        lathe((x, y, low), [(r - 0.004, h) for r, h in reversed(outline[:5])], 48, glow, cell_m=0.015, glow=0.9),
        tube([(x, y, low + 0.25), (x, y, middle), (x, y, ceiling_m - 0.03)], 0.005, 6, BLACK),
        lathe((x, y, ceiling_m - 0.035), [(0.01, 0.0), (0.05, 0.012), (0.055, 0.035)], 20, BRASS),
        _glowing(ball((x, y, z + 0.03), 0.04, 0.02, pt.plain("#fff8e2", 782, grain=0.0, patch=0.0))),
    ]
    lid = disc((x, y, low + 0.25), 0.026, 0.01, BLACK)
    return shadeless(joined([*parts, lid]))


def _glowing(piece: Piece) -> Piece:
    return Piece(tuple(replace(s, glow=1.0) for s in piece.sheets))


def mug(paint: Painter) -> Piece:
    """A mug of coffee."""
    t = np.arange(9) / 8.0 * np.pi
    handle = [(0.038 + 0.026 * float(np.sin(a)), 0.0, 0.05 - 0.028 * float(np.cos(a))) for a in t]
    body = lathe(
        (0, 0, 0), [(0.034, 0), (0.040, 0.01), (0.040, 0.095), (0.036, 0.096), (0.036, 0.07)], 24, paint, cell_m=0.007
    )
    return joined([body, disc((0, 0, 0.078), 0.0365, 0.009, pt.plain("#4a2d1a", 810)), tube(handle, 0.0055, 6, paint)])


def fruit_bowl(seed: int) -> Piece:
    """A bowl with five fruits."""
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


def place_setting() -> Piece:
    """A mat with a plate, a knife and a fork."""
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


def open_carton() -> Piece:
    """An open carton with a soft toy and a roll of paper in it."""
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


def toys() -> Piece:
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


POUF_CODES = ["#e0b14e", "#d9a743", "#b8842f"]


def pouf(codes: list[str] = POUF_CODES) -> Piece:
    """A knitted pouf."""
    knit = pt.stripes(codes, [0.022, 0.022, 0.0168], 870)
    body = lathe(
        (0, 0, 0.002),
        [(0.2, 0), (0.27, 0.06), (0.29, 0.18), (0.26, 0.31), (0.18, 0.365), (0.06, 0.375)],
        90,
        knit,
        cell_m=0.013,
    )
    lid = disc((0, 0, 0.3765), 0.062, 0.012, pt.plain(codes[2], 871))
    return shadeless(joined([body, lid])) + Piece((), (((-0.22, -0.22, 0.0), (0.22, 0.22, 0.33)),))
