# SPDX-License-Identifier: GPL-3.0-or-later
"""Falling rain and snow as a node group: shells of depth, each a tile of particles that is stretched along the fall.

The particles of a shell fall with one speed and in one direction; each has its own depth and size, and so its own
width, length, blur and faintness, and what is nearer hides it. All is in pixels of the reference width.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from ...core.node_graph import Graph, GroupInput, Socket, Value
from ...core.srgb import LUMINANCE
from ..groups import Canvas
from ._air import air_nodes, kept_sky, lamp_light_nodes
from ._arrays import SKY_M
from ._particles import EXTINCTION_EFFICIENCY, NEAR_M
from ._sheet_nodes import LIT_SIZES, SIZES, seen_through_lit_sheets, seen_through_sheets
from ._sizes import Coarser, coarser
from ._weather import (
    DENSITY,
    EXCESS,
    LEAST_WIDTH_PX,
    LEVELS,
    MOST_OPAQUE,
    QUICK_LEAST,
    SOFTNESS,
    TILE,
    UNITS,
    area_and_width,
    shells,
)

_GOLDEN = (math.sqrt(5) - 1) / 2
HIDDEN = 1e9  # nearness of what hides all


@dataclass(frozen=True)
class Laws:
    """What falls, as nodes. name: as in a group's name.

    sizes: graph; mm/h -> particles per cubic metre and mm of diameter, by 1000; mean diameter in mm.
    speed: graph; diameter in mm -> speed of fall in still air, m/s. brightness: with which it has the sky's own colour.
    scattering: of a lamp's light, as `_lamp_light` says. shine: on lit frames, of a particle beside the air before the
    horizon: it faces more of an overcast sky, three times as bright overhead (Moon and Spencer, 1942). longest: of a
    streak on lit frames, in widths.
    """

    name: str
    sizes: Callable[[Graph, Socket], tuple[Value, Socket]]
    speed: Callable[[Graph, Socket], Socket]
    brightness: float
    scattering: float
    shine: float
    longest: float


def build_falling(canvas: Canvas, given: Mapping[str, Socket], laws: Laws) -> Socket:
    """Mix the image, of linear light, with the particles' light, by the transmission of streaks and veil."""
    graph, camera = canvas.graph, canvas.camera
    assert canvas.depth_m is not None
    assert camera is not None
    with graph.section("What falls"):
        many, measured_mm = laws.sizes(graph, given["rate_mm_h"])
        scale_mm = measured_mm * given["size"]
        seen_to_m = graph.math("DIVIDE", scale_mm, given["least_mrad"], label="Where the mean particle is just seen")
        count_m3 = measured_mm * many * 1e3
    with graph.section("Distance"):
        # Maximum returns its first operand where the second is NaN.
        known_m = graph.math("MAXIMUM", 0.0, canvas.depth_m)
        sky = graph.math("GREATER_THAN", known_m, SKY_M)
        void = graph.math("MAXIMUM", graph.math("LESS_THAN", known_m, 1e-12), sky)
        surface_m = graph.math("MINIMUM", known_m, SKY_M) * graph.math("SUBTRACT", 1.0, sky)
        distance_m = graph.math("MULTIPLY_ADD", void, given["void_m"], surface_m)
        limit_m = graph.math("MINIMUM", distance_m, given["reach_m"])
        nearness = graph.math("DIVIDE", 1.0, limit_m, label="Nearness of what hides")
        # An image even where Depth is one number: the shells take their pixels from it.
        pixel = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Pixel", "vector")
        nearness = graph.math("MULTIPLY_ADD", pixel.x, 0.0, nearness)
    drawn = coarser(canvas, given["coarse"])
    with graph.section("Camera"):
        half = graph.math("TANGENT", given["view_deg"] * (math.pi / 360))
        wind_m_s = given["wind_m_s"]
        across = graph.math("ARCTAN2", camera.back.x * -1.0, camera.back.y * -1.0)
        upwards = graph.math("ARCSINE", graph.clamp(camera.back.z * -1.0, -1.0, 1.0))
        shared = {
            "Down": graph.vector(camera.right.z * -1.0, camera.up.z, camera.back.z),
            "Blown": graph.vector(camera.right.x * wind_m_s, camera.up.x * -wind_m_s, camera.back.x * -wind_m_s),
            "Own": camera.to_own(camera.velocity),
            "Turning": camera.turning * (1.0, -1.0, -1.0),
            "Turned": graph.vector(across, upwards),
            "Nearness": drawn.taken(nearness),
            "Height": drawn.height_px,
            "Width": drawn.width_px,
            "Scale": drawn.scale,
            "Least width": graph.choose(given["coarse"], QUICK_LEAST * LEAST_WIDTH_PX, LEAST_WIDTH_PX, "float"),
            "Count": count_m3,
            "Mean": scale_mm,
            "Measured": measured_mm,
            "Seen to": seen_to_m,
            "Focal length": canvas.width_px / canvas.scale * 0.5 / half,
            "Gusts": given["gusts_m_s"],
            "Fall": given["fall"],
            "Exposure": given["shutter_ms"] * 1e-3,
            "Time": canvas.drift_frames / given["frame_rate_hz"],
            "Aperture": given["aperture_mm"] * 1e-3,
            "Focus": given["focus_m"],
        }
    with graph.section("Veil"):
        # As `veil_depth` has it; the maximum holds the rounding near 0.
        x = limit_m / seen_to_m
        decayed = graph.math("EXPONENT", x * -1.0)
        polynomial = graph.math("MULTIPLY_ADD", graph.math("MULTIPLY_ADD", x, 0.5, 2.0), x, 3.0)
        integral = graph.math("MAXIMUM", graph.math("MULTIPLY_ADD", decayed, polynomial, x - 3.0), 0.0)
        extinction = count_m3 * scale_mm * scale_mm * (EXTINCTION_EFFICIENCY * math.pi / 2 * 1e-6)
        veil = graph.math("MULTIPLY_ADD", integral, seen_to_m, distance_m - limit_m) * extinction
        veil = veil * kept_sky(canvas, given)
    hidden = _hidden(canvas, given, laws, shared, veil=veil, drawn=drawn)
    return _over_the_image(canvas, given, laws, hidden)


