# SPDX-License-Identifier: GPL-3.0-or-later
"""Light baked into the colours: daylight through the windows, the sun's patches, two lamps, and corner shadows.

Light is computed on a coarse lattice of every sheet, with the blockers' boxes as obstacles, and interpolated. Display
values are its square root, which is close to the sRGB curve and exact on every processor. Only sunlight is computed for
each vertex.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .openings import Hole, pane_bars_m
from .surfaces import Array, Piece, Point, Sheet

# Rays against boxes that are aligned with the axes. Single precision: sums and products, so every processor agrees.


_MARGIN_M = 1e-3  # far more than single precision rounds in a room


def first_hit(origins_m: Array, directions: Array, boxes_m: Array) -> Array:
    """(N,) distance in units of the directions, (N, 3) or (3,), to the nearest box (B, 2, 3) entered from outside.

    Infinite where there is none. Single precision: sums and products, so every processor agrees.
    """
    if not len(boxes_m):
        return np.full(len(origins_m), np.inf)
    enter = np.full((len(boxes_m), len(origins_m)), -np.inf, np.float32)
    leave = np.full_like(enter, np.inf)
    for k in range(3):
        d = directions[..., k]
        inverse = np.float32(1.0) / np.where(abs(d) < 1e-6, 1e-6, d).astype(np.float32)
        o = origins_m[:, k]
        a, b = (boxes_m[:, 0, k, None] - o) * inverse, (boxes_m[:, 1, k, None] - o) * inverse
        np.maximum(enter, np.minimum(a, b), out=enter)
        np.minimum(leave, np.maximum(a, b), out=leave)
    hit = np.where((enter < leave) & (enter > 0), enter, np.inf)
    return hit.min(0)


def first_hits(origins_m: Array, directions: Array, boxes_m: Array, reach_m: float) -> Array:
    """(D, N) distance along directions (D, 3) of length 1 to the nearest box that is entered from outside.

    Infinite where there is none within reach_m; beyond it some are left out.
    """
    which, box = _pairs(origins_m, reach_m * directions, boxes_m, towards=False)
    distance = np.full((len(directions), len(origins_m)), np.inf, np.float32)
    if len(which):
        inverse = _inverse(directions)[which]
        hit = _entered(origins_m, boxes_m[box], [inverse[:, k, None] for k in range(3)])
        starts = np.flatnonzero(np.diff(which, prepend=-1))
        distance[which[starts]] = np.minimum.reduceat(hit, starts, axis=0)
    return distance


def hidden(origins_m: Array, lights_m: Array, away: Array, boxes_m: Array) -> NDArray[np.bool_]:
    """(L, N) whether a box stands between points (N, 3) and lights (L, 3). away: the vectors (L, N, 3) to these."""
    which, box = _pairs(origins_m, lights_m, boxes_m, towards=True)
    found = np.zeros(away.shape[:2], bool)
    if len(which):
        inverse = _inverse(away)
        hit = _entered(origins_m, boxes_m[box], [inverse[which, :, k] for k in range(3)])
        starts = np.flatnonzero(np.diff(which, prepend=-1))
        found[which[starts]] = np.logical_or.reduceat(hit < 1.0, starts, axis=0)
    return found


def _inverse(directions: Array) -> Array:
    return np.float32(1.0) / np.where(abs(directions) < 1e-6, 1e-6, directions).astype(np.float32)


def _entered(origins_m: Array, boxes_m: Array, inverse: list[Array]) -> Array:
    """(P, N) distance from each point to the P boxes (P, 2, 3), infinite where a box is not entered from outside.

    inverse: of x, y and z of the directions, each (P, 1) or (P, N).
    """
    enter = leave = None
    for k in range(3):
        o = origins_m[:, k]
        a, b = (boxes_m[:, 0, k, None] - o) * inverse[k], (boxes_m[:, 1, k, None] - o) * inverse[k]
        near, far = np.minimum(a, b), np.maximum(a, b, out=a)
        enter = near if enter is None else np.maximum(enter, near, out=enter)
        leave = far if leave is None else np.minimum(leave, far, out=leave)
    assert enter is not None
    assert leave is not None
    enter[(enter >= leave) | (enter <= 0)] = np.inf
    return enter


def _pairs(
    origins_m: Array, ends_m: Array, boxes_m: Array, *, towards: bool
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return numbers of ends (E, 3) and of boxes that may stand in the way to these, sorted by end.

    towards: whether all ways end in a point, or each goes on by the same vector. While a share t of a way is gone, all
    are in a box whose sides move evenly; where these overlap the box, if anywhere, are six inequalities in t.
    """
    low, high = origins_m.min(axis=0).astype(np.float64), origins_m.max(axis=0).astype(np.float64)
    moved_low, moved_high = (ends_m - low, ends_m - high) if towards else (ends_m, ends_m)
    first, last = np.zeros((len(ends_m), len(boxes_m))), np.ones((len(ends_m), len(boxes_m)))
    for k in range(3):
        # low + t * moved <= the box's high side, and the other way round.
        for slack, rate in (
            (boxes_m[:, 1, k] + _MARGIN_M - low[k], moved_low[:, k, None]),
            (high[k] - boxes_m[:, 0, k] + _MARGIN_M, -moved_high[:, k, None]),
        ):
            with np.errstate(divide="ignore", invalid="ignore"):
                at = slack / rate
            last = np.where(rate > 0, np.minimum(last, at), last)
            first = np.where(rate < 0, np.maximum(first, at), first)
            last = np.where((rate == 0) & (slack < 0), -1.0, last)
    ends, boxes = np.nonzero(first <= last)
    return ends, boxes


