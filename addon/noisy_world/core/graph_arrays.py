# SPDX-License-Identifier: GPL-3.0-or-later
"""A node graph carried out on arrays: what each node of Blender's compositor makes of numbers and images.

A described node group carried out on arrays, without Blender: the same nodes, the same picture.

For groups whose random pattern is best told by their nodes: written twice, the two would draw different pictures.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .node_graph import IMAGE_KINDS, INTERFACE, BroughtImage, Graph, Kind, Node, Socket
from .srgb import decoded, encoded

# Bob Jenkins' hash of a few words (lookup3, 2006, in the public domain), which Blender's White Noise takes.


Words: TypeAlias = NDArray[np.uint32]

_TWO_WORDS, _THREE_WORDS, _FOUR_WORDS = (np.uint32(0xDEADBEEF + (count << 2) + 13) for count in (2, 3, 4))


def hash_of_two(x: Words, y: Words) -> Words:
    """Return the hash of two words, arrays of one shape."""
    return _final(x + _TWO_WORDS, y + _TWO_WORDS, np.full_like(x, _TWO_WORDS))


def hash_of_three(x: Words, y: Words, z: Words) -> Words:
    """Return the hash of three words, arrays of one shape."""
    return _final(x + _THREE_WORDS, y + _THREE_WORDS, z + _THREE_WORDS)


def hash_of_four(x: Words, y: Words, z: Words, w: Words) -> Words:
    """Return the hash of four words, arrays of one shape."""
    a, b, c = x + _FOUR_WORDS, y + _FOUR_WORDS, z + _FOUR_WORDS
    a, c = (a - c) ^ _turned(c, 4), c + b
    b, a = (b - a) ^ _turned(a, 6), a + c
    c, b = (c - b) ^ _turned(b, 8), b + a
    a, c = (a - c) ^ _turned(c, 16), c + b
    b, a = (b - a) ^ _turned(a, 19), a + c
    c, b = (c - b) ^ _turned(b, 4), b + a
    return _final(a + w, b, c)


def _final(a: Words, b: Words, c: Words) -> Words:
    c = (c ^ b) - _turned(b, 14)
    a = (a ^ c) - _turned(c, 11)
    b = (b ^ a) - _turned(a, 25)
    c = (c ^ b) - _turned(b, 16)
    a = (a ^ c) - _turned(c, 4)
    b = (b ^ a) - _turned(a, 14)
    return (c ^ b) - _turned(b, 24)


def _turned(word: Words, bits: int) -> Words:
    """Turn 32 bits to the left."""
    return (word << np.uint32(bits)) | (word >> np.uint32(32 - bits))


# The arithmetic of Blender's Math, Vector Math, Mix and White Noise nodes on arrays, in float32 as there.
#
# A value is a number, an image of numbers (H, W) with the bottom row first, or three of these: a vector or a colour;
# where alpha has a meaning it is a fourth.


Number: TypeAlias = NDArray[np.float32] | np.float32
Triple: TypeAlias = tuple[Number, Number, Number]
Held: TypeAlias = Number | Triple | tuple[Number, Number, Number, Number]

_ONE, _ZERO = np.float32(1), np.float32(0)


def triple(value: Held) -> Triple:
    """Return a number three times, and three numbers as they are; a fourth, alpha, is left out."""
    return value[:3] if isinstance(value, tuple) else (value, value, value)


def number(value: Held) -> Number:
    """Return one number. Raises TypeError for a vector or a colour, which no description narrows."""
    if isinstance(value, tuple):
        raise TypeError("a vector stands where one number is wanted")
    return value


def _exact(function: Callable[[Any], Any]) -> Callable[[Number], Number]:
    """Return a function that is rounded once from float64 for single numbers, as the C library's nearly always is."""

    def found(value: Number) -> Number:
        if isinstance(value, np.ndarray):
            return function(value)
        return np.float32(function(np.float64(value)))

    return found


def _divided(a: Number, b: Number) -> Number:
    if isinstance(b, np.ndarray):
        return np.where(b == 0, _ZERO, a / np.where(b == 0, _ONE, b)).astype(np.float32)
    return a / b if b != 0 else a * _ZERO


