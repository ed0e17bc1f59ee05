# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion blur: the camera moves while the shutter is open."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Graph, GroupInput, Socket, Value
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import QUICKLY, correlate, line_kernel, quick_key
from ._noise import white_noise

# Of the pixel's own weight: smaller weights are left out of the node group. Together they are less than 0.1 of 255.
NEGLIGIBLE = 1e-3
# Quickly, so many steps are summed first, and these sums then: 1 for each FINEST_PX of the deviation; both are chosen.
FINEST_PX, MOST_FIRST = 2.5, 4
SLOPED = 0.8  # deviations along the trail: the sums fall off as the trail does there; chosen
# A step half way between two pixels goes to the left or upper one; this is above what float32 rounds the angle by.
TIE_PX = 5e-5


@dataclass(frozen=True)
class MotionBlur:
    """A one-sided trail with Gaussian weights along a line, its angle drawn for each frame; the border is replicated.

    As ImageNet-C. The angle is independent of the camera's true path.
    """

    radius_px: int = key("the trail has 2 radius + 1 pixels", default=15, unit="px", minimum=0, maximum=100)
    sigma_px: float = key("standard deviation of its weights", default=8.0, unit="px", above=0, maximum=200)
    max_angle_deg: float = key(
        "the angle to the rows is uniform between minus this and this",
        default=45.0,
        unit="deg",
        minimum=0,
        maximum=180,
        slider=(0, 90),
    )
    angle_deg: float = key(
        "middle of the range the angle is drawn from: 0 to the right, 90 down",
        default=0.0,
        unit="deg",
        minimum=-180,
        maximum=180,
        slider=(-90, 90),
    )
    coarse: bool = quick_key("sum a few steps first, and then these sums: nearly the same trail, in half the time")
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "radius_px": "Higher: longer streaks",
        "sigma_px": "Higher: the streaks fade less toward their ends",
        "max_angle_deg": "Higher: the streaks' direction varies more from frame to frame",
        "angle_deg": "Turns the streaks",
        "coarse": "On: nearly the same streaks, in half the time",
    }


def apply(rgb: NDArray[np.float32], parameters: MotionBlur, context: FrameContext) -> NDArray[np.float32]:
    """Blur (H, W, 3)."""
    if context.lit:  # as the nodes draw
        turn = (2 * white_noise(context).numbers(0)[0] - 1) * parameters.max_angle_deg
    else:
        turn = context.pattern_stream().uniform(-parameters.max_angle_deg, parameters.max_angle_deg)
    angle = parameters.angle_deg + turn
    if parameters.coarse:
        return correlate(rgb, quick_kernel(parameters.radius_px, parameters.sigma_px, angle))
    least = NEGLIGIBLE if context.lit else 0.0  # what nodes leave out, beside a lamp, is more than rounding
    return correlate(rgb, line_kernel(parameters.radius_px, parameters.sigma_px, angle, least))


