# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera's path in continuous time: a pose at any moment, through the poses of a trajectory exactly.

A camera's path in continuous time: a pose at any moment, through the poses of a trajectory exactly.

Positions are natural cubic splines over the stamps, rotations their counterpart (rotation_spline). So both have two
continuous derivatives, which an IMU needs, at any rate of the stamps, and before the first pose and after the last one
the path goes on as fast as there.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import NoisyWorldError
from .geometry import pose, rotation_from_rotvec, rotvec_from_rotation

# How a body moves at some times: its pose with the first and second derivatives, and those of what it carries.


Float64: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """A body's motion at N times.

    rotation: (N, 3, 3) world from body. position_m, velocity_m_s, acceleration_m_s2: (N, 3) in the world's axes.
    rate_rad_s, angular_acceleration_rad_s2: (N, 3) angular velocity and its derivative in the body's own axes.
    """

    rotation: Float64
    position_m: Float64
    velocity_m_s: Float64
    acceleration_m_s2: Float64
    rate_rad_s: Float64
    angular_acceleration_rad_s2: Float64

    def carried(self, body_from_sensor: Float64) -> "BodyMotion":
        """Return the motion of what is fixed to the body at a pose (4, 4), in its own axes.

        The lever arm l adds w x l to the velocity, and a x l + w x (w x l) to the acceleration.
        """
        turn, arm_m = body_from_sensor[:3, :3], body_from_sensor[:3, 3]
        swing_m_s = np.cross(self.rate_rad_s, arm_m)
        pull_m_s2 = np.cross(self.angular_acceleration_rad_s2, arm_m) + np.cross(self.rate_rad_s, swing_m_s)
        return BodyMotion(
            self.rotation @ turn,
            self.position_m + self.rotation @ arm_m,
            self.velocity_m_s + _turned(self.rotation, swing_m_s),
            self.acceleration_m_s2 + _turned(self.rotation, pull_m_s2),
            self.rate_rad_s @ turn,
            self.angular_acceleration_rad_s2 @ turn,
        )

    def displaced(self, arm_m: Float64, speed_m_s: Float64, change_m_s2: Float64) -> "BodyMotion":
        """Return the motion of a body of the same axes at a place (N, 3) in them that moves: with two derivatives."""
        swing_m_s = np.cross(self.rate_rad_s, arm_m) + speed_m_s
        pull_m_s2 = np.cross(self.angular_acceleration_rad_s2, arm_m) + change_m_s2
        pull_m_s2 += np.cross(self.rate_rad_s, swing_m_s + speed_m_s)
        return replace(
            self,
            position_m=self.position_m + _turned(self.rotation, arm_m),
            velocity_m_s=self.velocity_m_s + _turned(self.rotation, swing_m_s),
            acceleration_m_s2=self.acceleration_m_s2 + _turned(self.rotation, pull_m_s2),
        )

    def turned(self, by: Float64, rate_rad_s: Float64, change_rad_s2: Float64) -> "BodyMotion":
        """Return the motion of a body at the same place, turned by rotations (N, 3, 3) that change.

        rate_rad_s, change_rad_s2: (N, 3) their angular velocity and acceleration, in the turned axes.
        """
        back = by.swapaxes(-1, -2)
        carried = _turned(back, self.rate_rad_s)
        carried_change = _turned(back, self.angular_acceleration_rad_s2) - np.cross(rate_rad_s, carried)
        return replace(
            self,
            rotation=self.rotation @ by,
            rate_rad_s=carried + rate_rad_s,
            angular_acceleration_rad_s2=carried_change + change_rad_s2,
        )

    def sped(self, speed: Float64, speeding: Float64) -> "BodyMotion":
        """Return the motion along the same path by another clock: speed, speeding (N,) are its two derivatives."""
        by, squared, more = speed[:, None], speed[:, None] ** 2, speeding[:, None]
        return BodyMotion(
            self.rotation,
            self.position_m,
            self.velocity_m_s * by,
            self.acceleration_m_s2 * squared + self.velocity_m_s * more,
            self.rate_rad_s * by,
            self.angular_acceleration_rad_s2 * squared + self.rate_rad_s * more,
        )

    def felt(self, gravity_m_s2: float) -> tuple[Float64, Float64]:
        """Return angular velocity (N, 3), rad/s, and specific force (N, 3), m/s^2, in the body's axes; world z up."""
        force = self.acceleration_m_s2 + np.array([0.0, 0.0, gravity_m_s2])
        return self.rate_rad_s, _turned(self.rotation.swapaxes(-1, -2), force)


