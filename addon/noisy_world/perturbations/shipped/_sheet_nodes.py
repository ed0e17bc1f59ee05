# SPDX-License-Identifier: GPL-3.0-or-later
"""Rain and snow that stay in the world, as nodes: sheets of particles that a moving camera passes and flies through.

The air is cut into slabs across one of the world's axes, the one that a pixel looks along most. Each slab has its
particles in a sheet, one in a cell of it, where a hash of the cell puts it, so no place repeats another. Where a
pixel's ray meets a sheet is arithmetic, and so a particle moves on the image as its distance says. Small particles
and large ones have sheets of their own, which fall at their own speeds.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TypeAlias

from ...core.node_graph import Graph, GroupInput, Kind, Socket
from ..groups import CameraSockets, Canvas
from ._particles import NEAR_M
from ._weather import EXCESS, MOST_OPAQUE, QUICK_LEAST, SOFTNESS, area_and_width

_GOLDEN = (math.sqrt(5) - 1) / 2
FIRST_PURPOSE = 16  # of the random numbers that key the sheets
START_SLABS = 64.0  # of slabs, in which a seed puts the camera; chosen
AXES, KEYS = 4.0, 2.0**20  # a sheet's number tells its axis too; with a key it is exact in float32
LEAST_ROOM = 0.3  # of a cell, in which a particle lies; the rest is for its streak


@dataclass(frozen=True)
class Sizes:
    """Particles of a range of sizes, in multiples of the mean diameter, and so of the distance at which that is seen.

    low, high: least and greatest. spacing: between sheets. sheets: how many are looked at. tilt: how far a sheet comes
    nearer for each metre along its sides, so that those in one have many distances; their sum is below 1.
    """

    low: float
    high: float
    spacing: float
    sheets: int
    tilt: tuple[float, float]

    @property
    def share(self) -> float:
        """Of all particles, whose sizes are distributed exponentially."""
        return math.exp(-self.low) - math.exp(-self.high)

    @property
    def typical(self) -> float:
        """The mean size of those that are seen: large ones are seen in a larger space, by the cube."""
        return 4 * (_gamma(5, self.low) - _gamma(5, self.high)) / (_gamma(4, self.low) - _gamma(4, self.high))


# Chosen: 2 % of what is seen is beyond the last sheet, and a sheet of large flakes comes every metre or so.
SIZES = (Sizes(0.0, 2.0, 0.5, 4, (-0.25, 0.2)), Sizes(2.0, EXCESS, 0.8, 9, (0.3, -0.15)))


def _gamma(order: int, x: float) -> float:
    """Return Q(order, x), the regularised upper incomplete gamma function of a whole order."""
    return math.exp(-x) * sum(x**k / math.factorial(k) for k in range(order))


Axes: TypeAlias = tuple[Socket, Socket, Socket]
"""Parts of a vector along each pixel's own axes: two across a sheet, and one through it."""


@dataclass(frozen=True)
class Rays:
    """Where pixels look. right_of, down_of: what a step along the world's axes is on the image, at a depth of 1.

    level: 1 where a pixel looks along the vertical most; aside: where along x, and otherwise along y. slope: (3,), how
    far a ray goes across the sheets for each metre through them, and its sense through them. through: the part of a
    ray of depth 1 that goes through them. right, down: what steps across a sheet are on the image.
    """

    right_of: Socket
    down_of: Socket
    aside: Socket
    level: Socket
    slope: Axes
    through: Socket
    right: Axes
    down: Axes


def _rays(graph: Graph, camera: CameraSockets, x: Socket, y: Socket) -> Rays:
    """Return where the pixels at x, y look, right and down at a depth of 1."""
    forward, below = camera.back * -1.0, camera.up * -1.0
    ray = graph.math("MULTIPLY_ADD", camera.right, _three(graph, x), forward)
    ray = graph.math("MULTIPLY_ADD", below, _three(graph, y), ray)
    size = graph.math("ABSOLUTE", ray)
    level = graph.math("GREATER_THAN", size.z, graph.math("MAXIMUM", size.x, size.y))
    aside = graph.math("GREATER_THAN", size.x, graph.math("MAXIMUM", size.y, size.z))
    right_of = graph.math("MULTIPLY_ADD", forward, _three(graph, x * -1.0), camera.right)
    down_of = graph.math("MULTIPLY_ADD", forward, _three(graph, y * -1.0), below)
    own, right, down = (_turned(graph, item, aside, level) for item in (ray, right_of, down_of))
    through = graph.math("ABSOLUTE", own[2])
    slope = own[0] / through, own[1] / through, own[2] / through
    return Rays(right_of, down_of, aside, level, slope, through, right, down)


def _turned(graph: Graph, vector: Socket, aside: Socket, level: Socket) -> Axes:
    """Return a vector of the world along each pixel's own axes."""
    along_y = graph.vector(vector.x, vector.z, vector.y)
    along_x = graph.vector(vector.y, vector.z, vector.x)
    found = graph.blend(graph.blend(along_y, along_x, aside), vector, level)
    return found.x, found.y, found.z


def _three(graph: Graph, value: Socket) -> Socket:
    return graph.vector(value, value, value)


