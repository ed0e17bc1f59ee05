# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups of the compositor's Add menu: where one is put, and what it is linked to."""

import pytest
from refusals import refused

bpy = pytest.importorskip("bpy", reason="bpy is not installed")

from noisy_world.core.errors import NoisyWorldError
from noisy_world.panel import add_menu
from noisy_world.panel.add_menu import add_group

pytestmark = pytest.mark.usefixtures("add_on")


@pytest.fixture
def tree():
    """The scene's compositor as New makes it, but for the viewer: the render leads to the output."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    layers, end = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("NodeGroupOutput")
    end.location.x = 300
    tree.links.new(layers.outputs["Image"], end.inputs["Image"])
    bpy.context.scene.compositing_node_group = tree
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_percentage = 800, 50
    bpy.context.view_layer.use_pass_z = False
    for node in tree.nodes:
        node.select = False
    return tree


def chain(tree):
    """The names of the nodes from the render to the output, along the images."""
    (end,) = (node for node in tree.nodes if node.bl_idname == "NodeGroupOutput")
    found, socket = [], end.inputs["Image"]
    while socket.links:
        node = socket.links[0].from_node
        found.append(node.node_tree.name if node.bl_idname == "CompositorNodeGroup" else node.bl_idname)
        socket = node.inputs.get("Image") or next(iter(node.inputs), None)
        if socket is None:
            break
    return found[::-1]


def deselect(tree):
    for node in tree.nodes:
        node.select = False


def test_groups_are_put_in_the_order_of_propagation_and_given_the_render_s_depth(tree):
    scene = bpy.context.scene
    assert add_group(tree, scene, "gaussian_noise") == "Gaussian Noise is added"
    deselect(tree)
    assert "renders Depth for it from now on" in add_group(tree, scene, "fog_depth")
    assert chain(tree) == ["CompositorNodeRLayers", "Fog by Depth", "Gaussian Noise"]
    fog = tree.nodes.active
    assert [node for node in tree.nodes if node.select] == [fog]
    assert (fog.inputs["Depth"].links[0].from_socket.name, bpy.context.view_layer.use_pass_z) == ("Depth", True)
    assert fog.inputs["Reference Width"].default_value == 400
    places = [node.location.x for node in (tree.nodes["Render Layers"], fog, tree.nodes["Group"])]
    assert places == sorted(places)
    assert add_group(tree, scene, "lens_dirt") == "Lens Dirt is added"  # after the one that is active
    deselect(tree)
    assert add_group(tree, scene, "fog_depth") == "Fog by Depth is added"
    assert chain(tree) == ["CompositorNodeRLayers", "Fog by Depth", "Fog by Depth", "Lens Dirt", "Gaussian Noise"]


def test_after_the_active_node_all_that_it_fed_is_fed_by_the_group(tree):
    glare = tree.nodes.new("CompositorNodeGlare")
    layers = tree.nodes["Render Layers"]
    tree.links.new(layers.outputs["Image"], glare.inputs["Image"])
    layers.select, tree.nodes.active = True, layers
    add_group(tree, bpy.context.scene, "vignetting")
    group = tree.nodes.active
    assert {link.to_node for link in group.outputs["Image"].links} == {glare, tree.nodes["Group Output"]}
    assert [link.to_node for link in layers.outputs["Image"].links] == [group]


def test_what_cannot_be_linked_is_said(tree):
    layers = tree.nodes["Render Layers"]
    tree.nodes.remove(layers)
    said = add_group(tree, bpy.context.scene, "fog_depth")
    assert said == "Fog by Depth is added; nothing gives it an image yet; link the Depth of Render Layers to it"
    refused(add_group, tree, bpy.context.scene, "desync", names="no node group", error=NoisyWorldError)
    refused(bpy.ops.noisy_world.add_group, perturbation="fog", names="poll", error=RuntimeError)
    tree.nodes.clear()
    assert "nothing gives" in add_group(tree, bpy.context.scene, "fog")


def test_the_menu_has_every_group_and_says_what_each_does():
    assert len(add_menu.grouped()) > 30
    for item in add_menu.grouped():
        shown = type("Properties", (), {"perturbation": item.name})
        assert len(add_menu.NoisyWorldAddGroup.description(bpy.context, shown)) > 15
