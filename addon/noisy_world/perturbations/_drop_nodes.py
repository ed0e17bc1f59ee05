# SPDX-License-Identifier: GPL-3.0-or-later
"""Drops on the glass as nodes: the same drops as `_drops` paints, found anew at each pixel of the glass's image."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TypeAlias

from ..core.node_graphs.graph import Socket
from ..core.node_graphs.groups import PURPOSES, Canvas
from ._drop_laws import (
    CELL_HEIGHT,
    CELL_WIDTH,
    CLASSES,
    GLINT_AT,
    GLINT_RADIUS,
    HALVINGS,
    LARGEST,
    LOGISTIC,
    PRESENT,
    ROW_SHIFT,
    SAG,
    SLANT,
    START,
    TALL,
    TURNS,
    WAVES,
    drying_rate,
    of_class,
)
from ._drop_optics import bent_nodes
from ._drop_run_nodes import RUN_INPUTS, run_nodes
from ._drop_sheet_nodes import SheetNodes, sheet_graph
from ._glass_nodes import GlassNodes, glass_nodes, laid_over_nodes, mean_of, reduced_nodes, sampled

Given: TypeAlias = Mapping[str, Socket]


def build_drops(canvas: Canvas, given: Given) -> Socket:
    """Draw drops before an image of linear light. given: a socket for each parameter of lens_drops."""
    graph = canvas.graph
    # Lengths are given in pixels of the image; drops have their places at the reference width.
    with graph.section("Sizes"):
        given = {name: value / canvas.scale if name.endswith("_px") else value for name, value in given.items()}
    glass = glass_nodes(canvas, given["focus_px"])
    sheet = SheetNodes.of(graph, *_uneven(canvas, glass, given["size_px"]))
    runs = sheet_graph("Running Drops", "Drops that run down, and their beads", RUN_INPUTS, run_nodes, canvas)
    with graph.section("Drops that run"):
        inputs = {"Size": given["size_px"], "Height": glass.height_px, "Share": given["runs"]}
        inputs |= {"Run": canvas.drift_frames * given["run_px"]}
        sheet = sheet.after(canvas, runs, inputs, name="Running drops")
    part = sheet_graph("Drops of a Size", "Drops of an octave of diameters", _OWN, _class_nodes, canvas)
    for number, share in enumerate(_shares(given)):
        with graph.section("Drops that sit"):
            largest = given["size_px"] * (LARGEST * 0.5**number)
            inputs = {"Largest": largest, "Share": share, "Start": START[number], "Tall": TALL[number]}
            inputs |= {
                "Sag": SAG[number],
                "Turns": canvas.drift_frames * given["drying"] * drying_rate(number),
            }
            # Its random numbers are those of purposes 2 x number and the next one.
            sheet = sheet.after(canvas, part, inputs | {"Purpose": 2.0 * number}, name=f"Drops {number + 1}")
    light, cover = _refracted(canvas, given, glass, sheet)
    return laid_over_nodes(canvas, glass, light, cover)


def _uneven(canvas: Canvas, glass: GlassNodes, size_px: Socket) -> tuple[Socket, Socket]:
    """Return each pixel's place on the even glass, as `uneven` does."""
    graph, x, y = canvas.graph, glass.x_px, glass.y_px
    with graph.section("Unevenness"):
        first, second = canvas.random(30), canvas.random(31)
        turns = [item * (2 * math.pi) for item in (first.x, first.y, first.z, second.x)]
        (large, long), (small, short) = (
            (size_px * amplitude, graph.math("DIVIDE", 1 / length, size_px)) for amplitude, length in WAVES
        )

        def wave(place: Socket, turn: Socket) -> Socket:
            return graph.math("SINE", graph.math("MULTIPLY_ADD", place, long, turn))

        def ripple(place: Socket, other: Socket, slant: float, turn: Socket) -> Socket:
            both = graph.math("MULTIPLY_ADD", other, slant, place)
            return graph.math("SINE", graph.math("MULTIPLY_ADD", both, short, turn))

        across = graph.math("MULTIPLY_ADD", wave(y, turns[0]), large, x)
        across = graph.math("MULTIPLY_ADD", ripple(y, x, SLANT, turns[1]), small, across)
        up = graph.math("MULTIPLY_ADD", wave(x, turns[2]), large, y)
        up = graph.math("MULTIPLY_ADD", ripple(x, y, -SLANT, turns[3]), small, up)
    return across, up


def _shares(given: Given) -> list[Socket]:
    """Return for each class the share of its cells that hold a drop, as `shares` does; one number each."""
    graph = given["coverage"].graph
    with graph.section("How many"):
        steep = graph.math("DIVIDE", -LOGISTIC * math.log(2), given["spread"])
        curve = [graph.math("DIVIDE", 1.0, graph.math("EXPONENT", steep * times) + 1.0) for times in (1.0, 2.0)]
        inner, outer = curve[0] - 0.5, curve[1] - curve[0]
        often = [outer, inner, inner, outer]
        classes = [of_class(number) for number in range(CLASSES)]
        area = inner * (classes[1].area + classes[2].area) + outer * (classes[0].area + classes[3].area)
        covered = graph.math("LOGARITHM", 1.0 - given["coverage"], math.e) * -1.0
        dense = covered / area
        return [dense * share * item.cell for share, item in zip(often, classes, strict=True)]