def _turned(rotation: Float64, vectors: Float64) -> Float64:
    """(N, 3, 3), (N, 3) -> (N, 3)."""
    return (rotation @ vectors[..., None])[..., 0]


# A smooth rotation through given ones: angular velocity and acceleration are continuous, and a steady turn is exact.
#
# In each interval the rotation vector from the interval's first rotation is a cubic of time. The angular velocities at
# the knots are chosen so that the angular acceleration has no jump, and is 0 at both ends; since turns do not commute,
# what they have to satisfy is a little more than linear, and is solved by iteration. The kinematics of rotation vectors
# are Shuster's, A Survey of Attitude Representations (1993), equations 279 to 285.


MOST_ITERATIONS = 30
TOLERANCE = 1e-12  # of the angular velocities, relative to the largest; each iteration gains a digit or more


@dataclass(frozen=True, eq=False)
class RotationSpline:
    """The spline through rotations (N, 3, 3) at knots (N,), which increase; N >= 1.

    Neighbours are joined the shorter way round. Beyond the ends the turn goes on as fast as there.
    """

    knots: Float64
    rotations: Float64

    @cached_property
    def _turns(self) -> Float64:
        """(N - 1, 3): the rotation vector from each knot to the next."""
        return rotvec_from_rotation(self.rotations[:-1].swapaxes(-1, -2) @ self.rotations[1:])

    @cached_property
    def _rates(self) -> Float64:
        """(N, 3): the angular velocity at each knot, in the axes of its own rotation, rad a unit of the knots."""
        count = len(self.knots)
        if count == 1:
            return np.zeros((1, 3))
        gaps, turns = np.diff(self.knots)[:, None], self._turns
        to_rate, from_rate = _rate_from_rotvec_rate(turns), _rotvec_rate_from_rate(turns)
        inverse = 1.0 / gaps[:, :, None]
        ends = np.concatenate([inverse[:1], inverse[1:] + inverse[:-1], inverse[-1:]])
        solve = _block_solver(2.0 * inverse * to_rate, 4.0 * ends * np.eye(3), 2.0 * inverse * from_rate)
        pushes = 6.0 * turns / gaps**2
        right = np.zeros((count, 3))
        right[:-1] += pushes
        right[1:] += pushes
        rates = solve(right)
        for _ in range(MOST_ITERATIONS):
            bent = right.copy()
            bent[1:] -= _bending(turns, (from_rate @ rates[1:, :, None])[..., 0])
            before, rates = rates, solve(bent)
            if np.abs(rates - before).max() <= TOLERANCE * np.abs(rates).max():
                break
        return rates

    def at(self, times: ArrayLike) -> Float64:
        """(...) -> (..., 3, 3)."""
        asked = np.asarray(times, dtype=np.float64)
        t, last = asked.ravel(), len(self.knots) - 1
        if last == 0:
            return np.broadcast_to(self.rotations[0], (*asked.shape, 3, 3)).copy()
        inside, left, gap, (begin, square, cube) = self._pieces(t)
        u = (inside - self.knots[left])[:, None] / gap
        rotvec = u * (begin + u * (square + u * cube))
        beyond = (t - inside)[:, None] * np.where((t < inside)[:, None], self._rates[0], self._rates[-1])
        found = self.rotations[left] @ rotation_from_rotvec(rotvec) @ rotation_from_rotvec(beyond)
        return found.reshape(*asked.shape, 3, 3)

    def rates_at(self, times: Float64) -> tuple[Float64, Float64]:
        """(N,) -> the angular velocity (N, 3), rad a unit of the knots, in the turned axes, and its derivative."""
        if len(self.knots) == 1:
            return np.zeros((len(times), 3)), np.zeros((len(times), 3))
        inside, left, gap, (begin, square, cube) = self._pieces(times)
        u = (inside - self.knots[left])[:, None] / gap
        rotvec = u * (begin + u * (square + u * cube))
        first = (begin + u * (2.0 * square + u * 3.0 * cube)) / gap
        second = (2.0 * square + u * 6.0 * cube) / gap**2
        rate, change = angular_motion(rotvec, first, second)
        return rate, np.where((times == inside)[:, None], change, 0.0)

    def _pieces(self, t: Float64) -> tuple[Float64, NDArray[np.intp], Float64, tuple[Float64, ...]]:
        """Return times (N,) inside the knots, the knot before, the gap (N, 1), and the cubic's coefficients (N, 3)."""
        inside = np.clip(t, self.knots[0], self.knots[-1])
        left = np.clip(np.searchsorted(self.knots, inside, side="right") - 1, 0, len(self.knots) - 2)
        gap = (self.knots[left + 1] - self.knots[left])[:, None]
        turn = self._turns[left]
        begin = gap * self._rates[left]
        end = gap * (_rotvec_rate_from_rate(turn) @ self._rates[left + 1][..., None])[..., 0]
        return inside, left, gap, (begin, 3.0 * turn - 2.0 * begin - end, begin + end - 2.0 * turn)


