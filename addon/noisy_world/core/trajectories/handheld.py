# SPDX-License-Identifier: GPL-3.0-or-later
"""A smooth, seeded, hand-held camera path inside a room that is given only as a mesh.

The room is divided, as seen from above, into cells of 5 cm. A cell is blocked where the mesh has anything within the
clearance of the camera's heights, and known where the mesh has a floor or furniture below these. The path joins points
that are far apart through free, known cells; in narrow passages it bends more tightly and goes slower. Gravity is -z.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import NoisyWorldError
from ..geometry import opencv_from_robot_c2w, pose, rotation_from_euler_deg
from ..scenes.mesh import Mesh
from ..streams import stream
from .trajectory import Trajectory, evenly_stamped

type Float64 = NDArray[np.float64]
type Mask = NDArray[np.bool_]

# Chosen, unless a comment says otherwise: what looks like a person walking through a furnished room.
_CELL_M = 0.05  # the map's resolution: fine enough for a gap between furniture, some 10^4 cells for a room
_MOST_CELLS = 4_000_000  # 100 m x 100 m, so that the map's memory stays small
_LEAST_AREA_M2 = 0.25  # of free space, half a metre square: less is no room for a path
_CHUNK = 100_000  # triangles cut at a time, so that memory stays flat
_ROOF_M = 1.8  # of mesh above the lowest point of a cell make the cell indoors: more than furniture is high
_FLOOR_GAP_M = 0.3  # holes of up to twice this width in a scanned floor are counted as floor
_SWAY_M = 0.1  # amplitude of the slow change of height
_BOB_M = 0.012  # amplitude of the height with each step
_TREMOR_DEG = 0.3  # amplitude of each rotation
_STEP_M = 0.01  # between the points along the path
_BENDS_M = (0.4, 0.2, 0.1, 0.05)  # sigmas of the path's smoothing, each half the one before; the last always fits
_START_S = 1.0  # from rest to walking speed

_LOOK_S = 2.5  # from one look-at point to the next
_TURN_DEG_S = 28.0  # of yaw at most: with tremor and pitch the camera stays below 40
_LOOK_SIGMA_S = 0.5  # smoothing of the yaw
_SIGHT_M = 6.0  # how far openness is judged: about the length of a room
_VOID_M = 0.1  # counted as open where the view leaves the mesh: less than before any wall

_NOTHING = "no hand-held path: the mesh has nothing within bounds_m; check its metres and axes"


@dataclass(frozen=True, eq=False)
class _Room:
    """The room at the camera's height: masks over cells; corner_m (2,) is the lower corner of the first cell."""

    corner_m: Float64
    occupied: Mask
    free: Mask  # the clearance is kept at every point of the cell
    plan: Mask  # one connected part of free, without the cells at its border
    height_m: float  # of the camera, world z
    sway_m: float

    def cells(self, xy_m: Float64) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(..., 2) metres -> indices into the masks; outside the grid the nearest cell, which is never free."""
        index = np.floor((xy_m - self.corner_m) / _CELL_M).astype(np.int64)
        return tuple(np.moveaxis(np.clip(index, 0, np.array(self.occupied.shape) - 1), -1, 0))

    def centre_m(self, flat_cells: ArrayLike) -> Float64:
        """(...) indices into the flattened masks -> (..., 2) metres."""
        return self.corner_m + (np.stack(np.divmod(flat_cells, self.plan.shape[1]), axis=-1) + 0.5) * _CELL_M


def handheld_path(
    mesh: Mesh,
    *,
    seed: int,
    frames: int,
    rate_hz: float = 20.0,
    bounds_m: ArrayLike | None = None,
    eye_height_m: tuple[float, float] = (1.2, 1.7),
    speed_m_s: float = 0.5,
    clearance_m: float = 0.45,
) -> Trajectory:
    """Return a path of `frames` frames through the largest free space of the mesh; equal seeds give equal paths.

    bounds_m: (2, 3) lowest and highest corner of the box that the camera stays in; by default the mesh alone decides.
    eye_height_m: lowest and highest height above the floor. clearance_m: least distance to every vertex, and to every
    face within 5 cm. speed_m_s: reached within a second, lower in bends. The camera turns by less than 40 degrees a
    second, looks toward open space and 8 degrees down (plus or minus 10), and rolls by less than 3 degrees.
    Raises NoisyWorldError where there is no such space, ValueError for numbers that make no sense.
    """
    low, high = eye_height_m
    if frames < 1 or not (rate_hz > 0.0 and speed_m_s > 0.0 and clearance_m >= 0.0 and 0.0 <= low <= high):
        raise ValueError("frames, rate and speed must be positive, clearance and eye heights not negative")
    bounds = np.array([[-np.inf] * 3, [np.inf] * 3]) if bounds_m is None else np.asarray(bounds_m, dtype=np.float64)
    if bounds.shape != (2, 3) or not np.all(bounds[0] < bounds[1]):
        raise ValueError(f"bounds_m is the lowest and the highest corner, (2, 3), not {bounds_m}")
    time_s = np.arange(frames) / rate_hz
    room = _find_room(mesh, bounds, (low, high), clearance_m, stream("handheld", "height", seed))
    xy_m = _walk(room, stream("handheld", "walk", seed), speed_m_s, time_s)
    yaw_deg = _look_around(room, stream("handheld", "look", seed), xy_m, time_s)
    rng = stream("handheld", "sway", seed)
    bob_m = _BOB_M * np.stack([_waves(rng, time_s, 0.2, 2.0) for _ in range(3)], axis=-1)
    height_m = room.height_m + room.sway_m * _waves(rng, time_s, 0.03, 0.1)
    position_m = np.column_stack([xy_m, height_m]) + bob_m
    tremor_deg = _TREMOR_DEG * np.stack([_waves(rng, time_s, 0.2, 2.0) for _ in range(3)])
    pitch_deg = -8.0 + 9.0 * _waves(rng, time_s, 0.03, 0.08) + tremor_deg[0]
    roll_deg = 1.5 * _waves(rng, time_s, 0.05, 0.15) + tremor_deg[1]
    facing = rotation_from_euler_deg(roll_deg, -pitch_deg, yaw_deg + tremor_deg[2])
    return evenly_stamped(opencv_from_robot_c2w(pose(facing, position_m)), rate_hz)


def _waves(rng: np.random.Generator, time_s: Float64, low_hz: float, high_hz: float) -> Float64:
    """(N,) in [-1, 1]: a sum of a few sine waves; faster ones have smaller amplitudes, so that none of them jerks."""
    hz = rng.uniform(low_hz, high_hz, 4)
    phase = rng.uniform(0.0, 2.0 * np.pi, 4)
    return np.sin(2.0 * np.pi * np.outer(time_s, hz) + phase) @ (1.0 / hz) / np.sum(1.0 / hz)


def _find_room(
    mesh: Mesh, bounds: Float64, eyes_m: tuple[float, float], clearance_m: float, rng: np.random.Generator
) -> _Room:
    points_m, corner_m, shape = _columns(mesh, bounds[:, :2], clearance_m)
    cell = np.floor((points_m[:, :2] - corner_m) / _CELL_M).astype(np.int64) @ [shape[1], 1]
    centres_m = [corner_m[axis] + (np.arange(shape[axis]) + 0.5) * _CELL_M for axis in (0, 1)]
    shy_m = _CELL_M / 2.0 + _BOB_M
    sides = [(c - shy_m >= bounds[0, axis]) & (c + shy_m <= bounds[1, axis]) for axis, c in enumerate(centres_m)]
    inside = sides[0][:, None] & sides[1]
    floor_m, indoors = _floor(cell, points_m[:, 2], inside)
    low_m, high_m = max(floor_m + eyes_m[0], bounds[0, 2]), min(floor_m + eyes_m[1], bounds[1, 2])
    if low_m > high_m:
        raise NoisyWorldError(
            f"no hand-held path: the floor is at z = {floor_m:.2f} m and eye_height_m above it lies outside of bounds_m"
        )
    sway_m = min(_SWAY_M, max((high_m - low_m) / 2.0 - _BOB_M, 0.0))
    reach_m = sway_m + _BOB_M + clearance_m
    largest_m2 = 0.0
    # A seeded height; the others are tried only where there is no room at it, under a low ceiling or among shelves.
    for share in (rng.uniform(), 0.0, 0.25, 0.5, 0.75, 1.0):
        height_m = low_m + sway_m + share * max(high_m - low_m - 2.0 * sway_m, 0.0)
        below = points_m[:, 2] < height_m - reach_m
        beside = ~below & (points_m[:, 2] <= height_m + reach_m)
        occupied, known = (np.bincount(cell[s], minlength=indoors.size).reshape(shape) > 0 for s in (beside, below))
        known = _closed(known & indoors)
        # Between cell centres: a cell's diagonal more covers both points' positions in their cells, then the bob.
        apart_m = clearance_m + np.sqrt(2.0) * _CELL_M + 2.0 * _BOB_M
        free = (_distance_m(occupied | ~known, apart_m) >= apart_m) & inside
        plan = _largest_part(_distance_m(~free, 2.0 * _CELL_M) > 1.5 * _CELL_M)
        largest_m2 = max(largest_m2, float(np.count_nonzero(plan)) * _CELL_M**2)
        if largest_m2 >= _LEAST_AREA_M2:
            return _Room(corner_m, occupied, free, plan, float(height_m), sway_m)
    raise NoisyWorldError(
        f"no hand-held path: {clearance_m} m from everything, {eyes_m[0]} to {eyes_m[1]} m above the floor at "
        f"z = {floor_m:.2f} m, the largest free space is {largest_m2:.2f} m2; lower clearance_m, change "
        "eye_height_m or bounds_m, or give a trajectory file"
    )


def _columns(mesh: Mesh, bounds: Float64, clearance_m: float) -> tuple[Float64, Float64, tuple[int, int]]:
    """Return the mesh's points in and around the bounds (2, 2), and the lower corner and the shape of their grid."""
    sides = bounds + np.array([[-_SIGHT_M], [_SIGHT_M]])
    least_m = np.maximum(mesh.vertices_m[:, :2].min(axis=0, initial=np.inf), sides[0])
    most_m = np.minimum(mesh.vertices_m[:, :2].max(axis=0, initial=-np.inf), sides[1])
    if np.any(least_m > most_m):
        raise NoisyWorldError(_NOTHING)
    # Wide enough that no distance of interest reaches beyond the border, whose cells are never free.
    margin = int(np.ceil((clearance_m + _FLOOR_GAP_M) / _CELL_M)) + 4
    corner_m = (np.floor(least_m / _CELL_M) - margin) * _CELL_M
    columns, rows = (int(n) + margin for n in np.ceil((most_m - corner_m) / _CELL_M))
    if columns * rows > _MOST_CELLS:
        size = f"{columns * _CELL_M:.0f} x {rows * _CELL_M:.0f} m"
        raise NoisyWorldError(f"no hand-held path: the mesh spans {size}; give bounds_m around one room")
    return _points(mesh, sides), corner_m, (columns, rows)


