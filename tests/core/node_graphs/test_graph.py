# SPDX-License-Identifier: GPL-3.0-or-later
"""Arithmetic on sockets: the nodes that it describes, worked out by what Blender's manual says of each operation."""

import math
import operator

import numpy as np
import pytest
from refusals import refused
from cases import cases

from noisy_world.core.node_graph import INTERFACE, Graph, GroupInput, BroughtImage, Socket

# Blender's manual on the Math and the Vector Math node, operation by operation.
OPERATIONS = {
    "ADD": np.add,
    "SUBTRACT": np.subtract,
    "MULTIPLY": np.multiply,
    "DIVIDE": lambda a, b: np.divide(a, b, out=np.zeros(np.broadcast(a, b).shape), where=np.asarray(b) != 0),
    "POWER": np.power,
    "LESS_THAN": lambda a, b: np.where(np.less(a, b), 1.0, 0.0),
    "GREATER_THAN": lambda a, b: np.where(np.greater(a, b), 1.0, 0.0),
    "MULTIPLY_ADD": lambda a, b, c: np.multiply(a, b) + c,
    "MINIMUM": np.minimum,
    "MAXIMUM": np.maximum,
    "SIGN": np.sign,
    "DOT_PRODUCT": np.dot,
}
NUMBERS = (-2.5, 0.0, 0.5, 3.0)
FIRST, SECOND = np.array([-2.5, 0.5, 3.0]), np.array([0.5, 0.5, -1.0])


def described(kind, names="ab"):
    """A graph with an input of a kind for each name, and the inputs."""
    graph = Graph("test", "A test's")
    default = 0.0 if kind == "float" else (0.0, 0.0, 0.0)
    return graph, [graph.input(GroupInput(name, kind, default, name)) for name in names]


def worth(value, given):
    """What a socket, or a number, is where the group's inputs are given by name."""
    if not isinstance(value, Socket):
        return value
    if value.node == INTERFACE:
        return given[value.output]
    node = value.graph.nodes[value.node]
    inputs = {name: worth(item, given) for name, item in node.inputs.items()}
    if node.idname == "ShaderNodeSeparateXYZ":
        return inputs["Vector"]["XYZ".index(value.output)]
    if node.idname == "ShaderNodeCombineXYZ":
        return np.array([inputs[axis] for axis in "XYZ"])
    if node.idname == "GeometryNodeSwitch":
        return np.asarray(inputs["True" if inputs["Switch"] else "False"])
    assert node.idname in ("ShaderNodeMath", "ShaderNodeVectorMath"), node.idname
    return OPERATIONS[node.properties["operation"]](*inputs.values())


@cases("operation", [operator.add, operator.sub, operator.mul, operator.truediv, operator.lt, operator.gt])
def test_operators_are_their_nodes(operation):
    graph, (a, b) = described("float")
    for x in NUMBERS:
        for y in NUMBERS:
            expected = 0.0 if operation is operator.truediv and y == 0 else float(operation(x, y))
            given = {"a": x, "b": y}
            assert worth(operation(a, b), given) == expected
            assert worth(operation(a, y), given) == expected
            if operation not in (operator.lt, operator.gt):  # Python turns `2 < a` into `a > 2`
                assert worth(operation(x, b), given) == expected
    vectors, (u, v) = described("vector")
    expected = operation(FIRST, SECOND).astype(float)
    np.testing.assert_array_equal(worth(operation(u, v), {"a": FIRST, "b": SECOND}), expected)
    np.testing.assert_array_equal(worth(operation(u, 0.5), {"a": FIRST}), operation(FIRST, 0.5).astype(float))
    assert vectors.nodes
    assert graph.nodes


def test_powers_negation_limits_and_mixtures():
    _, (a, b) = described("float")
    for x in NUMBERS:
        given = {"a": x, "b": 3.0}
        assert worth(-a, given) == -x
        assert worth(a**2.0, given) == x**2
        assert worth(a.graph.clamp(a), given) == min(max(x, 0), 1)
        assert worth(a.graph.clamp(a, -1.0, 2.0), given) == min(max(x, -1), 2)
        assert worth(a.graph.mix(a, b, 0.25), given) == pytest.approx(0.75 * x + 0.25 * 3)


