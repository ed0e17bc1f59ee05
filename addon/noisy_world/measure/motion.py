# SPDX-License-Identifier: GPL-3.0-or-later
"""How images change from one frame to the next: how the camera moves by colour, what depth says of it, what stays.

Frames are looked at in runs, in their order, each once: a video and a bag are read so at their own speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import rotation_from_rotvec, rotvec_from_rotation
from ..images.measured_depth import completed_m
from .footage import Float32, Float64, Look, Points, RecordingView

Grey: TypeAlias = NDArray[np.uint8]

# Chosen, as all below: of rooms and real frames these give the least errors.
QUICK_PX, FINE_PX = 320, 640  # the width at which features are followed from frame to frame
QUICK_FEATURES, FINE_FEATURES, LEAST_FEATURES = 200, 400, 20
BACK_PX = 0.7  # how far from where it was a feature may be that is followed there and back
LEAST_KEPT = 0.25  # share of the features that have to be found again
FLAT = 0.05  # relative difference of depth in 5 x 5 pixels, more of which is an edge
ITERATIONS, ALREADY = 8, 1e-6  # of Gauss and Newton's method; radians, or units of depth, that change nothing
TUKEY = 4.7  # standard deviations from which on something counts nothing (Tukey's, 95 % efficient)
LEAST_PX = 0.1  # standard deviation of where a feature is found
NEAREST = 0.05  # times its depth: a point does not come nearer
RANSAC_PX = 1.0

# Of depth's own motion: images of inverse depth, so wide; relative to it, slopes, bends and changes that are edges.
TINY_PX = 80
SLOPE, BEND, CHANGE = 0.08, 0.03, 0.15
MEASURED = 0.7  # share of what a pixel is the mean of that has to be measured
LEAST_PIXELS = 200
REWEIGHTED = 4  # times
LEAST_SPREAD = 1e-7  # relative


@dataclass(frozen=True)
class Steps:
    """What happened between neighbours in runs of frames, M steps.

    frames: (M, 2) their numbers. run: (M,) the run that a step is of. move: (M, 6) by colour: rotation vector and
    translation of the world in the camera's axes, radians and units of depth; NaN where it cannot be told, and for
    translation without depth. normal, right: (M, 6, 6) and (M, 6) of the normal equations of such a motion by depth
    alone; 0 where it says nothing. same, same_depth: (M,) whether images are equal, pixel by pixel. change: (M,) mean
    absolute difference of grey levels. void: by frame, the share of pixels that have no depth. followed: what a move
    was told by; None where it was not.
    """

    frames: NDArray[np.int64]
    run: NDArray[np.int64]
    move: Float64
    normal: Float64
    right: Float64
    same: NDArray[np.bool_]
    same_depth: NDArray[np.bool_]
    change: Float64
    void: dict[int, float]
    followed: "tuple[Followed | None, ...]" = ()

    def __len__(self) -> int:
        return len(self.frames)


@dataclass(frozen=True)
class Followed:
    """N features of a step, in both frames.

    here, there: (N, 2) on the plane at 1. inverse: (N,) of their depth in the first frame, 1/m; None where it is not
    known. places: (2, N, 2) where they are in either image, of its width and height, from -1/2 to 1/2. focal_px: of the
    images in which they were followed.
    """

    here: Float64
    there: Float64
    inverse: Float64 | None
    places: Float64
    focal_px: float


@dataclass(frozen=True)
class _Step:
    frames: tuple[int, int]
    run: int
    move: Float64
    normal: Float64
    right: Float64
    same: bool
    same_depth: bool
    change: float
    followed: Followed | None


@dataclass(frozen=True)
class _Seen:
    """A frame at the sizes at which motion is measured. filled_m: depth completed; None without depth."""

    look: Look
    grey: Grey
    filled_m: Float32 | None
    inverse: "Inverse | None"


def steps_of(footage: RecordingView, runs: Sequence[range], *, fine: bool = False, depth_later: int = 0) -> Steps:
    """Return what happens in runs of frames.

    fine: whether the camera's turns are wanted as exactly as they can be had. depth_later: depth is taken from so many
    frames later.

    Raises InputError where a frame's files are damaged.
    """
    depth_flow = DepthFlow(footage) if footage.has_depth else None
    widest_px, features = (FINE_PX, FINE_FEATURES) if fine else (QUICK_PX, QUICK_FEATURES)
    steps: list[_Step] = []
    void: dict[int, float] = {}
    for number, run in enumerate(runs):
        before: _Seen | None = None
        for frame in range(max(run.start, -depth_later), min(run.stop, len(footage) - depth_later)):
            look = footage.look(frame)
            if depth_later:
                look = replace(look, depth_m=footage.look(frame + depth_later).depth_m)
            now = _seen(look, depth_flow, widest_px)
            if now.look.depth_m is not None:
                void[frame] = float(np.mean(now.look.depth_m <= 0))
            if before is not None:
                steps.append(_step(footage, number, (frame - 1, before), (frame, now), (depth_flow, features)))
            before = now
    return Steps(
        np.array([step.frames for step in steps], np.int64).reshape(-1, 2),
        np.array([step.run for step in steps], np.int64),
        np.array([step.move for step in steps]).reshape(-1, 6),
        np.array([step.normal for step in steps]).reshape(-1, 6, 6),
        np.array([step.right for step in steps]).reshape(-1, 6),
        np.array([step.same for step in steps], np.bool_),
        np.array([step.same_depth for step in steps], np.bool_),
        np.array([step.change for step in steps], np.float64),
        void,
        tuple(step.followed for step in steps),
    )


def _seen(look: Look, depth_flow: "DepthFlow | None", widest_px: int) -> _Seen:
    import cv2

    height_px, width_px = look.grey.shape
    size_px = min(widest_px, width_px), max(1, round(height_px * min(1.0, widest_px / width_px)))
    grey = look.grey if width_px <= widest_px else cv2.resize(look.grey, size_px, interpolation=cv2.INTER_AREA)
    if look.depth_m is None or depth_flow is None:
        return _Seen(look, np.asarray(grey, np.uint8), None, None)
    small_m = np.asarray(cv2.resize(look.depth_m, size_px, interpolation=cv2.INTER_NEAREST), np.float32)
    return _Seen(look, np.asarray(grey, np.uint8), completed_m(small_m), depth_flow.inverse(look.depth_m))


def _step(
    footage: RecordingView,
    run: int,
    first: tuple[int, _Seen],
    second: tuple[int, _Seen],
    how: tuple["DepthFlow | None", int],
) -> _Step:
    """Return what happened between two frames. how: what depth is worked on by, and how many features are wanted."""
    import cv2

    (number, one), (other_number, other), (depth_flow, features) = first, second, how
    change = float(np.mean(np.asarray(cv2.absdiff(one.grey, other.grey))))
    same = change == 0 and bool(np.array_equal(one.look.whole, other.look.whole))
    depths = one.look.depth_m, other.look.depth_m
    same_depth = depths[0] is not None and depths[1] is not None and bool(np.array_equal(*depths))
    move, told_by = np.full(6, np.nan), None
    if (found := followed(one.grey, other.grey, features)) is not None:
        move, told_by = _moved(footage, one, found)
    normal, right = np.zeros((6, 6)), np.zeros(6)
    if depth_flow is not None and one.inverse is not None and other.inverse is not None:
        normal, right = depth_flow.equations(one.inverse, other.inverse)
    return _Step((number, other_number), run, move, normal, right, same, same_depth, change, told_by)


def beside(same: NDArray[np.bool_], run: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return the steps (M,) into a doubled frame and out of it: one shows no motion, the other that of two."""
    out = np.concatenate([[False], same[:-1] & (run[1:] == run[:-1])]) if len(same) else same
    return same | out


