# SPDX-License-Identifier: GPL-3.0-or-later
"""PLY files of every dialect: the header, the elements as tables, and the mesh that they describe.

PLY files of every dialect: the header, and the elements as tables.

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

from ..core.errors import InputError
from ..core.file_access import open_regular
from .mesh_formats import FORMAT_BYTES, link_notes, not_a_ply
from .polygon_mesh import OBJECT_ID, OBJECT_NAMES, Mesh, Texture
from .textures import TextureFile, locate_texture, read_picture

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


# The faces of a PLY file: which vertices are their corners, and which of the file's corners and faces are kept.


INDEX_NAMES = ("vertex_indices", "vertex_index")


@dataclass(frozen=True)
class Faces:
    """Faces of three or more corners, none repeated in succession.

    corners: (C,) int32, and starts: (F,) int32, as a Mesh has them. stored_sizes: the number of corners of each face in
    the file. kept_corners, kept_faces: which of the file's corners and faces these are; None where all.
    """

    corners: NDArray[np.int32]
    starts: NDArray[np.int32]
    stored_sizes: NDArray[np.int64]
    kept_corners: NDArray[np.bool_] | None
    kept_faces: NDArray[np.bool_] | None

    def of_corners(self, values: NDArray) -> NDArray:
        """Return the kept rows of what the file has for each corner."""
        return values if self.kept_corners is None else values[self.kept_corners]

    def of_faces(self, values: NDArray) -> NDArray:
        """Return the kept rows of what the file has for each face."""
        return values if self.kept_faces is None else values[self.kept_faces]

    def at_corners(self, values: NDArray) -> NDArray:
        """Return what the file has for each face at each of the face's kept corners."""
        return self.of_corners(np.repeat(values, self.stored_sizes, axis=0))


def read_faces(rows: Rows, vertex_count: int, notes: list[str]) -> Faces:
    """Return the faces. Raises InputError where an index names no vertex, or no face is left."""
    name = next(name for name in INDEX_NAMES if name in rows.element.lists)
    values, sizes = rows.values(name), np.broadcast_to(rows.counts(name), rows.element.rows)
    corners = values.astype(np.int32)
    bad = np.flatnonzero((values < 0) | (values >= vertex_count) | (values != corners))  # the last finds fractions
    if len(bad):
        where = f"face {np.searchsorted(np.cumsum(sizes), bad[0], side='right')}"
        problem = f"vertex index {values[bad[0]]:.15g} is none of the {vertex_count} vertices, {len(bad)} such in all"
        raise InputError(rows.body.path, problem, where=where, remedy=DAMAGED)
    stored_sizes, kept, kept_corners = sizes, None, None
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
        kept_corners = ~repeated & np.repeat(kept, sizes)
        corners, sizes = corners[kept_corners], (sizes - repeats)[kept]
    if len(sizes) == 0:
        raise InputError(rows.body.path, "no face has three different corners", remedy=DAMAGED)
    return Faces(corners, (np.cumsum(sizes) - sizes).astype(np.int32), stored_sizes, kept_corners, kept)


# The colours of a PLY file: of its vertices, its faces, or in the textures that it names.


_COLOUR_NAMES = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_COLOUR_SLACK = 1e-3  # of full scale: colours stored as floats may overshoot their range by rounding
_LEAST_OF_BYTES = 16  # floats that reach no more are hardly bytes, which would all be near black; chosen
_STORE_COLOURS = "store them as uchar, 0 to 255, or as float, 0 to 1"
_CORNER_UV = "texcoord"  # a list of each face: u and v of each corner
_VERTEX_UV = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
_PICTURE = "texnumber"  # of each face


@dataclass(frozen=True)
class Colours:
    """The colours of a Mesh, as it has them."""

    rgb: NDArray[np.float32] | None
    corner_rgb: NDArray[np.float32] | None
    texture: Texture | None


def read_colours(path: Path, header: Header, tables: dict[str, Rows], faces: Faces, notes: list[str]) -> Colours:
    """Return what is shown of a file's colours: those of vertices rather than of faces, and a texture over both.

    MeshLab chooses so too; but where it multiplies a texture by the vertices' colours, here the texture alone is shown.
    The notes say what is left out. Raises InputError where colours or textures are damaged or missing.
    """
    vertex, face = tables["vertex"], tables["face"]
    on_vertices, on_faces = _colour_names(vertex.element), _colour_names(face.element)
    rgb = _colours(vertex, on_vertices, notes) if on_vertices else None
    face_rgb = _colours(face, on_faces, notes) if on_faces and not on_vertices else None
    corner_rgb = None if face_rgb is None else faces.at_corners(face_rgb)
    texture = _texture(path, header, tables, faces, notes)
    _note_excluded(header, texture, notes)
    return Colours(rgb, corner_rgb, texture)


