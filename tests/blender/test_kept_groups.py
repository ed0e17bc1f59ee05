# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups that were built before are read from files: the same groups, and built where a file cannot be used."""

import os
import resource
import signal

import bpy
import numpy as np
import pytest
from group_tools import by_groups, picture

from noisy_world.nodes import node_trees
from noisy_world.nodes.node_trees import ensure_group, remove_group
from noisy_world.core.node_graph import BroughtImage, Graph, GroupInput, Panel
from noisy_world.perturbations.groups import REFERENCE_INPUT

IMAGE = GroupInput("Image", "color", (0.5, 0.5, 0.5, 1.0), "What comes in")
TINT = np.linspace(0, 255, 24 * 40 * 3).reshape(24, 40, 3).astype(np.uint8)
FILED = "ice.png"
VALUES = ("Factor", "Use", "Kind", "Reference Width")
SHOWN = ("item_type", "name", "description", "identifier", "default_value", "min_value", "max_value", "subtype",
         "is_panel_toggle", "default_closed", "in_out")  # fmt: skip


def child(name="Child", times=2.0):
    graph = Graph(name, "Inside")
    graph.output("Image", graph.input(IMAGE) * times)
    return graph


def large(folder, times=2.0):
    """A group that is worth a file, with groups inside groups and both kinds of images."""
    import cv2

    cv2.imwrite(str(folder / FILED), TINT)
    parent = Graph("Parent", "Around it")
    inner = parent.group(child(times=times), {"Image": parent.input(IMAGE)})
    parent.output("Image", inner.out("Image", "color") + 0.125)
    graph = Graph("Large", "Many nodes", tags=("a",))
    value = graph.input(IMAGE)
    graph.input(REFERENCE_INPUT)
    factor = graph.input(GroupInput("Factor", "float", 0.5, "How much", 0.0, 1.0, "FACTOR"))
    options = Panel("Options", "What can be chosen", closed=True)
    use = graph.input(GroupInput("Use", "bool", True, "Whether", panel=options, toggles=True))
    menu = graph.input(GroupInput("Kind", "menu", "More", "Which", panel=options, items=("Less", "More", "Most")))
    where = graph.input(GroupInput("Where", "vector", (0.0, 0.25, 0.5), "Where it is", panel=options))
    with graph.section("Choice"):
        less, more, _ = graph.chosen(menu)
        value = graph.choose(use, value + where * more + less, value)
    with graph.section("Chain"):
        for number in range(node_trees.LEAST_NODES):
            value = value * (1.0 + 0.01 * number) + 0.001
        value = value * factor * 0.25
    with graph.section("Groups"):
        for group in (child(times=times), parent):
            value = value + graph.group(group, {"Image": value}).out("Image", "color") * 0.125
    with graph.section("Images"):
        value = value + graph.picture(BroughtImage("made", "1", lambda: TINT)) * 0.25
        value = value + graph.picture(BroughtImage("filed", "1", lambda: folder / FILED)) * 0.25
    graph.output("Image", value)
    return graph


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache, an empty file, and no shipped library."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(node_trees, "SHELF", tmp_path / "none.blend")
    node_trees._shelf.cache_clear()
    yield tmp_path / "cache" / "noisy-world" / "groups"
    node_trees._shelf.cache_clear()


@pytest.fixture
def built(monkeypatch):
    """The names of the groups that are built."""
    names, build = [], node_trees._build
    monkeypatch.setattr(node_trees, "_build", lambda graph: names.append(graph.name) or build(graph))
    return names


def emptied():
    bpy.ops.wm.read_factory_settings(use_empty=True)


