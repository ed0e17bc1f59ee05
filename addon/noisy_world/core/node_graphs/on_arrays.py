# SPDX-License-Identifier: GPL-3.0-or-later
"""A described node group carried out on arrays, without Blender: the same nodes, the same picture.

For groups whose random pattern is best told by their nodes: written twice, the two would draw different pictures.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..linear_light import decoded, encoded
from .array_images import (
    block_means,
    blurred,
    boxed,
    coordinates,
    displaced,
    flipped,
    looked_up,
    mean,
    normalized,
    size_of,
    slopes,
    whole,
)
from .array_math import OPERATIONS, Held, Number, mixed, number, triple, vector_math, white_noise
from .graph import IMAGE_KINDS, INTERFACE, BroughtImage, Graph, Kind, Node, Socket

BAND_ROWS = 16  # of a frame, which a group of arithmetic alone is given together; chosen: they stay in the cache
_ARITHMETIC = (
    "ShaderNodeMath",
    "ShaderNodeVectorMath",
    "ShaderNodeMix",
    "ShaderNodeTexWhiteNoise",
    "ShaderNodeCombineXYZ",
    "ShaderNodeSeparateXYZ",
)


def carried_out(graph: Graph, given: Mapping[str, Any], frame: int = 0) -> dict[str, Held]:
    """Return a group's outputs by name.

    given: by an input's name a number, a text, (H, W) or (H, W, 3) with the top row first, or what another group gave;
    others have their defaults. frame: of the scene. Raises ValueError for a node that has no counterpart here.
    """
    with np.errstate(all="ignore"):
        return _Walk(graph, {name: _held(value) for name, value in given.items()}, frame).outputs()


def image_of(value: Held, size: tuple[int, int]) -> NDArray[np.float32]:
    """Return a colour as (H, W, 3), the top row first. size: height and width."""
    return np.stack([whole(part, size) for part in triple(value)], axis=-1)[::-1]


def _held(value: Any) -> Any:
    """Return a value as it is held: images with the bottom row first, a vector as its parts."""
    if isinstance(value, np.ndarray) and value.ndim == 3:
        return tuple(np.ascontiguousarray(value[::-1, :, k], np.float32) for k in range(3))
    if isinstance(value, np.ndarray) and value.ndim == 2:
        return np.ascontiguousarray(value[::-1], np.float32)
    return value


def _plain(value: Any) -> Any:
    """Return an unlinked value as it is held."""
    if isinstance(value, bool | str) or value is None:
        return value
    if isinstance(value, tuple) and not isinstance(value[0], np.ndarray):
        return tuple(np.float32(part) for part in value[:3])
    return np.float32(value) if isinstance(value, int | float) else value


def _as_kind(kind: Kind, value: Any) -> Any:
    if isinstance(value, bool | str):
        return value
    return value if kind not in IMAGE_KINDS or isinstance(value, tuple) else triple(value)


class _Walk:
    """Carries out one group's nodes, each when it is first asked for, and forgets what nobody will ask for again."""

    def __init__(self, graph: Graph, given: Mapping[str, Any], frame: int) -> None:
        self._graph, self._frame = graph, frame
        self._given = {
            item.name: _as_kind(item.kind, _plain(given.get(item.name, item.default))) for item in graph.inputs
        }
        self._found: dict[int, Any] = {}
        self._asked = Counter(
            socket.node for at in graph.reachable() for socket in _sockets(graph.nodes[at])
        ) + Counter(item.socket.node for item in graph.outputs)

    def outputs(self) -> dict[str, Held]:
        """Return the group's outputs."""
        return {item.name: _as_kind(item.kind, self._of(item.socket)) for item in self._graph.outputs}

    def _of(self, socket: Socket) -> Any:
        """Return a socket's value; nodes that wait for others stand on a pile, as they may be many."""
        pile = [socket.node]
        while pile:
            at = pile[-1]
            if at == INTERFACE or at in self._found:
                pile.pop()
                continue
            wanted = [item.node for item in self._wanted(self._graph.nodes[at])]
            missing = [item for item in wanted if item != INTERFACE and item not in self._found]
            pile += missing
            if not missing:
                self._found[at] = self._made(self._graph.nodes[at])
                pile.pop()
        return self._output(socket)

    def _wanted(self, node: Node) -> list[Socket]:
        """Return the inputs that a node needs; of a choice, its condition first and then one branch."""
        if node.idname != "GeometryNodeSwitch":
            return _sockets(node)
        switch = node.inputs["Switch"]
        if isinstance(switch, Socket) and switch.node != INTERFACE and switch.node not in self._found:
            return [switch]
        branch = node.inputs["True" if self._holds(switch) else "False"]
        return [item for item in (switch, branch) if isinstance(item, Socket)]

    def _holds(self, switch: Any) -> bool:
        value = self._value(switch)
        return value if isinstance(value, bool) else bool(number(value) > 0)

    def _output(self, socket: Socket) -> Any:
        """Return a socket's value, and forget its node where nobody will ask again."""
        value = self._value(socket)
        self._asked[socket.node] -= 1
        if socket.node != INTERFACE and self._asked[socket.node] == 0:
            self._found[socket.node] = None
        return value

    def _value(self, item: Any) -> Any:
        """Return an input's value without counting that it was asked for."""
        if not isinstance(item, Socket):
            return _plain(item)
        if item.node == INTERFACE:
            return self._given[item.output]
        found = self._found[item.node]
        return found(item.output) if callable(found) else found[item.output] if isinstance(found, dict) else found

    def _made(self, node: Node) -> Any:
        if node.idname == "GeometryNodeSwitch":
            kind = "vector" if node.properties["input_type"] in ("RGBA", "VECTOR") else "float"
            return _as_kind(kind, self._value(node.inputs["True" if self._holds(node.inputs["Switch"]) else "False"]))
        values = {
            name: self._output(value) if isinstance(value, Socket) else _plain(value)
            for name, value in node.inputs.items()
        }
        if node.group is not None:
            return self._inside(node.group, values)
        if node.picture is not None:
            return _picture(node.picture)
        return _of_node(node, values, self._frame)

    def _inside(self, group: Graph, values: Mapping[str, Any]) -> dict[str, Held]:
        """Carry out a group inside; of arithmetic alone, some rows at a time."""
        rows = max((size_of(value)[0] for value in values.values() if not isinstance(value, bool | str)), default=1)
        if rows <= BAND_ROWS or any(node.idname not in _ARITHMETIC for node in group.nodes):
            return _Walk(group, values, self._frame).outputs()
        bands = [
            _Walk(group, {name: _rows(value, first) for name, value in values.items()}, self._frame).outputs()
            for first in range(0, rows, BAND_ROWS)
        ]
        return {name: _stacked([band[name] for band in bands]) for name in bands[0]}