def used_textures(path: Path, header: Header) -> list[TextureFile]:
    """Return the files of a mesh's textures; none where it has no texture coordinates, and so does not use them."""
    has_uv = _has_corner_uv(header.elements["face"]) or _vertex_uv_names(header.elements["vertex"])
    return [locate_texture(path, name) for name in header.textures] if has_uv else []


def check_textures(path: Path, header: Header) -> None:
    """Raise InputError where a texture is missing and the mesh has no other colours."""
    missing = [file for file in used_textures(path, header) if not file.exists]
    if missing and not _has_colours(header):
        problem = f"its texture {missing[0].name[:200]!r} is missing: there is no {missing[0].path.name[:200]!r}"
        raise InputError(path, f"{problem} in {missing[0].path.parent}", remedy="put it there, beside the mesh")


def _has_colours(header: Header) -> bool:
    return any(_colour_names(header.elements[name]) for name in ("vertex", "face"))


def _colour_names(element: Element) -> tuple[str, ...] | None:
    return next((names for names in _COLOUR_NAMES if element.scalars.issuperset(names)), None)


def _colours(rows: Rows, names: tuple[str, ...], notes: list[str]) -> NDArray[np.float32]:
    """Return the colours (rows, 3) in [0, 1] of the vertices or of the faces."""
    rgb = np.stack([rows.values(name) for name in names], axis=1, dtype=np.float32, casting="unsafe")
    check_finite(rows, rgb, "colour")
    lowest, highest = rgb.min(), rgb.max()
    kinds = {rows.element.kinds[name].str[1:] for name in names}
    full = {"u1": 255, "u2": 65535}.get(max(kinds)) if len(kinds) == 1 else None
    if full is None and kinds <= {"f4", "f8"} and highest <= 1 + _COLOUR_SLACK:
        full = 1
    elif full is None and kinds & {"f4", "f8"} and highest < _LEAST_OF_BYTES:
        problem = f"colours are floats up to {highest:g}, which may be of 0 to 1, too bright, or of 0 to 255, too dark"
        raise InputError(rows.body.path, problem, remedy=_STORE_COLOURS)
    elif full is None:
        full = 255
        notes.append(f"colours are not stored as bytes and reach {highest:g}: read as 0..255")
    if lowest < -_COLOUR_SLACK * full or highest > (1 + _COLOUR_SLACK) * full:
        problem = f"colours lie between {lowest:g} and {highest:g}, not 0 and {full}"
        raise InputError(rows.body.path, problem, remedy=_STORE_COLOURS)
    return np.clip(rgb / np.float32(full), 0, 1)


def _note_excluded(header: Header, texture: Texture | None, notes: list[str]) -> None:
    vertex, face = header.elements["vertex"], header.elements["face"]
    where = [name for name, element in (("vertices", vertex), ("faces", face)) if _colour_names(element)]
    if texture is not None and where:
        notes.append(f"its texture is shown, and not the colours of its {' and '.join(where)}")
    elif len(where) == 2:
        notes.append("the colours of its vertices are shown, and not those of its faces")
    elif texture is None and not where:
        notes.append("no colours: shown in neutral grey")
    if "color" in face.lists:
        notes.append("its faces' lists color, of colours of corners, are left out")
    if any(name.startswith("multi_texture") for name in header.elements):
        notes.append("its elements multi_texture are left out")
    has_uv = _has_corner_uv(face) or _vertex_uv_names(vertex)
    if has_uv and not header.textures:
        notes.append("it has texture coordinates, but no line 'comment TextureFile NAME': they are left out")
    if header.textures and not has_uv:
        notes.append(f"it names the texture {header.textures[0][:60]!r}, but has no texture coordinates: left out")


# --- textures ---


def _has_corner_uv(face: Element) -> bool:
    return _CORNER_UV in face.lists


