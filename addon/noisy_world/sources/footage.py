# SPDX-License-Identifier: GPL-3.0-or-later
"""Footage without recorded poses: a video file, or a folder of plain images in the order of their names."""

import hashlib
import itertools
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import sha256_of_file
from ..core.errors import InputError
from ..core.frame_request import FrameRequest, SensorPaths
from ..core.geometry import Intrinsics
from ..core.schema import ConfigPath
from ..core.trajectory import FrameStamps, Trajectory
from ..images.image_files import WholeFile, check_whole, read_header
from ..images.image_reading import DepthFolder, check_size_px, read_colour, read_depth_folder
from ..images.measured_depth import MeasuredDepth, Void
from ..images.video_files import VideoFile, VideoReader, read_video
from ..layouts import Modality, OutputFormat
from ..layouts.association import unposed
from ..layouts.layout import MILLIMETRES, counted_note
from ..layouts.stored_recording import RATE_HZ, StoredSequence
from ..render.source import ColourAndDepth, RenderOptions, SimpleSource, SourceCapabilities

# The camera of images that nothing says one of: a guess, or the one that the preset gives.


# Of the larger side: what COLMAP begins with (ImageReaderOptions::default_focal_length_factor).
FOCAL_LENGTH_FACTOR = 1.2
GUESSED = (
    "nothing says its camera: a guess is written, with a focal length of 1.2 times the larger side; camera says another"
)


def given_or_guessed(asked: Intrinsics | None, size_px: tuple[int, int], place: ConfigPath, what: str) -> Intrinsics:
    """Return the intrinsics asked for or, where none are, a guess.

    place: the key of the source. what: the word for its images. Raises InputError where another size is asked for.
    """
    wide, high = size_px
    if asked is None:
        focal_px = FOCAL_LENGTH_FACTOR * max(wide, high)
        return Intrinsics(wide, high, focal_px, focal_px, (wide - 1) / 2, (high - 1) / 2)
    if (asked.width_px, asked.height_px) != size_px:
        problem = f"its {what} are {wide} x {high}, but the preset's camera has {asked.width_px} x {asked.height_px}"
        raise place.error(problem, "set camera to that, or leave it out")
    return asked


READ = (".png", ".jpg", ".jpeg")
OTHERS = (".exr", ".tif", ".tiff", ".dpx", ".tga", ".webp", ".bmp", ".hdr", ".jp2", ".gif", ".heic")  # told, not read
RECORDED = "plain images have nothing between them"
NO_SCALE = 1.0  # steps a metre of depth that is not there


@dataclass(frozen=True)
class Images(SimpleSource):
    """The images of a folder."""

    stored: StoredSequence
    place: ConfigPath

    @property
    def location(self) -> str:
        """The folder."""
        return str(self.stored.folder)

    @property
    def capabilities(self) -> SourceCapabilities:
        """Colour alone."""
        return SourceCapabilities(rendered=False, any_pose=False, depth=False, instants_only=RECORDED)

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the images, counted by the rate."""
        return self.stored.stamps.rgb.seconds

    def camera(self, asked: Intrinsics | None) -> Intrinsics:
        """Return the intrinsics asked for or, where none are, a guess. Raises InputError for another size."""
        self.stored.check_images()
        return given_or_guessed(asked, self.stored.size_px, self.place.at("sequence"), "images")

    def trajectory(self) -> Trajectory:
        """Return a path whose poses are not known."""
        return self.stored.trajectory

    def hashes(self) -> dict[str, Any]:
        """Return the folder's name, the hash of all images in their order, and the rate."""
        digests = "".join(sha256_of_file(file) or "" for file in self.stored.files)
        return {
            "sequence": self.stored.folder.name,
            "sequence_sha256": hashlib.sha256(digests.encode()).hexdigest(),
            "rate_hz": self.stored.counted_hz,
        }

    @contextmanager
    def prepare(self, camera: Intrinsics, note: Callable[[str], None]) -> Iterator["OpenImages"]:
        """Prepare to read images."""
        for text in (*self.stored.notes, *self.stored.image_notes):
            note(text)
        if camera == self.camera(None):
            note(GUESSED)
        yield OpenImages(self.stored)


