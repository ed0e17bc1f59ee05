# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth of a stereo camera, which measures disparity in fractions of a pixel."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from noisy_world.extend import DepthPerturbation, FrameContext, key


@dataclass(frozen=True)
class StereoSteps:
    """Disparity is uncertain and rounded, so far depth has steps."""

    step_px: float = key("what disparity is rounded to", default=0.25, unit="px", above=0, maximum=8)
    noise_px: float = key("standard deviation of disparity", default=0.05, unit="px", minimum=0, maximum=8)
    baseline_m: float = key("distance between the two cameras", default=0.05, unit="m", above=0, maximum=10)


def apply(depth_m: NDArray[np.float32], parameters: StereoSteps, context: FrameContext) -> NDArray[np.float32]:
    """Round the disparity of (H, W) metres; disparities of 0 become void, and void stays void."""
    if context.intrinsics is None:
        raise TypeError("stereo_steps needs the camera's intrinsics")
    product = context.intrinsics.fx_px * parameters.baseline_m
    disparity_px = np.divide(product, depth_m, out=np.zeros_like(depth_m), where=depth_m > 0)
    disparity_px += parameters.noise_px * context.stream().standard_normal(depth_m.shape)
    disparity_px = np.round(disparity_px / parameters.step_px) * parameters.step_px
    known = (depth_m > 0) & (disparity_px > 0)
    return np.divide(product, disparity_px, out=np.zeros_like(disparity_px), where=known).astype(np.float32)


PERTURBATION = DepthPerturbation(
    name="stereo_steps",
    label="Depth: stereo steps",
    order=50,  # after our own, which have 10 to 40
    parameters=StereoSteps,
    severities={"step_px": (0.0625, 0.125, 0.25, 0.5, 1.0)},
    source="our own: a quarter of a pixel, halved and doubled",
    apply=apply,
)
