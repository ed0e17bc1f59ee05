# SPDX-License-Identifier: GPL-3.0-or-later
"""Points sampled closely on a mesh's faces, within a budget, so that no mesh takes minutes."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..scenes.mesh import Mesh

Float64: TypeAlias = NDArray[np.float64]

_NEEDLE = 256  # sizes long: 12.8 m of 5 cm
_CHUNK = 100_000  # triangles cut at a time, so that memory stays flat


@dataclass(frozen=True, eq=False)
class SampledTriangles:
    """The triangles of a mesh, (T, 3, 3) metres, and what decides into how many pieces they are cut.

    sides: (2, 2) lower and upper corner of the ground that matters. extents_m: (T,) the longest along an axis.
    areas_m2, lengths_m: (T,) area and longest edge within the sides, never less than they are.
    """

    triangles_m: Float64
    sides: Float64
    extents_m: Float64
    areas_m2: Float64
    lengths_m: Float64

    def pieces(self, size_m: float) -> float:
        """Return about how many pieces of this size they make, rather too many."""
        large = self.extents_m > size_m
        areas, lengths = self.areas_m2[large] / size_m**2, self.lengths_m[large] / size_m
        # Measured: halving a right triangle ends between size^2 / 8 and size^2 / 4, and halves of slivers overlap.
        parts = np.where(self._needles(size_m)[large], 2.0 * lengths, 6.0 * areas + 1.5 * lengths**1.4) + 1.0
        return float(parts.sum())

    def points_m(self, size_m: float) -> Float64:
        """(P, 3) points of larger faces, no farther apart than the size."""
        large, needles = self.extents_m > size_m, self._needles(size_m)
        along = [_along(triangle_m, size_m / 2.0) for triangle_m in self.triangles_m[large & needles]]
        return np.concatenate([*along, *_pieces(self.triangles_m[large & ~needles], self.sides, size_m)])

    def _needles(self, size_m: float) -> NDArray[np.bool_]:
        """Tell which triangles are so long and thin that points along an edge are as good as pieces.

        Halving their longest edge gives pieces that overlap, many times as many as points.
        """
        if np.isfinite(self.sides).any():
            return np.zeros(len(self.triangles_m), dtype=bool)  # what lies beyond the sides is dropped piece by piece
        thin = self.areas_m2 * 2.0 < self.lengths_m * size_m / 2.0
        return thin & (self.lengths_m > _NEEDLE * size_m)


def faces_of(mesh: Mesh, sides: Float64, least_m: float) -> SampledTriangles:
    """Return the triangles of a mesh's faces that extend farther than least_m along an axis."""
    sizes = mesh.face_sizes
    extents_m = np.zeros(len(sizes))
    for axis in range(3 if len(sizes) else 0):
        along = mesh.vertices_m[mesh.corner_vertices, axis]
        span_m = np.maximum.reduceat(along, mesh.face_starts) - np.minimum.reduceat(along, mesh.face_starts)
        np.maximum(extents_m, span_m, out=extents_m)
    large = extents_m > least_m
    starts, sizes = mesh.face_starts[large].astype(np.int64), sizes[large].astype(np.int64)
    fans = np.maximum(sizes - 2, 0)
    second = np.arange(fans.sum()) - np.repeat(np.cumsum(fans) - fans, fans) + np.repeat(starts, fans) + 1
    corners = mesh.corner_vertices[np.column_stack([np.repeat(starts, fans), second, second + 1])]
    triangles_m = mesh.vertices_m[corners]
    areas_m2, lengths_m = _within(triangles_m, sides)
    return SampledTriangles(triangles_m, sides, np.repeat(extents_m[large], fans), areas_m2, lengths_m)


def _within(triangles_m: Float64, sides: Float64) -> tuple[Float64, Float64]:
    """Return upper bounds of the area (T,) and of the longest edge (T,) of triangles within the sides."""
    a, b, c = np.moveaxis(triangles_m, 1, 0)
    normals_m2 = np.cross(b - a, c - a)
    areas_m2 = np.linalg.norm(normals_m2, axis=-1) / 2.0
    edges_m = np.stack([b - a, c - b, a - c])
    lengths_m = np.sqrt(np.sum(edges_m**2, axis=-1).max(axis=0))
    if not np.isfinite(sides).all():
        return areas_m2, lengths_m
    room_m = np.diff(sides, axis=0)[0]
    extents_m = np.ptp(triangles_m[..., :2], axis=1)
    # Along an axis a triangle is at most twice as dense as on average; seen from above its share is at most the ground.
    with np.errstate(divide="ignore", invalid="ignore"):
        slab = np.nanmin(np.where(extents_m > 0.0, 2.0 * room_m / extents_m, 1.0), axis=1)
        ground = np.where(normals_m2[:, 2] != 0.0, room_m.prod() / (np.abs(normals_m2[:, 2]) / 2.0), 1.0)
    met = np.all(
        (triangles_m[..., :2].max(axis=1) >= sides[0]) & (triangles_m[..., :2].min(axis=1) <= sides[1]), axis=1
    )
    share = np.minimum(np.minimum(slab, ground), 1.0) * met
    return areas_m2 * share, lengths_m * np.minimum(slab, 1.0) * met


def _along(triangle_m: Float64, size_m: float) -> Float64:
    """(3, 3) -> (P, 3) points of its longest edge."""
    ends_m = np.roll(triangle_m, -1, axis=0)
    longest = int(np.argmax(np.sum((ends_m - triangle_m) ** 2, axis=1)))
    a, b = triangle_m[longest], ends_m[longest]
    return a + np.linspace(0.0, 1.0, int(np.ceil(np.linalg.norm(b - a) / size_m)) + 1)[:, None] * (b - a)


def _pieces(triangles_m: Float64, sides: Float64, size_m: float) -> list[Float64]:
    """(T, 3, 3) -> centroids of pieces no longer than the size; cutting the longest edge keeps slivers few."""
    centroids = []
    bounded = bool(np.isfinite(sides).any())
    rest = [np.ascontiguousarray(np.moveaxis(triangles_m, 0, -1))]  # corner, axis, triangle: sums over corners are fast
    while rest:
        part = rest.pop()
        if part.shape[-1] > _CHUNK:
            rest += [part[..., :_CHUNK], part[..., _CHUNK:]]
            continue
        if bounded:
            flat = part[:, :2]
            near = (flat.max(axis=0) >= sides[0][:, None]) & (flat.min(axis=0) <= sides[1][:, None])
            part = part[..., near.all(axis=0)]
        squares_m2 = np.sum((np.roll(part, -1, axis=0) - part) ** 2, axis=1)
        small = np.all(squares_m2 <= size_m**2, axis=0)
        centroids.append(part[..., small].mean(axis=0).T)
        if small.all():
            continue
        order = (np.argmax(squares_m2[:, ~small], axis=0) + np.arange(3)[:, None]) % 3
        a, b, c = np.take_along_axis(part[..., ~small], order[:, None], axis=0)
        middle = (a + b) / 2.0
        rest.append(np.concatenate([np.stack([a, middle, c]), np.stack([middle, b, c])], axis=-1))
    return centroids
