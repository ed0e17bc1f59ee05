# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys on groups in an artist's own compositor: how the camera moves, and values told for each frame."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.geometry import rotvec_from_rotation
from ..nodes.chain_scene import BUILT_AS, clear_keys, key_socket
from ..nodes.datablocks import fcurves_of, set_value
from ..nodes.node_trees import STAMP, described_as
from ..perturbations.group_camera import TURNING_INPUT, VELOCITY_INPUT
from ..perturbations.groups import socket_name
from ..perturbations.kinds import ColourPerturbation
from ..scenes.blend_scene import SampledCamera
from .own_view import bound_cameras, sampled_camera

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


# Keys on groups in an artist's own compositor that are told a value for each frame, such as auto-exposure's stops.


BAKED = "noisy_world_baked"  # of a tree: the keys that were baked, [frame, value] by their sockets' paths, as JSON
CONSTANT = 1e-6  # stops or turns; what changes less is set, not keyed


@dataclass(frozen=True)
class ToldGroup:
    """A group node that is told values for each frame. place: its tree and the node."""

    place: Place
    perturbation: ColourPerturbation

    @property
    def name(self) -> str:
        """What the node is called."""
        _, node = self.place
        return node.label or node.name


def told_groups(own: bpy.types.NodeTree | None, by_group: Mapping[str, ColourPerturbation]) -> list[ToldGroup]:
    """Return the group nodes of a scene's own compositing that have sockets for values of each frame.

    by_group: those perturbations, by the name of their group. Groups inside groups of the user's own are among them, in
    the order in which the compositor has them.
    """
    found: list[ToldGroup] = []
    for tree, node in [] if own is None else groups_within(own):
        group: Any = node.node_tree
        if (perturbation := by_group.get(described_as(group))) is not None:
            found.append(ToldGroup((tree, node), perturbation))
    return found


def bake(group: ToldGroup, frames: range, values: Mapping[str, Sequence[float]]) -> list[str]:
    """Key a group's sockets over scene frames; return the names of those that stay as an artist has set them up.

    values: of each frame, by the perturbation's name for them. What an earlier call keyed is keyed anew, unless it was
    changed since; sockets that are linked, driven or keyed otherwise stay.
    """
    tree, node = group.place
    baked: dict[str, Any] = json.loads(tree.get(BAKED, "{}"))
    left: list[str] = []
    for name, each in values.items():
        socket: Any = node.inputs[socket_name(group.perturbation, name)]
        path = socket.path_from_id("default_value")
        if socket.is_linked or _is_own(tree, path, baked.get(path)):
            left.append(f"{group.name} > {socket.name}")
            continue
        clear_keys(tree, [path])
        numbers = np.array(each, np.float32)
        set_value(socket, float(numbers[0]))
        baked.pop(path, None)
        if np.ptp(numbers) > CONSTANT:
            key_socket(tree, socket, list(zip(frames, numbers.tolist(), strict=True)))
            baked[path] = _keys(tree, path).tolist()
    tree[BAKED] = json.dumps(baked)
    return left


def _is_own(tree: bpy.types.NodeTree, path: str, baked: Any) -> bool:
    """Tell whether a socket is driven, or has keys that are not those that were baked."""
    data = tree.animation_data
    if data is None:
        return False
    if any(curve.data_path == path for curve in data.drivers):
        return True
    keys = _keys(tree, path)
    return len(keys) > 0 and keys.tolist() != baked


def _keys(tree: bpy.types.NodeTree, path: str) -> NDArray[np.float64]:
    """Return (N, 2) frame and value of a socket's keys."""
    data = tree.animation_data
    curves = [] if data is None else [curve for curve in fcurves_of(data) if curve.data_path == path]
    return np.array([point.co[:] for curve in curves for point in curve.keyframe_points], np.float64).reshape(-1, 2)
