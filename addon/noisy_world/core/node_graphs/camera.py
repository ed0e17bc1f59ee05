# SPDX-License-Identifier: GPL-3.0-or-later
"""Sockets for the camera's pose and motion in the world, which groups of weather have."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..trajectories.camera_state import CameraState
from .graph import Graph, GroupInput, Panel, Socket

CAMERA_PANEL = Panel("Camera", "How the camera stands and moves, as an object in Blender", closed=True)

LOCATION_INPUT = GroupInput(
    "Camera Location", "vector", (0.0, 0.0, 0.0), "Where the camera is, in meters; z is up", panel=CAMERA_PANEL
)
ROTATION_INPUT = GroupInput(
    "Camera Rotation",
    "vector",
    (math.pi / 2, 0.0, 0.0),
    "The camera's rotation, XYZ Euler angles in radians",
    panel=CAMERA_PANEL,
)
VELOCITY_INPUT = GroupInput(
    "Camera Velocity",
    "vector",
    (0.0, 0.0, 0.0),
    "Meters a second along the world's axes; it draws streaks",
    panel=CAMERA_PANEL,
)
TURNING_INPUT = GroupInput(
    "Camera Turning",
    "vector",
    (0.0, 0.0, 0.0),
    "Radians a second about the camera's own axes; it draws streaks",
    panel=CAMERA_PANEL,
)
CAMERA_INPUTS = (LOCATION_INPUT, ROTATION_INPUT, VELOCITY_INPUT, TURNING_INPUT)


@dataclass(frozen=True)
class CameraSockets:
    """The camera in a group: location, velocity, in the world; turning, about its own axes right, up and back.

    right, up, back: its own axes in the world.
    """

    location: Socket
    velocity: Socket
    turning: Socket
    right: Socket
    up: Socket
    back: Socket

    def to_own(self, vector: Socket) -> Socket:
        """Return a vector of the world in the camera's axes: right, down, forward."""
        graph = vector.graph
        right, up, back = (graph.math("DOT_PRODUCT", vector, axis) for axis in (self.right, self.up, self.back))
        return graph.vector(right, up * -1.0, back * -1.0)


def camera_sockets(graph: Graph) -> CameraSockets:
    """Add the inputs to a group."""
    location, rotation, velocity, turning = (graph.input(item) for item in CAMERA_INPUTS)
    with graph.section("Camera's axes"):
        sines, cosines = graph.math("SINE", rotation), graph.math("COSINE", rotation)
        (sx, sy, sz), (cx, cy, cz) = ((of.x, of.y, of.z) for of in (sines, cosines))
        right = graph.vector(cz * cy, sz * cy, sy * -1.0)
        up = graph.vector(cz * sy * sx - sz * cx, sz * sy * sx + cz * cx, cy * sx)
        back = graph.vector(cz * sy * cx + sz * sx, sz * sy * cx - cz * sx, cy * cx)
    return CameraSockets(location, velocity, turning, right, up, back)


def camera_values(camera_state: CameraState) -> Mapping[str, Any]:
    """Return the values of the sockets, by name."""
    return dict(zip((item.name for item in CAMERA_INPUTS), camera_state.as_blender(), strict=True))
