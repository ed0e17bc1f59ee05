# SPDX-License-Identifier: GPL-3.0-or-later
"""An estimate, the truth and the frames read from files, with the times of poses that have none of their own."""

import re
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.schema import quoted
from ..core.trajectory import Axes, Direction, Trajectory
from ..layouts import find_sequence, recognising
from ..layouts.stored_recording import RATE_HZ, StoredSequence
from ..trajectories.formats import Auto
from ..trajectories.pose_files import LARGEST_STAMP_S, is_header, read_text
from .estimates import Asked, Estimate, Frames, ReadPoses, estimate_of, read_poses
from .run_files import ESTIMATE, KEYFRAMES

# A list of the frames that a system was given: a stamp a line, as TUM's rgb.txt, EuRoC's data.csv and times.txt.


_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?")
_LEAST_NS = 10**17  # 1973 in nanoseconds: stamps from here on are nanoseconds, as in files of poses
_MOST_DIGITS = 40
_REMEDY = "a line is a time stamp, and perhaps a file, as in TUM's rgb.txt and EuRoC's data.csv"


def read_frame_list(path: Path) -> Frames:
    """Read a list of frames: each line's first word is a stamp in seconds, or in nanoseconds from 1e17 on.

    What follows, at its end the name of the frame's image, is separated by blanks or commas. Raises InputError.
    """
    stamps: list[Decimal] = []
    names: list[str] = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        data = line.partition("#")[0].strip()
        words = re.split(r"[\s,]+", data)
        if not data or (not stamps and is_header(words[0])):
            continue
        if len(words[0]) > _MOST_DIGITS or not _NUMBER.fullmatch(words[0]):
            raise InputError(path, f"{quoted(words[0])} is no time stamp", where=f"line {number}", remedy=_REMEDY)
        stamps.append(Decimal(words[0]))
        names.append(words[1] if len(words) > 1 else "")
    if not stamps:
        raise InputError(path, "lists no frame", remedy=_REMEDY)
    per_s = 10**9 if all(stamp >= _LEAST_NS for stamp in stamps) else 1
    seconds = np.array([float(stamp / per_s) for stamp in stamps])
    if np.abs(seconds).max() > LARGEST_STAMP_S:
        raise InputError(path, "has time stamps of more than 1e11 s", remedy="write them in seconds, or in nanoseconds")
    seconds, first = np.unique(seconds, return_index=True)
    return Frames.of(seconds, [names[row] for row in first.tolist()] if all(names) else ())


COLOUR_LIST = "rgb.txt"  # of TUM's layout
_DEPTH = 3  # folders from a true path up to its sequence: EuRoC's lies in mav0/state_groundtruth_estimate0


@dataclass(frozen=True)
class PosesToCompare:
    """An estimate, the keyframes where there are some, and the truth.

    frames: those that the system was given, where a folder or a file says them; None: they follow from the stamps.
    frames_from: where they come from, in words; "" where they are not known. notes: what a user should know.
    """

    estimate: Estimate
    truth: Trajectory
    keyframes: Estimate | None = None
    frames: Frames | None = None
    frames_from: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _KnownFrames:
    """The frames, where they come from, in words, and what is to be said of them.

    of_truth: whether they are the true poses, which have no time stamps of their own.
    """

    frames: Frames | None = None
    said: str = ""
    notes: tuple[str, ...] = ()
    of_truth: bool = False


def read_poses_to_compare(
    estimate: Path,
    truth: Path,
    *,
    keyframes: Path | None = None,
    frames: Path | None = None,
    format: str = "auto",  # noqa: A002
    direction: Direction = "c2w",
    axes: Axes | None = None,
    rate_hz: float | None = None,
) -> PosesToCompare:
    """Read an estimate and the truth, files of poses in any format.

    estimate: a file or folder of poses, or a run's folder with estimate.txt; a file without a pose is an estimate
    without poses. truth: a file or folder of poses, or a sequence's folder. keyframes: a file of poses; a run's folder
    has its own. frames: a list of the frames' stamps, or a sequence's folder; None: those of the folder of the
    sequence that the truth is, or lies in, where there is one. format, direction, axes: of the estimate's poses.
    Poses without stamps count the frames: they get the stamps of those, or of the truth where that has as many, else a
    rate is needed. Raises InputError, for files that hold anything else too, and where stamps cannot be had.
    """
    folder = estimate if (estimate / ESTIMATE).is_file() else None
    if folder is not None:
        estimate = folder / ESTIMATE
        keyframes = folder / KEYFRAMES if keyframes is None and (folder / KEYFRAMES).is_file() else keyframes
    true, given = _read_truth(truth, rate_hz)
    if frames is not None:
        given = _KnownFrames(_frames_of(frames), f"those of {frames.name}")
    known = given.frames
    reference_s = known.stamps_s if known is not None else true.stamps_s
    direction_given: Direction | Auto = "auto" if direction == "c2w" else direction
    asked = Asked(direction_given, axes or "auto")
    found = read_poses(estimate, format, asked, reference_s)
    notes = [*found.notes, *true.notes, *given.notes]
    path, counted = _with_stamps(truth, true, found, known, rate_hz)
    of_estimate, more = _estimate(estimate, found, path, known, rate_hz)
    notes += [*counted, *more]
    of_keyframes = None
    if keyframes is not None:
        read = read_poses(keyframes, "auto", asked, reference_s)
        if read.stamps_s is None and len(read):
            raise InputError(keyframes, "has no time stamps", remedy="keyframes need them: write TUM's format")
        of_keyframes = _NONE if read.stamps_s is None else estimate_of(keyframes, read, None)
    known = Frames.of(path.stamps_s) if given.of_truth else known
    return PosesToCompare(of_estimate, path, of_keyframes, known, given.said, tuple(notes))