def test_components_vectors_and_what_is_a_single_number():
    graph, (u, v) = described("vector")
    given = {"a": FIRST, "b": SECOND}
    for k, names in enumerate(("xr", "yg", "zb")):
        for name in names:
            assert worth(getattr(u, name), given) == FIRST[k]
    turned = graph.vector(u.z, u.x, v.y)
    np.testing.assert_array_equal(worth(turned, given), [FIRST[2], FIRST[0], SECOND[1]])
    dot = graph.math("DOT_PRODUCT", u, v)
    assert dot.kind == "float"
    assert worth(dot, given) == pytest.approx(float(FIRST @ SECOND))
    with pytest.raises(AttributeError):
        _ = dot.x
    with pytest.raises(AttributeError):
        _ = u.w


@cases("kind, one, other", [("float", 2.0, 3.0), ("vector", 2.0, (1.0, 2.0, 3.0)), ("color", 0.5, (0.1, 0.2, 0.3))])
def test_a_choice_takes_one_of_two_in_the_form_of_its_kind(kind, one, other):
    graph, (condition,) = described("float", "c")
    chosen = graph.choose(condition, one, other, kind)
    assert chosen.kind == kind
    for is_true, value in ((True, one), (False, other)):
        found = worth(chosen, {"c": is_true})
        assert found.size == {"float": 1, "vector": 3, "color": 4}[kind]
        np.testing.assert_array_equal(found.ravel()[:3], np.broadcast_to(value, min(found.size, 3)))


def test_python_cannot_decide_by_a_socket():
    _, (a, b) = described("float")
    decisions = [lambda: bool(a), lambda: max(a, b), lambda: a == b, lambda: a in [b], lambda: 1 < a < 2]
    for decide in decisions:
        refused(decide, names="socket", error=TypeError)


def test_equal_nodes_of_a_section_are_one_and_sections_hold_what_is_made_in_them():
    graph, (a, b) = described("float")
    assert (a * 2.0).node == (a * 2.0).node != (a * 3.0).node
    with graph.section("Later"):
        assert (a * 2.0).node != (b * 2.0).node
    assert [node.section for node in graph.nodes] == ["", "", "Later", "Later"]


def test_what_cannot_be_described_is_refused():
    graph, (a, _) = described("float")
    _, (stranger, _) = described("float")
    refused(graph.input, GroupInput("a", "float", 0.0, "again"), names="there twice", error=ValueError)
    refused(graph.math, "ADD", a, stranger, names="linked to a socket of", error=ValueError)
    for number in (math.nan, math.inf):
        refused(graph.math, "ADD", a, number, names="stands in a node group", error=ValueError)


def test_the_stamp_tells_descriptions_apart():
    def stamp(*, factor=2.0, name="tint", default=0.5, version="1", property_="ADD", inner=1.0):
        graph = Graph(name, "A tint")
        a = graph.input(GroupInput("a", "float", default, "what comes in"))
        within = Graph("inner", "Inside")
        within.output("Image", within.input(GroupInput("Image", "color", (0, 0, 0, 1), "in")) * inner)
        shown = graph.picture(BroughtImage("noise", version, lambda: np.zeros((2, 2), np.uint8)))
        shown = graph.group(within, {"Image": shown}, name="Inner").out("Image", "color")
        graph.output("Image", graph.math(property_, shown, a * factor))
        return graph.stamp

    others = [
        stamp(factor=2.5),
        stamp(name="other"),
        stamp(default=0.25),
        stamp(version="2"),
        stamp(property_="SUBTRACT"),
        stamp(inner=2.0),
    ]
    assert stamp() == stamp()
    assert len({stamp(), *others}) == len(others) + 1
    graph, (a, _) = described("float")
    before = graph.stamp
    graph.output("Image", a)
    assert graph.stamp != before


def test_only_what_an_output_depends_on_is_reached_in_order():
    graph, (a, b) = described("float")
    needed = (a + 1.0) * b
    _ = b - 7.0  # made, and used by nothing
    graph.output("Value", needed, "float")
    assert [graph.nodes[number].properties["operation"] for number in graph.reachable()] == ["ADD", "MULTIPLY"]


def test_the_stamp_is_of_numbers_as_blender_holds_them():
    """In single precision, whose numbers near a third are 3e-8 apart: another numpy makes no other group."""

    def stamp(value):
        graph = Graph("Name", "What it does")
        graph.output("Image", graph.input(GroupInput("Image", "color", (value,) * 4, "What comes in")) * value)
        return graph.stamp

    assert stamp(1 / 3) == stamp(1 / 3 + 1e-12)
    assert stamp(1 / 3) != stamp(1 / 3 + 4e-8)
