# SPDX-License-Identifier: GPL-3.0-or-later
"""The free space of a room that is given only as a mesh, and whether a body has room along its path.

The free space of a room that is given only as a mesh: a map of cells, as seen from above. Gravity is -z.

A cell is blocked where the mesh has anything within the clearance of the camera's heights, and known where the mesh has
a floor or furniture below these. Cells are 5 cm wide; larger where the mesh or the clearance is so large that the map
would have too many of them, or the mesh too many pieces.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import Message, NoisyWorldError, PresetKey, either
from ..core.trajectory import Trajectory
from ..scenes.polygon_mesh import Mesh
from .bodies import CarryingBody

# Points sampled closely on a mesh's faces, within a budget, so that no mesh takes minutes.


Float64: TypeAlias = NDArray[np.float64]

_NEEDLE = 256  # sizes long: 12.8 m of 5 cm
_CHUNK = 100_000  # triangles cut at a time, so that memory stays flat


@dataclass(frozen=True, eq=False)
class SampledTriangles:
    """The triangles of a mesh, (T, 3, 3) metres, and what decides into how many pieces they are cut.

    sides: (2, 2) lower and upper corner of the ground that matters. extents_m: (T,) the longest along an axis.
    areas_m2, lengths_m: (T,) area and longest edge within the sides, never less than they are.
    """

    triangles_m: Float64
    sides: Float64
    extents_m: Float64
    areas_m2: Float64
    lengths_m: Float64

    def pieces(self, size_m: float) -> float:
        """Return about how many pieces of this size they make, rather too many."""
        large = self.extents_m > size_m
        areas, lengths = self.areas_m2[large] / size_m**2, self.lengths_m[large] / size_m
        # Measured: halving a right triangle ends between size^2 / 8 and size^2 / 4, and halves of slivers overlap.
        parts = np.where(self._needles(size_m)[large], 2.0 * lengths, 6.0 * areas + 1.5 * lengths**1.4) + 1.0
        return float(parts.sum())

    def points_m(self, size_m: float) -> Float64:
        """(P, 3) points of larger faces, no farther apart than the size."""
        large, needles = self.extents_m > size_m, self._needles(size_m)
        along = [_along(triangle_m, size_m / 2.0) for triangle_m in self.triangles_m[large & needles]]
        return np.concatenate([*along, *_pieces(self.triangles_m[large & ~needles], self.sides, size_m)])

    def _needles(self, size_m: float) -> NDArray[np.bool_]:
        """Tell which triangles are so long and thin that points along an edge are as good as pieces.

        Halving their longest edge gives pieces that overlap, many times as many as points.
        """
        if np.isfinite(self.sides).any():
            return np.zeros(len(self.triangles_m), dtype=bool)  # what lies beyond the sides is dropped piece by piece
        thin = self.areas_m2 * 2.0 < self.lengths_m * size_m / 2.0
        return thin & (self.lengths_m > _NEEDLE * size_m)


def faces_of(mesh: Mesh, sides: Float64, least_m: float) -> SampledTriangles:
    """Return the triangles of a mesh's faces that extend farther than least_m along an axis."""
    sizes = mesh.face_sizes
    extents_m = np.zeros(len(sizes))
    for axis in range(3 if len(sizes) else 0):
        along = mesh.vertices_m[mesh.corner_vertices, axis]
        span_m = np.maximum.reduceat(along, mesh.face_starts) - np.minimum.reduceat(along, mesh.face_starts)
        np.maximum(extents_m, span_m, out=extents_m)
    large = extents_m > least_m
    starts, sizes = mesh.face_starts[large].astype(np.int64), sizes[large].astype(np.int64)
    fans = np.maximum(sizes - 2, 0)
    second = np.arange(fans.sum()) - np.repeat(np.cumsum(fans) - fans, fans) + np.repeat(starts, fans) + 1
    corners = mesh.corner_vertices[np.column_stack([np.repeat(starts, fans), second, second + 1])]
    triangles_m = mesh.vertices_m[corners]
    areas_m2, lengths_m = _within(triangles_m, sides)
    return SampledTriangles(triangles_m, sides, np.repeat(extents_m[large], fans), areas_m2, lengths_m)


