# SPDX-License-Identifier: GPL-3.0-or-later
"""A smooth rotation through given ones: angular velocity and acceleration are continuous, and a steady turn is exact.

In each interval the rotation vector from the interval's first rotation is a cubic of time. The angular velocities at
the knots are chosen so that the angular acceleration has no jump, and is 0 at both ends; since turns do not commute,
what they have to satisfy is a little more than linear, and is solved by iteration. The kinematics of rotation vectors
are Shuster's, A Survey of Attitude Representations (1993), equations 279 to 285.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry import rotation_from_rotvec, rotvec_from_rotation

Float64: TypeAlias = NDArray[np.float64]

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