def _floor(cell: NDArray[np.int64], z_m: Float64, inside: Mask) -> tuple[float, Mask]:
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


def _closed(mask: Mask) -> Mask:
    widened = _distance_m(mask, _FLOOR_GAP_M) <= _FLOOR_GAP_M
    return _distance_m(~widened, _FLOOR_GAP_M) > _FLOOR_GAP_M


def _points(mesh: Mesh, sides: Float64) -> Float64:
    """(P, 3) metres: the vertices within the sides (2, 2), and points a cell apart at most on larger faces."""
    sizes = mesh.face_sizes
    large = np.zeros(len(sizes), dtype=bool)
    for axis in range(3 if len(sizes) else 0):
        along = mesh.vertices_m[mesh.corner_vertices, axis]
        large |= np.maximum.reduceat(along, mesh.face_starts) - np.minimum.reduceat(along, mesh.face_starts) > _CELL_M
    starts, sizes = mesh.face_starts[large].astype(np.int64), sizes[large].astype(np.int64)
    fans = np.maximum(sizes - 2, 0)
    second = np.arange(fans.sum()) - np.repeat(np.cumsum(fans) - fans, fans) + np.repeat(starts, fans) + 1
    corners = mesh.corner_vertices[np.column_stack([np.repeat(starts, fans), second, second + 1])]
    points_m = np.concatenate([mesh.vertices_m, *_pieces(mesh.vertices_m[corners], sides)])
    return points_m[np.all((points_m[:, :2] >= sides[0]) & (points_m[:, :2] <= sides[1]), axis=1)]