def _power(a: Number, b: Number) -> Number:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.power(a, b)
    return np.float32(np.power(np.float64(a), np.float64(b)))


def _logarithm(a: Number, b: Number) -> Number:
    log = _exact(np.log)
    above = log(np.maximum(a, np.float32(np.finfo(np.float32).tiny)))
    return np.where(a > 0, above / log(b), _ZERO) if isinstance(above, np.ndarray) else above / log(b)


def _wrapped(a: Number, high: Number, low: Number) -> Number:
    span = high - low
    return a - span * np.floor((a - low) / span)


def _there_and_back(a: Number, side: Number) -> Number:
    turns = (a - side) / (side * np.float32(2))
    return np.abs((turns - np.floor(turns)) * side * np.float32(2) - side)


def _told(condition: Any) -> Number:
    return condition.astype(np.float32) if isinstance(condition, np.ndarray) else np.float32(condition)


OPERATIONS: Mapping[str, Callable[..., Number]] = {
    "ADD": lambda a, b: a + b,
    "SUBTRACT": lambda a, b: a - b,
    "MULTIPLY": lambda a, b: a * b,
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "DIVIDE": _divided,
    "POWER": _power,
    "LOGARITHM": _logarithm,
    "EXPONENT": _exact(np.exp),
    "SQRT": lambda a: np.sqrt(np.maximum(a, _ZERO)),
    "ABSOLUTE": np.abs,
    # Of NaN and a number, the number: Blender takes the first, and descriptions put the number first.
    "MINIMUM": np.fmin,
    "MAXIMUM": np.fmax,
    "LESS_THAN": lambda a, b: _told(a < b),
    "GREATER_THAN": lambda a, b: _told(a > b),
    "COMPARE": lambda a, b, near: _told(np.abs(a - b) <= np.maximum(near, np.float32(1e-5))),
    "SIGN": np.sign,
    "FLOOR": np.floor,
    "CEIL": np.ceil,
    "ROUND": lambda a: np.floor(a + np.float32(0.5)),
    "FRACT": lambda a: a - np.floor(a),
    "FRACTION": lambda a: a - np.floor(a),  # the same, of vectors
    "MODULO": np.fmod,
    "WRAP": _wrapped,
    "PINGPONG": _there_and_back,
    "SINE": _exact(np.sin),
    "COSINE": _exact(np.cos),
    "TANGENT": _exact(np.tan),
    "ARCSINE": _exact(np.arcsin),
    "ARCTAN2": np.arctan2,
}


def vector_math(operation: str, values: Sequence[Triple]) -> Held:
    """Calculate with vectors as Vector Math does."""
    if operation in ("DOT_PRODUCT", "LENGTH", "DISTANCE"):
        first, second = values[0], values[-1]
        if operation == "DISTANCE":
            first = second = (first[0] - second[0], first[1] - second[1], first[2] - second[2])
        total = first[0] * second[0] + first[1] * second[1] + first[2] * second[2]
        return total if operation == "DOT_PRODUCT" else np.sqrt(total)
    x, y, z = (OPERATIONS[operation](*parts) for parts in zip(*values, strict=True))
    return x, y, z


def mixed(first: Held, second: Held, share: Number) -> Held:
    """Return first x (1 - share) + second x share, the share clamped, as Mix does."""
    part = np.clip(share, _ZERO, _ONE)
    if not isinstance(first, tuple) and not isinstance(second, tuple):
        return first * (_ONE - part) + second * part
    x, y, z = (a * (_ONE - part) + b * part for a, b in zip(triple(first), triple(second), strict=True))
    return x, y, z


# --- random numbers ---


