# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of a recording whose pose is not known: left out, kept, or refused."""

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..trajectories.trajectory import Trajectory

PosePolicy = Literal["drop", "keep", "require", "none"]
"""What becomes of frames without a pose: left out, kept without one, refused; none: no pose is looked for at all."""

_POSES = "poses: drop leaves them out, poses: keep keeps them"


def chosen_by_pose(path: Path, known: NDArray[np.bool_], policy: PosePolicy) -> tuple[NDArray[np.intp], str]:
    """Return the rows of the frames that are used, and a note on the others; "" where there is nothing to say.

    path: the file or folder of the poses, for messages. known: (N,) whether a frame has a pose. Raises InputError where
    a frame without one is not allowed, or none would be left.
    """
    rows, lacking = np.flatnonzero(known), int(np.count_nonzero(~known))
    everything = np.arange(len(known))
    if not lacking or policy == "none":
        return everything, ""
    message = f"{lacking} of {len(known)} frames have no valid pose"
    if policy == "require":
        raise InputError(path, f"{message}, the first is frame {int(np.argmin(known))}", remedy=_POSES)
    if policy == "keep":
        return everything, f"{message}; they are kept, and no pose is written for them"
    if not rows.size:
        raise InputError(path, message, remedy="poses: none uses the images without ground truth")
    return rows, f"{message} and are left out"


def truth_file(path: Path, policy: PosePolicy) -> Path | None:
    """Return the file of the poses; None where none is to be read, or it is not there and frames are kept anyway."""
    return None if policy == "none" or (policy == "keep" and not path.exists()) else path


def unposed(count: int) -> Trajectory:
    """Return a path of so many frames, a second apart, none of whose poses is known."""
    return Trajectory(np.tile(np.eye(4), (count, 1, 1)), np.arange(float(count)), posed=np.zeros(count, dtype=np.bool_))
