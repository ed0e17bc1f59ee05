# SPDX-License-Identifier: GPL-3.0-or-later
"""Room 3: a corridor of 9.0 x 1.9 m in an old house that opens into a hall of 2.9 x 3.8 m, with five doors."""

from . import finishes as pic
from . import surfaces as pt
from .building import (
    Coat,
    Wall,
    ceiling,
    closed_door,
    door_hole,
    glazed,
    ground,
    lining,
    skirting,
    solid,
    strip,
    surface,
    walls,
)
from .finishes import cement_tiles, joints, noticeboard, plaster, poster, tiles, world_map
from .furniture import basket, bench, chest, coat_rack, mirror_table, radiator, table_lamp
from .light import Lighting
from .openings import Hole, city, garden_from
from .surfaces import Piece, joined, placed
from .things import clock, flowers, framed, open_carton, pendant, potted_palm, rug, trailing_plant

_HEIGHT_M = 2.9
_CORNERS_M = ((-4.5, 0.95), (1.6, 0.95), (1.6, 2.85), (4.5, 2.85), (4.5, -0.95), (-4.5, -0.95))
_DADO_M = 1.2
_END_WINDOW = (0.4, 1.5, 1.0, 2.4)
_HALL_WINDOW = (1.55, 2.6, 0.95, 2.35)
_HOLES: dict[int, tuple[Hole, ...]] = {
    0: (door_hole(1.4), door_hole(4.6)),
    2: (_HALL_WINDOW,),
    3: (door_hole(2.6),),
    4: (door_hole(3.2), door_hole(6.4)),
    5: (_END_WINDOW,),
}
_LAMPS_M = ((-3.0, 0.0, 2.2, 0.18), (-0.2, 0.0, 2.2, 0.18), (3.1, 1.0, 2.15, 0.26), (2.15, 2.67, 1.2, 0.12))
_FLOOR = Coat(
    cement_tiles(["#e9dfc8", "#3f5a60", "#b5654a", "#2c2f33"], 0.2, 2220),
    columns_m=lambda length: joints(0.2, 9, length),
    rows_m=lambda length: joints(0.2, 9, length),
)
_GREEN = tiles(["#2f5a4a", "#356553", "#28503f", "#3f7260"], "#d8d2c2", (0.2, 0.1), 2201, bond=0.5)
_TILED = Coat(_GREEN, 0.02, lambda length: joints(0.1, 4, length), lambda length: joints(0.1, 4, length))
_OCHRE = Coat(pt.wallpaper("#efdfb4", "#4a5a2c", "#7a1c18", 2202))
_MAHOGANY = pt.wood("#7d4427", "#4a2413", 2203)


def corridor() -> tuple[Piece, Lighting]:
    """Everything in it, and its light."""
    sides = walls(_CORNERS_M, _HEIGHT_M)
    lighting = Lighting(
        (-4.5, -0.95, 0.0),
        (4.5, 2.85, _HEIGHT_M),
        (sides[5].window(_END_WINDOW), sides[2].window(_HALL_WINDOW)),
        _LAMPS_M,
        sun=(1.0, -0.3, -0.5),
        day=1.05,
    )
    built: list[Piece] = []
    rail = pt.plain("#1f3f33", 2204, grain=0.15)
    for k, wall in enumerate(sides):
        holes = _HOLES.get(k, ())
        doors = tuple(hole for hole in holes if hole[2] == 0.0)
        built += [
            surface(wall, _TILED, (0.0, _DADO_M), holes),
            surface(wall, _OCHRE, (_DADO_M, _HEIGHT_M), holes),
            strip(
                wall, (_DADO_M - 0.04, _DADO_M), 0.022, rail, tuple((a - 0.09, b + 0.09, c, d) for a, b, c, d in holes)
            ),
            strip(wall, (_HEIGHT_M - 0.09, _HEIGHT_M), 0.05, pt.plain("#f1ead9", 2205, grain=0.1, grain_m=0.03)),
            skirting(wall, "#1f3f33", doors, 0.14),
            *(closed_door(wall, hole, "#8a4a2c" if k != 3 else "#2f4a3c") for hole in doors),
        ]
    stucco = Coat(plaster("#f3ecdb", "#dccfb2", 2221, stroke=0.8), 0.03)
    return joined(
        [
            *built,
            lining(_CORNERS_M, sides, _HOLES),
            ground(_CORNERS_M, _FLOOR),
            ceiling(_CORNERS_M, _HEIGHT_M, stucco),
            glazed(sides[5], _END_WINDOW, garden_from(0.4), 2230, hung=None),
            glazed(sides[2], _HALL_WINDOW, city(2231), 2232, hung=None),
            solid((-4.5, 0.95, 0.0), (1.6, 2.85, _HEIGHT_M)),
            *_furniture(sides),
            *_pictures(sides),
        ]
    ), lighting


