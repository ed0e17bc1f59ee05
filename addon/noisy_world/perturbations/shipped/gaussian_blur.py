# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaussian blur: a soft lens."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import as_blur_node, gaussian

HALF = math.sqrt(0.5)  # of a standard deviation: what two blurs in a row have each


@dataclass(frozen=True)
class GaussianBlur:
    """Convolution with a Gaussian, cut off at 4 sigma, the border replicated, as ImageNet-C.

    On scene-linear light it is two Gaussians one after another, which together reach 4.2 sigma and end without an edge
    that a bright lamp would show.
    """

    sigma_px: float = key("standard deviation of the kernel", default=3.0, unit="px", minimum=0, maximum=50)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "sigma_px": "Higher: the picture gets softer, and detail goes",
    }


def apply(rgb: NDArray[np.float32], parameters: GaussianBlur, context: FrameContext) -> NDArray[np.float32]:
    """Blur (H, W, 3)."""
    if context.lit:
        once = as_blur_node(rgb, parameters.sigma_px * 3.0 * HALF)
        return as_blur_node(once, parameters.sigma_px * 3.0 * HALF)
    return gaussian(rgb, parameters.sigma_px)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Blur with the Blur node, whose Gaussian's size is 3 sigma and which cuts it off there; light twice."""
    graph, lit = canvas.graph, canvas.lit
    whole = given["sigma_px"] * 3.0
    if not isinstance(lit, Socket):
        half = whole * HALF
        return _blur(_blur(canvas.image, half), half) if lit else _blur(canvas.image, whole)
    with graph.section("Two blurs of light, one of a picture"):
        first = whole * graph.math("MULTIPLY_ADD", lit, HALF - 1.0, 1.0)
        second = whole * (lit * HALF)
    return _blur(_blur(canvas.image, first), second)


def _blur(image: Socket, size: Socket) -> Socket:
    graph = image.graph
    with graph.section("Blur"):
        inputs = {"Image": image, "Size": graph.vector(size, size), "Type": "Gaussian", "Separable": True}
        return graph.node("CompositorNodeBlur", inputs).out("Image", "color")


PERTURBATION = ColourPerturbation(
    name="gaussian_blur",
    label="Gaussian blur",
    stage="lens",
    order=30,
    parameters=GaussianBlur,
    severities={"sigma_px": (1, 2, 3, 4, 6)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Blurs the whole image alike, softly",
        "convolution with a Gaussian",
        of_paper=True,
    ),
    apply=apply,
    averages=True,
    repeatable=True,
    nodes=Nodes(build),
)
