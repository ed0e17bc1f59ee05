# SPDX-License-Identifier: GPL-3.0-or-later
"""What offices and kitchens are fitted with: desks, screens, chairs, boards; units, worktop, stove, fridge."""

import numpy as np

from . import surfaces as pt
from .finishes import desktop, landscape, noticeboard, tiles, whiteboard
from .surfaces import (
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
    thing,
    tilted,
    tube,
)
from .things import BLACK, mug, stack, vase

_GREY = pt.plain("#8d9094", 1700, grain=0.12)
_DARK = pt.plain("#34353a", 1701, grain=0.2)
DESK_M = 0.74  # height of a desk's top


@thing("table")
def desk(width_m: float, timber: Painter, *, depth_m: float = 0.78, drawers: bool = True) -> Piece:
    """A desk about its origin; who sits at it sits at -y and looks towards +y."""
    w, d = width_m / 2, depth_m / 2
    parts = [rounded_box((-w, -d, DESK_M - 0.03), (w, d, DESK_M), 0.006, 0.018, timber)]
    for x in (-w + 0.05, w - 0.05):
        parts.append(box((x - 0.025, -d + 0.05, 0.0), (x + 0.025, -d + 0.1, DESK_M - 0.03), 0.03, _GREY, skip="zZ"))
        parts.append(box((x - 0.025, d - 0.1, 0.0), (x + 0.025, d - 0.05, DESK_M - 0.03), 0.03, _GREY, skip="zZ"))
        parts.append(shadeless(box((x - 0.025, -d + 0.1, 0.03), (x + 0.025, d - 0.1, 0.07), 0.03, _GREY)))
    parts.append(shadeless(box((-w + 0.08, d - 0.09, 0.35), (w - 0.08, d - 0.075, DESK_M - 0.03), 0.025, _GREY)))
    if drawers:
        parts.append(placed(pedestal("#c9ccd0"), (w - 0.32, d - 0.12, 0.0)))
    return joined(parts)


@thing("cabinet")
def pedestal(code: str) -> Piece:
    """Three drawers on castors, 0.4 m wide, the back at y = 0."""
    steel = pt.plain(code, 1705, grain=0.08)
    parts = [box((-0.2, -0.52, 0.05), (0.2, 0.0, 0.6), 0.022, steel, skip="z")]
    for k in range(3):
        z = 0.065 + 0.178 * k
        parts.append(shadeless(box((-0.19, -0.535, z), (0.19, -0.52, z + 0.168), 0.018, steel, skip="Y")))
        parts.append(shadeless(box((-0.06, -0.55, z + 0.12), (0.06, -0.535, z + 0.135), 0.015, _DARK, skip="Y")))
    parts += [shadeless(ball((x, y, 0.025), 0.025, 0.015, _DARK)) for x in (-0.16, 0.16) for y in (-0.46, -0.06)]
    return joined(parts)


@thing("screen")
def monitor(seed: int, *, width_m: float = 0.6) -> Piece:
    """A screen on its foot, about the origin, facing -y."""
    w, h, low = width_m / 2, 0.57 * width_m, 0.14
    rim = 0.012
    parts = [
        box((-w, -0.01, low), (w, 0.025, low + h), 0.03, _DARK, skip="y"),
        rect((-w, -0.01, low), (2 * w, 0, 0), (0, 0, rim), 0.02, _DARK),
        rect((-w, -0.01, low + h - rim), (2 * w, 0, 0), (0, 0, rim), 0.02, _DARK),
        rect((-w, -0.01, low + rim), (rim, 0, 0), (0, 0, h - 2 * rim), 0.02, _DARK),
        rect((w - rim, -0.01, low + rim), (rim, 0, 0), (0, 0, h - 2 * rim), 0.02, _DARK),
    ]
    inner_w, inner_h = 2 * (w - rim), h - 2 * rim
    image = desktop(inner_w, inner_h, seed)
    parts.append(rect((-w + rim, -0.009, low + rim), (inner_w, 0, 0), (0, 0, inner_h), 0.0092, image, glow=0.9))
    parts.append(rod((0.0, 0.035, 0.01), (0.0, 0.03, low + 0.1), 0.018, 0.03, _GREY))
    parts.append(box((-0.12, -0.07, 0.0), (0.12, 0.11, 0.01), 0.02, _GREY, skip="z"))
    return shadeless(joined(parts)) + Piece((), (((-w, -0.01, low), (w, 0.025, low + h)),))


