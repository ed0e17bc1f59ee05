# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's objects by their exact types, and float images handed to it and read back.

Typed access to Blender's objects, where Blender's own functions return a base class or None by their types.

Errors in Blender's type stubs are worked around here too, once, each with its reason beside it.
"""

import contextlib
import os
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, TypeVar

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.errors import StorageError
from ..core.file_access import open_regular

T = TypeVar("T", bound=bpy.types.Node)


def new_tree(name: str) -> bpy.types.CompositorNodeTree:
    """Add an empty node group of the compositor to the file."""
    tree = bpy.data.node_groups.new(name, "CompositorNodeTree")
    assert isinstance(tree, bpy.types.CompositorNodeTree)
    return tree


def new_node(tree: bpy.types.NodeTree, kind: type[T]) -> T:
    """Add a node of one of Blender's classes."""
    node = tree.nodes.new(kind.__name__)
    assert isinstance(node, kind)
    return node


def get_node(tree: bpy.types.NodeTree, name: str, kind: type[T]) -> T:
    """Return a node by its name."""
    node = tree.nodes[name]
    assert isinstance(node, kind)
    return node


def inputs(node: bpy.types.Node) -> bpy.types.NodeInputs:
    """Return a node's inputs, which the stubs declare as None in many subclasses."""
    return node.inputs


def outputs(node: bpy.types.Node) -> bpy.types.NodeOutputs:
    """Return a node's outputs, which the stubs declare as None in many subclasses."""
    return node.outputs


def group_of(node: bpy.types.CompositorNodeGroup) -> bpy.types.CompositorNodeTree:
    """Return the group that a group node shows."""
    assert node.node_tree is not None
    return node.node_tree


def node_tree(material: bpy.types.Material) -> bpy.types.NodeTree:
    """Return a material's nodes."""
    assert material.node_tree is not None
    return material.node_tree


def interface(tree: bpy.types.NodeTree) -> bpy.types.NodeTreeInterface:
    """Return the interface of a group, which is its inputs and outputs."""
    assert tree.interface is not None
    return tree.interface


def new_socket(
    tree: bpy.types.NodeTree,
    name: str,
    kind: str,
    *,
    output: bool,
    panel: bpy.types.NodeTreeInterfacePanel | None = None,
) -> bpy.types.NodeTreeInterfaceSocket:
    """Add an input or output to a group. kind: Blender's name, such as NodeSocketColor."""
    return interface(tree).new_socket(
        name,
        in_out="OUTPUT" if output else "INPUT",
        socket_type=kind,  # pyright: ignore[reportArgumentType]  the stubs know no kind but DEFAULT
        parent=panel,
    )


def set_value(socket: bpy.types.NodeSocket, value: Any) -> None:
    """Set the value of an unlinked socket."""
    socket.default_value = value  # pyright: ignore[reportAttributeAccessIssue]  each subclass has it, of its own type


def get_value(socket: bpy.types.NodeSocket) -> Any:
    """Return the value of an unlinked socket."""
    return socket.default_value  # pyright: ignore[reportAttributeAccessIssue]  each subclass has it, of its own type


def camera_of(item: bpy.types.Object | None) -> bpy.types.Camera:
    """Return the lens and sensor of a camera object."""
    assert item is not None
    assert isinstance(item.data, bpy.types.Camera)
    return item.data


def mesh_of(item: bpy.types.Object) -> bpy.types.Mesh:
    """Return the vertices and faces of a mesh object."""
    assert isinstance(item.data, bpy.types.Mesh)
    return item.data


def action_of(item: bpy.types.ID) -> bpy.types.Action:
    """Return the action (the keyframes) of an object or a node group that has one."""
    data = item.animation_data  # pyright: ignore[reportAttributeAccessIssue]  each subclass that is animated has it
    assert data is not None
    assert data.action is not None
    return data.action


def new_action(item: bpy.types.ID, name: str) -> bpy.types.Action:
    """Give an object or a node group a new action for its keyframes."""
    data = item.animation_data_create()
    assert data is not None
    action = bpy.data.actions.new(name)
    data.action = action
    return action


def emptied_action(item: bpy.types.ID, name: str) -> bpy.types.Action:
    """Return the action of an object or a node group without its keyframes, drivers and strips; a new one if it has
    none, or one that others use, too.

    An action is emptied rather than replaced since Blender keeps, on undo, what looks the same in two steps: what had
    been given another action in between would point to one that is gone, and Blender would crash.
    """
    data = item.animation_data  # pyright: ignore[reportAttributeAccessIssue]  each subclass that is animated has it
    action = None if data is None else data.action
    item.animation_data_clear()
    if action is None or action.users > 0 or action.library is not None:
        return new_action(item, name)
    for parts in (action.layers, action.slots):
        while parts:
            parts.remove(parts[0])
    data = item.animation_data_create()
    assert data is not None
    data.action = action
    return action


def fcurves_of(data: bpy.types.AnimData) -> list[bpy.types.FCurve]:
    """Return the curves that animate what this data belongs to; other users of its action are left out."""
    return curves_in(data.action, data.action_slot)


