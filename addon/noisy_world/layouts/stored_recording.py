# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings on disk: which colour, depth and pose belong together, and frames read when they are asked for."""

import json
import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, Message, PresetKey
from ..core.file_access import finite_number, read_bytes, read_text
from ..core.frame_table import FRAMES, given_lines
from ..core.geometry import Intrinsics
from ..core.lens import PINHOLE, Optics
from ..core.schema import key
from ..core.trajectory import FrameStamps, Stamps, Trajectory
from ..images.image_files import (
    WholeFile,
    check_colour,
    check_depth,
    check_named_png,
    check_size_px,
    check_whole,
    metres,
    read_colour,
    read_header,
    read_light,
    read_steps,
    spoken,
)
from ..images.image_header import ImageHeader
from ..trajectories.rig import RecordedImu

# The SHA-256 of each file of a recording that this program wrote, as its frames.jsonl tells them.


_DIGEST = re.compile("[0-9a-f]{64}")
_REMEDY = "mend or remove it"


def read_digests(folder: Path) -> dict[str, str]:
    """Return by name in a sequence the SHA-256 of its files; none where no frames.jsonl tells them.

    Raises InputError where it cannot be read, or tells what is no SHA-256.
    """
    path = folder / FRAMES
    if not os.path.lexists(path):
        return {}
    found: dict[str, str] = {}
    for where, record in given_lines(path, _REMEDY):
        digests = record.get("sha256", {}) if isinstance(record, dict) else None
        if not isinstance(digests, dict) or not all(map(_is_digest, digests.values())):
            raise InputError(path, "tells no SHA-256 by the files' names", where=where, remedy=_REMEDY)
        found |= digests
    return found


def _is_digest(value: object) -> bool:
    return isinstance(value, str) and _DIGEST.fullmatch(value) is not None


RATE_HZ = 20.0  # of sequences that say no time at all, unless a preset says another
INTRINSICS_TOLERANCE_PX = 1e-3  # chosen: people round to about as many digits when they copy intrinsics

# Chosen: a step of 10 m to one of 0.1 um. Metres per step, such as 0.001 or 1 / 5000, are below it.
SCALES_PER_M = (0.1, 1e7)


def depth_scale_key(meaning: str, *, least_shown: float = 100) -> Any:
    """Declare a key for the steps a metre of depth images. least_shown: where its slider begins."""
    least, most = SCALES_PER_M
    return key(
        meaning,
        unit="steps/m",
        default=None,
        minimum=least,
        maximum=most,
        identity="meaning",
        slider=(least_shown, 10_000),
        label="Depth Scale",
    )


SizePx: TypeAlias = tuple[int, int]
"""Width and height in pixels."""