def _within(triangles_m: Float64, sides: Float64) -> tuple[Float64, Float64]:
    """Return upper bounds of the area (T,) and of the longest edge (T,) of triangles within the sides."""
    a, b, c = np.moveaxis(triangles_m, 1, 0)
    normals_m2 = np.cross(b - a, c - a)
    areas_m2 = np.linalg.norm(normals_m2, axis=-1) / 2.0
    edges_m = np.stack([b - a, c - b, a - c])
    lengths_m = np.sqrt(np.sum(edges_m**2, axis=-1).max(axis=0))
    if not np.isfinite(sides).all():
        return areas_m2, lengths_m
    room_m = np.diff(sides, axis=0)[0]
    extents_m = np.ptp(triangles_m[..., :2], axis=1)
    # Along an axis a triangle is at most twice as dense as on average; seen from above its share is at most the ground.
    with np.errstate(divide="ignore", invalid="ignore"):
        slab = np.nanmin(np.where(extents_m > 0.0, 2.0 * room_m / extents_m, 1.0), axis=1)
        ground = np.where(normals_m2[:, 2] != 0.0, room_m.prod() / (np.abs(normals_m2[:, 2]) / 2.0), 1.0)
    met = np.all(
        (triangles_m[..., :2].max(axis=1) >= sides[0]) & (triangles_m[..., :2].min(axis=1) <= sides[1]), axis=1
    )
    share = np.minimum(np.minimum(slab, ground), 1.0) * met
    return areas_m2 * share, lengths_m * np.minimum(slab, 1.0) * met


def _along(triangle_m: Float64, size_m: float) -> Float64:
    """(3, 3) -> (P, 3) points of its longest edge."""
    ends_m = np.roll(triangle_m, -1, axis=0)
    longest = int(np.argmax(np.sum((ends_m - triangle_m) ** 2, axis=1)))
    a, b = triangle_m[longest], ends_m[longest]
    return a + np.linspace(0.0, 1.0, int(np.ceil(np.linalg.norm(b - a) / size_m)) + 1)[:, None] * (b - a)


def _pieces(triangles_m: Float64, sides: Float64, size_m: float) -> list[Float64]:
    """(T, 3, 3) -> centroids of pieces no longer than the size; cutting the longest edge keeps slivers few."""
    centroids = []
    bounded = bool(np.isfinite(sides).any())
    rest = [np.ascontiguousarray(np.moveaxis(triangles_m, 0, -1))]  # corner, axis, triangle: sums over corners are fast
    while rest:
        part = rest.pop()
        if part.shape[-1] > _CHUNK:
            rest += [part[..., :_CHUNK], part[..., _CHUNK:]]
            continue
        if bounded:
            flat = part[:, :2]
            near = (flat.max(axis=0) >= sides[0][:, None]) & (flat.min(axis=0) <= sides[1][:, None])
            part = part[..., near.all(axis=0)]
        squares_m2 = np.sum((np.roll(part, -1, axis=0) - part) ** 2, axis=1)
        small = np.all(squares_m2 <= size_m**2, axis=0)
        centroids.append(part[..., small].mean(axis=0).T)
        if small.all():
            continue
        order = (np.argmax(squares_m2[:, ~small], axis=0) + np.arange(3)[:, None]) % 3
        a, b, c = np.take_along_axis(part[..., ~small], order[:, None], axis=0)
        middle = (a + b) / 2.0
        rest.append(np.concatenate([np.stack([a, middle, c]), np.stack([middle, b, c])], axis=-1))
    return centroids


Mask: TypeAlias = NDArray[np.bool_]

