# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera's path in continuous time: a pose at any moment, through the poses of a trajectory exactly.

Positions are natural cubic splines over the stamps, rotations their counterpart (rotation_spline). So both have two
continuous derivatives, which an IMU needs, at any rate of the stamps, and before the first pose and after the last one
the path goes on as fast as there.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import NoisyWorldError
from ..geometry import pose
from .body_motion import BodyMotion
from .rotation_spline import RotationSpline

Float64: TypeAlias = NDArray[np.float64]


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
