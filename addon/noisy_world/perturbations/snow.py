# SPDX-License-Identifier: GPL-3.0-or-later
"""Snow: falling flakes before a whitened scene."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.perturbation import Frame, Perturbation
from ..core.schema import key
from ._kernels import correlate, line_kernel
from ._patterns import kept_for_sequence, three_channels, torus_window


@dataclass(frozen=True)
class Snow:
    """Two layers of streaked flakes, one the other turned by 180 degrees, over the whitened image, as ImageNet-C.

    The flakes are what is bright in an enlarged field of normal noise, over the whole frame.
    """

    mean: float = key("mean of the noise", default=0.55, minimum=-1, maximum=2)
    std: float = key("standard deviation of the noise", default=0.3, minimum=0, maximum=2)
    scale: float = key("how much the noise is enlarged", default=4.0, minimum=1, maximum=50)
    threshold: float = key("what is darker than this is no flake", default=0.9, minimum=-1, maximum=2)
    blur_radius_px: int = key("a streak has 2 radius + 1 pixels", default=12, unit="px", minimum=0, maximum=100)
    blur_sigma_px: float = key("standard deviation of its weights", default=8.0, unit="px", above=0, maximum=200)
    blending_ratio: float = key("share of the image, the rest being whitened", default=0.7, minimum=0, maximum=1)
    fall_px: float = key("drift: how far the flakes fall a frame", default=12.0, unit="px", minimum=0, maximum=1000)


def apply(rgb: NDArray[np.float32], parameters: Snow, frame: Frame) -> NDArray[np.float32]:
    """Let it snow on (H, W, 3)."""
    image = _whitened(rgb, parameters.blending_ratio)
    image += three_channels(_flakes(rgb.shape[:2], parameters, frame))
    return image


def _whitened(rgb: NDArray[np.float32], ratio: float) -> NDArray[np.float32]:
    import cv2

    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    grey *= np.float32(1.5)
    grey += np.float32(0.5)
    white = three_channels(grey)
    np.maximum(white, rgb, out=white)
    return cv2.addWeighted(rgb, ratio, white, 1 - ratio, 0.0, dst=white)


def _flakes(size: tuple[int, int], parameters: Snow, frame: Frame) -> NDArray[np.float32]:
    """Return both layers of flakes, (H, W)."""
    noise, angle_deg = _noise(frame, _cells(size, parameters.scale))
    fallen_px = frame.drift_frames * parameters.fall_px
    layer = _layer(size, noise, angle_deg, parameters, fallen_px)
    # Turned by 180 degrees, what rises falls.
    other = _layer(size, noise, angle_deg, parameters, -fallen_px) if fallen_px else layer
    return layer + other[::-1, ::-1]


def _layer(
    size: tuple[int, int], noise: NDArray[np.float32], angle_deg: float, parameters: Snow, fallen_px: float
) -> NDArray[np.float32]:
    """Return the flakes that this noise makes, streaked along the angle, after a fall along the angle too."""
    # The first and the last point of the noise lie on the frame's borders.
    step_y, step_x = ((cells - 1) / max(pixels - 1, 1) for cells, pixels in zip(noise.shape, size, strict=True))
    start = (-fallen_px * step_y, -fallen_px * step_x / math.tan(math.radians(angle_deg)))
    layer = torus_window(noise, size, (step_y, step_x), start)
    layer *= np.float32(parameters.std)
    layer += np.float32(parameters.mean)
    layer *= layer >= np.float32(parameters.threshold)
    np.clip(layer, 0.0, 1.0, out=layer)
    return correlate(layer, line_kernel(parameters.blur_radius_px, parameters.blur_sigma_px, angle_deg))


def _cells(size: tuple[int, int], scale: float) -> tuple[int, int]:
    return math.ceil(size[0] / scale), math.ceil(size[1] / scale)


@kept_for_sequence
def _noise(frame: Frame, cells: tuple[int, int]) -> tuple[NDArray[np.float32], float]:
    """Return standard normal noise of this many rows and columns, and the angle of the fall in degrees."""
    generator = frame.pattern_stream()
    angle_deg = generator.uniform(-135.0, -45.0)
    noise = generator.standard_normal(cells, dtype=np.float32)
    noise.flags.writeable = False
    return noise, angle_deg


PERTURBATION = Perturbation(
    name="snow",
    label="Snow",
    category="environment",
    parameters=Snow,
    severities={
        "mean": (0.1, 0.2, 0.55, 0.55, 0.55),
        "std": (0.3, 0.3, 0.3, 0.3, 0.3),
        "scale": (3, 2, 4, 4.5, 2.5),
        "threshold": (0.5, 0.5, 0.9, 0.85, 0.85),
        "blur_radius_px": (10, 12, 12, 12, 12),
        "blur_sigma_px": (4, 4, 8, 8, 12),
        "blending_ratio": (0.8, 0.7, 0.7, 0.65, 0.55),
    },
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    apply=apply,
    temporals=("fresh", "fixed", "drift"),
    counts=frozenset({"blur_radius_px"}),
)