def seen_through_sheets(
    canvas: Canvas,
    given: Mapping[str, Socket],
    shared: Mapping[str, Socket],
    speed_m_s: Mapping[Sizes, Socket],
) -> Socket:
    """Return the share of light that passes all sheets.

    shared: as for the shells. speed_m_s: of fall, by sizes.
    """
    camera = canvas.camera
    assert camera is not None
    assert canvas.seed is not None
    assert canvas.key is not None
    # In a group of their own: Blender makes a large group slowly.
    graph = Graph("Streaks in the World", "How much light passes the particles in sheets of the air")
    sockets = {f"Speed {number}": speed_m_s[sizes] for number, sizes in enumerate(SIZES, start=1)}
    sockets |= {name: shared[name] for name in (*_SHARED, *_FRAME)}
    sockets |= {"Seed": canvas.seed, "Frame": canvas.key, "Wind": given["wind_m_s"]}
    sockets |= {f"Camera {item.name}": getattr(camera, item.name) for item in fields(camera)}
    inside = {name: graph.input(_input(name, socket)) for name, socket in sockets.items()}
    own = CameraSockets(*(inside[f"Camera {item.name}"] for item in fields(camera)))
    there = replace(canvas, graph=graph, camera=own, seed=inside["Seed"], key=inside["Frame"], quick=None)
    speeds = {sizes: inside[f"Speed {number}"] for number, sizes in enumerate(SIZES, start=1)}
    graph.output("Seen", _seen(there, inside["Wind"], inside, speeds), "float", "Share of the light that passes")
    return canvas.graph.group(graph, sockets, name=graph.name).out("Seen", "float")


def _input(name: str, socket: Socket) -> GroupInput:
    default = 0.0 if socket.kind == "float" else 0 if socket.kind == "int" else (0.0, 0.0, 0.0)
    return GroupInput(name, socket.kind, default, "As the group around has it")


def _seen(canvas: Canvas, wind_m_s: Socket, shared: Mapping[str, Socket], speed_m_s: Mapping[Sizes, Socket]) -> Socket:
    """Return what `seen_through_sheets` does, inside its group."""
    graph, camera = canvas.graph, canvas.camera
    assert camera is not None
    with graph.section("Rays"):
        x, y = view_slopes(graph, shared)
        seen_along = _rays(graph, camera, x, y)
        open_px = shared["Focal length"] * shared["Exposure"]
        sweep = swept(graph, shared["Turning"], x, y)
        inputs = {name: shared[name] for name in _SHARED}
        inputs |= {"Sweep right": sweep[0] * open_px, "Sweep down": sweep[1] * open_px}
        inputs |= {
            "Slope across": seen_along.slope[0],
            "Slope along": seen_along.slope[1],
            "Sense": seen_along.slope[2],
        }
        inputs |= {"Through": seen_along.through, "Lean": shared["Gusts"] * open_px * math.sqrt(12)}
        part, seen = _sheet_graph(), graph.math("MULTIPLY", 1.0, 1.0)
    for number, sizes in enumerate(SIZES):
        with graph.section(f"Sheets {number + 1}"):
            blown_m_s = graph.vector(wind_m_s, 0.0, speed_m_s[sizes] * -1.0)
            own = inputs | _of_sizes(canvas, blown_m_s, shared, seen_along, sizes)
            key = graph.math("FLOOR", canvas.random_value(FIRST_PURPOSE + number) * KEYS) * AXES
            own["Key"] = graph.math("MULTIPLY_ADD", seen_along.level, 2.0, seen_along.aside) + key
            for ahead in range(sizes.sheets):
                made = graph.group(part, own | {"Ahead": float(ahead)}, name=f"Sheet {number + 1}.{ahead + 1}")
                seen = seen * made.out("Seen", "float")
    return seen


def view_slopes(graph: Graph, shared: Mapping[str, Socket]) -> tuple[Socket, Socket]:
    """Return how far each pixel looks to the right and down, at a depth of 1."""
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": shared["Nearness"]}).out("Pixel", "vector")
    step = graph.math("DIVIDE", 1.0, shared["Focal length"] * shared["Scale"])
    x = graph.math("MULTIPLY_ADD", pixel.x, step, (shared["Width"] - 1.0) * step * -0.5)
    return x, graph.math("MULTIPLY_ADD", pixel.y, step * -1.0, (shared["Height"] - 1.0) * step * 0.5)


