# SPDX-License-Identifier: GPL-3.0-or-later
"""Small things that make a room lived in: lamps, tableware, toys, books, vases, plants."""

from dataclasses import dataclass, replace

import numpy as np

from . import finishes as pic
from . import surfaces as pt
from .surfaces import (
    Array,
    Painter,
    Piece,
    Point,
    ball,
    box,
    disc,
    grid,
    joined,
    lathe,
    placed,
    rect,
    rod,
    rounded_box,
    shadeless,
    sheet,
    thing,
    tilted,
    tube,
)

BRASS = pt.plain("#b8924a", 700, grain=0.14)
BLACK = pt.plain("#35322f", 701, grain=0.2)


RUG = pic.rug(2.6, 1.8, 711)


@thing("rug")
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


@thing("picture")
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


@thing("clock")
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


@thing("lamp")
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


@thing("lamp")
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


@thing("tableware")
def mug(paint: Painter) -> Piece:
    """A mug of coffee."""
    t = np.arange(9) / 8.0 * np.pi
    handle = [(0.038 + 0.026 * float(np.sin(a)), 0.0, 0.05 - 0.028 * float(np.cos(a))) for a in t]
    body = lathe(
        (0, 0, 0), [(0.034, 0), (0.040, 0.01), (0.040, 0.095), (0.036, 0.096), (0.036, 0.07)], 24, paint, cell_m=0.007
    )
    return joined([body, disc((0, 0, 0.078), 0.0365, 0.009, pt.plain("#4a2d1a", 810)), tube(handle, 0.0055, 6, paint)])


@thing("tableware")
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


@thing("tableware")
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


@thing("box")
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


@thing("toy")
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


@thing("stool")
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


# Books, one by one, in rows and in stacks; vases; shelves full of both.


OAK = pt.wood("#c9a06c", "#94683c", 501)
SHELF_BACK = pt.wood("#a9794b", "#6f4a2b", 540)


def _spine(width_m: float, height_m: float, seed: int) -> Painter:
    """The back of a book: ground, bands, and a title of little marks."""
    grounds = (
        "#7d2e2a",
        "#274a63",
        "#d9c9a3",
        "#3f5d45",
        "#c98f3c",
        "#54345a",
        "#b7563a",
        "#1f2d3a",
        "#8fa7a3",
        "#e7dcc4",
        "#6b4a33",
        "#a33b4b",
        "#3c7a80",
        "#d8b23f",
    )
    inks = ("#e9cf86", "#f3ead6", "#2a2523")
    number = int(pt.pick(seed, 7, 0, len(grounds)))
    ground = pt.colour(grounds[number])
    ink = pt.colour(inks[2] if number in (2, 9, 13) else inks[seed % 2])
    style = seed // 3 % 4

    def paint(u: Array, v: Array) -> Array:
        wear = 0.88 + 0.2 * pt.hash01(np.floor(u / 0.006), np.floor(v / 0.012), seed)
        rgb = ground * wear[..., None]
        h = v / height_m
        bands = (abs(h - 0.90) < 0.018) | (abs(h - 0.10) < 0.018)
        if style == 1:
            bands |= (abs(h - 0.82) < 0.012) | (abs(h - 0.18) < 0.012)
        if style == 2:
            bands = (h > 0.66) & (h < 0.86)
        rgb = np.where(bands[..., None], ink, rgb)
        inside = (u > 0.22 * width_m) & (u < 0.78 * width_m)
        title = (
            inside & (h > 0.3) & (h < 0.62) & (pt.hash01(np.floor(u / 0.007), np.floor(v / 0.0085), seed + 1) > 0.42)
        )
        return np.where(title[..., None], ink, rgb)

    return paint


@thing("book")
def book(width_m: float, height_m: float, depth_m: float, seed: int) -> Piece:
    """An upright book on the origin with its spine at y = 0 and its pages behind."""
    spine = _spine(width_m, height_m, seed)
    cover_rgb = spine(np.full((1, 1), 0.001), np.full((1, 1), 0.5 * height_m))[0, 0]

    def bound(u: Array, v: Array) -> Array:
        return cover_rgb * np.ones_like(u + v)[..., None]

    pages = pt.plain("#e3d6b8", seed, grain=0.1, patch=0.0)
    back = rect((0, 0, 0), (width_m, 0, 0), (0, 0, height_m), 0.009, spine)
    sides = box((0, 0, 0), (width_m, depth_m, height_m), 0.4, bound, skip="yYzZ")
    top = rect((0, 0, height_m - 0.003), (width_m, 0, 0), (0, depth_m, 0), 0.016, pages)
    return shadeless(joined([back, sides, top]))


