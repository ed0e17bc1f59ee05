# SPDX-License-Identifier: GPL-3.0-or-later
"""Node graphs as data: nodes and sockets, groups in groups laid flat, and where a node editor shows them.

A node group described as arithmetic, before Blender makes it: sockets, nodes, sections, and a stamp of it all.

A description holds no Blender object. So it is complete, or has failed, before anything in a file is changed. Two
descriptions are equal if their stamps are.
"""

import hashlib
import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, NoReturn, TypeAlias

import numpy as np
from numpy.typing import NDArray

Kind: TypeAlias = Literal["float", "int", "bool", "menu", "vector", "color"]
Value: TypeAlias = "Socket | float | tuple[float, ...]"

IMAGE_KINDS = ("vector", "color")  # the kinds with several numbers at each pixel
INTERFACE = -1  # the node number of the group's own inputs


@dataclass(frozen=True)
class Panel:
    """A part of a group's node with its own title. closed: until a user opens it."""

    name: str
    description: str
    closed: bool = False


@dataclass(frozen=True)
class GroupInput:
    """An input of the group. subtype: Blender's name (PIXEL, ANGLE, DISTANCE, FACTOR), which decides the unit.

    panel: that it stands in, None above all panels. toggles: it is the switch in its panel's title, and stands first in
    it. items: what a menu offers.
    """

    name: str
    kind: Kind
    default: Any
    description: str
    minimum: float | None = None
    maximum: float | None = None
    subtype: str = "NONE"
    panel: Panel | None = None
    toggles: bool = False
    items: tuple[str, ...] = ()


@dataclass(frozen=True)
class GroupOutput:
    """An output of the group and what it shows."""

    name: str
    kind: Kind
    socket: "Socket"
    description: str


@dataclass(frozen=True, eq=False)
class BroughtImage:
    """An image that a group brings with it, for what nodes cannot make.

    make: returns (H, W) or (H, W, 3) uint8 or float32, top row first, equal for equal `version`; or the path of an
    image file, which is used as it is. Values are used as stored, without colour management.
    """

    name: str
    version: str
    make: Callable[[], NDArray[Any] | Path]


@dataclass(frozen=True)
class Node:
    """A node: its type, its properties, its inputs (linked or not), and the section it belongs to.

    follows: of a Value node, the property of the scene that it gives, by its path from the scene, and the number where
    there is none.
    """

    idname: str
    label: str
    section: str
    properties: Mapping[str, Any]
    inputs: Mapping[str, Any]
    picture: BroughtImage | None = None
    group: "Graph | None" = None
    name: str = ""
    follows: tuple[str, float] | None = None


class Socket:  # noqa: PLW1641 - not hashable, as == raises
    """A value in a graph: an output of a node, or an input of the group. Arithmetic and < and > on it make nodes.

    Its value is known only when Blender calculates, so Python cannot decide by it: truth (`if`, `and`, `max`, `in`,
    1 < x < 2) and equality raise TypeError.
    """

    __slots__ = ("graph", "kind", "node", "output")
    kind: Kind

    def __init__(self, graph: "Graph", node: int, output: str, kind: Kind) -> None:
        self.graph = graph
        self.node = node
        self.output = output
        self.kind = kind

    def __add__(self, other: Value) -> "Socket":
        return self.graph.math("ADD", self, other)

    def __radd__(self, other: Value) -> "Socket":
        return self.graph.math("ADD", other, self)

    def __sub__(self, other: Value) -> "Socket":
        return self.graph.math("SUBTRACT", self, other)

    def __rsub__(self, other: Value) -> "Socket":
        return self.graph.math("SUBTRACT", other, self)

    def __mul__(self, other: Value) -> "Socket":
        return self.graph.math("MULTIPLY", self, other)

    def __rmul__(self, other: Value) -> "Socket":
        return self.graph.math("MULTIPLY", other, self)

    def __truediv__(self, other: Value) -> "Socket":
        """Divide; as in Blender's nodes, division by zero gives zero."""
        return self.graph.math("DIVIDE", self, other)

    def __rtruediv__(self, other: Value) -> "Socket":
        return self.graph.math("DIVIDE", other, self)

    def __neg__(self) -> "Socket":
        return self.graph.math("MULTIPLY", self, -1.0)

    def __pow__(self, other: Value) -> "Socket":
        return self.graph.math("POWER", self, other)

    def __lt__(self, other: Value) -> "Socket":
        return self.graph.math("LESS_THAN", self, other)

    def __gt__(self, other: Value) -> "Socket":
        return self.graph.math("GREATER_THAN", self, other)

    def __eq__(self, other: object) -> NoReturn:
        raise TypeError("sockets cannot be compared with ==: ask `is` for the same object, Graph.math for their values")

    def __bool__(self) -> NoReturn:
        raise TypeError(
            "a socket is neither true nor false while the group is described: choose by Graph.choose or a product with "
            "a comparison, take Graph.math's MAXIMUM and MINIMUM, and ask `is None` for one that is not there"
        )

    def __getattr__(self, name: str) -> "Socket":
        """Return a component: x, y and z of a vector; r, g and b of a colour are the same."""
        places = {"x": "X", "y": "Y", "z": "Z", "r": "X", "g": "Y", "b": "Z"}
        if name not in places or self.kind not in IMAGE_KINDS:
            raise AttributeError(name)
        return self.graph.node("ShaderNodeSeparateXYZ", {"Vector": self}).out(places[name], "float")


