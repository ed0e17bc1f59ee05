# SPDX-License-Identifier: GPL-3.0-or-later
"""Rain and snow in the world on lit frames: the sheets of `_sheet_nodes`, fewer and by few operations a pixel.

Sheets are evenly apart, so the depth where a pixel's ray meets one is a multiple of its number, and all else follows
from that depth. A cell's particle follows from the cell by arithmetic, which takes a third of the time of Blender's
white noise. In float32 a product, and a sum after it, are the same on all processors, so both executions draw alike.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from ..core.node_graphs.graph import Graph, GroupInput, Kind, Socket
from ..core.node_graphs.groups import Canvas
from ._falling_tile import EXCESS
from ._particles import NEAR_M
from ._sheet_nodes import FIRST_PURPOSE, LEAST_ROOM, START_SLABS, Sizes, swept, view_slopes
from ._streaks import MOST_OPAQUE

# Chosen: 2 % of what is seen is beyond the last sheet.
LIT_SIZES = (Sizes(0.0, 2.0, 0.5, 4, (-0.25, 0.2)), Sizes(2.0, EXCESS, 1.8, 4, (0.45, -0.25)))
LEAST_ROUND_PX = 2.0  # of a particle's width as it is drawn, so that pixels sample it evenly; it is fainter instead
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
        }
        for number, sizes in enumerate(LIT_SIZES, start=1):
            blown_m_s = graph.vector(given["wind_m_s"], 0.0, speed_m_s[sizes] * -1.0)
            own = _of_sizes(canvas, blown_m_s, shared, sizes)
            passing = graph.math("SUBTRACT", blown_m_s, camera.velocity)
            own["Passing"] = passing * graph.vector(spread_px, spread_px, spread_px)
            own["Key"] = canvas.random_value(FIRST_PURPOSE + number - 1) * LIT_KEYS
            inputs |= {f"{name} {number}": value for name, value in own.items()}
        return graph.group(_sheets_graph(), inputs, name="Round Streaks").out("Seen", "float")


def _of_sizes(
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


def _three(graph: Graph, value: Socket) -> Socket:
    return graph.vector(value, value, value)


_INPUTS: Mapping[str, tuple[Kind, str]] = {
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
_SHARED = ("Sweep right", "Sweep down", "Half size", "Half blur", "Focus", "Least", "Lean", "Longest")


def _sheets_graph() -> Graph:
    """Describe all sheets: how much of the light behind passes each pixel."""
    graph = Graph("Round Streaks", "How much light passes the particles in sheets of the air", alone=True)
    items = dict(_INPUTS) | {
        f"{name} {number}": item for number in range(1, len(LIT_SIZES) + 1) for name, item in _INPUTS_OF_SIZES.items()
    }
    taken = {
        name: graph.input(GroupInput(name, kind, 1.0 if kind == "float" else (0.0, 0.0, 0.0), text))
        for name, (kind, text) in items.items()
    }
    part, seen = _sheet_graph(), graph.math("MULTIPLY", 1.0, 1.0)
    with graph.section("Where pixels look"):
        zones = _zones(graph, taken)
        # Of what is nearer than a camera's hood nothing is seen.
        middle = graph.math("MULTIPLY_ADD", taken["Nearness"], 0.5, 0.5 / NEAR_M)
        shared = {name: taken[name] for name in _SHARED} | {"Middle": middle, "Range": 1 / NEAR_M - middle}
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
        _turned(graph, along_x, along_z, item) for item in ((rays[0], rays[1], rays[2]), right_of, down_of)
    )
    return _Zones(along_x, along_z, ray, right, down, right_of, down_of, graph.math("SIGN", ray[2]))


def _steps(graph: Graph, own: list[Socket], forward: list[Socket], at: Socket) -> Parts:
    """Return what steps along the world's axes are on the image at a depth of 1, along one of the camera's axes."""
    back = at * -1.0
    x, y, z = (graph.math("MULTIPLY_ADD", ahead, back, step) for step, ahead in zip(own, forward, strict=True))
    return x, y, z


def _turned(graph: Graph, along_x: Socket, along_z: Socket, parts: Parts) -> Parts:
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
    place_m = _turned(graph, zones.x, zones.z, (place.x, place.y, place.z))
    through_m, ray = (_sheared(graph, parts, sizes) for parts in (place_m, zones.ray))
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


def _sheared(graph: Graph, parts: Parts, sizes: Sizes) -> Socket:
    """Return how far a vector goes through tilted sheets."""
    across = graph.math("MULTIPLY_ADD", parts[1], sizes.tilt[1], parts[2])
    return graph.math("MULTIPLY_ADD", parts[0], sizes.tilt[0], across)


def _level(graph: Graph, zones: _Zones, upright: Socket, level: Socket) -> Socket:
    """Return one number where sheets are upright, and another where they are level."""
    return graph.math("MULTIPLY_ADD", zones.z, level - upright, upright)


def _dot(graph: Graph, vector: Socket, parts: Parts) -> Socket:
    across = graph.math("MULTIPLY_ADD", parts[1], vector.y, parts[2] * vector.z)
    return graph.math("MULTIPLY_ADD", parts[0], vector.x, across)


def _sheet_graph() -> Graph:
    """Describe one sheet: how much of the light behind passes each pixel."""
    graph = Graph("Sheet of Round Streaks", "How much light passes the particles in one sheet of the air", alone=True)
    texts = _INPUTS_OF_A_SHEET | {name: _INPUTS[name][1] for name in _SHARED}
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
        blurred = graph.math("MAXIMUM", blurred, (LEAST_ROUND_PX / 2) ** 2)
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