# Chosen, unless a comment says otherwise: what looks like a person walking through a furnished room.
_CELL_M = 0.05  # the map's resolution: fine enough for a gap between furniture, some 10^4 cells for a room
_COARSEST_M = 0.25  # a corridor of 1.7 m is still one
_MOST_CELLS = 1_000_000  # 50 m x 50 m of 5 cm, 250 m x 250 m of the coarsest: each height tried takes 0.3 s
_MOST_PIECES = 2_000_000  # 800 m2 of faces at 5 cm: 2 s
_CLEARANCE_CELLS = 40  # the clearance in cells at most, since the map is searched that far around each
_RESOLVED_M = 1e-4  # coordinates that float64 does not hold this exactly are too far from the origin
_LEAST_AREA_M2 = 0.25  # of free space, half a metre square: less is no room for a path
_ROOF_M = 1.8  # of mesh above the lowest point of a cell make the cell indoors: more than furniture is high
_FLOOR_GAP_M = 0.3  # holes of up to twice this width in a scanned floor are counted as floor
_SWAY_M = 0.1  # amplitude of the slow change of height
BOB_M = 0.012
"""Amplitude of the height with each step, and of the position."""
HEAD_M = 0.2
"""Of a body above its camera."""
SIGHT_M = 6.0
"""How far openness is judged: about the length of a room."""

_NOTHING = "no hand-held path: the mesh has nothing within bounds_m; check its metres and axes"
_ELSE = "check its metres and axes, or give a trajectory file"


@dataclass(frozen=True, eq=False)
class Grid:
    """Cells over the ground; corner_m (2,) is the lower corner of the first, shape how many there are along x and y."""

    corner_m: Float64
    shape: tuple[int, int]
    cell_m: float

    def cells(self, xy_m: Float64) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(..., 2) metres -> indices into masks; outside the grid the nearest cell, which is never free."""
        index = np.floor((xy_m - self.corner_m) / self.cell_m).astype(np.int64)
        return tuple(np.moveaxis(np.clip(index, 0, np.array(self.shape) - 1), -1, 0))

    def centre_m(self, flat_cells: ArrayLike) -> Float64:
        """(...) indices into flattened masks -> (..., 2) metres."""
        return self.corner_m + (np.stack(np.divmod(flat_cells, self.shape[1]), axis=-1) + 0.5) * self.cell_m


@dataclass(frozen=True, eq=False)
class Room:
    """The room at the camera's height: masks over the cells of the grid."""

    grid: Grid
    occupied: Mask
    free: Mask  # the clearance is kept at every point of the cell
    plan: Mask  # one connected part of free, without the cells at its border
    height_m: float  # of the camera, world z
    sway_m: float


