# SPDX-License-Identifier: GPL-3.0-or-later
"""A robot's cameras: the pose of each sensor on the body whose path is given."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry import (
    invert_pose,
    nearest_rotation,
    pose,
    rotation_error,
    rotation_from_euler_deg,
    rotation_from_quat_wxyz,
)
from .curve import MountedCurve
from .trajectory import Axes, Trajectory, convert_convention

if TYPE_CHECKING:
    from ..inertial.imu import Imu

# As for trajectory files: rounding is mended, anything more is a mistake and refused.
_ROTATION_TOLERANCE = 5e-3
_QUAT_NORM_TOLERANCE = 1e-2


@dataclass(frozen=True, eq=False)
class Sensor:
    """The pose of a sensor on the robot: robot_from_sensor (4, 4) float64, metres, OpenCV axes for both."""

    robot_from_sensor: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rig:
    """The sensors of an RGB-D robot; depth is None where it has the colour sensor's pose, imu where there is none."""

    rgb: Sensor
    depth: Sensor | None
    imu: "Imu | None" = None


def sensor_trajectory(robot: Trajectory, sensor: Sensor) -> Trajectory:
    """Return the sensor's own c2w = world_from_robot @ robot_from_sensor, with the robot's stamps.

    robot: the body's poses with OpenCV axes, as read with the axes that its file declares.
    """
    return Trajectory(
        robot.c2w @ sensor.robot_from_sensor,
        robot.stamps_s,
        posed=robot.posed,
        curve=MountedCurve(robot.continuous, sensor.robot_from_sensor),
        independent=robot.independent,
        shots=robot.shots,
    )


def sensor_from_extrinsics(
    *,
    translation_m: ArrayLike | None = None,
    quat_wxyz: ArrayLike | None = None,
    rotation_euler_deg: ArrayLike | None = None,
    matrix: ArrayLike | None = None,
    robot_axes: Axes = "robot",
) -> Sensor:
    """Build a sensor from its pose on the robot, given by a matrix or by a translation and one rotation.

    translation_m: (3,) metres, the sensor's position in the robot's axes; default the robot's centre.
    quat_wxyz: (4,) or rotation_euler_deg: (3,) degrees [rx, ry, rz] as Rz Ry Rx, robot from sensor, the sensor with
    OpenCV axes. With neither, the sensor looks where the robot faces, its image upright.
    matrix: (4, 4) robot from sensor. robot_axes: the robot's axes, in which all these are given.
    Raises ValueError, whose message names neither file nor key, for anything that is not one rigid pose.
    """
    rotations = [r for r in (quat_wxyz, rotation_euler_deg) if r is not None]
    if matrix is not None and (rotations or translation_m is not None):
        raise ValueError("matrix is a whole pose: give either it or a translation and a rotation")
    if len(rotations) > 1:
        raise ValueError("give one rotation: quat_wxyz or rotation_euler_deg")
    # Taking the body's own axes as the world, its c2w is robot_from_opencv.
    opencv_from_robot = invert_pose(convert_convention(np.eye(4), direction="c2w", axes=robot_axes))
    if matrix is not None:
        return Sensor(opencv_from_robot @ _rigid(_numbers(matrix, (4, 4), "matrix")))
    place = np.zeros(3) if translation_m is None else _numbers(translation_m, (3,), "translation_m")
    if quat_wxyz is not None:
        rotation = rotation_from_quat_wxyz(_unit_quat(_numbers(quat_wxyz, (4,), "quat_wxyz")))
    elif rotation_euler_deg is not None:
        rotation = rotation_from_euler_deg(*_numbers(rotation_euler_deg, (3,), "rotation_euler_deg"))
    else:
        rotation = opencv_from_robot[:3, :3].T
    return Sensor(opencv_from_robot @ pose(rotation, place))


def _numbers(values: ArrayLike, shape: tuple[int, ...], name: str) -> NDArray[np.float64]:
    size = " x ".join(map(str, shape))
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be {size} numbers, not {values!r}") from None
    if array.shape != shape:
        raise ValueError(f"{name} must be {size} numbers, not {values!r}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must hold finite numbers only, not {values!r}")
    return array


def _unit_quat(quat_wxyz: NDArray[np.float64]) -> NDArray[np.float64]:
    length = math.hypot(*quat_wxyz.tolist())
    if abs(length - 1.0) > _QUAT_NORM_TOLERANCE:
        raise ValueError(f"quat_wxyz must have length 1, not {length:.6g}")
    return quat_wxyz


def _rigid(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    rotation = matrix[:3, :3]
    if np.any(np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]) > 1e-6):
        raise ValueError(f"the last row of matrix must be 0 0 0 1, not {matrix[3].tolist()}")
    with np.errstate(over="ignore", invalid="ignore"):
        error = float(rotation_error(rotation))
    if not error <= _ROTATION_TOLERANCE:
        raise ValueError(f"the rotation of matrix is not orthonormal: R^T R is off by {error:.3g}")
    if np.linalg.det(rotation) < 0.0:
        raise ValueError("the rotation of matrix mirrors (determinant -1): check the sensor's and the robot's axes")
    return pose(rotation if error < 1e-12 else nearest_rotation(rotation), matrix[:3, 3])
