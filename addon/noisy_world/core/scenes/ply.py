# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading PLY meshes of every dialect.

A file is read into bytes once and its properties become strided views of them. Text is first turned into float64
numbers, after which it is read as if it were a binary file of doubles.
"""

import re
import struct
import warnings
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from itertools import chain, repeat
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .mesh import Mesh

type _Int64s = NDArray[np.int64]

_SIZED = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")
_UNSIZED = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double")
_TYPES = {name: np.dtype(sized) for name, sized in zip(_SIZED + _UNSIZED, _SIZED * 2, strict=True)}
_LENGTH_TYPES = {name for name, kind in _TYPES.items() if kind.kind in "iu"}
_BYTE_ORDERS: dict[str, Literal["=", "<", ">"]] = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_COLOUR_NAMES = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_INDEX_NAMES = ("vertex_indices", "vertex_index")
_COLOUR_SLACK = 1e-3  # of full scale: colours stored as floats may overshoot their range by rounding
_COARSE_M = 1e-4  # float32 coordinates whose resolution is coarser than this are worth a note; chosen
_TEXT_BLOCK = 1 << 18  # bytes: a block and its masks stay in the processor's cache
_POWERS_OF_TEN = 10.0 ** np.arange(23)  # 10^22 is the largest power of ten that is exact in float64
_DAMAGED = "the file is damaged: export it again"


@dataclass(frozen=True)
class _Element:
    """An element as the header declares it: the type of each property; 'NAME length' is the length of list NAME."""

    name: str
    rows: int
    kinds: dict[str, np.dtype]
    lists: list[str]


@dataclass(frozen=True)
class _Body:
    """What follows the header: the file's own bytes, or the float64 numbers of a text file."""

    path: Path
    data: bytes
    encoding: str
    flaw: InputError | None = None  # why the numbers of a text file end early

    def stored(self, kind: np.dtype) -> np.dtype:
        return np.dtype("f8") if self.encoding == "ascii" else kind.newbyteorder(_BYTE_ORDERS[self.encoding])


@dataclass(frozen=True)
class _Rows:
    """The positions of one element's rows in the body, in bytes.

    lengths: (1, L) int64 where the L lists of the element are equally long in all rows, else (rows, L).
    """

    body: _Body
    element: _Element
    begin: int
    lengths: _Int64s

    @cached_property
    def layout(self) -> tuple[dict[str, _Int64s], _Int64s]:
        """The beginning of each property and the rows' sizes: (1,) int64 if all rows are alike, else (rows,)."""
        offsets, sizes = {}, np.zeros(len(self.lengths), np.int64)
        for name, kind in self.element.kinds.items():
            offsets[name] = sizes
            sizes = sizes + self.counts(name) * self.body.stored(kind).itemsize
        starts = self.begin + np.cumsum(sizes) - sizes
        return {name: starts + offset for name, offset in offsets.items()}, sizes

    @property
    def end(self) -> int:
        return self.begin + int(self.layout[1].sum()) * (self.element.rows if len(self.lengths) == 1 else 1)

    def counts(self, name: str) -> _Int64s:
        """How many values a property has: (1,) int64 if in all rows equally many, else (rows,)."""
        lists = self.element.lists
        return self.lengths[:, lists.index(name)] if name in lists else np.ones(len(self.lengths), np.int64)

    def values(self, name: str) -> NDArray:
        """All values of a property, row after row."""
        begins, counts, stored = self.layout[0][name], self.counts(name), self.body.stored(self.element.kinds[name])
        data, size = self.body.data, stored.itemsize
        if len(self.lengths) == 1:
            shape, strides = (self.element.rows, int(counts[0])), (int(self.layout[1][0]), size)
            return np.ndarray(shape, stored, data, int(begins[0]), strides).reshape(-1)
        positions = np.repeat(begins - (np.cumsum(counts) - counts) * size, counts)
        positions += np.arange(0, len(positions) * size, size)
        return np.ndarray(max(len(data) - size + 1, 0), stored, data, 0, (1,))[positions]  # of the value at every byte


