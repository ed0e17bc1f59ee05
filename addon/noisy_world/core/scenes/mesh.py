# SPDX-License-Identifier: GPL-3.0-or-later
"""A coloured polygon mesh, as arrays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Mesh:
    """Polygons of any size with one colour a vertex.

    vertices_m: (V, 3) float64, metres, Z up. Float64 so that a scene far from the origin can be moved without loss.
    rgb: (V, 3) float32 in [0, 1], display-encoded (sRGB), or None where the file has no colours.
    corner_vertices: (C,) int32, the vertices of all faces, one face after another.
    face_starts: (F,) int32, where each face begins in corner_vertices; the first is 0.
    notes: what a user should know about how the file was read, one sentence each.
    """

    vertices_m: NDArray[np.float64]
    rgb: NDArray[np.float32] | None
    corner_vertices: NDArray[np.int32]
    face_starts: NDArray[np.int32]
    notes: tuple[str, ...] = ()

    @property
    def face_sizes(self) -> NDArray[np.int32]:
        """(F,) int32: the number of corners of each face."""
        return np.diff(self.face_starts, append=np.int32(len(self.corner_vertices))).astype(np.int32)
