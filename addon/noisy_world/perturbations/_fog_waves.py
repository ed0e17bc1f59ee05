# SPDX-License-Identifier: GPL-3.0-or-later
"""Uneven fog: a field of waves in the world, of which both executions know the mean between any two depths.

The field is the sum of amplitude x cos(k . place + phase). Amplitudes go with the cube root of the
wavelength, as turbulence makes them (Kolmogorov, The local structure of turbulence, 1941), and fog lies in layers, so
waves are flatter than wide. A wave's mean along a ray between two depths is a cosine in their middle times
sin(x) / x. It is taken in slabs of depth on a coarse grid of rays, as all of it is smooth, and put together for each
pixel by its own depth.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.streams import stream
from ..core.trajectories.camera_state import CameraState

Float32: TypeAlias = NDArray[np.float32]
Float64: TypeAlias = NDArray[np.float64]

OCTAVES = 3
WAVES = 18  # six an octave; chosen: fewer are seen as waves
FLATTER = 2.5  # than wide; chosen, as fog banks look
# Edges of the slabs, as shares of the visibility: farther, less than 3 % of the light comes through. Chosen.
EDGES = (0.0, 0.04, 0.1, 0.2, 0.4, 0.7, 1.2)
GRID_PX = 8  # a ray for so many pixels along a side
KEY_BITS = 12  # of the seed and of the frame that a phase takes at a time, so that float32 keeps its fraction


@dataclass(frozen=True)
class Wave:
    """A wave of the field, of clumps of 1 m.

    vector: (right, forward, up) radians a metre. amplitude: so that the field's standard deviation is 1. turns: the
    phase's turns for the lower and the higher bits of the seed, and for those of the frame.
    """

    vector: tuple[float, float, float]
    amplitude: float
    turns: tuple[float, float, float]


@lru_cache(maxsize=1)
def waves() -> tuple[Wave, ...]:
    """Return the waves, the longest first. Their numbers have few digits, so they are equal on all processors."""
    drawn = stream("waves of fog")
    per_octave = WAVES // OCTAVES
    lengths = [2.0 ** -(k / per_octave) for k in range(WAVES)]
    amplitudes = np.cbrt(lengths)
    amplitudes *= math.sqrt(2 / (amplitudes @ amplitudes))
    found = []
    for length, amplitude in zip(lengths, amplitudes, strict=True):
        angle, up = 2 * math.pi * drawn.random(), 2 * drawn.random() - 1
        flat = math.sqrt(1 - up * up)
        size = 2 * math.pi / length
        vector = flat * math.cos(angle) * size, flat * math.sin(angle) * size, up * size * FLATTER
        turns = tuple(round(float(value), 6) for value in drawn.random(3))
        x, y, z = (round(value, 4) for value in vector)
        found.append(Wave((x, y, z), round(float(amplitude), 6), (turns[0], turns[1], turns[2])))
    return tuple(found)


@dataclass(frozen=True)
class Bank:
    """Uneven fog as a camera stands in it.

    clump_m: the longest wavelength. blown_m: how far the wind has carried it to the right. reach_m: the visibility.
    key: (3,) whole numbers, of which the phases are made: `key_of`.
    """

    clump_m: float
    blown_m: float
    reach_m: float
    key: tuple[int, int, int]


def key_of(seed: int, frame: int) -> tuple[int, int, int]:
    """Return lower and higher bits of a seed below 2^24, and the lower bits of a frame's number."""
    return seed % (1 << KEY_BITS), seed >> KEY_BITS, frame % (1 << KEY_BITS)


def phases_rad(bank: Bank, camera_state: CameraState) -> Float64:
    """Return (N,): each wave's phase at the camera."""
    right, down, forward = camera_state.position_m
    place = np.array([right - bank.blown_m, forward, -down]) / bank.clump_m
    parts = np.array(bank.key, np.float32) * np.array([wave.turns for wave in waves()], np.float32)
    turns = (parts - np.floor(parts)).sum(axis=1, dtype=np.float64)
    return 2 * np.pi * turns + np.array([wave.vector for wave in waves()]) @ place


def slab_means(bank: Bank, camera_state: CameraState, rays: Float32) -> Float32:
    """Return (slabs, H, W): the field's mean in each slab along rays (3, H, W), right, down, forward, of depth 1."""
    axes = camera_state.rotation
    directions = np.array([axes[0], axes[2], -axes[1]])  # right, forward, up of the air, by the camera's axes
    edges_m = np.array(EDGES) * bank.reach_m
    middles_m = ((edges_m[1:] + edges_m[:-1]) / 2).astype(np.float32)[:, None, None]
    halves_m = ((edges_m[1:] - edges_m[:-1]) / 2).astype(np.float32)[:, None, None]
    found = np.zeros((len(middles_m), *rays.shape[1:]), np.float32)
    for wave, phase in zip(waves(), phases_rad(bank, camera_state), strict=True):
        x, y, z = (np.array(wave.vector) / bank.clump_m @ directions).astype(np.float32)
        rate = x * rays[0] + y * rays[1] + z * rays[2]  # radians for a metre of depth
        # numpy's sinc is of pi x.
        evened = np.sinc(rate * halves_m * np.float32(1 / np.pi))
        evened *= np.cos(rate * middles_m + np.float32(phase % (2 * np.pi)))
        evened *= np.float32(wave.amplitude)
        found += evened
    return found


def mean_before(means: Float32, reach_m: float, distance_m: Float32) -> Float32:
    """Return (H, W): the field's mean from the camera to each distance, from slabs of a coarse grid (slabs, h, w).

    What is beyond the last slab is like what is before it.
    """
    import cv2

    height, width = distance_m.shape
    edges_m = np.array(EDGES, np.float32) * np.float32(reach_m)
    near_m = np.minimum(distance_m, edges_m[-1])
    total = np.zeros_like(near_m)
    for mean, begin_m, end_m in zip(means, edges_m[:-1], edges_m[1:], strict=True):
        part = np.clip(near_m, begin_m, end_m)
        part -= begin_m
        part *= np.asarray(cv2.resize(mean, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
        total += part
    total /= np.maximum(near_m, np.float32(1e-6))
    return total