def _of_sizes(
    canvas: Canvas, blown_m_s: Socket, shared: Mapping[str, Socket], seen_along: Rays, sizes: Sizes
) -> dict[str, Socket | float]:
    """Return what all sheets of these sizes are given."""
    graph, camera = canvas.graph, canvas.camera
    assert camera is not None
    spacing_m = shared["Seen to"] * sizes.spacing
    begun_m = canvas.random(FIRST_PURPOSE + len(SIZES)) * _three(graph, spacing_m * START_SLABS)
    drifted_m = graph.math("MULTIPLY_ADD", blown_m_s, _three(graph, shared["Time"] * -1.0), begun_m)
    place_m = _turned(graph, graph.math("ADD", camera.location, drifted_m), seen_along.aside, seen_along.level)
    sheared, slope = (_sheared(graph, part, sizes) for part in (place_m, seen_along.slope))
    slabs = sheared / spacing_m
    steps = {
        f"{name} {side}": graph.math("MULTIPLY_ADD", way[2], -tilt, part)
        for name, way in zip(_WAYS, (seen_along.right, seen_along.down), strict=True)
        for side, tilt, part in zip(_SIDES, sizes.tilt, way, strict=False)
    }
    open_px = shared["Focal length"] * shared["Exposure"]
    passing_px = graph.math("SUBTRACT", blown_m_s, camera.velocity) * _three(graph, open_px)
    side_m = graph.math("DIVIDE", 1.0, graph.math("SQRT", shared["Count"] * spacing_m * sizes.share))
    track_m = graph.math("ABSOLUTE", blown_m_s.z) * shared["Exposure"]
    # Longer than wide, as streaks are, but for a sheet that falls towards the camera.
    longer = graph.math("SQRT", graph.math("MINIMUM", track_m / side_m + 1.0, 3.0))
    across_m = graph.blend(side_m / longer, side_m, seen_along.level)
    along_m = graph.blend(side_m * longer, side_m, seen_along.level)
    wide_m = shared["Mean"] * (sizes.typical * 1.5e-3) + shared["Aperture"]
    return steps | {
        "Place across": place_m[0],
        "Place along": place_m[1],
        "Slabs": slabs,
        "Slab": graph.math("FLOOR", slabs),
        "Spacing": spacing_m / graph.math("ABSOLUTE", slope),
        "Cell across": across_m,
        "Cell along": along_m,
        "Room across": graph.math("MAXIMUM", 1.0 - wide_m / (side_m / longer), LEAST_ROOM),
        "Room along": graph.math("MAXIMUM", 1.0 - (wide_m + track_m) / (side_m * longer), LEAST_ROOM),
        "Run right": graph.math("DOT_PRODUCT", passing_px, seen_along.right_of),
        "Run down": graph.math("DOT_PRODUCT", passing_px, seen_along.down_of),
        "Low": sizes.low,
        "Held": 1.0 - math.exp(sizes.low - sizes.high),
    }


def _sheared(graph: Graph, parts: Axes, sizes: Sizes) -> Socket:
    """Return how far a vector goes through tilted sheets."""
    (across, along, through), (first, second) = parts, sizes.tilt
    return graph.math("MULTIPLY_ADD", across, first, graph.math("MULTIPLY_ADD", along, second, through))


def swept(graph: Graph, turning: Socket, x: Socket, y: Socket) -> tuple[Socket, Socket]:
    """Return what a point at rest seems to do, a second, at a focal length of 1, as the camera turns."""
    forward = graph.math("MULTIPLY_ADD", turning.x, y, turning.y * x * -1.0)
    right = graph.math("MULTIPLY_ADD", turning.z, y, turning.y * -1.0)
    down = graph.math("MULTIPLY_ADD", turning.z, x * -1.0, turning.x)
    return graph.math("MULTIPLY_ADD", forward, x, right), graph.math("MULTIPLY_ADD", forward, y, down)


_SHARED = {
    "Nearness": "1 / metres of what hides, at each pixel",
    "Least width": "Of a streak, in pixels of the reference width",
    "Focal length": "In pixels",
    "Seen to": "Metres at which the mean particle spans the least angle",
    "Mean": "Mean diameter, mm",
    "Aperture": "Metres",
    "Focus": "Metres",
}

_FRAME = ("Height", "Width", "Scale", "Count", "Gusts", "Exposure", "Time", "Turning")

_INPUTS = _SHARED | {
    "Ahead": "How many slabs are nearer",
    "Key": "Another number, other particles",
    "Place across": "Where the camera is among the particles across a sheet, metres",
    "Place along": "Where it is along the sheet's other side, metres",
    "Slabs": "How many slabs it has passed",
    "Slab": "The number of the one that it is in",
    "Spacing": "Metres through a slab, along the axis",
    "Slope across": "How far a ray goes across a sheet for each metre through it",
    "Slope along": "How far along its other side",
    "Sense": "1, or -1 where a ray goes against the axis",
    "Through": "Metres through the sheets for a metre of depth",
    "Right across": "What a step across a sheet is on the image, columns at a depth of 1",
    "Right along": "What one along its other side is",
    "Down across": "Rows likewise",
    "Down along": "Rows likewise",
    "Run right": "Pixels at a metre that the camera sees a particle go while the shutter is open, columns",
    "Run down": "Rows likewise",
    "Sweep right": "Pixels that a turning camera sees anything go meanwhile, columns",
    "Sweep down": "Rows likewise",
    "Lean": "Pixels at a metre that its own velocity moves a particle meanwhile, the range",
    "Cell across": "A cell's side, metres",
    "Cell along": "Its other side",
    "Room across": "Share of a cell in which its particle may lie",
    "Room along": "Share of its other side",
    "Low": "The least size, of the mean diameter's",
    "Held": "Share of the sizes above the least that are below the greatest",
}


