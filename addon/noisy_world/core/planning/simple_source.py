# SPDX-License-Identifier: GPL-3.0-or-later
"""What most sources have in common, to begin one with; and one whose frames are computed one by one."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry import Intrinsics
from ..optics import PINHOLE, Optics
from ..scenes.mesh import Mesh
from ..trajectories.frame_request import FrameRequest
from ..trajectories.sensor_paths import SensorPaths
from ..trajectories.stamps import FrameStamps
from ..trajectories.trajectory import Axes, Trajectory
from .source import RenderedFrame, RenderOptions, SourceCapabilities


class SimpleSource(ABC):
    """A source whose camera is one pinhole, that takes colour, depth and pose at one moment, and that has no mesh."""

    @abstractmethod
    def trajectory(self) -> Trajectory:
        """Return the path."""

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the path's frames, seconds."""
        return self.trajectory().stamps_s

    @property
    def frame_stamps(self) -> FrameStamps:
        """Those of the path: colour, depth and pose are of one moment."""
        return self._frame_stamps

    @cached_property
    def _frame_stamps(self) -> FrameStamps:
        return FrameStamps.of(self.stamps_s)

    @property
    def robot_axes(self) -> Axes | None:
        """None: it knows of no rig."""
        return None

    def camera(self, asked: Intrinsics | None) -> Intrinsics | None:
        """Return the intrinsics asked for: it can be seen through any camera."""
        return asked

    def optics(self, camera: Intrinsics) -> Optics:
        """Return one pinhole."""
        del camera
        return PINHOLE

    @property
    def mesh(self) -> Callable[[], Mesh] | None:
        """None: its frames show no mesh that is known."""
        return None

    def remarks(self, camera: Intrinsics) -> Iterable[str]:
        """Return nothing that a user should know of its frames."""
        del camera
        return ()


class ComputedSource(SimpleSource):
    """A source that computes each frame by itself, from any pose: `location`, `trajectory`, `hashes` and `frame`."""

    capabilities = SourceCapabilities(rendered=False, any_pose=True)

    @property
    def robot_axes(self) -> Axes | None:
        """OpenCV's."""
        return "opencv"

    @abstractmethod
    def hashes(self) -> dict[str, Any]:
        """Return what decides the frames' bytes beside the keys of the preset: the SHA-256 of files, or nothing."""

    @abstractmethod
    def frame(self, request: FrameRequest, camera: Intrinsics) -> RenderedFrame:
        """Return colour as seen from `request.rgb_c2w`, and depth from `request.depth_c2w`, at `request.time_s`."""

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> "Iterator[OpenComputed]":
        """Prepare to compute frames; there is nothing to prepare."""
        del note
        yield OpenComputed(self, camera)


@dataclass(frozen=True)
class OpenComputed:
    """A computed source, seen through a camera."""

    source: ComputedSource
    camera: Intrinsics

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> "OpenComputed":
        """Return itself: each request says its pose."""
        del paths, options, note
        return self

    def frame(self, request: FrameRequest) -> RenderedFrame:
        """Return the frame of a request."""
        return self.source.frame(request, self.camera)
