# SPDX-License-Identifier: GPL-3.0-or-later
"""Frost: the scene through an iced pane."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.perturbation import Frame, Perturbation
from ..core.schema import key
from . import _ice


@dataclass(frozen=True)
class Frost:
    """intensity * image + influence * ice, as ImageNet-C; the ice is drawn, a picture picked for each frame.

    The picture is cropped at random, enlarged only where a frame is larger than it, and never squashed.
    """

    intensity: float = key("share of the image that is left", default=0.7, minimum=0, maximum=2)
    influence: float = key("share of the ice that is added", default=0.7, minimum=0, maximum=2)
    creep_px: float = key(
        "drift: how far the ice creeps a frame, to and fro",
        default=0.5,
        unit="px",
        minimum=0,
        maximum=100,
    )


def apply(rgb: NDArray[np.float32], parameters: Frost, frame: Frame) -> NDArray[np.float32]:
    """Put ice over (H, W, 3)."""
    import cv2

    frosted = _crop(rgb.shape[:2], parameters, frame).astype(np.float32)
    return cv2.addWeighted(rgb, parameters.intensity, frosted, parameters.influence / 255, 0.0, dst=frosted)


def _crop(size: tuple[int, int], parameters: Frost, frame: Frame) -> NDArray[np.uint8]:
    """Return the ice before the frame, (H, W, 3) uint8."""
    import cv2

    generator = frame.pattern_stream()
    picture = _ice.ice(int(generator.choice(_ice.EQUALLY_OFTEN)))
    start, angle = generator.random(2), generator.uniform(0, 2 * np.pi)
    # A tenth is left for the crop to move in, as ImageNet-C does.
    scale = max(1.0, 1.1 * size[0] / _ice.HEIGHT_PX, 1.1 * size[1] / _ice.WIDTH_PX)
    slack = np.array([_ice.HEIGHT_PX - size[0] / scale, _ice.WIDTH_PX - size[1] / scale])
    origin = np.floor(start * slack)
    if scale == 1 and not frame.drift_frames:
        row, column = origin.astype(int)
        return picture[row : row + size[0], column : column + size[1]]
    if frame.drift_frames:
        crept = frame.drift_frames * parameters.creep_px / scale * np.array([np.sin(angle), np.cos(angle)])
        origin = _to_and_fro(origin + crept, slack)
    matrix = np.array([[1 / scale, 0, origin[1]], [0, 1 / scale, origin[0]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(picture, matrix, (size[1], size[0]), flags=flags, borderMode=cv2.BORDER_REPLICATE)


def _to_and_fro(position: NDArray[np.float64], length: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fold positions back at both ends of [0, length]."""
    return length - np.abs(position % (2 * length) - length)


PERTURBATION = Perturbation(
    name="frost",
    label="Frost",
    category="environment",
    parameters=Frost,
    severities={"intensity": (1.0, 0.8, 0.7, 0.65, 0.6), "influence": (0.4, 0.6, 0.7, 0.7, 0.75)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"; the ice: our own',
    apply=apply,
    temporals=("fresh", "fixed", "drift"),
)
