# SPDX-License-Identifier: GPL-3.0-or-later
"""Saturate: colours paler or stronger than they are."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import by_bands

GREY = np.float32(1e-4)  # channels that are nearer to one another have no hue; chosen far below a byte's step, 4e-3


@dataclass(frozen=True)
class Saturate:
    """HSV's saturation times a gain plus an offset, cut to [0, 1], hue and value kept, as ImageNet-C.

    Grey has the hue 0: with an offset it becomes reddish.
    """

    gain: float = key("factor of the saturation", default=2.0, minimum=0, maximum=100)
    offset: float = key("added to it", default=0.0, minimum=0, maximum=1)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "gain": "Below 1 colors get paler; above 1 they get stronger",
        "offset": "Higher: pale colors get stronger, and gray turns red",
    }


def apply(rgb: NDArray[np.float32], parameters: Saturate, _context: FrameContext) -> NDArray[np.float32]:
    """Saturate (H, W, 3)."""
    return by_bands(rgb, rgb.dtype, lambda band: _saturated(band, parameters.gain, parameters.offset))


def _saturated(rgb: NDArray[np.float32], gain: float, offset: float) -> NDArray[np.float32]:
    # Whole planes at once: broadcasting three numbers at a time is slow in numpy.
    channels = [np.ascontiguousarray(rgb[..., channel]) for channel in range(3)]
    value = np.maximum(np.maximum(channels[0], channels[1]), channels[2])
    spread = value - np.minimum(np.minimum(channels[0], channels[1]), channels[2])
    grey = spread < GREY
    safe = np.maximum(value, GREY)
    stronger = np.clip(spread / safe * np.float32(gain) + np.float32(offset), 0.0, 1.0)
    factor = stronger * safe / np.maximum(spread, GREY)
    red = value * (1 - stronger)  # of green and blue, where hue is 0
    made = np.empty_like(rgb)
    for channel, given in enumerate(channels):
        made[..., channel] = np.where(grey, red if channel else value, value - (value - given) * factor)
    return made


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Move each channel away from HSV's value as the saturation grows."""
    graph, image = canvas.graph, canvas.image
    with graph.section("Saturation"):
        red, green, blue = image.x, image.y, image.z
        value = graph.math("MAXIMUM", graph.math("MAXIMUM", red, green), blue)
        spread = value - graph.math("MINIMUM", graph.math("MINIMUM", red, green), blue)
        safe = graph.math("MAXIMUM", value, float(GREY))
        stronger = graph.math("MULTIPLY_ADD", spread / safe, given["gain"], given["offset"])
        stronger = graph.math("MINIMUM", graph.math("MAXIMUM", stronger, 0.0), 1.0)
    with graph.section("Saturate"):
        factor = stronger * safe / graph.math("MAXIMUM", spread, float(GREY))
        whole = graph.vector(value, value, value)
        coloured = graph.math(
            "SUBTRACT", whole, graph.math("SUBTRACT", whole, image) * graph.vector(factor, factor, factor)
        )
        rest = value * (1.0 - stronger)
        return graph.mix(coloured, graph.vector(value, rest, rest), spread < float(GREY))


PERTURBATION = ColourPerturbation(
    name="saturate",
    label="Saturate",
    stage="post",
    order=15,
    parameters=Saturate,
    severities={"gain": (0.3, 0.1, 2.0, 5.0, 20.0), "offset": (0.0, 0.0, 0.0, 0.1, 0.2)},
    source="ImageNet-C, saturate",
    about=About(
        "Makes colors paler at severities 1 and 2, stronger from 3 on",
        "HSV's saturation times a gain, plus an offset",
        of_imagenet_c=True,
    ),
    apply=apply,
    repeatable=True,
    nodes=Nodes(build),
)
