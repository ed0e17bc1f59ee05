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

from ..core.node_graphs.camera import CameraSockets
from ..core.node_graphs.graph import Graph, GroupInput, Socket
from ..core.node_graphs.groups import Canvas
from ._falling_tile import EXCESS
from ._falling_widths import area_and_width
from ._particles import NEAR_M
from ._streaks import MOST_OPAQUE, SOFTNESS

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
    there = replace(canvas, graph=graph, camera=own, seed=inside["Seed"], key=inside["Frame"])
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
    hidden = _hidden(graph, streak)
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


def _hidden(graph: Graph, streak: _Streak) -> Socket:
    """Return the share of light that a streak hides."""
    width_px, length_px = streak.width_px, streak.length_px
    with graph.section("Its streak"):
        along = graph.math("MULTIPLY_ADD", streak.away[0], streak.run[0], streak.away[1] * streak.run[1])
        part = graph.clamp(along / streak.squared, -0.5, 0.5) * -1.0
        off = [graph.math("MULTIPLY_ADD", run, part, item) for run, item in zip(streak.run, streak.away, strict=True)]
        off_px = graph.math("SQRT", graph.math("MULTIPLY_ADD", off[0], off[0], off[1] * off[1]))
        ramp = graph.math("MAXIMUM", width_px * SOFTNESS, 1.0)
        edge = graph.math("MULTIPLY_ADD", width_px, 0.5, off_px * -1.0)
        covered = graph.clamp(graph.math("DIVIDE", edge, ramp) + 0.5)
        track = graph.math("MULTIPLY_ADD", width_px, math.pi / 4, length_px) * width_px
        share = graph.math("MINIMUM", graph.math("DIVIDE", streak.area * (math.pi / 4), track), MOST_OPAQUE)
        return share * covered


_SIDES = ("across", "along")
_WAYS = ("Right", "Down")
