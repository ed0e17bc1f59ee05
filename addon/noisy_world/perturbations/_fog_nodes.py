# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog that is no even layer, as nodes: what `_fog_air`, `_fog_waves` and `_fog_glow` calculate.

What is switched off is exactly 1, or 0, and is calculated for a single pixel.
"""

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import TypeAlias

from ..core.node_graphs.graph import Graph, GroupInput, Socket, Value
from ..core.node_graphs.groups import Canvas
from ._block_nodes import blocks_of, blurred, looked_up
from ._fog_air import FARTHEST, STEEPEST
from ._fog_glow import WIDTHS
from ._fog_waves import EDGES, GRID_PX, KEY_BITS, waves

SERIES = 0.03  # below it (1 - e^-u) / u is a series, as the difference loses digits

Given: TypeAlias = Mapping[str, Socket]


def distance_nodes(canvas: Canvas, given: Given) -> Socket:
    """Return the distance to each pixel; void and what is farther than all fog is there."""
    graph, depth_m = canvas.graph, canvas.depth_m
    assert depth_m is not None
    # Maximum returns its first operand where the second is NaN.
    known_m = graph.math("MAXIMUM", 0.0, depth_m)
    farthest_m = given["visibility_m"] * FARTHEST
    void = graph.math("LESS_THAN", known_m, 1e-30, label="Void")
    return graph.math("MINIMUM", graph.math("MULTIPLY_ADD", void, farthest_m, known_m), farthest_m)


def thinned_nodes(canvas: Canvas, given: Given, distance_m: Socket) -> Socket:
    """Return the mean density on the way to each pixel, as it thins with height."""
    graph, camera = canvas.graph, canvas.camera
    assert camera is not None
    with graph.section("Thinner with height"):
        on = given["falloff_m"] > 0.0
        falloff_m = graph.math("MAXIMUM", given["falloff_m"], 1e-3)
        size = graph.vector(canvas.width_px, canvas.height_px, 1.0)
        right, up = _slopes(canvas, given, _pixels(canvas, on), size)
        rise = graph.math("MULTIPLY_ADD", right, camera.right.z, camera.back.z * -1.0)
        rise = graph.math("MULTIPLY_ADD", up, camera.up.z, rise)
        way_m = graph.choose(on, distance_m, 1.0, "float")
        u = graph.math("MAXIMUM", rise * way_m / falloff_m, -STEEPEST)
        small = graph.math("LESS_THAN", graph.math("ABSOLUTE", u), SERIES)
        closed = (1.0 - graph.math("EXPONENT", u * -1.0)) / u
        series = graph.math("MULTIPLY_ADD", graph.math("MULTIPLY_ADD", u, 1 / 6, -0.5), u, 1.0)
        height_m = camera.location.z + given["camera_height_m"]
        here = graph.math("EXPONENT", graph.math("MAXIMUM", height_m / falloff_m, -STEEPEST) * -1.0)
        return graph.math("MULTIPLY_ADD", graph.mix(closed, series, small) * here - 1.0, on, 1.0)


def _pixels(canvas: Canvas, on: Socket) -> Socket:
    """Return each pixel's place in the frame, from the lower left; one number where it is not wanted."""
    graph = canvas.graph
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Pixel", "vector")
    return graph.choose(on, pixel, (0.0, 0.0, 0.0), "vector")


def _slopes(canvas: Canvas, given: Given, pixel: Socket, size: Socket) -> tuple[Socket, Socket]:
    """Return right and up, of depth 1, through the pixels of an image of a size that shows what the frame does."""
    graph = canvas.graph
    half = graph.math("TANGENT", given["view_deg"] * (math.pi / 360))
    tall = half * canvas.height_px / canvas.width_px
    # From the left and from below, -1 to 1.
    place = graph.math("SUBTRACT", graph.math("DIVIDE", pixel * 2.0 + (1.0, 1.0, 1.0), size), (1.0, 1.0, 1.0))
    return place.x * half, place.y * tall


