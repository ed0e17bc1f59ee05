# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh in Embree, ready to be seen from any pose: the session of `engine: embree`, which needs no Blender."""

import contextlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..channels import SurfaceImages
from ..channels.channel import Surface
from ..core.file_access import private_cache_folder
from ..core.frame_request import FrameRequest, SensorPaths
from ..core.geometry import Intrinsics
from ..core.lens import WIDEST_DEG, Distortion, LensRays, lens_rays
from ..core.machine import available_threads, keep_freed_memory, processor_features
from ..core.packages import install_command
from ..core.srgb import exact_colours, quick_light
from ..core.trajectory import Trajectory, recentring_m
from ..scenes.polygon_mesh import Mesh
from .embree import Hits, LibraryError, TracedTriangles, check_embree
from .source import RenderedFrame, RenderOptions
from .triangles import (
    TILE_PX,
    Caster,
    CastImages,
    CastMesh,
    LineView,
    RayView,
    View,
    colours_of,
    triangle_corners,
    triangle_faces,
    triangle_normals,
)

# Anti-aliasing: a pixel whose colour is not its neighbours' becomes the mean light of a grid of rays through it.
#
# The grid is regular and the same for every pixel (a box filter over the pixel), so nothing is random. Means are
# those of linear light, as a sensor and Cycles take them; void is black. Where colours are alike a pixel keeps its
# centre's.


# Of a display-encoded component, nominally [0, 1]. Chosen, in the embedded rooms at 9 samples: .1 gives 1 dB more for a
# fifth more rays, .2 takes 1.5 dB for a sixth fewer. Jumps of depth between pixels would add a tenth of a dB.
CONTRAST = 0.15
PIXELS_AT_ONCE = 4096  # bounds the memory; chosen


@dataclass(frozen=True)
class RayGrid:
    """The rays through a pixel beside that of its centre, in order.

    right_px, down_px: (S,) float64, where they go, from the centre. samples: of which the mean is made, with the
    centre's where `centred`.
    """

    right_px: NDArray[np.float64]
    down_px: NDArray[np.float64]
    samples: int
    centred: bool


def grid_of(samples: int) -> RayGrid:
    """Return the grid of so many samples, a square number above 1; the middle one of an odd number is the centre."""
    side = round(samples**0.5)
    assert side * side == samples > 1, samples
    places_px = (np.arange(side) + 0.5) / side - 0.5
    down_px, right_px = (values.ravel() for values in np.meshgrid(places_px, places_px, indexing="ij"))
    beside = np.arange(samples) != samples // 2 if side % 2 else np.full(samples, True)
    return RayGrid(right_px[beside], down_px[beside], samples, centred=bool(side % 2))


def uneven_pixels(rgb: NDArray[np.float32]) -> NDArray[np.intp]:
    """Return the pixels of an image (H, W, 3) that differ from a neighbour by more than CONTRAST, row by row.

    They are places in the image's H x W pixels. Neighbours share a side.
    """
    import cv2

    uneven = np.zeros(rgb.shape[:2], dtype=np.bool_)
    for here, there in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
        if rgb[here].size:
            alike = cv2.inRange(cv2.absdiff(rgb[here], rgb[there]), (0.0,) * 3, (CONTRAST,) * 3)
            differs = alike.reshape(uneven[here].shape) == 0
            uneven[here] |= differs
            uneven[there] |= differs
    return np.flatnonzero(uneven)


def mean_colours(centre: NDArray[np.float32], beside: NDArray[np.float32], grid: RayGrid) -> NDArray[np.float32]:
    """Return the colours (N, 3) of pixels: centre (N, 3) and beside (N, S, 3) are those of the grid's rays.

    All are display-encoded and within [0, 1], or taken to its ends.
    """
    light = quick_light(beside)
    mean = quick_light(centre) if grid.centred else np.zeros_like(centre)
    for ray in range(light.shape[1]):  # one after another, in a third of the time of numpy's sum along the axis
        mean += light[:, ray]
    mean /= np.float32(grid.samples)
    return np.asarray(exact_colours(mean), dtype=np.float32)


# Casting rays one at a time through embreex, and colouring what they meet in numpy: it needs nothing compiled.


