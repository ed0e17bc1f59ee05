# SPDX-License-Identifier: GPL-3.0-or-later
"""What a trajectory format is, and what the readers of all formats share: a file's text as rows of numbers.

Numbers are separated by blanks, commas or semicolons; blank lines and comments from # on are skipped. A first line that
holds no number is a header.
"""

import json
import math
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, NotFiniteError
from ..core.file_access import open_regular, read_bytes
from ..core.geometry import Intrinsics
from ..core.packages import LAST
from ..core.schema import LONGEST_QUOTED, quoted
from ..core.trajectory import Axes, Direction, Trajectory
from .pose_columns import PoseColumns, StampUnit, named_columns, split_cells

_HEAD_BYTES = 512
_BINARY = (b"\x93NUMPY", b"PK\x03\x04")  # of numpy's arrays; all else is read as text, and refused as that
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")  # as PowerShell redirects what a program prints

# Intrinsics stated in a trajectory file, compared with the camera that is rendered.


# Principal points are half a pixel apart between the two conventions of where a pixel's centre is. Chosen beside it.
_TOLERANCE_PX = 0.51
_TOLERANCE_RAD = 1e-3


@dataclass(frozen=True)
class StatedCamera:
    """What a file says of its camera; None where it says nothing.

    angle_x_rad: the horizontal field of view. varies: whether frames differ. distorts: whether its lens does.
    """

    width_px: float | None = None
    height_px: float | None = None
    fx_px: float | None = None
    fy_px: float | None = None
    cx_px: float | None = None
    cy_px: float | None = None
    angle_x_rad: float | None = None
    varies: bool = False
    distorts: bool = False

    def difference(self, camera: Intrinsics) -> str:
        """Return a sentence where this is not the camera, "" where it is."""
        names = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
        said = {name: value for name in names if (value := getattr(self, name)) is not None}
        parts = [
            f"{name.removesuffix('_px')} {value:g} (the preset's: {getattr(camera, name):g})"
            for name, value in said.items()
            if not abs(value - getattr(camera, name)) <= _TOLERANCE_PX
        ]
        angle_rad = 2.0 * math.atan(camera.width_px / (2.0 * camera.fx_px))
        stated_rad = self.angle_x_rad if self.fx_px is None else None
        if stated_rad is not None and not abs(stated_rad - angle_rad) <= _TOLERANCE_RAD:
            stated, own = (f"{math.degrees(value):.4g}" for value in (stated_rad, angle_rad))
            parts.append(f"a view of {stated} degrees (the preset's: {own})")
        if self.varies:
            parts.append("intrinsics that vary from frame to frame")
        if self.distorts:
            parts.append("a lens that distorts")
        return f"states another camera, {', '.join(parts)}; the preset's camera is used" if parts else ""


Float64: TypeAlias = NDArray[np.float64]

PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}

LEAST_NS = 1e17  # 1973 in nanoseconds since 1970, and 3e9 years in seconds: stamps from here on are nanoseconds
LARGEST_STAMP_S = 1e11  # 3,000 years: larger numbers are no seconds, whatever they count from
COLMAP_IMAGES = "images.txt"
LARGEST_READ_BYTES = 64 * 10**6  # of arrays, where no definition of a system says another limit
WAYS = (
    "a line holds one pose: 16 numbers (Replica), 12 (KITTI) or 8 (TUM); EuRoC has 8 or 17 columns, other files four "
    "lines of four numbers a pose"
)


class OverLimitError(InputError):
    """A file is larger than may be read."""


@dataclass(frozen=True, eq=False)
class FilePoses:
    """The poses of a file as they stand there, and what the file says about them.

    format: the name of its format. poses: (N, 4, 4) float64, rigid. stamps_s: (N,) seconds, increasing; None where the
    file has none. numbers: (N,) those of the frames, increasing, from which stamps follow with a rate. direction,
    axes: those of the file's format. camera: the intrinsics that the file states. notes: what a user should know, one
    sentence each. listed: (M,) the numbers of all frames that a file of matrices has a pose of, with those whose poses
    are not finite and so not here. sparse: whether the file leaves out frames that were lost. names: of the frames'
    images, by which a file of a reconstruction says them; the numbers count them in their order. places: where each
    name stands, in words.
    """

    format: str
    poses: Float64
    stamps_s: Float64 | None = None
    numbers: Float64 | None = None
    direction: Direction = "c2w"
    axes: Axes = "opencv"
    camera: StatedCamera | None = None
    notes: tuple[str, ...] = ()
    listed: Float64 | None = None
    sparse: bool = False
    names: tuple[str, ...] = ()
    places: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def count(self) -> int | None:
        """How many frames the file speaks of, lost ones too; None where it leaves those out."""
        return None if self.sparse else len(self.poses if self.listed is None else self.listed)


