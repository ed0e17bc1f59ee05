# SPDX-License-Identifier: GPL-3.0-or-later
"""White noise of an IMU, from its samples alone, whether it moves or not: by differences that motion hardly has."""

import numpy as np

from ..trajectories.rig import RecordedImu
from .figure import BLOCKS, Figure, blocks_of, jackknifed
from .footage import Float64

ORDER = 4  # of the differences: what a hand and a body do is smooth over so many samples
SUM_OF_SQUARES = 70.0  # of the weights 1 -4 6 -4 1
LEAST_SAMPLES = 200
CLIPPED = 6.0  # standard deviations: what is beyond is no noise

NAMES = ("gyro_noise_density", "accel_noise_density")  # rad/s/sqrt(Hz), m/s^2/sqrt(Hz)


def imu_noise(imu: RecordedImu | None) -> tuple[Figure, ...]:
    """Return the densities of white noise of the gyroscope and the accelerometer, the mean over their axes.

    Vibration at half of the rate of samples counts as noise, and noise that was filtered as less.
    """
    if imu is None:
        return tuple(Figure.none(name, "there is no IMU") for name in NAMES)
    samples = imu.samples
    if len(samples.stamps_ns) < LEAST_SAMPLES:
        return tuple(Figure.none(name, "there are too few samples") for name in NAMES)
    rate_hz = 1e9 / float(np.median(np.diff(samples.stamps_ns)))
    return tuple(
        _density(name, values, rate_hz)
        for name, values in zip(NAMES, (samples.rate_rad_s, samples.force_m_s2), strict=True)
    )


def _density(name: str, values: Float64, rate_hz: float) -> Figure:
    steps = np.diff(values, n=ORDER, axis=0)
    most = CLIPPED * (1.4826 * np.median(np.abs(steps), axis=0) + 1e-12)
    steps = np.where(np.abs(steps) > most, np.nan, steps)  # knocks and lost samples
    groups = blocks_of(len(steps))
    rounding = np.array([_step(column) ** 2 / 12 for column in values.T])

    def density(rows: Float64) -> float:
        variance = np.nanmean(rows**2, axis=0) / SUM_OF_SQUARES - rounding
        return float(np.sqrt(max(float(np.mean(variance)), 0.0) / rate_hz))

    left_out = np.array([density(steps[groups != group]) for group in range(BLOCKS)])
    return Figure.within(name, density(steps), jackknifed(left_out), len(steps), "samples")


def _step(values: Float64) -> float:
    """Return the step of digits of an axis (N,); 0 where they are too fine to be seen."""
    found = np.unique(values)
    return float(np.median(np.diff(found))) if 1 < len(found) < len(values) / 3 else 0.0
