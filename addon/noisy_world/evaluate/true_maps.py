# SPDX-License-Identifier: GPL-3.0-or-later
"""The true map: a scene's mesh, or a recording's true depth fused along the true path, as far as cameras saw it."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..channels import COLOUR_AND_DEPTH
from ..core.frame_request import SensorPaths
from ..core.geometry import Intrinsics
from ..core.machine import available_threads
from ..core.packages import need
from ..core.streams import stream
from ..core.trajectory import evenly_stamped
from ..images.pixels import rgb_bytes
from ..render.source import RenderOptions
from ..render.triangles import triangle_corners
from ..scenes.polygon_mesh import Mesh
from .map_fusion import fuse

# Triangles of a mesh, and points on them drawn evenly by area.


Points: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """Points (N, 3) float64 metres on triangles, and the triangle (N,) of each."""

    points_m: Points
    triangles: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.points_m)

    def only(self, kept: NDArray[np.bool_]) -> "Samples":
        """Return those that are kept."""
        return Samples(self.points_m[kept], self.triangles[kept])


def corners_of(mesh: Mesh) -> Points:
    """Return the corners (T, 3, 3) float64 of a mesh's triangles, in metres; polygons are cut as for rendering."""
    vertices_m = mesh.vertices_m
    if not len(mesh.face_starts):
        return np.empty((0, 3, 3))
    middle_m = (vertices_m.min(axis=0) + vertices_m.max(axis=0)) / 2  # float32 decides how faces are cut
    corners = triangle_corners(mesh, (vertices_m - middle_m).astype(np.float32))
    return vertices_m[mesh.corner_vertices[corners]]


def areas_m2(corners_m: Points) -> NDArray[np.float64]:
    """Return the areas (T,) of triangles (T, 3, 3)."""
    return np.linalg.norm(_normals(corners_m), axis=1) / 2


def draw(corners_m: Points, count: int, *names: str | int) -> Samples:
    """Draw points on triangles (T, 3, 3), evenly by area; none where they have none.

    names: of the random stream; the same names and triangles give the same points.
    """
    ends = np.cumsum(areas_m2(corners_m))
    if not len(ends) or not ends[-1] > 0:
        return Samples(np.empty((0, 3)), np.empty(0, dtype=np.intp))
    random = stream("map samples", *names)
    chosen = np.minimum(np.searchsorted(ends, random.random(count) * ends[-1], side="right"), len(ends) - 1)
    # Osada et al. 2002: the root makes points as dense at the first corner as at the opposite edge.
    root, along = np.sqrt(random.random(count))[:, None], random.random(count)[:, None]
    a, b, c = corners_m[chosen].transpose(1, 0, 2)
    return Samples(a + root * (b - a + along * (c - b)), chosen)


def _normals(corners_m: Points) -> Points:
    a, b, c = corners_m.transpose(1, 0, 2)
    return np.cross(b - a, c - a)


# What the true cameras see of the true mesh, of a recording, and of an estimated map.


NEAR_M, FAR_M = 0.01, 1000.0


@dataclass(frozen=True)
class MapView:
    """What a camera sees: colour (H, W, 3) uint8, None where it has none; planar depth (H, W) in metres, 0 = void."""

    rgb: NDArray[np.uint8] | None
    depth_m: NDArray[np.float32]


class Views(Protocol):
    """True views by their number. camera: their intrinsics. c2w: (N, 4, 4) float64, OpenCV axes."""

    camera: Intrinsics
    c2w: NDArray[np.float64]

    def view(self, index: int) -> MapView:
        """Return what the camera sees there, without noise."""
        ...


class NoViews:
    """No true camera is known: nothing can be culled or rendered."""

    camera = Intrinsics(1, 1, 1.0, 1.0, 0.0, 0.0)
    c2w = np.empty((0, 4, 4))

    def view(self, index: int) -> MapView:
        """Raise IndexError: there is none."""
        raise IndexError(index)


class RecordedViews:
    """The views of a recording as they were stored. Its depth should be that of a good sensor."""

    def __init__(self, frames: Sequence, camera: Intrinsics) -> None:
        """Keep frames with rgb, depth_m and c2w, which are read when they are looked at."""
        self.camera = camera
        self._frames = frames
        self.c2w = np.array([frame.c2w for frame in frames]).reshape(-1, 4, 4)

    def view(self, index: int) -> MapView:
        """Return a frame's images."""
        frame = self._frames[index]
        return MapView(frame.rgb, frame.depth_m)


