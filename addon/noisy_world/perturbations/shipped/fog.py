# SPDX-License-Identifier: GPL-3.0-or-later
"""Fog: uneven haze that lifts the dark and takes contrast."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Graph, GroupInput, Socket
from ...core.schema import key
from ..groups import PURPOSES, Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import Level, colour_by_bands, kept_for_sequence, three_channels, torus_window

_LEAST_CELLS = 256  # least number of points along a side, however smooth the haze; chosen
_VISIBLE = 0.5 / 255  # half a byte's step: a finer level that is weaker changes no stored value
_NODE_LEVELS = 11  # of the node group, so 2^11 = 2048 points along a side; finer detail is interpolated


@dataclass(frozen=True)
class Fog:
    """(image + thickness * haze) * m / (m + thickness), with m the frame's brightest value, as ImageNet-C.

    The haze is a plasma fractal in [0, 1] of its own for each frame; `uniform` is the paper's text, a constant grey.
    """

    thickness: float = key("how much haze is added, of full scale", default=2.5, minimum=0, maximum=20)
    smoothness: float = key(
        "how much weaker the haze gets from one scale to the next finer, squared", default=1.7, minimum=1, maximum=10
    )
    uniform: bool = key("the same grey everywhere instead of the plasma", default=False)
    flow_px: float = key(
        "drift: how far the haze flows a frame, to the right",
        default=3.0,
        unit="px",
        minimum=-1000,
        maximum=1000,
        slider=(0, 50),
    )
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "thickness": "Higher: the haze gets denser, and contrast goes",
        "smoothness": "Higher: softer, larger clouds; lower: ragged ones",
        "uniform": "On: the same gray everywhere instead of clouds",
        "flow_px": "Higher: with the pattern Drift, the clouds move faster",
    }


def apply(rgb: NDArray[Level], parameters: Fog, context: FrameContext) -> NDArray[Level]:
    """Put haze over (H, W, 3)."""
    thickness = parameters.thickness
    # What is brighter than white, as on lit frames, does not make the fog brighter.
    brightest = min(float(rgb.max() if rgb.dtype == np.float32 else np.float32(rgb.max()) / np.float32(255)), 1.0)
    if thickness == 0:
        return rgb.copy()
    scale = np.float32(brightest / (brightest + thickness))
    if parameters.uniform:
        return colour_by_bands(rgb, lambda band: (band + np.float32(0.5 * thickness)) * scale)

    def hazy(band: NDArray[np.float32], haze: NDArray[np.float32]) -> NDArray[np.float32]:
        over = three_channels(haze * np.float32(thickness))
        over += band
        return np.multiply(over, scale, out=over)

    return colour_by_bands(rgb, hazy, _haze(rgb.shape[:2], parameters, context))


def _haze(size: tuple[int, int], parameters: Fog, context: FrameContext) -> NDArray[np.float32]:
    """Return the part of the plasma that the frame shows, (H, W): its upper left corner, moved if it flows."""
    levels = max(math.ceil(math.log2(max(size))), 1)
    plasma = _plasma(context, _levels_seen(levels, parameters.thickness, parameters.smoothness), parameters.smoothness)
    step = plasma.shape[0] / 2**levels
    moved = -context.drift_frames * parameters.flow_px * step
    return torus_window(plasma, size, (step, step), (0.0, moved))


def _levels_seen(levels: int, thickness: float, smoothness: float) -> int:
    """Return how many of the plasma's levels change a stored value; finer detail is left to interpolation."""
    strength = thickness / (1 + thickness)
    least = min(levels, int(math.log2(_LEAST_CELLS)))
    seen = sum(strength * smoothness ** (-2 * level) > _VISIBLE for level in range(levels))
    return max(least, seen)


