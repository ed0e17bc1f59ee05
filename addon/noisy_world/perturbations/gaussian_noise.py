# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaussian noise: the read-out noise of a sensor in low light."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.perturbation import Frame, Perturbation
from ..core.schema import key


@dataclass(frozen=True)
class GaussianNoise:
    """Independent normal noise on every channel of every pixel."""

    std: float = key("standard deviation, of full scale", default=0.18, minimum=0, maximum=2)


def apply(rgb: NDArray[np.float32], parameters: GaussianNoise, frame: Frame) -> NDArray[np.float32]:
    """Add the noise to (H, W, 3)."""
    noise = frame.pattern_stream().standard_normal(rgb.shape, dtype=np.float32)
    noise *= np.float32(parameters.std)
    noise += rgb
    return noise


PERTURBATION = Perturbation(
    name="gaussian_noise",
    label="Gaussian noise",
    category="sensor",
    parameters=GaussianNoise,
    severities={"std": (0.08, 0.12, 0.18, 0.26, 0.38)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    apply=apply,
    temporals=("fresh", "fixed"),
)