class RenderedViews:
    """The views of a mesh from poses, by rays. A context: its threads end with it."""

    def __init__(self, mesh: Mesh, camera: Intrinsics, c2w: NDArray[np.float64]) -> None:
        """Copy the mesh. Raises MissingDependencyError where embreex cannot be imported."""
        from ..render.ray_session import RaySession

        need(["embreex"], "evaluate", for_what="rendering maps")
        self.camera = camera
        self.c2w = np.asarray(c2w, dtype=np.float64)
        self.coloured = mesh.rgb is not None or mesh.corner_rgb is not None or mesh.texture is not None
        self._paths = SensorPaths(evenly_stamped(self.c2w))
        channels = COLOUR_AND_DEPTH if self.coloured else frozenset({"depth"})
        options = RenderOptions(NEAR_M, FAR_M, samples=1, seed=0, engine="embree", channels=channels)
        self._session = RaySession(mesh, self._paths, camera, options)

    def view(self, index: int) -> MapView:
        """Return what is seen of the mesh."""
        frame = self._session.frame(self._paths.request(index))
        assert frame.depth_m is not None
        return MapView(None if frame.rgb is None else rgb_bytes(frame.rgb), frame.depth_m)

    def close(self) -> None:
        """End the threads."""
        self._session.close()


@contextmanager
def rendered_views(mesh: Mesh, camera: Intrinsics, c2w: NDArray[np.float64]) -> Iterator[RenderedViews]:
    """Give the views of a mesh, and end their threads."""
    views = RenderedViews(mesh, camera, c2w)
    try:
        yield views
    finally:
        views.close()


def spread(count: int, most: int) -> list[int]:
    """Return at most so many of the numbers 0 to count - 1, evenly: the first and the last among them."""
    if count <= most:
        return list(range(count))
    return np.unique(np.rint(np.linspace(0, count - 1, most)).astype(int)).tolist()


# Culling: only points that the true cameras saw are compared.


MARGIN_M = 0.1  # how far behind the true surface a map's point still counts as seen; chosen
TRUTH_MARGIN_M = 0.02  # of the truth's own points: more would count what a thin shelf hides; chosen
MOST_VIEWS = 200
_AT_ONCE = 200_000  # points


class Culling(StrEnum):
    """Which points count."""

    NONE = "none"  # all
    FRUSTUM = "frustum"  # in the picture of some true camera, no farther than the farthest that it sees, with a margin
    FRUSTUM_OCCLUSION = "frustum_occlusion"  # and not behind what it sees there, with a margin


