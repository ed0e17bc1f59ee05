# SPDX-License-Identifier: GPL-3.0-or-later
"""Zoom blur: the camera moves towards the scene, or its lens zooms, while the shutter is open."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Graph, GroupInput, Socket
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import QUICKLY, quick_key

FIRST = 3  # zooms that are summed first where it is to be quick; chosen


@dataclass(frozen=True)
class ZoomBlur:
    """The mean of the frame, twice, and of it enlarged about its centre in equal steps, as ImageNet-C.

    ImageNet-C cuts the middle out in whole pixels before it enlarges it; here the centre stays where it is. Depth is
    that of the frame without zoom.
    """

    zooms: int = key("how often the frame is enlarged", default=10, minimum=0, maximum=100)
    step: float = key("by how much more each time, of the frame's size", default=0.02, minimum=0, maximum=1)
    coarse: bool = quick_key("sum three zooms first, and then these sums: nearly the same, in half the time")
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "zooms": "Higher: everything is drawn out farther from the middle",
        "step": "Higher: everything is drawn out farther, until its copies come apart",
        "coarse": "On: nearly the same blur, in half the time",
    }


def apply(rgb: NDArray[np.float32], parameters: ZoomBlur, _context: FrameContext) -> NDArray[np.float32]:
    """Blur (H, W, 3)."""
    import cv2

    height, width = rgb.shape[:2]
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    flags, border = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, cv2.BORDER_REPLICATE

    def zoomed(image: NDArray[np.float32], number: int) -> NDArray[np.float32]:
        share = 1 / (1 + number * parameters.step)
        matrix = np.column_stack([np.eye(2) * share, centre * (1 - share)])
        made = cv2.warpAffine(image, matrix, (width, height), flags=flags, borderMode=border)
        return np.asarray(made, np.float32).reshape(rgb.shape)

    zooms = parameters.zooms
    if parameters.coarse:
        first = sum((zoomed(rgb, number) for number in range(1, min(FIRST - 1, zooms) + 1)), rgb)
        total = rgb + first
        for number in range(FIRST, zooms + 1, FIRST):
            total += zoomed(first, number) * np.float32(min(FIRST, zooms + 1 - number) / FIRST)
    else:
        total = rgb * np.float32(2)
        for number in range(1, zooms + 1):
            total += zoomed(rgb, number)
    return total * np.float32(1 / (zooms + 2))


def build(canvas: Canvas, given: Mapping[str, Socket], served: Mapping[str, float]) -> Socket:
    """Sum the frame moved away from its middle by each zoom."""
    graph, layer = canvas.graph, _layer()
    with graph.section("From the middle"):
        pixel = graph.node("CompositorNodeImageCoordinates", {"Image": canvas.image}).out("Pixel", "vector")
        middle = graph.math("MULTIPLY", graph.vector(canvas.width_px - 1.0, canvas.height_px - 1.0), (0.5, 0.5, 0.5))
        from_middle = graph.math("SUBTRACT", pixel, middle)
    shared = {"Image": canvas.image, "From Middle": from_middle, "Zooms": given["zooms"], "Growth": given["step"]}
    total, zooms = canvas.image * (2.0, 2.0, 2.0), given["zooms"]
    with graph.section("Zooms"):
        for number in range(1, int(served["zooms"]) + 1):
            made = graph.group(layer, shared | {"Number": float(number), "Total": total})
            total = made.out("Total", "vector")
    with graph.section("Quickly: the first zooms"):
        first = canvas.image * (1.0, 1.0, 1.0)
        few = graph.math("MINIMUM", zooms, FIRST - 1.0)
        for number in range(1, FIRST):
            made = graph.group(layer, shared | {"Zooms": few, "Number": float(number), "Total": first})
            first = made.out("Total", "vector")
    with graph.section("Quickly: their sums"):
        quickly = canvas.image + first
        for number in range(FIRST, int(served["zooms"]) + 1, FIRST):
            part = graph.clamp((zooms + (1.0 - number)) * (1 / FIRST))
            own = {"Image": first, "Number": float(number), "Total": quickly, "Part": part}
            quickly = graph.group(layer, shared | own).out("Total", "vector")
    with graph.section("Mean"):
        return graph.math("DIVIDE", graph.choose(given["coarse"], quickly, total, "vector"), zooms + 2.0)


def _layer() -> Graph:
    """Describe one zoom: it adds the enlarged frame."""
    graph = Graph("Zoom Blur Layer", "Adds the frame as one zoom shows it")
    image = graph.input(GroupInput("Image", "color", (0.0, 0.0, 0.0, 1.0), "The frame"))
    from_middle = graph.input(GroupInput("From Middle", "vector", (0.0, 0.0, 0.0), "Pixels from the middle"))
    zooms = graph.input(GroupInput("Zooms", "float", 0.0, "How many zooms there are"))
    growth = graph.input(GroupInput("Growth", "float", 0.0, "By how much more each enlarges"))
    number = graph.input(GroupInput("Number", "float", 1.0, "This zoom's number, from 1"))
    part = graph.input(GroupInput("Part", "float", 1.0, "How much of it is added"))
    total = graph.input(GroupInput("Total", "vector", (0.0, 0.0, 0.0), "The sum so far"))
    with graph.section("Place"):
        active = number < zooms + 0.5
        more = number * growth
        share = more / (more + 1.0)
        offset = from_middle * graph.vector(share, share, 0.0)
    with graph.section("Add"):
        # A zoom that is not asked for gets a single value instead of a frame, so it costs nothing.
        source = graph.choose(active, image, 0.0)
        extend = {"Extension X": "Extend", "Extension Y": "Extend"}
        inputs = {"Image": source, "Displacement": offset, "Interpolation": "Bilinear", **extend}
        seen = graph.node("CompositorNodeDisplace", inputs).out("Image", "color")
        more = graph.math("MULTIPLY_ADD", seen, graph.vector(part, part, part), total)
        graph.output("Total", graph.choose(active, more, total, "vector"), "vector")
    return graph


PERTURBATION = ColourPerturbation(
    name="zoom_blur",
    label="Zoom blur",
    stage="lens",
    order=51,
    parameters=ZoomBlur,
    newly=QUICKLY,
    severities={"zooms": (11, 15, 10, 12, 10), "step": (0.01, 0.01, 0.02, 0.02, 0.03)},
    source="ImageNet-C, zoom_blur: zooms from 1 to 1.11, 1.15, 1.2, 1.24 and 1.3",
    about=About(
        "Draws everything out from the middle, as a zoom or a move forward does",
        "the mean of the frame enlarged about its middle",
        of_imagenet_c=True,
    ),
    apply=apply,
    averages=True,
    repeatable=True,
    counts=frozenset({"zooms"}),
    nodes=Nodes(build, capacity={"zooms": 15}),
)
