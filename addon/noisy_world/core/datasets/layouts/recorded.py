# SPDX-License-Identifier: GPL-3.0-or-later
"""Base class of layouts that are only read: datasets and recorders of others."""

from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...geometry import Intrinsics
from ...messages import Message, PresetKey
from ...trajectories.pose_text import read_text, text_rows
from ..known_poses import PosePolicy
from ..stored import StoredSequence, checked_intrinsics, size_of

MILLIMETRES = 1000.0  # steps per metre of depth in millimetres
# Three lines of three numbers: 3DMatch and tsdf-fusion have the first (data/camera-intrinsics.txt), SceneNN the second.
MATRIX_FILES = ("camera-intrinsics.txt", "intrinsic.txt")
RECORDED_HZ = 30.0  # the rate of Kinect, PrimeSense, Structure and RealSense, where a recording says no time


class RecordedLayout(ABC):
    """How recordings of others lie on disk.

    name: for messages and lists. label, meaning: for people. files: how it is told, in words. shortly: its files in a
    word or two.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    meaning: ClassVar[str]
    files: ClassVar[str]

    @abstractmethod
    def recognises(self, folder: Path) -> bool:
        """Tell whether a folder looks like a recording of this layout."""

    @abstractmethod
    def read(self, folder: Path, rate_hz: float | None = None, poses: PosePolicy = "drop") -> StoredSequence:
        """Find the files of a recording. rate_hz: of its frames, where no file says their times; None for its usual.

        poses: what becomes of frames without a pose. Raises InputError where files are missing, wrong or do not match.
        """


def counted_note(rate_hz: float | None, used_hz: float) -> tuple[str, ...]:
    """Return a note that the frames' times are counted, unless the user has said the rate."""
    message = Message(f"no file says time stamps: {used_hz:g} frames a second, or ", PresetKey("rate_hz"))
    return () if rate_hz else (message,)


def stated_camera(folder: Path, image: Path) -> tuple[Intrinsics, Path] | None:
    """Return the camera that a file of a matrix says, in a recording's folder or above it, and that file; or None.

    image: one of the colour images. Raises InputError where the file is no matrix of intrinsics.
    """
    places = [parent / name for parent in (folder, folder.parent) for name in MATRIX_FILES]
    path = next((path for path in places if path.is_file()), None)
    if path is None:
        return None
    rows = text_rows(path, read_text(path))
    if rows.widths.tolist() != [3, 3, 3]:
        raise InputError(path, "is no matrix of three lines of three numbers", remedy="mend it, or take it away")
    return intrinsics_of_matrix(path, rows.numbers.reshape(3, 3), size_of(image)), path


def intrinsics_of_matrix(path: Path, matrix: NDArray[np.float64], size_px: tuple[int, int]) -> Intrinsics:
    """Return a camera of a matrix (3, 3) or larger: fx 0 cx / 0 fy cy / 0 0 1. Raises InputError for another kind."""
    rest = matrix.copy()
    for row, column in ((0, 0), (1, 1), (0, 2), (1, 2)):
        rest[row, column] = float(row == column)
    if not np.array_equal(rest, np.eye(len(matrix))):
        remedy = "a pinhole's matrix is fx 0 cx, 0 fy cy, 0 0 1, without skew"
        raise InputError(path, "is no matrix of intrinsics", remedy=remedy)
    values = (size_px[0], size_px[1], matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    return checked_intrinsics(path, ("width", "height", "fx", "fy", "cx", "cy"), tuple(map(float, values)))