def _sheet_graph() -> Graph:
    """Describe one sheet: how much of the light behind passes each pixel. Numbers take less time than vectors."""
    graph = Graph("Sheet of Particles", "How much light passes the particles in one sheet of the air", alone=True)
    taken = {name: graph.input(GroupInput(name, "float", 1.0, text)) for name, text in _INPUTS.items()}
    with graph.section("Where the ray meets the sheet"):
        sense = taken["Sense"]
        slab = graph.math("MULTIPLY_ADD", sense, taken["Ahead"], taken["Slab"])
        # Somewhere in its slab, so that they do not come at equal times.
        level = slab + graph.math("FRACT", slab * _GOLDEN)
        through_m = (level - taken["Slabs"]) * sense * taken["Spacing"]
        sides = [
            graph.math("MULTIPLY_ADD", taken[f"Slope {side}"], through_m, taken[f"Place {side}"])
            / taken[f"Cell {side}"]
            for side in _SIDES
        ]
    with graph.section("The particle in the cell"):
        corners = [graph.math("FLOOR", side) for side in sides]
        where = graph.vector(corners[0], corners[1], graph.math("MULTIPLY_ADD", slab, AXES, taken["Key"]))
        drawn = graph.node("ShaderNodeTexWhiteNoise", {"Vector": where}, {"noise_dimensions": "3D"})
        # Three numbers in one, which takes a sixth of the time: those after the first 8 of its 24 bits, and after 16.
        first = drawn.out("Value", "float")
        jitter = [graph.math("FRACT", first * scale) - 0.5 for scale in (2.0**8, 2.0**16)]
        apart_m = [
            graph.math("MULTIPLY_ADD", moved, taken[f"Room {name}"], corner - side + 0.5) * taken[f"Cell {name}"]
            for name, moved, corner, side in zip(_SIDES, jitter, corners, sides, strict=True)
        ]
        nearness = graph.math("DIVIDE", taken["Through"], through_m, label="1 / its depth in metres")
        rest = graph.math("MULTIPLY_ADD", first * taken["Held"], -1.0, 1.0)
        larger = taken["Low"] - graph.math("LOGARITHM", rest, math.e)
    with graph.section("Its streak"):
        area, width_px = area_and_width(graph, taken, larger, nearness)
        per_m = nearness * taken["Focal length"]
        away = [
            graph.math("MULTIPLY_ADD", apart_m[0], taken[f"{name} across"], apart_m[1] * taken[f"{name} along"]) * per_m
            for name in _WAYS
        ]
        runs = [
            graph.math(
                "MULTIPLY_ADD",
                graph.math("MULTIPLY_ADD", moved, taken["Lean"], taken[f"Run {name.lower()}"]),
                nearness,
                taken[f"Sweep {name.lower()}"],
            )
            for name, moved in zip(_WAYS, jitter, strict=True)
        ]
        # Never quite at rest, so that it has a direction.
        squared = graph.math("MULTIPLY_ADD", runs[0], runs[0], graph.math("MULTIPLY_ADD", runs[1], runs[1], 1e-8))
        length_px = graph.math("SQRT", squared)
        streak = _Streak(area, width_px, (away[0], away[1]), (runs[0], runs[1]), length_px, squared)
    hidden = _hidden(graph, streak, taken["Least width"])
    with graph.section("What passes"):
        there = (nearness > taken["Nearness"]) * (nearness < 1 / NEAR_M)
        there = there * (larger * taken["Seen to"] * nearness > 1.0)
        graph.output("Seen", 1.0 - hidden * there, "float", "Share of the light that passes")
    return graph


@dataclass(frozen=True)
class _Streak:
    """A particle's streak at each pixel, in pixels: the square of its size, its blurred width, how far its middle is
    away and how far it runs, right and down, and its length, plain and squared."""

    area: Socket
    width_px: Socket
    away: tuple[Socket, Socket]
    run: tuple[Socket, Socket]
    length_px: Socket
    squared: Socket


def _hidden(graph: Graph, streak: _Streak, least_px: Socket) -> Socket:
    """Return the share of light that a streak hides. least_px: the ramp of its edge, at least."""
    width_px, length_px = streak.width_px, streak.length_px
    with graph.section("Its streak"):
        along = graph.math("MULTIPLY_ADD", streak.away[0], streak.run[0], streak.away[1] * streak.run[1])
        part = graph.clamp(along / streak.squared, -0.5, 0.5) * -1.0
        off = [graph.math("MULTIPLY_ADD", run, part, item) for run, item in zip(streak.run, streak.away, strict=True)]
        off_px = graph.math("SQRT", graph.math("MULTIPLY_ADD", off[0], off[0], off[1] * off[1]))
        ramp = graph.math("MAXIMUM", width_px * SOFTNESS, least_px)
        edge = graph.math("MULTIPLY_ADD", width_px, 0.5, off_px * -1.0)
        covered = graph.clamp(graph.math("DIVIDE", edge, ramp) + 0.5)
        track = graph.math("MULTIPLY_ADD", width_px, math.pi / 4, length_px) * width_px
        share = graph.math("MINIMUM", graph.math("DIVIDE", streak.area * (math.pi / 4), track), MOST_OPAQUE)
        return share * covered


_SIDES = ("across", "along")
_WAYS = ("Right", "Down")


# Rain and snow in the world on lit frames: the sheets of `_sheet_nodes`, fewer and by few operations a pixel.
#
# Sheets are evenly apart, so the depth where a pixel's ray meets one is a multiple of its number, and all else follows
# from that depth. A cell's particle follows from the cell by arithmetic, which takes a third of the time of Blender's
# white noise. In float32 a product, and a sum after it, are the same on all processors, so both executions draw alike.


