# SPDX-License-Identifier: GPL-3.0-or-later
"""The frames that a system is given: a JSON index of files, read strictly, and the images that it names."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.datasets.images import GREY_WEIGHTS_PER_MILLE
from ...core.errors import InputError
from ...core.geometry import Intrinsics
from ...core.regular_files import read_bytes, read_text
from ...core.schema import ConfigPath, key, parse
from ..systems.depth_noise import InverseDepth

Grey: TypeAlias = NDArray[np.uint8]
Depth: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True)
class CameraEntry:
    """The camera of all frames."""

    width: int = key("image width", unit="px", minimum=1, maximum=65500)
    height: int = key("image height", unit="px", minimum=1, maximum=65500)
    fx: float = key("focal length", unit="px", above=0.0)
    fy: float = key("focal length", unit="px", above=0.0)
    cx: float = key("principal point", unit="px")
    cy: float = key("principal point", unit="px")


@dataclass(frozen=True)
class FrameEntry:
    """A frame of the sequence: when it was taken, and the files of its images."""

    index: int = key("the frame's number", minimum=0)
    stamp_s: float = key("when its colour was taken", unit="s")
    colour: str | None = key("its colour image")
    depth: str | None = key("its depth image", default=None)
    depth_stamp_s: float | None = key("when its depth was taken", unit="s", default=None)


@dataclass(frozen=True)
class FrameIndex:
    """What the JSON index says: the camera, the steps of a depth image a metre, and the frames in order of time."""

    camera: CameraEntry = key("the camera")
    depth_scale_per_m: float = key("steps of the depth images a metre", unit="steps/m", above=0.0)
    frames: tuple[FrameEntry, ...] = key("the frames, in order of time")
    inverse_depth: InverseDepth | None = key("what the depth is like, which this system does not go by", default=None)

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera as the rest of the code knows it."""
        camera = self.camera
        return Intrinsics(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)


def read_index(path: Path) -> FrameIndex:
    """Read the JSON index. Raises InputError, with file and key, for what it cannot be; at least a frame is needed."""
    try:
        value = json.loads(read_text(path))
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InputError(path, f"is no JSON: {error}") from error
    index = parse(FrameIndex, value, ConfigPath(path))
    at = ConfigPath(path).at("frames")
    if not index.frames:
        raise at.error("names no frame")
    last_s = -math.inf
    for row, frame in enumerate(index.frames):
        if not frame.stamp_s > last_s:
            raise at.at(row).at("stamp_s").error(f"is {frame.stamp_s}, no later than the frame before")
        last_s = frame.stamp_s
    return index


def read_colour(entry: FrameEntry, camera: Intrinsics) -> NDArray[np.uint8]:
    """Read a frame's colour (H, W, 3), BGR as OpenCV has it; grey is in three equal channels.

    Raises InputError for an image that cannot be read, or where there is none.
    """
    import cv2

    if entry.colour is None:
        raise InputError(f"frame {entry.index}", "has no colour image", remedy="align by depth alone: --by depth")

    image = _read(Path(entry.colour), cv2.IMREAD_COLOR)
    _check_size(entry.colour, image, camera)
    return image.astype(np.uint8, copy=False)


def grey_of(bgr: NDArray[np.uint8]) -> Grey:
    """Return (H, W) grey of (H, W, 3) BGR, by the weights of BT.601."""
    import cv2

    assert GREY_WEIGHTS_PER_MILLE == (299, 587, 114)  # OpenCV's own
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY), np.uint8)


def read_depth(entry: FrameEntry, camera: Intrinsics, scale_per_m: float) -> Depth:
    """Read a frame's planar depth (H, W) in metres; NaN where it is void, which is everywhere without a depth image."""
    import cv2

    if entry.depth is None:
        return np.full((camera.height_px, camera.width_px), np.nan, np.float32)
    steps = _read(Path(entry.depth), cv2.IMREAD_UNCHANGED)
    if steps.ndim != 2:
        raise InputError(entry.depth, "is an image of several channels", remedy="a depth image has one")
    _check_size(entry.depth, steps, camera)
    depth_m = steps.astype(np.float32) / np.float32(scale_per_m)
    depth_m[~((depth_m > 0) & np.isfinite(depth_m))] = np.nan
    return depth_m


def _read(path: Path, flag: int) -> NDArray:
    """Decode an image. From memory, as OpenCV opens no file whose name Windows cannot spell in its code page."""
    import cv2

    try:
        data = read_bytes(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror}") from error
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flag) if data else None
    if image is None:
        raise InputError(path, "is no image that can be decoded")
    return image


def _check_size(path: str, image: NDArray, camera: Intrinsics) -> None:
    height, width = image.shape[:2]
    if (width, height) != (camera.width_px, camera.height_px):
        raise InputError(
            path,
            f"has {width} x {height} pixels, but the camera {camera.width_px} x {camera.height_px}",
            remedy="give the intrinsics of these images",
        )
