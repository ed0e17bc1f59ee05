# SPDX-License-Identifier: GPL-3.0-or-later
"""Grids of quads, the solids made of them, and procedural colour patterns.

Grids of quads, and the solids made of them: boxes, rounded boxes, lathed bodies, tubes, discs, pillows.

Everything is a sheet: an open grid of R x C points with its own vertices, so that colours stay sharp where parts meet.
Seen from its outer side, columns run to the right and rows upwards: column step x row step = outward normal.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import wraps
from itertools import pairwise
from typing import Any, ParamSpec, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]  # of floats; pyright takes three times as long for arrays whose type is named
Point: TypeAlias = tuple[float, float, float]
# (u_m, v_m), each (R, C) in metres along the surface -> (R, C, 3) display-encoded colours.
Painter: TypeAlias = Callable[[Array, Array], Array]
P = ParamSpec("P")


# The classes of things in rooms, by which their masks are numbered from 1 on: new ones come last.
CLASSES = (
    *("wall", "floor", "ceiling", "window", "outdoors", "curtain", "door", "table", "chair", "sofa", "bed", "cabinet"),
    *("shelf", "lamp", "screen", "picture", "clock", "mirror", "rug", "plant", "vase", "book", "box", "bin", "basket"),
    *("radiator", "bench", "stool", "rack", "board", "partition", "printer", "keyboard", "laptop", "fridge"),
    *("water cooler", "tableware", "kitchenware", "toy", "paper", "easel"),
)


@dataclass(frozen=True, eq=False)
class Thing:
    """A thing that has a name of its own, its class; two of one class are two things."""

    category: str


@dataclass(frozen=True)
class Sheet:
    """A grid of quads.

    points_m, normals, rgb: (R, C, 3) float64; rgb is the colour under white light, display-encoded.
    glow: 0 for a surface that the room lights, 1 for one that shows its own colour (sky, screen, lampshade).
    thing: what it is a part of; None of nothing that is named.
    """

    points_m: Array
    normals: Array
    rgb: Array
    glow: float = 0.0
    thing: Thing | None = None


@dataclass(frozen=True)
class Piece:
    """Sheets that belong together, and the boxes that cast their shadows: ((x, y, z) low, (x, y, z) high), metres."""

    sheets: tuple[Sheet, ...] = ()
    blockers_m: tuple[tuple[Point, Point], ...] = ()

    def __add__(self, other: "Piece") -> "Piece":
        return Piece(self.sheets + other.sheets, self.blockers_m + other.blockers_m)


def _point(numbers: Iterable[float]) -> Point:
    """Three numbers as a point."""
    x, y, z = numbers
    return x, y, z


def joined(pieces: Iterable[Piece]) -> Piece:
    """All sheets and blockers of many pieces, in order."""
    listed = list(pieces)
    return Piece(tuple(s for p in listed for s in p.sheets), tuple(b for p in listed for b in p.blockers_m))


def thing(category: str) -> Callable[[Callable[P, Piece]], Callable[P, Piece]]:
    """Decorate what builds a thing: those of its sheets that belong to nothing yet belong to one of this class."""
    if category not in CLASSES:
        raise ValueError(f"{category!r} is no class of things in rooms")

    def decorate(build: Callable[P, Piece]) -> Callable[P, Piece]:
        @wraps(build)
        def made(*args: P.args, **kwargs: P.kwargs) -> Piece:
            return named(build(*args, **kwargs), category)

        return made

    return decorate


def named(piece: Piece, category: str) -> Piece:
    """The piece, whose sheets that belong to nothing yet belong to one thing of this class."""
    one = Thing(category)
    return Piece(tuple(s if s.thing else replace(s, thing=one) for s in piece.sheets), piece.blockers_m)


def _others(sheets: tuple[Sheet, ...]) -> Iterator[Thing | None]:
    """Yield what copies of sheets are parts of: as many other things of the same classes."""
    others: dict[Thing, Thing] = {}
    for sheet in sheets:
        yield None if sheet.thing is None else others.setdefault(sheet.thing, Thing(sheet.thing.category))


def shadeless(piece: Piece) -> Piece:
    """The piece without blockers: for parts too thin, or too close to another blocker, to cast a shadow of note."""
    return Piece(piece.sheets)


def spaced(length_m: float, cell_m: float) -> Array:
    """Even coordinates from 0 to length_m, about cell_m apart, at least two."""
    count = max(1, round(length_m / cell_m))
    return np.arange(count + 1) * (length_m / count)


def grid(u_m: Array, v_m: Array) -> tuple[Array, Array]:
    """(R, C) coordinates for C values of u and R of v, as np.meshgrid gives, at a tenth of its cost for small ones."""
    u, v = np.empty((len(v_m), len(u_m))), np.empty((len(v_m), len(u_m)))
    u[:], v[:] = u_m, v_m[:, None]
    return u, v


def cross(a: Array, b: Array) -> Array:
    """Cross product over the last axis, written out so that every machine rounds in the same order."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        -1,
    )


