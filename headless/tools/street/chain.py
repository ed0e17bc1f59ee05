# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups one behind the other in the compositor, as if an artist had dragged them in, with keys on their sockets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from noisy_world.blender.nodes import ensure_group
from noisy_world.blender.typed import (
    action_of,
    group_of,
    interpolation,
    new_action,
    new_node,
    new_socket,
    new_tree,
    outputs,
    set_value,
)
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.node_graphs.camera import OVERRIDE_CAMERA, camera_values
from noisy_world.core.node_graphs.group_inputs import socket_name, socket_value
from noisy_world.core.node_graphs.groups import build_group
from noisy_world.core.perturbing.kinds import ColourPerturbation
from noisy_world.core.trajectories.camera_state import camera_state_of
from noisy_world.core.trajectories.motion import motion_between
from noisy_world.perturbations import registry

GAP = 60
TOP = 200  # of the nodes, so that a node editor shows them as it opens
OVERRIDE = "Override Severity"
Keys: TypeAlias = Sequence[tuple[int, float]]
"""Scene frames with values; between them the value goes straight from one to the other."""


@dataclass(frozen=True)
class Link:
    """A group of the chain. values, keys: of its sockets, where they are other than the group's own."""

    perturbation: str
    values: Mapping[str, float | bool]
    keys: Mapping[str, Keys] = field(default_factory=dict)


# Chosen by eye for the street: a winter's evening, fog that lies low, moves and glows around the lamps.
EVENING_FOG = {"Airlight": 0.5, "Falloff": 6.0, "Glow": 0.8, "Unevenness": 0.6, "Frame Rate": 24.0}
CHAIN = (
    Link("fog_depth", {OVERRIDE: True, "Visibility": 80.0} | EVENING_FOG),
    Link("snow_depth", {"Severity": 3.0, "Frame Rate": 24.0}),
    Link("lens_frost", {"Severity": 2.0, "Frame Rate": 24.0}),
    Link("gaussian_noise", {OVERRIDE: True, "Std": 0.03}),
)


def show_behind_render(
    scene: bpy.types.Scene, chain: Sequence[Link], camera: Intrinsics, c2w: NDArray[np.float64]
) -> bpy.types.NodeTree:
    """Make the scene's compositing a chain of groups behind its render; return it. c2w: the camera's path, from 0."""
    tree = new_tree("Street")
    new_socket(tree, "Image", "NodeSocketColor", output=True)
    layers = new_node(tree, bpy.types.CompositorNodeRLayers)
    layers.scene = scene
    passes = outputs(layers)
    wide_px = scene.render.resolution_x
    groups = add_groups(tree, passes["Image"], passes["Depth"], chain, camera=camera, reference_width_px=wide_px)
    end = tree.nodes.new("NodeGroupOutput")
    tree.links.new(groups[-1].outputs["Image"], end.inputs["Image"])
    key_camera(tree, groups, c2w, scene.render.fps)
    arrange([layers, *groups, end])
    scene.compositing_node_group = tree
    scene.render.use_compositing = True
    return tree


def add_groups(
    tree: bpy.types.NodeTree,
    image: bpy.types.NodeSocket,
    depth_m: bpy.types.NodeSocket,
    chain: Sequence[Link],
    *,
    camera: Intrinsics,
    reference_width_px: int,
) -> list[bpy.types.CompositorNodeGroup]:
    """Add the groups, each behind the other, the first behind `image`."""
    groups = []
    for seed, link in enumerate(chain, 1):
        node = _group(tree, link, camera)
        own = {"Reference Width": reference_width_px, "Seed": seed}
        for name, value in own.items():
            if name in node.inputs:
                set_value(node.inputs[name], value)
        tree.links.new(image, node.inputs["Image"])
        if "Depth" in node.inputs:
            tree.links.new(depth_m, node.inputs["Depth"])
        image = node.outputs["Image"]
        groups.append(node)
    return groups


def _group(tree: bpy.types.NodeTree, link: Link, camera: Intrinsics) -> bpy.types.CompositorNodeGroup:
    perturbation = registry()[link.perturbation]
    assert isinstance(perturbation, ColourPerturbation)
    node = new_node(tree, bpy.types.CompositorNodeGroup)
    node.node_tree = ensure_group(build_group(perturbation))
    node.width = group_of(node).default_group_node_width
    seen = {} if perturbation.by_camera is None else perturbation.by_camera(camera)
    if OVERRIDE_CAMERA in node.inputs:
        set_value(node.inputs[OVERRIDE_CAMERA], True)
    for name, value in seen.items():
        set_value(node.inputs[socket_name(perturbation, name)], socket_value(perturbation, name, value))
    for name, value in link.values.items():
        set_value(node.inputs[name], value)
    for name, keys in link.keys.items():
        _key(tree, node.inputs[name], np.array(keys, dtype=np.float64))
    return node


def key_camera(
    tree: bpy.types.NodeTree,
    groups: Sequence[bpy.types.CompositorNodeGroup],
    c2w: NDArray[np.float64],
    fps: float,
) -> None:
    """Tell the groups of weather how the camera stands and moves, at each frame of its path (N, 4, 4), from frame 0."""
    each = []
    for frame, here in enumerate(c2w):
        seconds = 1 / fps if frame else 0.0
        each.append(camera_values(camera_state_of(motion_between(c2w[0], c2w[max(frame - 1, 0)], here, seconds))))
    for node in groups:
        for name in each[0]:
            if name not in node.inputs:
                continue
            for axis in range(3):
                keys = [(frame, values[name][axis]) for frame, values in enumerate(each)]
                _key(tree, node.inputs[name], np.array(keys), axis)


def _key(
    tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, keys: NDArray[np.float64], axis: int | None = None
) -> None:
    """Key a socket, or one number of a vector's, by frames and values (N, 2)."""
    if tree.animation_data is None:
        new_action(tree, tree.name)
    path = socket.path_from_id("default_value")
    where: dict[str, Any] = {} if axis is None else {"index": axis}
    points = action_of(tree).fcurve_ensure_for_datablock(tree, path, **where).keyframe_points
    points.add(len(keys))
    points.foreach_set("co", keys.astype(np.float32).ravel())
    points.foreach_set("interpolation", np.full(len(keys), interpolation("LINEAR"), dtype=np.int32))


def arrange(nodes: Sequence[bpy.types.Node]) -> None:
    """Put nodes beside each other around the middle."""
    left = -sum(node.width + GAP for node in nodes) / 2
    for node in nodes:
        node.location = (left, TOP)
        node.select = False
        left += node.width + GAP
