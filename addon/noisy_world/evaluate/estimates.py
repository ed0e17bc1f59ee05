# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimates of SLAM systems: from what a system wrote to poses of frames. Studies, `score` and the library read so.

The formats are those of trajectories (`trajectories/formats.py`), for a path of which frames may be missing.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PureWindowsPath
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError, Message, NotFiniteError, PresetKey
from ..core.schema import quoted
from ..core.trajectory import Axes, Direction
from ..trajectories.formats import TRAJECTORY_FORMATS, Auto, format_of, read_file_poses, upright_poses
from ..trajectories.matrix_poses import AllLostError
from ..trajectories.pose_columns import StampUnit, names_columns, split_cells
from ..trajectories.pose_files import COLMAP_IMAGES, LARGEST_READ_BYTES, FilePoses, PoseFile, is_header, read_text

# The frames that a system was given, which the poses of an estimate belong to.


Index: TypeAlias = Mapping[str, Any]
"""The frames as a system is given them: `frames`, a list in their order, each with `stamp_s` and `colour`, its file."""


@dataclass(frozen=True, eq=False)
class Frames:
    """stamps_s: (N,) float64, seconds, increasing. names: the files of their colour images; empty where not known."""

    stamps_s: NDArray[np.float64]
    names: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.stamps_s)

    @classmethod
    def of(cls, stamps_s: ArrayLike, names: Sequence[object] = ()) -> "Frames":
        """Return frames of stamps (N,)."""
        return cls(np.asarray(stamps_s, dtype=np.float64), tuple(map(str, names)))

    @classmethod
    def of_index(cls, index: Index) -> "Frames":
        """Return the frames of an index."""
        frames = index["frames"]
        names = [frame.get("colour") for frame in frames]
        return cls.of([frame["stamp_s"] for frame in frames], names if all(names) else ())


# Which pose of an estimate belongs to which frame of the truth, decided by their time stamps.


Float64: TypeAlias = NDArray[np.float64]
Rows: TypeAlias = NDArray[np.int64]

MAX_DIFFERENCE_S = 0.01
"""How far the stamps of a pose and its frame may lie apart: evo's default, and that of the paper's code."""


def associate_poses(
    estimate_s: Float64, truth_s: Float64, max_difference_s: float = MAX_DIFFERENCE_S
) -> tuple[Rows, Rows]:
    """Return the rows (K,) of the poses and (K,) of the frames that belong together, both increasing.

    estimate_s (M,), truth_s (N,): seconds, strictly increasing. A pose and a frame belong together where each is the
    other's nearest and their stamps differ by max_difference_s at most; of two that are equally near, the earlier
    counts. So each is used once, and a pose that is not its frame's nearest is left out, rather than given to the next
    frame. evo gives the same pairs, but uses a pose or a frame twice where max_difference_s is more than half of what
    lies between two stamps. Raises ValueError for a difference that is negative or not finite.
    """
    if not (np.isfinite(max_difference_s) and max_difference_s >= 0.0):
        raise ValueError(f"max_difference_s is 0 or more, not {max_difference_s}")
    if len(estimate_s) == 0 or len(truth_s) == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    frame_of_pose = _nearest(estimate_s, truth_s)
    pose_of_frame = _nearest(truth_s, estimate_s)
    poses = np.arange(len(estimate_s))
    close = np.abs(estimate_s - truth_s[frame_of_pose]) <= max_difference_s
    kept = np.flatnonzero(close & (pose_of_frame[frame_of_pose] == poses))
    return kept, frame_of_pose[kept]


