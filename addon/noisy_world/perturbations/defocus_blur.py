# SPDX-License-Identifier: GPL-3.0-or-later
"""Defocus blur: the scene out of focus."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.graph import Socket
from ..core.groups import Canvas
from ..core.perturbation import Frame, Perturbation
from ..core.schema import key
from ._kernels import correlate, disk_kernel, gaussian


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


def apply(rgb: NDArray[np.float32], parameters: DefocusBlur, _frame: Frame) -> NDArray[np.float32]:
    """Blur (H, W, 3)."""
    softened = gaussian(rgb, parameters.alias_sigma_px)
    return correlate(softened, disk_kernel(parameters.radius_px))


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Soften with the Blur node's Gaussian, whose size is 3 sigma, and average with its exact disk."""
    graph, radius, alias = canvas.graph, given["radius_px"], given["alias_sigma_px"] * 3.0
    with graph.section("Soften"):
        inputs = {"Image": canvas.image, "Size": graph.vector(alias, alias), "Type": "Gaussian", "Separable": True}
        softened = graph.node("CompositorNodeBlur", inputs).out("Image", "color")
    with graph.section("Circle of confusion"):
        inputs = {"Image": softened, "Size": graph.vector(radius, radius), "Type": "Flat", "Separable": False}
        return graph.node("CompositorNodeBlur", inputs).out("Image", "color")


PERTURBATION = Perturbation(
    name="defocus_blur",
    label="Defocus blur",
    category="lens",
    parameters=DefocusBlur,
    severities={"radius_px": (3, 4, 6, 8, 10), "alias_sigma_px": (0.1, 0.5, 0.5, 0.5, 0.5)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    apply=apply,
    build=build,
)
