# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances from points to the nearest points, and to the nearest surface."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.extras import need
from ...core.machine import available_threads
from .samples import Points

CANDIDATES = 8  # triangles that are looked at for each point; chosen
_AT_ONCE = 100_000  # points


def tree_of(points_m: Points) -> Any:
    """Return scipy's k-d tree of points (N, 3). Raises MissingDependencyError where scipy is missing."""
    need(["scipy"], "evaluate", for_what="measuring maps")
    from scipy.spatial import KDTree

    return KDTree(points_m)


def to_points(points_m: Points, tree: Any, *, largest_m: float = np.inf) -> tuple[NDArray, NDArray]:
    """Return how far the nearest point of a tree is from each of (N, 3), and which it is; infinity beyond largest_m."""
    return tree.query(points_m, distance_upper_bound=largest_m, workers=available_threads())


class MapSurface:
    """Triangles, to which distances are asked for.

    Candidates are the triangles of the points nearest to each asked point: so points have to lie on each triangle
    that counts, as close to one another as triangles are small. Then distances are those to the surface itself, where
    distances to points alone would be too large by about half of their spacing.
    """

    def __init__(self, corners_m: Points, points_m: Points, triangles: NDArray[np.intp]) -> None:
        """Keep the triangles (T, 3, 3) and the points (N, 3) on those named (N,), at least one."""
        self._corners_m = corners_m
        self._triangles = triangles
        self._tree = tree_of(points_m)
        self._candidates = min(CANDIDATES, len(points_m))

    def distances_m(self, points_m: Points) -> NDArray[np.float64]:
        """Return the distances (N,) of points (N, 3)."""
        found = np.empty(len(points_m))
        for first in range(0, len(points_m), _AT_ONCE):
            some = points_m[first : first + _AT_ONCE]
            near = self._tree.query(some, k=self._candidates, workers=available_threads())[1].reshape(len(some), -1)
            triangles = self._triangles[near]
            squares = np.full(len(some), np.inf)
            for column in range(triangles.shape[1]):
                new = (triangles[:, :column] != triangles[:, column, None]).all(axis=1)
                corners_m = self._corners_m[triangles[new, column]]
                squares[new] = np.minimum(squares[new], squared_distances(some[new], corners_m))
            found[first : first + _AT_ONCE] = np.sqrt(squares)
        return found


def squared_distances(points: Points, corners: Points) -> NDArray[np.float64]:
    """Return the squared distances (N,) of points (N, 3) from triangles (N, 3, 3), which may be without area."""
    a, b, c = corners.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    square = _dot(normal, normal)
    edges = ((a, b), (b, c), (c, a))
    inside = square > 0
    nearest = np.full(len(points), np.inf)
    for start, end in edges:
        along, offset = end - start, points - start
        inside &= _dot(np.cross(along, offset), normal) >= 0
        length = _dot(along, along)
        share = np.clip(np.divide(_dot(offset, along), length, out=np.zeros_like(length), where=length > 0), 0, 1)
        beside = offset - share[:, None] * along
        nearest = np.minimum(nearest, _dot(beside, beside))
    height = _dot(points - a, normal)
    above = np.divide(height * height, square, out=np.full_like(square, np.inf), where=square > 0)
    return np.where(inside, above, nearest)


def _dot(first: Points, second: Points) -> NDArray[np.float64]:
    return np.einsum("ni,ni->n", first, second)