# --- the camera's motion by colour ---


def followed(one: Grey, other: Grey, count: int) -> tuple[Points, Points] | None:
    """Return features of an image, so many at most, and where they are in another; None where they are few.

    As Lucas and Kanade (1981) follow them, there and back.
    """
    import cv2

    found = cv2.goodFeaturesToTrack(one, count, 0.01, max(one.shape[1] / (2.5 * count**0.5), 3))
    if found is None or len(found) < LEAST_FEATURES:
        return None
    points = np.asarray(found, np.float32).reshape(-1, 2)
    there, good, _ = cv2.calcOpticalFlowPyrLK(one, other, points, points.copy(), winSize=(15, 15), maxLevel=3)
    back, again, _ = cv2.calcOpticalFlowPyrLK(other, one, there, points.copy(), winSize=(15, 15), maxLevel=3)
    near = np.linalg.norm(np.asarray(back) - points, axis=1) < BACK_PX
    kept = (np.asarray(good).ravel() > 0) & (np.asarray(again).ravel() > 0) & near
    if kept.sum() < max(LEAST_FEATURES, LEAST_KEPT * len(points)):
        return None
    return points[kept], np.asarray(there, np.float32)[kept]


def _moved(footage: RecordingView, one: _Seen, found: tuple[Points, Points]) -> tuple[Float64, Followed | None]:
    """Return the motion (6,) of a step, and what it is told by; NaN and None where it cannot be told."""
    high, wide = one.grey.shape
    places = (np.stack(found).astype(np.float64) + 0.5) / (wide, high) - 0.5
    times = footage.camera.width_px / one.grey.shape[1]
    here, there = (footage.plane(((points + 0.5) * times - 0.5).astype(np.float32)) for points in found)
    seen = np.isfinite(here).all(axis=1) & np.isfinite(there).all(axis=1)
    focal_px = footage.focal_px / times
    if one.filled_m is not None:
        at = found[0].round().astype(int)
        known = seen & _flat(one.filled_m)[at[:, 1], at[:, 0]]
        if known.sum() >= LEAST_FEATURES:
            inverse = 1 / one.filled_m[at[known, 1], at[known, 0]].astype(np.float64)
            told_by = Followed(here[known], there[known], inverse, places[:, known], focal_px)
            return moved_by(told_by.here, told_by.there, inverse, focal_px), told_by
    move = np.full(6, np.nan)
    if seen.sum() < LEAST_FEATURES:
        return move, None
    move[:3] = _turned(here[seen], there[seen], focal_px)
    return move, Followed(here[seen], there[seen], None, places[:, seen], focal_px)


