# SPDX-License-Identifier: GPL-3.0-or-later
"""The text files of an IMU, as EuRoC has them: its samples, its true states, and what it is."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...geometry import continuous_quats, invert_pose, pose, quat_wxyz_from_rotation
from ...inertial.imu import Imu, ImuSamples, ImuStates
from ...trajectories.rounding import rounded_numbers, rounded_poses
from .asl import POSES_HEADER, sensor_yaml, stamp_text, yaml_number
from .layout import IMU_FILES, SequenceFacts, lines

# EuRoC's own headers.
SAMPLES_HEADER = "#timestamp [ns]," + ",".join(
    [*(f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"), *(f"a_RS_S_{axis} [m s^-2]" for axis in "xyz")]
)
STATES_HEADER = POSES_HEADER + "".join(
    f", {name}_{axis} [{unit}]"
    for name, unit in (("v_RS_R", "m s^-1"), ("b_w_RS_S", "rad s^-1"), ("b_a_RS_S", "m s^-2"))
    for axis in "xyz"
)


def samples_csv(samples: ImuSamples) -> str:
    """Return what an IMU measured: t [ns] of its own clock, angular velocity [rad/s], specific force [m/s^2]."""
    values = np.concatenate([samples.rate_rad_s, samples.force_m_s2], axis=1)
    return lines([SAMPLES_HEADER, *_rows(samples.stamps_ns, values)])


def states_csv(states: ImuStates) -> str:
    """Return true states: t [ns] of the cameras' clock, position, quaternion with w first, velocity, both biases."""
    at = rounded_poses(pose(states.motion.rotation, states.motion.position_m))
    quats = continuous_quats(quat_wxyz_from_rotation(at[:, :3, :3]))
    others = [states.motion.velocity_m_s, states.gyro_bias_rad_s, states.accel_bias_m_s2]
    values = np.concatenate([at[:, :3, 3], quats, *map(rounded_numbers, others)], axis=1)
    return lines([STATES_HEADER, *_rows(states.stamps_ns, values)])


def read_samples(text: str, file: Path | str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return stamps (N,) in nanoseconds, and angular velocity and specific force (N, 6), of a text with samples.

    file: for messages. Raises InputError where it is none.
    """
    rows = [line.split(",") for line in text.splitlines() if line and not line.startswith("#")]
    try:
        stamps_ns = np.array([int(row[0]) for row in rows], dtype=np.int64)
        values = np.array([[float(cell) for cell in row[1:]] for row in rows], dtype=np.float64)
    except ValueError as error:
        raise InputError(file, f"is no list of samples: {error}") from error
    if values.shape != (len(rows), 6):
        raise InputError(file, "has to have seven numbers in each row")
    return stamps_ns, values


def imu_yaml(imu: Imu, body_from_imu: NDArray[np.float64], more: Sequence[str] = ()) -> str:
    """Return the text of an IMU's sensor.yaml, with EuRoC's keys, its clock and gravity. more: lines at its end."""
    model = imu.model
    rows = {
        "gyroscope_noise_density": (model.gyro_noise_density, "rad/s/sqrt(Hz)"),
        "gyroscope_random_walk": (model.gyro_random_walk, "rad/s^2/sqrt(Hz)"),
        "accelerometer_noise_density": (model.accel_noise_density, "m/s^2/sqrt(Hz)"),
        "accelerometer_random_walk": (model.accel_random_walk, "m/s^3/sqrt(Hz)"),
        "gravity": (imu.gravity_m_s2, "m/s^2, along the world's -z"),
        "time_offset": (imu.time_offset_s, "s: its clock minus the cameras', at the first frame"),
        "clock_drift": (imu.clock_drift_ppm, "ppm: how much faster its clock goes"),
    }
    numbers = [f"{name}: {yaml_number(value)}  # {meaning}" for name, (value, meaning) in rows.items()]
    head = sensor_yaml("imu", "angular velocity and specific force", body_from_imu, rate_hz=imu.rate_hz)
    return head + lines(["", *numbers, *more])


def imu_texts(facts: SequenceFacts) -> dict[str, str]:
    """Return the files of an IMU beside a sequence's images, by name; none where the layout has a place of its own."""
    samples, rig = facts.imu, facts.rig
    if samples is None or rig is None or facts.format.layout.holds_imu:
        return {}
    rgb_from_imu = rounded_poses(invert_pose(rig.rgb.robot_from_sensor) @ samples.imu.robot_from_sensor)
    rows = ["# The IMU's pose in the colour camera's frame; T_BS is its pose in the robot's, with OpenCV's axes."]
    rows += ["T_cam_imu:", *(f"  - [{', '.join(map(yaml_number, row))}]" for row in rgb_from_imu.tolist())]
    texts = [
        samples_csv(samples),
        imu_yaml(samples.imu, samples.imu.robot_from_sensor, rows),
        states_csv(samples.true_states(facts.frames_ns)),
    ]
    return dict(zip(IMU_FILES, texts, strict=True))


def _rows(stamps_ns: NDArray[np.int64], values: NDArray[np.float64]) -> Iterable[str]:
    """Yield a line for each row of values (N, D), which read back to the same float64."""
    for stamp_ns, row in zip(stamps_ns.tolist(), (values + 0.0).tolist(), strict=True):
        yield ",".join([stamp_text(stamp_ns), *map(repr, row)])
