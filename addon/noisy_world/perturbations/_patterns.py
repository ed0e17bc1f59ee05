# SPDX-License-Identifier: GPL-3.0-or-later
"""Patterns without an edge (on a torus), how they are looked at and moved, and how they are kept for a sequence."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, wraps
from typing import Concatenate

import numpy as np
from numpy.typing import NDArray

from ..core.perturbing.kinds import FrameContext

_KEPT = 8  # patterns of as many sequences, so that memory does not grow


def kept_for_sequence[**P, T](
    draw: Callable[Concatenate[FrameContext, P], T],
) -> Callable[Concatenate[FrameContext, P], T]:
    """Draw a pattern again for each frame only where it is fresh; `draw` takes its numbers from `pattern_stream`.

    What is drawn is shared by threads and frames: it must not be written to.
    """
    kept = lru_cache(maxsize=_KEPT)(draw)

    @wraps(draw)
    def pick(context: FrameContext, *args: P.args, **kwargs: P.kwargs) -> T:
        if context.temporal == "fresh":
            return draw(context, *args, **kwargs)
        # Without what is the frame's own, or a kept pattern would keep its images in memory.
        alone = replace(context, index=0, stamp_s=None, intrinsics=None, read_rgb=None, read_depth_m=None)
        return kept(alone, *args, **kwargs)

    return pick


def torus_window(
    field: NDArray[np.float32],
    size: tuple[int, int],
    step: tuple[float, float] = (1.0, 1.0),
    start: tuple[float, float] = (0.0, 0.0),
) -> NDArray[np.float32]:
    """Look at a periodic field (H, W): size[0] rows from start[0] on, step[0] apart, columns alike; bilinear."""
    import cv2

    rows, columns = start[0] % field.shape[0], start[1] % field.shape[1]
    matrix = np.array([[step[1], 0.0, columns], [0.0, step[0], rows]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpAffine(field, matrix, (size[1], size[0]), flags=flags, borderMode=cv2.BORDER_WRAP)
    return np.asarray(seen, np.float32)


def three_channels(layer: NDArray[np.float32]) -> NDArray[np.float32]:
    """Repeat (H, W) to (H, W, 3), ten times faster to add than by broadcasting."""
    import cv2

    return np.asarray(cv2.merge([layer, layer, layer]), np.float32)
