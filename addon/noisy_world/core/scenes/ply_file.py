# SPDX-License-Identifier: GPL-3.0-or-later
"""PLY files of every dialect: the header, and the elements as tables.

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
from typing import BinaryIO, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..regular_files import open_regular
from .mesh_formats import FORMAT_BYTES, not_a_ply

_Int64s: TypeAlias = NDArray[np.int64]

_SIZED = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")
_UNSIZED = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double")
_TYPES = {name: np.dtype(sized) for name, sized in zip(_SIZED + _UNSIZED, _SIZED * 2, strict=True)}
_LENGTH_TYPES = {name for name, kind in _TYPES.items() if kind.kind in "iu"}
_BYTE_ORDERS: dict[str, Literal["=", "<", ">"]] = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_TEXT_BLOCK = 1 << 18  # bytes: a block and its masks stay in the processor's cache
_POWERS_OF_TEN = 10.0 ** np.arange(23)  # 10^22 is the largest power of ten that is exact in float64
DAMAGED = "the file is damaged: export it again"


@dataclass(frozen=True)
class Element:
    """An element as the header declares it: the type of each property; 'NAME length' is the length of list NAME."""

    name: str
    rows: int
    kinds: dict[str, np.dtype]
    lists: list[str]

    @property
    def scalars(self) -> set[str]:
        """The properties of one value a row."""
        return self.kinds.keys() - {name for item in self.lists for name in (item, f"{item} length")}


@dataclass(frozen=True)
class Header:
    """A file's header. lines: how many it has. data_at: where the data begin, in bytes.

    textures: the names of its textures' files, as the lines `comment TextureFile NAME` of MeshLab give them.
    """

    encoding: str
    elements: dict[str, Element]
    lines: int
    data_at: int
    textures: tuple[str, ...]


@dataclass(frozen=True)
class Body:
    """What follows the header: the file's own bytes, or the float64 numbers of a text file."""

    path: Path
    data: bytes
    encoding: str
    flaw: InputError | None = None  # why the numbers of a text file end early

    def stored(self, kind: np.dtype) -> np.dtype:
        """Return how the body holds values of a kind."""
        return np.dtype("f8") if self.encoding == "ascii" else kind.newbyteorder(_BYTE_ORDERS[self.encoding])


@dataclass(frozen=True)
class Rows:
    """The positions of one element's rows in the body, in bytes.

    lengths: (1, L) int64 where the L lists of the element are equally long in all rows, else (rows, L).
    """

    body: Body
    element: Element
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
        """Where the rows end."""
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


def read_header(path: Path) -> Header:
    """Read the header only; raise InputError where the file is missing, not a PLY, or its header is damaged."""
    try:
        with open_regular(path) as file:
            return _parse_header(path, file)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error


def read_elements(path: Path, header: Header) -> tuple[dict[str, Rows], list[str]]:
    """Return the rows of every element, and notes on how the file ends.

    Raises InputError where the file is cut short or damaged.
    """
    try:
        with open_regular(path) as file:
            file.seek(header.data_at)
            data = file.read()
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error
    body = _parse_text(path, data, header.lines) if header.encoding == "ascii" else Body(path, data, header.encoding)
    tables, position, notes = {}, 0, []
    for name, element in header.elements.items():
        tables[name] = _locate(body, element, position)
        position = tables[name].end
    if position < len(body.data) or body.flaw:
        notes.append("the file goes on after its data: the rest was ignored")
    elif header.encoding == "ascii" and not data[-1:].isspace():
        notes.append("the last line has no line end: if the file was cut there, its last number is wrong")
    return tables, notes


