# SPDX-License-Identifier: GPL-3.0-or-later
"""A written group in two: the random images that it draws, and the rest, which is given them.

Several severities of a perturbation that draw from one stream draw the same images, so these are made once for all.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..perturbing.kinds import ColourPerturbation
from ..perturbing.steps import Step
from .chain import build_written, capacity_of, step_node
from .graph import INTERFACE, Graph, GroupInput, Socket
from .group_inputs import IMAGE_INPUT, OFFSET_INPUT, PATTERN, REFERENCE_INPUT, SEED_INPUT

_NOISE, _POSITION = "ShaderNodeTexWhiteNoise", "CompositorNodeImageCoordinates"
_FRAME = (IMAGE_INPUT.name, REFERENCE_INPUT.name)
_TIMING = (SEED_INPUT.name, OFFSET_INPUT.name, PATTERN)


@dataclass(frozen=True)
class Divided:
    """A group in two. draws: makes the random images. rest: has an input of the same name for each of them."""

    draws: Graph
    rest: Graph


def divided(graph: Graph) -> Divided | None:
    """Divide what `build_written` describes; None where no random image depends on frame, seed and pattern alone."""
    alike = _alike(graph)
    spread = _reached_from(graph, {number for number, node in enumerate(graph.nodes) if node.idname == _POSITION})
    noise = {number for number in alike & spread if graph.nodes[number].idname == _NOISE}
    drawn = _reached_from(graph, noise) & alike
    handed = [socket for socket in _used_by_others(graph, drawn) if socket.node in drawn]
    if not handed:
        return None
    names = {(socket.node, socket.output): f"Draw {place}" for place, socket in enumerate(handed, start=1)}
    draws, rest = Graph(f"{graph.name}: draws", graph.description), Graph(f"{graph.name}: rest", graph.description)
    made = _copied(graph, draws, handed, {})
    for socket in made:
        draws.output(f"Draw {len(draws.outputs) + 1}", socket, socket.kind, "A random image")
    given = {
        place: GroupInput(names[place], socket.kind, _ZERO[socket.kind], "A random image")
        for place, socket in zip(names, handed, strict=True)
    }
    ends = _copied(graph, rest, [item.socket for item in graph.outputs], given)
    for item, socket in zip(graph.outputs, ends, strict=True):
        rest.output(item.name, socket, item.kind, item.description)
    return Divided(draws, rest)


def pooled(
    chains: Mapping[str, Sequence[Step[ColourPerturbation]]], *, lit: bool = False
) -> Iterator[tuple[tuple[str, ...], Graph | Divided]]:
    """Return chains of equal groups together, each time with the group. lit: as `build_written` says.

    It is divided where several chains name one stream: they draw the same random images, which are then made once.
    """
    equal: dict[tuple[Any, ...], list[str]] = {}
    for name, steps in chains.items():
        what = tuple((step_node(step), step.perturbation.name, tuple(capacity_of(step).items())) for step in steps)
        streams = tuple(step.stream for step in steps)
        equal.setdefault((what, None if None in streams else streams), []).append(name)
    for (_, streams), names in equal.items():
        steps = chains[names[0]]
        parted = divided(build_written(steps, lit=lit)) if streams and len(names) > 1 else None
        yield tuple(names), parted or build_written(steps, lit=lit, apart=True)


_ZERO: Mapping[str, Any] = {"float": 0.0, "vector": (0.0, 0.0, 0.0), "color": (0.0, 0.0, 0.0, 1.0)}


def _is_alike(item: str) -> bool:
    """Tell whether an input of a written group is that of all chains of one stream."""
    return item in _FRAME or item.startswith("Constant ") or item.rpartition(": ")[2] in _TIMING


def _sockets(graph: Graph, number: int) -> list[Socket]:
    return [value for value in graph.nodes[number].inputs.values() if isinstance(value, Socket)]


def _alike(graph: Graph) -> set[int]:
    """Return the nodes whose results are those of all chains of one stream."""
    found: set[int] = set()
    for number in graph.reachable():
        if all(
            _is_alike(item.output) if item.node == INTERFACE else item.node in found for item in _sockets(graph, number)
        ):
            found.add(number)
    return found


def _reached_from(graph: Graph, start: set[int]) -> set[int]:
    """Return these nodes and all that depend on them."""
    found = set(start)
    for number in graph.reachable():
        if any(item.node in found for item in _sockets(graph, number)):
            found.add(number)
    return found


def _used_by_others(graph: Graph, numbers: set[int]) -> list[Socket]:
    """Return what the group's outputs and the nodes that are not among these take, each once."""
    others = [item for number in graph.reachable() if number not in numbers for item in _sockets(graph, number)]
    taken = {(item.node, item.output): item for item in [*others, *(end.socket for end in graph.outputs)]}
    return list(taken.values())


def _copied(
    graph: Graph, target: Graph, ends: list[Socket], given: Mapping[tuple[int, str], GroupInput]
) -> list[Socket]:
    """Copy what these sockets depend on into another description; return them there.

    given: what is an input there, by node and output.
    """
    inputs = {item.name: item for item in graph.inputs}
    made: dict[tuple[int, str], Socket] = {}
    numbers: dict[int, int] = {}

    def socket_of(item: Socket) -> Socket:
        place = item.node, item.output
        if place not in made and item.node == INTERFACE:
            made[place] = target.input(inputs[item.output])
        elif place not in made and place in given:
            made[place] = target.input(given[place])
        elif place not in made:
            made[place] = Socket(target, number_of(item.node), item.output, item.kind)
        return made[place]

    def number_of(number: int) -> int:
        if number not in numbers:
            node = graph.nodes[number]
            values = {name: socket_of(item) if isinstance(item, Socket) else item for name, item in node.inputs.items()}
            copy = target.node(node.idname, values, node.properties, picture=node.picture, group=node.group)
            numbers[number] = copy.number
        return numbers[number]

    return [socket_of(item) for item in ends]
