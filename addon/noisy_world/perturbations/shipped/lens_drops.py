# SPDX-License-Identifier: GPL-3.0-or-later
"""Water drops on the front glass: each a small lens that shows the scene upside down, dark at its rim."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Graph, GroupInput, Socket, Value
from ..groups import PURPOSES, Canvas
from ..kinds import About, ColourPerturbation, Example, FrameContext, Nodes
from ._arrays import by_camera
from ._drops import (
    ASIDE,
    BEAD_RADIUS,
    BEAD_START,
    BEADS,
    BELOW,
    CAUSTIC_AT,
    CAUSTIC_WIDTH,
    CELL_HEIGHT,
    CELL_WIDTH,
    CLASSES,
    CLEAR,
    GLINT_AT,
    GLINT_RADIUS,
    HALVINGS,
    HIGHEST,
    LARGEST,
    LOGISTIC,
    LOWEST,
    PRESENT,
    REST,
    ROW_SHIFT,
    RUN_RADIUS,
    SAG,
    SLANT,
    SMALL_AT_REST,
    START,
    STICK,
    STRIP,
    STRIP_START,
    TAIL,
    TALL,
    TAPER,
    TRACK,
    TRAIL,
    TURNS,
    UNMARKED,
    WAVES,
    WINDING,
    LensDrops,
    bent_nodes,
    drying_rate,
    of_class,
    seen_through,
)
from ._glass import GlassNodes, glass_nodes, laid_over_nodes, mean_of, reduced_nodes, sampled

# The sheet that drops are painted on, as nodes: `Sheet` of `_drop_sheet`, with one drop after another added.


ABSENT = 1e3  # added to the square of the distance from a drop that is not there


@dataclass(frozen=True)
class SheetNodes:
    """As `Sheet`: each pixel's place on the even glass; the drop that it lies in; what is taken."""

    graph: Graph
    x_px: Socket
    y_px: Socket
    rho_squared: Value = 1.0
    aside: Value = 0.0
    down: Value = 0.0
    taken: Value = 0.0

    @classmethod
    def of(cls, graph: Graph, x_px: Socket, y_px: Socket) -> "SheetNodes":
        """Return a sheet without drops."""
        return cls(graph, x_px, y_px)

    def with_drop(self, aside: Socket, down: Socket, absent: Socket) -> "SheetNodes":
        """Return the sheet with a drop at each pixel, where none is yet: the place from its middle, in radii."""
        graph = self.graph
        squared = graph.math("MULTIPLY_ADD", absent, ABSENT, graph.math("MULTIPLY_ADD", down, down, self.taken))
        squared = graph.math("MULTIPLY_ADD", aside, aside, squared)
        inside = squared < 1.0
        shown = graph.math("MULTIPLY_ADD", self.taken, -UNMARKED, squared)
        return replace(
            self,
            rho_squared=graph.math("MULTIPLY_ADD", shown - 1.0, inside, self.rho_squared),
            aside=graph.math("MULTIPLY_ADD", aside, inside, self.aside),
            down=graph.math("MULTIPLY_ADD", down, inside, self.down),
            taken=graph.math("MAXIMUM", CLEAR - squared, self.taken),
        )

    def after(self, canvas: Canvas, part: Graph, given: Mapping[str, Value], name: str) -> "SheetNodes":
        """Return the sheet after a group of `sheet_graph`. given: the group's own inputs by name. name: of the node."""
        assert canvas.seed is not None
        assert canvas.key is not None
        inputs = dict(zip(_SHEET, (getattr(self, item) for item in _FIELDS), strict=True))
        made = self.graph.group(part, {"Seed": canvas.seed, "Key": canvas.key, **inputs, **given}, name=name)
        found = {item: made.out(label, "float") for item, label in zip(_FIELDS[2:], tuple(_SHEET)[2:], strict=True)}
        return replace(self, **found)


_FIELDS = ("x_px", "y_px", "rho_squared", "aside", "down", "taken")
_SHEET = {
    "X": "Each pixel's place on the glass, from the left",
    "Y": "Each pixel's place on the glass, from the top",
    "Rho Squared": "Square of the distance from the middle of its drop, in radii; 1 where there is none",
    "Aside": "Direction from there, to the right",
    "Down": "Direction from there, down",
    "Taken": "Where this is 1 there are no further drops",
}


def sheet_graph(
    name: str,
    description: str,
    own: Mapping[str, str],
    draw: Callable[[Canvas, Mapping[str, Socket], SheetNodes], SheetNodes],
    canvas: Canvas,
) -> Graph:
    """Describe a group that adds drops to a sheet. own: meanings of its own inputs by name. canvas: of the whole."""
    graph = Graph(name, description, alone=True)
    seed = graph.input(GroupInput("Seed", "int", 0, "The pattern's"))
    key = graph.input(GroupInput("Key", "float", 0.0, "The frame's, where each has a pattern of its own"))
    sheet = [graph.input(GroupInput(label, "float", 0.0, text)) for label, text in _SHEET.items()]
    taken = {label: graph.input(GroupInput(label, "float", 1.0, text)) for label, text in own.items()}
    before = SheetNodes(graph, *sheet)
    after = draw(replace(canvas, graph=graph, seed=seed, key=key), taken, before)
    for item, (label, text) in list(zip(_FIELDS, _SHEET.items(), strict=True))[2:]:
        graph.output(label, getattr(after, item), "float", text)
    return graph


# Drops that run down the glass, as nodes: as `_drop_runs` paints them, found anew at each pixel.


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


# Drops on the glass as nodes: the same drops as `_drops` paints, found anew at each pixel of the glass's image.


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
        near = (rho - CAUSTIC_AT) * (1 / CAUSTIC_WIDTH)
        near = graph.math("MAXIMUM", graph.math("MULTIPLY_ADD", near * near, -1.0, 1.0), 0.0)
        below = graph.math("MAXIMUM", down, 0.0)
        gathered = graph.math("MULTIPLY_ADD", near * near * below * below, given["caustic"], cap.passes)
        passes = graph.vector(gathered, gathered, gathered)
        light = graph.math("MULTIPLY_ADD", seen, passes, mean_of(small) * graph.vector(own, own, own))
        cover = rho_squared < 1.0
        return light * graph.vector(cover, cover, cover), cover


def apply(rgb: NDArray[np.float32], parameters: LensDrops, context: FrameContext) -> NDArray[np.float32]:
    """Look at (H, W, 3) through drops."""
    return seen_through(rgb, parameters, context)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Draw the drops on a smaller image, blur them, and lay them over the frame."""
    return build_drops(canvas, given)


PERTURBATION = ColourPerturbation(
    name="lens_drops",
    label="Lens drops",
    stage="lens",
    order=60,
    parameters=LensDrops,
    severities={
        "coverage": (0.04, 0.08, 0.14, 0.21, 0.3),
        "runs": (0.05, 0.15, 0.25, 0.35, 0.45),
    },
    newly={"caustic": 1.5},
    source="our own: from the first drops to a lens in the rain",
    about=About(
        "Puts drops of water on the front glass, which show the scene upside down, run and dry",
        "drops of water on the front glass, which refract, run and dry",
        example=Example(
            text="Drops on the lens in the embedded room, which run and dry, clean and at severities 1, 3 and 5."
        ),
    ),
    apply=apply,
    nodes=Nodes(build, linear=True, draws_lit=True, by_camera=by_camera),
    temporals=("drift", "fixed", "fresh"),
)
