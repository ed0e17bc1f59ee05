# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys of a rig's IMU: its clock and its errors."""

from dataclasses import dataclass, fields

from ..inertial.devices import DeviceName, ImuModel, Triple, device_model
from ..schema import Choice, key


@dataclass(frozen=True)
class ImuKeys:
    """What an IMU measures by. Errors that are not given are the device's."""

    device: DeviceName = key(
        "whose errors it has: none, EuRoC's ADIS16448, or the BMI055 of a RealSense D435i",
        default="ideal",
        choices={
            "ideal": Choice("Ideal", "Without any error"),
            "adis16448": Choice("ADIS16448", "Of the EuRoC datasets"),
            "bmi055": Choice("BMI055", "Of RealSense's D435i"),
        },
        identity="meaning",
    )
    rate_hz: float = key("samples a second", unit="Hz", default=200.0, minimum=1, maximum=10_000, identity="meaning")
    gravity_m_s2: float = key(
        "gravity, along the world's -z", unit="m/s^2", default=9.81, minimum=0, maximum=100, identity="meaning"
    )
    time_offset_s: float = key(
        "its clock minus the cameras' at the path's beginning",
        unit="s",
        default=0.0,
        minimum=-1000,
        maximum=1000,
        identity="meaning",
    )
    clock_drift_ppm: float = key(
        "how much faster its clock goes than the cameras'",
        unit="ppm",
        default=0.0,
        minimum=-1e5,
        maximum=1e5,
        identity="meaning",
    )
    gyro_noise_density: float | None = key(
        "white noise of angular velocity; default the device's",
        unit="rad/s/sqrt(Hz)",
        default=None,
        minimum=0,
        maximum=10,
        identity="meaning",
    )
    gyro_random_walk: float | None = key(
        "random walk of the gyro's bias; default the device's",
        unit="rad/s^2/sqrt(Hz)",
        default=None,
        minimum=0,
        maximum=10,
        identity="meaning",
    )
    accel_noise_density: float | None = key(
        "white noise of specific force; default the device's",
        unit="m/s^2/sqrt(Hz)",
        default=None,
        minimum=0,
        maximum=100,
        identity="meaning",
    )
    accel_random_walk: float | None = key(
        "random walk of the accelerometer's bias; default the device's",
        unit="m/s^3/sqrt(Hz)",
        default=None,
        minimum=0,
        maximum=100,
        identity="meaning",
    )
    gyro_bias_rad_s: Triple | None = key(
        "the gyro's bias at the path's beginning; default the device's",
        unit="rad/s",
        default=None,
        minimum=-100,
        maximum=100,
        identity="meaning",
    )
    accel_bias_m_s2: Triple | None = key(
        "the accelerometer's bias at the path's beginning; default the device's",
        unit="m/s^2",
        default=None,
        minimum=-1000,
        maximum=1000,
        identity="meaning",
    )
    gyro_scale_error: Triple | None = key(
        "relative error of the gyro's scale, each axis; default the device's",
        default=None,
        minimum=-1,
        maximum=1,
        identity="meaning",
    )
    accel_scale_error: Triple | None = key(
        "relative error of the accelerometer's scale, each axis; default the device's",
        default=None,
        minimum=-1,
        maximum=1,
        identity="meaning",
    )
    gyro_misalignment_deg: Triple | None = key(
        "of the gyro: by how much of x the y axis, of x the z axis, and of y the z axis measures; default the device's",
        unit="deg",
        default=None,
        minimum=-45,
        maximum=45,
        identity="meaning",
    )
    accel_misalignment_deg: Triple | None = key(
        "the same of the accelerometer; default the device's",
        unit="deg",
        default=None,
        minimum=-45,
        maximum=45,
        identity="meaning",
    )
    gyro_range_deg_s: float | None = key(
        "largest angular velocity; 0: any; default the device's",
        unit="deg/s",
        default=None,
        minimum=0,
        maximum=1e6,
        identity="meaning",
    )
    accel_range_m_s2: float | None = key(
        "largest specific force; 0: any; default the device's",
        unit="m/s^2",
        default=None,
        minimum=0,
        maximum=1e6,
        identity="meaning",
    )
    gyro_step_deg_s: float | None = key(
        "what angular velocity is rounded to; 0: nothing; default the device's",
        unit="deg/s",
        default=None,
        minimum=0,
        maximum=1000,
        identity="meaning",
    )
    accel_step_m_s2: float | None = key(
        "what specific force is rounded to; 0: nothing; default the device's",
        unit="m/s^2",
        default=None,
        minimum=0,
        maximum=1000,
        identity="meaning",
    )

    @property
    def model(self) -> ImuModel:
        """Its errors: the device's, with what is given in place of them."""
        return device_model(self.device, {item.name: getattr(self, item.name) for item in fields(ImuKeys)})