class Seen:
    """What true cameras saw: their depth images, evenly chosen from all views, at most MOST_VIEWS."""

    def __init__(self, views: Views, culling: Culling) -> None:
        """Look at the views; their depth is kept."""
        self.culling = culling
        self._camera = views.camera
        chosen = [] if culling is Culling.NONE else spread(len(views.c2w), MOST_VIEWS)
        # Neighbours see much the same. With far ones first, most points are found soon, and not looked for again.
        order = [chosen[place] for place in _far_ones_first(len(chosen))]
        self._c2w = views.c2w[order]
        self._limits_m = [self._limit_m(views.view(index).depth_m) for index in order]

    @property
    def view_count(self) -> int:
        """How many views were looked at."""
        return len(self._limits_m)

    def _limit_m(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return how deep a pixel (H * W,) sees: without an end where it meets nothing."""
        if self.culling is Culling.FRUSTUM:
            return np.full(depth_m.size, depth_m.max(), dtype=np.float32)
        return np.where(depth_m > 0, depth_m, np.float32(np.inf)).reshape(-1)

    def covers(self, points_m: Points, margin_m: float) -> NDArray[np.bool_]:
        """Return which of the points (N, 3) count (N,): those at most so far behind what is seen."""
        covered = np.full(len(points_m), self.culling is Culling.NONE)
        for first in range(0, len(points_m) if self._limits_m else 0, _AT_ONCE):
            some = points_m[first : first + _AT_ONCE]
            left = np.arange(first, first + len(some))
            for c2w, limit_m in zip(self._c2w, self._limits_m, strict=True):
                seen = _in_view(points_m[left], c2w, self._camera, limit_m + np.float32(margin_m))
                covered[left[seen]] = True
                left = left[~seen]
        return covered


def _in_view(
    points_m: Points, c2w: NDArray[np.float64], camera: Intrinsics, limit_m: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """Return which points lie in a picture, before what limits each pixel's sight."""
    x, y, z = ((points_m - c2w[:3, 3]) @ c2w[:3, :3]).astype(np.float32).T
    seen = z > 0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # behind the camera: not seen
        right = x / z * np.float32(camera.fx_px) + np.float32(camera.cx_px + 0.5)
        down = y / z * np.float32(camera.fy_px) + np.float32(camera.cy_px + 0.5)
    seen &= (right >= 0) & (right < camera.width_px) & (down >= 0) & (down < camera.height_px)
    inside = np.flatnonzero(seen)
    pixels = down[inside].astype(np.intp) * camera.width_px + right[inside].astype(np.intp)
    seen[inside] = z[inside] <= limit_m[pixels]
    return seen


def _far_ones_first(count: int) -> list[int]:
    """Return 0 to count - 1 in halves of halves: 0, a half, a quarter, three quarters, ..."""
    bits = max(count - 1, 0).bit_length()
    turned = (int(format(place, f"0{bits}b")[::-1], 2) if bits else place for place in range(1 << bits))
    return [place for place in turned if place < count]


# Distances from points to the nearest points, and to the nearest surface.


CANDIDATES = 8  # triangles that are looked at for each point; chosen
_DISTANCES_AT_ONCE = 100_000  # points


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
        distances = np.empty(len(points_m))
        for first in range(0, len(points_m), _DISTANCES_AT_ONCE):
            some = points_m[first : first + _DISTANCES_AT_ONCE]
            near = self._tree.query(some, k=self._candidates, workers=available_threads())[1].reshape(len(some), -1)
            triangles = self._triangles[near]
            squares = np.full(len(some), np.inf)
            for column in range(triangles.shape[1]):
                new = (triangles[:, :column] != triangles[:, column, None]).all(axis=1)
                corners_m = self._corners_m[triangles[new, column]]
                squares[new] = np.minimum(squares[new], squared_distances(some[new], corners_m))
            distances[first : first + _DISTANCES_AT_ONCE] = np.sqrt(squares)
        return distances


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


SAMPLES = 200_000
_ROUNDS = 20  # of samples, where most are not seen; chosen

Origin: TypeAlias = Literal["mesh", "fused"]


@dataclass(frozen=True)
class SeenSurface:
    """The part of a mesh that counts. samples: as many as were asked for. share: of the mesh's area."""

    surface: MapSurface
    samples: Samples
    share: float


def seen_surface(mesh: Mesh, seen: Seen, margin_m: float, count: int, *names: str | int) -> SeenSurface | None:
    """Return the part of a mesh that was seen, with points drawn on it; None where nothing of it was."""
    corners_m = corners_of(mesh)
    first = draw(corners_m, count, *names, 0)
    if not len(first):
        return None
    seen_points = seen.covers(first.points_m, margin_m)
    parts, share = [first.only(seen_points)], float(seen_points.mean())
    for number in range(1, _ROUNDS):
        if share == 0 or sum(map(len, parts)) >= count:
            break
        more = draw(corners_m, count, *names, number)
        parts.append(more.only(seen.covers(more.points_m, margin_m)))
    samples = Samples(
        np.concatenate([part.points_m for part in parts])[:count],
        np.concatenate([part.triangles for part in parts])[:count],
    )
    if not len(samples):
        return None
    areas = areas_m2(corners_m)
    small = np.flatnonzero((areas < 4 * areas.sum() * share / len(samples)) & (areas > 0))  # such may have no sample
    centres_m = corners_m[small].mean(axis=1)
    seen_points = seen.covers(centres_m, margin_m)
    points_m = np.concatenate([samples.points_m, centres_m[seen_points]])
    return SeenSurface(
        MapSurface(corners_m, points_m, np.concatenate([samples.triangles, small[seen_points]])), samples, share
    )


class TrueMap(AbstractContextManager["TrueMap"]):
    """What maps are held against, for any number of them. A context: its renderer's threads end with it.

    origin: "mesh", or "fused" where it is itself a fusion of the true depth, with its voxels' error. seen: which points
    count. part: what was seen of it. views: the true cameras'.
    """

    def __init__(
        self,
        mesh: Mesh | None,
        views: Views,
        origin: Origin,
        *,
        culling: Culling = Culling.FRUSTUM_OCCLUSION,
        samples: int = SAMPLES,
        seed: int = 0,
    ) -> None:
        """See what the cameras see of the mesh; None is a truth of which nothing is known."""
        self.origin: Origin = origin
        self.views = views
        self.sample_count = samples
        self.seed = seed
        self.seen = Seen(views, culling)
        self.part = None if mesh is None else seen_surface(mesh, self.seen, TRUTH_MARGIN_M, samples, "truth", seed)

    @property
    def points_m(self) -> Points:
        """Points drawn on what was seen of it."""
        return np.empty((0, 3)) if self.part is None else self.part.samples.points_m

    def close(self) -> None:
        """End the threads of the renderer, where there is one."""
        if isinstance(self.views, RenderedViews):
            self.views.close()

    def __exit__(self, *_: object) -> None:
        self.close()


def true_map_of_mesh(
    mesh: Mesh,
    camera: Intrinsics,
    c2w: NDArray[np.float64],
    *,
    culling: Culling = Culling.FRUSTUM_OCCLUSION,
    samples: int = SAMPLES,
    seed: int = 0,
) -> TrueMap:
    """Return the true map of a scene's mesh, seen by cameras at the true poses (N, 4, 4)."""
    views = RenderedViews(mesh, camera, c2w)
    return TrueMap(mesh, views, "mesh", culling=culling, samples=samples, seed=seed)


def true_map_of_recording(
    frames: Sequence,
    camera: Intrinsics,
    *,
    voxel_m: float = 0.01,
    culling: Culling = Culling.FRUSTUM_OCCLUSION,
    samples: int = SAMPLES,
    seed: int = 0,
) -> TrueMap:
    """Return the true map of frames without noise, with rgb, depth_m and c2w.

    Finer voxels than a map's own: what is fused with an error of some millimetres measures nothing below that.
    """
    fused = fuse(frames, (frame.c2w for frame in frames), camera, voxel_m=voxel_m)
    views = RecordedViews(frames, camera)
    return TrueMap(fused.mesh, views, "fused", culling=culling, samples=samples, seed=seed)
