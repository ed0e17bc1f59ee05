# SPDX-License-Identifier: GPL-3.0-or-later
"""A chain where a person sees it: keyed on the timeline, and put behind what a scene renders or before an image."""

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from ..core.chain import build_chain, socket_values, step_node
from ..core.mixture import Identifiers, Step
from .nodes import ensure_group, remove_group

PREVIOUS = "noisy_world_previous_compositing"


def make_chain(name: str, steps: Sequence[Step], frames: Sequence[int], identifiers: Identifiers) -> bpy.types.NodeTree:
    """Make the node group of a chain with its sockets set, and keyed over `frames` where they change.

    A scene at frame k then shows what the generator writes as frame k of the sequence that `identifiers` names.
    """
    tree = ensure_group(build_chain(name, steps))
    tree.animation_data_clear()
    for step in steps:
        node = tree.nodes[step_node(step)]
        each = [socket_values(step, k, identifiers, scene_frame=k)[0] for k in frames]
        names = dict.fromkeys(name for values in each for name in values)
        for socket_name in names:
            socket = node.inputs[socket_name]
            # Where a step does nothing its parameters stay as they were.
            known = [(k, values[socket_name]) for k, values in zip(frames, each, strict=True) if socket_name in values]
            socket.default_value = known[0][1]
            if len({value for _, value in known}) > 1:
                _key(tree, socket, known)
    return tree


def _key(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, values: list[tuple[int, Any]]) -> None:
    """Key a socket: each value holds until the next key."""
    if tree.animation_data is None or tree.animation_data.action is None:
        tree.animation_data_create()
        tree.animation_data.action = bpy.data.actions.new(f"{tree.name} severity")
    path = socket.path_from_id("default_value")
    curve = tree.animation_data.action.fcurve_ensure_for_datablock(tree, path)
    points = curve.keyframe_points
    points.add(len(values))
    points.foreach_set("co", np.array(values, dtype=np.float32).ravel())
    constant = bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items["CONSTANT"].value
    points.foreach_set("interpolation", np.full(len(values), constant, dtype=np.int32))
    curve.update()


def show_chain(
    scene: bpy.types.Scene,
    chain: bpy.types.NodeTree,
    *,
    image: bpy.types.Image | None = None,
    encoded: bool = False,
    reference_width_px: int | None = None,
) -> bpy.types.NodeTree:
    """Let a scene's compositor show a chain, behind its render or before an image; `hide_chain` takes it back.

    encoded: what comes in is sRGB-encoded and is to stay so. reference_width_px: by default the scene's full width.
    """
    tree = bpy.data.node_groups.new(f"{scene.name} with {chain.name}", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    source = tree.nodes.new("CompositorNodeImage" if image is not None else "CompositorNodeRLayers")
    if image is not None:
        source.image = image
    else:
        source.scene = scene
    group = tree.nodes.new("CompositorNodeGroup")
    group.node_tree = chain
    group.width = 240
    group.inputs["Encoded"].default_value = encoded
    group.inputs["Reference Width"].default_value = reference_width_px or scene.render.resolution_x
    end = tree.nodes.new("NodeGroupOutput")
    for node, left in ((source, -360), (group, 0), (end, 340)):
        node.location = (left, 0)
    tree.links.new(source.outputs["Image"], group.inputs["Image"])
    if "Depth" in group.inputs and image is None:
        scene.view_layers[0].use_pass_z = True
        tree.links.new(source.outputs["Depth"], group.inputs["Depth"])
    tree.links.new(group.outputs["Image"], end.inputs["Image"])
    hide_chain(scene)  # only now: the chain that goes may be this one
    scene[PREVIOUS] = scene.compositing_node_group
    scene.compositing_node_group = tree
    return tree


def hide_chain(scene: bpy.types.Scene) -> None:
    """Give a scene back the compositing that it had before `show_chain`; a chain that nothing else uses goes too."""
    if PREVIOUS not in scene:
        return
    shown = scene.compositing_node_group
    scene.compositing_node_group = scene[PREVIOUS]
    del scene[PREVIOUS]
    if shown is not None and shown.users == 0:
        remove_group(shown)