@kept_for_sequence
def _plasma(context: FrameContext, levels: int, smoothness: float) -> NDArray[np.float32]:
    """Return a plasma fractal (2^levels, 2^levels) on a torus, scaled to [0, 1]: the diamond-square algorithm.

    Each level halves the distance of the points (Fournier, Fussell, Carpenter, "Computer rendering of stochastic
    models", 1982). A new point is the mean of its four neighbours plus a uniform deviation, smoothness^2 times weaker
    from level to level, because ImageNet-C multiplies its wibble by itself.
    """
    generator = context.pattern_stream()
    field = np.zeros((1, 1), dtype=np.float32)
    for level in range(levels):
        cells = field.shape[0]
        deviation = generator.random((3, cells, cells), dtype=np.float32)
        deviation -= np.float32(0.5)
        deviation *= np.float32(2 * smoothness ** (-2 * level))
        along_rows = field + np.roll(field, -1, axis=1)
        along_columns = field + np.roll(field, -1, axis=0)
        centres = (along_rows + np.roll(along_rows, -1, axis=0)) * np.float32(0.25) + deviation[0]
        finer = np.empty((2 * cells, 2 * cells), dtype=np.float32)
        finer[::2, ::2] = field
        finer[1::2, 1::2] = centres
        finer[::2, 1::2] = (along_rows + centres + np.roll(centres, 1, axis=0)) * np.float32(0.25) + deviation[1]
        finer[1::2, ::2] = (along_columns + centres + np.roll(centres, 1, axis=1)) * np.float32(0.25) + deviation[2]
        field = finer
    field -= field.min()
    field /= field.max()
    field.flags.writeable = False
    return field


# --- as a node group ---


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Build the plasma small, level by level, look at it enlarged, and blend it in."""
    graph, image, thickness = canvas.graph, canvas.image, given["thickness"]
    with graph.section("Size of the plasma"):
        width_px, height_px = (graph.math("ROUND", side / canvas.scale) for side in (canvas.width_px, canvas.height_px))
        longest_px = graph.math("MAXIMUM", width_px, height_px, label="Longest side")
        # float32's logarithm of a power of two may be a little above the whole number: 3e-5 less keeps the ceiling
        # right.
        doublings = graph.math("CEIL", graph.math("LOGARITHM", longest_px, 2.0) - 3e-5)
        levels = graph.math("MAXIMUM", doublings, 1.0, label="Levels of the frame")
        side_px = graph.math("POWER", 2.0, levels, label="Side of the torus")
        built = _levels_built(graph, levels, thickness, given["smoothness"])
        points = graph.math("POWER", 2.0, built, label="Points along it")
    with graph.section("Plasma"):
        plasma = _plasma_nodes(canvas, built, given["smoothness"])
    with graph.section("Look at it"):
        flowed = graph.math("FRACT", canvas.drift_frames * (given["flow_px"] / canvas.scale) / side_px)
        first = graph.math("DIVIDE", 0.5, points)
        where = graph.math(
            "MULTIPLY_ADD",
            canvas.position_px,
            graph.math("DIVIDE", 1.0, graph.vector(side_px, side_px, 1.0)),
            graph.vector(first - flowed, first, 1.0),
        )
        haze = _look_up(graph, plasma, where)
        level = graph.choose(given["uniform"], 0.5, haze, "float")
    with graph.section("Blend"):
        largest = graph.math("MAXIMUM", graph.math("MAXIMUM", image.r, image.g), image.b)
        found = graph.node("CompositorNodeLevels", {"Image": largest, "Channel": "Red"}).out("Maximum", "float")
        # A lamp brighter than white does not make the fog brighter.
        brightest = graph.math("MINIMUM", found, 1.0)
        scale = brightest / (brightest + thickness)
        return (image + level * thickness) * scale


def _levels_built(graph: Graph, levels: Socket, thickness: Socket, smoothness: Socket) -> Socket:
    """Return how many levels the nodes build: `_levels_seen` in closed form, _NODE_LEVELS at most."""
    strength = thickness / (thickness + 1.0)
    weaker = graph.math("MAXIMUM", graph.math("LOGARITHM", smoothness, math.e) * 2.0, 1e-6)
    seen = graph.math("CEIL", graph.math("LOGARITHM", strength / _VISIBLE, math.e) / weaker)
    enough = graph.math("MAXIMUM", math.log2(_LEAST_CELLS), seen, label="Levels seen")
    return graph.math("MINIMUM", graph.math("MINIMUM", levels, enough), float(_NODE_LEVELS), label="Levels built")


def _plasma_nodes(canvas: Canvas, built: Socket, smoothness: Socket) -> Socket:
    """Return the plasma in [0, 1] with 2^built points along a side; further levels are not calculated."""
    assert canvas.seed is not None
    assert canvas.key is not None
    graph, part = canvas.graph, _level_graph()
    inputs = {"Levels": built, "Smoothness": smoothness, "Seed": canvas.seed, "Key": canvas.key}
    field: Socket | float = 0.0
    for level in range(_NODE_LEVELS):
        made = graph.group(part, inputs | {"Field": field, "Level": float(level)}, name=f"Level {level + 1}")
        field = made.out("Field", "float")
    return graph.node("CompositorNodeNormalize", {"Value": field}).out("Value", "float")


def _level_graph() -> Graph:
    """Describe one level of diamond and square, which doubles the field's points along a side."""
    graph = Graph("Plasma Level", "Doubles the points of a plasma on a torus: diamond, then square")
    field = graph.input(GroupInput("Field", "float", 0.0, "The coarser plasma"))
    level = graph.input(GroupInput("Level", "float", 0.0, "How many levels are there already", 0.0))
    levels = graph.input(GroupInput("Levels", "float", 8.0, "How many there are to be: others pass the plasma on"))
    smoothness = graph.input(GroupInput("Smoothness", "float", 1.7, "The root of how much weaker a level is", 1.0))
    seed = graph.input(GroupInput("Seed", "int", 0, "Another seed, another pattern"))
    key = graph.input(GroupInput("Key", "float", 0.0, "Another key, another pattern: the frame"))
    with graph.section("Level"):
        wanted = levels > level + 0.5
        # Blender calculates both branches of a calculated choice, so a level that is not wanted is made tiny.
        points = graph.math("POWER", 2.0, level * wanted, label="Points along a side")
        deviation = graph.math("POWER", smoothness, level * -2.0, label="Largest deviation")
        number = graph.math("MULTIPLY_ADD", key, float(PURPOSES), level)
    with graph.section("Finer grid"):
        twice = points * 2.0
        blank = graph.node("CompositorNodeBlankImage", {"Size": graph.vector(twice, twice)}).out("Image", "color")
        position = graph.node("CompositorNodeImageCoordinates", {"Image": blank}).out("Pixel", "vector")
        parity = graph.math("MODULO", position, (2.0, 2.0, 2.0))
        is_centre = graph.math("MULTIPLY", parity.x, parity.y, label="Is a centre")
        is_edge = graph.math("COMPARE", parity.x + parity.y, 1.0, 0.1, label="Is amid an edge")
    with graph.section("Deviation"):
        where = graph.math("ADD", position, graph.vector(0.0, 0.0, seed))
        noise = graph.node("ShaderNodeTexWhiteNoise", {"Vector": where, "W": number}, {"noise_dimensions": "4D"})
        random = (noise.out("Value", "float") - 0.5) * (deviation * 2.0)
    with graph.section("Diamond"):
        half = graph.math("DIVIDE", 0.5, points)
        between = _look_up(graph, field, graph.math("MULTIPLY_ADD", position, half, graph.vector(half, half, 1.0)))
        centred = graph.math("MULTIPLY_ADD", random, is_centre, between)
    with graph.section("Square"):
        around = [_shifted(graph, centred, step) for step in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))]
        # The result is positioned as the first operand is, so this must not be a shifted one.
        total = random * 4.0 + around[0] + around[1] + around[2] + around[3]
        finer = graph.mix(centred, total * 0.25, is_edge)
        graph.output("Field", graph.choose(wanted, finer, field, "float"), "float", "The finer plasma")
    return graph


