# SPDX-License-Identifier: GPL-3.0-or-later
"""What readers of estimates share: the frames that a system was given, and poses that belong to frames by number."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....core.errors import InputError, NotFiniteError
from ....core.geometry import nearest_rotation, pose, rotation_error
from ....core.trajectories.trajectory import Axes, Direction, convert_convention
from ...estimate import Estimate

Index: TypeAlias = Mapping[str, Any]
"""The frames that a system was given: `frames`, a list in their order, each with `stamp_s` and `colour`, its file."""

# As for trajectory files: rounding is mended, which is 1e-6 in float32; anything more is a mistake and refused.
_ROTATION_TOLERANCE = 5e-3
_ROTATION_EXACT = 1e-12
_LAST_ROW_TOLERANCE = 1e-5


def stamps_of(index: Index) -> NDArray[np.float64]:
    """Return the time stamps of the frames (N,), seconds."""
    return np.array([frame["stamp_s"] for frame in index["frames"]], dtype=np.float64)


def estimate_of_frames(
    path: Path,
    numbers: Sequence[int],
    poses: ArrayLike,
    index: Index,
    *,
    direction: Direction = "c2w",
    axes: Axes = "opencv",
) -> Estimate:
    """Return the estimate whose M poses (M, 4, 4) or (M, 3, 4) belong to frames by their numbers, 0 the first.

    A matrix of zeros alone is a frame that the system has not come to: it is left out. Raises NotFiniteError where
    others are not finite, and InputError, which names file and frame, where they are not rigid, a frame does not exist
    or has two poses.
    """
    stamps_s = stamps_of(index)
    with np.errstate(invalid="ignore"):  # of NaN in float32
        matrices = _whole(path, np.asarray(poses, dtype=np.float64))
    if len(numbers) != len(matrices):
        raise InputError(path, f"has {len(matrices)} poses for {len(numbers)} numbers of frames")
    _check_numbers(path, numbers, len(stamps_s))
    reached = matrices[:, :3, :].any(axis=(1, 2))
    order = sorted(np.flatnonzero(reached).tolist(), key=numbers.__getitem__)
    frames = [numbers[row] for row in order]
    rigid = _rigid(path, frames, matrices[order])
    c2w = convert_convention(rigid, direction=direction, axes=axes)
    return Estimate(stamps_s[frames], c2w)


def check_every_frame(path: Path, count: int, index: Index) -> None:
    """Raise InputError unless a file of poses without numbers has one for each frame."""
    frames = len(index["frames"])
    if count != frames:
        remedy = "poses without numbers or stamps are those of all frames, in their order"
        raise InputError(path, f"has {count} poses for {frames} frames", remedy=remedy)


def _whole(path: Path, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(M, 4, 4) or (M, 3, 4) -> (M, 4, 4)."""
    if poses.ndim != 3 or poses.shape[1:] not in ((4, 4), (3, 4)):
        raise InputError(path, f"its poses are an array of {_spoken(poses.shape)}, but have to be N x 4 x 4")
    if poses.shape[1] == 4:
        return poses
    return np.concatenate([poses, np.broadcast_to([[[0.0, 0.0, 0.0, 1.0]]], (len(poses), 1, 4))], axis=1)


def _spoken(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) or "no axes"


def _check_numbers(path: Path, numbers: Sequence[int], count: int) -> None:
    seen: set[int] = set()
    for number in numbers:
        if not 0 <= number < count:
            raise InputError(path, f"has a pose for frame {number}, but there are {count}, from 0")
        if number in seen:
            raise InputError(path, "has two poses", where=f"frame {number}")
        seen.add(number)


def _rigid(path: Path, frames: Sequence[int], matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses (M, 4, 4) with rotations that are orthonormal. Raises InputError for the first that is no pose."""
    check_finite(path, [f"frame {frame}" for frame in frames], matrices)
    rotation = matrices[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        error = rotation_error(rotation)
        mirrored = np.linalg.det(rotation) < 0.0
    last = np.abs(matrices[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) > _LAST_ROW_TOLERANCE
    wrong = np.flatnonzero(last | ~(error <= _ROTATION_TOLERANCE) | mirrored)
    if wrong.size:
        row = int(wrong[0])
        where = f"frame {frames[row]}"
        if last[row]:
            raise InputError(path, "the last row of its pose is not 0 0 0 1", where=where)
        problem = "its pose mirrors" if error[row] <= _ROTATION_TOLERANCE else f"R^T R is off by {error[row]:.3g}"
        raise InputError(path, f"its pose is not rigid: {problem}", where=where)
    rounded = error > _ROTATION_EXACT
    rotation = rotation.copy()
    rotation[rounded] = nearest_rotation(rotation[rounded])
    return pose(rotation, matrices[:, :3, 3])


def check_finite(path: Path, places: Sequence[str], values: NDArray[np.float64]) -> None:
    """Raise NotFiniteError, which names the place, for the first of M items (M, ...) that holds NaN or infinity."""
    finite = np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
    if not finite.all():
        raise NotFiniteError(path, "its pose is not finite", where=places[int(np.argmin(finite))])