@dataclass(frozen=True)
class ReadOptions:
    """How a file of poses is read.

    declared: whether the user names its format, so that its content does not decide. stamp_unit: of its time stamps;
    None where the file decides. skip_lost: whether it is an estimate: a matrix that is not finite, and a row of NaN,
    mean a frame in which tracking was lost, and are left out. largest_bytes: that are read of arrays, whose file may
    hold much else.
    """

    declared: bool = False
    stamp_unit: StampUnit | None = None
    skip_lost: bool = False
    largest_bytes: int = LARGEST_READ_BYTES


class PoseFile:
    """A file of poses, or a folder with one pose a file, of which no more is read than is asked for.

    path: where it is.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @cached_property
    def is_folder(self) -> bool:
        """Whether it is a folder."""
        return self.path.is_dir()

    @cached_property
    def text(self) -> str:
        """Its text. Raises InputError where it cannot be read, or is no UTF-8."""
        return read_text(self.path)

    @cached_property
    def head(self) -> bytes:
        """Its first bytes; none of a folder, or where it cannot be read. Raises InputError where it is no file."""
        if self.is_folder:
            return b""
        try:
            with open_regular(self.path) as stream:
                return stream.read(_HEAD_BYTES)
        except InputError:
            raise
        except OSError:  # of which its reader says more
            return b""

    @property
    def is_binary(self) -> bool:
        """Whether its first bytes are those of no text."""
        return self.head.startswith(_BINARY)

    @cached_property
    def lines(self) -> "TextLines":
        """The lines of its text that hold data. Raises InputError where it is no text."""
        return text_lines(self.path, self.text)

    @cached_property
    def rows(self) -> "TextRows":
        """Its text as rows of numbers. Raises InputError where it is none."""
        return _rows_of(self.lines)

    @cached_property
    def columns(self) -> PoseColumns | None:
        """Where its lines have a pose, by the names in its header; None where that names none, or it is no text."""
        if not self._is_table:
            return None
        columns = named_columns(self.lines.headers)
        # OpenVINS names its covariances in the header of a table without them.
        widths = (columns.names, max(columns.used) + 1) if columns is not None else ()
        return columns if columns and (not columns.names or len(split_cells(self.lines.texts[0])) in widths) else None

    @cached_property
    def first_widths(self) -> tuple[int, ...]:
        """How many numbers its first two rows have; () where it is no text of numbers."""
        if not self._is_table:
            return ()
        try:
            two = zip(self.lines.texts[:2], self.lines.numbers[:2], strict=True)
            return tuple(len(_parse_line(self.path, number, text)) for text, number in two)
        except InputError:
            return ()

    @cached_property
    def document(self) -> Any:
        """What its text holds as JSON; None where that is none."""
        if not self.begins_with("{", "["):
            return None
        try:
            return json.loads(self.text)
        except (ValueError, RecursionError):
            return None

    @cached_property
    def _is_table(self) -> bool:
        """Whether it is a text with a line of data."""
        if self.begins_with("{", "["):
            return False
        try:
            return not self.is_binary and bool(self.lines.texts)
        except InputError:
            return False

    def begins_with(self, *texts: str) -> bool:
        """Tell whether its text begins with one of these, after blanks; False where it is no text."""
        try:
            return not self.is_binary and self.text.lstrip().startswith(texts)
        except InputError:
            return False


@dataclass(frozen=True)
class TrajectoryFormat:
    """A format of files of poses: of paths to render along, and of what SLAM systems estimate.

    name: in presets and options. order: in lists, ours first. label, meaning: in menus and lists, a name and a
    sentence. looks_like, recognised_by, times: in the table of formats. recognises: tells whether a file is of this
    format, and of no other. read: returns its poses; raises InputError, and NotFiniteError, which is one, where a pose
    is not finite. write: returns the text of a trajectory; None where the format is only read. stamped: whether its
    poses have time stamps. reads_folders: whether it may be a folder. one_convention: whether it fixes what `axes`,
    `direction` and the stamps of its poses are. reads_parts: whether a part of a file is read that may be large.
    """

    name: str
    label: str
    meaning: str
    recognises: Callable[[PoseFile], bool]
    read: Callable[[PoseFile, ReadOptions], FilePoses]
    write: Callable[[Trajectory], str] | None = None
    stamped: bool = False
    reads_folders: bool = False
    one_convention: bool = False
    reads_parts: bool = False
    looks_like: str = ""
    recognised_by: str = ""
    times: str = ""
    order: int = LAST


@dataclass(frozen=True, eq=False)
class PoseRows:
    """Numbers, a row for each pose, (N, C) float64, and the place of each row.

    files: the file of every row, or one for each. lines: (N,) lines of the files, 1 the first.
    """

    files: Path | Sequence[Path]
    values: Float64
    lines: NDArray[np.int64]

    def place(self, row: int) -> tuple[Path, str]:
        """Return the file and the line of a row."""
        file = self.files if isinstance(self.files, Path) else self.files[row]
        return file, f"line {self.lines[row]}"

    def fail_where(
        self,
        wrong: NDArray[np.bool_],
        problem: str,
        *,
        remedy: str = "",
        of: object = None,
        error: type[InputError] = InputError,
    ) -> None:
        """Raise an error for the first row that is wrong; `{}` in `problem` is replaced by that row of `of`."""
        if not wrong.any():
            return
        row = int(np.argmax(wrong))
        of_row = "" if of is None else _in_words(np.asarray(of)[row])
        file, where = self.place(row)
        raise error(file, problem.format(of_row), where=where, remedy=remedy)

    def keep(self, chosen: NDArray[np.bool_]) -> "PoseRows":
        """Return the chosen rows."""
        return self.take(np.flatnonzero(chosen))

    def take(self, rows: NDArray[np.int64]) -> "PoseRows":
        """Return rows by their numbers, in that order."""
        files = self.files if isinstance(self.files, Path) else [self.files[row] for row in rows.tolist()]
        return PoseRows(files, self.values[rows], self.lines[rows])


@dataclass(frozen=True, eq=False)
class NamedRows(PoseRows):
    """Rows that do not stand in lines. names: (N,) where each stands, in words."""

    names: tuple[str, ...] = ()

    def place(self, row: int) -> tuple[Path, str]:
        """Return the file, and where in it a row stands."""
        assert isinstance(self.files, Path)
        return self.files, self.names[row]

    def take(self, rows: NDArray[np.int64]) -> "NamedRows":
        """Return rows by their numbers, in that order."""
        names = tuple(self.names[row] for row in rows.tolist())
        return NamedRows(self.files, self.values[rows], self.lines[rows], names)


def named_rows(path: Path, values: Float64, names: Sequence[str]) -> NamedRows:
    """Return rows (N, C) of a file that has no lines, by where each stands, in words."""
    return NamedRows(path, values, np.arange(len(values)), tuple(names))


@dataclass(frozen=True, eq=False)
class TextRows:
    """The numbers of a text file, line by line.

    numbers: of all rows, one after another. widths: (R,) how many each row has. lines: (R,) its line, 1 the first.
    texts: of each row. headers: the comments before the first row, and a first line without numbers.
    """

    path: Path
    numbers: Float64
    widths: NDArray[np.int64]
    lines: NDArray[np.int64]
    texts: list[str]
    headers: tuple[str, ...]

    @property
    def commas(self) -> bool:
        """Whether commas separate the numbers."""
        return _separated(self.texts[0])

    def table(self, widths: Sequence[int], ways: str = WAYS) -> PoseRows:
        """Return the rows as a table. Raises InputError where they differ in width, or have none of these widths."""
        first = int(self.widths[0])
        if first not in widths:
            raise InputError(self.path, f"{first} numbers", where=f"line {self.lines[0]}", remedy=ways)
        other = np.flatnonzero(self.widths != first)
        if other.size:
            problem = _other_width(int(self.widths[other[0]]), int(self.lines[0]), first)
            raise InputError(self.path, problem, where=f"line {self.lines[other[0]]}", remedy=_ONE_FORMAT)
        return PoseRows(self.path, self.numbers.reshape(-1, first), self.lines)

    def cells(self, column: int) -> list[str]:
        """Return the text of each row's number in a column."""
        return [split_cells(text)[column] for text in self.texts]


