# SPDX-License-Identifier: GPL-3.0-or-later
"""How a camera moves at one frame of its path."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry import quat_wxyz_from_rotation

type Float64 = NDArray[np.float64]


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
    turned_rad = rotation_vector(before_c2w[:3, :3].T @ c2w[:3, :3])
    return CameraMotion(first_c2w, c2w, (c2w[:3, 3] - before_c2w[:3, 3]) / seconds, turned_rad / seconds)


def rotation_vector(rotation: ArrayLike) -> Float64:
    """Return (3,) radians: axis times angle, up to a half turn, of a rotation (3, 3)."""
    quat = quat_wxyz_from_rotation(rotation)
    sine = float(np.linalg.norm(quat[1:]))
    angle_rad = 2 * np.arctan2(sine, quat[0])
    return quat[1:] * (angle_rad / sine if sine > 0 else 0.0)