def white_noise(where: tuple[Number, ...]) -> Callable[[str], Held]:
    """Return White Noise's outputs by name, Value or Color: Jenkins' hash of two to four words (lookup3, 2006)."""
    parts = where
    wide = np.broadcast_arrays(*(np.asarray(part, np.float32) for part in parts))
    words = [np.ascontiguousarray(part).view(np.uint32).reshape(part.shape) for part in wide]
    orders = ((0, 1, 2, 3), (2, 0, 3, 1), (3, 2, 1, 0)) if len(parts) == 4 else (tuple(range(len(parts))),)
    if len(parts) == 2:  # its colour has 1 and 2 as third words; of three words Value alone is known
        words += [np.full_like(words[0], np.float32(number).view(np.uint32)) for number in (1, 2)]
        orders = ((0, 1), (0, 1, 2), (0, 1, 3))

    def uniform(order: tuple[int, ...]) -> Number:
        hashed: Callable[..., Words] = (hash_of_two, hash_of_three, hash_of_four)[len(order) - 2]
        found = hashed(*(words[k] for k in order)).astype(np.float32) / np.float32(2.0**32)
        return found if found.ndim else np.float32(found)

    def of(name: str) -> Held:
        if name == "Value":
            return uniform(orders[0])
        x, y, z = (uniform(order) for order in orders)
        return x, y, z

    return of


# Nodes of Blender's compositor that look at more than one pixel, on arrays: (H, W), the bottom row first.


Image: TypeAlias = NDArray[np.float32]


def size_of(value: Held) -> tuple[int, int]:
    """Return the height and width of an image; 1 and 1 of a single value."""
    shape = np.broadcast_shapes(*(np.shape(part) for part in (value if isinstance(value, tuple) else (value,))))
    return (shape[0], shape[1]) if len(shape) == 2 else (1, 1)


def whole(value: Number, size: tuple[int, int]) -> Image:
    """Return an image of this size, of whatever the value is."""
    return np.ascontiguousarray(np.broadcast_to(np.asarray(value, np.float32), size))


def by_channel(value: Held, function: Callable[[Image], Image]) -> Held:
    """Do the same to each channel of an image."""
    size = size_of(value)
    if not isinstance(value, tuple):
        return function(whole(value, size))
    x, y, z, *alpha = (function(whole(part, size)) for part in value)
    return (x, y, z, alpha[0]) if alpha else (x, y, z)


def coordinates(image: Held) -> Triple:
    """Return each pixel's column and row, from the lower left."""
    height, width = size_of(image)
    x, y = np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)
    return whole(x, (height, width)), whole(y[:, None], (height, width)), np.float32(0)


def looked_up(image: Held, where: Triple, interpolation: str, beyond: tuple[str, str]) -> Held:
    """Return an image's values at places, 0 to 1 along its sides, as Map UV does. beyond: along x and y."""
    height, width = size_of(image)
    at = size_of(where)
    place = [whole(part, at) * np.float32(side) for part, side in zip(where[:2], (width, height), strict=True)]
    sides = (width, height)
    if interpolation == "Nearest":
        columns, rows = (
            _inside(np.floor(part).astype(np.int64), side, how)
            for part, side, how in zip(place, sides, beyond, strict=True)
        )
        taken = [((columns, rows), None)]
    else:
        place = [part - np.float32(0.5) for part in place]
        corner = [np.floor(part) for part in place]
        part = [item - low for item, low in zip(place, corner, strict=True)]
        ends = [
            [_inside(low.astype(np.int64) + step, side, how) for step in (0, 1)]
            for low, side, how in zip(corner, sides, beyond, strict=True)
        ]
        shares = [(1 - item, item) for item in part]
        taken = [((ends[0][i], ends[1][j]), shares[0][i] * shares[1][j]) for j in (0, 1) for i in (0, 1)]

    def channel(values: Image) -> Image:
        total = np.zeros(at, np.float32)
        for ((column, there_x), (row, there_y)), share in taken:
            found = values[row, column]
            if there_x is not None or there_y is not None:
                found = found * ((True if there_x is None else there_x) & (True if there_y is None else there_y))
            total = found if share is None else total + found * share
        return np.asarray(total, np.float32)

    return by_channel(image, channel)


def _inside(index: NDArray[np.int64], side: int, beyond: str) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
    """Return indices that an image has, and where they were ones: None where what is beyond is no matter."""
    if beyond == "Repeat":
        return index % side, None
    kept = np.clip(index, 0, side - 1)
    return kept, (kept == index) if beyond == "Clip" else None


def mean(image: Number) -> np.float32:
    """Return the mean of all pixels."""
    return np.float32(np.mean(image, dtype=np.float64))


