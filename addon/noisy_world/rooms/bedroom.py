# SPDX-License-Identifier: GPL-3.0-or-later
"""Room 1: a bedroom of 4.4 x 4.0 m in blue and rose, with one window to the west."""

from . import finishes as pic
from . import surfaces as pt
from .building import Coat, Wall, ceiling, closed_door, door_hole, enclosed, glazed, ground, lining, skirting, walls
from .finishes import boards, facets, joints, plaster, quilt, wandering
from .furniture import armchair, basket, bed, cabinet, drawers, radiator, table_lamp, wall_shelf, wardrobe
from .light import Lighting
from .openings import garden_from
from .surfaces import Piece, joined, placed, shadeless
from .things import clock, floor_lamp, flowers, framed, mug, pendant, rug, stack, trailing_plant

_HEIGHT_M = 2.5
_CORNERS_M = ((-2.2, 2.0), (2.2, 2.0), (2.2, -2.0), (-2.2, -2.0))
_WINDOW = (1.15, 2.75, 0.85, 2.15)
_DOOR = door_hole(0.75)
_LAMPS_M = ((-1.45, 1.78, 0.95, 0.16), (0.95, 1.78, 0.95, 0.16), (-0.2, -0.4, 1.9, 0.16), (-1.8, -1.62, 1.5, 0.14))

_FLOOR = Coat(pt.planks("#d8cbb4", "#9d8a6d", "#5f5140", 2020), 0.024, rows_m=lambda length: pt.plank_rows(length, 4))
_CEILING = Coat(boards("#eeeae0", "#a8a396", 2021), 0.03, rows_m=lambda length: joints(0.16, 3, length))
_NIGHT = ["#27375c", "#31507a", "#1f2c4c", "#46648f", "#d9b8b0", "#2b4066"]
_ASH = pt.wood("#d9c9ae", "#a98d68", 2001)
_WHITE = pt.wood("#ece5d6", "#cdc1a8", 2002)


def bedroom() -> tuple[Piece, Lighting]:
    """Everything in it, and its light."""
    sides = walls(_CORNERS_M, _HEIGHT_M)
    _, _, south, west = sides
    lighting = Lighting(
        (-2.2, -2.0, 0.0), (2.2, 2.0, _HEIGHT_M), (west.window(_WINDOW),), _LAMPS_M, sun=(0.9, -0.45, -0.62), day=1.15
    )
    rose = Coat(plaster("#e6d3cb", "#c8a79d", 2010))
    pale = Coat(plaster("#e4e2da", "#bfc3c6", 2011))
    coats = [Coat(facets(_NIGHT, 0.21, 2012)), pale, rose, pale]
    built = [
        enclosed(sides, coats, {2: (_DOOR,), 3: (_WINDOW,)}),
        lining(_CORNERS_M, sides, {2: (_DOOR,), 3: (_WINDOW,)}),
        ground(_CORNERS_M, _FLOOR, turned=True),
        ceiling(_CORNERS_M, _HEIGHT_M, _CEILING),
        *(skirting(w, "#e9e6de", (_DOOR,) if w is south else ()) for w in sides),
        glazed(
            west, _WINDOW, garden_from(0.3), 2030,
            hung=["#31507a", "#e6d3cb", "#31507a", "#c9a35e", "#31507a", "#e4e2da"],
        ),
        closed_door(south, _DOOR, "#e2ddd0"),
    ]  # fmt: skip
    return joined([*built, *_furniture(sides), *_decor(sides)]), lighting


