# SPDX-License-Identifier: GPL-3.0-or-later
"""Positions of rain and snow particles at a time, for those that a camera can see.

The air is divided into cubes, for each class of sizes its own, which fall and drift with the class. What is in a cube
follows from a hash of the key, the class and the cube alone. So any moment is known without those before it, the air
has no end, and only the cubes in sight are looked at.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

# Rain and snow as numbers: how many particles of which size a cubic metre holds, and what those too small to see veil.
#
# Sizes are distributed exponentially, N(D) = n0 exp(-D / scale), in particles a cubic metre and a metre of diameter.
# A particle is seen by itself where it spans at least an angle; all others, between it and the camera, are a veil. So
# at depth z the veil is made of the diameters below angle * z.


EXTINCTION_EFFICIENCY = 2.0  # of particles much larger than light's wavelength (van de Hulst, 1957)


@dataclass(frozen=True)
class Precipitation:
    """Particles in the air. n0_m4: per cubic metre and metre of diameter. scale_m: the mean diameter."""

    n0_m4: float
    scale_m: float

    @property
    def count_m3(self) -> float:
        """Particles of all sizes in a cubic metre."""
        return self.n0_m4 * self.scale_m

    @property
    def extinction_per_m(self) -> float:
        """Of all sizes: the integral of N(D) 2 pi (D / 2)^2."""
        return EXTINCTION_EFFICIENCY * math.pi / 4 * self.n0_m4 * 2 * self.scale_m**3

    def sized(self, size: float) -> "Precipitation":
        """Return as many particles, each `size` times as large."""
        return Precipitation(self.n0_m4 / size, self.scale_m * size)


def rain(rate_mm_h: float) -> Precipitation:
    """Marshall and Palmer, The distribution of raindrops with size, 1948: 8000 exp(-4.1 R^-0.21 D) per m^3 and mm."""
    return Precipitation(8e6, rate_mm_h**0.21 / 4.1 * 1e-3)


FLAKE_DENSITY_KG_M3 = 100.0  # chosen: dry flakes; the usual ten to one of fresh snow to water
SWOLLEN = (1000.0 / FLAKE_DENSITY_KG_M3) ** (1 / 3)  # a flake's diameter over that of the drop it melts to


def snow(rate_mm_h: float) -> Precipitation:
    """Gunn and Marshall, The distribution with size of aggregate snowflakes, 1958, of water's millimetres an hour.

    3800 R^-0.87 exp(-2.55 R^-0.48 D) per m^3 and mm of the melted diameter D.
    """
    return Precipitation(3.8e6 * rate_mm_h**-0.87, rate_mm_h**0.48 / 2.55 * 1e-3).sized(SWOLLEN)


def drop_speed_m_s(diameter_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Atlas, Srivastava and Sekhon, Doppler radar characteristics of precipitation, 1973: 9.65 - 10.3 exp(-0.6 D)."""
    return np.maximum(np.float32(9.65) - np.float32(10.3) * np.exp(diameter_m * np.float32(-600.0)), np.float32(0.0))


