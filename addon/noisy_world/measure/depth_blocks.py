# SPDX-License-Identifier: GPL-3.0-or-later
"""Blocks of depth, and the same surfaces in another frame: relief is there again, noise is not.

A block is a plane, which is linear in inverse depth, and what that leaves. By the camera's motion a block's plane is
known in the other frame, and which of its pixels show each of the block's: what the plane leaves of these is the same
relief, with noise of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .footage import Float32, Float64, RecordingView
from .motion import Steps, tukey

# Chosen, as all below.
SIDE = 9  # of small blocks in pixels
EDGE = 0.15  # times its distance: a block that spans more is an edge
LAGS = 6, 8, 11, 15, 20, 27  # frames to the other frame: the first over which enough moves
MOVED = 1 / 24  # of the width, that surfaces have to move by: noise that stays at its pixels is left behind
ALIGNED_BLOCKS, ALIGNED_STEP = 800, 2  # blocks by which a motion is made exact, and every how many pixels of them
ROUNDS = 4
TURN_RAD, SHIFT_M = 0.02, 0.03  # standard deviations of a motion by colour
STILL = 2e-4  # radians and metres: a change of the motion that changes nothing
LEAST_BLOCKS = 40
LEAST_SPREAD_PER_M = 1e-6


@dataclass(frozen=True)
class DepthBlocks:
    """N blocks of side x side pixels without void or edge.

    which: (N,) by number, row by row. corner_px: (N, 2) of their first pixel, right and down. z: (N,) metres in the
    middle. slope: (N, 2), change of inverse depth a pixel across and down. left: (N, side x side), what planes leave of
    inverse depth. bend: (N,), second differences of neighbours' means in inverse depth; infinite without neighbours.
    """

    side: int
    which: NDArray[np.int64]
    corner_px: NDArray[np.int64]
    z: Float64
    slope: Float64
    left: Float32
    bend: Float64

    def __len__(self) -> int:
        return len(self.z)

    def taken(self, rows: NDArray[np.intp]) -> "DepthBlocks":
        """Return some of them."""
        places = self.which[rows], self.corner_px[rows]
        return DepthBlocks(self.side, *places, self.z[rows], self.slope[rows], self.left[rows], self.bend[rows])

    def evenly(self, count: int) -> "DepthBlocks":
        """Return so many of them at most, evenly over the image."""
        return self.taken(np.unique(np.linspace(0, len(self) - 1, count).astype(int)))


@cache
def _terms(side: int) -> tuple[Float32, Float32]:
    """Return a plane's terms over a block, (3, side^2), and what finds their factors in its pixels, (side^2, 3)."""
    v, u = np.mgrid[:side, :side] - (side - 1) / 2
    terms = np.stack([np.ones(u.size), u.ravel(), v.ravel()]).astype(np.float32)
    return terms, np.ascontiguousarray(np.linalg.pinv(terms), np.float32)


def blocks_in(depth_m: Float32, side: int) -> DepthBlocks:
    """Return the blocks of an image of depth (H, W) in metres, 0 = void."""
    high, wide = depth_m.shape[0] // side, depth_m.shape[1] // side
    cut = depth_m[: high * side, : wide * side].reshape(high, side, wide, side).swapaxes(1, 2).reshape(-1, side * side)
    lowest, highest = cut.min(axis=1), cut.max(axis=1)
    whole = np.flatnonzero((lowest > 0) & (highest - lowest < EDGE * highest))
    per_m = 1 / cut[whole].astype(np.float32)
    terms, finds = _terms(side)
    # Less the mean, so that single precision is of the differences.
    mean = per_m.mean(axis=1, keepdims=True)
    per_m -= mean
    plane = per_m @ finds
    per_m -= plane @ terms
    middle, slope = (plane[:, 0] + mean[:, 0]).astype(np.float64), plane[:, 1:].astype(np.float64)
    inner = np.full(high * wide, np.inf)
    inner[whole] = middle
    means = np.pad(inner.reshape(high, wide), 1, constant_values=np.inf)
    around = means[1:-1, 2:] + means[1:-1, :-2], means[2:, 1:-1] + means[:-2, 1:-1]
    bend = np.hypot(*(each.reshape(-1)[whole] - 2 * middle for each in around))
    row, column = np.divmod(whole, max(wide, 1))
    corner_px = np.stack([column, row], axis=1) * side
    return DepthBlocks(side, whole, corner_px, 1 / middle, slope, np.asarray(per_m, np.float32), bend)


