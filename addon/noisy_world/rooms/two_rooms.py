# SPDX-License-Identifier: GPL-3.0-or-later
"""Room 4: a kitchen of 4.2 x 4.2 m and a study of 3.8 x 4.2 m, joined by a wide doorway of 1.5 m."""

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
    passage,
    skirting,
    solid,
    walls,
)
from .finishes import boards, cement_tiles, joints, plaster, stones, world_map
from .fittings import TOP_M, bin_, clutter, desk, fridge, keyboard, monitor, papers, splashback, units, wall_units
from .furniture import armchair, chair, dining_table, easel, radiator, stool, wall_shelf
from .light import Lighting
from .openings import city, garden_from
from .surfaces import Piece, joined, placed, shadeless, thing
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
    potted_palm,
    rug,
    stack,
    trailing_plant,
)

_HEIGHT_M = 2.7
_KITCHEN_M = ((-4.3, 2.1), (-0.1, 2.1), (-0.1, -2.1), (-4.3, -2.1))
_STUDY_M = ((0.1, 2.1), (3.9, 2.1), (3.9, -2.1), (0.1, -2.1))
_FROM_KITCHEN = (1.75, 3.25, 0.0, 2.3)
_FROM_STUDY = (0.95, 2.45, 0.0, 2.3)
_KITCHEN_WINDOW = (2.75, 3.95, 1.0, 2.2)
_STUDY_WINDOW = (0.9, 2.7, 0.9, 2.2)
_DOOR = door_hole(3.3)
_LAMPS_M = ((-2.6, -0.75, 1.7, 0.26), (-1.3, 1.2, 2.3, 0.16), (2.0, 0.0, 2.05, 0.2), (0.5, 1.72, 1.55, 0.2))
_KITCHEN_FLOOR = Coat(stones(["#b9826a", "#a96f58", "#c49680", "#9a614c", "#b08a72"], "#8f8578", 0.3, 2320), 0.021)
_STUDY_FLOOR = Coat(pt.planks("#8f5f38", "#50301a", "#22140a", 2321), 0.024, rows_m=lambda m: pt.plank_rows(m, 4))
_BLUE = pt.plain("#4a6d80", 2301, grain=0.08, grain_m=0.022, patch=0.08, fleck=0.08)
_BUTCHER = pt.wood("#c99a62", "#8f6536", 2302)
_BIRCH = pt.wood("#dfc79c", "#b8975f", 2303)


def two_rooms() -> tuple[Piece, Lighting]:
    """Everything in them, and their light."""
    kitchen, study = walls(_KITCHEN_M, _HEIGHT_M), walls(_STUDY_M, _HEIGHT_M)
    lighting = Lighting(
        (-4.3, -2.1, 0.0),
        (3.9, 2.1, _HEIGHT_M),
        (kitchen[0].window(_KITCHEN_WINDOW), study[1].window(_STUDY_WINDOW)),
        _LAMPS_M,
        sun=(-1.0, -0.5, -0.6),
        day=1.3,
    )
    yellow = Coat(plaster("#efdca6", "#d6b56a", 2310))
    pines = Coat(plaster("#3f5f50", "#2c4a40", 2311))
    white = Coat(plaster("#ebe4d4", "#cdc2aa", 2312))
    plum = Coat(pt.wallpaper("#6b4a58", "#c9a37a", "#e9c9a8", 2313))
    encaustic = Coat(
        cement_tiles(["#f0e8d6", "#4a6d80", "#d9a441", "#2c3f4a"], 0.15, 2314),
        columns_m=lambda m: joints(0.15, 7, m),
        rows_m=lambda m: joints(0.15, 7, m),
    )
    wooden = Coat(boards("#e6dcc4", "#9c8f74", 2322), 0.03, rows_m=lambda m: joints(0.16, 3, m))
    ceiled = Coat(plaster("#f1ecdf", "#d8d0bd", 2323, stroke=0.8), 0.03)
    built = [
        enclosed(
            kitchen, [yellow, yellow, encaustic, white], {0: (_KITCHEN_WINDOW,), 1: (_FROM_KITCHEN,), 2: (_DOOR,)}
        ),
        enclosed(study, [pines, white, plum, pines], {1: (_STUDY_WINDOW,), 3: (_FROM_STUDY,)}),
        passage(kitchen[1], _FROM_KITCHEN, 0.2, _BUTCHER),
        lining(_KITCHEN_M, kitchen, {0: (_KITCHEN_WINDOW,), 1: (_FROM_KITCHEN,), 2: (_DOOR,)}),
        lining(_STUDY_M, study, {1: (_STUDY_WINDOW,), 3: (_FROM_STUDY,)}),
        ground(_KITCHEN_M, _KITCHEN_FLOOR),
        ground(_STUDY_M, _STUDY_FLOOR, turned=True),
        ceiling(_KITCHEN_M, _HEIGHT_M, wooden),
        ceiling(_STUDY_M, _HEIGHT_M, ceiled),
        *(skirting(w, "#e9e2d0", {1: (_FROM_KITCHEN,), 2: (_DOOR,)}.get(k, ())) for k, w in enumerate(kitchen)),
        *(skirting(w, "#e9e2d0", {3: (_FROM_STUDY,)}.get(k, ())) for k, w in enumerate(study)),
        glazed(kitchen[0], _KITCHEN_WINDOW, garden_from(0.55), 2330, hung=None),
        glazed(study[1], _STUDY_WINDOW, city(2331), 2332, hung=_CURTAINS),
        closed_door(kitchen[2], _DOOR, "#4a6d80"),
        solid((-0.1, -2.1, 0.0), (0.1, -1.15, _HEIGHT_M)),
        solid((-0.1, 0.35, 0.0), (0.1, 2.1, _HEIGHT_M)),
        solid((-0.1, -1.15, 2.3), (0.1, 0.35, _HEIGHT_M)),
    ]
    return joined([*built, *_kitchen(kitchen), *_study(study)]), lighting


