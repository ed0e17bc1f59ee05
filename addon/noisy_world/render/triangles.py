# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces as triangles, split as Blender splits them, and the colours of points on them as its materials show them.

Faces as triangles, split as Blender splits them for rendering.

A flat face has one shape however it is split. But colours are interpolated within a triangle, and a face that is not
flat is another surface when it is split along another diagonal. So the rules are Blender's (bke::mesh::corner_tris), in
float32 as there: a quad along the diagonal from its first corner, unless that lies outside it; larger faces by cutting
off ears.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..scenes.polygon_mesh import NEUTRAL_GREY, Mesh, Texture
from .embree import Hits

# Splitting an outline into triangles by cutting off its ears, in the order in which Blender cuts them.
#
# An ear is a corner whose triangle with its two neighbours holds no other corner. Blender (BLI_polyfill_2d) goes around
# an outline, cuts off every other ear so that convex outlines do not become fans, and turns back at corners that bend
# inwards.


_OUT, _STRAIGHT, _IN = 1, 0, -1  # how a corner bends


def clip_ears(points: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return the triangles (n - 2, 3) int32 of an outline (n, 2) float32 that runs clockwise."""
    return _Outline(points).triangles()


Point: TypeAlias = tuple[Any, Any]
"""x and y."""


class _Outline:
    """What is left of an outline: a ring of corners, each with its neighbours and the way it bends."""

    def __init__(self, points: NDArray[np.float32]) -> None:
        count = len(points)
        self._points: list[Point] = [(x, y) for x, y in points]  # numpy's float32: double decides otherwise where
        self._places = points.T.tolist()  # corners lie on a line
        self._left = count
        self._after = [*range(1, count), 0]
        self._before = [count - 1, *range(count - 1)]
        self._first = 0
        self._bends = [self._bend(corner) for corner in range(count)]
        self._inner = {corner for corner, bend in enumerate(self._bends) if bend != _OUT}

    def triangles(self) -> NDArray[np.int32]:
        """Cut off all ears."""
        cut: list[tuple[int, int, int]] = []
        start, backward = 0, False
        while self._left > 3:
            ear = self._next_ear(start, backward=backward)
            before, after = self._before[ear], self._after[ear]
            cut.append((before, ear, after))
            self._remove(ear)
            for corner in (before, after):
                if self._bends[corner] != _OUT:
                    self._bends[corner] = self._bend(corner)
                    if self._bends[corner] == _OUT:
                        self._inner.discard(corner)
            start = self._before[before] if backward else self._after[after]
            if self._bends[start] != _OUT:  # not a good place for an ear
                start = self._before[start] if backward else self._after[start]
                backward = not backward
        second = self._after[self._first]
        cut.append((self._first, second, self._after[second]))
        return np.array(cut, dtype=np.int32)

    def _next_ear(self, start: int, *, backward: bool) -> int:
        """Return the first ear from a corner on; where there is none, a corner that does not bend inwards."""
        step = self._before if backward else self._after
        for wanted in (_OUT, _STRAIGHT):  # an ear without area only where there is no other
            corner = start
            for _ in range(self._left):
                if not self._inner or (self._bends[corner] == wanted and not self._holds_another(corner)):
                    return corner
                corner = step[corner]
        corner = start
        for _ in range(self._left):
            if self._bends[corner] != _IN:
                return corner
            corner = self._after[corner]
        return corner

    def _holds_another(self, ear: int) -> bool:
        """Tell whether the triangle of an ear holds another corner; only those that do not bend outwards can be."""
        own = (ear, self._after[ear], self._before[ear])
        (x, y), first, second, third = self._places, *(self._points[corner] for corner in own)
        left, right = min(x[corner] for corner in own), max(x[corner] for corner in own)
        low, high = min(y[corner] for corner in own), max(y[corner] for corner in own)
        return any(
            turn(first, second, point) >= 0 and turn(second, third, point) >= 0 and turn(third, first, point) >= 0
            for point in (
                self._points[corner]
                for corner in self._inner
                if left <= x[corner] <= right and low <= y[corner] <= high and corner not in own
            )
        )

    def _remove(self, corner: int) -> None:
        before, after = self._before[corner], self._after[corner]
        self._after[before], self._before[after] = after, before
        self._first = after if self._first == corner else self._first
        self._inner.discard(corner)
        self._left -= 1

    def _bend(self, corner: int) -> int:
        before, after = self._points[self._before[corner]], self._points[self._after[corner]]
        return int(np.sign(turn(before, self._points[corner], after)))


def turn(before: Point, at: Point, after: Point) -> Any:
    """Return twice the area of a triangle, positive where a clockwise outline bends outwards at its second corner.

    Numbers, or arrays for many triangles at once, in the precision that they have.
    """
    (x, y), (a, b), (c, d) = after, at, before
    return (a - x) * (d - y) - (c - x) * (b - y)


Points: TypeAlias = NDArray[np.float32]

AT_ONCE = 500_000  # triangles whose normals are calculated together; chosen: 100 MB

_IN_TWO = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
_ACROSS = np.array([[0, 1, 3], [1, 2, 3]], dtype=np.int32)  # where the diagonal from the first corner lies outside


def triangle_corners(mesh: Mesh, vertices_m: Points) -> NDArray[np.int32]:
    """Return the corners (T, 3) int32 of the mesh's triangles, as places in its corner_vertices, in the faces' order.

    vertices_m: (V, 3) float32, the vertices as they are rendered.
    """
    sizes = mesh.face_sizes
    starts = np.asarray(mesh.face_starts, dtype=np.int32)
    first_triangle = starts - 2 * np.arange(len(starts), dtype=np.int32)  # a face of n corners has n - 2 triangles
    corners = np.empty((len(mesh.corner_vertices) - 2 * len(starts), 3), dtype=np.int32)
    for size in np.unique(sizes).tolist():
        faces = np.flatnonzero(sizes == size)
        places = starts[faces, None] + np.arange(size, dtype=np.int32)
        local = _split(vertices_m, mesh.corner_vertices[places])
        rows = first_triangle[faces, None] + np.arange(size - 2, dtype=np.int32)
        corners[rows] = starts[faces, None, None] + local
    return corners


def triangle_faces(mesh: Mesh) -> NDArray[np.int32]:
    """Return the face (T,) int32 of each triangle."""
    return np.repeat(np.arange(len(mesh.face_starts), dtype=np.int32), mesh.face_sizes - 2)


def triangle_normals(mesh: Mesh, corners: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the normals (T, 3) float32 of triangles, of unit length; zero of those without an area.

    corners: (T, 3), as `triangle_corners` returns them. In float64, from the mesh's own vertices.
    """
    normals = np.zeros((len(corners), 3), dtype=np.float32)
    for start in range(0, len(corners), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        first, second, third = (mesh.vertices_m[mesh.corner_vertices[corners[part, corner]]] for corner in range(3))
        across = np.cross(second - first, third - first)
        length = np.linalg.norm(across, axis=1, keepdims=True)
        np.divide(across, length, out=normals[part], where=length > 0, casting="same_kind")
    return normals


def _split(vertices_m: Points, faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Split faces of the same size (F, n), given by their vertices; return triangles (F, n - 2, 3) of 0 to n - 1."""
    count, size = faces.shape
    if size == 3:
        return np.broadcast_to(np.arange(3, dtype=np.int32), (count, 1, 3))
    if size == 4:
        first, second, third, fourth = (vertices_m[faces[:, corner]] for corner in range(4))
        across = third - first
        one_side = np.cross(second - first, across), np.cross(fourth - first, across)
        outside = np.sum(one_side[0] * one_side[1], axis=1) > 0
        return np.where(outside[:, None, None], _ACROSS, _IN_TWO)
    points = _flattened(vertices_m[faces])
    before, at, after = ((part[..., 0], part[..., 1]) for part in (np.roll(points, turned, 1) for turned in (1, 0, -1)))
    convex = (turn(before, at, after) > 0).all(axis=1)
    split = np.empty((count, size - 2, 3), dtype=np.int32)
    if convex.any():
        split[convex] = clip_ears(_regular(size))  # the ears of convex faces depend on nothing but their number
    for face in np.flatnonzero(~convex).tolist():
        split[face] = clip_ears(points[face])
    return split


def _flattened(points_m: Points) -> Points:
    """Project faces (F, n, 3) along their normals; return (F, n, 2), seen from behind."""
    before = np.roll(points_m, 1, axis=1)
    difference, total = before - points_m, before + points_m
    normal = np.zeros_like(points_m[:, 0])
    for corner in range(points_m.shape[1]):  # Newell's, summed in Blender's order
        normal += difference[:, corner, [1, 2, 0]] * total[:, corner, [2, 0, 1]]
    length = np.sqrt(_dot(normal, normal))[:, None]
    x, y, z = np.where(length > 0, -normal / np.where(length > 0, length, 1), np.array([0, 0, -1], np.float32)).T
    slant = x * x + y * y
    upright, nothing = slant <= np.finfo(np.float32).eps, np.zeros_like(x)
    scale = 1 / np.sqrt(np.where(upright, 1, slant))
    right = np.stack([np.where(upright, np.where(z < 0, -1, 1), y * scale), np.where(upright, 0, -x * scale), nothing])
    up = np.where(upright, [[0], [1], [0]], [-z * right[1], z * right[0], x * right[1] - y * right[0]])
    axes = [axis.astype(np.float32).T[:, None] for axis in (right, up)]
    return np.stack([_dot(points_m, axis) for axis in axes], axis=-1)


def _dot(first: Points, second: Points) -> Points:
    """Return the products of vectors (..., 3), summed from the first component on."""
    product = first * second
    return np.add(product[..., 0] + product[..., 1], product[..., 2], dtype=np.float32)


def _regular(size: int) -> NDArray[np.float32]:
    """Return the corners (size, 2) of a regular face, in the order of `_flattened`."""
    angle = -np.linspace(0, 2 * np.pi, size, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1).astype(np.float32)


# The colours of points on triangles, as Blender's materials show them: a texture, or else those of the corners.


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


# The interface of ray casters: a view in, images out, a band of rows at a time.


TILE_PX = 40  # rows of a band, and columns whose packets follow one another; chosen: from 16 to 80 they take as long


@dataclass(frozen=True)
class RayView:
    """Rays from a point through the centres of an image's pixels.

    origin_m: (3,) float64, in the axes of the triangles. across: (3, W), down: (3, H) float64; the sum of a column's
    and a row's is the ray's direction there, of component 1 along the optical axis: its lengths are planar depths.
    """

    origin_m: NDArray[np.float64]
    across: NDArray[np.float64]
    down: NDArray[np.float64]

    def directions(self, rows: slice) -> NDArray[np.float32]:
        """Return the directions (N, 3) of some rows, one after another; added in float64, rounded once."""
        import cv2

        across, down = self.across[:, None], self.down[:, rows, None]
        planes = np.empty((3, down.shape[1], across.shape[2]), dtype=np.float32)
        np.add(across, down, out=planes, dtype=np.float64, casting="same_kind")
        return np.asarray(cv2.merge(list(planes)), dtype=np.float32).reshape(-1, 3)

    def origins_m(self, rows: slice) -> NDArray[np.float64]:
        """Return where the rays of some rows begin, (1, 1, 3)."""
        del rows
        return self.origin_m[None, None]


@dataclass(frozen=True)
class LineView:
    """Rays of an image whose rows or columns are seen from poses of their own, or whose rays go as a lens bends them.

    Of the shapes, h is H or 1 and w is W or 1: what all rows or columns share is there once. starts_m: (h, w, 3)
    float64, in the axes of the triangles. axes: (h, w, 3, 3) float64, the camera's axes as columns. right, down: (h, w)
    float64, where a ray passes the plane at 1 along the optical axis; its lengths are planar depths. forward: (h, w)
    float64, what is in place of 1 where rays lead sideways and back; None for 1.
    """

    starts_m: NDArray[np.float64]
    axes: NDArray[np.float64]
    right: NDArray[np.float64]
    down: NDArray[np.float64]
    forward: NDArray[np.float64] | None = None

    def directions(self, rows: slice) -> NDArray[np.float32]:
        """Return the directions (N, 3) of some rows, one after another; added in float64, rounded once."""
        axes, right, down = (_rows_of(values, rows) for values in (self.axes, self.right, self.down))
        ahead = axes[..., 2] if self.forward is None else axes[..., 2] * _rows_of(self.forward, rows)[..., None]
        made = axes[..., 0] * right[..., None] + (axes[..., 1] * down[..., None] + ahead)
        return made.astype(np.float32).reshape(-1, 3)

    def beside(
        self,
        row: NDArray[np.intp],
        column: NDArray[np.intp],
        right: NDArray[np.float64],
        down: NDArray[np.float64],
        forward: NDArray[np.float64] | None = None,
    ) -> "LineView":
        """Return rays beside those of some pixels (N,): N rows. right, down, forward: (S,) or (N, S), how far."""
        height, width = len(self.starts_m), self.starts_m.shape[1]
        line = (np.minimum(row, height - 1), np.minimum(column, width - 1))
        middle = [
            plane[np.minimum(row, len(plane) - 1), np.minimum(column, plane.shape[1] - 1), None]
            for plane in (self.right, self.down, *([] if self.forward is None else [self.forward]))
        ]
        ahead = None if forward is None or self.forward is None else middle[2] + forward
        starts_m, axes = self.starts_m[line][:, None], self.axes[line][:, None]
        return LineView(starts_m, axes, middle[0] + right, middle[1] + down, ahead)

    def origins_m(self, rows: slice) -> NDArray[np.float64]:
        """Return where the rays of some rows begin, (h, w, 3)."""
        return np.ascontiguousarray(_rows_of(self.starts_m, rows))


View: TypeAlias = RayView | LineView


def _rows_of(values: NDArray[np.float64], rows: slice) -> NDArray[np.float64]:
    return values if len(values) == 1 else values[rows]


@dataclass(frozen=True)
class CastImages:
    """What a view sees; each is None where it is not asked for.

    rgb: (H, W, 3) float32, display-encoded, black where nothing is seen. depth_m: (H, W) float32, 0 there. triangles:
    (H, W) int32, which of the mesh's triangles; -1 there.
    """

    rgb: NDArray[np.float32] | None
    depth_m: NDArray[np.float32] | None
    triangles: NDArray[np.int32] | None


@dataclass(frozen=True)
class CastMesh:
    """A mesh that rays are cast at, between two distances.

    vertices_m: (V, 3), as they are seen. corners: (T, 3), of its triangles. coloured: whether colours are asked for.
    """

    mesh: Mesh
    vertices_m: NDArray[np.float32]
    corners: NDArray[np.int32]
    near_m: float
    far_m: float
    coloured: bool


class Caster(Protocol):
    """Triangles that rays are cast at, between two distances. Several threads may cast at once."""

    def cast(self, view: View, rows: slice, images: CastImages) -> None:
        """Fill in some rows of the images."""
        ...

    def close(self) -> None:
        """Free what it holds; nothing can be cast then."""
        ...
