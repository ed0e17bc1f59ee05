# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses as matrices: Replica's and KITTI's lines, blocks of four lines, a folder of these, and Open3D's .log.

Replica: 16 numbers a line, a row-major 4 x 4 pose. KITTI: 12, its first three rows. Blocks: four lines of four numbers,
in one file or one pose a file (ScanNet, 7-Scenes). A .log, Redwood's format: before each block a line of three whole
numbers, the third of which is the frame's, counted from 1.
"""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, NotFiniteError
from ..core.geometry import nearest_rotation, pose, rotation_error
from ..core.trajectory import Trajectory
from .pose_files import (
    COLMAP_IMAGES,
    PER_SECOND,
    FilePoses,
    Float64,
    PoseFile,
    PoseRows,
    ReadOptions,
    TextRows,
    TrajectoryFormat,
    all_finite,
    read_text,
    text_rows,
)

# Tolerances of what a file says. Text of six digits is off by 1e-6. The wide ones are chosen: they mend files of three
# digits, and refuse a matrix with scale or shear.
_ROTATION_TOLERANCE = 5e-3  # entries of R^T R - 1
_ROTATION_EXACT = 1e-12  # below it a matrix is orthonormal to float64's rounding, and is kept as it is
_LAST_ROW_TOLERANCE = 1e-5  # float32 matrices that were inverted
_LARGEST_COUNT = 2.0**53  # up to which float64 holds every whole number


class AllLostError(NotFiniteError):
    """A file of matrices in which none is finite: tracking was lost in every frame. count: how many there are."""

    count: int = 0


_BLOCK = "a pose is four lines of four numbers"
# Camera-to-world: "the transformation matrix maps a point from its local coordinates to the world coordinates"
# (http://redwood-data.org/indoor/fileformat.html); Open3D's FileLOG.cpp inverts it to get a camera's extrinsics.
_LOG = "a .log has a line of three whole numbers and four lines of four for each pose"


def _line_poses(name: str, width: int, file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read a pose a line, 16 or 12 numbers. Raises InputError."""
    table = file.rows.table((width,))
    numbers = np.arange(len(table.values), dtype=np.float64)
    if options.skip_lost:
        return _finite_poses(name, table, numbers)
    return FilePoses(name, rigid_poses(all_finite(table)), numbers=numbers)


