# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings that are described file by file: by a preset, or by a layout of recordings that all lie alike.

A `SequenceSpec` says where the images, poses, times and intrinsics are. Images of colour and depth belong together by
what the * of their patterns stand for, or by their times.
"""

import glob
import itertools
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.lens import DepthCamera, Optics
from ..core.schema import ConfigPath, key, key_of, quoted
from ..core.trajectory import FrameStamps, Stamps, Trajectory
from ..images.image_files import read_header
from ..trajectories.formats import (
    PoseAxes,
    PoseDirection,
    PoseKeys,
    StampUnits,
    read_file_poses,
    read_trajectory_file,
    upright_poses,
)
from ..trajectories.pose_files import PER_SECOND, text_rows
from ..trajectories.pose_files import read_text as read_numbers
from .asl import imu_beside
from .cam_params import read_camera_file
from .layout import MILLIMETRES, RECORDED_HZ, RecordedLayout, counted_note, intrinsics_of_matrix
from .numbered import LARGEST_NUMBER, Cameras
from .stored_recording import (
    PAIRING_S,
    MatchedFrames,
    PosePolicy,
    SizePx,
    StampedFiles,
    StoredSequence,
    associate,
    associate_frames,
    checked_intrinsics,
    chosen_by_pose,
    depth_scale_key,
    recorded_text,
    size_of,
    truth_file,
)

_FILES = "a pattern of file names in the folder, such as image_left/*.png"
_LEAST_NS = 1e17  # as files of poses: 1973 in nanoseconds since 1970
_HALF_PX = 0.5

Key: TypeAlias = tuple[tuple[int, int, str], ...]
"""What a name is ordered and paired by: its numbers by value, its letters whatever their case."""

PosesByNumber: TypeAlias = Mapping[int, NDArray[np.float64]]
"""Poses (4, 4), c2w in OpenCV's axes, by the numbers in the names of the images."""


# --- what is said of a recording ---


BAG_SUFFIXES = (".bag", ".mcap", ".db3")
"""Of bags of ROS 1, in MCAP and in SQLite."""


@dataclass(frozen=True)
class BagTopics:
    """The topics that are asked for, "none" for no such thing, None to find one. body: the frame of poses."""

    rgb: str | None = None
    depth: str | None = None
    imu: str | None = None
    poses: str | None = None
    intrinsics: str | None = None
    body: str | None = None


@dataclass(frozen=True)
class ImageFilesSpec:
    """Where the images of one kind are; a bare text is their files."""

    SHORTHAND: ClassVar[str] = "files"

    files: str | None = key(
        f"{_FILES}; what * stands for pairs an image of colour with its depth, and numbers count as numbers",
        default=None,
        identity="meaning",
    )
    list: str | None = key(
        "instead of files: a file with a time stamp and a file name on each line, as TUM's rgb.txt",
        default=None,
        identity="meaning",
    )


@dataclass(frozen=True)
class DepthFilesSpec(ImageFilesSpec):
    """Where the depth images are, and what is in them; a bare text is their files."""

    scale_per_m: float | None = depth_scale_key(
        "steps a metre; default 1000 for whole numbers, 1 for floating point", least_shown=1
    )
    void: tuple[float, ...] = key(
        "values that say that nothing was measured, beside 0 and what is not finite: [65535]",
        default=(),
        identity="meaning",
    )


@dataclass(frozen=True)
class PoseFilesSpec:
    """The colour camera's poses; a bare text is their file, or a bag's topic."""

    SHORTHAND: ClassVar[str] = "file"

    file: str | None = key(
        "file of poses, or folder of one pose a file, in the folder; its format is told by content",
        default=None,
        identity="meaning",
        label="File",
    )
    format: str = key_of(PoseKeys, "format")
    pose: PoseDirection = key_of(PoseKeys, "pose")
    axes: PoseAxes = key_of(PoseKeys, "axes")
    rate_hz: float | None = key(
        "poses a second of a file without time stamps; by default the i-th pose is that of the i-th image",
        unit="Hz",
        default=None,
        above=0,
        maximum=10_000,
        identity="meaning",
        slider=(1, 120),
        label="Pose Rate",
    )
    stamp_unit: StampUnits = key_of(PoseKeys, "stamp_unit")
    body: str | None = key(
        "of a bag: the frame that the poses of a topic are of, where its messages do not say; else the camera's",
        default=None,
        identity="meaning",
    )


@dataclass(frozen=True)
class StampFilesSpec:
    """When the images were taken; a bare text is a file."""

    SHORTHAND: ClassVar[str] = "file"

    file: str | None = key(
        "file whose lines begin with the time of an image each, in the images' order",
        default=None,
        identity="meaning",
        label="File",
    )
    names: bool = key(
        "whether the names of the images are their times; depth is then paired by time",
        default=False,
        identity="meaning",
    )
    stamp_unit: StampUnits = key_of(PoseKeys, "stamp_unit")


