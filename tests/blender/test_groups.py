# SPDX-License-Identifier: GPL-3.0-or-later
"""Node groups out of descriptions: whole or not at all, found again, read from left to right, and what all have."""

from dataclasses import fields

import bpy
import numpy as np
import pytest
from cases import cases
from group_tools import by_groups, described, keep_group, picture, step_of

from srgb import encoded, linear
from noisy_world.nodes.node_trees import STAMP, ensure_group, ensure_picture, remove_group
from noisy_world.core.errors import american
from noisy_world.nodes.chain import build_chain
from noisy_world.core.node_graph import Graph, GroupInput, BroughtImage
from noisy_world.perturbations.groups import socket_name, socket_value
from noisy_world.perturbations.kinds import ColourPerturbation
from noisy_world.perturbations import registry

COLOUR = {item.name: item for item in registry().values() if isinstance(item, ColourPerturbation) and item.nodes}
NAMES = list(COLOUR)
TABLED = [name for name, item in COLOUR.items() if item.group_severities]
LAMPS = (4.0, 20.0, 100.0)
HEIGHT, WIDTH = 30, 64
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
    return {name: ensure_group(described(name)) for name in NAMES}


def test_every_perturbation_of_colour_has_a_group():
    assert len(NAMES) >= 18
    assert all(item.nodes for item in registry().values() if isinstance(item, ColourPerturbation))


@cases("name", NAMES)
def test_sockets_say_what_the_parameters_say(trees, name):
    perturbation, tree = registry()[name], trees[name]
    sockets = [item for item in tree.interface.items_tree if item.item_type == "SOCKET"]
    items = {item.name: item for item in sockets if item.in_out == "INPUT"}
    for told, value in perturbation.nodes.values.items():
        socket = items[socket_name(perturbation, told)]
        assert socket.description == american(value.meaning)
        ends = socket.min_value, socket.default_value, socket.max_value
        assert ends == pytest.approx((value.minimum, value.default, value.maximum))
    for field in fields(perturbation.parameters) if perturbation.has_parameter_sockets else ():
        info, socket = field.metadata["key"], items[socket_name(perturbation, field.name)]
        assert socket.description.lower() == american(info.meaning).lower()
        degrees = np.pi / 180 if info.unit == "deg" else 1
        if socket.bl_socket_idname == "NodeSocketMenu":
            assert socket.default_value == field.default.capitalize()
            continue
        number = type(field.default) is int  # which of its kind: that follows Seed
        begins = field.default if number else perturbation.newly.get(field.name, field.default)
        assert socket.default_value == pytest.approx(begins * degrees)
        if info.unit in ("px", "deg", "m"):
            assert socket.subtype == {"px": "PIXEL", "deg": "ANGLE", "m": "DISTANCE"}[info.unit]
        if socket.bl_socket_idname != "NodeSocketBool":
            low = info.minimum if info.above is None else info.above
            assert socket.min_value == pytest.approx(low * degrees)
            largest = max([*perturbation.severities.get(field.name, ()), field.default]) * degrees
            assert largest * (1 - 1e-6) <= socket.max_value <= info.maximum * degrees * (1 + 1e-6)
    assert all(item.description for item in items.values())
    assert tree.description
    assert ({"Seed", "Frame Offset"} <= set(items)) == bool(perturbation.group_temporals)
    assert ("Pattern" in items) == (len(perturbation.group_temporals) > 1)
    if "Pattern" in items:
        assert items["Pattern"].default_value == perturbation.natural.capitalize()
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


# --- what every group has, as people use it ---


def lit():
    """Scene-linear light (H, W, 3) with three lamps of 10 x 10 pixels, and something darker than black."""
    rgb = picture(HEIGHT, WIDTH) ** 2.2
    for place, light in enumerate(LAMPS):
        rgb[10:20, 6 + 20 * place : 16 + 20 * place] = light
    rgb[0, 0] = -0.01
    return rgb.astype(np.float32)


def depth():
    """Planar depth (H, W), metres, with void."""
    depth_m = np.tile(np.linspace(0.5, 6, WIDTH, dtype=np.float32), (HEIGHT, 1))
    depth_m[:3, :3] = 0
    return depth_m


@pytest.fixture(scope="module")
def made(tmp_path_factory, trees):
    """Every group on the lamps: switched off, at severities 1 and 3, and clipped at 3."""
    options = {
        "off": {"Enabled": False},
        "low": {"Severity": 1.0},
        "middle": {},
        "clipped": {"Clip": True},
    }
    nodes = {
        f"{name} {label}": (name, values)
        for name, item in COLOUR.items()
        for label, values in options.items()
        if item.group_severities or "Severity" not in values
    }
    return by_groups(nodes, lit(), tmp_path_factory.mktemp("lamps"), depth_m=depth())


