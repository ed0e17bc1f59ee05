# SPDX-License-Identifier: GPL-3.0-or-later
"""Grids of quads, and the solids made of them: boxes, rounded boxes, lathed bodies, tubes, discs, pillows.

Everything is a sheet: an open grid of R x C points with its own vertices, so that colours stay sharp where parts meet.
Seen from its outer side, columns run to the right and rows upwards: column step x row step = outward normal.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]  # of floats; pyright takes three times as long for arrays whose type is named
Point: TypeAlias = tuple[float, float, float]
# (u_m, v_m), each (R, C) in metres along the surface -> (R, C, 3) display-encoded colours.
Painter: TypeAlias = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Sheet:
    """A grid of quads.

    points_m, normals, rgb: (R, C, 3) float64; rgb is the colour under white light, display-encoded.
    glow: 0 for a surface that the room lights, 1 for one that shows its own colour (sky, screen, lampshade).
    """

    points_m: Array
    normals: Array
    rgb: Array
    glow: float = 0.0


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
    sheets = tuple(Sheet(p.reshape(s.points_m.shape), n.reshape(s.points_m.shape), s.rgb, s.glow) for s, p, n in parts)
    blockers = []
    for low, high in piece.blockers_m:
        corners = turn(np.array([[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)])) + shift
        blockers.append((_point(corners.min(0)), _point(corners.max(0))))
    return Piece(sheets, tuple(blockers))


def _moved(piece: Piece, by_m: Point) -> Piece:
    shift = np.array(by_m, np.float64)
    sheets = tuple(Sheet(s.points_m + shift, s.normals, s.rgb, s.glow) for s in piece.sheets)
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
