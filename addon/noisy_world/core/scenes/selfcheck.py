# SPDX-License-Identifier: GPL-3.0-or-later
"""Checking a rendered frame against the mesh, the pose and the intrinsics, without any renderer.

Users of such datasets lose most time with pose conventions. If axes, principal point, focal lengths, scale or pose went
wrong on the way through the renderer, vertices appear in front of the surface that was rendered.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry import Intrinsics, invert_pose
from ..lens import WIDEST_DEG, projected
from ..optics import Distortion
from .mesh import Mesh

# Chosen: an error of a convention moves nearly all vertices, a correct frame none but the exceptions named here.
SAMPLES = 20_000  # face corners, so that the check takes milliseconds
TOLERANCE = 0.03  # of the depth: a slanted surface comes nearer between the pixels' centres
ALLOWED = 0.02  # of the vertices: those of things so thin that they meet no pixel's centre
SIDEWAYS = float(np.cos(np.radians(WIDEST_DEG - 1.0)))  # of a vertex's distance: beyond, pixels may have no depth
LEAST = 200  # vertices in view: the share of fewer is too uncertain


def share_in_front(
    mesh: Mesh, c2w: ArrayLike, camera: Intrinsics, depth_m: NDArray[np.float32], lens: Distortion | None = None
) -> float | None:
    """Return the share of vertices in view that are nearer than all depths rendered in the 3 x 3 pixels around them.

    c2w: (4, 4) with OpenCV axes, metres. depth_m: (H, W) planar depth, 0 = void. lens: that distorts; None for a
    pinhole. None where too few are in view.
    """
    used = mesh.corner_vertices[:: max(1, len(mesh.corner_vertices) // SAMPLES)]
    w2c = invert_pose(c2w)
    points_m = mesh.vertices_m[used] @ w2c[:3, :3].T + w2c[:3, 3]
    points_m = points_m[points_m[:, 2] > 0.1]
    if lens is not None:  # which may see farther round than there is a planar depth
        points_m = points_m[points_m[:, 2] > SIDEWAYS * np.linalg.norm(points_m, axis=1)]
    column, row = map(np.rint, projected(points_m, camera, lens))
    inside = (column >= 1) & (column < camera.width_px - 1) & (row >= 1) & (row < camera.height_px - 1)
    if np.count_nonzero(inside) < LEAST:
        return None
    column, row = column[inside].astype(int), row[inside].astype(int)
    around_m = np.stack([depth_m[row + i, column + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    nearest_m = np.where(around_m > 0, around_m, np.inf).min(axis=0)
    return float(np.mean(points_m[inside, 2] < nearest_m * (1 - TOLERANCE)))


def reprojection_problem(
    mesh: Mesh, c2w: ArrayLike, camera: Intrinsics, depth_m: NDArray[np.float32], lens: Distortion | None = None
) -> str | None:
    """Return what is wrong with a rendered depth as a sentence, or None. lens: that distorts; None for a pinhole."""
    share = share_in_front(mesh, c2w, camera, depth_m, lens)
    if share is None or share <= ALLOWED:
        return None
    return f"{share:.0%} of the mesh in view lies in front of the rendered depth: pose or intrinsics went wrong"