Indices: TypeAlias = NDArray[np.integer]

# Chosen by eye: a sunny room whose shadows give features, and which is built within a second or two.
LATTICE_M = 0.12
THIN_M = 0.04  # anything narrower gets one sample across
REACH_M = 1.3  # things farther than this cast no ambient shadow
# Linear light; 1 is white.
SUN_RGB = np.array([1.45, 1.28, 0.95])
DAY_RGB = np.array([0.95, 1.0, 1.06])
AMBIENT_RGB = np.array([0.53, 0.52, 0.505])
REVEAL_LIGHT = 0.35  # extra daylight in the windows' reveals
BOUNCE_RGB = np.array([0.07, 0.03, -0.01])  # from the floor
LAMP_RGB = np.array([1.25, 0.95, 0.62])
_NEAR_M = 0.012  # rays start so far above a surface, clear of its own blocker
_DIRECTIONS = 32  # ambient rays a point


@dataclass(frozen=True)
class Window:
    """An opening in an outer wall that lets daylight in.

    axis, side: the wall's outward normal: 0 is x, 1 is y, side is 1 or -1. plane_m: where the wall is on that axis.
    hole_m: from and to along the other axis, low and high.
    """

    axis: int
    side: int
    plane_m: float
    hole_m: Hole

    def beyond(self, points_m: Array) -> Array:
        """(N,) whether points (N, 3) lie outside of the window's wall."""
        return self.side * points_m[:, self.axis] > self.side * self.plane_m


@dataclass(frozen=True)
class Lighting:
    """Where light comes from.

    low_m, high_m: the box that the rooms fill; what is solid inside of it has to be among the blockers.
    lamps_m: x, y, z of each lamp's bulb, and its strength. sun: the direction in which sunlight travels.
    day, ambient: factors for daylight from the windows, and for the light that is everywhere. reach_m: how far lamps
    shine; what is a few metres away adds less than a step of a byte, and costs time in a large room.
    """

    low_m: Point
    high_m: Point
    windows: tuple[Window, ...]
    lamps_m: tuple[tuple[float, float, float, float], ...]
    sun: Point = (0.36, -1.0, -0.66)
    day: float = 1.0
    ambient: float = 1.0
    reach_m: float = 100.0


