# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera that turns steadily about its own axis, at a steady speed, and so is known at every time."""

import numpy as np
from analytic import look_at
from scipy.spatial.transform import Rotation

from noisy_world.core.geometry import pose

START = look_at([-0.4, 0.1, 1.2], [1.0, 0.4, 1.0])
TURN_RAD_S, SPEED_M_S = np.radians([25.0, -40.0, 30.0]), np.array([1.5, 0.6, 0.4])


def poses_at(times_s):
    """The camera (..., 4, 4) at some times (...)."""
    times_s = np.asarray(times_s, dtype=np.float64)
    turned = Rotation.from_rotvec(times_s[..., None] * TURN_RAD_S).as_matrix()
    return pose(START[:3, :3] @ turned, START[:3, 3] + times_s[..., None] * SPEED_M_S)