@dataclass(frozen=True)
class IntrinsicsSpec:
    """The colour camera's pinhole; a bare text is a file."""

    SHORTHAND: ClassVar[str] = "file"

    file: str | None = key(
        "file that says it: a matrix of 3 x 3 or 4 x 4, the numbers fx fy cx cy, or JSON with K, cam_K, "
        "intrinsic_matrix or fx, fy, cx and cy",
        default=None,
        identity="meaning",
        label="File",
    )
    fx: float | None = key("focal length", unit="px", default=None, above=0, maximum=1e6, identity="meaning")
    fy: float | None = key("focal length", unit="px", default=None, above=0, maximum=1e6, identity="meaning")
    cx: float | None = key(
        "principal point", unit="px", default=None, minimum=-1e6, maximum=1e6, identity="meaning", label="cx"
    )
    cy: float | None = key(
        "principal point", unit="px", default=None, minimum=-1e6, maximum=1e6, identity="meaning", label="cy"
    )


@dataclass(frozen=True)
class SequenceSpec:
    """A recording: a folder whose layout is told by its files, or one that is described here, file by file."""

    SHORTHAND: ClassVar[str] = "folder"

    folder: str | None = key(
        "folder of the recording, laid out as one of the layouts that are read (see --list layouts) or as the other "
        "keys say, relative to the preset; * allowed",
        default=None,
        identity="meaning",
        label="Folder",
    )
    bag: str | None = key(
        "instead of folder: a bag of ROS, .bag, .mcap, .db3 or the folder of one; rgb, depth, poses, imu and "
        "intrinsics are then topics, none for no such thing, and are found where exactly one fits",
        default=None,
        identity="meaning",
        label="Bag",
    )
    rgb: ImageFilesSpec | None = key("the colour images", default=None, label="Colour")
    depth: DepthFilesSpec | None = key("the depth images: PNG, TIFF, EXR, NPY or NPZ", default=None)
    poses: PoseFilesSpec | None = key("the colour camera's poses", default=None)
    imu: str | None = key(
        "file of what an IMU measured, as EuRoC's data.csv; the imu.yaml or sensor.yaml beside it says where it sits",
        default=None,
        identity="meaning",
        label="IMU",
    )
    intrinsics: IntrinsicsSpec | None = key("the colour camera's intrinsics; or camera says them", default=None)
    stamps: StampFilesSpec | None = key("when the images were taken, where no list says it", default=None)

    @property
    def described(self) -> bool:
        """Whether its files are described here, rather than found by a layout."""
        return any(getattr(self, item.name) is not None for item in fields(self) if item.name != "folder")

    @property
    def topics(self) -> BagTopics:
        """The topics of a bag that are named."""
        poses = self.poses
        return BagTopics(
            rgb=None if self.rgb is None else self.rgb.files,
            depth=None if self.depth is None else self.depth.files,
            imu=self.imu,
            poses=None if poses is None else poses.file,
            intrinsics=None if self.intrinsics is None else self.intrinsics.file,
            body=None if poses is None else poses.body,
        )


def check_sequence(spec: SequenceSpec, place: ConfigPath) -> None:
    """Refuse a recording of which something is missing or said twice. Raises InputError."""
    if spec.bag is not None:
        _check_bag(spec, place)
    else:
        _check_folder(spec, place)


def _check_folder(spec: SequenceSpec, place: ConfigPath) -> None:
    if spec.folder is None:
        raise place.at("folder").error("is missing", "name the recording's folder")
    if not spec.described:
        return
    if spec.rgb is None:
        raise place.at("rgb").error("is missing", "say where the colour images are, such as rgb: {files: rgb/*.png}")
    for name, images in (("rgb", spec.rgb), ("depth", spec.depth)):
        if images is not None and (images.files is None) == (images.list is None):
            raise place.at(name).error("needs either files or list", "name one of them")
    if (poses := spec.poses) is not None and (poses.file is None or poses.body is not None):
        name, said, remedy = ("file", "is missing", "name the file of poses")
        if poses.file is not None:
            name, said, remedy = ("body", "is for a bag", "leave it out")
        raise place.at("poses").at(name).error(said, remedy)
    if spec.stamps is not None:
        if (spec.stamps.file is not None) == spec.stamps.names:
            raise place.at("stamps").error("needs either file or names: true", "name one of them")
        if spec.rgb.list is not None:
            raise place.at("stamps").error("the list of rgb says the times already", "leave one of them out")
    _check_intrinsics(spec, place)


