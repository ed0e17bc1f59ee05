# SPDX-License-Identifier: GPL-3.0-or-later
"""The free space of a room that is given only as a mesh: a map of cells, as seen from above. Gravity is -z.

A cell is blocked where the mesh has anything within the clearance of the camera's heights, and known where the mesh has
a floor or furniture below these. Cells are 5 cm wide; larger where the mesh or the clearance is so large that the map
would have too many of them, or the mesh too many pieces.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import NoisyWorldError
from ..messages import Message, PresetKey, either
from ..scenes.mesh import Mesh
from .mesh_points import SampledTriangles, faces_of

Float64: TypeAlias = NDArray[np.float64]
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
