# SPDX-License-Identifier: GPL-3.0-or-later
"""The checkpoint of Co-SLAM, `checkpointN.pt`.

As save_ckpt and convert_relative_pose in coslam.py of https://github.com/HengyiWang/Co-SLAM have it: `pose` maps a
frame's number to a matrix; `pose_rel` maps the first frame, and those that are no keyframes, to their pose relative to
the keyframe before them, which was optimised further after the frame was tracked. The camera's axes are OpenGL's.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....core.errors import InputError
from ...estimate import Estimate
from ..leavings import LARGEST_READ_BYTES
from .frames import Index, estimate_of_frames
from .torch_files import Tensor, open_torch


def read(path: Path, index: Index, *, largest_bytes: int = LARGEST_READ_BYTES) -> Estimate:
    """Return the poses as they were when their frames were tracked, keyframes as they are in the end."""
    file = _checkpoint(path)
    with open_torch(file, largest_bytes) as held:
        poses = _poses(file, held, "pose")
    return estimate_of_frames(file, list(poses), _stacked(poses), index, axes="opengl")


def read_relative(path: Path, index: Index, *, largest_bytes: int = LARGEST_READ_BYTES) -> Estimate:
    """Return the poses that follow from those of the keyframes in the end."""
    file = _checkpoint(path)
    with open_torch(file, largest_bytes) as held:
        poses, relative = _poses(file, held, "pose"), _poses(file, held, "pose_rel")
    keyframe = None
    for number in sorted(poses):
        if number == min(poses) or number not in relative:
            keyframe = poses[number]
        else:
            assert keyframe is not None, "the first frame is one"
            poses[number] = relative[number] @ keyframe
    return estimate_of_frames(file, list(poses), _stacked(poses), index, axes="opengl")


def _checkpoint(path: Path) -> Path:
    """Return the checkpoint of the highest number in a folder, or the path itself where it is none."""
    if not path.is_dir():
        return path
    numbers = ((file.stem.removeprefix("checkpoint"), file) for file in path.glob("checkpoint*.pt"))
    found = sorted((int(number), file) for number, file in numbers if number.isascii() and number.isdecimal())
    if not found:
        raise InputError(path, "holds no checkpoint: checkpoint0.pt and so on")
    return found[-1][1]


def _poses(file: Path, held: Any, name: str) -> dict[int, NDArray[np.float64]]:
    found = held.get(name) if isinstance(held, dict) else None
    if not isinstance(found, dict) or not all(type(number) is int for number in found):
        raise InputError(file, f"holds no poses by number: {name}")
    poses: dict[int, NDArray[np.float64]] = {}
    for number, value in sorted(found.items()):
        if not isinstance(value, Tensor) or value.shape != (4, 4):
            raise InputError(file, "is no pose of 4 x 4", where=f"{name}, frame {number}")
        with np.errstate(invalid="ignore"):  # of NaN in float32
            poses[number] = value.array().astype(np.float64)
    return poses


def _stacked(poses: dict[int, NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.array(list(poses.values())).reshape(-1, 4, 4)