def _pieces(triangles_m: Float64, sides: Float64) -> list[Float64]:
    """(T, 3, 3) -> centroids of pieces no longer than a cell; cutting the longest edge keeps slivers few."""
    centroids = []
    rest = [np.ascontiguousarray(np.moveaxis(triangles_m, 0, -1))]  # corner, axis, triangle: sums over corners are fast
    while rest:
        part = rest.pop()
        if part.shape[-1] > _CHUNK:
            rest += [part[..., :_CHUNK], part[..., _CHUNK:]]
            continue
        flat = part[:, :2]
        near = (flat.max(axis=0) >= sides[0][:, None]) & (flat.min(axis=0) <= sides[1][:, None])
        part = part[..., near.all(axis=0)]
        squares_m2 = np.sum((np.roll(part, -1, axis=0) - part) ** 2, axis=1)
        small = np.all(squares_m2 <= _CELL_M**2, axis=0)
        centroids.append(part[..., small].mean(axis=0).T)
        if small.all():
            continue
        order = (np.argmax(squares_m2[:, ~small], axis=0) + np.arange(3)[:, None]) % 3
        a, b, c = np.take_along_axis(part[..., ~small], order[:, None], axis=0)
        middle = (a + b) / 2.0
        rest.append(np.concatenate([np.stack([a, middle, c]), np.stack([middle, b, c])], axis=-1))
    return centroids


