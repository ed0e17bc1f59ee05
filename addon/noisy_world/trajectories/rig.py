# SPDX-License-Identifier: GPL-3.0-or-later
"""A robot's sensors: the pose of each on the body whose path is given, and what its IMU measures."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from statistics import NormalDist
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.curve import BodyMotion, MountedCurve, motion_of
from ..core.errors import NoisyWorldError
from ..core.geometry import (
    invert_pose,
    nearest_rotation,
    pose,
    rotation_error,
    rotation_from_euler_deg,
    rotation_from_quat_wxyz,
)
from ..core.streams import Identifiers, stream
from ..core.trajectory import NS_PER_S, Axes, Trajectory, convert_convention, rounded_numbers

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


# Inertial measurement units: what they measure along a path, and by which errors.


# The errors of an inertial measurement unit, and those of real devices.


DeviceName: TypeAlias = Literal["ideal", "adis16448", "bmi055", "bmi055_filtered"]
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
    bandwidth_hz: of the low-pass before samples are taken; 0: there is none.
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
    bandwidth_hz: float = 0.0

    @property
    def gyro_matrix(self) -> NDArray[np.float64]:
        """(3, 3): what the axes of the gyroscope measure of the true ones."""
        return _mixing(self.gyro_scale_error, self.gyro_misalignment_deg)

    @property
    def accel_matrix(self) -> NDArray[np.float64]:
        """(3, 3): what the axes of the accelerometer measure of the true ones."""
        return _mixing(self.accel_scale_error, self.accel_misalignment_deg)


# Of RealSense's D435i. Noise: VINS-Mono's thread 472, whose reporter sees drift. Digits: the data sheet, 12 bits at
# 4 g and 16 at 1000 deg/s; ranges: librealsense's pull request 2777.
_BMI055 = ImuModel(
    gyro_noise_density=1.28e-4,
    gyro_random_walk=2.4e-6,
    accel_noise_density=8.4e-4,
    accel_random_walk=6.3e-5,
    gyro_range_deg_s=1000.0,
    accel_range_m_s2=4 * G_M_S2,
    gyro_step_deg_s=2000 / 2**16,
    accel_step_m_s2=G_M_S2 / 512,
)
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
    "bmi055": _BMI055,
    # 64 Hz is one of the gyroscope's bandwidths (Bosch's driver), the wider one at 200 samples a second (from memory).
    # That the D435i has it, and the accelerometer the same, is a guess.
    "bmi055_filtered": replace(_BMI055, bandwidth_hz=64.0),
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


# An IMU on a robot: where it sits, when it measures, and what it measures along the robot's path.


Float64: TypeAlias = NDArray[np.float64]

IMU_STREAM = "rig.imu"  # what an IMU draws by, whatever the setting
LEAST_BANDWIDTH_HZ = 1.0  # of a low-pass, whose weights reach over 6 s then; chosen
MOST_SAMPLES = 20_000_000
"""Of one sequence: 28 hours at 200 Hz; as numbers they take 5 GB."""
_SAME_NS = 1000  # samples that are nearer to a frame than this have its time: the rest is rounding
_FAR_NS = -(2**62)


@dataclass(frozen=True, eq=False)
class Imu:
    """An inertial measurement unit.

    robot_from_sensor: (4, 4) its pose on the robot, whose axes are OpenCV's; its own are as it says. time_offset_s:
    its clock minus the cameras' at the path's beginning; clock_drift_ppm: how much faster it goes. Its stamps are
    those of its own clock.
    """

    robot_from_sensor: Float64
    model: ImuModel
    rate_hz: float = 200.0
    gravity_m_s2: float = 9.81
    time_offset_s: float = 0.0
    clock_drift_ppm: float = 0.0

    @property
    def clock_rate(self) -> float:
        """Seconds of its clock in one of the cameras'."""
        return 1.0 + 1e-6 * self.clock_drift_ppm

    def sample_numbers(self, duration_s: float) -> range:
        """Return the numbers of the samples along a path, 0 the one that its clock says is at the path's beginning.

        They cover the path by both clocks: readers ask for one before the first image, and one after the last.
        """
        last_s = max(duration_s, duration_s * self.clock_rate + self.time_offset_s)
        first_s = min(0.0, self.time_offset_s)
        return range(-math.ceil(-first_s * self.rate_hz - 1e-6), math.ceil(last_s * self.rate_hz - 1e-6) + 1)


@dataclass(frozen=True, eq=False)
class ImuSamples:
    """What an IMU measured, N samples.

    imu: which one. stamps_ns: (N,) of its own clock. rate_rad_s, force_m_s2: (N, 3) as measured.
    """

    imu: Imu
    stamps_ns: NDArray[np.int64]
    rate_rad_s: Float64
    force_m_s2: Float64

    def true_states(self, also_ns: NDArray[np.int64]) -> "ImuStates | None":
        """Return the true states at the samples, and at other times (M,); None where nobody knows them."""
        del also_ns


@dataclass(frozen=True, eq=False)
class RecordedImu:
    """The IMU of a recording. rig: where it and the colour camera sit on their body. path: the file of the samples."""

    rig: Rig
    samples: ImuSamples
    path: Path


