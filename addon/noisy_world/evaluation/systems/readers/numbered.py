# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses that belong to frames by number, as `core.trajectories.files` reads them.

Replica's and KITTI's lines, blocks of four lines in a file or a folder, Open3D's .log, nerfstudio's transforms.json.
"""

from pathlib import Path

import numpy as np

from ....core.trajectories.files import read_trajectory
from ....core.trajectories.pose_text import TrajectoryFormat, read_text
from ....core.trajectories.trajectory import Axes, Direction
from ...estimate import Estimate
from ...whole_text import check_whole
from .frames import Index, check_every_frame, estimate_of_frames
from .stamped import NO_POSE, is_empty

_OF_ALL_FRAMES = ("replica", "kitti", "transforms")
"""Formats that have no numbers: a file has a pose for each frame."""


def read(
    path: Path,
    index: Index,
    *,
    format: TrajectoryFormat,  # noqa: A002
    direction: Direction = "c2w",
    axes: Axes | None = None,
) -> Estimate:
    """Return the estimate of a file or a folder; axes: None for the format's own.

    Matrices and .log leave out the frames that are not finite, which is how they say that tracking was lost. Raises
    NotFiniteError for the other formats, and InputError.
    """
    if not path.is_dir():
        if format != "transforms" and is_empty(path):
            return NO_POSE
        check_whole(path, read_text(path))
    found = read_trajectory(path, format=format, direction=direction, axes=axes or "auto", rate_hz=1.0)
    if format in _OF_ALL_FRAMES:
        check_every_frame(path, len(found), index)
    numbers = np.rint(found.stamps_s).astype(np.int64).tolist()
    return estimate_of_frames(path, numbers, found.c2w, index)
