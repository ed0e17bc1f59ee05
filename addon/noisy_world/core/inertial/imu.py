# SPDX-License-Identifier: GPL-3.0-or-later
"""An IMU on a robot: where it sits, when it measures, and what it measures along the robot's path."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..errors import NoisyWorldError
from ..streams import Identifiers, stream
from ..trajectories.body_motion import BodyMotion
from ..trajectories.curve import motion_of
from ..trajectories.rounding import rounded_numbers
from ..trajectories.stamps import NS_PER_S
from ..trajectories.trajectory import Trajectory
from .devices import ImuModel

Float64: TypeAlias = NDArray[np.float64]

IMU_STREAM = "rig.imu"  # what an IMU draws by, whatever the setting
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
    """What an IMU measured along a path, N samples.

    imu: which one. stamps_ns: (N,) of its own clock. passed_s: (N,) since the path's beginning, by the cameras' clock.
    rate_rad_s, force_m_s2: (N, 3) as measured. gyro_bias_rad_s, accel_bias_m_s2: (N, 3) the true biases.
    """

    imu: Imu
    path: Trajectory
    first_ns: int
    stamps_ns: NDArray[np.int64]
    passed_s: Float64
    rate_rad_s: Float64
    force_m_s2: Float64
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


def measure(path: Trajectory, imu: Imu, first_ns: int, identifiers: Identifiers) -> ImuSamples:
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
    rate_rad_s, force_m_s2 = imu_motion(path, imu, passed_s).felt(imu.gravity_m_s2)
    errors = ImuErrors(imu.model, imu.rate_hz, stream(*identifiers, IMU_STREAM, "sequence"))
    measured = errors.added(rounded_numbers(rate_rad_s), rounded_numbers(force_m_s2))
    return ImuSamples(imu, path, first_ns, stamps_ns, passed_s, *map(rounded_numbers, measured))


@dataclass(frozen=True, eq=False)
class ImuErrors:
    """The errors of an IMU's model at a rate, drawn from a generator: more samples begin with the same draws."""

    model: ImuModel
    rate_hz: float
    generator: np.random.Generator

    def added(self, rate_rad_s: Float64, force_m_s2: Float64) -> tuple[Float64, Float64, Float64, Float64]:
        """True angular velocity and specific force (N, 3) -> as measured, and both biases (N, 3).

        A sample of white noise has the deviation density * sqrt(rate), as an ideal filter to half the rate leaves it;
        a bias goes on by walk / sqrt(rate) a sample (Kalibr's model). Then digits are rounded and the range clips.
        """
        model, root = self.model, np.sqrt(self.rate_hz)
        normals = self.generator.standard_normal((len(rate_rad_s), 4, 3))
        biases = [
            first + _walked(normals[:, place] * (walk / root))
            for place, walk, first in (
                (2, model.gyro_random_walk, model.gyro_bias_rad_s),
                (3, model.accel_random_walk, model.accel_bias_m_s2),
            )
        ]
        rate = rate_rad_s @ model.gyro_matrix.T + biases[0] + normals[:, 0] * (model.gyro_noise_density * root)
        force = force_m_s2 @ model.accel_matrix.T + biases[1] + normals[:, 1] * (model.accel_noise_density * root)
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
