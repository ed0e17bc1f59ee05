# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion blur: the camera moves while the shutter is open."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.perturbation import Frame, Perturbation
from ..core.schema import key
from ._kernels import correlate, line_kernel


@dataclass(frozen=True)
class MotionBlur:
    """A one-sided trail with Gaussian weights along a line, its angle drawn for each frame; the border is replicated.

    As ImageNet-C. The angle is independent of the camera's true path.
    """

    radius_px: int = key("the trail has 2 radius + 1 pixels", default=15, unit="px", minimum=0, maximum=100)
    sigma_px: float = key("standard deviation of its weights", default=8.0, unit="px", above=0, maximum=200)
    max_angle_deg: float = key(
        "the angle to the rows is uniform between minus this and this", default=45.0, unit="deg", minimum=0, maximum=180
    )


def apply(rgb: NDArray[np.float32], parameters: MotionBlur, frame: Frame) -> NDArray[np.float32]:
    """Blur (H, W, 3)."""
    angle = frame.pattern_stream().uniform(-parameters.max_angle_deg, parameters.max_angle_deg)
    return correlate(rgb, line_kernel(parameters.radius_px, parameters.sigma_px, angle))


PERTURBATION = Perturbation(
    name="motion_blur",
    label="Motion blur",
    category="lens",
    parameters=MotionBlur,
    severities={"radius_px": (10, 15, 15, 15, 20), "sigma_px": (3, 5, 8, 12, 15)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    apply=apply,
    temporals=("fresh", "fixed"),
    counts=frozenset({"radius_px"}),
)
