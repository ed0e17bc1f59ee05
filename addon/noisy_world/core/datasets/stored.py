# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings: sequences on disk, their files and their frames, which are read when they are needed."""

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry import Intrinsics
from ..optics import PINHOLE, Optics
from ..trajectories.stamps import FrameStamps
from ..trajectories.trajectory import Trajectory
from .image_files import damage
from .json_text import finite_number

RATE_HZ = 20.0  # of sequences that say no time at all, unless a preset says another
INTRINSICS_TOLERANCE_PX = 1e-3  # chosen: people round to about as many digits when they copy intrinsics

type SizePx = tuple[int, int]
"""Width and height in pixels."""


@dataclass(frozen=True)
class StoredFrame:
    """A frame on disk, whose images are read on request.

    size_px: width and height that its images have to have. colour: what its colour image holds, "rgb" or 8-bit "grey";
    None if it holds something else. depth_size_px: of depth, where it is another. void_steps: what depth images hold
    where there is no depth, besides 0.
    """

    rgb_file: Path
    depth_file: Path
    depth_scale_per_m: float
    size_px: SizePx
    colour: str | None = "rgb"
    depth_size_px: SizePx | None = None
    void_steps: tuple[int, ...] = ()

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), RGB, sRGB-encoded; grey in three equal channels.

        Raises InputError where the file is no image, or one of another size.
        """
        import cv2

        image = _read_image(self.rgb_file, cv2.IMREAD_COLOR)
        _check_size(self.rgb_file, image, self.size_px)
        return np.ascontiguousarray(image[..., ::-1])

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void. Raises InputError where the file is no 16-bit image of the size."""
        steps = _read_steps(self.depth_file)
        _check_size(self.depth_file, steps, self.depth_size_px or self.size_px)
        if self.void_steps:
            steps[np.isin(steps, self.void_steps)] = 0
        return (steps / np.float64(self.depth_scale_per_m)).astype(np.float32)


