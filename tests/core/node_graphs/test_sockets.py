# SPDX-License-Identifier: GPL-3.0-or-later
"""A socket in a description has no value yet: what Python would decide by it fails instead of deciding by accident."""

import pytest
from refusals import refused

from noisy_world.core.node_graph import Graph, GroupInput, Socket


@pytest.fixture
def sockets():
    graph = Graph("group", "for a test")
    return [graph.input(GroupInput(name, "float", 0.0, name)) for name in ("A", "B")]


@pytest.mark.parametrize(
    "decide",
    [
        max,
        lambda a, b: min(a, 1.0),
        lambda a, b: sorted([a, b]),
        lambda a, b: a or b,
        lambda a, b: not a,
        lambda a, b: 1.0 if a else 0.0,
        lambda a, b: 0.0 < a < 1.0,
    ],
    ids=["max", "min", "sorted", "or", "not", "if", "chained"],
)
def test_truth_is_refused_with_what_to_do_instead(sockets, decide):
    refused(decide, *sockets, names=("neither true nor false", "Graph.choose"), error=TypeError)


@pytest.mark.parametrize(
    "decide",
    [lambda a, b: a == 0.5, lambda a, b: a != b, lambda a, b: a in [b], lambda a, b: (0.5, a) == (0.5, b)],
    ids=["number", "socket", "in", "tuple"],
)
def test_equality_is_refused(sockets, decide):
    refused(decide, *sockets, names="cannot be compared", error=TypeError)


def test_a_socket_is_no_key(sockets):
    refused(set, sockets, names="unhashable", error=TypeError)


def test_comparisons_are_nodes(sockets):
    a, b = sockets
    for compared, operation in ((a < b, "LESS_THAN"), (a > 0.5, "GREATER_THAN")):
        assert isinstance(compared, Socket)
        assert compared.graph.nodes[compared.node].properties["operation"] == operation