# Chosen: 2 % of what is seen is beyond the last sheet.
LIT_SIZES = (Sizes(0.0, 2.0, 0.5, 4, (-0.25, 0.2)), Sizes(2.0, EXCESS, 1.8, 4, (0.45, -0.25)))
LEAST_ROUND_PX = 2.0  # of a particle's width as it is drawn, so that pixels sample it evenly; it is fainter instead
LEAST_SQUARE = (LEAST_ROUND_PX / 2) ** 2  # of its radius
SPREAD = math.sqrt(0.5)  # of a run: the half axis of an ellipse as wide
LIT_KEYS = 64.0  # a sheet's key is less; it keeps the digits of what is added to it
# Of the numbers that a cell draws, chosen: irrational steps, and slopes so steep that no part of 512 x 512 cells
# correlates with another by more than 0.04.
COLUMN, ROW, SHEET = 0.6180339887, 0.4142135624, 0.0973
BENT, STEEP, APART = 1543.7, 739.3, (331.7, -577.3)
ZONES = (0.71, 0.37)  # added to the key where a pixel looks along x, and along z, most

Parts: TypeAlias = tuple[Socket, Socket, Socket]
"""Of a vector."""


def seen_through_lit_sheets(
    canvas: Canvas,
    given: Mapping[str, Socket],
    shared: Mapping[str, Socket],
    speed_m_s: Mapping[Sizes, Socket],
    longest: float,
) -> Socket:
    """Return the share of light that passes all sheets.

    shared: as for the shells. speed_m_s: of fall, by sizes. longest: of a streak, in widths.
    """
    graph, camera = canvas.graph, canvas.camera
    assert camera is not None
    with graph.section("Round streaks in the world"):
        x, y = view_slopes(graph, shared)
        spread_px = shared["Focal length"] * shared["Exposure"] * SPREAD
        sweep = swept(graph, shared["Turning"], x, y)
        inputs: dict[str, Socket | float] = {
            "Nearness": shared["Nearness"],
            "X": x,
            "Y": y,
            "Sweep right": sweep[0] * spread_px,
            "Sweep down": sweep[1] * spread_px,
            "Right": camera.right,
            "Below": camera.up * -1.0,
            "Forward": camera.back * -1.0,
            "Focal length": shared["Focal length"],
            "Half size": shared["Mean"] * shared["Focal length"] * 0.5e-3,
            "Half blur": shared["Aperture"] * shared["Focal length"] * 0.5,
            "Focus": graph.math("DIVIDE", 1.0, shared["Focus"]),
            "Least": graph.math("DIVIDE", 1.0, shared["Seen to"]),
            "Lean": shared["Gusts"] * spread_px * math.sqrt(12),
            "Longest": 1.0 + (2 * SPREAD * longest) ** 2,
            "Least square": graph.choose(given["coarse"], QUICK_LEAST**2 * LEAST_SQUARE, LEAST_SQUARE, "float"),
        }
        for number, sizes in enumerate(LIT_SIZES, start=1):
            blown_m_s = graph.vector(given["wind_m_s"], 0.0, speed_m_s[sizes] * -1.0)
            own = _lit_of_sizes(canvas, blown_m_s, shared, sizes)
            passing = graph.math("SUBTRACT", blown_m_s, camera.velocity)
            own["Passing"] = passing * graph.vector(spread_px, spread_px, spread_px)
            own["Key"] = canvas.random_value(FIRST_PURPOSE + number - 1) * LIT_KEYS
            inputs |= {f"{name} {number}": value for name, value in own.items()}
        return graph.group(_sheets_graph(), inputs, name="Round Streaks").out("Seen", "float")


def _lit_of_sizes(
    canvas: Canvas, blown_m_s: Socket, shared: Mapping[str, Socket], sizes: Sizes
) -> dict[str, Socket | float]:
    """Return what the group is told of these sizes, each one number or one vector for the frame."""
    graph, camera = canvas.graph, canvas.camera
    assert camera is not None
    spacing_m = shared["Seen to"] * sizes.spacing
    begun_m = canvas.random(FIRST_PURPOSE + len(LIT_SIZES)) * _three(graph, spacing_m * START_SLABS)
    drifted_m = graph.math("MULTIPLY_ADD", blown_m_s, _three(graph, shared["Time"] * -1.0), begun_m)
    side_m = graph.math("DIVIDE", 1.0, graph.math("SQRT", shared["Count"] * spacing_m * sizes.share))
    track_m = graph.math("ABSOLUTE", blown_m_s.z) * shared["Exposure"]
    # Longer than wide, as streaks are, but for a sheet that falls towards the camera.
    longer = graph.math("SQRT", graph.math("MINIMUM", track_m / side_m + 1.0, 3.0))
    wide_m = shared["Mean"] * (sizes.typical * 1.5e-3) + shared["Aperture"]
    return {
        "Place": graph.math("ADD", camera.location, drifted_m),
        "Spacing": spacing_m,
        "Cell across": side_m / longer,
        "Cell along": side_m * longer,
        "Cell level": side_m,
        "Room across": graph.math("MAXIMUM", 1.0 - wide_m / (side_m / longer), LEAST_ROOM),
        "Room along": graph.math("MAXIMUM", 1.0 - (wide_m + track_m) / (side_m * longer), LEAST_ROOM),
    }


