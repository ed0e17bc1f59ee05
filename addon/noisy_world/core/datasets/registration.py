# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth of one camera as another sees it, and the reverse, by the calibration between them.

As devices align depth to colour (librealsense, src/proc/align.cpp): the square of each depth pixel is carried through
the calibration to a rectangle of colour, and pixels with their centres inside get its depth; of several the nearest
counts. What no depth pixel reaches is void. librealsense takes the pixels of both corners, a row and a column more.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..geometry import Intrinsics
from ..optics import DepthCamera, Distortion

Float64: TypeAlias = NDArray[np.float64]

# Chosen: a depth pixel that is nearer than this to the colour camera would cover the whole image.
_NEAREST_M = 0.01
_ROUNDING_PX = 1e-6
_LARGEST_SPLAT_PX = 64  # of a side: colour of sixty times the pixels of depth, a side


@dataclass(frozen=True)
class Registration:
    """What is between a colour camera and the camera of its depth images. distortion: of the colour camera's lens."""

    colour: Intrinsics
    depth: DepthCamera
    distortion: Distortion | None = None

    def depth_in_colour(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return planar depth (H, W) in metres as the colour camera sees it, 0 = void."""
        seen = depth_m > 0
        z_m = depth_m[seen].astype(np.float64)
        (left, top), (right, bottom) = self._corners
        first, corner_m = self._carried(left[seen], top[seen], z_m)
        last, other_m = self._carried(right[seen], bottom[seen], z_m)
        near_m = (corner_m + other_m) / 2  # the middle's, as depth is linear in a pixel's place on a plane across
        # The pixels whose centres are inside. Squares that meet in a centre leave no gap, whatever is rounded.
        low = np.ceil(np.minimum(first, last) - _ROUNDING_PX).astype(np.int64)
        high = np.ceil(np.maximum(first, last)).astype(np.int64) - 1
        there = np.isfinite(near_m) & (near_m > _NEAREST_M) & (high >= 0).all(axis=0)
        there &= (low[0] < self.colour.width_px) & (low[1] < self.colour.height_px)
        low, high, near_m = low[:, there], high[:, there], near_m[there]
        out_m = np.full((self.colour.height_px, self.colour.width_px), np.inf)
        if near_m.size:
            self._splat(out_m, low, np.minimum(high, low + _LARGEST_SPLAT_PX), near_m)
        out_m[np.isinf(out_m)] = 0.0
        return out_m.astype(np.float32)

    def colour_in_depth(self, rgb: NDArray[np.float32], depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return colour (H, W, 3) at each pixel of depth; where there is no depth, at the middle one of the others."""
        import cv2

        known = depth_m[depth_m > 0]
        z_m = np.where(depth_m > 0, depth_m, np.median(known) if known.size else 1.0).astype(np.float64)
        (x, y), _ = self._carried(self._rays[..., 0], self._rays[..., 1], z_m)
        maps = [np.asarray(part, np.float32) for part in (x, y)]
        return np.asarray(
            cv2.remap(rgb, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32
        )

    @cached_property
    def _rays(self) -> Float64:
        return self.depth.intrinsics.ray_directions()

    @cached_property
    def _corners(self) -> tuple[tuple[Float64, Float64], tuple[Float64, Float64]]:
        """The rays through the first and the last corner of each depth pixel, x and y (H, W) each."""
        camera, rays = self.depth.intrinsics, self._rays
        half_x, half_y = 0.5 / camera.fx_px, 0.5 / camera.fy_px
        return (rays[..., 0] - half_x, rays[..., 1] - half_y), (rays[..., 0] + half_x, rays[..., 1] + half_y)

    def _carried(self, x: Float64, y: Float64, z_m: Float64) -> tuple[Float64, Float64]:
        """Return where points on rays (x, y, 1) at planar depth are in colour, (2, ...) px, and their depth there."""
        points = np.stack([x * z_m, y * z_m, z_m])
        if self.depth.rgb_from_depth is not None:
            matrix = self.depth.matrix
            points = np.einsum("ij,j...->i...", matrix[:3, :3], points) + matrix[:3, 3].reshape(3, *[1] * z_m.ndim)
        with np.errstate(divide="ignore", invalid="ignore"):
            across, down = points[0] / points[2], points[1] / points[2]
        if self.distortion is not None and not self.depth.shares_lens:
            across, down = self.distortion.bent(across, down)
        camera = self.colour
        pixels = np.stack([across * camera.fx_px + camera.cx_px, down * camera.fy_px + camera.cy_px])
        far = camera.width_px + camera.height_px + 1.0
        return np.clip(np.nan_to_num(pixels, nan=-far), -far, 2 * far), points[2]

    def _splat(self, out_m: Float64, low: NDArray[np.int64], high: NDArray[np.int64], near_m: Float64) -> None:
        """Put depths into rectangles of an image from `low` to `high`, (2, N) px, the nearest where they overlap."""
        height, width = out_m.shape
        size = (high - low).max(axis=1)
        flat = out_m.reshape(-1)
        for down in range(int(size[1]) + 1):
            for across in range(int(size[0]) + 1):
                x, y = low[0] + across, low[1] + down
                inside = (x <= high[0]) & (y <= high[1]) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
                np.minimum.at(flat, y[inside] * width + x[inside], near_m[inside])
