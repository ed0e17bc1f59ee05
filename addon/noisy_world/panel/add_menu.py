# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups in the compositor's Add menu: one is added where it belongs, linked to image, depth and output."""

from collections.abc import Iterator
from typing import Any

import bpy

from ..core.errors import NoisyWorldError, american
from ..nodes.datablocks import inputs, layout_of, new_node, outputs, set_value
from ..nodes.node_trees import described_as, ensure_group
from ..perturbations import registry
from ..perturbations.groups import DEPTH_INPUT, IMAGE_INPUT, REFERENCE_INPUT, build_group, group_name
from ..perturbations.kinds import COLOUR_STAGES, ColourPerturbation, propagation_key
from .operators import UNDOABLE, guarded
from .sections import STAGE_LABELS

TREE = "CompositorNodeTree"
APART = 60  # between two nodes; chosen


def grouped() -> list[ColourPerturbation]:
    """Return the perturbations that have a node group, in the order of propagation."""
    found = (item for item in registry().values() if isinstance(item, ColourPerturbation))
    return sorted((item for item in found if item.nodes is not None), key=propagation_key)


def edited_tree(context: bpy.types.Context) -> bpy.types.CompositorNodeTree | None:
    """Return the compositor's nodes that the editor shows; None where it shows none."""
    tree = getattr(context.space_data, "edit_tree", None)
    return tree if isinstance(tree, bpy.types.CompositorNodeTree) else None