_LIT_SHEET_NODES_INPUTS: Mapping[str, tuple[Kind, str]] = {
    "Nearness": ("float", "1 / metres of what hides, at each pixel"),
    "X": ("float", "How far a pixel looks to the right, at a depth of 1"),
    "Y": ("float", "How far down"),
    "Sweep right": ("float", "Pixels that a turning camera spreads anything over while the shutter is open, columns"),
    "Sweep down": ("float", "Rows likewise"),
    "Right": ("vector", "The camera's axis in the world"),
    "Below": ("vector", "Likewise"),
    "Forward": ("vector", "Likewise"),
    "Focal length": ("float", "In pixels"),
    "Half size": ("float", "Of the mean particle, pixels at a metre"),
    "Half blur": ("float", "Of the aperture, pixels at a metre"),
    "Focus": ("float", "1 / metres"),
    "Least": ("float", "1 / metres, of the distance at which the mean particle spans the least angle"),
    "Lean": ("float", "Pixels at a metre that its own velocity spreads a particle over meanwhile, the range"),
    "Longest": ("float", "Square of a streak's length in widths, at most"),
    "Least square": ("float", "Square of the radius that it is drawn with at least, pixels"),
}
_INPUTS_OF_SIZES: Mapping[str, tuple[Kind, str]] = {
    "Place": ("vector", "Where the camera is among the particles, metres"),
    "Spacing": ("float", "Metres between sheets"),
    "Cell across": ("float", "A cell's side in an upright sheet, metres"),
    "Cell along": ("float", "Its other side"),
    "Cell level": ("float", "A cell's sides in a level sheet, metres"),
    "Room across": ("float", "Share of a cell in which its particle may lie"),
    "Room along": ("float", "Share of its other side"),
    "Passing": ("vector", "Pixels at a metre that a particle is spread over while the shutter is open"),
    "Key": ("float", "Another number, other particles"),
}


@dataclass(frozen=True)
class _Zones:
    """What all sheets share at each pixel. x: 1 where it looks along the world's x most; z: along z; otherwise y.

    ray, right, down: across a sheet, along its other side, and through it: where the pixel looks, and what steps of a
    metre are on the image, at a depth of 1. right_of, down_of: the same steps along the world's axes. sense: of the ray
    through the sheets.
    """

    x: Socket
    z: Socket
    ray: Parts
    right: Parts
    down: Parts
    right_of: Parts
    down_of: Parts
    sense: Socket


_INPUTS_OF_A_SHEET = {
    "Ahead": "How many sheets are nearer",
    "First": "Metres to the first sheet",
    "Step": "Metres from one to the next",
    "Across": "Cells for a metre of depth",
    "Along": "Likewise",
    "Begin across": "Cells at the camera",
    "Begin along": "Likewise",
    "Key": "What the first sheet adds to a cell's numbers",
    "Next": "What each further one adds",
    "Room across": "Share of a cell in which its particle may lie",
    "Room along": "Share of its other side",
    "Right across": "Columns at a metre for a cell's side",
    "Right along": "For its other side",
    "Down across": "Rows likewise",
    "Down along": "Rows likewise",
    "Run right": "Columns at a metre that a particle is spread over, but for its own velocity",
    "Run down": "Rows likewise",
    "Middle": "Of what is seen: the middle of the range of 1 / metres",
    "Range": "Half that range",
    "Low": "The least size, of the mean diameter's",
    "Held": "Share of the sizes above the least that are below the greatest",
}
_LIT_SHARED = (
    "Sweep right",
    "Sweep down",
    "Half size",
    "Half blur",
    "Focus",
    "Least",
    "Lean",
    "Longest",
    "Least square",
)


def _sheets_graph() -> Graph:
    """Describe all sheets: how much of the light behind passes each pixel."""
    graph = Graph("Round Streaks", "How much light passes the particles in sheets of the air", alone=True)
    items = dict(_LIT_SHEET_NODES_INPUTS) | {
        f"{name} {number}": item for number in range(1, len(LIT_SIZES) + 1) for name, item in _INPUTS_OF_SIZES.items()
    }
    taken = {
        name: graph.input(GroupInput(name, kind, 1.0 if kind == "float" else (0.0, 0.0, 0.0), text))
        for name, (kind, text) in items.items()
    }
    part, seen = _lit_sheet_graph(), graph.math("MULTIPLY", 1.0, 1.0)
    with graph.section("Where pixels look"):
        zones = _zones(graph, taken)
        # Of what is nearer than a camera's hood nothing is seen.
        middle = graph.math("MULTIPLY_ADD", taken["Nearness"], 0.5, 0.5 / NEAR_M)
        shared = {name: taken[name] for name in _LIT_SHARED} | {
            "Middle": middle,
            "Range": 1 / NEAR_M - middle,
        }
    for number, sizes in enumerate(LIT_SIZES, start=1):
        own = taken | {name: taken[f"{name} {number}"] for name in _INPUTS_OF_SIZES}
        with graph.section(f"Sheets {number}"):
            inputs = shared | _at_pixels(graph, own, zones, sizes)
            for ahead in range(sizes.sheets):
                made = graph.group(part, inputs | {"Ahead": float(ahead)}, name=f"Sheet {number}.{ahead + 1}")
                seen = seen * made.out("Seen", "float")
    graph.output("Seen", seen, "float", "Share of the light that passes")
    return graph


