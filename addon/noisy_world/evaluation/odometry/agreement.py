# SPDX-License-Identifier: GPL-3.0-or-later
"""How well two views agree under an estimated motion between them, on a grid of pixels.

OpenCV's odometry never admits to being lost: it returns the motion with the least error, however large that is.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics, invert_pose
from .alignment import RgbdView

Float64: TypeAlias = NDArray[np.float64]

ACROSS = 64  # points of the grid in a row; chosen: 3,000 points take half a millisecond
NEAR_M, NEAR_SHARE = 0.03, 0.02  # depths agree within 3 cm and 2 % of the depth


@dataclass(frozen=True)
class Agreement:
    """How well two views agree.

    overlap: share of the grid's pixels with depth in the target that are inside the source's image. seen: share of the
    grid's pixels that have depth in both.
    depth: share of these at whose place the source has the depth that is expected.
    grey: correlation of the grey values there, -1 to 1; 0 where one of them is uniform. moved: how far the points move
    in the image, their mean, as a share of its width. error: median difference of the depths, as a share of the depth.
    """

    overlap: float
    seen: float
    depth: float
    grey: float
    moved: float
    error: float


NONE = Agreement(0.0, 0.0, 0.0, 0.0, 1.0, np.inf)
WHOLE = Agreement(1.0, 1.0, 1.0, 1.0, 0.0, 0.0)  # of a view with itself


def agreement(camera: Intrinsics, source: RgbdView, target: RgbdView, target_from_source: Float64) -> Agreement:
    """Compare the target with what the source shows at the same places."""
    step = max(1, camera.width_px // ACROSS)
    rows = np.arange(step // 2, camera.height_px, step)
    columns = np.arange(step // 2, camera.width_px, step)
    depth_m = target.depth_m[np.ix_(rows, columns)].astype(np.float64)
    known = np.isfinite(depth_m)
    if not known.any():
        return NONE
    row, column = (np.broadcast_to(axis, known.shape)[known] for axis in (rows[:, None], columns[None, :]))
    z = depth_m[known]
    points = np.stack([(column - camera.cx_px) / camera.fx_px * z, (row - camera.cy_px) / camera.fy_px * z, z])
    source_from_target = invert_pose(target_from_source)
    x, y, expected_m = source_from_target[:3, :3] @ points + source_from_target[:3, 3:]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = x / expected_m * camera.fx_px + camera.cx_px
        v = y / expected_m * camera.fy_px + camera.cy_px
    inside = (expected_m > 0) & (u >= 0) & (u <= camera.width_px - 1) & (v >= 0) & (v <= camera.height_px - 1)
    if not inside.any():
        return NONE
    u, v, row, column, expected_m = u[inside], v[inside], row[inside], column[inside], expected_m[inside]
    found_m = _at(source.depth_m, u, v).astype(np.float64)
    both = np.isfinite(found_m)
    if not both.any():
        return NONE
    apart_m, expected_m = np.abs(found_m[both] - expected_m[both]), expected_m[both]
    return Agreement(
        float(inside.mean()),
        float(both.sum() / known.size),
        float((apart_m <= NEAR_M + NEAR_SHARE * expected_m).mean()),
        _correlation(_at(source.grey, u, v)[both], target.grey[row, column][both]),
        float(np.hypot(u - column, v - row).mean()) / camera.width_px,
        float(np.median(apart_m / expected_m)),
    )


def _at(image: NDArray, u: Float64, v: Float64) -> NDArray:
    """Return the image's values (N,) at pixels between the grid's, linearly interpolated; next to NaN they are NaN."""
    import cv2

    columns, rows = u.astype(np.float32)[None], v.astype(np.float32)[None]
    return np.asarray(cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))[0]


def _correlation(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """Return Pearson's correlation, 0 where there are few values or one of the sides is uniform."""
    if len(a) < 2:
        return 0.0
    of_a, of_b = a - a.mean(), b - b.mean()
    norm = float(np.sqrt((of_a * of_a).sum() * (of_b * of_b).sum()))
    return float((of_a * of_b).sum()) / norm if norm > 0.0 else 0.0