def book_row(length_m: float, room_m: float, seed: int) -> Piece:
    """Books from x = 0 on, the last one leaning, in a shelf room_m high."""
    parts: list[Piece] = []
    x, k = 0.004, 0
    while True:
        number = seed * 40 + k
        width = pt.pick(number, 1, 0.018, 0.052)
        height = min(pt.pick(number, 2, 0.17, 0.30), room_m - 0.025)
        if x + width > length_m - 0.075:
            break
        parts.append(placed(book(width, height, 0.19, number), (x, pt.pick(number, 3, 0.0, 0.03), 0.0)))
        x += width + 0.0022
        k += 1
    last = placed(tilted(book(0.026, 0.215, 0.18, seed * 40 + 39), 1, -13.0), (x + 0.001, 0.01, 0.0062))
    return joined([*parts, last])


def stack(count: int, seed: int, yaw_deg: float = 0.0) -> Piece:
    """Books lying on each other, spines to the front."""
    parts, z = [], 0.0
    for k in range(count):
        number = seed * 40 + k
        thick, long_ = pt.pick(number, 1, 0.022, 0.045), pt.pick(number, 2, 0.2, 0.27)
        flat = placed(tilted(book(thick, long_, 0.17, number), 1, 90.0), (-long_ / 2, 0.0, thick))
        parts.append(placed(flat, (0.0, 0.0, z), yaw_deg + pt.pick(number, 3, -8, 8)))
        z += thick + 0.001
    return joined(parts)


@thing("vase")
def vase(seed: int, height_m: float, paint: Painter) -> Piece:
    """A vase on the origin; seed decides how wide it is."""
    h = height_m
    wide = 0.3 + 0.1 * (seed % 3)
    outline = [(0.18 * h, 0), (wide * h, 0.35 * h), (wide * 0.85 * h, 0.6 * h), (0.12 * h, 0.85 * h), (0.17 * h, h)]
    return lathe((0, 0, 0), outline, 28, paint, cell_m=0.009)


_GLAZES = (
    pt.terrazzo("#e8dcc4", ["#c9714e", "#35525f", "#e0b14e"], 530, chip_m=0.028),
    pt.stripes(["#3d6470", "#e9dfc9", "#3d6470", "#c25a3c"], [0.02, 0.02, 0.02, 0.02], 531),
    pt.checks(["#c25a3c", "#b4553a", "#d98b5f", "#8a3f2c"], 0.02, 532),
)


@dataclass(frozen=True)
class Shelf:
    """A bookshelf against the wall at y = 0: its size, and how many compartments it has beside and above each other."""

    width_m: float = 2.46
    height_m: float = 2.22
    depth_m: float = 0.32
    bays: int = 3
    levels: int = 6
    timber: Painter = OAK
    back: Painter = SHELF_BACK
    seed: int = 600
    odd: tuple[tuple[int, int], ...] = ((1, 0), (6, 1), (8, 2), (10, 1), (15, 2), (17, 0))  # compartment, what it holds


def _shelf_fill(shelf: Shelf, number: int, width_m: float, room_m: float) -> Piece:
    """The content of one compartment; the origin is its lower left front corner."""
    odd = dict(shelf.odd)
    if number not in odd:
        return book_row(width_m, room_m, shelf.seed + number)
    kind = odd[number]
    things = [placed(vase(number, 0.21, _GLAZES[kind]), (0.14, 0.14, 0.0))]
    things.append(placed(book_row(width_m - 0.30, room_m, shelf.seed + 40 + number), (0.29, 0.0, 0.0)))
    if kind == 2:
        things[1] = placed(stack(5, shelf.seed + 60 + number), (0.46, 0.04, 0.0))
    return joined(things)


