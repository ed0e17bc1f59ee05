# SPDX-License-Identifier: GPL-3.0-or-later
"""What a dataset layout is: one that is written and read, or read alone."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS, COLOUR_AND_DEPTH
from ..channels.channel import FileKind
from ..core.depth_range import Beyond, DepthRange, OutOfRange
from ..core.errors import InputError, Message, PresetKey
from ..core.frame_request import SensorPaths
from ..core.geometry import Intrinsics
from ..core.lens import PINHOLE, Distortion, Optics
from ..core.packages import LAST
from ..core.trajectory import FrameStamps, Stamps, Trajectory
from ..images.pixels import (
    UINT16_MAX,
    as_bytes,
    encode_colour,
    encode_light,
    encode_png,
    grey_bytes,
    out_of_range,
    quantise_depth,
)
from ..trajectories.pose_files import read_text, text_rows
from ..trajectories.rig import ImuSamples, Rig
from .stored_recording import PosePolicy, StoredSequence, associate, checked_intrinsics, size_of

Modality: TypeAlias = str
"""The name of a channel, as in `output.modalities`."""

Image = Literal["jpg", "png", "exr"]
Colour = Literal["rgb", "grey"]
StampsLike: TypeAlias = FrameStamps | Sequence[float] | NDArray[np.float64]
"""The stamps of a path's frames; as seconds (N,) where colour, depth and poses have the same."""

IMU_FILES = ("imu.csv", "imu.yaml", "imu_states.csv")
"""An IMU's files in a sequence's folder: its samples, what it is, its true states."""

_SPOKEN: dict[Image, str] = {"jpg": "JPEG", "png": "PNG", "exr": "EXR"}


