# SPDX-License-Identifier: GPL-3.0-or-later
"""Spatter: drops of water or splashes of mud on the lens."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.perturbation import Frame, Perturbation
from ..core.schema import key
from ._kernels import gaussian
from ._patterns import kept_for_sequence, three_channels, torus_window

_WATER_RGB = (175, 238, 238)
_MUD_RGB = (63, 42, 20)
_FAR_PX = 20  # the rim's glint reaches no further
_RIM = np.array([[-2, -1, 0], [-1, 1, 1], [0, 1, 2]], dtype=np.float32)


@dataclass(frozen=True)
class Spatter:
    """Drops where smoothed normal noise is above a threshold, as ImageNet-C.

    Water adds a pale tint, strongest near the drops' rims; mud covers. Where no drop falls, the image stays as it is.
    """

    mean: float = key("mean of the noise", default=0.65, minimum=-1, maximum=2)
    std: float = key("standard deviation of the noise", default=0.3, minimum=0, maximum=2)
    sigma_px: float = key("standard deviation of its smoothing", default=2.0, unit="px", minimum=0, maximum=50)
    threshold: float = key("what is below this is no drop", default=0.68, minimum=0, maximum=2)
    scaling: float = key(
        "water: the tint's greatest strength; mud: standard deviation of the edges' smoothing in px",
        default=0.5,
        minimum=0,
        maximum=50,
    )
    complexity: int = key("0 is water, 1 is mud", default=0, minimum=0, maximum=1)
    run_px: float = key("drift: how far the drops run down a frame", default=0.5, unit="px", minimum=0, maximum=1000)


def apply(rgb: NDArray[np.float32], parameters: Spatter, frame: Frame) -> NDArray[np.float32]:
    """Spatter (H, W, 3)."""
    cover = _cover(frame, rgb.shape[:2], parameters)
    if frame.drift_frames:
        cover = torus_window(cover, rgb.shape[:2], start=(-frame.drift_frames * parameters.run_px, 0.0))
    if not cover.any():
        return rgb.copy()
    spattered = _tinted(cover, _MUD_RGB if parameters.complexity else _WATER_RGB)
    if not parameters.complexity:
        spattered += rgb
        return spattered
    left = three_channels(1 - cover)
    left *= rgb
    left += spattered
    return left


def _tinted(cover: NDArray[np.float32], colour: tuple[int, int, int]) -> NDArray[np.float32]:
    import cv2

    return cv2.merge([cover * np.float32(value / 255) for value in colour])


@kept_for_sequence
def _cover(frame: Frame, size: tuple[int, int], parameters: Spatter) -> NDArray[np.float32]:
    """Return how much of each pixel the drops cover, (H, W); on a torus if it drifts, so that it runs on and on."""
    import cv2

    noise = frame.pattern_stream().standard_normal(size, dtype=np.float32)
    noise *= np.float32(parameters.std)
    noise += np.float32(parameters.mean)
    margin = _margin(parameters) if frame.temporal == "drift" else 0
    if margin:
        noise = cv2.copyMakeBorder(noise, *[margin] * 4, cv2.BORDER_WRAP)
    layer = gaussian(noise, parameters.sigma_px)
    layer *= layer >= np.float32(parameters.threshold)
    cover = _mud(layer, parameters) if parameters.complexity else _water(layer)
    cover = cover[margin : margin + size[0], margin : margin + size[1]]
    if not parameters.complexity and (brightest := float(cover.max())) > 0:
        cover = cover * np.float32(parameters.scaling / brightest)
    cover = np.ascontiguousarray(cover)
    cover.flags.writeable = False
    return cover


def _margin(parameters: Spatter) -> int:
    """Return how far away noise has an influence."""
    reach = math.ceil(4 * parameters.scaling) if parameters.complexity else _FAR_PX + 4
    return math.ceil(4 * parameters.sigma_px) + reach


def _mud(layer: NDArray[np.float32], parameters: Spatter) -> NDArray[np.float32]:
    cover = gaussian((layer > 0).astype(np.float32), parameters.scaling)
    cover *= cover >= np.float32(0.8)
    return cover


def _water(layer: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the drops' brightness: their own, times a relief of the distance to their rims."""
    import cv2

    drops = np.minimum(layer * np.float32(255), np.float32(255)).astype(np.uint8)
    distance = cv2.distanceTransform(255 - cv2.Canny(drops, 50, 150), cv2.DIST_L2, 5)
    np.minimum(distance, np.float32(_FAR_PX), out=distance)
    relief = cv2.equalizeHist(cv2.blur(distance, (3, 3)).astype(np.uint8))
    relief = cv2.blur(cv2.filter2D(relief, cv2.CV_8U, _RIM), (3, 3))
    return drops * relief.astype(np.float32)


PERTURBATION = Perturbation(
    name="spatter",
    label="Spatter",
    category="environment",
    parameters=Spatter,
    severities={
        "mean": (0.65, 0.65, 0.65, 0.65, 0.67),
        "std": (0.3, 0.3, 0.3, 0.3, 0.4),
        "sigma_px": (4, 3, 2, 1, 1),
        "threshold": (0.69, 0.68, 0.68, 0.65, 0.65),
        "scaling": (0.6, 0.6, 0.5, 1.5, 1.5),
        "complexity": (0, 0, 0, 1, 1),
    },
    source='paper, table "Specific configurations of the RGB imaging perturbations"; the drops: ImageNet-C',
    apply=apply,
    temporals=("fresh", "fixed", "drift"),
    counts=frozenset({"complexity"}),
)
