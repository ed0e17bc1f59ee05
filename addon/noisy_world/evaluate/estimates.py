# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimates of SLAM systems: from what a system wrote to poses of frames. Studies, `score` and the library read so.

A format is one module with a `FORMAT`, and its name in the list in `reading`.
"""

from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError, NotFiniteError
from ..core.file_access import open_regular
from ..core.schema import quoted
from ..core.trajectory import Axes, Direction
from ..trajectories.pose_files import StampUnit
from ..trajectories.stamped_poses import first_of_equal
from .estimate_formats import (
    LARGEST_READ_BYTES,
    Asked,
    Auto,
    EstimateFormat,
    ReadPoses,
    colmap_images,
    pose_arrays,
    pose_texts,
    splatam_parameters,
    vslamlab_results,
)

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


# The one reader of estimates: a file in any format, and the frames that its poses belong to.


_RECOGNISED = (splatam_parameters.FORMAT, colmap_images.FORMAT, vslamlab_results.FORMAT, pose_arrays.FORMAT)

FORMATS: Mapping[str, EstimateFormat] = ChainMap(
    {item.name: item for item in _RECOGNISED}, cast("Any", pose_texts.FORMATS)
)
"""Every format by the name that a system's definition and `score --format` give."""

_HEAD_BYTES = 16
_UNITS: tuple[StampUnit, ...] = ("s", "ns")
_FEW = 2  # poses that meet frames: one alone may do so in the wrong unit, in which all stamps are nearly one


def format_of(path: Path) -> EstimateFormat:
    """Return the format of a file or folder by its name and first bytes: `text.OF_ANY` where none is recognised."""
    head = b""
    if not path.is_dir():
        try:
            with open_regular(path) as stream:
                head = stream.read(_HEAD_BYTES)
        except InputError:
            raise
        except OSError:  # of which the format's reader says more
            pass
    return next((known for known in _RECOGNISED if known.recognises(path, head)), pose_texts.OF_ANY)


def read_poses(
    path: Path,
    format: str = "auto",  # noqa: A002
    asked: Asked | None = None,
    frames_s: NDArray[np.float64] | None = None,
) -> ReadPoses:
    """Read the poses of a file, or of a folder of one pose a file, in a format, or in the one that it looks like.

    frames_s: (N,) stamps of the frames, or of the truth, where they are known: where the unit of the poses' stamps is
    not declared, it is the one in which they are those of frames; ORB-SLAM3 writes nanoseconds into TUM's columns.
    Raises NotFiniteError where a pose holds NaN or infinity and is no lost frame, InputError, of which it is one, where
    the file is not of its format, and ValueError for an unknown format and what it does not leave open.
    """
    asked = asked or Asked()
    known = format_of(path) if format == "auto" else FORMATS.get(format)
    if known is None:
        raise ValueError(f"no reader is called {format!r}; known are {', '.join(FORMATS)}")
    given = [name for name in ("direction", "axes") if getattr(asked, name) != "auto"]
    if given and not known.any_convention:
        raise ValueError(f"the poses of {known.name} have one convention, so {' and '.join(given)} cannot be given")
    if not known.any_unit or asked.stamp_unit != "auto" or asked.stamps != "time" or frames_s is None:
        return known.read(path, asked)
    return _in_the_unit_of(known, path, asked, frames_s)


def _in_the_unit_of(known: EstimateFormat, path: Path, asked: Asked, frames_s: NDArray[np.float64]) -> ReadPoses:
    """Return the poses with stamps in the unit in which most of them are those of frames, the format's own first."""
    best: ReadPoses | None = None
    most, refused = -1, None
    for unit in ("auto", *_UNITS):
        try:
            found = known.read(path, replace(asked, stamp_unit=unit))
        except NotFiniteError:
            raise
        except InputError as error:
            refused = refused or error
            continue
        if found.stamps_s is None:
            return found
        met = len(associate_poses(np.unique(found.stamps_s), frames_s)[0])
        if best is None or (met > most and met >= _FEW):
            note = () if unit == "auto" else (f"{path.name}: its time stamps are those of the frames in {unit}",)
            best, most = replace(found, notes=(*found.notes, *note)), met
        if met >= min(_FEW, len(found)):
            break
    if best is None:
        assert refused is not None
        raise refused
    return best