def find_room(
    mesh: Mesh,
    bounds: Float64,
    eyes_m: tuple[float, float],
    clearance_m: float,
    rng: np.random.Generator,
    *,
    step_m: float | None = None,
    wander_m: float = 0.0,
) -> Room:
    """Return the largest free space at one of the camera's heights. Raises NoisyWorldError where there is none.

    wander_m: how far the height changes, where that is more than a walk's own change and the camera's heights allow it.

    step_m: of a body that stands on the floor, which needs all free from this height above it up to its head; None:
    the clearance is kept below the camera and above it.
    """
    points_m, grid = columns(mesh, bounds[:, :2], clearance_m)
    corner_m, shape, cell_m = grid.corner_m, grid.shape, grid.cell_m
    cell = np.floor((points_m[:, :2] - corner_m) / cell_m).astype(np.int64) @ [shape[1], 1]
    centres_m = [corner_m[axis] + (np.arange(shape[axis]) + 0.5) * cell_m for axis in (0, 1)]
    shy_m = cell_m / 2.0 + BOB_M
    sides = [(c - shy_m >= bounds[0, axis]) & (c + shy_m <= bounds[1, axis]) for axis, c in enumerate(centres_m)]
    inside = sides[0][:, None] & sides[1]
    floor_m, indoors = floor_of(cell, points_m[:, 2], inside)
    low_m, high_m = max(floor_m + eyes_m[0], bounds[0, 2]), min(floor_m + eyes_m[1], bounds[1, 2])
    if low_m > high_m:
        raise NoisyWorldError(
            f"no hand-held path: the floor is at z = {floor_m:.2f} m and eye_height_m above it lies outside of bounds_m"
        )
    sway_m = min(max(_SWAY_M, wander_m), max((high_m - low_m) / 2.0 - BOB_M, 0.0))
    reach_m = sway_m + BOB_M + clearance_m
    largest_m2 = 0.0
    # A seeded height; the others are tried only where there is no room at it, under a low ceiling or among shelves.
    for share in (rng.uniform(), 0.0, 0.25, 0.5, 0.75, 1.0):
        height_m = low_m + sway_m + share * max(high_m - low_m - 2.0 * sway_m, 0.0)
        low_reach_m, high_reach_m = height_m - reach_m, height_m + reach_m
        if step_m is not None:
            low_reach_m, high_reach_m = floor_m + step_m, height_m + sway_m + BOB_M + HEAD_M
        below = points_m[:, 2] < low_reach_m
        beside = ~below & (points_m[:, 2] <= high_reach_m)
        occupied, known = (np.bincount(cell[s], minlength=indoors.size).reshape(shape) > 0 for s in (beside, below))
        known = _closed(known & indoors, cell_m)
        # Between cell centres: a cell's diagonal more covers both points' positions in their cells, then the bob.
        apart_m = clearance_m + np.sqrt(2.0) * cell_m + 2.0 * BOB_M
        free = (distance_m(occupied | ~known, apart_m, cell_m) >= apart_m) & inside
        plan = largest_part(distance_m(~free, 2.0 * cell_m, cell_m) > 1.5 * cell_m)
        largest_m2 = max(largest_m2, float(np.count_nonzero(plan)) * cell_m**2)
        if largest_m2 >= _LEAST_AREA_M2:
            return Room(grid, occupied, free, plan, float(height_m), sway_m)
    raise NoisyWorldError(
        f"no hand-held path: {clearance_m} m from everything, {eyes_m[0]} to {eyes_m[1]} m above the floor at "
        f"z = {floor_m:.2f} m, the largest free space is {largest_m2:.2f} m2",
        remedy=either(
            Message("lower ", PresetKey("clearance_m")), "change eye_height_m or bounds_m", "give a trajectory file"
        ),
    )


def columns(mesh: Mesh, bounds: Float64, clearance_m: float) -> tuple[Float64, Grid]:
    """Return the mesh's points in and around the bounds (2, 2), and their grid."""
    _check_resolution(mesh)
    sides = bounds + np.array([[-SIGHT_M], [SIGHT_M]])
    least_m = np.maximum(mesh.vertices_m[:, :2].min(axis=0, initial=np.inf), sides[0])
    most_m = np.minimum(mesh.vertices_m[:, :2].max(axis=0, initial=-np.inf), sides[1])
    if np.any(least_m > most_m):
        raise NoisyWorldError(_NOTHING)
    faces = faces_of(mesh, sides, _CELL_M)
    grid = _grid(least_m, most_m, clearance_m, faces)
    points_m = np.concatenate([mesh.vertices_m, faces.points_m(grid.cell_m)])
    return points_m[np.all((points_m[:, :2] >= sides[0]) & (points_m[:, :2] <= sides[1]), axis=1)], grid


def _check_resolution(mesh: Mesh) -> None:
    farthest_m = float(np.abs(mesh.vertices_m).max(initial=0.0))
    if not np.spacing(farthest_m) <= _RESOLVED_M:
        raise NoisyWorldError(
            f"no hand-held path: the mesh reaches {farthest_m:.3g} m from the origin, where numbers are too coarse for "
            f"one; {_ELSE}"
        )


def _grid(least_m: Float64, most_m: Float64, clearance_m: float, faces: SampledTriangles) -> Grid:
    """Return the finest grid that is neither too large nor cuts the faces into too many pieces."""
    cell_m = max(_CELL_M, clearance_m / _CLEARANCE_CELLS)
    while True:
        # Wide enough that no distance of interest reaches beyond the border, whose cells are never free.
        margin = int(np.ceil((clearance_m + _FLOOR_GAP_M) / cell_m)) + 4
        corner_m = (np.floor(least_m / cell_m) - margin) * cell_m
        columns, rows = (int(n) + margin for n in np.ceil((most_m - corner_m) / cell_m))
        pieces = faces.pieces(cell_m)
        if columns * rows <= _MOST_CELLS and pieces <= _MOST_PIECES:
            return Grid(corner_m, (columns, rows), cell_m)
        if cell_m >= _COARSEST_M:
            break
        cell_m = min(cell_m * 1.25, _COARSEST_M)
    if columns * rows > _MOST_CELLS:
        size = f"{columns * cell_m:.0f} x {rows * cell_m:.0f} m"
        raise NoisyWorldError(f"no hand-held path: the mesh spans {size}; give bounds_m around one room, {_ELSE}")
    size = f"{faces.areas_m2.sum():.3g} m2, up to {faces.lengths_m.max():.3g} m long"
    raise NoisyWorldError(f"no hand-held path: the mesh has faces of {size}: too large to look for a room; {_ELSE}")


