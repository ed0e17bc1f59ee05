# SPDX-License-Identifier: GPL-3.0-or-later
"""What a camera's automatics make of earlier frames: a first-order lag, sampled at frames that need not be regular."""

import math
from collections.abc import Callable, Hashable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.perturbing.contexts import FrameContext
from ..core.perturbing.earlier_frames import EarlierFrame

LEAST_WEIGHT = 1e-4  # what is so far back that all before it weighs less counts with the oldest frame that is looked at


def lag_span_s(lag_s: float) -> float:
    """Return how many seconds of earlier frames an automatic of this time constant looks at."""
    return -math.log(LEAST_WEIGHT) * lag_s


def lag_weights(stamps_s: Sequence[float], now_s: float, lag_s: float) -> NDArray[np.float64]:
    """Return (N,) weights of frames at increasing stamps (N,) before now; their sum is 1.

    x' = (wanted - x) / lag_s, where each frame's wish holds until the next frame: x now is the sum of
    (exp(-(now - t[j + 1]) / lag) - exp(-(now - t[j]) / lag)) wanted[j]; the oldest frame's wish held ever before. A
    lag of 0 does what the last frame asks for.
    """
    ends = np.append(np.asarray(stamps_s[1:], np.float64), now_s)
    if lag_s == 0:
        return np.append(np.zeros(len(ends) - 1), 1.0)
    reached = np.exp(-np.maximum(now_s - ends, 0.0) / lag_s)
    return np.diff(reached, prepend=0.0)


def lagged(
    context: FrameContext, lag_s: float, wanted: Callable[[EarlierFrame], NDArray[np.float64]], by: Hashable
) -> NDArray[np.float64]:
    """Return what an automatic is at in a frame. wanted: what it would have, seeing a frame. by: what decides that."""
    frames = context.earlier(lag_span_s(lag_s))
    now_s = frames[-1].stamp_s if context.stamp_s is None else context.stamp_s
    weights = lag_weights([frame.stamp_s for frame in frames], now_s, lag_s)
    for frame in frames:
        if by not in frame.asked:
            frame.asked[by] = wanted(frame)
    return np.sum([weight * frame.asked[by] for weight, frame in zip(weights, frames, strict=True)], axis=0)