@dataclass(frozen=True, eq=False)
class TextLines:
    """The lines of a text file that hold data, without their comments.

    texts: of each. numbers: of the lines, 1 the first. headers: as in `TextRows`.
    """

    path: Path
    texts: list[str]
    numbers: list[int]
    headers: tuple[str, ...]

    @property
    def commas(self) -> bool:
        """Whether commas or semicolons separate cells."""
        return _separated(self.texts[0])

    def picked(self, columns: PoseColumns) -> tuple[PoseRows, list[str]]:
        """Return the numbers (N, 8) in some columns, t x y z qw qx qy qz, and the texts of the stamps.

        What other columns hold is not looked at. Raises InputError.
        """
        used, most = columns.used, max(columns.used)
        width = len(split_cells(self.texts[0]))
        numbers, stamps = array("d"), []
        for number, text in zip(self.numbers, self.texts, strict=True):
            cells = split_cells(text)
            if len(cells) != width or width <= most:
                problem = _other_width(len(cells), self.numbers[0], width)
                raise InputError(self.path, problem, where=f"line {number}", remedy=_ONE_FORMAT)
            picked = [cells[column] for column in used]
            numbers.fromlist(_floats(self.path, number, picked, "".join(picked)))
            stamps.append(cells[columns.stamp])
        return PoseRows(self.path, np.array(numbers).reshape(-1, 8), np.array(self.numbers)), stamps


