# SPDX-License-Identifier: GPL-3.0-or-later
"""Source `video`: a video file's colour, and depth where a folder holds it."""

import hashlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import sha256_of_file
from ..core.errors import Message, Part, PresetKey
from ..core.frame_request import FrameRequest, SensorPaths
from ..core.geometry import Intrinsics
from ..core.schema import ConfigPath, key
from ..core.trajectory import Trajectory
from ..images.image_files import DepthFolder, WholeFile, read_depth_folder
from ..images.measured_depth import VOID_CHOICES, VOID_MEANING, MeasuredDepth, Void
from ..images.video_files import VideoFile, VideoReader, read_video
from ..layouts import Modality, OutputFormat
from ..layouts.layout import MILLIMETRES
from ..layouts.stored_recording import depth_scale_key, unposed
from ..preset.scene_keys import SceneKeys
from ..render.source import ColourAndDepth, RenderOptions, SimpleSource, Source, SourceCapabilities
from .scene_kinds import GUESSED, FileSource, Lack, SceneEntry, camera_or_guess, filled, located_path

RECORDED = "a video has nothing between its frames"


@dataclass(frozen=True, kw_only=True)
class VideoKeys(SceneKeys):
    """What a preset says of a video."""

    TOOLTIPS: ClassVar[dict[str, str]] = {
        "video": "A video that OpenCV reads, such as .mp4, .mov, .avi or .mkv",
        "depth": "Folder of the video's depth: a 16-bit PNG for each frame, in the order of their numbers",
        "depth_scale_per_m": "Steps a meter of the depth beside the video; 1000: millimeters",
    }

    video: str = key(
        "instead of sequence: a video file, relative to the preset; * allowed", identity="meaning", label="Video"
    )
    depth: str | None = key(
        "the folder of a video's depth, a 16-bit PNG for each frame in the order of their numbers, relative to the "
        "preset; * stands for what the * of video matched",
        default=None,
        identity="meaning",
        label="Depth",
    )
    depth_scale_per_m: float | None = depth_scale_key(
        "steps a metre of the depth beside a video; default 1000: millimetres"
    )
    void: Void = key(VOID_MEANING, default="unmeasured", choices=VOID_CHOICES)