def block_means(image: Held, side: Number) -> Held:
    """Return the means of blocks from the lower left, each at all its pixels, as Pixelate does."""
    step = max(int(side), 1)

    def channel(values: Image) -> Image:
        height, width = values.shape
        rows, columns = np.arange(0, height, step), np.arange(0, width, step)
        total = np.add.reduceat(np.add.reduceat(values.astype(np.float64), rows, axis=0), columns, axis=1)
        counts = np.diff([*rows, height])[:, None] * np.diff([*columns, width])
        return (total / counts).astype(np.float32).repeat(step, 0)[:height].repeat(step, 1)[:, :width]

    return by_channel(image, channel)


def blurred(image: Held, size_px: Triple) -> Held:
    """Blur with a Gaussian whose sigma is a third of the size, cut off there, as Blur does with rows and columns."""
    import cv2

    across, along = (_weights(float(part)) for part in size_px[:2])
    return by_channel(
        image,
        lambda values: np.asarray(
            cv2.sepFilter2D(values, cv2.CV_32F, across, along, borderType=cv2.BORDER_REPLICATE), np.float32
        ),
    )


def _weights(size_px: float) -> NDArray[np.float64]:
    if size_px <= 0:
        return np.ones(1)
    places = np.arange(-math.ceil(size_px), math.ceil(size_px) + 1)
    weights = np.exp(-4.5 * (places / size_px) ** 2)
    return weights / weights.sum()


def displaced(image: Held, by: Triple, interpolation: str, beyond: tuple[str, str]) -> Held:
    """Return an image moved by so many pixels to the right and up, as Displace does."""
    height, width = size_of(image)
    columns, rows = (np.arange(side, dtype=np.float32) for side in (width, height))
    half = np.float32(0.5)
    x = (columns + half - np.asarray(by[0], np.float32)) / np.float32(width)
    y = (rows[:, None] + half - np.asarray(by[1], np.float32)) / np.float32(height)
    where = whole(x, (height, width)), whole(y, (height, width)), np.float32(1)
    return looked_up(image, where, interpolation, beyond)


def flipped(image: Held, axes: tuple[int, ...]) -> Held:
    """Return an image mirrored along axes: 0 upside down, 1 left to right."""
    return by_channel(image, lambda values: np.ascontiguousarray(np.flip(values, axes)))


def normalized(image: Number) -> Number:
    """Return an image from 0 at its least to 1 at its greatest value, as Normalize does."""
    low, high = np.min(image), np.max(image)
    return (image - low) * (np.float32(1) / (high - low) if high > low else np.float32(0))


def slopes(image: Held) -> Held:
    """Return the length of Sobel's two differences, as Filter does; the border is repeated."""
    import cv2

    def channel(values: Image) -> Image:
        right, up = (
            cv2.Sobel(values, cv2.CV_32F, *order, borderType=cv2.BORDER_REPLICATE) for order in ((1, 0), (0, 1))
        )
        return np.asarray(np.sqrt(right * right + up * up), np.float32)

    return by_channel(image, channel)


def boxed(image: Held, size_px: Triple) -> Held:
    """Return means of rectangles that reach so many pixels to each side, as Blur does with Flat."""
    import cv2

    sides = [2 * int(part) + 1 for part in size_px[:2]]
    return by_channel(
        image, lambda values: np.asarray(cv2.blur(values, sides, borderType=cv2.BORDER_REPLICATE), np.float32)
    )


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
        if properties.get("factor_mode") == "NON_UNIFORM":
            parts = zip(triple(first), triple(second), triple(values["Factor_Vector"]), strict=True)
            x, y, z = (number(mixed(*part)) for part in parts)
            return x, y, z
        return mixed(first, second, number(values["Factor_Float"]))
    ends = zip(triple(values["A_Color"]), triple(values["B_Color"]), strict=True)
    x, y, z = (np.clip(first * second, np.float32(0), np.float32(1)) for first, second in ends)
    return x, y, z


def _noise(properties: Values, values: Values) -> Any:
    where = triple(values["Vector"])
    return white_noise(
        {"2D": where[:2], "3D": where}.get(properties["noise_dimensions"]) or (*where, number(values["W"]))
    )


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
