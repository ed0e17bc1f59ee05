# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh as a spinning lidar sees it: rows of beams around, each column from where the sensor is by then."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..core.planning.source import RenderOptions
from ..core.scenes.mesh import Mesh
from ..core.scenes.recentring import recentring_m
from ..core.trajectories.trajectory import Trajectory
from .casters import caster_of
from .casting import CastImages, LineView
from .triangles import triangle_corners, triangle_normals

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Spin:
    """One turn of rows of beams. elevations_deg: (B,) from the lowest. columns: measurements around. turn_s: of a turn.

    It goes clockwise seen from above, from behind the sensor, and looks ahead in the middle.
    """

    elevations_deg: Float64
    columns: int
    turn_s: float

    @cached_property
    def parts(self) -> Float64:
        """(A,) how far into the turn each column is measured, from -0.5 to 0.5."""
        return (np.arange(self.columns) + 0.5) / self.columns - 0.5

    @property
    def azimuths_rad(self) -> Float64:
        """(A,) to the right of ahead."""
        return 2 * np.pi * self.parts

    @property
    def down(self) -> Float64:
        """(B,) how far below the horizon a beam is at one metre from the axis, metres."""
        return -np.tan(np.radians(self.elevations_deg))

    @property
    def beams(self) -> Float64:
        """(B, A, 3) unit vectors of the beams in the sensor's axes: x ahead, y to the left, z up."""
        down, azimuth = self.down[:, None], self.azimuths_rad[None]
        vectors = np.stack(np.broadcast_arrays(np.cos(azimuth), -np.sin(azimuth), -down), axis=-1)
        return vectors / np.sqrt(1 + down * down)[..., None]

    def line_view(self, c2w: Float64, origin_m: Float64) -> LineView:
        """Return the rays of a turn whose columns are seen from poses (A, 4, 4), OpenCV axes, around a point."""
        sine, cosine = np.sin(self.azimuths_rad), np.cos(self.azimuths_rad)
        zero, one = np.zeros(self.columns), np.ones(self.columns)
        turned = np.stack([cosine, zero, sine, zero, one, zero, -sine, zero, cosine], axis=-1).reshape(-1, 3, 3)
        axes = (c2w[:, :3, :3] @ turned)[None]
        return LineView((c2w[:, :3, 3] - origin_m)[None], axes, np.zeros((1, 1)), self.down[:, None])


@dataclass(frozen=True, eq=False)
class Echoes:
    """What a turn meets, (B, A) float64: range in metres, 0 for nothing; the cosine of incidence; luminance, 0 to 1."""

    range_m: Float64
    cosine: Float64
    luminance: Float64


class SpinningCaster:
    """A mesh in Embree, for turns of beams along a path."""

    def __init__(self, mesh: Mesh, path: Trajectory, options: RenderOptions, rays: int) -> None:
        """Copy the mesh. path: near which it is precise. rays: how many there will be.

        Raises MissingDependencyError where embreex cannot be imported.
        """
        self._origin_m = recentring_m(path)
        vertices_m = (mesh.vertices_m - self._origin_m).astype(np.float32)
        corners = triangle_corners(mesh, vertices_m)
        self._caster, self.notes = caster_of(mesh, vertices_m, corners, options, rays)
        self._normals = triangle_normals(mesh, corners)

    def cast(self, spin: Spin, c2w: Float64) -> Echoes:
        """Return what a turn meets whose columns are seen from poses (A, 4, 4), camera-to-world, OpenCV axes."""
        size = (len(spin.elevations_deg), spin.columns)
        view = spin.line_view(c2w, self._origin_m)
        rgb, depth_m = np.empty((*size, 3), np.float32), np.empty(size, np.float32)
        triangles = np.empty(size, np.int32)
        self._caster.cast(view, slice(0, size[0]), CastImages(rgb, depth_m, triangles))
        length = np.sqrt(1 + spin.down * spin.down)[:, None]
        directions = view.directions(slice(0, size[0])).reshape(*size, 3) / length[..., None]
        normals = np.take(self._normals, triangles, axis=0, mode="clip")
        cosine = np.abs(np.einsum("bak,bak->ba", normals, directions))
        luminance = rgb.astype(np.float64) @ np.array([0.2126, 0.7152, 0.0722])
        return Echoes(depth_m.astype(np.float64) * length, cosine, luminance)

    def close(self) -> None:
        """Free the mesh."""
        self._caster.close()

    def __enter__(self) -> "SpinningCaster":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