_CURTAINS = ["#efe6d4", "#6b4a58", "#efe6d4", "#c9a37a", "#efe6d4", "#3f5f50"]
_TABLE_M = (-2.6, -0.75)


def _kitchen(sides: list[Wall]) -> list[Piece]:
    north, east, south, west = sides
    x, y = _TABLE_M
    dark, gold = pt.wood("#3f2c20", "#241810", 2340), pt.wood("#c9a35e", "#8a6630", 2341)
    seats = [pt.weave(c, "#f0e0c0", 2342 + k, thread_m=0.016) for k, c in enumerate(("#d9a441", "#4a6d80"))]
    around = ((x - 0.38, y - 0.6, 177.0), (x + 0.36, y - 0.66, 186.0), (x - 0.36, y + 0.62, 4.0))
    ripe = ("#7fb0d0", "#f6efd8", "#ffffff", "#b8c47a", "#e0c050", "#c9713f", "#5a7a3a")
    return [
        north.before(units(6, _BLUE, _BUTCHER, 2, 4), 0.35),
        north.before(splashback(2.4, ["#f2ede0", "#e6e0d0", "#f7f3ea", "#b8cdd6"], 2350), 0.35),
        north.before(wall_units(4, _BLUE), 0.35),
        placed(north.before(clutter(), 0.35, TOP_M + 0.0005), (0.0, 0.0, 0.0)),
        west.before(fridge("#c9d6cf"), 3.25),
        placed(dining_table(_BIRCH), (x, y, 0.0)),
        *(placed(chair(seats[k % 2], _BIRCH), (cx, cy, 0.0), yaw) for k, (cx, cy, yaw) in enumerate(around)),
        placed(stool(_BUTCHER), (-0.65, 0.85, 0.0)),
        pendant((x, y, 1.7), _HEIGHT_M, ["#d9a441", "#f0e8d6", "#d9a441", "#b8842f", "#d9a441", "#4a6d80"]),
        pendant((-1.3, 1.2, 2.3), _HEIGHT_M, ["#4a6d80", "#f0e8d6", "#4a6d80", "#2c3f4a", "#4a6d80", "#d9a441"]),
        west.before(wall_shelf(1.3, _BIRCH, 2351), 1.2, 1.55),
        west.before(radiator(1.2), 1.2),
        placed(fruit_bowl(2352), (x + 0.1, y, 0.7525)),
        placed(flowers(), (x - 0.45, y + 0.1, 0.7525)),
        placed(mug(pt.stripes(["#4a6d80", "#f0e8d6"], [0.013, 0.009], 2353)), (x + 0.42, y - 0.2, 0.7525), 70.0),
        east.before(framed(0.5, 0.66, pic.blocks(0.5, 0.66, 2354), dark), 0.95, 1.65),
        east.before(clock(), 3.72, 1.85, 0.035),
        south.before(framed(0.7, 0.5, pic.landscape(0.7, 0.5, 2355, ripe), gold), 1.9, 1.7),
        south.before(framed(0.36, 0.5, pic.botanical(0.36, 0.5, 2356, "#4a6d80"), dark, mat_m=0.03), 1.05, 1.65),
        placed(potted_palm(), (-0.6, -1.75, 0.0), 30.0),
        placed(bin_("#8d9094", 2357), (-3.95, 0.35, 0.0)),
        north.before(placed(trailing_plant(), (0.0, -0.14, 0.0)), 3.8, 1.004 - 0.084),
    ]