def angular_motion(rotvec: Float64, first: Float64, second: Float64) -> tuple[Float64, Float64]:
    """Return angular velocity and acceleration (N, 3), in the turned axes, of a rotation vector and its derivatives."""
    to_rate = _rate_from_rotvec_rate(rotvec)
    rate = (to_rate @ first[..., None])[..., 0]
    return rate, (to_rate @ second[..., None])[..., 0] + _bending(rotvec, first)


def _cross_matrix(vectors: Float64) -> Float64:
    """(..., 3) -> (..., 3, 3): what multiplies as the cross product from the left does."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _by_angle(rotvec: Float64, exact: Callable[[Float64], Float64], small: tuple[float, float]) -> Float64:
    """Return (..., 1) a function of the angle, by the first two terms of its series in the angle's square near 0."""
    angle = np.linalg.norm(rotvec, axis=-1, keepdims=True)
    near = angle < 0.03  # where the exact form has lost as many digits as the series lacks
    return np.where(near, small[0] + small[1] * angle**2, exact(np.where(near, 1.0, angle)))


def _rate_from_rotvec_rate(rotvec: Float64) -> Float64:
    """(..., 3) -> (..., 3, 3): angular velocity, in the turned axes, of a rotation vector's derivative."""
    cross = _cross_matrix(rotvec)
    first = _by_angle(rotvec, lambda a: (1.0 - np.cos(a)) / a**2, (1 / 2, -1 / 24))[..., None]
    second = _by_angle(rotvec, lambda a: (a - np.sin(a)) / a**3, (1 / 6, -1 / 120))[..., None]
    return np.eye(3) - first * cross + second * cross @ cross


def _rotvec_rate_from_rate(rotvec: Float64) -> Float64:
    """(..., 3) -> (..., 3, 3): a rotation vector's derivative of the angular velocity, in the turned axes."""
    cross = _cross_matrix(rotvec)
    second = _by_angle(rotvec, lambda a: (1.0 - 0.5 * a / np.tan(0.5 * a)) / a**2, (1 / 12, 1 / 720))[..., None]
    return np.eye(3) + 0.5 * cross + second * cross @ cross


def _bending(rotvec: Float64, rotvec_rate: Float64) -> Float64:
    """(..., 3), (..., 3) -> (..., 3): the angular acceleration that a constant derivative of a rotation vector has."""
    cross = np.cross(rotvec, rotvec_rate)
    first = _by_angle(rotvec, lambda a: (2.0 - a * np.sin(a) - 2.0 * np.cos(a)) / a**4, (1 / 12, -1 / 180))
    second = _by_angle(rotvec, lambda a: (3.0 * np.sin(a) - a * np.cos(a) - 2.0 * a) / a**5, (-1 / 60, 1 / 1260))
    third = _by_angle(rotvec, lambda a: (a - np.sin(a)) / a**3, (1 / 6, -1 / 120))
    along = np.sum(rotvec * rotvec_rate, axis=-1, keepdims=True)
    return along * (first * cross + second * np.cross(rotvec, cross)) + third * np.cross(rotvec_rate, cross)


