# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth as a sensor measured it: as another camera sees it, and completed where nothing was measured.

Depth that was not measured: completed for what acts on colour, never for what is written.

A sensor leaves void where it measured nothing: at edges, on dark, shiny or near surfaces, beside the projector's view.
Such a pixel shows a surface, not the sky, so it counts as far as what was measured around it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, PresetKey
from ..core.geometry import Intrinsics
from ..core.lens import DepthCamera, Distortion
from ..core.schema import Choice

Void: TypeAlias = Literal["unmeasured", "sky"]
"""What void means: that nothing was measured there, or that nothing is there: infinitely far."""

MEDIAN_PX = 5  # side of the square; chosen

VOID_MEANING = (
    "what depth 0 means to perturbations of colour by depth: unmeasured counts as far as what was measured "
    "around it, and depth is written as it is; sky is infinitely far"
)
VOID_CHOICES = {
    "unmeasured": Choice("Unmeasured", "As far as what was measured around it; written depth stays as it is"),
    "sky": Choice("Sky", "Infinitely far"),
}


def completed_m(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return planar depth (H, W), metres, completed where it is 0; itself where none is 0, or all are.

    A pixel gets the farthest of the nearest four that were measured: left, right, above and below. So the shadow beside
    a near surface and what is out of range count as what is behind. A median over 5 x 5 pixels takes streaks out.
    """
    import cv2

    known = depth_m > 0
    if known.all() or not known.any():
        return depth_m
    filled = _filled(depth_m, known)
    if not (there := filled > 0).all():  # neither their row nor their column has any
        filled = _filled(filled, there)
    smooth = np.asarray(cv2.medianBlur(filled, MEDIAN_PX), np.float32)
    np.copyto(smooth, depth_m, where=known)
    return smooth


def _filled(depth_m: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return depth (H, W) with the farthest neighbour in its row and column where it is not known; 0 without any."""
    by_row, by_column = depth_m.copy(), np.zeros(depth_m.T.shape, np.float32)
    by_row[~known] = _farther_neighbours(depth_m, known)
    by_column[~known.T] = _farther_neighbours(depth_m.T, known.T)
    return np.maximum(by_row, by_column.T, out=by_row)


def _farther_neighbours(depth_m: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return (N,): for each pixel that is not known, row by row, the farther of the known ones before and after it.

    All of a run have the same neighbours; beside the image there is 0.
    """
    height, width = depth_m.shape
    beside = np.zeros((height, width + 2), np.float32)
    beside[:, 1:-1] = depth_m
    unknown = np.zeros((height, width + 2), np.bool_)
    np.logical_not(known, out=unknown[:, 1:-1])
    flat, is_unknown = beside.ravel(), unknown.ravel()
    changes = np.flatnonzero(is_unknown[1:] != is_unknown[:-1])
    before, after = changes[::2], changes[1::2] + 1
    return np.repeat(np.maximum(flat[before], flat[after]), after - before - 1)


@dataclass(frozen=True)
class MeasuredDepth:
    """How far the frames of a recording see, for those that measured nothing.

    place: for messages. count: of frames. read: a frame's number -> its planar depth (H, W), metres, 0 where nothing
    was measured.
    """

    place: Path
    count: int
    read: Callable[[int], NDArray[np.float32]]
    _medians_m: dict[int, float] = field(default_factory=dict[int, float], init=False, repr=False)

    def __call__(self, frame: int) -> float:
        """Return the median of what was measured in the nearest frame that measured anything, metres.

        Of two that are equally near it is the earlier one. Raises InputError where no frame measured anything.
        """
        for apart in range(self.count):
            for other in (frame - apart, frame + apart):
                if 0 <= other < self.count and (median_m := self._median_m(other)) > 0:
                    return median_m
        remedy = f"leave out what needs depth, or take it for sky with {PresetKey('void', 'sky')}"
        raise InputError(self.place, "no frame has any depth that was measured", remedy=remedy)

    def _median_m(self, frame: int) -> float:
        if frame not in self._medians_m:
            depth_m = self.read(frame)
            measured_m = depth_m[depth_m > 0]
            self._medians_m[frame] = float(np.median(measured_m)) if measured_m.size else 0.0
        return self._medians_m[frame]


# Depth of one camera as another sees it, and the reverse, by the calibration between them.
#
# As devices align depth to colour (librealsense, src/proc/align.cpp): the square of each depth pixel is carried through
# the calibration to a rectangle of colour, and pixels with their centres inside get its depth; of several the nearest
# counts. What no depth pixel reaches is void. librealsense takes the pixels of both corners, a row and a column more.


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