def floor_of(cell: NDArray[np.int64], z_m: Float64, inside: Mask) -> tuple[float, Mask]:
    """Return the floor's height and the cells that may be in the room: those under a roof, or all where none is."""
    lowest_m = np.full(inside.size, np.inf)
    highest_m = np.full(inside.size, -np.inf)
    np.minimum.at(lowest_m, cell, z_m)
    np.maximum.at(highest_m, cell, z_m)
    seen = np.isfinite(lowest_m)
    indoors = seen & (highest_m - lowest_m > _ROOF_M)
    counts = [np.count_nonzero(mask & inside.ravel()) for mask in (seen, indoors)]
    if counts[0] == 0:
        raise NoisyWorldError(_NOTHING)
    # Walls alone are over a tenth of a room's cells; a quarter means a roof, as a garden may be larger than the house.
    if 4 * counts[1] < counts[0]:
        indoors = seen
    # The lowest wide level, to 10 cm: scans have stray points below the floor, and beds may be as wide as the floor.
    levels_m = np.sort(lowest_m[indoors & inside.ravel()])
    alike = np.searchsorted(levels_m, levels_m + 0.1, side="right") - np.arange(len(levels_m))
    first = int(np.argmax(2 * alike >= alike.max()))
    return float(np.median(levels_m[first : first + alike[first]])), indoors.reshape(inside.shape)


def _closed(mask: Mask, cell_m: float) -> Mask:
    widened = distance_m(mask, _FLOOR_GAP_M, cell_m) <= _FLOOR_GAP_M
    return distance_m(~widened, _FLOOR_GAP_M, cell_m) > _FLOOR_GAP_M


def distance_m(mask: Mask, limit_m: float, cell_m: float) -> Float64:
    """Distance of each cell's centre to the nearest one in the mask, exact up to the limit, large beyond it."""
    reach = int(np.ceil(limit_m / cell_m)) + 1
    far = 4 * reach
    along = np.where(mask, 0, far)
    for axis in (0, 1):
        padding = [(reach, reach) if axis == a else (0, 0) for a in (0, 1)]
        padded = np.pad(along**2 if axis == 0 else along, padding, constant_values=far**2)
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=axis)
        along = np.full(mask.shape, 2 * far**2)
        for shift in range(-reach, reach + 1):
            np.minimum(along, windows[..., shift + reach] + shift**2, out=along)
    return np.sqrt(along) * cell_m


def largest_part(mask: Mask) -> Mask:
    """Return the largest part of a mask whose cells are joined by their sides; the first one where two are as large.

    Steps along sides are the ones that a way can always take: cells that touch only by their corners are not joined.
    """
    heads = mask & ~np.pad(mask, ((0, 0), (1, 0)))[:, :-1]
    runs = np.cumsum(heads).reshape(mask.shape) - 1  # of each cell in the mask: the number of its run along y
    pairs = mask[:-1] & mask[1:]
    first, second = runs[:-1][pairs], runs[1:][pairs]
    part = np.arange(np.count_nonzero(heads))  # of each run: the smallest run that it is known to be joined with
    while True:
        ends = part[first], part[second]
        apart = ends[0] != ends[1]
        if not apart.any():
            break
        np.minimum.at(part, np.maximum(*ends)[apart], np.minimum(*ends)[apart])
        while not np.array_equal(part[part], part):
            part = part[part]
    labels = part[runs[mask]]
    found = np.zeros_like(mask)
    if len(labels):
        found[mask] = labels == np.argmax(np.bincount(labels))
    return found


