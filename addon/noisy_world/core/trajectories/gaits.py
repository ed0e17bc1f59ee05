# SPDX-License-Identifier: GPL-3.0-or-later
"""How the camera of a body moves beside its mean way: closed formulas of walking, running, trotting, rolling, flying.

Each gives offsets over time, in the body's own axes: x forward, y left, z up. What is periodic follows the phase of the
steps, whose rate follows the speed; what is slow and irregular are seeded waves.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float64: TypeAlias = NDArray[np.float64]

GRAVITY_M_S2 = 9.80665
STANDING_M_S = 0.3  # below this speed steps grow shorter until the body stands; chosen


@dataclass(frozen=True, eq=False)
class Way:
    """How a body goes: times (N,) seconds, evenly apart, speed (N,) m/s, walked (N,) metres, acceleration (N, 2) m/s^2.

    acceleration_m_s2: forward and to the left.
    """

    times_s: Float64
    speed_m_s: Float64
    walked_m: Float64
    acceleration_m_s2: Float64

    @property
    def going(self) -> Float64:
        """(N,) from 0, where the body stands, to 1, where it goes as it does; with two continuous derivatives."""
        u = np.clip(self.speed_m_s / STANDING_M_S, 0.0, 1.0)
        return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)

    def steps(self, rate_hz: Float64) -> Float64:
        """(N,) -> (N,) radians: the phase of the steps, of a rate over time."""
        gap_s = np.diff(self.times_s, prepend=self.times_s[0])
        return 2.0 * np.pi * np.cumsum(rate_hz * gap_s)


@dataclass(frozen=True, eq=False)
class Offsets:
    """What the camera does beside its mean way: moved (N, 3) metres, turned (N, 3) radians: roll, pitch, yaw.

    Both in the body's axes: x forward, y left, z up; a positive pitch looks down.
    """

    moved_m: Float64
    turned_rad: Float64


Gait: TypeAlias = Callable[[Way, np.random.Generator], Offsets]


def walking(way: Way, rng: np.random.Generator) -> Offsets:
    """Return the head's motion in walking.

    Steps a second and their length grow together, 0.0065 m for each step a minute (Sekiya and Nagasaki, Gait and
    Posture 7, 1998). The rise is a share of that of a stiff leg of 0.9 m, which overestimates it (Gard, Miff and Kuo,
    Human Movement Science 22, 2004). Sideways once a stride, 1 to 2 cm; the head pitches against the rise, by about a
    degree (Hirasaki et al., Experimental Brain Research 127, 1999).
    """
    rate_hz = _walking_rate_hz(way.speed_m_s)
    length_m = way.speed_m_s / rate_hz
    rise_m = 0.6 * (0.9 - np.sqrt(0.81 - np.minimum(length_m, 1.2) ** 2 / 4.0)) / 2.0
    phase, size = way.steps(rate_hz), way.going * _varied(rng, way)
    vertical = np.cos(phase) + 0.15 * np.cos(2.0 * phase + 0.6) + 0.05 * np.cos(3.0 * phase + 1.1)
    return _offsets(
        size,
        moved_m=(0.008 * np.sin(phase), 0.015 * np.sin(phase / 2.0), -rise_m * vertical),
        turned_deg=(
            0.7 * np.sin(phase / 2.0 + 0.4),
            1.0 * np.cos(phase + 0.3) + 0.2 * np.cos(2.0 * phase),
            1.0 * np.sin(phase / 2.0 + 1.0),
        ),
    )


def running(way: Way, rng: np.random.Generator) -> Offsets:
    """Return the head's motion in running: 2.6 to 3.4 steps a second, 8 cm of rise, impacts up to 20 Hz.

    Step rate and rise: Cavagna, Franzetti, Heglund and Willems, Journal of Physiology 399, 1988. Harmonics of the
    impact fall as the third power of their number, up to the sixth.
    """
    rate_hz = 2.6 + 0.8 * np.clip((way.speed_m_s - 1.5) / 4.0, 0.0, 1.0)
    phase, size = way.steps(rate_hz), way.going * _varied(rng, way)
    vertical = sum((np.cos(k * phase + 0.5 * (k - 1)) / k**3 for k in range(1, 7)), np.zeros_like(phase))
    return _offsets(
        size,
        moved_m=(0.012 * np.sin(phase), 0.010 * np.sin(phase / 2.0), -0.037 * vertical),
        turned_deg=(
            1.0 * np.sin(phase / 2.0 + 0.4),
            1.8 * np.cos(phase + 0.3) + 0.3 * np.cos(2.0 * phase),
            1.8 * np.sin(phase / 2.0 + 1.0),
        ),
    )


def trotting(way: Way, rng: np.random.Generator) -> Offsets:
    """Return the trunk's motion of a small quadruped that trots: two strides a second, so a bounce at 4 Hz.

    Standard deviations of roll, .66 degrees, and pitch, .22, are those of an open-loop trot at .49 m/s that was
    simulated with rigid bodies and contacts.
    """
    phase, size = way.steps(np.full_like(way.speed_m_s, 4.0)), way.going * _varied(rng, way)
    vertical = np.cos(phase) + 0.3 * np.cos(2.0 * phase + 0.7) + 0.1 * np.cos(3.0 * phase + 0.2)
    return _offsets(
        size,
        moved_m=(0.003 * np.sin(phase), 0.004 * np.sin(phase / 2.0), -0.005 * vertical),
        turned_deg=(0.92 * np.sin(phase / 2.0 + 0.4), 0.31 * np.cos(phase + 0.3), 0.5 * np.sin(phase / 2.0 + 1.0)),
    )


WHEELBASE_M, TRACK_M = 0.5, 0.4
ROUGHNESS_M3 = 16e-6  # ISO 8608: the spectral density of class A at 0.1 cycles a metre; it falls as the square
WAVES_PER_M = (0.2, 8.0)  # of the floor, in cycles a metre: longer ones are slopes, a wheel does not feel shorter ones


def rolling(way: Way, rng: np.random.Generator) -> Offsets:
    """Return the motion of a stiff four-wheeled rover on a rough floor: each side's wheels follow a profile of its own.

    The profiles are of ISO 8608's class A, which is a good road; rise, pitch and roll follow from the four wheels.
    """
    profiles = [_profile(rng) for _ in range(2)]
    heights_m = np.array(
        [[profile(way.walked_m + along * WHEELBASE_M / 2.0) for along in (1.0, -1.0)] for profile in profiles]
    )
    left, right = heights_m
    pitch = (heights_m[:, 1].mean(axis=0) - heights_m[:, 0].mean(axis=0)) / WHEELBASE_M
    roll = (left.mean(axis=0) - right.mean(axis=0)) / TRACK_M
    nothing = np.zeros_like(roll)
    return Offsets(
        np.stack([nothing, nothing, heights_m.mean(axis=(0, 1))], axis=-1), np.stack([roll, pitch, nothing], axis=-1)
    )


def flying(way: Way, rng: np.random.Generator) -> Offsets:
    """Return the motion of a multicopter: it leans as far as it accelerates, and wanders by centimetres.

    A rotorcraft's thrust is along its own axis, so it pitches by atan(a / g) to accelerate (Mahony, Kumar and Corke,
    Multirotor aerial vehicles, 2012). The rotors' vibration is no part of it.
    """
    forward, left = way.acceleration_m_s2.T
    wander_m = 0.02 * np.stack([_waves(rng, way.times_s, 0.1, 0.6) for _ in range(3)], axis=-1)
    turned = np.stack(
        [
            -np.arctan2(left, GRAVITY_M_S2) + np.deg2rad(0.5) * _waves(rng, way.times_s, 0.3, 1.5),
            np.arctan2(forward, GRAVITY_M_S2) + np.deg2rad(0.5) * _waves(rng, way.times_s, 0.3, 1.5),
            np.deg2rad(1.0) * _waves(rng, way.times_s, 0.1, 0.6),
        ],
        axis=-1,
    )
    return Offsets(wander_m, turned)


def _walking_rate_hz(speed_m_s: Float64) -> Float64:
    """(N,) -> (N,): steps a second; not below 40 a minute."""
    return np.maximum(np.sqrt(60.0 * speed_m_s / 0.0065), 40.0) / 60.0


def _offsets(size: Float64, moved_m: tuple[Float64, ...], turned_deg: tuple[Float64, ...]) -> Offsets:
    """Return offsets, all of them times `size` (N,)."""
    return Offsets(
        size[:, None] * np.stack(moved_m, axis=-1), np.deg2rad(size[:, None] * np.stack(turned_deg, axis=-1))
    )


def _varied(rng: np.random.Generator, way: Way) -> Float64:
    """(N,): no two strides are alike: amplitudes change by a few percent within seconds."""
    return 1.0 + 0.08 * _waves(rng, way.times_s, 0.1, 0.5)


def _waves(rng: np.random.Generator, times_s: Float64, low_hz: float, high_hz: float) -> Float64:
    """(N,) in [-1, 1]: the mean of a few sine waves of drawn frequencies and phases."""
    hz = rng.uniform(low_hz, high_hz, 6)
    phase = rng.uniform(0.0, 2.0 * np.pi, 6)
    return np.sin(2.0 * np.pi * np.outer(times_s, hz) + phase).mean(axis=-1)


def _profile(rng: np.random.Generator) -> Callable[[Float64], Float64]:
    """Return a floor's height over the way, metres: sine waves, a part of the spectrum each."""
    edges = np.geomspace(*WAVES_PER_M, 41)
    middle = np.sqrt(edges[:-1] * edges[1:])
    density_m3 = ROUGHNESS_M3 * (middle / 0.1) ** -2.0
    amplitude_m = np.sqrt(2.0 * density_m3 * np.diff(edges))
    phase = rng.uniform(0.0, 2.0 * np.pi, len(middle))
    per_m = rng.uniform(edges[:-1], edges[1:])

    def height_m(walked_m: Float64) -> Float64:
        found = np.zeros_like(walked_m)
        for amplitude, wave, start in zip(amplitude_m, per_m, phase, strict=True):
            found += amplitude * np.sin(2.0 * np.pi * wave * walked_m + start)
        return found

    return height_m