def _matrices(file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read a folder of one pose a file, or a file of poses; those that are not finite are left out."""
    if not file.is_folder:
        return _block_poses(file.rows)
    poses = _folder_poses(file.path)
    if options.stamp_unit is None:
        return poses
    assert poses.numbers is not None
    return replace(poses, stamps_s=poses.numbers / PER_SECOND[options.stamp_unit])


def _is_block(file: PoseFile) -> bool:
    """Tell whether the first row is one of a matrix: four numbers, which semicolons do not part."""
    return file.first_widths[:1] == (4,) and ";" not in file.lines.texts[0]


def _block_poses(rows: TextRows) -> FilePoses:
    """Read blocks of four lines, or a line for each pose; those that are not finite are left out."""
    if int(rows.widths[0]) in (12, 16):
        table = rows.table((12, 16))
        return _finite_poses("matrices", table, np.arange(len(table.values), dtype=np.float64))
    table = rows.table((4,), _BLOCK)
    if len(table.values) % 4:
        problem = f"{len(table.values)} lines of four numbers are no whole number of poses"
        raise InputError(rows.path, problem, where=f"line {table.lines[-1]}", remedy=_BLOCK)
    blocks = PoseRows(rows.path, table.values.reshape(-1, 16), table.lines[::4])
    return _finite_poses("matrices", blocks, np.arange(len(blocks.values), dtype=np.float64))


def _log_poses(file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read a .log. Raises InputError, also for one that pairs fragments instead of placing frames."""
    del options
    rows = file.rows
    expected = np.where(np.arange(len(rows.widths)) % 5 == 0, 3, 4)
    wrong = np.flatnonzero(rows.widths != expected)
    if wrong.size or len(rows.widths) % 5:
        row = int(wrong[0]) if wrong.size else len(rows.widths) - 1
        problem = f"{rows.widths[row]} numbers" + ("" if wrong.size else ", and the pose is not complete")
        raise InputError(rows.path, problem, where=f"line {rows.lines[row]}", remedy=_LOG)
    values = rows.numbers.reshape(-1, 19)
    about = PoseRows(rows.path, values[:, :3], rows.lines[::5])
    counts = (about.values == np.floor(about.values)) & (np.abs(about.values) < _LARGEST_COUNT)
    about.fail_where(~counts.all(axis=1), "{}", of=about.values, remedy=_LOG)
    first, second, third = about.values.T
    # Alignments of fragments are stored alike: which two, and of how many.
    if (first != second).any() and (third == third[0]).all() and (np.maximum(first, second) < third).all():
        about.fail_where(first != second, "aligns two fragments ({}); this is no path", of=about.values)
    numbers = np.arange(len(values), dtype=np.float64)
    if (np.diff(third) > 0).all() and third[0] >= 0:
        numbers = third - min(third[0], 1.0)
    return replace(_finite_poses("log", PoseRows(rows.path, values[:, 3:], rows.lines[1::5]), numbers), sparse=True)


# --- a folder ---


def _folder_poses(folder: Path) -> FilePoses:
    """Read a folder of numbered .txt files, one pose each, in the order of the numbers.

    The number is the last in a file's name: 12.txt, frame-000012.pose.txt. Poses that are not finite are left out.
    Raises InputError.
    """
    files, numbers, ignored = _numbered_files(folder)
    blocks = []
    for file in files:
        rows = text_rows(file, read_text(file))
        if rows.widths.tolist() != [4, 4, 4, 4]:
            wrong = next((row for row, width in enumerate(rows.widths) if width != 4), len(rows.widths) - 1)
            problem = f"{rows.widths[wrong]} numbers" if rows.widths[wrong] != 4 else f"{len(rows.widths)} lines"
            raise InputError(file, problem, where=f"line {rows.lines[wrong]}", remedy=_BLOCK)
        blocks.append((rows.numbers, rows.lines[0]))
    values, lines = np.array([block for block, _ in blocks]), np.array([line for _, line in blocks])
    found = _finite_poses("matrices", PoseRows(files, values, lines), np.array(numbers, dtype=np.float64))
    found = replace(found, sparse=True)
    if not ignored:
        return found
    more = f" and {len(ignored) - 1} more" if len(ignored) > 1 else ""
    note = f"{ignored[0].name}{more} in {folder.name} not read: a file of a pose has a number in its name"
    return replace(found, notes=(*found.notes, note))


def numbered_files(folder: Path) -> list[Path]:
    """Return the files of a folder's poses, in their order. Raises InputError."""
    return _numbered_files(folder)[0]


def _numbered_files(folder: Path) -> tuple[list[Path], list[int], list[Path]]:
    """Return the files by number, their numbers, and the .txt files without one."""
    try:
        texts = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".txt" and path.is_file())
    except OSError as error:
        raise InputError(folder, f"cannot be read: {error.strerror or error}") from None
    found: dict[int, Path] = {}
    kinds: dict[tuple[str, str], Path] = {}
    ignored = []
    for path in texts:
        match = re.fullmatch(r"(.*?)([0-9]+)([^0-9]*)", path.name)
        if match is None:
            ignored.append(path)
            continue
        kinds.setdefault((match[1], match[3]), path)
        if len(kinds) > 1:
            one, other = (path.name for path in kinds.values())
            remedy = "leave only the files of poses there"
            raise InputError(folder, f"holds two kinds of numbered files, {one} and {other}", remedy=remedy)
        if (same := found.setdefault(int(match[2]), path)) != path:
            raise InputError(folder, f"{same.name} and {path.name} have one number", remedy="keep one of them")
    if not found:
        remedy = "a folder holds one pose a file: 0.txt, 1.txt or frame-000000.pose.txt and so on"
        raise InputError(folder, "is a folder without numbered .txt files", remedy=remedy)
    numbers = sorted(found)
    return [found[number] for number in numbers], numbers, ignored


def _holds_poses(folder: Path) -> bool:
    """Tell whether a folder has numbered .txt files, and is none of COLMAP, whose points3D.txt has a number too."""
    if (folder / COLMAP_IMAGES).exists():
        return False
    try:
        _numbered_files(folder)
    except InputError:
        return False
    return True


# --- matrices ---