@thing("keyboard")
def keyboard() -> Piece:
    """A keyboard and a mouse, about the origin."""
    keys = pt.checks(["#3a3b40", "#2c2d31", "#45464b", "#d8d6cf"], 0.019, 1710)
    board = box((-0.22, -0.07, 0.0), (0.22, 0.07, 0.018), 0.0095, keys, skip="z")
    mouse = rounded_box((0.29, -0.05, 0.0), (0.35, 0.05, 0.03), 0.014, 0.012, _DARK, arc=3)
    return shadeless(joined([board, mouse]))


def workplace(seed: int, timber: Painter, *, width_m: float = 1.6, screens: int = 2) -> Piece:
    """A desk with screens, keyboard, papers, a mug and books, as someone has left it."""
    parts = [desk(width_m, timber)]
    for k in range(screens):
        x = (k - (screens - 1) / 2) * 0.63 - 0.1
        turn = -14.0 * (k - (screens - 1) / 2)
        parts.append(placed(monitor(seed + k), (x, 0.18, DESK_M), turn + pt.pick(seed, 40 + k, -5.0, 5.0)))
    parts.append(placed(keyboard(), (-0.1, -0.13, DESK_M + 0.0005), pt.pick(seed, 50, -6.0, 6.0)))
    parts.append(placed(papers(seed), (-width_m / 2 + 0.22, -0.1, DESK_M + 0.0005), pt.pick(seed, 51, -25.0, 25.0)))
    codes = ("#c9553c", "#3d6470", "#e0b14e", "#5f9a50")
    glaze = pt.terrazzo(codes[seed % 4], ["#f3e6d0"], seed, chip_m=0.02)
    parts.append(placed(mug(glaze), (width_m / 2 - 0.5, -0.05, DESK_M + 0.0005), pt.pick(seed, 52, 0.0, 360.0)))
    books = stack(2 + seed % 3, 700 + seed % 90, 10.0)
    parts.append(placed(shadeless(books), (width_m / 2 - 0.19, 0.12, DESK_M + 0.0005), pt.pick(seed, 53, -20.0, 20.0)))
    return joined(parts)


@thing("paper")
def papers(seed: int) -> Piece:
    """A few printed sheets lying askew, about the origin."""
    parts = []
    for k in range(3):
        page = noticeboard(9.0, 9.0, seed + k) if k == 1 else whiteboard(9.0, 9.0, seed + k)
        leaf = rect(
            (-0.105, -0.148, 0.001 * (k + 1)), (0.21, 0, 0), (0, 0.297, 0), 0.0095, page, start_m=(0.62 * k, 0.46)
        )
        parts.append(placed(leaf, (0.02 * k, 0.015 * k, 0.0), pt.pick(seed, 60 + k, -20.0, 20.0)))
    return joined(parts)