def unit(v: Array) -> Array:
    """Vectors scaled to length 1; zero vectors stay zero."""
    length = np.sqrt(v[..., 0] ** 2 + v[..., 1] ** 2 + v[..., 2] ** 2)
    return v / np.maximum(length, 1e-12)[..., None]


def sheet(points_m: Array, rgb: Array, glow: float = 0.0) -> Sheet:
    """A sheet through (R, C, 3) points; its normals come from central differences."""
    normals = unit(cross(np.gradient(points_m, axis=1), np.gradient(points_m, axis=0)))
    return Sheet(points_m, normals, rgb, glow)


def rect(
    corner_m: Point,
    u_edge_m: Point,
    v_edge_m: Point,
    cell_m: float,
    paint: Painter,
    *,
    u_m: Array | None = None,
    v_m: Array | None = None,
    start_m: tuple[float, float] = (0.0, 0.0),
    glow: float = 0.0,
) -> Piece:
    """A flat rectangle with outward normal u x v; u_m and v_m replace the even grid, start_m shifts the painter."""
    corner, u_edge, v_edge = (np.array(x, np.float64) for x in (corner_m, u_edge_m, v_edge_m))
    u_length, v_length = (float(np.sqrt((e * e).sum())) for e in (u_edge, v_edge))
    u_m = spaced(u_length, cell_m) if u_m is None else u_m
    v_m = spaced(v_length, cell_m) if v_m is None else v_m
    u, v = grid(u_m, v_m)
    points = corner + u[..., None] * (u_edge / u_length) + v[..., None] * (v_edge / v_length)
    normals = np.broadcast_to(unit(cross(u_edge, v_edge)), points.shape)
    return Piece((Sheet(points, normals, paint(u + start_m[0], v + start_m[1]), glow),))


def _painted(sheets: list[Sheet], at: list[tuple[Array, Array]], paint: Painter) -> tuple[Sheet, ...]:
    """The sheets with colours for their (u, v), by a single call of the painter: calls cost more than vertices."""
    u, v = (np.concatenate([pair[k].ravel() for pair in at])[None] for k in (0, 1))
    parts = np.split(paint(u, v)[0], np.cumsum([pair[0].size for pair in at])[:-1])
    return tuple(
        Sheet(s.points_m, s.normals, rgb.reshape(s.points_m.shape), s.glow)
        for s, rgb in zip(sheets, parts, strict=True)
    )


# Face letter -> fixed axis, whether at the high end, and the axes (a, b) with a x b pointing outwards.
_FACES = {
    "x": (0, False, 2, 1),
    "X": (0, True, 1, 2),
    "y": (1, False, 0, 2),
    "Y": (1, True, 2, 0),
    "z": (2, False, 1, 0),
    "Z": (2, True, 0, 1),
}


def box(low_m: Point, high_m: Point, cell_m: float, paint: Painter, *, skip: str = "", glow: float = 0.0) -> Piece:
    """An axis-aligned box that blocks light; u runs along each face's longer edge; skip names faces (xXyYzZ)."""
    low, high = np.array(low_m, np.float64), np.array(high_m, np.float64)
    size = high - low
    sheets: list[Sheet] = []
    at: list[tuple[Array, Array]] = []

    def blank(u: Array, v: Array) -> Array:
        at.append((u, v))
        return np.zeros((*u.shape, 3))

    for number, (letter, (axis, far, a, b)) in enumerate(_FACES.items()):
        if letter in skip:
            continue
        corner, a_edge, b_edge = low.copy(), np.zeros(3), np.zeros(3)
        corner[axis] = high[axis] if far else low[axis]
        a_edge[a], b_edge[b] = size[a], size[b]
        if size[b] > size[a]:
            corner, a_edge, b_edge = corner + a_edge, b_edge, -a_edge
        shift = (1.7 * number + 3.1 * low[0], 2.3 * number + 1.3 * low[1] + 0.7 * low[2])
        sheets += rect(_point(corner), _point(a_edge), _point(b_edge), cell_m, blank, start_m=shift, glow=glow).sheets
    return Piece(_painted(sheets, at, paint), ((low_m, high_m),))


def _rounded_steps(length_m: float, radius_m: float, cell_m: float, arc: int) -> Array:
    """Coordinates along one edge of a rounded box: finer inside the two arcs."""
    bend = np.arange(arc) * (radius_m / arc)
    middle = spaced(max(length_m - 2 * radius_m, 1e-4), cell_m) + radius_m
    return np.concatenate([bend, middle, length_m - bend[::-1]])


