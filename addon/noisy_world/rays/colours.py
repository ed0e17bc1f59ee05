# SPDX-License-Identifier: GPL-3.0-or-later
"""The colours of points on triangles, as Blender's materials show them: a texture, or else those of the corners."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.scenes.mesh import NEUTRAL_GREY, Mesh, Texture
from .embree import Hits
from .triangles import triangle_faces

Planes: TypeAlias = NDArray[np.float32]
"""Values (K, N), each kind in one piece: numpy then calculates several times as fast as with N rows of three."""

BYTE = np.float32(1 / 255)


def colours_of(mesh: Mesh, corners: NDArray[np.int32]) -> Callable[[Hits], Planes]:
    """Return what gives the colours (3, N) of points on a mesh, display-encoded, nominally [0, 1].

    corners: (T, 3) int32, the corners of the mesh's triangles. Points of rays that meet nothing have any colour.
    """
    at_corners = _corner_colours(mesh, corners)
    return at_corners if mesh.texture is None else _Textured(mesh, mesh.texture, corners, at_corners).colours


def _corner_colours(mesh: Mesh, corners: NDArray[np.int32]) -> Callable[[Hits], Planes]:
    """Return what interpolates the colours of vertices or of corners, as stored."""
    if mesh.corner_rgb is not None:
        return Interpolated(mesh.corner_rgb, corners).at
    if mesh.rgb is not None:
        return Interpolated(mesh.rgb, mesh.corner_vertices[corners]).at
    return lambda hits: np.full((3, len(hits.triangles)), NEUTRAL_GREY, dtype=np.float32)


class Interpolated:
    """Values of triangles' corners, interpolated between them.

    A row for each triangle holds its first corner's values, then by how much those of the second and of the third
    differ, so that a point takes one look into memory.
    """

    def __init__(self, values: NDArray[np.float32], corners: NDArray[np.int32]) -> None:
        """Keep the values (V, K) of the corners (T, 3), which are places in them."""
        self._kinds = kinds = values.shape[1]
        self._rows = np.empty((len(corners), 3 * kinds), dtype=np.float32)
        self._rows[:, :kinds] = values[corners[:, 0]]
        for corner in (1, 2):
            columns = slice(corner * kinds, (corner + 1) * kinds)
            np.subtract(values[corners[:, corner]], self._rows[:, :kinds], out=self._rows[:, columns])

    def at(self, hits: Hits) -> Planes:
        """Return the values (K, N) at points; any where a ray meets nothing."""
        planes = np.ascontiguousarray(np.take(self._rows, hits.triangles, axis=0, mode="clip").T)
        first, to_second, to_third = planes.reshape(3, self._kinds, -1)
        first += np.multiply(to_second, hits.second, out=to_second)
        first += np.multiply(to_third, hits.third, out=to_third)
        return first


class _Textured:
    """A texture's colours, and other colours on faces without a picture."""

    def __init__(
        self, mesh: Mesh, texture: Texture, corners: NDArray[np.int32], other: Callable[[Hits], Planes]
    ) -> None:
        self._uv = Interpolated(texture.corner_uv, corners)
        self._pictures = texture.pictures
        self._picture_of = texture.face_pictures[triangle_faces(mesh)]
        self._other = other

    def colours(self, hits: Hits) -> Planes:
        """Return the colours (3, N) of points."""
        shown = np.take(self._picture_of, hits.triangles, mode="clip")
        numbers = np.unique(shown).tolist()
        if numbers == [-1]:
            return self._other(hits)
        uv = self._uv.at(hits)
        if len(numbers) == 1:
            return between_texels(self._pictures[numbers[0]], uv)
        planes = self._other(hits) if -1 in numbers else np.empty((3, len(shown)), dtype=np.float32)
        for number in numbers:
            if number >= 0:
                there = np.flatnonzero(shown == number)
                planes[:, there] = between_texels(self._pictures[number], uv[:, there])
        return planes


def between_texels(picture: NDArray[np.uint8], uv: Planes) -> Planes:
    """Interpolate linearly between a picture's texels (H, W, 3), as stored; it repeats in both directions.

    uv: (2, N), to the right and up from the bottom left corner; 1 is the whole width or height. Returns (3, N).
    """
    height, width = picture.shape[:2]
    texels = picture.reshape(-1, 3)
    column, to_right = _between(uv[0], width)
    row, up = _between(uv[1], height)
    right = np.where(column == width - 1, 0, column + 1)
    rows = [(height - 1 - low) * width for low in (row, np.where(row == height - 1, 0, row + 1))]
    lower, upper = (_blend(texels, start + column, start + right, to_right) for start in rows)
    upper -= lower
    lower += np.multiply(upper, up, out=upper)
    return np.multiply(lower, BYTE, out=lower)


def _between(coordinate: NDArray[np.float32], size: int) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Return the texel before each coordinate, 0 to size - 1, and how far it is from there to the next, 0 to 1."""
    texel = coordinate * np.float32(size) - np.float32(0.5)  # texels' centres are at halves
    before = np.floor(texel)
    return np.mod(before, np.float32(size)).astype(np.intp), texel - before


def _blend(
    texels: NDArray[np.uint8], first: NDArray[np.intp], second: NDArray[np.intp], share: NDArray[np.float32]
) -> Planes:
    start, end = (np.take(texels, places, axis=0).T.astype(np.float32, order="C") for places in (first, second))
    end -= start
    start += np.multiply(end, share, out=end)
    return start