_NONE = Estimate(np.zeros(0), np.zeros((0, 4, 4)))


def _read_truth(path: Path, rate_hz: float | None) -> tuple[ReadPoses, _KnownFrames]:
    """Return the true poses, and the frames of the sequence that the path is the folder of, or lies in."""
    if path.is_dir() and recognising(path):
        sequence = find_sequence(path, rate_hz)
        frames = None if sequence.stamps_path is None and rate_hz is None else _frames(sequence)
        poses = sequence.trajectory
        if frames is None:
            count = len(poses)
            counted = ReadPoses("", poses.c2w, numbers=np.arange(count), count=count, notes=poses.notes)
            return counted, _KnownFrames(None, _source_text(path), of_truth=True)
        return ReadPoses("", poses.c2w, stamps_s=poses.stamps_s, notes=poses.notes), _KnownFrames(
            frames, _source_text(path)
        )
    found = read_poses(path)
    if not len(found):
        raise InputError(path, "holds no pose", remedy="the true path needs one for each frame")
    return found, _frames_near(path)


def _frames_near(path: Path) -> _KnownFrames:
    """Return the frames of the sequence in whose folder a file of true poses lies; none where there is no sequence."""
    for folder in path.resolve().parents[:_DEPTH]:
        try:
            sequence = find_sequence(folder) if recognising(folder) else None
        except InputError:
            sequence = None
        own = sequence is not None and sequence.trajectory_path is not None and sequence.trajectory_path.samefile(path)
        if sequence is not None and own and sequence.stamps_path is not None:
            return _KnownFrames(_frames(sequence), _source_text(folder))
    listed = path.parent / COLOUR_LIST
    if not listed.is_file():
        return _KnownFrames()
    return _KnownFrames(
        read_frame_list(listed), f"those of {listed.name} beside {path.name}"
    )  # of a camera without depth


def _source_text(folder: Path) -> str:
    return f"those of the folder {folder.resolve().name}"


def _frames(sequence: StoredSequence) -> Frames:
    return Frames.of(sequence.stamps.rgb.seconds, sequence.rgb_files)


def _frames_of(path: Path) -> Frames:
    if path.is_dir():
        return _frames(find_sequence(path, poses="keep"))
    return read_frame_list(path)


def _with_stamps(
    path: Path, true: ReadPoses, found: ReadPoses, known: Frames | None, rate_hz: float | None
) -> tuple[Trajectory, tuple[str, ...]]:
    """Return the true path with time stamps, and a note on where they come from."""
    if true.stamps_s is not None:
        return Trajectory(true.c2w, true.stamps_s), ()
    if rate_hz is not None or (found.stamps_s is None and known is None):
        return _counted(path, true, rate_hz or RATE_HZ), (f"frames are counted at {rate_hz or RATE_HZ:g} Hz",)
    if known is None:
        assert found.stamps_s is not None
        frames, whose = Frames.of(np.unique(found.stamps_s)), "the estimate"
    else:
        frames, whose = known, "the frames"
    numbers = true.numbers
    if numbers is None or int(numbers[-1]) != len(frames) - 1:
        counted = "names images" if numbers is None else f"counts {int(numbers[-1]) + 1} frames"
        problem = f"has no time stamps, and {counted}, where {whose} are {len(frames)}"
        raise InputError(path, problem, remedy="say its frames a second: --rate-hz")
    estimate = estimate_of(path, true, frames)
    return Trajectory(estimate.c2w, estimate.stamps_s), (f"{path.name} has no time stamps: it gets those of {whose}",)


def _counted(path: Path, read: ReadPoses, rate_hz: float) -> Trajectory:
    """Return poses under the times of their frames' numbers at a rate."""
    if read.numbers is None:
        raise InputError(path, "names images, and which frames these are is not known", remedy="name --frames")
    return Trajectory(read.c2w, read.numbers / rate_hz)


def _estimate(
    path: Path, found: ReadPoses, truth: Trajectory, known: Frames | None, rate_hz: float | None
) -> tuple[Estimate, tuple[str, ...]]:
    """Return the estimate with time stamps, and notes on it."""
    if found.stamps_s is not None:
        return estimate_of(path, found, None), ()
    if not len(found):
        return _NONE, ()
    if known is not None:
        return (
            estimate_of(path, found, known),
            (f"{path.name} has no time stamps: its poses get those of the frames",),
        )
    if rate_hz is not None:
        counted = _counted(path, found, rate_hz)
        return Estimate(counted.stamps_s, counted.c2w), (f"{path.name}: frames are counted at {rate_hz:g} Hz",)
    if found.numbers is not None:
        frames = found.count or int(found.numbers.max()) + 1
        if frames != len(truth):
            problem = f"has no time stamps, and counts {frames} frames, where the truth has {len(truth)} poses"
            remedy = "say which frames there are, --frames, or how many a second: --rate-hz"
            raise InputError(path, problem, remedy=remedy)
    estimate = estimate_of(path, found, Frames.of(truth.stamps_s))
    return estimate, (f"{path.name} has no time stamps: its frames get those of the truth",)