def described():
    """All that can be told of the groups and images of the file."""
    found = {}
    for tree in bpy.data.node_groups:
        sockets = [socket for node in tree.nodes for socket in (*node.inputs, *node.outputs)]
        values = [repr(item.default_value) for item in sockets if item.type == "VALUE"]
        used = [
            getattr(node, name).name for node in tree.nodes for name in ("node_tree", "image") if hasattr(node, name)
        ]
        links = [(link.from_node.name, link.from_socket.identifier, link.to_socket.identifier) for link in tree.links]
        found[tree.name] = (
            [(node.name, node.label, node.bl_idname, tuple(node.location)) for node in tree.nodes],
            [(socket.node.name, socket.identifier, socket.hide) for socket in sockets],
            [
                [repr(getattr(item, name, None)) for name in SHOWN if name != "default_value" or item.name in VALUES]
                for item in tree.interface.items_tree
            ],
            [tuple(item.default_value) for item in tree.interface.items_tree if "Where" in item.name],
            [values, used, links, tree.users, tree.use_fake_user, dict(tree.items())],
        )
    for image in bpy.data.images:
        sizes = image.packed_file.size, np.array(image.pixels[:]).sum()
        found[f"image {image.name}"] = image.filepath, image.users, sizes, dict(image.items())
    return found


def test_what_is_read_is_what_was_built(cache, built, tmp_path):
    rgb = picture(24, 40)
    ensure_group(large(tmp_path)).use_fake_user = True
    first = described()
    wanted = by_groups({"a": (large(tmp_path), {})}, rgb, tmp_path)["a"]
    assert built == ["Large", "Child", "Parent"]
    emptied()
    tree = ensure_group(large(tmp_path))
    tree.use_fake_user = True
    assert built == ["Large", "Child", "Parent"]
    assert described() == first
    assert np.array_equal(by_groups({"a": (large(tmp_path), {})}, rgb, tmp_path)["a"], wanted)
    # Nothing tells where it was: the user's file holds no path of this machine, and is linked to nothing.
    assert not bpy.data.libraries
    assert all(item.library_weak_reference is None for item in (*bpy.data.node_groups, *bpy.data.images))
    assert {image.filepath for image in bpy.data.images} <= {"", f"//{FILED}"}
    tree.use_fake_user = False
    remove_group(tree)
    left = {item.name for item in (*bpy.data.node_groups, *bpy.data.images)}
    assert left <= {"By groups", "By groups.001", "Render Result"}


def test_the_shipped_library_is_opened_once_for_all_groups_of_a_chain(cache, built, monkeypatch, tmp_path):
    parts = [child("One"), child("Two", 3.0), large(tmp_path)]
    chain = Graph("Chain", "All of them")
    value = chain.input(IMAGE)
    for part in parts:
        value = chain.group(part, {"Image": value}).out("Image", "color")
    chain.output("Image", value)
    for part in parts:
        ensure_group(part).use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(node_trees.SHELF), copy=True)
    index = node_trees.index_of(node_trees.SHELF, {part.name: part for part in parts})
    node_trees.SHELF.with_suffix(".json").write_text(index)
    node_trees._shelf.cache_clear()
    emptied()
    built.clear()
    older = ensure_group(child("Two"))
    opened, linking = [], node_trees.linking
    monkeypatch.setattr(node_trees, "linking", lambda path: opened.append(path) or linking(path))
    tree = ensure_group(chain)
    assert (built, opened) == (["Two", "Chain"], [str(node_trees.SHELF)])
    used = [node.node_tree.name for node in tree.nodes if node.bl_idname == "CompositorNodeGroup"]
    assert used == ["One", "Two", "Large"]
    assert older not in set(bpy.data.node_groups)
    assert not bpy.data.libraries
    assert ensure_group(chain) == tree


def test_what_the_file_has_of_it_stays_and_what_is_older_is_replaced(cache, built, tmp_path):
    ensure_group(large(tmp_path))
    emptied()
    same, older = ensure_group(child()), ensure_group(child("Parent"))
    theirs = bpy.data.node_groups.new("Large", "CompositorNodeTree")
    user = bpy.data.node_groups.new("User", "CompositorNodeTree").nodes.new("CompositorNodeGroup")
    user.node_tree = older
    tree = ensure_group(large(tmp_path))
    assert tree.name == "Large.001"
    assert theirs.name == "Large"
    inside = [node.node_tree for node in tree.nodes if node.bl_idname == "CompositorNodeGroup"]
    assert inside[0] == same
    assert user.node_tree == inside[1]
    assert sorted(item.name for item in bpy.data.node_groups) == ["Child", "Large", "Large.001", "Parent", "User"]
    assert ensure_group(large(tmp_path)) == tree
    built.clear()
    ensure_group(large(tmp_path, times=3.0))
    assert "Large" in built  # another description is another file


