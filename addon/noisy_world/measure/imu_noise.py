# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise of an IMU from its samples alone: white, whether it moves or not, and density and bandwidth where it rests.

While it moves, by differences that motion hardly has.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..trajectories.rig import RecordedImu
from .figure import BLOCKS, Figure, blocks_of, jackknifed
from .footage import Float64

ORDER = 4  # of the differences: what a hand and a body do is smooth over so many samples
SUM_OF_SQUARES = 70.0  # of the weights 1 -4 6 -4 1
LEAST_SAMPLES = 200
CLIPPED = 6.0  # standard deviations: what is beyond is no noise

REST_S = 1.0  # long windows, whose spectra are averaged where the IMU rests
RESTS = 2.5  # times the white noise of differences: what a window at rest deviates by at most, without its trend
LEAST_REST = 8  # windows
LOW, HIGH = (0.01, 0.12), 0.45  # of the rate of samples: where density is read, and up to where a fall is looked for

NAMES = ("gyro_noise_density", "accel_noise_density")  # rad/s/sqrt(Hz), m/s^2/sqrt(Hz)
AT_REST = ("gyro_rest_noise_density", "accel_rest_noise_density")
BANDWIDTHS = ("gyro_bandwidth_hz", "accel_bandwidth_hz")


def imu_noise(imu: RecordedImu | None) -> tuple[Figure, ...]:
    """Return the densities of white noise of gyroscope and accelerometer, the mean over their axes; those at rest; and
    at which frequency their noise falls to half of its power.

    In motion, vibration at half of the rate of samples counts as noise, and noise that was filtered as less. At rest it
    is that of low frequencies, so a filter does not lower it.
    """
    if imu is None:
        return tuple(Figure.none(name, "there is no IMU") for name in (*NAMES, *AT_REST, *BANDWIDTHS))
    samples = imu.samples
    if len(samples.stamps_ns) < LEAST_SAMPLES:
        return tuple(Figure.none(name, "there are too few samples") for name in (*NAMES, *AT_REST, *BANDWIDTHS))
    rate_hz = 1e9 / float(np.median(np.diff(samples.stamps_ns)))
    both = samples.rate_rad_s, samples.force_m_s2
    moving = [_density(name, values, rate_hz) for name, values in zip(NAMES, both, strict=True)]
    resting = _resting([_windows(values, rate_hz) for values in both])
    still = [_at_rest(names, windows, rate_hz) for *names, windows in zip(AT_REST, BANDWIDTHS, resting, strict=True)]
    return (*moving, *(density for density, _ in still), *(bandwidth for _, bandwidth in still))


def _windows(values: Float64, rate_hz: float) -> Float64:
    """Return (N, samples, 3): windows of REST_S without their lines."""
    long = max(round(REST_S * rate_hz), 16)
    count = len(values) // long
    cut = values[: count * long].reshape(count, long, -1)
    line = np.stack([np.ones(long), np.linspace(-1, 1, long)], axis=1)
    return cut - np.einsum("ij,njk->nik", line @ np.linalg.pinv(line), cut)


def _resting(both: list[Float64]) -> list[Float64]:
    """Return the windows in which neither sensor deviates by more than the noise of its own quietest ones."""
    at_rest = np.ones(len(both[0]), np.bool_)
    for windows in both:
        quick = np.diff(windows, n=ORDER, axis=1)
        white = np.sqrt(np.median(quick**2, axis=1) / 0.4549 / SUM_OF_SQUARES)  # chi squared's median
        whole = windows.std(axis=1)
        least = np.maximum(np.quantile(whole, 0.02, axis=0), 1e-12) if len(whole) else 1e-12
        at_rest &= ((whole < RESTS * np.maximum(white, 1e-12)) | (whole < 1.5 * least)).all(axis=1)
    return [windows[at_rest] for windows in both]


def _at_rest(names: Sequence[str], windows: Float64, rate_hz: float) -> tuple[Figure, Figure]:
    """Return density and bandwidth, of the mean spectrum over windows and axes."""
    if len(windows) < LEAST_REST:
        why = f"the IMU rests for less than {LEAST_REST * REST_S:g} s"
        return Figure.none(names[0], why), Figure.none(names[1], why)
    long = windows.shape[1]
    taper = np.hanning(long)[None, :, None]
    power = np.mean(np.abs(np.fft.rfft(windows * taper, axis=1)) ** 2, axis=2) / (rate_hz * np.sum(taper**2))
    frequency = np.fft.rfftfreq(long)  # of the rate of samples
    low = (frequency >= LOW[0]) & (frequency <= LOW[1])
    groups = blocks_of(len(power))

    def told(kept: NDArray[np.bool_]) -> tuple[float, float]:
        mean = power[kept].mean(axis=0)
        density = float(np.sqrt(mean[low].mean()))
        smooth = np.convolve(mean, np.ones(5) / 5, "same")
        fallen = np.flatnonzero((smooth < density**2 / 2) & (frequency > LOW[0]) & (frequency < HIGH))
        return density, float(frequency[fallen[0]] * rate_hz) if fallen.size else np.nan

    density, falls_hz = told(groups >= 0)
    left_out = np.array([told(groups != group) for group in range(BLOCKS)])
    figure = Figure.within(names[0], density, jackknifed(left_out[:, 0]), len(windows), "windows at rest")
    if not np.isfinite([falls_hz, *left_out[:, 1]]).all():
        return figure, Figure.none(names[1], f"noise falls to no half below {HIGH * rate_hz:.3g} Hz")
    error_hz = float(np.hypot(jackknifed(left_out[:, 1]), rate_hz / long))
    return figure, Figure.within(names[1], falls_hz, error_hz, len(windows), "windows at rest")


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
