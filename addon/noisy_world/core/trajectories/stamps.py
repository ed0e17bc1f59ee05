# SPDX-License-Identifier: GPL-3.0-or-later
"""Time stamps: of one series, and of the colour, the depth and the pose of a path's frames."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

NS_PER_S = 10**9


def nanoseconds(stamp_s: float) -> int:
    """Return a stamp in nanoseconds: those of the shortest decimal number that reads back to this float64.

    Around 1.3e9 s, float64 numbers are 2.4e-7 s apart: further digits would look exact and mean nothing.
    """
    return int((Decimal(repr(float(stamp_s))) * NS_PER_S).to_integral_value(ROUND_HALF_EVEN))


@dataclass(frozen=True, eq=False)
class Stamps:
    """The time stamps of a series; the array is copied and read-only.

    seconds: (N,) float64. exact_ns: the same in whole nanoseconds where a file says them, which float64 seconds cannot
    hold on a real clock; None where seconds are all that is known.
    """

    seconds: NDArray[np.float64]
    exact_ns: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        seconds = np.array(self.seconds, dtype=np.float64)
        seconds.setflags(write=False)
        object.__setattr__(self, "seconds", seconds)

    @classmethod
    def of_ns(cls, stamps_ns: Iterable[int]) -> "Stamps":
        """Return stamps that are known in whole nanoseconds."""
        exact = tuple(stamps_ns)
        return cls(np.array([stamp_ns / NS_PER_S for stamp_ns in exact]), exact)

    def __len__(self) -> int:
        return len(self.seconds)

    @cached_property
    def ns(self) -> tuple[int, ...]:
        """Whole nanoseconds: the exact ones, or those of the shortest decimal numbers of the seconds."""
        return tuple(map(nanoseconds, self.seconds.tolist())) if self.exact_ns is None else self.exact_ns

    def take(self, rows: Sequence[int] | NDArray[np.int64]) -> "Stamps":
        """Return the stamps of some rows, in this order."""
        exact = None if self.exact_ns is None else tuple(self.exact_ns[row] for row in rows)
        return Stamps(self.seconds[np.asarray(rows, dtype=np.int64)], exact)


@dataclass(frozen=True, eq=False)
class FrameStamps:
    """When the parts of each frame of a path were taken: its colour, its depth and its pose, N stamps each.

    A frame's own stamp is its colour's, and these increase. A recording's depth and ground truth come from other clocks
    or at other moments, so their stamps may differ, and need not increase from frame to frame.
    """

    rgb: Stamps
    depth: Stamps
    pose: Stamps

    @classmethod
    def of(cls, stamps: "FrameStamps | ArrayLike") -> "FrameStamps":
        """Return stamps as they are, or those of frames whose parts all have the same (N,) seconds."""
        if isinstance(stamps, FrameStamps):
            return stamps
        same = Stamps(np.asarray(stamps, dtype=np.float64))
        return cls(same, same, same)

    def __len__(self) -> int:
        return len(self.rgb)

    def frame_times(self, frame: int) -> tuple[float, float | None]:
        """Return what the record of a frame says: its time, and its depth's where that is another, in seconds."""
        time_s, depth_time_s = float(self.rgb.seconds[frame]), float(self.depth.seconds[frame])
        return time_s, None if depth_time_s == time_s else depth_time_s

    def take(self, rows: Sequence[int] | NDArray[np.int64]) -> "FrameStamps":
        """Return the stamps of some frames, in this order."""
        return FrameStamps(self.rgb.take(rows), self.depth.take(rows), self.pose.take(rows))
