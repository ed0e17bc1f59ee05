# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh in Embree, ready to be seen from any pose: the session of `engine: embree`, which needs no Blender."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.channels.surface import Surface
from ..core.channels.surface_images import SurfaceImages
from ..core.geometry import Intrinsics
from ..core.lens import WIDEST_DEG, LensRays, lens_rays
from ..core.machine import available_threads, keep_freed_memory
from ..core.optics import Distortion
from ..core.planning.source import RenderedFrame, RenderOptions
from ..core.scenes.mesh import Mesh
from ..core.scenes.recentring import recentring_m
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.sensor_paths import SensorPaths
from .antialiasing import PIXELS_AT_ONCE, grid_of, mean_colours, uneven_pixels
from .casters import caster_of
from .casting import TILE_PX, CastImages, LineView, RayView, View
from .triangles import triangle_corners, triangle_faces, triangle_normals

SIDEWAYS = f"the lens sees sideways: depth is void from {WIDEST_DEG:g} degrees off its axis on, where planar depth ends"


@dataclass(frozen=True, eq=False)
class _Eye:
    """The rays of a camera's pixels: right (W,) and down (H,) at one metre; lens: of one that distorts, instead."""

    right: NDArray[np.float64]
    down: NDArray[np.float64]
    lens: LensRays | None = None

    @classmethod
    def of(cls, camera: Intrinsics, lens: LensRays | None = None) -> "_Eye":
        """Return the rays of a pinhole, and of its lens where that distorts."""
        columns, rows = (np.arange(size, dtype=np.float64) for size in (camera.width_px, camera.height_px))
        return cls((columns - camera.cx_px) / camera.fx_px, (rows - camera.cy_px) / camera.fy_px, lens)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, pixels."""
        return len(self.down), len(self.right)

    def planar_m(self, lengths_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the planar depth (H, W) of what rays meet, 0 = void, where a lens sees sideways; else as it is."""
        if self.lens is None or self.lens.forward is None:
            return lengths_m
        return np.where(self.lens.is_deep, lengths_m * self.lens.forward, 0).astype(np.float32)

    def lines(self, *, rows: bool) -> int:
        """Return how many rows it has, or columns."""
        return self.size[0 if rows else 1]


