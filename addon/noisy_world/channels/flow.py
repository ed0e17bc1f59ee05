# SPDX-License-Identifier: GPL-3.0-or-later
"""Optical flow from a frame to the next one of its sequence, and where what a pixel sees is hidden then."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics, invert_pose
from .channel import PairChannel, View

SEEN, OCCLUDED, OUTSIDE, VOID = 0, 1, 2, 3
# Chosen: of its depth. What hides a surface from so near cannot be told from rounding: engines give depth to 2e-4, and
# a recording's steps of 0.2 mm are as much at 1 m.
NEAREST_OCCLUDER = 1e-3
NEAREST_WAY_PX = 0.25  # chosen: what something else goes otherwise by less than this is not told apart


_Cell: TypeAlias = tuple[NDArray[np.intp], ...]
_Places: TypeAlias = tuple[
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.bool_],
    Callable[[_Cell], tuple[NDArray[np.bool_], NDArray[np.bool_]]],
]
"""Where another view has what the pixels' centres see: x and y in pixels, and whether it is before the camera, each
(H, W); and a function of the square between pixels that it lies in, which tells whether it is seen there, and where
nothing is known. Where nothing is seen here, they mean nothing."""


class Flow(PairChannel):
    """Forward optical flow, by depth and poses or, of a world in which things move, as a renderer tells it."""

    name = "flow"
    order = 50
    label = "Flow"
    meaning = "forward optical flow to the sequence's next frame, and what is hidden there"
    spoken = "flow"
    dtype = "float32"
    components = 3
    unit = "px"
    parts = ("dx", "dy", "hidden")
    convention = (
        "dx, dy, hidden as float32: what the centre of the pixel (x, y) sees is at (x + dx, y + dy) in the colour "
        "image of the sequence's next frame; hidden is 0 where it is seen there, 1 where something lies before it, 2 "
        "where it is outside that image, 3 where no depth tells, and in all of the last frame; dx and dy are 0 where "
        "it is 3, and of what is behind the next camera"
    )
    bytes_per_pixel = 7.4

    def of_views(self, here: View, there: View) -> NDArray[np.float32]:
        """Return (H, W, 3): dx, dy, hidden."""
        height, width = here.depth_m.shape
        x, y, before, shown = _by_depth(here, there) if here.to_other_px is None else _by_motion(here, there)
        inside = before & (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)
        cell = tuple(np.where(inside, np.floor(at), 0).astype(np.intp) + 1 for at in (y, x))
        seen, unknown = shown(cell)
        valid = (here.depth_m > 0) & ~(inside & unknown)
        hidden = np.select([~valid, ~inside, ~seen], [VOID, OUTSIDE, OCCLUDED], default=SEEN)
        flow = np.empty((height, width, 3), dtype=np.float32)
        flow[..., 0] = np.where(valid & before, x - np.arange(width), 0)
        flow[..., 1] = np.where(valid & before, y - np.arange(height)[:, None], 0)
        flow[..., 2] = hidden
        return flow

    def of_last(self, camera: Intrinsics) -> NDArray[np.float32]:
        """Return (H, W, 3), all of it void."""
        flow = np.zeros((camera.height_px, camera.width_px, 3), dtype=np.float32)
        flow[..., 2] = VOID
        return flow


def _by_depth(here: View, there: View) -> _Places:
    """Return where the other view has what the pixels' centres see, of a world in which nothing moves."""
    there_from_here = invert_pose(there.c2w) @ here.c2w
    turned = there.camera.matrix @ there_from_here[:3, :3] @ np.linalg.inv(here.camera.matrix)
    moved = there.camera.matrix @ there_from_here[:3, 3]
    depth_m = np.where(here.depth_m > 0, here.depth_m, np.float32(1)).astype(np.float64)
    height, width = depth_m.shape
    across, down = np.arange(width), np.arange(height)[:, None]
    x, y, z_m = (depth_m * (turned[k, 0] * across + (turned[k, 1] * down + turned[k, 2])) + moved[k] for k in range(3))

    def shown(cell: _Cell) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        farthest, _ = _allowed(_inverse(there.depth_m))  # the inverse depth of what is farthest is the least
        with np.errstate(divide="ignore"):
            return 1 / z_m >= farthest[cell] * (1 - NEAREST_OCCLUDER), np.isnan(farthest)[cell]

    with np.errstate(divide="ignore", invalid="ignore"):
        return x / z_m, y / z_m, z_m > 0, shown


def _by_motion(here: View, there: View) -> _Places:
    """Return the same as a renderer tells it: seen is what the other view brings back to where it came from."""
    assert here.to_other_px is not None, "it is asked for by that"
    assert there.to_other_px is not None, "both are told"
    ahead, back = here.to_other_px.astype(np.float64), there.to_other_px
    height, width = here.depth_m.shape

    def shown(cell: _Cell) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        seen, unknown = np.ones((height, width), np.bool_), np.zeros((height, width), np.bool_)
        for axis in (0, 1):
            least, most = _allowed(np.where(there.depth_m > 0, back[..., axis], np.nan))
            home = -ahead[..., axis]
            seen &= (home >= least[cell] - NEAREST_WAY_PX) & (home <= most[cell] + NEAREST_WAY_PX)
            unknown |= np.isnan(least)[cell]
        return seen, unknown

    x, y = np.arange(width) + ahead[..., 0], np.arange(height)[:, None] + ahead[..., 1]
    return x, y, np.ones((height, width), np.bool_), shown


def _inverse(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    with np.errstate(divide="ignore"):
        return np.where(depth_m > 0, np.reciprocal(depth_m, dtype=np.float32), np.float32(np.nan))


def _allowed(values: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the least and the most (H + 1, W + 1) that a value may be between four pixels; NaN where none is known.

    [row + 1, column + 1] is of the square whose corner with the least coordinates is the centre of the pixel (row,
    column). What is linear along a plane, such as inverse depth, lies between its values at the corners. Where surfaces
    meet in the square, it goes no farther than the surface of any corner leads, so the least slope beyond a corner,
    along both axes, is allowed for. A corner that is NaN says nothing. Beyond the outermost pixels' centres surfaces
    go on as they come.
    """
    height, width = values.shape
    across, down = _slopes(values, 1), _slopes(values, 0)
    corners = np.pad(values, 1, mode="edge")
    least = np.full((height + 1, width + 1), np.nan, dtype=np.float32)
    most, slope = least.copy(), least.copy()
    for low in (0, 1):
        for left in (0, 1):
            rows, columns = slice(low, low + height + 1), slice(left, left + width + 1)
            np.fmin(least, corners[rows, columns], out=least)
            np.fmax(most, corners[rows, columns], out=most)
            beyond_x, beyond_y = across[rows, 2 * left :], down[2 * low :, columns]
            np.fmin(slope, beyond_x[:, : width + 1] + beyond_y[: height + 1], out=slope)
    slope[np.isnan(slope)] = np.inf
    return least - slope, most + slope


def _slopes(values: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """Return how much values differ from one pixel to the next along an axis; beyond the edge as much as beside it."""
    steps = np.abs(np.diff(values, axis=axis)) if values.shape[axis] > 1 else np.zeros_like(values)
    return np.pad(steps, [(2, 2) if item == axis else (1, 1) for item in (0, 1)], mode="edge")


CHANNEL = Flow()
