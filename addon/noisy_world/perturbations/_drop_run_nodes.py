# SPDX-License-Identifier: GPL-3.0-or-later
"""Drops that run down the glass, as nodes: as `_drop_runs` paints them, found anew at each pixel."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..core.node_graphs.graph import Socket
from ..core.node_graphs.groups import Canvas
from ._drop_laws import (
    ASIDE,
    BEAD_RADIUS,
    BEAD_START,
    BEADS,
    BELOW,
    HIGHEST,
    LOWEST,
    PRESENT,
    REST,
    RUN_RADIUS,
    SMALL_AT_REST,
    STICK,
    STRIP,
    STRIP_START,
    TAIL,
    TAPER,
    TRACK,
    TRAIL,
    TURNS,
    WINDING,
)
from ._drop_sheet_nodes import SheetNodes

RUN_INPUTS = {
    "Size": "Median diameter of all drops, in pixels of the reference width",
    "Height": "Rows of the frame, at the reference width",
    "Share": "Share of the strips down which a drop runs",
    "Run": "Rows that a drop has run since the first frame",
}


@dataclass(frozen=True)
class _Run:
    """What runs down each pixel's strip, as `Runs`. aside_px: how far the pixel is from its way."""

    there: Socket
    number: Socket
    begin_px: Socket
    at_px: Socket
    radius_px: Socket
    aside_px: Socket


def run_nodes(canvas: Canvas, own: Mapping[str, Socket], sheet: SheetNodes) -> SheetNodes:
    """Add a running drop, its beads and its track to each strip that has one."""
    graph = canvas.graph
    run = _run(canvas, own, sheet)
    behind_px = run.at_px - sheet.y_px
    per_px = graph.math("DIVIDE", 1.0, run.radius_px)
    with graph.section("Running drop"):
        above = graph.math("MAXIMUM", behind_px * per_px, 0.0)
        narrow = graph.math("MULTIPLY_ADD", graph.math("MINIMUM", above * 0.5, 1.0), -TAPER, 1.0)
        # Above its middle it is drawn out: shortened to TAIL.
        down = graph.math("MULTIPLY_ADD", above, 1 - TAIL, behind_px * per_px * -1.0)
        sheet = sheet.with_drop(run.aside_px * per_px / narrow, down, 1.0 - run.there)
    per_trail = graph.math("DIVIDE", 1 / TRAIL, own["Size"])
    sheet = _with_beads(canvas, own["Size"], per_trail, run, sheet)
    with graph.section("Track"):
        fresh = graph.clamp(graph.math("MULTIPLY_ADD", behind_px * per_trail, -2.0, 2.0))
        across = run.aside_px * per_px * (1 / TRACK)
        wiped = graph.clamp(graph.math("MULTIPLY_ADD", across * across, -3.0, 3.0)) * fresh
        wiped = wiped * (behind_px > 0.0) * (sheet.y_px > run.begin_px) * run.there
        return replace(sheet, taken=graph.math("MAXIMUM", sheet.taken, wiped))


def _run(canvas: Canvas, own: Mapping[str, Socket], sheet: SheetNodes) -> _Run:
    graph, size_px, height_px = canvas.graph, own["Size"], own["Height"]
    with graph.section("A strip's running drop"):
        strip_px = size_px * STRIP
        u = graph.math("MULTIPLY_ADD", sheet.x_px, graph.math("DIVIDE", 1.0, strip_px), STRIP_START)
        strip = graph.math("FLOOR", u)
        clock = canvas.random(8, graph.vector(strip, 0.0))
        rate = own["Run"] / (height_px * (BELOW / (1 - REST)))
        turned = graph.math("MULTIPLY_ADD", graph.math("MULTIPLY_ADD", clock.y, 0.8, 0.6), rate, clock.x)
        turn = graph.math("FLOOR", turned)
        age = turned - turn
        often = graph.math("FRACT", graph.math("MULTIPLY_ADD", turn, PRESENT, clock.z))
        number = graph.math("MULTIPLY_ADD", turn, float(TURNS), strip)
        drawn = canvas.random(9, graph.vector(number, 0.0))
        begin_px = height_px * graph.math("MULTIPLY_ADD", drawn.x, LOWEST - HIGHEST, HIGHEST)
    with graph.section("How far it has run"):
        gone = graph.math("MAXIMUM", (age - REST) * (1 / (1 - REST)), 0.0)
        way = gone
        for amplitude, waves in STICK:
            way = graph.math("MULTIPLY_ADD", graph.math("SINE", gone * (2 * math.pi * waves)), amplitude, way)
        at_px = graph.math("MULTIPLY_ADD", way, height_px * BELOW - begin_px, begin_px)
        rested = graph.math("MINIMUM", age * (1 / REST), 1.0)
        grown = graph.math("SQRT", graph.math("MULTIPLY_ADD", rested, 1 - SMALL_AT_REST, SMALL_AT_REST))
        radius_px = graph.math("MULTIPLY_ADD", drawn.z, RUN_RADIUS[1], RUN_RADIUS[0]) * grown * size_px
    with graph.section("From its way"):
        beside = graph.math("MULTIPLY_ADD", drawn.y - 0.5, ASIDE, 0.5)
        aside = (u - strip - beside) * strip_px
        for (amplitude, length), shift in zip(WINDING, (drawn.y, drawn.x), strict=True):
            per_px = graph.math("DIVIDE", 1 / length, size_px)
            wave = graph.math("SINE", graph.math("MULTIPLY_ADD", sheet.y_px, per_px, shift * (4 * math.pi)))
            aside = graph.math("MULTIPLY_ADD", wave, size_px * -amplitude, aside)
    return _Run(often < own["Share"], number, begin_px, at_px, radius_px, aside)


def _with_beads(canvas: Canvas, size_px: Socket, per_trail: Socket, run: _Run, sheet: SheetNodes) -> SheetNodes:
    graph = canvas.graph
    with graph.section("Beads"):
        step_px = size_px * BEADS
        per_step = graph.math("DIVIDE", 1.0, step_px)
        bead = graph.math("FLOOR", graph.math("MULTIPLY_ADD", sheet.y_px, per_step, BEAD_START))
        drawn = canvas.random(10, graph.vector(run.number, bead))
        bead_px = (graph.math("MULTIPLY_ADD", drawn.z, 0.5, 0.25 - BEAD_START) + bead) * step_px
        fade = graph.clamp(1.0 - (run.at_px - bead_px) * per_trail)
        left = (bead_px < graph.math("MULTIPLY_ADD", run.radius_px, -1.3, run.at_px)) * (bead_px > run.begin_px)
        thick = graph.math("MULTIPLY_ADD", drawn.x * drawn.x, BEAD_RADIUS[1], BEAD_RADIUS[0]) * size_px
        per_bead = graph.math("DIVIDE", 1.0, graph.math("MAXIMUM", thick * graph.math("SQRT", fade), 1e-3))
        right = graph.math("MULTIPLY_ADD", (drawn.y - 0.5) * size_px, -0.5, run.aside_px)
        return sheet.with_drop(right * per_bead, (sheet.y_px - bead_px) * per_bead, 1.0 - left * run.there)
