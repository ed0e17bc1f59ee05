# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups of weather in an artist's own compositor, linked to the scene's camera by drivers, and keys where it moves."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, TypeAlias

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..core.geometry import rotvec_from_rotation
from ..core.node_graphs.camera import CAMERA_INPUTS, LOCATION_INPUT, ROTATION_INPUT, TURNING_INPUT, VELOCITY_INPUT
from ..core.node_graphs.group_inputs import socket_name
from ..core.scenes.own_scene import SampledCamera
from .chain_values import BUILT_AS, clear_keys, key_socket
from .nodes import STAMP
from .scene_camera import bound_cameras, camera_parameters, sampled_camera
from .typed import set_value

Place: TypeAlias = tuple[bpy.types.NodeTree, bpy.types.NodeGroup | Any]
"""A tree, and a node of it that shows one of our groups."""

FRAME_RATE, VIEW = socket_name("frame_rate_hz"), socket_name("view_deg")
_NAMES = {item.name for item in CAMERA_INPUTS}
STILL = 1e-6  # metres or radians a second; what moves less is at rest


def linkable(scene: bpy.types.Scene) -> list[Place]:
    """Return the group nodes of a scene's compositor that ask for the camera, or for the frame rate.

    Those inside groups of the user's own are among them; the chain that the panel keys itself is not.
    """
    tree = scene.compositing_node_group
    return [] if tree is None else [place for place in groups_within(tree) if _looks_at_camera(place[1])]


def _looks_at_camera(node: Any) -> bool:
    names = {socket.name for socket in node.inputs}
    return names >= _NAMES or FRAME_RATE in names


def groups_within(tree: bpy.types.NodeTree) -> list[Place]:
    """Return the nodes of our groups in a tree and in groups of the user's own inside it; not the panel's chain."""
    return list(_within(tree, {tree.session_uid}))


def _within(tree: bpy.types.NodeTree, seen: set[int]) -> Iterator[Place]:
    for node in tree.nodes:
        group = getattr(node, "node_tree", None)
        if group is None:
            continue
        if STAMP in group and BUILT_AS not in group:
            yield tree, node
        elif STAMP not in group and BUILT_AS not in group and group.library is None and group.session_uid not in seen:
            seen.add(group.session_uid)
            yield from _within(group, seen)


def link_camera(scene: bpy.types.Scene) -> list[str]:
    """Link all these groups to the scene's camera and frame rate; return the names of their nodes.

    Location, rotation, field of view and frame rate follow by drivers that need no script. What a driver cannot know,
    velocity and turning, is keyed over the scene's frames, as means since the frame before; a path that changes later
    asks for linking again. Where markers bind several cameras, all is keyed, as a driver follows one. Sockets that a
    user has linked to another node stay as they are.
    """
    camera, places, frames = scene.camera, linkable(scene), range(scene.frame_start, scene.frame_end + 1)
    assert camera is not None, "the scene has a camera"
    takes_turns = has_several_cameras(scene)
    keyed: dict[str, NDArray[np.float64]] = {}
    if takes_turns or any(VELOCITY_INPUT.name in node.inputs for _, node in places):
        sampled = sampled_camera(scene, None if takes_turns else camera, frames)
        keyed = _velocities(sampled, scene.render.fps / scene.render.fps_base)
        if takes_turns:
            keyed |= _stands(sampled)
    for tree, node in places:
        for name, channels in ((LOCATION_INPUT.name, "LOC"), (ROTATION_INPUT.name, "ROT")):
            if not takes_turns and (socket := _free(node, name)) is not None:
                _drive_vector(tree, socket, camera, channels)
        if (socket := _free(node, FRAME_RATE)) is not None:
            _drive(tree, socket, "fps / base", {"fps": (scene, "render.fps"), "base": (scene, "render.fps_base")})
        if not takes_turns and (socket := _free(node, VIEW)) is not None:
            _view(tree, socket, scene, camera)
        for name, values in keyed.items():
            if (socket := _free(node, name)) is not None:
                _key(tree, socket, frames, values)
    return [node.label or node.name for _, node in places]


def has_several_cameras(scene: bpy.types.Scene) -> bool:
    """Tell whether markers bind more than one camera, so that they take turns."""
    return len({item.name for _, item in bound_cameras(scene)}) > 1


def _free(node: Any, name: str) -> Any:
    """Return an input of a node that no link feeds; None where there is none."""
    socket = node.inputs.get(name)
    return None if socket is None or socket.is_linked else socket