@dataclass(frozen=True, eq=False)
class SimulatedImuSamples(ImuSamples):
    """What an IMU measured along a path that is known.

    first_ns: the path's first stamp. passed_s: (N,) since then, by the cameras' clock. gyro_bias_rad_s,
    accel_bias_m_s2: (N, 3) the true biases.
    """

    path: Trajectory
    first_ns: int
    passed_s: Float64
    gyro_bias_rad_s: Float64
    accel_bias_m_s2: Float64

    @cached_property
    def true_ns(self) -> NDArray[np.int64]:
        """(N,): when the samples were taken, by the cameras' clock."""
        return self.first_ns + np.rint(self.passed_s * NS_PER_S).astype(np.int64)

    def true_states(self, also_ns: NDArray[np.int64]) -> "ImuStates":
        """Return the true states at the samples along the path, and at other times (M,) of it, in order of time."""
        last_ns = self.first_ns + round(float(self.path.stamps_s[-1] - self.path.stamps_s[0]) * NS_PER_S)
        samples_ns = self.true_ns[(self.true_ns >= self.first_ns) & (self.true_ns <= last_ns)]
        also_ns = np.unique(also_ns)
        after = np.searchsorted(also_ns, samples_ns)
        padded_ns = np.concatenate([[_FAR_NS], also_ns, [-_FAR_NS]])
        near = np.minimum(np.abs(padded_ns[after] - samples_ns), np.abs(padded_ns[after + 1] - samples_ns))
        return self.states_at(np.union1d(also_ns, samples_ns[near > _SAME_NS]))

    def states_at(self, times_ns: NDArray[np.int64]) -> "ImuStates":
        """Return the true states of the IMU at times (M,) of the cameras' clock; biases change linearly meanwhile."""
        passed_s = (times_ns - self.first_ns) / NS_PER_S
        motion = imu_motion(self.path, self.imu, passed_s)
        biases = [
            np.stack([np.interp(passed_s, self.passed_s, values[:, axis]) for axis in range(3)], axis=-1)
            for values in (self.gyro_bias_rad_s, self.accel_bias_m_s2)
        ]
        return ImuStates(times_ns, motion, *biases)


@dataclass(frozen=True, eq=False)
class ImuStates:
    """The true states of an IMU at M times of the cameras' clock: motion of its own axes in the world, and biases."""

    stamps_ns: NDArray[np.int64]
    motion: BodyMotion
    gyro_bias_rad_s: Float64
    accel_bias_m_s2: Float64


def imu_motion(path: Trajectory, imu: Imu, passed_s: Float64) -> BodyMotion:
    """Return how an IMU moves on a robot that follows a path, at times (N,) since its first stamp."""
    return motion_of(path.continuous, path.stamps_s[0] + passed_s).carried(imu.robot_from_sensor)


def measure(path: Trajectory, imu: Imu, first_ns: int, identifiers: Identifiers) -> SimulatedImuSamples:
    """Return what an IMU measures along a robot's path; before and after it the robot goes on as fast as there.

    first_ns: the first stamp to the nanosecond. identifiers: the preset's seed and the scene.
    Raises NoisyWorldError for a path without derivatives.
    """
    if path.independent:
        raise NoisyWorldError(f"an IMU has nothing to measure: {path.independent}")
    numbers = imu.sample_numbers(float(path.stamps_s[-1] - path.stamps_s[0]))
    on_clock_s = np.arange(numbers.start, numbers.stop) / imu.rate_hz
    passed_s = (on_clock_s - imu.time_offset_s) / imu.clock_rate
    stamps_ns = first_ns + np.rint(on_clock_s * NS_PER_S).astype(np.int64)
    rate_rad_s, force_m_s2 = _felt(path, imu, numbers)
    errors = ImuErrors(imu.model, imu.rate_hz, stream(*identifiers, IMU_STREAM, "sequence"))
    measured = errors.added(rounded_numbers(rate_rad_s), rounded_numbers(force_m_s2))
    rate_rad_s, force_m_s2, *biases = map(rounded_numbers, measured)
    return SimulatedImuSamples(imu, stamps_ns, rate_rad_s, force_m_s2, path, first_ns, passed_s, *biases)


def _felt(path: Trajectory, imu: Imu, numbers: range) -> tuple[Float64, Float64]:
    """Return true angular velocity and specific force (N, 3) as they pass the low-pass, at samples by their numbers."""
    bandwidth_hz = imu.model.bandwidth_hz
    steps = math.ceil(max(_LEAST_HZ, 8 * bandwidth_hz) / imu.rate_hz) if bandwidth_hz else 1
    weights = low_pass(bandwidth_hz, imu.rate_hz * steps)
    reach = len(weights) // 2
    parts: list[Float64] = []
    for first in range(numbers.start, numbers.stop, _SAMPLES_AT_ONCE):
        last = min(first + _SAMPLES_AT_ONCE, numbers.stop) - 1
        on_clock_s = np.arange(first * steps - reach, last * steps + reach + 1) / (imu.rate_hz * steps)
        motion = imu_motion(path, imu, (on_clock_s - imu.time_offset_s) / imu.clock_rate)
        parts.append(_smoothed(np.concatenate(motion.felt(imu.gravity_m_s2), axis=1), weights, steps))
    felt = np.concatenate(parts)
    return felt[:, :3], felt[:, 3:]


