# SPDX-License-Identifier: GPL-3.0-or-later
"""A coloured polygon mesh, as arrays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

OBJECT_ID = "object_id"  # the property of faces in Replica's mesh_semantic.ply
NEUTRAL_GREY = 128 / 255  # display-encoded colour of a mesh without colours; chosen


@dataclass(frozen=True)
class Texture:
    """Pictures, and where in them the corners of faces lie.

    names: of the pictures' files. pictures: each (H, W, 3) uint8, RGB, display-encoded (sRGB), the top row first.
    corner_uv: (C, 2) float32, to the right and up from a picture's bottom left corner; 1 is its whole width or height,
    and beyond [0, 1] it repeats. face_pictures: (F,) int32, the picture of each face; -1 where a face has none.
    """

    names: tuple[str, ...]
    pictures: tuple[NDArray[np.uint8], ...]
    corner_uv: NDArray[np.float32]
    face_pictures: NDArray[np.int32]


@dataclass(frozen=True)
class Mesh:
    """Polygons of any size, coloured at their vertices, at their corners or by a texture.

    vertices_m: (V, 3) float64, metres, Z up. Float64 so that a scene far from the origin can be moved without loss.
    rgb: (V, 3) float32 in [0, 1], display-encoded (sRGB), or None where vertices have no colours.
    corner_vertices: (C,) int32, the vertices of all faces, one face after another.
    face_starts: (F,) int32, where each face begins in corner_vertices; the first is 0.
    notes: what a user should know about how the file was read, one sentence each.
    corner_rgb: (C, 3) float32 as rgb, instead of it: equal at all corners of a face that has one colour.
    texture: what is shown instead of other colours, where a face has a picture.
    object_ids: (F,) int64, the object that each face belongs to, as the file numbers them; None where it does not.
    """

    vertices_m: NDArray[np.float64]
    rgb: NDArray[np.float32] | None
    corner_vertices: NDArray[np.int32]
    face_starts: NDArray[np.int32]
    notes: tuple[str, ...] = ()
    corner_rgb: NDArray[np.float32] | None = None
    texture: Texture | None = None
    object_ids: NDArray[np.int64] | None = None

    @property
    def face_sizes(self) -> NDArray[np.int32]:
        """(F,) int32: the number of corners of each face."""
        return np.diff(self.face_starts, append=np.int32(len(self.corner_vertices))).astype(np.int32)
