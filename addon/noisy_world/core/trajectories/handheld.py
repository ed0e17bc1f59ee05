# SPDX-License-Identifier: GPL-3.0-or-later
"""A smooth, seeded, hand-held camera path inside a room that is given only as a mesh.

The path joins points that are far apart through free cells of the room's map; in narrow passages it bends more tightly
and goes slower. Gravity is -z.
"""

from typing import TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from ..errors import NoisyWorldError
from ..geometry import opencv_from_robot_c2w, pose, rotation_from_euler_deg
from ..messages import Message, PresetKey
from ..scenes.mesh import Mesh
from ..streams import stream
from .room_map import BOB_M, Room, distance_m, find_room
from .trajectory import Trajectory, evenly_stamped
from .walk import look_around, walk

Float64: TypeAlias = NDArray[np.float64]

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
