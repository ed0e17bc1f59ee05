# SPDX-License-Identifier: GPL-3.0-or-later
"""Node groups out of descriptions: whole or not at all, found again, read from left to right; nothing is left over."""

from dataclasses import fields

import bpy
import numpy as np
import pytest
from cases import cases
from group_tools import keep_group

from noisy_world.blender.nodes import STAMP, ensure_group, ensure_picture, remove_group
from noisy_world.core.labels import american
from noisy_world.core.node_graphs.graph import Graph, GroupInput, Picture
from noisy_world.core.node_graphs.groups import build_group, socket_name
from noisy_world.core.perturbing.kinds import ColourPerturbation
from noisy_world.perturbations import registry

NAMES = [item.name for item in registry().values() if isinstance(item, ColourPerturbation)]
IMAGE = GroupInput("Image", "color", (0.5, 0.5, 0.5, 1.0), "What comes in")


def tinted(amount=0.5, name="Test"):
    """A small group: the image times a number."""
    graph = Graph(name, "A tint")
    image = graph.input(IMAGE)
    factor = graph.input(GroupInput("Factor", "float", amount, "How much", 0.0, 1.0, "FACTOR"))
    with graph.section("Tint"):
        graph.output("Image", image * factor)
    return graph


def stock():
    """How many of each kind of data the file holds."""
    return {name: len(getattr(bpy.data, name)) for name in ("node_groups", "images", "scenes", "actions", "materials")}


@pytest.fixture
def empty():
    bpy.ops.wm.read_factory_settings(use_empty=True)


@pytest.fixture(scope="module")
def trees():
    """Every perturbation's group, in the file as long as no test empties it."""
    for name in NAMES:
        keep_group(name)
    return {name: ensure_group(build_group(registry()[name])) for name in NAMES}


def test_every_perturbation_of_colour_has_a_group():
    assert len(NAMES) >= 18
    assert [name for name in NAMES if registry()[name].build is None] == []


@cases("name", NAMES)
def test_sockets_say_what_the_parameters_say(trees, name):
    perturbation, tree = registry()[name], trees[name]
    sockets = [item for item in tree.interface.items_tree if item.item_type == "SOCKET"]
    items = {item.name: item for item in sockets if item.in_out == "INPUT"}
    for field in fields(perturbation.parameters):
        info, socket = field.metadata["key"], items[socket_name(field.name)]
        assert socket.description.lower() == american(info.meaning).lower()
        degrees = np.pi / 180 if info.unit == "deg" else 1
        assert socket.default_value == pytest.approx(field.default * degrees)
        if info.unit in ("px", "deg", "m"):
            assert socket.subtype == {"px": "PIXEL", "deg": "ANGLE", "m": "DISTANCE"}[info.unit]
        if socket.bl_socket_idname != "NodeSocketBool":
            low = info.minimum if info.above is None else info.above
            assert socket.min_value == pytest.approx(low * degrees)
            largest = max([*perturbation.severities.get(field.name, ()), field.default]) * degrees
            assert largest * (1 - 1e-6) <= socket.max_value <= info.maximum * degrees * (1 + 1e-6)
    assert all(item.description for item in items.values())
    assert tree.description
    assert ({"Seed", "Frame Offset"} <= set(items)) == bool(perturbation.temporals)
    assert ("Pattern" in items) == (len(perturbation.temporals) > 1)
    if "Pattern" in items:
        assert items["Pattern"].default_value == ("Drift" if "drift" in perturbation.temporals else "Fresh")
    assert ("Depth" in items) == perturbation.needs_depth


@cases("name", NAMES)
def test_a_group_is_read_from_left_to_right(trees, name):
    tree = trees[name]
    place = {node.name: node.location_absolute for node in tree.nodes}
    assert all(link.is_valid for link in tree.links)
    for link in tree.links:
        assert place[link.from_node.name].x < place[link.to_node.name].x, (link.from_node.name, link.to_node.name)
    frames = [node for node in tree.nodes if node.bl_idname == "NodeFrame"]
    assert len(frames) >= 3
    assert all(frame.label for frame in frames)
    loose = [node for node in tree.nodes if node.parent is None and node.bl_idname not in ("NodeFrame",)]
    assert [node.bl_idname for node in loose] == ["NodeGroupOutput"]


