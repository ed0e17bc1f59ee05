# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses with time stamps, one a line: TUM's, and EuRoC's ground truth.

TUM: 8 numbers, `t tx ty tz qx qy qz qw`, in seconds (ORB-SLAM3 writes nanoseconds into the same columns). EuRoC: 8 or
17 columns, `t, px, py, pz, qw, qx, qy, qz, ...`, in whole nanoseconds, separated by commas; what follows the
quaternion, velocities and biases, is not used. A header that names the quaternion's columns decides their order. Of
poses with one stamp the first is kept.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import partial
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, Message, PresetKey
from ..core.geometry import continuous_quats, pose, quat_wxyz_from_rotation, rotation_from_quat_wxyz
from ..core.schema import quoted
from ..core.trajectory import Trajectory
from .matrix_poses import row_text
from .pose_files import (
    LARGEST_STAMP_S,
    PER_SECOND,
    WAYS,
    FilePoses,
    Float64,
    PoseFile,
    PoseRows,
    ReadOptions,
    StampUnit,
    TextRows,
    TrajectoryFormat,
    all_finite,
)

StampedFormat: TypeAlias = Literal["tum", "euroc"]

WIDTHS = (8, 17)

_LEAST_NS = 1e17  # 1973 in nanoseconds since 1970, and 3e9 years in seconds: stamps from here on are nanoseconds
_DAY_S = 86_400.0
_SHORTEST_GAP_S = 1e-4  # the preset's highest rate is 10 kHz: what is closer was not meant as nanoseconds
_QUAT_NORM_TOLERANCE = 1e-2  # chosen: three digits are mended, other mistakes refused

_LEAST_COMMAS = 7  # of a header that names stamp, position and quaternion

_WHOLE = re.compile(r"-?[0-9]+")
_UNITS = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "ms": "ms", "msec": "ms", "milliseconds": "ms",
    "us": "us", "usec": "us", "microseconds": "us", "ns": "ns", "nsec": "ns", "nsecs": "ns", "nanoseconds": "ns",
}  # fmt: skip
_TIME = re.compile(r"(?:.*_)?(?:t|ts|time|stamp|time_?stamps?)(?:_(?P<unit>[a-z]+))?")
_POSITION = re.compile(r"(?:(?:.*_)?(?:pos|position|trans|translation|location)_?|[pt](?:_rs_[rs])?_?)?(?P<axis>[xyz])")
_QUATERNION = re.compile(r"(?:(?:.*_)?(?:quat|quaternion|rot|rotation|orientation)|[qro](?:_rs)?)_?(?P<axis>[wxyz])")


@dataclass(frozen=True)
class _Columns:
    """Where a line has what. unit: of the stamps, where the header says it."""

    stamp: int
    position: tuple[int, ...]
    quat_wxyz: tuple[int, ...]
    unit: StampUnit | None = None

    @property
    def format(self) -> StampedFormat:
        return "euroc" if self.quat_wxyz[0] < self.quat_wxyz[1] else "tum"


_TUM = _Columns(0, (1, 2, 3), (7, 4, 5, 6))
_EUROC = _Columns(0, (1, 2, 3), (4, 5, 6, 7))


def _stamped_poses(name: StampedFormat, file: PoseFile, options: ReadOptions) -> FilePoses:
    """Read poses with stamps, of the format that the user names or, where he names none, that the content tells."""
    rows, declared = file.rows, name if options.declared else None
    table = all_finite(rows.table((8,) if declared == "tum" else WIDTHS, _WAYS[declared]))
    _refuse_stamped_matrices(table)
    named = _named_columns(rows.headers, table.values.shape[1])
    if named is not None and declared is not None and named.format != declared:
        first = {"euroc": "first", "tum": "last"}[named.format]
        problem = f"the header names the quaternion's w {first}, which is not {declared}"
        raise InputError(rows.path, problem, remedy="leave format out, or mend the header")
    stamps = rows.cells(0 if named is None else named.stamp)
    whole = all(map(_WHOLE.fullmatch, stamps))
    columns = named or _columns(rows, table, declared, whole=whole)
    unit, guessed = _unit(table, stamps, columns, declared, options.stamp_unit, whole_ns=whole and _comma_or_wide(rows))
    stamps_s = _seconds(stamps, unit)
    _check_stamps(table, stamps, stamps_s, unit)
    kept, note = first_of_equal(stamps_s, lambda row: ": ".join([table.place(row)[1], stamps[row]]))
    table, stamps_s = table.keep(kept), stamps_s[kept]
    if guessed and len(stamps_s) > 1:
        _check_gaps(table, stamps_s, unit)
    quat_wxyz = table.values[:, columns.quat_wxyz]
    length = np.array([math.hypot(*quat) for quat in quat_wxyz.tolist()])
    problem = "the quaternion has length {}, not 1"
    table.fail_where(np.abs(length - 1.0) > _QUAT_NORM_TOLERANCE, problem, of=length, remedy=_ORDERS[columns.format])
    poses = pose(rotation_from_quat_wxyz(quat_wxyz), table.values[:, columns.position])
    return FilePoses(columns.format, poses, stamps_s, notes=note)


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


_ORDERS = {"tum": "a TUM line is t tx ty tz qx qy qz qw", "euroc": "a EuRoC row is t, x, y, z, qw, qx, qy, qz"}
_WAYS: dict[StampedFormat | None, str] = {
    "tum": _ORDERS["tum"],
    "euroc": _ORDERS["euroc"] + ", and nine more or none",
    None: WAYS,
}


