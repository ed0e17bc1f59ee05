# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats of estimates: what one is, and the poses of a file as they stand there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.errors import InputError, NotFiniteError
from ...core.geometry import nearest_rotation, pose, rotation_error
from ...core.trajectory import Axes, Direction
from ...trajectories.pose_files import StampUnit

LARGEST_READ_BYTES = 64 * 10**6  # of an estimate, where no definition says another limit

# As for trajectory files: rounding is mended, which is 1e-6 in float32; anything more is a mistake and refused.
_ROTATION_TOLERANCE = 5e-3
_ROTATION_EXACT = 1e-12
_LAST_ROW_TOLERANCE = 1e-5


class OverLimitError(InputError):
    """What a system left is more than its limits allow to be read."""


@dataclass(frozen=True, eq=False)
class ReadPoses:
    """The poses of a file: (M, 4, 4) float64, rigid, camera-to-world with OpenCV's axes, M >= 0.

    One of three says which frame each belongs to. stamps_s: (M,) seconds, in any order. numbers: (M,) int64, of frames,
    0 the first. names: the file of each frame's image. places: where each stands in the file, in words, for messages.
    count: how many frames the file speaks of, where it has something for each frame in their order, lost ones too; None
    where it leaves lost ones out. notes: what a user should know, one sentence each.
    """

    format: str
    c2w: NDArray[np.float64]
    stamps_s: NDArray[np.float64] | None = None
    numbers: NDArray[np.int64] | None = None
    names: tuple[str, ...] | None = None
    places: tuple[str, ...] = ()
    count: int | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.c2w)


def no_pose(format_name: str, count: int | None = None) -> ReadPoses:
    """Return the estimate of a system that tracked no frame. count: of the frames that its file says are lost."""
    empty = np.zeros(0, dtype=np.int64)
    return ReadPoses(format_name, np.zeros((0, 4, 4)), numbers=empty, count=count)


def rigid(path: Path, places: Sequence[str], poses: ArrayLike) -> NDArray[np.float64]:
    """(M, 4, 4) or (M, 3, 4) -> (M, 4, 4) with rotations that are orthonormal.

    places: where each is, in words. Raises NotFiniteError and InputError for the first that is no pose.
    """
    matrices = whole_matrices(path, poses)
    check_finite(path, places, matrices)
    rotation = matrices[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        error = rotation_error(rotation)
        mirrored = np.linalg.det(rotation) < 0.0
    last = np.abs(matrices[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) > _LAST_ROW_TOLERANCE
    wrong = np.flatnonzero(last | ~(error <= _ROTATION_TOLERANCE) | mirrored)
    if wrong.size:
        row = int(wrong[0])
        if last[row]:
            raise InputError(path, "the last row of its pose is not 0 0 0 1", where=places[row])
        problem = "its pose mirrors" if error[row] <= _ROTATION_TOLERANCE else f"R^T R is off by {error[row]:.3g}"
        raise InputError(path, f"its pose is not rigid: {problem}", where=places[row])
    rounded = error > _ROTATION_EXACT
    rotation = rotation.copy()
    rotation[rounded] = nearest_rotation(rotation[rounded])
    return pose(rotation, matrices[:, :3, 3])


def whole_matrices(path: Path, poses: ArrayLike) -> NDArray[np.float64]:
    """(M, 4, 4) or (M, 3, 4) -> (M, 4, 4) float64. Raises InputError for another shape."""
    with np.errstate(invalid="ignore"):  # of NaN in float32
        found = np.asarray(poses, dtype=np.float64)
    if found.ndim != 3 or found.shape[1:] not in ((4, 4), (3, 4)):
        shape = " x ".join(map(str, found.shape)) or "no axes"
        raise InputError(path, f"its poses are an array of {shape}, but have to be N x 4 x 4")
    if found.shape[1] == 4:
        return found
    return np.concatenate([found, np.broadcast_to([[[0.0, 0.0, 0.0, 1.0]]], (len(found), 1, 4))], axis=1)


def check_finite(path: Path, places: Sequence[str], values: NDArray[np.float64]) -> None:
    """Raise NotFiniteError, which names the place, for the first of M items (M, ...) that holds NaN or infinity."""
    finite = np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
    if not finite.all():
        raise NotFiniteError(path, "its pose is not finite", where=places[int(np.argmin(finite))])


def unit_quats(path: Path, places: Sequence[str], quats: NDArray[np.float64]) -> NDArray[np.float64]:
    """(M, 4) of any length -> (M, 4) of length 1. Raises InputError for one that has no length, or too large a one."""
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(quats, axis=1)
    if not (usable := (lengths > 0.0) & np.isfinite(lengths)).all():
        problem = "its rotation is a quaternion of zeros, or of numbers beyond 1e154"
        raise InputError(path, problem, where=places[int(np.argmin(usable))])
    return quats / lengths[:, None]


# What a format of estimates is: a name, a function that reads a file of it, and what may be said about its poses.


Auto: TypeAlias = Literal["auto"]
StampsOf: TypeAlias = Literal["time", "index", "none"]
"""How a pose says its frame: by its time, by the frame's number in place of the time, or by its order."""


@dataclass(frozen=True)
class Asked:
    """How a file is to be read, where its format leaves that open.

    direction, axes: of the poses; "auto" is camera-to-world with the format's own axes. stamps: how a pose says its
    frame. stamp_unit: of its time; "auto" is what the file says or looks like. largest_bytes: that are read of a file
    with more than poses in it.
    """

    direction: Direction | Auto = "auto"
    axes: Axes | Auto = "auto"
    stamps: StampsOf = "time"
    stamp_unit: StampUnit | Auto = "auto"
    largest_bytes: int = LARGEST_READ_BYTES


def _never(path: Path, head: bytes) -> bool:
    del path, head
    return False


@dataclass(frozen=True)
class EstimateFormat:
    """A format of estimates.

    meaning: what it is, for people. read: a file, and how -> its poses; raises InputError, and NotFiniteError, which is
    one, where a pose is not finite. recognises: a file and its first bytes -> whether it is of this format, where none
    is named. any_convention: whether it leaves direction and axes open. any_stamps: whether it leaves `stamps` and
    `stamp_unit` open. any_unit: whether the unit of its times is tried by those of the frames. reads_parts: whether a
    part of a file is read that may be large.
    """

    name: str
    meaning: str
    read: Callable[[Path, Asked], ReadPoses]
    recognises: Callable[[Path, bytes], bool] = _never
    any_convention: bool = False
    any_stamps: bool = False
    any_unit: bool = False
    reads_parts: bool = False