@dataclass(frozen=True)
class StoredSequence:
    """A recording: its pairs of images, its ground truth, its stamps, its depth scale and its camera.

    trajectory: the colour camera's poses, one for each pair of images, at the stamps of the colour. stamps: of colour,
    depth and poses, as the recording has them. depth_scale_per_m: steps per metre. stamps_path: the file that says the
    stamps; None where there is none, and counted_hz is the rate that they follow from. camera: its intrinsics, and
    camera_path the file that says them; None where none does. notes: sentences that the user should see. void_steps:
    what depth images hold where there is no depth, besides 0. optics: what its cameras have beyond one pinhole.
    assumed: says that the camera is the dataset's documented one, which another may replace; "" where a file says it.
    """

    folder: Path
    rgb_files: tuple[Path, ...]
    depth_files: tuple[Path, ...]
    trajectory_path: Path | None
    trajectory: Trajectory
    stamps: FrameStamps
    depth_scale_per_m: float
    stamps_path: Path | None = None
    camera: Intrinsics | None = None
    camera_path: Path | None = None
    notes: tuple[str, ...] = ()
    counted_hz: float | None = None
    void_steps: tuple[int, ...] = ()
    optics: Optics = PINHOLE
    assumed: str = ""

    @cached_property
    def _first_image(self) -> tuple[SizePx, str | None]:
        """Width and height of the first colour image in pixels, and what it holds."""
        import cv2

        pixels = _read_image(self.rgb_files[0], cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
        colour = "rgb" if pixels.ndim == 3 else "grey" if pixels.dtype == np.uint8 else None
        return _size_px(pixels), colour

    @property
    def size_px(self) -> SizePx:
        """Width and height of its first image in pixels."""
        return self._first_image[0]

    @property
    def files(self) -> tuple[Path, ...]:
        """Every image."""
        return self.rgb_files + self.depth_files

    @property
    def rate_hz(self) -> float | None:
        """Frames per second by the median of the gaps; None for a single frame."""
        gaps_s = np.diff(self.stamps.rgb.seconds)
        return 1 / float(np.median(gaps_s)) if gaps_s.size else None

    @cached_property
    def known_camera(self) -> Intrinsics | None:
        """Its intrinsics, or None where no file says them. Raises InputError where its images have another size."""
        if self.camera is None or (self.camera_path is None and not self.assumed):
            return None
        told = (self.camera.width_px, self.camera.height_px)
        if told != self.size_px:
            if self.camera_path is None:
                return None  # images of another size than the dataset's: its documented camera is none of theirs
            problem = f"says {told[0]} x {told[1]}, but {self.rgb_files[0].name} has {_spoken(self.size_px)} pixels"
            raise InputError(self.camera_path, problem, remedy="mend it, or take the images that belong to it")
        return self.camera

    def check_depth(self) -> None:
        """Raise InputError where the first depth image is no 16-bit image of the size of the colour."""
        _check_size(self.depth_files[0], _read_steps(self.depth_files[0]), self.depth_size_px)

    @property
    def depth_size_px(self) -> SizePx:
        """Width and height that its depth images have to have, in pixels."""
        seen = None if self.optics.depth is None else self.optics.depth.intrinsics
        return self.size_px if seen is None else (seen.width_px, seen.height_px)

    def frame(self, index: int) -> StoredFrame:
        """Return a frame."""
        size_px, colour = self._first_image
        rgb, depth, scale_per_m = self.rgb_files[index], self.depth_files[index], self.depth_scale_per_m
        return StoredFrame(rgb, depth, scale_per_m, size_px, colour, self.depth_size_px, self.void_steps)


def size_of(path: Path) -> SizePx:
    """Return the width and height of an image in pixels. Raises InputError where it is none."""
    import cv2

    return _size_px(_read_image(path, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH))


def same_camera(one: Intrinsics, other: Intrinsics) -> bool:
    """Tell whether intrinsics agree, up to INTRINSICS_TOLERANCE_PX."""
    values = [np.array([item.fx_px, item.fy_px, item.cx_px, item.cy_px]) for item in (one, other)]
    same_size = (one.width_px, one.height_px) == (other.width_px, other.height_px)
    return same_size and bool(np.abs(values[0] - values[1]).max() <= INTRINSICS_TOLERANCE_PX)


def checked_intrinsics(path: Path, places: tuple[str, ...], values: tuple[object, ...]) -> Intrinsics:
    """Return intrinsics from what a file says: width, height, fx, fy, cx and cy in pixels.

    places: where each value stands. Raises InputError, which names the place, for what is no number, a size that is not
    whole or not positive, and a focal length that is not positive.
    """
    numbers = [finite_number(value) for value in values]
    for index, (where, number) in enumerate(zip(places, numbers, strict=True)):
        if number is None:
            raise InputError(path, "is no finite number", where=where)
        if index < 4 and number <= 0:
            raise InputError(path, f"is {number:g}, but has to be above 0", where=where)
        if index < 2 and not number.is_integer():
            raise InputError(path, f"is {number:g}, but a size is whole pixels", where=where)
    wide, high, fx_px, fy_px, cx_px, cy_px = (float(number) for number in numbers if number is not None)
    return Intrinsics(int(wide), int(high), fx_px, fy_px, cx_px, cy_px)


def check_files(listing: Path, files: tuple[Path, ...]) -> None:
    """Raise InputError where a file that a list names is not there."""
    # Not Path.is_file, which raises OSError for a name that no file can have.
    lost = next((file for file in files if not os.path.isfile(file)), None)  # noqa: PTH113
    if lost is not None:
        raise InputError(listing, f"names {_short(lost.name)}, which is not there", remedy=f"looked in {lost.parent}")


def read_text(path: Path) -> str:
    """Return the text of a file. Raises InputError where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"cannot be read: {error}") from error


def _short(name: str) -> str:
    return name if len(name) <= 80 else f"{name[:77]}..."


def _read_steps(path: Path) -> NDArray[np.uint16]:
    import cv2

    steps = _read_image(path, cv2.IMREAD_UNCHANGED)
    if steps.ndim != 2 or steps.dtype != np.uint16:
        raise InputError(path, f"is {steps.dtype} {steps.shape}, but depth has to be 16-bit grey")
    return steps


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


def _check_size(path: Path, pixels: NDArray[Any], wanted: SizePx) -> None:
    if _size_px(pixels) != wanted:
        problem = f"is {_spoken(_size_px(pixels))} pixels, but the first colour image is {_spoken(wanted)}"
        raise InputError(path, problem, remedy="a sequence has one size; register depth to colour")


def _size_px(pixels: NDArray[Any]) -> SizePx:
    return pixels.shape[1], pixels.shape[0]


def _spoken(size_px: SizePx) -> str:
    return f"{size_px[0]} x {size_px[1]}"