def _block_solver(below: Float64, middle: Float64, above: Float64) -> Callable[[Float64], Float64]:
    """Return what solves a block tridiagonal system, (N, 3) -> (N, 3): below, above (N - 1, 3, 3), middle (N, 3, 3).

    By elimination; the blocks in the middle dominate.
    """
    pivots, factors = np.empty_like(middle), np.empty_like(above)
    pivots[0] = np.linalg.inv(middle[0])
    for k in range(1, len(middle)):
        factors[k - 1] = pivots[k - 1] @ above[k - 1]
        pivots[k] = np.linalg.inv(middle[k] - below[k - 1] @ factors[k - 1])

    def solve(right: Float64) -> Float64:
        solved = np.empty_like(right)
        solved[0] = pivots[0] @ right[0]
        for k in range(1, len(right)):
            solved[k] = pivots[k] @ (right[k] - below[k - 1] @ solved[k - 1])
        for k in range(len(right) - 2, -1, -1):
            solved[k] -= factors[k] @ solved[k + 1]
        return solved

    return solve


class Curve(Protocol):
    """Where a camera is at any time."""

    def pose_at(self, times_s: ArrayLike) -> Float64:
        """(...) seconds -> (..., 4, 4) float64, rigid, camera-to-world, OpenCV axes, metres."""
        ...


@runtime_checkable
class MovingCurve(Curve, Protocol):
    """A curve that tells its derivatives too."""

    def motion_at(self, times_s: Float64) -> BodyMotion:
        """(N,) seconds -> the camera's motion then, by analytic derivatives."""
        ...


def motion_of(curve: Curve, times_s: Float64) -> BodyMotion:
    """Return the motion along a curve at times (N,). Raises NoisyWorldError for a curve that tells no derivatives."""
    if not isinstance(curve, MovingCurve):
        name = type(curve).__name__
        raise NoisyWorldError(f"a path of {name} has no derivatives, which an IMU needs: give {name} motion_at")
    return curve.motion_at(times_s)


@dataclass(frozen=True, eq=False)
class NaturalSpline:
    """The natural cubic spline through values at knots: C2 everywhere, straight before the first and after the last.

    knots: (N,) float64, increasing, N >= 1. values: (N, D). At a knot it gives the knot's own value to the bit.
    Source: de Boor, A Practical Guide to Splines, chapter IV.
    """

    knots: Float64
    values: Float64

    @cached_property
    def _slopes(self) -> Float64:
        """(N, D): the first derivative at each knot."""
        count = len(self.knots)
        if count == 1:
            return np.zeros_like(self.values)
        gaps = np.diff(self.knots)
        rises = np.diff(self.values, axis=0) / gaps[:, None]
        if count == 2:
            return np.repeat(rises, 2, axis=0)
        # Rows of the tridiagonal system in the slopes: equal second derivatives from both sides, 0 at both ends.
        below, above = np.append(gaps[1:], 1.0), np.append(1.0, gaps[:-1])
        middle = np.concatenate([[2.0], 2.0 * (gaps[1:] + gaps[:-1]), [2.0]])
        right = np.concatenate(
            [
                3.0 * rises[:1],
                3.0 * (gaps[1:, None] * rises[:-1] + gaps[:-1, None] * rises[1:]),
                3.0 * rises[-1:],
            ]
        )
        return _solve_tridiagonal(below, middle, above, right)

    def at(self, times: ArrayLike) -> Float64:
        """(...) -> (..., D)."""
        asked = np.asarray(times, dtype=np.float64)
        t = asked.ravel()
        inside, left, gap, (low, begin, square, cube) = self._pieces(t)
        u = (inside - self.knots[left])[:, None] / gap
        found = low + u * (begin + u * (square + u * cube))
        found = np.where(u == 1.0, self.values[np.minimum(left + 1, len(self.knots) - 1)], found)
        beyond = np.where((t < inside)[:, None], self._slopes[0], self._slopes[-1])
        return (found + (t - inside)[:, None] * beyond).reshape(*asked.shape, self.values.shape[1])

    def derivatives_at(self, times: Float64) -> tuple[Float64, Float64]:
        """(N,) -> the first and the second derivative (N, D)."""
        inside, left, gap, (_, begin, square, cube) = self._pieces(times)
        u = (inside - self.knots[left])[:, None] / gap
        first = (begin + u * (2.0 * square + u * 3.0 * cube)) / gap
        second = (2.0 * square + u * 6.0 * cube) / gap**2
        return first, np.where((times == inside)[:, None], second, 0.0)

    def _pieces(self, t: Float64) -> tuple[Float64, NDArray[np.intp], Float64, tuple[Float64, ...]]:
        """Return times (N,) inside the knots, the knot before, the gap (N, 1), and the cubic's coefficients (N, D)."""
        last = len(self.knots) - 1
        inside = np.clip(t, self.knots[0], self.knots[-1])
        left = np.clip(np.searchsorted(self.knots, inside, side="right") - 1, 0, max(last - 1, 0))
        right = np.minimum(left + 1, last)
        gap = np.where(right > left, self.knots[right] - self.knots[left], 1.0)[:, None]
        low, high = self.values[left], self.values[right]
        rise, begin, end = high - low, gap * self._slopes[left], gap * self._slopes[right]
        return inside, left, gap, (low, begin, 3.0 * rise - 2.0 * begin - end, begin + end - 2.0 * rise)


