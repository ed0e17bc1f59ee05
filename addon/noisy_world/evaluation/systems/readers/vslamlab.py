# SPDX-License-Identifier: GPL-3.0-or-later
"""The results of VSLAM-LAB, `NNNNN_KeyFrameTrajectory.csv`.

`ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw`, camera-to-world, by the stamps of its rgb.csv. The lines may be in any
order, and some systems head the first column `timestamp`, or separate by blanks (Baselines/baseline_files and
Evaluate/evo_functions.py of https://github.com/VSLAM-LAB/VSLAM-LAB).
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....core.datasets.association import PAIRING_S
from ....core.errors import InputError
from ....core.geometry import pose, rotation_from_quat_wxyz
from ....core.trajectories.pose_text import all_finite, read_text, text_rows
from ....core.trajectories.stamps import NS_PER_S
from ...estimate import Estimate
from ...whole_text import check_whole
from .frames import Index, stamps_of
from .stamped import NO_POSE, elsewhere, is_empty

COLUMNS = "ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw"
_MOST_DIGITS = 20  # of nanoseconds in 64 bits
_QUAT_NORM_TOLERANCE = 1e-2  # as for trajectory files


def read(path: Path, index: Index) -> Estimate:
    """Return the estimate of a file, in the order of time; of a line given twice, one. Raises InputError."""
    if is_empty(path):
        return NO_POSE
    text = read_text(path)
    check_whole(path, text)
    rows = text_rows(path, text)
    table = all_finite(rows.table((8,), f"a line is {COLUMNS}"))
    stamps_s = _seconds(path, rows.cells(0), " ".join(rows.headers), stamps_of(index))
    with np.errstate(over="ignore"):  # of a number that is refused, as its length is not 1
        lengths = np.linalg.norm(table.values[:, 4:], axis=1)
    wrong = np.abs(lengths - 1.0) > _QUAT_NORM_TOLERANCE
    table.fail_where(wrong, "the quaternion has length {}, not 1", of=lengths, remedy=f"a line is {COLUMNS}")
    quats = np.roll(table.values[:, 4:] / lengths[:, None], 1, axis=1)
    c2w = pose(rotation_from_quat_wxyz(quats), table.values[:, 1:4])
    order = np.argsort(stamps_s, kind="stable")
    stamps_s, c2w = stamps_s[order], c2w[order]
    first = np.concatenate([[True], np.diff(stamps_s) > 0.0])
    for row in np.flatnonzero(~first):
        if not np.array_equal(c2w[row], c2w[row - 1]):
            raise InputError(path, f"has two poses at {stamps_s[row]:.9f} s")
    return Estimate(stamps_s[first], c2w[first])


def _exact(text: str) -> float | int:
    """Return a stamp; a whole number is kept whole, since float64 does not hold nanoseconds of a real clock."""
    whole = text.removeprefix("-").isdecimal() and len(text) <= _MOST_DIGITS  # more are no stamp, and slow to convert
    return int(text) if whole else float(text)


def _seconds(path: Path, texts: list[str], header: str, frames_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return stamps in seconds, by the unit in which they are those of more frames: nanoseconds, or seconds.

    In the wrong unit all would be the first frame's, or none. One stamp alone fits both where the first frame's is 0:
    then it is nanoseconds if the header says so, or if it is whole.
    """
    stamps = [_exact(text) for text in texts]
    units = (NS_PER_S, 1) if "(ns)" in header or all(isinstance(stamp, int) for stamp in stamps) else (1, NS_PER_S)
    candidates = [np.array([stamp / per_s for stamp in stamps]) for per_s in units]
    counts = [_frames_met(stamps_s, frames_s) for stamps_s in candidates]
    if max(counts) == 0:
        raise elsewhere(path, candidates[0], frames_s)
    return candidates[counts.index(max(counts))]


def _frames_met(stamps_s: NDArray[np.float64], frames_s: NDArray[np.float64]) -> int:
    """Return how many frames have a stamp that is nearer to them than PAIRING_S and than to any other frame."""
    if not len(frames_s):
        return 0
    after = np.clip(np.searchsorted(frames_s, stamps_s), 1, max(len(frames_s) - 1, 1))
    places = np.stack([after - 1, np.minimum(after, len(frames_s) - 1)])
    apart_s = np.abs(frames_s[places] - stamps_s)
    nearest = np.where(apart_s[0] <= apart_s[1], places[0], places[1])
    return len(np.unique(nearest[apart_s.min(axis=0) < PAIRING_S]))