def quick_kernel(radius_px: int, sigma_px: float, angle_deg: float) -> NDArray[np.float32]:
    """Return what `line_kernel` does of a trail whose steps are summed a few at a time: (odd, odd), sum 1."""
    few = first_steps(sigma_px)
    angle = math.radians(angle_deg)
    towards = np.array([math.sin(angle), math.cos(angle)])

    def steps(places: NDArray[np.int64], ahead: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        weights = np.exp(-((places + ahead) ** 2) / (2 * sigma_px**2))
        return np.ceil((places[:, None] * towards).round(9) - 0.5).astype(int), weights * (weights > NEGLIGIBLE)

    near, parts = steps(np.arange(min(few, 2 * radius_px + 1)), SLOPED * sigma_px)
    far, wholes = steps(np.arange(0, 2 * radius_px + 1, few), (few - 1) / 2)
    reach = 2 * radius_px + few
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    places = reach + near[:, None] + far
    np.add.at(kernel, (places[..., 0], places[..., 1]), parts[:, None] * wholes)
    return (kernel / kernel.sum()).astype(np.float32)


def first_steps(sigma_px: float) -> int:
    """Return how many steps of a trail are summed first."""
    return min(max(math.floor(sigma_px / FINEST_PX), 1), MOST_FIRST)


def build(canvas: Canvas, given: Mapping[str, Socket], served: Mapping[str, float]) -> Socket:
    """Sum the frame shifted by each step of the trail, cut out of a copy with wide borders."""
    graph = canvas.graph
    count = 2 * int(served["radius_px"]) + 1
    with graph.section("Direction"):
        turn = graph.math("MULTIPLY_ADD", canvas.random_value(0), 2.0, -1.0)
        angle = graph.math("RADIANS", graph.math("MULTIPLY_ADD", turn, given["max_angle_deg"], given["angle_deg"]))
        direction = graph.vector(graph.math("COSINE", angle), graph.math("SINE", angle), 0.0)
    with graph.section("Weights"):
        spread = -0.5 / (given["sigma_px"] * given["sigma_px"])
        last = given["radius_px"] * 2.0
    with graph.section("Widen the border"):
        size = graph.vector(canvas.width_px, canvas.height_px, 1.0)
        padded = _padded(canvas.image, size, count + MOST_FIRST)
    shared = {"Direction": direction, "Spread": spread, "Last": last}
    whole = shared | {"Widened": padded, "Border": float(count + MOST_FIRST), "Size": size}
    with graph.section("Trail"):
        total, weights = _trail(graph, whole, [float(number) for number in range(count)])
    with graph.section("Mean"):
        exact = graph.math("DIVIDE", total, weights)
    with graph.section("Quickly: a few steps"):
        few = graph.clamp(graph.math("FLOOR", given["sigma_px"] * (1 / FINEST_PX)), 1.0, float(MOST_FIRST))
        inner = graph.math("ADD", size, (2.0 * count, 2.0 * count, 0.0))
        first = whole | {"Border": float(MOST_FIRST), "Size": inner, "Ahead": given["sigma_px"] * SLOPED}
        first["Last"] = graph.math("MINIMUM", few - 1.0, last)
        sums, of_sums = _trail(graph, first, [float(number) for number in range(MOST_FIRST)])
    with graph.section("Quickly: their sums"):
        second = shared | {"Widened": sums, "Border": float(count), "Size": size, "Ahead": few * 0.5 - 0.5}
        # A trail of few first steps is short, as what is negligible is left out.
        longest = math.ceil(math.sqrt(-2 * math.log(NEGLIGIBLE)) * FINEST_PX * 2)
        numbers = max(min(longest, count), -(-count // MOST_FIRST))
        total, weights = _trail(graph, second, [few * float(number) for number in range(numbers)])
        quickly = graph.math("DIVIDE", total, weights * of_sums)
        return graph.choose(given["coarse"], quickly, exact, "vector")


def _trail(graph: Graph, shared: Mapping[str, Socket | float], steps: Sequence[Value]) -> tuple[Socket, Socket]:
    """Return the sum of steps, and of their weights."""
    step = _step()
    total: Value = (0.0, 0.0, 0.0)
    weights: Value = 0.0
    for number in steps:
        made = graph.group(step, {**shared, "Step": number, "Total": total, "Weights": weights})
        total, weights = made.out("Total", "vector"), made.out("Weights", "float")
    assert isinstance(total, Socket)
    assert isinstance(weights, Socket)
    return total, weights


def _padded(image: Socket, size: Socket, border_px: int) -> Socket:
    """Return the image with its outermost pixels repeated on all sides."""
    graph = image.graph
    wide = graph.node("CompositorNodeBlankImage", {"Size": graph.math("ADD", size, 2.0 * border_px)})
    pixel = graph.node("CompositorNodeImageCoordinates", {"Image": wide.out("Image", "color")}).out("Pixel", "vector")
    where = graph.math("DIVIDE", graph.math("ADD", pixel, (0.5 - border_px, 0.5 - border_px, 1.0)), size)
    extend = {"Extension X": "Extend", "Extension Y": "Extend"}
    inputs = {"Image": image, "UV": where, "Interpolation": "Nearest", **extend}
    return graph.node("CompositorNodeMapUV", inputs).out("Image", "color")


def _step() -> Graph:
    """Describe a step of the trail: it adds the shifted frame times the step's weight."""
    graph = Graph("Motion Blur Step", "Adds the frame as a step of the trail sees it")
    wide = graph.input(GroupInput("Widened", "color", (0.0, 0.0, 0.0, 1.0), "The frame with wide borders"))
    total = graph.input(GroupInput("Total", "vector", (0.0, 0.0, 0.0), "The sum so far"))
    weights = graph.input(GroupInput("Weights", "float", 0.0, "The sum of the weights so far"))
    step = graph.input(GroupInput("Step", "float", 0.0, "The step's number, from 0"))
    ahead = graph.input(GroupInput("Ahead", "float", 0.0, "Added to the number where the weight is asked for"))
    last = graph.input(GroupInput("Last", "float", 0.0, "The number of the last step"))
    direction = graph.input(GroupInput("Direction", "vector", (1.0, 0.0, 0.0), "A step: pixels to the right and down"))
    spread = graph.input(GroupInput("Spread", "float", -1.0, "A weight is exp(spread times the step squared)"))
    border = graph.input(GroupInput("Border", "float", 0.0, "How wide the border is"))
    size = graph.input(GroupInput("Size", "vector", (1.0, 1.0, 0.0), "The frame's width and height"))
    with graph.section("Weight"):
        along = step + ahead
        exponent = along * along * spread
        weight = graph.math("EXPONENT", exponent)
        active = graph.math("MULTIPLY", weight > NEGLIGIBLE, step < last + 0.5)
    with graph.section("Place"):
        position = graph.math("CEIL", direction * step - 0.5 - TIE_PX)
        corner = graph.math("MULTIPLY_ADD", position, (1.0, -1.0, 0.0), graph.vector(border, border, 0.0))
    with graph.section("Cut out"):
        # A step without weight gets a single value instead of a frame, so it costs nothing.
        source = graph.choose(active, wide, 0.0)
        inputs = {"Image": source, "X": corner.x, "Y": corner.y, "Width": size.x, "Height": size.y}
        seen = graph.node("CompositorNodeCrop", inputs | {"Alpha Crop": False}).out("Image", "color")
    with graph.section("Add"):
        used = weight * active
        graph.output("Total", graph.math("MULTIPLY_ADD", seen, graph.vector(used, used, used), total), "vector")
        graph.output("Weights", weights + used, "float")
    return graph


PERTURBATION = ColourPerturbation(
    name="motion_blur",
    label="Motion blur",
    stage="lens",
    order=50,
    parameters=MotionBlur,
    newly=QUICKLY,
    severities={"radius_px": (10, 15, 15, 15, 20), "sigma_px": (3, 5, 8, 12, 15)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Smears the whole image along one line, whatever the camera does",
        "a one-sided trail at a random angle",
        twin="camera_motion_blur",
        of_paper=True,
    ),
    apply=apply,
    averages=True,
    temporals=("fresh", "fixed"),
    counts=frozenset({"radius_px"}),
    nodes=Nodes(build, capacity={"radius_px": 20}),
)