def read_ply(path: Path) -> Mesh:
    """Read a polygon mesh from a PLY file, ASCII or binary of either byte order.

    Vertices keep the file's precision; normals, alpha and all other properties are skipped. Messages count from 0.

    Returns a Mesh: vertices_m (V, 3) float64 metres, rgb (V, 3) float32 in [0, 1] or None, faces of three or more
    corners with none repeated in succession, and notes on what was dropped, guessed or lost.
    Raises InputError where the file is missing, not a PLY, cut short, damaged, or not a mesh.
    """
    encoding, elements, header_lines, data = _open(path, whole=True)
    body = _parse_text(path, data, header_lines) if encoding == "ascii" else _Body(path, data, encoding)
    tables, position, notes = {}, 0, []
    for name, element in elements.items():
        tables[name] = _locate(body, element, position)
        position = tables[name].end
    if position < len(body.data) or body.flaw:
        notes.append("the file goes on after its data: the rest was ignored")
    elif encoding == "ascii" and not data[-1:].isspace():
        notes.append("the last line has no line end: if the file was cut there, its last number is wrong")
    with np.errstate(invalid="ignore", over="ignore"):  # odd bit patterns are judged by the checks, not by warnings
        vertices_m = _vertices(tables["vertex"], notes)
        rgb = _colours(tables["vertex"], notes)
        corners, starts = _faces(tables["face"], len(vertices_m), notes)
    return Mesh(vertices_m, rgb, corners, starts, tuple(notes))


def check_ply(path: Path) -> None:
    """Read the header only; raise InputError where the file is missing, not a PLY, or not a mesh."""
    _open(path, whole=False)


def _open(path: Path, *, whole: bool) -> tuple[str, dict[str, _Element], int, bytes]:
    """Return the encoding, the elements, the number of header lines, and the body if `whole`."""
    try:
        with Path(path).open("rb") as file:
            encoding, elements, header_lines = _read_header(path, file)
            data = file.read() if whole else b""
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error
    _check_is_mesh(path, elements)
    return encoding, elements, header_lines, data


def _read_header(path: Path, file: BinaryIO) -> tuple[str, dict[str, _Element], int]:
    """Return the encoding, the elements in the file's order, and the number of lines; leaves the file at its data."""
    if file.readline(16).split() != [b"ply"]:
        raise InputError(path, "not a PLY file", remedy="the first line of a PLY file reads 'ply'")
    encoding, elements, kinds, lists = "", {}, {}, []
    for number, line in enumerate(file, start=2):
        where = f"header line {number}"
        words = [word.decode("latin-1") for word in line.split()]
        fresh = elements and words and words[-1] not in kinds
        match words:
            case ["end_header"] if encoding:
                return encoding, elements, number
            case ["comment" | "obj_info", *_]:
                pass
            case ["format", name, "1.0"] if name in _BYTE_ORDERS:
                encoding = name
            case ["format", *_]:
                remedy = f"version 1.0 of {', '.join(_BYTE_ORDERS)} can be read"
                raise InputError(path, f"unknown format {' '.join(words[1:])[:60]!r}", where=where, remedy=remedy)
            case ["element", name, rows] if re.fullmatch("[0-9]{1,18}", rows) and name not in elements:
                kinds, lists = {}, []
                elements[name] = _Element(name, int(rows), kinds, lists)
            case ["property", kind, name] if fresh and kind in _TYPES:
                kinds[name] = _TYPES[kind]
            case ["property", "list", length, kind, name] if fresh and length in _LENGTH_TYPES and kind in _TYPES:
                kinds |= {f"{name} length": _TYPES[length], name: _TYPES[kind]}
                lists.append(name)
            case _ if words:
                raise InputError(path, f"malformed: {' '.join(words)[:60]!r}", where=where, remedy=_DAMAGED)
    raise InputError(path, "cut short: its header has no end_header", remedy=_DAMAGED)


def _check_is_mesh(path: Path, elements: dict[str, _Element]) -> None:
    vertex, face = elements.get("vertex"), elements.get("face")
    if vertex is None or vertex.rows == 0 or not {"x", "y", "z"} <= vertex.kinds.keys() - set(vertex.lists):
        raise InputError(path, "holds no vertices with x, y and z", remedy="export it as a polygon mesh")
    if face is None or face.rows == 0:
        raise InputError(path, "holds no faces: a point cloud", remedy="mesh it first")
    if not any(name in face.lists and face.kinds[name].kind in "iu" for name in _INDEX_NAMES):
        raise InputError(path, "its faces have no integer list vertex_indices", remedy="export it as a polygon mesh")


def _parse_text(path: Path, text: bytes, header_lines: int) -> _Body:
    """Return the numbers of a text body, up to the first word that is not a number."""
    flaw, blocks, stream = None, [np.empty(0)], BytesIO(text + b"\n")
    while not flaw and (block := stream.read(_TEXT_BLOCK) + stream.readline()):
        numbers = _decimals(block)
        if numbers is None:
            numbers = _from_text(block, np.float64, len(block.split()))
        if numbers is None:
            bad = next(word for word in re.finditer(rb"\S+", block) if _from_text(word[0], np.float64, 1) is None)
            where = f"line {header_lines + 1 + text.count(b'\n', 0, stream.tell() - len(block) + bad.start())}"
            flaw = InputError(path, f"{str(bad[0][:40])[1:]} is not a number", where=where, remedy=_DAMAGED)
            block = block[: bad.start()]
            numbers = _from_text(block, np.float64, len(block.split()))
            assert numbers is not None, "every word before the first bad one is a number"
        blocks.append(numbers)
    return _Body(path, np.concatenate(blocks).tobytes(), "ascii", flaw)


