# SPDX-License-Identifier: GPL-3.0-or-later
"""The source of a video file: colour alone, without depth, poses or, unless the preset gives it, a camera."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.known_poses import unposed
from ..core.datasets.layouts import Modality, OutputFormat
from ..core.datasets.storage import sha256_of_file
from ..core.datasets.video_files import VideoFile, VideoReader, read_video
from ..core.geometry import Intrinsics
from ..core.optics import PINHOLE, Optics
from ..core.planning.source import Gives, RenderOptions
from ..core.schema import Place
from ..core.trajectories.sensor_paths import Moment, SensorPaths
from ..core.trajectories.stamps import FrameStamps
from ..core.trajectories.trajectory import Axes, Trajectory

# Of the larger side: what COLMAP begins with (ImageReaderOptions::default_focal_length_factor).
FOCAL_LENGTH_FACTOR = 1.2


@dataclass(frozen=True)
class Video:
    """A video file."""

    video: VideoFile
    place: Place

    @property
    def location(self) -> str:
        """The file."""
        return str(self.video.path)

    @property
    def gives(self) -> Gives:
        """Recorded colour."""
        return Gives(rendered=False, any_pose=False, depth=False)

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the frames, as the file has them."""
        return self.video.stamps_s

    @property
    def frame_stamps(self) -> FrameStamps:
        """Those of colour."""
        return FrameStamps.of(self.video.stamps_s)

    @property
    def robot_axes(self) -> Axes | None:
        """None: a video has no rig."""
        return None

    def camera(self, asked: Intrinsics | None) -> Intrinsics:
        """Return the intrinsics asked for or, where none are, a guess. Raises InputError for another size."""
        wide, high = self.video.size_px
        if asked is None:
            focal_px = FOCAL_LENGTH_FACTOR * max(wide, high)
            return Intrinsics(wide, high, focal_px, focal_px, (wide - 1) / 2, (high - 1) / 2)
        if (asked.width_px, asked.height_px) != (wide, high):
            problem = (
                f"its frames are {wide} x {high}, but the preset's camera has {asked.width_px} x {asked.height_px}"
            )
            raise self.place.at("video").error(problem, "set camera to that, or leave it out")
        return asked

    def optics(self, camera: Intrinsics) -> Optics:
        """Return one pinhole."""
        del camera
        return PINHOLE

    def trajectory(self) -> Trajectory:
        """Return a path whose poses are not known."""
        return unposed(len(self.video)).at(slice(None), self.video.stamps_s)

    @property
    def mesh(self) -> None:
        """None: frames were recorded."""
        return None

    def hashes(self) -> dict[str, Any]:
        """Return the file's name and its hash."""
        return {"video": self.video.path.name, "video_sha256": sha256_of_file(self.video.path)}

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator["OpenVideo"]:
        """Prepare to read frames."""
        if camera == self.camera(None):
            note(
                "nothing says its camera: a guess is written, with a focal length of 1.2 times the larger side; "
                "camera says another"
            )
        opened = OpenVideo(VideoReader(self.video))
        try:
            yield opened
        finally:
            opened.reader.close()


def read_video_source(path: Path, place: Place) -> Video:
    """Find what a video holds. Raises InputError where it is none."""
    return Video(read_video(path), place)


@dataclass(frozen=True)
class OpenVideo:
    """A video that is ready to give frames."""

    reader: VideoReader

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> "OpenVideo":
        """Return itself: the file decides what its frames show."""
        del paths, options, note
        return self

    def frame(self, moment: Moment) -> "VideoFrame":
        """Return the frame of a moment, decoded at once: a video is read in its order."""
        return VideoFrame(self.reader.rgb(moment.index))


@dataclass(frozen=True)
class VideoFrame:
    """A frame of a video. rgb: (H, W, 3) uint8, RGB."""

    rgb: NDArray[np.uint8]
    depth_m: None = None

    def file_as(self, modality: Modality, written: OutputFormat) -> None:
        """Return None: no file holds one frame."""
        del modality, written