@dataclass(frozen=True)
class Video(SimpleSource):
    """A video file. depth: None where there is colour alone."""

    video: VideoFile
    place: ConfigPath
    depth: DepthFolder | None = None
    void: Void = "unmeasured"

    @cached_property
    def _measured(self) -> MeasuredDepth | None:
        depth = self.depth
        return None if depth is None else MeasuredDepth(depth.folder, len(depth.files), depth.depth_m)

    @property
    def location(self) -> str:
        """The file."""
        return str(self.video.path)

    @property
    def capabilities(self) -> SourceCapabilities:
        """Recorded colour and, where there is any, depth."""
        return SourceCapabilities(
            rendered=False,
            any_pose=False,
            depth=self.depth is not None,
            instants_only=RECORDED,
            unmeasured_m=None if self.void == "sky" else self._measured,
        )

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the frames, as the file has them."""
        return self.video.stamps_s

    def camera(self, asked: Intrinsics | None) -> Intrinsics:
        """Return the intrinsics asked for or, where none are, a guess. Raises InputError for another size."""
        return camera_or_guess(asked, self.video.size_px, self.place.at("video"), "frames")

    def trajectory(self) -> Trajectory:
        """Return a path whose poses are not known."""
        return unposed(len(self.video)).at(slice(None), self.video.stamps_s)

    def hashes(self) -> dict[str, Any]:
        """Return the file's name and its hash; of depth the folder's name, the hash of all images, and the scale."""
        found = {"video": self.video.path.name, "video_sha256": sha256_of_file(self.video.path)}
        if self.depth is None:
            return found
        digests = "".join(sha256_of_file(file) or "" for file in self.depth.files)
        return {
            **found,
            "depth": self.depth.folder.name,
            "depth_sha256": hashlib.sha256(digests.encode()).hexdigest(),
            "depth_scale_per_m": self.depth.scale_per_m,
        }

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator["OpenVideo"]:
        """Prepare to read frames."""
        if self.video.note:
            note(self.video.note)
        if camera == self.camera(None):
            note(GUESSED)
        opened = OpenVideo(VideoReader(self.video), self.depth)
        try:
            yield opened
        finally:
            opened.reader.close()


def read_video_source(
    path: Path,
    place: ConfigPath,
    depth: Path | None = None,
    scale_per_m: float = MILLIMETRES,
    void: Void = "unmeasured",
) -> Video:
    """Find what a video holds. depth: the folder of its depth images, of scale_per_m steps a metre; None for no depth.
    void: what depth 0 means.

    Raises InputError where it is no video, or the images of depth are not those of its frames.
    """
    video = read_video(path)
    if depth is None:
        return Video(video, place)
    return Video(video, place, read_depth_folder(depth, scale_per_m, path, len(video), video.size_px), void)


@dataclass(frozen=True)
class OpenVideo:
    """A video that is ready to give frames."""

    reader: VideoReader
    depth: DepthFolder | None

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> "OpenVideo":
        """Return itself: the file decides what its frames show."""
        del paths, options, note
        return self

    def frame(self, request: FrameRequest) -> "VideoFrame":
        """Return the frame of a request, its colour decoded at once: a video is read in its order."""
        return VideoFrame(self.reader.rgb(request.frame), request.frame, self.depth)


@dataclass(frozen=True)
class VideoFrame(ColourAndDepth):
    """A frame of a video. rgb: (H, W, 3) uint8, RGB. index: its number. depth: where its depth is; None for nowhere."""

    rgb: NDArray[np.uint8]
    index: int
    depth: DepthFolder | None

    @property
    def depth_m(self) -> NDArray[np.float32] | None:
        """Planar depth (H, W) in metres, 0 = void; None without any. Raises InputError where its file is damaged."""
        return None if self.depth is None else self.depth.depth_m(self.index)

    def file_as(self, modality: Modality, written: OutputFormat) -> WholeFile | None:
        """Return depth's file if a dataset would write the same; None for colour, as no file holds one frame.

        Raises InputError where that file is damaged.
        """
        if modality != "depth" or self.depth is None or self.depth.scale_per_m != written.depth_scale_per_m:
            return None
        return self.depth.whole_file(self.index)


class VideoKind(FileSource[VideoKeys]):
    """A video file, with a folder of depth where there is one."""

    name = "video"
    order = 40
    label = "Video"
    meaning = "a video file; a folder beside it may hold its depth"
    keys = VideoKeys
    several = "videos"
    remedies: ClassVar[Mapping[Lack, Part]] = {"depth": Message("name the folder of its depth: ", PresetKey("depth"))}
    instead: ClassVar[Mapping[str, Part]] = {"trajectory": "leave it out: a video has no poses"}

    def check(self, keys: VideoKeys, place: ConfigPath) -> None:
        """Refuse a depth scale without depth."""
        if keys.depth is not None:
            return
        for name, given in (("depth_scale_per_m", keys.depth_scale_per_m is not None), ("void", keys.void == "sky")):
            if given:
                raise place.at(name).error("goes with depth of a video", "leave it out")

    def open_file(self, entry: SceneEntry[VideoKeys], name: str, path: Path, parts: tuple[str, ...]) -> Source:
        """Return the source of a file."""
        del name
        beside, where = None, entry.place.at("depth")
        if entry.keys.depth is not None:
            beside = located_path(entry.preset, where, filled(entry.keys.depth, parts, where), folder=True)
        return read_video_source(
            path, entry.place, beside, entry.keys.depth_scale_per_m or MILLIMETRES, entry.keys.void
        )


SOURCE = VideoKind()
