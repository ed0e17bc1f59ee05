# SPDX-License-Identifier: GPL-3.0-or-later
"""How the scene's camera moves, keyed in groups of weather in an artist's own compositor; how it stands they see."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.geometry import rotvec_from_rotation
from ..core.node_graphs.camera import TURNING_INPUT, VELOCITY_INPUT
from ..core.scenes.own_scene import SampledCamera
from .chain_values import BUILT_AS, clear_keys, key_socket
from .nodes import STAMP
from .scene_camera import bound_cameras, sampled_camera
from .typed import set_value

Place: TypeAlias = tuple[bpy.types.NodeTree, bpy.types.NodeGroup | Any]
"""A tree, and a node of it that shows one of our groups."""

_NAMES = {VELOCITY_INPUT.name, TURNING_INPUT.name}
STILL = 1e-6  # metres or radians a second; what moves less is at rest


def keyable(scene: bpy.types.Scene) -> list[Place]:
    """Return the group nodes of a scene's compositor that ask how the camera moves.

    Those inside groups of the user's own are among them; the chain that the panel keys itself is not.
    """
    tree = scene.compositing_node_group
    return [] if tree is None else [place for place in groups_within(tree) if set(place[1].inputs.keys()) >= _NAMES]


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


def key_motion(scene: bpy.types.Scene) -> list[str]:
    """Key how the scene's camera moves in all these groups; return the names of their nodes.

    Velocity and turning, which no driver knows, are keyed over the scene's frames, as means since the frame before; a
    path that changes later asks for keying again. Where markers bind several cameras, they are of the one that sees the
    frame, and none flies from one to the next. Sockets that a user has linked or driven stay as they are.
    """
    camera, places, frames = scene.camera, keyable(scene), range(scene.frame_start, scene.frame_end + 1)
    assert camera is not None, "the scene has a camera"
    sampled = sampled_camera(scene, None if has_several_cameras(scene) else camera, frames)
    keyed = _velocities(sampled, scene.render.fps / scene.render.fps_base)
    for tree, node in places:
        for name, values in keyed.items():
            if not _is_taken(tree, node.inputs[name]):
                _key(tree, node.inputs[name], frames, values)
    return [node.label or node.name for _, node in places]


def has_several_cameras(scene: bpy.types.Scene) -> bool:
    """Tell whether markers bind more than one camera, so that they take turns."""
    return len({item.name for _, item in bound_cameras(scene)}) > 1


def _is_taken(tree: bpy.types.NodeTree, socket: Any) -> bool:
    drivers = () if tree.animation_data is None else tree.animation_data.drivers
    return socket.is_linked or socket.path_from_id("default_value") in {curve.data_path for curve in drivers}


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


def _key(tree: bpy.types.NodeTree, socket: Any, frames: range, values: NDArray[np.float64]) -> None:
    """Key vectors (frames, 3) where they change; what does not is set."""
    clear_keys(tree, [socket.path_from_id("default_value")])
    rows = [tuple(row) for row in values.tolist()]
    set_value(socket, rows[0])
    if np.ptp(values, axis=0).max() > STILL:
        key_socket(tree, socket, list(zip(frames, rows, strict=True)))
