# SPDX-License-Identifier: GPL-3.0-or-later
"""Room 5: an open office of 9.0 x 7.0 m with a pillar, two islands of desks and a band of windows to the south."""

from . import finishes as pic
from . import surfaces as pt
from .building import Coat, Wall, ceiling, closed_door, door_hole, enclosed, glazed, ground, lining, skirting, walls
from .finishes import carpet_tiles, concrete, joints, mineral, plaster, poster, slats
from .fittings import (
    bin_,
    board,
    cabinet_row,
    ceiling_light,
    printer,
    screen_wall,
    swivel_chair,
    water_cooler,
    workplace,
)
from .furniture import coffee_table, radiator, sofa
from .light import Lighting
from .openings import city
from .surfaces import Piece, box, joined, placed
from .things import Shelf, bookshelf, clock, flowers, framed, mug, potted_palm, pouf, trailing_plant

_HEIGHT_M = 3.0
_CORNERS_M = ((-4.5, 3.5), (4.5, 3.5), (4.5, -3.5), (-4.5, -3.5))
_WINDOWS = ((0.7, 2.9, 0.85, 2.45), (3.4, 5.6, 0.85, 2.45), (6.1, 8.3, 0.85, 2.45))
_DOOR = door_hole(1.6)
_LIGHTS_M = tuple((x, y) for x in (-3.0, 0.0, 3.0) for y in (-1.5, 1.5))
_FLOOR = Coat(carpet_tiles(["#4a5560", "#5a6873", "#3c464f", "#6f7f8a", "#54616b"], 2520), 0.027)
_CEILING = Coat(mineral("#ecebe4", 2521), 0.037)
_MAPLE = pt.wood("#e2cba0", "#c0a070", 2501)
_FELT = pt.weave("#2f7f86", "#58a3a6", 2502, thread_m=0.02)


def open_office() -> tuple[Piece, Lighting]:
    """Everything in it, and its light."""
    sides = walls(_CORNERS_M, _HEIGHT_M)
    north, _, south, _ = sides
    lighting = Lighting(
        (-4.5, -3.5, 0.0),
        (4.5, 3.5, _HEIGHT_M),
        tuple(south.window(w) for w in _WINDOWS),
        tuple((x, y, _HEIGHT_M - 0.1, 0.42) for x, y in _LIGHTS_M),
        sun=(0.5, 1.0, -0.75),
        day=0.9,
        reach_m=3.0,
    )
    coats = [
        Coat(plaster("#e9e8e2", "#c4c8c8", 2510), 0.021),
        Coat(concrete("#b9b6ae", 2511), 0.021),
        Coat(plaster("#e4e6e2", "#b9c2c2", 2512), 0.021),
        Coat(
            slats("#b98a58", "#7d5532", 2513),
            0.02,
            columns_m=lambda m: joints(0.06, 2, m),
        ),
    ]
    built = [
        enclosed(sides, coats, {0: (_DOOR,), 2: _WINDOWS}),
        lining(_CORNERS_M, sides, {0: (_DOOR,), 2: _WINDOWS}),
        ground(_CORNERS_M, _FLOOR),
        ceiling(_CORNERS_M, _HEIGHT_M, _CEILING),
        *(skirting(w, "#4a5560", (_DOOR,) if w is north else (), 0.08) for w in sides),
        *(glazed(south, w, city(2530 + k), 2533 + k, hung=None, eye_out_m=3.5) for k, w in enumerate(_WINDOWS)),
        closed_door(north, _DOOR, "#c9692f"),
        *(ceiling_light((x, y, _HEIGHT_M), (1.2, 0.6)) for x, y in _LIGHTS_M),
        box((-0.9, -0.55, 0.0), (-0.5, -0.15, _HEIGHT_M), 0.02, concrete("#a9a69e", 2514), skip="zZ"),
    ]
    return joined([*built, *_desks(), *_furniture(sides), *_decor(sides)]), lighting


