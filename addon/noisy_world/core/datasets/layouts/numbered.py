# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings whose images and poses belong together by the numbers in their names, as most people's do."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...trajectories.stamps import FrameStamps
from ...trajectories.trajectory import Trajectory
from ..known_poses import PosePolicy, chosen_by_pose

LARGEST_NUMBER = 10**9  # over a year at 30 Hz: what is larger is no count


@dataclass(frozen=True, eq=False)
class NumberedPoses:
    """Poses by the number of their frame. c2w: (4, 4) each, OpenCV's camera axes. path: their file or folder."""

    path: Path
    c2w: Mapping[int, NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class NumberedFrames:
    """The frames of a recording, in the order of their numbers. notes: on those that are left out."""

    rgb_files: tuple[Path, ...]
    depth_files: tuple[Path, ...]
    trajectory: Trajectory
    stamps: FrameStamps
    notes: tuple[str, ...]


def numbered_images(folder: Path, pattern: str) -> dict[int, Path]:
    """Return the files of a folder whose whole name matches a pattern, by the number that its first group catches.

    Raises InputError where two have one number, or the folder cannot be read.
    """
    found: dict[int, Path] = {}
    try:
        files = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(folder, f"cannot be read: {error.strerror or error}") from None
    for path in files:
        match = re.fullmatch(pattern, path.name)
        if match is None:
            continue
        number = int(match[1][-20:])
        if number > LARGEST_NUMBER or len(match[1]) > 20:
            raise InputError(path, "its number is too large to count frames", remedy="number the frames from 0")
        if (same := found.setdefault(number, path)) != path:
            raise InputError(folder, f"{same.name} and {path.name} have one number", remedy="keep one of them")
    return found


def numbered_frames(
    folder: Path,
    rgb: Mapping[int, Path],
    depth: Mapping[int, Path],
    poses: NumberedPoses | None,
    *,
    policy: PosePolicy,
    rate_hz: float,
) -> NumberedFrames:
    """Return the frames that have colour and depth, and a pose where the policy wants it; frame i is at i / rate_hz.

    poses: None for a recording without ground truth, whose policy is "keep" or "none". Raises InputError where no frame
    is left.
    """
    numbers = sorted(rgb.keys() & depth.keys())
    if not numbers:
        problem = f"has {len(rgb)} colour and {len(depth)} depth images, none of which have one number"
        raise InputError(folder, problem)
    known = np.array([poses is not None and number in poses.c2w for number in numbers])
    rows, told = chosen_by_pose(folder if poses is None else poses.path, known, policy)
    chosen = [numbers[row] for row in rows]
    c2w = np.tile(np.eye(4), (len(chosen), 1, 1))
    if poses is not None:
        for row, number in enumerate(chosen):
            c2w[row] = poses.c2w.get(number, c2w[row])
    stamps_s = np.array(chosen, dtype=np.float64) / rate_hz
    unpaired = len(rgb) + len(depth) - 2 * len(numbers)
    alone = f"{unpaired} images are left out: no colour or no depth has their number" if unpaired else ""
    return NumberedFrames(
        tuple(rgb[number] for number in chosen),
        tuple(depth[number] for number in chosen),
        Trajectory(c2w, stamps_s, posed=known[rows]),
        FrameStamps.of(stamps_s),
        tuple(note for note in (alone, told) if note),
    )
