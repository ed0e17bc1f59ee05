# SPDX-License-Identifier: GPL-3.0-or-later
"""Periodic patterns (on a torus): looking at a part of one, moving it, and keeping it for a whole sequence."""

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.perturbing.kinds import FrameContext

P = ParamSpec("P")
Drawn = TypeVar("Drawn")

_KEPT = 8  # patterns of the last 8 sequences; chosen, so that memory does not grow with the number of sequences


def kept_for_sequence(
    draw: Callable[Concatenate[FrameContext, P], Drawn],
) -> Callable[Concatenate[FrameContext, P], Drawn]:
    """Decorate `draw`, so that it draws once per sequence unless the pattern is fresh for each frame.

    `draw` takes its random numbers from `pattern_stream`. Threads and frames share what it returns, so nobody may write
    to it.
    """
    kept = lru_cache(maxsize=_KEPT)(draw)

    @wraps(draw)
    def pick(context: FrameContext, *args: P.args, **kwargs: P.kwargs) -> Drawn:
        if context.temporal == "fresh":
            return draw(context, *args, **kwargs)
        # Leave out what belongs to one frame: else the cache would miss, and keep the frame's images in memory.
        return kept(context.for_sequence(), *args, **kwargs)

    return pick


def torus_window(
    field: NDArray[np.float32],
    size: tuple[int, int],
    step: tuple[float, float] = (1.0, 1.0),
    start: tuple[float, float] = (0.0, 0.0),
) -> NDArray[np.float32]:
    """Sample a periodic field (H, W) bilinearly: size[0] rows, step[0] apart, from row start[0]; columns likewise."""
    import cv2

    rows, columns = start[0] % field.shape[0], start[1] % field.shape[1]
    matrix = np.array([[step[1], 0.0, columns], [0.0, step[0], rows]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpAffine(field, matrix, (size[1], size[0]), flags=flags, borderMode=cv2.BORDER_WRAP)
    return np.asarray(seen, np.float32)


def three_channels(layer: NDArray[np.float32]) -> NDArray[np.float32]:
    """Repeat (H, W) to (H, W, 3). Adding the result to an image is ten times as fast as broadcasting (H, W, 1)."""
    import cv2

    return np.asarray(cv2.merge([layer, layer, layer]), np.float32)