def _comma_or_wide(rows: TextRows) -> bool:
    return rows.commas or int(rows.widths[0]) == 17


def _refuse_stamped_matrices(table: PoseRows) -> None:
    """Refuse a stamp before a 4 x 4 pose: its 17 numbers may pass for EuRoC's."""
    if table.values.shape[1] == 17:
        matrices = (np.abs(table.values[:, 13:] - [0.0, 0.0, 0.0, 1.0]) < 1e-6).all(axis=1)
        remedy = "write the poses as TUM, or leave the stamps out"
        table.fail_where(matrices, "17 numbers that end in 0 0 0 1: a stamp before a 4 x 4 pose", remedy=remedy)


# --- columns ---


def _columns(rows: TextRows, table: PoseRows, declared: StampedFormat | None, *, whole: bool) -> _Columns:
    """Return the columns of a file whose header names none."""
    if declared is not None:
        return _TUM if declared == "tum" else _EUROC
    if rows.commas and not whole and table.values.shape[1] == 8:
        euroc = Message(PresetKey("format", "euroc"), " (w first) with ", PresetKey("stamp_unit", "ns"))
        remedy = Message("say which: ", euroc, ", or ", PresetKey("format", "tum"), " (w last)")
        unclear = table.values[:, 0] >= _LEAST_NS
        table.fail_where(unclear, "nanoseconds with a point may be EuRoC's columns or TUM's", remedy=remedy)
    return _EUROC if table.values.shape[1] == 17 or (whole and rows.commas) else _TUM


def _named_columns(headers: Sequence[str], width: int) -> _Columns | None:
    """Return the columns that the last header with a quaternion's names gives; None where no header names one."""
    for header in reversed(headers):
        names = _column_names(header)
        if len(names) == width and (columns := _columns_of(names)) is not None:
            return columns
    return None


def names_columns(header: str) -> bool:
    """Tell whether a line without a number names the columns of a table of poses."""
    return header.count(",") >= _LEAST_COMMAS or _columns_of(_column_names(header)) is not None


def _column_names(header: str) -> list[str]:
    """Return a header's names in small letters, with underscores, units among them: timestamp_ns, q_rs_w."""
    text = re.sub(r"(?<!\s)\s++\[", "[", header.strip().lstrip("#"))
    cells = text.rstrip(",").split(",") if "," in text else text.split()
    return [re.sub(r"[^a-z0-9]+", "_", cell.strip().lower()).strip("_") for cell in cells]


def _columns_of(names: list[str]) -> _Columns | None:
    quat = {match["axis"]: index for index, name in enumerate(names) if (match := _QUATERNION.fullmatch(_bare(name)))}
    found = [name for name in names if _QUATERNION.fullmatch(_bare(name))]
    if len(found) != 4 or set(quat) != set("wxyz"):
        return None
    times = [index for index, name in enumerate(names) if _TIME.fullmatch(name)]
    stamp = times[0] if times else 0
    rest = [index for index in range(len(names)) if index not in quat.values() and index != stamp]
    at = {match["axis"]: index for index in reversed(rest) if (match := _POSITION.fullmatch(_bare(names[index])))}
    position = tuple(at[axis] for axis in "xyz") if set(at) == set("xyz") else tuple(rest[:3])
    match = _TIME.fullmatch(names[stamp])
    unit = _UNITS.get(match["unit"] or "") if match else None
    return _Columns(stamp, position, tuple(quat[axis] for axis in "wxyz"), unit)  # pyright: ignore[reportArgumentType]


def _bare(name: str) -> str:
    """Return a name without the unit of a length."""
    return name.removesuffix("_m")


# --- stamps ---


def _unit(
    table: PoseRows,
    stamps: Sequence[str],
    columns: _Columns,
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
    if columns.format == "euroc" and whole_ns:
        return "ns", True
    values = table.values[:, columns.stamp]
    return ("ns" if (values >= _LEAST_NS).all() else "s"), True


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
    step_s = np.diff(stamps_s, prepend=-np.inf)
    late = step_s < 0.0
    for row in np.flatnonzero(step_s == 0.0).tolist():  # equal, or not to be told apart in float64
        late[row] = Decimal(stamps[row]) != Decimal(stamps[row - 1])
    problem = "the time stamp {} does not come after the one before it"
    table.fail_where(late, problem, of=texts, remedy="sort the lines by time")


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
    if file.first_widths[:1] not in ((8,), (17,)):
        return False
    named = _named_columns(file.rows.headers, file.first_widths[0])
    if named is not None:
        return named.format == "euroc"
    return file.first_widths[0] == 17 or (file.rows.commas and bool(_WHOLE.fullmatch(file.rows.first_cell())))


TUM = TrajectoryFormat(
    "tum",
    "TUM",
    "Time stamp, position and quaternion, w last",
    lambda file: file.first_widths[:1] in ((8,), (17,)) and not _is_euroc(file),
    partial(_stamped_poses, "tum"),
    write=tum_text,
    stamped=True,
    looks_like="`t tx ty tz qx qy qz qw`, w last",
    recognised_by="8 numbers",
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
    looks_like="`t, x, y, z, qw, qx, qy, qz`, w first, and nine more or none",
    recognised_by="17 numbers; 8 with commas, `t` a whole number",
    times="its own: nanoseconds",
    order=40,
)
FORMAT = TUM, EUROC
