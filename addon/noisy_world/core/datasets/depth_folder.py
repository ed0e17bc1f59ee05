# SPDX-License-Identifier: GPL-3.0-or-later
"""A folder of depth images for the frames of a video: one each, in the order of their numbers."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .image_files import WholeFile, check_whole, read_header
from .image_reading import check_depth, read_steps, spoken

SizePx: TypeAlias = tuple[int, int]
"""Width and height in pixels."""


@dataclass(frozen=True)
class DepthFolder:
    """Depth images, the i-th of which belongs to frame i. scale_per_m: steps per metre. size_px: of each."""

    folder: Path
    files: tuple[Path, ...]
    scale_per_m: float
    size_px: SizePx

    def depth_m(self, index: int) -> NDArray[np.float32]:
        """Return planar depth (H, W) in metres, 0 = void. Raises InputError where the file is damaged."""
        return (read_steps(self.files[index], self.size_px) / np.float64(self.scale_per_m)).astype(np.float32)

    def whole_file(self, index: int) -> WholeFile:
        """Return the file of a depth image that is used as it is. Raises InputError where it is damaged."""
        header, digest = check_whole(self.files[index])
        _check_size_px(self.files[index], header.size_px, self.size_px)
        return WholeFile(self.files[index], digest)


def read_depth_folder(folder: Path, scale_per_m: float, video: Path, count: int, size_px: SizePx) -> DepthFolder:
    """Find the depth images of a video's frames, PNG files with a number in their names; their headers are checked.

    video, count, size_px: the video, its frames and their size. Raises InputError where the images are not as many, of
    another size, no 16-bit grey, or not in one order.
    """
    found: dict[int, Path] = {}
    for path in _png_files(folder):
        number = _number(path)
        if (same := found.setdefault(number, path)) != path:
            raise InputError(folder, f"{same.name} and {path.name} have one number", remedy="keep one of them")
    if len(found) != count:
        problem = f"holds {len(found)} depth images, but {video.name} has {count} frames"
        raise InputError(folder, problem, remedy="a 16-bit PNG for each frame, in the order of their numbers")
    files = tuple(found[number] for number in sorted(found))
    for path in files:
        header = read_header(path)
        check_depth(path, header)
        _check_size_px(path, header.size_px, size_px)
    return DepthFolder(folder, files, scale_per_m, size_px)


def _png_files(folder: Path) -> Iterator[Path]:
    try:
        yield from sorted(path for path in folder.iterdir() if path.suffix.lower() == ".png")
    except OSError as error:
        raise InputError(folder, f"cannot be read: {error.strerror or error}") from None


def _number(path: Path) -> int:
    """Return the last number in a file's name, before its suffix."""
    found = re.search(r"([0-9]{1,30})[^0-9]*$", path.stem, re.ASCII)
    if found is None:
        raise InputError(path, "has no number in its name", remedy="name depth images by their frames: 000000.png")
    return int(found[1])


def _check_size_px(path: Path, size_px: SizePx, wanted: SizePx) -> None:
    if size_px != wanted:
        problem = f"is {spoken(size_px)} pixels, but the video's frames are {spoken(wanted)}"
        raise InputError(path, problem, remedy="register depth to colour")
