# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies that carry the camera along a route: a head that walks or runs, a quadruped, a rover, a drone."""

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..errors import NoisyWorldError
from ..geometry import opencv_from_robot_c2w, pose, rotation_from_euler_deg, rotation_from_rotvec
from ..streams import stream
from .blurring import blurred
from .curve import SplineCurve
from .gaits import Gait, Way, flying, rolling, running, trotting, walking
from .trajectory import MOST_POSES, Trajectory

Float64: TypeAlias = NDArray[np.float64]
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
