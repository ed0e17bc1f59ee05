# SPDX-License-Identifier: GPL-3.0-or-later
"""A smooth, seeded, hand-held camera path inside a room that is given only as a mesh.

The path joins points that are far apart through free cells of the room's map; in narrow passages it bends more tightly
and goes slower. Gravity is -z.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from ..core.errors import Message, NoisyWorldError, PresetKey
from ..core.geometry import opencv_from_robot_c2w, pose, rotation_from_euler_deg
from ..core.streams import stream
from ..core.trajectory import Trajectory, evenly_stamped
from ..scenes.polygon_mesh import Mesh
from .bodies import blurred
from .room_map import BOB_M, SIGHT_M, Float64, Grid, Mask, Room, distance_m, find_room

# Smooth paths through the free cells of a room, from one far point to another, slower in bends.


_STEP_M = 0.01  # between the points along the path
_BENDS_M = (0.4, 0.2, 0.1, 0.05)  # sigmas of the path's smoothing, each half the one before; the last always fits
_START_S = 1.0  # from rest to walking speed
_AHEAD = 200  # cells, 10 m: how far ahead a way is made straight, so that a maze does not take minutes

_LOOK_S = 2.5  # from one look-at point to the next
_TURN_DEG_S = 28.0  # of yaw at most: with tremor and pitch the camera stays below 40
_LOOK_SIGMA_S = 0.5  # smoothing of the yaw
_RETURN_S = 20.0  # what was passed or seen so long before is come back to
_NEAR_M = 0.4  # of an earlier place: there the camera looks where it looked then
_EAGER_S = (0.0, 2.5, 5.0)  # how far ahead such a place is looked for, so that the camera has turned when it is there
_VOID_M = 0.1  # counted as open where the view leaves the mesh: less than before any wall


def walk(room: Room, rng: np.random.Generator, speed_m_s: float, time_s: Float64, *, revisit: bool = False) -> Float64:
    """(N, 2) metres at the given times, from rest.

    revisit: after every second new place, an earlier stretch of the way is walked again.
    """
    cells = np.flatnonzero(room.plan)
    visited = [int(rng.choice(cells))]
    walked_again: list[int] = []  # where in `visited` each stretch begins that was walked before
    corners = visited.copy()
    length_m, wanted_m = 0.0, speed_m_s * time_s[-1] + 2.0
    # The speed rises as the smooth step 3 u^2 - 2 u^3; this is its integral.
    u = np.clip(time_s / _START_S, 0.0, 1.0)
    walked_s = _START_S * (u**3 - u**4 / 2.0) + np.maximum(time_s - _START_S, 0.0)
    while True:
        while length_m < wanted_m:
            if revisit and (again := _stretch_again(room, rng, visited, walked_again, speed_m_s)):
                walked_again.append(len(visited))
                targets = again
            else:
                targets = [_new_place(room, rng, visited)]
            for target in targets:
                visited.append(target)
                way = _route(room.grid, room.plan, visited[-2], visited[-1])
                corners += way[1:]
                length_m += float(np.linalg.norm(np.diff(room.grid.centre_m(way), axis=0), axis=1).sum())
        corners_m = room.grid.centre_m(corners)
        path_m, tightness = _smoothed(room, corners_m)
        # A bend of half the radius has the same sideways acceleration, v^2 / r, at a speed lower by the root of two.
        at_s = np.concatenate([[0.0], np.cumsum(_STEP_M / speed_m_s * 2.0 ** (tightness[1:] / 2.0))])
        if at_s[-1] >= walked_s[-1]:
            return np.stack([np.interp(walked_s, at_s, path_m[:, axis]) for axis in (0, 1)], axis=-1)
        wanted_m *= 1.5


def _new_place(room: Room, rng: np.random.Generator, visited: list[int]) -> int:
    """Of 16 random cells the farthest from the last 4: the path crosses the room and returns by another way."""
    offered = rng.choice(np.flatnonzero(room.plan), 16)
    gaps_m = room.grid.centre_m(offered)[:, None] - room.grid.centre_m(visited[-4:])
    return int(offered[int(np.argmax(np.linalg.norm(gaps_m, axis=-1).min(axis=1)))])


def _stretch_again(
    room: Room, rng: np.random.Generator, visited: list[int], walked_again: list[int], speed_m_s: float
) -> list[int]:
    """Return both ends of an earlier stretch of the way; nothing where it is not time for one, or none is long past.

    walked_again: where in `visited` stretches begin that were such ones.
    """
    if len(visited) - (walked_again[-1] + 2 if walked_again else 0) < 2:
        return []
    gaps_m = np.linalg.norm(np.diff(room.grid.centre_m(visited), axis=0), axis=1)
    # Between two places the way is at least the straight line.
    past = np.cumsum(gaps_m[::-1])[::-1] - gaps_m > _RETURN_S * speed_m_s
    first = [k for k in np.flatnonzero(past).tolist() if k not in walked_again]
    if not first:
        return []
    chosen = int(rng.choice(first))
    return visited[chosen : chosen + 2]


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


def _route(grid: Grid, mask: Mask, start: int, goal: int) -> list[int]:
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
        ahead = min(len(cells) - 1, corners[-1] + _AHEAD)
        while ahead > corners[-1] + 1 and not _sees(grid, mask, cells[corners[-1]], cells[ahead]):
            ahead -= 1
        corners.append(ahead)
    return [cells[i] for i in corners]


def _sees(grid: Grid, mask: Mask, first: int, second: int) -> bool:
    a, b = (np.array(divmod(cell, mask.shape[1])) + 0.5 for cell in (first, second))
    share = np.linspace(0.0, 1.0, int(np.ceil(np.linalg.norm(b - a) * grid.cell_m / _STEP_M)) + 1)[:, None]
    x, y = np.floor(a + share * (b - a)).astype(np.int64).T
    return bool(mask[x, y].all())


def _smoothed(room: Room, corners_m: Float64) -> tuple[Float64, Float64]:
    """(C, 2) -> (S, 2) metres at each centimetre of the given path, and (S,) the position in _BENDS_M used, 0 to 3.

    A Gaussian of sigma s moves a point by at most its mean absolute value, 0.8 s. So with the narrowest one the path
    stays within a cell of the planned one, hence free, and the loop ends.
    """
    at_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners_m, axis=0), axis=1))])
    dense_m = np.arange(0.0, at_m[-1], _STEP_M)
    straight_m = np.stack([np.interp(dense_m, at_m, corners_m[:, axis]) for axis in (0, 1)], axis=-1)
    bends = np.array([blurred(straight_m, width_m / _STEP_M) for width_m in _BENDS_M])
    level = np.zeros(len(straight_m))
    reach = int(3.0 * 0.2 / _STEP_M)
    while True:
        # Raised within the whole reach of the blur below, so that the blurred level is not lower where it must be high.
        raised = np.lib.stride_tricks.sliding_window_view(np.pad(level, reach, mode="edge"), 2 * reach + 1).max(axis=1)
        tightness = np.clip(blurred(raised[:, None], 0.2 / _STEP_M)[:, 0], 0.0, len(_BENDS_M) - 1.0)
        wider = np.minimum(tightness.astype(np.int64), len(_BENDS_M) - 2)
        share = (tightness - wider)[:, None]
        share = share * share * (3.0 - 2.0 * share)
        rows = np.arange(len(level))
        path_m = (1.0 - share) * bends[wider, rows] + share * bends[wider + 1, rows]
        blocked = ~room.free[room.grid.cells(path_m)]
        if not blocked.any():
            return path_m, tightness
        level[blocked] += 1.0


def look_around(
    room: Room, rng: np.random.Generator, xy_m: Float64, time_s: Float64, *, revisit: bool = False
) -> Float64:
    """(N,) degrees of yaw in the world: every few seconds toward open space, preferably where it has not looked yet.

    revisit: where the path comes back to a place, the camera looks where it looked there before.
    """
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
        if revisit and (seen_deg := _seen_before(xy_m, time_s, now_s, yaw_deg)) is not None:
            away_deg = np.abs(np.mod(bearings_deg - seen_deg + 180.0, 360.0) - 180.0)
            worth = np.where(worth < 0.0, -1.0, 360.0 - away_deg)
        best = int(np.argmax(worth))
        looked[sectors[best]] += 1.0
        yaw_deg.append(yaw_deg[-1] + float(turn_deg[best]) if yaw_deg else float(bearings_deg[best]))
    fine_s = np.arange(0.0, keys_s[-1], 0.01)
    smooth_deg = blurred(np.interp(fine_s, keys_s, yaw_deg)[:, None], _LOOK_SIGMA_S / 0.01)[:, 0]
    return np.interp(time_s, fine_s, smooth_deg)


def _seen_before(xy_m: Float64, time_s: Float64, now_s: float, yaw_deg: list[float]) -> float | None:
    """Return where the camera looked when it was here long before, or where it soon will be; None where it never was.

    yaw_deg: at each key so far.
    """
    keys_s = np.arange(len(yaw_deg)) * _LOOK_S
    past = time_s < min(now_s - _RETURN_S, keys_s[-1] if len(keys_s) else 0.0)
    if not past.any():
        return None
    for ahead_s in _EAGER_S:
        there_m = np.array([np.interp(now_s + ahead_s, time_s, xy_m[:, axis]) for axis in (0, 1)])
        apart_m = np.linalg.norm(xy_m[past] - there_m, axis=1)
        nearest = int(np.argmin(apart_m))
        if apart_m[nearest] < _NEAR_M:
            return float(np.interp(time_s[nearest], keys_s, yaw_deg))
    return None


def _open_m(room: Room, here_m: Float64, bearings_deg: Float64) -> Float64:
    """(B,) metres to what blocks the view, averaged over 60 degrees about each bearing; _VOID_M where nothing does."""
    angle = np.deg2rad(bearings_deg)
    reach_m = np.arange(room.grid.cell_m, SIGHT_M, room.grid.cell_m)
    ways_m = here_m + reach_m[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, None]
    met = room.occupied[room.grid.cells(ways_m)]
    first_m = np.where(met.any(axis=1), reach_m[np.argmax(met, axis=1)], _VOID_M)
    return np.mean([np.roll(first_m, shift) for shift in range(-6, 7)], axis=0)


_DOWN_DEG = -8.0  # how far the camera looks up
_TREMOR_DEG = 0.3  # amplitude of each rotation
# Of the hand that strays, x, y and z: to and fro within ten seconds, and no axis in step with another.
_WANDER_HZ = ((0.1, 0.13), (0.14, 0.18), (0.22, 0.28))
_WANDER_SHARES, _OVERTONE = (0.75, 0.25), 1.9
_EASED_S = 1.0  # within which the straying hand comes back where it gets narrow
# Of one path: a day and a night, and what is walked in it. Both bound the memory, to less than a gigabyte.
_LONGEST_S = 100_000.0
_FARTHEST_M = 50_000.0


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
    revisit: bool = False,
    steady: bool = False,
    step_m: float | None = None,
    wander_m: float = 0.0,
) -> Trajectory:
    """Return a path of `frames` frames through the largest free space of the mesh; equal seeds give equal paths.

    bounds_m: (2, 3) lowest and highest corner of the box that the camera stays in; by default the mesh alone decides.
    eye_height_m: lowest and highest height above the floor. clearance_m: least distance to every vertex, and to every
    face within 5 cm. speed_m_s: reached within a second, lower in bends. The camera turns by less than 40 degrees a
    second, looks toward open space and 8 degrees down (plus or minus 10), and rolls by less than 3 degrees. revisit:
    earlier stretches are walked again, looking where the camera looked then. steady: without what a hand and steps add,
    as the route of a body. step_m: see `find_room`. wander_m: how far the hand strays from the walk along each axis,
    within seconds, so that the path has extent in three of them: less where the clearance would not be kept, and
    vertically within the eye heights; 0 for none.
    Raises NoisyWorldError where there is no such space or the walk is too long, ValueError for numbers without sense.
    """
    low, high = eye_height_m
    if frames < 1 or not (rate_hz > 0.0 and speed_m_s > 0.0 and min(clearance_m, wander_m, low) >= 0.0 and low <= high):
        raise ValueError("frames, rate and speed must be positive, clearance, eye heights and wander not negative")
    bounds = np.array([[-np.inf] * 3, [np.inf] * 3]) if bounds_m is None else np.asarray(bounds_m, dtype=np.float64)
    if bounds.shape != (2, 3) or not np.all(bounds[0] < bounds[1]):
        raise ValueError(f"bounds_m is the lowest and the highest corner, (2, 3), not {bounds_m}")
    if problem := walk_problem(frames, rate_hz, speed_m_s):
        raise NoisyWorldError(f"no hand-held path: {problem}")
    time_s = np.arange(frames) / rate_hz
    heights = stream("handheld", "height", seed)
    room = find_room(mesh, bounds, (low, high), clearance_m, heights, step_m=step_m, wander_m=wander_m)
    xy_m = walk(room, stream("handheld", "walk", seed), speed_m_s, time_s, revisit=revisit)
    yaw_deg = look_around(room, stream("handheld", "look", seed), xy_m, time_s, revisit=revisit)
    if steady:
        place_m = np.column_stack([xy_m, np.full(frames, room.height_m)])
        facing = rotation_from_euler_deg(np.zeros(frames), np.full(frames, -_DOWN_DEG), yaw_deg)
        return evenly_stamped(opencv_from_robot_c2w(pose(facing, place_m)), rate_hz)
    rng = stream("handheld", "sway", seed)
    bob_m = BOB_M * np.stack([_waves(rng, time_s, 0.2, 2.0) for _ in range(3)], axis=-1)
    height_m = room.height_m + room.sway_m * _waves(rng, time_s, 0.03, 0.1)
    if wander_m > 0.0:
        strayed = stream("handheld", "wander", seed)
        xy_m = xy_m + _strayed_m(room, strayed, xy_m, time_s, wander_m)
        height_m = room.height_m + max(room.sway_m - BOB_M, 0.0) * _wander(strayed, time_s, 2)
    position_m = np.column_stack([xy_m, height_m]) + bob_m
    tremor_deg = _TREMOR_DEG * np.stack([_waves(rng, time_s, 0.2, 2.0) for _ in range(3)])
    pitch_deg = _DOWN_DEG + 9.0 * _waves(rng, time_s, 0.03, 0.08) + tremor_deg[0]
    roll_deg = 1.5 * _waves(rng, time_s, 0.05, 0.15) + tremor_deg[1]
    facing = rotation_from_euler_deg(roll_deg, -pitch_deg, yaw_deg + tremor_deg[2])
    return evenly_stamped(opencv_from_robot_c2w(pose(facing, position_m)), rate_hz)


def walk_problem(frames: int, rate_hz: float, speed_m_s: float) -> str:
    """Return why a walk is too long to be made, or "" where it is not."""
    # In two steps: a tiny rate would overflow.
    if frames > _LONGEST_S * rate_hz:
        message = f"{frames:,} frames at {rate_hz:g} Hz are more than {_LONGEST_S:,.0f} s; lower "
        return Message(message, PresetKey("handheld.frames"), " or raise ", PresetKey("rate_hz"))
    walked_m = frames / rate_hz * speed_m_s
    if walked_m > _FARTHEST_M:
        message = f"the walk would be {walked_m / 1e3:.0f} km long, more than {_FARTHEST_M / 1e3:.0f}; lower "
        return Message(message, PresetKey("handheld.frames"), " or ", PresetKey("speed_m_s"))
    return ""


def _strayed_m(room: Room, rng: np.random.Generator, xy_m: Float64, time_s: Float64, wander_m: float) -> Float64:
    """(N, 2) -> (N, 2) metres beside the walk, never farther than free cells reach."""
    cell_m = room.grid.cell_m
    farthest_m = np.sqrt(2.0) * wander_m
    apart_m = distance_m(~room.free, farthest_m + 2.0 * cell_m, cell_m)[room.grid.cells(xy_m)]
    # From cell centre to cell centre: half a cell's diagonal on either side, and the places in their cells.
    allowed_m = np.clip(apart_m - 2.0 * cell_m, 0.0, farthest_m)
    # Least within a time that the smoothing does not reach beyond: so what is smoothed is never more than is allowed.
    gap_s = float(time_s[1] - time_s[0]) if len(time_s) > 1 else 1.0
    reach = int(np.ceil(_EASED_S / gap_s))
    least_m = sliding_window_view(np.pad(allowed_m, reach, mode="edge"), 2 * reach + 1).min(axis=1)
    kernel = np.hanning(2 * reach + 1) if reach > 0 else np.ones(1)
    eased_m = sliding_window_view(np.pad(least_m, reach, mode="edge"), 2 * reach + 1) @ (kernel / kernel.sum())
    waves = np.stack([_wander(rng, time_s, axis) for axis in range(2)], axis=-1)
    return waves * (eased_m / np.sqrt(2.0))[:, None]


def _wander(rng: np.random.Generator, time_s: Float64, axis: int) -> Float64:
    """(N,) in [-1, 1]: two sine waves of a drawn frequency and phases, the slower one the larger."""
    hz = rng.uniform(*_WANDER_HZ[axis]) * np.array([1.0, _OVERTONE])
    phase = rng.uniform(0.0, 2.0 * np.pi, len(hz))
    return np.sin(2.0 * np.pi * np.outer(time_s, hz) + phase) @ _WANDER_SHARES


def _waves(rng: np.random.Generator, time_s: Float64, low_hz: float, high_hz: float) -> Float64:
    """(N,) in [-1, 1]: a sum of a few sine waves; faster ones have smaller amplitudes, so that none of them jerks."""
    hz = rng.uniform(low_hz, high_hz, 4)
    phase = rng.uniform(0.0, 2.0 * np.pi, 4)
    return np.sin(2.0 * np.pi * np.outer(time_s, hz) + phase) @ (1.0 / hz) / np.sum(1.0 / hz)