# --- in another frame ---


class PixelRays:
    """Where the pixels of a recording's looks are on the plane at 1, and back."""

    def __init__(self, footage: RecordingView) -> None:
        self._camera, self._lens = footage.camera, footage.lens.distortion
        self.wide_px, self.high_px = footage.size_px
        v, u = np.mgrid[: self.high_px, : self.wide_px]
        plane = footage.plane(np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float32)).reshape(*u.shape, 2)
        self.x, self.y = (np.ascontiguousarray(plane[..., axis], np.float32) for axis in (0, 1))

    def places(self, x: Float32, y: Float32) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return the nearest pixels, right and down, of places on the plane at 1; -1 where there are none."""
        if self._lens is not None:
            bent = self._lens.bent(x.astype(np.float64), y.astype(np.float64))
            x, y = bent[0].astype(np.float32), bent[1].astype(np.float32)
        camera = self._camera
        found: list[NDArray[np.int32]] = []
        for at, focal_px, middle_px, size in (
            (x, camera.fx_px, camera.cx_px, self.wide_px),
            (y, camera.fy_px, camera.cy_px, self.high_px),
        ):
            place = at * np.float32(focal_px) + np.float32(middle_px)
            place = np.where(np.abs(place - size / 2) < size / 2 + 1, place, -1)  # not a number is nowhere too
            found.append(np.rint(place).astype(np.int32))
        return found[0], found[1]

    def planes(self, blocks: DepthBlocks) -> Float64:
        """Return (N, 3): blocks' inverse depth is this times (x, y, 1) on the plane at 1."""
        middle = blocks.corner_px + blocks.side // 2
        column, row = (
            np.clip(at, 1, size - 2) for at, size in zip(middle.T, (self.wide_px, self.high_px), strict=True)
        )
        x_u, x_v, y_u, y_v = (
            (grid[row + down, column + right].astype(np.float64) - grid[row - down, column - right]) / 2
            for grid in (self.x, self.y)
            for right, down in ((1, 0), (0, 1))
        )
        area = x_u * y_v - x_v * y_u
        of_u, of_v = blocks.slope.T
        of_x, of_y = (of_u * y_v - of_v * y_u) / area, (of_v * x_u - of_u * x_v) / area
        off = (blocks.side - 1) / 2 - blocks.side // 2
        x, y = self.x[row, column] + off * (x_u + x_v), self.y[row, column] + off * (y_u + y_v)
        return np.stack([of_x, of_y, 1 / blocks.z - of_x * x - of_y * y], axis=1)


@dataclass(frozen=True)
class There:
    """Blocks where another frame shows them. rows: (n,) which of the blocks.

    left: (n, pixels), what the planes leave there, as large in inverse depth as if it were in the first frame. z: (n,).
    off: (n,) how much less inverse depth the plane has than is seen. plane, middle: (n, 3) the planes there, and (x, y,
    1) on the plane at 1.
    """

    rows: NDArray[np.intp]
    left: Float32
    z: Float64
    off: Float64
    plane: Float64
    middle: Float64

    def equations(self) -> tuple[Float64, Float64]:
        """Return the normal equations (6, 6) and (6,) of what the motion is off by, in the noise's units.

        Rotation vector and translation, in the other camera's axes: points lie on planes (Chen and Medioni, 1992).
        """
        ways = np.concatenate([-np.cross(self.plane, self.middle), self.plane / self.z[:, None]], axis=1)
        spread = 1.4826 * float(np.median(np.abs(self.off))) + LEAST_SPREAD_PER_M
        weighted = ways * (tukey(self.off, LEAST_SPREAD_PER_M) / spread**2)[:, None]
        return weighted.T @ ways, -weighted.T @ self.off