@dataclass(frozen=True)
class _Lattice:
    """The coarse points of all sheets: (N, 3) positions, (N, 3) normals, and per sheet its row and column numbers."""

    points_m: Array
    normals: Array
    rows: list[Indices]
    columns: list[Indices]


def _picked(counts: Indices, lengths_m: Array) -> list[Indices]:
    """For each line of so many points, the numbers of those to sample, about LATTICE_M apart, both ends included."""
    wanted = np.minimum(counts - 1, np.maximum(1, np.rint(lengths_m / LATTICE_M).astype(np.int64)))
    wanted[lengths_m < THIN_M] = 0  # its middle alone
    return [_spread_out(int(count), int(number)) for count, number in zip(counts, wanted, strict=True)]


@lru_cache(maxsize=4096)
def _spread_out(count: int, wanted: int) -> Indices:
    return np.arange(wanted + 1) * (count - 1) // wanted if wanted else np.array([count // 2])


def _lengths_m(lines_m: list[Array]) -> tuple[Indices, Array]:
    """How many points lines (P, 3) have, at least two each, and how long they are."""
    counts = np.array([len(line) for line in lines_m])
    x, y, z = np.diff(np.concatenate(lines_m), axis=0).T
    step_m = np.sqrt(x * x + y * y + z * z)
    ends = np.cumsum(counts)
    # Each by itself, and not by reduceat: many lengths lie between two numbers of samples, and a last bit decides.
    lengths = [step_m[end - count : end - 1].sum() for end, count in zip(ends, counts, strict=True)]
    return counts, np.array(lengths)


