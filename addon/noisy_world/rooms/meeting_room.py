# SPDX-License-Identifier: GPL-3.0-or-later
"""Room 7: a meeting room of 6.4 x 4.6 m with an alcove of 2.8 x 1.6 m for coffee, in oak, felt and concrete."""

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
from .finishes import concrete, joints, plaster, poster, slats, stones, tiles
from .fittings import (
    DESK_M,
    TOP_M,
    board,
    clutter,
    conference_table,
    laptop,
    papers,
    swivel_chair,
    tube_light,
    units,
    wall_units,
)
from .furniture import armchair, cabinet, radiator, stool, television
from .light import Lighting
from .openings import city
from .surfaces import Piece, Point, joined, placed, rounded_box, shadeless
from .things import clock, flowers, framed, fruit_bowl, mug, potted_palm, pouf, trailing_plant

_HEIGHT_M = 2.9
_CORNERS_M = (
    (-3.2, 3.1), (3.2, 3.1), (3.2, -1.5), (2.6, -1.5), (2.6, -3.1), (-0.2, -3.1), (-0.2, -1.5), (-3.2, -1.5),
)  # fmt: skip
_WINDOWS = ((0.7, 2.5, 0.8, 2.4), (3.1, 4.9, 0.8, 2.4))
_DOOR = door_hole(0.75)
_LAMPS_M = ((-1.6, 1.1, 2.35, 0.3), (-0.3, 1.1, 2.35, 0.3), (1.0, 1.1, 2.35, 0.3), (1.2, -2.2, 2.35, 0.3))
_FLOOR = Coat(stones(["#c9c0b0", "#a39a8c", "#8a7f74", "#d8cfbf", "#b5654a", "#5f6f6a"], "#e2dccf", 0.062, 2720), 0.02)
_OAK = pt.wood("#c9a06c", "#94683c", 2701)
_SMOKED = pt.wood("#5f4a38", "#362719", 2702)


def meeting_room() -> tuple[Piece, Lighting]:
    """Everything in it, and its light."""
    sides = walls(_CORNERS_M, _HEIGHT_M)
    north = sides[0]
    lighting = Lighting(
        (-3.2, -3.1, 0.0),
        (3.2, 3.1, _HEIGHT_M),
        tuple(north.window(w) for w in _WINDOWS),
        _LAMPS_M,
        sun=(-0.6, -1.0, -0.8),
    )
    smooth = Coat(plaster("#e6e2d8", "#c9c2b2", 2710))
    wine = Coat(plaster("#8a4a52", "#6b343c", 2711))
    glaze = Coat(
        tiles(["#d8a04a", "#cf9440", "#e2ad58", "#c9883a"], "#efe8da", (0.2, 0.1), 2712),
        columns_m=lambda m: joints(0.2, 8, m),
        rows_m=lambda m: joints(0.1, 4, m),
    )
    oak = Coat(slats("#c9a06c", "#94683c", 2713), 0.02, columns_m=lambda m: joints(0.06, 2, m))
    coats = [smooth, oak, smooth, glaze, glaze, glaze, wine, Coat(concrete("#a9a8a4", 2714))]
    built = [
        enclosed(sides, coats, {0: _WINDOWS, 6: (_DOOR,)}),
        lining(_CORNERS_M, sides, {0: _WINDOWS, 6: (_DOOR,)}),
        ground(_CORNERS_M, _FLOOR),
        ceiling(_CORNERS_M, _HEIGHT_M, Coat(plaster("#dcd9d0", "#b5b2a8", 2721, stroke=0.9), 0.028)),
        *(skirting(w, "#5f4a38", (_DOOR,) if k == 6 else (), 0.08) for k, w in enumerate(sides)),
        *(
            glazed(north, w, city(2730 + k, ("#e0e6ea", "#7f9cc0")), 2733 + k, hung=_CURTAINS)
            for k, w in enumerate(_WINDOWS)
        ),
        closed_door(sides[6], _DOOR, "#5f4a38"),
        *(tube_light((-2.1, y, 2.36), 3.6, _HEIGHT_M) for y in (0.85, 1.35)),
        tube_light((0.4, -2.2, 2.36), 1.6, _HEIGHT_M),
        solid((-3.2, -3.1, 0.0), (-0.2, -1.5, _HEIGHT_M)),
        solid((2.6, -3.1, 0.0), (3.2, -1.5, _HEIGHT_M)),
    ]
    return joined([*built, *_table(), *_alcove(sides), *_decor(sides)]), lighting


_CURTAINS = ["#8a4a52", "#e6e2d8", "#8a4a52", "#6b343c", "#8a4a52", "#c9a06c"]
_TABLE_M = (-0.4, 1.1)


