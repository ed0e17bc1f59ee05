# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh in Embree, ready to be seen from any pose: the session of `engine: embree`, which needs no Blender."""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.channels.surface import Surface
from ..core.channels.surface_images import SurfaceImages
from ..core.geometry import Intrinsics
from ..core.machine import available_threads, keep_freed_memory
from ..core.planning.source import RenderedFrame, RenderOptions
from ..core.scenes.mesh import Mesh
from ..core.scenes.recentring import recentring_m
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.sensor_paths import SensorPaths
from .colours import colours_of
from .embree import Hits, TracedTriangles
from .triangles import triangle_corners, triangle_faces, triangle_normals

_Take: TypeAlias = Callable[[slice, NDArray[np.float32], Hits, NDArray[np.intp]], None]

RAYS_AT_ONCE = 96_000  # chosen: as fast as any number from 48,000 on, and 15 MB a thread


class RaySession:
    """One mesh in Embree, from its first frame to its last.

    origin_m: (3,) float64, around which it is seen. triangles: the mesh as rays meet it, moved by that.
    """

    def __init__(self, mesh: Mesh, paths: SensorPaths, intrinsics: Intrinsics, options: RenderOptions) -> None:
        """Copy the mesh. paths: of the sensors; the scene is recentred so that what is near them is precise.

        Raises MissingDependencyError where embreex cannot be imported.
        """
        keep_freed_memory()  # clearing new pages for what numpy holds of a frame takes as long as the colours
        self.origin_m = recentring_m(paths.rgb)
        self._options = options
        vertices_m = (mesh.vertices_m - self.origin_m).astype(np.float32)
        corners = triangle_corners(mesh, vertices_m)
        self.triangles = TracedTriangles(vertices_m, mesh.corner_vertices[corners])
        self._colours = colours_of(mesh, corners) if options.rgb else None
        self._images = SurfaceImages(options.channels, mesh)
        needs = self._images.needs
        self._normals = triangle_normals(mesh, corners) if "normals" in needs else None
        self._faces = triangle_faces(mesh) if "faces" in needs else None
        self._width, self._height = intrinsics.width_px, intrinsics.height_px
        self._right = (np.arange(self._width) - intrinsics.cx_px) / intrinsics.fx_px
        self._down = (np.arange(self._height) - intrinsics.cy_px) / intrinsics.fy_px
        self._threads = ThreadPoolExecutor(options.threads or available_threads(), thread_name_prefix="rays")

    def serves(self, paths: SensorPaths, options: RenderOptions) -> bool:
        """Tell whether frames along other paths, with other options, would be those of a session of their own."""
        here, there = (replace(item, first_frames=()) for item in (self._options, options))
        return here == there and np.array_equal(self.origin_m, recentring_m(paths.rgb))

    def frame(self, request: FrameRequest) -> RenderedFrame:
        """Return the frame of a request: one ray through the centre of each pixel of each sensor."""
        others = self._images.of(self._surface(request.rgb_c2w)) if self._images.needs else {}
        wants_depth = self._options.depth
        if self._colours is None:
            return RenderedFrame(None, self._seen(request.depth_c2w, rgb=False, depth=True)[1], others)
        together = wants_depth and np.array_equal(request.rgb_c2w, request.depth_c2w)
        rgb, depth_m = self._seen(request.rgb_c2w, rgb=True, depth=together)
        if wants_depth and not together:
            depth_m = self._seen(request.depth_c2w, rgb=False, depth=True)[1]
        return RenderedFrame(rgb, depth_m, others)

    def _seen(
        self, c2w: NDArray[np.float64], *, rgb: bool, depth: bool
    ) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
        """Return what a pose (4, 4) sees: colour (H, W, 3) and planar depth (H, W), None for what is not asked for."""
        size = (self._height, self._width)
        colours = np.empty((*size, 3), dtype=np.float32) if rgb else None
        depth_m = np.empty(size, dtype=np.float32) if depth else None

        def take(rows: slice, _directions: NDArray[np.float32], hits: Hits, missed: NDArray[np.intp]) -> None:
            if colours is not None and self._colours is not None:
                planes = self._colours(hits)
                planes[:, missed] = 0
                colours[rows] = planes.T.reshape(-1, self._width, 3)
            if depth_m is not None:
                hits.lengths[missed] = 0
                depth_m[rows] = hits.lengths.reshape(-1, self._width)

        self._cast(c2w, take)
        return colours, depth_m

    def _surface(self, c2w: NDArray[np.float64]) -> Surface:
        """Return what a pose (4, 4) sees of the mesh, as far as it is asked for."""
        size = (self._height, self._width)
        normals = None if self._normals is None else np.empty((*size, 3), dtype=np.float32)
        faces = None if self._faces is None else np.empty(size, dtype=np.int32)

        def take(rows: slice, directions: NDArray[np.float32], hits: Hits, missed: NDArray[np.intp]) -> None:
            if normals is not None and self._normals is not None:
                there = np.take(self._normals, hits.triangles, axis=0, mode="clip")
                behind = np.einsum("nk,nk->n", there, directions) > 0  # the other side of the face is seen
                there[behind] *= -1
                there[missed] = 0
                normals[rows] = (there @ c2w[:3, :3]).reshape(-1, self._width, 3)
            if faces is not None and self._faces is not None:
                seen = np.take(self._faces, hits.triangles, mode="clip")
                seen[missed] = -1
                faces[rows] = seen.reshape(-1, self._width)

        self._cast(c2w, take)
        return Surface(normals, faces)

    def _cast(self, c2w: NDArray[np.float64], take: _Take) -> None:
        """Cast a ray through the centre of each pixel of a pose (4, 4), in bands of rows; `take` is given each band's.

        It is called in several threads, with the rows, the rays' directions (N, 3), what they meet, and which of them
        meet nothing.
        """
        origin_m = c2w[:3, 3] - self.origin_m
        # Of component 1 along the optical axis, so that lengths are planar depths; in float64, rounded once.
        across, down = self._right[:, None] * c2w[:3, 0] + c2w[:3, 2], self._down[:, None] * c2w[:3, 1]

        bands = self._bands()
        origins_m = np.full((bands[0].stop * self._width, 3), origin_m, dtype=np.float32)

        def cast(rows: slice) -> None:
            directions = np.empty((*down[rows].shape[:1], self._width, 3), dtype=np.float32)
            np.add(across, down[rows, None], out=directions, dtype=np.float64, casting="same_kind")
            flat = directions.reshape(-1, 3)
            hits = self._first(origin_m, origins_m[: len(flat)], flat)
            take(rows, flat, hits, np.flatnonzero(hits.triangles < 0))

        self._each(cast, bands)

    def _first(
        self, origin_m: NDArray[np.float64], origins_m: NDArray[np.float32], directions: NDArray[np.float32]
    ) -> Hits:
        """Return what rays from a point (3,), given for each of them (N, 3) too, meet between near and far plane.

        Rays that meet something before the near plane are cast again, from there.
        """
        near_m, far_m = self._options.near_m, self._options.far_m
        hits = self.triangles.first(origins_m, directions)
        near = np.flatnonzero(hits.lengths < near_m)
        if near.size:
            onward = directions[near]
            again = self.triangles.first((origin_m + near_m * onward).astype(np.float32), onward)
            hits.triangles[near], hits.lengths[near] = again.triangles, again.lengths + np.float32(near_m)
            hits.second[near], hits.third[near] = again.second, again.third
        hits.triangles[hits.lengths > far_m] = -1
        return hits

    def _bands(self) -> list[slice]:
        """Return the rows that are cast together, the first as many as any."""
        rows = max(1, RAYS_AT_ONCE // self._width)
        return [slice(top, min(top + rows, self._height)) for top in range(0, self._height, rows)]

    def _each(self, work: Callable[[slice], None], bands: Iterable[slice]) -> None:
        for done in [self._threads.submit(work, band) for band in bands]:
            done.result()

    def close(self) -> None:
        """End the threads."""
        self._threads.shutdown()

    def __enter__(self) -> "RaySession":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
