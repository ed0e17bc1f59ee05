# SPDX-License-Identifier: GPL-3.0-or-later
"""The body that carries the camera, and the frames of its rig, as lines in the 3D views at the current frame."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import pose
from ..core.trajectories.bodies import BODIES
from .document import NO_BODY
from .imu_fields import PLACE
from .typed_numbers import value_of

Ends: TypeAlias = NDArray[np.float64]
"""The ends (2 M, 3) of M lines."""
Colour: TypeAlias = tuple[float, float, float]

BODY_RGB = (0.0, 0.62, 0.45)  # bluish green of Okabe and Ito's palette, as the paths' blue and orange are
AXES_RGB: tuple[Colour, Colour, Colour] = ((0.93, 0.25, 0.25), (0.45, 0.80, 0.25), (0.30, 0.50, 0.98))
AXIS_M, IMU_AXIS_M = 0.2, 0.12  # chosen by eye
CORNERS = 24  # of a circle
# Half the length and the width of a trunk, its lower and upper edge as shares of the camera's height; by eye.
_TRUNKS = {"quadruped": (0.2, 0.13, 0.5, 0.75), "rover": (0.25, 0.2, 0.3, 0.6)}


def lines(panel: Any, c2w: NDArray[np.float64], row: int, moved: NDArray[np.float64]) -> list[tuple[Colour, Ends]]:
    """Return the lines of a body and its rig in the world, by colour; none where nothing carries the camera.

    c2w: (N, 4, 4) the planned path. row: which pose of it is shown. moved: (4, 4) where deviation has the camera then.
    """
    has_body, has_imu = panel.body != NO_BODY, bool(panel.has_imu)
    if not (has_body or has_imu):
        return []
    found = list(zip(AXES_RGB, axes(moved, AXIS_M), strict=True))
    if has_imu:
        imu = moved @ pose(np.eye(3), np.array([value_of(panel, name) for name in PLACE]))
        found += zip(AXES_RGB, axes(imu, IMU_AXIS_M), strict=True)
    if has_body:
        body = BODIES[panel.body]
        floor_m = float(c2w[:, 2, 3].mean()) - body.height_m
        outline = figure(panel.body) @ _upright(c2w, row)[:3, :3].T + [*c2w[row, :2, 3], floor_m]
        found += [(BODY_RGB, outline), (BODY_RGB, _shadow(c2w, floor_m))]
    return found


def axes(c2w: NDArray[np.float64], length_m: float) -> list[Ends]:
    """Return the x, y and z axis of a frame in the world, a line each."""
    return [np.stack([c2w[:3, 3], c2w[:3, 3] + length_m * c2w[:3, axis]]) for axis in range(3)]


def figure(kind: str) -> Ends:
    """Return the outline of a body that stands at the origin and looks along x, z up; as high as its camera."""
    body = BODIES[kind]
    high, wide = body.height_m, body.radius_m
    if kind in _TRUNKS:
        half, side, low, top = _TRUNKS[kind]
        parts = [_box(half, side, low * high, top * high)]
        for x, y in ((half, side), (half, -side), (-half, side), (-half, -side)):
            if kind == "rover":
                parts.append(_circle(0.1, (0, 2), (0.7 * x, y, 0.1)))
            else:
                knee = [0.75 * x - 0.08, y, 0.3 * high]
                parts.append(_strip([[0.75 * x, y, low * high], knee, [0.75 * x, y, 0.0]]))
        parts.append(_strip([[0.8 * half, 0, top * high], [0.8 * half, 0, high]]))
    elif body.stands:
        hip, neck = 0.53 * high, 0.86 * high
        parts = [
            *(_strip([[0, y, hip], [0, 1.3 * y, 0.0]]) for y in (0.1, -0.1)),
            _strip([[0, 0.1, hip], [0, -0.1, hip]]),
            _strip([[0, 0, hip], [0, 0, neck]]),
            *(_strip([[0, 0, neck], [0, y, 0.8 * high], [0.05, 1.2 * y, hip]]) for y in (0.8 * wide, -0.8 * wide)),
            _circle(0.11, (0, 2), (0, 0, high)),
        ]
    else:
        arm = 0.7 * wide
        corners = [(arm, arm), (arm, -arm), (-arm, -arm), (-arm, arm)]
        parts = [_strip([[*corners[0], high], [*corners[2], high]]), _strip([[*corners[1], high], [*corners[3], high]])]
        parts += [_circle(0.5 * wide, (0, 1), (x, y, high)) for x, y in corners]
    return np.concatenate([*parts, _circle(wide, (0, 1), (0, 0, 0.0))])


def _upright(c2w: NDArray[np.float64], row: int) -> NDArray[np.float64]:
    """Return level axes (3, 3): where the camera looks over the floor, its left, and up."""
    ahead = c2w[row, :2, 2]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    return np.array([[ahead[0], -ahead[1], 0.0], [ahead[1], ahead[0], 0.0], [0.0, 0.0, 1.0]])


def _shadow(c2w: NDArray[np.float64], floor_m: float) -> Ends:
    """Return the way on the floor."""
    return _strip(np.column_stack([c2w[:, :2, 3], np.full(len(c2w), floor_m)]))


def _strip(points: Any) -> Ends:
    return np.repeat(np.asarray(points, np.float64), 2, axis=0)[1:-1]


def _circle(radius_m: float, plane: tuple[int, int], centre_m: tuple[float, float, float]) -> Ends:
    around = np.linspace(0, 2 * np.pi, CORNERS + 1)
    points = np.zeros((CORNERS + 1, 3))
    points[:, plane[0]], points[:, plane[1]] = radius_m * np.cos(around), radius_m * np.sin(around)
    return _strip(points + centre_m)


def _box(half_m: float, side_m: float, low_m: float, top_m: float) -> Ends:
    ring = np.array([(half_m, side_m), (half_m, -side_m), (-half_m, -side_m), (-half_m, side_m), (half_m, side_m)])
    rings = [_strip(np.column_stack([ring, np.full(5, z)])) for z in (low_m, top_m)]
    posts = [_strip([[x, y, low_m], [x, y, top_m]]) for x, y in ring[:4]]
    return np.concatenate([*rings, *posts])
