# SPDX-License-Identifier: GPL-3.0-or-later
"""A recording as it is measured: some of its frames, grey and depth at a moderate size, whatever source they have."""

from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.frame_request import SensorPaths
from ..core.geometry import Intrinsics
from ..core.lens import Optics, straightened
from ..core.srgb import decoded
from ..core.trajectory import FrameStamps, Trajectory
from ..images.measured_depth import Registration
from ..images.pixels import as_bytes
from ..render.source import OpenSource, RenderOptions, Source
from ..trajectories.rig import RecordedImu

Float64: TypeAlias = NDArray[np.float64]
Float32: TypeAlias = NDArray[np.float32]
Points: TypeAlias = NDArray[np.float32]
"""(N, 2) places on an image in pixels, x and y."""

WIDEST_PX = 800  # of an image in which features are followed; chosen
KEPT_BYTES = 1 << 28  # of decoded frames that are kept: two seconds of 640 x 480 are read once


@dataclass(frozen=True)
class Look:
    """One frame. grey: (H, W) uint8. depth_m: (H, W) planar depth as the colour camera sees it, 0 = void; or None.

    whole: (H, W) uint8 grey of the size that it was recorded in, and colour (H, W, 3) uint8, RGB.
    """

    grey: NDArray[np.uint8]
    depth_m: Float32 | None
    whole: NDArray[np.uint8]
    colour: NDArray[np.uint8]

    @property
    def held_bytes(self) -> int:
        """How much memory it takes, at most."""
        depth = 0 if self.depth_m is None else self.depth_m.nbytes
        return self.grey.nbytes + self.whole.nbytes + self.colour.nbytes + depth


@dataclass
class RecordingView:
    """A recording's frames, by their numbers.

    name: for messages. camera: of colour, at the size of `Look`. scale: that size over the recorded one. lens: what the
    cameras have beyond a pinhole. path: poses of colour. stamps: of colour, depth and poses. has_depth: whether there
    is any. imu: what was measured beside them; None without one. depth_scale_per_m: steps a metre of its images; None
    where it has none. poses_path: the file of the poses. read: how many frames have been decoded.
    """

    name: str
    opened: OpenSource
    camera: Intrinsics
    scale: float
    lens: Optics
    path: Trajectory
    stamps: FrameStamps
    has_depth: bool
    imu: RecordedImu | None
    depth_scale_per_m: float | None = None
    poses_path: Path | None = None
    read: set[int] = field(default_factory=set[int])
    _kept: "OrderedDict[int, Look]" = field(default_factory=OrderedDict[int, Look], repr=False)
    _between: Registration | None = None
    _reading: Lock = field(default_factory=Lock, repr=False)

    def __post_init__(self) -> None:
        depth = self.lens.depth
        self._between = None if depth is None else Registration(self.camera, depth, self.lens.distortion)
        self._paths = SensorPaths(self.path)

    def __len__(self) -> int:
        return len(self.path)

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of a look."""
        return self.camera.width_px, self.camera.height_px

    @property
    def whole_px(self) -> float:
        """The width that frames were recorded with."""
        return self.camera.width_px / self.scale

    @property
    def focal_px(self) -> float:
        """Of colour at the size of a look, the mean of both directions."""
        return (self.camera.fx_px + self.camera.fy_px) / 2

    @property
    def rate_hz(self) -> float | None:
        """Frames a second by the median of the gaps; None for a single one."""
        gaps_s = np.diff(self.stamps.rgb.seconds)
        return 1 / float(np.median(gaps_s)) if gaps_s.size else None

    def look(self, frame: int) -> Look:
        """Return a frame. The last ones are kept. Raises InputError where its files are damaged."""
        with self._reading:
            if frame in self._kept:
                self._kept.move_to_end(frame)
                return self._kept[frame]
            self._kept[frame] = made = self._made(frame)
            self.read.add(frame)
            if len(self._kept) > max(KEPT_BYTES // made.held_bytes, 1):
                self._kept.popitem(last=False)
            return made

    def colour(self, frame: int) -> NDArray[np.uint8]:
        """Return a frame's colour alone, (H, W, 3) RGB, as it was recorded. Raises InputError as `look` does."""
        with self._reading:
            if frame in self._kept:
                return self._kept[frame].colour
            self.read.add(frame)
            return as_bytes(np.asarray(self.opened.frame(self._paths.request(frame)).rgb))

    def depth(self, frame: int) -> Float32:
        """Return a frame's depth alone, (H, W), as `look` has it; all void without any. Raises InputError likewise."""
        kept = self._kept.get(frame)
        depth_m = self._depth_m(self.opened.frame(self._paths.request(frame))) if kept is None else kept.depth_m
        return np.zeros(self.size_px[::-1], np.float32) if depth_m is None else depth_m

    def plane(self, points: Points) -> Float64:
        """Return where places on the image (N, 2) are on the plane at 1, (N, 2); NaN where the lens sees nothing."""
        at, camera, lens = points.astype(np.float64), self.camera, self.lens.distortion
        x, y = (at[:, 0] - camera.cx_px) / camera.fx_px, (at[:, 1] - camera.cy_px) / camera.fy_px
        return np.stack([x, y] if lens is None else straightened(lens, x, y), axis=-1)

    def _made(self, frame: int) -> Look:
        import cv2

        shown = self.opened.frame(self._paths.request(frame))
        colour = as_bytes(np.asarray(shown.rgb))
        whole = np.asarray(cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY), np.uint8)
        grey = np.asarray(self._resized(whole, cv2.INTER_AREA), np.uint8)
        return Look(grey, self._depth_m(shown), whole, colour)

    def _depth_m(self, shown: Any) -> Float32 | None:
        import cv2

        depth_m = shown.depth_m if self.has_depth else None
        if depth_m is None or self._between is None:
            return None if depth_m is None else np.asarray(self._resized(depth_m, cv2.INTER_NEAREST), np.float32)
        return self._between.depth_in_colour(depth_m)

    def _resized(self, image: NDArray[Any], by: int) -> NDArray[Any]:
        import cv2

        same = image.shape[1::-1] == self.size_px
        return image if same else np.asarray(cv2.resize(image, self.size_px, interpolation=by))


@cache
def linear_of_bytes() -> Float32:
    """Return (256,) linear light of bytes: exposures add in it."""
    return np.asarray(decoded(np.arange(256, dtype=np.float32) / np.float32(255)), np.float32)


@contextmanager
def footage_of(name: str, source: Source, camera: Intrinsics, widest_px: int = WIDEST_PX) -> Iterator[RecordingView]:
    """Open a recorded source for measuring. camera: of colour, as the source returned it."""
    path, found = source.trajectory(), source.capabilities
    small = camera.shrunk(widest_px)
    with source.prepare(camera, lambda _: None) as prepared:
        options = RenderOptions(near_m=0.01, far_m=1000.0, samples=1, seed=0)
        opened = prepared.open(SensorPaths(path), options, lambda _: None)
        scale = small.width_px / camera.width_px
        lens = source.optics(camera)
        stamps, more = source.frame_stamps, (found.depth_scale_per_m, found.poses_path)
        yield RecordingView(name, opened, small, scale, lens, path, stamps, found.depth, found.imu, *more)
