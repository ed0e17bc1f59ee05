# SPDX-License-Identifier: GPL-3.0-or-later
"""The compositor of the street's scene: groups behind the render, as an artist would have dragged them in."""

from collections.abc import Mapping
from dataclasses import dataclass

import bpy

from noisy_world.blender.nodes import ensure_group
from noisy_world.blender.typed import new_node, new_socket, new_tree, set_value
from noisy_world.core.node_graphs.groups import build_group
from noisy_world.core.perturbing.kinds import ColourPerturbation
from noisy_world.perturbations import registry

NODE_WIDTH, NODE_GAP = 230, 60
TOP = 200  # of the nodes, so that a node editor shows them as it opens


@dataclass(frozen=True)
class Link:
    """A group of the chain. values: of its sockets, where they are other than the group's own."""

    perturbation: str
    values: Mapping[str, float | bool]


# Chosen by eye for this scene: a winter's evening, the cafe's board in focus.
CHAIN = (
    Link("fog_depth", {"Visibility": 90.0, "Airlight": 0.42}),
    Link("snow_depth", {"Rate": 2.0, "Redraw": False, "Drift": True, "Frame Rate": 24.0}),
    Link("defocus_depth", {"Focus": 5.0, "F-Stop": 1.2, "Focal Length": 31.0}),
    Link("gaussian_noise", {"Std": 0.03}),
)


def add_chain(scene: bpy.types.Scene, chain: tuple[Link, ...] = CHAIN) -> bpy.types.NodeTree:
    """Make the scene's compositing a chain of groups behind its render; return it."""
    tree = new_tree("Street")
    new_socket(tree, "Image", "NodeSocketColor", output=True)
    layers = new_node(tree, bpy.types.CompositorNodeRLayers)
    layers.scene = scene
    pitch = NODE_WIDTH + NODE_GAP
    left = -pitch * (len(chain) + 1) / 2
    layers.location = (left - NODE_GAP, TOP)
    last = layers.outputs["Image"]
    for place, link in enumerate(chain):
        node = _group(tree, link)
        node.location = (left + (place + 1) * pitch, TOP)
        set_value(node.inputs["Reference Width"], scene.render.resolution_x)
        set_value(node.inputs["Seed"], place + 1) if "Seed" in node.inputs else None
        tree.links.new(last, node.inputs["Image"])
        if "Depth" in node.inputs:
            tree.links.new(layers.outputs["Depth"], node.inputs["Depth"])
        last = node.outputs["Image"]
    end = tree.nodes.new("NodeGroupOutput")
    end.location = (left + (len(chain) + 1) * pitch, TOP)
    tree.links.new(last, end.inputs["Image"])
    for node in tree.nodes:
        node.select = False
    scene.compositing_node_group = tree
    scene.render.use_compositing = True
    return tree


def _group(tree: bpy.types.NodeTree, link: Link) -> bpy.types.CompositorNodeGroup:
    perturbation = registry()[link.perturbation]
    assert isinstance(perturbation, ColourPerturbation)
    node = new_node(tree, bpy.types.CompositorNodeGroup)
    node.node_tree = ensure_group(build_group(perturbation))
    node.name = node.label = perturbation.label
    node.width = NODE_WIDTH
    for name, value in link.values.items():
        set_value(node.inputs[name], value)
    return node