@thing("chair")
def swivel_chair(cloth: Painter) -> Piece:
    """An office chair on five castors, about its origin, looking towards +y."""
    parts = [
        rounded_box((-0.24, -0.22, 0.44), (0.24, 0.25, 0.52), 0.035, 0.021, cloth, arc=3, bulge_m=0.015),
        placed(
            tilted(
                rounded_box((-0.22, -0.03, 0.0), (0.22, 0.035, 0.55), 0.03, 0.021, cloth, arc=3, bulge_m=0.015), 0, 9.0
            ),
            (0, -0.25, 0.6),
        ),
        shadeless(tube([(0, -0.1, 0.45), (0, -0.24, 0.44), (0, -0.29, 0.55), (0, -0.31, 0.75)], 0.02, 8, _DARK)),
        shadeless(rod((0, 0, 0.1), (0, 0, 0.45), 0.028, 0.04, _GREY, sides=12)),
    ]
    for k in range(5):
        a = 2 * np.pi * (k + 0.25) / 5
        x, y = 0.3 * float(np.cos(a)), 0.3 * float(np.sin(a))
        parts.append(shadeless(rod((0, 0, 0.12), (x, y, 0.075), 0.02, 0.04, _DARK)))
        parts.append(shadeless(ball((x, y, 0.033), 0.033, 0.016, _DARK)))
    for x in (-0.28, 0.28):
        parts.append(shadeless(rounded_box((x - 0.03, -0.14, 0.66), (x + 0.03, 0.13, 0.69), 0.012, 0.018, _DARK)))
        parts.append(shadeless(tube([(x * 0.8, 0.0, 0.46), (x, 0.0, 0.5), (x, 0.0, 0.66)], 0.014, 8, _DARK)))
    return joined(parts)


@thing("board")
def board(width_m: float, height_m: float, seed: int, *, pinned: bool = False) -> Piece:
    """A whiteboard, or one of cork, on the wall at y = 0, its lower edge at z = 0, in the middle of x = 0."""
    w = width_m / 2
    face = noticeboard(width_m, height_m, seed) if pinned else whiteboard(width_m, height_m, seed)
    rim = pt.wood("#b58a58", "#8f6238", seed) if pinned else _GREY
    parts = [rect((-w, -0.012, 0.0), (width_m, 0, 0), (0, 0, height_m), 0.012, face)]
    for low, high in (
        ((-w - 0.02, -0.022, -0.02), (w + 0.02, 0.0, 0.0)),
        ((-w - 0.02, -0.022, height_m), (w + 0.02, 0.0, height_m + 0.02)),
        ((-w - 0.02, -0.022, 0.0), (-w, 0.0, height_m)),
        ((w, -0.022, 0.0), (w + 0.02, 0.0, height_m)),
    ):
        parts.append(box(low, high, 0.018, rim, skip="Y"))
    if not pinned:
        parts.append(box((-0.25, -0.075, -0.035), (0.25, -0.0, -0.02), 0.018, _GREY, skip="Y"))
        for k, code in enumerate(("#1f4f9c", "#b3261e", "#1d6b3a")):
            pen = pt.plain(code, 1720 + k)
            parts.append(
                rod((-0.2 + 0.15 * k, -0.045, -0.011), (-0.09 + 0.15 * k, -0.05, -0.011), 0.009, 0.03, pen, sides=6)
            )
    return shadeless(joined(parts))


@thing("cabinet")
def cabinet_row(count: int, codes: list[str], height_m: float, seed: int) -> Piece:
    """Steel cupboards beside each other, 0.8 m each, with lateral drawers; the middle of the row at x = 0."""
    parts = []
    rows = max(2, round(height_m / 0.4))
    for k in range(count):
        x = (k - count / 2) * 0.8
        steel = pt.plain(codes[k % len(codes)], seed + k, grain=0.07, patch=0.06)
        parts.append(box((x + 0.003, -0.45, 0.02), (x + 0.797, 0.0, height_m), 0.022, steel, skip="Yz"))
        for j in range(rows):
            z, step = 0.03 + j * (height_m - 0.04) / rows, (height_m - 0.04) / rows
            parts.append(
                shadeless(
                    box((x + 0.012, -0.465, z + 0.006), (x + 0.788, -0.45, z + step - 0.006), 0.02, steel, skip="Y")
                )
            )
            parts.append(
                shadeless(
                    box((x + 0.3, -0.482, z + step - 0.06), (x + 0.5, -0.465, z + step - 0.042), 0.016, _DARK, skip="Y")
                )
            )
            label = whiteboard(9.0, 9.0, seed + 7 * k + j)
            parts.append(
                rect(
                    (x + 0.06, -0.4655, z + step - 0.09), (0.14, 0, 0), (0, 0, 0.06), 0.0095, label, start_m=(0.1, 0.05)
                )
            )
    return joined(parts)


