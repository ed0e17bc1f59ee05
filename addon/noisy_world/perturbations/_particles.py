# SPDX-License-Identifier: GPL-3.0-or-later
"""Positions of rain and snow particles at a time, for those that a camera can see.

The air is divided into cubes, for each class of sizes its own, which fall and drift with the class. What is in a cube
follows from a hash of the key, the class and the cube alone. So any moment is known without those before it, the air
has no end, and only the cubes in sight are looked at.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ._precipitation import Precipitation

T = TypeVar("T", bound=np.floating)

Float64: TypeAlias = NDArray[np.float64]
Float32: TypeAlias = NDArray[np.float32]

NEAR_M = 0.2  # chosen: nothing falls between a camera and its hood
CLASS_RATIO = 2.0  # of a class's largest diameter to its least; chosen, the least time
CELLS_DEEP = 6  # cubes along the distance to which a class is seen; chosen, likewise
MANY = 1 << 15  # particles that are looked at together; chosen, so that their arrays stay in the processor's cache
RAREST = 1e-3  # of classes of which fewer are in sight on average, the rest is one; chosen
SWAY_RAD_S = (2.0, 6.0)  # a particle's own swaying; chosen, as flakes are seen to
_GOLDEN = 0x9E3779B97F4A7C15
_MASK = 2**64 - 1
# Added to a particle's seed for its place in its cube, its size, its rate and its phase of swaying; sixteen such steps
# are between two particles of a cube.
_PLACE, _SIZE, _RATE, _PHASE, _NEXT = (np.uint64(_GOLDEN * k & _MASK) for k in (0, 1, 2, 3, 16))


@dataclass(frozen=True)
class AirCamera:
    """A camera in the air, whose axes are right, down, forward.

    rotation: (3, 3), camera to air. position_m: (3,) in the air. velocity_m_s: (3,) in the air. turning_rad_s: (3,), in
    the camera's axes. focal_px, middle_px: along x and y. size_px: width, height. farthest_m: nothing is seen beyond.
    exposure_s: how long the shutter is open.
    """

    rotation: Float64
    position_m: Float64
    velocity_m_s: Float64
    turning_rad_s: Float64
    focal_px: tuple[float, float]
    middle_px: tuple[float, float]
    size_px: tuple[int, int]
    farthest_m: float
    exposure_s: float

    def slopes(self) -> Float64:
        """Return (2, 2): least and greatest x / z, and y / z, that the image shows, to its pixels' outer edges."""
        return np.array(
            [
                ((-0.5 - middle) / focal, (size - 0.5 - middle) / focal)
                for focal, middle, size in zip(self.focal_px, self.middle_px, self.size_px, strict=True)
            ]
        )


@dataclass(frozen=True)
class Air:
    """What falls, and how.

    least_rad, reach_m: what is seen by itself, as in `_precipitation`. speed_m_s: of fall, by diameter. wind_m_s: to
    the right. gusts_m_s: standard deviation of each particle's own velocity, along each axis.
    """

    particles: Precipitation
    least_rad: float
    reach_m: float
    speed_m_s: Callable[[Float32], Float32]
    wind_m_s: float
    gusts_m_s: float


@dataclass(frozen=True)
class Particles:
    """Particles before a camera, in its axes. position_m, velocity_m_s (relative to the camera): (N, 3); diameter_m."""

    position_m: Float32
    velocity_m_s: Float32
    diameter_m: Float32


def in_sight(air: Air, view: AirCamera, key: int, time_s: float) -> Particles:
    """Return the particles that are seen by themselves while the shutter is open, and some just outside the image.

    key: of the hash, a whole number below 2^64. time_s: in the middle of the exposure.
    """
    parts = [
        part
        for number, bounds in enumerate(classes(air))
        for part in _of_class(air, view, bounds, _hashed(np.array([(key + number) & _MASK], np.uint64)), time_s)
    ]
    if not parts:
        nothing = np.zeros((0, 3), np.float32)
        return Particles(nothing, nothing, nothing[:, 0])
    return Particles(
        np.concatenate([part.position_m for part in parts]),
        np.concatenate([part.velocity_m_s for part in parts]),
        np.concatenate([part.diameter_m for part in parts]),
    )


def classes(air: Air) -> Iterator[tuple[float, float]]:
    """Yield the classes' least and greatest diameters in metres, the last one without an end."""
    low_m = air.least_rad * NEAR_M
    while True:
        high_m = low_m * CLASS_RATIO
        reach_m = min(high_m / air.least_rad, air.reach_m)
        if air.particles.count_m3 * np.exp(-high_m / air.particles.scale_m) * reach_m**3 < RAREST:
            yield low_m, np.inf
            return
        yield low_m, high_m
        low_m = high_m


