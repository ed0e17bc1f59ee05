# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene that stays in memory from one case to the next: loading it takes longer than rendering small frames."""

import contextlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from ...core.optics import Optics
from ...core.planning.source import Gives, OpenSource, PreparedSource, RenderOptions, Source
from ...core.scenes.mesh import Mesh
from ...core.trajectories.sensor_paths import SensorPaths
from ...core.trajectories.stamps import FrameStamps
from ...core.trajectories.trajectory import Axes, Trajectory


class SceneCache:
    """Holds the scene that was prepared last."""

    def __init__(self) -> None:
        self._name = ""
        self._camera: Intrinsics | None = None
        self._prepared: PreparedSource | None = None
        self._opened = contextlib.ExitStack()
        self._note: Callable[[str], None] = print

    def prepared(self, name: str, source: Source, camera: Intrinsics, note: Callable[[str], None]) -> PreparedSource:
        """Return a source prepared for a camera: the one that is held or, if it is another, a new one in its place."""
        self._note = note
        if self._prepared is None or (self._name, self._camera) != (name, camera):
            self.close()
            self._prepared = self._opened.enter_context(source.prepare(camera, self._tell))
            self._name, self._camera = name, camera
        return self._prepared

    def _tell(self, text: str) -> None:
        """Say something to who listens now."""
        self._note(text)

    def close(self) -> None:
        """Let go of it."""
        self._prepared = None
        self._opened.close()


@dataclass(frozen=True)
class SourceInside:
    """A source that does what another one does; what is derived from it does one thing otherwise."""

    source: Source

    @property
    def location(self) -> str:
        """The source's."""
        return self.source.location

    @property
    def gives(self) -> Gives:
        """What the source gives."""
        return self.source.gives

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the path's frames, seconds."""
        return self.source.stamps_s

    @property
    def frame_stamps(self) -> FrameStamps:
        """The source's."""
        return self.source.frame_stamps

    @property
    def robot_axes(self) -> Axes | None:
        """The axes of the path's poses."""
        return self.source.robot_axes

    def camera(self, asked: Intrinsics | None) -> Intrinsics | None:
        """Return the intrinsics of its frames."""
        return self.source.camera(asked)

    def optics(self, camera: Intrinsics) -> Optics:
        """Return the source's."""
        return self.source.optics(camera)

    def trajectory(self) -> Trajectory:
        """Return the path."""
        return self.source.trajectory()

    @property
    def mesh(self) -> Callable[[], Mesh] | None:
        """Returns the mesh that it shows, if it is one."""
        return self.source.mesh

    def hashes(self) -> dict[str, Any]:
        """Return what decides the frames' bytes."""
        return self.source.hashes()


@dataclass(frozen=True)
class CachedSource(SourceInside):
    """A source that stays prepared for the next case of its scene.

    seeded: whether its renderer's samples follow the seed; else another seed needs no other session.
    """

    name: str
    holder: SceneCache
    seeded: bool

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator[PreparedSource]:
        """Prepare to give frames."""
        prepared = self.holder.prepared(self.name, self.source, camera, note)
        yield prepared if self.seeded else _Unseeded(prepared)


@dataclass(frozen=True)
class _Unseeded:
    """A prepared source that is opened with one seed for all."""

    prepared: PreparedSource

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> OpenSource:
        """Return what gives frames along the paths."""
        return self.prepared.open(paths, replace(options, seed=0), note)