def estimate_of(path: Path, read: ReadPoses, frames: Frames | None) -> tuple[Estimate, tuple[str, ...]]:
    """Return poses with the time stamps of their frames, or their own where they have some; and notes.

    Of poses with one stamp the first is kept. frames: that the system was given; None where they are not known. Raises
    InputError where poses say their frames otherwise than by stamps and these frames are not known or do not exist.
    """
    if read.stamps_s is not None:
        order = np.argsort(read.stamps_s, kind="stable")
        stamps_s = read.stamps_s[order]
        kept, notes = first_of_equal(stamps_s, lambda row: _place(read, int(order[row]), stamps_s[row]))
        return Estimate(stamps_s[kept], read.c2w[order][kept]), tuple(f"{path.name}: {note}" for note in notes)
    if frames is None:
        remedy = "name the folder of the sequence, or a file of the frames' stamps"
        raise InputError(path, "has no time stamps, and which frames there are is not known", remedy=remedy)
    numbers = _numbers_by_name(path, read, frames) if read.names is not None else read.numbers
    assert numbers is not None, "poses have stamps, numbers or names"
    if read.count is not None and read.count != len(frames):
        remedy = "poses without numbers or stamps are those of all frames, in their order"
        raise InputError(path, f"has {read.count} poses for {len(frames)} frames", remedy=remedy)
    _check_numbers(path, numbers, len(frames))
    order = np.argsort(numbers, kind="stable")
    return Estimate(frames.stamps_s[numbers[order]], read.c2w[order]), ()


def match_frames(
    estimate: Estimate, frames_s: NDArray[np.float64], within_s: float = MAX_DIFFERENCE_S
) -> tuple[Estimate, str]:
    """Return the poses that belong to frames, under the frames' stamps (N,), and a sentence on the others, "" of none.

    By the rule by which scores pair poses with true ones, `associate_poses`. Where no pose belongs to a frame, all are
    returned under their own stamps, so that their score says so.
    """
    rows, of_frames = associate_poses(estimate.stamps_s, frames_s, within_s)
    others = len(estimate) - len(rows)
    if not others:
        return Estimate(frames_s[of_frames], estimate.c2w[rows]), ""
    how = f"within {within_s:g} s by their stamps"
    if not len(rows):
        off_s = float(
            np.abs(estimate.stamps_s[:, None] - _reading_nearest(frames_s, estimate.stamps_s)).min(initial=np.inf)
        )
        nearest = f"the nearest is {off_s:.3g} s off" if len(frames_s) else "there is none"
        return estimate, f"no pose belongs to a frame that was given, {how}: {nearest}"
    said = f"{others} of {len(estimate)} poses belong to no frame that was given, {how}"
    return Estimate(frames_s[of_frames], estimate.c2w[rows]), said


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
    (`EstimateFormat.any_convention`); None for camera-to-world and OpenCV's, or the format's own. largest_bytes: that
    are read of a file with more than poses in it (`EstimateFormat.reads_parts`).
    Frames that the system did not track are missing; a file without a pose is an estimate of none. Poses that belong to
    no frame are left out, unless none does: then they have their own stamps. Raises what `read_poses` and `estimate_of`
    raise.
    """
    frames = index if isinstance(index, Frames) else Frames.of_index(index)
    asked = Asked(direction or "auto", axes or "auto", largest_bytes=largest_bytes)
    read = read_poses(path, name, asked, frames.stamps_s)
    estimate, _ = estimate_of(path, read, frames)
    return match_frames(estimate, frames.stamps_s)[0]


def _place(read: ReadPoses, row: int, stamp_s: float) -> str:
    return f"{read.places[row]}: {stamp_s:.9f} s" if read.places else f"{stamp_s:.9f} s"


def _check_numbers(path: Path, numbers: NDArray[np.int64], count: int) -> None:
    outside = np.flatnonzero((numbers < 0) | (numbers >= count))
    if outside.size:
        raise InputError(path, f"has a pose for frame {numbers[outside[0]]}, but there are {count}, from 0")
    found, counts = np.unique(numbers, return_counts=True)
    if (counts > 1).any():
        raise InputError(path, "has two poses", where=f"frame {found[np.argmax(counts > 1)]}")


def _numbers_by_name(path: Path, read: ReadPoses, frames: Frames) -> NDArray[np.int64]:
    """Return the numbers of the frames whose colour image has the name that a pose gives, without its folders."""
    assert read.names is not None
    if not frames.names:
        problem = "names images, and those of the frames are not known"
        raise InputError(path, problem, remedy="name the folder of the sequence")
    numbered: dict[str, list[int]] = {}
    for number, name in enumerate(frames.names):
        numbered.setdefault(_file_name(name), []).append(number)
    numbers = []
    for row, name in enumerate(read.names):
        found = numbered.get(_file_name(name), [])
        if len(found) != 1:
            problem = f"{quoted(name)} is the name of {len(found)} frames' colour images"
            raise InputError(path, problem, where=read.places[row], remedy="each image has to be that of one frame")
        numbers.append(found[0])
    return np.array(numbers, dtype=np.int64)


def _file_name(name: str) -> str:
    return PurePosixPath(Path(name).as_posix()).name


__all__ = [
    "FORMATS",
    "Asked",
    "EstimateFormat",
    "Frames",
    "Index",
    "NotFiniteError",
    "ReadPoses",
    "estimate_of",
    "match_frames",
    "read_estimate",
    "read_poses",
]