def flake_speed_m_s(diameter_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Locatelli and Hobbs, Fall speeds and masses of solid precipitation particles, 1974: 0.8 D^0.16, aggregates."""
    return np.float32(0.8) * (diameter_m * np.float32(1e3)) ** np.float32(0.16)


def veil_depth(
    distance_m: NDArray[np.float32], air: Precipitation, least_rad: float, reach_m: float
) -> NDArray[np.float32]:
    """Return the optical depth of what is not seen by itself, from the camera to each distance.

    distance_m: any shape, metres. least_rad: the least angle that a particle seen by itself spans. reach_m: none is
    seen by itself beyond.

    Of the extinction at depth z diameters below least_rad * z have the share P(3, k z), k = least_rad / scale, P the
    regularised incomplete gamma function: the integral to Z is Z P(3, k Z) - 3 / k P(4, k Z). It is written as a sum
    of e^-x with a polynomial, and as a series where that would lose digits.
    """
    import cv2

    rate = least_rad / air.scale_m
    near_m = np.minimum(distance_m, np.float32(reach_m))
    x = near_m * np.float32(rate)
    decayed = np.asarray(cv2.exp(-x), np.float32).reshape(x.shape)
    # k times the integral: x P(3, x) - 3 P(4, x) = x - 3 + e^-x (x^2 / 2 + 2 x + 3), which is x^4 / 24 and less.
    closed = x - 3 + decayed * ((x / 2 + 2) * x + 3)
    if (x < SMALL).any():
        closed = np.where(x < SMALL, _series(x), closed)
    integral = closed / np.float32(rate)
    found = (integral + (distance_m - near_m)) * np.float32(air.extinction_per_m)
    return found.astype(np.float32, copy=False)


SMALL = 0.3  # below it the series is the better one in float32


def _series(x: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return x P(3, x) - 3 P(4, x) by its first four terms."""
    squared = x * x
    found = squared * squared * (1 / 24 - x * (1 / 40 - x * (1 / 120 - x * np.float32(1 / 504))))
    return found.astype(np.float32, copy=False)


T = TypeVar("T", bound=np.floating)

Float64: TypeAlias = NDArray[np.float64]
Float32: TypeAlias = NDArray[np.float32]

NEAR_M = 0.2  # chosen: nothing falls between a camera and its hood
CLASS_RATIO = 2.0  # of a class's largest diameter to its least; chosen, the least time
CELLS_DEEP = 6  # cubes along the distance to which a class is seen; chosen, likewise
MANY = 1 << 15  # particles that are looked at together; chosen, so that their arrays stay in the processor's cache
RAREST = 1e-3  # of classes of which fewer are in sight on average, the rest is one; chosen
MANY_CUBES = 1 << 17  # cubes that are looked at together; chosen, likewise
MOST_CUBES = 1 << 21  # of a class; where a camera sees more, they are larger; chosen
MOST_LOOKED_AT = 30_000_000  # cubes and particles of a frame; chosen: some seconds
LARGER = 2.0**0.25  # step of the least angle, where that is too much
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
        return slopes_of(self.focal_px, self.middle_px, self.size_px)


def slopes_of(focal_px: tuple[float, float], middle_px: tuple[float, float], size_px: tuple[int, int]) -> Float64:
    """Return (2, 2): least and greatest x / z, and y / z, that an image shows, to its pixels' outer edges."""
    return np.array(
        [
            ((-0.5 - middle) / focal, (size - 0.5 - middle) / focal)
            for focal, middle, size in zip(focal_px, middle_px, size_px, strict=True)
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


def affordable(air: Air, slopes: Float64, exposure_s: float) -> Air:
    """Return what of the air can be looked at: where that is too much, what is drawn has to span a larger angle.

    slopes: as `AirCamera.slopes` gives them. All else that is small veils, as before. It follows from the camera's
    lens and what falls, and not from a frame, so that the air stays the same along a path.
    """
    while looked_at(air, slopes, exposure_s) > MOST_LOOKED_AT:
        air = replace(air, least_rad=air.least_rad * LARGER)
    return air


def looked_at(air: Air, slopes: Float64, exposure_s: float) -> float:
    """Return how many cubes and particles are looked at for a frame of a camera at rest, on average."""
    many = 0.0
    for bounds in classes(air):
        cubes = _cubes(air, bounds, slopes, exposure_s)
        if cubes.mean > 0:
            around_m = cubes.side_m * np.sqrt(0.75) + cubes.margin_m(cubes.drift_m_s, exposure_s)
            many += _volume_m3(slopes, cubes.reach_m, around_m) / cubes.side_m**3 * (1 + cubes.mean)
    return float(many)


def _volume_m3(slopes: Float64, seen_m: float, around_m: float) -> float:
    """Return the volume of what a camera sees up to a depth, and of what is so near beside it."""
    wide, more = slopes[:, 1] - slopes[:, 0], around_m * np.hypot(1, slopes).sum(axis=1)
    first, last = max(NEAR_M - around_m, float((-more / wide).max())), seen_m + around_m
    thirds, halves, ones = wide[0] * wide[1] / 3, (wide[0] * more[1] + wide[1] * more[0]) / 2, more[0] * more[1]
    return sum(sign * at * (ones + at * (halves + at * thirds)) for sign, at in ((1, last), (-1, first)))


@dataclass(frozen=True)
class _Cubes:
    """How the particles of a class are laid into cubes.

    low_m: their least diameter. share: of all particles that are larger than the least, and than the largest one.
    reach_m: how far any of them is seen. side_m: of a cube. mean: of the particles in one. drift_m_s: (3,), velocity of
    all cubes. gusts_m_s: of the air.
    """

    low_m: float
    share: tuple[float, float]
    reach_m: float
    side_m: float
    mean: float
    drift_m_s: Float64
    gusts_m_s: float

    def margin_m(self, velocity_m_s: Float64, exposure_s: float, *, swept_m_s: float = 0.0) -> float:
        """Return how far beside the image a particle may be that is seen. velocity_m_s: (3,), past the camera."""
        fastest_m_s = np.linalg.norm(velocity_m_s) + 4 * self.gusts_m_s
        fastest_m_s += swept_m_s
        return float(fastest_m_s * exposure_s / 2 + _sway_m(self.gusts_m_s))


def _sway_m(gusts_m_s: float) -> float:
    return 2 * gusts_m_s / SWAY_RAD_S[0]


def _cubes(air: Air, bounds: tuple[float, float], slopes: Float64, exposure_s: float) -> _Cubes:
    """Return the cubes of a class. They are larger where the camera sees more than MOST_CUBES of them."""
    low_m, high_m = bounds
    reach_m = min(high_m / air.least_rad, air.reach_m)
    middle_m = low_m * np.sqrt(CLASS_RATIO)
    drift_m_s = np.array([air.wind_m_s, float(air.speed_m_s(np.array([middle_m], np.float32))[0]), 0.0])
    larger, largest = (float(np.exp(-edge_m / air.particles.scale_m)) for edge_m in bounds)

    def of(side_m: float) -> _Cubes:
        mean = air.particles.count_m3 * (larger - largest) * side_m**3
        return _Cubes(low_m, (larger, largest), reach_m, side_m, mean, drift_m_s, air.gusts_m_s)

    cubes = of(max(reach_m / CELLS_DEEP, _sway_m(air.gusts_m_s)))
    margin_m = cubes.margin_m(drift_m_s, exposure_s)
    while cubes.side_m < margin_m + reach_m:
        around_m = cubes.side_m * np.sqrt(0.75) + margin_m
        if _volume_m3(slopes, reach_m, around_m) <= MOST_CUBES * cubes.side_m**3:
            break
        cubes = of(2 * cubes.side_m)
    return cubes


@dataclass(frozen=True)
class _Class:
    """Some cubes of a class with what they hold.

    seen_m: how far the camera sees it. margin_m: how far beside the image a particle may be that is seen. time_s: for
    how long the cubes have drifted. cells: (3, N), their places; hashes, counts: (N,), of each, and how many particles
    it holds.
    """

    cubes: _Cubes
    seen_m: float
    margin_m: float
    time_s: float
    cells: NDArray[np.int64]
    hashes: NDArray[np.uint64]
    counts: NDArray[np.int64]


def _of_class(
    air: Air, view: AirCamera, bounds: tuple[float, float], key: NDArray[np.uint64], time_s: float
) -> Iterator[Particles]:
    """Yield the particles of a class, those of some cubes at a time."""
    cubes = _cubes(air, bounds, view.slopes(), view.exposure_s)
    if cubes.mean == 0:
        return
    seen_m = min(cubes.reach_m, view.farthest_m)
    swept_m_s = float(np.linalg.norm(view.turning_rad_s) * seen_m)
    margin_m = cubes.margin_m(cubes.drift_m_s - view.velocity_m_s, view.exposure_s, swept_m_s=swept_m_s)
    for cells in _cells_in_sight(view, cubes.drift_m_s * time_s, cubes.side_m, seen_m, margin_m):
        hashes = key
        for axis in cells:
            hashes = _hashed(hashes + axis.astype(np.uint64))
        counts = _poisson(hashes, cubes.mean)
        of = _Class(cubes, seen_m, margin_m, time_s, cells, hashes, counts)
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
    moved_m = (of.cubes.drift_m_s * of.time_s - view.position_m)[:, None]
    corners_m = _turned(of.cells[:, some] * of.cubes.side_m + moved_m, view.rotation)
    position_m = _turned(_uniform(seeds + _PLACE, 3) * np.float32(of.cubes.side_m), view.rotation)
    position_m += np.repeat(corners_m.astype(np.float32), counts, axis=1)
    kept = np.flatnonzero(_near_image(view, position_m, of.seen_m, of.margin_m))
    seeds, position_m = seeds[kept], position_m[:, kept]
    larger, largest = np.float32(of.cubes.share[0]), np.float32(of.cubes.share[1])
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
) -> Iterator[NDArray[np.int64]]:
    """Yield (3, N) of the cubes that touch what the camera sees up to `seen_m`, in their order, some at a time.

    moved_m: how far they have moved. Where the box about them holds many, only those of its columns are looked at that
    lie between the faces of what is seen.
    """
    slopes = view.slopes()
    corners = np.array([(x, y, 1.0) for x in slopes[0] for y in slopes[1]]) * seen_m
    corners_m = np.concatenate([corners, np.zeros((1, 3))]) @ view.rotation.T + view.position_m - moved_m
    first = np.floor((corners_m.min(axis=0) - margin_m) / side_m).astype(np.int64)
    last = np.floor((corners_m.max(axis=0) + margin_m) / side_m).astype(np.int64)
    counts = last - first + 1
    from_camera_m = moved_m - view.position_m
    room_m = side_m * np.sqrt(0.75) + margin_m

    def kept(cells: NDArray[np.int64]) -> NDArray[np.int64]:
        centre_m = _turned((cells + 0.5) * side_m + from_camera_m[:, None], view.rotation)
        z_m = centre_m[2]
        near = (z_m > NEAR_M - room_m) & (z_m < seen_m + room_m)
        for axis, (low, high) in enumerate(slopes):
            near &= centre_m[axis] >= low * z_m - room_m * np.hypot(1, low)
            near &= centre_m[axis] <= high * z_m + room_m * np.hypot(1, high)
        return cells[:, np.flatnonzero(near)]

    if np.prod(counts.astype(np.float64)) <= MANY_CUBES:
        yield kept(np.indices(tuple(counts.tolist())).reshape(3, -1) + first[:, None])
        return
    # What is seen lies where normals @ centre + offsets >= 0; in cubes, where inward @ cell + level >= 0.
    normals, offsets = [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)], [room_m - NEAR_M, seen_m + room_m]
    for axis, (low, high) in enumerate(slopes):
        for slope, sign in ((low, 1.0), (high, -1.0)):
            normals.append((sign * (axis == 0), sign * (axis == 1), -sign * slope))
            offsets.append(room_m * np.hypot(1, slope))
    inward = np.array(normals) @ view.rotation.T
    level = inward @ (0.5 * side_m + from_camera_m) + np.array(offsets)
    inward *= side_m
    layers = max(1, MANY_CUBES // int(counts[1] * counts[2]))
    for begin in range(int(first[0]), int(last[0]) + 1, layers):
        across = np.arange(begin, min(begin + layers, int(last[0]) + 1))
        x, y = (part.ravel() for part in np.meshgrid(across, np.arange(first[1], last[1] + 1), indexing="ij"))
        low, high = np.full(len(x), float(first[2])), np.full(len(x), float(last[2]))
        for (to_x, to_y, to_z), at in zip(inward.tolist(), level.tolist(), strict=True):
            if abs(to_z) < 1e-9 * side_m:
                continue  # the face lies along the columns; what it cuts off is looked at, and not kept
            meets = (x * to_x + y * to_y + at) / -to_z
            low, high = (np.maximum(low, meets), high) if to_z > 0 else (low, np.minimum(high, meets))
        # A cube more at both ends, for rounding.
        low, high = np.maximum(np.ceil(low) - 1, first[2]), np.minimum(np.floor(high) + 1, last[2])
        many = np.maximum(high - low + 1, 0).astype(np.int64)
        within = np.arange(many.sum()) - np.repeat(np.cumsum(many) - many, many)
        columns = [np.repeat(part, many) for part in (x, y, low.astype(np.int64))]
        columns[2] += within
        yield kept(np.stack(columns))


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