def test_drivers_come_with_a_group(cache, monkeypatch, tmp_path):
    build = node_trees._build

    def driven(graph):
        tree = build(graph)
        node = tree.nodes.new("ShaderNodeValue")
        node.name = "Driven"
        driver = node.outputs[0].driver_add("default_value").driver
        variable = driver.variables.new()
        variable.type = "CONTEXT_PROP"
        variable.targets[0].data_path = "render.resolution_x"
        driver.expression = f"{variable.name} * 2"
        return tree

    monkeypatch.setattr(node_trees, "_build", driven)
    for _ in range(2):
        emptied()
        tree = ensure_group(large(tmp_path))
        bpy.context.scene.compositing_node_group = tree
        bpy.context.scene.render.resolution_x = 321
        bpy.context.view_layer.update()
        (curve,) = tree.animation_data.drivers
        assert curve.data_path == 'nodes["Driven"].outputs[0].default_value'
        assert curve.driver.is_valid
        assert curve.driver.variables[0].targets[0].data_path == "render.resolution_x"
        assert tree.nodes["Driven"].outputs[0].default_value == 642


@pytest.mark.parametrize("damage", ["cut", "changed", "other"])
def test_a_damaged_file_is_built_again(cache, built, tmp_path, damage):
    ensure_group(large(tmp_path))
    (file,) = cache.iterdir()
    content = file.read_bytes()
    middle = len(content) // 2
    file.write_bytes(
        {"cut": content[:middle], "changed": content[:middle] + b"??" + content[middle + 2 :], "other": b"text"}[damage]
    )
    emptied()
    built.clear()
    assert ensure_group(large(tmp_path)).name == "Large"
    assert built
    emptied()
    built.clear()
    ensure_group(large(tmp_path))
    assert not built
    assert len(list(cache.iterdir())) == 1


def test_what_cannot_be_kept_is_built(cache, built, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / FILED))  # which is no folder
    assert ensure_group(large(tmp_path)).name == "Large"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    before, ignored = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        emptied()
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))  # as where the disk is full
        assert ensure_group(large(tmp_path)).name == "Large"
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    assert list(cache.iterdir()) == []
    built.clear()
    emptied()
    ensure_group(large(tmp_path))
    assert built
    assert len(list(cache.iterdir())) == 1


def test_what_was_not_used_for_long_makes_room(cache, tmp_path, monkeypatch):
    for times in (2.0, 3.0):
        ensure_group(large(tmp_path, times))
    first, second = sorted(cache.iterdir(), key=lambda path: path.stat().st_mtime)
    size = first.stat().st_size
    os.utime(first, (1000, 1000))
    left = cache / ".left.blend"
    left.touch()
    os.utime(left, (1000, 1000))
    monkeypatch.setattr(node_trees, "MOST_BYTES", 2.5 * size)
    ensure_group(large(tmp_path, 4.0))
    there = set(cache.iterdir())
    assert len(there) == 2
    assert second in there


def test_a_small_group_is_no_file_and_neither_is_one_whose_images_come_from_nowhere(cache, tmp_path):
    ensure_group(child())
    graph = large(tmp_path)
    graph.output("Other", graph.picture(BroughtImage("made by a class", "1", np.float32)))
    assert list(node_trees.kept_groups(graph)) == []
    assert not cache.exists()
    assert node_trees._key(large(tmp_path)) is not None


def test_a_file_is_for_what_makes_the_images_too(cache, tmp_path):
    def graph(text):
        source = tmp_path / f"{len(text)}.py"
        source.write_text(text)
        space = {}
        exec(compile(text, source, "exec"), space)
        made = Graph("Images", "From a module")
        made.output("Image", made.picture(BroughtImage("made", "1", space["make"])))
        return made

    one, other = graph("def make(): return 1"), graph("def make(): return 12")
    assert one.stamp == other.stamp
    assert node_trees._key(one) != node_trees._key(other)