def _lattice(sheets: tuple[Sheet, ...]) -> _Lattice:
    rows = _picked(*_lengths_m([s.points_m[:, s.points_m.shape[1] // 2] for s in sheets]))
    columns = _picked(*_lengths_m([s.points_m[s.points_m.shape[0] // 2] for s in sheets]))
    points, normals = [], []
    for s, r, c in zip(sheets, rows, columns, strict=True):
        at = (r[:, None], c)
        points.append(s.points_m[at].reshape(-1, 3))
        normals.append(s.normals[at].reshape(-1, 3))
    return _Lattice(np.concatenate(points), np.concatenate(normals), rows, columns)


def _spread(coarse: Array, r: Indices, c: Indices, shape: tuple[int, int]) -> Array:
    """(len(r), len(c), 3) values -> (R, C, 3) by linear interpolation over row and column numbers."""

    def along(values: Array, at: Indices, count: int) -> Array:
        if len(at) == count:
            return values
        if len(at) == 1:
            return np.repeat(values, count, 0)
        k, t, rest = _between(at.tobytes(), count)
        return values[k - 1] * rest + values[k] * t

    return along(along(coarse, r, shape[0]).swapaxes(0, 1), c, shape[1]).swapaxes(0, 1)


@lru_cache(maxsize=4096)
def _between(at_bytes: bytes, count: int) -> tuple[Indices, Array, Array]:
    """For each of `count` numbers the sampled number after it, and the shares of that one and of the one before."""
    at = np.frombuffer(at_bytes, np.int64)
    k = np.searchsorted(at, np.arange(count), side="right").clip(1, len(at) - 1)
    t = ((np.arange(count) - at[k - 1]) / (at[k] - at[k - 1]))[:, None, None]
    return k, t, 1 - t


def _within(boxes_m: Array, low: Array, high: Array) -> Array:
    """The boxes that touch the box from low to high."""
    return boxes_m[((boxes_m[:, 0] < high) & (boxes_m[:, 1] > low)).all(1)]


def _room_distance(origins_m: Array, directions: Array, lighting: Lighting) -> Array:
    """(D, N) distance along directions (D, 3) to the walls, floor or ceiling; points in a window's reveal see out."""
    best = np.full((len(directions), len(origins_m)), np.inf)
    for k in range(3):
        low, high = (side[k] - origins_m[:, k] for side in (lighting.low_m, lighting.high_m))
        d = directions[:, k, None]
        slanted = abs(d[:, 0]) > 1e-9
        ahead = np.where(d[slanted] > 0, high, low) / d[slanted]
        best[slanted] = np.minimum(best[slanted], np.where(ahead < -1e-3, np.inf, ahead))
    return np.maximum(best, 0.0)


def _sphere(count: int) -> Array:
    """(count, 3) directions spread evenly over the sphere."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, k * 2.399963229728653
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], -1)


def _ambient(origins_m: Array, normals: Array, boxes_m: Array, lighting: Lighting) -> tuple[Array, Array]:
    """(N,) how open the surroundings are, 0 to 1, and (N,) the share of the floor in what is seen."""
    d = _sphere(_DIRECTIONS)
    x, y, z = d.T[:, :, None]
    cos = normals[:, 0] * x + normals[:, 1] * y + normals[:, 2] * z
    cos = np.where(cos > 0.05, cos, 0.0)
    hit = first_hits(origins_m, d, boxes_m, REACH_M)
    free = np.minimum(np.minimum(hit, _room_distance(origins_m, d, lighting) * 1.6) / REACH_M, 1.0)
    weight = np.maximum(cos.sum(axis=0), 1e-9)
    return (cos * np.sqrt(free)).sum(axis=0) / weight, (cos * np.maximum(-z, 0.0) * free).sum(axis=0) / weight


@dataclass(frozen=True)
class _SeenLights:
    """Points of light from points (N, 3): whether each is visible (L, N), the cosine at the surface, the vectors."""

    clear: Array
    cos: Array
    away: Array

    @property
    def square(self) -> Array:
        """(L, N) squared distances."""
        return self.away[..., 0] ** 2 + self.away[..., 1] ** 2 + self.away[..., 2] ** 2


def _seen(origins_m: Array, normals: Array, lights_m: Array, boxes_m: Array) -> _SeenLights:
    away = lights_m[:, None] - origins_m
    x, y, z = away[..., 0], away[..., 1], away[..., 2]
    distance = np.sqrt(x**2 + y**2 + z**2)
    dot = x * normals[:, 0] + y * normals[:, 1] + z * normals[:, 2]
    cos = np.maximum(dot / np.maximum(distance, 1e-6), 0.0)
    return _SeenLights((cos > 0) & ~hidden(origins_m, lights_m, away, boxes_m), cos, away)


def _windows(origins_m: Array, normals: Array, boxes_m: Array, windows: tuple[Window, ...]) -> Array:
    """(N,) daylight: each window is a grid of points on the wall's inner face."""
    if not windows:
        return np.zeros(len(origins_m))
    parts = [np.zeros((1, len(origins_m)))]
    for window in windows:
        low, high, z_low, z_high = window.hole_m
        cells = (high - low) * (z_high - z_low) / 9
        grid = np.empty((9, 3))
        i, j = np.divmod(np.arange(9), 3)
        # The rows are skewed, so that straight edges do not cast shadows in steps.
        grid[:, 1 - window.axis] = low + (high - low) * (i + 0.25 + 0.25 * j) / 3
        grid[:, window.axis] = window.plane_m - 0.005 * window.side
        grid[:, 2] = z_low + (z_high - z_low) * (j + 0.5) / 3
        seen = _seen(origins_m, normals, grid, boxes_m)
        ahead = np.maximum(window.side * seen.away[..., window.axis], 0)
        square = seen.square
        parts.append(seen.clear * seen.cos * ahead / np.sqrt(square + 1e-9) * cells / (square + 0.12))
    return np.concatenate(parts).sum(axis=0)


_CROSS_M = ((0.1, 0.03), (-0.03, 0.1), (-0.1, -0.03), (0.03, -0.1))


def _lamps(origins_m: Array, normals: Array, boxes_m: Array, lighting: Lighting) -> Array:
    """(N,) light of the lamps, each a small cross of points."""
    low, high = origins_m.min(0) - lighting.reach_m, origins_m.max(0) + lighting.reach_m
    near = [lamp for lamp in lighting.lamps_m if low[0] < lamp[0] < high[0] and low[1] < lamp[1] < high[1]]
    if not near:
        return np.zeros(len(origins_m))
    points = np.array([(x + dx, y + dy, z) for x, y, z, _ in near for dx, dy in _CROSS_M])
    strength = np.repeat([lamp[3] for lamp in near], len(_CROSS_M))[:, None]
    seen = _seen(origins_m, normals, points, boxes_m)
    lit_by = 0.25 * strength * seen.clear * (0.15 + 0.85 * seen.cos) * (seen.cos > 0) / (seen.square + 0.15)
    return lit_by.sum(axis=0)


def _turned_to_windows(origins_m: Array, normals: Array, lighting: Lighting) -> Array:
    """(N,) factors: light reflected by the room is stronger on the wall that faces the windows."""
    if not lighting.windows:
        return np.ones(len(origins_m), np.float32)
    k, side = lighting.windows[0].axis, lighting.windows[0].side
    far_m = (lighting.low_m if side > 0 else lighting.high_m)[k]
    towards = side * normals[:, k]
    return 1.0 + 0.12 * towards * (side * origins_m[:, k] < side * far_m + 1) - 0.08 * (towards < -0.5)


def _gathered(points_m: Array, normals: Array, boxes_m: Array, lighting: Lighting) -> Array:
    """(N, 3) light on points; neighbouring points are computed together, as few boxes are near them."""
    light = np.empty_like(points_m)
    origins = (points_m + _NEAR_M * normals).astype(np.float32)
    normals = normals.astype(np.float32)
    cell = np.floor(origins / 1.5).astype(np.int64) + 8
    key = (cell[:, 0] * 32 + cell[:, 1]) * 32 + cell[:, 2]
    order = np.argsort(key, kind="stable")
    for group in np.split(order, np.nonzero(np.diff(key[order]))[0] + 1):
        for chunk in np.array_split(group, len(group) // 2000 + 1):
            o, n = origins[chunk], normals[chunk]
            open_, floor = _ambient(o, n, boxes_m, lighting)
            bright = _turned_to_windows(o, n, lighting)
            outside = np.any([w.beyond(o) for w in lighting.windows] or [np.zeros(len(o), bool)], axis=0)
            light[chunk] = (
                lighting.ambient * AMBIENT_RGB * (bright * (0.12 + 0.88 * open_))[:, None]
                + BOUNCE_RGB * floor[:, None]
                + DAY_RGB * (1.2 * lighting.day * _windows(o, n, boxes_m, lighting.windows))[:, None]
                + LAMP_RGB * _lamps(o, n, boxes_m, lighting)[:, None]
                + DAY_RGB * (REVEAL_LIGHT * outside)[:, None]
            )
    return light


@dataclass(frozen=True)
class _SunnyWall:
    """The holes of one wall that the sun shines into; travel: its direction, scaled to one metre through the wall."""

    axis: int
    side: int
    plane_m: float
    holes_m: tuple[Hole, ...]
    travel: Array


def _sunny_walls(lighting: Lighting) -> list[_SunnyWall]:
    sun = np.array(lighting.sun)
    walls: dict[tuple[int, int, float], list[Hole]] = {}
    for w in lighting.windows:
        if sun[w.axis] * w.side < 0:
            walls.setdefault((w.axis, w.side, w.plane_m), []).append(w.hole_m)
    return [_SunnyWall(*wall, tuple(holes), sun / abs(sun[wall[0]])) for wall, holes in walls.items()]


def _sunlit(points_m: Array, normals: Array, boxes_m: Array, lighting: Lighting) -> Array:
    """(N,) sunlight in [0, 1] from all windows that the sun shines into."""
    sun = np.array(lighting.sun)
    cos = np.maximum(-(normals[:, 0] * sun[0] + normals[:, 1] * sun[1] + normals[:, 2] * sun[2]), 0.0)
    cos /= np.sqrt(float((sun * sun).sum()))
    k = np.nonzero(cos > 0)[0]
    points, towards = points_m[k], normals[k]
    share = np.zeros(len(k))
    for wall in _sunny_walls(lighting):
        share += _through(wall, points, towards, boxes_m)
    total = np.zeros(len(points_m))
    total[k] = share * cos[k]
    return total


def _through(wall: _SunnyWall, points_m: Array, normals: Array, boxes_m: Array) -> Array:
    """(N,) share of the sun in [0, 1] that comes through one wall's panes, past glazing bars and furniture."""
    axis, side, travel = wall.axis, wall.side, wall.travel
    back = side * (wall.plane_m + side * 0.1 - points_m[:, axis])
    along, z = points_m[:, 1 - axis] - travel[1 - axis] * back, points_m[:, 2] - travel[2] * back
    share = np.zeros(len(points_m))
    for hole in wall.holes_m:
        low, high, z_low, z_high = hole
        blur = 0.008 + 0.004 * back
        inside = np.minimum(np.minimum(along - low, high - along), np.minimum(z - z_low, z_high - z)) - 0.055
        upright, level = pane_bars_m(hole)
        for at in upright:
            inside = np.minimum(inside, abs(along - at) - 0.026)
        for at in level:
            inside = np.minimum(inside, abs(z - at) - 0.016)
        share = np.maximum(share, np.clip(0.5 + inside / (2 * blur), 0, 1))
    k = np.nonzero((share > 0) & (back > 0.02))[0]
    result = np.zeros(len(points_m))
    origins = (points_m[k] + _NEAR_M * normals[k]).astype(np.float32)
    for chunk in np.array_split(np.arange(len(k)), len(k) // 4000 + 1):
        o = origins[chunk]
        towards = -travel * (side * (wall.plane_m - o[:, axis]))[:, None]
        if len(o):
            near = _within(boxes_m, np.minimum(o, o + towards).min(0), np.maximum(o, o + towards).max(0))
            result[k[chunk]] = first_hit(o, towards, near) >= 1.0
    return result * share


def lit(piece: Piece, lighting: Lighting) -> Array:
    """(V, 3) display-encoded colours of all sheets, in order, under the room's light: multiples of 1/255."""
    boxes = np.array(piece.blockers_m, np.float32)
    lattice = _lattice(piece.sheets)
    coarse = _gathered(lattice.points_m, lattice.normals, boxes, lighting)
    points = np.concatenate([s.points_m.reshape(-1, 3) for s in piece.sheets])
    normals = np.concatenate([s.normals.reshape(-1, 3) for s in piece.sheets])
    sizes = [s.rgb.size // 3 for s in piece.sheets]
    glow = np.repeat([min(s.glow, 1.0) for s in piece.sheets], sizes)[:, None]
    light = np.empty_like(points)
    at, first = 0, 0
    for s, r, c, size in zip(piece.sheets, lattice.rows, lattice.columns, sizes, strict=True):
        count = len(r) * len(c)
        spread = _spread(coarse[at : at + count].reshape(len(r), len(c), 3), r, c, s.points_m.shape[:2])
        light[first : first + size].reshape(s.points_m.shape)[:] = spread
        at += count
        first += size
    light += SUN_RGB * _sunlit(points, normals, boxes, lighting)[:, None]
    shown = np.sqrt(np.maximum(light, 0.0, out=light), out=light)
    shown *= 1 - glow
    shown += glow
    shown *= np.concatenate([s.rgb.reshape(-1, 3) for s in piece.sheets])
    shown = _shoulder(shown)
    shown *= 255.0
    return np.divide(np.round(shown, out=shown), 255.0, out=shown)


def _shoulder(x: Array) -> Array:
    """Compress values above 0.75, in place, so that highlights keep hue and detail, and never exceed 1."""
    over = np.maximum(x - 0.75, 0.0)
    softer = over / 0.25
    softer += 1
    over /= softer
    np.minimum(x, 0.75, out=x)
    x += over
    return np.clip(x, 0.0, 1.0, out=x)