_OWN = {
    "Purpose": "Tells the random numbers of one size from those of another",
    "Largest": "Greatest diameter, in pixels of the reference width",
    "Share": "Share of the cells that hold a drop",
    "Start": "Cells before the frame's corner",
    "Tall": "Height over width",
    "Sag": "How much wider a drop is at its foot than in its middle",
    "Turns": "How often drops have dried since the first frame",
}


def _class_nodes(canvas: Canvas, own: Given, sheet: SheetNodes) -> SheetNodes:
    """Add the drops of a class, as `cells_of` and `paint_class` do."""
    graph, largest, tall = canvas.graph, own["Largest"], own["Tall"]
    with graph.section("Cells"):
        assert canvas.key is not None
        canvas = replace(canvas, key=graph.math("MULTIPLY_ADD", own["Purpose"], 1 / PURPOSES, canvas.key))
        width, height = largest * CELL_WIDTH, largest * CELL_HEIGHT
        v = graph.math("MULTIPLY_ADD", sheet.y_px, graph.math("DIVIDE", 1.0, height), own["Start"])
        row = graph.math("FLOOR", v)
        u = graph.math("MULTIPLY_ADD", sheet.x_px, graph.math("DIVIDE", 1.0, width), own["Start"])
        u = graph.math("MULTIPLY_ADD", row, ROW_SHIFT, u)
        column = graph.math("FLOOR", u)
    with graph.section("Clock"):
        clock = canvas.random(0, graph.vector(column, row))
        turned = graph.math("MULTIPLY_ADD", clock.y + 0.5, own["Turns"], clock.x)
        turn = graph.math("FLOOR", turned)
        often = graph.math("FRACT", graph.math("MULTIPLY_ADD", turn, PRESENT, clock.z))
        absent = 1.0 - (often < own["Share"])
        left = 1.0 - (turned - turn)
    with graph.section("Drop"):
        drawn = canvas.random(1, graph.vector(graph.math("MULTIPLY_ADD", turn, float(TURNS), column), row))
        diameter = graph.math("POWER", 0.5, drawn.x) * largest
        per_px = graph.math("DIVIDE", 2.0, diameter * graph.math("SQRT", left))
        # From the drop's middle: it lies in its cell as a whole.
        aside = (u - column - drawn.y) * width - diameter * (0.5 - drawn.y)
        down = (v - row - drawn.z) * height - diameter * (0.5 - drawn.z) * tall
        aside, down = aside * per_px, down * per_px / tall
        aside = aside * graph.math("MULTIPLY_ADD", down, own["Sag"] * -1.0, 1.0)
    with graph.section("On the sheet"):
        return sheet.with_drop(aside, down, absent)


def _refracted(canvas: Canvas, given: Given, glass: GlassNodes, sheet: SheetNodes) -> tuple[Socket, Socket]:
    """Return the light of the drops, 0 beside them, and where they are, as `refracted` does."""
    graph = canvas.graph
    small = reduced_nodes(canvas, HALVINGS)
    rho_squared, aside, down = sheet.rho_squared, sheet.aside, sheet.down
    assert isinstance(rho_squared, Socket)
    assert isinstance(aside, Socket)
    assert isinstance(down, Socket)
    with graph.section("Refraction"):
        focal_px = glass.width_px * 0.5 / graph.math("TANGENT", given["view_deg"] * (math.pi / 360))
        contact = graph.math("SINE", given["contact_deg"] * (math.pi / 180))
        cap = bent_nodes(graph, rho_squared, contact)
        long = graph.math("MULTIPLY_ADD", aside, aside, down * down)
        per = graph.math("DIVIDE", 1.0, graph.math("MAXIMUM", graph.math("SQRT", long), 1e-6))
        aside, down = aside * per, down * per
        far = cap.tangent * focal_px
        x = graph.math("PINGPONG", glass.x_px - aside * far, glass.width_px)
        y = graph.math("PINGPONG", glass.y_px - down * far, glass.height_px)
        share = graph.vector(x / glass.width_px, 1.0 - y / glass.height_px)
        seen = sampled(small, share)
    with graph.section("Light of the drops"):
        rho = graph.math("SQRT", rho_squared)
        apart_x = graph.math("MULTIPLY_ADD", aside, rho, -GLINT_AT[0])
        apart_y = graph.math("MULTIPLY_ADD", down, rho, -GLINT_AT[1])
        apart = graph.math("MULTIPLY_ADD", apart_x, apart_x, apart_y * apart_y)
        spot = graph.math("MAXIMUM", graph.math("MULTIPLY_ADD", apart, -(GLINT_RADIUS**-2), 1.0), 0.0)
        own = graph.math("MULTIPLY_ADD", 1.0 - cap.passes, given["rim"], spot * given["glint"])
        passes = graph.vector(cap.passes, cap.passes, cap.passes)
        light = graph.math("MULTIPLY_ADD", seen, passes, mean_of(small) * graph.vector(own, own, own))
        cover = rho_squared < 1.0
        return light * graph.vector(cover, cover, cover), cover
