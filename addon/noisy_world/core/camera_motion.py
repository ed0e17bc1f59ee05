# SPDX-License-Identifier: GPL-3.0-or-later
"""How a camera moves: at one frame, relative to the air, and by deviations from its path."""

import math
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .curve import BodyMotion, Curve, angular_motion, motion_of
from .geometry import pose, rotation_from_rotvec, rotvec_from_rotation

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