# --- uneven ---


def clumps_nodes(canvas: Canvas, given: Given, distance_m: Socket) -> Socket:
    """Return the mean density on the way to each pixel, as clumps make it."""
    graph, camera = canvas.graph, canvas.camera
    assert camera is not None
    assert canvas.seed is not None
    assert canvas.key is not None
    with graph.section("Clumps: rays of a coarse grid"):
        on = given["unevenness"] > 0.0
        grid = [_grid_side(graph, side / canvas.scale, on) for side in (canvas.width_px, canvas.height_px)]
        blank = graph.node("CompositorNodeBlankImage", {"Size": graph.vector(*grid)}).out("Image", "color")
        pixel = graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Pixel", "vector")
        right, up = _slopes(canvas, given, pixel, graph.vector(grid[0], grid[1], 1.0))
        ray = graph.math("MULTIPLY_ADD", camera.right, graph.vector(right, right, right), camera.back * -1.0)
        ray = graph.math("MULTIPLY_ADD", camera.up, graph.vector(up, up, up), ray)
    with graph.section("Clumps: waves"):
        blown_m = given["wind_m_s"] * canvas.drift_frames / given["frame_rate_hz"]
        clump_m = given["clump_m"]
        place = (camera.location - graph.vector(blown_m, 0.0)) / graph.vector(clump_m, clump_m, clump_m)
        bits = float(1 << KEY_BITS)
        high = graph.math("FLOOR", canvas.seed / bits)
        key = graph.vector(canvas.seed - high * bits, high, graph.math("MODULO", canvas.key, bits))
        reach = given["visibility_m"] / clump_m
        near: Value = (0.0, 0.0, 0.0)
        far: Value = (0.0, 0.0, 0.0)
        part = _wave_graph()
        inputs = {"Ray": ray, "Place": place, "Key": key, "Reach": reach}
        for number, wave in enumerate(waves()):
            own = {"Vector": wave.vector, "Amplitude": wave.amplitude, "Turns": wave.turns, "Near": near, "Far": far}
            made = graph.group(part, inputs | own, name=f"Wave {number + 1}")
            near, far = made.out("Near", "vector"), made.out("Far", "vector")
    with graph.section("Clumps before each pixel"):
        size = graph.vector(canvas.width_px, canvas.height_px, 1.0)
        where = graph.math("DIVIDE", _pixels(canvas, on) + (0.5, 0.5, 1.0), size)
        reach_m = given["visibility_m"]
        way_m = graph.choose(on, distance_m, 1.0, "float")
        near_m = graph.math("MINIMUM", way_m, reach_m * EDGES[-1])
        total: Value = 0.0
        for means, edges in ((near, EDGES[:4]), (far, EDGES[3:])):
            assert isinstance(means, Socket)
            begin, end = (graph.vector(*(reach_m * edge for edge in some)) for some in (edges[:3], edges[1:]))
            length = graph.vector(near_m, near_m, near_m)
            within = graph.math("MINIMUM", graph.math("MAXIMUM", length, begin), end) - begin
            total = graph.math("DOT_PRODUCT", within, looked_up(graph, means, where, "Bilinear")) + total
        mean = total / graph.math("MAXIMUM", near_m, 1e-6) * given["unevenness"]
        # 1 + mean, but 1 / (1 - mean) below 0.
        return graph.math("MAXIMUM", mean, 0.0) + graph.math("DIVIDE", 1.0, 1.0 - graph.math("MINIMUM", mean, 0.0))


def _grid_side(graph: Graph, side_px: Socket, on: Socket, step: float = GRID_PX) -> Socket:
    """Return how many points a side has; one where the grid is not wanted."""
    return graph.math("MULTIPLY_ADD", graph.math("CEIL", side_px * (1 / step)) - 1.0, on, 1.0)