@dataclass(frozen=True)
class _Hidden:
    """What hides the scene at each pixel. veil: its optical depth. through, seen: what passes sheets, and all."""

    veil: Socket
    through: Socket
    seen: Socket


def _hidden(
    canvas: Canvas,
    given: Mapping[str, Socket],
    laws: Laws,
    shared: Mapping[str, Socket],
    *,
    veil: Socket,
    drawn: Coarser,
) -> _Hidden:
    """Return what hides the scene.

    shared: what all streaks are given. veil: its optical depth. drawn: of which size they are.
    """
    graph = canvas.graph
    with graph.section("Streaks in the world"):
        speeds = {
            sizes: laws.speed(graph, shared["Measured"] * sizes.typical) * given["fall"]
            for sizes in (*SIZES, *LIT_SIZES)
        }
        # Of shells and sheets, those not used see a single number, which costs nothing. On lit frames all is in the
        # world: there shells would cut the nearest particles.
        lit = graph.math("GREATER_THAN", canvas.lit, 0.0)
        drifts = graph.math("GREATER_THAN", graph.math("SUBTRACT", canvas.drifts, lit), 0.0)
        others = graph.math("SUBTRACT", 1.0, graph.math("MAXIMUM", lit, drifts))
        round_ones, drifting, shown = (
            {**shared, "Nearness": graph.choose(used, shared["Nearness"], HIDDEN, "float")}
            for used in (lit, drifts, others)
        )
    through = graph.math("MULTIPLY", 1.0, 1.0)
    if not canvas.never_lit:
        through = seen_through_lit_sheets(canvas, given, round_ones, speeds, laws.longest)
    if not canvas.always_lit:
        through = through * seen_through_sheets(canvas, given, drifting, speeds)
    with graph.section("Streaks"):
        quick = given["coarse"]
        through, veiled = drawn.back(through), graph.math("EXPONENT", veil * -1.0)
        behind = veiled * through
        seen = graph.choose(quick, 1.0, behind, "float")
        part = _shell_graph(laws)
        for number, shell in enumerate(() if canvas.always_lit else shells()):
            start = canvas.random(number) * graph.vector(float(UNITS), float(UNITS))
            inputs = shown | {"Start": start, "Share": shell.share, "Middle": shell.middle}
            inputs |= {f"Depth {power}": value for power, value in enumerate(shell.places)}
            seen = seen * graph.group(part, inputs, name=f"Shell {number + 1}").out("Seen", "float")
        seen = graph.choose(quick, behind * drawn.back(seen), seen, "float")
    return _Hidden(veil, through, seen)


