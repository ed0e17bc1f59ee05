# SPDX-License-Identifier: GPL-3.0-or-later
"""Culling: only points that the true cameras saw are compared."""

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from .samples import Points
from .views import Views, spread

MARGIN_M = 0.1  # how far behind the true surface a map's point still counts as seen; chosen
TRUTH_MARGIN_M = 0.02  # of the truth's own points: more would count what a thin shelf hides; chosen
MOST_VIEWS = 200
_AT_ONCE = 200_000  # points


class Culling(StrEnum):
    """Which points count."""

    NONE = "none"  # all
    FRUSTUM = "frustum"  # in the picture of some true camera, no farther than the farthest that it sees, with a margin
    FRUSTUM_OCCLUSION = "frustum_occlusion"  # and not behind what it sees there, with a margin


class Seen:
    """What true cameras saw: their depth images, evenly chosen from all views, at most MOST_VIEWS."""

    def __init__(self, views: Views, culling: Culling) -> None:
        """Look at the views; their depth is kept."""
        self.culling = culling
        self._camera = views.camera
        chosen = [] if culling is Culling.NONE else spread(len(views.c2w), MOST_VIEWS)
        # Neighbours see much the same. With far ones first, most points are found soon, and not looked for again.
        order = [chosen[place] for place in _far_ones_first(len(chosen))]
        self._c2w = views.c2w[order]
        self._limits_m = [self._limit_m(views.view(index).depth_m) for index in order]

    @property
    def view_count(self) -> int:
        """How many views were looked at."""
        return len(self._limits_m)

    def _limit_m(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return how deep a pixel (H * W,) sees: without an end where it meets nothing."""
        if self.culling is Culling.FRUSTUM:
            return np.full(depth_m.size, depth_m.max(), dtype=np.float32)
        return np.where(depth_m > 0, depth_m, np.float32(np.inf)).reshape(-1)

    def tell(self, points_m: Points, margin_m: float) -> NDArray[np.bool_]:
        """Return which of the points (N, 3) count (N,): those at most so far behind what is seen."""
        found = np.full(len(points_m), self.culling is Culling.NONE)
        for first in range(0, len(points_m) if self._limits_m else 0, _AT_ONCE):
            some = points_m[first : first + _AT_ONCE]
            left = np.arange(first, first + len(some))
            for c2w, limit_m in zip(self._c2w, self._limits_m, strict=True):
                seen = _in_view(points_m[left], c2w, self._camera, limit_m + np.float32(margin_m))
                found[left[seen]] = True
                left = left[~seen]
        return found


def _in_view(
    points_m: Points, c2w: NDArray[np.float64], camera: Intrinsics, limit_m: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """Return which points lie in a picture, before what limits each pixel's sight."""
    x, y, z = ((points_m - c2w[:3, 3]) @ c2w[:3, :3]).astype(np.float32).T
    seen = z > 0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # behind the camera: not seen
        right = x / z * np.float32(camera.fx_px) + np.float32(camera.cx_px + 0.5)
        down = y / z * np.float32(camera.fy_px) + np.float32(camera.cy_px + 0.5)
    seen &= (right >= 0) & (right < camera.width_px) & (down >= 0) & (down < camera.height_px)
    inside = np.flatnonzero(seen)
    pixels = down[inside].astype(np.intp) * camera.width_px + right[inside].astype(np.intp)
    seen[inside] = z[inside] <= limit_m[pixels]
    return seen


def _far_ones_first(count: int) -> list[int]:
    """Return 0 to count - 1 in halves of halves: 0, a half, a quarter, three quarters, ..."""
    bits = max(count - 1, 0).bit_length()
    turned = (int(format(place, f"0{bits}b")[::-1], 2) if bits else place for place in range(1 << bits))
    return [place for place in turned if place < count]
