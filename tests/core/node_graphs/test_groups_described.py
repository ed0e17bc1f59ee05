# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbations' groups as descriptions: sockets out of the parameters, places, and a setting's chain of groups."""

import math
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Literal

import pytest
from refusals import refused
from cases import cases

from noisy_world.core.errors import NoisyWorldError
from noisy_world.nodes.chain import (
    build_chain,
    build_written,
    capacity_of,
    roomy_capacity_of,
    is_active,
    shown_values,
    socket_values,
    step_node,
)
from noisy_world.core.node_graph import INTERFACE, Graph, GroupInput, Socket
from noisy_world.perturbations.groups import OVERRIDE_PANEL
from noisy_world.perturbations.groups import Canvas, build_group
from noisy_world.core.node_graph import arrange
from noisy_world.perturbations.kinds import ColourPerturbation, Nodes
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.core.schema import ConfigPath, key
from noisy_world.perturbations import registry

COLOUR = {item.name: item for item in registry().values() if isinstance(item, ColourPerturbation) and item.nodes}
WHERE = (7, "room", "setting")


def steps_of(*items):
    return parse_steps(items, ConfigPath("test"), registry())


def sockets_by_parameter(name):
    """The group's inputs by the words of their parameter's name, without its unit."""
    inputs = {item.name.lower(): item for item in build_group(COLOUR[name]).inputs}
    units = ("_per_s", "_mm_h", "_m_s", "_px", "_deg", "_mrad", "_mm", "_ms", "_hz", "_m")
    inputs["f number"] = inputs.get("f-stop")  # Blender's word for it
    found = {}
    for item in () if COLOUR[name].nodes.by_frame is not None else fields(COLOUR[name].parameters):
        suffix = next((unit for unit in units if item.name.endswith(unit)), "")
        said = item.metadata["key"].label or item.name.removesuffix(suffix).replace("_", " ")
        found[item.name] = inputs.get(said.lower()) or inputs[item.name.removesuffix(suffix).replace("_", " ")]
    return found


@cases("name", COLOUR)
def test_a_group_has_a_socket_for_every_parameter_at_severity_3(name):
    perturbation = COLOUR[name]
    third = perturbation.at_severity(3)
    for parameter, socket in sockets_by_parameter(name).items():
        value = getattr(third, parameter)
        if type(value) is not int:  # what a new step has, and its group
            value = perturbation.newly.get(parameter, value)
        if isinstance(value, str):
            assert (socket.kind, socket.default) == ("menu", value.capitalize())
            assert socket.default in socket.items
            continue
        assert socket.default == pytest.approx(math.radians(value) if parameter.endswith("_deg") else value)
        assert socket.description
        assert socket.kind == {bool: "bool", int: "int", float: "float"}[type(value)]
        assert socket.subtype in {"_px": ("PIXEL",), "deg": ("ANGLE",)}.get(parameter[-3:], (socket.subtype,))
        assert (socket.panel == OVERRIDE_PANEL) == (parameter in perturbation.severities)
        if socket.kind != "bool":
            assert socket.minimum <= socket.default <= socket.maximum
    names = [item.name for item in build_group(perturbation).inputs]
    assert {"Image", "Mask", "Reference Width", "Enabled", "Encoded", "Clip"} <= set(names)
    assert ("Severity" in names) == ("Override Severity" in names) == bool(perturbation.group_severities)
    assert ("Seed" in names) == bool(perturbation.group_temporals)
    assert ("Pattern" in names) == (len(perturbation.group_temporals) > 1)
    assert ("Depth" in names) == perturbation.needs_depth


@cases("name", COLOUR)
def test_a_description_is_the_same_each_time(name):
    group = build_group(COLOUR[name])
    assert group.stamp == build_group(COLOUR[name]).stamp
    assert group.category == COLOUR[name].stage
    assert [item.name for item in group.outputs] == ["Image"]
    with_larger = {key: 2 * value for key, value in COLOUR[name].nodes.capacity.items()}
    if with_larger:
        larger = build_group(COLOUR[name], with_larger)
        assert larger.stamp != group.stamp
        assert larger.name != group.name
        assert larger.category == ""  # no asset of its own