# Whether a body has room along its path: what of the mesh comes nearer to it than its radius.


STEP_M = 0.02  # between the places that are looked at: a tenth of the smallest radius
AT_ONCE = 64  # places that are looked at together, among the points around them


@dataclass(frozen=True)
class Narrow:
    """Where a body has no room: at which second, at which place (x, y, z), and how near the mesh is."""

    time_s: float
    place_m: tuple[float, float, float]
    gap_m: float


def first_narrow(mesh: Mesh, path: Trajectory, body: CarryingBody) -> Narrow | None:
    """Return where a path first leaves a body less than its radius, None where it has room everywhere.

    A body that stands needs the floor free, from what it can step on to its head; another one what is around it.
    Points of the mesh are at most some 5 cm apart. Raises NoisyWorldError where the mesh is too large to be looked at.
    """
    times_s, places_m = _places(path)
    bounds = np.stack([places_m[:, :2].min(axis=0), places_m[:, :2].max(axis=0)])
    points_m, grid = columns(mesh, bounds, body.radius_m)
    low_m, high_m = places_m[:, 2] - body.radius_m, places_m[:, 2] + body.radius_m
    if body.stands:
        cell = np.ravel_multi_index(grid.cells(points_m[:, :2]), grid.shape)
        floor_m, _ = floor_of(cell, points_m[:, 2], np.ones(grid.shape, np.bool_))
        low_m, high_m = np.full_like(low_m, floor_m + body.step_m), places_m[:, 2] + HEAD_M
    beside_m = points_m[(points_m[:, 2] >= low_m.min()) & (points_m[:, 2] <= high_m.max())]
    occupied = np.zeros(grid.shape, np.bool_)
    occupied[grid.cells(beside_m[:, :2])] = True
    near_m = body.radius_m + 2.0 * grid.cell_m
    near = np.flatnonzero(distance_m(occupied, near_m, grid.cell_m)[grid.cells(places_m[:, :2])] < near_m)
    for first in range(0, len(near), AT_ONCE):
        rows = near[first : first + AT_ONCE]
        gaps_m = _gaps_m(places_m[rows], low_m[rows], high_m[rows], beside_m, near_m)
        if (narrow := np.flatnonzero(gaps_m < body.radius_m)).size:
            row = rows[narrow[0]]
            x, y, z = places_m[row].tolist()
            return Narrow(float(times_s[row]), (x, y, z), float(gaps_m[narrow[0]]))
    return None


def _places(path: Trajectory) -> tuple[Float64, Float64]:
    """Return times (N,) and places (N, 3) along a path, at most STEP_M apart."""
    at_s, place_m = path.stamps_s, path.c2w[:, :3, 3]
    gaps_m = np.linalg.norm(np.diff(place_m, axis=0), axis=1)
    counts = np.maximum(np.ceil(2.0 * gaps_m / STEP_M).astype(np.int64), 1)  # a curve is longer than its chords
    parts = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(at_s[:-1], at_s[1:], counts, strict=True)]
    times_s = np.concatenate([*parts, at_s[-1:]])
    return times_s, path.continuous.pose_at(times_s)[:, :3, 3]


def _gaps_m(places_m: Float64, low_m: Float64, high_m: Float64, points_m: Float64, near_m: float) -> Float64:
    """Return (N,): how far the nearest point between two heights is from each place, level.

    Points farther than near_m need not count; inf where there is none.
    """
    least_m, most_m = places_m[:, :2].min(axis=0) - near_m, places_m[:, :2].max(axis=0) + near_m
    points_m = points_m[np.all((points_m[:, :2] >= least_m) & (points_m[:, :2] <= most_m), axis=1)]
    found = np.full(len(places_m), np.inf)
    for row, place_m in enumerate(places_m):
        level = points_m[(points_m[:, 2] >= low_m[row]) & (points_m[:, 2] <= high_m[row]), :2]
        if len(level):
            found[row] = np.sqrt(np.min(np.sum(np.square(level - place_m[:2]), axis=1)))
    return found
