# SPDX-License-Identifier: GPL-3.0-or-later
"""JPEG compression: blocks, ringing and smeared colours."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.images import as_float, rgb_bytes
from ..core.node_graphs.graph import Socket
from ..core.node_graphs.groups import Canvas
from ..core.perturbing.about import About
from ..core.perturbing.kinds import ColourPerturbation, FrameContext
from ..core.schema import key
from ._full_size import full_size
from ._jpeg_nodes import compressed


@dataclass(frozen=True)
class JpegCompression:
    """Encoded and decoded, 4:2:0, libjpeg's tables, as ImageNet-C. The image is rounded to bytes on the way."""

    quality: int = key("quality as libjpeg counts it: lower is coarser", default=15, minimum=1, maximum=100)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "quality": "Lower: coarser blocks of 8 pixels, and blurrier colors",
    }


def apply(rgb: NDArray[np.float32], parameters: JpegCompression, _context: FrameContext) -> NDArray[np.float32]:
    """Compress (H, W, 3)."""
    return as_float(apply_bytes(rgb_bytes(rgb), parameters, _context))


def apply_bytes(rgb: NDArray[np.uint8], parameters: JpegCompression, _context: FrameContext) -> NDArray[np.uint8]:
    """Compress (H, W, 3) bytes."""
    import cv2

    options = [cv2.IMWRITE_JPEG_QUALITY, parameters.quality]
    options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420]
    _, encoded = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), options)
    decoded = cv2.imdecode(encoded, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
    return np.asarray(decoded, np.uint8)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Do to the pixels what encoding and decoding do, with all 64 coefficients of each block.

    A preview is enlarged to the reference width, by slopes between its pixels, and its result made small again. So its
    blocks look as they do in the frame, and it takes as long as the frame. An image larger than the reference width has
    blocks of 8 of its own pixels.
    """
    full = full_size(canvas)
    return full.back(compressed(full.canvas, given["quality"]))


PERTURBATION = ColourPerturbation(
    name="jpeg_compression",
    label="JPEG compression",
    stage="post",
    order=30,
    parameters=JpegCompression,
    severities={"quality": (25, 18, 15, 10, 7)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Leaves the blocks and rings of strong compression",
        "encoded and decoded by libjpeg",
        of_paper=True,
    ),
    apply=apply,
    repeatable=True,
    build=build,
    apply_bytes=apply_bytes,
    counts=frozenset({"quality"}),
)