class RaySession:
    """One mesh in Embree, from its first frame to its last.

    origin_m: (3,) float64, around which it is seen. notes: what a user should know about how its rays are cast.
    """

    def __init__(
        self,
        mesh: Mesh,
        paths: SensorPaths,
        intrinsics: Intrinsics,
        options: RenderOptions,
        lens: Distortion | None = None,
    ) -> None:
        """Copy the mesh. paths: of the sensors; the scene is recentred so that what is near them is precise.

        lens: that rays pass before the image of these intrinsics; it is sound there.

        Raises MissingDependencyError where embreex cannot be imported.
        """
        keep_freed_memory()  # clearing new pages for what numpy holds of a frame takes as long as the colours
        self.origin_m = recentring_m(paths.rgb)
        self._options = options
        vertices_m = (mesh.vertices_m - self.origin_m).astype(np.float32)
        corners = triangle_corners(mesh, vertices_m)
        self._width, self._height = intrinsics.width_px, intrinsics.height_px
        rays = self._width * self._height * len(paths)
        self._caster, self.notes = caster_of(mesh, vertices_m, corners, options, rays)
        self._images = SurfaceImages(options.channels, mesh)
        needs = self._images.needs
        self._normals = triangle_normals(mesh, corners) if "normals" in needs else None
        self._faces = triangle_faces(mesh) if "faces" in needs else None
        self._lens = None if lens is None else lens_rays(intrinsics, lens)
        self._eye = _Eye.of(intrinsics, self._lens)
        if self._lens is not None and self._lens.forward is not None and options.depth_camera is None:
            self.notes = (*self.notes, SIDEWAYS)
        own = options.depth_camera
        self._deep_eye = None if own is None else _Eye.of(own)
        self._grid = grid_of(options.samples) if options.samples > 1 else None
        self._focal_px = intrinsics.fx_px, intrinsics.fy_px
        self._threads = ThreadPoolExecutor(options.threads or available_threads(), thread_name_prefix="rays")
        self._process = os.getpid()

    def serves(self, paths: SensorPaths, options: RenderOptions) -> bool:
        """Tell whether frames along other paths, with other options, would be those of a session of their own."""
        here, there = (replace(item, first_frames=()) for item in (self._options, options))
        return here == there and np.array_equal(self.origin_m, recentring_m(paths.rgb))

    def frame(self, request: FrameRequest) -> RenderedFrame:
        """Return the frame of a request: one ray through each pixel of a sensor, more where colours are uneven."""
        rgb = self._options.rgb and request.looks_at("rgb")
        depth = (self._options.depth and request.looks_at("depth")) or not rgb  # which tells whether anything is seen
        view, deep = self._views(request)
        apart = depth and deep is not None
        through = self._options.through_glass and rgb and self._deep_eye is not None  # what colour itself shows
        together = (depth and not apart) or through
        seen = self._seen(view, rgb=rgb, depth=together, triangles=bool(self._images.needs))
        others = {} if seen.triangles is None else self._images.of(self._surface(view, request.rgb_c2w, seen.triangles))
        eye = self._deep_eye or self._eye
        seen_m = seen.depth_m if seen.depth_m is None else self._eye.planar_m(seen.depth_m)
        depth_m = seen_m
        if deep is not None and apart:
            lengths_m = self._seen(deep, eye, depth=True).depth_m
            assert lengths_m is not None, "it is asked for"
            depth_m = eye.planar_m(lengths_m)
        rays = None if seen.rgb is None else self._smooth(view, request.rgb_c2w, seen.rgb)
        behind_m = seen_m if through else None
        return RenderedFrame(seen.rgb, depth_m if depth else None, others, rays, behind_glass_m=behind_m)

    def _views(self, request: FrameRequest) -> tuple[View, View | None]:
        """Return what the colour sensor sees, and the depth sensor where that sees something else."""
        eye, own = self._eye, self._deep_eye
        if (readout := request.rays.readout) is None:
            same = own is None and np.array_equal(request.rgb_c2w, request.depth_c2w)
            return self._view(request.rgb_c2w, eye), None if same else self._view(request.depth_c2w, own or eye)
        rows = readout.direction in ("down", "up")
        rgb_c2w, depth_c2w = request.poses_after(readout.line_times_s(eye.lines(rows=rows)))
        view = self._lines(rgb_c2w, eye, rows=rows)
        if not request.rays.depth_rolls:
            return view, self._view(request.depth_c2w, own or eye)
        if own is not None:
            _, depth_c2w = request.poses_after(readout.line_times_s(own.lines(rows=rows)))
            return view, self._lines(depth_c2w, own, rows=rows)
        return view, None if np.array_equal(rgb_c2w, depth_c2w) else self._lines(depth_c2w, eye, rows=rows)

    def _lines(self, c2w: NDArray[np.float64], eye: "_Eye", *, rows: bool) -> LineView:
        """Return the rays of an image each row or column of which has its own pose (L, 4, 4)."""
        lines = (len(c2w), 1) if rows else (1, len(c2w))
        starts_m = (c2w[:, :3, 3] - self.origin_m).reshape(*lines, 3)
        axes, lens = c2w[:, :3, :3].reshape(*lines, 3, 3), eye.lens
        if lens is not None:
            return LineView(starts_m, axes, lens.right, lens.down, lens.forward)
        right, down = (np.asarray(values, np.float64) for values in (eye.right[None], eye.down[:, None]))
        return LineView(starts_m, axes, right, down)

    def _smooth(self, view: View, c2w: NDArray[np.float64], rgb: NDArray[np.float32]) -> int | None:
        """Average the colours of uneven pixels, in place; return how many rays all pixels took, None where one each."""
        if (grid := self._grid) is None:
            return None
        fx_px, fy_px = self._focal_px
        beside_right, beside_down = grid.right_px / fx_px, grid.down_px / fy_px
        beside = c2w[:3, :1] * beside_right + c2w[:3, 1:2] * beside_down
        pixels, colours = uneven_pixels(rgb), rgb.reshape(-1, 3)

        def smooth(part: slice) -> None:
            row, column = np.divmod(pixels[part], self._width)
            # Those of a pixel are in one row, and share packets.
            if isinstance(view, RayView):
                centres = np.ascontiguousarray(view.across[:, column] + view.down[:, row])
                rays: View = RayView(view.origin_m, beside, centres)
            else:
                places: tuple[NDArray[np.float64], ...] = (beside_right, beside_down)
                if self._lens is not None:
                    places = self._lens.beside(row, column, grid.right_px, grid.down_px)
                rays = view.beside(row, column, *places)
            found = np.empty((len(row), beside.shape[1], 3), dtype=np.float32)
            self._caster.cast(rays, slice(0, len(found)), CastImages(found, None, None))
            colours[pixels[part]] = mean_colours(colours[pixels[part]], found, grid)

        self._each(smooth, len(pixels), PIXELS_AT_ONCE)
        return self._width * self._height + beside.shape[1] * len(pixels)

    def _view(self, c2w: NDArray[np.float64], eye: "_Eye") -> View:
        """Return the rays of a pose (4, 4)."""
        if eye.lens is not None:
            return self._lines(c2w[None], eye, rows=True)
        right, down, forward = (c2w[:3, axis, None] for axis in range(3))
        return RayView(c2w[:3, 3] - self.origin_m, eye.right * right + forward, eye.down * down)

    def _seen(
        self,
        view: View,
        eye: "_Eye | None" = None,
        *,
        rgb: bool = False,
        depth: bool = False,
        triangles: bool = False,
    ) -> CastImages:
        """Return what is asked for of what a view sees. eye: whose rays these are; by default colour's."""
        size = (eye or self._eye).size
        images = CastImages(
            np.empty((*size, 3), dtype=np.float32) if rgb else None,
            np.empty(size, dtype=np.float32) if depth else None,
            np.empty(size, dtype=np.int32) if triangles else None,
        )
        if rgb or depth or triangles:
            self._each(lambda rows: self._caster.cast(view, rows, images), size[0], TILE_PX)
        return images

    def _surface(self, view: View, c2w: NDArray[np.float64], triangles: NDArray[np.int32]) -> Surface:
        """Return what is asked for of the mesh, where a view of a pose (4, 4) sees these triangles (H, W)."""
        size = triangles.shape
        normals = None if self._normals is None else np.empty((*size, 3), dtype=np.float32)
        faces = None if self._faces is None else np.empty(size, dtype=np.int32)

        def look(rows: slice) -> None:
            seen = triangles[rows].ravel()
            missed = np.flatnonzero(seen < 0)
            if normals is not None and self._normals is not None:
                there = np.take(self._normals, seen, axis=0, mode="clip")
                behind = np.einsum("nk,nk->n", there, view.directions(rows)) > 0  # the other side of the face is seen
                there[behind] *= -1
                there[missed] = 0
                normals[rows] = (there @ c2w[:3, :3]).reshape(-1, self._width, 3)
            if faces is not None and self._faces is not None:
                face = np.take(self._faces, seen, mode="clip")
                face[missed] = -1
                faces[rows] = face.reshape(-1, self._width)

        self._each(look, self._height, TILE_PX)
        return Surface(normals, faces)

    def _each(self, work: Callable[[slice], None], count: int, size: int) -> None:
        """Do something for parts of a whole: in several threads, but where this process was forked meanwhile.

        Threads do not outlive a fork, and those who fork workers have one for each processor.
        """
        parts = [slice(first, min(first + size, count)) for first in range(0, count, size)]
        if os.getpid() != self._process:
            for part in parts:
                work(part)
        else:
            for done in [self._threads.submit(work, part) for part in parts]:
                done.result()

    def close(self) -> None:
        """End the threads, and free the mesh."""
        self._threads.shutdown()
        self._caster.close()

    def __enter__(self) -> "RaySession":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