def add_group(tree: bpy.types.CompositorNodeTree, scene: bpy.types.Scene, name: str) -> str:
    """Add a perturbation's group to a compositor, linked up; return what there is to say.

    After the node that is active and selected, where that gives an image; else before the output, in the order of
    propagation among our groups. Its reference width is the scene's. Where it takes depth, it is given that of the
    render, whose pass is switched on.
    """
    perturbation = registry().get(name)
    if not isinstance(perturbation, ColourPerturbation) or perturbation.nodes is None:
        raise NoisyWorldError(f"{name} has no node group")
    after = _given_after(tree, perturbation)
    group = new_node(tree, bpy.types.CompositorNodeGroup)
    group.node_tree = ensure_group(build_group(perturbation))
    group.width = group.node_tree.default_group_node_width
    set_value(group.inputs[REFERENCE_INPUT.name], scene.render.resolution_x * scene.render.resolution_percentage // 100)
    said = "" if after is not None else "; nothing gives it an image yet"
    if after is not None:
        _insert(tree, group, after)
    if DEPTH_INPUT.name in group.inputs:
        said += _link_depth(tree, scene, group)
    for node in tree.nodes:
        node.select = node == group
    tree.nodes.active = group
    return f"{group_name(perturbation)} is added{said}"


def _given_after(
    tree: bpy.types.CompositorNodeTree, perturbation: ColourPerturbation
) -> tuple[bpy.types.NodeSocket, list[bpy.types.NodeSocket]] | None:
    """Return what gives the new group its image, and what is to take the group's; None where nothing does."""
    active = tree.nodes.active
    if active is not None and active.select and (given := _image(outputs(active))) is not None:
        return given, [link.to_socket for link in given.links or () if link.to_socket is not None]
    ends = [node for node in tree.nodes if isinstance(node, bpy.types.NodeGroupOutput)]
    taken = next((socket for node in ends if (socket := _image(node.inputs)) is not None), None)
    if taken is None:
        return None
    order = {group_name(item): propagation_key(item) for item in grouped()}
    while (given := _source_of(taken)) is not None and isinstance(given.node, bpy.types.CompositorNodeGroup):
        other = given.node
        place = None if other.node_tree is None else order.get(described_as(other.node_tree))
        if place is None or place <= propagation_key(perturbation):
            break
        taken = other.inputs[IMAGE_INPUT.name]
    if given is None:
        layers = next(_layers(tree), None)
        given = None if layers is None else _image(outputs(layers))
    return None if given is None else (given, [taken])


def _image(sockets: Any) -> bpy.types.NodeSocket | None:
    """Return the first of a node's sockets that is an image and is shown."""
    return next((socket for socket in sockets if socket.type == "RGBA" and socket.enabled), None)


def _source_of(socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
    links = socket.links
    return links[0].from_socket if links else None


def _insert(
    tree: bpy.types.CompositorNodeTree,
    group: bpy.types.CompositorNodeGroup,
    after: tuple[bpy.types.NodeSocket, list[bpy.types.NodeSocket]],
) -> None:
    """Link the group behind what gives an image, and before what took it; what stands there makes room."""
    given, taken = after
    before = given.node
    assert before is not None
    group.parent = before.parent
    group.location = (before.location.x + before.width + APART, before.location.y)
    room = group.width + APART
    for node in [socket.node for socket in taken]:
        if node is not None and node.location.x < group.location.x + room:
            _move_on(tree, node, room)
    tree.links.new(given, group.inputs[IMAGE_INPUT.name])
    for socket in taken:
        tree.links.new(outputs(group)[IMAGE_INPUT.name], socket)


def _move_on(tree: bpy.types.CompositorNodeTree, first: bpy.types.Node, by: float) -> None:
    """Move a node, and all that stand at its right."""
    left = first.location.x
    for node in tree.nodes:
        if node.location.x >= left and not isinstance(node, bpy.types.NodeFrame):
            node.location.x += by


def _layers(tree: bpy.types.CompositorNodeTree) -> Iterator[bpy.types.CompositorNodeRLayers]:
    yield from (node for node in tree.nodes if isinstance(node, bpy.types.CompositorNodeRLayers))


def _link_depth(
    tree: bpy.types.CompositorNodeTree, scene: bpy.types.Scene, group: bpy.types.CompositorNodeGroup
) -> str:
    """Give a group the render's depth; return what there is to say."""
    found = list(_layers(tree))
    layers = next((node for node in found if node.scene == scene), found[0] if found else None)
    if layers is None or layers.scene is None:
        return "; link the Depth of Render Layers to it"
    layer = layers.scene.view_layers.get(layers.layer)
    said = ""
    if layer is not None and not layer.use_pass_z:
        layer.use_pass_z = True
        said = f"; {layer.name} renders Depth for it from now on"
    tree.links.new(outputs(layers)["Depth"], inputs(group)[DEPTH_INPUT.name])
    return said


class NoisyWorldAddGroup(bpy.types.Operator):
    """Add the node group of a perturbation, linked up: after the active node, or before the output"""

    bl_idname = "noisy_world.add_group"
    bl_label = "Add Perturbation"
    bl_options = UNDOABLE

    perturbation: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})  # pyright: ignore[reportInvalidTypeForm]  Blender reads annotations

    @classmethod
    def description(cls, _: bpy.types.Context, properties: Any) -> str:
        """Say what the group does."""
        known = registry().get(properties.perturbation)
        return cls.__doc__ or "" if known is None else american(known.sentence)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Ask for a compositor's nodes."""
        if edited_tree(context) is not None:
            return True
        cls.poll_message_set("The editor shows no compositing nodes: press New in its header")
        return False

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add it."""

        def work() -> str:
            tree = edited_tree(context)
            assert tree is not None, "poll"
            return add_group(tree, context.scene, self.perturbation)

        return guarded(self, work)


class NOISYWORLD_MT_add_group(bpy.types.Menu):
    """The perturbations' node groups, in the order of propagation"""

    bl_label = "Noisy World"

    def draw(self, _: bpy.types.Context) -> None:
        """Draw an entry for each, below its stage."""
        row = layout_of(self).row()
        for stage in COLOUR_STAGES:
            column = row.column()
            label, icon = STAGE_LABELS[stage]
            column.label(text=label, icon=icon)
            for item in grouped():
                if item.stage == stage:
                    button: Any = column.operator(NoisyWorldAddGroup.bl_idname, text=group_name(item))
                    button.perturbation = item.name


def _draw_in_add(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    space = context.space_data
    if isinstance(space, bpy.types.SpaceNodeEditor) and space.tree_type == TREE:
        layout = layout_of(menu)
        layout.separator()
        layout.menu("NOISYWORLD_MT_add_group", icon="OUTLINER_OB_FORCE_FIELD")


_DRAWS: Any = _draw_in_add  # the stubs give such functions no menu
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (NoisyWorldAddGroup, NOISYWORLD_MT_add_group)
)


def register() -> None:
    """Register the menu."""
    _register_classes()
    bpy.types.NODE_MT_add.append(_DRAWS)  # looked up anew: reloading scripts makes another class of it


def unregister() -> None:
    """Unregister it."""
    bpy.types.NODE_MT_add.remove(_DRAWS)
    _unregister_classes()
