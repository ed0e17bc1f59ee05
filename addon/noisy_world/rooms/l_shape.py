# SPDX-License-Identifier: GPL-3.0-or-later
"""Room 2: living and dining in an L of 7.2 x 6.2 m, in sage and terracotta, with windows to the north and west."""

from . import finishes as pic
from . import surfaces as pt
from .building import (
    Coat,
    Wall,
    ceiling,
    closed_door,
    door_hole,
    enclosed,
    glazed,
    ground,
    lining,
    skirting,
    solid,
    walls,
)
from .finishes import PARQUET_M, ferns, joints, parquet, plaster, poster, stones, wandering
from .furniture import (
    armchair,
    basket,
    cabinet,
    chair,
    coffee_table,
    dining_table,
    radiator,
    sofa,
    television,
    wall_shelf,
)
from .light import Lighting
from .openings import garden_from
from .surfaces import Piece, box, joined, placed, shadeless
from .things import (
    Shelf,
    bookshelf,
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
    stack,
    toys,
    trailing_plant,
)

_HEIGHT_M = 2.8
_CORNERS_M = ((-3.6, 3.1), (3.6, 3.1), (3.6, -0.2), (0.4, -0.2), (0.4, -3.1), (-3.6, -3.1))
_NORTH_WINDOWS = ((1.0, 2.8, 0.9, 2.3), (4.6, 6.2, 0.9, 2.3))
_WEST_WINDOW = (3.9, 5.5, 0.9, 2.3)
_DOOR = door_hole(3.3)
_LAMPS_M = ((-3.27, -1.85, 1.55, 0.26), (2.1, 1.5, 1.65, 0.28), (-1.4, -2.3, 2.1, 0.2))
_STRIP_M = PARQUET_M / 4
_FLOOR = Coat(
    parquet("#b98552", "#74491f", "#3a2412", 2120),
    columns_m=lambda length: joints(_STRIP_M, 3, length),
    rows_m=lambda length: joints(_STRIP_M, 3, length),
)
_TEAK = pt.wood("#a8693a", "#6b3d1d", 2101)
_PALE = pt.wood("#e3d2b4", "#c0a77f", 2102)
_RUST = pt.weave("#b5563a", "#e3a778", 2103, thread_m=0.02)


def l_shape() -> tuple[Piece, Lighting]:
    """Everything in it, and its light."""
    sides = walls(_CORNERS_M, _HEIGHT_M)
    north, _, _, _, south, west = sides
    lighting = Lighting(
        (-3.6, -3.1, 0.0),
        (3.6, 3.1, _HEIGHT_M),
        (*(north.window(w) for w in _NORTH_WINDOWS), west.window(_WEST_WINDOW)),
        _LAMPS_M,
        sun=(0.85, -0.55, -0.6),
    )
    sage = Coat(plaster("#bcc7ae", "#93a487", 2110))
    warm = Coat(plaster("#eee3cf", "#d0bd9f", 2111))
    rubble = Coat(stones(["#a89a86", "#8f8272", "#c0b29c", "#7d7468", "#b5a284"], "#d6cbb8", 0.27, 2112))
    jungle = Coat(ferns("#f0e6d2", ["#c9a877", "#7f9a72", "#4d6f55"], 2113))
    coats = [warm, jungle, warm, sage, rubble, sage]
    white = Coat(plaster("#f2ede2", "#d9d2c3", 2114, stroke=0.7), 0.03)
    built = [
        enclosed(sides, coats, {0: _NORTH_WINDOWS, 4: (_DOOR,), 5: (_WEST_WINDOW,)}),
        lining(_CORNERS_M, sides, {0: _NORTH_WINDOWS, 4: (_DOOR,), 5: (_WEST_WINDOW,)}),
        ground(_CORNERS_M, _FLOOR),
        ceiling(_CORNERS_M, _HEIGHT_M, white),
        *(skirting(w, "#a8693a", (_DOOR,) if w is south else ()) for w in sides),
        *(
            shadeless(box((-3.6, y - 0.08, _HEIGHT_M - 0.16), (0.4, y + 0.08, _HEIGHT_M), 0.03, _TEAK, skip="xXZ"))
            for y in (-2.2, -1.2)
        ),
        *(
            glazed(north, w, garden_from(0.15 + 0.2 * k), 2130 + k, hung=_CURTAINS)
            for k, w in enumerate(_NORTH_WINDOWS)
        ),
        glazed(west, _WEST_WINDOW, garden_from(0.7), 2133, hung=_CURTAINS),
        closed_door(south, _DOOR, "#8a4a33"),
        solid((0.4, -3.1, 0.0), (3.6, -0.2, _HEIGHT_M)),
    ]
    return joined([*built, *_furniture(sides), *_decor(sides)]), lighting


_CURTAINS = ["#efe6d4", "#b5563a", "#efe6d4", "#93a487", "#efe6d4", "#d9a441"]
_TABLE_M = (2.1, 1.5)
_COFFEE_M = (-1.75, -0.45)


