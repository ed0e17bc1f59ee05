# SPDX-License-Identifier: GPL-3.0-or-later
"""Images for the odometry: grey and depth in metres, scaled to a size that is fast."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from .alignment import By
from .frames import Depth, FrameEntry, FrameIndex, Grey, grey_of, read_colour, read_depth
from .smoothing import smoothed

T = TypeVar("T", bound=np.generic)


class Pictures:
    """Reads frames; images that are too wide are thinned out."""

    def __init__(self, index: FrameIndex, *, widest_px: int, smooth: bool, by: By = "both") -> None:
        self._index = index
        self._full = index.intrinsics
        self._smooth = smooth
        self._by = by
        self.step = max(1, -(-self._full.width_px // widest_px))
        self.camera = smaller(self._full, self.step)

    def read(self, entry: FrameEntry) -> tuple[Grey, Depth]:
        """Read a frame: grey (H, W), uniform where depth alone counts, and depth (H, W) in metres, NaN where void."""
        import cv2

        grey = self._grey(entry)
        depth_m = read_depth(entry, self._full, self._index.depth_scale_per_m)
        if self.step > 1:  # of both the same pixels are taken: depth is not averaged, or surfaces would appear between
            grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), self.step / 2.0), np.uint8)
            grey, depth_m = self._thinned(grey), self._thinned(depth_m)
        return grey, smoothed(depth_m) if self._smooth else depth_m

    def _grey(self, entry: FrameEntry) -> Grey:
        if self._by == "depth":
            return np.zeros((self._full.height_px, self._full.width_px), np.uint8)
        return grey_of(read_colour(entry, self._full))

    def _thinned(self, image: NDArray[T]) -> NDArray[T]:
        first = self.step // 2
        thinned = image[first :: self.step, first :: self.step]
        return np.ascontiguousarray(thinned[: self.camera.height_px, : self.camera.width_px])


def smaller(camera: Intrinsics, step: int) -> Intrinsics:
    """Return the camera of an image of every `step`-th pixel, the first being the (step // 2)-th."""
    first = step // 2
    return Intrinsics(
        max(1, (camera.width_px - first + step - 1) // step),
        max(1, (camera.height_px - first + step - 1) // step),
        camera.fx_px / step,
        camera.fy_px / step,
        (camera.cx_px - first) / step,
        (camera.cy_px - first) / step,
    )
