# SPDX-License-Identifier: GPL-3.0-or-later
"""What moves the bodies: a point ahead on the route gives speed and turn; a trot or four wheels follow them."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .models import HIP_Y_M, LEGS, SHANK_M, STANCE_M, THIGH_M, WHEEL_M, WHEEL_Y_M, SimulatedKind

Float64: TypeAlias = NDArray[np.float64]

AHEAD_M = 0.35  # the point that is steered for; chosen
ARRIVED_M = 0.15
STRIDE_HZ, STANDS, LIFT_M = 3.0, 0.65, 0.03  # by trying: legs that stand for half the stride fall over
MOST_M_S: dict[SimulatedKind, float] = {"quadruped": 0.4, "rover": 1.5}  # faster, legs without balance fall; by trying
MOST_TURN_RAD_S = 0.8
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


def steering(place_m: Float64, heading_rad: float, goal_m: Float64, speed_m_s: float) -> tuple[float, float]:
    """Return the speed ahead, m/s, and the turn, rad/s: slower the further the goal is off the heading."""
    off_m = goal_m - place_m
    off_rad = float(np.angle(np.exp(1j * (np.arctan2(off_m[1], off_m[0]) - heading_rad))))
    turn_rad_s = float(np.clip(2.5 * off_rad, -MOST_TURN_RAD_S, MOST_TURN_RAD_S))
    return speed_m_s * max(np.cos(off_rad), 0.0) ** 2, turn_rad_s


def drives(kind: SimulatedKind, time_s: float, ahead_m_s: float, turn_rad_s: float) -> Float64:
    """Return what each actuator is asked for: angles of hips and knees, or speeds of wheels, in the order of LEGS."""
    sides = [1.0 if name.endswith("left") else -1.0 for name in LEGS]
    if kind == "rover":
        return np.array([(ahead_m_s - side * SKID * turn_rad_s * WHEEL_Y_M) / WHEEL_M for side in sides])
    asked: list[float] = []
    for name, side in zip(LEGS, sides, strict=True):
        diagonal = name in ("front_left", "rear_right")
        phase = (STRIDE_HZ * time_s + (0.0 if diagonal else 0.5)) % 1.0
        length_m = (ahead_m_s - side * turn_rad_s * 2.0 * HIP_Y_M) * STANDS / STRIDE_HZ
        asked += _leg(*_foot(phase, length_m, min(time_s, 1.0)))
    return np.array(asked)


def _foot(phase: float, length_m: float, begun: float) -> tuple[float, float]:
    """Return where a foot is below its hip, forward and down: on the floor for a share of the stride, then lifted."""
    if phase < STANDS:
        return length_m * (0.5 - phase / STANDS) * begun, STANCE_M
    swing = np.pi * (phase - STANDS) / (1.0 - STANDS)
    return -0.5 * length_m * float(np.cos(swing)) * begun, STANCE_M - LIFT_M * begun * float(np.sin(swing)) ** 2


def _leg(forward_m: float, down_m: float) -> tuple[float, float]:
    """Return the angles of hip and knee that bring the foot there, the knee bent backwards."""
    reach = np.clip(np.hypot(forward_m, down_m), 0.05, THIGH_M + SHANK_M - 1e-3)
    knee = np.pi - np.arccos(np.clip((THIGH_M**2 + SHANK_M**2 - reach**2) / (2 * THIGH_M * SHANK_M), -1, 1))
    lean = np.arcsin(np.clip(SHANK_M * np.sin(knee) / reach, -1, 1))
    return float(-np.arctan2(forward_m, down_m) - lean), float(knee)