@thing("lamp")
def ceiling_light(centre_m: Point, size_m: tuple[float, float]) -> Piece:
    """A flat luminaire below the ceiling; its light is a lamp of the room's lighting."""
    x, y, z = centre_m
    w, d = size_m[0] / 2, size_m[1] / 2
    frame = box((x - w, y - d, z - 0.05), (x + w, y + d, z), 0.03, _GREY, skip="zZ")
    shine = pt.plain("#fbfaf2", 1730, grain=0.05, grain_m=0.03, patch=0.02)
    face = rect((x - w, y + d, z - 0.045), (2 * w, 0, 0), (0, -2 * d, 0), 0.03, shine, glow=1.0)
    return shadeless(frame) + face


@thing("lamp")
def tube_light(start_m: Point, length_m: float, ceiling_m: float, *, along_x: bool = True) -> Piece:
    """A slim lamp that hangs on two wires."""
    x, y, z = start_m
    dx, dy = (length_m, 0.0) if along_x else (0.0, length_m)
    shine = pt.plain("#fbfaf2", 1731, grain=0.05, grain_m=0.03, patch=0.02)
    w = 0.05
    low, high = (x - w, y - w, z), (x + dx + w, y + dy + w, z + 0.05)
    parts = [box(low, high, 0.03, _DARK, skip="z")]
    parts.append(rect((low[0], high[1], z), (high[0] - low[0], 0, 0), (0, low[1] - high[1], 0), 0.03, shine, glow=1.0))
    for share in (0.08, 0.92):
        at = (x + dx * share, y + dy * share)
        parts.append(rod((*at, z + 0.05), (*at, ceiling_m), 0.003, 0.1, _GREY, sides=5))
    return shadeless(joined(parts))


@thing("bin")
def bin_(code: str, seed: int) -> Piece:
    """A waste bin with crumpled paper."""
    wire = pt.checks([code, "#26262a", code, code], 0.022, seed)
    parts = [
        lathe((0, 0, 0), [(0.11, 0.0), (0.14, 0.3), (0.135, 0.3), (0.128, 0.2)], 28, wire, cell_m=0.011),
        disc((0, 0, 0.2), 0.13, 0.02, wire),
    ]
    for k in range(5):
        at = (0.06 * float(np.cos(1.3 * k)), 0.06 * float(np.sin(1.3 * k)), 0.235 + 0.012 * k)
        parts.append(ball(at, 0.045, 0.012, pt.plain("#efece2", seed + k, grain=0.3)))
    return shadeless(joined(parts)) + Piece((), (((-0.1, -0.1, 0.0), (0.1, 0.1, 0.28)),))


@thing("printer")
def printer() -> Piece:
    """An office printer on its stand, 0.6 m wide, its back at y = 0."""
    shell, dark = pt.plain("#e3e2dc", 1740, grain=0.07), _DARK
    parts = [
        box((-0.3, -0.55, 0.0), (0.3, 0.0, 0.62), 0.022, shell, skip="Yz"),
        rounded_box((-0.33, -0.58, 0.62), (0.33, 0.0, 0.98), 0.03, 0.02, shell),
        shadeless(box((-0.24, -0.6, 0.74), (0.24, -0.58, 0.8), 0.02, dark, skip="Y")),
        shadeless(rounded_box((-0.3, -0.5, 0.98), (0.3, -0.02, 1.06), 0.02, 0.02, dark)),
        shadeless(rect((0.06, -0.583, 0.86), (0.2, 0, 0), (0, 0, 0.08), 0.0095, desktop(0.2, 0.08, 1741), glow=0.6)),
    ]
    trays = [(0.05 + 0.18 * k, 0.21 + 0.18 * k) for k in range(3)]
    parts += [shadeless(box((-0.28, -0.565, low), (0.28, -0.55, high), 0.02, shell, skip="Y")) for low, high in trays]
    return joined(parts)