def _check_intrinsics(spec: SequenceSpec, place: ConfigPath) -> None:
    if spec.intrinsics is not None:
        given = [name for name in ("fx", "fy", "cx", "cy") if getattr(spec.intrinsics, name) is not None]
        if (spec.intrinsics.file is None) == (not given) or len(given) not in (0, 4):
            raise place.at("intrinsics").error("needs either file, or fx, fy, cx and cy", "name one of them")


def _check_bag(spec: SequenceSpec, place: ConfigPath) -> None:
    """Refuse what a bag says itself, or has not. Raises InputError."""
    if spec.folder is not None:
        raise place.at("bag").error("stands beside folder", "leave one of them out")
    topic = "name a topic alone, or leave it out"
    if spec.rgb is not None and spec.rgb != ImageFilesSpec(spec.rgb.files):
        raise place.at("rgb").error("is a topic of the bag", topic)
    if (depth := spec.depth) is not None and depth != DepthFilesSpec(depth.files, scale_per_m=depth.scale_per_m):
        raise place.at("depth").error("is a topic of the bag, with a scale", topic)
    if (poses := spec.poses) is not None and poses != PoseFilesSpec(poses.file, body=poses.body):
        raise place.at("poses").error("is a topic of the bag, whose poses are ROS's", topic)
    if spec.intrinsics is not None and spec.intrinsics != IntrinsicsSpec(spec.intrinsics.file):
        raise place.at("intrinsics").error("is a topic of the bag", "name one, or give the preset's camera")
    if spec.stamps is not None:
        raise place.at("stamps").error("are those of the bag's messages", "leave it out")


# --- images ---


@dataclass(frozen=True, eq=False)
class _Images:
    """Images in order. keys: of their names; () of a list's. stamps: where names or a list say them."""

    files: tuple[Path, ...]
    keys: tuple[Key, ...] = ()
    stamps: Stamps | None = None

    @property
    def numbers(self) -> tuple[int, ...] | None:
        """The numbers that frames are counted by; None where names are no such numbers."""
        found = [
            each[0][1] for each in self.keys if len(each) == 1 and each[0][0] == 0 and each[0][1] <= LARGEST_NUMBER
        ]
        return tuple(found) if found and len(found) == len(self.files) else None


