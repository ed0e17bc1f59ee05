# SPDX-License-Identifier: GPL-3.0-or-later
"""The JSON index of the frames that a system is given, as it is written and as rgbd_odometry reads it."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import InputError
from ..core.file_access import read_text
from ..core.geometry import Intrinsics
from ..core.schema import ConfigPath, key, parse


@dataclass(frozen=True)
class InverseDepth:
    """The inverse of a sequence's planar depth Z."""

    median_per_m: float = key("the median of 1 / Z", unit="1/m", above=0.0)
    noise_per_m: float = key("the standard deviation of the noise of 1 / Z", unit="1/m", minimum=0.0)


@dataclass(frozen=True)
class CameraEntry:
    """The camera of all frames."""

    width: int = key("image width", unit="px", minimum=1, maximum=65500)
    height: int = key("image height", unit="px", minimum=1, maximum=65500)
    fx: float = key("focal length", unit="px", above=0.0)
    fy: float = key("focal length", unit="px", above=0.0)
    cx: float = key("principal point", unit="px")
    cy: float = key("principal point", unit="px")

    @classmethod
    def of(cls, camera: Intrinsics) -> "CameraEntry":
        """Return the entry of a camera."""
        return cls(camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)


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