@dataclass(frozen=True)
class _Class:
    """Particles of a class of sizes. share: of all particles that are larger than low_m, and than high_m.

    seen_m: how far the camera sees it. margin_m: how far beside the image a particle may be that is seen. side_m: of a
    cube. drift_m_s: velocity of all cubes. time_s: for how long they have drifted. cells: (3, N), the cubes; hashes,
    counts: (N,), of each, and how many particles it holds.
    """

    low_m: float
    share: tuple[float, float]
    seen_m: float
    margin_m: float
    side_m: float
    drift_m_s: Float64
    time_s: float
    cells: NDArray[np.int64]
    hashes: NDArray[np.uint64]
    counts: NDArray[np.int64]


def _of_class(
    air: Air, view: AirCamera, bounds: tuple[float, float], key: NDArray[np.uint64], time_s: float
) -> Iterator[Particles]:
    """Yield the particles of a class, those of some cubes at a time."""
    low_m, high_m = bounds
    reach_m = min(high_m / air.least_rad, air.reach_m)
    sway_m = 2 * air.gusts_m_s / SWAY_RAD_S[0]
    side_m = max(reach_m / CELLS_DEEP, sway_m)
    middle_m = low_m * np.sqrt(CLASS_RATIO)
    drift_m_s = np.array([air.wind_m_s, float(air.speed_m_s(np.array([middle_m], np.float32))[0]), 0.0])
    seen_m = min(reach_m, view.farthest_m)
    fastest_m_s = np.linalg.norm(drift_m_s - view.velocity_m_s) + 4 * air.gusts_m_s
    fastest_m_s += np.linalg.norm(view.turning_rad_s) * seen_m
    margin_m = float(fastest_m_s * view.exposure_s / 2 + sway_m)
    share = tuple(float(np.exp(-edge_m / air.particles.scale_m)) for edge_m in bounds)
    cells = _cells_in_sight(view, drift_m_s * time_s, side_m, seen_m, margin_m)
    hashes = key
    for axis in cells:
        hashes = _hashed(hashes + axis.astype(np.uint64))
    counts = _poisson(hashes, air.particles.count_m3 * (share[0] - share[1]) * side_m**3)
    size = low_m, (share[0], share[1])
    of = _Class(*size, seen_m, margin_m, side_m, drift_m_s, time_s, cells, hashes, counts)
    ends = np.cumsum(counts)
    at = 0
    while at < len(counts):
        to = max(int(np.searchsorted(ends, (ends[at - 1] if at else 0) + MANY)), at + 1)
        yield _in_cells(air, view, of, slice(at, to))
        at = to


def _in_cells(air: Air, view: AirCamera, of: _Class, some: slice) -> Particles:
    """Return a class's particles in some of its cubes. Inside, places and velocities are (3, N), fast along an axis."""
    counts = of.counts[some]
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    seeds = np.repeat(of.hashes[some], counts) + within.astype(np.uint64) * _NEXT
    moved_m = (of.drift_m_s * of.time_s - view.position_m)[:, None]
    corners_m = _turned(of.cells[:, some] * of.side_m + moved_m, view.rotation)
    position_m = _turned(_uniform(seeds + _PLACE, 3) * np.float32(of.side_m), view.rotation)
    position_m += np.repeat(corners_m.astype(np.float32), counts, axis=1)
    kept = np.flatnonzero(_near_image(view, position_m, of.seen_m, of.margin_m))
    seeds, position_m = seeds[kept], position_m[:, kept]
    larger, largest = np.float32(of.share[0]), np.float32(of.share[1])
    diameter_m = np.log(larger - _uniform(seeds + _SIZE, 1)[0] * (larger - largest))
    diameter_m *= np.float32(-air.particles.scale_m)
    kept = np.flatnonzero(diameter_m >= np.float32(air.least_rad) * (position_m[2] - np.float32(of.margin_m)))
    seeds, position_m, diameter_m = seeds[kept], position_m[:, kept], diameter_m[kept]
    sway_m, velocity_m_s = _swaying(seeds, air.gusts_m_s, of.time_s)
    velocity_m_s[0] += np.float32(air.wind_m_s)
    velocity_m_s[1] += air.speed_m_s(diameter_m)
    velocity_m_s -= view.velocity_m_s.astype(np.float32)[:, None]
    position_m += _turned(sway_m, view.rotation)
    velocity_m_s = _turned(velocity_m_s, view.rotation)
    velocity_m_s -= _crossed(view.turning_rad_s, position_m)
    z_m = position_m[2]
    seen = (z_m >= np.float32(NEAR_M)) & (z_m <= np.float32(of.seen_m))
    seen &= diameter_m >= np.float32(air.least_rad) * z_m
    kept = np.flatnonzero(seen)
    return Particles(position_m[:, kept].T, velocity_m_s[:, kept].T, diameter_m[kept])


def _turned(vectors: NDArray[T], rotation: Float64) -> NDArray[T]:
    """Return rotation.T @ vectors (3, N). For so narrow a product BLAS takes longer, on all cores."""
    turn = rotation.T.astype(vectors.dtype)
    x, y, z = vectors
    return np.stack([x * row[0] + y * row[1] + z * row[2] for row in turn])


