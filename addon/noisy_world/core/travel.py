# SPDX-License-Identifier: GPL-3.0-or-later
"""How far what a camera sees goes on its image while the camera moves."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .geometry import Intrinsics
from .lens import Distortion, lens_rays, projected

GRID = 25, 15  # pixels across and down that are looked at, corners among them; chosen
MISSED = 1.25  # times the grid's way: what the nearest pixel of a cell goes counts from there on; chosen
VOID_M = 1e5  # void is as far as that, and moves by rotation alone
NEAREST = 0.02  # of a point's depth: nearer it would pass the camera, and is beside the image


def travel_px(
    depth_m: NDArray[np.float32],
    depth_c2w: NDArray[np.float64],
    c2w: NDArray[np.float64],
    depth_camera: Intrinsics,
    camera: Intrinsics,
    *,
    lens: Distortion | None = None,
) -> float:
    """Return the longest way on the image, in pixels, of what a grid of pixels sees.

    Where the nearest pixel of a cell goes a quarter farther, it is that one's: a pole may stand between the grid's.

    depth_m: (H, W) planar depth, 0 = void, seen from depth_c2w (4, 4) through depth_camera. c2w: (N, 4, 4), the poses
    of the camera one after another. A way from one to the next counts while the point is before the camera and within
    an image's size of the image; with a lens that distorts both images, while it is within the image.
    """
    height, width = depth_m.shape
    known_m = np.where(depth_m > 0, depth_m, np.float32(VOID_M))
    places = _on_grid(width, height), _nearest(known_m)
    seen = [known_m[v, u].astype(np.float64) for u, v in places]
    parts = [_points(seen_m, u, v, depth_camera, lens) for seen_m, (u, v) in zip(seen, places, strict=True)]
    seen_m, points = np.concatenate(seen), np.concatenate(parts, axis=1)
    away_m = np.linalg.norm(points, axis=0)
    world = depth_c2w[:3, :3] @ points + depth_c2w[:3, 3:]
    placed = c2w[:, :3, :3].transpose(0, 2, 1) @ (world - c2w[:, :3, 3:])
    if lens is not None and lens_rays(camera, lens).forward is not None:
        before = np.linalg.norm(placed, axis=1) > NEAREST * away_m
    else:
        before = placed[:, 2] > NEAREST * seen_m
        placed[:, 2] = np.where(before, placed[:, 2], 1.0)
    at_u, at_v = projected(placed.transpose(0, 2, 1), camera, lens)
    before &= (np.abs(at_u - width / 2) < 1.5 * width) & (np.abs(at_v - height / 2) < 1.5 * height)
    step_px = np.hypot(np.diff(at_u, axis=0), np.diff(at_v, axis=0))
    way_px = np.where(before[1:] & before[:-1], step_px, 0.0).sum(axis=0)
    count = seen[0].size
    grid_px, nearest_px = (float(part.max(initial=0.0)) for part in (way_px[:count], way_px[count:]))
    return nearest_px if nearest_px > MISSED * grid_px else grid_px


def _on_grid(width: int, height: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return columns and rows (N,) of the grid's pixels."""
    across, down = (
        np.unique(np.linspace(0, size - 1, count).round().astype(np.intp))
        for size, count in zip((width, height), GRID, strict=True)
    )
    u, v = np.meshgrid(across, down)
    return u.ravel(), v.ravel()


def _nearest(depth_m: NDArray[np.float32]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return columns and rows (N,) of the nearest pixel of each cell of the grid that is not all void."""
    height, width = depth_m.shape
    across, down = (
        np.unique(np.linspace(0, size, count).round().astype(np.intp)).tolist()
        for size, count in zip((width, height), GRID, strict=True)
    )
    found = [
        (left + at % (right - left), top + at // (right - left))
        for top, bottom in pairwise(down)
        for left, right in pairwise(across)
        for at in [int(depth_m[top:bottom, left:right].argmin())]
    ]
    u, v = np.array(found, np.intp).T
    known = depth_m[v, u] < VOID_M
    return u[known], v[known]


def _points(
    seen_m: NDArray[np.float64], u: NDArray[np.intp], v: NDArray[np.intp], camera: Intrinsics, lens: Distortion | None
) -> NDArray[np.float64]:
    """Return where pixels (N,) see something at planar depths (N,), (3, N) in the camera's axes.

    Where a lens sees sideways there is no planar depth: what is there is taken to be as far as the nearest of the rest.
    """
    if lens is None:
        local = np.stack([(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px])
        return np.concatenate([local * seen_m, seen_m[None]])
    rays = lens_rays(camera, lens)
    local = np.stack([rays.right[v, u], rays.down[v, u]])
    if rays.forward is None:
        return np.concatenate([local * seen_m, seen_m[None]])
    deep, forward = rays.is_deep[v, u], rays.forward[v, u]
    away_m = np.divide(seen_m, forward, out=np.full(seen_m.shape, np.inf), where=deep)
    away_m[~deep] = away_m.min(initial=VOID_M)
    return np.concatenate([local, forward[None]]) * away_m
