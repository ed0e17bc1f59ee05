# SPDX-License-Identifier: GPL-3.0-or-later
"""Grain larger than a pixel: normal numbers of variance 1 that neighbours share in part."""

import numpy as np
from numpy.typing import NDArray

from ..core.perturbing.kinds import FrameContext
from ._quantiles import look_up, scaled_normal, uniform_codes

SIGMA = 0.5  # of the Gaussian that makes it, over its size; chosen
WIDTHS = 3  # at how many sigmas that is cut off


def grain(context: FrameContext, shape: tuple[int, int], size_px: float) -> NDArray[np.float32]:
    """Return (H, W, 3) normal numbers: white ones through a Gaussian kernel, by the root of its squares' sum.

    They are drawn beyond the border, so the border is as all else.
    """
    import cv2

    sigma = SIGMA * size_px
    reach = int(np.ceil(WIDTHS * sigma))
    weights = np.exp(-0.5 * np.square(np.arange(-reach, reach + 1) / sigma))
    weights /= np.sqrt(np.square(weights).sum())
    wide = (shape[0] + 2 * reach, shape[1] + 2 * reach, 3)
    white = look_up(uniform_codes(context.pattern_stream("grain"), wide), scaled_normal(1.0))
    soft = np.asarray(cv2.sepFilter2D(white, -1, weights, weights), np.float32)
    return np.ascontiguousarray(soft[reach : reach + shape[0], reach : reach + shape[1]])