def _distance_m(mask: Mask, limit_m: float) -> Float64:
    """Distance of each cell's centre to the nearest one in the mask, exact up to the limit, large beyond it."""
    reach = int(np.ceil(limit_m / _CELL_M)) + 1
    far = 4 * reach
    along = np.where(mask, 0, far)
    for axis in (0, 1):
        padding = [(reach, reach) if axis == a else (0, 0) for a in (0, 1)]
        padded = np.pad(along**2 if axis == 0 else along, padding, constant_values=far**2)
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=axis)
        along = np.full(mask.shape, 2 * far**2)
        for shift in range(-reach, reach + 1):
            np.minimum(along, windows[..., shift + reach] + shift**2, out=along)
    return np.sqrt(along) * _CELL_M


def _largest_part(mask: Mask) -> Mask:
    best = np.zeros_like(mask)
    rest = mask.copy()
    while np.count_nonzero(rest) > np.count_nonzero(best):
        part = _steps_from(rest, int(np.argmax(rest))) >= 0
        rest &= ~part
        if np.count_nonzero(part) > np.count_nonzero(best):
            best = part
    return best


def _steps_from(mask: Mask, start: int, goal: int = -1) -> NDArray[np.int64]:
    """Steps from the flat cell `start` within the mask, -1 where no way leads; stops early when it reaches the goal.

    Only every other step may be diagonal, so that cells of equal steps form an octagon, which is nearly a circle.
    """
    width = mask.shape[1]
    straight = np.array([-width, -1, 1, width])
    around = np.array([-width - 1, -width, -width + 1, -1, 1, width - 1, width, width + 1])
    steps = np.where(mask, -1, -2).ravel()  # -2: blocked; the border always is, so no index runs over
    steps[start] = 0
    front = np.array([start])
    count = 0
    while len(front) and (goal < 0 or steps[goal] < 0):
        count += 1
        reached = (front[:, None] + (around if count % 2 else straight)).ravel()
        front = np.unique(reached[steps[reached] == -1])
        steps[front] = count
    return np.where(steps < 0, -1, steps).reshape(mask.shape)


