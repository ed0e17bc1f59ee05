# SPDX-License-Identifier: GPL-3.0-or-later
"""How a camera moves at one frame of its path."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..geometry import rotvec_from_rotation

Float64: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """Where a camera is, and how it got there.

    first_c2w, c2w: (4, 4), of the sequence's first frame and of this one, OpenCV's axes, metres. velocity_m_s: (3,), in
    the world. turning_rad_s: (3,), in the camera's axes. Both are means since the frame before; 0 at the first.
    """

    first_c2w: Float64
    c2w: Float64
    velocity_m_s: Float64
    turning_rad_s: Float64

    @property
    def key(self) -> bytes:
        """What is equal for equal motions."""
        return b"".join(part.tobytes() for part in (self.first_c2w, self.c2w, self.velocity_m_s, self.turning_rad_s))


def motion_between(first_c2w: Float64, before_c2w: Float64, c2w: Float64, seconds: float) -> CameraMotion:
    """Return the motion at a pose, `seconds` after the one before it; at rest for 0 seconds.

    Only earlier poses count, so that a path that goes on changes no frame that is there.
    """
    if seconds == 0:
        return CameraMotion(first_c2w, c2w, np.zeros(3), np.zeros(3))
    turned_rad = rotvec_from_rotation(before_c2w[:3, :3].T @ c2w[:3, :3])
    return CameraMotion(first_c2w, c2w, (c2w[:3, 3] - before_c2w[:3, 3]) / seconds, turned_rad / seconds)
