# SPDX-License-Identifier: GPL-3.0-or-later
"""The errors of an inertial measurement unit, and those of real devices."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

DeviceName: TypeAlias = Literal["ideal", "adis16448", "bmi055"]
Triple: TypeAlias = tuple[float, float, float]

G_M_S2 = 9.80665  # standard gravity, by which data sheets count
_NONE: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ImuModel:
    """What an IMU makes of true angular velocity (rad/s) and specific force (m/s^2), each in its own axes.

    gyro_noise_density: rad/s/sqrt(Hz), accel_noise_density: m/s^2/sqrt(Hz): of white noise. gyro_random_walk:
    rad/s^2/sqrt(Hz), accel_random_walk: m/s^3/sqrt(Hz): of the biases. The biases begin with gyro_bias_rad_s and
    accel_bias_m_s2. gyro_scale_error, accel_scale_error: relative, each axis. gyro_misalignment_deg,
    accel_misalignment_deg: by how much of x the y axis, of x the z axis and of y the z axis measures.
    gyro_range_deg_s, accel_range_m_s2: the largest values; gyro_step_deg_s, accel_step_m_s2: of the digits; 0: none.
    """

    gyro_noise_density: float = 0.0
    gyro_random_walk: float = 0.0
    accel_noise_density: float = 0.0
    accel_random_walk: float = 0.0
    gyro_bias_rad_s: Triple = _NONE
    accel_bias_m_s2: Triple = _NONE
    gyro_scale_error: Triple = _NONE
    accel_scale_error: Triple = _NONE
    gyro_misalignment_deg: Triple = _NONE
    accel_misalignment_deg: Triple = _NONE
    gyro_range_deg_s: float = 0.0
    accel_range_m_s2: float = 0.0
    gyro_step_deg_s: float = 0.0
    accel_step_m_s2: float = 0.0

    @property
    def gyro_matrix(self) -> NDArray[np.float64]:
        """(3, 3): what the axes of the gyroscope measure of the true ones."""
        return _mixing(self.gyro_scale_error, self.gyro_misalignment_deg)

    @property
    def accel_matrix(self) -> NDArray[np.float64]:
        """(3, 3): what the axes of the accelerometer measure of the true ones."""
        return _mixing(self.accel_scale_error, self.accel_misalignment_deg)


DEVICES: Mapping[DeviceName, ImuModel] = {
    "ideal": ImuModel(),
    # Noise: the sensor.yaml of EuRoC's imu0. Ranges and digits: the data sheet, from memory, not checked.
    "adis16448": ImuModel(
        gyro_noise_density=1.6968e-4,
        gyro_random_walk=1.9393e-5,
        accel_noise_density=2.0e-3,
        accel_random_walk=3.0e-3,
        gyro_range_deg_s=1000.0,
        accel_range_m_s2=18 * G_M_S2,
        gyro_step_deg_s=0.04,
        accel_step_m_s2=0.833e-3 * G_M_S2,
    ),
    # Of RealSense's D435i. Noise: VINS-Mono's thread 472, whose reporter sees drift. Digits: the data sheet, 12 bits at
    # 4 g and 16 at 1000 deg/s; that these are the D435i's ranges is from memory, not checked.
    "bmi055": ImuModel(
        gyro_noise_density=1.28e-4,
        gyro_random_walk=2.4e-6,
        accel_noise_density=8.4e-4,
        accel_random_walk=6.3e-5,
        gyro_range_deg_s=1000.0,
        accel_range_m_s2=4 * G_M_S2,
        gyro_step_deg_s=2000 / 2**16,
        accel_step_m_s2=G_M_S2 / 512,
    ),
}


def device_model(device: DeviceName, given: Mapping[str, Any]) -> ImuModel:
    """Return the errors of a device, with those that are given and not None in place of its own."""
    known = {item.name for item in fields(ImuModel)}
    return replace(
        DEVICES[device], **{name: value for name, value in given.items() if name in known and value is not None}
    )


def _mixing(scale_error: Triple, misalignment_deg: Triple) -> NDArray[np.float64]:
    """Return the lower triangular matrix of Kalibr's model of scale and misalignment."""
    of_x_in_y, of_x_in_z, of_y_in_z = (math.sin(math.radians(angle)) for angle in misalignment_deg)
    x, y, z = (1.0 + error for error in scale_error)
    return np.array([[x, 0.0, 0.0], [of_x_in_y, y, 0.0], [of_x_in_z, of_y_in_z, z]])