@thing("partition")
def screen_wall(width_m: float, height_m: float, cloth: Painter) -> Piece:
    """A padded partition between desks, standing on the origin along x."""
    w = width_m / 2
    parts = [rounded_box((-w, -0.03, 0.1), (w, 0.03, height_m), 0.02, 0.023, cloth)]
    parts += [shadeless(box((x - 0.02, -0.2, 0.0), (x + 0.02, 0.2, 0.1), 0.03, _GREY)) for x in (-w + 0.1, w - 0.1)]
    return joined(parts)


@thing("water cooler")
def water_cooler() -> Piece:
    """A cooler with its bottle, the back at y = 0."""
    shell = pt.plain("#e6e6e2", 1750, grain=0.07)
    water = pt.plain("#9cc4d8", 1751, grain=0.12, patch=0.2)
    parts = [
        rounded_box((-0.16, -0.34, 0.0), (0.16, 0.0, 0.98), 0.025, 0.02, shell),
        shadeless(box((-0.11, -0.345, 0.62), (0.11, -0.338, 0.86), 0.018, _DARK, skip="Y")),
        shadeless(
            lathe(
                (0, -0.17, 0.98),
                [(0.06, 0.0), (0.135, 0.06), (0.14, 0.2), (0.132, 0.22), (0.14, 0.24), (0.135, 0.38), (0.05, 0.4)],
                32,
                water,
                cell_m=0.014,
            )
        ),
        shadeless(disc((0, -0.17, 1.379), 0.051, 0.015, water)),
    ]
    return joined(parts)


@thing("table")
def conference_table(length_m: float, width_m: float, timber: Painter) -> Piece:
    """A long table on two legs, about its origin, its top at DESK_M, with a sunk box for cables."""
    w, d = length_m / 2, width_m / 2
    parts = [rounded_box((-w, -d, DESK_M - 0.04), (w, d, DESK_M), 0.012, 0.0125, timber)]
    for x in (-0.6 * w, 0.6 * w):
        parts.append(box((x - 0.04, -0.55 * d, 0.03), (x + 0.04, 0.55 * d, DESK_M - 0.04), 0.025, timber, skip="zZ"))
        parts.append(shadeless(box((x - 0.07, -0.75 * d, 0.0), (x + 0.07, 0.75 * d, 0.03), 0.025, _DARK)))
    parts.append(shadeless(box((-0.2, -0.06, DESK_M), (0.2, 0.06, DESK_M + 0.004), 0.016, _DARK, skip="z")))
    return joined(parts)


@thing("laptop")
def laptop(seed: int) -> Piece:
    """An open laptop, about the origin; who uses it sits at -y."""
    keys = pt.checks(["#55565b", "#3a3b40", "#2c2d31", "#6b6c72"], 0.018, seed)
    base = box((-0.17, -0.12, 0.0), (0.17, 0.12, 0.016), 0.0095, keys, skip="z")
    lid = box((-0.17, 0.0, 0.0), (0.17, 0.008, 0.225), 0.02, _GREY, skip="y")
    lid += rect((-0.17, -0.0005, 0.0), (0.34, 0, 0), (0, 0, 0.225), 0.0085, desktop(0.34, 0.225, seed), glow=0.9)
    return shadeless(joined([base, placed(tilted(lid, 0, -18.0), (0.0, 0.115, 0.016))]))


# A fitted kitchen along a wall: units, worktop, sink, stove, wall units, fridge. Its back is at y = 0.


_CHROME = pt.plain("#b9bcbd", 1600, grain=0.12)
_ENAMEL = pt.plain("#ece9e1", 1601, grain=0.06)
TOP_M = 0.92
DEPTH_M = 0.62


@thing("cabinet")
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


@thing("cabinet")
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


@thing("fridge")
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


@thing("wall")
def splashback(width_m: float, codes: list[str], seed: int, *, low_m: float = TOP_M, high_m: float = 1.48) -> Piece:
    """Tiles on the wall between worktop and wall units, from x = 0 on."""
    paint = tiles(codes, "#d9d3c6", (0.15, 0.07), seed, bond=0.5)
    return rect((0.0, -0.006, low_m), (width_m, 0, 0), (0, 0, high_m - low_m), 0.0125, paint)


@thing("kitchenware")
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
