# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectory files: their formats told apart by content, read and written.

Replica, KITTI, TUM and EuRoC hold a pose a line; further there are blocks of four lines (in one file, or a folder of
one pose a file), Open3D's .log and nerfstudio's transforms.json. `docs/trajectories.md` says how each is recognised.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry import continuous_quats, quat_wxyz_from_rotation
from ..messages import Message, PresetKey
from .matrix_poses import block_poses, folder_poses, is_log, line_poses, log_poses
from .pose_text import FORMATS, LARGEST_STAMP_S, FilePoses, TextRows, TrajectoryFormat, read_text, text_rows
from .stamped_poses import PER_SECOND, STAMP_UNITS, StampUnit, stamped_poses
from .stated_camera import StatedCamera
from .trajectory import AXES, DIRECTIONS, Axes, Direction, Trajectory, checked_rate, convert_convention
from .transforms_json import transforms_poses

STAMPED_FORMATS: tuple[TrajectoryFormat, ...] = ("tum", "euroc")
"""The formats whose poses have time stamps."""

Auto: TypeAlias = Literal["auto"]


@dataclass(frozen=True, eq=False)
class TrajectoryFile:
    """What a file of poses holds.

    format: what it was read as. axes, direction: those of its poses.
    camera: the intrinsics that it states, None where it does not. trajectory.notes: what was left out.
    """

    format: TrajectoryFormat
    direction: Direction
    axes: Axes
    trajectory: Trajectory
    camera: StatedCamera | None


def read_trajectory(
    path: str | Path,
    *,
    format: TrajectoryFormat | Auto = "auto",  # noqa: A002 - the preset's key
    direction: Direction | Auto = "auto",
    axes: Axes | Auto = "auto",
    rate_hz: float = 20.0,
    stamp_unit: StampUnit | Auto = "auto",
) -> Trajectory:
    """Read the poses of a file, or of a folder with one pose a file; its notes say what was left out.

    format: what the file is, where its content should not decide. direction, axes: the convention of its poses; "auto"
    is camera-to-world with the axes of the format, OpenCV's for all but transforms.json. stamp_unit: of its stamps,
    "auto" is the format's. Files without stamps get 0, 1 / rate_hz, ... seconds. Rotations that are off by rounding
    are made orthonormal. Raises InputError, which names file and line, for anything that is not a trajectory of rigid
    poses, and ValueError for an argument that does not exist, or a rate that is not positive.
    """
    found = read_trajectory_file(
        path, format=format, direction=direction, axes=axes, rate_hz=rate_hz, stamp_unit=stamp_unit
    )
    return found.trajectory


def read_trajectory_file(
    path: str | Path,
    *,
    format: TrajectoryFormat | Auto = "auto",  # noqa: A002
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
    own_direction: Direction = "c2w" if direction == "auto" else direction
    c2w = convert_convention(poses.poses, direction=own_direction, axes=own_axes)
    unit = None if stamp_unit == "auto" else stamp_unit
    trajectory = Trajectory(c2w, _stamps_s(path, poses, rate_hz, unit), poses.notes)
    return TrajectoryFile(poses.format, own_direction, own_axes, trajectory, poses.camera)


def read_file_poses(
    path: Path,
    *,
    format: TrajectoryFormat | Auto = "auto",  # noqa: A002
    stamp_unit: StampUnit | Auto = "auto",
    lost: bool = False,
) -> FilePoses:
    """Read a file's poses as they stand there: with their stamps, or with their numbers where there are none.

    lost: whether a matrix that is not finite is a frame in which tracking was lost in every format of matrices, and so
    left out; else in `matrices` and `log` alone. Raises InputError as `read_trajectory` does, NotFiniteError, which is
    one, where a pose is not finite, and ValueError for an argument that does not exist.
    """
    _check_name("format", format, FORMATS)
    _check_name("stamp_unit", stamp_unit, STAMP_UNITS)
    return _read(path, None if format == "auto" else format, None if stamp_unit == "auto" else stamp_unit, lost=lost)


def detect_format(path: str | Path) -> TrajectoryFormat:
    """Tell the format of a file by its content. Raises InputError as read_trajectory does."""
    return _read(Path(path), None, None).format


def _read(path: Path, declared: TrajectoryFormat | None, unit: StampUnit | None, *, lost: bool = False) -> FilePoses:
    if path.is_dir():
        if declared not in (None, "matrices"):
            remedy = "a folder holds one pose a file: format: matrices, or auto"
            raise InputError(path, f"is a folder, which is not {declared}", remedy=remedy)
        poses = folder_poses(path)
        if unit is not None:
            assert poses.numbers is not None
            poses = replace(poses, stamps_s=poses.numbers / PER_SECOND[unit])
        return poses
    text = read_text(path)
    if declared == "transforms" or (declared is None and text.lstrip().startswith(("{", "["))):
        return transforms_poses(path, text)
    return _read_rows(text_rows(path, text), declared, unit, lost=lost)


def _read_rows(rows: TextRows, declared: TrajectoryFormat | None, unit: StampUnit | None, *, lost: bool) -> FilePoses:
    width = int(rows.widths[0])
    if declared in ("replica", "kitti"):
        return line_poses(rows, 16 if declared == "replica" else 12, lost=lost)
    if declared == "log" or (declared is None and is_log(rows)):
        return log_poses(rows)
    if declared == "matrices" or (declared is None and width == 4):
        return block_poses(rows)
    if declared in ("tum", "euroc"):
        return stamped_poses(rows, cast("Literal['tum', 'euroc']", declared), unit)
    return line_poses(rows, lost=lost) if width in (12, 16) else stamped_poses(rows, None, unit)


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


def _check_name(what: str, name: str, known: tuple[str, ...]) -> None:
    if name != "auto" and name not in known:
        raise ValueError(f"{what} is auto or one of {', '.join(known)}, not {name!r}")


# --- writing ---


def replica_text(trajectory: Trajectory) -> str:
    """One line a frame: 16 row-major numbers of c2w, OpenCV axes; every number reads back to the same float64."""
    return _text(trajectory.c2w.reshape(-1, 16))


def tum_text(trajectory: Trajectory) -> str:
    """One line a frame: `t tx ty tz qx qy qz qw` of c2w, OpenCV axes; signs of q are chosen so that it never jumps."""
    quat_wxyz = continuous_quats(quat_wxyz_from_rotation(trajectory.c2w[:, :3, :3]))
    columns = [trajectory.stamps_s[:, None], trajectory.c2w[:, :3, 3], np.roll(quat_wxyz, -1, axis=1)]
    return _text(np.concatenate(columns, axis=1))


def _text(rows: NDArray[np.float64]) -> str:
    # Python's repr is the shortest text that reads back to the same float64; + 0.0 turns -0.0 into 0.0.
    return "".join(" ".join(map(repr, row)) + "\n" for row in (rows + 0.0).tolist())
