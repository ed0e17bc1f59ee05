# SPDX-License-Identifier: GPL-3.0-or-later
"""A quadruped's trot with balance: legs that stand carry a level trunk, legs that swing are put where it will fall.

Where a foot is put follows Raibert (Legged Robots That Balance, 1986): half the way that the trunk goes while a foot
stands, and a share of the error of its speed; the gain is near that of the capture point, sqrt(height / g) (Pratt and
others 2006).
"""

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .models import FOOT_M, HIP_X_M, HIP_Y_M, LEGS, SHANK_M, STANCE_M, THIGH_M

Float64: TypeAlias = NDArray[np.float64]

STRIDE_HZ, STANDS, LIFT_M = 3.0, 0.55, 0.05  # by trying
CAPTURE_S = 0.08  # how far a foot is put aside for an error of the speed; by trying, capture: sqrt(.25 / 9.81) = .16
PULL_S = 0.04  # how far standing feet are asked to pull the trunk for an error of its speed; by trying
SWUNG = 0.85  # of a swing after which the foot is where it is put: joints lag behind; by trying
LEAD_S = 0.023  # how far joints lag behind what is asked of them; by trying
MOST_OFF_RAD = 0.04  # how far the heading that is asked for is ahead of the trunk's; chosen
DAMPED_S = 0.05  # and for an error of the turn rate; by trying
SLID = 0.2  # of how far a standing foot has slid is taken over in a step of the controller; by trying
FLOOR_SHARE = 0.05  # of a step's news of the floor's height, 250 a second; chosen
FASTER_M_S2 = 1.0  # how fast the speed that is asked for changes
HIPS_M = np.array([(x, y, 0.0) for x in (HIP_X_M, -HIP_X_M) for y in (HIP_Y_M, -HIP_Y_M)])
_PHASES = np.array([0.0 if name in ("front_left", "rear_right") else 0.5 for name in LEGS])


@dataclass(frozen=True, eq=False)
class Trunk:
    """The trunk as it is: place (3,), speed (3,) and turn rate (3,) in the world, and its axes (3, 3).

    axes: x ahead, y left, z up.
    """

    place_m: Float64
    speed_m_s: Float64
    turn_rad_s: Float64
    axes: Float64

    @property
    def heading_rad(self) -> float:
        """Which way it looks over the floor."""
        return float(np.arctan2(self.axes[1, 0], self.axes[0, 0]))


