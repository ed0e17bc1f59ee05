# SPDX-License-Identifier: GPL-3.0-or-later
"""Where clean frames come from: what everything else knows of a mesh, of a recording, and of whatever is added.

Nothing outside a source asks which one it is. `noisy_world.sources` holds them.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ..datasets.layouts import Modality, OutputFormat
from ..geometry import Intrinsics
from ..schema import Place
from ..trajectories.sensor_paths import Moment, SensorPaths
from ..trajectories.trajectory import Axes, Trajectory


class SourceFrame(Protocol):
    """A clean frame. What was not asked for is None."""

    @property
    def rgb(self) -> NDArray[np.float32] | NDArray[np.uint8] | None:
        """Colour (H, W, 3), float32 in [0, 1] or uint8; RGB, sRGB-encoded."""
        ...

    @property
    def depth_m(self) -> NDArray[np.float32] | None:
        """Planar depth (H, W) in metres; 0 = void."""
        ...

    def file_as(self, modality: Modality, written: OutputFormat) -> Path | None:
        """Return the file that holds an image just as a dataset would write it, where there is one already."""
        ...


@dataclass(frozen=True)
class Gives:
    """What a source can give.

    rendered: its frames come from a renderer, which takes time and Blender. any_pose: it can be seen from anywhere, and
    not only from where it was recorded.
    """

    rendered: bool
    any_pose: bool


@dataclass(frozen=True)
class RenderOptions:
    """How frames are rendered, by sources that render. threads 0: as many as the machine has."""

    near_m: float
    far_m: float
    samples: int
    seed: int
    engine: Literal["cycles", "eevee", "workbench"] = "cycles"
    device: Literal["cpu", "gpu"] = "cpu"
    rgb: bool = True
    depth: bool = True
    threads: int = 0


class OpenSource(Protocol):
    """A source that gives frames."""

    def frame(self, moment: Moment) -> SourceFrame:
        """Return the frame of a moment."""
        ...


class Source(Protocol):
    """Where the clean frames of a scene come from."""

    @property
    def location(self) -> str:
        """The file or folder, or the name of what is embedded, for people."""
        ...

    @property
    def gives(self) -> Gives:
        """What it can give."""
        ...

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the path's frames, seconds; known before the path is."""
        ...

    @property
    def robot_axes(self) -> Axes | None:
        """The axes that the path's poses were declared in, and a rig's extrinsics refer to; None without."""
        ...

    def camera(self, asked: Intrinsics) -> Intrinsics:
        """Return the intrinsics of its frames, given those that are asked for.

        Raises InputError where it cannot give them.
        """
        ...

    def trajectory(self) -> Trajectory:
        """Return the path of the camera, or of the robot that carries it. Made once; it may take seconds."""
        ...

    def hashes(self) -> dict[str, Any]:
        """Return what decides the frames' bytes: names as people gave them, and SHA-256 of the files."""
        ...

    def open(
        self, paths: SensorPaths, camera: Intrinsics, options: RenderOptions, note: Callable[[str], None]
    ) -> AbstractContextManager[OpenSource]:
        """Make ready to give frames along the paths. note: is told what a user should know of what was found."""
        ...


@dataclass(frozen=True)
class Scene:
    """A scene of a preset: its name in the dataset, where the preset speaks of it, and where its frames come from."""

    name: str
    place: Place
    source: Source

    @property
    def frame_count(self) -> int:
        """How many frames its path has."""
        return len(self.source.stamps_s)