def read_images(folder: Path, place: ConfigPath, rate_hz: float | None = None) -> Images:
    """Find the images of a folder; numbers in their names count as numbers.

    rate_hz: images a second; None for 20. Raises InputError where there are none, or two have one name.
    """
    files = _files(folder)
    used_hz = rate_hz or RATE_HZ
    stamps_s = np.arange(len(files)) / used_hz
    stored = StoredSequence(
        folder=folder,
        rgb_files=files,
        depth_files=(),
        trajectory_path=None,
        trajectory=unposed(len(files)).at(slice(None), stamps_s),
        stamps=FrameStamps.of(stamps_s),
        depth_scale_per_m=NO_SCALE,
        notes=counted_note(rate_hz, used_hz),
        counted_hz=used_hz,
    )
    return Images(stored, place)


def holds_images(folder: Path) -> bool:
    """Tell whether PNG or JPEG images lie in a folder itself."""
    return folder.is_dir() and any(path.suffix.lower() in READ for path in folder.iterdir())


def _files(folder: Path) -> tuple[Path, ...]:
    try:
        there = [path for path in folder.iterdir() if not path.name.startswith(".")]
    except OSError as error:
        raise InputError(folder, f"cannot be read: {error.strerror or error}") from None
    found = sorted((path for path in there if path.suffix.lower() in READ), key=_in_order)
    if not found:
        others = sorted({path.suffix.lower() for path in there} & set(OTHERS))
        problem = f"has images of {', '.join(others)}, but no PNG or JPEG" if others else "has no PNG or JPEG images"
        raise InputError(folder, problem, remedy="convert them" if others else "")
    for one, other in itertools.pairwise(found):
        if _in_order(one) == _in_order(other):
            problem = f"{one.name} and {other.name} stand for one place in the order of names"
            raise InputError(folder, problem, remedy="keep one of them")
    return tuple(found)


def _in_order(path: Path) -> list[tuple[int, int, str]]:
    """Return what a file's name is ordered by, without its suffix: numbers by value, letters whatever their case."""
    parts = re.findall(r"[0-9]+|[^0-9]+", path.stem.casefold())
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]


@dataclass(frozen=True)
class OpenImages:
    """A folder that is ready to give frames."""

    stored: StoredSequence

    def open(self, paths: SensorPaths, options: RenderOptions, note: Callable[[str], None]) -> "OpenImages":
        """Return itself: the files decide what its frames show."""
        del paths, options, note
        return self

    def frame(self, request: FrameRequest) -> "ImageFrame":
        """Return the frame of a request, which is read on request."""
        return ImageFrame(self.stored.rgb_files[request.frame], self.stored.size_px)


@dataclass(frozen=True)
class ImageFrame(ColourAndDepth):
    """An image on disk. size_px: that it has to have."""

    file: Path
    size_px: tuple[int, int]

    @property
    def rgb(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB, sRGB-encoded: uint8, or float32 in [0, 1] where the file has 16 bits.

        Raises InputError where the file is damaged, or no image.
        """
        return read_colour(self.file, self.size_px)

    @property
    def depth_m(self) -> None:
        """None: there is no depth."""
        return None

    def file_as(self, modality: Modality, written: OutputFormat) -> WholeFile | None:
        """Return the image's file if a dataset would write the same: equal kind and colours.

        Raises InputError where that file is damaged.
        """
        if modality != "rgb":
            return None
        header = read_header(self.file)
        if (header.kind, header.plainly) != (written.image, written.colour):
            return None
        whole, digest = check_whole(self.file)
        check_size_px(self.file, whole, self.size_px)
        return WholeFile(self.file, digest)


# A video file: colour, and depth where a folder holds it; a camera where the preset gives it.


VIDEO_SOURCE_RECORDED = "a video has nothing between its frames"


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
            instants_only=VIDEO_SOURCE_RECORDED,
            unmeasured_m=None if self.void == "sky" else self._measured,
        )

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """Time stamps (N,) of the frames, as the file has them."""
        return self.video.stamps_s

    def camera(self, asked: Intrinsics | None) -> Intrinsics:
        """Return the intrinsics asked for or, where none are, a guess. Raises InputError for another size."""
        return given_or_guessed(asked, self.video.size_px, self.place.at("video"), "frames")

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
