# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera in node groups: the scene's own, by drivers, or sockets in its place; and how it moves, by sockets.

Groups as people see them look at the camera of the scene that is composited. What the generator and the panel's chain
evaluate is told by sockets, as it need not be that of a scene.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from ..core.camera_motion import CameraState
from ..core.node_graph import Graph, GroupInput, Panel, Socket
from .kinds import ColourPerturbation

OVERRIDE_CAMERA = "Override Camera"
CAMERA_PANEL = Panel(
    OVERRIDE_CAMERA,
    "What the scene's camera and frame rate decide; switched on, these values are used",
    closed=True,
)
MOTION_PANEL = Panel("Camera Motion", "How the camera moves, which draws streaks", closed=True)
OVERRIDE_CAMERA_INPUT = GroupInput(
    OVERRIDE_CAMERA,
    "bool",
    False,
    "Use the values below instead of the scene's camera and frame rate",
    panel=CAMERA_PANEL,
    toggles=True,
)
FRAME_RATE, VIEW, AXIS_ACROSS, AXIS_DOWN = "frame_rate_hz", "view_deg", "axis_across", "axis_down"
SENSOR_MM = 36.0  # of a camera that is not there, which sees 90 degrees
VERTICAL_FIT, HORIZONTAL_FIT = 2, 1  # of a camera's sensor, as Blender numbers them; 0 is automatic

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
    panel=MOTION_PANEL,
)
TURNING_INPUT = GroupInput(
    "Camera Turning",
    "vector",
    (0.0, 0.0, 0.0),
    "Radians a second about the camera's own axes; it draws streaks",
    panel=MOTION_PANEL,
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


def looks_at_scene(perturbation: ColourPerturbation) -> bool:
    """Tell whether a perturbation's group, as people see it, looks at the scene's camera or frame rate."""
    return perturbation.uses_motion or bool(of_scene(perturbation))


def of_scene(perturbation: ColourPerturbation) -> tuple[str, ...]:
    """Return the parameters of a perturbation that the scene decides, in a group as people see it."""
    names = [item.name for item in fields(perturbation.parameters)] if perturbation.has_parameter_sockets else []
    by_camera = (VIEW, AXIS_ACROSS, AXIS_DOWN) if perturbation.by_camera is not None else ()
    return tuple(name for name in names if name == FRAME_RATE or name in by_camera)


def scene_values(graph: Graph, width_px: Socket, height_px: Socket) -> dict[str, Socket]:
    """Return each of these parameters as the scene has it: an angle in radians, shares, frames a second.

    width_px, height_px: of the image. By Blender's rule, as in `camera_parameters`.
    """
    fit, lens = graph.of_scene("camera.data.sensor_fit", 0.0), graph.of_scene("camera.data.lens", SENSOR_MM / 2)
    width_mm, height_mm = (graph.of_scene(f"camera.data.sensor_{name}", SENSOR_MM) for name in ("width", "height"))
    shift_x, shift_y = (graph.of_scene(f"camera.data.shift_{axis}", 0.0) for axis in "xy")
    wide, tall = (graph.of_scene(f"render.pixel_aspect_{axis}", 1.0) for axis in "xy")
    high = height_px * (tall / wide)  # in pixels as wide as the image's
    vertical = graph.math("GREATER_THAN", fit, VERTICAL_FIT - 0.5)
    automatic = graph.math("LESS_THAN", fit, HORIZONTAL_FIT - 0.5)
    side_px = graph.mix(width_px, high, graph.math("MAXIMUM", vertical, automatic * (high > width_px)))
    half = graph.mix(width_mm, height_mm, vertical) * width_px / (lens * side_px * 2.0)
    return {
        VIEW: graph.math("ARCTANGENT", half) * 2.0,
        AXIS_ACROSS: 0.5 - shift_x * side_px / width_px,
        AXIS_DOWN: 0.5 + shift_y * side_px / high,
        FRAME_RATE: graph.of_scene("render.fps", 24.0) / graph.of_scene("render.fps_base", 1.0),
    }


def camera_sockets(graph: Graph, override: Socket | None) -> CameraSockets:
    """Add the inputs to a group. override: whether they count instead of the scene's camera; None for always."""
    location, rotation, velocity, turning = (graph.input(item) for item in CAMERA_INPUTS)
    with graph.section("Camera's axes"):
        sines, cosines = graph.math("SINE", rotation), graph.math("COSINE", rotation)
        (sx, sy, sz), (cx, cy, cz) = ((of.x, of.y, of.z) for of in (sines, cosines))
        right = graph.vector(cz * cy, sz * cy, sy * -1.0)
        up = graph.vector(cz * sy * sx - sz * cx, sz * sy * sx + cz * cx, cy * sx)
        back = graph.vector(cz * sy * cx + sz * sx, sz * sy * cx - cz * sx, cy * cx)
    if override is not None:
        with graph.section("The scene's camera"):
            axes = [_column(graph, place) for place in range(4)]
            *turned, stands = (graph.math("NORMALIZE", axis) if place < 3 else axis for place, axis in enumerate(axes))
            by_hand = (right, up, back, location)
            right, up, back, location = (
                graph.choose(override, hand, own, "vector")
                for hand, own in zip(by_hand, (*turned, stands), strict=True)
            )
    return CameraSockets(location, velocity, turning, right, up, back)


def _column(graph: Graph, place: int) -> Socket:
    """Return a column of the camera's matrix in the world: one of its axes, or its location."""
    level = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.0, 0.0, 0.0))[place]
    x, y, z = (graph.of_scene(f"camera.matrix_world[{place}][{row}]", level[row]) for row in range(3))
    return graph.vector(x, y, z)


def camera_values(camera_state: CameraState) -> Mapping[str, Any]:
    """Return the values of the sockets, by name."""
    return dict(zip((item.name for item in CAMERA_INPUTS), camera_state.as_blender(), strict=True))
