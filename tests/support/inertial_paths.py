# SPDX-License-Identifier: GPL-3.0-or-later
"""Smooth paths whose derivatives are known, and integration of what an IMU measured along them."""

import numpy as np

from noisy_world.core.geometry import pose, rotation_from_rotvec
from noisy_world.core.trajectory import Trajectory

GRAVITY_M_S2 = np.array([0.0, 0.0, -9.81])


def lively_path(duration_s=8.0, rate_hz=20.0, *, seed=1, highest_hz=4.0, strength=1.0):
    """A path of sines up to a frequency, by its poses at a rate: at strength 1 up to 17 m/s^2 and 2.3 rad/s."""
    random = np.random.default_rng(seed)
    times_s = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    frequency_hz = random.uniform(0.2, highest_hz, (6, 4))
    amplitude = strength * np.array([[0.05]] * 3 + [[0.1]] * 3) / frequency_hz
    phase = random.uniform(0, 2 * np.pi, (6, 4))
    waves = (amplitude * np.sin(2 * np.pi * frequency_hz * times_s[:, None, None] + phase)).sum(axis=-1)
    return Trajectory(pose(rotation_from_rotvec(waves[:, 3:]), waves[:, :3]), times_s)


def circle(radius_m=2.0, rate_rad_s=1.5, duration_s=4.0, rate_hz=100.0):
    """A body that faces along a circle about the world's z: x forward, y to the centre, z up."""
    times_s = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    angle = rate_rad_s * times_s
    zero, one = np.zeros_like(angle), np.ones_like(angle)
    forward = np.stack([-np.sin(angle), np.cos(angle), zero], axis=-1)
    inward = np.stack([-np.cos(angle), -np.sin(angle), zero], axis=-1)
    turn = np.stack([forward, inward, np.stack([zero, zero, one], axis=-1)], axis=-1)
    return Trajectory(pose(turn, -radius_m * inward), times_s)


def integrated(rate_rad_s, force_m_s2, dt_s, first):
    """Where a body is after each sample, by the midpoint rule from its true first state: (N, 3, 3), (N, 3)."""
    rotation, position_m, velocity_m_s = first
    turns, places = [rotation], [position_m]
    for k in range(len(rate_rad_s) - 1):
        later = rotation @ rotation_from_rotvec(0.5 * (rate_rad_s[k] + rate_rad_s[k + 1]) * dt_s)
        pull = 0.5 * (rotation @ force_m_s2[k] + later @ force_m_s2[k + 1]) + GRAVITY_M_S2
        position_m = position_m + velocity_m_s * dt_s + 0.5 * pull * dt_s**2
        velocity_m_s, rotation = velocity_m_s + pull * dt_s, later
        turns.append(rotation)
        places.append(position_m)
    return np.array(turns), np.array(places)


def overlapping_allan_variance(values, rate_hz, averaging_s):
    """The overlapping Allan variance of rates (N, 3) at averaging times, by its definition on their integral."""
    angle = np.concatenate([np.zeros((1, 3)), np.cumsum(values, axis=0)]) / rate_hz
    found = []
    for tau_s in averaging_s:
        m = round(tau_s * rate_hz)
        second = angle[2 * m :] - 2 * angle[m:-m] + angle[: -2 * m]
        found.append((second**2).mean(axis=0) / (2 * (m / rate_hz) ** 2))
    return np.array(found)