def _desks() -> list[Piece]:
    """Two islands of four desks, two facing two, with padded screens between them."""
    cloths = [
        pt.weave(c, thread, 2540 + k, thread_m=0.022)
        for k, (c, thread) in enumerate((("#3a3d44", "#565b64"), ("#2f7f86", "#56a0a4"), ("#c9692f", "#e09a68")))
    ]
    parts = []
    for island, (x, y) in enumerate(((-2.5, -0.35), (2.5, -0.35))):
        for k, (dx, dy, yaw) in enumerate(
            ((-0.81, -0.43, 0.0), (0.81, -0.43, 0.0), (-0.81, 0.43, 180.0), (0.81, 0.43, 180.0))
        ):
            number = 4 * island + k
            seat = 0.85 + pt.pick(number, 2541, 0.0, 0.22)
            side = -1.0 if yaw == 0.0 else 1.0
            parts.append(
                placed(workplace(2550 + 3 * number, _MAPLE, screens=1 + number % 2), (x + dx, y + dy, 0.0), yaw)
            )
            at = (x + dx + pt.pick(number, 2542, -0.15, 0.15), y + dy + side * (seat - 0.1), 0.0)
            parts.append(placed(swivel_chair(cloths[number % 3]), at, yaw + pt.pick(number, 2543, -40.0, 40.0)))
        parts.append(placed(screen_wall(3.1, 1.12, _FELT if island else cloths[2]), (x, y, 0.0)))
    return parts


def _furniture(sides: list[Wall]) -> list[Piece]:
    north, east, south, west = sides
    shelf = Shelf(2.2, 2.1, 0.34, 3, 5, _MAPLE, _MAPLE, 720, ((2, 0), (4, 2), (9, 1), (12, 2)))
    moss = pt.weave("#7f8c4f", "#d8dcae", 2560, thread_m=0.02)
    return [
        north.before(board(2.6, 1.2, 2561), 4.2, 0.95),
        north.before(cabinet_row(3, ["#d8dadb", "#c9cdd0", "#e08a3c"], 0.82, 2562), 7.4),
        north.before(printer(), 5.75),
        west.before(bookshelf(shelf), 1.5),
        placed(sofa(moss), (-3.95, 1.95, 0.0), 90.0),
        placed(coffee_table(_MAPLE), (-2.9, 1.95, 0.0), 90.0),
        placed(pouf(["#e08a3c", "#d07a2f", "#b5652a"]), (-2.15, 2.7, 0.0)),
        east.before(cabinet_row(2, ["#d8dadb", "#2f7f86"], 1.3, 2563), 5.6),
        north.before(water_cooler(), 8.8),
        east.before(board(2.4, 1.15, 2564, pinned=True), 2.6, 1.0),
        *(south.before(radiator(1.5), x) for x in (1.8, 4.5, 7.2)),
    ]


def _decor(sides: list[Wall]) -> list[Piece]:
    north, east, _, west = sides
    black, pale = pt.wood("#37322e", "#211d1a", 2570), pt.wood("#e2cba0", "#c0a070", 2571)
    shapes = ("#c9692f", "#2f7f86", "#e8b13c", "#34424c")
    glaze = pt.stripes(["#2f7f86", "#e8e2d4"], [0.013, 0.009], 2572)
    return [
        placed(potted_palm(), (-0.7, 3.05, 0.0), 40.0),
        placed(potted_palm(), (4.1, -3.2, 0.0), 150.0),
        placed(potted_palm(), (-3.75, -3.15, 0.0), 250.0),
        placed(bin_("#34424c", 2574), (-0.68, -0.8, 0.0)),
        placed(bin_("#34424c", 2575), (-0.68, 0.1, 0.0)),
        north.before(placed(flowers(), (0.0, -0.22, 0.0)), 7.0, 0.8205),
        north.before(placed(trailing_plant(), (0.0, -0.3, 0.0)), 8.1, 0.8205),
        east.before(placed(trailing_plant(), (0.0, -0.3, 0.0)), 6.2, 1.3005),
        north.before(clock(), 2.52, 2.35, 0.035),
        north.before(framed(0.6, 0.8, poster(0.6, 0.8, 2576, ("#efe9dc", "#26292d", *shapes)), black), 6.6, 1.75),
        north.before(framed(0.6, 0.8, poster(0.6, 0.8, 2577, ("#34424c", "#efe9dc", *shapes)), black), 7.45, 1.75),
        north.before(framed(0.6, 0.8, poster(0.6, 0.8, 2578, ("#e8b13c", "#26292d", *shapes)), black), 8.3, 1.75),
        west.before(framed(1.0, 0.7, pic.circles(1.0, 2579), pale), 5.45, 1.65),
        east.before(framed(0.9, 0.64, pic.blocks(0.9, 0.64, 2580), black), 0.75, 1.7),
        placed(mug(glaze), (-2.85, 1.7, 0.4325), 30.0),
        west.before(framed(0.5, 0.7, pic.botanical(0.5, 0.7, 2581, "#2f5a4a"), black, mat_m=0.04), 3.25, 1.65),
    ]
