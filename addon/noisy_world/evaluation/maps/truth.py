# SPDX-License-Identifier: GPL-3.0-or-later
"""The true map: a scene's mesh, or a recording's true depth fused along the true path, as far as cameras saw it."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from ...core.scenes.mesh import Mesh
from .culling import TRUTH_MARGIN_M, Culling, Seen
from .distances import MapSurface
from .fusing import fuse
from .samples import Points, Samples, areas_m2, corners_of, draw
from .views import RecordedViews, RenderedViews, Views

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
    seen_points = seen.tell(first.points_m, margin_m)
    parts, share = [first.only(seen_points)], float(seen_points.mean())
    for number in range(1, _ROUNDS):
        if share == 0 or sum(map(len, parts)) >= count:
            break
        more = draw(corners_m, count, *names, number)
        parts.append(more.only(seen.tell(more.points_m, margin_m)))
    samples = Samples(
        np.concatenate([part.points_m for part in parts])[:count],
        np.concatenate([part.triangles for part in parts])[:count],
    )
    if not len(samples):
        return None
    areas = areas_m2(corners_m)
    small = np.flatnonzero((areas < 4 * areas.sum() * share / len(samples)) & (areas > 0))  # such may have no sample
    centres_m = corners_m[small].mean(axis=1)
    seen_points = seen.tell(centres_m, margin_m)
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
    stopped: Callable[[], bool] = lambda: False,
) -> TrueMap:
    """Return the true map of frames without noise, with rgb, depth_m and c2w.

    Finer voxels than a map's own: what is fused with an error of some millimetres measures nothing below that.
    """
    fused = fuse(frames, (frame.c2w for frame in frames), camera, voxel_m=voxel_m, stopped=stopped)
    views = RecordedViews(frames, camera)
    return TrueMap(fused.mesh, views, "fused", culling=culling, samples=samples, seed=seed)