@dataclass(frozen=True)
class StoredFrame:
    """A frame on disk, whose images are read on request.

    size_px: width and height that its images have to have. rgb_sha256, depth_sha256: of the files when they were
    written, where that is known; files with another are refused. depth_size_px: of depth, where it is another.
    void_steps: what depth images hold where there is no depth, besides 0. rgb_header: of the colour image, where it was
    read.
    """

    rgb_file: Path
    depth_file: Path | None
    depth_scale_per_m: float
    size_px: SizePx
    rgb_sha256: str | None = None
    depth_sha256: str | None = None
    depth_size_px: SizePx | None = None
    void_steps: tuple[float, ...] = ()
    rgb_header: ImageHeader | None = None

    @property
    def rgb(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB, sRGB-encoded: uint8, or float32 in [0, 1] where the file has 16 bits.

        Grey is in three equal channels. Raises InputError where the file is damaged, or no image as it has to be.
        """
        return read_colour(self.rgb_file, self.size_px, self.rgb_sha256)

    @property
    def light(self) -> NDArray[np.float32]:
        """Scene-linear light (H, W, 3) of a dataset whose colour is an EXR. Raises InputError where it is damaged."""
        return read_light(self.rgb_file, self.size_px, self.rgb_sha256)

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void. Raises InputError where the file is no depth image of the size."""
        assert self.depth_file is not None, "there is no depth"
        values = read_steps(self.depth_file, self.depth_size_px or self.size_px, self.depth_sha256)
        return metres(values, self.depth_scale_per_m, self.void_steps)

    @cached_property
    def stored_rgb(self) -> tuple[str, str | None]:
        """The kind of the colour image's file, and what it holds: 8-bit "rgb" or "grey", None for anything else."""
        header = self.rgb_header or read_header(self.rgb_file)
        return header.kind, header.plainly

    @property
    def depth_is_png(self) -> bool:
        """Whether its depth image is a PNG, as datasets have it."""
        return self.depth_file is not None and is_png(self.depth_file)

    def whole_file(self, modality: str) -> WholeFile:
        """Return the file of "rgb" or "depth" that is used as it is. Raises InputError where it is damaged."""
        file, sha256 = (self.rgb_file, self.rgb_sha256) if modality == "rgb" else (self.depth_file, self.depth_sha256)
        assert file is not None, "there is no depth"
        header, digest = check_whole(file, sha256)
        if modality == "depth":
            check_named_png(file, header)
        own_size_px = None if modality == "rgb" else self.depth_size_px
        check_size_px(file, header, own_size_px or self.size_px, own_size_px not in (None, self.size_px))
        return WholeFile(file, digest)


@dataclass(frozen=True)
class StoredSequence:
    """A recording: colour, and whatever else there is: depth, ground truth, stamps, a camera.

    depth_files: one for each colour image; () without depth. trajectory: the colour camera's poses, one for each colour
    image, at its stamp. stamps: of colour, depth and poses, as the recording has them. depth_scale_per_m: steps per
    metre; any number without depth. stamps_path: the file that says the
    stamps; None where there is none, and counted_hz is the rate that they follow from. camera: its intrinsics, and
    camera_path the file that says them; None where none does. notes: sentences that the user should see. void_steps:
    what depth images hold where there is no depth, besides 0. optics: what its cameras have beyond one pinhole.
    assumed: says that the camera is the dataset's documented one, which another may replace; "" where a file says it.
    likely: a camera that its folder's name hints at, where none is known. imu: what its IMU measured; None without one.
    exposures_s: (N,) how long colour of each frame was exposed, NaN where no file says it; None without any.
    """

    folder: Path
    rgb_files: tuple[Path, ...]
    depth_files: tuple[Path, ...]
    trajectory_path: Path | None
    trajectory: Trajectory
    stamps: FrameStamps
    depth_scale_per_m: float
    stamps_path: Path | None = None
    camera: Intrinsics | None = None
    camera_path: Path | None = None
    notes: tuple[str, ...] = ()
    counted_hz: float | None = None
    void_steps: tuple[float, ...] = ()
    optics: Optics = PINHOLE
    assumed: str = ""
    likely: Intrinsics | None = None
    imu: RecordedImu | None = None
    exposures_s: NDArray[np.float64] | None = None

    @cached_property
    def size_px(self) -> SizePx:
        """Width and height of its first image in pixels."""
        return read_header(self.rgb_files[0]).size_px

    @property
    def depth_is_png(self) -> bool:
        """Whether all its depth images are PNG, as their names say."""
        return all(map(is_png, self.depth_files))

    @property
    def files(self) -> tuple[Path, ...]:
        """Every image."""
        return self.rgb_files + self.depth_files

    @property
    def rate_hz(self) -> float | None:
        """Frames per second by the median of the gaps; None for a single frame."""
        gaps_s = np.diff(self.stamps.rgb.seconds)
        return 1 / float(np.median(gaps_s)) if gaps_s.size else None

    @cached_property
    def known_camera(self) -> Intrinsics | None:
        """Its intrinsics, or None where no file says them. Raises InputError where its images have another size."""
        if self.camera is None or (self.camera_path is None and not self.assumed):
            return None
        stated_px = (self.camera.width_px, self.camera.height_px)
        if stated_px != self.size_px:
            if self.camera_path is None:
                return None  # images of another size than the dataset's: its documented camera is none of theirs
            problem = (
                f"says {stated_px[0]} x {stated_px[1]}, but {self.rgb_files[0].name} has {spoken(self.size_px)} pixels"
            )
            raise InputError(self.camera_path, problem, remedy="mend it, or take the images that belong to it")
        return self.camera

    @cached_property
    def _rgb_headers(self) -> tuple[ImageHeader, ...]:
        return tuple(map(read_header, self.rgb_files))

    @cached_property
    def image_notes(self) -> tuple[str, ...]:
        """What the user should know of its images, in sentences, after the headers of all of them are looked at.

        Raises InputError where one is no image as it has to be, or has another size than the first.
        """
        found: Counter[str] = Counter()
        for file, header in zip(self.rgb_files, self._rgb_headers, strict=True):
            check_colour(file, header)
            check_size_px(file, header, self.size_px)
            found.update(_remarks(header))
        for file in self.depth_files:
            header = read_header(file)
            check_depth(file, header)
            check_size_px(file, header, self.depth_size_px, self.depth_size_px != self.size_px)
        return tuple(
            f"{count} of {len(self.rgb_files)} colour images {problem}" for problem, count in sorted(found.items())
        )

    def check_images(self) -> None:
        """Raise InputError where the header of an image says that it cannot be used, before any is decoded."""
        _ = self.image_notes

    def frame(self, index: int) -> StoredFrame:
        """Return a frame."""
        rgb, depth = self.rgb_files[index], self.depth_files[index] if self.depth_files else None
        return StoredFrame(
            rgb,
            depth,
            self.depth_scale_per_m,
            self.size_px,
            self._digest(rgb),
            None if depth is None else self._digest(depth),
            self.depth_size_px,
            self.void_steps,
            self._rgb_headers[index] if "_rgb_headers" in self.__dict__ else None,  # one is not worth reading all
        )

    def encoded_colour(self, index: int) -> bytes:
        """Return what the file of a frame's colour holds. Raises InputError where it cannot be read."""
        path = self.rgb_files[index]
        try:
            return read_bytes(path, largest_bytes=None)
        except OSError as error:
            raise InputError(path, "cannot be read") from error

    @property
    def depth_size_px(self) -> SizePx:
        """Width and height that its depth images have to have, in pixels."""
        seen = None if self.optics.depth is None else self.optics.depth.intrinsics
        return self.size_px if seen is None else (seen.width_px, seen.height_px)

    @cached_property
    def _digests(self) -> dict[str, str]:
        return read_digests(self.folder)

    def _digest(self, file: Path) -> str | None:
        if not self._digests or not file.is_relative_to(self.folder):
            return None
        return self._digests.get(file.relative_to(self.folder).as_posix())


FLOATING = "depth is floating point"


def in_metres(found: StoredSequence, usual_scale_per_m: float | None) -> StoredSequence:
    """Return a recording whose depth is metres where it is floating point and nothing says a scale but its layout.

    usual_scale_per_m: the layout's, which is of steps.
    """
    if (
        found.depth_is_png
        or found.depth_scale_per_m != usual_scale_per_m
        or not read_header(found.depth_files[0]).floating
    ):
        return found
    if any(FLOATING in str(note) for note in found.notes):
        return found
    note = Message(f"{FLOATING}: it is taken for metres; ", PresetKey("depth_scale_per_m"), " says another")
    return replace(found, depth_scale_per_m=1.0, notes=(*found.notes, note))


def is_png(path: Path) -> bool:
    """Tell whether an image is a PNG, by its name; `whole_file` looks at its content."""
    return path.suffix.lower() == ".png"


def size_of(path: Path) -> SizePx:
    """Return the width and height of an image in pixels. Raises InputError where it is none."""
    return read_header(path).size_px


def _remarks(header: ImageHeader) -> Iterator[str]:
    """Yield what the user should know of a colour image."""
    if header.channels == 1:
        yield "are grey: perturbations get three equal channels"
    if header.bits == 16:
        yield "have 16 bits a channel: they are perturbed so, and written with 8"
    if header.channels == 4:
        yield "are CMYK: OpenCV converts them to RGB"


def same_camera(one: Intrinsics, other: Intrinsics) -> bool:
    """Tell whether intrinsics agree, up to INTRINSICS_TOLERANCE_PX."""
    values = [np.array([item.fx_px, item.fy_px, item.cx_px, item.cy_px]) for item in (one, other)]
    same_size = (one.width_px, one.height_px) == (other.width_px, other.height_px)
    return same_size and bool(np.abs(values[0] - values[1]).max() <= INTRINSICS_TOLERANCE_PX)


def checked_intrinsics(path: Path, places: tuple[str, ...], values: tuple[object, ...]) -> Intrinsics:
    """Return intrinsics from what a file says: width, height, fx, fy, cx and cy in pixels.

    places: where each value stands. Raises InputError, which names the place, for what is no number, a size that is not
    whole or not positive, and a focal length that is not positive.
    """
    numbers = [finite_number(value) for value in values]
    for index, (where, number) in enumerate(zip(places, numbers, strict=True)):
        if number is None:
            raise InputError(path, "is no finite number", where=where)
        if index < 4 and number <= 0:
            raise InputError(path, f"is {number:g}, but has to be above 0", where=where)
        if index < 2 and not number.is_integer():
            raise InputError(path, f"is {number:g}, but a size is whole pixels", where=where)
    wide, high, fx_px, fy_px, cx_px, cy_px = (float(number) for number in numbers if number is not None)
    return Intrinsics(int(wide), int(high), fx_px, fy_px, cx_px, cy_px)


def checked_depth_scale(path: Path, where: str, value: object, *, remedy: str = "") -> float:
    """Return a depth scale as a file says it, steps per metre. Raises InputError where it is none that depth has."""
    number = finite_number(value)
    least, most = SCALES_PER_M
    if number is None or number <= 0:
        text = json.dumps(value, default=str)
        message = text if len(text) <= 40 else f"{text[:37]}..."
        raise InputError(path, f"is {message}, but has to be a number above 0", where=where, remedy=remedy)
    if not least <= number <= most:
        message = f"is {number:g} steps per metre, so a step is {1 / number:.3g} m; it has to be {least:g} to {most:g}"
        if least <= 1 / number <= most:
            remedy = f"write {1 / number:g} where {number:g} m per step is meant"
        raise InputError(path, message, where=where, remedy=remedy)
    return number


def check_files(listing: Path, files: tuple[Path, ...]) -> None:
    """Raise InputError where a file that a list names is not there."""
    # Not Path.is_file, which raises OSError for a name that no file can have.
    lost = next((file for file in files if not os.path.isfile(file)), None)  # noqa: PTH113
    if lost is not None:
        raise InputError(listing, f"names {_short(lost.name)}, which is not there", remedy=f"looked in {lost.parent}")


def recorded_text(path: Path) -> str:
    """Return the text of a file. Raises InputError where it cannot be read."""
    try:
        return read_text(path, encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"cannot be read: {error}") from error


def _short(name: str) -> str:
    return name if len(name) <= 80 else f"{name[:77]}..."


# The time stamps in the frames.jsonl of a recording, which this program wrote beside the images.


_FRAME_TIMES_REMEDY = Message("mend it; without it, frames are ", PresetKey("rate_hz"), " apart")


def read_frame_times(folder: Path, frames: Sequence[int]) -> FrameStamps | None:
    """Return the stamps of a sequence's frames; None where there is no frames.jsonl.

    frames: the numbers of the frames that there are; the file may tell of others too. Poses have the stamps of colour.
    Raises InputError where the file is damaged, lacks a frame, or tells stamps that do not increase.
    """
    path = folder / FRAMES
    if not os.path.lexists(path):
        return None
    times_s = _times(path)
    lacking = next((frame for frame in frames if frame not in times_s), None)
    if lacking is not None:
        raise InputError(path, f"has no line for frame {lacking}", remedy=_FRAME_TIMES_REMEDY)
    rgb_s, depth_s = (np.array([times_s[frame][column] for frame in frames]) for column in (0, 1))
    late = np.flatnonzero(np.diff(rgb_s) <= 0)
    if late.size:
        raise InputError(
            path, f"frame {frames[late[0] + 1]} is not later than the one before it", remedy=_FRAME_TIMES_REMEDY
        )
    rgb = Stamps(rgb_s)
    return FrameStamps(rgb, rgb if np.array_equal(rgb_s, depth_s) else Stamps(depth_s), rgb)


def _times(path: Path) -> dict[int, tuple[float, float]]:
    """Return by frame the stamps of its colour and of its depth."""
    times_s: dict[int, tuple[float, float]] = {}
    for where, record in given_lines(path, _FRAME_TIMES_REMEDY):
        if not isinstance(record, dict) or not _is_frame(record.get("frame")) or record["frame"] in times_s:
            raise InputError(path, "is no line for a frame of its own", where=where, remedy=_FRAME_TIMES_REMEDY)
        time_s = finite_number(record.get("time_s"))
        depth_time_s = finite_number(record.get("depth_time_s", record.get("time_s")))
        if time_s is None or depth_time_s is None:
            raise InputError(path, "has no time stamp in seconds", where=where, remedy=_FRAME_TIMES_REMEDY)
        times_s[record["frame"]] = (time_s, depth_time_s)
    return times_s


def _is_frame(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


# Which colour, depth and pose of a recording belong together, decided by their time stamps.
#
# The rule is that of associate.py, which the TUM RGB-D benchmark publishes: of all pairs closer than PAIRING_S, the
# closest is taken, then the closest of those that are left, and each stamp is used once. Of equally close pairs the one
# that is earlier in the first list comes first, then the one that is earlier in the second.


# Frames of a recording whose pose is not known: left out, kept, or refused.


PosePolicy = Literal["drop", "keep", "require", "none"]
"""What becomes of frames without a pose: left out, kept without one, refused; none: no pose is looked for at all."""

_POSES = "poses: drop leaves them out, poses: keep keeps them"


def chosen_by_pose(path: Path, known: NDArray[np.bool_], policy: PosePolicy) -> tuple[NDArray[np.intp], str]:
    """Return the rows of the frames that are used, and a note on the others; "" where there is nothing to say.

    path: the file or folder of the poses, for messages. known: (N,) whether a frame has a pose. Raises InputError where
    a frame without one is not allowed, or none would be left.
    """
    rows, lacking = np.flatnonzero(known), int(np.count_nonzero(~known))
    everything = np.arange(len(known))
    if not lacking or policy == "none":
        return everything, ""
    message = f"{lacking} of {len(known)} frames have no valid pose"
    if policy == "require":
        raise InputError(path, f"{message}, the first is frame {int(np.argmin(known))}", remedy=_POSES)
    if policy == "keep":
        return everything, f"{message}; they are kept, and no pose is written for them"
    if not rows.size:
        raise InputError(path, message, remedy="poses: none uses the images without ground truth")
    return rows, f"{message} and are left out"


def truth_file(path: Path, policy: PosePolicy) -> Path | None:
    """Return the file of the poses; None where none is to be read, or it is not there and frames are kept anyway."""
    return None if policy == "none" or (policy == "keep" and not path.exists()) else path


def unposed(count: int) -> Trajectory:
    """Return a path of so many frames, a second apart, none of whose poses is known."""
    return Trajectory(np.tile(np.eye(4), (count, 1, 1)), np.arange(float(count)), posed=np.zeros(count, dtype=np.bool_))


PAIRING_S = 0.02  # stamps that belong together differ by less; the default of associate.py
# Chosen: seconds and a gigabyte; stamps of a camera in seconds make a few pairs for each image.
MAX_CANDIDATES = 10_000_000


@dataclass(frozen=True, eq=False)
class StampedFiles:
    """A list of images with their stamps, which increase; those of paired depth need not."""

    stamps: Stamps
    files: tuple[Path, ...]


@dataclass(frozen=True, eq=False)
class MatchedFrames:
    """The frames of a recording: a colour image each, with depth where it has any, and a pose where that is known.

    depth_files: one for each colour image; () of a recording without depth. trajectory: the poses, at the stamps of the
    colour. stamps: of colour, depth and poses. notes: on what is left out, and on how the poses were read.
    """

    rgb_files: tuple[Path, ...]
    depth_files: tuple[Path, ...]
    trajectory: Trajectory
    stamps: FrameStamps
    notes: tuple[str, ...]


def associate(
    first_s: NDArray[np.float64], second_s: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows of two lists of stamps that belong together, in the order of the first.

    first_s (N,), second_s (M,): seconds, increasing. Raises ValueError where more than MAX_CANDIDATES pairs are closer
    than PAIRING_S.
    """
    # The window is wider than the limit by float64's rounding; the limit itself is applied to the difference.
    wide_s = PAIRING_S + 4 * np.spacing(np.abs(first_s) + PAIRING_S)
    begin = np.searchsorted(second_s, first_s - wide_s, side="left")
    end = np.searchsorted(second_s, first_s + wide_s, side="right")
    count = end - begin
    total = int(count.sum())
    if total > MAX_CANDIDATES:
        raise ValueError(f"{total} pairs of stamps are closer than {PAIRING_S:g} s")
    first = np.repeat(np.arange(len(first_s)), count)
    second = np.arange(total) - np.repeat(np.cumsum(count) - count, count) + np.repeat(begin, count)
    apart_s = np.abs(first_s[first] - second_s[second])
    close = apart_s < PAIRING_S
    first, second, apart_s = first[close], second[close], apart_s[close]
    partner: dict[int, int] = {}
    taken: set[int] = set()
    for index in np.lexsort((second, first, apart_s)).tolist():
        here, there = int(first[index]), int(second[index])
        if here not in partner and there not in taken:
            partner[here] = there
            taken.add(there)
    rows = sorted(partner)
    return np.array(rows, dtype=np.int64), np.array([partner[row] for row in rows], dtype=np.int64)


def associate_frames(
    folder: Path,
    rgb: StampedFiles,
    depth: StampedFiles | None,
    path: Trajectory | None,
    pose_stamps: Stamps | None = None,
    *,
    paired: bool = False,
    policy: PosePolicy = "drop",
) -> MatchedFrames:
    """Return the frames of a recording: first each colour image with its depth, then each of these with its pose.

    depth, path: images of depth, and the ground truth; None where there is none. pose_stamps: those of the path where
    they are known more exactly than it holds them. paired: the i-th depth is that of the i-th colour image, whatever
    their stamps. policy: what becomes of frames without a pose. Raises InputError where no colour image has all that
    there is, or none is left.
    """
    poses = pose_stamps or Stamps(np.zeros(0) if path is None else path.stamps_s)
    try:
        if depth is None or paired:
            of_rgb = of_depth = np.arange(len(rgb.files), dtype=np.int64)
        else:
            of_rgb, of_depth = associate(rgb.stamps.seconds, depth.stamps.seconds)
        with_pose, of_pose = associate(rgb.stamps.seconds[of_rgb], poses.seconds)
    except ValueError as error:
        raise InputError(folder, str(error), remedy="stamps are seconds: are these in another unit?") from error
    if not len(of_rgb if path is None else with_pose):
        stamped = {"colour": rgb.stamps}
        stamped |= {} if depth is None else {"depth": depth.stamps}
        stamped |= {} if path is None else {"pose": poses}
        spans = [f"{name} {item.seconds[0]:.6f} to {item.seconds[-1]:.6f} s" for name, item in stamped.items() if item]
        *others, last = stamped
        problem = f"no {', '.join(others)} and {last} lie within {PAIRING_S} s of one another"
        raise InputError(folder, problem, remedy=", ".join(spans))
    with_depth = len(of_rgb)
    notes = () if path is None else path.notes
    if path is None or (policy in ("keep", "require") and len(with_pose) < with_depth):
        known = np.zeros(with_depth, dtype=np.bool_)
        known[with_pose] = True
        _, note = chosen_by_pose(folder, known, policy)
        notes += (note,) if note else ()
        c2w, taken = np.tile(np.eye(4), (with_depth, 1, 1)), rgb.stamps.take(of_rgb)
        if path is not None:
            c2w[with_pose] = path.c2w[of_pose]
        of_poses = _pose_stamps(taken, poses, with_pose, of_pose)
        trajectory = Trajectory(c2w, taken.seconds, posed=known)
    else:
        of_rgb, of_depth = of_rgb[with_pose], of_depth[with_pose]
        taken, of_poses = rgb.stamps.take(of_rgb), poses.take(of_pose)
        trajectory = Trajectory(path.c2w[of_pose], taken.seconds)
    excluded = _excluded(len(rgb.files), with_depth, len(of_rgb))
    return MatchedFrames(
        tuple(rgb.files[row] for row in of_rgb),
        () if depth is None else tuple(depth.files[row] for row in of_depth),
        trajectory,
        FrameStamps(taken, taken if depth is None else depth.stamps.take(of_depth), of_poses),
        (*notes, excluded) if excluded else notes,
    )


def _pose_stamps(taken: Stamps, poses: Stamps, with_pose: NDArray[np.int64], of_pose: NDArray[np.int64]) -> Stamps:
    """Return the stamps of the frames' poses; where there is none, that of the colour stands for it."""
    rows = dict(zip(with_pose.tolist(), of_pose.tolist(), strict=True))
    parts = [poses.take([rows[row]]) if row in rows else taken.take([row]) for row in range(len(taken))]
    seconds = np.concatenate([part.seconds for part in parts])
    exact = [part.exact_ns for part in parts]
    return Stamps(seconds, None if None in exact else tuple(stamp for part in exact if part for stamp in part))


def _excluded(images: int, paired: int, frames: int) -> str:
    """Say how many colour images have no depth, and how many of the others no pose; "" where each has both."""
    reasons = [(images - paired, "no depth image"), (paired - frames, "no pose")]
    parts = [f"{number} with {reason}" for number, reason in reasons if number]
    if not parts:
        return ""
    return f"{images - frames} of {images} colour images are left out: {', '.join(parts)} within {PAIRING_S} s"
