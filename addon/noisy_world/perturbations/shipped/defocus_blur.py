# SPDX-License-Identifier: GPL-3.0-or-later
"""Defocus blur: the scene out of focus."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Graph, GroupInput, Kind, Socket
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import QUICKLY, correlate, disk_kernel, gaussian, quick_key
from ._glass import sampled, share_of

# A row of the disk that ends exactly at a pixel's centre includes it; above float32's error of a radius (4e-6 at 50
# px).
TIE_PX = 1e-4
# Where it is to be quick, larger disks than this are summed at half the frame's size; chosen.
QUICK_PX = 3.5
# Halving and enlarging blur by a variance of 1/4 and 2/3 along a line; a disk's is a quarter of its squared radius.
LOST_PX2 = 4 * (1 / 4 + 2 / 3)


@dataclass(frozen=True)
class DefocusBlur:
    """Convolution with a softened disk, the border replicated, as ImageNet-C.

    The kernel's sum is 1 at every radius: ImageNet-C softens its disk of radius 8 and 10 against the kernel's edge and
    brightens the frame by 1 %. Here the frame is softened instead of the disk, which is the same and faster.
    """

    radius_px: float = key("radius of the circle of confusion", default=6.0, unit="px", minimum=0, maximum=50)
    alias_sigma_px: float = key(
        "standard deviation of the Gaussian that softens the disk's edge", default=0.5, unit="px", minimum=0, maximum=5
    )
    coarse: bool = quick_key("sum large disks at half the frame's size: softer rims, in half the time")
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "radius_px": "Higher: everything is further out of focus; points grow to larger disks",
        "alias_sigma_px": "Higher: the disks' rims get softer",
        "coarse": "On: large disks have softer rims, and take half the time",
    }


def apply(rgb: NDArray[np.float32], parameters: DefocusBlur, _context: FrameContext) -> NDArray[np.float32]:
    """Blur (H, W, 3)."""
    if parameters.coarse and parameters.radius_px > QUICK_PX:
        return _at_half(rgb, parameters.radius_px)
    softened = gaussian(rgb, parameters.alias_sigma_px)
    return correlate(softened, disk_kernel(parameters.radius_px))


def _at_half(rgb: NDArray[np.float32], radius_px: float) -> NDArray[np.float32]:
    """Blur (H, W, 3) at half the size."""
    import cv2

    height, width = rgb.shape[:2]
    small = cv2.resize(rgb, ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_LINEAR)
    reach_px = math.sqrt(radius_px**2 - LOST_PX2) / 2
    blurred = correlate(np.asarray(small, np.float32), disk_kernel(reach_px))
    return np.asarray(cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)


def build(canvas: Canvas, given: Mapping[str, Socket], served: Mapping[str, float]) -> Socket:
    """Soften with the Blur node's Gaussian, whose size is 3 sigma, and sum the disk; quickly, at half the size."""
    graph, alias, radius_px = canvas.graph, given["alias_sigma_px"] * 3.0, given["radius_px"]
    quick = given["coarse"]
    with graph.section("Size"):
        # What is not used gets a single value instead of the frame, so it costs nothing.
        large = graph.math("GREATER_THAN", radius_px, QUICK_PX)
        kept = graph.choose(quick, graph.choose(large, 0.0, canvas.image), canvas.image)
    with graph.section("Soften"):
        inputs = {"Image": kept, "Size": graph.vector(alias, alias), "Type": "Gaussian", "Separable": True}
        softened = graph.node("CompositorNodeBlur", inputs).out("Image", "color")
    exact = _disk("Circle of confusion", softened, radius_px, served["radius_px"])
    with graph.section("Half the size"):
        sides = [graph.math("FLOOR", side * 0.5 + 0.5) for side in (canvas.width_px, canvas.height_px)]
        asked = graph.choose(large, canvas.image, 0.0)
        small = sampled(asked, share_of(graph, graph.vector(*sides)))
        reach_px = graph.math("SQRT", graph.math("MAXIMUM", radius_px * radius_px - LOST_PX2, 0.0)) * 0.5
    half = _disk("Half of it", small, reach_px, served["radius_px"] / 2)
    with graph.section("The frame's size"):
        share = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Normalized", "vector")
        quickly = graph.choose(large, sampled(half, share), exact)
        return graph.choose(quick, quickly, exact)


