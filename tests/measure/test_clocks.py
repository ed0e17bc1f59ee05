# SPDX-License-Identifier: GPL-3.0-or-later
"""Clocks that are late and drift, and an IMU that rests, made in closed form."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_noise import Walk

from noisy_world.core.geometry import rotation_from_rotvec
from noisy_world.measure.figure import Figure
from noisy_world.measure.imu_noise import imu_noise
from noisy_world.measure.late_planes import lateness_of_planes
from noisy_world.measure.lateness import depth_lateness, imu_clock_by_poses
from noisy_world.measure.motion import Steps

RNG = np.random.default_rng(11)
WAVES = RNG.uniform(0.3, 2.0, 9), RNG.uniform(0, 6, 9), RNG.normal(0, 1, (6, 9))  # Hz, phases, of six numbers


def motion(at_s):
    """Six smooth numbers at times (N,)."""
    hz, phase, of = WAVES
    return np.sin(2 * np.pi * np.outer(at_s, hz) + phase) @ of.T


@pytest.mark.parametrize(("late_frames", "ms_per_min"), [(1.3, 0.0), (-0.4, 40.0)])
def test_depth_that_is_late_and_drifts(late_frames, ms_per_min):
    rate_hz, count = 15.0, 600
    at_s = np.arange(count + 1) / rate_hz
    middle_s = (at_s[1:] + at_s[:-1]) / 2
    late_s = late_frames / rate_hz + ms_per_min / 6e4 * (middle_s - middle_s.mean())
    frames = np.stack([np.arange(count), np.arange(count) + 1], axis=1)
    none = np.zeros(count, np.bool_)
    noise = RNG.normal(0, 0.3, (count, 6))
    steps = Steps(
        frames,
        np.zeros(count, np.int64),
        motion(middle_s),
        np.tile(np.eye(6), (count, 1, 1)),
        motion(middle_s - late_s) + noise,
        none,
        none,
        np.full(count, 9.0),
        {},
    )
    late, drift = depth_lateness(steps, at_s)
    assert late.value == pytest.approx(late_frames, abs=0.1)
    assert drift.low < ms_per_min < drift.high
    assert drift.value == pytest.approx(ms_per_min, abs=8)
    short, untold = depth_lateness(steps, at_s / 10)
    assert short.value == late.value
    assert "apart" in untold.untold
    steps.normal[: count // 4] = 0.0  # no depth there
    _, untold = depth_lateness(steps, at_s)
    assert untold.untold == "some parts of the recording do not tell it"


def test_depth_that_is_late_by_planes_of_it():
    """A camera goes to and fro along a wall; depth's range flow is not asked."""
    late_frames, untold = 1.3, Figure.none("depth_late_frames", "not asked")
    frames = np.arange(34)

    def place_m(frame):
        return 0.25 * np.sin(2 * np.pi * frame / 17)

    def noise(z):
        return RNG.normal(0, 0.001, z.shape) * z**2

    walk = Walk(place_m(frames - late_frames), noise, by_colour_m=place_m(frames))
    walk.stamps = SimpleNamespace(rgb=SimpleNamespace(seconds=frames / 30))
    late = lateness_of_planes(walk, walk.steps, untold)
    assert late.value == pytest.approx(late_frames, abs=0.1)
    assert late.low < late_frames < late.high
    assert late.half_width < 0.5
    few = replace(walk.steps, run=np.arange(len(walk.steps)) // 6)
    assert lateness_of_planes(walk, few, untold) is untold


def resting(values, at_ns):
    eye = np.eye(4)
    samples = SimpleNamespace(
        stamps_ns=at_ns, rate_rad_s=values, force_m_s2=values, imu=SimpleNamespace(robot_from_sensor=eye)
    )
    return SimpleNamespace(samples=samples, rig=SimpleNamespace(rgb=SimpleNamespace(robot_from_sensor=eye)))


@pytest.mark.parametrize(
    ("still_s", "along"),  # until when it does not turn, and about which axis it says that it does
    [(-9.0, [0, 0, 1]), (20.0, [0, 0, 1]), (20.0, [1, 0, 0])],
)
def test_an_imus_clock_that_drifts(still_s, along):
    ppm, offset_s = 400.0, 0.012

    def turned(times_s):
        return 0.2 * np.where(times_s[:, None] < still_s, 0.0, motion(times_s)[:, :1]) * np.array([0.0, 0.0, 1.0])

    at_s = np.arange(0, 60, 0.05)
    path = SimpleNamespace(known=np.ones(len(at_s), np.bool_), c2w=np.tile(np.eye(4), (len(at_s), 1, 1)))
    path.c2w[:, :3, :3] = rotation_from_rotvec(turned(at_s))
    imu_s = np.arange(-2, 62, 0.005)
    step_s = 1e-4
    rate = (turned(imu_s + step_s) - turned(imu_s - step_s)) / (2 * step_s)
    rate = rate[:, 2:] * np.array(along, np.float64)
    said_s = imu_s + offset_s + ppm * 1e-6 * (imu_s - 30)
    clock, drift = imu_clock_by_poses(resting(rate, np.rint(said_s * 1e9).astype(np.int64)), path, at_s)
    assert clock.value == pytest.approx(offset_s, abs=0.004)  # of the parts with most motion
    if still_s > 0:
        assert "some parts" in drift.untold
        return
    assert drift.value == pytest.approx(ppm, abs=40)
    assert drift.low < ppm < drift.high


def test_an_imu_at_rest():
    rate_hz, density, count = 200.0, 1e-3, 200 * 60
    white = RNG.normal(0, density * rate_hz**0.5, (count, 3))
    at_ns = (np.arange(count) / rate_hz * 1e9).astype(np.int64)
    found = {figure.name: figure for figure in imu_noise(resting(white, at_ns))}
    assert found["gyro_rest_noise_density"].value == pytest.approx(density, rel=0.1)
    assert "no half" in found["gyro_bandwidth_hz"].untold
    # Butterworth's low-pass of second order: half of the power passes at 40 Hz.
    frequency_hz = np.fft.rfftfreq(count, 1 / rate_hz)
    passed = np.fft.irfft(np.fft.rfft(white, axis=0) / np.sqrt(1 + (frequency_hz[:, None] / 40) ** 4), count, axis=0)
    found = {figure.name: figure for figure in imu_noise(resting(passed, at_ns))}
    assert found["accel_rest_noise_density"].value == pytest.approx(density, rel=0.1)
    assert found["accel_bandwidth_hz"].value == pytest.approx(40, rel=0.1)
    assert found["accel_bandwidth_hz"].low < 40 < found["accel_bandwidth_hz"].high
    moving = imu_noise(resting(white + 50 * density * motion(at_ns / 1e9)[:, :3], at_ns))
    untold = {figure.name: figure.untold for figure in moving}
    assert "rests for less" in untold["gyro_rest_noise_density"]
    assert untold["gyro_noise_density"] == ""