def rounded_box(
    low_m: Point, high_m: Point, radius_m: float, cell_m: float, paint: Painter, *, arc: int = 2, bulge_m: float = 0.0
) -> Piece:
    """A box with round edges and corners of radius_m; bulge_m swells its faces, as upholstery does. Coarse below."""
    low, high = np.array(low_m, np.float64), np.array(high_m, np.float64)
    size = high - low
    radius = min(radius_m, 0.49 * float(size.min()))
    sheets: list[Sheet] = []
    at: list[tuple[Array, Array]] = []
    for number, (letter, (axis, far, a, b)) in enumerate(_FACES.items()):
        cell = 4 * cell_m if letter == "z" else cell_m
        along_a, along_b = (_rounded_steps(float(size[k]), radius, cell, arc) for k in (a, b))
        grid_a, grid_b = grid(along_a, along_b)
        points = np.empty((*grid_a.shape, 3))
        points[..., axis] = high[axis] if far else low[axis]
        points[..., a], points[..., b] = grid_a + low[a], grid_b + low[b]
        core = np.clip(points, low + radius, high - radius)
        normals = unit(points - core)
        swell_a, swell_b = 1 - (2 * grid_a / size[a] - 1) ** 2, 1 - (2 * grid_b / size[b] - 1) ** 2
        points = core + normals * (radius + bulge_m * swell_a * swell_b)[..., None]
        u, v = (grid_a, grid_b) if size[a] >= size[b] else (grid_b, grid_a)
        at.append((u + 1.7 * number + 3.1 * low[0], v + 2.3 * number + 1.3 * low[1]))
        sheets.append(Sheet(points, normals, points))
    return Piece(_painted(sheets, at, paint), ((low_m, high_m),))


def ball(centre_m: Point, radius_m: float, cell_m: float, paint: Painter) -> Piece:
    """A sphere made of six bent squares, so that it has no poles."""
    low = _point(c - radius_m for c in centre_m)
    high = _point(c + radius_m for c in centre_m)
    count = max(2, round(0.8 * radius_m / cell_m))
    return rounded_box(low, high, radius_m, 1.0, paint, arc=count)


def disc(
    centre_m: Point, radius_m: float, cell_m: float, paint: Painter, *, up: bool = True, glow: float = 0.0
) -> Piece:
    """A horizontal disc: a square grid bent round, which needs no triangle in the middle; u, v start at the centre."""
    count = max(2, round(2 * radius_m / cell_m))
    s = (2 * np.arange(count + 1) / count - 1) * (1 if up else -1)
    x, y = np.meshgrid(s, s * (1 if up else -1))
    u, v = radius_m * x * np.sqrt(1 - y * y / 2), radius_m * y * np.sqrt(1 - x * x / 2)
    points = np.stack([u, v, np.zeros_like(u)], -1) + np.array(centre_m)
    normals = np.broadcast_to(np.array([0.0, 0.0, 1.0 if up else -1.0]), points.shape)
    return Piece((Sheet(points, normals, paint(u, v), glow),))


def lathe(
    centre_m: Point,
    profile_m: list[tuple[float, float]],
    sides: int,
    paint: Painter,
    *,
    cell_m: float = 0.02,
    glow: float = 0.0,
) -> Piece:
    """A body of revolution about a vertical axis, outer side only where the (radius, z) profile runs upwards."""
    profile = np.array(profile_m, np.float64)
    lengths = np.sqrt((np.diff(profile, axis=0) ** 2).sum(-1))
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    fine = np.unique(np.concatenate([a + spaced(b - a, cell_m) for a, b in pairwise(at)]).round(9))
    radius, z = np.interp(fine, at, profile[:, 0]), np.interp(fine, at, profile[:, 1])
    angle = np.arange(sides + 1) * (2 * np.pi / sides)
    angle[-1] = 0.0
    points = np.stack(
        [
            radius[:, None] * np.cos(angle) + centre_m[0],
            radius[:, None] * np.sin(angle) + centre_m[1],
            np.repeat(z[:, None] + centre_m[2], sides + 1, 1),
        ],
        -1,
    )
    u, v = np.meshgrid(np.arange(sides + 1) * (2 * np.pi / sides) * float(profile[:, 0].max()), fine)
    normals = unit(cross(points[:, [*range(1, sides), 0, 1]] - points[:, [-2, *range(sides - 1), -2]], _rows(points)))
    return Piece((Sheet(points, normals, paint(u, v), glow),))


def _rows(points_m: Array) -> Array:
    return np.gradient(points_m, axis=0)