def _disk(section: str, softened: Socket, radius_px: Socket, most_px: float) -> Socket:
    """Return the mean of each pixel's disk, from its outermost rows inwards."""
    graph = softened.graph
    row = _rows()
    names: tuple[tuple[str, Kind], ...] = (
        ("Line", "vector"),
        ("Length", "float"),
        ("Total", "vector"),
        ("Area", "float"),
    )
    values: dict[str, Any] = {"Line": (0.0, 0.0, 0.0), "Length": 0.0, "Total": (0.0, 0.0, 0.0), "Area": 0.0}
    with graph.section(section):
        shared = {"Image": softened, "Radius": radius_px}
        for number in reversed(range(math.floor(most_px) + 1)):
            made = graph.group(row, shared | values | {"Row": float(number)})
            values = {name: made.out(name, kind) for name, kind in names}
        return values["Total"] / values["Area"]


def _rows() -> Graph:
    """Describe one summation: the pixels by which rows of the disk are longer than the next ones farther out.

    The rows at plus and minus `Row` and all rows between are at least as long as these two, so the box added here has
    2 `Row` + 1 rows.
    """
    graph = Graph("Defocus Blur Rows", "Adds to a disk what its rows reach beyond those farther out")
    image = graph.input(GroupInput("Image", "color", (0.0, 0.0, 0.0, 1.0), "The frame"))
    radius = graph.input(GroupInput("Radius", "float", 0.0, "The disk's radius", subtype="PIXEL"))
    row = graph.input(GroupInput("Row", "float", 0.0, "How far the two rows are from the middle", subtype="PIXEL"))
    line = graph.input(GroupInput("Line", "vector", (0.0, 0.0, 0.0), "Sum along the next row farther out"))
    length = graph.input(GroupInput("Length", "float", 0.0, "That row's length", subtype="PIXEL"))
    total = graph.input(GroupInput("Total", "vector", (0.0, 0.0, 0.0), "The sum so far"))
    area = graph.input(GroupInput("Area", "float", 0.0, "How many pixels it has"))
    with graph.section("Length of the row"):
        square = radius * radius - row * row
        half = graph.math("FLOOR", graph.math("SQRT", graph.math("MAXIMUM", square, 0.0)) + TIE_PX)
        own = (half * 2.0 + 1.0) * (square > -TIE_PX)
        # A row as long as the next one adds nothing: it gets a single value instead of a frame, so it costs nothing.
        active = own > length + 0.5
    with graph.section("Sum along the row"):
        source = graph.choose(active, image, 0.0)
        reached = _box(source, graph.vector(half, 0.0)) * graph.vector(own, own, own)
    with graph.section("Sum over the rows between"):
        more = graph.math("SUBTRACT", reached, graph.choose(active, line, 0.0, "vector"))
        height = row * 2.0 + 1.0
        added = _box(more, graph.vector(0.0, row)) * graph.vector(height, height, height)
    with graph.section("Add"):
        graph.output("Line", graph.choose(active, reached, line, "vector"), "vector")
        graph.output("Length", graph.math("MAXIMUM", own, length), "float")
        graph.output("Total", graph.choose(active, total + added, total, "vector"), "vector")
        graph.output("Area", area + graph.math("MAXIMUM", own - length, 0.0) * height, "float")
    return graph


def _box(image: Socket, size: Socket) -> Socket:
    inputs = {"Image": image, "Size": size, "Type": "Flat", "Separable": False}
    return image.graph.node("CompositorNodeBlur", inputs).out("Image", "color")


PERTURBATION = ColourPerturbation(
    name="defocus_blur",
    label="Defocus blur",
    stage="lens",
    order=10,
    parameters=DefocusBlur,
    newly=QUICKLY,
    severities={"radius_px": (3, 4, 6, 8, 10), "alias_sigma_px": (0.1, 0.5, 0.5, 0.5, 0.5)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Blurs the whole image alike, by a disk",
        "convolution with a disk, normalised everywhere",
        twin="defocus_depth",
        of_paper=True,
    ),
    apply=apply,
    averages=True,
    repeatable=True,
    nodes=Nodes(build, capacity={"radius_px": 10}),
)
