# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses with time stamps in text: TUM's and EuRoC's formats, as `core.trajectories.files` reads them.

A file does not always say the unit of its stamps, and ORB-SLAM3 writes nanoseconds into TUM's columns. Here the frames
are known, so the unit is the one in which the stamps are those of the frames.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....core.errors import InputError, NotFiniteError
from ....core.trajectories.files import read_trajectory
from ....core.trajectories.pose_text import is_header, read_text
from ....core.trajectories.stamped_poses import StampedFormat, StampUnit
from ....core.trajectories.trajectory import Axes, Direction
from ...estimate import Estimate
from ...whole_text import check_whole
from .frames import Index, stamps_of

NO_POSE = Estimate(np.zeros(0), np.zeros((0, 4, 4)))
_UNITS: tuple[StampUnit, ...] = ("s", "ns")
_LEAST_COMMAS = 7  # of a header that names stamp, position and quaternion
_MARGIN_S = 1.0  # chosen: a system's clock may be late by some frames, and another unit is off by 1e9


def read(
    path: Path,
    index: Index,
    *,
    format: StampedFormat,  # noqa: A002
    direction: Direction = "c2w",
    axes: Axes = "opencv",
) -> Estimate:
    """Return the estimate of a file; of one without a line of numbers, that of a system that tracked no frame.

    Raises NotFiniteError, and InputError also where the stamps are not those of the frames in any unit.
    """
    if is_empty(path):
        return NO_POSE
    check_whole(path, read_text(path))
    frames_s = stamps_of(index)
    found, refusals = [], []
    for unit in ("auto", *_UNITS):
        try:
            path_read = read_trajectory(path, format=format, direction=direction, axes=axes, stamp_unit=unit)
        except NotFiniteError:
            raise
        except InputError as error:
            refusals.append(error)
            continue
        if _within(path_read.stamps_s, frames_s):
            return Estimate(path_read.stamps_s, path_read.c2w)
        found.append(path_read)
    raise elsewhere(path, found[0].stamps_s, frames_s) if found else refusals[0]


def is_empty(path: Path) -> bool:
    """Tell whether a text file holds nothing but blank lines, comments and a table's header. Raises InputError."""
    lines = (line.partition("#")[0].strip() for line in read_text(path).splitlines())
    rows = [line for line in lines if line]
    return not rows or (len(rows) == 1 and rows[0].count(",") >= _LEAST_COMMAS and is_header(rows[0]))


def _within(stamps_s: NDArray[np.float64], frames_s: NDArray[np.float64]) -> bool:
    """Tell whether stamps are, by and large, those of the frames."""
    middle_s = float(np.median(stamps_s))
    return bool(len(frames_s)) and frames_s[0] - _MARGIN_S <= middle_s <= frames_s[-1] + _MARGIN_S


def elsewhere(path: Path, stamps_s: NDArray[np.float64], frames_s: NDArray[np.float64]) -> InputError:
    """Return the error of an estimate whose stamps are not those of the frames."""
    first_s, last_s = stamps_s.min(), stamps_s.max()
    message = f"{frames_s[0]:.6f} to {frames_s[-1]:.6f} s" if len(frames_s) else "none"
    remedy = f"the frames': {message}; the estimate has to be that of this sequence"
    return InputError(path, f"its stamps, {first_s:.6f} to {last_s:.6f} s, are not those of the frames", remedy=remedy)
