# SPDX-License-Identifier: GPL-3.0-or-later
"""The formats of trajectories, as `core.trajectories.files` reads them, for a path of which frames may be missing.

A frame whose matrix is not finite, or that a numbered format leaves out, is one that was lost.
"""

import math
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from ...core.errors import InputError, Message, PresetKey
from ...core.schema import quoted
from ...core.trajectory import Axes, Direction, convert_convention
from ...trajectories.formats import TRAJECTORY_FORMATS, read_file_poses
from ...trajectories.matrix_poses import AllLostError
from ...trajectories.pose_files import FilePoses, StampUnit, TrajectoryFormat, is_header, read_text
from ...trajectories.stamped_poses import names_columns
from . import Asked, Auto, EstimateFormat, ReadPoses, no_pose

# Whether a text of poses is whole: one that was cut inside its last number still reads as numbers, but false ones.


REMEDY = "write it again or, if it is whole, end its last line with a line break"
FEWEST = 3  # chosen: lines from which on equally many digits are no chance
_HOMOGENEOUS = (4, 16)  # numbers of a line that ends a 4 x 4 matrix, so that the last is a 1


def check_whole(path: Path, text: str) -> None:
    """Raise InputError, with file and line, for a text without an end of its last line that may be cut.

    A writer ends each line, and a file that is cut does not end so. Without that end the last number is known to be
    whole where it has as many characters after the point as in every line before it, three at least, where a blank or
    comma follows it, and where it is the 1 of a 4 x 4 matrix. All else is refused: nothing in it tells 0.7 from the
    beginning of 0.70710678. JSON is left to its own reader.
    """
    if not text or text[-1] in "\n\r, \t" or text.lstrip()[:1] in ("{", "["):
        return
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    last = _words(lines[-1])
    if not last or "#" in lines[-1]:
        return
    before = [(number, words) for number, line in enumerate(lines[:-1], 1) if _is_number((words := _words(line))[-1:])]
    where = f"line {len(lines)}"
    if before and len(before[-1][1]) != len(last):
        number, words = before[-1]
        problem = f"the file ends in the middle of a line: {len(last)} numbers, but line {number} has {len(words)}"
        raise InputError(path, problem, where=where, remedy=REMEDY)
    if not _is_number(last[-1:]) or not math.isfinite(float(last[-1])):
        return  # which the reader refuses in words of its own
    if len(last) in _HOMOGENEOUS and float(last[-1]) == 1.0:
        return
    others = [words[-1] for _, words in before]
    if len(others) >= FEWEST and _decimals(last[-1]) and {_decimals(last[-1])} == set(map(_decimals, others)):
        return
    problem = f"the file does not end with a line break, so its last number, {quoted(last[-1])}, may be cut"
    raise InputError(path, problem, where=where, remedy=REMEDY)


def _words(line: str) -> list[str]:
    return line.partition("#")[0].replace(",", " ").split()


def _is_number(words: list[str]) -> bool:
    try:
        return [float(word) for word in words] != []
    except ValueError:
        return False


def _decimals(number: str) -> int:
    """Return how many characters follow the point, those of an exponent too; 0 where there is none."""
    return len(number.partition(".")[2])


_SPARSE = ("log",)  # formats of one file that number their frames, and may leave some out


def read_text_poses(path: Path, asked: Asked, format_name: str = "auto") -> ReadPoses:
    """Read a file, or a folder of one pose a file. Raises InputError, and NotFiniteError for what is not a lost frame.

    A file without a pose, a table's header alone among them, is the estimate of a system that tracked no frame.
    """
    if not path.is_dir():
        text = read_text(path)
        if holds_no_pose(text):
            return no_pose(format_name)
        check_whole(path, text)
    unit: StampUnit | Auto = "s" if asked.stamps == "index" else asked.stamp_unit
    try:
        found = read_file_poses(path, format=format_name, stamp_unit=unit, skip_lost=True)
    except AllLostError as error:
        return no_pose(format_name, None if path.is_dir() else error.count)
    direction = cast("Direction", found.direction if asked.direction == "auto" else asked.direction)
    axes = cast("Axes", found.axes if asked.axes == "auto" else asked.axes)
    c2w = convert_convention(found.poses, direction=direction, axes=axes)
    if asked.stamps == "none":
        order = np.arange(len(c2w))
        return ReadPoses(found.format, c2w, numbers=order, count=len(c2w), notes=found.notes)
    if asked.stamps == "index" and found.stamps_s is not None:
        return ReadPoses(found.format, c2w, numbers=_whole_numbers(path, found.stamps_s), notes=found.notes)
    if found.stamps_s is not None:
        return ReadPoses(found.format, c2w, stamps_s=found.stamps_s, notes=found.notes)
    return _numbered(path, found, c2w, unit)


def _numbered(path: Path, found: FilePoses, c2w: np.ndarray, unit: StampUnit | Auto) -> ReadPoses:
    """Return the poses of a format without stamps, by the numbers of their frames."""
    assert found.numbers is not None, "poses have stamps or numbers"
    if unit != "auto" and not TRAJECTORY_FORMATS[found.format].stamped:
        remedy = Message("leave ", PresetKey("stamp_unit"), " out")
        raise InputError(path, f"has no time stamps ({found.format}), so none in {unit}", remedy=remedy)
    numbers = _whole_numbers(path, found.numbers)
    sparse = path.is_dir() or found.format in _SPARSE
    count = None if sparse else len(numbers) if found.listed is None else len(found.listed)
    return ReadPoses(found.format, c2w, numbers=numbers, count=count, notes=found.notes)


def _whole_numbers(path: Path, values: np.ndarray) -> np.ndarray:
    wrong = np.flatnonzero((values != np.floor(values)) | (values < 0.0) | (values > 2.0**53))
    if wrong.size:
        raise InputError(path, f"{values[wrong[0]]:g} is no number of a frame, 0 the first")
    return values.astype(np.int64)


def holds_no_pose(text: str) -> bool:
    """Tell whether a text holds nothing but blank lines, comments and a line that names a table's columns."""
    lines = (line.partition("#")[0].strip() for line in text.splitlines())
    rows = [line for line in lines if line]
    return not rows or (len(rows) == 1 and is_header(rows[0]) and names_columns(rows[0]))


def _text_format(of: TrajectoryFormat) -> EstimateFormat:
    read = partial(read_text_poses, format_name=of.name)
    return EstimateFormat(of.name, of.meaning, read, any_convention=True, any_stamps=True, any_unit=of.stamped)


class _TextFormats(Mapping[str, EstimateFormat]):
    """The formats of trajectories, those of packages too, which are looked for when one is asked for."""

    def __getitem__(self, name: str) -> EstimateFormat:
        return _text_format(TRAJECTORY_FORMATS[name])

    def __iter__(self) -> Iterator[str]:
        return iter(TRAJECTORY_FORMATS)

    def __len__(self) -> int:
        return len(TRAJECTORY_FORMATS)


FORMATS = _TextFormats()
OF_ANY = EstimateFormat("auto", "", read_text_poses, any_convention=True, any_stamps=True, any_unit=True)
"""What no format recognises: one of the above, told by content."""
