# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses with time stamps, one a line: TUM's, EuRoC's, and tables whose header names the columns; and numbered matrices.

TUM: 8 numbers, `t tx ty tz qx qy qz qw`, in seconds (ORB-SLAM3 writes nanoseconds into the same columns); OpenVINS'
recorder has 6 or 12 more, covariances (ov_eval/src/utils/Recorder.h). EuRoC: 8 or 17 columns, `t, px, py, pz, qw, qx,
qy, qz, ...`, in whole nanoseconds, separated by commas; VINS-Fusion's vio.csv has 11 (visualization.cpp). What follows
the quaternion is not used. A header that names the columns decides, at any width (`pose_columns`). Of poses with one
stamp the first is kept.

KITTI-360: the frame's number, or a stamp, and a matrix of 3 x 4 or 4 x 4.
"""

import math
import re
from collections.abc import Callable, Sequence
from decimal import Decimal, localcontext
from functools import partial
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, Message, PresetKey
from ..core.geometry import continuous_quats, pose, quat_wxyz_from_rotation, rotation_from_quat_wxyz
from ..core.schema import quoted
from ..core.trajectory import Trajectory
from .matrix_poses import AllLostError, rigid_poses, row_text
from .pose_columns import EUROC_COLUMNS, HEADER, TUM_COLUMNS, PoseColumns, StampUnit, named_columns, split_cells
from .pose_files import (
    LARGEST_STAMP_S,
    LEAST_NS,
    PER_SECOND,
    WAYS,
    FilePoses,
    Float64,
    PoseFile,
    PoseRows,
    ReadOptions,
    TrajectoryFormat,
    all_finite,
)

StampedFormat: TypeAlias = Literal["tum", "euroc", "vslamlab"]

_EUROC_WIDTH = 17
_EUROC_WIDTHS = (8, 11, 17)  # 11 of VINS-Fusion, with a velocity
_COVARIANCE_WIDTHS = (14, 20)  # of OpenVINS: the upper triangles of 3 x 3 matrices, of the rotation or of both
_TUM_WIDTHS = (8, *_COVARIANCE_WIDTHS)
_MATRIX_WIDTHS = (13, 17)
_LAST_NUMBER = 1e8  # whole numbers before matrices are those of frames up to here: 38 days of 30 a second

_DAY_S = 86_400.0
_SHORTEST_GAP_S = 1e-4  # the preset's highest rate is 10 kHz: what is closer was not meant as nanoseconds
_QUAT_NORM_TOLERANCE = 1e-2  # chosen: three digits are mended, other mistakes refused

_GRAPHS = ("VERTEX", "EDGE")  # of g2o and TORO
_VSLAMLAB_HEAD = b"ts (ns)"
_WHOLE = re.compile(r"-?[0-9]+")


def _stamped_poses(name: StampedFormat, file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read poses with stamps, of the format that the user names or, where he names none, that the content tells."""
    declared = name if options.declared else None
    table, stamps, columns = _stamped_table(file, declared)
    table, stamps, notes = _tracked(table, stamps, skip_lost=options.skip_lost)
    whole = all(map(_WHOLE.fullmatch, stamps))
    width = len(split_cells(file.lines.texts[0]))
    whole_ns = whole and (declared == "vslamlab" or file.lines.commas or width == _EUROC_WIDTH)
    unit, guessed = _unit(table, stamps, columns, declared, options.stamp_unit, whole_ns=whole_ns)
    stamps_s = _seconds(stamps, unit)
    _check_stamps(table, stamps, stamps_s, unit)
    if name == "vslamlab":
        order = np.argsort(stamps_s, kind="stable")
        table, stamps, stamps_s = table.take(order), [stamps[row] for row in order.tolist()], stamps_s[order]
    else:
        _check_order(table, stamps, stamps_s)
    kept, equal = first_of_equal(stamps_s, lambda row: ": ".join([table.place(row)[1], stamps[row]]))
    table, stamps_s = table.keep(kept), stamps_s[kept]
    if guessed and len(stamps_s) > 1:
        _check_gaps(table, stamps_s, unit)
    poses = _posed(table, (1, 2, 3), (4, 5, 6, 7), _ORDERS[columns.w_first])
    format_name = name if declared or name == "vslamlab" else "euroc" if columns.w_first else "tum"
    if guessed and unit == "ns" and format_name == "tum":
        notes += (f"its time stamps, from {LEAST_NS:g} on, are read as nanoseconds",)
    if columns.others:
        notes += ("its header names several poses: the first is read",)
    return FilePoses(format_name, poses, stamps_s, notes=(*notes, *equal))


