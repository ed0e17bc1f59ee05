# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles of a mesh, and points on them drawn evenly by area."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.scenes.mesh import Mesh
from ...core.streams import stream
from ...rays.triangles import triangle_corners

Points: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """Points (N, 3) float64 metres on triangles, and the triangle (N,) of each."""

    points_m: Points
    triangles: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.points_m)

    def only(self, kept: NDArray[np.bool_]) -> "Samples":
        """Return those that are kept."""
        return Samples(self.points_m[kept], self.triangles[kept])


def corners_of(mesh: Mesh) -> Points:
    """Return the corners (T, 3, 3) float64 of a mesh's triangles, in metres; polygons are cut as for rendering."""
    vertices_m = mesh.vertices_m
    if not len(mesh.face_starts):
        return np.empty((0, 3, 3))
    middle_m = (vertices_m.min(axis=0) + vertices_m.max(axis=0)) / 2  # float32 decides how faces are cut
    corners = triangle_corners(mesh, (vertices_m - middle_m).astype(np.float32))
    return vertices_m[mesh.corner_vertices[corners]]


def areas_m2(corners_m: Points) -> NDArray[np.float64]:
    """Return the areas (T,) of triangles (T, 3, 3)."""
    return np.linalg.norm(_normals(corners_m), axis=1) / 2


def draw(corners_m: Points, count: int, *names: str | int) -> Samples:
    """Draw points on triangles (T, 3, 3), evenly by area; none where they have none.

    names: of the random stream; the same names and triangles give the same points.
    """
    ends = np.cumsum(areas_m2(corners_m))
    if not len(ends) or not ends[-1] > 0:
        return Samples(np.empty((0, 3)), np.empty(0, dtype=np.intp))
    random = stream("map samples", *names)
    chosen = np.minimum(np.searchsorted(ends, random.random(count) * ends[-1], side="right"), len(ends) - 1)
    # Osada et al. 2002: the root makes points as dense at the first corner as at the opposite edge.
    root, along = np.sqrt(random.random(count))[:, None], random.random(count)[:, None]
    a, b, c = corners_m[chosen].transpose(1, 0, 2)
    return Samples(a + root * (b - a + along * (c - b)), chosen)


def _normals(corners_m: Points) -> Points:
    a, b, c = corners_m.transpose(1, 0, 2)
    return np.cross(b - a, c - a)