def _vertex_uv_names(vertex: Element) -> tuple[str, str] | None:
    return next((names for names in _VERTEX_UV if vertex.scalars.issuperset(names)), None)


def _texture(path: Path, header: Header, tables: dict[str, Rows], faces: Faces, notes: list[str]) -> Texture | None:
    """Return the texture; None where the file uses none, or none is found."""
    check_textures(path, header)
    files = used_textures(path, header)
    if not files:
        return None
    corner_uv, has_uv = _corner_uv(tables, faces)
    picture_of = np.where(has_uv, faces.of_faces(_face_pictures(tables["face"], len(files), notes)), -1)
    for file in files:
        if not file.exists:
            notes.append(f"its texture {file.name[:200]!r} is missing in {file.path.parent}: other colours are shown")
        elif file.moved:
            notes.append(f"its texture is named {file.name[:200]!r}: {file.path.name} beside the mesh was taken")
    notes += link_notes(path, [file.path for file in files if file.exists])
    numbers, pictures = np.full(len(files), -1), []
    for number, file in enumerate(files):
        if file.exists and np.any(picture_of == number):
            picture, transparent = read_picture(file.path)
            if transparent:
                notes.append(f"{file.path.name} is transparent in places: it is shown without transparency")
            numbers[number] = len(pictures)
            pictures.append(picture)
    if not pictures:
        return None
    face_pictures = np.where(picture_of >= 0, numbers[picture_of], -1).astype(np.int32)
    if (bare := np.count_nonzero(face_pictures < 0)) and all(file.exists for file in files):
        notes.append(f"{bare} of {len(face_pictures)} faces have no texture: other colours are shown, or grey")
    names = tuple(file.path.name for file, number in zip(files, numbers, strict=True) if number >= 0)
    return Texture(names, tuple(pictures), corner_uv, face_pictures)


def _corner_uv(tables: dict[str, Rows], faces: Faces) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return u and v (C, 2) of the corners, and which faces (F,) have them."""
    vertex, face = tables["vertex"], tables["face"]
    if not _has_corner_uv(face.element):
        names = _vertex_uv_names(vertex.element)
        assert names is not None, "the mesh has texture coordinates"
        uv = np.stack([vertex.values(name) for name in names], axis=1, dtype=np.float32, casting="unsafe")
        check_finite(vertex, uv, "texture coordinate")
        return uv[faces.corners], np.ones(len(faces.starts), bool)
    sizes, counts = faces.stored_sizes, np.broadcast_to(face.counts(_CORNER_UV), len(faces.stored_sizes))
    bad = np.flatnonzero((counts != 2 * sizes) & (counts != 0))
    if len(bad):
        problem = f"{counts[bad[0]]} texture coordinates for {sizes[bad[0]]} corners, which take 2 each"
        raise InputError(face.body.path, problem, where=f"face {bad[0]}", remedy=DAMAGED)
    values = face.values(_CORNER_UV).astype(np.float32)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        where = f"face {np.searchsorted(np.cumsum(counts), bad[0], side='right')}"
        raise InputError(face.body.path, "a texture coordinate is NaN or infinite", where=where, remedy=DAMAGED)
    stored = np.zeros((int(sizes.sum()), 2), np.float32)
    stored[np.repeat(counts > 0, sizes)] = values.reshape(-1, 2)
    return faces.of_corners(stored), faces.of_faces(counts > 0)


def _face_pictures(face: Rows, count: int, notes: list[str]) -> NDArray[np.int64]:
    """Return the number of each face's texture among `count`; negative where a face has none."""
    if _PICTURE not in face.element.scalars:
        if count > 1:
            notes.append(f"it names {count} textures, but its faces have no {_PICTURE}: the first is shown")
        return np.zeros(face.element.rows, np.int64)
    values = face.values(_PICTURE)
    numbers = np.clip(np.nan_to_num(values.astype(np.float64), nan=count), -1, count).astype(np.int64)
    bad = np.flatnonzero((numbers >= count) | (numbers != np.maximum(values, -1)))
    if len(bad):
        problem = f"{_PICTURE} {values[bad[0]]:.15g} is none of its {count} textures"
        raise InputError(face.body.path, problem, where=f"face {bad[0]}", remedy=DAMAGED)
    return numbers


# Reading PLY meshes of every dialect.


_COARSE_M = 1e-4  # float32 coordinates whose resolution is coarser than this are worth a note; chosen