def _drive_vector(tree: bpy.types.NodeTree, socket: Any, camera: bpy.types.Object, channels: str) -> None:
    _undriven(tree, socket)
    for part, axis in enumerate("XYZ"):
        curve: Any = socket.driver_add("default_value", part)
        curve.driver.type = "AVERAGE"
        variable = curve.driver.variables.new()
        variable.type = "TRANSFORMS"
        target = variable.targets[0]
        target.id = camera
        target.transform_type, target.transform_space = f"{channels}_{axis}", "WORLD_SPACE"
        target.rotation_mode = "XYZ"


def _drive(
    tree: bpy.types.NodeTree, socket: Any, expression: str, variables: dict[str, tuple[bpy.types.ID, str]]
) -> None:
    """Let a socket follow properties. expression: simple enough that Blender needs no script for it."""
    _undriven(tree, socket)
    curve: Any = socket.driver_add("default_value")
    curve.driver.type = "SCRIPTED"
    for name, (item, path) in variables.items():
        variable = curve.driver.variables.new()
        variable.name = name
        target = variable.targets[0]
        target.id_type, target.id, target.data_path = item.id_type, item, path
    curve.driver.expression = expression
    assert curve.driver.is_simple_expression


def _undriven(tree: bpy.types.NodeTree, socket: Any) -> None:
    """Take away a socket's keys and drivers."""
    path = socket.path_from_id("default_value")
    clear_keys(tree, [path])
    if tree.animation_data is not None and any(curve.data_path == path for curve in tree.animation_data.drivers):
        socket.driver_remove("default_value")


def _view(tree: bpy.types.NodeTree, socket: Any, scene: bpy.types.Scene, camera: bpy.types.Object) -> None:
    """Let the field of view follow the lens, where the sensor's width is along the image; else set it."""
    seen = camera_parameters(scene, camera)
    wide = 2 * np.arctan(seen.width_px / 2 / seen.fx_px)
    data: Any = camera.data
    if abs(data.angle_x - wide) < 1e-5:
        _drive(tree, socket, "angle + 0", {"angle": (data, "angle_x")})
        return
    _undriven(tree, socket)
    set_value(socket, float(wide))


def _turns(sampled: SampledCamera) -> NDArray[np.float64]:
    """Return the rotations (frames, 3, 3) of a camera in the world."""
    axes = sampled.matrices[:, :3, :3]
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def _velocities(sampled: SampledCamera, rate_hz: float) -> dict[str, NDArray[np.float64]]:
    """Return by socket (frames, 3): velocity in the world, m/s, and turning about the camera's axes, rad/s."""
    places_m, turns = sampled.matrices[:, :3, 3], _turns(sampled)
    velocity, turning = np.zeros_like(places_m), np.zeros_like(places_m)
    velocity[1:] = np.diff(places_m, axis=0) * rate_hz
    turning[1:] = [rotvec_from_rotation(a.T @ b) * rate_hz for a, b in pairwise(turns)]
    if sampled.shots is not None:  # no camera flies from one shot to the next
        cut = np.flatnonzero(np.diff(sampled.shots)) + 1
        velocity[cut] = turning[cut] = 0
    return {VELOCITY_INPUT.name: velocity, TURNING_INPUT.name: turning}


def _stands(sampled: SampledCamera) -> dict[str, NDArray[np.float64]]:
    """Return by socket how each frame's camera stands: location and rotation (frames, 3), and its view (frames,)."""
    angles = np.array([Matrix(turn.tolist()).to_euler("XYZ")[:] for turn in _turns(sampled)])
    view_rad = [2 * np.arctan(item.width_px / 2 / item.fx_px) for item in sampled.parameters]
    return {LOCATION_INPUT.name: sampled.matrices[:, :3, 3], ROTATION_INPUT.name: angles, VIEW: np.array(view_rad)}


def _key(tree: bpy.types.NodeTree, socket: Any, frames: range, values: NDArray[np.float64]) -> None:
    """Key numbers (frames,) or vectors (frames, 3) where they change; what does not is set."""
    _undriven(tree, socket)
    rows = [tuple(row) if isinstance(row, list) else row for row in values.tolist()]
    set_value(socket, rows[0])
    if np.ptp(values, axis=0).max() > STILL:
        key_socket(tree, socket, list(zip(frames, rows, strict=True)))
