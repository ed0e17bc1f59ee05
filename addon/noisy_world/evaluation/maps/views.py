# SPDX-License-Identifier: GPL-3.0-or-later
"""What the true cameras see of the true mesh, of a recording, and of an estimated map."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...core.channels import COLOUR_AND_DEPTH
from ...core.datasets.images import rgb_bytes
from ...core.extras import need
from ...core.geometry import Intrinsics
from ...core.planning.source import RenderOptions
from ...core.scenes.mesh import Mesh
from ...core.trajectories.sensor_paths import SensorPaths
from ...core.trajectories.trajectory import evenly_stamped

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
        from ...rays.session import RaySession

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