def _furniture(sides: list[Wall]) -> list[Piece]:
    north, hall_west, hall_north, east, south, west = sides
    coats = ["#3d4f6b", "#8a3b2c", "#55613f", "#c9a35e", "#4a4038"]
    cushion = pt.stripes(["#b5654a", "#efe3c8", "#3f5a60"], [0.05, 0.02, 0.03], 2240)
    knots = pic.rug(4.6, 0.9, 2241)
    glaze = pt.terrazzo("#3f5a60", ["#e9dfc8", "#b5654a"], 2242, chip_m=0.03)
    shade = pt.stripes(["#ffe7b0", "#f0cb86"], [0.04, 0.02], 2243)
    lamp_codes = ["#b8924a", "#e9dfc8", "#b8924a", "#8a6630", "#b8924a", "#2c2f33"]
    return [
        placed(rug(knots, "#7c3022", (4.6, 0.9)), (-1.4, 0.0, 0.0)),
        *(pendant((x, y, z), _HEIGHT_M, lamp_codes) for x, y, z, _ in _LAMPS_M[:3]),
        east.before(coat_rack(1.06, _MAHOGANY, coats, 2250), 1.45),
        east.before(bench(1.0, _MAHOGANY, cushion), 1.45),
        hall_north.before(mirror_table(_MAHOGANY), 0.55),
        hall_north.before(placed(table_lamp(glaze, shade), (0.0, -0.18, 0.0)), 0.55, 0.801),
        hall_west.before(chest((1.1, 0.5, 0.45), _MAHOGANY, 2251), 0.9),
        hall_west.before(placed(flowers(), (0.2, -0.22, 0.0)), 0.9, 0.507),
        south.before(chest((0.9, 0.46, 0.32), pt.wood("#a98a5f", "#6b5230", 2252), 2253), 4.8),
        south.before(placed(trailing_plant(), (0.0, -0.15, 0.0)), 4.95, 0.467),
        south.before(bench(1.0, _MAHOGANY, cushion), 8.2),
        north.before(radiator(0.9), 3.0),
        hall_north.before(radiator(0.9), 2.1),
        placed(potted_palm(), (4.1, 2.45, 0.0), 120.0),
        placed(basket("#a8804e", 2254), (1.95, -0.6, 0.0)),
        placed(open_carton(), (4.1, -0.6, 0.0), 180.0),
        west.before(placed(basket("#b98a58", 2255), (0.0, -0.3, 0.0)), 0.32),
    ]


def _pictures(sides: list[Wall]) -> list[Piece]:
    north, hall_west, hall_north, east, south, west = sides
    gold, dark, red = (
        pt.wood("#c9a35e", "#8a6630", 2260),
        pt.wood("#3f2c20", "#241810", 2261),
        pt.wood("#8a4a2c", "#54260f", 2262),
    )
    moor = ("#8fa3b0", "#e8d8b8", "#fff4d2", "#a39a78", "#7f8a58", "#5f6a40", "#8a5a78", "#4a4a38")
    storm = ("#3a4a5a", "#b8c4c8", "#f0f0e0", "#4f6a7a", "#2f4a5a", "#8fa8a8", "#24384a")
    field = ("#7fb0d0", "#f6efd8", "#ffffff", "#b8c47a", "#e0c050", "#8aa040", "#5a7a3a")
    shapes = ("#b5654a", "#3f5a60", "#e0b14e", "#e9dfc8")
    hung = [
        (north, 0.42, 1.75, framed(0.42, 0.52, pic.botanical(0.42, 0.52, 2270, "#2f5a4a"), dark, mat_m=0.04)),
        (north, 2.5, 1.85, framed(0.6, 0.44, pic.landscape(0.6, 0.44, 2271, moor), gold)),
        (north, 3.5, 1.85, framed(0.5, 0.66, poster(0.5, 0.66, 2272, ("#efe3c8", "#2c2f33", *shapes)), dark)),
        (north, 5.55, 1.8, framed(0.5, 0.4, pic.blocks(0.5, 0.4, 2273), red)),
        (south, 0.8, 1.8, framed(0.5, 0.64, poster(0.5, 0.64, 2274, ("#2f4a5c", "#efe3c8", *shapes)), gold)),
        (south, 1.9, 1.8, framed(0.6, 0.42, pic.landscape(0.6, 0.42, 2275, field), dark, mat_m=0.04)),
        (south, 4.4, 1.85, framed(0.4, 0.56, pic.botanical(0.4, 0.56, 2276, "#8a4a2c"), gold, mat_m=0.03)),
        (south, 5.15, 1.85, framed(0.56, 0.56, pic.circles(0.56, 2277), dark, mat_m=0.03)),
        (south, 7.5, 1.85, framed(0.5, 0.36, pic.landscape(0.5, 0.36, 2278, storm), red)),
        (south, 8.35, 1.8, framed(0.6, 0.5, noticeboard(0.6, 0.5, 2279), gold)),
        (hall_west, 0.9, 1.85, framed(1.1, 0.75, world_map(1.1, 0.75, 2280), dark)),
        (hall_north, 0.55, 1.85, framed(0.56, 0.7, pic.landscape(0.56, 0.7, 2281, storm), gold)),
        (east, 3.4, 1.8, framed(0.36, 0.5, pic.blocks(0.36, 0.5, 2282), red)),
    ]
    return [
        *(wall.before(piece, along, z) for wall, along, z, piece in hung),
        east.before(clock(), 2.6, 2.45, 0.035),
        west.before(framed(0.2, 0.26, pic.circles(0.2, 2283), dark), 0.2, 1.7),
    ]
