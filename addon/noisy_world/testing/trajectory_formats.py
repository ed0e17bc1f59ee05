# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a trajectory format keeps its contract."""

from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.trajectories.files import TRAJECTORY_FORMATS
from ..core.trajectories.pose_text import FilePoses, PoseFile, ReadOptions, TrajectoryFormat
from ..core.trajectories.trajectory import convert_convention
from .rules import path, require, require_name

EXACT = 1e-9
"""By how much a pose, in metres and entries of its rotation, and a stamp in seconds may differ after a round trip."""


def check_trajectory_format(item: TrajectoryFormat, file: Path, folder: Path) -> None:
    """Check a trajectory format. Raises AssertionError with the rule that it breaks.

    file: one of the format, or a folder of it, with two poses or more. folder: an empty one to write into.

    A file that is missing or empty is not recognised, its own is, and no other format recognises that. Reading finds
    rigid poses, with increasing stamps or numbers, and finds the same twice; a text that is cut in its first half ends
    with InputError. What it writes, where it does, it recognises, and comes back.
    """
    require(isinstance(item, TrajectoryFormat), str(item), f"is a {type(item).__name__}, no TrajectoryFormat")
    require_name(item.name)
    name = item.name
    require(item.label and item.meaning, name, "needs a label and a meaning")
    require(item.looks_like and item.recognised_by and item.times, name, "needs the words of the table of formats")
    (folder / "empty.txt").write_text("")
    for nothing in (folder / "no_such_file", folder / "empty.txt"):
        require(not item.recognises(PoseFile(nothing)), name, f"recognises {nothing.name}, which holds no pose")
    _check_recognised(item, file)
    poses, again = (item.read(PoseFile(file), ReadOptions()) for _ in range(2))
    _check_poses(item, poses)
    require(np.array_equal(poses.poses, again.poses), name, "reads something else the second time")
    if file.is_file():
        _check_cut(item, file.read_bytes(), folder / f"cut{file.suffix}")
    if item.write is not None:
        _check_written(item, folder / f"written{file.suffix}")


def _check_recognised(item: TrajectoryFormat, file: Path) -> None:
    require(item.recognises(PoseFile(file)), item.name, f"does not recognise its own file {file.name}")
    others = [
        name for name, other in TRAJECTORY_FORMATS.items() if name != item.name and other.recognises(PoseFile(file))
    ]
    require(not others, item.name, f"its file is recognised by {', '.join(others)} too; tell it by what they lack")


def _check_poses(item: TrajectoryFormat, found: FilePoses) -> None:
    name, poses = item.name, found.poses
    require(found.format == name, name, f"says that it read {found.format}")
    right = poses.dtype == np.float64 and poses.ndim == 3 and poses.shape[1:] == (4, 4) and len(poses) > 0
    require(right, name, f"reads poses of {poses.dtype} {poses.shape}, not float64 (N, 4, 4)")
    rotation = poses[:, :3, :3]
    rigid = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max() < EXACT and np.linalg.det(rotation) > 0
    require(np.all(rigid) and np.all(poses[:, 3] == [0, 0, 0, 1]), name, "reads poses that are not rigid")
    times = found.stamps_s if item.stamped else found.numbers
    require(times is not None, name, "reads no " + ("stamps" if item.stamped else "numbers of frames"))
    assert times is not None
    require(len(times) == len(poses) and np.all(np.diff(times) > 0), name, "its stamps or numbers do not increase")


def _check_cut(item: TrajectoryFormat, content: bytes, file: Path) -> None:
    """Check that a file that was cut gives fewer poses, or one line that names it."""
    file.write_bytes(content[: len(content) // 3])
    try:
        item.read(PoseFile(file), ReadOptions(declared=True))
    except InputError as error:
        require(str(file) in str(error), item.name, f"refuses a file that was cut without naming it: {error}")
    except Exception as error:
        rule = f"a file that was cut ends in {type(error).__name__}: {error}; raise InputError that names it"
        raise AssertionError(f"{item.name}: {rule}") from error


def _check_written(item: TrajectoryFormat, file: Path) -> None:
    assert item.write is not None
    whole = path(5)
    text = item.write(whole)
    require(text == item.write(whole), item.name, "writes something else the second time")
    file.write_text(text, encoding="utf-8")
    _check_recognised(item, file)
    found = item.read(PoseFile(file), ReadOptions())
    _check_poses(item, found)
    c2w = convert_convention(found.poses, direction=found.direction, axes=found.axes)
    off = np.abs(c2w - whole.c2w).max() if len(c2w) == len(whole) else np.inf
    require(off < EXACT, item.name, f"what it writes comes back {off:g} off")
    if found.stamps_s is not None:
        off_s = np.abs(found.stamps_s - whole.stamps_s).max()
        require(off_s < EXACT, item.name, f"the stamps that it writes come back {off_s:g} s off")