@thing("shelf")
def bookshelf(shelf: Shelf) -> Piece:
    """A bookshelf full of books, its back at y = 0."""
    t, w, h, d, timber = 0.024, shelf.width_m, shelf.height_m, shelf.depth_m, shelf.timber
    parts = [rect((-w / 2, -0.012, 0), (w, 0, 0), (0, 0, h), 0.035, shelf.back)]
    bay = (w - t) / shelf.bays
    for k in range(shelf.bays + 1):
        x = -w / 2 + k * bay
        parts.append(box((x, -d, 0.0), (x + t, -0.013, h), 0.03, timber, skip="zY"))
    gap = (h - 0.08 - t) / shelf.levels
    for level in range(shelf.levels + 1):
        z = 0.08 + level * gap
        for k in range(shelf.bays):
            x = -w / 2 + k * bay + t
            parts.append(box((x, -d + 0.004, z), (x + bay - t, -0.013, z + t), 0.03, timber, skip="xXY"))
            if level < shelf.levels:
                fill = _shelf_fill(shelf, k + shelf.bays * level, bay - t, gap - t)
                parts.append(placed(fill, (x, -d + 0.035, z + t)))
                block = ((x + 0.01, -d + 0.06, z + t), (x + bay - t - 0.08, -0.03, z + 0.7 * gap))
                parts.append(Piece((), (block,)))
    plinth = box((-w / 2 + t, -d + 0.03, 0.0), (w / 2 - t, -d + 0.045, 0.08), 0.02, timber, skip="xXzZ")
    return joined([*parts, shadeless(plinth)])


# A palm, trailing pot plants and tulips: many thin leaves, each a small sheet.


def _blade(base_m: Array, along: Array, size_m: tuple[float, float, float], paint: Painter) -> Piece:
    """A narrow leaf from base_m in the direction along, bending down towards its tip; size_m: length, width, droop."""
    length_m, width_m, droop_m = size_m
    t = np.arange(8) / 7.0
    spine = base_m + along * (length_m * t)[:, None] - np.array([0, 0, 1.0]) * (droop_m * t * t)[:, None]
    aside = np.array([-along[1], along[0], 0.0])
    aside = aside / max(float(np.sqrt((aside * aside).sum())), 1e-6)
    half = 0.5 * width_m * np.maximum(4 * t * (1 - t), 0.07) + 0.0005
    s = np.array([-1.0, 0.0, 1.0])
    points = spine[:, None] + aside * (half[:, None] * s)[..., None]
    points = points - np.array([0, 0, 0.25]) * (half[:, None] * abs(s))[..., None]
    u, v = grid(s * width_m, t * length_m)
    return Piece((sheet(points, paint(u + base_m[0], v + base_m[2])),))


def _palm(fronds: int, height_m: float, seed: int) -> Piece:
    """Arching fronds with two rows of narrow leaves, out of the origin."""
    parts: list[Piece] = []
    leaf = [
        pt.plain(c, seed + k, grain=0.16, patch=0.0) for k, c in enumerate(("#4f8a4a", "#3b7040", "#6fa354", "#2f5f3a"))
    ]
    stem = pt.plain("#8aa05a", seed + 9, grain=0.1, patch=0.0)
    for k in range(fronds):
        yaw = 2.399963 * k + 0.3 * pt.pick(k, seed)
        rise = height_m * pt.pick(k, seed + 1, 0.55, 1.0)
        reach = pt.pick(k, seed + 2, 0.22, 0.52) * (1.25 - 0.5 * rise / height_m)
        out = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        t = np.arange(15) / 14.0
        line = (
            out * (reach * t * t)[:, None]
            + np.array([0, 0, 1.0]) * (rise * (1.25 * t - 0.3 * t**3))[:, None]
            + out * 0.03
        )
        parts.append(tube([tuple(p) for p in line], 0.0055 - 0.0035 * t, 5, stem))
        for j in range(5, 15):
            ahead = line[j] - line[j - 1]
            ahead = ahead / np.sqrt((ahead * ahead).sum())
            for side in (-1.0, 1.0):
                across = np.array([-out[1], out[0], 0.0]) * side
                along = 0.62 * ahead + 0.78 * across
                length = 0.21 * (1 - 0.05 * abs(j - 9)) * pt.pick(j * 2 + int(side > 0), seed + k, 0.85, 1.1)
                parts.append(_blade(line[j], along, (length, 0.022, 0.07), leaf[(j + k) % 4]))
    return joined(parts)


