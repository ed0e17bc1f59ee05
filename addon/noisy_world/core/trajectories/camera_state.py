# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera's pose and velocity relative to the air of its sequence, for weather.

The air's axes are right, down and forward of the sequence's first image, made level; it begins at the first camera.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .motion import CameraMotion

Float64: TypeAlias = NDArray[np.float64]


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
