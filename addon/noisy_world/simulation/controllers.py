# SPDX-License-Identifier: GPL-3.0-or-later
"""What steers the bodies: a point ahead on the route gives speed and turn, which a trot or four wheels follow."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .models import LEGS, WHEEL_M, WHEEL_Y_M, SimulatedKind

Float64: TypeAlias = NDArray[np.float64]

AHEAD_M = 0.35  # the point that is steered for; chosen
ARRIVED_M = 0.15
MOST_M_S: dict[SimulatedKind, float] = {"quadruped": 0.8, "rover": 1.5}  # by trying
MOST_TURN_RAD_S: dict[SimulatedKind, float] = {"quadruped": 1.5, "rover": 0.8}
SKID = 1.8  # wheels that slip sideways turn the rover by less than their speeds say; by trying


@dataclass(frozen=True, eq=False)
class Route:
    """Where a body goes: points (N, 2), their way (N,) from the first, and the speed there (N,) m/s.

    held_back: whether the speed was lowered somewhere to what the body can do.
    """

    points_m: Float64
    way_m: Float64
    speed_m_s: Float64
    held_back: bool

    def ahead(self, place_m: Float64, passed_m: float) -> tuple[Float64, float, float]:
        """Return the point to steer for, how much of the way is passed, and the speed there. place_m: (2,)."""
        near = (self.way_m >= passed_m - 0.01) & (self.way_m <= passed_m + 2.0 * AHEAD_M)
        rows = np.flatnonzero(near)
        row = rows[np.argmin(np.linalg.norm(self.points_m[rows] - place_m, axis=1))]
        passed_m = max(passed_m, float(self.way_m[row]))
        goal = min(int(np.searchsorted(self.way_m, passed_m + AHEAD_M)), len(self.way_m) - 1)
        return self.points_m[goal], passed_m, float(self.speed_m_s[row])


def steering(
    kind: SimulatedKind, place_m: Float64, heading_rad: float, goal_m: Float64, speed_m_s: float
) -> tuple[float, float]:
    """Return the speed ahead, m/s, and the turn, rad/s: slower the further the goal is off the heading."""
    off_m = goal_m - place_m
    off_rad = float(np.angle(np.exp(1j * (np.arctan2(off_m[1], off_m[0]) - heading_rad))))
    turn_rad_s = float(np.clip(2.5 * off_rad, -MOST_TURN_RAD_S[kind], MOST_TURN_RAD_S[kind]))
    return speed_m_s * max(np.cos(off_rad), 0.0) ** 2, turn_rad_s


def wheels(ahead_m_s: float, turn_rad_s: float) -> Float64:
    """Return the speeds, rad/s, that are asked of the rover's wheels, in the order of LEGS."""
    sides = [1.0 if name.endswith("left") else -1.0 for name in LEGS]
    return np.array([(ahead_m_s - side * SKID * turn_rad_s * WHEEL_Y_M) / WHEEL_M for side in sides])