@lru_cache(maxsize=8)
def _picture(picture: BroughtImage) -> Held:
    """Return a picture that a group brings, as stored: bytes as 255ths."""
    made = picture.make()
    assert not isinstance(made, Path), "those that are drawn, not read, are carried out on arrays"
    values = made if made.dtype == np.float32 else made.astype(np.float32) / np.float32(255)
    return triple(_held(values))


def _sockets(node: Node) -> list[Socket]:
    return [value for value in node.inputs.values() if isinstance(value, Socket)]


def _rows(value: Any, first: int) -> Any:
    if isinstance(value, tuple):
        return tuple(_rows(part, first) for part in value)
    return value[first : first + BAND_ROWS] if isinstance(value, np.ndarray) else value


def _stacked(parts: list[Any]) -> Any:
    if isinstance(parts[0], tuple):
        return tuple(_stacked(list(part)) for part in zip(*parts, strict=True))
    return np.concatenate(parts) if isinstance(parts[0], np.ndarray) else parts[0]


# --- nodes ---

Values: TypeAlias = Mapping[str, Any]
_BLURS = {"Gaussian": blurred, "Flat": boxed}
_CHANNELS = ("Red", "Green", "Blue")


def _of_node(node: Node, values: Values, frame: int) -> Any:
    """Return what a node gives: a value, or several by its outputs' names."""
    if node.idname == "CompositorNodeSceneTime":
        return np.float32(frame)
    if node.idname not in _NODES:
        raise ValueError(f"{node.idname} of a node group has no counterpart on arrays")
    return _NODES[node.idname](node.properties, values)


def _mix(properties: Values, values: Values) -> Held:
    if properties.get("blend_type") != "MULTIPLY":
        first, second = (values[f"{end}_{properties['data_type'].capitalize()}"] for end in "AB")
        return mixed(first, second, number(values["Factor_Float"]))
    ends = zip(triple(values["A_Color"]), triple(values["B_Color"]), strict=True)
    x, y, z = (np.clip(first * second, np.float32(0), np.float32(1)) for first, second in ends)
    return x, y, z


def _noise(_properties: Values, values: Values) -> Any:
    return white_noise(triple(values["Vector"]), number(values["W"]) if "W" in values else None)


def _by_channels(names: Iterable[str], value: Held) -> dict[str, Held]:
    return dict(zip(names, triple(value), strict=True))


def _alpha(value: Held) -> Number:
    return value[3] if isinstance(value, tuple) and len(value) == 4 else np.float32(1)


def _chosen(properties: Values, values: Values) -> dict[str, Held]:
    return {f"Item_{place}": np.float32(item == values["Menu"]) for place, item in enumerate(properties["items"])}