def seen_in(blocks: DepthBlocks, moved: Float64, depth_m: Float32, rays: PixelRays, step: int = 1) -> There:
    """Return blocks in another frame. moved: (4, 4), from the first camera's axes to the other's.

    step: every how many pixels are taken.
    """
    planes = rays.planes(blocks)
    offsets = np.arange(blocks.side)[::step]
    right, down = (each.ravel() for each in np.meshgrid(offsets, offsets))
    column, row = blocks.corner_px[:, :1] + right, blocks.corner_px[:, 1:] + down
    x, y = rays.x[row, column], rays.y[row, column]
    here = planes.astype(np.float32)
    per_m = here[:, :1] * x + here[:, 1:2] * y + here[:, 2:]
    turn, shift = moved[:3, :3].astype(np.float32), moved[:3, 3].astype(np.float32)
    far = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] + shift[2] * per_m
    ahead = np.where(far > 0.05, far, np.nan)
    u, v = rays.places(
        (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] + shift[0] * per_m) / ahead,
        (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] + shift[1] * per_m) / ahead,
    )
    inside = ((u >= 0) & (u < rays.wide_px) & (v >= 0) & (v < rays.high_px)).all(axis=1)
    rows = np.flatnonzero(inside)
    u, v = u[rows], v[rows]
    seen_m = depth_m[v, u]
    lowest, highest = seen_m.min(axis=1), seen_m.max(axis=1)
    good = (lowest > 0) & (highest - lowest < EDGE * highest)
    rows, u, v, seen_m = rows[good], u[good], v[good], seen_m[good]
    turned = planes[rows] @ moved[:3, :3].T
    plane = turned / (1 + turned @ moved[:3, 3])[:, None]
    x, y, there = rays.x[v, u], rays.y[v, u], plane.astype(np.float32)
    expected = there[:, :1] * x + there[:, 1:2] * y + there[:, 2:]
    off = 1 / seen_m - expected
    middle = np.stack([x.mean(axis=1), y.mean(axis=1), np.ones(len(rows))], axis=1).astype(np.float64)
    z = 1 / expected.mean(axis=1).astype(np.float64)
    mean = off.mean(axis=1).astype(np.float64)
    meant = np.abs(mean) < EDGE / z  # another surface hides the others
    left = np.asarray(off * ((z / blocks.z[rows]) ** 2)[:, None], np.float32)
    return There(rows[meant], left[meant], z[meant], mean[meant], plane[meant], middle[meant])


def _aligned(blocks: DepthBlocks, moved: Float64, depth_m: Float32, rays: PixelRays) -> Float64:
    """Return a motion (4, 4) that was made exact by depth itself."""
    some = blocks.evenly(ALIGNED_BLOCKS)
    prior = np.diag([TURN_RAD**-2] * 3 + [SHIFT_M**-2] * 3)
    for _ in range(ROUNDS):
        seen = seen_in(some, moved, depth_m, rays, ALIGNED_STEP)
        if len(seen.rows) < LEAST_BLOCKS:
            return moved
        normal, right = seen.equations()
        change = np.linalg.solve(normal + prior, right)
        moved = as_matrix(change) @ moved
        if np.abs(change).max() < STILL:
            break
    return moved


def as_matrix(move: Float64) -> Float64:
    """Return a rotation vector and a translation (6,) as a matrix (4, 4)."""
    import cv2

    made = np.eye(4)
    made[:3, :3], made[:3, 3] = cv2.Rodrigues(np.asarray(move[:3], np.float64))[0], move[3:]
    return made


# --- which frame ---


@dataclass(frozen=True)
class Other:
    """Another frame of the same surfaces.

    moved: (4, 4), from the first camera's axes to its own. enough: whether surfaces moved so far that noise which stays
    at its pixels was left behind.
    """

    frame: int
    depth_m: Float32
    moved: Float64
    enough: bool