def name_key(text: str) -> Key:
    """Return what a name is ordered by: numbers by value, letters whatever their case."""
    parts = re.findall(r"[0-9]+|[^0-9]+", text.casefold())
    return tuple((0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts)


def _found(folder: Path, spec: ImageFilesSpec, stamps: StampFilesSpec | None, place: ConfigPath) -> _Images:
    """Return the images of a kind. Raises InputError where there are none, or two stand for one."""
    if spec.list is not None:
        return _listed(folder, spec.list, place.at("list"))
    pattern, place = (spec.files or "").replace("\\", "/"), place.at("files")
    if "**" in pattern:
        raise place.error("has **, but a pattern has one * for each part of a name", "name the folders")
    try:
        matcher = _matcher(pattern)
    except re.error:
        raise place.error(f"{quoted(pattern)} is no pattern", "[ and ] hold letters, as in [0-9]") from None
    found: dict[Key, Path] = {}
    texts: dict[Key, str] = {}
    for name in glob.glob(pattern, root_dir=folder):  # noqa: PTH207 - takes absolute patterns too
        match = matcher.fullmatch(name.replace("\\", "/"))
        path = folder / name
        if match is None or not path.is_file():
            continue
        text = "\0".join(match.groups())
        if (same := found.setdefault(name_key(text), path)) != path:
            raise place.error(f"{same.name} and {path.name} stand for one frame", "keep one of them")
        texts[name_key(text)] = text
    if not found:
        raise place.error(f"no file matches {quoted(pattern)} in {folder}", _near(folder, pattern))
    keys = sorted(found)
    if stamps is None or not stamps.names:
        return _Images(tuple(found[each] for each in keys), tuple(keys))
    times = {each: _time(texts[each], stamps.stamp_unit, found[each]) for each in keys}
    keys.sort(key=lambda each: times[each])
    return _stamped([(times[each], found[each]) for each in keys], folder)


def _matcher(pattern: str) -> re.Pattern[str]:
    """Return an expression whose groups are what the wildcards of a pattern stand for, but for those of the suffix."""
    name, dot, suffix = pattern.rpartition(".")
    if not dot or "/" in suffix:
        name, suffix = pattern, ""
    wild = r"(\*|\?|\[[^\]]+\])"
    told, ending = ("".join(map(_expression, re.split(wild, text))) for text in (name, dot + suffix))
    return re.compile(told + re.sub(r"(?<!\\)\(", "(?:", ending))  # raises re.error for a set that holds nothing


def _expression(part: str) -> str:
    if part in ("*", "?"):
        return "([^/]*)" if part == "*" else "([^/])"
    return f"({part.replace('[!', '[^')})" if part.startswith("[") and part.endswith("]") else re.escape(part)


def _near(folder: Path, pattern: str) -> str:
    """Return what there is where a pattern looks, in words."""
    inside = folder / Path(pattern).parent
    if not inside.is_dir():
        there = sorted(path.name for path in folder.iterdir() if path.is_dir())[:8] if folder.is_dir() else []
        return f"folders there: {', '.join(there)}" if there else "check the folder"
    ends = sorted({path.suffix for path in itertools.islice(inside.iterdir(), 1000) if path.suffix})[:8]
    return f"{inside.name} has files of {', '.join(ends)}" if ends else f"{inside.name} is empty"


def _time(text: str, unit: StampUnits, path: Path) -> Decimal:
    number = re.findall(r"[0-9]+(?:\.[0-9]+)?", text)
    if len(number) != 1:
        raise InputError(path, "has no time in its name", remedy="leave stamps.names out, or name a file of times")
    return _seconds(Decimal(number[0]), unit)


def _seconds(value: Decimal, unit: StampUnits) -> Decimal:
    per_s = PER_SECOND["ns" if value >= _LEAST_NS else "s"] if unit == "auto" else PER_SECOND[unit]
    return value / per_s


def _listed(folder: Path, name: str, place: ConfigPath) -> _Images:
    """Return the images of a file with a time stamp and a name on each line."""
    path = _inside(folder, name, place)
    images: list[tuple[Decimal, Path]] = []
    for number, line in enumerate(recorded_text(path).split("\n"), 1):
        words = re.split(r"[\s,;]+", line.partition("#")[0].strip())
        if words == [""]:
            continue
        try:
            stamp = Decimal(words[0])
        except InvalidOperation:
            stamp = Decimal("nan")
        if len(words) < 2 or not stamp.is_finite():
            raise InputError(
                path, "is no time stamp and file name", where=f"line {number}", remedy="as in TUM's rgb.txt"
            )
        image = path.parent / words[1].replace("\\", "/")
        if not os.path.isfile(image):  # noqa: PTH113 - Path.is_file raises for a name that no file can have
            problem = f"names {quoted(words[1])}, which is not there"
            raise InputError(path, problem, where=f"line {number}", remedy=f"looked in {image.parent}")
        images.append((_seconds(stamp, "auto"), image))
    if not images:
        raise place.error(f"{path} lists no image", "name another")
    return _stamped(sorted(images, key=lambda image: image[0]), path)


def _stamped(images: Sequence[tuple[Decimal, Path]], path: Path) -> _Images:
    stamps = exact_stamps([stamp for stamp, _ in images])
    same = np.flatnonzero(np.diff(stamps.seconds) <= 0)
    if same.size:
        one, other = (images[same[0] + more][1].name for more in (0, 1))
        raise InputError(path, f"{one} and {other} have one time stamp", remedy="an image has a stamp of its own")
    return _Images(tuple(file for _, file in images), stamps=stamps)


def exact_stamps(given_s: Sequence[Decimal]) -> Stamps:
    """Return stamps in seconds, with exact nanoseconds where all are whole ones."""
    stamps_ns = [stamp.scaleb(9) for stamp in given_s]
    whole = all(stamp_ns == int(stamp_ns) for stamp_ns in stamps_ns)
    return Stamps(np.array([float(stamp) for stamp in given_s]), tuple(map(int, stamps_ns)) if whole else None)


def _times_in(path: Path, count: int, unit: StampUnits) -> Stamps:
    """Return the times that the lines of a file begin with. Raises InputError where they are not as many as images."""
    times: list[Decimal] = []
    for number, line in enumerate(recorded_text(path).split("\n"), 1):
        words = re.split(r"[\s,;]+", line.partition("#")[0].strip())
        if words == [""]:
            continue
        try:
            times.append(_seconds(Decimal(words[0]), unit))
        except InvalidOperation:
            if times:
                raise InputError(path, "does not begin with a time", where=f"line {number}") from None
        if times and not times[-1].is_finite():
            raise InputError(path, "does not begin with a finite time", where=f"line {number}")
    if len(times) != count:
        raise InputError(path, f"has {len(times)} times for {count} images", remedy="a line for each image")
    stamps = exact_stamps(times)
    if late := np.flatnonzero(np.diff(stamps.seconds) <= 0).tolist():
        raise InputError(path, f"time {late[0] + 2} is not later than the one before it")
    return stamps


def _paired(rgb: _Images, depth: _Images, place: ConfigPath) -> tuple[list[int], tuple[Path, ...], str]:
    """Return which colour images have depth, the depth of each, and a note on the others; by their names."""
    by_key = dict(zip(depth.keys, depth.files, strict=False))
    rows = [row for row, each in enumerate(rgb.keys) if each in by_key]
    if rows:
        alone = len(rgb.files) + len(depth.files) - 2 * len(rows)
        note = f"{alone} images are left out: no colour or no depth has their name" if alone else ""
        return rows, tuple(by_key[rgb.keys[row]] for row in rows), note
    if len(rgb.files) == len(depth.files):
        note = f"names of colour and depth have nothing in common ({rgb.files[0].name}, {depth.files[0].name}): the i-th of one belongs to the i-th of the other"  # fmt: skip  # noqa: E501
        return list(range(len(rgb.files))), depth.files, note
    problem = f"{len(depth.files)} depth images and {len(rgb.files)} of colour have no name in common"
    raise place.error(problem, "let * stand for what is equal in both, such as rgb/*.png and depth/*.png")


# --- poses ---


@dataclass(frozen=True, eq=False)
class _Poses:
    """Poses of images: by their rows or, where they have times of their own, as a path. notes: on the reading."""

    by_row: Mapping[int, NDArray[np.float64]]
    path: Trajectory | None = None
    notes: tuple[str, ...] = ()


def _read_poses(
    file: Path, spec: PoseFilesSpec, rgb: _Images, pairs: Sequence[int], untimed: ConfigPath | None
) -> _Poses:
    """Read a file of poses. pairs: the rows of the images with depth. untimed: the key, where images have no times."""
    found = read_file_poses(file, format=spec.format, stamp_unit=spec.stamp_unit, skip_lost=True)
    if found.stamps_s is not None or spec.rate_hz is not None:
        if untimed is not None and found.stamps_s is not None:
            problem = f"{file.name} has time stamps, but nothing says those of the images"
            raise untimed.error(problem, "say stamps, or format where these are none")
        read = read_trajectory_file(
            file,
            format=spec.format,
            direction=spec.pose,
            axes=spec.axes,
            rate_hz=spec.rate_hz or 1.0,
            stamp_unit=spec.stamp_unit,
        )
        return _Poses({}, read.trajectory, read.trajectory.notes)
    axes = found.axes if spec.axes == "auto" else spec.axes
    direction = found.direction if spec.pose == "auto" else spec.pose
    c2w = upright_poses(found.poses, direction, axes)
    assert found.numbers is not None, "poses have stamps or numbers"
    numbers = [round(number) for number in found.numbers.tolist()]
    listed = numbers if found.listed is None else [round(number) for number in found.listed.tolist()]
    return _Poses(_rows_of(file, dict(zip(numbers, c2w, strict=True)), listed, rgb, pairs), notes=found.notes)


def _rows_of(
    file: Path, poses: PosesByNumber, listed: Sequence[int], rgb: _Images, pairs: Sequence[int]
) -> dict[int, NDArray[np.float64]]:
    """Return counted poses by the rows of the images that they belong to. Raises InputError where none can be told."""
    numbers = rgb.numbers
    if file.is_dir() and numbers is not None:
        return {row: poses[number] for row, number in enumerate(numbers) if number in poses}
    count = listed[-1] + 1
    for rows in (range(len(rgb.files)), pairs):
        if count == len(rows):
            return {row: poses[place] for place, row in enumerate(rows) if place in poses}
    if numbers is not None:  # images are lost, and their numbers say which
        fitting = {begin for begin in (0, 1, numbers[0]) if begin <= numbers[0] and begin + count - 1 == numbers[-1]}
        if len(fitting) == 1:
            (begin,) = fitting
            return {row: poses[number - begin] for row, number in enumerate(numbers) if number - begin in poses}
    problem = f"has poses of {count} frames, but there are {len(rgb.files)} images"
    raise InputError(file, problem, remedy="a pose for each image, in their order")


# --- cameras ---


def read_intrinsics(path: Path, size_px: SizePx) -> Intrinsics:
    """Return the pinhole that a file says, of images of a size. Raises InputError where it says none.

    The file is a matrix of 3 x 3 or 4 x 4, the numbers fx fy cx cy, or JSON as `read_camera_file` takes it.
    """
    text = recorded_text(path)
    if text.lstrip().startswith("{"):
        return read_camera_file(path, size_px)
    rows = text_rows(path, read_numbers(path))
    if rows.numbers.size == 4:
        names = ("width", "height", "fx", "fy", "cx", "cy")
        return checked_intrinsics(path, names, (*size_px, *rows.numbers.tolist()))
    if rows.widths.tolist() not in ([3] * 3, [4] * 4):
        remedy = "a matrix of 3 x 3 or 4 x 4, or the numbers fx fy cx cy"
        raise InputError(path, "holds no intrinsics", remedy=remedy)
    side = len(rows.widths)
    return intrinsics_of_matrix(path, rows.numbers.reshape(side, side), size_px)


FOCAL_TOLERANCE = 0.01  # chosen: of autofocus; a zoom changes more


def median_camera(path: Path, cameras: Sequence[Intrinsics]) -> tuple[Intrinsics, str]:
    """Return the median of the cameras of a recording's frames, and a note where they differ; "" where they are equal.

    Raises InputError where they differ by more than 1 % of the focal length, or have several sizes.
    """
    first = cameras[0]
    values = np.array([[item.fx_px, item.fy_px, item.cx_px, item.cy_px] for item in cameras])
    most_px = float(np.ptp(values, axis=0).max())
    sizes = {(item.width_px, item.height_px) for item in cameras}
    if len(sizes) > 1 or most_px > FOCAL_TOLERANCE * first.fx_px:
        what = "sizes" if len(sizes) > 1 else f"intrinsics that differ by {most_px:.3g} px"
        raise InputError(path, f"has frames of several {what}", remedy="a recording has one camera: take frames of one")
    median = Intrinsics(first.width_px, first.height_px, *map(float, np.median(values, axis=0)))
    note = f"intrinsics differ from frame to frame by up to {most_px:.2g} px: their median is used"
    return (median, note) if most_px else (first, "")


def seen_by_depth(camera: Intrinsics, size_px: SizePx) -> DepthCamera | None:
    """Return the camera of depth images that show the same view in other pixels; None where they are the colour's."""
    if size_px == (camera.width_px, camera.height_px):
        return None
    across, down = np.array(size_px) / (camera.width_px, camera.height_px)
    cx_px, cy_px = (camera.cx_px + _HALF_PX) * across - _HALF_PX, (camera.cy_px + _HALF_PX) * down - _HALF_PX
    fx_px, fy_px = camera.fx_px * across, camera.fy_px * down
    seen = Intrinsics(*size_px, float(fx_px), float(fy_px), float(cx_px), float(cy_px))
    return DepthCamera(seen, shares_lens=True)


# --- reading ---


@dataclass(frozen=True)
class Told:
    """What a layout's own files tell beside what is described.

    cameras: of colour and depth. poses: (4, 4) of each image, c2w in OpenCV's axes, None for one that is not known;
    None where no file tells any. path: the file of the poses. stamps: (N,) of the images; rate_hz: theirs without.
    """

    cameras: Cameras | None = None
    poses: Sequence[NDArray[np.float64] | None] | None = None
    path: Path | None = None
    stamps: Stamps | None = None
    rate_hz: float | None = None
    notes: tuple[str, ...] = ()


Telling: TypeAlias = Callable[[Path, tuple[Path, ...]], Told]
"""Returns what a layout's own files tell of a folder with these colour images."""


def read_described(
    folder: Path,
    spec: SequenceSpec,
    place: ConfigPath,
    rate_hz: float | None = None,
    policy: PosePolicy = "drop",
    *,
    telling: Telling = lambda _, __: Told(),
) -> StoredSequence:
    """Find the files of a recording as they are described. place: of the description, for messages.

    rate_hz: of the images, where nothing says their times. policy: what becomes of frames without a pose; a recording
    whose poses are not described has none. Raises InputError where files are missing, wrong or do not match.
    """
    assert spec.rgb is not None, "this has been checked"
    rgb = _found(folder, spec.rgb, spec.stamps, place.at("rgb"))
    told = telling(folder, rgb.files)
    counted_by = rate_hz or told.rate_hz
    used_hz = counted_by or RECORDED_HZ
    told = replace(told, rate_hz=used_hz)
    if spec.poses is None and told.poses is None:
        if policy == "require":
            raise place.at("poses").error("is missing, and poses: require asks for it", "name the file of poses")
        policy = "none"
    times_path, stamps = _image_times(folder, spec, rgb, told, place.at("stamps"))
    rows, depth, notes = _depth_of(folder, spec, rgb, stamps, place)
    path, given = told.path, _Poses({})
    if policy != "none" and told.poses is not None:
        given = _Poses({row: c2w for row, c2w in enumerate(told.poses) if c2w is not None})
    elif policy != "none" and spec.poses is not None and spec.poses.file is not None:
        at = place.at("poses").at("file")
        path = truth_file(_inside(folder, spec.poses.file, at, must=policy != "keep"), policy)
        if path is not None:
            given = _read_poses(path, spec.poses, rgb, rows, None if times_path else place.at("poses"))
    colour = StampedFiles(stamps.take(rows), tuple(rgb.files[row] for row in rows))
    if given.path is not None:
        frames = associate_frames(folder, colour, depth, given.path, paired=True, policy=policy)
    else:
        frames = _with_poses(path or folder, colour, depth, [given.by_row.get(row) for row in rows], policy)
    cameras = told.cameras or _told_camera(folder, spec, frames.rgb_files[0], place)
    scale_per_m, void = _values_of(spec, frames.depth_files, cameras)
    optics, size_note = _optics_of(cameras, frames.depth_files)
    imu, imu_note = None, ""
    if spec.imu is not None:
        imu, imu_note = imu_beside(_inside(folder, spec.imu, place.at("imu")))
    trajectory = frames.trajectory
    if cameras.posed_from_camera is not None:
        c2w = _checked_poses(path or folder, trajectory.c2w @ cameras.posed_from_camera)
        trajectory = replace(trajectory, c2w=c2w, curve=None)
    return StoredSequence(
        folder,
        frames.rgb_files,
        frames.depth_files,
        path if policy != "none" else None,
        trajectory,
        frames.stamps,
        scale_per_m,
        times_path,
        cameras.camera,
        cameras.path,
        tuple(
            note
            for note in (*notes, *frames.notes, *given.notes, *told.notes, size_note, imu_note)
            + (counted_note(counted_by, used_hz) if times_path is None else ())
            if note
        ),
        None if times_path else used_hz,
        void,
        optics,
        cameras.assumed,
        imu=imu,
    )


def _inside(folder: Path, name: str, place: ConfigPath, *, must: bool = True) -> Path:
    """Return a file or folder that the description names. must: whether it has to be there. Raises InputError."""
    path = folder / name.replace("\\", "/")
    if must and not os.path.exists(path):  # noqa: PTH110 - Path.exists raises for a name that no file can have
        remedy = "; leave poses out to use the images without ground truth" if ".poses." in f".{place.path}" else ""
        raise place.error(f"{quoted(name)} does not exist", f"looked in {folder}{remedy}")
    return path


def _checked_poses(path: Path, c2w: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses (N, 4, 4). Raises InputError for the first that is not finite."""
    wrong = np.flatnonzero(~np.isfinite(c2w).all(axis=(1, 2)))
    if wrong.size:
        raise InputError(path, f"the pose of frame {wrong[0]} is not finite", remedy="leave it out")
    return c2w


def _optics_of(cameras: Cameras, depth_files: tuple[Path, ...]) -> tuple[Optics, str]:
    """Return what cameras have beyond one pinhole, and a note where depth is of another size than colour."""
    if cameras.optics.depth is not None or cameras.camera is None or not depth_files:
        return cameras.optics, ""
    size_px = size_of(depth_files[0])
    seen = seen_by_depth(cameras.camera, size_px)
    note = f"depth is {size_px[0]} x {size_px[1]}: it is taken to show colour's view in other pixels"
    return replace(cameras.optics, depth=seen), "" if seen is None else note


def _image_times(
    folder: Path, spec: SequenceSpec, rgb: _Images, told: Told, place: ConfigPath
) -> tuple[Path | None, Stamps]:
    """Return what says the images' times, and these; counted by the rate that is told where nothing does."""
    assert told.rate_hz is not None, "this has been filled in"
    if rgb.stamps is not None:
        assert spec.rgb is not None, "this has been checked"
        return folder / (spec.rgb.list or Path(spec.rgb.files or "").parent), rgb.stamps
    if spec.stamps is not None and spec.stamps.file is not None:
        path = _inside(folder, spec.stamps.file, place.at("file"))
        return path, _times_in(path, len(rgb.files), spec.stamps.stamp_unit)
    if told.stamps is not None:
        return told.path, told.stamps
    counts = rgb.numbers or range(len(rgb.files))
    return None, Stamps(np.array(counts, dtype=np.float64) / told.rate_hz)


def _depth_of(
    folder: Path, spec: SequenceSpec, rgb: _Images, stamps: Stamps, place: ConfigPath
) -> tuple[list[int], StampedFiles | None, tuple[str, ...]]:
    """Return the rows of colour that have depth, this, and notes; all rows of a recording without depth."""
    everything = list(range(len(rgb.files)))
    if spec.depth is None:
        return everything, None, ()
    depth = _found(folder, spec.depth, spec.stamps, place.at("depth"))
    if depth.stamps is not None:
        try:
            of_rgb, of_depth = associate(stamps.seconds, depth.stamps.seconds)
        except ValueError as error:
            raise place.at("depth").error(str(error), "stamps are seconds: are these in another unit?") from None
        if not len(of_rgb):
            spans = [f"{item.seconds[0]:.6f} to {item.seconds[-1]:.6f} s" for item in (stamps, depth.stamps)]
            problem = f"no depth image is within {PAIRING_S} s of one of colour"
            raise place.at("depth").error(problem, f"colour has {spans[0]}, depth {spans[1]}")
        alone = len(rgb.files) - len(of_rgb)
        note = f"{alone} of {len(rgb.files)} colour images are left out: no depth image within {PAIRING_S} s"
        files = tuple(depth.files[row] for row in of_depth)
        return of_rgb.tolist(), StampedFiles(depth.stamps.take(of_depth), files), (note,) if alone else ()
    if rgb.stamps is not None and len(depth.files) != len(rgb.files):
        problem = f"{len(depth.files)} depth images have no times, and {len(rgb.files)} of colour have"
        raise place.at("depth").error(problem, "say depth: {list: ...}, with a time for each")
    rows, files, note = (everything, depth.files, "") if rgb.stamps else _paired(rgb, depth, place.at("depth"))
    return rows, StampedFiles(stamps.take(rows), files), (note,)


def _with_poses(
    path: Path,
    colour: StampedFiles,
    depth: StampedFiles | None,
    poses: Sequence[NDArray[np.float64] | None],
    policy: PosePolicy,
) -> MatchedFrames:
    """Return frames with poses (4, 4) of their own, some of which may not be known. path: of the poses."""
    known = np.array([each is not None for each in poses])
    chosen, note = chosen_by_pose(path, known, policy)
    rows = chosen.tolist()
    c2w = _checked_poses(path, np.array([np.eye(4) if (each := poses[row]) is None else each for row in rows]))
    stamps = colour.stamps.take(rows)
    taken = stamps if depth is None else depth.stamps.take(rows)
    return MatchedFrames(
        tuple(colour.files[row] for row in rows),
        () if depth is None else tuple(depth.files[row] for row in rows),
        Trajectory(c2w, stamps.seconds, posed=known[rows]),
        FrameStamps(stamps, taken, stamps),
        (note,) if note else (),
    )


def _told_camera(folder: Path, spec: SequenceSpec, image: Path, place: ConfigPath) -> Cameras:
    said = spec.intrinsics
    if said is None:
        return Cameras()
    if said.file is not None:
        path = _inside(folder, said.file, place.at("intrinsics").at("file"))
        return Cameras(read_intrinsics(path, size_of(image)), path)
    assert None not in (said.fx, said.fy, said.cx, said.cy), "this has been checked"
    values = (float(getattr(said, name)) for name in ("fx", "fy", "cx", "cy"))
    return Cameras(Intrinsics(*size_of(image), *values), Path(place.file))


def _values_of(spec: SequenceSpec, depth_files: tuple[Path, ...], cameras: Cameras) -> tuple[float, tuple[float, ...]]:
    """Return the steps a metre of depth, and its values for void."""
    if spec.depth is None or not depth_files:
        return MILLIMETRES, ()
    own = spec.depth.scale_per_m or cameras.depth_scale_per_m
    return own or (1.0 if read_header(depth_files[0]).floating else MILLIMETRES), spec.depth.void


class DescribedLayout(RecordedLayout):
    """A layout of recordings that is described file by file.

    described: where its files are. told_by: patterns of files that all have to be there for a folder to be one.
    documented: the dataset's camera, where no file says one; assumed: a sentence that says so.
    """

    described: ClassVar[SequenceSpec]
    told_by: ClassVar[tuple[str, ...]]
    documented: ClassVar[Intrinsics | None] = None
    assumed: ClassVar[str] = ""

    def recognises(self, folder: Path) -> bool:
        """Tell whether the files are there by which it is told."""
        return all(any(folder.glob(pattern)) for pattern in self.told_by)

    def description(self, folder: Path) -> SequenceSpec:
        """Return where the files of a recording are; without depth and poses where a recording may lack them."""
        spec = self.described
        if spec.depth is not None and not any(folder.glob(spec.depth.files or spec.depth.list or "")):
            spec = replace(spec, depth=None)
        return spec

    def tell(self, folder: Path, images: tuple[Path, ...]) -> Told:
        """Return what its own files tell beside. images: of colour."""
        del folder, images
        if self.documented is None:
            return Told()
        return Told(Cameras(self.documented, assumed=self.assumed))

    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Find the files of a recording."""
        return read_described(folder, self.description(folder), ConfigPath(folder), rate_hz, poses, telling=self.tell)