def _furniture(sides: list[Wall]) -> list[Piece]:
    north, east, inner_south, inner_east, south, west = sides
    x, y = _TABLE_M
    seats = [pt.weave(c, "#f0e0c0", 2140 + k, thread_m=0.016) for k, c in enumerate(("#93a487", "#b5563a"))]
    around = (
        (x - 0.36, y - 0.62, 178.0),
        (x + 0.4, y - 0.6, 188.0),
        (x - 0.4, y + 0.6, -4.0),
        (x + 0.36, y + 0.66, 5.0),
    )
    shelf = Shelf(1.7, 2.3, 0.32, 2, 6, _TEAK, _TEAK, 660, ((1, 0), (4, 2), (7, 1), (10, 0)))
    moss = pt.weave("#6f7f58", "#c9cfae", 2142, thread_m=0.02)
    return [
        west.before(placed(sofa(_RUST), (0.0, -0.5, 0.0)), 2.6),
        placed(coffee_table(_TEAK), (*_COFFEE_M, 0.0), 90.0),
        placed(armchair(moss, _TEAK), (-1.9, 1.35, 0.0), -14.0),
        inner_east.before(cabinet((1.9, 0.5, 0.42), 4, _TEAK, _PALE), 1.5),
        inner_east.before(placed(television(), (0.0, -0.2, 0.0)), 1.5, 0.5005),
        south.before(bookshelf(shelf), 1.2),
        placed(dining_table(_PALE), (x, y, 0.0)),
        *(placed(chair(seats[k % 2], _TEAK), (cx, cy, 0.0), yaw) for k, (cx, cy, yaw) in enumerate(around)),
        inner_south.before(cabinet((1.5, 0.85, 0.42), 3, _PALE, _TEAK), 1.5),
        east.before(wall_shelf(1.2, _TEAK, 2150), 0.85, 1.45),
        north.before(radiator(1.4), 1.9),
        west.before(radiator(1.2), 4.7),
    ]


def _decor(sides: list[Wall]) -> list[Piece]:
    north, east, inner_south, inner_east, south, west = sides
    gold, dark = pt.wood("#c9a35e", "#8a6630", 2160), pt.wood("#3f2c20", "#241810", 2161)
    canyon = ("#7fa3b5", "#f0d0a0", "#fff0c8", "#d9a06a", "#c9713f", "#a34f2c", "#7a3a24")
    lake = ("#8fb4c8", "#f4ead6", "#ffffff", "#8aa69a", "#5f8578", "#3f6a5a", "#d8c48f")
    x, y = _TABLE_M
    wool = wandering(["#efe6d4", "#b5563a", "#93a487", "#d9a441", "#e3d2b4", "#6f7f58"], 2162)
    glazes = (
        pt.terrazzo("#93a487", ["#f3e6d0"], 2163, chip_m=0.02),
        pt.stripes(["#b5563a", "#efe6d4"], [0.014, 0.009], 2164),
    )
    shapes = ("#b5563a", "#d9a441", "#6f7f58", "#3d5a60")
    return [
        placed(rug(wool, "#6f7f58", (3.0, 2.2)), (-1.75, -0.35, 0.0), 90.0),
        pendant((x, y, 1.65), _HEIGHT_M, ["#b5563a", "#efe6d4", "#b5563a", "#8a4a33", "#b5563a", "#c9a35e"]),
        pendant((-1.4, -2.3, 2.1), _HEIGHT_M, ["#6f7f58", "#c9a35e", "#6f7f58", "#4f5f40", "#6f7f58", "#c9a35e"]),
        floor_lamp(_LAMPS_M[0][:3]),
        placed(potted_palm(), (0.0, 2.6, 0.0), 70.0),
        placed(potted_palm(), (-3.2, 2.7, 0.0), 200.0),
        placed(pouf(["#93a487", "#86987a", "#6f7f58"]), (-0.75, 0.8, 0.0)),
        placed(toys(), (-0.6, -1.85, 0.0), 130.0),
        placed(open_carton(), (-3.1, 1.35, 0.0), 75.0),
        south.before(placed(basket("#b98a58", 2165), (0.0, -0.3, 0.0)), 2.45),
        west.before(framed(1.3, 0.7, pic.landscape(1.3, 0.7, 2170, canyon), gold), 2.6, 1.55),
        west.before(framed(0.42, 0.56, pic.botanical(0.42, 0.56, 2171, "#4d6f55"), dark, mat_m=0.05), 1.15, 1.6),
        inner_east.before(framed(0.5, 0.66, poster(0.5, 0.66, 2172, ("#efe3c8", "#2c2a28", *shapes)), dark), 0.45, 1.6),
        inner_east.before(framed(0.56, 0.4, pic.landscape(0.56, 0.4, 2173, lake), gold, mat_m=0.04), 2.5, 1.6),
        inner_south.before(framed(0.9, 0.62, pic.circles(0.9, 2174), dark, mat_m=0.05), 1.5, 1.65),
        inner_south.before(framed(0.36, 0.5, pic.botanical(0.36, 0.5, 2175, "#8a4a33"), gold, mat_m=0.03), 2.6, 1.6),
        east.before(framed(0.7, 0.5, pic.blocks(0.7, 0.5, 2176), dark), 2.4, 1.7),
        north.before(clock(), 3.7, 1.9, 0.035),
        placed(fruit_bowl(2180), (x, y + 0.02, 0.7525)),
        *(
            placed(place_setting(), (x + dx, y + dy, 0.7525), yaw)
            for dx, dy, yaw in ((-0.38, -0.26, 0), (0.4, 0.26, 180))
        ),
        placed(mug(glazes[0]), (_COFFEE_M[0] + 0.1, _COFFEE_M[1] - 0.2, 0.4325), 40.0),
        placed(mug(glazes[1]), (_COFFEE_M[0] - 0.12, _COFFEE_M[1] + 0.1, 0.4325), 220.0),
        placed(shadeless(stack(4, 694, 10)), (_COFFEE_M[0], _COFFEE_M[1] + 0.33, 0.4325), 80.0),
        inner_south.before(placed(flowers(), (0.0, -0.22, 0.0)), 1.75, 0.851),
        inner_south.before(placed(shadeless(stack(5, 695, -10)), (0.0, -0.32, 0.0)), 1.05, 0.851),
        inner_east.before(placed(trailing_plant(), (0.0, -0.24, 0.0)), 2.3, 0.5205),
        east.before(placed(trailing_plant(), (0.0, -0.12, 0.0)), 1.35, 1.451),
    ]