def _stamped_table(file: PoseFile, declared: StampedFormat | None) -> tuple[PoseRows, list[str], PoseColumns]:
    """Return t x y z qw qx qy qz of each line (N, 8), the texts of the stamps, and the columns that they are from."""
    lines = file.lines
    if not lines.texts:
        raise InputError(file.path, "holds no pose", remedy=WAYS)
    if lines.texts[0].startswith(_GRAPHS):
        remedy = "export its poses with their time stamps, as RTAB-Map does in RGBD-SLAM's format"
        raise InputError(file.path, "is a graph, whose poses have no time stamps", remedy=remedy)
    columns = file.columns
    if columns is None:
        columns = _columns_by_width(file, declared)
    elif declared is not None and columns.w_first != (declared == "euroc"):
        first = "first" if columns.w_first else "last"
        problem = f"the header names the quaternion's w {first}, which is not {declared}"
        raise InputError(file.path, problem, remedy="leave format out, or mend the header")
    table, stamps = lines.picked(columns)
    if file.columns is None and not (declared or columns.w_first) and lines.commas:
        _check_whole_stamps(table, stamps)
    return table, stamps, columns


def _columns_by_width(file: PoseFile, declared: StampedFormat | None) -> PoseColumns:
    """Return the columns of a file whose header names none."""
    lines = file.lines
    width = int(file.rows.widths[0])
    where = f"line {lines.numbers[0]}"
    if (named := named_columns(lines.headers)) is not None:
        problem = f"{width} numbers, but its header names {named.names} columns"
        raise InputError(file.path, problem, where=where, remedy="name all columns in the header")
    if declared is not None:
        commas_or_usual = lines.commas or width in (8, _EUROC_WIDTH)
        fits = {"tum": width in _TUM_WIDTHS, "vslamlab": width == 8, "euroc": width >= 8 and commas_or_usual}
        if not fits[declared]:
            raise InputError(file.path, f"{width} numbers", where=where, remedy=_WAYS[declared])
        return EUROC_COLUMNS if declared == "euroc" else TUM_COLUMNS
    if _is_euroc(file):
        return EUROC_COLUMNS
    if not _is_tum(file):
        remedy = f"{WAYS}; a table of others needs a first line with the names of its columns: {HEADER}"
        raise InputError(file.path, f"{width} numbers", where=where, remedy=remedy)
    return TUM_COLUMNS


def _check_whole_stamps(table: PoseRows, stamps: Sequence[str]) -> None:
    """Refuse stamps with a point between commas that are nanoseconds: w may be first or last."""
    euroc = Message(PresetKey("format", "euroc"), " (w first) with ", PresetKey("stamp_unit", "ns"))
    remedy = Message("say which: ", euroc, ", or ", PresetKey("format", "tum"), " (w last)")
    if not all(map(_WHOLE.fullmatch, stamps)):
        unclear = table.values[:, 0] >= LEAST_NS
        table.fail_where(unclear, "nanoseconds with a point may be EuRoC's columns or TUM's", remedy=remedy)


def _tracked(table: PoseRows, stamps: list[str], *, skip_lost: bool) -> tuple[PoseRows, list[str], tuple[str, ...]]:
    """Return the rows with a pose: in an estimate, seven NaN mean that tracking was lost. Raises NotFiniteError."""
    lost = np.isnan(table.values[:, 1:]).all(axis=1) & np.isfinite(table.values[:, 0])
    if not skip_lost or not lost.any():
        return all_finite(table), stamps, ()
    first = table.place(int(np.argmax(lost)))
    if lost.all():
        raise AllLostError(first[0], f"{len(lost)} of {len(lost)} poses are NaN: no pose is left", where=first[1])
    note = (
        f"{np.count_nonzero(lost)} of {len(lost)} poses are NaN (tracking was lost), and are left out, first {first[1]}"
    )
    kept = [stamp for stamp, is_lost in zip(stamps, lost.tolist(), strict=True) if not is_lost]
    return all_finite(table.keep(~lost)), kept, (note,)


