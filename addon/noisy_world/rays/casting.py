# SPDX-License-Identifier: GPL-3.0-or-later
"""The interface of ray casters: a view in, images out, a band of rows at a time."""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.scenes.mesh import Mesh

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
