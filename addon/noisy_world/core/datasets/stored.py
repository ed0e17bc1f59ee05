# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings: sequences on disk, their files and their frames, which are read when they are needed."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry import Intrinsics
from ..trajectories.trajectory import Trajectory
from .image_files import damage

PAIRING_S = 0.02  # the greatest difference of stamps that belong together; the default of TUM's associate.py

type StampedFile = tuple[float, Path]
"""A time stamp in seconds, and a file."""


@dataclass(frozen=True)
class StoredFrame:
    """A frame on disk, whose images are read on request.

    colour: what its colour image holds, "rgb" or 8-bit "grey"; None if it holds something else.
    """

    rgb_file: Path
    depth_file: Path
    depth_scale_per_m: float
    colour: str | None = "rgb"

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), RGB, sRGB-encoded; grey in three equal channels. Raises InputError if it is no image."""
        import cv2

        return np.ascontiguousarray(_read_image(self.rgb_file, cv2.IMREAD_COLOR)[..., ::-1])

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void. Raises InputError where the file is no 16-bit image."""
        import cv2

        steps = _read_image(self.depth_file, cv2.IMREAD_UNCHANGED)
        if steps.ndim != 2 or steps.dtype != np.uint16:
            raise InputError(self.depth_file, f"is {steps.dtype} {steps.shape}, but depth has to be 16-bit grey")
        return (steps / np.float64(self.depth_scale_per_m)).astype(np.float32)


@dataclass(frozen=True)
class StoredSequence:
    """A recording: its pairs of images, its ground truth and its depth scale.

    trajectory: the colour camera's poses, one for each pair of images. depth_scale_per_m: steps per metre.
    camera: its intrinsics, or None where the layout does not hold them.
    """

    folder: Path
    rgb_files: tuple[Path, ...]
    depth_files: tuple[Path, ...]
    trajectory_path: Path
    trajectory: Trajectory
    depth_scale_per_m: float
    camera: Intrinsics | None = None

    @cached_property
    def _first_image(self) -> tuple[tuple[int, int], str | None]:
        """Width and height of the first colour image in pixels, and what it holds."""
        import cv2

        pixels = _read_image(self.rgb_files[0], cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
        height, width = pixels.shape[:2]
        colour = "rgb" if pixels.ndim == 3 else "grey" if pixels.dtype == np.uint8 else None
        return (width, height), colour

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of its first image in pixels."""
        return self._first_image[0]

    @property
    def files(self) -> tuple[Path, ...]:
        """Every image."""
        return self.rgb_files + self.depth_files

    def frame(self, index: int) -> StoredFrame:
        """Return a frame."""
        colour = self._first_image[1]
        return StoredFrame(self.rgb_files[index], self.depth_files[index], self.depth_scale_per_m, colour)


def pair_by_stamp(
    folder: Path, rgb: Sequence[StampedFile], depth: Sequence[StampedFile], poses: Path, path: Trajectory
) -> tuple[tuple[Path, ...], tuple[Path, ...], Trajectory]:
    """Return the colour images that have a depth image and a pose within PAIRING_S, with these, in the same order.

    poses: the file of the path. The frames' stamps are those of the poses. Raises InputError where no image has both.
    """
    depth_stamps_s = np.array([stamp_s for stamp_s, _ in depth])
    pairs: list[tuple[Path, Path, int]] = []
    for stamp_s, file in rgb:
        near_depth, near_pose = _nearest(depth_stamps_s, stamp_s), _nearest(path.stamps_s, stamp_s)
        if near_depth is not None and near_pose is not None:
            pairs.append((file, depth[near_depth][1], near_pose))
    if not pairs:
        raise InputError(folder, f"no colour, depth and pose lie within {PAIRING_S} s of one another")
    rgb_files, depth_files, rows = zip(*pairs, strict=True)
    for file, row, before in zip(rgb_files[1:], rows[1:], rows, strict=False):
        if row <= before:
            problem = f"the pose nearest to {file.name} is not later than that of the image before"
            raise InputError(poses, problem, remedy="there has to be a pose for each image, and both sorted by time")
    return rgb_files, depth_files, Trajectory(path.c2w[list(rows)], path.stamps_s[list(rows)])


def _nearest(stamps_s: NDArray[np.float64], stamp_s: float) -> int | None:
    gaps = np.abs(stamps_s - stamp_s)
    return int(gaps.argmin()) if gaps.size and gaps.min() <= PAIRING_S else None


def read_text(path: Path) -> str:
    """Return the text of a file. Raises InputError where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"cannot be read: {error}") from error


def _read_image(path: Path, mode: int) -> NDArray[Any]:
    import cv2

    try:
        problem = damage(path.read_bytes())
    except OSError as error:
        raise InputError(path, "is not there or no image") from error
    if problem:
        raise InputError(path, f"is damaged: {problem}", remedy="copy it again")
    image = cv2.imread(str(path), mode)
    if image is None:
        raise InputError(path, "is not there or no image")
    return image
