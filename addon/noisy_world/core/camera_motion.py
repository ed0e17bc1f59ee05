# SPDX-License-Identifier: GPL-3.0-or-later
"""How a camera moves: at a frame, through the air, away from its path; and how far what it sees goes on its image."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .curve import BodyMotion, Curve, angular_motion, motion_of
from .geometry import Intrinsics, pose, rotation_from_rotvec, rotvec_from_rotation
from .lens import Distortion, lens_rays, projected

Float64: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """Where a camera is, and how it got there.

    first_c2w, c2w: (4, 4), of the sequence's first frame and of this one, OpenCV's axes, metres. velocity_m_s: (3,), in
    the world. turning_rad_s: (3,), in the camera's axes. Both are means since the frame before; 0 at the first.
    """

    first_c2w: Float64
    c2w: Float64
    velocity_m_s: Float64
    turning_rad_s: Float64

    @property
    def key(self) -> bytes:
        """What is equal for equal motions."""
        return b"".join(part.tobytes() for part in (self.first_c2w, self.c2w, self.velocity_m_s, self.turning_rad_s))


def motion_between(first_c2w: Float64, before_c2w: Float64, c2w: Float64, seconds: float) -> CameraMotion:
    """Return the motion at a pose, `seconds` after the one before it; at rest for 0 seconds.

    Only earlier poses count, so that a path that goes on changes no frame that is there.
    """
    if seconds == 0:
        return CameraMotion(first_c2w, c2w, np.zeros(3), np.zeros(3))
    turned_rad = rotvec_from_rotation(before_c2w[:3, :3].T @ c2w[:3, :3])
    return CameraMotion(first_c2w, c2w, (c2w[:3, 3] - before_c2w[:3, 3]) / seconds, turned_rad / seconds)


# A camera's pose and velocity relative to the air of its sequence, for weather.
#
# The air's axes are right, down and forward of the sequence's first image, made level; it begins at the first camera.


@dataclass(frozen=True, eq=False)
class CameraState:
    """How a camera stands and moves.

    rotation: (3, 3), camera to air. position_m, velocity_m_s: (3,), of the air. turning_rad_s: (3,), the camera's axes.
    """

    rotation: Float64
    position_m: Float64
    velocity_m_s: Float64
    turning_rad_s: Float64

    def as_blender(self) -> tuple[tuple[float, float, float], ...]:
        """Return location, rotation (XYZ Euler angles, radians), velocity and turning as of an object in Blender.

        There x is right, y forward and z up, and a camera's own axes are right, up and back.
        """
        turned = _WORLD @ self.rotation @ _OWN
        vectors = _WORLD @ self.position_m, _euler_rad(turned), _WORLD @ self.velocity_m_s, _OWN @ self.turning_rad_s
        found = [tuple(float(value) for value in vector) for vector in vectors]
        return tuple((x, y, z) for x, y, z in found)


_WORLD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
_OWN = np.diag([1.0, -1.0, -1.0])
AT_REST = CameraState(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))
_UPRIGHT = 1e-9  # nearer to a turn about y by a quarter, x and z turn about the same axis


def _euler_rad(rotation: Float64) -> Float64:
    """Return angles about x, y and z, in this order, of a rotation (3, 3)."""
    flat = math.hypot(rotation[0, 0], rotation[1, 0])
    y = math.atan2(-rotation[2, 0], flat)
    if flat < _UPRIGHT:
        return np.array([math.atan2(-rotation[1, 2], rotation[1, 1]), y, 0.0])
    return np.array([math.atan2(rotation[2, 1], rotation[2, 2]), y, math.atan2(rotation[1, 0], rotation[0, 0])])


def camera_state_of(motion: CameraMotion | None) -> CameraState:
    """Return how a camera stands in the air; level and at rest where its path is unknown."""
    if motion is None:
        return AT_REST
    axes = level_axes(motion.first_c2w[:3, :3])
    position_m = axes.T @ (motion.c2w[:3, 3] - motion.first_c2w[:3, 3])
    return CameraState(axes.T @ motion.c2w[:3, :3], position_m, axes.T @ motion.velocity_m_s, motion.turning_rad_s)


def level_axes(rotation: Float64) -> Float64:
    """Return (3, 3): the directions right, down and forward in the world, as columns, of a camera to world rotation.

    Down is the world's axis that is nearest to down in the image; right is the image's, made level.
    """
    nearest = int(np.abs(rotation[:, 1]).argmax())
    down = np.zeros(3)
    down[nearest] = np.sign(rotation[nearest, 1])
    right = rotation[:, 0] - down * (down @ rotation[:, 0])
    right /= np.linalg.norm(right)
    return np.column_stack([right, down, np.cross(right, down)])


# Deviations of a body from its path that are smooth in time: sums of sines, and single pulses.


Derivatives: TypeAlias = tuple[Float64, Float64, Float64]
"""Values (N, 3) with their first and second derivatives."""


class Signal(Protocol):
    """Three numbers at any time."""

    def at(self, passed_s: Float64) -> Derivatives:
        """(N,) seconds -> the numbers then, and how they change."""
        ...


@dataclass(frozen=True, eq=False)
class Sines:
    """Sums of sines. angular_hz: (3, K) rad/s. amplitude, phase: (3, K). Powers add up: amplitude^2 / 2 of each."""

    angular_hz: Float64
    amplitude: Float64
    phase: Float64

    def at(self, passed_s: Float64) -> Derivatives:
        """(N,) seconds -> the sums then, and how they change."""
        value, first, second = (np.zeros((len(passed_s), 3)) for _ in range(3))
        for angular, amplitude, phase in zip(self.angular_hz.T, self.amplitude.T, self.phase.T, strict=True):
            turned = passed_s[:, None] * angular + phase
            sine, cosine = amplitude * np.sin(turned), amplitude * np.cos(turned)
            value += sine
            first += angular * cosine
            second -= angular**2 * sine
        return value, first, second


@dataclass(frozen=True, eq=False)
class Pulses:
    """Single pulses peak (1 - u^2)^4 with u the time from their middle, in half lengths; 0 from u = 1 on.

    middle_s: (M,) increasing. half_s: half their length. peak: (M, 3). Three derivatives are continuous.
    """

    middle_s: Float64
    half_s: float
    peak: Float64

    def at(self, passed_s: Float64) -> Derivatives:
        """(N,) seconds -> the sum of the pulses then, and how it changes."""
        value, first, second = (np.zeros((len(passed_s), 3)) for _ in range(3))
        order = np.argsort(passed_s, kind="stable")
        sorted_s = passed_s[order]
        begins = np.searchsorted(sorted_s, self.middle_s - self.half_s)
        ends = np.searchsorted(sorted_s, self.middle_s + self.half_s)
        for number in np.flatnonzero(ends > begins):
            rows, middle_s, peak = order[begins[number] : ends[number]], self.middle_s[number], self.peak[number]
            u = (passed_s[rows, None] - middle_s) / self.half_s
            left = 1.0 - u**2
            value[rows] += peak * left**4
            first[rows] += peak * (-8.0 * u * left**3) / self.half_s
            second[rows] += peak * (48.0 * u**2 * left**2 - 8.0 * left**3) / self.half_s**2
        return value, first, second


@dataclass(frozen=True, eq=False)
class DeviatingCurve:
    """A curve whose body deviates: its pose, times the deviation's translation and turn in the body's own axes.

    origin_s: the signals' time 0. translation_m: metres. turn: rotation vectors, rad.
    """

    curve: Curve
    origin_s: float
    translation_m: Signal
    turn: Signal

    def deviation_at(self, times_s: ArrayLike) -> Float64:
        """(...) seconds -> (..., 4, 4): the deviated body's pose in the frame of the body that does not deviate."""
        asked = np.asarray(times_s, dtype=np.float64)
        passed_s = asked.ravel() - self.origin_s
        turn, translation_m = self.turn.at(passed_s)[0], self.translation_m.at(passed_s)[0]
        return pose(rotation_from_rotvec(turn), translation_m).reshape(*asked.shape, 4, 4)

    def pose_at(self, times_s: ArrayLike) -> Float64:
        """(...) seconds -> (..., 4, 4)."""
        return self.curve.pose_at(times_s) @ self.deviation_at(times_s)

    def motion_at(self, times_s: Float64) -> BodyMotion:
        """(N,) seconds -> the deviated body's motion then."""
        passed_s = times_s - self.origin_s
        moved = motion_of(self.curve, times_s).displaced(*self.translation_m.at(passed_s))
        turn, turn_rate, turn_change = self.turn.at(passed_s)
        return moved.turned(rotation_from_rotvec(turn), *angular_motion(turn, turn_rate, turn_change))


# How far what a camera sees goes on its image while the camera moves.


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
