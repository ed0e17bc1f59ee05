# SPDX-License-Identifier: GPL-3.0-or-later
"""Impulse noise: salt and pepper, from bit errors and dead or hot pixels."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.node_graph import Socket
from ...core.schema import key
from ..groups import Canvas
from ..kinds import About, ColourPerturbation, FrameContext, Nodes
from ._arrays import QUICK_NOISE, QUICKLY, by_bands, quick_key
from ._noise import CODES, look_up, uniform_codes

T = TypeVar("T", bound=np.integer | np.floating)


@dataclass(frozen=True)
class ImpulseNoise:
    """Channels of pixels, each on its own, go to 1 (half of them) or to 0, as ImageNet-C.

    Each half's share is a whole number of 65,536ths.
    """

    amount: float = key("share of the values that are replaced", default=0.09, minimum=0, maximum=1)
    coarse: bool = quick_key()
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "amount": "Higher: more pixels are pure black, white or a pure color",
        "coarse": QUICK_NOISE,
    }


def apply(rgb: NDArray[np.float32], parameters: ImpulseNoise, context: FrameContext) -> NDArray[np.float32]:
    """Put the impulses into (H, W, 3)."""
    return np.clip(_add(rgb, parameters, context), 0, 1)


def apply_bytes(rgb: NDArray[np.uint8], parameters: ImpulseNoise, context: FrameContext) -> NDArray[np.uint8]:
    """Put the impulses into (H, W, 3) bytes."""
    return _add(rgb, parameters, context)


def _add(rgb: NDArray[T], parameters: ImpulseNoise, context: FrameContext) -> NDArray[T]:
    import cv2

    generator, impulses = context.pattern_stream(), _impulses(parameters.amount)
    depth = cv2.CV_8U if rgb.dtype == np.uint8 else cv2.CV_32F
    return by_bands(
        rgb,
        rgb.dtype,
        lambda band: cv2.add(band, look_up(uniform_codes(generator, band.shape), impulses), dtype=depth),
    )


@lru_cache(maxsize=16)
def _impulses(amount: float) -> NDArray[np.int16]:
    """Return (CODES,): what each code adds to a byte before it is clipped, 255 (salt), -255 (pepper) or 0."""
    half = round(amount * CODES / 2)
    table = np.zeros(CODES, np.int16)
    table[:half] = -255
    table[CODES - half :] = 255
    return table


def build(canvas: Canvas, given: Mapping[str, Socket], _served: Mapping[str, float]) -> Socket:
    """Put an impulse where a random number is among the lowest (pepper) or the highest (salt)."""
    graph = canvas.graph
    with graph.section("Uniform noise"):
        uniform = canvas.random(0, canvas.position_px)
    with graph.section("Impulses"):
        half = given["amount"] * 0.5
        salt, pepper = uniform > 1.0 - half, uniform < half
    with graph.section("Put in"):
        # Of any brightness; of values in [0, 1] this is what adding the impulses and clipping gives.
        return graph.math("MAXIMUM", canvas.image * (1.0 - pepper), salt)


PERTURBATION = ColourPerturbation(
    name="impulse_noise",
    label="Impulse noise",
    stage="sensor",
    order=20,
    parameters=ImpulseNoise,
    severities={"amount": (0.03, 0.06, 0.09, 0.17, 0.27)},
    newly=QUICKLY,
    source='paper, table "Specific configurations of the RGB imaging perturbations"',
    about=About(
        "Makes single pixels black or white",
        "values replaced by black or white",
        of_paper=True,
    ),
    apply=apply,
    nodes=Nodes(build),
    apply_bytes=apply_bytes,
    temporals=("fresh", "fixed"),
    grain=True,
)