def _over_the_image(canvas: Canvas, given: Mapping[str, Socket], laws: Laws, hidden: _Hidden) -> Socket:
    """Mix the image with the particles' light, and add that of lamps."""
    graph = canvas.graph
    light = _light(canvas, given, laws)
    with graph.section("Over the image"):
        fallen = graph.mix(light, canvas.image, _wide(hidden.seen))
    if canvas.never_lit:
        return fallen
    with graph.section("Lamps: the air before each pixel"):
        usual = graph.math("MAXIMUM", given["brightness"] / laws.brightness, 1e-3)
        air = light / _wide(usual)
        veiled = 1.0 - graph.math("EXPONENT", hidden.veil * -1.0)
    lamps = lamp_light_nodes(canvas, given, air, laws.scattering / laws.brightness, hidden.veil)
    with graph.section("Lamps over the image"):
        before = lamps.veil(veiled) * _wide(hidden.through)
        own = graph.math("MULTIPLY_ADD", air, ((laws.shine - 1.0) / laws.brightness,) * 3, lamps.particles)
        lit = graph.math("MULTIPLY_ADD", own, _wide(1.0 - hidden.through), before)
        return graph.math("MULTIPLY_ADD", lit, _wide(given["brightness"]), fallen)


def _wide(value: Socket) -> Socket:
    return value.graph.vector(value, value, value)


def _light(canvas: Canvas, given: Mapping[str, Socket], laws: Laws) -> Socket:
    """Return the particles' light, as arrays have it."""
    graph, air = canvas.graph, air_nodes(canvas, given)
    with graph.section("Light"):
        channels = ("Red", "Green", "Blue")
        levels = [graph.node("CompositorNodeLevels", {"Image": canvas.image, "Channel": name}) for name in channels]
        mean = graph.vector(*(node.out("Mean", "float") for node in levels))
        tint = graph.vector(*[given["tint"]] * 3)
        tinted = []
        for each in (mean, air.surfaces):
            grey = graph.math("DOT_PRODUCT", each, LUMINANCE)
            tinted.append(graph.mix(graph.vector(grey, grey, grey), each, tint))
        return air.chosen(*tinted, over=laws.brightness) * _wide(given["brightness"])


_INPUTS = {
    "Nearness": "1 / metres of what hides, at each pixel",
    "Height": "Rows of the image",
    "Width": "Columns of the image",
    "Scale": "Pixels of the image in one of the reference width",
    "Count": "Particles of all sizes in a cubic metre",
    "Mean": "Mean diameter, mm",
    "Measured": "Mean diameter of the measured particles, mm, which decides the speed",
    "Least width": "Of a streak, in pixels of the reference width",
    "Seen to": "Metres at which the mean particle spans the least angle",
    "Focal length": "In pixels",
    "Gusts": "Standard deviation of each particle's own velocity, m/s",
    "Fall": "Speed of fall, times that in still air",
    "Exposure": "Seconds",
    "Time": "Seconds that it has drifted",
    "Aperture": "Metres",
    "Focus": "Metres",
    "Share": "Share of all particles that are in the shell",
    "Middle": "Mean depth of the shell, in multiples of Seen to",
}


_VECTORS = {
    "Down": "Direction of fall in the camera's axes: right, down, forward",
    "Blown": "Velocity of the wind in the camera's axes, m/s",
    "Own": "The camera's velocity in its axes, m/s",
    "Turning": "The camera's turning about its axes, rad/s",
    "Turned": "How far the camera has turned to the right and up, rad",
}

Taken: TypeAlias = Mapping[str, Socket]
"""The inputs of a shell's group by name."""


