# SPDX-License-Identifier: GPL-3.0-or-later
"""Node groups out of descriptions: made whole or not at all, found again where nothing changed, laid out to be read."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.node_graphs.graph import INTERFACE, Graph, GroupInput, Node, Picture, Socket
from ..core.node_graphs.node_layout import Arrangement, arrange
from .typed import new_node, new_socket, new_tree, set_pixels, set_value, use_as_data

STAMP = "noisy_world_stamp"
PICTURE_VERSION = "noisy_world_version"
GROUP_WIDTH_PX = 180.0  # so that names and values of parameters are not cut off
_SOCKET_TYPES = {
    "float": "NodeSocketFloat",
    "int": "NodeSocketInt",
    "bool": "NodeSocketBool",
    "vector": "NodeSocketVector",
    "color": "NodeSocketColor",
}


def ensure_group(graph: Graph) -> bpy.types.CompositorNodeTree:
    """Return the node group of a description: the one in the file where it is the same, a new one in its place if not.

    What uses the old group uses the new one afterwards. Whatever fails, the file is left as it was.
    """
    old = _local(bpy.data.node_groups, graph.name)
    if isinstance(old, bpy.types.CompositorNodeTree) and old.get(STAMP) == graph.stamp:
        return old
    before: set[bpy.types.ID] = {*bpy.data.node_groups, *bpy.data.images}
    try:
        tree = _build(graph)
    except BaseException:
        _remove_new(before)
        raise
    if old is not None:
        old.user_remap(tree)
        bpy.data.node_groups.remove(old)
    tree.name = graph.name
    return tree


def remove_group(tree: bpy.types.NodeTree) -> None:
    """Remove a group with the groups, images and actions that only it used."""
    used = _used_by(tree)
    bpy.data.node_groups.remove(tree)
    for item in used:
        with suppress(ReferenceError):  # a group within a group may have gone with it
            if item.users == 0:
                remove_group(item) if isinstance(item, bpy.types.NodeTree) else bpy.data.batch_remove([item])


def _local[T: bpy.types.ID](collection: Iterable[T], name: str) -> T | None:
    return next((item for item in collection if item.name == name and item.library is None), None)


def _remove_new(before: set[bpy.types.ID]) -> None:
    for tree in [tree for tree in bpy.data.node_groups if tree not in before]:
        bpy.data.node_groups.remove(tree)
    for image in [image for image in bpy.data.images if image not in before]:
        bpy.data.images.remove(image)


def _used_by(tree: bpy.types.NodeTree) -> list[bpy.types.ID]:
    used = [getattr(node, name, None) for node in tree.nodes for name in ("node_tree", "image")]
    if tree.animation_data is not None:
        used.append(tree.animation_data.action)
    return list(dict.fromkeys(item for item in used if item is not None))


# --- building ---


def _build(graph: Graph) -> bpy.types.CompositorNodeTree:
    children = {number: ensure_group(node.group) for number, node in enumerate(graph.nodes) if node.group is not None}
    tree = new_tree(f"{graph.name} (unfinished)")
    tree.description = graph.description
    tree.color_tag = "FILTER"
    identifiers = {item.name: _add_input(tree, item) for item in graph.inputs}
    for item in graph.outputs:
        socket = new_socket(tree, item.name, _SOCKET_TYPES[item.kind], output=True)
        socket.description = item.description
    plan = arrange(graph)
    frames = _frames(tree, plan)
    made = {number: _add_node(tree, graph.nodes[number], children.get(number)) for number in plan.positions}
    entries = _entries(tree, plan, frames)
    for number, node in made.items():
        _place(node, plan.positions[number], frames.get(graph.nodes[number].section))
        for name, value in graph.nodes[number].inputs.items():
            target = _input(node, name)
            if isinstance(value, Socket):
                source = _source(value, made, entries.get(graph.nodes[number].section), identifiers)
                tree.links.new(source, target)
            else:
                set_value(target, value)
    end = new_node(tree, bpy.types.NodeGroupOutput)
    end.is_active_output = True
    end.location = plan.output
    for item in graph.outputs:
        tree.links.new(_source(item.socket, made, entries.get(""), identifiers), end.inputs[item.name])
    _tidy(tree)
    tree[STAMP] = graph.stamp
    return tree


def _add_input(tree: bpy.types.NodeTree, item: GroupInput) -> str:
    socket = new_socket(tree, item.name, _SOCKET_TYPES[item.kind], output=False)
    socket.description = item.description
    properties: dict[str, Any] = {}
    if item.kind in ("float", "int"):
        properties["subtype"] = item.subtype
        if item.minimum is not None:
            properties["min_value"] = item.minimum
        if item.maximum is not None:
            properties["max_value"] = item.maximum
    for name, value in (properties | {"default_value": item.default}).items():
        setattr(socket, name, value)
    return socket.identifier


def _frames(tree: bpy.types.NodeTree, plan: Arrangement) -> dict[str, bpy.types.Node]:
    frames = {}
    for label in plan.sections:
        frame = new_node(tree, bpy.types.NodeFrame)
        frame.label = frame.name = label
        frame.shrink = True
        frames[label] = frame
    return frames


def _add_node(tree: bpy.types.NodeTree, item: Node, child: bpy.types.NodeTree | None) -> bpy.types.Node:
    node = tree.nodes.new(item.idname)
    properties: dict[str, Any] = {}
    if child is not None:
        properties |= {"node_tree": child, "width": GROUP_WIDTH_PX}
    if item.picture is not None:
        properties["image"] = ensure_picture(item.picture)
    for name, value in (properties | dict(item.properties)).items():
        setattr(node, name, value)
    if item.label:
        node.label = item.label
    if item.name:
        node.name = item.name
    return node


def _entries(
    tree: bpy.types.NodeTree, plan: Arrangement, frames: Mapping[str, bpy.types.Node]
) -> dict[str, bpy.types.Node]:
    """Give each section that uses the group's inputs a Group Input of its own: short links are read more easily."""
    entries = {}
    for section, place in plan.entries.items():
        entry = tree.nodes.new("NodeGroupInput")
        _place(entry, place, frames.get(section))
        entries[section] = entry
    return entries