def _look_up(graph: Graph, field: Socket, where: Socket) -> Socket:
    """Sample a torus bilinearly. where: x and y from 0 to 1 along its sides; z is Map UV's weight, 1."""
    inputs = {
        "Image": field,
        "UV": where,
        "Interpolation": "Bilinear",
        "Extension X": "Repeat",
        "Extension Y": "Repeat",
    }
    return graph.node("CompositorNodeMapUV", inputs).out("Image", "float")


def _shifted(graph: Graph, field: Socket, step: tuple[float, float]) -> Socket:
    """Shift a torus by whole points."""
    inputs = {"Image": field, "Displacement": step, "Interpolation": "Nearest"}
    node = graph.node("CompositorNodeDisplace", inputs | {"Extension X": "Repeat", "Extension Y": "Repeat"})
    return node.out("Image", "float")


PERTURBATION = ColourPerturbation(
    name="fog",
    label="Fog",
    stage="environment",
    order=10,
    parameters=Fog,
    severities={"thickness": (1.5, 2.0, 2.5, 2.5, 3.0), "smoothness": (2.0, 2.0, 1.7, 1.5, 1.4)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"; the plasma: ImageNet-C',
    about=About(
        "Lays clouds of one grey over the image, as thick near as far away",
        "plasma haze, scaled by the frame's brightest value; `uniform: true` for an even grey",
        caption="the benchmark's haze, a pattern over the image.",
        twin="fog_depth",
        of_paper=True,
    ),
    overlay=True,
    apply=apply,
    version=2,  # float colour is rounded before it
    apply_bytes=apply,
    nodes=Nodes(build, draws_lit=True),
    temporals=("fresh", "fixed", "drift"),
    tinted=True,
)