# An IMU's low-pass: a filter that is flat in its band, as those that sum many samples of a converter are. Makers give
# the bandwidth alone; that it falls like this, and that the driver takes its delay off, is a choice.


_FALL = 0.15  # standard deviation of the fall, times the bandwidth: a tenth of it is left at 1.27 times the bandwidth
_HALF_POWER = NormalDist().inv_cdf(math.sqrt(0.5))
_LEAST_HZ = 2000.0  # at which motion is taken for it: what is faster, by the bandwidth, would alias; chosen
_REACH = 5.5  # deviations of the weights in time: less than 1e-6 is left out
_SAMPLES_AT_ONCE = 20_000  # so that memory does not grow with the path; chosen


def low_pass(bandwidth_hz: float, rate_hz: float) -> Float64:
    """Return the weights (odd,) of an IMU's low-pass on values at a rate, without delay; of none, one weight.

    A share normal((edge - f) / fall) - normal((-edge - f) / fall) of a sine of f passes, with fall = 0.15 bandwidth and
    the edge such that half of the power passes at the bandwidth, as data sheets count.
    """
    if bandwidth_hz <= 0:
        return np.ones(1)
    fall_hz = _FALL * bandwidth_hz
    edge_hz = bandwidth_hz + _HALF_POWER * fall_hz
    deviation_s = 1 / (2 * math.pi * fall_hz)
    reach = math.ceil(_REACH * deviation_s * rate_hz)
    times_s = np.arange(-reach, reach + 1) / rate_hz
    weights = np.sinc(2 * edge_hz * times_s) * np.exp(-0.5 * (times_s / deviation_s) ** 2)
    return weights / weights.sum()


def _smoothed(values: Float64, weights: Float64, steps: int = 1) -> Float64:
    """Return the weighted sums of values (N, ...) around every one of `steps`, as far as the weights reach."""
    if len(weights) == 1:
        return values
    count = (len(values) - len(weights)) // steps + 1
    total = np.zeros((count, *values.shape[1:]))
    for place, weight in enumerate(weights.tolist()):
        total += weight * values[place : place + (count - 1) * steps + 1 : steps]
    return total


@dataclass(frozen=True, eq=False)
class ImuErrors:
    """The errors of an IMU's model at a rate, drawn from a generator: more samples begin with the same draws."""

    model: ImuModel
    rate_hz: float
    generator: np.random.Generator

    def added(self, rate_rad_s: Float64, force_m_s2: Float64) -> tuple[Float64, Float64, Float64, Float64]:
        """True angular velocity and specific force (N, 3) -> as measured, and both biases (N, 3).

        A sample of white noise has the deviation density * sqrt(rate), as an ideal filter to half the rate leaves it;
        then it passes the low-pass, which leaves its density in the band. A bias goes on by walk / sqrt(rate) a sample
        (Kalibr's model). Then digits are rounded and the range clips.
        """
        model, root, count = self.model, np.sqrt(self.rate_hz), len(rate_rad_s)
        weights = low_pass(model.bandwidth_hz if 2 * model.bandwidth_hz < self.rate_hz else 0.0, self.rate_hz)
        drawn = self.generator.standard_normal((count + len(weights) - 1, 4, 3))
        white, normals = _smoothed(drawn[:, :2], weights), drawn[:count]
        biases = [
            first + _walked(normals[:, place] * (walk / root))
            for place, walk, first in (
                (2, model.gyro_random_walk, model.gyro_bias_rad_s),
                (3, model.accel_random_walk, model.accel_bias_m_s2),
            )
        ]
        rate = rate_rad_s @ model.gyro_matrix.T + biases[0] + white[:, 0] * (model.gyro_noise_density * root)
        force = force_m_s2 @ model.accel_matrix.T + biases[1] + white[:, 1] * (model.accel_noise_density * root)
        rate = digital(rate, math.radians(model.gyro_step_deg_s), math.radians(model.gyro_range_deg_s))
        return rate, digital(force, model.accel_step_m_s2, model.accel_range_m_s2), biases[0], biases[1]


def _walked(steps: Float64) -> Float64:
    """Return the sums of the steps (N, 3) before each: the first sample has the bias that it begins with."""
    sums = np.zeros_like(steps)
    np.cumsum(steps[:-1], axis=0, out=sums[1:])
    return sums


def digital(values: Float64, step: float, largest: float) -> Float64:
    """Round to the nearest multiple of a step, and clip to the largest that the range holds; 0: neither.

    What is out of range stays at the last multiple inside it.
    """
    if step:
        values = np.rint(values / step) * step
        largest = np.floor(largest / step * (1.0 + 1e-12)) * step
    return np.clip(values, -largest, largest) if largest else values