def test_building_again_saving_and_reloading_change_nothing_and_removing_leaves_nothing(empty, tmp_path):
    def build():
        return [ensure_group(build_group(registry()[name])) for name in NAMES]

    nothing = stock()
    trees = build()
    for tree in trees:
        tree.use_fake_user = True
    before = stock()
    nodes = {tree.name: sorted(node.name for node in tree.nodes) for tree in bpy.data.node_groups}
    assert build() == trees
    assert stock() == before
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "groups.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "groups.blend"))
    trees = build()
    assert stock() == before
    assert {tree.name: sorted(node.name for node in tree.nodes) for tree in bpy.data.node_groups} == nodes
    for tree in trees:
        remove_group(tree)
    assert stock() == nothing


def test_another_definition_takes_the_old_one_s_place(empty):
    old = ensure_group(tinted(0.5))
    user = bpy.data.node_groups.new("User", "CompositorNodeTree")
    node = user.nodes.new("CompositorNodeGroup")
    node.node_tree = old
    new = ensure_group(tinted(0.25))
    assert node.node_tree == new
    assert new.name == "Test"
    assert [tree.name for tree in bpy.data.node_groups] == ["Test", "User"]
    assert new[STAMP] == tinted(0.25).stamp != tinted(0.5).stamp


def test_a_group_of_another_file_is_left_alone(empty, tmp_path):
    ensure_group(tinted(0.5)).use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (source, target):
        target.node_groups = list(source.node_groups)
    (linked,) = bpy.data.node_groups
    own = ensure_group(tinted(0.25))
    assert linked.library is not None
    assert linked[STAMP] == tinted(0.5).stamp
    assert own != linked


@cases("fault", ["node", "socket", "property", "picture", "inner"])
def test_a_failed_build_leaves_nothing(empty, fault):
    inner = Graph("Inner", "Inside")
    inner.output("Image", inner.input(IMAGE) * 2.0)

    def no_picture():
        raise OSError("the picture cannot be read")

    graph = Graph("Broken", "Fails")
    image = graph.input(IMAGE)
    result = graph.group(inner, {"Image": image}).out("Image", "color")
    good = Picture("good", "1", lambda: np.zeros((4, 4), np.uint8))
    result = result + graph.picture(good)
    made = {
        "node": lambda: graph.node("CompositorNodeNoSuchThing", {"Image": result}),
        "socket": lambda: graph.node("CompositorNodeBlur", {"Picture": result}),
        "property": lambda: graph.node("ShaderNodeMath", {"Value": result}, {"operation": "GUESS"}),
        "picture": lambda: graph.node("CompositorNodeImage", {}, picture=Picture("bad", "1", no_picture)),
        "inner": lambda: graph.group(inner, {"Imago": result}),
    }[fault]()
    graph.output("Image", made.out("Image", "color"))
    before = stock()
    with pytest.raises((RuntimeError, KeyError, TypeError, OSError)):
        ensure_group(graph)
    assert stock() == before


def test_a_picture_is_packed_upright_and_exact(empty):
    values = np.arange(6 * 4 * 3, dtype=np.uint8).reshape(6, 4, 3)
    image = ensure_picture(Picture("picture", "1", lambda: values))
    assert image.packed_file is not None
    assert ensure_picture(Picture("picture", "1", lambda: 1 / 0)) == image
    pixels = np.array(image.pixels[:]).reshape(6, 4, 4)[::-1, :, :3]
    assert np.abs(pixels * 255 - values).max() < 1e-4
    other = ensure_picture(Picture("picture", "2", lambda: values + 1))
    assert [item.name for item in bpy.data.images] == ["picture"]
    assert other.pixels[0] != 0
