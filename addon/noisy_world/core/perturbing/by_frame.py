# SPDX-License-Identifier: GPL-3.0-or-later
"""What a node group is told for each frame where nodes cannot find it: what automatics decided by earlier frames."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .contexts import FrameContext
from .earlier_frames import EarlierFrame

GREY = 0.18  # of white: the light that a meter takes for the middle
MID_GREY = EarlierFrame(0.0, np.full((1, 1, 3), GREY, np.float32))


@dataclass(frozen=True)
class FrameValue:
    """A number that a group is told for each frame: a socket, which an artist keys. default: of the socket."""

    meaning: str
    default: float
    minimum: float
    maximum: float


@dataclass(frozen=True)
class ByFrame:
    """All that a group is told for a frame.

    values: by name, as parameters are named; the group has a socket for each, and none for parameters, since these
    decide them. Without any, the sockets are those of parameters, and some of these are told. of: parameters; the
    frame's context -> each value, or each parameter that is told.
    """

    values: Mapping[str, FrameValue]
    of: Callable[[Any, FrameContext], Mapping[str, float]]


def without_frames(context: FrameContext) -> FrameContext:
    """Return a context for where no earlier frames are known, as in a live preview: as if all had been mid-grey."""
    return replace(context, stamp_s=context.stamp_s or 0.0, read_earlier=lambda _span_s: (MID_GREY,))