def first_of_equal(stamps_s: Float64, place: Callable[[int], str]) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """(N,) seconds, not decreasing -> (N,) bool: the first pose of each stamp; and a note where others are left out.

    place: a row -> its place and stamp, in words. Motion capture and systems write a stamp twice.
    """
    kept = np.concatenate([[True], np.diff(stamps_s) > 0.0])[: len(stamps_s)]
    if kept.all():
        return kept, ()
    left_out, first = int(np.count_nonzero(~kept)), int(np.argmin(kept))
    poses = "1 pose has" if left_out == 1 else f"{left_out} poses have"
    return kept, (f"{poses} the time stamp of the pose before, which is kept; left out first: {place(first)}",)


_TUM_LINE = "a TUM line is t tx ty tz qx qy qz qw"
_EUROC_LINE = "a EuRoC row is t, x, y, z, qw, qx, qy, qz"
_ORDERS = {False: _TUM_LINE, True: _EUROC_LINE}  # by whether w is first
_WAYS: dict[StampedFormat, str] = {
    "tum": _TUM_LINE,
    "euroc": _EUROC_LINE + ", and nine more or none",
    "vslamlab": "a line is ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw",
}


# --- numbered matrices ---


def _numbered_matrices(file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read a number or a stamp and a matrix a line. Raises InputError."""
    table = all_finite(file.rows.table(_MATRIX_WIDTHS, "a line is a frame's number and its 3 x 4 or 4 x 4 pose"))
    poses = rigid_poses(PoseRows(table.files, table.values[:, 1:], table.lines))
    first = table.values[:, 0]
    stamps = file.rows.cells(0)
    late = np.diff(first, prepend=-np.inf) <= 0.0
    table.fail_where(late, "its number {} does not come after the one before it", of=np.array(stamps))
    if options.stamp_unit is None and (first == np.floor(first)).all() and 0.0 <= first[0] <= first[-1] < _LAST_NUMBER:
        return FilePoses("kitti360", poses, numbers=first, sparse=True)
    unit = options.stamp_unit or ("ns" if (first >= LEAST_NS).all() else "s")
    stamps_s = _seconds(stamps, unit)
    _check_stamps(table, stamps, stamps_s, unit)
    _check_order(table, stamps, stamps_s)
    return FilePoses("kitti360", poses, stamps_s)


def _is_numbered_matrices(file: PoseFile) -> bool:
    """Tell by the first line: 13 numbers, or 17 that end in the last row of a 4 x 4 pose."""
    if file.columns is not None or file.first_widths[:1] not in ((13,), (17,)):
        return False
    cells = split_cells(file.lines.texts[0])
    return len(cells) == 13 or [float(cell) for cell in cells[13:]] == [0.0, 0.0, 0.0, 1.0]


# --- stamps ---


def _unit(
    table: PoseRows,
    stamps: Sequence[str],
    columns: PoseColumns,
    declared: StampedFormat | None,
    declared_unit: StampUnit | None,
    *,
    whole_ns: bool,
) -> tuple[StampUnit, bool]:
    """Return the unit of the stamps, and whether it is a guess from content."""
    if declared_unit is not None:
        return declared_unit, False
    if columns.unit is not None:
        return columns.unit, False
    if declared == "euroc":
        broken = np.array([not text.isdecimal() for text in stamps])
        remedy = Message(PresetKey("stamp_unit"), " says it where they are in another unit")
        table.fail_where(
            broken, "{} is no time in whole nanoseconds", of=np.array([*map(quoted, stamps)]), remedy=remedy
        )
        return "ns", False
    if declared == "vslamlab":
        return ("ns" if whole_ns else "s"), False
    if columns.w_first and whole_ns:
        return "ns", True
    return ("ns" if (table.values[:, 0] >= LEAST_NS).all() else "s"), True


def _seconds(stamps: Sequence[str], unit: StampUnit) -> Float64:
    """Return the nearest float64 to each stamp in seconds: digits that float64 cannot hold are not lost before that."""
    if unit == "s":
        return np.array([float(text) for text in stamps])
    with localcontext(prec=400):  # as many digits as a finite float64 can have before the point, and 90 after it
        scale = PER_SECOND[unit]
        return np.array(
            [int(text) / scale if _WHOLE.fullmatch(text) else float(Decimal(text) / scale) for text in stamps]
        )


def _check_stamps(table: PoseRows, stamps: Sequence[str], stamps_s: Float64, unit: StampUnit) -> None:
    texts = np.array(stamps)
    unlikely = np.abs(stamps_s) > LARGEST_STAMP_S
    problem = f"the time stamp {{}} {unit} is more than 1e11 s, over 3,000 years"
    remedy = Message("if the stamps are no seconds, say what they are: ", PresetKey("stamp_unit"), ": ms, us or ns")
    table.fail_where(unlikely, problem, of=texts, remedy=remedy)


def _check_order(table: PoseRows, stamps: Sequence[str], stamps_s: Float64) -> None:
    step_s = np.diff(stamps_s, prepend=-np.inf)
    late = step_s < 0.0
    for row in np.flatnonzero(step_s == 0.0).tolist():  # equal, or not to be told apart in float64
        late[row] = Decimal(stamps[row]) != Decimal(stamps[row - 1])
    problem = "the time stamp {} does not come after the one before it"
    table.fail_where(late, problem, of=np.array(stamps), remedy="sort the lines by time")


def _check_gaps(table: PoseRows, stamps_s: Float64, unit: StampUnit) -> None:
    """Refuse gaps that show that the unit was guessed wrong."""
    gap_s = float(np.median(np.diff(stamps_s)))
    file, where = table.place(1)
    if unit == "s" and gap_s > _DAY_S and (stamps_s == np.floor(stamps_s)).all():
        problem = f"whole-numbered stamps are {gap_s:g} apart, which would be {gap_s / _DAY_S:.3g} days"
        remedy = Message("say their unit: ", PresetKey("stamp_unit"), ": s, ms, us or ns")
        raise InputError(file, problem, where=where, remedy=remedy)
    if unit == "ns" and gap_s < _SHORTEST_GAP_S:
        problem = f"whole-numbered stamps are {gap_s * 1e9:.3g} apart, too close for EuRoC's nanoseconds"
        unit_key = PresetKey("stamp_unit")
        remedy = Message("say what they are: ", PresetKey("format", "tum"), ", or ", unit_key, ": s, ms, us or ns")
        raise InputError(file, problem, where=where, remedy=remedy)


# --- the formats ---


def tum_text(trajectory: Trajectory) -> str:
    """One line a frame: `t tx ty tz qx qy qz qw` of c2w, OpenCV axes; signs of q are chosen so that it never jumps."""
    quat_wxyz = continuous_quats(quat_wxyz_from_rotation(trajectory.c2w[:, :3, :3]))
    columns = [trajectory.stamps_s[:, None], trajectory.c2w[:, :3, 3], np.roll(quat_wxyz, -1, axis=1)]
    return row_text(np.concatenate(columns, axis=1))


def _is_euroc(file: PoseFile) -> bool:
    """Tell by the first line whether a stamped file is EuRoC's; its reader looks at all lines."""
    if file.columns is not None:
        return file.columns.w_first
    if not file.first_widths or file.first_widths[0] < 8 or _is_numbered_matrices(file):
        return False
    first = split_cells(file.lines.texts[0])[0]
    whole = file.lines.commas and bool(_WHOLE.fullmatch(first))
    if file.first_widths[0] in _EUROC_WIDTHS:
        return whole or file.first_widths[0] == _EUROC_WIDTH
    return whole and float(first) >= LEAST_NS


def _is_vslamlab(file: PoseFile) -> bool:
    return file.head.startswith(_VSLAMLAB_HEAD)


def _is_tum(file: PoseFile) -> bool:
    if file.columns is not None:
        return not file.columns.w_first and not _is_vslamlab(file)
    wide = file.first_widths[:1] and file.first_widths[0] in _COVARIANCE_WIDTHS and not file.lines.commas
    return (file.first_widths[:1] == (8,) or bool(wide)) and not _is_euroc(file)


_UNSTAMPED_WAY = "a line without a time is tx ty tz qx qy qz qw"


def _unstamped_poses(file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read positions and quaternions, w last, without stamps; TartanAir's axes are an aircraft's.

    https://github.com/castacks/tartanair_tools, data_type.md: "tx ty tz qx qy qz qw", "in the NED frame. That is to
    say, the x-axis is pointing to the camera's forward, the y-axis is pointing to the camera's right, the z-axis is
    pointing to the camera's downward".
    """
    table = file.rows.table((7,), _UNSTAMPED_WAY)
    listed = np.arange(float(len(table.values)))
    finite = np.isfinite(table.values).all(axis=1)
    if not options.skip_lost or not finite.any():
        all_finite(table)
    table, numbers = table.keep(finite), listed[finite]
    poses = _posed(table, (0, 1, 2), (6, 3, 4, 5), _UNSTAMPED_WAY)
    return FilePoses("tartanair", poses, numbers=numbers, axes="ned", listed=listed)


def _posed(table: PoseRows, position: Sequence[int], quat_wxyz: Sequence[int], remedy: str) -> Float64:
    """Return the poses (N, 4, 4) of rows with a position and a quaternion. Raises InputError where that is none."""
    quats = table.values[:, quat_wxyz]
    length = np.array([math.hypot(*quat) for quat in quats.tolist()])
    problem = "the quaternion has length {}, not 1"
    table.fail_where(np.abs(length - 1.0) > _QUAT_NORM_TOLERANCE, problem, of=length, remedy=remedy)
    return pose(rotation_from_quat_wxyz(quats), table.values[:, position])


TUM = TrajectoryFormat(
    "tum",
    "TUM",
    "Time stamp, position and quaternion, w last",
    _is_tum,
    partial(_stamped_poses, "tum"),
    write=tum_text,
    stamped=True,
    looks_like="`t tx ty tz qx qy qz qw`, w last; a header that names these among other columns",
    recognised_by="8 numbers, or 14 or 20 (OpenVINS); a header with w last",
    times="its own: seconds, or nanoseconds from 1e17 on",
    order=30,
)
EUROC = TrajectoryFormat(
    "euroc",
    "EuRoC",
    "Time stamp in nanoseconds, position and quaternion, w first",
    _is_euroc,
    partial(_stamped_poses, "euroc"),
    stamped=True,
    looks_like="`t, x, y, z, qw, qx, qy, qz`, w first, and others; VINS-Fusion's `vio.csv`",
    recognised_by="17 numbers; 8 or more with commas, `t` whole nanoseconds; a header with w first",
    times="its own: nanoseconds",
    order=40,
)
VSLAMLAB = TrajectoryFormat(
    "vslamlab",
    "VSLAM-LAB",
    "VSLAM-LAB's NNNNN_KeyFrameTrajectory.csv",
    _is_vslamlab,
    partial(_stamped_poses, "vslamlab"),
    stamped=True,
    one_convention=True,
    looks_like="`ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw`",
    recognised_by="`ts (ns)` at the beginning",
    times="its own: nanoseconds where whole or named so, else seconds",
    order=45,
)
KITTI_360 = TrajectoryFormat(
    "kitti360",
    "KITTI-360",
    "A frame's number or time stamp, and a 3 x 4 or 4 x 4 pose a line",
    _is_numbered_matrices,
    _numbered_matrices,
    looks_like="13 or 17 numbers a line: a whole number, of the frame, or a time stamp, and the pose row by row",
    recognised_by="13 numbers; 17 that end in 0 0 0 1",
    times="the frames' numbers, from 0, / `rate_hz`; or its own",
    order=25,
)
TARTANAIR = TrajectoryFormat(
    "tartanair",
    "TartanAir",
    "Position and quaternion, w last, without time stamps",
    lambda file: file.first_widths[:1] == (7,),
    _unstamped_poses,
    looks_like="`tx ty tz qx qy qz qw`, w last, in an aircraft's axes",
    recognised_by="7 numbers",
    times="`rate_hz`",
    order=47,
)
FORMAT = TUM, EUROC, VSLAMLAB, KITTI_360, TARTANAIR