def tube(path_m: list[Point], radius_m: float | Array, sides: int, paint: Painter, *, glow: float = 0.0) -> Piece:
    """A round bar along a path of K points; radius_m is one number or K of them. Its ends stay open."""
    path = np.array(path_m, np.float64)
    along = unit(np.gradient(path, axis=0))
    # The axis that the path is least parallel to is never parallel to it, so it can define the sides everywhere.
    side = np.eye(3)[int(np.argmin(abs(along).max(0)))]
    across = unit(cross(along, np.broadcast_to(side, along.shape)))
    third = cross(along, across)
    angle = np.arange(sides + 1) * (2 * np.pi / sides)
    angle[-1] = 0.0
    radius = np.broadcast_to(np.asarray(radius_m, np.float64), (len(path),))
    normals = across[:, None] * np.cos(angle)[:, None] + third[:, None] * np.sin(angle)[:, None]
    points = path[:, None] + normals * radius[:, None, None]
    lengths = np.sqrt((np.diff(path, axis=0) ** 2).sum(-1))
    u, v = np.meshgrid(np.arange(sides + 1) * (2 * np.pi / sides) * float(radius.max()), np.append(0, lengths.cumsum()))
    return Piece((Sheet(points, normals, paint(v, u), glow),))


def rod(start_m: Point, end_m: Point, radius_m: float, cell_m: float, paint: Painter, *, sides: int = 8) -> Piece:
    """A straight round bar between two points."""
    a, b = np.array(start_m, np.float64), np.array(end_m, np.float64)
    t = spaced(1.0, cell_m / float(np.sqrt(((b - a) ** 2).sum())))
    return tube([_point(a + (b - a) * k) for k in t], radius_m, sides, paint)


def pillow(width_m: float, height_m: float, thick_m: float, cell_m: float, paint: Painter) -> Piece:
    """A scatter cushion about the origin in the x-z plane, thick along y, with pinched sides and pointed corners."""
    u, v = np.meshgrid(spaced(width_m, cell_m), spaced(height_m, cell_m))
    s, t = 2 * u / width_m - 1, 2 * v / height_m - 1
    x = 0.5 * width_m * s * (1 - 0.1 * (1 - t * t))
    z = 0.5 * height_m * t * (1 - 0.1 * (1 - s * s))
    y = 0.5 * thick_m * np.sqrt(np.sqrt(np.maximum((1 - s * s) * (1 - t * t), 0.0)) * (1 - 0.25 * (s * s + t * t)))
    rgb = paint(u, v)
    front = sheet(np.stack([x, -y, z], -1), rgb)
    back = sheet(np.stack([x, y, z], -1)[:, ::-1], rgb[:, ::-1])
    return Piece((front, back))


