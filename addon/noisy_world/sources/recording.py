# SPDX-License-Identifier: GPL-3.0-or-later
"""The source of a recording: a sequence on disk, whose frames are read."""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.layouts import Modality, OutputFormat
from ..core.datasets.storage import sha256_of_file
from ..core.datasets.stored import StoredFrame, StoredSequence
from ..core.geometry import Intrinsics
from ..core.planning.source import Gives, RenderOptions
from ..core.schema import Place
from ..core.trajectories.sensor_paths import Moment, SensorPaths
from ..core.trajectories.trajectory import Axes, Trajectory

INTRINSICS_TOLERANCE_PX = 1e-3  # chosen: people round to about as many digits when they copy intrinsics


@dataclass(frozen=True)
class Recording:
    """A sequence on disk in one of the layouts."""

    stored: StoredSequence
    place: Place

    @property
    def location(self) -> str:
        """The folder."""
        return str(self.stored.folder)

    @property
    def gives(self) -> Gives:
        """Frames from the recorded poses, not rendered."""
        return Gives(rendered=False, any_pose=False)

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the frames."""
        return self.stored.trajectory.stamps_s

    @property
    def robot_axes(self) -> Axes | None:
        """None: a recording has no rig."""
        return None

    def camera(self, asked: Intrinsics) -> Intrinsics:
        """Return the intrinsics asked for. Raises InputError where the recording's own are known and differ."""
        wide, high = self.stored.size_px
        if (wide, high) != (asked.width_px, asked.height_px):
            remedy = f"set camera to that; it has {asked.width_px} x {asked.height_px}"
            raise self.place.at("sequence").error(f"its images are {wide} x {high}", remedy)
        told = self.stored.camera
        if told is not None and np.abs(_intrinsics_px(told) - _intrinsics_px(asked)).max() > INTRINSICS_TOLERANCE_PX:
            values = f"fx {told.fx_px:g}, fy {told.fy_px:g}, cx {told.cx_px:g}, cy {told.cy_px:g}"
            raise self.place.at("sequence").error(f"its camera has {values}", "set camera to these; it has others")
        return asked

    def trajectory(self) -> Trajectory:
        """Return its ground truth."""
        return self.stored.trajectory

    def hashes(self) -> dict[str, Any]:
        """Return the folder's name and the hashes of the ground truth and of all images together."""
        path = self.stored.trajectory_path
        digests = "".join(sha256_of_file(file) or "" for file in self.stored.files)
        return {
            "sequence": self.stored.folder.name,
            "sequence_sha256": hashlib.sha256(digests.encode()).hexdigest(),
            "trajectory": path.name,
            "trajectory_sha256": sha256_of_file(path),
        }

    @contextmanager
    def open(
        self, paths: SensorPaths, camera: Intrinsics, options: RenderOptions, note: Callable[[str], None]
    ) -> Iterator["OpenRecording"]:
        """Prepare to read frames."""
        del paths, camera, options, note  # the files decide all of it
        yield OpenRecording(self.stored)


def _intrinsics_px(camera: Intrinsics) -> NDArray[np.float64]:
    return np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px])


@dataclass(frozen=True)
class OpenRecording:
    """A recording that is ready to give frames."""

    stored: StoredSequence

    def frame(self, moment: Moment) -> "RecordedFrame":
        """Return the frame of a moment; its images are read on request."""
        return RecordedFrame(self.stored.frame(moment.index))


@dataclass(frozen=True)
class RecordedFrame:
    """A frame on disk."""

    stored: StoredFrame

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), RGB, sRGB-encoded. Raises InputError where the file is no image."""
        return self.stored.rgb

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void. Raises InputError where the file is no 16-bit image."""
        return self.stored.depth_m

    def file_as(self, modality: Modality, written: OutputFormat) -> Path | None:
        """Return an image's file if a dataset would write the same: equal image kind, colours and depth scale."""
        stored = self.stored
        if modality == "rgb":
            same = stored.rgb_file.suffix == f".{written.image}" and stored.colour == written.colour
            return stored.rgb_file if same else None
        same = stored.depth_file.suffix == ".png" and stored.depth_scale_per_m == written.depth_scale_per_m
        return stored.depth_file if same else None
