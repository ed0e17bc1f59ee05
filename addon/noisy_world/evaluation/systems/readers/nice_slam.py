# SPDX-License-Identifier: GPL-3.0-or-later
"""The checkpoints of NICE-SLAM and of its iMAP, `ckpts/00000.tar`.

As src/utils/Logger.py and src/tools/eval_ate.py of https://github.com/cvg/nice-slam have them: `estimate_c2w_list` has
a matrix for each frame, zeros where the tracker has not come to, and `idx` is the last frame of the estimate. The
camera's axes are OpenGL's: src/utils/datasets.py turns the second and the third round.
"""

from pathlib import Path

from ....core.errors import InputError
from ...estimate import Estimate
from ..leavings import LARGEST_READ_BYTES
from .frames import Index, estimate_of_frames
from .torch_files import Tensor, open_torch


def read(path: Path, index: Index, *, largest_bytes: int = LARGEST_READ_BYTES) -> Estimate:
    """Return the estimate of a checkpoint; of the last one, where the path is a folder of them. Raises InputError."""
    file = last_checkpoint(path)
    with open_torch(file, largest_bytes) as held:
        if not isinstance(held, dict):
            raise InputError(file, "holds no poses: estimate_c2w_list")
        poses, last = held.get("estimate_c2w_list"), held.get("idx")
        if not isinstance(poses, Tensor):
            raise InputError(file, "holds no poses: estimate_c2w_list")
        matrices = poses.array()
        number = last.array().item() if isinstance(last, Tensor) and last.shape in ((), (1,)) else last
    if type(number) is not int or not 0 <= number < len(matrices):
        raise InputError(file, f"says no frame of its {len(matrices)} as the last: idx")
    return estimate_of_frames(file, range(number + 1), matrices[: number + 1], index, axes="opengl")


def last_checkpoint(path: Path) -> Path:
    """Return the checkpoint of the highest number in a folder, or the path itself where it is none."""
    if not path.is_dir():
        return path
    found = sorted(
        (int(file.stem), file) for file in path.glob("*.tar") if file.stem.isascii() and file.stem.isdecimal()
    )
    if not found:
        raise InputError(path, "holds no checkpoint: 00000.tar and so on")
    return found[-1][1]
