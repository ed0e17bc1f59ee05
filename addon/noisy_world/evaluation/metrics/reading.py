# SPDX-License-Identifier: GPL-3.0-or-later
"""An estimate and the truth read from files, with the times of poses that have none of their own."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...core.datasets.layouts import LAYOUTS, find_sequence
from ...core.datasets.stored import RATE_HZ
from ...core.errors import InputError
from ...core.trajectories.files import STAMPED_FORMATS, read_trajectory_file
from ...core.trajectories.pose_text import read_text
from ...core.trajectories.trajectory import Axes, Direction, Trajectory
from ..estimate import Estimate
from ..whole_text import check_whole

ESTIMATE, KEYFRAMES = "estimate.txt", "keyframes.txt"
"""The files of a run's folder that hold poses."""


@dataclass(frozen=True)
class PosesToCompare:
    """An estimate, the keyframes where there are some, and the truth. notes: what a user should know."""

    estimate: Estimate
    truth: Trajectory
    keyframes: Estimate | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Read:
    """The poses of a file; None where it holds none. numbered: whether their stamps are the frames' numbers."""

    path: Path
    poses: Trajectory | None
    numbered: bool = False

    @property
    def notes(self) -> tuple[str, ...]:
        return () if self.poses is None else self.poses.notes

    @property
    def estimate(self) -> Estimate:
        if self.poses is None:
            return Estimate(np.zeros(0), np.zeros((0, 4, 4)))
        return Estimate(self.poses.stamps_s, self.poses.c2w)


def read_poses_to_compare(
    estimate: Path,
    truth: Path,
    *,
    keyframes: Path | None = None,
    direction: Direction = "c2w",
    axes: Axes | None = None,
    rate_hz: float | None = None,
) -> PosesToCompare:
    """Read an estimate and the truth, files of poses in any format.

    estimate: a file or folder of poses, or a run's folder with estimate.txt; a file without a line of numbers is an
    estimate without poses. truth: a file or folder of poses, or a sequence's folder. keyframes: a file of poses; a
    run's folder has its own. direction, axes: of the estimate's poses; None is the format's.
    Poses without stamps count the frames: they get those of the other file where that has as many, else a rate is
    needed. Raises InputError, for files that hold anything else too, and where stamps cannot be had.
    """
    folder = estimate if (estimate / ESTIMATE).is_file() else None
    if folder is not None:
        estimate = folder / ESTIMATE
        keyframes = folder / KEYFRAMES if keyframes is None and (folder / KEYFRAMES).is_file() else keyframes
    found, true = _read(estimate, direction, axes), _read_truth(truth)
    found, true, note = _stamped(found, true, rate_hz)
    of_keyframes = None if keyframes is None else _read(keyframes, direction, axes)
    if of_keyframes is not None and of_keyframes.numbered:
        raise InputError(of_keyframes.path, "has no time stamps", remedy="keyframes need them: write TUM's format")
    assert true.poses is not None
    notes = (*found.notes, *true.notes, *note)
    return PosesToCompare(found.estimate, true.poses, None if of_keyframes is None else of_keyframes.estimate, notes)


def _read(path: Path, direction: Direction, axes: Axes | None) -> _Read:
    if not path.is_dir():
        text = read_text(path)
        if _is_empty(text):
            return _Read(path, None)
        check_whole(path, text)
    read = read_trajectory_file(path, direction=direction, axes=axes or "auto", rate_hz=1.0)
    return _Read(path, read.trajectory, read.format not in STAMPED_FORMATS)


def _read_truth(path: Path) -> _Read:
    if any(layout.recognises(path) for layout in LAYOUTS.values()):
        sequence = find_sequence(path, 1.0)
        return _Read(path, sequence.trajectory, sequence.stamps_path is None)
    found = _read(path, "c2w", None)
    if found.poses is None:
        raise InputError(path, "holds no pose", remedy="the true path needs one for each frame")
    return found


def _is_empty(text: str) -> bool:
    return not any(line.partition("#")[0].strip() for line in text.splitlines())


def _stamped(estimate: _Read, truth: _Read, rate_hz: float | None) -> tuple[_Read, _Read, tuple[str, ...]]:
    """Return both with stamps, and a note on where they come from."""
    if rate_hz is not None or (estimate.numbered and truth.numbered) or estimate.poses is None:
        rate = RATE_HZ if rate_hz is None else rate_hz
        note = (f"frames are counted at {rate:g} Hz",) if estimate.numbered or truth.numbered else ()
        return _at_rate(estimate, rate), _at_rate(truth, rate), note
    if not estimate.numbered and not truth.numbered:
        return estimate, truth, ()
    bare, other = (estimate, truth) if estimate.numbered else (truth, estimate)
    assert bare.poses is not None
    assert other.poses is not None
    last = int(bare.poses.stamps_s[-1])
    if last != len(other.poses) - 1:
        problem = f"has no time stamps, and counts {last + 1} frames, where {other.path} has {len(other.poses)} poses"
        raise InputError(bare.path, problem, remedy="say its frames a second: --rate-hz")
    rows = bare.poses.stamps_s.astype(np.int64)
    timed = replace(bare, poses=Trajectory(bare.poses.c2w, other.poses.stamps_s[rows], bare.notes), numbered=False)
    note = (f"{bare.path.name} has no time stamps: its frames get those of {other.path.name}",)
    return (timed, truth, note) if bare is estimate else (estimate, timed, note)


def _at_rate(read: _Read, rate_hz: float) -> _Read:
    if not read.numbered or read.poses is None:
        return read
    poses = Trajectory(read.poses.c2w, read.poses.stamps_s / rate_hz, read.notes)
    return replace(read, poses=poses, numbered=False)