class RayByRay:
    """Triangles in embreex. Its values are those that packets of rays give, to the bit."""

    def __init__(self, cast: CastMesh) -> None:
        """Copy the mesh. Raises MissingDependencyError where embreex cannot be imported."""
        self._triangles = TracedTriangles(cast.vertices_m, cast.mesh.corner_vertices[cast.corners])
        self._colours = colours_of(cast.mesh, cast.corners) if cast.coloured else None
        self._near_m, self._far_m = cast.near_m, cast.far_m

    def cast(self, view: View, rows: slice, images: CastImages) -> None:
        """Fill in some rows of the images."""
        import cv2

        directions = view.directions(rows)
        size = (rows.stop - rows.start, len(directions) // (rows.stop - rows.start))
        hits = self._first(np.broadcast_to(view.origins_m(rows), (*size, 3)).reshape(-1, 3), directions)
        missed = np.flatnonzero(hits.triangles < 0)
        if images.rgb is not None and self._colours is not None:
            planes = self._colours(hits)
            planes[:, missed] = 0
            images.rgb[rows] = cv2.merge([plane.reshape(size) for plane in planes])
        if images.depth_m is not None:
            hits.lengths[missed] = 0
            images.depth_m[rows] = hits.lengths.reshape(size)
        if images.triangles is not None:
            images.triangles[rows] = hits.triangles.reshape(size)

    def _first(self, origins_m: NDArray[np.float64], directions: NDArray[np.float32]) -> Hits:
        """Return what rays from points (N, 3) along directions (N, 3) meet between near and far plane.

        Rays that meet something before the near plane are cast again, from there.
        """
        hits = self._triangles.first(origins_m.astype(np.float32), directions)
        near = np.flatnonzero(hits.lengths < self._near_m)
        if near.size:
            onward = directions[near]
            again = self._triangles.first((origins_m[near] + self._near_m * onward).astype(np.float32), onward)
            hits.triangles[near], hits.lengths[near] = again.triangles, again.lengths + np.float32(self._near_m)
            hits.second[near], hits.third[near] = again.second, again.third
        hits.triangles[hits.lengths > self._far_m] = -1
        return hits

    def close(self) -> None:
        """Do nothing: embreex frees its triangles by itself."""


# Chooses how rays are cast: in packets where numba is installed and it pays, else one by one, with equal values.


# Measured: importing numba and its compiled code takes .4 s; packets spare .1 s a million rays, and in building the
# tree .4 s a million triangles.
PAYS_FROM_RAYS = 4_000_000
RAYS_FOR_A_TRIANGLE = 4


def caster_of(
    mesh: Mesh, vertices_m: NDArray[np.float32], corners: NDArray[np.int32], options: RenderOptions, rays: int
) -> tuple[Caster, tuple[str, ...]]:
    """Return the mesh ready for rays, and what a user should know about how they are cast.

    vertices_m: (V, 3), as they are seen. corners: (T, 3), of its triangles. rays: how many there will be at most.

    Raises MissingDependencyError where embreex cannot be imported.
    """
    check_embree()
    notes: tuple[str, ...] = ()
    cast = CastMesh(mesh, vertices_m, corners, options.near_m, options.far_m, options.rgb)
    if rays + RAYS_FOR_A_TRIANGLE * len(corners) >= PAYS_FROM_RAYS:
        folder = private_cache_folder()
        try:
            from .packets import Packets

            packets = Packets(cast, folder)
        except (ImportError, LibraryError) as error:
            remedy = f"; run: {install_command('embree')}" if isinstance(error, ModuleNotFoundError) else ""
            notes = (f"rays are cast one by one, which takes twice as long: {error}{remedy}",)
        else:
            kept = "not kept: there is no folder for it that is yours alone" if folder is None else f"kept in {folder}"
            took = f"compiling the code that casts rays took {packets.compiling_s:.1f} s; it is {kept}"
            return packets, (took,) if packets.compiling_s else ()
    return RayByRay(cast), notes


def load_packets(rays: int) -> None:
    """Load what casts so many rays, where packets pay: processes that are split from this one have it then.

    Embree itself is not loaded: its threads would be missing in them.
    """
    folder = private_cache_folder()
    if rays < PAYS_FROM_RAYS or folder is None:
        return
    with contextlib.suppress(ImportError):
        from .packets import compiled

        compiled(16 if "AVX512_SKX" in processor_features() else 8, folder)  # if Embree takes others, they load them


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


# A mesh as a spinning lidar sees it: rows of beams around, each column from where the sensor is by then.


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
