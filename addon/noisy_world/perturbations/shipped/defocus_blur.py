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
from ._arrays import correlate, disk_kernel, gaussian

# A row of the disk that ends exactly at a pixel's centre includes it; above float32's error of a radius (4e-6 at 50
# px).
TIE_PX = 1e-4


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
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "radius_px": "Higher: everything is further out of focus; points grow to larger disks",
        "alias_sigma_px": "Higher: the disks' rims get softer",
    }


def apply(rgb: NDArray[np.float32], parameters: DefocusBlur, _context: FrameContext) -> NDArray[np.float32]:
    """Blur (H, W, 3)."""
    softened = gaussian(rgb, parameters.alias_sigma_px)
    return correlate(softened, disk_kernel(parameters.radius_px))


def build(canvas: Canvas, given: Mapping[str, Socket], served: Mapping[str, float]) -> Socket:
    """Soften with the Blur node's Gaussian, whose size is 3 sigma; sum the disk from its outermost rows inwards."""
    graph, alias = canvas.graph, given["alias_sigma_px"] * 3.0
    with graph.section("Soften"):
        inputs = {"Image": canvas.image, "Size": graph.vector(alias, alias), "Type": "Gaussian", "Separable": True}
        softened = graph.node("CompositorNodeBlur", inputs).out("Image", "color")
    row = _rows()
    names: tuple[tuple[str, Kind], ...] = (
        ("Line", "vector"),
        ("Length", "float"),
        ("Total", "vector"),
        ("Area", "float"),
    )
    values: dict[str, Any] = {"Line": (0.0, 0.0, 0.0), "Length": 0.0, "Total": (0.0, 0.0, 0.0), "Area": 0.0}
    with graph.section("Circle of confusion"):
        shared = {"Image": softened, "Radius": given["radius_px"]}
        for number in reversed(range(math.floor(served["radius_px"]) + 1)):
            made = graph.group(row, shared | values | {"Row": float(number)})
            values = {name: made.out(name, kind) for name, kind in names}
    with graph.section("Mean"):
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
