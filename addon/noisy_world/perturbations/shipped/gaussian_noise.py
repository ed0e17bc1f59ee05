# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaussian noise: the read-out noise of a sensor in low light."""

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


@dataclass(frozen=True)
class GaussianNoise:
    """Independent normal noise on every channel of every pixel, as ImageNet-C."""

    std: float = key("standard deviation, of full scale", default=0.18, minimum=0, maximum=2)
    coarse: bool = quick_key()
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "std": "Higher: more color grain, everywhere alike",
        "coarse": QUICK_NOISE,
    }


def apply(rgb: NDArray[np.float32], parameters: GaussianNoise, context: FrameContext) -> NDArray[np.float32]:
    """Add the noise to (H, W, 3)."""
    import cv2

    generator, noise = context.pattern_stream(), _tables(parameters.std)[0]
    return by_bands(rgb, rgb.dtype, lambda band: cv2.add(band, look_up(uniform_codes(generator, band.shape), noise)))


def apply_bytes(rgb: NDArray[np.uint8], parameters: GaussianNoise, context: FrameContext) -> NDArray[np.uint8]:
    """Add the noise to (H, W, 3) bytes."""
    import cv2

    generator, noise = context.pattern_stream(), _tables(parameters.std)[1]
    return by_bands(
        rgb,
        rgb.dtype,
        lambda band: cv2.add(band, look_up(uniform_codes(generator, band.shape), noise), dtype=cv2.CV_8U),
    )


@lru_cache(maxsize=16)
def _tables(std: float) -> tuple[NDArray[np.float32], NDArray[np.int16]]:
    """Return the noise of each code (CODES,), in units of full scale and in whole bytes; both round to equal bytes."""
    steps = normal_quantiles() * (std * 255)
    # Keep 1e-3 of a byte clear of ties, so that byte + noise in float32 rounds as byte + rounded noise does.
    tie = np.floor(steps) + 0.5
    near = np.abs(steps - tie) < 1e-3
    steps[near] = tie[near] + np.copysign(1e-3, steps[near] - tie[near])
    return (steps / 255).astype(np.float32), np.rint(steps).astype(np.int16)


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Add normal noise."""
    with canvas.graph.section("Uniform noise"):
        uniform = canvas.random(0, canvas.position_px)
    with canvas.graph.section("Normal noise"):
        noise = normal_quantile(uniform)
    with canvas.graph.section("Add"):
        return canvas.graph.math("MULTIPLY_ADD", noise, given["std"], canvas.image)


PERTURBATION = ColourPerturbation(
    name="gaussian_noise",
    label="Gaussian noise",
    stage="sensor",
    order=10,
    parameters=GaussianNoise,
    severities={"std": (0.08, 0.12, 0.18, 0.26, 0.38)},
    newly=QUICKLY,
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Adds grain, as strong in dark places as in bright ones",
        "normal noise, added",
        of_paper=True,
    ),
    apply=apply,
    version=2,  # float colour is rounded before it
    nodes=Nodes(build),
    apply_bytes=apply_bytes,
    temporals=("fresh", "fixed"),
    grain=True,
)