@cases("name", COLOUR)
def test_nodes_stand_to_the_right_of_what_they_depend_on_and_none_on_another(name):
    graph = build_group(COLOUR[name])
    plan = arrange(graph)
    for number, (x, _) in plan.positions.items():
        for value in graph.nodes[number].inputs.values():
            if isinstance(value, Socket) and value.node != INTERFACE:
                assert plan.positions[value.node][0] < x
    assert len(plan.sections) >= 3
    assert all(x < plan.output[0] for x, _ in plan.positions.values())
    positions = sorted(plan.positions.items(), key=lambda item: item[1])
    for (_, (x, y)), (b, (other_x, other_y)) in pairwise(positions):
        if x == other_x:
            # Sockets are 22 px apart; a closed node's title takes 20.
            assert other_y - y >= 20 + 22 * (1 + len(graph.nodes[b].inputs))
        else:
            assert other_x - x >= 190


def test_a_group_that_gives_its_input_has_an_entry():
    graph = Graph("nothing", "Gives what it takes")
    graph.output("Image", graph.input(GroupInput("Image", "color", (0, 0, 0, 1), "in")))
    plan = arrange(graph)
    assert plan.positions == {}
    assert set(plan.entries) == {""}


def test_a_perturbation_without_nodes_says_who_carries_it_out():
    refused(
        build_group,
        replace(COLOUR["contrast"], nodes=None),
        names=("contrast: ", "the backend reference"),
        error=NoisyWorldError,
    )


def test_random_numbers_have_a_purpose_and_a_seed():
    graph = Graph("test", "A test's")
    image = graph.input(GroupInput("Image", "color", (0, 0, 0, 1), "in"))
    seed, key = (graph.input(GroupInput(name, "float", 0.0, name)) for name in ("Seed", "Key"))
    canvas = Canvas(graph, image, seed, seed, seed, image, seed=seed, key=key)
    drawn = {canvas.random(purpose).node for purpose in range(32)}
    assert len(drawn) == 32  # each purpose has numbers of its own
    assert canvas.random(3, image).node not in drawn
    for wrong in (-1, 32):
        refused(canvas.random, wrong, names="purpose", error=ValueError)
    refused(
        lambda: Canvas(graph, image, seed, seed, seed, image).random_value(0),
        names="of a seeded group",
        error=ValueError,
    )


# --- chains ---


def test_a_chain_applies_its_steps_one_after_another():
    steps = steps_of({"fog_depth": {"severity": 2}}, {"gaussian_noise": None}, {"gaussian_noise": None})
    graph = build_chain("chain", steps)
    groups = [node for node in graph.nodes if node.group is not None]
    assert [node.name for node in groups] == [step_node(step) for step in steps]
    assert len({node.name for node in groups}) == 3
    assert [node.group.name for node in groups] == [build_group(step.perturbation).name for step in steps]
    for before, after in pairwise(groups):
        assert graph.nodes[after.inputs["Image"].node] is before
    assert "Depth" in [item.name for item in graph.inputs]
    assert "Depth" not in [item.name for item in build_chain("chain", steps[1:]).inputs]


def test_a_trail_longer_than_the_group_serves_asks_for_a_larger_one():
    (usual,) = steps_of({"motion_blur": {"severity": 5}})
    (longer,) = steps_of({"motion_blur": {"radius_px": 33}})
    (varied,) = steps_of({"motion_blur": {"levels": [0, 1], "radius_px": 40, "mode": "dynamic"}})
    assert capacity_of(usual) == {}
    assert capacity_of(longer) == {"radius_px": 33}
    assert roomy_capacity_of(longer) == {"radius_px": 45}  # 20, 30, 45: as for all from 31 on
    assert capacity_of(varied) == {"radius_px": 40}
    blur = registry()["motion_blur"]
    given = {item.name: getattr(blur, item.name) for item in fields(ColourPerturbation) if item.name != "nodes"}
    made = ColourPerturbation(
        **given, build=blur.nodes.build, capacity={"radius_px": 7}
    )  # as packages for 0.1.0 say it
    assert made.nodes == Nodes(blur.nodes.build, {"radius_px": 7})