def _solve_tridiagonal(below: Float64, middle: Float64, above: Float64, right: Float64) -> Float64:
    """Return the solution (N, D) of a diagonally dominant system by elimination without pivots (Thomas)."""
    factors, solved = np.empty(len(above)), right.copy()
    pivot = middle[0]
    solved[0] /= pivot
    for k in range(1, len(middle)):
        factors[k - 1] = above[k - 1] / pivot
        pivot = middle[k] - below[k - 1] * factors[k - 1]
        solved[k] = (solved[k] - below[k - 1] * solved[k - 1]) / pivot
    for k in range(len(middle) - 2, -1, -1):
        solved[k] -= factors[k] * solved[k + 1]
    return solved


@dataclass(frozen=True, eq=False)
class SplineCurve:
    """The curve through poses c2w (N, 4, 4) at stamps (N,), which increase."""

    c2w: Float64
    stamps_s: Float64

    @cached_property
    def _splines(self) -> tuple[NaturalSpline, RotationSpline]:
        # From the first stamp and position on: little of a difference would be left at 1e9 s or 1e5 m.
        knots_s = self.stamps_s - self.stamps_s[0]
        moved_m = self.c2w[:, :3, 3] - self.c2w[0, :3, 3]
        return NaturalSpline(knots_s, moved_m), RotationSpline(knots_s, self.c2w[:, :3, :3])

    def pose_at(self, times_s: ArrayLike) -> Float64:
        """(...) seconds -> (..., 4, 4); no turn between two neighbours is more than a half one."""
        passed_s = np.asarray(times_s, dtype=np.float64) - self.stamps_s[0]
        positions, rotations = self._splines
        return pose(rotations.at(passed_s), positions.at(passed_s) + self.c2w[0, :3, 3])

    def motion_at(self, times_s: Float64) -> BodyMotion:
        """(N,) seconds -> the motion then."""
        passed_s = times_s - self.stamps_s[0]
        positions, rotations = self._splines
        rate_rad_s, angular_rad_s2 = rotations.rates_at(passed_s)
        position_m = positions.at(passed_s) + self.c2w[0, :3, 3]
        return BodyMotion(
            rotations.at(passed_s), position_m, *positions.derivatives_at(passed_s), rate_rad_s, angular_rad_s2
        )


@dataclass(frozen=True, eq=False)
class WarpedCurve:
    """A curve that is followed at another speed: at the time t it is where `curve` is at clock.at(t)."""

    curve: Curve
    clock: NaturalSpline

    def pose_at(self, times_s: ArrayLike) -> Float64:
        """(...) seconds -> (..., 4, 4)."""
        return self.curve.pose_at(self.clock.at(times_s)[..., 0])

    def motion_at(self, times_s: Float64) -> BodyMotion:
        """(N,) seconds -> the motion then."""
        speed, speeding = self.clock.derivatives_at(times_s)
        return motion_of(self.curve, self.clock.at(times_s)[:, 0]).sped(speed[:, 0], speeding[:, 0])


@dataclass(frozen=True, eq=False)
class MountedCurve:
    """The curve of a sensor on a body. body_from_sensor: (4, 4)."""

    curve: Curve
    body_from_sensor: Float64

    def pose_at(self, times_s: ArrayLike) -> Float64:
        """(...) seconds -> (..., 4, 4)."""
        return self.curve.pose_at(times_s) @ self.body_from_sensor

    def motion_at(self, times_s: Float64) -> BodyMotion:
        """(N,) seconds -> the sensor's motion then, with its lever arm."""
        return motion_of(self.curve, times_s).carried(self.body_from_sensor)