class Registered:
    """Frames of a recording beside others of the same surfaces, by the camera's motion.

    late_frames: by how many frames depth is later than the colour that steps are of.
    """

    def __init__(self, footage: RecordingView, steps: Steps, late_frames: float) -> None:
        self._footage, self._late = footage, late_frames
        known = np.isfinite(steps.move).all(axis=1)
        rows = np.arange(len(steps))
        self._moves = np.stack(
            [np.interp(rows, rows[known], column[known]) if known.any() else 0.0 * rows for column in steps.move.T],
            axis=1,
        )
        self._poses = [np.eye(4)]
        for move in self._moves[:-1]:
            self._poses.append(as_matrix(move) @ self._poses[-1])
        self._row_of = {int(frame): row for row, frame in enumerate(steps.frames[:, 0])}
        self._run = steps.run
        self.rays = PixelRays(footage)

    @property
    def frames(self) -> list[int]:
        """Those that have a next one in the same run."""
        return sorted(self._row_of)

    def other(self, frame: int, blocks: DepthBlocks) -> Other | None:
        """Return another frame of a frame's blocks, in which they are elsewhere if there is such a one.

        None where there is no other.
        """
        if len(blocks) < LEAST_BLOCKS or frame not in self._row_of:
            return None
        planes = self.rays.planes(blocks)
        least_px = MOVED * self.rays.wide_px
        chosen: tuple[int, Float64] | None = None
        enough = False
        for other in (frame + lag * way for lag in LAGS for way in (1, -1)):
            moved = self.moved(frame, other)
            if moved is not None:
                chosen = other, moved
                enough = self._way_px(blocks, planes, moved) > least_px
            if enough:
                break
        if chosen is None:
            return None
        depth_m = self._footage.depth(chosen[0])
        return Other(chosen[0], depth_m, _aligned(blocks, chosen[1], depth_m, self.rays), enough)

    def after(self, frame: int, blocks: DepthBlocks, other: Other) -> Other | None:
        """Return the other frame as the one after `frame` sees it. blocks: of that one."""
        moved = self.moved(frame, frame + 1)
        if moved is None or len(blocks) < LEAST_BLOCKS:
            return None
        return replace(other, moved=_aligned(blocks, other.moved @ np.linalg.inv(moved), other.depth_m, self.rays))

    def moved(self, one: int, other: int) -> Float64 | None:
        """Return the motion (4, 4) of depth from a frame to another by colour; None where it is of no one run."""
        rows = [self._row_of.get(frame) for frame in (min(one, other), max(one, other) - 1)]
        if rows[0] is None or rows[1] is None or self._run[rows[0]] != self._run[rows[1]]:
            return None
        ends = self._pose(rows[0] - self._late), self._pose(rows[1] + 1 - self._late)
        whole = ends[1] @ np.linalg.inv(ends[0])
        return whole if one <= other else np.linalg.inv(whole)

    def _pose(self, at: float) -> Float64:
        """Return the motion (4, 4) of the world from the first step to a place between them."""
        row = int(np.clip(np.floor(at), 0, len(self._moves) - 1))
        return as_matrix((at - row) * self._moves[row]) @ self._poses[row]

    def again(self, blocks: DepthBlocks, other: Other) -> There:
        """Return blocks in the other frame, with what planes over them leave."""
        seen = seen_in(blocks, other.moved, other.depth_m, self.rays)
        terms, finds = _terms(blocks.side)
        return replace(seen, left=seen.left - (seen.left @ finds) @ terms)

    def _way_px(self, blocks: DepthBlocks, planes: Float64, moved: Float64) -> float:
        """Return by how many pixels blocks move, the median."""
        column, row = (blocks.corner_px + blocks.side // 2).T
        rays = np.stack([self.rays.x[row, column], self.rays.y[row, column], np.ones(len(blocks))], axis=1)
        seen = rays @ moved[:3, :3].T + ((planes * rays).sum(axis=1))[:, None] * moved[:3, 3]
        camera = self._footage.camera
        way = seen[:, :2] / np.maximum(seen[:, 2:], 0.05) - rays[:, :2]
        return float(np.nanmedian(np.hypot(way[:, 0] * camera.fx_px, way[:, 1] * camera.fy_px)))


def evenly(frames: Sequence[int], count: int) -> list[int]:
    """Return so many of some frames, evenly."""
    at = np.unique(np.linspace(0, len(frames) - 1, count).round().astype(int)) if frames else []
    return [frames[each] for each in at]