def _decimals(block: bytes) -> NDArray[np.float64] | None:
    """Return a block's numbers, or None if one has more than 15 digits or an odd form, or a word is not a number.

    An integer below 2^53 multiplied or divided by an exact power of ten is rounded only once, so it is the nearest
    float64, in a quarter of the time of a general conversion. An exponent is read as a separate word.
    """
    characters = np.frombuffer(block, np.uint8)
    blank, marks = characters <= ord(" "), np.flatnonzero((characters | 32) == ord("e"))
    loose = np.any(blank[marks - 1] | blank[marks + 1]) or b".-" in block or b".+" in block
    blank[marks] = True
    ends, dots = np.flatnonzero(blank[1:] & ~blank[:-1]) + 1, np.flatnonzero(characters == ord("."))
    dotted, scaled = np.searchsorted(ends, dots), np.searchsorted(ends, marks)
    if loose or 0 in np.diff(dotted) or 1 in np.diff(scaled) or np.isin(scaled + 1, dotted).any():
        return None
    whole = _from_text(block.translate(bytes.maketrans(b"eE", b"  "), b"."), np.int64, len(ends))
    if whole is None:
        return None
    powers = np.zeros(len(ends), np.int64)
    powers[dotted] = dots + 1 - ends[dotted]
    powers[scaled] += whole[scaled + 1]
    numbers = whole * _POWERS_OF_TEN[np.clip(powers, 0, 22)] / _POWERS_OF_TEN[np.clip(-powers, 0, 22)]
    exact = np.all((abs(powers) <= 22) & (whole < 1 << 53) & (whole > -1 << 53))
    return np.delete(numbers, scaled + 1) if exact else None


def _from_text(block: bytes, kind: type, words: int) -> NDArray | None:
    if words == 0:  # numpy reads a number from blanks alone
        return np.empty(0, kind)
    with warnings.catch_warnings(action="ignore"), suppress(ValueError):  # older numpy warns and stops early
        numbers = np.fromstring(block, kind, sep=" ")
        return numbers if len(numbers) == words else None  # 1.5.2 is one word and parts of two numbers
    return None