@dataclass(eq=False)
class Trot:
    """What the legs do from step to step.

    feet_m: (4, 3) where each foot was put down, or was lifted, in the world. heading_rad: which way it is to look.
    floor_m: how high feet stand.
    """

    feet_m: Float64
    heading_rad: float
    floor_m: float
    swings: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(len(LEGS), dtype=np.bool_))
    ahead_m_s: float = 0.0
    last_s: float = 0.0

    @classmethod
    def standing(cls, trunk: Trunk, floor_m: float) -> "Trot":
        """Return legs that stand below the hips. floor_m: the height of the floor there."""
        feet_m = trunk.place_m + HIPS_M @ _upright(trunk.heading_rad).T
        feet_m[:, 2] = floor_m + FOOT_M
        return cls(feet_m, trunk.heading_rad, floor_m + FOOT_M)

    def asked(self, trunk: Trunk, touching_m: Float64, time_s: float, ahead_m_s: float, turn_rad_s: float) -> Float64:
        """Return the angles (12,) that are asked of the joints: roll, hip and knee of each leg, in the order of LEGS.

        touching_m: (4, 3) where the feet are. time_s: since it began to trot; at 0 it stands.
        """
        passed_s, self.last_s = max(time_s - self.last_s, 0.0), time_s
        change = FASTER_M_S2 * passed_s
        self.ahead_m_s += float(np.clip(ahead_m_s - self.ahead_m_s, -change, change))
        off_rad = _turn(self.heading_rad + turn_rad_s * passed_s - trunk.heading_rad)
        off_rad += DAMPED_S * (turn_rad_s - trunk.turn_rad_s[2])
        if time_s > 0.0:
            self.heading_rad = trunk.heading_rad + float(np.clip(off_rad, -MOST_OFF_RAD, MOST_OFF_RAD))
        wanted_m_s = _upright(self.heading_rad) @ np.array([self.ahead_m_s, 0.0, 0.0])
        off_m_s = (wanted_m_s - trunk.speed_m_s) * [1.0, 1.0, 0.0]
        phases = (STRIDE_HZ * time_s + _PHASES) % 1.0
        swings = (phases >= STANDS) & (time_s > 0.0)
        landed = self.swings & ~swings
        self.feet_m[landed] = touching_m[landed]
        if time_s > 0.0:  # feet that slide are not pulled back
            self.feet_m[~swings] += SLID * (touching_m - self.feet_m)[~swings]
        self.swings = swings
        self.floor_m += FLOOR_SHARE * (float(touching_m[~swings, 2].min()) - self.floor_m)
        over_m = trunk.place_m + PULL_S * off_m_s + LEAD_S * wanted_m_s if time_s > 0.0 else self.feet_m.mean(axis=0)
        place_m = np.array([*over_m[:2], self.floor_m + STANCE_M])
        goals = (self.feet_m - place_m) @ _upright(self.heading_rad) - HIPS_M
        goals[:, 2] = -STANCE_M
        for leg in np.flatnonzero(swings):
            share = float((phases[leg] - STANDS) / (1.0 - STANDS))
            goals[leg] = self._swung(int(leg), share, trunk, wanted_m_s, turn_rad_s)
        return np.concatenate([_angles(goal) for goal in goals])

    def _swung(self, leg: int, share: float, trunk: Trunk, wanted_m_s: Float64, turn_rad_s: float) -> Float64:
        """Return where a foot (3,) swings to below its hip, in the trunk's axes, for a share of its swing."""
        stood_s, left_s = STANDS / STRIDE_HZ, (1.0 - share) * (1.0 - STANDS) / STRIDE_HZ
        arm_m = trunk.axes @ HIPS_M[leg]
        hip_m = trunk.place_m + arm_m
        around_m = np.array([-arm_m[1], arm_m[0], 0.0])
        hip_m_s = trunk.speed_m_s + trunk.turn_rad_s[2] * around_m
        off_m_s = wanted_m_s + turn_rad_s * around_m - hip_m_s
        to_m = hip_m + hip_m_s * (left_s + stood_s / 2.0) - CAPTURE_S * off_m_s
        share = min(share / SWUNG, 1.0)
        eased = share**2 * (3.0 - 2.0 * share)
        at_m = self.feet_m[leg] + (to_m - self.feet_m[leg]) * eased
        at_m[2] = self.floor_m + LIFT_M * np.sin(np.pi * share) ** 2
        return trunk.axes.T @ (at_m - hip_m)


def _turn(angle_rad: float) -> float:
    """Return the same turn between -pi and pi."""
    return float(np.angle(np.exp(1j * angle_rad)))


def _upright(heading_rad: float) -> Float64:
    """Return level axes (3, 3) that look this way."""
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _angles(foot_m: Float64) -> Float64:
    """Return the angles of roll, hip and knee that bring a foot (3,) there below its hip, the knee bent backwards."""
    forward_m, left_m, up_m = foot_m
    down_m = np.hypot(left_m, up_m)
    reach = np.clip(np.hypot(forward_m, down_m), 0.05, THIGH_M + SHANK_M - 1e-3)
    knee = np.pi - np.arccos(np.clip((THIGH_M**2 + SHANK_M**2 - reach**2) / (2 * THIGH_M * SHANK_M), -1, 1))
    lean = np.arcsin(np.clip(SHANK_M * np.sin(knee) / reach, -1, 1))
    return np.array([np.arctan2(left_m, -up_m), -np.arctan2(forward_m, down_m) - lean, knee])
