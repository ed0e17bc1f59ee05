# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectory formats, and reading a file of any: each is an object, and packages bring more.

`docs/trajectories.md` says what each looks like and how it is recognised.
"""

import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, Message, PresetKey
from ..core.packages import Door, Registry
from ..core.schema import Choice, ChoicesOf, key
from ..core.trajectory import AXES, DIRECTIONS, Axes, Direction, Trajectory, checked_rate, convert_convention
from .pose_columns import STAMP_UNITS, StampUnit
from .pose_files import (
    LARGEST_READ_BYTES,
    LARGEST_STAMP_S,
    FilePoses,
    PoseFile,
    ReadOptions,
    StatedCamera,
    TrajectoryFormat,
)

Auto: TypeAlias = Literal["auto"]

# Aircraft's worlds have z down; ours have it up. x stays.
UP_FROM_NED = np.diag([1.0, -1.0, -1.0, 1.0])


def _problem(item: TrajectoryFormat) -> str:
    """Return what a format does not say of itself, in a sentence, or ""."""
    if lacking := [name for name in ("name", "label", "meaning") if not getattr(item, name)]:
        return f"its trajectory format lacks {', '.join(lacking)}"
    if item.name == "auto" or not re.fullmatch(r"[a-z][a-z0-9_]*", item.name):
        return f"{item.name!r} is no name of a format: small letters, digits and underscores, a letter first"
    return ""


DOOR = Door("noisy_world.trajectory_formats", "trajectory format", "FORMAT", (TrajectoryFormat,), _problem)

TRAJECTORY_FORMATS = Registry(DOOR, __package__)
"""Every format of files of poses by its name, ours and those of installed packages."""


# What presets say of files of poses, and of recordings.


PoseDirection: TypeAlias = Literal["auto", "c2w", "w2c"]
PoseAxes: TypeAlias = Literal["auto", "opencv", "opengl", "robot", "ned"]
StampUnits: TypeAlias = Literal["auto", "s", "ms", "us", "ns"]


@dataclass(frozen=True)
class PoseKeys:
    """What a preset says of a file of poses, where its content should not decide."""

    format: str = key(
        "the file's format, where its content should not decide",
        default="auto",
        choices=ChoicesOf(
            TRAJECTORY_FORMATS,
            lambda item: Choice(item.label, item.meaning),
            {"auto": Choice("Automatic", "As the file's content tells")},
        ),
        identity="meaning",
    )
    pose: PoseDirection = key(
        "whether the file holds camera-to-world or world-to-camera; auto is camera-to-world",
        default="auto",
        choices={
            "auto": Choice("Automatic", "Camera to World"),
            "c2w": Choice("Camera to World", "A pose takes points from the camera to the world"),
            "w2c": Choice("World to Camera", "A pose takes points from the world to the camera"),
        },
        identity="meaning",
    )
    axes: PoseAxes = key(
        "the file's camera axes: x right, y down, z forward; y up, z backward; x forward, y left, z up; or x forward, "
        "y right, z down in a world whose z is down; auto is opencv, opengl for transforms.json, ned for tartanair",
        default="auto",
        choices={
            "auto": Choice("Automatic", "OpenGL for a transforms.json, NED for TartanAir's, else OpenCV"),
            "opencv": Choice("OpenCV", "The camera looks along z: x right, y down, z forward"),
            "opengl": Choice("OpenGL", "As Blender's cameras: x right, y up, z backward"),
            "robot": Choice("Robot", "The camera looks along x: x forward, y left, z up"),
            "ned": Choice("NED", "As aircraft have it: x forward, y right, z down, in a world whose z is down"),
        },
        identity="meaning",
    )
    stamp_unit: StampUnits = key(
        "the unit of the file's time stamps; auto tells seconds from nanoseconds",
        default="auto",
        choices={
            "auto": Choice("Automatic", "Seconds or nanoseconds, as large as the numbers are"),
            "s": Choice("Seconds", "The time stamps are seconds"),
            "ms": Choice("Milliseconds", "The time stamps are milliseconds"),
            "us": Choice("Microseconds", "The time stamps are microseconds"),
            "ns": Choice("Nanoseconds", "The time stamps are nanoseconds"),
        },
        identity="meaning",
    )


@dataclass(frozen=True, eq=False)
class TrajectoryFile:
    """What a file of poses holds.

    format: what it was read as. axes, direction: those of its poses.
    camera: the intrinsics that it states, None where it does not. trajectory.notes: what was left out.
    """

    format: str
    direction: Direction
    axes: Axes
    trajectory: Trajectory
    camera: StatedCamera | None


def read_trajectory(
    path: str | Path,
    *,
    format: str = "auto",  # noqa: A002 - the preset's key
    direction: Direction | Auto = "auto",
    axes: Axes | Auto = "auto",
    rate_hz: float = 20.0,
    stamp_unit: StampUnit | Auto = "auto",
) -> Trajectory:
    """Read the poses of a file, or of a folder with one pose a file; its notes say what was left out.

    format: what the file is, where its content should not decide. direction, axes: the convention of its poses; "auto"
    is the format's own: camera-to-world with OpenCV's axes for all of ours but transforms.json, which has OpenGL's, and
    tartanair, which has an aircraft's ("ned"); the world of these has z down, and is turned about x.
    stamp_unit: of its stamps, "auto" is the format's. Files without stamps get 0, 1 / rate_hz, ... seconds. Rotations
    that are off by rounding are made orthonormal. Raises InputError, which names file and line, for anything that is
    not a trajectory of rigid poses, and ValueError for an argument that does not exist, or a rate that is not positive.
    """
    found = read_trajectory_file(
        path, format=format, direction=direction, axes=axes, rate_hz=rate_hz, stamp_unit=stamp_unit
    )
    return found.trajectory


def upright_poses(poses: NDArray[np.float64], direction: Direction, axes: Axes) -> NDArray[np.float64]:
    """(N, 4, 4) poses as a file declares them -> c2w with OpenCV's camera axes; an aircraft's world is turned up."""
    c2w = convert_convention(poses, direction=direction, axes=axes)
    return UP_FROM_NED @ c2w + 0.0 if axes == "ned" else c2w  # + 0.0: no negative zeros


def read_trajectory_file(
    path: str | Path,
    *,
    format: str = "auto",  # noqa: A002
    direction: Direction | Auto = "auto",
    axes: Axes | Auto = "auto",
    rate_hz: float = 20.0,
    stamp_unit: StampUnit | Auto = "auto",
) -> TrajectoryFile:
    """Read a file as `read_trajectory` does; return also what it is and what else it says."""
    _check_name("direction", direction, DIRECTIONS)
    _check_name("axes", axes, AXES)
    checked_rate(rate_hz)
    path = Path(path)
    poses = read_file_poses(path, format=format, stamp_unit=stamp_unit)
    own_axes = poses.axes if axes == "auto" else axes
    own_direction = poses.direction if direction == "auto" else direction
    c2w = upright_poses(poses.poses, own_direction, own_axes)
    unit = None if stamp_unit == "auto" else stamp_unit
    trajectory = Trajectory(c2w, _stamps_s(path, poses, rate_hz, unit), poses.notes)
    return TrajectoryFile(poses.format, own_direction, own_axes, trajectory, poses.camera)


def read_file_poses(
    file: Path | PoseFile,
    *,
    format: str = "auto",  # noqa: A002
    stamp_unit: StampUnit | Auto = "auto",
    skip_lost: bool = False,
    largest_bytes: int = LARGEST_READ_BYTES,
) -> FilePoses:
    """Read a file's poses as they stand there: with their stamps, or with their numbers where there are none.

    skip_lost: whether it is an estimate: a matrix that is not finite, and a row of NaN, is a frame in which tracking
    was lost, and left out, which is so in `matrices` and `log` for any file. largest_bytes: that are read of arrays.
    Raises InputError as `read_trajectory` does, NotFiniteError, which is one, where a pose is not finite, and
    ValueError for an argument that does not exist.
    """
    _check_name("format", format, TRAJECTORY_FORMATS)
    _check_name("stamp_unit", stamp_unit, STAMP_UNITS)
    file = file if isinstance(file, PoseFile) else PoseFile(file)
    declared = format != "auto"
    known = format_of(file, format)
    if file.is_folder and not known.reads_folders:
        remedy = "a folder holds one pose a file: format: matrices, or auto"
        raise InputError(file.path, f"is a folder, which is not {known.name}", remedy=remedy)
    unit = None if stamp_unit == "auto" else stamp_unit
    return known.read(file, ReadOptions(declared, unit, skip_lost, largest_bytes))


def format_of(file: PoseFile, name: str = "auto") -> TrajectoryFormat:
    """Return a format by its name or, for "auto", the one of a file. Raises InputError where it may be of several."""
    return TRAJECTORY_FORMATS[name] if name != "auto" else _recognised(file)


def _recognised(file: PoseFile) -> TrajectoryFormat:
    """Return the format that recognises a file; where none does, one whose reader says what is wrong."""
    names = [item.name for item in TRAJECTORY_FORMATS.values() if item.recognises(file)]
    if len(names) > 1:
        remedy = Message("say which: ", PresetKey("format"))
        raise InputError(file.path, f"may be of the formats {' and '.join(names)}", remedy=remedy)
    return TRAJECTORY_FORMATS[names[0] if names else "matrices" if file.is_folder else "tum"]


def _stamps_s(path: Path, poses: FilePoses, rate_hz: float, unit: StampUnit | None) -> NDArray[np.float64]:
    if poses.stamps_s is not None:
        stamps_s = poses.stamps_s
    else:
        assert poses.numbers is not None, "poses have stamps or numbers"
        if unit is not None:
            remedy = Message(
                "leave ", PresetKey("stamp_unit"), " out; ", PresetKey("rate_hz"), " gives the frames' times"
            )
            raise InputError(path, f"has no time stamps ({poses.format}), so none in {unit}", remedy=remedy)
        with np.errstate(over="ignore"):
            stamps_s = poses.numbers / rate_hz
    last_s = float(np.abs(stamps_s).max())
    if not last_s <= LARGEST_STAMP_S:
        problem = f"frames would reach {last_s:.3g} s, over 3,000 years, at {rate_hz:g} Hz"
        stamps = Message("numbers that are time stamps need ", PresetKey("stamp_unit"))
        remedy = Message("raise ", PresetKey("rate_hz"), ", or number the files from 0; ", stamps)
        raise InputError(path, problem, remedy=remedy)
    if np.any(np.diff(stamps_s) <= 0.0):
        raise InputError(path, "numbers its frames too closely for float64 seconds", remedy="number them from 0")
    return stamps_s


def _check_name(what: str, name: str, known: Collection[str]) -> None:
    if name != "auto" and name not in known:
        raise ValueError(f"{what} is auto or one of {', '.join(known)}, not {name!r}")
