# SPDX-License-Identifier: GPL-3.0-or-later
"""What a trajectory format is, and what the readers of all formats share: a file's text as rows of numbers.

Numbers are separated by blanks or by commas; blank lines and comments from # on are skipped. A first line that holds
no number is a header.
"""

import math
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from ..core.entry_points import LAST
from ..core.errors import InputError, NotFiniteError
from ..core.file_access import read_bytes
from ..core.geometry import Intrinsics
from ..core.schema import LONGEST_QUOTED, quoted
from ..core.trajectory import Axes, Direction, Trajectory

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
StampUnit: TypeAlias = Literal["s", "ms", "us", "ns"]

STAMP_UNITS: tuple[str, ...] = get_args(StampUnit)
PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}

LARGEST_STAMP_S = 1e11  # 3,000 years: larger numbers are no seconds, whatever they count from
WAYS = (
    "a line holds one pose: 16 numbers (Replica), 12 (KITTI) or 8 (TUM); EuRoC has 8 or 17 columns, other files four "
    "lines of four numbers a pose"
)


@dataclass(frozen=True, eq=False)
class FilePoses:
    """The poses of a file as they stand there, and what the file says about them.

    format: the name of its format. poses: (N, 4, 4) float64, rigid. stamps_s: (N,) seconds, increasing; None where the
    file has none. numbers: (N,) those of the frames, increasing, from which stamps follow with a rate. direction,
    axes: those of the file's format. camera: the intrinsics that the file states. notes: what a user should know, one
    sentence each. listed: (M,) the numbers of all frames that a file of matrices has a pose of, with those whose poses
    are not finite and so not here.
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


@dataclass(frozen=True)
class ReadOptions:
    """How a file of poses is read.

    declared: whether the user names its format, so that its content does not decide. stamp_unit: of its time stamps;
    None where the file decides. skip_lost: whether a matrix that is not finite means a frame in which tracking was
    lost, and is left out, also in a format that refuses it.
    """

    declared: bool = False
    stamp_unit: StampUnit | None = None
    skip_lost: bool = False


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
    def rows(self) -> "TextRows":
        """Its text as rows of numbers. Raises InputError where it is none."""
        return text_rows(self.path, self.text)

    @cached_property
    def first_widths(self) -> tuple[int, ...]:
        """How many numbers its first two rows have; () where it is no text of numbers."""
        if self.begins_with("{", "["):
            return ()
        try:
            return tuple(self.rows.widths[:2].tolist())
        except InputError:
            return ()

    def begins_with(self, *texts: str) -> bool:
        """Tell whether its text begins with one of these, after blanks; False where it is no text."""
        try:
            return self.text.lstrip().startswith(texts)
        except InputError:
            return False


@dataclass(frozen=True)
class TrajectoryFormat:
    """A format of files of poses.

    name: in presets and options. order: in lists, ours first. label, meaning: in menus and lists, a name and a
    sentence. looks_like, recognised_by, times: in the table of formats. recognises: tells whether a file is of this
    format, and of no other. read: returns its poses; raises InputError, and NotFiniteError, which is one, where a pose
    is not finite. write: returns the text of a trajectory; None where the format is only read. stamped: whether its
    poses have time stamps. reads_folders: whether it may be a folder.
    """

    name: str
    label: str
    meaning: str
    recognises: Callable[[PoseFile], bool]
    read: Callable[[PoseFile, ReadOptions], FilePoses]
    write: Callable[[Trajectory], str] | None = None
    stamped: bool = False
    reads_folders: bool = False
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
        files = self.files
        if not isinstance(files, Path):
            files = [file for file, kept in zip(files, chosen, strict=True) if kept]
        return PoseRows(files, self.values[chosen], self.lines[chosen])


@dataclass(frozen=True, eq=False)
class TextRows:
    """The numbers of a text file, line by line.

    numbers: of all rows, one after another. widths: (R,) how many each row has. lines: (R,) its line, 1 the first.
    texts: every line of the file. headers: the comments before the first row, and a first line without numbers.
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
        return "," in self._data(0)

    def table(self, widths: Sequence[int], ways: str = WAYS) -> PoseRows:
        """Return the rows as a table. Raises InputError where they differ in width, or have none of these widths."""
        first = int(self.widths[0])
        if first not in widths:
            raise InputError(self.path, f"{first} numbers", where=f"line {self.lines[0]}", remedy=ways)
        other = np.flatnonzero(self.widths != first)
        if other.size:
            problem = f"{self.widths[other[0]]} numbers, but line {self.lines[0]} has {first}"
            remedy = "a file has one format throughout"
            raise InputError(self.path, problem, where=f"line {self.lines[other[0]]}", remedy=remedy)
        return PoseRows(self.path, self.numbers.reshape(-1, first), self.lines)

    def cells(self, column: int) -> list[str]:
        """Return the text of each row's number in a column."""
        data = map(self._data, range(len(self.lines)))
        return [line.split("," if "," in line else None)[column].strip() for line in data]

    def first_cell(self) -> str:
        """Return the text of the first row's first number."""
        line = self._data(0)
        return line.split("," if "," in line else None)[0].strip()

    def _data(self, row: int) -> str:
        return self.texts[self.lines[row] - 1].partition("#")[0]


def read_text(path: Path) -> str:
    """Return the content of a text file. Raises InputError where it cannot be read or is no UTF-8."""
    try:
        data = read_bytes(path)
    except FileNotFoundError:
        raise InputError(path, "does not exist") from None
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise InputError(path, "is not a text file", remedy="a trajectory is UTF-8 text; " + WAYS)
    return text


def text_rows(path: Path, text: str) -> TextRows:
    """Read the rows of numbers in a file's text. Raises InputError for what is no number, and where there is none."""
    # Not splitlines, which also splits at characters that editors do not show as line ends.
    texts = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    numbers = array("d")
    lines: list[int] = []
    widths: list[int] = []
    headers: list[str] = []
    headed = False
    for line_number, line in enumerate(texts, start=1):
        data, _, comment = line.partition("#")
        if not data or data.isspace():
            if comment and not lines:
                headers.append(comment)
            continue
        if not lines and not headed and is_header(data):
            headed = True
            headers.append(data)
            continue
        row = _parse_line(path, line_number, data)
        numbers.fromlist(row)
        lines.append(line_number)
        widths.append(len(row))
    if not lines:
        raise InputError(path, "holds no pose", remedy=WAYS)
    return TextRows(path, np.array(numbers), np.array(widths), np.array(lines), texts, tuple(headers))


def is_header(data: str) -> bool:
    """Tell whether none of a line's words is a number."""
    return not any(map(_is_number, data.replace(",", " ").split()))


def all_finite(rows: PoseRows, remedy: str = "leave out the frames without a pose") -> PoseRows:
    """Return the rows. Raises NotFiniteError for the first that holds an infinity or no number."""
    finite = np.isfinite(rows.values)
    if not finite.all():
        first = rows.values[np.arange(len(finite)), np.argmin(finite, axis=1)]
        rows.fail_where(~finite.all(axis=1), "holds {}", of=first, remedy=remedy, error=NotFiniteError)
    return rows


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
        wrong = next((token for token in tokens if not _is_number(token)), tokens[0])
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
