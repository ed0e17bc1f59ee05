# SPDX-License-Identifier: GPL-3.0-or-later
"""Sofa, tables, chairs, cabinets and the bookshelf.

A piece is built about its own origin on the floor with its front towards -y, and then placed in the room.
"""

import numpy as np

from . import patterns as pt
from .books import OAK, Shelf, bookshelf, stack
from .pictures import screen
from .surfaces import (
    Painter,
    Piece,
    Point,
    box,
    joined,
    lathe,
    pillow,
    placed,
    rect,
    rod,
    rounded_box,
    shadeless,
    sheet,
    tilted,
)

WALNUT = pt.wood("#9a6b45", "#57371f", 500)
STEEL = pt.plain("#4a4744", 502, grain=0.18)


SOFA_CLOTH = pt.weave("#4f7f88", "#a9c5c4", 510, thread_m=0.02)


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