def _flat(depth_m: Float32) -> NDArray[np.bool_]:
    """Return where depth (H, W) is known and has no edge, (H, W)."""
    import cv2

    square = np.ones((5, 5), np.uint8)
    lowest, highest = cv2.erode(depth_m, square), cv2.dilate(depth_m, square)
    return np.asarray((lowest > 0) & (highest < (1 + FLAT) * lowest), np.bool_)


def moved_by(here: Float64, there: Float64, inverse: Float64, focal_px: float) -> Float64:
    """Return rotation vector and translation (6,) of points on the plane at 1 (N, 2), by their inverse depth (N,).

    By Gauss and Newton's method with Tukey's weights. What moves is the world in the camera's axes.
    """
    rays = np.concatenate([here, np.ones((len(here), 1))], axis=1)
    found = np.zeros(6)
    for step in range(ITERATIONS):
        turned = rays @ rotation_from_rotvec(found[:3]).T
        seen = turned + inverse[:, None] * found[3:]
        at, slopes = projected(turned, inverse, seen)
        off_px = focal_px * (there - at)
        weight = tukey(np.hypot(off_px[:, 0], off_px[:, 1]), LEAST_PX) if step else np.ones(len(at))
        slopes = focal_px * slopes.reshape(-1, 6)
        weighted = slopes * np.repeat(weight, 2)[:, None]
        normal = weighted.T @ slopes + np.diag([1e-9] * 3 + [1e-6] * 3)
        change = np.linalg.solve(normal, weighted.T @ off_px.ravel())
        turned_so = rotation_from_rotvec(change[:3]) @ rotation_from_rotvec(found[:3])
        found = np.concatenate([rotvec_from_rotation(turned_so), found[3:] + change[3:]])
        if np.abs(change).max() < ALREADY:
            break
    return found


def projected(turned: Float64, inverse: Float64, seen: Float64) -> tuple[Float64, Float64]:
    """Return where points are on the plane at 1 (N, 2), and how that changes with a motion (N, 2, 6).

    turned: (N, 3) rays after the rotation. inverse: (N,) of their depth. seen: (N, 3) rays after the whole motion.
    """
    z = np.maximum(seen[:, 2], NEAREST)
    x, y = seen[:, 0] / z, seen[:, 1] / z
    a, b, c = turned.T
    slopes = np.zeros((len(z), 2, 6))
    slopes[:, 0, 0], slopes[:, 0, 1], slopes[:, 0, 2] = -x * b, c + x * a, -b
    slopes[:, 1, 0], slopes[:, 1, 1], slopes[:, 1, 2] = -c - y * b, y * a, a
    slopes[:, 0, 3] = slopes[:, 1, 4] = inverse
    slopes[:, 0, 5], slopes[:, 1, 5] = -x * inverse, -y * inverse
    return np.stack([x, y], axis=1), slopes / z[:, None, None]


def tukey(distance: Float64, least: float) -> Float64:
    """Return Tukey's weights of distances (N,); least: their standard deviation at least."""
    spread = max(1.4826 * float(np.median(np.abs(distance))), least)
    return np.clip(1 - (distance / (TUKEY * spread)) ** 2, 0, None) ** 2


def _turned(here: Float64, there: Float64, focal_px: float) -> Float64:
    """Return the rotation vector of points (N, 2) on the plane at 1, whose depth is not known; NaN where none fits."""
    import cv2

    matrix, inside = cv2.findEssentialMat(here, there, np.eye(3), cv2.RANSAC, 0.999, RANSAC_PX / focal_px)
    if matrix is None or np.shape(matrix) != (3, 3):
        return np.full(3, np.nan)
    _, turned, _, _ = cv2.recoverPose(matrix, here, there, np.eye(3), mask=inside)
    return rotvec_from_rotation(np.asarray(turned, np.float64))


# --- what depth alone says of the motion ---