class Layout(ABC):
    """How a dataset lies on disk: the names of its files, the text files beside the images, and how it is read.

    name: in presets. order: in lists, ours first. label, meaning: for people. images: the image kinds that colour may
    be stored as. colours: "rgb", "grey" or both. The first of each is the default. depth_scale_per_m: steps of the
    depth images per metre, unless a preset gives another. conventions: those that differ from the manifest's for all
    layouts. rgb_file, depth_file: the names of the images, of {frame:06d}, {frame} or {stamp_ns:019d} and, of colour's
    kind, {image}; a layout may override rgb_name and depth_name instead. patterns: glob patterns of all other files
    that a sequence's folder may hold. setting_files: the names of those that a setting's folder may hold. These say
    what to remove when a dataset is replaced. gaps: whether frames may lack a pose. optics: whether its files can say
    that depth has a camera of its own, and how a lens distorts. lists_depth: whether each depth image stands in a list
    under a time stamp of its own. holds_imu: whether sequence_texts has an IMU's files; else they lie beside the images
    (IMU_FILES).

    All names have forward slashes and are relative to the sequence's (or setting's) folder.
    """

    name: ClassVar[str]
    order: ClassVar[int] = LAST
    label: ClassVar[str]
    meaning: ClassVar[str]
    images: ClassVar[tuple[Image, ...]]
    colours: ClassVar[tuple[Colour, ...]]
    depth_scale_per_m: ClassVar[float]
    conventions: ClassVar[dict[str, str]] = {}
    rgb_file: ClassVar[str] = ""
    depth_file: ClassVar[str] = ""
    patterns: ClassVar[tuple[str, ...]]
    setting_files: ClassVar[tuple[str, ...]] = ()
    gaps: ClassVar[bool] = True
    optics: ClassVar[bool] = False
    holds_imu: ClassVar[bool] = False
    lists_depth: ClassVar[bool] = False

    @property
    def summary(self) -> str:
        """A sentence on what the layout is and which images it takes."""
        *first, last = (_SPOKEN[kind] for kind in self.images)
        kinds = f"{', '.join(first)} or {last}" if first else last
        return f"{self.meaning[0].upper()}{self.meaning[1:]}; {kinds}"

    def rgb_name(self, frame: int, stamp_ns: int, image: Image) -> str:
        """Return the name of a frame's colour image; stamp_ns: when it was taken, nanoseconds."""
        return self.rgb_file.format(frame=frame, stamp_ns=stamp_ns, image=image)

    def depth_name(self, frame: int, stamp_ns: int) -> str:
        """Return the name of a frame's depth image; stamp_ns: when it was taken, nanoseconds."""
        return self.depth_file.format(frame=frame, stamp_ns=stamp_ns)

    def channel_name(self, channel: str, frame: int, stamps: FrameStamps, suffix: str) -> str:
        """Return the name of an image of a channel that the layout knows nothing of: a folder of the channel's name."""
        del stamps
        return f"{channel}/{frame:06d}.{suffix}"

    def channel_patterns(self, channel: str) -> tuple[str, ...]:
        """Return glob patterns of all files of such a channel."""
        return (*numbered(f"{channel}/{{}}.*"), f"{channel}.json")

    @property
    def all_patterns(self) -> tuple[str, ...]:
        """Glob patterns of all files that a sequence's folder may hold, those of other channels too."""
        others = [name for name in CHANNELS if name not in COLOUR_AND_DEPTH]
        channels = (pattern for name in others for pattern in self.channel_patterns(name))
        images = (pattern for name in (self.rgb_file, self.depth_file) for pattern in _patterns_of(name, self.images))
        return (*images, *self.patterns, *IMU_FILES, *channels)

    def image_note(self, image: Image) -> str:
        """Return a sentence on who does not find colour images of this kind, or ""."""
        del image
        return ""

    def says_lens(self, lens: Distortion) -> bool:
        """Tell whether its files can say how a lens distorts."""
        del lens
        return self.optics

    def stamps_problem(self, stamps: StampsLike) -> str:
        """Return why frames with these stamps cannot be written, or "" where they can."""
        del stamps
        return ""

    @abstractmethod
    def sequence_texts(self, facts: "SequenceFacts") -> dict[str, str]:
        """Return the text files of a sequence by name."""

    def setting_texts(self, camera: Intrinsics, depth_scale_per_m: float, optics: Optics = PINHOLE) -> dict[str, str]:
        """Return the text files of a setting by name; of a sequence, where the scenes' cameras differ."""
        del camera, depth_scale_per_m, optics
        return {}

    @abstractmethod
    def recognises(self, folder: Path) -> bool:
        """Tell whether a folder looks like a sequence of this layout."""

    @abstractmethod
    def written_poses(self, folder: Path, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the colour camera's poses (N, 4, 4), c2w, by the text files written beside a sequence's images.

        time_s (N,): when the colour of its frames was taken. Raises InputError where the files do not tell them.
        """

    @abstractmethod
    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Find the files of a sequence. rate_hz: of the frames, where the sequence has no stamps; None for RATE_HZ.

        poses: what becomes of frames without a pose. Raises InputError where files are missing, wrong or do not match.
        """


@dataclass(frozen=True)
class OutputFormat:
    """The format that a dataset is written in: its layout and what a preset may choose besides.

    modalities: the channels that are written, by name. depth_scale_per_m: steps of the 16-bit depth images per metre.
    depth_beyond: what depth becomes that 16 bits cannot hold: void (0), or the farthest depth that they hold. formats:
    what other channels than colour are stored as, by name, where that is not their default.
    """

    layout: Layout
    image: Image
    colour: Colour
    modalities: tuple[Modality, ...]
    depth_scale_per_m: float
    depth_beyond: Beyond = "void"
    formats: tuple[tuple[Modality, FileKind], ...] = ()

    @property
    def of_light(self) -> bool:
        """Whether colour is stored as scene-linear light, before a view transform."""
        return self.image == "exr" and "rgb" in self.modalities

    @property
    def depth_limit_m(self) -> float:
        """The largest depth that 16 bits hold."""
        return UINT16_MAX / self.depth_scale_per_m

    @property
    def folders(self) -> set[str]:
        """The folders of a sequence that hold its images."""
        return {str(PurePosixPath(name).parent) for name in self.names([0.0]).of(0)}

    @property
    def note(self) -> str:
        """A sentence on what readers of the layout will not find; "" where they find all."""
        return self.layout.image_note(self.image) if "rgb" in self.modalities else ""

    @property
    def depth_range(self) -> DepthRange:
        """The range of its depth images, for sentences on what lies beyond it."""
        return DepthRange(self.depth_scale_per_m, self.depth_beyond)

    def names(self, stamps: StampsLike) -> "FrameNames":
        """Return the names of the images of a sequence whose i-th frame has the i-th time stamps."""
        return FrameNames(self, FrameStamps.of(stamps))

    def setting_texts(self, camera: Intrinsics, optics: Optics = PINHOLE) -> dict[str, str]:
        """Return the text files of a setting by name; of a sequence, where the scenes' cameras differ."""
        return self.layout.setting_texts(camera, self.depth_scale_per_m, optics)

    def encode_rgb(self, rgb: NDArray[Any], *, fit_tables: bool = True) -> bytes:
        """Encode (H, W, 3) RGB, sRGB-encoded, uint8 or float32 in [0, 1], as a colour image of the dataset.

        Where that is an EXR: scene-linear light, float32. fit_tables: see `encode_colour`.
        """
        if self.image == "exr":
            return encode_light(rgb)
        pixels = grey_bytes(rgb) if self.colour == "grey" else as_bytes(rgb)
        return encode_colour(pixels, self.image, fit_tables=fit_tables)

    def stored_rgb(self, rgb: NDArray[Any]) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Return colour (H, W, 3) as an image of the dataset holds it where nothing is lost; grey in each channel.

        Light, float32, where that is an EXR.
        """
        if self.image == "exr":
            return CHANNELS["rgb"].stored(rgb, self.image)
        return np.repeat(grey_bytes(rgb)[..., None], 3, axis=-1) if self.colour == "grey" else as_bytes(rgb)

    def encode_depth(self, depth_m: NDArray[np.float32]) -> bytes:
        """Encode planar depth (H, W) in metres, 0 = void, as a depth image of the dataset."""
        return encode_png(quantise_depth(depth_m, self.depth_scale_per_m, self.depth_beyond))

    def out_of_range(self, depth_m: NDArray[np.float32]) -> OutOfRange | None:
        """Count the pixels whose depth a depth image of the dataset cannot hold; None where it holds all."""
        return out_of_range(depth_m, self.depth_scale_per_m)

    def stored_depth_m(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return planar depth (H, W) in metres, 0 = void, as it is read back from a depth image of the dataset."""
        steps = quantise_depth(depth_m, self.depth_scale_per_m, self.depth_beyond)
        return (steps / np.float64(self.depth_scale_per_m)).astype(np.float32)


@dataclass(frozen=True, eq=False)
class FrameNames:
    """The names of the images of a sequence's frames, inside its folder."""

    format: OutputFormat
    stamps: FrameStamps

    def rgb(self, frame: int) -> str:
        """Return the name of a frame's colour image."""
        return self.format.layout.rgb_name(frame, self.stamps.rgb.ns[frame], self.format.image)

    def depth(self, frame: int) -> str:
        """Return the name of a frame's depth image."""
        return self.format.layout.depth_name(frame, self.stamps.depth.ns[frame])

    def image(self, modality: Modality, frame: int) -> str:
        """Return the name of a frame's image of a channel."""
        found = CHANNELS[modality]
        return found.name_in(self.format.layout, frame, self.stamps, found.suffix(self.format))

    def of(self, frame: int) -> set[str]:
        """Return the names of a frame's images, one for each modality of the dataset."""
        return {self.image(modality, frame) for modality in self.format.modalities}


@dataclass(frozen=True, eq=False)
class SequenceFacts:
    """The content of a sequence's text files.

    frames: the numbers of the frames that exist. paths: of the whole sequence; frame i has the i-th pose.
    rig: the sensors' poses on the robot; None where there is no rig. stamps: frame i has the i-th; None where colour,
    depth and poses have those of the paths. optics: what the cameras have beyond one pinhole. imu: what the rig's IMU
    measured along the whole path, whichever frames exist. exposures_s: how long the colour of the frames that exist was
    exposed, NaN where nobody knows; None where that holds for all.
    """

    format: OutputFormat
    camera: Intrinsics
    rig: Rig | None
    frames: tuple[int, ...]
    paths: SensorPaths
    stamps: FrameStamps | None = None
    optics: Optics = PINHOLE
    imu: ImuSamples | None = None
    exposures_s: NDArray[np.float64] | None = None

    @cached_property
    def chosen(self) -> SensorPaths:
        """The paths of the frames that exist, in the order of the frames."""
        rows = list(self.frames)
        return self.paths.each(lambda path: path.at(rows, path.stamps_s[rows]))

    @cached_property
    def taken(self) -> FrameStamps:
        """When colour, depth and pose of the frames that exist were taken."""
        return self._stamps.take(self.frames)

    @cached_property
    def timed(self) -> tuple[SensorPaths, Stamps] | None:
        """The known poses of the frames that exist, in the order of the poses' own stamps, and these.

        None where no pose is known.
        """
        order = np.argsort(self.taken.pose.seconds, kind="stable")
        order = order[self.chosen.rgb.known[order]]
        if not order.size:
            return None
        stamps = self.taken.pose.take(order)
        return self.chosen.each(lambda path: path.at(order, stamps.seconds)), stamps

    @property
    def frames_ns(self) -> NDArray[np.int64]:
        """(N,): when the poses of the frames that exist were taken, nanoseconds."""
        return np.array(self.taken.pose.ns, dtype=np.int64)

    @property
    def names(self) -> FrameNames:
        """The names of the images."""
        return self.format.names(self._stamps)

    @property
    def _stamps(self) -> FrameStamps:
        return FrameStamps.of(self.paths.rgb.stamps_s) if self.stamps is None else self.stamps


PATH_SUFFIXES = ("", "_depth", "_robot", "_nominal")


def poses_at(path: Trajectory, time_s: NDArray[np.float64], file: Path) -> NDArray[np.float64]:
    """Return the poses (N, 4, 4) of a path that belong to frames taken at time_s (N,), by their time stamps.

    Raises InputError, which names the file, where a frame has none.
    """
    frames, rows = associate(time_s, path.stamps_s)
    if len(frames) != len(time_s):
        raise InputError(file, f"has poses for {len(frames)} of {len(time_s)} frames, by their time stamps")
    return path.c2w[rows]


def path_suffix(name: str) -> str:
    """Return the suffix in the name of a path's file: "" for the colour camera's, "_robot" for the robot's."""
    return "" if name == "rgb" else f"_{name}"


def numbered(name: str) -> tuple[str, ...]:
    """Return glob patterns of files named after their frame's number, of 6 digits or 7, which replaces {} in `name`."""
    return tuple(name.format("[0-9]" * digits) for digits in (6, 7))


_DIGITS = {"{frame:06d}": (6, 7), "{frame}": range(1, 8), "{stamp_ns:019d}": (19,)}


def _patterns_of(name: str, images: Sequence[Image]) -> Iterator[str]:
    """Yield glob patterns of the files whose names a layout describes."""
    for image in images if "{image}" in name else ("",):
        for field, counts in _DIGITS.items():
            if field in name:
                yield from (name.replace(field, "[0-9]" * count).replace("{image}", image) for count in counts)


def lines(rows: Sequence[str]) -> str:
    """Return the rows as text, each ended by a line feed."""
    return "".join(f"{row}\n" for row in rows)


# Base class of layouts that are only read: datasets and recorders of others.


MILLIMETRES = 1000.0  # steps per metre of depth in millimetres
# Three lines of three numbers: 3DMatch and tsdf-fusion have the first (data/camera-intrinsics.txt), SceneNN the second.
MATRIX_FILES = ("camera-intrinsics.txt", "intrinsic.txt")
RECORDED_HZ = 30.0  # the rate of Kinect, PrimeSense, Structure and RealSense, where a recording says no time


class RecordedLayout(ABC):
    """How recordings of others lie on disk.

    name: for messages and lists. label, meaning: for people. files: how it is told, in words. shortly: its files in a
    word or two.
    """

    name: ClassVar[str]
    order: ClassVar[int] = LAST
    label: ClassVar[str]
    meaning: ClassVar[str]
    files: ClassVar[str]

    @abstractmethod
    def recognises(self, folder: Path) -> bool:
        """Tell whether a folder looks like a recording of this layout."""

    @abstractmethod
    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Find the files of a recording. rate_hz: of its frames, where no file says their times; None for its usual.

        poses: what becomes of frames without a pose. Raises InputError where files are missing, wrong or do not match.
        """


def counted_note(rate_hz: float | None, used_hz: float) -> tuple[str, ...]:
    """Return a note that the frames' times are counted, unless the user has said the rate."""
    message = Message(f"no file says time stamps: {used_hz:g} frames a second, or ", PresetKey("rate_hz"))
    return () if rate_hz else (message,)


def stated_camera(folder: Path, image: Path) -> tuple[Intrinsics, Path] | None:
    """Return the camera that a file of a matrix says, in a recording's folder or above it, and that file; or None.

    image: one of the colour images. Raises InputError where the file is no matrix of intrinsics.
    """
    places = [parent / name for parent in (folder, folder.parent) for name in MATRIX_FILES]
    path = next((path for path in places if path.is_file()), None)
    if path is None:
        return None
    rows = text_rows(path, read_text(path))
    if rows.widths.tolist() != [3, 3, 3]:
        raise InputError(path, "is no matrix of three lines of three numbers", remedy="mend it, or take it away")
    return intrinsics_of_matrix(path, rows.numbers.reshape(3, 3), size_of(image)), path


def intrinsics_of_matrix(path: Path, matrix: NDArray[np.float64], size_px: tuple[int, int]) -> Intrinsics:
    """Return a camera of a matrix (3, 3) or larger: fx 0 cx / 0 fy cy / 0 0 1. Raises InputError for another kind."""
    rest = matrix.copy()
    for row, column in ((0, 0), (1, 1), (0, 2), (1, 2)):
        rest[row, column] = float(row == column)
    if not np.array_equal(rest, np.eye(len(matrix))):
        remedy = "a pinhole's matrix is fx 0 cx, 0 fy cy, 0 0 1, without skew"
        raise InputError(path, "is no matrix of intrinsics", remedy=remedy)
    values = (size_px[0], size_px[1], matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    return checked_intrinsics(path, ("width", "height", "fx", "fy", "cx", "cy"), tuple(map(float, values)))