@cases("name", COLOUR)
def test_light_of_any_brightness_comes_through(made, name):
    rgb = lit()
    assert np.array_equal(made[f"{name} off"], rgb)
    for label in ("low", "middle"):
        found = made.get(f"{name} {label}")
        assert found is None or np.isfinite(found).all(), label
    found = made[f"{name} low"] if name in TABLED else made[f"{name} middle"]
    # Means of the lamps' middles: what blurs or weather leave of them is still brighter than white, and in order.
    means = [found[13:17, 9 + 20 * place : 13 + 20 * place].mean() for place in range(3)]
    if name == "sensor_noise":  # a sensor is full, by default four stops above white
        assert means == [pytest.approx(4, rel=0.02), 16, 16]
    else:
        assert 1 < means[0] < means[1] < means[2], means
    clipped = made[f"{name} clipped"]
    assert clipped.min() >= 0
    assert clipped.max() <= 1 + 1e-4  # the encoding's round trip


def lamp_of(made, name, label="middle"):
    """The brightest pixel in the middle of the lamp of 100."""
    return made[f"{name} {label}"][14:16, 50:52]


def test_a_lamp_of_100_is_as_bright_as_the_definitions_say(made):
    """By the formulas on encoded values, written again: exact ones at 1e-3, others within what they may change."""
    lamp = encoded(np.array(100.0))
    brighter = linear(lamp + COLOUR["brightness"].at_severity(3).offset)
    assert np.abs(lamp_of(made, "brightness") / brighter - 1).max() < 1e-3
    seen = COLOUR["fog"].at_severity(3)
    low, high = (linear((lamp + share * seen.thickness) / (1 + seen.thickness)) for share in (0, 1))
    assert low * 0.99 < lamp_of(made, "fog").min() <= lamp_of(made, "fog").max() < high * 1.01
    ice = COLOUR["frost"].at_severity(3)
    low, high = (linear(lamp * ice.intensity + share * ice.influence) for share in (0, 1))
    assert low * 0.99 < lamp_of(made, "frost").min() <= lamp_of(made, "frost").max() < high * 1.01
    # JPEG quantises it as it does what is darker: the error is of the size of the tables' steps.
    assert np.abs(encoded(lamp_of(made, "jpeg_compression")) - lamp).max() < 0.2
    impulses = made["impulse_noise middle"]
    lamp_of_100, dark = impulses[10:20, 46:56], impulses[22:]
    assert np.abs(lamp_of_100[lamp_of_100 > 0] - 100).max() < 0.01  # salt is white, and this is brighter already
    assert 0 < (lamp_of_100 == 0).sum() < 40  # pepper, of 300
    assert {0.0, 1.0} < set(np.round(dark, 4).ravel())
    photons = encoded(made["shot_noise middle"][10:20, 46:56]) * COLOUR["shot_noise"].at_severity(3).photons
    assert np.abs(photons - np.round(photons)).max() < 0.02
    assert abs(photons.mean() - 12 * lamp) < 5 * np.sqrt(12 * lamp / photons.size)


def test_a_whole_severity_gives_the_parameters_of_the_table_to_the_bit(trees, tmp_path):
    nodes = {}
    for place, name in enumerate(TABLED):
        perturbation, level = COLOUR[name], place % 5 + 1
        table = {
            item: getattr(perturbation.at_severity(level, **perturbation.newly), item)
            for item in perturbation.severities
        }
        by_hand = {
            socket_name(perturbation, item): socket_value(perturbation, item, value) for item, value in table.items()
        }
        nodes |= {name: (name, {"Severity": level}), f"{name} by hand": (name, {"Override Severity": True} | by_hand)}
    found = by_groups(nodes, lit(), tmp_path, depth_m=depth())
    assert [name for name in TABLED if not np.array_equal(found[name], found[f"{name} by hand"])] == []


def test_a_severity_between_levels_is_between_them_and_less_than_1_fades_out(tmp_path):
    rgb = lit()
    nodes = {f"{severity}": ("contrast", {"Severity": severity}) for severity in (0.0, 0.25, 1.0, 2.0, 2.25)}
    by_hand = {"Override Severity": True, "Factor": COLOUR["contrast"].at_severity(2.25).factor, "Severity": 0.5}
    found = by_groups(nodes | {"by hand": ("contrast", by_hand)}, rgb, tmp_path)
    assert np.array_equal(found["0.0"], rgb)
    assert np.allclose(found["0.25"], 0.75 * rgb + 0.25 * found["1.0"], rtol=1e-5, atol=1e-5)
    assert np.allclose(found["2.25"], found["by hand"], rtol=1e-5, atol=1e-6)  # where Severity has no say
    assert not np.allclose(found["2.25"], found["2.0"], rtol=1e-3)


def test_a_mask_says_where_the_effect_shows(tmp_path):
    rgb = lit()
    mask = np.zeros((HEIGHT, WIDTH), np.float32)
    mask[:, 20:40], mask[:, 40:] = 0.5, 1.0
    for name in ("contrast", "snow_depth"):  # which work on encoded colour, and on light
        nodes = {"whole": (name, {}), "masked": (name, {"Mask": mask}), "half": (name, {"Mask": 0.5})}
        found = by_groups(nodes, rgb, tmp_path, depth_m=depth())
        assert np.array_equal(found["masked"][:, :20], rgb[:, :20])
        assert np.array_equal(found["masked"][:, 40:], found["whole"][:, 40:])
        assert np.array_equal(found["masked"][:, 20:40], found["half"][:, 20:40])
        assert np.allclose(found["half"], (rgb + found["whole"]) / 2, rtol=1e-5, atol=1e-5)