def _converted(properties: Values, values: Values) -> Held:
    spaces, image = (properties["from_color_space"], properties["to_color_space"]), values["Image"]
    curve = {("sRGB", "Linear Rec.709"): decoded, ("Linear Rec.709", "sRGB"): encoded}[spaces]
    parts = (curve(np.atleast_2d(np.asarray(part, np.float32))) for part in triple(image))
    x, y, z = (part if size_of(image) != (1, 1) else np.float32(part[0, 0]) for part in parts)
    return x, y, z


def _size(_properties: Values, values: Values) -> Held:
    height, width = size_of(values["Image"])
    return np.float32(width), np.float32(height), np.float32(0)


def _coordinates(_properties: Values, values: Values) -> dict[str, Held]:
    """Return pixels from the lower left, and the places of their middles from 0 to 1."""
    x, y, _ = pixel = coordinates(values["Image"])
    height, width = size_of(values["Image"])
    half = np.float32(0.5)
    middle = (x + half) / np.float32(width), (y + half) / np.float32(height), np.float32(0)
    return {"Pixel": pixel, "Normalized": middle}


def _blank(_properties: Values, values: Values) -> Held:
    width, height = (max(int(number(part)), 1) for part in triple(values["Size"])[:2])
    x, y, z = (np.zeros((height, width), np.float32) for _ in range(3))
    return x, y, z


def _levels(_properties: Values, values: Values) -> dict[str, Held]:
    part = _by_channels(_CHANNELS, values["Image"])[values["Channel"]]
    return {"Mean": mean(number(part)), "Maximum": np.max(part), "Minimum": np.min(part)}


def _beyond(values: Values) -> tuple[str, str]:
    return values["Extension X"], values["Extension Y"]


def _map_uv(_properties: Values, values: Values) -> Held:
    return looked_up(values["Image"], triple(values["UV"]), values["Interpolation"], _beyond(values))


def _displace(_properties: Values, values: Values) -> Held:
    return displaced(values["Image"], triple(values["Displacement"]), values["Interpolation"], _beyond(values))


def _blur(_properties: Values, values: Values) -> Held:
    if values["Type"] not in _BLURS or not values["Separable"]:
        raise ValueError(f"a blur of a node group that is {values['Type']} has no counterpart on arrays")
    return _BLURS[values["Type"]](values["Image"], triple(values["Size"]))


def _flip(_properties: Values, values: Values) -> Held:
    return flipped(values["Image"], tuple(axis for axis, name in enumerate(("Flip Y", "Flip X")) if values[name]))


def _filter(_properties: Values, values: Values) -> Held:
    if values["Type"] != "Sobel":
        raise ValueError(f"a filter of a node group that is {values['Type']} has no counterpart on arrays")
    return slopes(values["Image"])


def _crop(_properties: Values, values: Values) -> Held:
    width, height = (int(number(values[side])) for side in ("Width", "Height"))
    size = size_of(values["Image"])
    left, low = (int(number(values.get(name, 0))) for name in "XY")
    x, y, z = (whole(part, size)[low : low + height, left : left + width] for part in triple(values["Image"]))
    return x, y, z


_NODES: Mapping[str, Callable[[Values, Values], Any]] = {
    "ShaderNodeMath": lambda p, v: OPERATIONS[p["operation"]](*map(number, v.values())),
    "ShaderNodeVectorMath": lambda p, v: vector_math(p["operation"], [triple(value) for value in v.values()]),
    "ShaderNodeMix": _mix,
    "ShaderNodeTexWhiteNoise": _noise,
    "ShaderNodeCombineXYZ": lambda _, v: tuple(number(v[axis]) for axis in "XYZ"),
    "ShaderNodeSeparateXYZ": lambda _, v: _by_channels("XYZ", v["Vector"]),
    "GeometryNodeMenuSwitch": _chosen,
    "GeometryNodeIndexSwitch": lambda _, v: v[f"Item_{int(number(v['Index']))}"],
    "CompositorNodeSeparateColor": lambda _, v: _by_channels(_CHANNELS, v["Image"]) | {"Alpha": _alpha(v["Image"])},
    "CompositorNodeSetAlpha": lambda _, v: (*triple(v["Image"]), number(v["Alpha"])),
    "CompositorNodeConvertColorSpace": _converted,
    "CompositorNodeImageInfo": _size,
    "CompositorNodeImageCoordinates": _coordinates,
    "CompositorNodeBlankImage": _blank,
    "CompositorNodeLevels": _levels,
    "CompositorNodeMapUV": _map_uv,
    "CompositorNodePixelate": lambda _, v: block_means(v["Color"], number(v["Size"])),
    "CompositorNodeBlur": _blur,
    "CompositorNodeDisplace": _displace,
    "CompositorNodeNormalize": lambda _, v: normalized(v["Value"]),
    "CompositorNodeFlip": _flip,
    "CompositorNodeFilter": _filter,
    "CompositorNodeCrop": _crop,
}
