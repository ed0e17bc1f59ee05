# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectory files: Replica, KITTI and TUM, told apart by their content.

Replica: 16 numbers a line, a row-major 4 x 4 pose. KITTI: 12, its first three rows. TUM: 8, `t tx ty tz qx qy qz qw`.
One pose a line, numbers separated by blanks or by commas; blank lines and comments from # on are skipped.
"""

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry import (
    continuous_quats,
    nearest_rotation,
    pose,
    quat_wxyz_from_rotation,
    rotation_error,
    rotation_from_quat_wxyz,
)
from .trajectory import Axes, Direction, Trajectory, convert_convention, evenly_stamped

type TrajectoryFormat = Literal["replica", "kitti", "tum"]

# By the numbers on a line, which the module's docstring describes.
_FORMATS: dict[int, TrajectoryFormat] = {16: "replica", 12: "kitti", 8: "tum"}
_ONE_POSE_A_LINE = "a line holds one pose: 16 numbers (Replica), 12 (KITTI) or 8 (TUM)"

# Tolerances of what a file says. Text of six digits is off by 1e-6. The wide ones are chosen: they mend files of three
# digits, and refuse a matrix with scale or shear.
_ROTATION_TOLERANCE = 5e-3  # entries of R^T R - 1
_ROTATION_EXACT = 1e-12  # below it a matrix is orthonormal to float64's rounding, and is kept as it is
_QUAT_NORM_TOLERANCE = 1e-2
_LAST_ROW_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class _Table:
    """The numbers of a file, (N, 16 | 12 | 8) float64, and the line of the file that each row is from, 1 the first."""

    path: Path
    values: NDArray[np.float64]
    lines: NDArray[np.int64]

    def fail_where(self, wrong: NDArray[np.bool_], problem: str, *, remedy: str = "", of: object = None) -> None:
        """Raise InputError for the first row that is wrong; `{}` in `problem` is replaced by that row of `of`."""
        if not wrong.any():
            return
        row = int(np.argmax(wrong))
        shown = "" if of is None else _shown(np.asarray(of)[row])
        raise InputError(self.path, problem.format(shown), where=f"line {self.lines[row]}", remedy=remedy)


def read_trajectory(
    path: str | Path, *, direction: Direction = "c2w", axes: Axes = "opencv", rate_hz: float = 20.0
) -> Trajectory:
    """Read a Replica, KITTI or TUM file whose poses have the declared direction and camera axes.

    TUM files keep their stamps, the others get 0, 1 / rate_hz, ... seconds. Rotations that are off by rounding are made
    orthonormal. Raises InputError, which names file and line, for anything that is not a trajectory of rigid poses, and
    ValueError for an unknown direction or axes, or a rate that is not positive.
    """
    table = _read_table(Path(path))
    if table.values.shape[1] == 8:
        stamps_s, poses = _tum_poses(table)
        return Trajectory(convert_convention(poses, direction=direction, axes=axes), stamps_s)
    return evenly_stamped(convert_convention(_matrix_poses(table), direction=direction, axes=axes), rate_hz)


def detect_format(path: str | Path) -> TrajectoryFormat:
    """Tell "replica", "kitti" or "tum" by the numbers on each line. Raises InputError as read_trajectory does."""
    return _FORMATS[_read_table(Path(path)).values.shape[1]]


def replica_text(trajectory: Trajectory) -> str:
    """One line a frame: 16 row-major numbers of c2w, OpenCV axes; every number reads back to the same float64."""
    return _text(trajectory.c2w.reshape(-1, 16))


def kitti_text(trajectory: Trajectory) -> str:
    """One line a frame: 12 row-major numbers of c2w without its last row, OpenCV axes; stamps are not kept."""
    return _text(trajectory.c2w[:, :3, :].reshape(-1, 12))


def tum_text(trajectory: Trajectory) -> str:
    """One line a frame: `t tx ty tz qx qy qz qw` of c2w, OpenCV axes; signs of q are chosen so that it never jumps."""
    quat_wxyz = continuous_quats(quat_wxyz_from_rotation(trajectory.c2w[:, :3, :3]))
    columns = [trajectory.stamps_s[:, None], trajectory.c2w[:, :3, 3], np.roll(quat_wxyz, -1, axis=1)]
    return _text(np.concatenate(columns, axis=1))


def _text(rows: NDArray[np.float64]) -> str:
    # Python's repr is the shortest text that reads back to the same float64; + 0.0 turns -0.0 into 0.0.
    return "".join(" ".join(map(repr, row)) + "\n" for row in (rows + 0.0).tolist())


def _read_table(path: Path) -> _Table:
    numbers = array("d")
    lines: list[int] = []
    width = 0
    for line_number, line in enumerate(_read_lines(path), start=1):
        data = line.partition("#")[0]
        if not data or data.isspace():
            continue
        row = _parse_line(path, line_number, data)
        if len(row) != width:
            if lines:
                problem = f"{len(row)} numbers, but line {lines[0]} has {width}"
                raise InputError(path, problem, where=f"line {line_number}", remedy="a file has one format throughout")
            width = len(row)
            if width not in _FORMATS:
                raise InputError(path, f"{width} numbers", where=f"line {line_number}", remedy=_ONE_POSE_A_LINE)
        numbers.fromlist(row)
        lines.append(line_number)
    if not lines:
        raise InputError(path, "holds no pose", remedy=_ONE_POSE_A_LINE)
    table = _Table(path, np.array(numbers).reshape(-1, width), np.array(lines))
    finite = np.isfinite(table.values)
    shown = table.values[np.arange(len(lines)), np.argmin(finite, axis=1)]
    table.fail_where(~finite.all(axis=1), "holds {}", of=shown, remedy="leave out the frames without a pose")
    return table


def _read_lines(path: Path) -> list[str]:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(path, "does not exist") from None
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise InputError(path, "is not a text file", remedy="a trajectory is UTF-8 text; " + _ONE_POSE_A_LINE)
    # Not splitlines, which also splits at characters that editors do not show as line ends.
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _parse_line(path: Path, line_number: int, data: str) -> list[float]:
    # Where there are commas, only they separate numbers: else "0,5 1,5" would be read as four numbers.
    tokens = [token.strip() for token in data.split(",")] if "," in data else data.split()
    if len(tokens) > 1 and not tokens[-1]:
        tokens.pop()
    try:
        row = list(map(float, tokens))
    except ValueError:
        row = None
    # float() also accepts 1_000 and digits of other scripts, which no other reader of these files does.
    if row is None or "_" in data or not data.isascii():
        raise InputError(path, f"{_first_non_number(tokens)!r} is not a number", where=f"line {line_number}")
    return row


def _first_non_number(tokens: Sequence[str]) -> str:
    for token in tokens:
        try:
            float(token)
        except ValueError:
            return token
        if "_" in token or not token.isascii():
            return token
    return tokens[0]


def _matrix_poses(table: _Table) -> NDArray[np.float64]:
    rows = table.values.reshape(len(table.values), -1, 4)
    if rows.shape[1] == 4:
        wrong = (np.abs(rows[:, 3] - [0.0, 0.0, 0.0, 1.0]) > _LAST_ROW_TOLERANCE).any(axis=1)
        remedy = "write each pose row by row"
        table.fail_where(wrong, "the last row of the pose is {}, not 0 0 0 1", of=rows[:, 3], remedy=remedy)
    rotation = rows[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        error = rotation_error(rotation)
        determinant = np.linalg.det(rotation)
    off = ~(error <= _ROTATION_TOLERANCE)
    problem = "the left 3 x 3 numbers are no rotation: R^T R is off by {}"
    remedy = "a pose is rigid, without scale; Replica and KITTI lines are row-major"
    table.fail_where(off, problem, of=error, remedy=remedy)
    problem = "the pose mirrors (determinant {})"
    remedy = "do not negate an axis: leave the poses as they were and declare their axes (opencv, opengl or robot)"
    table.fail_where(determinant < 0.0, problem, of=determinant, remedy=remedy)
    rounded = error > _ROTATION_EXACT
    rotation = rotation.copy()
    rotation[rounded] = nearest_rotation(rotation[rounded])
    return pose(rotation, rows[:, :3, 3])


def _tum_poses(table: _Table) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    stamps_s, position, quat_xyzw = table.values[:, 0], table.values[:, 1:4], table.values[:, 4:]
    late = np.concatenate([[False], np.diff(stamps_s) <= 0.0])
    remedy = "sort the lines by time and leave out duplicates"
    table.fail_where(late, "the time stamp {} does not come after the one before it", of=stamps_s, remedy=remedy)
    length = np.array([math.hypot(*quat) for quat in quat_xyzw.tolist()])
    wrong = np.abs(length - 1.0) > _QUAT_NORM_TOLERANCE
    remedy = "a TUM line is t tx ty tz qx qy qz qw"
    table.fail_where(wrong, "the quaternion has length {}, not 1", of=length, remedy=remedy)
    return stamps_s, pose(rotation_from_quat_wxyz(np.roll(quat_xyzw, 1, axis=1)), position)


def _shown(value: NDArray[np.float64]) -> str:
    return " ".join(f"{number:.10g}" for number in np.atleast_1d(value))