def _parse_header(path: Path, file: BinaryIO) -> Header:
    """Return the header, with the elements in the file's order."""
    first = file.readline(16)
    if first.split() != [b"ply"]:
        raise not_a_ply(path, first + file.read(FORMAT_BYTES))
    encoding, elements, kinds, lists, textures = "", {}, {}, [], []
    for number, line in enumerate(file, start=2):
        where = f"header line {number}"
        words = [word.decode("latin-1") for word in line.split()]
        fresh = elements and words and words[-1] not in kinds
        match words:
            case ["end_header"] if encoding:
                return Header(encoding, elements, number, file.tell(), tuple(textures))
            case ["comment", keyword, _, *_] if keyword.lower() == "texturefile":
                textures.append(_text(line.split(maxsplit=2)[2]))
            case ["comment" | "obj_info", *_]:
                pass
            case ["format", name, "1.0"] if name in _BYTE_ORDERS:
                encoding = name
            case ["format", *_]:
                remedy = f"version 1.0 of {', '.join(_BYTE_ORDERS)} can be read"
                raise InputError(path, f"unknown format {' '.join(words[1:])[:60]!r}", where=where, remedy=remedy)
            case ["element", name, rows] if re.fullmatch("[0-9]{1,18}", rows) and name not in elements:
                kinds, lists = {}, []
                elements[name] = Element(name, int(rows), kinds, lists)
            case ["property", kind, name] if fresh and kind in _TYPES:
                kinds[name] = _TYPES[kind]
            case ["property", "list", length, kind, name] if fresh and length in _LENGTH_TYPES and kind in _TYPES:
                kinds |= {f"{name} length": _TYPES[length], name: _TYPES[kind]}
                lists.append(name)
            case _ if words:
                raise InputError(path, f"malformed: {' '.join(words)[:60]!r}", where=where, remedy=DAMAGED)
    raise InputError(path, "cut short: its header has no end_header", remedy=DAMAGED)


def _text(name: bytes) -> str:
    """Return the name of a file as text: UTF-8, or else the letters of western Europe."""
    with suppress(UnicodeDecodeError):
        return name.strip().decode()
    return name.strip().decode("latin-1")


def _parse_text(path: Path, text: bytes, header_lines: int) -> Body:
    """Return the numbers of a text body, up to the first word that is not a number."""
    flaw, blocks, stream = None, [np.empty(0)], BytesIO(text + b"\n")
    while not flaw and (block := stream.read(_TEXT_BLOCK) + stream.readline()):
        numbers = _decimals(block)
        if numbers is None:
            numbers = _from_text(block, np.float64, len(block.split()))
        if numbers is None:
            bad = next(word for word in re.finditer(rb"\S+", block) if _from_text(word[0], np.float64, 1) is None)
            line = header_lines + 1 + text.count(b"\n", 0, stream.tell() - len(block) + bad.start())
            flaw = InputError(path, f"{str(bad[0][:40])[1:]} is not a number", where=f"line {line}", remedy=DAMAGED)
            block = block[: bad.start()]
            numbers = _from_text(block, np.float64, len(block.split()))
            assert numbers is not None, "every word before the first bad one is a number"
        blocks.append(numbers)
    return Body(path, np.concatenate(blocks).tobytes(), "ascii", flaw)


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
    with warnings.catch_warnings(action="error"), suppress(ValueError, DeprecationWarning):  # numpy before 2.3 warns
        numbers = np.fromstring(block, kind, sep=" ")
        return numbers if len(numbers) == words else None  # 1.5.2 is one word and parts of two numbers
    return None


def _locate(body: Body, element: Element, begin: int) -> Rows:
    """Find the rows of an element; raise InputError where the file cannot hold as many as its header promises."""
    rows = Rows(body, element, begin, np.zeros((1, len(element.lists)), np.int64))
    least = int(rows.layout[1][0])
    found = min(element.rows, (len(body.data) - begin) // least) if least else element.rows
    if element.lists and found == element.rows > 0:  # a promise that the file cannot keep allocates nothing
        first, rows = rows, Rows(body, element, begin, _walk(rows, 1))
        fits = len(rows.lengths) == 1 and rows.end <= len(body.data)
        if not (fits and all(np.all(rows.values(f"{name} length") == rows.counts(name)) for name in element.lists)):
            rows = Rows(body, element, begin, _walk(first, element.rows))
            found = len(rows.lengths)
    if found < element.rows:
        problem = f"cut short: the header promises {element.rows} x {element.name}, the file has room for {found}"
        raise body.flaw or InputError(body.path, problem, remedy=DAMAGED)
    return rows


def _walk(empty: Rows, rows: int) -> _Int64s:
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
        raise InputError(body.path, problem, where=where, remedy=DAMAGED)
    table = flat[: len(flat) // len(at) * len(at)].reshape(-1, len(at)).astype(np.int64)
    ends = empty.begin + np.cumsum(Rows(body, element, empty.begin, table).layout[1])
    return table[ends <= len(data)]


def check_finite(rows: Rows, values: NDArray, what: str) -> None:
    """Raise InputError where a row of the values (rows, K) has one that is NaN or infinite."""
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(bad):
        name = rows.element.name
        those = {"vertex": "vertices"}.get(name, f"{name}s")
        problem = f"a {what} is NaN or infinite, at {len(bad)} of {len(values)} {those}, this the first"
        raise InputError(rows.body.path, problem, where=f"{name} {bad[0]}", remedy=DAMAGED)