def _shell_graph(laws: Laws) -> Graph:
    """Describe a shell's streaks: how much of the light behind passes each pixel."""
    graph = Graph(f"{laws.name} Shell", "How much light passes the streaks of the particles in a shell", alone=True)
    start = graph.input(GroupInput("Start", "vector", (0.0, 0.0, 0.0), "Where on the tile the first pixel lies"))
    taken = {name: graph.input(GroupInput(name, "float", 1.0, text)) for name, text in _INPUTS.items()}
    taken |= {name: graph.input(GroupInput(name, "vector", (0.0, 0.0, 0.0), text)) for name, text in _VECTORS.items()}
    places = [
        graph.input(GroupInput(f"Depth {power}", "float", 0.0, f"Coefficient of a level to the power {power}"))
        for power in range(len(shells()[0].places))
    ]
    with graph.section("Fall"):
        fall_m_s = laws.speed(graph, taken["Measured"] * (taken["Middle"] + 1.0)) * taken["Fall"]
        fallen = graph.math("MULTIPLY_ADD", taken["Down"], graph.vector(fall_m_s, fall_m_s, fall_m_s), taken["Blown"])
        # The tile lies along the fall on the image; straight down from above it has any direction.
        moved = graph.vector(fallen.x, fallen.y + 1e-4)
        speed_m_s = graph.math("LENGTH", moved)
        direction = moved / graph.vector(speed_m_s, speed_m_s, speed_m_s)
        run_px = speed_m_s * taken["Focal length"] / taken["Seen to"] / taken["Middle"]  # a second
    own, right_px, down_px = _nearest_particle(graph, taken, start, direction, run_px)
    with graph.section("Its depth and size"):
        level = graph.math("FLOOR", own)
        place = graph.math("MULTIPLY_ADD", level, 1 / LEVELS, 0.5 / LEVELS)
        depth = places[-1]
        for coefficient in reversed(places[:-1]):
            depth = graph.math("MULTIPLY_ADD", depth, place, coefficient)
        per_m = graph.math("DIVIDE", 1.0, taken["Seen to"])
        nearness = graph.math("DIVIDE", per_m, depth, label="1 / its depth in metres")
        large = graph.math("MULTIPLY_ADD", own - level, EXCESS, depth, label="Its diameter, of the mean one's")
        area, width_px = area_and_width(graph, taken, large, nearness)
        aside_px, ahead_px = _run(graph, taken, fallen - taken["Own"], direction, nearness)
        length_px = graph.math("SQRT", graph.math("MULTIPLY_ADD", aside_px, aside_px, ahead_px * ahead_px))
    with graph.section("Its streak"):
        # Its own direction, from another number of its own.
        lean = (graph.math("FRACT", level * _GOLDEN) - 0.5) * (taken["Gusts"] / speed_m_s * math.sqrt(12))
        shares = aside_px / length_px, ahead_px / length_px
        along = graph.math("MULTIPLY_ADD", shares[1], down_px, shares[0] * right_px)
        across = graph.math("MULTIPLY_ADD", shares[1], right_px, shares[0] * down_px * -1.0)
        beside = graph.math("MULTIPLY_ADD", lean, along, across)
        before = graph.math("MULTIPLY_ADD", length_px, -0.5, graph.math("ABSOLUTE", along))
        before = graph.math("MAXIMUM", before, 0.0)
        apart = graph.math("SQRT", graph.math("MULTIPLY_ADD", beside, beside, before * before))
        ramp = graph.math("MAXIMUM", width_px * SOFTNESS, taken["Least width"])
        edge = graph.math("MULTIPLY_ADD", width_px, 0.5, apart * -1.0)
        covered = graph.clamp(graph.math("DIVIDE", edge, ramp) + 0.5)
    with graph.section("What passes"):
        track = graph.math("MULTIPLY_ADD", width_px, math.pi / 4, length_px) * width_px
        share = graph.math("MINIMUM", graph.math("DIVIDE", area * (math.pi / 4), track), MOST_OPAQUE)
        there = (nearness > taken["Nearness"]) * (nearness < 1 / NEAR_M)
        graph.output("Seen", 1.0 - share * covered * there, "float", "Share of the light that passes")
    return graph