def _route(mask: Mask, start: int, goal: int) -> list[int]:
    """Flat cells from start to goal, corners only: the straight line from each to the next stays in the mask."""
    width = mask.shape[1]
    around = np.array([-width, -1, 1, width, -width - 1, -width + 1, width - 1, width + 1])
    steps = _steps_from(mask, start, goal).ravel()
    cells = [goal]
    while cells[-1] != start:
        near = cells[-1] + around
        cells.append(int(near[np.argmax(steps[near] == steps[cells[-1]] - 1)]))
    cells.reverse()
    corners = [0]
    while corners[-1] < len(cells) - 1:
        ahead = len(cells) - 1
        while ahead > corners[-1] + 1 and not _sees(mask, cells[corners[-1]], cells[ahead]):
            ahead -= 1
        corners.append(ahead)
    return [cells[i] for i in corners]


def _sees(mask: Mask, first: int, second: int) -> bool:
    a, b = (np.array(divmod(cell, mask.shape[1])) + 0.5 for cell in (first, second))
    share = np.linspace(0.0, 1.0, int(np.ceil(np.linalg.norm(b - a) * _CELL_M / _STEP_M)) + 1)[:, None]
    x, y = np.floor(a + share * (b - a)).astype(np.int64).T
    return bool(mask[x, y].all())


def _walk(room: _Room, rng: np.random.Generator, speed_m_s: float, time_s: Float64) -> Float64:
    """(N, 2) metres at the given times, from rest."""
    cells = np.flatnonzero(room.plan)
    visited = [int(rng.choice(cells))]
    corners = visited.copy()
    corners_m = room.centre_m(corners)
    length_m, wanted_m = 0.0, speed_m_s * time_s[-1] + 2.0
    # The speed rises as the smooth step 3 u^2 - 2 u^3; this is its integral.
    u = np.clip(time_s / _START_S, 0.0, 1.0)
    walked_s = _START_S * (u**3 - u**4 / 2.0) + np.maximum(time_s - _START_S, 0.0)
    while True:
        while length_m < wanted_m:
            # Of 16 random cells the farthest from the last 4: the path crosses the room and returns by another way.
            offered = rng.choice(cells, 16)
            gaps_m = room.centre_m(offered)[:, None] - room.centre_m(visited[-4:])
            best = int(np.argmax(np.linalg.norm(gaps_m, axis=-1).min(axis=1)))
            visited.append(int(offered[best]))
            corners += _route(room.plan, visited[-2], visited[-1])[1:]
            corners_m = room.centre_m(corners)
            length_m = float(np.linalg.norm(np.diff(corners_m, axis=0), axis=1).sum())
        path_m, tightness = _smoothed(room, corners_m)
        # A bend of half the radius has the same sideways acceleration, v^2 / r, at a speed lower by the root of two.
        at_s = np.concatenate([[0.0], np.cumsum(_STEP_M / speed_m_s * 2.0 ** (tightness[1:] / 2.0))])
        if at_s[-1] >= walked_s[-1]:
            return np.stack([np.interp(walked_s, at_s, path_m[:, axis]) for axis in (0, 1)], axis=-1)
        wanted_m *= 1.5