@dataclass(frozen=True)
class Inverse:
    """A small image of inverse depth (H, W), and where it is known, (H, W)."""

    per_m: Float64
    known: NDArray[np.bool_]


class DepthFlow:
    """The range flow of depth images: how their change constrains the camera's motion (Spies, Jaehne, Barron, 2002).

    In inverse depth, in which planes are linear and a disparity's noise is even. Edges are left out.
    """

    def __init__(self, footage: RecordingView) -> None:
        wide_px, high_px = footage.size_px
        self._size_px = min(TINY_PX, wide_px), max(2, round(high_px * min(1.0, TINY_PX / wide_px)))
        times = wide_px / self._size_px[0]
        v, u = np.mgrid[: self._size_px[1], : self._size_px[0]]
        places = np.stack([(u.ravel() + 0.5) * times - 0.5, (v.ravel() + 0.5) * times - 0.5], axis=1)
        plane = np.nan_to_num(footage.plane(places.astype(np.float32)))
        x, y = (plane[:, axis].reshape(u.shape) for axis in (0, 1))
        (x_v, x_u), (y_v, y_u) = _slopes(x), _slopes(y)
        area = x_u * y_v - x_v * y_u
        area = np.where(np.abs(area) < 1e-12, np.inf, area)
        self._slopes = y_v / area, -y_u / area, -x_v / area, x_u / area
        zero, one = np.zeros_like(x), np.ones_like(x)
        self._turns = (
            np.stack([zero, one, -y], axis=-1),
            np.stack([-one, zero, x], axis=-1),
            np.stack([y, -x, zero], axis=-1),
        )
        self._plane = x[..., None], y[..., None]

    def inverse(self, depth_m: Float32) -> Inverse:
        """Return depth (H, W) as a small image of its inverse."""
        import cv2

        known = depth_m > 0
        per_m = np.divide(1, depth_m, out=np.zeros_like(depth_m), where=known)
        share, mean = (
            np.asarray(
                cv2.GaussianBlur(cv2.resize(image, self._size_px, interpolation=cv2.INTER_AREA), (3, 3), 0), np.float64
            )
            for image in (known.astype(np.float32), per_m)
        )
        return Inverse(np.where(share > 0.1, mean / np.maximum(share, 0.1), 0), share > MEASURED)

    def equations(self, one: Inverse, other: Inverse) -> tuple[Float64, Float64]:
        """Return the normal equations of the motion from one image to another: (6, 6) and (6,), in the noise's units.

        Both are 0 where too little is seen.
        """
        import cv2

        mean, change = (one.per_m + other.per_m) / 2, other.per_m - one.per_m
        down, right = _slopes(mean)
        bend = np.abs(_slopes(right)[1]) + np.abs(_slopes(down)[0])
        good = one.known & other.known & (np.hypot(right, down) < SLOPE * mean)
        good &= (bend < BEND * mean) & (np.abs(change) < CHANGE * mean)
        square = np.ones((3, 3), np.uint8)
        good = np.asarray(cv2.erode(np.pad(good, 1).astype(np.uint8), square))[1:-1, 1:-1] > 0
        if good.sum() < LEAST_PIXELS * mean.size / 4800:
            return np.zeros((6, 6)), np.zeros(6)
        a, b, c, d = (slope[good] for slope in self._slopes)
        across, along = (a * right[good] + b * down[good])[:, None], (c * right[good] + d * down[good])[:, None]
        x, y = (plane[good] for plane in self._plane)
        of_x, of_y, of_z = (turns[good] for turns in self._turns)
        per_m = mean[good][:, None]
        # What a rotation does to inverse depth at a pixel, and what a translation does.
        turn = across * (of_x - x * of_z) + along * (of_y - y * of_z) + per_m * of_z
        shift = per_m * np.concatenate([across, along, per_m - across * x - along * y], axis=1)
        rows = np.concatenate([turn, shift], axis=1) / per_m
        off = -change[good] / per_m[:, 0]
        weight = np.ones(len(off))
        normal, side, spread = np.eye(6), np.zeros(6), 1.0
        for _ in range(REWEIGHTED):
            weighted = rows * weight[:, None]
            normal, side = weighted.T @ rows + 1e-9 * np.eye(6), weighted.T @ off
            left = off - rows @ np.linalg.solve(normal, side)
            spread = 1.4826 * float(np.median(np.abs(left))) + LEAST_SPREAD
            weight = tukey(left, LEAST_SPREAD)
        return normal / spread**2, side / spread**2


def _slopes(image: Float64) -> tuple[Float64, Float64]:
    """Return the derivatives of an image (H, W) down and across, (H, W) each."""
    down, across = np.gradient(image)
    return np.asarray(down, np.float64), np.asarray(across, np.float64)