def _crossed(vector: Float64, others: Float32) -> Float32:
    """Return the cross product of a vector (3,) with others (3, N)."""
    x, y, z = vector.astype(np.float32)
    return np.stack([y * others[2] - z * others[1], z * others[0] - x * others[2], x * others[1] - y * others[0]])


def _near_image(view: AirCamera, position_m: Float32, seen_m: float, margin_m: float) -> NDArray[np.bool_]:
    """Tell which of the positions (3, N) the camera may see, or nearly: within `margin_m` of what it sees."""
    z_m = position_m[2]
    kept = (z_m < np.float32(seen_m + margin_m)) & (z_m > np.float32(NEAR_M - margin_m))
    for axis, (low, high) in enumerate(view.slopes()):
        kept &= position_m[axis] >= np.float32(low) * z_m - np.float32(margin_m * np.hypot(1, low))
        kept &= position_m[axis] <= np.float32(high) * z_m + np.float32(margin_m * np.hypot(1, high))
    return kept


def _cells_in_sight(
    view: AirCamera, moved_m: Float64, side_m: float, seen_m: float, margin_m: float
) -> NDArray[np.int64]:
    """Return (3, N): the cubes that touch what the camera sees up to `seen_m`. moved_m: how far they have moved."""
    slopes = view.slopes()
    corners = np.array([(x, y, 1.0) for x in slopes[0] for y in slopes[1]]) * seen_m
    corners_m = np.concatenate([corners, np.zeros((1, 3))]) @ view.rotation.T + view.position_m - moved_m
    first = np.floor((corners_m.min(axis=0) - margin_m) / side_m).astype(np.int64)
    last = np.floor((corners_m.max(axis=0) + margin_m) / side_m).astype(np.int64)
    counts = last - first + 1
    cells = np.indices(tuple(counts.tolist())).reshape(3, -1) + first[:, None]
    centre_m = _turned((cells + 0.5) * side_m + (moved_m - view.position_m)[:, None], view.rotation)
    room_m = side_m * np.sqrt(0.75) + margin_m
    z_m = centre_m[2]
    kept = (z_m > NEAR_M - room_m) & (z_m < seen_m + room_m)
    for axis, (low, high) in enumerate(slopes):
        kept &= centre_m[axis] >= low * z_m - room_m * np.hypot(1, low)
        kept &= centre_m[axis] <= high * z_m + room_m * np.hypot(1, high)
    return cells[:, np.flatnonzero(kept)]


def _swaying(seeds: NDArray[np.uint64], gusts_m_s: float, time_s: float) -> tuple[Float32, Float32]:
    """Return (3, N) each: how far particles have swayed from their places, and their velocities of swaying."""
    low, high = SWAY_RAD_S
    rate_rad_s = low + (high - low) * _uniform(seeds + _RATE, 3)
    turns = rate_rad_s.astype(np.float64) * (time_s / (2 * np.pi)) + _uniform(seeds + _PHASE, 3)
    phase = ((turns - np.floor(turns)) * (2 * np.pi)).astype(np.float32)
    peak_m_s = np.float32(np.sqrt(2) * gusts_m_s)
    return np.sin(phase) * (peak_m_s / rate_rad_s), np.cos(phase) * peak_m_s


# --- whole numbers that look random ---


def _hashed(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return splitmix64's output of each state (Steele, Lea and Flood, 2014)."""
    z = values + np.uint64(_GOLDEN)
    z ^= z >> np.uint64(30)
    z *= np.uint64(0xBF58476D1CE4E5B9)
    z ^= z >> np.uint64(27)
    z *= np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    return z


def _uniform(seeds: NDArray[np.uint64], count: int) -> Float32:
    """Return (count, N) numbers between 0 and 1, up to three, each of 21 bits of a seed's hash."""
    # Halves, as the processor turns 32 bits into float32 several at a time, and 64 one by one.
    low, high = _hashed(seeds).astype("<u8", copy=False).view("<u4").reshape(-1, 2).T
    found = np.empty((count, len(seeds)), np.float32)
    for place in range(count):
        bits = (low, high, (low >> np.uint32(21)) | (high >> np.uint32(21) << np.uint32(11)))[place]
        found[place] = (bits & np.uint32(2**21 - 1)).view(np.int32)
    found += np.float32(0.5)
    found *= np.float32(2.0**-21)
    return found


def _poisson(hashes: NDArray[np.uint64], mean: float) -> NDArray[np.int64]:
    """Return for each hash a number of Poisson's distribution."""
    highest = int(mean + 12 * np.sqrt(mean) + 20)
    numbers = np.arange(1, highest + 1)
    logs = np.concatenate([[0.0], np.cumsum(np.log(mean) - np.log(numbers))]) - mean
    below = np.cumsum(np.exp(logs))
    drawn = (_hashed(hashes) >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return np.searchsorted(below, drawn, side="right").astype(np.int64)
