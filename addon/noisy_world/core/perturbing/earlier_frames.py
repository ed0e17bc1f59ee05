# SPDX-License-Identifier: GPL-3.0-or-later
"""What a camera's automatics have seen before a frame: the clean frames of its sequence, small, in linear light."""

from bisect import bisect_right
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..datasets.images import as_bytes, read_only
from ..scenes.srgb import quick_light

LONGEST_PX = 32  # of a small image's longer side: a meter has some hundred fields; chosen


@dataclass(frozen=True, eq=False)
class EarlierFrame:
    """A frame as a meter sees it.

    stamp_s: its time stamp, seconds. light: (h, w, 3) float32, linear, at most 32 pixels a side; each pixel the mean of
    what it stands for; read-only. asked: what automatics would have, seeing it, by what decides that;
    frames of one light share it, as each is looked at from many later ones.
    """

    stamp_s: float
    light: NDArray[np.float32]
    asked: dict[Hashable, NDArray[np.float64]] = field(default_factory=dict[Hashable, NDArray[np.float64]], repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "light", read_only(self.light))


ReadEarlier: TypeAlias = Callable[[float], tuple[EarlierFrame, ...]]
"""Seconds -> the frames that a sequence showed so long before one, the oldest first, as `earlier_than` says."""


def earlier_than(stamps_s: Sequence[float] | NDArray[np.float64], frame: int, span_s: float) -> range:
    """Return the frames of a sequence from the one shown `span_s` before a frame up to it, without itself.

    Before its first frame a sequence has shown that frame.
    """
    if frame == 0:
        return range(1)
    shown = bisect_right(stamps_s, float(stamps_s[frame]) - span_s, 0, frame)
    return range(max(shown - 1, 0), frame)


def small_light(rgb: NDArray[Any]) -> NDArray[np.float32]:
    """Return a clean frame (H, W, 3), sRGB-encoded, as `EarlierFrame.light`.

    It is rounded to bytes, so that a frame which was read from a file is the same as when it was rendered.
    """
    return small_of(quick_light(as_bytes(rgb)))


def small_of(whole: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return linear light (H, W, 3) as `EarlierFrame.light`."""
    import cv2

    high, wide = whole.shape[:2]
    scale = max(1.0, max(high, wide) / LONGEST_PX)
    size = max(1, round(wide / scale)), max(1, round(high / scale))
    small = np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.float32).reshape(*size[::-1], 3)
    small = small.copy() if np.shares_memory(small, whole) else small
    small.setflags(write=False)
    return small


def alone(rgb: NDArray[Any]) -> ReadEarlier:
    """Return what there was before an image that stands alone: itself, as before the first frame of a sequence."""
    return lambda _span_s: (EarlierFrame(0.0, small_light(rgb)),)