def _locate(body: _Body, element: _Element, begin: int) -> _Rows:
    """Find the rows of an element; raise InputError where the file cannot hold as many as its header promises."""
    rows = _Rows(body, element, begin, np.zeros((1, len(element.lists)), np.int64))
    least = int(rows.layout[1][0])
    found = min(element.rows, (len(body.data) - begin) // least) if least else element.rows
    if element.lists and found == element.rows > 0:  # a promise that the file cannot keep allocates nothing
        first, rows = rows, _Rows(body, element, begin, _walk(rows, 1))
        fits = len(rows.lengths) == 1 and rows.end <= len(body.data)
        if not (fits and all(np.all(rows.values(f"{name} length") == rows.counts(name)) for name in element.lists)):
            rows = _Rows(body, element, begin, _walk(first, element.rows))
            found = len(rows.lengths)
    if found < element.rows:
        problem = f"cut short: the header promises {element.rows} x {element.name}, the file has room for {found}"
        raise body.flaw or InputError(body.path, problem, remedy=_DAMAGED)
    return rows


def _walk(empty: _Rows, rows: int) -> _Int64s:
    """(rows, L) int64: the lengths of the L lists in the first rows, up to the last that the body holds whole."""
    body, element, data, steps, lengths = empty.body, empty.element, empty.body.data, [], []
    at = [int(empty.layout[0][f"{name} length"][0]) for name in element.lists]
    codes = [body.stored(element.kinds[f"{name} length"]).char for name in element.lists]
    gaps = np.diff([*at, at[0] + empty.layout[1][0]]).tolist()
    for name, code, gap in zip(element.lists, codes, gaps, strict=True):
        unpack = struct.Struct(_BYTE_ORDERS[body.encoding] + code).unpack_from
        steps.append((unpack, gap, body.stored(element.kinds[name]).itemsize))
    position = at[0]
    with suppress(struct.error, IndexError, ValueError, OverflowError):  # the end, or no length: the caller reports it
        if codes == ["B"]:  # nearly all files, in a third of the time
            _, gap, size = steps[0]
            for _ in range(rows):
                lengths.append(data[position])
                position += gap + lengths[-1] * size
        else:
            for unpack, gap, size in chain.from_iterable(repeat(steps, rows)):
                (length,) = unpack(data, position)
                lengths.append(length)
                position += gap + int(length) * size
    flat = np.array(lengths, np.float64)
    bad = np.flatnonzero(~((flat >= 0) & (flat < 1 << 32)) | (flat != np.floor(flat)))
    if len(bad):
        where, problem = f"{element.name} {bad[0] // len(at)}", f"a list of {flat[bad[0]]:.15g} items cannot be"
        raise InputError(body.path, problem, where=where, remedy=_DAMAGED)
    table = flat[: len(flat) // len(at) * len(at)].reshape(-1, len(at)).astype(np.int64)
    ends = empty.begin + np.cumsum(_Rows(body, element, empty.begin, table).layout[1])
    return table[ends <= len(data)]


def _vertices(rows: _Rows, notes: list[str]) -> NDArray[np.float64]:
    columns = [rows.values(name) for name in ("x", "y", "z")]
    vertices_m = np.stack(columns, axis=1, dtype=np.float64, casting="unsafe")
    _check_finite(rows, vertices_m, "coordinate")
    farthest_m = np.float32(abs(vertices_m).max())
    apart_m = np.spacing(farthest_m)
    if apart_m > _COARSE_M and any(column.dtype.str[1:] == "f4" for column in columns):
        stored = f"coordinates near {farthest_m:.0f} m are stored as float32, {1000 * apart_m:.2f} mm apart"
        notes.append(f"{stored}: finer shape is lost in the file itself")
    return vertices_m


def _check_finite(rows: _Rows, values: NDArray, what: str) -> None:
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(bad):
        problem = f"a {what} is NaN or infinite, at {len(bad)} of {len(values)} vertices, this the first"
        raise InputError(rows.body.path, problem, where=f"vertex {bad[0]}", remedy=_DAMAGED)


def _colours(rows: _Rows, notes: list[str]) -> NDArray[np.float32] | None:
    scalars = rows.element.kinds.keys() - set(rows.element.lists)
    names = next((names for names in _COLOUR_NAMES if scalars.issuperset(names)), None)
    if names is None:
        notes.append("no vertex colours: shown in neutral grey")
        return None
    rgb = np.stack([rows.values(name) for name in names], axis=1, dtype=np.float32, casting="unsafe")
    _check_finite(rows, rgb, "colour")
    lowest, highest = rgb.min(), rgb.max()
    kinds = {rows.element.kinds[name].str[1:] for name in names}
    full = {"u1": 255, "u2": 65535}.get(max(kinds)) if len(kinds) == 1 else None
    if full is None and kinds <= {"f4", "f8"} and highest <= 1 + _COLOUR_SLACK:
        full = 1
    elif full is None:
        full = 255
        notes.append(f"colours are not stored as bytes and reach {highest:g}: read as 0..255")
    if lowest < -_COLOUR_SLACK * full or highest > (1 + _COLOUR_SLACK) * full:
        problem = f"colours lie between {lowest:g} and {highest:g}, not 0 and {full}"
        raise InputError(rows.body.path, problem, remedy="store them as uchar, 0 to 255, or as float, 0 to 1")
    return np.clip(rgb / np.float32(full), 0, 1)


def _faces(rows: _Rows, vertex_count: int, notes: list[str]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The corner_vertices and face_starts of a Mesh."""
    name = next(name for name in _INDEX_NAMES if name in rows.element.lists)
    values, sizes = rows.values(name), np.broadcast_to(rows.counts(name), rows.element.rows)
    corners = values.astype(np.int32)
    bad = np.flatnonzero((values < 0) | (values >= vertex_count) | (values != corners))  # the last finds fractions
    if len(bad):
        where = f"face {np.searchsorted(np.cumsum(sizes), bad[0], side='right')}"
        problem = f"vertex index {values[bad[0]]:.15g} is none of the {vertex_count} vertices, {len(bad)} such in all"
        raise InputError(rows.body.path, problem, where=where, remedy=_DAMAGED)
    ends, following = np.cumsum(sizes), np.roll(corners, -1)
    following[ends[sizes > 0] - 1] = corners[
        (ends - sizes)[sizes > 0]
    ]  # what follows a face's last corner is its first
    repeated = corners == following
    if repeated.any() or sizes.min() < 3:
        repeats = np.bincount(np.repeat(np.arange(len(sizes)), sizes)[repeated], minlength=len(sizes))
        kept = sizes - repeats >= 3
        if np.any(kept & (repeats > 0)):
            notes.append(f"{np.count_nonzero(kept & (repeats > 0))} faces repeated a corner: the repeats were removed")
        if not kept.all():
            notes.append(f"{np.count_nonzero(~kept)} faces had fewer than 3 different corners: dropped")
        corners, sizes = corners[~repeated & np.repeat(kept, sizes)], (sizes - repeats)[kept]
    if len(sizes) == 0:
        raise InputError(rows.body.path, "no face has three different corners", remedy=_DAMAGED)
    return corners, (np.cumsum(sizes) - sizes).astype(np.int32)