def _zones(graph: Graph, taken: Mapping[str, Socket]) -> _Zones:
    x, y = taken["X"], taken["Y"]
    axes = [[getattr(taken[name], axis) for axis in "xyz"] for name in ("Right", "Below", "Forward")]
    right_of, down_of = (_steps(graph, own, axes[2], at) for own, at in ((axes[0], x), (axes[1], y)))
    rays = [
        graph.math("MULTIPLY_ADD", below, y, graph.math("MULTIPLY_ADD", aside, x, ahead))
        for aside, below, ahead in zip(*axes, strict=True)
    ]
    sizes = [graph.math("ABSOLUTE", item) for item in rays]
    along_z = graph.math("GREATER_THAN", sizes[2], graph.math("MAXIMUM", sizes[0], sizes[1]))
    along_x = graph.math("GREATER_THAN", sizes[0], graph.math("MAXIMUM", sizes[1], sizes[2]))
    ray, right, down = (
        _lit_turned(graph, along_x, along_z, item) for item in ((rays[0], rays[1], rays[2]), right_of, down_of)
    )
    return _Zones(along_x, along_z, ray, right, down, right_of, down_of, graph.math("SIGN", ray[2]))


def _steps(graph: Graph, own: list[Socket], forward: list[Socket], at: Socket) -> Parts:
    """Return what steps along the world's axes are on the image at a depth of 1, along one of the camera's axes."""
    back = at * -1.0
    x, y, z = (graph.math("MULTIPLY_ADD", ahead, back, step) for step, ahead in zip(own, forward, strict=True))
    return x, y, z


def _lit_turned(graph: Graph, along_x: Socket, along_z: Socket, parts: Parts) -> Parts:
    """Return a vector of the world across a sheet, along its other side, and through it."""
    x, y, z = parts
    through = graph.math("MULTIPLY_ADD", along_x, x - y, y)
    return (
        graph.math("MULTIPLY_ADD", along_x, y - x, x),
        graph.math("MULTIPLY_ADD", along_z, y - z, z),
        graph.math("MULTIPLY_ADD", along_z, z - y, through),
    )


def _at_pixels(graph: Graph, taken: Mapping[str, Socket], zones: _Zones, sizes: Sizes) -> dict[str, Socket | float]:
    """Return what all sheets of these sizes are given."""
    place = taken["Place"]
    place_m = _lit_turned(graph, zones.x, zones.z, (place.x, place.y, place.z))
    through_m, ray = (_lit_sheared(graph, parts, sizes) for parts in (place_m, zones.ray))
    slabs = through_m * (zones.sense * graph.math("DIVIDE", 1.0, taken["Spacing"]))
    following = graph.math("FLOOR", slabs) + 1.0
    step_m = graph.math("DIVIDE", taken["Spacing"], graph.math("ABSOLUTE", ray))
    step = zones.sense * SHEET
    key = graph.math("MULTIPLY_ADD", zones.z, ZONES[1], zones.x * ZONES[0]) + taken["Key"]
    found: dict[str, Socket | float] = {
        "First": (following - slabs) * step_m,
        "Step": step_m,
        "Key": graph.math("MULTIPLY_ADD", following, step, key),
        "Next": step,
        "Room across": taken["Room across"],
        "Room along": taken["Room along"],
        "Low": sizes.low,
        "Held": 1.0 - math.exp(sizes.low - sizes.high),
    }
    for axis, (side, tilt) in enumerate(zip(("across", "along"), sizes.tilt, strict=True)):
        upright, level = taken[f"Cell {side}"], taken["Cell level"]
        # One division for each zone: those at each pixel take longer.
        per_m = _level(graph, zones, graph.math("DIVIDE", 1.0, upright), graph.math("DIVIDE", 1.0, level))
        wide_px = _level(graph, zones, upright, level) * taken["Focal length"]
        found[side.title()] = zones.ray[axis] * per_m
        found[f"Begin {side}"] = place_m[axis] * per_m
        for name, way in (("Right", zones.right), ("Down", zones.down)):
            found[f"{name} {side}"] = graph.math("MULTIPLY_ADD", way[2], -tilt, way[axis]) * wide_px
    for name, way in (("right", zones.right_of), ("down", zones.down_of)):
        found[f"Run {name}"] = _dot(graph, taken["Passing"], way)
    return found


def _lit_sheared(graph: Graph, parts: Parts, sizes: Sizes) -> Socket:
    """Return how far a vector goes through tilted sheets."""
    across = graph.math("MULTIPLY_ADD", parts[1], sizes.tilt[1], parts[2])
    return graph.math("MULTIPLY_ADD", parts[0], sizes.tilt[0], across)


def _level(graph: Graph, zones: _Zones, upright: Socket, level: Socket) -> Socket:
    """Return one number where sheets are upright, and another where they are level."""
    return graph.math("MULTIPLY_ADD", zones.z, level - upright, upright)