def _study(sides: list[Wall]) -> list[Piece]:
    north, east, south, west = sides
    dark, gold = pt.wood("#3f2c20", "#241810", 2360), pt.wood("#c9a35e", "#8a6630", 2361)
    shelf = Shelf(
        2.0, 2.25, 0.3, 2, 6, _BIRCH, pt.wood("#a9794b", "#6f4a2b", 2362), 690, ((0, 0), (5, 2), (6, 1), (11, 2))
    )
    leather = pt.plain("#8a5230", 2363, grain=0.16, grain_m=0.016, patch=0.3)
    knots = pic.rug(2.2, 1.5, 2364)
    sketch = pic.landscape(
        0.7, 0.9, 2365, ("#6f9fc4", "#f4d9ae", "#fff4d2", "#c98f8a", "#8f5f78", "#5b4264", "#2f3358")
    )
    return [
        north.before(bookshelf(shelf), 2.35),
        floor_lamp((0.5, 1.72, 1.55)),
        placed(desk(1.5, _BIRCH, depth_m=0.7), (3.35, 0.3, 0.0), -90.0),
        placed(monitor(2371), (3.5, 0.35, 0.74), -84.0),
        placed(keyboard(), (3.2, 0.3, 0.7405), -90.0),
        placed(papers(2372), (3.2, 0.85, 0.7405), -70.0),
        placed(shadeless(stack(4, 696, 8)), (3.45, -0.3, 0.7405), -90.0),
        placed(chair(pt.weave("#6b4a58", "#e9c9a8", 2373, thread_m=0.016)), (2.72, 0.3, 0.0), 95.0),
        placed(armchair(leather, dark), (0.85, 1.35, 0.0), -35.0),
        placed(easel(sketch), (0.75, -1.5, 0.0), 205.0),
        placed(rug(knots, "#7c3022", (2.2, 1.5)), (1.75, -0.05, 0.0), 90.0),
        pendant((2.0, 0.0, 2.05), _HEIGHT_M, ["#3f5f50", "#c9a35e", "#3f5f50", "#2c4a40", "#3f5f50", "#c9a35e"]),
        south.before(framed(1.25, 0.85, world_map(1.25, 0.85, 2374), dark), 1.7, 1.65),
        south.before(framed(0.4, 0.54, pic.botanical(0.4, 0.54, 2375, "#3f5f50"), gold, mat_m=0.04), 0.5, 1.6),
        south.before(shelf_low(), 1.7),
        west.before(framed(0.56, 0.72, pic.circles(0.56, 2376), gold, mat_m=0.04), 3.3, 1.6),
        east.before(framed(0.4, 0.4, pic.blocks(0.4, 0.4, 2377), dark), 3.75, 1.6),
        east.before(radiator(1.3), 1.8),
        placed(open_carton(), (3.45, -1.65, 0.0), 20.0),
        placed(bin_("#3f5f50", 2378), (3.6, 1.35, 0.0)),
    ]


@thing("shelf")
def shelf_low() -> Piece:
    """A low shelf with a plant and a vase on it."""
    low = bookshelf(Shelf(1.5, 0.72, 0.3, 2, 2, _BIRCH, _BIRCH, 710, ((1, 1),)))
    plant = placed(trailing_plant(), (-0.5, -0.16, 0.7205))
    return joined([low, plant, placed(shadeless(stack(3, 697, -6)), (0.3, -0.24, 0.7205))])
