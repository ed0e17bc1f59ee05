# SPDX-License-Identifier: GPL-3.0-or-later
"""How fast a camera moves and turns, from its poses."""

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.geometry import quat_wxyz_from_rotation, rotation_angle_rad

Float64: TypeAlias = NDArray[np.float64]

MOTION = ("speed_mps", "acceleration_mps2", "rotation_speed_degps", "rotation_acceleration_degps2")


def motion_of(c2w: ArrayLike, stamps_s: ArrayLike) -> dict[str, Float64]:
    """(N, 4, 4) c2w and (N,) stamps, increasing -> the columns MOTION, (N,) each.

    Speeds are those from the frame before to this one, NaN in the first; accelerations the change of the velocity
    around this frame, over the time from the middle of the step before to the middle of the step after, NaN in the
    first and the last. All are lengths of vectors, so they are not negative. The angular velocity is that of the
    constant rotation from pose to pose; between poses half a turn apart its direction, and so the acceleration there,
    is ambiguous.
    """
    c2w, stamps_s = np.asarray(c2w, dtype=np.float64), np.asarray(stamps_s, dtype=np.float64)
    count = len(stamps_s)
    step_s = np.diff(stamps_s)
    velocity = np.diff(c2w[:, :3, 3], axis=0) / step_s[:, None]
    rotation = c2w[:, :3, :3]
    turn_deg = np.degrees(rotation_angle_rad(rotation[:-1], rotation[1:]))
    angular = _axes(rotation) * (turn_deg / step_s)[:, None]
    between_s = ((step_s[1:] + step_s[:-1]) / 2.0)[:, None]
    columns = (
        (1, np.linalg.norm(velocity, axis=1)),
        (1, np.linalg.norm(np.diff(velocity, axis=0) / between_s, axis=1)),
        (1, turn_deg / step_s),
        (1, np.linalg.norm(np.diff(angular, axis=0) / between_s, axis=1)),
    )
    return {name: _placed(values, first, count) for name, (first, values) in zip(MOTION, columns, strict=True)}


def _axes(rotation: Float64) -> Float64:
    """(N, 3, 3) c2w -> (N - 1, 3): in the world, the unit axis of the turn from each to the next; 0 without a turn."""
    turns = rotation[1:] @ np.swapaxes(rotation[:-1], -1, -2)
    vector = quat_wxyz_from_rotation(turns)[:, 1:]
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    return np.divide(vector, length, out=np.zeros_like(vector), where=length > 0.0)


def _placed(values: Float64, first: int, count: int) -> Float64:
    """Return (count,) with values from place `first` on, NaN elsewhere."""
    column = np.full(count, np.nan)
    column[first : first + len(values)] = values
    return column
