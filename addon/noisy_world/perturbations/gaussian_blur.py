# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaussian blur: a soft lens."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.node_graphs.graph import Socket
from ..core.node_graphs.groups import Canvas
from ..core.perturbing.kinds import ColourPerturbation, FrameContext
from ..core.schema import key
from ._kernels import gaussian


@dataclass(frozen=True)
class GaussianBlur:
    """Convolution with a Gaussian, cut off at 4 sigma, the border replicated, as ImageNet-C."""

    sigma_px: float = key("standard deviation of the kernel", default=3.0, unit="px", minimum=0, maximum=50)


def apply(rgb: NDArray[np.float32], parameters: GaussianBlur, _context: FrameContext) -> NDArray[np.float32]:
    """Blur (H, W, 3)."""
    return gaussian(rgb, parameters.sigma_px)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Blur with the Blur node, whose Gaussian's size is 3 sigma."""
    size = given["sigma_px"] * 3.0
    with canvas.graph.section("Blur"):
        inputs = {"Image": canvas.image, "Size": canvas.graph.vector(size, size), "Type": "Gaussian"}
        return canvas.graph.node("CompositorNodeBlur", inputs | {"Separable": True}).out("Image", "color")


PERTURBATION = ColourPerturbation(
    name="gaussian_blur",
    label="Gaussian blur",
    stage="lens",
    order=30,
    parameters=GaussianBlur,
    severities={"sigma_px": (1, 2, 3, 4, 6)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    apply=apply,
    averages=True,
    repeatable=True,
    build=build,
)
