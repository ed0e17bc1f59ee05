# SPDX-License-Identifier: GPL-3.0-or-later
"""Speckle noise: noise in proportion to the signal."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import QUICK_NOISE, QUICKLY, by_bands, quick_key
from ._noise import look_up, normal_quantile, normal_quantiles, uniform_codes

GAIN_STEPS = 2**14  # an odd multiple of 2^-14 times a byte has at most 14 fractional bits and, unless 0, is no tie


@dataclass(frozen=True)
class SpeckleNoise:
    """Each channel of each pixel times its own normal gain of mean 1, as ImageNet-C."""

    std: float = key("standard deviation, of the pixel's value", default=0.35, minimum=0, maximum=2)
    coarse: bool = quick_key()
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "std": "Higher: more grain in bright places; dark ones stay clean",
        "coarse": QUICK_NOISE,
    }


def apply(rgb: NDArray[np.float32], parameters: SpeckleNoise, context: FrameContext) -> NDArray[np.float32]:
    """Multiply (H, W, 3) by the gains."""
    generator, gains = context.pattern_stream(), _gains(parameters.std)
    return by_bands(rgb, rgb.dtype, lambda band: band * look_up(uniform_codes(generator, band.shape), gains))


def apply_bytes(rgb: NDArray[np.uint8], parameters: SpeckleNoise, context: FrameContext) -> NDArray[np.uint8]:
    """Multiply (H, W, 3) bytes by the gains."""
    import cv2

    generator, gains = context.pattern_stream(), _gains(parameters.std)
    return by_bands(
        rgb,
        rgb.dtype,
        lambda band: cv2.multiply(band, look_up(uniform_codes(generator, band.shape), gains), dtype=cv2.CV_8U),
    )


@lru_cache(maxsize=16)
def _gains(std: float) -> NDArray[np.float32]:
    """Return the gain of each code (CODES,): the nearest odd multiple of 2^-14.

    A byte times such a gain is never a tie between two bytes, nor so near one that float32 could round it the other
    way.
    """
    if std == 0:
        return np.ones(normal_quantiles().size, np.float32)
    exact = 1 + std * normal_quantiles()
    return ((2 * np.floor(exact * (GAIN_STEPS / 2)) + 1) / GAIN_STEPS).astype(np.float32)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Multiply by normal gains of mean 1."""
    with canvas.graph.section("Uniform noise"):
        uniform = canvas.random(0, canvas.position_px)
    with canvas.graph.section("Normal noise"):
        noise = normal_quantile(uniform)
    with canvas.graph.section("Gain"):
        return canvas.image * canvas.graph.math("MULTIPLY_ADD", noise, given["std"], 1.0)


PERTURBATION = ColourPerturbation(
    name="speckle_noise",
    label="Speckle noise",
    stage="sensor",
    order=40,
    parameters=SpeckleNoise,
    severities={"std": (0.15, 0.2, 0.35, 0.45, 0.6)},
    newly=QUICKLY,
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Adds grain in proportion to brightness",
        "normal noise, multiplied",
        of_paper=True,
    ),
    apply=apply,
    version=2,  # float colour is rounded before it
    nodes=Nodes(build),
    apply_bytes=apply_bytes,
    temporals=("fresh", "fixed"),
    grain=True,
)
