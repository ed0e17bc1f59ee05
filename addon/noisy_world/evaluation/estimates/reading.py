# SPDX-License-Identifier: GPL-3.0-or-later
"""The one reader of estimates: a file in any format, and the frames that its poses belong to."""

from collections import ChainMap
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError, NotFiniteError
from ...core.regular_files import open_regular
from ...core.schema import shown
from ...core.trajectories.pose_text import StampUnit
from ...core.trajectories.stamped_poses import first_of_equal
from ...core.trajectories.trajectory import Axes, Direction
from ..association import MAX_DIFFERENCE_S, associate_poses
from ..estimate import Estimate
from . import arrays, colmap, splatam, text, vslamlab
from .format import Asked, Auto, EstimateFormat
from .frames import Frames, Index
from .poses import LARGEST_READ_BYTES, ReadPoses

_RECOGNISED = (splatam.FORMAT, colmap.FORMAT, vslamlab.FORMAT, arrays.FORMAT)

FORMATS: Mapping[str, EstimateFormat] = ChainMap({item.name: item for item in _RECOGNISED}, cast("Any", text.FORMATS))
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
    return next((known for known in _RECOGNISED if known.recognises(path, head)), text.OF_ANY)


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
        off_s = float(np.abs(estimate.stamps_s[:, None] - _nearest(frames_s, estimate.stamps_s)).min(initial=np.inf))
        nearest = f"the nearest is {off_s:.3g} s off" if len(frames_s) else "there is none"
        return estimate, f"no pose belongs to a frame that was given, {how}: {nearest}"
    said = f"{others} of {len(estimate)} poses belong to no frame that was given, {how}"
    return Estimate(frames_s[of_frames], estimate.c2w[rows]), said


def _nearest(frames_s: NDArray[np.float64], stamps_s: NDArray[np.float64]) -> NDArray[np.float64]:
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
            problem = f"{shown(name)} is the name of {len(found)} frames' colour images"
            raise InputError(path, problem, where=read.places[row], remedy="each image has to be that of one frame")
        numbers.append(found[0])
    return np.array(numbers, dtype=np.int64)


def _file_name(name: str) -> str:
    return PurePosixPath(Path(name).as_posix()).name
