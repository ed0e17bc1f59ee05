# SPDX-License-Identifier: GPL-3.0-or-later
"""Contrast: tones closer to one another."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket
from ...core.schema import key
from ...images.pixels import rgb_bytes
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import by_bands


@dataclass(frozen=True)
class Contrast:
    """Each channel scaled about its own mean over the frame, as ImageNet-C."""

    factor: float = key("factor of the distance from the mean", default=0.2, minimum=0, maximum=10)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "factor": "Lower: the picture gets flatter, toward one gray; above 1 it gets harsher",
    }


def apply(rgb: NDArray[np.float32], parameters: Contrast, _context: FrameContext) -> NDArray[np.float32]:
    """Scale (H, W, 3) about its means."""
    import cv2

    return _scale(rgb, np.array(cv2.mean(rgb)[:3]), parameters.factor)


def apply_bytes(rgb: NDArray[np.uint8], parameters: Contrast, _context: FrameContext) -> NDArray[np.uint8]:
    """Scale (H, W, 3) bytes about their means, by a table for each channel."""
    import cv2

    levels = np.arange(256, dtype=np.float32) / np.float32(255)
    counts = np.stack([cv2.calcHist([rgb], [channel], None, [256], [0, 256]).ravel() for channel in range(3)], axis=1)
    means = levels.astype(np.float64) @ counts.astype(np.float64) / (rgb.size / 3)
    table = rgb_bytes(_scale(np.repeat(levels[:, None, None], 3, axis=2), means, parameters.factor))
    return np.asarray(cv2.LUT(rgb, table.reshape(1, 256, 3)), np.uint8).reshape(rgb.shape)


def _scale(rgb: NDArray[np.float32], means: NDArray[np.float64], factor: float) -> NDArray[np.float32]:
    # Whole rows at once: broadcasting three numbers at a time is slow in numpy.
    centre = np.tile(means.astype(np.float32), rgb.shape[1])

    def scaled(band: NDArray[np.float32]) -> NDArray[np.float32]:
        distance = band - centre
        distance *= np.float32(factor)
        return np.add(distance, centre, out=distance)

    return by_bands(rgb.reshape(rgb.shape[0], -1), rgb.dtype, scaled).reshape(rgb.shape)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Mix each channel's mean with the image."""
    graph = canvas.graph
    with graph.section("Means"):
        means = [
            graph.node("CompositorNodeLevels", {"Image": canvas.image, "Channel": channel}).out("Mean", "float")
            for channel in ("Red", "Green", "Blue")
        ]
        mean = graph.vector(*means)
    with graph.section("Scale"):
        return graph.mix(mean, canvas.image, given["factor"])


PERTURBATION = ColourPerturbation(
    name="contrast",
    label="Contrast",
    stage="post",
    order=20,
    parameters=Contrast,
    severities={"factor": (0.4, 0.3, 0.2, 0.1, 0.05)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Makes the whole image flatter, or harsher",
        "values moved towards each channel's mean",
        of_paper=True,
    ),
    apply=apply,
    version=2,  # float colour is rounded before it
    repeatable=True,
    nodes=Nodes(build),
    apply_bytes=apply_bytes,
)
