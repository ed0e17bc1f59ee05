# SPDX-License-Identifier: GPL-3.0-or-later
"""Casting rays in packets: triangles in Embree's own library, and one compiled loop from directions to colours."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .casting import CastImages, CastMesh, LineView, View
from .embree_library import PacketScene
from .packet_kernel import compiled
from .triangles import triangle_faces


class Packets:
    """Triangles that rays are cast at in packets. compiling_s: the seconds that compiling its code took, if it did."""

    def __init__(self, cast: CastMesh, kept_in: Path | None) -> None:
        """Copy the mesh; its colours are not copied.

        kept_in: the folder of compiled code; None for none. Raises LibraryError where Embree's library is another, and
        ImportError where numba compiles nothing.
        """
        mesh, corners, coloured = cast.mesh, cast.corners, cast.coloured
        vertices = mesh.corner_vertices[corners]
        self._scene = scene = PacketScene(cast.vertices_m, vertices)
        known = compiled.cache_info().misses
        self._kernel, marker, seconds = compiled(scene.lanes, kept_in)
        self.compiling_s = seconds if compiled.cache_info().misses > known else 0.0
        addresses = [scene.address, scene.intersector(scene.lanes), scene.intersector(1), marker]
        self._functions = np.array(addresses, dtype=np.int64)
        self._near_m, self._far_m = np.float32(cast.near_m), np.float32(cast.far_m)
        self._colours, self._colour_corners = _EMPTY_VALUES, _EMPTY_CORNERS
        self._uv, self._uv_corners, self._shown = _EMPTY_VALUES, _EMPTY_CORNERS, np.empty(0, np.int32)
        self._pictures: list[NDArray[np.uint8]] = []
        if coloured and mesh.corner_rgb is not None:
            self._colours, self._colour_corners = np.ascontiguousarray(mesh.corner_rgb), corners
        elif coloured and mesh.rgb is not None:
            self._colours, self._colour_corners = np.ascontiguousarray(mesh.rgb), vertices
        if coloured and (texture := mesh.texture) is not None:
            self._uv, self._uv_corners = np.ascontiguousarray(texture.corner_uv), corners
            self._shown = texture.face_pictures[triangle_faces(mesh)]
            self._pictures = [np.ascontiguousarray(picture) for picture in texture.pictures]
        lines = [(picture.ctypes.data, picture.shape[1], picture.shape[0]) for picture in self._pictures]
        self._told_pictures = np.array(lines, dtype=np.int64).reshape(-1, 3)

    def cast(self, view: View, rows: slice, images: CastImages) -> None:
        """Fill in some rows of the images, without Python's lock. The first row is a multiple of TILE_PX."""
        if isinstance(view, LineView):
            bent = view.directions(rows).reshape(rows.stop - rows.start, -1, 3)
            across, down = _NO_LINES, _NO_LINES
        else:
            bent, across, down = _EMPTY_RGB, view.across, view.down
        self._kernel(
            *(self._functions, self._scene.lanes, view.origins_m(rows), across, down, bent),
            *(self._near_m, self._far_m, rows.start, rows.stop),
            *(self._colours, self._colour_corners),
            *(self._uv, self._uv_corners, self._shown, self._told_pictures),
            _EMPTY_RGB if images.rgb is None else images.rgb,
            _EMPTY_DEPTH if images.depth_m is None else images.depth_m,
            _EMPTY_CORNERS if images.triangles is None else images.triangles,
        )

    def close(self) -> None:
        """Free the triangles."""
        self._scene.close()


_NO_LINES = np.empty((3, 0))
_EMPTY_RGB, _EMPTY_DEPTH = np.empty((0, 0, 3), np.float32), np.empty((0, 0), np.float32)
_EMPTY_VALUES, _EMPTY_CORNERS = np.empty((0, 3), np.float32), np.empty((0, 3), np.int32)