@dataclass(frozen=True)
class NodeHandle:
    """A node that was added, which gives its outputs."""

    graph: "Graph"
    number: int

    def out(self, identifier: str, kind: Kind) -> Socket:
        """Return an output by its identifier."""
        return Socket(self.graph, self.number, identifier, kind)


# Operations that Blender's Vector Math node does not have; they are built from several nodes.
_VECTOR_OPERATIONS = {"LESS_THAN", "GREATER_THAN"}


@dataclass(eq=False)
class Graph:
    """A node group that is being described.

    name: of the group. description: what it does, for its tooltip. category: the asset catalogue that shows it; "" for
    a group that only other groups use. alone: it stays a group where others are written out (`flat`), as it is large.
    """

    name: str
    description: str
    category: str = ""
    tags: tuple[str, ...] = ()
    alone: bool = False
    inputs: list[GroupInput] = field(default_factory=list)
    outputs: list[GroupOutput] = field(default_factory=list)
    nodes: list[Node] = field(default_factory=list)
    _section: str = ""
    _known: dict[str, int] = field(default_factory=dict)
    _stamped: tuple[tuple[int, ...], str] | None = None

    # --- the group's own sockets ---

    def input(self, item: GroupInput) -> Socket:
        """Add an input of the group."""
        if any(known.name == item.name for known in self.inputs):
            raise ValueError(f"{self.name}: the input {item.name!r} is there twice")
        self.inputs.append(item)
        return Socket(self, INTERFACE, item.name, item.kind)

    def output(self, name: str, socket: Socket, kind: Kind = "color", description: str = "") -> None:
        """Add an output of the group."""
        self.outputs.append(GroupOutput(name, kind, socket, description))

    @contextmanager
    def section(self, label: str) -> Iterator[None]:
        """Put the nodes that are added inside this context into a labelled frame node."""
        before, self._section = self._section, label
        yield
        self._section = before

    # --- nodes ---

    def node(
        self,
        idname: str,
        inputs: Mapping[str, Any],
        properties: Mapping[str, Any] | None = None,
        *,
        label: str = "",
        picture: BroughtImage | None = None,
        group: "Graph | None" = None,
        name: str = "",
        follows: tuple[str, float] | None = None,
    ) -> NodeHandle:
        """Add a node, or return the equal one of the same section.

        inputs: by identifier, each a socket or the value of an unlinked input.
        """
        item = Node(idname, label, self._section, dict(properties or {}), dict(inputs), picture, group, name, follows)
        for value in item.inputs.values():
            if isinstance(value, Socket) and value.graph is not self:
                raise ValueError(f"{self.name}: {idname} is linked to a socket of {value.graph.name}")
        text = json.dumps(_content(item), sort_keys=True)
        if text not in self._known:
            self._known[text] = len(self.nodes)
            self.nodes.append(item)
        return NodeHandle(self, self._known[text])

    def math(self, operation: str, *values: Value, label: str = "") -> Socket:
        """Calculate at every pixel, with images (three numbers a pixel) or with one number.

        operation: as Blender's Math and Vector Math nodes name it; comparisons give 0 and 1.
        """
        kinds = [_kind(value) for value in values]
        if any(kind in IMAGE_KINDS for kind in kinds):
            return self._vector_math(operation, values, label)
        names = ("Value", "Value_001", "Value_002")
        inputs = {name: value for name, value in zip(names, values, strict=False)}  # noqa: C416 - values may be fewer
        return self.node("ShaderNodeMath", inputs, {"operation": operation}, label=label).out("Value", "float")

    def _vector_math(self, operation: str, values: Sequence[Value], label: str) -> Socket:
        if operation in _VECTOR_OPERATIONS:
            # Vector Math has no comparison; the sign of the difference serves as one.
            first, second = values if operation == "GREATER_THAN" else reversed(values)
            sign = self._vector_math("SIGN", (self._vector_math("SUBTRACT", (first, second), ""),), "")
            return self._vector_math("MAXIMUM", (sign, 0.0), label)
        names = ("Vector", "Vector_001", "Vector_002")
        wide = [value if isinstance(value, Socket) else _triple(value) for value in values]
        inputs: dict[str, Any] = dict(zip(names, wide, strict=False))
        scalar = operation in ("DOT_PRODUCT", "LENGTH", "DISTANCE")
        node = self.node("ShaderNodeVectorMath", inputs, {"operation": operation}, label=label)
        return node.out("Value", "float") if scalar else node.out("Vector", "vector")

    def clamp(self, value: Socket, low: Value = 0.0, high: Value = 1.0) -> Socket:
        """Return the value clamped to [low, high]."""
        return self.math("MINIMUM", self.math("MAXIMUM", value, low), high)

    def mix(self, first: Value, second: Value, share: Value) -> Socket:
        """Return first + (second - first) * share."""
        return self.math("MULTIPLY_ADD", self.math("SUBTRACT", second, first), share, first)

    def blend(self, first: Value, second: Value, share: Value) -> Socket:
        """Return first x (1 - share) + second x share: exactly one of the two where the share, clamped, is 0 or 1.

        share: one number a pixel or, between images, three.
        """
        wide = any(_kind(item) in IMAGE_KINDS for item in (first, second))
        suffix, kind = ("Vector", "vector") if wide else ("Float", "float")
        inputs = {f"A_{suffix}": _as(kind, first), f"B_{suffix}": _as(kind, second)}
        properties = {"data_type": suffix.upper()}
        if _kind(share) in IMAGE_KINDS:
            inputs, properties = {"Factor_Vector": share} | inputs, properties | {"factor_mode": "NON_UNIFORM"}
        else:
            inputs = {"Factor_Float": share} | inputs
        node = self.node("ShaderNodeMix", inputs, properties)
        return node.out(f"Result_{suffix}", kind)

    def vector(self, x: Value, y: Value, z: Value = 0.0) -> Socket:
        """Put three numbers together."""
        return self.node("ShaderNodeCombineXYZ", {"X": x, "Y": y, "Z": z}).out("Vector", "vector")

    def choose(self, condition: Socket, if_true: Value, if_false: Value, kind: Kind = "color") -> Socket:
        """Return one of two values; if the condition is a bool input of the group itself, the other is not calculated.

        With a calculated condition, even one value for the whole frame, Blender calculates both. Then choose between
        the frame and a single value before the slow nodes: these take no time for a single value.
        """
        types = {"color": "RGBA", "vector": "VECTOR", "float": "FLOAT", "int": "INT", "bool": "BOOLEAN"}
        inputs = {"Switch": condition, "True": _as(kind, if_true), "False": _as(kind, if_false)}
        return self.node("GeometryNodeSwitch", inputs, {"input_type": types[kind]}).out("Output", kind)

    def chosen(self, menu: Socket) -> list[Socket]:
        """Return for each item of a menu of the group 1 if it is chosen, otherwise 0.

        To be asked once for each menu: two of Blender's nodes cannot share one.
        """
        items = next(item.items for item in self.inputs if item.name == menu.output)
        node = self.node("GeometryNodeMenuSwitch", {"Menu": menu}, {"data_type": "FLOAT", "items": items})
        return [node.out(f"Item_{place}", "float") for place in range(len(items))]

    def picture(self, picture: BroughtImage) -> Socket:
        """Add a node that gives an image of ours."""
        return self.node("CompositorNodeImage", {}, label=picture.name, picture=picture).out("Image", "color")

    def of_scene(self, path: str, otherwise: float) -> Socket:
        """Return a number that follows a property of the scene that is composited, by a driver that needs no script.

        path: from the scene, such as "camera.data.lens". otherwise: where there is none, as without a camera.
        """
        return self.node("ShaderNodeValue", {}, label=path, follows=(path, otherwise)).out("Value", "float")

    def group(self, graph: "Graph", inputs: Mapping[str, Any], name: str = "") -> NodeHandle:
        """Add a group node; its inputs and outputs are identified by their names."""
        return self.node("CompositorNodeGroup", inputs, group=graph, label=name, name=name)

    # --- identity ---

    @property
    def stamp(self) -> str:
        """A hash of the whole description, its numbers as Blender holds them; cached until something is added."""
        size = len(self.inputs), len(self.outputs), len(self.nodes)
        if self._stamped is None or self._stamped[0] != size:
            self._stamped = size, self._hash()
        return self._stamped[1]

    def _hash(self) -> str:
        content = {
            "name": self.name,
            "description": self.description,
            "category": self.category,
            "tags": self.tags,
            "inputs": [astuple(item) for item in self.inputs],
            "outputs": [[item.name, item.kind, _content(item.socket), item.description] for item in self.outputs],
            "nodes": [_content(node) for node in self.nodes],
        }
        return hashlib.sha256(json.dumps(_as_held(content), sort_keys=True).encode()).hexdigest()

    def reachable(self) -> list[int]:
        """Return the numbers of the nodes that an output depends on, each after those it depends on."""
        seen: set[int] = set()
        ordered: list[int] = []

        def visit(number: int) -> None:
            if number == INTERFACE or number in seen:
                return
            seen.add(number)
            for value in self.nodes[number].inputs.values():
                if isinstance(value, Socket):
                    visit(value.node)
            ordered.append(number)

        for item in self.outputs:
            visit(item.socket.node)
        return sorted(ordered)