@thing("plant")
def potted_palm() -> Piece:
    """A palm, 1.5 m with its banded clay pot, standing on the origin."""
    pot = pt.stripes(["#c9714e", "#c9714e", "#f0e2c8", "#2f5a55", "#f0e2c8"], [0.16, 0.03, 0.014, 0.024, 0.014], 790)

    def rings(u: Array, v: Array) -> Array:
        return pot(v, u)

    outline = [(0.12, 0.0), (0.165, 0.24), (0.185, 0.33), (0.192, 0.345), (0.18, 0.35), (0.17, 0.33)]
    body = lathe((0, 0, 0), outline, 40, rings, cell_m=0.012)
    soil = disc((0, 0, 0.325), 0.172, 0.016, pt.plain("#4a3524", 791, grain=0.5))
    blocker = Piece((), (((-0.15, -0.15, 0.0), (0.15, 0.15, 0.33)),))
    return shadeless(joined([body, soil, placed(_palm(16, 1.15, 792), (0, 0, 0.32))])) + blocker


@thing("plant")
def trailing_plant() -> Piece:
    """A small pot whose shoots hang down in front (-y)."""
    parts = [
        lathe(
            (0, 0, 0), [(0.055, 0), (0.08, 0.13), (0.07, 0.13)], 24, pt.plain("#e8e0cf", 800, grain=0.08), cell_m=0.01
        )
    ]
    parts.append(disc((0, 0, 0.127), 0.0715, 0.012, pt.plain("#4a3524", 806, grain=0.5)))
    leaf = [pt.plain(c, 801 + k, grain=0.14, patch=0.0) for k, c in enumerate(("#5f9a50", "#86b565", "#427a44"))]
    stem = pt.plain("#6b8a48", 805, patch=0.0)
    for k in range(11):
        yaw = -np.pi / 2 + 0.27 * (k - 5)
        out = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        fall = pt.pick(k, 806, 0.15, 0.62)
        t = np.arange(13) / 12.0
        line = (
            out * (0.02 + 0.16 * np.minimum(1.0, 2.2 * t))[:, None]
            + np.array([0, 0, 1.0]) * (0.13 + 0.05 * t - fall * t * t)[:, None]
        )
        parts.append(tube([tuple(p) for p in line], 0.002, 4, stem))
        for j in range(2, 13):
            side = np.array([np.cos(yaw + 1.3 * (-1) ** j), np.sin(yaw + 1.3 * (-1) ** j), 0.1])
            parts.append(_blade(line[j], side, (0.075, 0.05, 0.02), leaf[(j + k) % 3]))
    return joined(parts)


@thing("plant")
def flowers() -> Piece:
    """A jug of tulips."""
    jug = pt.terrazzo("#f0e8d6", ["#3d6470", "#7fa0a8"], 820, chip_m=0.022)
    parts = [
        lathe((0, 0, 0), [(0.05, 0), (0.075, 0.06), (0.07, 0.13), (0.04, 0.19), (0.055, 0.22)], 28, jug, cell_m=0.008)
    ]
    green = pt.plain("#5f8f48", 821, grain=0.12)
    codes = ("#d9482f", "#e8b13c", "#e07a8c", "#f3e6d0", "#c23b5a")
    for k in range(11):
        yaw, reach, top = 2.4 * k, pt.pick(k, 822, 0.03, 0.17), pt.pick(k, 823, 0.34, 0.48)
        x, y = reach * float(np.cos(yaw)), reach * float(np.sin(yaw))
        parts.append(tube([(0.15 * x, 0.15 * y, 0.18), (0.5 * x, 0.5 * y, 0.3), (x, y, top)], 0.003, 5, green))
        petal = pt.stripes([codes[k % 5], codes[(k + 1) % 5]], [0.014, 0.004], 824 + k)
        parts.append(
            lathe(
                (x, y, top - 0.01),
                [(0.008, 0), (0.024, 0.014), (0.026, 0.035), (0.014, 0.056)],
                10,
                petal,
                cell_m=0.008,
            )
        )
        out = np.array([np.cos(yaw + 1), np.sin(yaw + 1), 0.9])
        parts.append(_blade(np.array([0, 0, 0.2]), out * 0.7, (0.2, 0.03, 0.05), green))
    return joined(parts)