def _nearest(of_s: Float64, among_s: Float64) -> Rows:
    """(M,), (N,), N >= 1 -> (M,): the row of the nearest stamp, the earlier of two that are equally near."""
    after = np.clip(np.searchsorted(among_s, of_s), 0, len(among_s) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(np.abs(of_s - among_s[before]) <= np.abs(among_s[after] - of_s), before, after)


# A camera path as a SLAM system estimates it: frames may be missing, all of them too.


@dataclass(frozen=True)
class Estimate:
    """Estimated poses of the frames that a system tracked; the arrays are copied and read-only.

    stamps_s: (M,) float64, seconds, strictly increasing, M >= 0: those of the tracked colour frames.
    c2w: (M, 4, 4) float64, finite, camera-to-world with OpenCV's camera axes (x right, y down, z forward). World frame,
    and without depth the scale, are the system's own.
    Raises ValueError for other shapes, values that are not finite and stamps that do not increase.
    """

    stamps_s: NDArray[np.float64]
    c2w: NDArray[np.float64]

    def __post_init__(self) -> None:
        stamps_s = np.array(self.stamps_s, dtype=np.float64)
        c2w = np.array(self.c2w, dtype=np.float64, order="C")
        if stamps_s.ndim != 1 or c2w.shape != (len(stamps_s), 4, 4):
            raise ValueError(f"an estimate is (M,) stamps and (M, 4, 4) poses, not {stamps_s.shape} and {c2w.shape}")
        if not (np.isfinite(stamps_s).all() and np.isfinite(c2w).all()):
            raise ValueError("an estimate holds finite numbers only")
        if np.any(np.diff(stamps_s) <= 0.0):
            raise ValueError("time stamps must increase from pose to pose")
        for name, array in (("stamps_s", stamps_s), ("c2w", c2w)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.stamps_s)


# A file in any format of trajectories, and the frames that its poses belong to.


StampsOf: TypeAlias = Literal["time", "index", "none"]
"""How a pose says its frame: by its time, by the frame's number in place of the time, or by its order."""

_UNITS: tuple[StampUnit, ...] = ("s", "ns", "us", "ms")
_FEW = 2  # poses that meet frames: one alone may do so in the wrong unit, in which all stamps are nearly one


@dataclass(frozen=True)
class Asked:
    """How a file is to be read, where its format leaves that open.

    direction, axes: of the poses; "auto" is the format's own. stamps: how a pose says its frame. stamp_unit: of its
    time; "auto" is what the file says or looks like. largest_bytes: that are read of a file with more than poses in it.
    """

    direction: Direction | Auto = "auto"
    axes: Axes | Auto = "auto"
    stamps: StampsOf = "time"
    stamp_unit: StampUnit | Auto = "auto"
    largest_bytes: int = LARGEST_READ_BYTES


def no_pose(format_name: str, count: int | None = None) -> FilePoses:
    """Return the estimate of a system that tracked no frame. count: of the frames that its file says are lost."""
    listed = None if count is None else np.arange(count, dtype=np.float64)
    return FilePoses(format_name, np.zeros((0, 4, 4)), numbers=np.zeros(0), listed=listed, sparse=count is None)


def read_poses(
    path: Path,
    format: str = "auto",  # noqa: A002
    asked: Asked | None = None,
    frames_s: NDArray[np.float64] | None = None,
) -> FilePoses:
    """Read the poses of a file, or of a folder of one pose a file, in a format, or in the one that it looks like.

    Its poses are camera-to-world with OpenCV's axes, its numbers whole, 0 the first frame's. A file without a pose, a
    table's header alone among them, is the estimate of a system that tracked no frame. frames_s: (N,) stamps of the
    frames, or of the truth, where they are known: where the unit of the poses' stamps is not declared, it is the one in
    which they are those of frames; ORB-SLAM3 writes nanoseconds into TUM's columns. Raises NotFiniteError where a pose
    holds NaN or infinity and is no lost frame, InputError, of which it is one, where the file is not of its format, or
    what is asked is not left open by that, and ValueError for an unknown format.
    """
    asked = asked or Asked()
    if format not in ("auto", *TRAJECTORY_FORMATS):
        raise ValueError(f"no reader is called {format!r}; known are {', '.join(TRAJECTORY_FORMATS)}")
    file = PoseFile(path)
    arrays = format != "auto" and TRAJECTORY_FORMATS[format].reads_parts
    if (text := None if arrays else _text_of(file)) is not None and holds_no_pose(text):
        return no_pose(format)
    known = format_of(file, format)
    given = [name for name in ("direction", "axes") if getattr(asked, name) != "auto"]
    if given and known.one_convention:
        problem = f"is {known.name}, whose poses have one convention"
        raise InputError(path, problem, remedy=f"leave {' and '.join(given)} out")
    if text is not None and known.name != "colmap":
        check_whole(path, text)
    if not known.stamped or asked.stamp_unit != "auto" or asked.stamps != "time" or frames_s is None:
        return _read_once(file, format, asked)
    return _in_the_unit_of(file, format, asked, frames_s)


def _text_of(file: PoseFile) -> str | None:
    """Return the text of a file of poses, or of COLMAP's folder; None for other folders and where it is no text."""
    if file.is_folder:
        images = file.path / COLMAP_IMAGES
        return read_text(images) if images.is_file() else None
    return None if file.is_binary else file.text


def _read_once(file: PoseFile, format_name: str, asked: Asked) -> FilePoses:
    """Read a file that holds a pose."""
    path = file.path
    unit: StampUnit | Auto = "s" if asked.stamps == "index" else asked.stamp_unit
    try:
        poses = read_file_poses(
            file, format=format_name, stamp_unit=unit, skip_lost=True, largest_bytes=asked.largest_bytes
        )
    except AllLostError as error:
        return no_pose(format_name, None if path.is_dir() else error.count or None)
    direction = poses.direction if asked.direction == "auto" else asked.direction
    axes = poses.axes if asked.axes == "auto" else asked.axes
    read = replace(poses, poses=upright_poses(poses.poses, direction, axes), direction="c2w", axes="opencv")
    if asked.stamps == "none":
        counted = np.arange(len(read), dtype=np.float64)
        return replace(read, stamps_s=None, numbers=counted, listed=None, sparse=False, names=())
    if read.names:
        return read
    if read.stamps_s is not None and asked.stamps == "time":
        return read
    if read.stamps_s is None and unit != "auto" and not TRAJECTORY_FORMATS[read.format].stamped:
        remedy = Message("leave ", PresetKey("stamp_unit"), " out")
        raise InputError(path, f"has no time stamps ({read.format}), so none in {unit}", remedy=remedy)
    if read.stamps_s is not None:
        read = replace(read, stamps_s=None, numbers=read.stamps_s, sparse=True)
    _check_whole_numbers(path, read.numbers)
    return read


def _check_whole_numbers(path: Path, values: NDArray[np.float64] | None) -> None:
    assert values is not None, "poses have stamps or numbers"
    wrong = np.flatnonzero((values != np.floor(values)) | (values < 0.0) | (values > 2.0**53))
    if wrong.size:
        raise InputError(path, f"{values[wrong[0]]:g} is no number of a frame, 0 the first")


def _in_the_unit_of(file: PoseFile, format_name: str, asked: Asked, frames_s: NDArray[np.float64]) -> FilePoses:
    """Return the poses with stamps in the unit in which most of them are those of frames, the format's own first."""
    best: FilePoses | None = None
    most, refused = -1, None
    for unit in ("auto", *_UNITS):
        try:
            read = _read_once(file, format_name, replace(asked, stamp_unit=unit))
        except NotFiniteError:
            raise
        except InputError as error:
            refused = refused or error
            continue
        if read.stamps_s is None:
            return read
        met = len(associate_poses(read.stamps_s, frames_s)[0])
        if best is None or (met > most and met >= _FEW):
            note = () if unit == "auto" else (f"{file.path.name}: its time stamps are those of the frames in {unit}",)
            best, most = replace(read, notes=(*read.notes, *note)), met
        if met >= min(_FEW, len(read)):
            break
    if best is None:
        assert refused is not None
        raise refused
    return best


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
    return split_cells(line.partition("#")[0])


def _is_number(words: list[str]) -> bool:
    try:
        return [float(word) for word in words] != []
    except ValueError:
        return False


def _decimals(number: str) -> int:
    """Return how many characters follow the point, those of an exponent too; 0 where there is none."""
    return len(number.partition(".")[2])


def holds_no_pose(text: str) -> bool:
    """Tell whether a text holds nothing but blank lines, comments and a line that names a table's columns."""
    lines = (line.partition("#")[0].strip() for line in text.splitlines())
    rows = [line for line in lines if line]
    return not rows or (len(rows) == 1 and is_header(rows[0]) and names_columns(rows[0]))


# From poses as they stand in a file to poses of frames.


def estimate_of(path: Path, read: FilePoses, frames: Frames | None) -> Estimate:
    """Return poses with the time stamps of their frames, or their own where they have some.

    frames: that the system was given; None where they are not known. Raises InputError where poses say their frames
    otherwise than by stamps and these frames are not known or do not exist.
    """
    if read.stamps_s is not None:
        return Estimate(read.stamps_s, read.poses)
    if frames is None:
        remedy = "name the folder of the sequence, or a file of the frames' stamps"
        raise InputError(path, "has no time stamps, and which frames there are is not known", remedy=remedy)
    assert read.numbers is not None, "poses have stamps or numbers"
    numbers = _numbers_by_name(path, read, frames) if read.names else read.numbers.astype(np.int64)
    if read.count is not None and read.count != len(frames):
        remedy = "poses without numbers or stamps are those of all frames, in their order"
        raise InputError(path, f"has {read.count} poses for {len(frames)} frames", remedy=remedy)
    _check_numbers(path, numbers, len(frames))
    order = np.argsort(numbers, kind="stable")
    return Estimate(frames.stamps_s[numbers[order]], read.poses[order])


def match_frames(estimate: Estimate, frames_s: NDArray[np.float64]) -> tuple[Estimate, str]:
    """Return the poses that belong to frames, under the frames' stamps (N,), and a sentence on the others, "" of none.

    By the rule by which scores pair poses with true ones, `associate_poses`. Where no pose belongs to a frame, all are
    returned under their own stamps, so that their score says so.
    """
    rows, of_frames = associate_poses(estimate.stamps_s, frames_s, MAX_DIFFERENCE_S)
    others = len(estimate) - len(rows)
    if not others:
        return Estimate(frames_s[of_frames], estimate.c2w[rows]), ""
    how = f"within {MAX_DIFFERENCE_S:g} s by their stamps"
    if not len(rows):
        off_s = float(
            np.abs(estimate.stamps_s[:, None] - _reading_nearest(frames_s, estimate.stamps_s)).min(initial=np.inf)
        )
        nearest = f"the nearest is {off_s:.3g} s off" if len(frames_s) else "there is none"
        return estimate, f"no pose belongs to a frame that was given, {how}: {nearest}"
    sentence = f"{others} of {len(estimate)} poses belong to no frame that was given, {how}"
    return Estimate(frames_s[of_frames], estimate.c2w[rows]), sentence


def _reading_nearest(frames_s: NDArray[np.float64], stamps_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,), (M,) -> (M, 2): the frames' stamps before and after each; (M, 0) where there is no frame."""
    if not len(frames_s):
        return np.zeros((len(stamps_s), 0))
    after = np.clip(np.searchsorted(frames_s, stamps_s), 0, len(frames_s) - 1)
    return np.stack([frames_s[np.maximum(after - 1, 0)], frames_s[after]], axis=1)


def read_estimate(
    name: str,
    path: Path,
    index: Index | Frames,
    *,
    direction: Direction | Auto | None = None,
    axes: Axes | Auto | None = None,
    largest_bytes: int = LARGEST_READ_BYTES,
) -> Estimate:
    """Return what a system estimated, from the file or folder that it wrote, as poses of the frames that it was given.

    name: of the format, or "auto". index: the frames. direction, axes: of the poses, where the format leaves them open
    (not `TrajectoryFormat.one_convention`); None for the format's own. largest_bytes: that are read of a file with more
    than poses in it (`TrajectoryFormat.reads_parts`).
    Frames that the system did not track are missing; a file without a pose is an estimate of none. Poses that belong to
    no frame are left out, unless none does: then they have their own stamps. Raises what `read_poses` and `estimate_of`
    raise.
    """
    frames = index if isinstance(index, Frames) else Frames.of_index(index)
    asked = Asked(direction or "auto", axes or "auto", largest_bytes=largest_bytes)
    read = read_poses(path, name, asked, frames.stamps_s)
    return match_frames(estimate_of(path, read, frames), frames.stamps_s)[0]


def _check_numbers(path: Path, numbers: NDArray[np.int64], count: int) -> None:
    outside = np.flatnonzero((numbers < 0) | (numbers >= count))
    if outside.size:
        raise InputError(path, f"has a pose for frame {numbers[outside[0]]}, but there are {count}, from 0")
    each, counts = np.unique(numbers, return_counts=True)
    if (counts > 1).any():
        raise InputError(path, "has two poses", where=f"frame {each[np.argmax(counts > 1)]}")


def _numbers_by_name(path: Path, read: FilePoses, frames: Frames) -> NDArray[np.int64]:
    """Return the numbers of the frames whose colour image has the name that a pose gives, without its folders."""
    if not frames.names:
        problem = "names images, and those of the frames are not known"
        raise InputError(path, problem, remedy="name the folder of the sequence")
    numbered: dict[str, list[int]] = {}
    for number, name in enumerate(frames.names):
        numbered.setdefault(_file_name(name), []).append(number)
    numbers = []
    for row, name in enumerate(read.names):
        frames_of_name = numbered.get(_file_name(name), [])
        if len(frames_of_name) != 1:
            problem = f"{quoted(name)} is the name of {len(frames_of_name)} frames' colour images"
            raise InputError(path, problem, where=read.places[row], remedy="each image has to be that of one frame")
        numbers.append(frames_of_name[0])
    return np.array(numbers, dtype=np.int64)


def _file_name(name: str) -> str:
    return PureWindowsPath(name).name  # which takes / and \\ for separators


__all__ = [
    "Asked",
    "Frames",
    "Index",
    "NotFiniteError",
    "estimate_of",
    "match_frames",
    "read_estimate",
    "read_poses",
]