def curves_in(action: bpy.types.Action | None, slot: bpy.types.ActionSlot | None) -> list[bpy.types.FCurve]:
    """Return the curves of one user of an action; none where there is none."""
    if action is None or slot is None:
        return []
    strips = (strip for layer in action.layers for strip in layer.strips)
    bags = (strip.channelbag(slot) for strip in strips if isinstance(strip, bpy.types.ActionKeyframeStrip))
    return [curve for bag in bags if bag is not None for curve in bag.fcurves]


def interpolation(name: str) -> int:
    """Return the number that a keyframe's interpolation has in arrays: LINEAR, CONSTANT."""
    known = bpy.types.Keyframe.bl_rna.properties["interpolation"]
    assert isinstance(known, bpy.types.EnumProperty)
    return known.enum_items[name].value


def cycles(item: bpy.types.Scene | bpy.types.Material | bpy.types.World) -> Any:
    """Return Cycles' properties of a scene, a material or a world; Cycles is an add-on without stubs."""
    return item.cycles


def use_as_data(image: bpy.types.Image) -> None:
    """Make Blender use an image's values as they are, without colour management."""
    assert image.colorspace_settings is not None
    name: Any = "Non-Color"  # the names come from the OpenColorIO configuration
    image.colorspace_settings.name = name


def set_pixels(image: bpy.types.Image, rgba: NDArray[np.float32]) -> None:
    """Set all values of an image from (H, W, 4) float32, bottom row first."""
    image.pixels.foreach_set(rgba.ravel())  # pyright: ignore[reportArgumentType]  any buffer will do
    image.update()


def size_px(image: bpy.types.Image) -> tuple[int, int]:
    """Return an image's width and height."""
    wide, high = image.size  # pyright: ignore[reportGeneralTypeIssues]  an array of two can be unpacked
    return wide, high


def layout_of(item: bpy.types.Panel | bpy.types.Menu | bpy.types.Header | bpy.types.Operator) -> bpy.types.UILayout:
    """Return the layout that a panel, a menu or a header draws into."""
    assert item.layout is not None
    return item.layout


def override_scene(scene: bpy.types.Scene) -> AbstractContextManager[object]:
    """Let operators that are called inside the `with` work on a scene and its first view layer.

    Never the scene alone: Blender would pair it with the view layer of the context, which a script may have overridden
    by one of another scene, and rendering would end the whole process.
    """
    return override(scene=scene, view_layer=scene.view_layers[0])


def override(**members: Any) -> AbstractContextManager[object]:
    """Override members of the context for operators that are called inside the `with`."""
    return bpy.context.temp_override(**members)  # pyright: ignore[reportReturnType]  the stubs lack __enter__, __exit__


def linking(path: str) -> AbstractContextManager[tuple[Any, Any]]:
    """Open a file to link from: what is in it, and what is wanted, which is linked when the `with` ends."""
    return bpy.data.libraries.load(path, link=True)  # pyright: ignore[reportReturnType]  the stubs say None


# Float images that are handed to Blender, and those that it writes into scratch files, read back as arrays.


def float_image(name: str, size_px: tuple[int, int]) -> bpy.types.Image:
    """Add an image of floats without colour management to the file. size_px: width, height."""
    image = bpy.data.images.new(name, *size_px, alpha=False, float_buffer=True)
    use_as_data(image)
    return image


def image_node(tree: bpy.types.NodeTree, image: bpy.types.Image) -> bpy.types.Node:
    """Add a node that gives an image."""
    node = new_node(tree, bpy.types.CompositorNodeImage)
    node.image = image
    return node


def write_plain_floats(file_format: bpy.types.ImageFormatSettings) -> None:
    """Make Blender write float values as they are, layer by layer, without colour management or compression."""
    file_format.media_type = "MULTI_LAYER_IMAGE"
    file_format.file_format = "OPEN_EXR_MULTILAYER"
    file_format.color_depth = "32"
    file_format.exr_codec = "NONE"
    file_format.use_exr_interleave = True


def read_rows(path: Path, size_px: tuple[int, int], channels: int) -> NDArray[np.float32]:
    """Read an uncompressed float EXR of so many channels as (H, channels, W), the channels in their names' order.

    size_px: width, height. The end of such a file is a row after the other, each with its number and its length before
    it (OpenEXR File Layout, "Regular scan line"), so what stands before needs no reading; it takes a tenth of the time
    that OpenEXR takes. Raises StorageError where the file is not of this form, as one that is cut short.
    """
    width, height = size_px
    row = np.dtype([("number", "<i4"), ("bytes", "<i4"), ("values", "<f4", (channels, width))])
    with open_regular(path) as file:
        before = os.fstat(file.fileno()).st_size - row.itemsize * height
        rows: NDArray[Any] = np.fromfile(file, row, offset=max(before, 0))
    if len(rows) != height or (rows["number"] != np.arange(height)).any() or (rows["bytes"] != row.itemsize - 8).any():
        raise StorageError("Blender's scratch file is cut short or damaged", file=path)
    return rows["values"]


@contextlib.contextmanager
def muted_output() -> Iterator[None]:
    """Hide the lines that Blender and its GL print for each frame.

    They are printed by C code, so the file descriptors are redirected; code that prints meanwhile needs copies of them.
    """
    saved = [(descriptor, os.dup(descriptor)) for descriptor in (1, 2)]
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        for descriptor, _ in saved:
            os.dup2(null, descriptor)
        yield
    finally:
        for descriptor, copy in saved:
            os.dup2(copy, descriptor)
            os.close(copy)
        os.close(null)