def test_sockets_say_what_a_step_does_to_a_frame():
    (step,) = steps_of({"fog": {"severity": 5, "temporal": "drift"}})
    values, note = socket_values(step, 12, WHERE, scene_frame=2)
    assert (values["Thickness"], values["Smoothness"]) == (3.0, 1.4)  # the paper's, at severity 5
    assert (values["Enabled"], values["Pattern"], values["Frame Offset"]) == (True, "Drift", 10)
    assert values["Seed"] == note["node_seed"]
    assert 0 <= values["Seed"] < 2**24  # what float32 counts
    assert socket_values(step, 13, WHERE)[0]["Seed"] == values["Seed"]
    assert socket_values(step, 12, (8, "room", "setting"))[0]["Seed"] != values["Seed"]
    (fresh,) = steps_of({"fog": {"severity": 0}})
    values, _ = socket_values(fresh, 0, WHERE)
    assert (values["Enabled"], values["Pattern"]) == (False, "Fresh")
    assert "Thickness" not in values
    (turned,) = steps_of({"motion_blur": {"max_angle_deg": 90.0}})
    assert socket_values(turned, 0, WHERE)[0]["Max Angle"] == pytest.approx(math.pi / 2)
    (still,) = steps_of({"contrast": {"severity": 1}})
    assert "Seed" not in socket_values(still, 0, WHERE)[0]


@pytest.mark.parametrize(
    ("given", "by_severity"),
    [
        ({"severity": 4}, True),
        ({"severity": 4, "flow_px": 9.0}, True),  # which is not in the table
        ({"severity": 4, "thickness": 2.75}, False),
        ({"severity": 3.5}, False),  # the table is exact to the bit at whole levels only
        ({"thickness": 2.5, "smoothness": 1.7}, False),
    ],
)
def test_what_people_see_goes_by_the_severity_where_that_decides_all(given, by_severity):
    (step,) = steps_of({"fog": given})
    bare, shown = socket_values(step, 3, WHERE)[0], shown_values(step, 3, WHERE)
    assert shown["Override Severity"] is not by_severity
    assert ("Thickness" in shown) is not by_severity
    assert shown.get("Severity") == (given["severity"] if by_severity else None)
    assert {name: bare[name] for name in shown if name in bare} == {
        name: value for name, value in shown.items() if name not in ("Severity", "Override Severity", "Mix", "Color")
    }


def test_a_step_that_does_nothing_leaves_its_severity_and_one_without_a_table_has_none():
    (off,) = steps_of({"fog": {"severity": 0}})
    assert shown_values(off, 0, WHERE).keys() == {"Enabled", "Mix", "Color", "Pattern", "Seed", "Frame Offset"}
    untabled = replace(off, perturbation=replace(COLOUR["fog"], severities={}), severity=None, given={})
    assert "Override Severity" not in shown_values(untabled, 0, WHERE)
    assert "Severity" not in [item.name for item in build_group(untabled.perturbation).inputs]


def test_a_choice_of_words_is_a_menu():
    @dataclass(frozen=True)
    class Tinted:
        """A tint."""

        hue: Literal["deep_red", "green"] = key("which tint", default="green")

    def build(canvas, given, _served):
        red, green = canvas.graph.chosen(given["hue"])
        return canvas.image * canvas.graph.vector(red, green, 0.0)

    tinted = replace(
        COLOUR["contrast"], name="tinted", parameters=Tinted, severities={}, build=build, label="tint by hue"
    )
    group = build_group(tinted)
    (hue,) = (item for item in group.inputs if item.kind == "menu")
    assert (group.name, hue.name, hue.items, hue.default) == ("Tint by Hue", "Hue", ("Deep Red", "Green"), "Green")
    (step,) = parse_steps([{"tinted": {"hue": "deep_red"}}], ConfigPath("test"), {"tinted": tinted})
    assert socket_values(step, 0, WHERE)[0]["Hue"] == "Deep Red"


def test_a_pattern_that_can_only_change_in_one_way_is_no_choice():
    only = replace(COLOUR["fog"], temporals=("fixed",))
    group = build_group(only)
    assert {"Seed", "Pattern"}.intersection(item.name for item in group.inputs) == {"Seed"}
    assert only.natural == "fixed"
    assert COLOUR["fog"].natural == "drift"
    assert COLOUR["gaussian_noise"].natural == "fresh"
    refused(
        replace,
        only,
        natural_temporal="drift",
        names=("fog: ", "natural_temporal"),
        error=ValueError,
    )


def test_a_chain_rests_where_nothing_is_enabled():
    on, off = {"Enabled": True}, {"Enabled": False}
    assert is_active({})  # no step: the frame itself
    assert is_active({"a": off, "b": on})
    assert not is_active({"a": off, "b": off})


def test_a_chain_of_no_steps_gives_its_image():
    assert [item.name for item in build_chain("empty", []).outputs] == ["Image"]
    assert [item.name for item in build_written([], lit=True).outputs] == ["Image"]
