# SPDX-License-Identifier: GPL-3.0-or-later
"""Casting rays one at a time through embreex, and colouring what they meet in numpy: it needs nothing compiled."""

import numpy as np
from numpy.typing import NDArray

from .casting import CastImages, CastMesh, View
from .colours import colours_of
from .embree import Hits, TracedTriangles


class RayByRay:
    """Triangles in embreex. Its values are those that packets of rays give, to the bit."""

    def __init__(self, cast: CastMesh) -> None:
        """Copy the mesh. Raises MissingDependencyError where embreex cannot be imported."""
        self._triangles = TracedTriangles(cast.vertices_m, cast.mesh.corner_vertices[cast.corners])
        self._colours = colours_of(cast.mesh, cast.corners) if cast.coloured else None
        self._near_m, self._far_m = cast.near_m, cast.far_m

    def cast(self, view: View, rows: slice, images: CastImages) -> None:
        """Fill in some rows of the images."""
        import cv2

        directions = view.directions(rows)
        size = (rows.stop - rows.start, len(directions) // (rows.stop - rows.start))
        hits = self._first(np.broadcast_to(view.origins_m(rows), (*size, 3)).reshape(-1, 3), directions)
        missed = np.flatnonzero(hits.triangles < 0)
        if images.rgb is not None and self._colours is not None:
            planes = self._colours(hits)
            planes[:, missed] = 0
            images.rgb[rows] = cv2.merge([plane.reshape(size) for plane in planes])
        if images.depth_m is not None:
            hits.lengths[missed] = 0
            images.depth_m[rows] = hits.lengths.reshape(size)
        if images.triangles is not None:
            images.triangles[rows] = hits.triangles.reshape(size)

    def _first(self, origins_m: NDArray[np.float64], directions: NDArray[np.float32]) -> Hits:
        """Return what rays from points (N, 3) along directions (N, 3) meet between near and far plane.

        Rays that meet something before the near plane are cast again, from there.
        """
        hits = self._triangles.first(origins_m.astype(np.float32), directions)
        near = np.flatnonzero(hits.lengths < self._near_m)
        if near.size:
            onward = directions[near]
            again = self._triangles.first((origins_m[near] + self._near_m * onward).astype(np.float32), onward)
            hits.triangles[near], hits.lengths[near] = again.triangles, again.lengths + np.float32(self._near_m)
            hits.second[near], hits.third[near] = again.second, again.third
        hits.triangles[hits.lengths > self._far_m] = -1
        return hits

    def close(self) -> None:
        """Do nothing: embreex frees its triangles by itself."""
