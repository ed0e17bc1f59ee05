# SPDX-License-Identifier: GPL-3.0-or-later
"""How a body moves at some times: its pose with the first and second derivatives, and those of what it carries."""

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

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
