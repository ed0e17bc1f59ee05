# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbations' groups as descriptions: sockets out of the parameters, places, and a setting's chain of groups."""

import math
from dataclasses import fields, replace
from itertools import pairwise

import pytest
from cases import cases

from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.node_graphs.chain import build_chain, capacity_of, is_active, socket_values, step_node
from noisy_world.core.node_graphs.graph import INTERFACE, Graph, GroupInput, Socket
from noisy_world.core.node_graphs.groups import Canvas, build_group
from noisy_world.core.node_graphs.node_layout import arrange
from noisy_world.core.perturbing.kinds import ColourPerturbation
from noisy_world.core.perturbing.reading import parse_steps
from noisy_world.core.schema import Place
from noisy_world.perturbations import registry

COLOUR = {item.name: item for item in registry().values() if isinstance(item, ColourPerturbation)}
WHERE = (7, "room", "setting")


def steps_of(*items):
    return parse_steps(items, Place("test"), registry())


def sockets_by_parameter(name):
    """The group's inputs by the words of their parameter's name, without its unit."""
    inputs = {item.name.lower(): item for item in build_group(COLOUR[name]).inputs}
    units = ("_mm_h", "_m_s", "_px", "_deg", "_mrad", "_mm", "_ms", "_hz", "_m")
    inputs["f number"] = inputs.get("f-stop")  # Blender's word for it
    found = {}
    for item in fields(COLOUR[name].parameters):
        suffix = next((unit for unit in units if item.name.endswith(unit)), "")
        found[item.name] = inputs[item.name.removesuffix(suffix).replace("_", " ")]
    return found


@cases("name", COLOUR)
def test_a_group_has_a_socket_for_every_parameter_at_severity_3(name):
    perturbation = COLOUR[name]
    third = perturbation.at_severity(3)
    for parameter, socket in sockets_by_parameter(name).items():
        value = getattr(third, parameter)
        assert socket.default == pytest.approx(math.radians(value) if parameter.endswith("_deg") else value)
        assert socket.description
        assert socket.kind == {bool: "bool", int: "int", float: "float"}[type(value)]
        assert socket.subtype in {"_px": ("PIXEL",), "deg": ("ANGLE",)}.get(parameter[-3:], (socket.subtype,))
        if socket.kind != "bool":
            assert socket.minimum <= socket.default <= socket.maximum
    names = [item.name for item in build_group(perturbation).inputs]
    assert {"Image", "Reference Width", "Enabled", "Encoded"} <= set(names)
    assert ("Seed" in names) == bool(perturbation.temporals)
    assert ("Drift" in names) == ("drift" in perturbation.temporals)
    assert ("Depth" in names) == perturbation.needs_depth


@cases("name", COLOUR)
def test_a_description_is_the_same_each_time(name):
    group = build_group(COLOUR[name])
    assert group.stamp == build_group(COLOUR[name]).stamp
    assert group.category == COLOUR[name].stage
    assert [item.name for item in group.outputs] == ["Image"]
    with_larger = {key: 2 * value for key, value in COLOUR[name].capacity.items()}
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
    graph = Graph("NW nothing", "Gives what it takes")
    graph.output("Image", graph.input(GroupInput("Image", "color", (0, 0, 0, 1), "in")))
    plan = arrange(graph)
    assert plan.positions == {}
    assert set(plan.entries) == {""}


def test_a_perturbation_without_nodes_says_who_carries_it_out():
    with pytest.raises(NoisyWorldError, match="contrast: has no node group; the backend reference"):
        build_group(replace(COLOUR["contrast"], build=None))


def test_random_numbers_have_a_purpose_and_a_seed():
    graph = Graph("NW test", "A test's")
    image = graph.input(GroupInput("Image", "color", (0, 0, 0, 1), "in"))
    seed, key = (graph.input(GroupInput(name, "float", 0.0, name)) for name in ("Seed", "Key"))
    canvas = Canvas(graph, image, seed, seed, seed, image, seed=seed, key=key)
    drawn = {canvas.random(purpose).node for purpose in range(32)}
    assert len(drawn) == 32  # each purpose has numbers of its own
    assert canvas.random(3, image).node not in drawn
    for wrong in (-1, 32):
        with pytest.raises(ValueError, match="purpose"):
            canvas.random(wrong)
    with pytest.raises(ValueError, match="of a seeded group"):
        Canvas(graph, image, seed, seed, seed, image).random_value(0)


# --- chains ---


def test_a_chain_applies_its_steps_one_after_another():
    steps = steps_of({"fog_depth": {"severity": 2}}, {"gaussian_noise": None}, {"gaussian_noise": None})
    graph = build_chain("NW chain", steps)
    groups = [node for node in graph.nodes if node.group is not None]
    assert [node.name for node in groups] == [step_node(step) for step in steps]
    assert len({node.name for node in groups}) == 3
    assert [node.group.name for node in groups] == [build_group(step.perturbation).name for step in steps]
    for before, after in pairwise(groups):
        assert graph.nodes[after.inputs["Image"].node] is before
    assert "Depth" in [item.name for item in graph.inputs]
    assert "Depth" not in [item.name for item in build_chain("NW chain", steps[1:]).inputs]


def test_a_trail_longer_than_the_group_serves_asks_for_a_larger_one():
    (usual,) = steps_of({"motion_blur": {"severity": 5}})
    (longer,) = steps_of({"motion_blur": {"radius_px": 33}})
    (varied,) = steps_of({"motion_blur": {"levels": [0, 1], "radius_px": 40, "mode": "dynamic"}})
    assert capacity_of(usual) == {}
    assert capacity_of(longer) == {"radius_px": 33}
    assert capacity_of(varied) == {"radius_px": 40}


def test_sockets_say_what_a_step_does_to_a_frame():
    (step,) = steps_of({"fog": {"severity": 5, "temporal": "drift"}})
    values, note = socket_values(step, 12, WHERE, scene_frame=2)
    assert (values["Thickness"], values["Smoothness"]) == (3.0, 1.4)  # the paper's, at severity 5
    assert (values["Enabled"], values["Redraw"], values["Drift"], values["Frame Offset"]) == (True, False, True, 10)
    assert values["Seed"] == note["node_seed"]
    assert 0 <= values["Seed"] < 2**24  # what float32 counts
    assert socket_values(step, 13, WHERE)[0]["Seed"] == values["Seed"]
    assert socket_values(step, 12, (8, "room", "setting"))[0]["Seed"] != values["Seed"]
    (fresh,) = steps_of({"fog": {"severity": 0}})
    values, _ = socket_values(fresh, 0, WHERE)
    assert (values["Enabled"], values["Redraw"], values["Drift"]) == (False, True, False)
    assert "Thickness" not in values
    (turned,) = steps_of({"motion_blur": {"max_angle_deg": 90.0}})
    assert socket_values(turned, 0, WHERE)[0]["Max Angle"] == pytest.approx(math.pi / 2)
    (still,) = steps_of({"contrast": {"severity": 1}})
    assert "Seed" not in socket_values(still, 0, WHERE)[0]


def test_a_chain_rests_where_nothing_is_enabled():
    on, off = {"Enabled": True}, {"Enabled": False}
    assert is_active({})  # no step: the frame itself
    assert is_active({"a": off, "b": on})
    assert not is_active({"a": off, "b": off})