def read_ply(path: Path) -> Mesh:
    """Read a polygon mesh from a PLY file, ASCII or binary of either byte order.

    Vertices keep the file's precision. Colours are those of a texture, of the vertices or of the faces, in this order
    where a file has several. Normals, alpha and all other properties are skipped. Messages count from 0.

    Returns a Mesh: vertices_m (V, 3) float64 metres, colours, faces of three or more corners with none repeated in
    succession, and notes on what was dropped, guessed or lost.
    Raises InputError where the file is missing, not a PLY, cut short, damaged, or not a mesh, and where its texture is
    missing or no image.
    """
    header = read_header(path)
    _check_is_mesh(path, header.elements)
    tables, notes = read_elements(path, header)
    face_notes: list[str] = []
    with np.errstate(invalid="ignore", over="ignore"):  # odd bit patterns are judged by the checks, not by warnings
        vertices_m = _vertices(tables["vertex"], notes)
        faces = read_faces(tables["face"], len(vertices_m), face_notes)
        colours = read_colours(path, header, tables, faces, notes)
        objects = _object_ids(tables["face"], faces)
    all_notes = tuple(notes + face_notes)
    return Mesh(
        *(
            vertices_m,
            colours.rgb,
            faces.corners,
            faces.starts,
            all_notes,
            colours.corner_rgb,
            colours.texture,
            objects,
        ),
        names_path=beside if objects is not None and (beside := path.with_name(OBJECT_NAMES)).is_file() else None,
    )


def face_properties(path: Path) -> frozenset[str]:
    """Return the names of the numbers that each face has. Raises InputError where the file is no PLY."""
    face = read_header(path).elements.get("face")
    return frozenset() if face is None else frozenset(face.scalars)


def check_ply(path: Path) -> None:
    """Read the header only; raise InputError where the file is missing, not a PLY, not a mesh, or lacks its texture."""
    header = read_header(path)
    _check_is_mesh(path, header.elements)
    check_textures(path, header)


def texture_files(path: Path) -> list[Path]:
    """Return the files of the textures that a mesh uses, those that are there. Raises InputError as check_ply does."""
    header = read_header(path)
    _check_is_mesh(path, header.elements)
    return [file.path for file in used_textures(path, header) if file.exists]


def _object_ids(rows: Rows, faces: Faces) -> NDArray[np.int64] | None:
    """Return the object of each kept face; None where the file tells none, or not by whole numbers."""
    if OBJECT_ID not in rows.element.scalars or rows.element.kinds[OBJECT_ID].kind not in "iu":
        return None
    return faces.of_faces(rows.values(OBJECT_ID)).astype(np.int64)


def _check_is_mesh(path: Path, elements: dict[str, Element]) -> None:
    vertex, face = elements.get("vertex"), elements.get("face")
    if vertex is None or vertex.rows == 0 or not {"x", "y", "z"} <= vertex.scalars:
        raise InputError(path, "holds no vertices with x, y and z", remedy="export it as a polygon mesh")
    if face is None or face.rows == 0:
        raise InputError(path, "holds no faces: a point cloud", remedy="mesh it first")
    if not any(name in face.lists and face.kinds[name].kind in "iu" for name in INDEX_NAMES):
        raise InputError(path, "its faces have no integer list vertex_indices", remedy="export it as a polygon mesh")


def _vertices(rows: Rows, notes: list[str]) -> NDArray[np.float64]:
    columns = [rows.values(name) for name in ("x", "y", "z")]
    vertices_m = np.stack(columns, axis=1, dtype=np.float64, casting="unsafe")
    check_finite(rows, vertices_m, "coordinate")
    farthest_m = np.float32(abs(vertices_m).max())
    if np.isinf(farthest_m):
        where = f"vertex {np.flatnonzero(np.isinf(vertices_m.astype(np.float32)).any(axis=1))[0]}"
        raise InputError(rows.body.path, "a coordinate is too large for float32", where=where, remedy=DAMAGED)
    apart_m = np.spacing(farthest_m)
    if apart_m > _COARSE_M and any(column.dtype.str[1:] == "f4" for column in columns):
        stored = f"coordinates near {farthest_m:.0f} m are stored as float32, {1000 * apart_m:.2f} mm apart"
        notes.append(f"{stored}: finer shape is lost in the file itself")
    return vertices_m
