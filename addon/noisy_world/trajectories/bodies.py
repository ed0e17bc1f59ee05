# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies that carry the camera along a route: a head that walks or runs, a quadruped, a rover, a drone."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.curve import SplineCurve
from ..core.errors import NoisyWorldError
from ..core.geometry import opencv_from_robot_c2w, pose, rotation_from_euler_deg, rotation_from_rotvec
from ..core.streams import stream
from ..core.trajectory import MOST_POSES, Trajectory

# Paths and what belongs to them, made smooth.


Float64: TypeAlias = NDArray[np.float64]


def blurred(rows: Float64, sigma: float) -> Float64:
    """(N, C) -> (N, C): each column blurred with a Gaussian of sigma rows, cut at 3 sigma; the ends are repeated."""
    reach = int(3.0 * sigma)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    padded = np.pad(rows, ((reach, reach), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, kernel, mode="valid") for column in padded.T], axis=-1)


# How the camera of a body moves beside its mean way: closed formulas of walking, running, trotting, rolling, flying.
#
# Each gives offsets over time, in the body's own axes: x forward, y left, z up. What is periodic follows the phase of
# the steps, whose rate follows the speed; what is slow and irregular are seeded waves.


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


BodyKind: TypeAlias = Literal["walker", "runner", "quadruped", "rover", "drone"]

RATE_HZ = 200.0
"""Of the poses that a body's path in continuous time goes through: content up to 20 Hz is smooth between them."""
SMOOTH_S = 0.25  # the sigma of a Gaussian over a body's speed: it takes steps, not centimetres; chosen
TURN_S = 0.8  # that over its direction: turning back takes some three seconds, at 90 degrees a second at most; chosen
SLOW_M_S = 0.05  # below this speed the way's direction says nothing


@dataclass(frozen=True)
class CarryingBody:
    """A kind of body.

    height_m: of its camera above the floor. radius_m: what it needs around it. stands: whether all has to be free from
    the floor to its camera, but for what is lower than step_m; a drone needs what is around it alone. looks: whether
    its camera looks where the route's does, as a head may, or ahead.
    """

    gait: Gait
    height_m: float
    radius_m: float
    step_m: float
    stands: bool
    looks: bool

    @property
    def route(self) -> dict[str, Any]:
        """What a hand-held path has to be to be its route, as arguments of `handheld_path`."""
        step_m = self.step_m if self.stands else None
        return {"eye_height_m": (self.height_m, self.height_m), "steady": True, "step_m": step_m}


# Chosen: an adult's eyes and shoulders, a small quadruped, a rover of half a metre, a drone of 30 cm.
BODIES: dict[str, CarryingBody] = {
    "walker": CarryingBody(walking, 1.6, 0.25, 0.1, stands=True, looks=True),
    "runner": CarryingBody(running, 1.6, 0.25, 0.1, stands=True, looks=True),
    "quadruped": CarryingBody(trotting, 0.45, 0.2, 0.05, stands=True, looks=False),
    "rover": CarryingBody(rolling, 0.4, 0.3, 0.03, stands=True, looks=False),
    "drone": CarryingBody(flying, 1.4, 0.2, 0.0, stands=False, looks=True),
}


def embodied(route: Trajectory, kind: BodyKind, *, seed: int, motion: float = 1.0) -> Trajectory:
    """Return the path of a body's camera along a route, at the route's stamps; equal seeds give equal paths.

    route: of the camera's mean way, whose height is kept; gravity is -z. motion: what the body's own motion is
    multiplied by. A body that does not look around looks level along its way, and where the route stands, as it
    did before. Raises NoisyWorldError for a route with unknown or independent poses, and for one that is too long.
    """
    body = BODIES[kind]
    _check(route)
    first_s, last_s = float(route.stamps_s[0]), float(route.stamps_s[-1])
    count = max(int(np.ceil((last_s - first_s) * RATE_HZ)) + 1, 2)
    passed_s = np.arange(count) / RATE_HZ
    mean = route.continuous.pose_at(first_s + passed_s)
    way, ahead_rad = _way(passed_s, mean[:, :3, 3])
    offsets = body.gait(way, stream("body", kind, seed))
    facing = _facing(mean, None if body.looks else ahead_rad)
    level = _turned(np.arctan2(facing[:, 1, 0], facing[:, 0, 0]))
    place_m = mean[:, :3, 3] + np.einsum("nij,nj->ni", level, motion * offsets.moved_m)
    turned = facing @ rotation_from_rotvec(motion * offsets.turned_rad)
    c2w = opencv_from_robot_c2w(pose(turned, place_m))
    curve = SplineCurve(c2w, first_s + passed_s)
    return Trajectory(curve.pose_at(route.stamps_s), route.stamps_s, route.notes, curve=curve)


def _check(route: Trajectory) -> None:
    if route.independent:
        raise NoisyWorldError(f"no body can follow the route: {route.independent}")
    if not route.known.all():
        raise NoisyWorldError(
            f"no body can follow the route: {np.count_nonzero(~route.known)} of its poses are unknown"
        )
    span_s = float(route.stamps_s[-1] - route.stamps_s[0])
    if span_s * RATE_HZ > MOST_POSES:
        raise NoisyWorldError(
            f"no body follows a route of {span_s:,.0f} s: at most {MOST_POSES / RATE_HZ:,.0f} s", remedy="take a part"
        )


def _way(passed_s: Float64, place_m: Float64) -> tuple[Way, Float64]:
    """Return how the body goes, and its direction (N,) in radians, both smooth."""
    velocity = np.gradient(place_m[:, :2], passed_s, axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    walked_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place_m[:, :2], axis=0), axis=1))])
    ahead_rad = _direction_rad(velocity, speed)
    smooth = _smoothed(velocity)
    acceleration = np.gradient(smooth, passed_s, axis=0)
    forward = np.stack([np.cos(ahead_rad), np.sin(ahead_rad)], axis=-1)
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=-1)
    along = np.stack([np.sum(acceleration * axis, axis=-1) for axis in (forward, left)], axis=-1)
    return Way(passed_s, _smoothed(speed[:, None])[:, 0], walked_m, along), ahead_rad


def _direction_rad(velocity: Float64, speed: Float64) -> Float64:
    """Return (N,): the direction of travel, without jumps; a body that stands turns towards where it goes next."""
    going = np.flatnonzero(speed >= SLOW_M_S)
    if len(going) == 0:
        return np.zeros(len(speed))
    told = np.unwrap(np.arctan2(velocity[going, 1], velocity[going, 0]))
    return _smoothed(np.interp(np.arange(len(speed)), going, told)[:, None], TURN_S)[:, 0]


def _smoothed(values: Float64, sigma_s: float = SMOOTH_S) -> Float64:
    """(N, C) -> (N, C): blurred over time by a Gaussian."""
    return blurred(values, sigma_s * RATE_HZ)


def _facing(mean: Float64, ahead_rad: Float64 | None) -> Float64:
    """Return (N, 3, 3): the body's axes in the world, x forward, y left, z up."""
    if ahead_rad is not None:
        return _turned(ahead_rad)
    right, down, forward = (mean[:, :3, axis] for axis in range(3))
    return np.stack([forward, -right, -down], axis=-1)


def _turned(yaw_rad: Float64) -> Float64:
    """(N,) -> (N, 3, 3): level axes that look that way."""
    level_deg = np.zeros_like(yaw_rad)
    return rotation_from_euler_deg(level_deg, level_deg, np.rad2deg(yaw_rad))
