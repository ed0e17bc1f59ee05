# SPDX-License-Identifier: GPL-3.0-or-later
"""Brightness: an exposure that is too long."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket
from ...core.schema import key
from ...images.pixels import rgb_bytes
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import by_bands
from ._noise import look_up

T = TypeVar("T", bound=np.integer | np.floating)

BLACK = np.float32(1e-6)  # a value below it counts as black, without a hue; chosen far below a byte's step, 4e-3


@dataclass(frozen=True)
class Brightness:
    """A constant added to HSV's value, hue and saturation kept, as ImageNet-C; black becomes grey."""

    offset: float = key("added to the value, of full scale", default=0.3, minimum=0, maximum=1)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "offset": "Higher: the whole picture gets lighter, until bright places are white",
    }


def apply(rgb: NDArray[np.float32], parameters: Brightness, _context: FrameContext) -> NDArray[np.float32]:
    """Brighten (H, W, 3)."""
    return by_bands(rgb, rgb.dtype, lambda band: _brighten(band, parameters.offset))


def _brighten(rgb: NDArray[np.float32], offset: float) -> NDArray[np.float32]:
    import cv2

    value = _value(rgb)
    gain = _gain(value, offset)
    gains = cv2.merge([gain, gain, gain]).reshape(rgb.shape)
    brighter = np.asarray(cv2.multiply(rgb, gains, dst=gains), np.float32).reshape(rgb.shape)
    brighter[value < BLACK] = min(offset, 1)
    return brighter


def apply_bytes(rgb: NDArray[np.uint8], parameters: Brightness, _context: FrameContext) -> NDArray[np.uint8]:
    """Brighten (H, W, 3) bytes by a table that has an entry for every value with every byte."""
    table = _table(parameters.offset)
    return by_bands(rgb, rgb.dtype, lambda band: look_up(_positions(band), table))


def _positions(rgb: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Return the table's indices (H, W, 3): value x 256 + byte."""
    import cv2

    value = _value(rgb)
    values = cv2.merge([value, value, value]).reshape(len(rgb), -1)
    return cv2.merge([rgb.reshape(len(rgb), -1), values]).view(np.uint16).reshape(rgb.shape)


@lru_cache(maxsize=16)
def _table(offset: float) -> NDArray[np.uint8]:
    levels = np.arange(256, dtype=np.float32) / np.float32(255)
    table = levels * _gain(levels, offset)[:, None]
    table[0] = min(offset, 1)
    return rgb_bytes(table)


def _value(rgb: NDArray[T]) -> NDArray[T]:
    import cv2

    red, green, blue = cv2.split(rgb)
    return np.asarray(cv2.max(cv2.max(red, green), blue), rgb.dtype).reshape(rgb.shape[:2])


def _gain(value: NDArray[np.float32], offset: float) -> NDArray[np.float32]:
    """Return the factor that raises the value by `offset`, to 1 at most."""
    return np.divide(np.minimum(value + np.float32(offset), 1), np.maximum(value, BLACK), dtype=np.float32)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Multiply by the gain that the largest channel needs."""
    graph, image, offset = canvas.graph, canvas.image, given["offset"]
    with graph.section("Value"):
        value = graph.math("MAXIMUM", graph.math("MAXIMUM", image.r, image.g), image.b)
    with graph.section("Gain"):
        brighter = graph.math("MINIMUM", value + offset, canvas.white)
        gain = brighter / graph.math("MAXIMUM", value, float(BLACK))
    with graph.section("Brighten"):
        black = value < float(BLACK)
        return graph.mix(image * gain, graph.math("MINIMUM", offset, 1.0), black)


PERTURBATION = ColourPerturbation(
    name="brightness",
    label="Brightness",
    stage="post",
    order=10,
    parameters=Brightness,
    severities={"offset": (0.1, 0.2, 0.3, 0.4, 0.5)},
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Makes the whole image lighter",
        "an offset added to HSV's value",
        of_paper=True,
    ),
    apply=apply,
    version=2,  # float colour is rounded before it
    repeatable=True,
    nodes=Nodes(build),
    apply_bytes=apply_bytes,
)