def _smoothed(room: _Room, corners_m: Float64) -> tuple[Float64, Float64]:
    """(C, 2) -> (S, 2) metres at each centimetre of the given path, and (S,) the position in _BENDS_M used, 0 to 3.

    A Gaussian of sigma s moves a point by at most its mean absolute value, 0.8 s. So with the narrowest one the path
    stays within a cell of the planned one, hence free, and the loop ends.
    """
    at_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners_m, axis=0), axis=1))])
    dense_m = np.arange(0.0, at_m[-1], _STEP_M)
    straight_m = np.stack([np.interp(dense_m, at_m, corners_m[:, axis]) for axis in (0, 1)], axis=-1)
    bends = np.array([_blurred(straight_m, width_m / _STEP_M) for width_m in _BENDS_M])
    level = np.zeros(len(straight_m))
    reach = int(3.0 * 0.2 / _STEP_M)
    while True:
        # Raised within the whole reach of the blur below, so that the blurred level is not lower where it must be high.
        raised = np.lib.stride_tricks.sliding_window_view(np.pad(level, reach, mode="edge"), 2 * reach + 1).max(axis=1)
        tightness = np.clip(_blurred(raised[:, None], 0.2 / _STEP_M)[:, 0], 0.0, len(_BENDS_M) - 1.0)
        wider = np.minimum(tightness.astype(np.int64), len(_BENDS_M) - 2)
        share = (tightness - wider)[:, None]
        share = share * share * (3.0 - 2.0 * share)
        rows = np.arange(len(level))
        path_m = (1.0 - share) * bends[wider, rows] + share * bends[wider + 1, rows]
        blocked = ~room.free[room.cells(path_m)]
        if not blocked.any():
            return path_m, tightness
        level[blocked] += 1.0


def _blurred(rows: Float64, sigma: float) -> Float64:
    """(N, C): each column blurred with a Gaussian of sigma rows, cut at 3 sigma; the ends are repeated."""
    reach = int(3.0 * sigma)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    padded = np.pad(rows, ((reach, reach), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, kernel, mode="valid") for column in padded.T], axis=-1)


def _look_around(room: _Room, rng: np.random.Generator, xy_m: Float64, time_s: Float64) -> Float64:
    """(N,) degrees of yaw in the world: every few seconds toward open space, preferably where it has not looked yet."""
    bearings_deg = np.arange(0.0, 360.0, 5.0)
    sectors = (bearings_deg // 30.0).astype(np.int64)
    looked = np.zeros(12)
    keys_s = np.arange(0.0, time_s[-1] + 2.0 * _LOOK_S, _LOOK_S)
    yaw_deg: list[float] = []
    for now_s in keys_s:
        here_m = np.array([np.interp(now_s, time_s, xy_m[:, axis]) for axis in (0, 1)])
        worth = _open_m(room, here_m, bearings_deg) * rng.uniform(1.0, 1.5, len(bearings_deg)) / (1.0 + looked[sectors])
        turn_deg = np.zeros(len(bearings_deg))
        if yaw_deg:
            turn_deg = np.mod(bearings_deg - yaw_deg[-1] + 180.0, 360.0) - 180.0
            worth[np.abs(turn_deg) > _TURN_DEG_S * _LOOK_S] = -1.0
        best = int(np.argmax(worth))
        looked[sectors[best]] += 1.0
        yaw_deg.append(yaw_deg[-1] + float(turn_deg[best]) if yaw_deg else float(bearings_deg[best]))
    fine_s = np.arange(0.0, keys_s[-1], 0.01)
    smooth_deg = _blurred(np.interp(fine_s, keys_s, yaw_deg)[:, None], _LOOK_SIGMA_S / 0.01)[:, 0]
    return np.interp(time_s, fine_s, smooth_deg)


def _open_m(room: _Room, here_m: Float64, bearings_deg: Float64) -> Float64:
    """(B,) metres to what blocks the view, averaged over 60 degrees about each bearing; _VOID_M where nothing does."""
    angle = np.deg2rad(bearings_deg)
    reach_m = np.arange(_CELL_M, _SIGHT_M, _CELL_M)
    ways_m = here_m + reach_m[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, None]
    met = room.occupied[room.cells(ways_m)]
    first_m = np.where(met.any(axis=1), reach_m[np.argmax(met, axis=1)], _VOID_M)
    return np.mean([np.roll(first_m, shift) for shift in range(-6, 7)], axis=0)
