# SPDX-License-Identifier: GPL-3.0-or-later
"""Room 6: a small office of 4.4 x 4.0 m for two, in white brick and cork, with one window to the north."""

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
    laid_bricks,
    lining,
    skirting,
    walls,
)
from .finishes import concrete, plaster, poster, wandering, world_map
from .fittings import bin_, board, cabinet_row, swivel_chair, tube_light, workplace
from .furniture import cabinet, radiator, stool, wall_shelf
from .light import Lighting
from .openings import city
from .surfaces import Piece, joined, placed
from .things import Shelf, bookshelf, clock, floor_lamp, framed, mug, open_carton, potted_palm, rug, trailing_plant

_HEIGHT_M = 2.75
_CORNERS_M = ((-2.2, 2.0), (2.2, 2.0), (2.2, -2.0), (-2.2, -2.0))
_WINDOW = (1.2, 3.2, 0.95, 2.3)
_DOOR = door_hole(0.8)
_LAMPS_M = ((-0.6, -0.2, 2.3, 0.3), (0.6, -0.2, 2.3, 0.3), (1.93, -0.95, 1.5, 0.16))
_FLOOR = Coat(pt.planks("#7a6a5a", "#463a30", "#1c1612", 2620), 0.024, rows_m=lambda m: pt.plank_rows(m, 4))
_WHITE_BRICKS = ("#dcd8ce", "#e6e2d8", "#cfcabd", "#d8d2c4", "#ece8df", "#c4bdae")
_PINE = pt.wood("#d9b27a", "#a97c45", 2601)
_BLACK = pt.wood("#3a3632", "#1f1c1a", 2602)


def small_office() -> tuple[Piece, Lighting]:
    """Everything in it, and its light."""
    sides = walls(_CORNERS_M, _HEIGHT_M)
    north, _, south, _ = sides
    lighting = Lighting(
        (-2.2, -2.0, 0.0), (2.2, 2.0, _HEIGHT_M), (north.window(_WINDOW),), _LAMPS_M, sun=(-0.5, -1.0, -0.7), day=1.1
    )
    bricks = laid_bricks(pt.bricks(2610, _WHITE_BRICKS, "#a9a294"))
    amber = Coat(plaster("#d98f3f", "#b5682a", 2611))
    grey = Coat(plaster("#d5d6d2", "#a9adad", 2612))
    built = [
        enclosed(sides, [grey, bricks, grey, amber], {0: (_WINDOW,), 2: (_DOOR,)}),
        lining(_CORNERS_M, sides, {0: (_WINDOW,), 2: (_DOOR,)}),
        ground(_CORNERS_M, _FLOOR),
        ceiling(_CORNERS_M, _HEIGHT_M, Coat(concrete("#c2bfb6", 2613, board_m=(1.0, 0.5)), 0.026)),
        *(skirting(w, "#3a3632", (_DOOR,) if w is south else (), 0.08) for w in sides),
        glazed(north, _WINDOW, city(2630, ("#f3dcc0", "#86a8d0")), 2631, hung=None),
        closed_door(south, _DOOR, "#3f4a52"),
        tube_light((-1.2, -0.2, 2.32), 2.4, _HEIGHT_M),
    ]
    return joined([*built, *_furniture(sides)]), lighting


def _furniture(sides: list[Wall]) -> list[Piece]:
    north, east, south, west = sides
    mesh = pt.weave("#3a3d44", "#565b64", 2640, thread_m=0.02)
    amber = pt.weave("#d98f3f", "#e8b070", 2641, thread_m=0.02)
    shelf = Shelf(1.4, 2.2, 0.32, 2, 6, _BLACK, _PINE, 740, ((1, 2), (4, 0), (7, 1), (10, 2)))
    shapes = ("#d98f3f", "#3f6f86", "#e9dcc0", "#8a3b2c")
    wool = wandering(["#3a3d44", "#d98f3f", "#8a8f96", "#e9dcc0", "#5a6068"], 2642)
    return [
        placed(workplace(2651, _PINE), (1.78, 0.15, 0.0), -90.0),
        placed(swivel_chair(mesh), (1.02, 0.2, 0.0), -70.0),
        placed(workplace(2656, _PINE, width_m=1.5), (-1.78, 0.35, 0.0), 90.0),
        placed(swivel_chair(amber), (-1.05, 0.3, 0.0), 75.0),
        south.before(bookshelf(shelf), 3.6),
        south.before(cabinet((1.0, 0.78, 0.4), 2, _BLACK, _PINE), 2.1),
        south.before(board(0.9, 0.75, 2660), 2.05, 1.2),
        west.before(board(1.7, 0.95, 2661, pinned=True), 2.35, 1.15),
        west.before(cabinet_row(1, ["#3f6f86"], 1.25, 2662), 3.5),
        east.before(wall_shelf(1.4, _PINE, 2663), 1.9, 1.62),
        east.before(framed(0.6, 0.8, poster(0.6, 0.8, 2664, ("#e9dcc0", "#2a2826", *shapes)), _BLACK), 3.35, 1.65),
        north.before(framed(0.62, 0.46, world_map(0.62, 0.46, 2665), _BLACK), 0.6, 1.65),
        north.before(framed(0.5, 0.66, pic.circles(0.5, 2666), _PINE, mat_m=0.03), 3.75, 1.65),
        north.before(radiator(1.5), 2.2),
        placed(rug(wool, "#3a3d44", (1.9, 1.3)), (0.0, 0.2, 0.0), 90.0),
        floor_lamp(_LAMPS_M[2][:3]),
        placed(stool(_PINE, 0.46), (0.0, 1.45, 0.0)),
        placed(potted_palm(), (1.75, 1.55, 0.0), 60.0),
        placed(open_carton(), (-1.2, 1.62, 0.0), 5.0),
        placed(bin_("#3f6f86", 2667), (-1.95, -0.65, 0.0)),
        south.before(placed(trailing_plant(), (0.0, -0.2, 0.0)), 2.45, 0.7805),
        south.before(
            placed(mug(pt.terrazzo("#d98f3f", ["#f3e6d0"], 2668, chip_m=0.02)), (0.0, -0.2, 0.0)), 1.8, 0.7805
        ),
        west.before(clock(), 0.55, 2.0, 0.035),
        west.before(framed(0.42, 0.56, pic.botanical(0.42, 0.56, 2669, "#8a3b2c"), _BLACK, mat_m=0.04), 0.95, 1.5),
    ]