def _table() -> list[Piece]:
    x, y = _TABLE_M
    cloths = [
        pt.weave(c, thread, 2740 + k, thread_m=0.022)
        for k, (c, thread) in enumerate((("#7b3c46", "#9a5a60"), ("#3f5252", "#5f7676"), ("#a9803f", "#c9a568")))
    ]
    parts = [placed(conference_table(3.2, 1.2, _SMOKED), (x, y, 0.0))]
    for k in range(8):
        side = -1 if k < 4 else 1
        at = (
            x - 1.2 + 0.8 * (k % 4) + pt.pick(k, 2741, -0.1, 0.1),
            y + side * (0.95 + pt.pick(k, 2742, -0.15, 0.12)),
            0.0,
        )
        turn = (0.0 if side < 0 else 180.0) + pt.pick(k, 2743, -35.0, 35.0)
        parts.append(placed(swivel_chair(cloths[k % 3]), at, turn))
    top = DESK_M + 0.0005

    def on(dx: float, dy: float) -> Point:
        return x + dx, y + dy, top

    return [
        *parts,
        placed(laptop(2750), on(-1.1, -0.3), 8.0),
        placed(laptop(2751), on(0.5, -0.28), -10.0),
        placed(laptop(2752), on(-0.35, 0.3), 175.0),
        placed(papers(2753), on(1.2, 0.25), 160.0),
        placed(papers(2756), on(-0.5, -0.33), 20.0),
        placed(papers(2759), on(-1.2, 0.3), 200.0),
        placed(mug(pt.stripes(["#8a4a52", "#e6e2d8"], [0.013, 0.009], 2760)), on(0.95, -0.2), 30.0),
        placed(mug(pt.terrazzo("#3f4a4a", ["#f3e6d0"], 2761, chip_m=0.02)), on(-0.75, 0.12), 130.0),
        placed(fruit_bowl(2762), on(0.65, 0.15)),
    ]


def _alcove(sides: list[Wall]) -> list[Piece]:
    inner_east, south, inner_west = sides[3], sides[4], sides[5]
    sand = pt.plain("#d8cdb8", 2770, grain=0.08, grain_m=0.022, patch=0.08, fleck=0.08)
    return [
        south.before(units(4, sand, _SMOKED, 0, 2), 0.2),
        south.before(clutter(), 0.2, TOP_M + 0.0005),
        south.before(wall_units(4, _OAK, low_m=1.55, high_m=2.25), 0.2),
        placed(stool(_OAK), (2.25, -1.95, 0.0)),
        inner_east.before(
            framed(0.5, 0.66, poster(0.5, 0.66, 2771, ("#3f4a4a", "#e6e2d8", *_SHAPES)), _SMOKED), 0.5, 1.65
        ),
        inner_west.before(framed(0.46, 0.6, pic.botanical(0.46, 0.6, 2772, "#3f5a4a"), _OAK, mat_m=0.03), 1.1, 1.65),
    ]


_SHAPES = ("#d8a04a", "#8a4a52", "#5f8078", "#e6dcc4")


def _decor(sides: list[Wall]) -> list[Piece]:
    north, east, corner, wall, west = sides[0], sides[1], sides[2], sides[6], sides[7]
    hills = ("#8fa3b0", "#e8d8b8", "#fff4d2", "#a3aa98", "#7f8a78", "#8a4a52", "#5f343c", "#3a2a2c")
    mustard = pt.weave("#a9803f", "#e6d0a0", 2780, thread_m=0.02)
    felt = [pt.weave(c, "#a89a88", 2781 + k, thread_m=0.02) for k, c in enumerate(("#8a4a52", "#5f8078", "#a9803f"))]
    panels = [
        shadeless(rounded_box((-0.25, -0.04, 0.0), (0.25, 0.0, 0.5), 0.02, 0.0175, felt[(j + 2 * k) % 3]))
        for j in range(3)
        for k in range(2)
    ]
    return [
        west.before(cabinet((2.2, 0.62, 0.42), 4, _SMOKED, _OAK), 2.6),
        west.before(placed(television(), (0.0, -0.2, 0.0)), 2.6, 0.6205),
        west.before(placed(trailing_plant(), (0.0, -0.2, 0.0)), 3.5, 0.6205),
        east.before(board(2.2, 1.15, 2790), 2.0, 0.95),
        *(wall.before(panel, 1.6 + 0.52 * (k // 2), 1.1 + 0.52 * (k % 2)) for k, panel in enumerate(panels)),
        placed(armchair(mustard, _OAK), (-2.55, -0.85, 0.0), 125.0),
        placed(pouf(["#5f8078", "#557468", "#48655c"]), (-1.75, -0.75, 0.0)),
        placed(potted_palm(), (-2.8, 2.7, 0.0), 20.0),
        placed(potted_palm(), (2.85, 2.75, 0.0), 140.0),
        north.before(radiator(1.3), 1.6),
        north.before(radiator(1.3), 4.0),
        north.before(clock(), 5.75, 1.9, 0.035),
        west.before(framed(0.5, 0.66, pic.circles(0.5, 2791), _SMOKED, mat_m=0.04), 0.6, 1.65),
        west.before(framed(0.6, 0.42, pic.landscape(0.6, 0.42, 2792, hills), _OAK), 4.1, 1.9),
        corner.before(framed(0.3, 0.4, pic.blocks(0.3, 0.4, 2793), _SMOKED), 0.3, 1.6),
        placed(flowers(), (-2.95, 1.9, 0.6205)),
    ]
