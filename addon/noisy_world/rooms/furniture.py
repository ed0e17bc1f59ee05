# SPDX-License-Identifier: GPL-3.0-or-later
"""Sofa, tables, chairs, cabinets and the bookshelf.

A piece is built about its own origin on the floor with its front towards -y, and then placed in the room.
"""

import numpy as np

from . import surfaces as pt
from .finishes import screen
from .surfaces import (
    Painter,
    Piece,
    Point,
    ball,
    box,
    disc,
    joined,
    lathe,
    pillow,
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
from .things import BLACK, BRASS, OAK, Shelf, book_row, bookshelf, stack

WALNUT = pt.wood("#9a6b45", "#57371f", 500)
STEEL = pt.plain("#4a4744", 502, grain=0.18)


SOFA_CLOTH = pt.weave("#4f7f88", "#a9c5c4", 510, thread_m=0.02)


@thing("sofa")
def sofa(cloth: Painter = SOFA_CLOTH) -> Piece:
    """A sofa for three with cushions and a throw."""
    cell = 0.0205
    parts = [
        rounded_box((-1.05, -0.40, 0.12), (1.05, 0.44, 0.31), 0.03, cell, cloth),
        rounded_box((-1.07, -0.44, 0.12), (-0.87, 0.44, 0.62), 0.07, cell, cloth, arc=4),
        rounded_box((0.87, -0.44, 0.12), (1.07, 0.44, 0.62), 0.07, cell, cloth, arc=4),
        rounded_box((-0.88, 0.24, 0.28), (0.88, 0.45, 0.80), 0.07, cell, cloth, arc=4),
    ]
    for k in range(3):
        x = -0.865 + 0.577 * k
        parts.append(rounded_box((x, -0.46, 0.30), (x + 0.572, 0.26, 0.455), 0.05, cell, cloth, arc=4, bulge_m=0.015))
        back = rounded_box((-0.28, -0.09, 0.0), (0.28, 0.08, 0.43), 0.07, cell, cloth, arc=4, bulge_m=0.03)
        parts.append(shadeless(placed(tilted(back, 0, -9), (x + 0.286, 0.165, 0.455))))
    parts += [
        lathe((x, y, 0.0), [(0.014, 0.0), (0.026, 0.125)], 10, WALNUT) for x in (-0.96, 0.96) for y in (-0.32, 0.36)
    ]
    mustard = pt.terrazzo("#dba63f", ["#f5e6c0", "#b5653a", "#f5e6c0"], 511, chip_m=0.04)
    rust = pt.stripes(["#b4553a", "#ecd9b8", "#b4553a", "#2f4a5c", "#ecd9b8"], [0.04, 0.016, 0.03, 0.016, 0.016], 512)
    patch = pt.checks(["#ecdfc6", "#c9714e", "#e0b14e", "#35525f", "#7fa093"], 0.055, 513)
    for paint, x, y, size, lean, yaw in (
        (mustard, -0.66, -0.03, 0.46, -22, 14),
        (patch, 0.62, -0.03, 0.46, -22, -16),
        (rust, 0.36, -0.10, 0.40, -26, -6),
    ):
        cushion = tilted(placed(pillow(size, size, 0.17, 0.0115, paint), (0, 0, size / 2)), 0, lean)
        parts.append(placed(cushion, (x, y, 0.475), yaw))
    return joined([*parts, _blanket()])


def _blanket() -> Piece:
    """A striped throw over the right arm."""
    line = [
        (0.863, 0.48),
        (0.863, 0.565),
        (0.885, 0.61),
        (0.935, 0.629),
        (1.005, 0.629),
        (1.055, 0.61),
        (1.078, 0.56),
        (1.08, 0.30),
    ]
    profile = np.array(line)
    at = np.append(0, np.sqrt((np.diff(profile, axis=0) ** 2).sum(-1)).cumsum())
    fine = np.linspace(0, at[-1], 48)
    v, u = np.meshgrid(np.linspace(0, 0.46, 40), fine)
    ripple = 0.004 * np.sin(v * 40 + 3 * u) + 0.004
    x = np.interp(fine, at, profile[:, 0])[:, None] + np.where(u > at[5], ripple, 0)
    z = np.interp(fine, at, profile[:, 1])[:, None] + np.where(u > at[5], 0, ripple)
    paint = pt.stripes(
        ["#efe3cb", "#c25a3c", "#efe3cb", "#e0b14e", "#efe3cb", "#3d6470"], [0.05, 0.03, 0.02, 0.03, 0.02, 0.03], 514
    )
    return Piece((sheet(np.stack([x, v - 0.3, z], -1)[:, ::-1], paint(u, v)[:, ::-1]),))


@thing("table")
def coffee_table(timber: Painter = WALNUT) -> Piece:
    """A low table of 1.16 x 0.62 m, its top at 0.432 m, on thin legs."""
    top = rounded_box((-0.58, -0.31, 0.405), (0.58, 0.31, 0.432), 0.01, 0.011, timber)
    rail = [rod((-0.52, y, 0.397), (0.52, y, 0.397), 0.008, 0.03, STEEL, sides=6) for y in (-0.25, 0.25)] + [
        rod((x, -0.25, 0.397), (x, 0.25, 0.397), 0.008, 0.03, STEEL, sides=6) for x in (-0.52, 0.52)
    ]
    legs = []
    for x in (-1, 1):
        for y in (-1, 1):
            legs.append(rod((x * 0.53, y * 0.27, 0.008), (x * 0.50, y * 0.24, 0.405), 0.009, 0.02, STEEL))
            legs.append(rod((x * 0.50, y * 0.19, 0.405), (x * 0.53, y * 0.265, 0.008), 0.007, 0.02, STEEL))
    return top + shadeless(joined([*rail, *legs]))


@thing("table")
def dining_table(timber: Painter = OAK) -> Piece:
    """A table of 1.6 x 0.9 m, its top at 0.752 m."""
    top = rounded_box((-0.8, -0.45, 0.722), (0.8, 0.45, 0.752), 0.012, 0.012, timber)
    apron = [
        box((-0.70, -0.37, 0.64), (0.70, -0.35, 0.722), 0.02, timber, skip="Z"),
        box((-0.70, 0.35, 0.64), (0.70, 0.37, 0.722), 0.02, timber, skip="Z"),
        box((-0.72, -0.35, 0.64), (-0.70, 0.35, 0.722), 0.02, timber, skip="Z"),
        box((0.70, -0.35, 0.64), (0.72, 0.35, 0.722), 0.02, timber, skip="Z"),
    ]
    legs = [
        box((x - 0.03, y - 0.03, 0.0), (x + 0.03, y + 0.03, 0.722), 0.018, timber, skip="zZ")
        for x in (-0.74, 0.74)
        for y in (-0.39, 0.39)
    ]
    return joined([top, *map(shadeless, apron), *legs])


CHAIR_WOOD = pt.wood("#7a4f31", "#47291a", 520)


@thing("chair")
def chair(seat_paint: Painter, dark: Painter = CHAIR_WOOD) -> Piece:
    """A spindle-back chair with a padded seat; it looks towards -y."""
    parts = [
        rounded_box((-0.22, -0.22, 0.425), (0.22, 0.21, 0.45), 0.01, 0.016, dark),
        shadeless(rounded_box((-0.205, -0.205, 0.449), (0.205, 0.18, 0.482), 0.014, 0.0115, seat_paint, bulge_m=0.012)),
    ]
    for x in (-1, 1):
        parts.append(rod((x * 0.215, -0.215, 0.0), (x * 0.185, -0.185, 0.43), 0.014, 0.045, dark))
        parts.append(rod((x * 0.205, 0.235, 0.0), (x * 0.19, 0.19, 0.45), 0.014, 0.045, dark))
        parts.append(rod((x * 0.19, 0.19, 0.44), (x * 0.20, 0.275, 0.94), 0.013, 0.045, dark))
        parts.append(rod((x * 0.203, -0.2, 0.2), (x * 0.2, 0.215, 0.2), 0.008, 0.045, dark, sides=6))
    parts.append(rod((-0.2, 0.0, 0.2), (0.2, 0.0, 0.2), 0.008, 0.045, dark, sides=6))
    rail = rounded_box((-0.215, -0.012, 0.0), (0.215, 0.012, 0.075), 0.01, 0.016, dark)
    parts.append(shadeless(placed(tilted(rail, 0, -9.5), (0, 0.265, 0.875))))
    parts.append(
        shadeless(
            placed(
                tilted(rounded_box((-0.19, -0.008, 0), (0.19, 0.008, 0.03), 0.006, 0.014, dark), 0, -9.5),
                (0, 0.213, 0.56),
            )
        )
    )
    for k in range(6):
        x = 0.062 * (k - 2.5)
        parts.append(rod((x * 0.95, 0.216, 0.58), (x, 0.269, 0.885), 0.0075, 0.045, dark, sides=6))
    blockers = (((-0.2, 0.2, 0.55), (0.2, 0.28, 0.62)), ((-0.21, 0.24, 0.87), (0.21, 0.29, 0.95)))
    return joined(parts) + Piece((), blockers)


DOOR_WOOD = pt.wood("#b98a5a", "#7d5532", 550)


@thing("cabinet")
def cabinet(size_m: Point, doors: int, paint: Painter, face: Painter = DOOR_WOOD) -> Piece:
    """A low cupboard on thin legs with slatted doors and small knobs, its back at y = 0; size: width, height, depth."""
    width_m, height_m, depth_m = size_m
    w, d, foot = width_m / 2, depth_m, 0.14
    parts = [box((-w, -d, foot), (w, -0.012, height_m), 0.016, paint, skip="Yz")]
    brass = pt.plain("#c19a4b", 551, grain=0.12)
    step = (width_m - 0.04) / doors
    for k in range(doors):
        a, b = -w + 0.02 + k * step + 0.008, -w + 0.02 + (k + 1) * step - 0.008
        low, high = foot + 0.028, height_m - 0.034
        parts.append(shadeless(box((a, -d - 0.012, low), (b, -d, high), 0.02, face, skip="Y")))
        slats = int((high - low - 0.05) / 0.032)
        for j in range(slats):
            z = low + 0.03 + 0.032 * j
            parts.append(
                shadeless(box((a + 0.04, -d - 0.02, z), (b - 0.04, -d - 0.012, z + 0.018), 0.02, face, skip="Y"))
            )
        x = b - 0.02 if k % 2 == 0 else a + 0.02
        parts.append(
            shadeless(
                box(
                    (x - 0.006, -d - 0.036, 0.62 * height_m),
                    (x + 0.006, -d - 0.012, 0.62 * height_m + 0.07),
                    0.008,
                    brass,
                    skip="Y",
                )
            )
        )
    parts += [
        shadeless(rod((x, y, 0.0), (x * 0.96, y, foot), 0.013, 0.02, STEEL))
        for x in (-w + 0.08, w - 0.08)
        for y in (-d + 0.06, -0.08)
    ]
    return joined(parts)


@thing("screen")
def television() -> Piece:
    """A flat screen on two feet, 1.24 m wide."""
    black = pt.plain("#2b2a2c", 560, grain=0.15)
    w, h = 1.24, 0.70
    frame = box((-w / 2, -0.02, 0.07), (w / 2, 0.02, 0.07 + h), 0.03, black, skip="y")
    rim = 0.013
    edge = [rect((-w / 2, -0.02, z), (w, 0, 0), (0, 0, rim), 0.02, black) for z in (0.07, 0.07 + h - rim)] + [
        rect((x, -0.02, 0.07 + rim), (rim, 0, 0), (0, 0, h - 2 * rim), 0.02, black) for x in (-w / 2, w / 2 - rim)
    ]
    image = rect(
        (-w / 2 + rim, -0.0185, 0.07 + rim),
        (w - 2 * rim, 0, 0),
        (0, 0, h - 2 * rim),
        0.0085,
        screen(w - 2 * rim, h - 2 * rim, 561),
        glow=0.85,
    )
    feet = [box((x - 0.012, -0.11, 0.0), (x + 0.012, 0.11, 0.012), 0.02, black) for x in (-0.45, 0.45)]
    posts = [box((x - 0.01, -0.012, 0.012), (x + 0.01, 0.012, 0.07), 0.02, black) for x in (-0.45, 0.45)]
    return joined([frame, *edge, image, *map(shadeless, feet + posts)])


# Where pieces stand: like every size in this room, designed, not measured.
TABLE_AT_M = (1.72, 0.30, 0.0)
SIDEBOARD_AT_M = (3.228, -0.95, 0.0)
CONSOLE_AT_M = (-1.30, -2.468, 0.0)
COFFEE_AT_M = (-1.25, 0.42, 0.0)


def furniture() -> Piece:
    """All large pieces, where they belong in the room."""
    seats = [
        pt.weave("#c9714e", "#f0d9b5", 570, thread_m=0.014),
        pt.weave("#e0b14e", "#7d5532", 571, thread_m=0.014),
        pt.weave("#4f7f88", "#e9dfc9", 572, thread_m=0.014),
        pt.weave("#c9714e", "#f0d9b5", 573, thread_m=0.014),
    ]
    x, y, _ = TABLE_AT_M
    chairs = ((x - 0.38, y - 0.52, 176), (x + 0.40, y - 0.70, 165), (x - 0.36, y + 0.56, 3), (x + 0.42, y + 0.55, -6))
    cream = pt.wood("#e3d9c3", "#bfae8d", 580)
    return joined(
        [
            placed(sofa(), (-1.30, 1.86, 0.0)),
            placed(coffee_table(), COFFEE_AT_M),
            placed(dining_table(), TABLE_AT_M),
            *(placed(chair(p), (cx, cy, 0.0), yaw) for p, (cx, cy, yaw) in zip(seats, chairs, strict=True)),
            placed(bookshelf(Shelf()), (-3.228, 0.0, 0.0), 90.0),
            placed(cabinet((1.8, 0.52, 0.40), 4, WALNUT), CONSOLE_AT_M, 180.0),
            placed(television(), (CONSOLE_AT_M[0], CONSOLE_AT_M[1] + 0.2, 0.5205), 180.0),
            placed(cabinet((1.5, 0.84, 0.42), 3, cream), SIDEBOARD_AT_M, -90.0),
            placed(shadeless(stack(3, 690, 15)), (COFFEE_AT_M[0] + 0.28, COFFEE_AT_M[1] - 0.12, 0.4325)),
            placed(shadeless(stack(4, 691, -10)), (SIDEBOARD_AT_M[0] - 0.22, SIDEBOARD_AT_M[1] - 0.35, 0.841), -90.0),
            placed(shadeless(stack(2, 692, 8)), (TABLE_AT_M[0] + 0.5, TABLE_AT_M[1] + 0.15, 0.753), 30.0),
        ]
    )


# Beds, wardrobes, chests, armchairs, shelves, and what stands in halls.
#
# A piece has its back at y = 0, or is about its own origin where its docstring says so.


@thing("bed")
def bed(width_m: float, timber: Painter, cover: Painter, linen: Painter, cushion: Painter) -> Piece:
    """A bed with a headboard, pillows and a quilt that hangs over its sides; 2.1 m long."""
    w = width_m / 2
    parts = [
        rounded_box((-w - 0.04, -0.07, 0.0), (w + 0.04, 0.0, 1.08), 0.02, 0.018, timber),
        box((-w, -2.08, 0.16), (w, -0.07, 0.31), 0.022, timber, skip="Y"),
        rounded_box((-w + 0.01, -2.05, 0.31), (w - 0.01, -0.08, 0.52), 0.06, 0.022, linen, arc=3),
        *(box((x - 0.03, -2.06, 0.0), (x + 0.03, -2.0, 0.16), 0.02, timber) for x in (-w + 0.05, w - 0.05)),
        shadeless(_coverlet(w, cover)),
    ]
    for k, x in enumerate((-w / 2, w / 2) if width_m > 1.2 else (0.0,)):
        for j, (paint, size, y, lean) in enumerate(((linen, 0.66, -0.17, -28.0), (cushion, 0.44, -0.36, -34.0))):
            soft = tilted(placed(pillow(size, 0.45 - 0.06 * j, 0.17, 0.013, paint), (0, 0, 0.2)), 0, lean)
            parts.append(placed(soft, (x, y - 0.07, 0.52), 7.0 * (-1) ** (k + j)))
    return joined(parts)


def _coverlet(half_m: float, paint: Painter) -> Piece:
    """A quilt over the mattress from y = -2.12 to -0.75, in one sheet with folds where it hangs."""
    drop = 0.30
    across = np.linspace(-half_m - drop, half_m + drop, round((2 * half_m + 2 * drop) / 0.013) + 1)
    along = np.linspace(0.0, 1.36 + drop, round((1.36 + drop) / 0.013) + 1)
    a, b = np.meshgrid(across, along)
    side, foot = np.maximum(abs(a) - half_m - 0.012, 0.0), np.maximum(b - 1.36, 0.0)
    fold = 0.018 * np.sin(9.0 * b + 2.0 * np.sign(a)) * np.minimum(side / 0.15, 1.0)
    fold_foot = 0.015 * np.sin(11.0 * a) * np.minimum(foot / 0.15, 1.0)
    x = np.sign(a) * (np.minimum(abs(a), half_m + 0.012) + fold + 0.06 * side)
    y = -0.74 - np.minimum(b, 1.36) - 0.06 * foot - abs(fold_foot)
    puff = 0.012 * np.sin(a * 22.0) * np.sin(b * 22.0)
    z = 0.545 + np.where((side == 0) & (foot == 0), puff, 0.0) - np.maximum(side, foot)
    return Piece((sheet(np.stack([x, y, z], -1)[::-1], paint(a + 5, b)[::-1]),))


@thing("cabinet")
def drawers(size_m: Point, columns: int, rows: int, timber: Painter, face: Painter) -> Piece:
    """A chest of drawers with knobs; size: width, height, depth."""
    w, h, d = size_m[0] / 2, size_m[1], size_m[2]
    parts = [box((-w, -d, 0.05), (w, 0.0, h), 0.018, timber, skip="Yz")]
    parts.append(shadeless(box((-w + 0.02, -d + 0.03, 0.0), (w - 0.02, 0.0, 0.05), 0.03, BLACK, skip="YzZ")))
    step_x, step_z = (2 * w - 0.02) / columns, (h - 0.08) / rows
    for i in range(columns):
        for j in range(rows):
            x, z = -w + 0.01 + i * step_x, 0.065 + j * step_z
            front = box(
                (x + 0.006, -d - 0.016, z + 0.006), (x + step_x - 0.006, -d, z + step_z - 0.006), 0.018, face, skip="Y"
            )
            parts.append(shadeless(front))
            middle = (x + step_x / 2, -d - 0.03, z + step_z * 0.55)
            parts.append(shadeless(ball(middle, 0.017, 0.008, BRASS)))
    return joined(parts)


@thing("cabinet")
def wardrobe(size_m: Point, doors: int, timber: Painter, face: Painter) -> Piece:
    """A wardrobe with panelled doors and a cornice; size: width, height, depth."""
    w, h, d = size_m[0] / 2, size_m[1], size_m[2]
    parts = [
        box((-w, -d, 0.08), (w, 0.0, h), 0.02, timber, skip="Yz"),
        shadeless(box((-w + 0.02, -d + 0.03, 0.0), (w - 0.02, 0.0, 0.08), 0.03, timber, skip="YzZ")),
        shadeless(box((-w - 0.03, -d - 0.03, h), (w + 0.03, 0.0, h + 0.06), 0.025, timber, skip="Y")),
    ]
    step = 2 * w / doors
    for k in range(doors):
        a, b = -w + k * step + 0.005, -w + (k + 1) * step - 0.005
        parts.append(shadeless(box((a, -d - 0.02, 0.1), (b, -d, h - 0.02), 0.018, face, skip="Y")))
        for low, high in ((0.18, 0.42 * h), (0.46 * h, h - 0.1)):
            parts.append(
                shadeless(box((a + 0.07, -d - 0.032, low), (b - 0.07, -d - 0.02, high), 0.018, timber, skip="Y"))
            )
        x = b - 0.035 if k % 2 == 0 else a + 0.035
        parts.append(shadeless(rod((x, -d - 0.04, 0.98), (x, -d - 0.04, 1.14), 0.008, 0.02, BRASS)))
    return joined(parts)


@thing("chair")
def armchair(cloth: Painter, legs: Painter) -> Piece:
    """A wide chair with arms, about its origin, looking towards -y."""
    cell = 0.019
    parts = [
        rounded_box((-0.36, -0.36, 0.16), (0.36, 0.34, 0.3), 0.03, cell, cloth),
        rounded_box((-0.27, -0.4, 0.29), (0.27, 0.22, 0.45), 0.05, cell, cloth, arc=3, bulge_m=0.02),
        rounded_box((-0.42, -0.38, 0.16), (-0.27, 0.36, 0.6), 0.06, cell, cloth, arc=3),
        rounded_box((0.27, -0.38, 0.16), (0.42, 0.36, 0.6), 0.06, cell, cloth, arc=3),
        placed(
            tilted(
                rounded_box((-0.36, -0.08, 0.0), (0.36, 0.08, 0.62), 0.07, cell, cloth, arc=3, bulge_m=0.02), 0, -10
            ),
            (0, 0.26, 0.28),
        ),
    ]
    parts += [
        shadeless(rod((x, y, 0.0), (0.9 * x, 0.9 * y, 0.17), 0.018, 0.03, legs))
        for x in (-0.34, 0.34)
        for y in (-0.32, 0.3)
    ]
    return joined(parts)


@thing("radiator")
def radiator(width_m: float) -> Piece:
    """A ribbed radiator on the wall."""
    enamel = pt.plain("#e9e6dc", 1500, grain=0.07, grain_m=0.02)
    count = round(width_m / 0.06)
    ribs = [
        rounded_box(
            (-width_m / 2 + 0.06 * k, -0.11, 0.14), (-width_m / 2 + 0.06 * k + 0.05, -0.035, 0.72), 0.02, 0.045, enamel
        )
        for k in range(count)
    ]
    pipe = [rod((-width_m / 2, -0.07, z), (width_m / 2 - 0.01, -0.07, z), 0.012, 0.05, enamel) for z in (0.17, 0.69)]
    feet = [
        rod((x, -0.07, 0.0), (x, -0.07, 0.15), 0.012, 0.03, enamel) for x in (-width_m / 2 + 0.025, width_m / 2 - 0.035)
    ]
    block = Piece((), (((-width_m / 2, -0.1, 0.14), (width_m / 2, -0.03, 0.7)),))
    return shadeless(joined([*ribs, *pipe, *feet])) + block


@thing("shelf")
def wall_shelf(width_m: float, timber: Painter, seed: int) -> Piece:
    """A board on two brackets with books on it, its top at z = 0."""
    w = width_m / 2
    parts = [rounded_box((-w, -0.22, -0.03), (w, 0.0, 0.0), 0.006, 0.014, timber)]
    arms = [[(x, -0.2, -0.03), (x, -0.02, -0.03), (x, -0.012, -0.16)] for x in (-w + 0.12, w - 0.12)]
    parts += [shadeless(tube(arm, 0.007, 6, BLACK)) for arm in arms]
    parts.append(placed(book_row(width_m - 0.03, 0.33, seed), (-w + 0.02, -0.205, 0.001)))
    return joined(parts)


@thing("rack")
def coat_rack(width_m: float, timber: Painter, codes: list[str], seed: int) -> Piece:
    """A board with hooks at eye height, and a coat on all but one of them."""
    w = width_m / 2
    parts = [box((-w, -0.025, 1.66), (w, 0.0, 1.78), 0.018, timber, skip="Y")]
    count = round(width_m / 0.26)
    for k in range(count):
        x = -w + (k + 0.5) * width_m / count
        hook = [(x, -0.025, 1.74), (x, -0.075, 1.73), (x, -0.085, 1.76)]
        parts.append(tube(hook, 0.007, 6, BRASS))
        if k != count // 2:
            parts.append(placed(_coat(codes[k % len(codes)], seed + k), (x, -0.02, 0.0)))
    return shadeless(joined(parts)) + Piece((), (((-w, -0.16, 0.75), (w, -0.03, 1.66)),))


def _coat(code: str, seed: int) -> Piece:
    """A coat that hangs from 1.74 m: a body in folds with a buttoned front, a collar, two sleeves."""
    cloth = (
        pt.weave(code, "#d8c8b0", seed, thread_m=0.02)
        if seed % 2
        else pt.checks([code, code, "#3a3430", "#8c7a62"], 0.045, seed)
    )
    v, a = np.meshgrid(np.linspace(0.0, 1.0, 60), np.linspace(0.0, 2 * np.pi, 61), indexing="ij")
    half = np.interp(v, [0.0, 0.03, 0.05, 0.1, 0.45, 1.0], [0.045, 0.05, 0.075, 0.15, 0.14, 0.175])
    fold = 1.0 + 0.2 * np.sin(6 * a + seed) * np.maximum(v - 0.25, 0.0)
    long_ = 0.85 + 0.2 * pt.pick(seed, 3)
    x, y = 0.82 * half * np.cos(a) * fold, -0.085 + np.minimum(0.07, 0.8 * half) * np.sin(a) * fold
    points = np.stack([x, y, 1.73 - long_ * v], -1)[::-1]
    front = abs(a - 1.5 * np.pi)
    button = (front < 0.16) & (front > 0.05) & (abs(v * 9 % 1.0 - 0.5) < 0.12) & (v > 0.12) & (v < 0.8)
    rgb = np.where((front < 0.05)[..., None], 0.55, 1.0) * cloth(a * 0.17, v * long_)
    rgb = np.where(button[..., None], 0.12, rgb)
    sleeves = [
        tube([(0.09 * s, -0.09, 1.64), (0.125 * s, -0.1, 1.52), (0.13 * s, -0.11, 1.3), (0.12 * s, -0.125, 1.08)],
             np.array([0.03, 0.045, 0.042, 0.036]), 14, cloth)
        for s in (-1, 1)
    ]  # fmt: skip
    return joined([Piece((sheet(points, rgb[::-1]),)), *sleeves])


@thing("bench")
def bench(width_m: float, timber: Painter, cushion: Painter) -> Piece:
    """A bench with a cushion and boots below it."""
    w = width_m / 2
    parts = [
        rounded_box((-w, -0.38, 0.41), (w, -0.02, 0.45), 0.01, 0.016, timber),
        shadeless(rounded_box((-w + 0.03, -0.37, 0.45), (w - 0.03, -0.03, 0.51), 0.025, 0.016, cushion, bulge_m=0.01)),
        shadeless(box((-w + 0.02, -0.36, 0.13), (w - 0.02, -0.04, 0.15), 0.03, timber)),
    ]
    parts += [box((x - 0.02, -0.36, 0.0), (x + 0.02, -0.04, 0.41), 0.022, timber) for x in (-w + 0.04, w - 0.04)]
    tones = ("#6b3f26", "#2f3d52", "#a8412f", "#45502f", "#3a3430", "#c9a35e")
    for k in range(int((width_m - 0.25) / 0.26)):
        x = -w + 0.14 + 0.26 * k
        skin = pt.plain(tones[k % 6], 1520 + k, grain=0.2, fleck=0.1)
        parts += [shadeless(_shoe(x + dx, skin)) for dx in (0.0, 0.105)]
    return joined(parts)


def _shoe(x_m: float, skin: Painter) -> Piece:
    return rounded_box((x_m, -0.34, 0.151), (x_m + 0.09, -0.08, 0.24), 0.04, 0.02, skin, arc=3)


@thing("lamp")
def table_lamp(base: Painter, shade: Painter) -> Piece:
    """A lamp to stand on something; its bulb is 0.38 m above the origin."""
    parts = [
        lathe((0, 0, 0), [(0.07, 0), (0.09, 0.05), (0.085, 0.12), (0.03, 0.2), (0.02, 0.24)], 28, base, cell_m=0.009),
        lathe((0, 0, 0.25), [(0.15, 0.0), (0.1, 0.21)], 48, shade, cell_m=0.011, glow=0.85),
        tube([(0, 0, 0.23), (0, 0, 0.35)], 0.008, 6, BRASS),
        disc((0, 0, 0.459), 0.099, 0.02, shade, glow=0.85),
    ]
    return shadeless(joined(parts))


@thing("table")
def mirror_table(timber: Painter) -> Piece:
    """A narrow hall table with a bowl's shelf, 0.9 m wide, its top at 0.8 m."""
    parts = [
        rounded_box((-0.45, -0.3, 0.77), (0.45, 0.0, 0.8), 0.008, 0.013, timber),
        box((-0.41, -0.27, 0.66), (0.41, -0.02, 0.77), 0.018, timber, skip="Z"),
        shadeless(box((-0.43, -0.28, 0.2), (0.43, -0.02, 0.22), 0.02, timber)),
    ]
    parts += [
        box((x - 0.018, y - 0.018, 0.0), (x + 0.018, y + 0.018, 0.77), 0.02, timber, skip="zZ")
        for x in (-0.42, 0.42)
        for y in (-0.27, -0.03)
    ]
    return joined(parts)


@thing("basket")
def basket(code: str, seed: int) -> Piece:
    """A round wicker basket with rolled blankets, about its origin."""
    wicker = pt.weave(code, "#6b4a2b", seed, thread_m=0.022)
    outline = [(0.17, 0.0), (0.22, 0.2), (0.21, 0.36), (0.195, 0.37), (0.19, 0.25)]
    parts = [lathe((0, 0, 0), outline, 36, wicker, cell_m=0.012), disc((0, 0, 0.25), 0.2, 0.02, wicker)]
    for k, tone in enumerate(("#c9714e", "#e9dfc9", "#4f7f88")):
        x, y = 0.1 * np.cos(2.1 * k), 0.1 * np.sin(2.1 * k)
        roll = pt.stripes([tone, "#f3ead6", tone], [0.05, 0.02, 0.03], seed + k)
        parts.append(rod((x, y, 0.2), (1.3 * x, 1.3 * y, 0.5 + 0.03 * k), 0.07, 0.015, roll, sides=16))
        parts.append(placed(disc((0, 0, 0), 0.07, 0.012, roll), (1.3 * x, 1.3 * y, 0.5 + 0.03 * k)))
    return shadeless(joined(parts)) + Piece((), (((-0.18, -0.18, 0.0), (0.18, 0.18, 0.36)),))


@thing("cabinet")
def chest(size_m: Point, timber: Painter, seed: int) -> Piece:
    """A trunk with iron bands; size: width, height, depth."""
    w, h, d = size_m[0] / 2, size_m[1], size_m[2]
    parts = [box((-w, -d, 0.0), (w, 0.0, h), 0.016, timber, skip="z")]
    iron = pt.plain("#3b3a3c", seed, grain=0.25)
    for x in (-0.7 * w, 0.0, 0.7 * w):
        parts.append(shadeless(box((x - 0.025, -d - 0.006, 0.0), (x + 0.025, -d, h + 0.006), 0.016, iron, skip="Y")))
        parts.append(shadeless(box((x - 0.025, -d, h), (x + 0.025, 0.0, h + 0.006), 0.016, iron, skip="z")))
    parts.append(shadeless(box((-0.05, -d - 0.02, h - 0.14), (0.05, -d - 0.006, h - 0.04), 0.014, BRASS)))
    return joined(parts)


@thing("easel")
def easel(image: Painter) -> Piece:
    """A painter's easel with a canvas of 0.7 x 0.9 m, about its origin, its front towards -y."""
    beech = pt.wood("#d2b07c", "#a87f4c", 1540)
    parts = [
        rod((-0.35, -0.25, 0.0), (-0.06, 0.08, 1.7), 0.018, 0.05, beech),
        rod((0.35, -0.25, 0.0), (0.06, 0.08, 1.7), 0.018, 0.05, beech),
        rod((0.0, 0.45, 0.0), (0.0, 0.09, 1.66), 0.018, 0.05, beech),
        box((-0.4, -0.21, 0.66), (0.4, -0.11, 0.69), 0.02, beech),
    ]

    canvas = rect((-0.35, -0.032, 0.0), (0.7, 0, 0), (0, 0, 0.9), 0.0095, image)
    canvas += box((-0.35, -0.03, 0.0), (0.35, 0.0, 0.9), 0.03, pt.plain("#e6dcc6", 1541), skip="y")
    parts.append(placed(tilted(canvas, 0, -11.0), (0, -0.12, 0.692)))
    return joined(parts)


@thing("stool")
def stool(seat: Painter, height_m: float = 0.66) -> Piece:
    """A round stool on four legs, about its origin."""
    h = height_m
    parts = [
        lathe((0, 0, h - 0.05), [(0.15, 0.0), (0.17, 0.015), (0.17, 0.045), (0.16, 0.05)], 32, seat, cell_m=0.012),
        disc((0, 0, h), 0.161, 0.012, seat),
    ]
    parts += [
        rod((0.2 * x, 0.2 * y, 0.0), (0.1 * x, 0.1 * y, h - 0.05), 0.013, 0.04, STEEL)
        for x, y in ((1, 0.0), (-1, 0.0), (0.0, 1), (0.0, -1))
    ]
    ring = [(0.165 * float(np.cos(a)), 0.165 * float(np.sin(a)), 0.22) for a in np.arange(17) * (2 * np.pi / 16)]
    parts.append(tube(ring, 0.007, 6, STEEL))
    return shadeless(joined(parts)) + Piece((), (((-0.12, -0.12, 0.1), (0.12, 0.12, h)),))