def _finite_poses(format_name: str, blocks: PoseRows, numbers: Float64) -> FilePoses:
    """Return the poses that are finite; of the others, which mean that tracking was lost, a note."""
    found = np.isfinite(blocks.values).all(axis=1)
    notes: tuple[str, ...] = ()
    if not found.all():
        file, where = blocks.place(int(np.argmin(found)))
        lost = f"{np.count_nonzero(~found)} of {len(found)} poses are not finite (tracking was lost)"
        if not found.any():
            error = AllLostError(file, f"{lost}: no pose is left", where=where, remedy="choose another recording")
            error.count = len(found)
            raise error
        notes = (f"{lost} and are left out, first {file.name} {where}; the others keep their times",)
    poses = rigid_poses(blocks.keep(found))
    return FilePoses(format_name, poses, numbers=numbers[found], notes=notes, listed=numbers)


def rigid_poses(rows: PoseRows) -> Float64:
    """(N, 16 | 12) row-major -> (N, 4, 4), rotations made orthonormal. Raises InputError where a pose is not rigid."""
    matrices = rows.values.reshape(len(rows.values), -1, 4)
    if matrices.shape[1] == 4:
        wrong = (np.abs(matrices[:, 3] - [0.0, 0.0, 0.0, 1.0]) > _LAST_ROW_TOLERANCE).any(axis=1)
        problem, remedy = "the last row of the pose is {}, not 0 0 0 1", "write each pose row by row"
        rows.fail_where(wrong, problem, of=matrices[:, 3], remedy=remedy)
    rotation = matrices[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        error = rotation_error(rotation)
        determinant = np.linalg.det(rotation)
    off: NDArray[np.bool_] = ~(error <= _ROTATION_TOLERANCE)
    problem = "the left 3 x 3 numbers are no rotation: R^T R is off by {}"
    remedy = "a pose is rigid, without scale; its numbers are row-major"
    rows.fail_where(off, problem, of=error, remedy=remedy)
    problem = "the pose mirrors (determinant {})"
    remedy = "do not negate an axis: leave the poses as they were and declare their axes (opencv, opengl or robot)"
    rows.fail_where(determinant < 0.0, problem, of=determinant, remedy=remedy)
    rounded = error > _ROTATION_EXACT
    rotation = rotation.copy()
    rotation[rounded] = nearest_rotation(rotation[rounded])
    return pose(rotation, matrices[:, :3, 3])


def row_text(rows: Float64) -> str:
    """Return numbers, a line for each row (N, C), as text that reads back to the same float64."""
    # Python's repr is the shortest such text; + 0.0 turns -0.0 into 0.0.
    return "".join([" ".join(map(repr, row)) + "\n" for row in (rows + 0.0).tolist()])


def replica_text(trajectory: Trajectory) -> str:
    """One line a frame: 16 row-major numbers of c2w, OpenCV axes; every number reads back to the same float64."""
    return row_text(trajectory.c2w.reshape(-1, 16))


# --- the formats ---

REPLICA = TrajectoryFormat(
    "replica",
    "Replica",
    "16 numbers a line, a 4 x 4 pose",
    lambda file: file.columns is None and file.first_widths[:1] == (16,),
    partial(_line_poses, "replica", 16),
    write=replica_text,
    looks_like="16 numbers a line, a 4 x 4 pose row by row",
    recognised_by="16 numbers",
    times="`rate_hz`",
    order=10,
)
KITTI = TrajectoryFormat(
    "kitti",
    "KITTI",
    "12 numbers a line, a 3 x 4 pose",
    lambda file: file.columns is None and file.first_widths[:1] == (12,),
    partial(_line_poses, "kitti", 12),
    looks_like="12 numbers a line, a pose without its last row",
    recognised_by="12 numbers",
    times="`rate_hz`",
    order=20,
)
MATRICES = TrajectoryFormat(
    "matrices",
    "Matrices",
    "Four lines a pose, in one file or in a folder with a file for each pose",
    lambda file: _holds_poses(file.path) if file.is_folder else _is_block(file),
    _matrices,
    reads_folders=True,
    looks_like="four lines of four numbers a pose, in one file, or in a folder of `0.txt`, `1.txt` or "
    "`frame-000000.pose.txt`: ScanNet, 7-Scenes",
    recognised_by="4 numbers; a folder",
    times="`rate_hz`; the files' numbers / `rate_hz`",
    order=50,
)
LOG = TrajectoryFormat(
    "log",
    "Open3D Log",
    "Three whole numbers, then four lines a pose",
    lambda file: file.first_widths == (3, 4),
    _log_poses,
    looks_like="Open3D and Redwood: `i i n`, then four lines of four numbers",
    recognised_by="3 numbers, then 4",
    times="the frames' numbers `n`, from 1, / `rate_hz`",
    order=60,
)
FORMAT = REPLICA, KITTI, MATRICES, LOG
