# SPDX-License-Identifier: GPL-3.0-or-later
"""The results of VSLAM-LAB, `NNNNN_KeyFrameTrajectory.csv`.

`ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw`, camera-to-world, by the stamps of its rgb.csv. The lines may be in any
order, and some systems head the first column `timestamp`, or separate by blanks (Baselines/baseline_files and
Evaluate/evo_functions.py of https://github.com/VSLAM-LAB/VSLAM-LAB).
"""

from pathlib import Path

import numpy as np

from ...core.geometry import pose, rotation_from_quat_wxyz
from ...trajectories.pose_files import PER_SECOND, all_finite, read_text, text_rows
from . import Asked, EstimateFormat, ReadPoses, no_pose
from .pose_texts import check_whole, holds_no_pose

COLUMNS = "ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw"
_MOST_DIGITS = 20  # of nanoseconds in 64 bits
_QUAT_NORM_TOLERANCE = 1e-2  # as for trajectory files


def read(path: Path, asked: Asked) -> ReadPoses:
    """Read a file, whose lines may be in any order. Raises InputError.

    Stamps are nanoseconds if the header says so, or if they are whole; else seconds.
    """
    text = read_text(path)
    if holds_no_pose(text):
        return no_pose("vslamlab")
    check_whole(path, text)
    rows = text_rows(path, text)
    table = all_finite(rows.table((8,), f"a line is {COLUMNS}"))
    stamps = [_exact(cell) for cell in rows.cells(0)]
    whole = "(ns)" in " ".join(rows.headers) or all(isinstance(stamp, int) for stamp in stamps)
    per_s = PER_SECOND[asked.stamp_unit if asked.stamp_unit != "auto" else "ns" if whole else "s"]
    stamps_s = np.array([stamp / per_s for stamp in stamps])
    with np.errstate(over="ignore"):  # of a number that is refused, as its length is not 1
        lengths = np.linalg.norm(table.values[:, 4:], axis=1)
    wrong = np.abs(lengths - 1.0) > _QUAT_NORM_TOLERANCE
    table.fail_where(wrong, "the quaternion has length {}, not 1", of=lengths, remedy=f"a line is {COLUMNS}")
    quats = np.roll(table.values[:, 4:] / lengths[:, None], 1, axis=1)
    c2w = pose(rotation_from_quat_wxyz(quats), table.values[:, 1:4])
    return ReadPoses("vslamlab", c2w, stamps_s=stamps_s, places=tuple(f"line {line}" for line in rows.lines))


def _exact(text: str) -> float | int:
    """Return a stamp; a whole number is kept whole, since float64 does not hold nanoseconds of a real clock."""
    whole = text.removeprefix("-").isdecimal() and len(text) <= _MOST_DIGITS  # more are no stamp, and slow to convert
    return int(text) if whole else float(text)


def _recognises(path: Path, head: bytes) -> bool:
    del path
    return head.startswith(b"ts (ns)")


FORMAT = EstimateFormat("vslamlab", "VSLAM-LAB's NNNNN_KeyFrameTrajectory.csv", read, _recognises, any_unit=True)