def _place(node: bpy.types.Node, place: tuple[float, float], frame: bpy.types.Node | None) -> None:
    node.parent = frame
    node.location = place


def _input(node: bpy.types.Node, name: str) -> bpy.types.NodeSocket:
    """Return a node's input: by identifier, a group's by name."""
    if node.bl_idname == "CompositorNodeGroup":
        return node.inputs[name]
    found = next((item for item in node.inputs if item.identifier == name), None)
    if found is None:
        raise KeyError(f"{node.bl_idname} has no input {name!r}")
    return found


def _source(
    socket: Socket,
    made: Mapping[int, bpy.types.Node],
    entry: bpy.types.Node | None,
    identifiers: Mapping[str, str],
) -> bpy.types.NodeSocket:
    if socket.node == INTERFACE:
        assert entry is not None
        return next(item for item in entry.outputs if item.identifier == identifiers[socket.output])
    node = made[socket.node]
    if node.bl_idname == "CompositorNodeGroup":
        return node.outputs[socket.output]
    found = next((item for item in node.outputs if item.identifier == socket.output), None)
    if found is None:
        raise KeyError(f"{node.bl_idname} has no output {socket.output!r}")
    return found


def _tidy(tree: bpy.types.NodeTree) -> None:
    """Show of each Group Input what is linked, and of each node no output that nothing asks for."""
    for node in tree.nodes:
        node.select = False
        for socket in node.outputs:
            if not socket.is_linked:
                socket.hide = True


# --- pictures ---


def ensure_picture(picture: Picture) -> bpy.types.Image:
    """Return the image of a picture, packed into the file; made anew where it is of another version."""
    old = _local(bpy.data.images, picture.name)
    if old is not None and old.get(PICTURE_VERSION) == picture.version:
        return old
    made = picture.make()
    image = _packed_file(made) if isinstance(made, Path) else _packed_pixels(picture.name, made)
    image[PICTURE_VERSION] = picture.version
    if old is not None:
        old.user_remap(image)
        bpy.data.images.remove(old)
    image.name = picture.name
    return image


def _packed_file(path: Path) -> bpy.types.Image:
    image = bpy.data.images.load(str(path))
    use_as_data(image)
    image.pack()
    image.filepath_raw = f"//{path.name}"  # the file's own place is nobody's business
    return image


def _packed_pixels(name: str, pixels: NDArray[Any]) -> bpy.types.Image:
    height, width = pixels.shape[:2]
    is_float = pixels.dtype == np.float32
    image = bpy.data.images.new(name, width, height, alpha=False, float_buffer=is_float)
    use_as_data(image)
    values = np.ones((height, width, 4), dtype=np.float32)
    values[..., :3] = (pixels if is_float else pixels / np.float32(255)).reshape(height, width, -1)[::-1]
    set_pixels(image, values)
    image.pack()
    return image
