# SPDX-License-Identifier: GPL-3.0-or-later
"""How noisy the depth of a sequence is, measured in its images: what a system that weighs depth has to know of it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.datasets.image_reading import read_pixels
from ...core.schema import key

FRAMES = 8  # chosen: of a sequence, in which noise is measured
OF_MEDIAN = 0.6745  # the median of the absolute values of a standard normal variable
OF_SECOND_DIFFERENCE = math.sqrt(6.0)  # 1 + 4 + 1
OF_ROUNDING = 1.0 / math.sqrt(12.0)  # of a step


@dataclass(frozen=True)
class InverseDepth:
    """The inverse of a sequence's planar depth Z."""

    median_per_m: float = key("the median of 1 / Z", unit="1/m", above=0.0)
    noise_per_m: float = key("the standard deviation of the noise of 1 / Z", unit="1/m", minimum=0.0)


def measured_inverse_depth(files: Sequence[Path], scale_per_m: float) -> InverseDepth | None:
    """Measure it in some depth images of a sequence, in steps of 1 / scale_per_m metres; None where none has depth.

    Along a row 1 / Z is linear on a plane, so second differences are noise alone, of six times its variance; by their
    median absolute value, edges do not count. It is at least the noise of rounding to steps. What neighbouring pixels
    share, as a bias or a smooth error, is not seen. A file that is no depth image is left to the system to complain of.
    """
    import cv2

    seen, apart = [np.zeros(0)], [np.zeros(0)]
    for place in sorted({round(k * (len(files) - 1) / (FRAMES - 1)) for k in range(FRAMES)}) if files else ():
        steps = read_pixels(files[place], cv2.IMREAD_UNCHANGED)
        if steps is None or steps.ndim != 2:
            continue
        with np.errstate(divide="ignore"):
            per_m = np.where(steps > 0, scale_per_m / steps.astype(np.float64), np.nan)
        second = per_m[:, :-2] - 2.0 * per_m[:, 1:-1] + per_m[:, 2:]
        seen.append(per_m[np.isfinite(per_m)])
        apart.append(np.abs(second[np.isfinite(second)]))
    inverse, differences = np.concatenate(seen), np.concatenate(apart)
    if not differences.size:
        return None
    median_per_m = float(np.median(inverse))
    noise_per_m = float(np.median(differences)) / OF_MEDIAN / OF_SECOND_DIFFERENCE
    return InverseDepth(median_per_m, max(noise_per_m, OF_ROUNDING * median_per_m**2 / scale_per_m))