def _wave_graph() -> Graph:
    """Describe a wave: its means in the six slabs, along each ray, in clumps instead of metres."""
    graph = Graph("NW Fog wave", "Adds a wave of the density of fog, evened out in slabs of depth", alone=True)

    def vector(name: str, text: str) -> Socket:
        return graph.input(GroupInput(name, "vector", (0.0, 0.0, 0.0), text))

    ray, place = vector("Ray", "Direction of each pixel"), vector("Place", "The camera's, in clumps")
    key, turns = vector("Key", "Of the pattern"), vector("Turns", "The phase's for each part of the key")
    along = vector("Vector", "Radians a clump")
    near, far = vector("Near", "Sum of the waves before it"), vector("Far", "Likewise, of the farther slabs")
    amplitude = graph.input(GroupInput("Amplitude", "float", 1.0, "How strong it is"))
    reach = graph.input(GroupInput("Reach", "float", 1.0, "Visibility in clumps"))
    with graph.section("Wave"):
        phase = graph.math("DOT_PRODUCT", graph.math("FRACTION", key * turns), (1.0, 1.0, 1.0)) * (2 * math.pi)
        phase = graph.math("DOT_PRODUCT", along, place) + phase
        rate = graph.math("DOT_PRODUCT", ray, along) * reach
        rates, phases = graph.vector(rate, rate, rate), graph.vector(phase, phase, phase)
        strong = graph.vector(amplitude, amplitude, amplitude)
    for name, before, edges in (("Near", near, EDGES[:4]), ("Far", far, EDGES[3:])):
        middles = tuple((a + b) / 2 for a, b in pairwise(edges))
        halves = tuple((b - a) / 2 for a, b in pairwise(edges))
        with graph.section(name):
            wave = graph.math("COSINE", graph.math("MULTIPLY_ADD", rates, middles, phases))
            half = graph.math("MAXIMUM", graph.math("ABSOLUTE", rates * halves), (1e-4, 1e-4, 1e-4))
            evened = wave * graph.math("SINE", half) / half
            graph.output(name, graph.math("MULTIPLY_ADD", evened, strong, before), "vector", "With it")
    return graph


# --- glow ---


def glow_nodes(canvas: Canvas, given: Given, air: Socket, depth: Socket) -> Socket:
    """Return the glow of what is brighter than the airlight. depth: optical, below 0."""
    graph = canvas.graph
    with graph.section("Glow: what fog takes"):
        on = given["glow"] > 0.0
        thick = graph.choose(on, depth * -1.0, 0.0, "float")
        excess = graph.math("SUBTRACT", graph.choose(on, canvas.image, (0.0, 0.0, 0.0)), air)
        lost = 1.0 - graph.math("EXPONENT", thick * -1.0)
        bright = graph.math("MAXIMUM", excess * graph.vector(lost, lost, lost), (0.0, 0.0, 0.0))
        blocks = blocks_of(canvas, on)
        lamps, thickness = (blocks.means(image) for image in (bright, thick))
        lamps = lamps * graph.vector(*[blocks.inside] * 3)
    with graph.section("Glow: blur"):
        half = graph.math("TANGENT", given["view_deg"] * (math.pi / 360))
        unit = graph.math("TANGENT", given["glow_width_deg"] * (math.pi / 180)) / half * canvas.width_px * 0.5
        unit = unit / blocks.side
        root = graph.math("LOGARITHM", graph.math("MAXIMUM", thickness.x, 1e-6), 2.0)
        place = graph.clamp(graph.math("MULTIPLY_ADD", root, 0.5, 1.0), 0.0, float(len(WIDTHS) - 1))
        total: Value = (0.0, 0.0, 0.0)
        for number, width in enumerate(WIDTHS):
            share = graph.math("MAXIMUM", 1.0 - graph.math("ABSOLUTE", place - float(number)), 0.0)
            total = blurred(lamps * graph.vector(share, share, share), unit * width, total)
    with graph.section("Glow: over the frame"):
        assert isinstance(total, Socket)
        strength = given["glow"]
        return blocks.back(total) * graph.vector(strength, strength, strength)