def _separated(text: str) -> bool:
    return "," in text or ";" in text


_ONE_FORMAT = "a file has one format throughout"


def _other_width(count: int, first_line: int, width: int) -> str:
    return f"{count} numbers, but line {first_line} has {width}"


def read_text(path: Path) -> str:
    """Return the content of a text file. Raises InputError where it cannot be read or is no UTF-8."""
    try:
        data = read_bytes(path)
    except FileNotFoundError:
        raise InputError(path, "does not exist", remedy="name a file of poses that is there") from None
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from None
    try:
        text = data.decode("utf-16" if data.startswith(_UTF_16) else "utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise InputError(path, "is not a text file", remedy="a trajectory is UTF-8 text; " + WAYS)
    return text


def text_lines(path: Path, text: str) -> TextLines:
    """Return the lines of a file's text that hold data."""
    kept: list[tuple[int, str]] = []
    headers: list[str] = []
    headed = False
    # Not splitlines, which also splits at characters that editors do not show as line ends.
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), start=1):
        data, _, comment = line.partition("#")
        if not data or data.isspace():
            if comment and not kept:
                headers.append(comment)
        elif not kept and not headed and is_header(data):
            headed = True
            headers.append(data)
        else:
            kept.append((number, data))
    return TextLines(path, [data for _, data in kept], [number for number, _ in kept], tuple(headers))


def text_rows(path: Path, text: str) -> TextRows:
    """Read the rows of numbers in a file's text. Raises InputError for what is no number, and where there is none."""
    return _rows_of(text_lines(path, text))


def _rows_of(lines: TextLines) -> TextRows:
    path = lines.path
    if not lines.texts:
        raise InputError(path, "holds no pose", remedy=WAYS)
    numbers = array("d")
    ends = [0]
    for number, data in zip(lines.numbers, lines.texts, strict=True):
        numbers.fromlist(_parse_line(path, number, data))
        ends.append(len(numbers))
    return TextRows(path, np.array(numbers), np.diff(ends), np.array(lines.numbers), lines.texts, lines.headers)


def is_header(data: str) -> bool:
    """Tell whether none of a line's words is a number."""
    return not any(map(_is_number, data.replace(",", " ").replace(";", " ").split()))


def all_finite(rows: PoseRows, remedy: str = "leave out the frames without a pose") -> PoseRows:
    """Return the rows. Raises NotFiniteError for the first that holds an infinity or no number."""
    finite = np.isfinite(rows.values)
    if not finite.all():
        first = rows.values[np.arange(len(finite)), np.argmin(finite, axis=1)]
        rows.fail_where(~finite.all(axis=1), "holds {}", of=first, remedy=remedy, error=NotFiniteError)
    return rows


def _parse_line(path: Path, line_number: int, data: str) -> list[float]:
    return _floats(path, line_number, split_cells(data), data)


def _floats(path: Path, line_number: int, cells: list[str], data: str) -> list[float]:
    """Return the numbers of cells. data: their text. Raises InputError."""
    try:
        row = list(map(float, cells))
    except ValueError:
        row = None
    # float() also accepts 1_000 and digits of other scripts, which no other reader of these files does.
    if row is None or "_" in data or not data.isascii():
        wrong = next((cell for cell in cells if not _is_number(cell)), cells[0])
        raise InputError(path, f"{quoted(wrong)} is not a number", where=f"line {line_number}")
    return row


def _is_number(token: str) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return "_" not in token and token.isascii()


def _in_words(value: object) -> str:
    if isinstance(value, str):
        return value if len(value) <= LONGEST_QUOTED else quoted(value)
    return " ".join(f"{number:.10g}" for number in np.atleast_1d(np.asarray(value, dtype=np.float64)))


def unit_quats(rows: PoseRows, quats: Float64) -> Float64:
    """(N, 4) of any length -> (N, 4) of length 1. Raises InputError for one that has no length, or too large a one."""
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(quats, axis=1)
    wrong = ~((lengths > 0.0) & np.isfinite(lengths))
    rows.fail_where(wrong, "its rotation is a quaternion of zeros, or of numbers beyond 1e154")
    return quats / lengths[:, None]
