# SPDX-License-Identifier: GPL-3.0-or-later
"""Seeded pairs of a true path and an estimate of it, made without the code that scores them."""

from dataclasses import dataclass

import numpy as np

from noisy_world.core.trajectory import Trajectory
from noisy_world.evaluate.estimates import Estimate


@dataclass(frozen=True, eq=False)
class Pair:
    """An estimate of a truth; what is odd about it, in words."""

    truth: Trajectory
    estimate: Estimate
    odd: str


def rotation(rng, angle_rad):
    """Return a rotation by an angle about a random axis, by Rodrigues' formula."""
    axis = rng.normal(size=3)
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle_rad) * cross + (1.0 - np.cos(angle_rad)) * cross @ cross


def path(rng, count, *, start_s=0.0, origin_m=0.0, shape="space", rate_hz=20.0):
    """Return a path that wanders and turns, half turns among it. shape: space, plane, line or still."""
    steps = rng.normal(size=(count, 3)) * 0.05
    positions = np.cumsum(steps, axis=0)
    if shape == "plane":
        positions[:, 2] = 0.0
    elif shape == "line":
        positions = np.outer(np.linspace(0.0, 3.0, count), rng.normal(size=3))
    elif shape == "still":
        positions[:] = 0.0
    c2w = np.tile(np.eye(4), (count, 1, 1))
    c2w[:, :3, 3] = positions + origin_m
    for row in range(count):
        angle = np.pi if row % 17 == 5 else rng.uniform(0.0, np.pi)
        c2w[row, :3, :3] = rotation(rng, angle)
    return Trajectory(c2w, start_s + np.arange(count) / rate_hz)


def moved(c2w, turn, shift, scale=1.0):
    """Return poses whose world is turned, scaled and shifted."""
    out = np.array(c2w)
    out[:, :3, :3] = turn @ c2w[:, :3, :3]
    out[:, :3, 3] = scale * c2w[:, :3, 3] @ turn.T + shift
    return out


def random_pair(seed):
    """Return the pair of a seed: drift, dropped poses, jitter of stamps, other worlds and scales, and odd cases."""
    rng = np.random.default_rng(seed)
    odd = ("", "dropped", "jitter", "far", "plane", "still", "few", "outside", "mirrored", "noise")[seed % 10]
    count = int(rng.integers(25, 45))
    start_s = 1e9 if odd == "jitter" else 0.0
    truth = path(
        rng, count, start_s=start_s, origin_m=1e5 if odd == "far" else 0.0, shape="plane" if odd == "plane" else "space"
    )
    c2w = np.array(truth.c2w)
    c2w[:, :3, 3] += np.cumsum(rng.normal(size=(count, 3)) * 0.01, axis=0)
    for row in range(count):
        c2w[row, :3, :3] = c2w[row, :3, :3] @ rotation(rng, rng.normal() * 0.05)
    if odd == "noise":
        c2w[:, :3, 3] = rng.normal(size=(count, 3))
    if odd == "mirrored":
        c2w[:, 2, 3] *= -1.0
    if odd == "still":
        c2w[:] = c2w[0]
    c2w = moved(c2w, rotation(rng, rng.uniform(0.0, np.pi)), rng.normal(size=3) * 5.0, rng.uniform(0.2, 5.0))
    stamps_s = truth.stamps_s + (
        rng.uniform(-1e-6, 1e-6, count) if odd == "jitter" else rng.uniform(-4e-3, 4e-3, count)
    )
    kept = np.ones(count, dtype=bool)
    if odd in ("dropped", "jitter"):
        kept = rng.uniform(size=count) > 0.3
    if odd == "few":
        kept = np.isin(np.arange(count), rng.choice(count, int(rng.integers(3, 6)), replace=False))
    if odd == "outside":
        stamps_s = stamps_s + 0.05 * int(rng.integers(3, 9))
    return Pair(truth, Estimate(stamps_s[kept], c2w[kept]), odd)
