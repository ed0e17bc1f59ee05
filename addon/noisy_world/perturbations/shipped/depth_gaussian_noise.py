# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaussian noise of a depth sensor."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.schema import key
from ..kinds import About, DepthPerturbation, FrameContext
from ._arrays import without_void
from ._noise import look_up, normal_quantiles, uniform_codes


@dataclass(frozen=True)
class DepthGaussianNoise:
    """Independent normal noise on every pixel; void stays void, and what is not positive becomes void.

    The published toolbox also adds scale x mean(D) to every pixel; here only `bias` does.
    """

    scale: float = key(
        "standard deviation, of the standard deviation of the frame's depths", default=0.3, minimum=0, maximum=10
    )
    bias: bool = key("add scale x the mean depth of the frame as well, as the published toolbox does", default=False)
    TOOLTIPS: ClassVar[Mapping[str, str]] = {
        "scale": "Higher: surfaces get rougher, far ones more than near ones",
        "bias": "On: the whole frame moves away as well",
    }


def apply(depth_m: NDArray[np.float32], parameters: DepthGaussianNoise, context: FrameContext) -> NDArray[np.float32]:
    """Add the noise to (H, W) metres."""
    import cv2

    clean, valid = without_void(depth_m)
    mean, std = (float(value[0, 0]) for value in cv2.meanStdDev(clean, mask=valid.view(np.uint8)))
    noise = look_up(uniform_codes(context.pattern_stream(), clean.shape), _table())
    noisy = cv2.scaleAdd(noise, parameters.scale * std, clean).reshape(clean.shape)
    if parameters.bias:
        noisy += np.float32(parameters.scale * mean)
    valid &= (noisy > 0) & (noisy < np.inf)
    return np.where(valid, noisy, np.float32(0))


@cache
def _table() -> NDArray[np.float32]:
    return normal_quantiles().astype(np.float32)


PERTURBATION = DepthPerturbation(
    name="depth_gaussian_noise",
    label="Depth: Gaussian noise",
    order=20,
    parameters=DepthGaussianNoise,
    severities={"scale": (0.1, 0.2, 0.3, 0.4, 0.5)},
    source='paper, table "Specific configurations of the depth imaging perturbations"',
    about=About(
        "Roughens depth, wherever it is, by the spread of the frame's depths",
        "normal noise, in proportion to the standard deviation of the frame's depths",
        picture="Noise of depth at severities 1, 3 and 5",
        of_paper=True,
    ),
    apply=apply,
    temporals=("fresh", "fixed"),
    grain=True,
)