def test_a_chain_clips_as_the_generator_does_unless_it_is_told_not_to(tmp_path):
    rgb = lit()
    chain = build_chain("Chain", [step_of("frost", severity=1), step_of("brightness", severity=1)])
    found = by_groups({"on": (chain, {}), "off": (chain, {"Clip": False})}, rgb, tmp_path)
    assert found["on"].max() <= 1 + 1e-4
    assert found["off"][15, 11].min() > 1
    dark = (found["off"] < 0.99).all(axis=2)
    assert np.allclose(found["on"][dark], np.maximum(found["off"][dark], 0), atol=1e-5)


def test_a_pattern_is_fresh_fixed_or_drifts(tmp_path):
    rgb = lit()
    names = ("Fresh", "Fixed", "Drift")
    nodes = {item: ("fog", {"Pattern": item, "Seed": 3}) for item in names} | {"default": ("fog", {"Seed": 3})}
    first, later = (by_groups(nodes, rgb, tmp_path, frame=frame) for frame in (0, 7))
    assert np.array_equal(first["Fixed"], later["Fixed"])
    assert np.array_equal(first["Drift"], first["Fixed"])  # at the first frame
    assert not np.array_equal(later["Drift"], later["Fixed"])
    assert not np.array_equal(later["Fresh"], later["Fixed"])
    assert np.array_equal(later["default"], later["Drift"])


def test_the_node_s_sockets_stand_in_panels():
    tree = ensure_group(described("fog"))
    sockets = [item for item in tree.interface.items_tree if item.item_type == "SOCKET" and item.in_out == "INPUT"]
    panels = {}
    for item in sockets:
        panels.setdefault(item.parent.name, []).append(item.name)
    assert panels == {
        "": ["Image", "Mask", "Mix", "Color", "Severity", "Enabled", "Uniform", "Flow"],
        "Override Severity": ["Override Severity", "Thickness", "Smoothness"],
        "Random Pattern": ["Pattern", "Seed", "Frame Offset"],
        "Image Options": ["Reference Width", "Encoded", "Clip"],
    }
    assert [item.name for item in sockets if item.is_panel_toggle] == ["Override Severity"]
    closed = [item.name for item in tree.interface.items_tree if item.item_type == "PANEL" and item.default_closed]
    assert closed == ["Image Options"]
    assert tree.default_group_node_width > 150


# --- groups in a file ---


def test_building_again_saving_and_reloading_change_nothing_and_removing_leaves_nothing(empty, tmp_path):
    def build():
        return [ensure_group(described(name)) for name in NAMES]

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
    good = BroughtImage("good", "1", lambda: np.zeros((4, 4), np.uint8))
    result = result + graph.picture(good)
    made = {
        "node": lambda: graph.node("CompositorNodeNoSuchThing", {"Image": result}),
        "socket": lambda: graph.node("CompositorNodeBlur", {"Picture": result}),
        "property": lambda: graph.node("ShaderNodeMath", {"Value": result}, {"operation": "GUESS"}),
        "picture": lambda: graph.node("CompositorNodeImage", {}, picture=BroughtImage("bad", "1", no_picture)),
        "inner": lambda: graph.group(inner, {"Imago": result}),
    }[fault]()
    graph.output("Image", made.out("Image", "color"))
    before = stock()
    with pytest.raises((RuntimeError, KeyError, TypeError, OSError)):
        ensure_group(graph)
    assert stock() == before


def test_a_picture_is_packed_upright_and_exact(empty):
    values = np.arange(6 * 4 * 3, dtype=np.uint8).reshape(6, 4, 3)
    image = ensure_picture(BroughtImage("picture", "1", lambda: values))
    assert image.packed_file is not None
    assert ensure_picture(BroughtImage("picture", "1", lambda: 1 / 0)) == image
    pixels = np.array(image.pixels[:]).reshape(6, 4, 4)[::-1, :, :3]
    assert np.abs(pixels * 255 - values).max() < 1e-4
    other = ensure_picture(BroughtImage("picture", "2", lambda: values + 1))
    assert [item.name for item in bpy.data.images] == ["picture"]
    assert other.pixels[0] != 0


def test_a_user_s_own_group_of_the_same_name_is_neither_taken_nor_replaced(empty):
    theirs = bpy.data.node_groups.new("Contrast", "CompositorNodeTree")
    theirs.use_fake_user = True
    ours = ensure_group(described("contrast"))
    assert (theirs.name, len(theirs.nodes)) == ("Contrast", 0)
    assert ours.name == "Contrast.001"
    assert ensure_group(described("contrast")) == ours
    copied = ours.copy()  # a user's, to be changed
    copied.nodes.clear()
    assert ensure_group(described("contrast")) == ours
    remove_group(ours)
    again = ensure_group(described("contrast"))
    assert again not in (theirs, copied)
    assert len(copied.nodes) == 0
