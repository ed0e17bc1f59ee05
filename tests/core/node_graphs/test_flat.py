# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups written out into the description that uses them: which are, which stay, and what is left out."""

import pytest

from noisy_world.nodes.chain import build_written
from noisy_world.core.node_graph import REPEATED, flat
from noisy_world.core.node_graph import Graph, GroupInput
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry

IMAGE = GroupInput("Image", "color", (0.5, 0.5, 0.5, 1.0), "What comes in")


def doubled(kind="color", given="color"):
    """A group that adds its input to itself."""
    graph = Graph("Twice", "A sum")
    image = graph.input(GroupInput("Image", given, IMAGE.default if given == "color" else 0.0, "What comes in"))
    factor = graph.input(GroupInput("Factor", "float", 2.0, "Never set"))
    graph.output("Image", graph.math("MULTIPLY", image, factor), kind)
    return graph


def used(inner, times=1, **more):
    graph = Graph("Outer", "Uses a group")
    image = graph.input(IMAGE)
    for number in range(times):
        image = graph.group(inner, {"Image": image, **more}, name=f"{number}").out("Image", "color")
    graph.output("Image", image)
    return graph


def idnames(graph):
    return [graph.nodes[number].idname for number in graph.reachable()]


def test_groups_inside_are_written_out_and_their_constants_become_inputs():
    made = flat(used(doubled(), times=REPEATED))
    assert idnames(made) == ["ShaderNodeVectorMath"] * REPEATED
    assert [(item.kind, item.default) for item in made.inputs[1:]] == [("float", 2.0)]
    assert made.nodes[1].inputs["Vector"].node == 0  # a sum goes into the next one


def test_a_group_that_is_there_often_stays_one():
    made = flat(used(doubled(), times=REPEATED + 1))
    assert idnames(made) == ["CompositorNodeGroup"] * (REPEATED + 1)


@pytest.mark.parametrize("shape", [{"kind": "float"}, {"given": "float"}])
def test_a_group_whose_sockets_narrow_what_a_link_carries_stays_one(shape):
    """Three numbers become their mean on the way into a socket of one, and that is lost if the socket goes."""
    assert idnames(flat(used(doubled(**shape)))) == ["CompositorNodeGroup"]


@pytest.mark.parametrize(("known", "kept"), [(True, "ADD"), (False, "SUBTRACT")])
def test_a_choice_that_is_known_leaves_the_other_branch_out(known, kept):
    inner = Graph("Choice", "One of two")
    image, on = inner.input(IMAGE), inner.input(GroupInput("On", "bool", not known, "Which"))
    inner.output("Image", inner.choose(on, image + 1.0, image - 1.0))
    made = flat(used(inner, On=known))
    assert [made.nodes[number].properties["operation"] for number in made.reachable()] == [kept]
    assert "GeometryNodeSwitch" in idnames(flat(inner))  # here the group's user decides


def test_a_menu_that_is_known_becomes_numbers():
    inner = Graph("Menu", "A tint by words")
    image = inner.input(IMAGE)
    red, blue = inner.chosen(inner.input(GroupInput("Hue", "menu", "Blue", "Which", items=("Red", "Blue"))))
    inner.output("Image", image * inner.vector(red, blue, 0.0))
    for given, wanted in ({}, (0.0, 1.0)), ({"Hue": "Red"}, (1.0, 0.0)):
        made = flat(used(inner, **given))
        assert "GeometryNodeMenuSwitch" not in idnames(made)
        (tint,) = (node for node in made.nodes if node.idname == "ShaderNodeCombineXYZ")
        assert (tint.inputs["X"], tint.inputs["Y"]) == wanted
    assert "GeometryNodeMenuSwitch" in idnames(flat(inner))


@pytest.mark.parametrize("name", ["gaussian_noise", "jpeg_compression"])
def test_what_is_evaluated_takes_the_frame_as_it_is(name):
    """The frame is encoded and every step is on, so nothing is converted and nothing chosen by that."""
    graph = build_written(parse_steps([{name: {"severity": 3}}], ConfigPath("test"), registry()))
    assert [item.name for item in graph.outputs] == ["Image", "Bytes"]
    assert [item.name for item in graph.inputs if item.name.endswith(": Encoded")] == []
    assert "CompositorNodeConvertColorSpace" not in idnames(graph)


def test_several_steps_may_stay_groups_each_with_a_name_of_its_own():
    """Two of a kind that are built otherwise may not take each other's place in a file."""
    steps = parse_steps(
        [{"gaussian_blur": {"sigma_px": 1.0}}, {"gaussian_blur": {"sigma_px": 30.0}}, {"fog": {"severity": 3}}],
        ConfigPath("test"),
        registry(),
    )
    whole, apart = (build_written(steps, apart=each) for each in (False, True))
    parts = [node.group for node in apart.nodes if node.group is not None and " " in node.group.name]
    assert len({part.name for part in parts}) == len({part.stamp for part in parts}) >= 2
    assert len(apart.nodes) < 20 < len(whole.nodes)
    assert [item.name for item in apart.inputs] == [item.name for item in whole.inputs]
    assert len(build_written(steps[:1], apart=True).nodes) == len(build_written(steps[:1]).nodes)