def _transformed(piece: Piece, rotation: Array, at_m: Point) -> Piece:
    def turn(p: Array) -> Array:
        return np.stack([p[..., 0] * r[0] + p[..., 1] * r[1] + p[..., 2] * r[2] for r in rotation], -1)

    shift = np.array(at_m, np.float64)
    # All sheets at once: calls cost more than vertices.
    points = turn(np.concatenate([s.points_m.reshape(-1, 3) for s in piece.sheets])) + shift
    normals = turn(np.concatenate([s.normals.reshape(-1, 3) for s in piece.sheets]))
    ends = np.cumsum([s.points_m.size // 3 for s in piece.sheets])[:-1]
    parts = zip(piece.sheets, np.split(points, ends), np.split(normals, ends), strict=True)
    sheets = tuple(
        Sheet(p.reshape(s.points_m.shape), n.reshape(s.points_m.shape), s.rgb, s.glow, other)
        for (s, p, n), other in zip(parts, _others(piece.sheets), strict=True)
    )
    blockers = []
    for low, high in piece.blockers_m:
        corners = turn(np.array([[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)])) + shift
        blockers.append((_point(corners.min(0)), _point(corners.max(0))))
    return Piece(sheets, tuple(blockers))


def _moved(piece: Piece, by_m: Point) -> Piece:
    shift = np.array(by_m, np.float64)
    sheets = tuple(
        Sheet(s.points_m + shift, s.normals, s.rgb, s.glow, other)
        for s, other in zip(piece.sheets, _others(piece.sheets), strict=True)
    )
    moved = tuple((_sum(low, by_m), _sum(high, by_m)) for low, high in piece.blockers_m)
    return Piece(sheets, moved)


def _sum(a: Point, b: Point) -> Point:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def placed(piece: Piece, at_m: Point, yaw_deg: float = 0.0) -> Piece:
    """The piece turned about the vertical through its origin, then moved to at_m."""
    if not yaw_deg:
        return _moved(piece, at_m)
    c, s = float(np.cos(np.deg2rad(yaw_deg)).round(12)), float(np.sin(np.deg2rad(yaw_deg)).round(12))
    return _transformed(piece, np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), at_m)


def tilted(piece: Piece, axis: int, angle_deg: float) -> Piece:
    """The piece turned about the x (0) or y (1) axis through its origin."""
    c, s = float(np.cos(np.deg2rad(angle_deg)).round(12)), float(np.sin(np.deg2rad(angle_deg)).round(12))
    about_x, about_y = [[1.0, 0, 0], [0, c, -s], [0, s, c]], [[c, 0, s], [0, 1.0, 0], [-s, 0, c]]
    return _transformed(piece, np.array(about_x if axis == 0 else about_y), (0.0, 0.0, 0.0))


# Procedural colour patterns from an integer hash: the same bytes on every machine and in every run.
#
# A painter maps (u_m, v_m), metres along a surface with u along its length, to display-encoded colours.


_MASK = 0xFFFFFFFF  # the lower 32 bits
_I, _J, _SEED = 374761393, 668265263, 2246822519
_ROUNDS = tuple(map(np.uint32, (15, 0x2C1B3C6D, 12, 0x297A2D39, 15)))


def colour(code: str) -> Array:
    """(3,) float64 from a "#rrggbb" code."""
    return np.array([int(code[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0


def hash01(i: NDArray[np.int64] | Array, j: NDArray[np.int64] | Array, seed: int) -> Array:
    """A pseudo-random number in [0, 1) for every pair of whole numbers.

    The multipliers are primes of xxHash32; the final mix is the two-round hash 15-2c1b3c6d-12-297a2d39-15 that
    hash-prospector lists.
    """
    return _mixed(_times(i, _I) + _times(j, _J) + np.uint32(seed * _SEED & _MASK))


def _times(numbers: NDArray[np.int64] | Array, prime: int) -> NDArray[np.uint32]:
    """Whole numbers times a prime, in 32 bits."""
    return np.asarray(numbers).astype(np.int64).astype(np.uint32) * np.uint32(prime)


def _mixed(h: NDArray[np.uint32]) -> Array:
    """Numbers in [0, 1) from hashes, which are used up."""
    first, by, second, again, last = _ROUNDS
    h ^= h >> first
    h *= by
    h ^= h >> second
    h *= again
    h ^= h >> last
    return h / 4294967296.0


def pick(index: int, seed: int, low: float = 0.0, high: float = 1.0) -> float:
    """A pseudo-random number in [low, high) for an index: hash01 of one number, which costs less without arrays."""
    h = (index * _I + seed % 9973 * _J + seed * _SEED) & _MASK
    h = (h ^ h >> 15) * 0x2C1B3C6D & _MASK
    h = (h ^ h >> 12) * 0x297A2D39 & _MASK
    return low + (high - low) * ((h ^ h >> 15) / 4294967296.0)


def noise(u: Array, v: Array, seed: int) -> Array:
    """Value noise in [0, 1) with a lattice of step 1: scale u and v to choose the grain."""
    iu, iv = np.floor(u), np.floor(v)
    fu, fv = u - iu, v - iv
    fu, fv = fu * fu * (3 - 2 * fu), fv * fv * (3 - 2 * fv)
    first_u, first_v = iu.min(), iv.min()
    count_u, count_v = int(iu.max() - first_u) + 2, int(iv.max() - first_v) + 2
    if count_u * count_v < 2 * iu.size:
        # There are fewer lattice points than vertices: hash each point once, then look up the four corners.
        table = hash01(first_u + np.arange(count_u)[:, None], first_v + np.arange(count_v), seed).ravel()
        at = ((iu - first_u) * count_v + (iv - first_v)).astype(np.int64)
        near, far_u, far_v, far = (table[at + step] for step in (0, count_v, 1, count_v + 1))
    else:
        h = np.empty((4, *iu.shape), np.uint32)
        h[0] = _times(iu, _I) + _times(iv, _J) + np.uint32(seed * _SEED & _MASK)
        h[1] = h[0] + np.uint32(_I)
        h[2:] = h[:2] + np.uint32(_J)
        near, far_u, far_v, far = _mixed(h)
    low, high = near + (far_u - near) * fu, far_v + (far - far_v) * fu
    return low + (high - low) * fv


def cloud(u: Array, v: Array, seed: int, octaves: int = 3) -> Array:
    """Noise of several grains, each half as wide and half as strong as the one before; in [0, 1)."""
    total, weight = np.zeros_like(u), 0.0
    for k in range(octaves):
        total += noise(u * 2**k, v * 2**k, seed + 17 * k) * 0.5**k
        weight += 0.5**k
    return total / weight


def mix(a: Array, b: Array, t: Array) -> Array:
    """From colour a (t = 0) to colour b (t = 1); a and b are (3,) or (R, C, 3), t is (R, C)."""
    w = np.clip(t, 0.0, 1.0)[..., None]
    return a * (1 - w) + b * w


def ramp(x: Array, start: float | Array, end: float | Array) -> Array:
    """0 at start, 1 at end, smooth between; start may be the larger one."""
    t = np.clip((x - start) / (end - start), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def plain(
    code: str, seed: int, *, grain: float = 0.05, grain_m: float = 0.012, patch: float = 0.05, fleck: float = 0.0
) -> Painter:
    """One colour with fine grain and faint patches, as paint, leather or glazed clay have; fleck adds dark dots."""
    base = colour(code)

    def paint(u: Array, v: Array) -> Array:
        dot = hash01(np.floor(u / grain_m), np.floor(v / grain_m), seed)
        tone = 1 + 2 * grain * (dot - 0.5) - fleck * (dot < 0.08)
        if patch:
            tone += 2 * patch * (cloud(u / 0.15, v / 0.15, seed + 1, 2) - 0.5)
        return base * tone[..., None]

    return paint


def wood(light: str, dark: str, seed: int, *, scale: float = 1.0) -> Painter:
    """Timber with its grain along u: streaks, growth rings and a knot here and there."""
    pale, deep = colour(light), colour(dark)

    def paint(u: Array, v: Array) -> Array:
        u, v = u / scale, v / scale
        bend = 0.03 * (noise(u / 0.5, v / 0.2, seed) - 0.5)
        rings = cloud(u / 0.9, (v + bend) / 0.035, seed + 1, 3)
        streak = noise(u / 0.11, v / 0.011, seed + 2)
        pores = 0.35 * (hash01(np.floor(u / 0.05), np.floor(v / 0.016), seed + 3) > 0.9)
        return mix(pale, deep, 0.9 * ramp(rings, 0.25, 0.8) + 0.5 * (streak - 0.5) + 0.75 * _knots(u, v, seed) + pores)

    return paint


def _knots(u: Array, v: Array, seed: int) -> Array:
    """Darkness of the knots: at most one in a cell of 45 x 14 cm, with a ring around it."""
    iu, iv = np.floor(u / 0.45), np.floor(v / 0.14)
    du = u / 0.45 - iu - (0.25 + 0.5 * hash01(iu, iv, seed + 5))
    dv = v / 0.14 - iv - (0.3 + 0.4 * hash01(iu, iv, seed + 6))
    d = np.sqrt((du * 0.45 / 1.7) ** 2 + (dv * 0.14) ** 2)
    return np.where(
        hash01(iu, iv, seed + 7) < 0.45, ramp(d, 0.016, 0.006) + 0.4 * ramp(abs(d - 0.024), 0.007, 0.0), 0.0
    )


PLANK_M = (1.4, 0.125)  # length and width of a board; like the other sizes in this room, designed, not measured
GAP_M = 0.003  # between boards


def plank_rows(length_m: float, inner: int) -> Array:
    """Grid rows across boards of PLANK_M, inner ones a board and three close together at every gap: a thin line."""
    count = round(length_m / PLANK_M[1])
    offsets = np.array([0.0, GAP_M, *np.arange(1, inner + 1) * (PLANK_M[1] / (inner + 1)), PLANK_M[1] - GAP_M])
    return np.append((np.arange(count)[:, None] * PLANK_M[1] + offsets).ravel(), count * PLANK_M[1])


def planks(light: str, dark: str, gap: str, seed: int) -> Painter:
    """Boards of PLANK_M laid along u with staggered ends; every board has its own tone and grain."""
    timber = wood(light, dark, seed)
    joint = colour(gap)

    def paint(u: Array, v: Array) -> Array:
        row = np.floor(v / PLANK_M[1] + 1e-6)
        shifted = u / PLANK_M[0] + hash01(row, row * 0, seed + 20)
        board = np.floor(shifted)
        own = hash01(board, row, seed + 21)
        rgb = timber(u + 7.3 * own, v + 3.1 * np.floor(8 * own))
        tone = 0.80 + 0.36 * hash01(board, row, seed + 22)
        warm = 1 + (hash01(board, row, seed + 23)[..., None] - 0.5) * np.array([0.04, 0.0, -0.10])
        edge_m = np.minimum(abs(v - row * PLANK_M[1]), abs(v - (row + 1) * PLANK_M[1]))
        end_m = (shifted - board) * PLANK_M[0]
        seam = np.maximum(edge_m < GAP_M / 2, 0.8 * (end_m < 0.016))
        return mix(rgb * tone[..., None] * warm, joint, seam)

    return paint


def beadboard(code: str, gap: str, seed: int) -> Painter:
    """Painted upright boards of PLANK_M's width, the brush marks and a knot showing here and there."""
    base, joint = colour(code), colour(gap)

    def paint(u: Array, v: Array) -> Array:
        board = np.floor(u / PLANK_M[1] + 1e-6)
        edge_m = np.minimum(abs(u - board * PLANK_M[1]), abs(u - (board + 1) * PLANK_M[1]))
        brush = noise(u / 0.024, v / 0.14 + 9 * hash01(board, board * 0, seed), seed + 1) - 0.5
        dots = hash01(np.floor(u / 0.025), np.floor(v / 0.026), seed + 2) < 0.05
        tone = 0.95 + 0.1 * hash01(board, board * 0, seed + 3) + 0.13 * brush - 0.13 * dots
        return mix(base * tone[..., None], joint, np.maximum(edge_m < GAP_M / 2, 0.45 * _knots(v, u, seed + 4)))

    return paint


BRICK_M = (0.22, 0.075)  # length and height of a brick with its mortar
MORTAR_M = 0.010  # width of a joint


def brick_grid(u_length_m: float, v_length_m: float) -> tuple[Array, Array]:
    """Columns and rows of a grid whose lines follow the edges of bricks of BRICK_M in running bond."""
    half, course, m = BRICK_M[0] / 2, BRICK_M[1], MORTAR_M / 2
    along = np.array([0.0, m, m + 0.003, *np.linspace(m + 0.028, half - m - 0.028, 2), half - m - 0.003, half - m])
    up = np.array([0.0, m, m + 0.003, course / 2, course - m - 0.003, course - m])
    u = (np.arange(int(u_length_m / half) + 1)[:, None] * half + along).ravel()
    v = (np.arange(int(v_length_m / course) + 1)[:, None] * course + up).ravel()
    ends = ((u, u_length_m), (v, v_length_m))
    u, v = (np.append(x[x < length - 0.001], length) for x, length in ends)
    return u, v


def brick_depth(u: Array, v: Array) -> tuple[Array, Array, Array]:
    """(face, column, course): face is 1 on a brick and 0 on mortar; column and course are the brick's numbers."""
    course = np.floor(v / BRICK_M[1] + 1e-6)
    shifted = u / BRICK_M[0] + 0.5 * (course % 2)
    column = np.floor(shifted + 1e-6)
    in_u = (shifted - column) * BRICK_M[0]
    in_v = v - course * BRICK_M[1]
    edge = np.minimum(np.minimum(in_u, BRICK_M[0] - in_u), np.minimum(in_v, BRICK_M[1] - in_v)) - MORTAR_M / 2
    return ramp(edge, 0.0005, 0.0029), column, course


RED_BRICKS = ("#b5745a", "#a9644c", "#c08468", "#97563f", "#b98f78", "#8a4e3e", "#c69a82")


def bricks(seed: int, codes: tuple[str, ...] = RED_BRICKS, joint: str = "#cfc5b6") -> Painter:
    """Bricks, reddish if nothing else is asked for, each with its own tone, with pits and pale smears, in mortar."""
    tones = np.array([colour(c) for c in codes])
    mortar = colour(joint)

    def paint(u: Array, v: Array) -> Array:
        face, column, course = brick_depth(u, v)
        tone = tones[(hash01(column, course, seed) * len(tones)).astype(np.int64)]
        pits = hash01(np.floor(u / 0.013), np.floor(v / 0.013), seed + 1)
        grime = cloud(u / 0.08, v / 0.05, seed + 2)
        rgb = tone * (0.72 + 0.5 * grime - 0.28 * (pits > 0.88) + 0.14 * (pits < 0.1))[..., None]
        smear = ramp(cloud(u / 0.3, v / 0.2, seed + 3), 0.62, 0.8) * 0.5
        joint = mortar * (0.86 + 0.25 * hash01(np.floor(u / 0.011), np.floor(v / 0.009), seed + 4))[..., None]
        return mix(joint, mix(rgb, mortar, smear), face)

    return paint


def _leaf(u: Array, v: Array, length: Array, width: float) -> Array:
    """Coverage of a leaf from the origin, rising to the right: a lens of the given length and width."""
    along, aside = (0.82 * u + 0.57 * v) / length, abs(0.82 * v - 0.57 * u) / width
    inside = 4 * along * (1 - along) - 2 * aside
    return ramp(inside, 0.0, 0.45)


SPRIG_M = (0.28, 0.35)  # width and height of the repeat


def wallpaper(ground: str, leaf: str, berry: str, seed: int) -> Painter:
    """Sprigs with leaves and berries in half-drop repeat, each a little different, on a speckled ground."""
    paper, green, red = colour(ground), colour(leaf), colour(berry)

    def paint(u: Array, v: Array) -> Array:
        column = np.floor(u / SPRIG_M[0])
        v = v + SPRIG_M[1] / 2 * (column % 2)
        row = np.floor(v / SPRIG_M[1])
        x = u - (column + 0.5) * SPRIG_M[0] + 0.04 * (hash01(column, row, seed) - 0.5)
        y = v - row * SPRIG_M[1] - 0.03 * hash01(column, row, seed + 1)
        straight = x
        x = np.where(hash01(column, row, seed + 2) < 0.5, -x, x)
        lean = 0.5 * (hash01(column, row, seed + 3) - 0.3)
        x = x - lean * (y - 0.16) * y * 4
        cover = ramp(abs(x), 0.012, 0.005) * (y > 0.02) * (y < 0.25)
        for k, height in enumerate((0.03, 0.075, 0.12, 0.165, 0.205)):
            side = 1 - 2 * (k % 2)
            size = 0.115 - 0.010 * k + 0.02 * hash01(column, row * 8 + k, seed + 4)
            cover = np.maximum(cover, _leaf(x * side, y - height, size, 0.052 - 0.003 * k))
        tone = 0.85 + 0.3 * hash01(column, row, seed + 5)
        berries = np.zeros_like(u)
        for k in range(4):
            bx = 0.22 * hash01(column, row * 4 + k, seed + 6) - 0.11
            by = 0.03 + 0.29 * hash01(column, row * 4 + k, seed + 7)
            berries = np.maximum(berries, ramp(np.sqrt((straight - bx) ** 2 + (y - by) ** 2), 0.022, 0.014))
        speck = hash01(np.floor(u / 0.014), np.floor(v / 0.014), seed + 8)
        rgb = (
            paper * (1 - 0.22 * (speck > 0.92) + 0.03 * (speck < 0.2) - 0.05 * cloud(u / 0.4, v / 0.4, seed))[..., None]
        )
        rgb = mix(rgb, green * tone[..., None], cover * (0.85 + 0.15 * (speck > 0.3)))
        return mix(rgb, red, 0.9 * berries * (cover < 0.4))

    return paint


def weave(code: str, thread: str, seed: int, *, thread_m: float = 0.018) -> Painter:
    """Coarse cloth: every thread crossing has its own tone, some are of the second colour."""
    base, second = colour(code), colour(thread)

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / thread_m), np.floor(v / thread_m)
        tone = 0.84 + 0.3 * hash01(i, j, seed) + 0.07 * ((i + j) % 2)
        return (
            mix(base * tone[..., None], second, 0.5 * (hash01(i, j, seed + 1) > 0.88))
            * (0.92 + 0.16 * cloud(u / 0.2, v / 0.2, seed + 2, 2))[..., None]
        )

    return paint


def stripes(codes: list[str], widths_m: list[float], seed: int) -> Painter:
    """Woven stripes along v, repeated across u."""
    tones, edges = np.array([colour(c) for c in codes]), np.cumsum(widths_m)

    def paint(u: Array, v: Array) -> Array:
        band = np.searchsorted(edges, u % edges[-1], side="right").clip(0, len(tones) - 1)
        grain = hash01(np.floor(u / 0.012), np.floor(v / 0.012), seed)
        return tones[band] * (0.88 + 0.2 * grain)[..., None]

    return paint


def checks(codes: list[str], size_m: float, seed: int) -> Painter:
    """Squares in random colours, as a patchwork."""
    tones = np.array([colour(c) for c in codes])

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / size_m), np.floor(v / size_m)
        grain = hash01(np.floor(u / 0.01), np.floor(v / 0.01), seed)
        return tones[(hash01(i, j, seed + 1) * len(tones)).astype(np.int64)] * (0.88 + 0.2 * grain)[..., None]

    return paint


def terrazzo(code: str, chips: list[str], seed: int, *, chip_m: float = 0.03) -> Painter:
    """A ground with chips of other colours strewn over it: stone, glaze, or printed cotton."""
    base, tones = colour(code), np.array([colour(c) for c in chips])

    def paint(u: Array, v: Array) -> Array:
        i, j = np.floor(u / chip_m), np.floor(v / chip_m)
        du = u / chip_m - i - 0.3 - 0.4 * hash01(i, j, seed)
        dv = v / chip_m - j - 0.3 - 0.4 * hash01(i, j, seed + 1)
        size = 0.18 + 0.22 * hash01(i, j, seed + 2)
        tone = tones[(hash01(i, j, seed + 3) * len(tones)).astype(np.int64)]
        return mix(base * np.ones_like(tone), tone, ramp(np.maximum(abs(du + 0.3 * dv), abs(dv)), size, size - 0.15))

    return paint
