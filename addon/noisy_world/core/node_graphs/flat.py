# SPDX-License-Identifier: GPL-3.0-or-later
"""A group's description without groups inside it: the same arithmetic, which Blender evaluates in fewer passes.

Whatever a group takes or gives is a whole image in memory; between nodes of one group Blender goes on with a piece at a
time, in the processor's cache. People read groups inside groups; the generator needs none.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from .graph import INTERFACE, Graph, GroupInput, Kind, Node, Socket

REPEATED = (
    4  # times that a group stands in another at most, to be written out; chosen: Blender makes large groups slowly
)
_SWITCH, _MENU_SWITCH = "GeometryNodeSwitch", "GeometryNodeMenuSwitch"
# From narrow to wide: a link to a wider socket loses nothing, so a group's socket in between changes nothing.
_WIDTH: Mapping[Kind, int] = {"menu": 0, "bool": 0, "int": 1, "float": 2, "vector": 3, "color": 3}


def flat(graph: Graph) -> Graph:
    """Return the description with the groups inside it written out.

    Where a group inside is given a plain True or False, or an item of a menu, and a choice depends on that alone, the
    other branches are left out. A group inside stays one where it is there more than `REPEATED` times or says so,
    itself made flat, and where a link to it narrows what it carries.
    """
    return _Writer(graph).result


class _Writer:
    """Writes groups into one description."""

    def __init__(self, graph: Graph) -> None:
        self.result = Graph(graph.name, graph.description)
        self._constants: dict[tuple[Kind, str], Socket] = {}
        self._groups: dict[str, Graph] = {}
        made = self._write(graph, {item.name: self.result.input(_unshown(item)) for item in graph.inputs})
        for item in graph.outputs:
            self.result.output(item.name, self._socket(item.kind, made[item.name]), item.kind, item.description)

    def _write(self, graph: Graph, given: Mapping[str, Any]) -> dict[str, Any]:
        """Write a group's nodes; return its outputs' values.

        given: for each input a socket, or the value of a bool or a menu.
        """
        numbers: dict[int, int] = {}
        found: dict[int, Mapping[str, Any]] = {INTERFACE: given}

        def value_of(item: Any) -> Any:
            if not isinstance(item, Socket):
                return item
            if item.node in found:
                return found[item.node][item.output]
            return Socket(self.result, numbers[item.node], item.output, item.kind)

        reachable = graph.reachable()
        groups = [graph.nodes[number].group for number in reachable]
        times = Counter(item.stamp for item in groups if item is not None)
        for number in reachable:
            node = graph.nodes[number]
            inputs = {name: value_of(value) for name, value in node.inputs.items()}
            if node.group is not None and self._written(node.group, times, inputs):
                arguments = {item.name: inputs.get(item.name, item.default) for item in node.group.inputs}
                sockets = {item.name: self._argument(item.kind, arguments[item.name]) for item in node.group.inputs}
                found[number] = self._write(node.group, sockets)
            elif (known := _known(node, inputs)) is not None:
                found[number] = known
            else:
                inside = node.group and self._flat_group(node.group)
                brought = {"picture": node.picture, "group": inside, "follows": node.follows}
                made = self.result.node(node.idname, inputs, node.properties, **brought)
                numbers[number] = made.number
        return {item.name: value_of(item.socket) for item in graph.outputs}

    def _written(self, group: Graph, times: Mapping[str, int], inputs: Mapping[str, Any]) -> bool:
        """Tell whether a group inside is written out."""
        return not group.alone and times[group.stamp] <= REPEATED and _fits(group, inputs)

    def _flat_group(self, group: Graph) -> Graph:
        if group.stamp not in self._groups:
            self._groups[group.stamp] = made = flat(group)
            made.name, made.alone = f"{group.name} (flat)", group.alone
        return self._groups[group.stamp]

    def _argument(self, kind: Kind, value: Any) -> Any:
        return value if isinstance(value, bool | str) else self._socket(kind, value)

    def _socket(self, kind: Kind, value: Any) -> Socket:
        """Return a socket that gives a value; a plain one becomes an input that is never set."""
        if isinstance(value, Socket):
            return value
        key = kind, repr(value)
        if key not in self._constants:
            name = f"Constant {len(self._constants) + 1}"
            self._constants[key] = self.result.input(GroupInput(name, kind, value, "A value in the group"))
        return self._constants[key]


def _unshown(item: GroupInput) -> GroupInput:
    """Return an input without its place on the node, which nobody sees."""
    return replace(item, panel=None, toggles=False)


def _known(node: Node, inputs: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return what a choice gives whose condition is known, by its outputs; None for other nodes."""
    if node.idname == _MENU_SWITCH and isinstance(inputs["Menu"], str):
        return {f"Item_{place}": float(item == inputs["Menu"]) for place, item in enumerate(node.properties["items"])}
    if node.idname != _SWITCH or not isinstance(inputs["Switch"], bool):
        return None
    chosen = inputs["True" if inputs["Switch"] else "False"]
    return {"Output": chosen} if isinstance(chosen, Socket) else None


def _fits(group: Graph, inputs: Mapping[str, Any]) -> bool:
    """Tell whether no link to or from a group's sockets narrows what it carries."""
    links: list[tuple[Kind, Kind]] = [(item.socket.kind, item.kind) for item in group.outputs]
    for item in group.inputs:
        value = inputs.get(item.name)
        if isinstance(value, Socket):
            links.append((value.kind, item.kind))
    return all(_WIDTH[source] <= _WIDTH[target] for source, target in links)