def _kind(value: Value) -> Kind:
    if isinstance(value, Socket):
        return value.kind
    return "vector" if isinstance(value, tuple) else "float"


def _triple(value: float | tuple[float, ...]) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (float(value),) * 3


def _as(kind: Kind, value: Value) -> Any:
    """Return an unlinked input's value in the form of its kind."""
    if isinstance(value, Socket):
        return value
    if kind == "color":
        return (*_triple(value)[:3], 1.0)
    return _triple(value) if kind == "vector" else value


def _as_held(content: Any) -> Any:
    """Return the content with numbers in single precision: a fit has other last digits with another numpy."""
    if isinstance(content, float):
        return float(np.float32(content))
    if isinstance(content, (list, tuple)):
        return [_as_held(item) for item in content]
    return {name: _as_held(item) for name, item in content.items()} if isinstance(content, dict) else content


def _content(item: Any) -> Any:
    """Return the part of a description that goes into its stamp, as plain values."""
    if item is None or type(item) in (str, int, bool):  # most are, and to ask whether one is a Mapping takes longer
        return item
    if isinstance(item, Socket):
        return ["socket", item.node, item.output, item.kind]
    if isinstance(item, Node):
        picture = [item.picture.name, item.picture.version] if item.picture else None
        parts = [item.idname, item.label, item.section, _content(item.properties), _content(item.inputs)]
        followed = [list(item.follows)] if item.follows else []
        return [*parts, picture, item.group.stamp if item.group else None, item.name, *followed]
    if isinstance(item, Mapping):
        return {str(name): _content(value) for name, value in item.items()}
    if isinstance(item, (tuple, list, np.ndarray)):
        return [_content(value) for value in item]
    if isinstance(item, float) and not math.isfinite(item):
        raise ValueError(f"{item} stands in a node group")
    return item.item() if isinstance(item, np.generic) else item


# A group's description without groups inside it: the same arithmetic, which Blender evaluates in fewer passes.
#
# Whatever a group takes or gives is a whole image in memory; between nodes of one group Blender goes on with a piece
# at a time, in the processor's cache. People read groups inside groups; the generator needs none.


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


# Positions of a group's nodes: sections from left to right, the nodes of each in the order of the calculation.


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
