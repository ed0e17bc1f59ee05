# SPDX-License-Identifier: GPL-3.0-or-later
"""Positions of a group's nodes: sections from left to right, the nodes of each in the order of the calculation."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from .graph import INTERFACE, Graph, Socket

# Chosen: rough sizes of nodes in Blender's node editor.
COLUMN_PX = 200.0
GAP_PX = 90.0  # between sections
TITLE_PX = 40.0
SOCKET_PX = 24.0
TALL_PX = 900.0  # a column that gets taller is split

Point: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class Arrangement:
    """Positions (x, y), y upwards: of the nodes by number, of a Group Input for each section, of the Group Output."""

    sections: tuple[str, ...]
    positions: Mapping[int, Point]
    entries: Mapping[str, Point]
    output: Point


def arrange(graph: Graph) -> Arrangement:
    """Return positions for all nodes that the outputs depend on; equal descriptions give equal positions."""
    numbers = graph.reachable()
    sections: dict[str, list[int]] = {}
    for number in numbers:
        sections.setdefault(graph.nodes[number].section, []).append(number)
    positions: dict[int, Point] = {}
    entries: dict[str, Point] = {}
    left = 0.0
    for section, members in sections.items():
        if any(_uses_interface(graph, number) for number in members):
            entries[section] = (left, 0.0)
            left += COLUMN_PX
        for column in _columns(graph, members, positions):
            height = sum(_height(graph, number) for number in column)
            top = height / 2
            for number in column:
                positions[number] = (left, top)
                top -= _height(graph, number)
            left += COLUMN_PX
        left += GAP_PX
    if any(item.socket.node == INTERFACE for item in graph.outputs) and "" not in entries:
        entries[""] = (left - COLUMN_PX, -200.0)
    return Arrangement(tuple(name for name in sections if name), positions, entries, (left, 0.0))


def _uses_interface(graph: Graph, number: int) -> bool:
    return any(isinstance(item, Socket) and item.node == INTERFACE for item in graph.nodes[number].inputs.values())


def _columns(graph: Graph, members: list[int], positioned: Mapping[int, Point]) -> list[list[int]]:
    """Put each node to the right of those it depends on; sort each column by the heights of the nodes linked to it."""
    inside = set(members)
    rank: dict[int, int] = {}
    for number in members:
        before = [item.node for item in graph.nodes[number].inputs.values() if isinstance(item, Socket)]
        rank[number] = 1 + max((rank[item] for item in before if item in inside), default=-1)
    columns: list[list[int]] = []
    order: dict[int, float] = {number: position[1] for number, position in positioned.items()}
    for level in range(max(rank.values()) + 1):
        column = [number for number in members if rank[number] == level]
        column.sort(key=lambda number: (-_mean_height(graph, number, order), number))
        for position, number in enumerate(column):
            order[number] = -SOCKET_PX * 4 * (position - (len(column) - 1) / 2)
        part: list[int] = []
        height = 0.0
        for number in column:
            height += _height(graph, number)
            if part and height > TALL_PX:
                columns.append(part)
                part, height = [], _height(graph, number)
            part.append(number)
        columns.append(part)
    return columns


def _mean_height(graph: Graph, number: int, order: Mapping[int, float]) -> float:
    known = [order[item.node] for item in graph.nodes[number].inputs.values() if getattr(item, "node", None) in order]
    return sum(known) / len(known) if known else 0.0


def _height(graph: Graph, number: int) -> float:
    node = graph.nodes[number]
    # An unlinked vector shows a field for each of its three numbers, and its name.
    rows = sum(4 if isinstance(value, tuple) else 1 for value in node.inputs.values())
    rows = max(rows, len(node.group.inputs) if node.group else 0)
    return TITLE_PX + SOCKET_PX * (rows + len(node.properties) + 2)
