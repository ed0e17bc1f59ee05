# SPDX-License-Identifier: GPL-3.0-or-later
"""The point around which a scene is rendered, so that float32 is precise near the camera."""

import numpy as np
from numpy.typing import NDArray

from ..trajectories.trajectory import Trajectory

# Up to this distance from the origin float32 resolves 1e-6 m, and a scene keeps its own coordinates for the artist.
RECENTRE_BEYOND_M = 16.0


def recentring_m(trajectory: Trajectory) -> NDArray[np.float64]:
    """Return the point (3,) float64, metres, to render around: whole metres in the middle of the path, if far away.

    The path decides, not the mesh, since precision matters near the camera.
    """
    positions_m = trajectory.c2w[:, :3, 3]
    middle_m = np.rint((positions_m.min(axis=0) + positions_m.max(axis=0)) / 2)
    return middle_m if np.abs(positions_m).max() > RECENTRE_BEYOND_M else np.zeros(3)
