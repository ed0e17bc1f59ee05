# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses as arrays of numpy: N matrices of 4 x 4 (or 3 x 4), with or without stamps or numbers of frames.

GO-SLAM's `checkpoints/est_poses.npy` is one: camera-to-world, OpenCV's axes, a pose for every frame (terminate in
src/slam.py of https://github.com/youmi-zym/GO-SLAM).
"""

import zipfile
from collections.abc import Container
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....core.errors import InputError
from ....core.regular_files import open_regular
from ....core.trajectories.trajectory import Axes, Direction
from ...estimate import Estimate
from .frames import Index, check_every_frame, estimate_of_frames

POSES = ("poses", "c2w", "w2c", "pose")
STAMPS = ("stamps_s", "timestamps", "stamps", "times", "tstamps")
NUMBERS = ("frames", "indices", "numbers")


def read(path: Path, index: Index, *, direction: Direction = "c2w", axes: Axes = "opencv") -> Estimate:
    """Return the estimate of a .npy with the poses of all frames, or of a .npz with stamps or numbers beside them.

    Raises InputError.
    """
    arrays = load_arrays(path)
    name = _poses_name(path, arrays)
    poses = _numbers(path, name, arrays[name])
    stamped = [item for item in STAMPS if item in arrays]
    numbered = [item for item in NUMBERS if item in arrays]
    if stamped and not numbered:
        return _stamped(path, poses, _row(path, stamped[0], arrays[stamped[0]], len(poses)), direction, axes)
    if numbered:
        numbers = _row(path, numbered[0], arrays[numbered[0]], len(poses))
        if (numbers != np.floor(numbers)).any():
            raise InputError(path, "are no whole numbers", where=numbered[0])
        frames = numbers.astype(np.int64).tolist()
        return estimate_of_frames(path, frames, poses, index, direction=direction, axes=axes)
    check_every_frame(path, len(poses), index)
    return estimate_of_frames(path, range(len(poses)), poses, index, direction=direction, axes=axes)


def load_arrays(path: Path, wanted: Container[str] | None = None) -> dict[str, NDArray]:
    """Return the arrays of a .npz by name, or that of a .npy as "poses"; pickled objects are refused with InputError.

    wanted: the names of those to be read, where the others may be large.
    """
    try:
        with open_regular(path) as file:
            held = np.load(file, allow_pickle=False)
            if isinstance(held, np.ndarray):
                return {"poses": held}
            with held:
                return {name: held[name] for name in held.files if wanted is None or name in wanted}
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error
    # What numpy and zipfile raise for bytes that are no array, an archive that is cut off or packed in an unknown way.
    except (ValueError, EOFError, zipfile.BadZipFile, KeyError, NotImplementedError) as error:
        raise InputError(path, "is no array of numbers as numpy writes it", remedy="a .npy or .npz file") from error


def _poses_name(path: Path, arrays: dict[str, NDArray]) -> str:
    named = [name for name in POSES if name in arrays]
    if named:
        return named[0]
    shaped = [name for name, array in arrays.items() if array.ndim == 3 and array.shape[1:] in ((4, 4), (3, 4))]
    if len(shaped) != 1:
        remedy = f"name the poses {', '.join(POSES[:-1])} or {POSES[-1]}"
        raise InputError(path, f"holds {len(shaped)} arrays of N x 4 x 4", remedy=remedy)
    return shaped[0]


def _numbers(path: Path, name: str, array: NDArray) -> NDArray[np.float64]:
    if array.dtype.kind not in "fiu":
        raise InputError(path, f"holds {array.dtype}, but has to be numbers", where=name)
    return array.astype(np.float64)


def _row(path: Path, name: str, array: NDArray, count: int) -> NDArray[np.float64]:
    row = _numbers(path, name, array).reshape(-1)
    if len(row) != count or not np.isfinite(row).all():
        raise InputError(path, f"has to be {count} finite numbers, one for each pose", where=name)
    return row


def _stamped(
    path: Path, poses: NDArray[np.float64], stamps_s: NDArray[np.float64], direction: Direction, axes: Axes
) -> Estimate:
    order = np.argsort(stamps_s, kind="stable")
    if (np.diff(stamps_s[order]) <= 0.0).any():
        raise InputError(path, "has two poses of one time stamp")
    own = {"frames": [{"stamp_s": stamp_s} for stamp_s in stamps_s[order].tolist()]}
    return estimate_of_frames(path, range(len(order)), poses[order], own, direction=direction, axes=axes)