def _dot(graph: Graph, vector: Socket, parts: Parts) -> Socket:
    across = graph.math("MULTIPLY_ADD", parts[1], vector.y, parts[2] * vector.z)
    return graph.math("MULTIPLY_ADD", parts[0], vector.x, across)


def _lit_sheet_graph() -> Graph:
    """Describe one sheet: how much of the light behind passes each pixel."""
    graph = Graph("Sheet of Round Streaks", "How much light passes the particles in one sheet of the air", alone=True)
    texts = _INPUTS_OF_A_SHEET | {name: _LIT_SHEET_NODES_INPUTS[name][1] for name in _LIT_SHARED}
    taken = {name: graph.input(GroupInput(name, "float", 1.0, text)) for name, text in texts.items()}
    sides, ways = ("across", "along"), ("right", "down")
    with graph.section("Where the ray meets the sheet"):
        depth_m = graph.math("MULTIPLY_ADD", taken["Step"], taken["Ahead"], taken["First"])
        nearness = graph.math("DIVIDE", 1.0, depth_m)
        places = [graph.math("MULTIPLY_ADD", taken[side.title()], depth_m, taken[f"Begin {side}"]) for side in sides]
    with graph.section("The particle in the cell"):
        corners = [graph.math("FLOOR", place) for place in places]
        key = graph.math("MULTIPLY_ADD", taken["Next"], taken["Ahead"], taken["Key"])
        *jitter, size = _drawn(graph, corners, key)
        jitter = [number - 0.5 for number in jitter]
        apart = [
            graph.math("MULTIPLY_ADD", moved, taken[f"Room {side}"], corner - place + 0.5)
            for moved, side, corner, place in zip(jitter, sides, corners, places, strict=True)
        ]
        # Exponentially distributed above the least of these sizes.
        rest = graph.math("MULTIPLY_ADD", size, taken["Held"] * -1.0, 1.0)
        shown = (taken["Low"] - graph.math("LOGARITHM", rest, math.e)) * nearness
    with graph.section("Its streak"):
        radius_px = shown * taken["Half size"]
        area = graph.math("MULTIPLY", radius_px, radius_px)
        blur_px = (nearness - taken["Focus"]) * taken["Half blur"]
        blurred = graph.math("MULTIPLY_ADD", blur_px, blur_px, area)
        blurred = graph.math("MAXIMUM", blurred, taken["Least square"])
        away, run = [], []
        for moved, way in zip(jitter, ways, strict=True):
            steps = [taken[f"{way.title()} {side}"] for side in sides]
            away.append(graph.math("MULTIPLY_ADD", apart[0], steps[0], apart[1] * steps[1]) * nearness)
            ran = graph.math("MULTIPLY_ADD", moved, taken["Lean"], taken[f"Run {way}"])
            run.append(graph.math("MULTIPLY_ADD", ran, nearness, taken[f"Sweep {way}"]))
        hidden = ellipse(graph, away, run, (area, blurred), taken["Longest"])
    with graph.section("What passes"):
        there = graph.math("COMPARE", nearness, taken["Middle"], taken["Range"]) * (shown > taken["Least"])
        graph.output("Seen", 1.0 - hidden * there, "float", "Share of the light that passes")
    return graph


def _drawn(graph: Graph, corners: list[Socket], key: Socket) -> tuple[Socket, Socket, Socket]:
    """Return three numbers of a cell, as if at random from 0 to 1."""
    column = graph.math("FRACT", corners[0] * COLUMN + key)
    row = graph.math("FRACT", corners[1] * ROW + graph.math("FRACT", (column * BENT + STEEP) * column))
    found = (row * BENT + STEEP) * row
    first, second, third = (graph.math("FRACT", found + row * more if more else found) for more in (0.0, *APART))
    return first, second, third


def ellipse(
    graph: Graph, away: list[Socket], run: list[Socket], squares: tuple[Socket, Socket], longest: Socket
) -> Socket:
    """Return what a streak hides.

    A particle out of focus is a paraboloid, which is smooth at the edge of its blurred disc of radius b. While the
    shutter is open it runs a way of l: its streak is the paraboloid over an ellipse, b across and sqrt(b^2 + l^2 / 2)
    along, with the variances of what the run makes of the disc, and as faint as it is larger. So it hides what the
    particle does, and its direction takes no root.

    away, run: right and down, pixels: how far it is, and SPREAD times the run. squares: of the particle's radius, and
    of its blurred one. longest: square of the ellipse's length over its width, at most.
    """
    area, radius = squares
    # Never quite at rest, so that it has a direction.
    ran = graph.math("MULTIPLY_ADD", run[0], run[0], graph.math("MULTIPLY_ADD", run[1], run[1], 1e-6))
    length = graph.math("MINIMUM", radius + ran, radius * longest)
    along = graph.math("MULTIPLY_ADD", away[0], run[0], away[1] * run[1])
    apart = graph.math("MULTIPLY_ADD", away[0], away[0], graph.math("MULTIPLY", away[1], away[1]))
    left = radius - apart + along * along * ((length - radius) / (length * ran))
    covered = graph.math("MAXIMUM", left, 0.0) * area * 2.0
    share = covered / (graph.math("SQRT", radius * length) * radius)
    return graph.math("MINIMUM", share, MOST_OPAQUE)