def _nearest_particle(
    graph: Graph, taken: Taken, start: Socket, direction: Socket, run_px: Socket
) -> tuple[Socket, Socket, Socket]:
    """Return of the particle nearest to each pixel its own number, and how far it is aside and ahead, in pixels."""
    with graph.section("Tile"):
        # Particles in a pixel; a unit of the tile holds DENSITY of them, and is longer than wide as the streaks are.
        solid = taken["Seen to"] / taken["Focal length"]
        dense = graph.math("SQRT", taken["Count"] * taken["Share"] * taken["Seen to"] * (2 / DENSITY)) * solid
        longer = graph.math("SQRT", graph.math("MULTIPLY_ADD", run_px, taken["Exposure"], 2.0))
        across, along = dense * longer, dense / longer
        drifted = start.y - run_px * taken["Time"] * along
    with graph.section("The nearest particle"):
        # Pixels are counted from below, and are smaller or larger than those of the reference width.
        finer = graph.math("DIVIDE", 1.0, taken["Scale"])
        top = taken["Height"] - 0.5
        aside = graph.vector(direction.y * across, direction.x * across) * graph.vector(finer, finer)
        ahead = graph.vector(direction.x * along, direction.y * along * -1.0) * graph.vector(finer, finer)
        # A camera that turns sees other parts of the tile.
        turned = taken["Turned"] * graph.vector(*[taken["Focal length"] * taken["Scale"]] * 3)
        first_u = graph.math("MULTIPLY_ADD", aside.x, 0.5, start.x) - aside.y * top
        first_v = graph.math("MULTIPLY_ADD", ahead.x, 0.5, drifted) - ahead.y * top
        first_u, first_v = (
            graph.math("DOT_PRODUCT", turned, axis) + at for axis, at in ((aside, first_u), (ahead, first_v))
        )
        pixel = graph.node("CompositorNodeImageCoordinates", {"Image": taken["Nearness"]}).out("Pixel", "vector")
        u = graph.math("DOT_PRODUCT", pixel, aside) + first_u
        v = graph.math("DOT_PRODUCT", pixel, ahead) + first_v
        where = graph.vector(u * (1 / UNITS), v * (1 / UNITS), 1.0)
        inputs = {"Image": graph.picture(TILE), "UV": where, "Interpolation": "Nearest"}
        inputs |= {"Extension X": "Repeat", "Extension Y": "Repeat"}
        found = graph.node("CompositorNodeMapUV", inputs).out("Image", "color")
        split = graph.node("CompositorNodeSeparateColor", {"Image": found}, {"mode": "RGB"})
        columns, rows, own = (split.out(name, "float") for name in ("Red", "Green", "Blue"))
        turn = UNITS / 2
        right_px = graph.math("WRAP", columns - u, turn, -turn) / across
        down_px = graph.math("WRAP", rows - v, turn, -turn) / along
    return own, right_px, down_px


def _run(
    graph: Graph, taken: Taken, velocity_m_s: Socket, direction: Socket, nearness: Socket
) -> tuple[Socket, Socket]:
    """Return how far a particle goes on the image while the shutter is open, aside of the fall and along it, in pixels.

    velocity_m_s: relative to the camera's, in its axes. At a place (x, y, 1) on the image, a camera that turns by w
    adds what a point at rest seems to do: (x (w_x y - w_y x) - w_y + w_z y, y (w_x y - w_y x) + w_x - w_z x).
    """
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": taken["Nearness"]}).out("Pixel", "vector")
    slope = graph.math("DIVIDE", 1.0, taken["Focal length"] * taken["Scale"])
    x = graph.math("MULTIPLY_ADD", pixel.x, slope, (taken["Width"] - 1.0) * slope * -0.5)
    y = graph.math("MULTIPLY_ADD", pixel.y, slope * -1.0, (taken["Height"] - 1.0) * slope * 0.5)
    turning = taken["Turning"]
    swept = graph.math("MULTIPLY_ADD", turning.x, y, turning.y * x * -1.0)
    back = graph.math("MULTIPLY_ADD", velocity_m_s.z, nearness * -1.0, swept)
    right = graph.math("MULTIPLY_ADD", turning.z, y, turning.y * -1.0)
    down = graph.math("MULTIPLY_ADD", turning.z, x * -1.0, turning.x)
    right = graph.math("MULTIPLY_ADD", velocity_m_s.x, nearness, right)
    down = graph.math("MULTIPLY_ADD", velocity_m_s.y, nearness, down)
    right, down = graph.math("MULTIPLY_ADD", back, x, right), graph.math("MULTIPLY_ADD", back, y, down)
    open_px = taken["Focal length"] * taken["Exposure"]
    aside = graph.math("MULTIPLY_ADD", direction.y, right, direction.x * down * -1.0) * open_px
    # Never quite at rest, so that it has a direction.
    return aside, graph.math("MULTIPLY_ADD", direction.x, right, direction.y * down) * open_px + 1e-4