def _furniture(sides: list[Wall]) -> list[Piece]:
    north, east, south, west = sides
    linen = pt.stripes(["#f2ede2", "#e7dfd0", "#f2ede2", "#b9c3cf"], [0.05, 0.02, 0.04, 0.008], 2040)
    cover = quilt(["#31507a", "#e6d3cb", "#c98f8a", "#f0e6d6", "#7f94b5", "#c9a35e"], 0.17, 2041)
    cushion = pt.terrazzo("#c98f8a", ["#f0e6d6", "#27375c", "#c9a35e"], 2042, chip_m=0.045)
    velvet = pt.weave("#9c5f66", "#d9b8b0", 2043, thread_m=0.02)
    return [
        north.before(bed(1.6, _ASH, cover, linen, cushion), 2.0),
        *(north.before(cabinet((0.46, 0.55, 0.38), 1, _WHITE, _ASH), x) for x in (0.75, 3.15)),
        east.before(wardrobe((1.7, 2.12, 0.58), 3, _WHITE, _ASH), 1.35),
        south.before(drawers((1.3, 0.86, 0.46), 2, 4, _ASH, _WHITE), 2.55),
        placed(armchair(velvet, _ASH), (-1.62, -1.2, 0.0), 118.0),
        west.before(radiator(1.2), 1.95),
        east.before(wall_shelf(0.9, _ASH, 2050), 3.1, 1.5),
    ]


def _decor(sides: list[Wall]) -> list[Piece]:
    north, east, south, west = sides
    brass, dark = pt.wood("#c9a35e", "#8a6630", 2060), pt.wood("#4a3325", "#2a1c14", 2061)
    dusk = ("#2b3358", "#d98a6c", "#ffe2a0", "#7a5a78", "#5b4264", "#3a304e", "#221f38")
    shade = pt.stripes(["#f7dcc0", "#e9b89a"], [0.04, 0.02], 2062)
    glaze = pt.terrazzo("#e6d3cb", ["#31507a", "#c9a35e"], 2063, chip_m=0.03)
    lamps = [north.before(placed(table_lamp(glaze, shade), (0, -0.2, 0.0)), x, 0.551) for x in (0.75, 3.15)]
    wool = wandering(["#e9dfd0", "#c98f8a", "#31507a", "#d9b8b0", "#8fa0ba", "#f2ede2"], 2064)
    top = 0.861
    return [
        *lamps,
        placed(rug(wool, "#27375c", (2.5, 1.7)), (-0.2, -0.55, 0.0)),
        north.before(framed(1.2, 0.55, pic.landscape(1.2, 0.55, 2070, dusk), brass), 2.0, 1.72),
        south.before(framed(0.5, 0.66, pic.circles(0.5, 2071), dark, mat_m=0.05), 2.2, 1.58),
        south.before(framed(0.4, 0.54, pic.botanical(0.4, 0.54, 2072, "#31507a"), brass, mat_m=0.04), 2.95, 1.6),
        south.before(framed(0.4, 0.3, pic.blocks(0.4, 0.3, 2073), dark), 3.75, 1.5),
        west.before(framed(0.4, 0.52, pic.botanical(0.4, 0.52, 2074, "#7a4a4a"), brass, mat_m=0.03), 0.5, 1.55),
        west.before(clock(), 3.5, 1.75, 0.035),
        placed(basket("#b98a58", 2075), (1.75, -0.95, 0.0)),
        floor_lamp((-1.8, -1.62, 1.5), shade),
        pendant((-0.2, -0.4, 1.9), _HEIGHT_M, ["#c98f8a", "#c9a35e", "#c98f8a", "#a86f6c", "#c98f8a", "#c9a35e"]),
        south.before(placed(flowers(), (0.0, -0.22, 0.0)), 2.9, top),
        south.before(placed(shadeless(stack(4, 690, 12)), (0.0, -0.3, 0.0)), 2.2, top),
        north.before(placed(shadeless(stack(2, 693, -14)), (0.0, -0.32, 0.0)), 3.2, 0.551),
        north.before(placed(mug(glaze), (0.14, -0.28, 0.0), 30.0), 0.75, 0.551),
        east.before(placed(trailing_plant(), (0.0, -0.12, 0.0)), 3.45, 1.501),
    ]
