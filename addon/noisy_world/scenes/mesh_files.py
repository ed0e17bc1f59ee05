# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of a mesh, of any format that is read: checked before anything is loaded."""

import itertools
import math
import re
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.file_access import open_regular, utf8_name
from .mesh_formats import (
    FORMAT_BYTES,
    MeshFormat,
    check_no_pipe,
    format_of,
    is_file,
    is_inside,
    leads_out,
    not_a_mesh,
    place_inside,
)
from .ply import DAMAGED, check_ply, texture_files

# Checks of the numbers in text mesh files; Blender's importers silently read bad ones as 0.
#
# Every pattern here takes time in proportion to the text: what one part of it has matched, no other tries again.


_NUMBER = rb"[-+]?(?:[0-9]++\.?[0-9]*+|\.[0-9]++)(?:[eE][-+]?[0-9]++)?"
_WORD = re.compile(rb"[^ \t\r\n\f\v]++")
_IS_NUMBER = re.compile(_NUMBER).fullmatch
_IS_NO_FINITE = re.compile(rb"[-+]?(?:nan|inf(?:inity)?)", re.IGNORECASE).fullmatch
_HAS_COMMA = re.compile(rb"[-+]?[0-9]*+,[0-9]++").fullmatch
_BLANKS = rb"[ \t\f\v]"
_OF_NUMBERS = b"0123456789+-.eE, \t\r\n"
_LARGE = re.compile(rb"[0-9]{29}|[eE]\+?0*+[1-9][0-9]")  # all smaller numbers are below 1e38, and float32 holds them


def check_lines(path: Path, data: bytes, kinds: tuple[tuple[bytes, int, str], ...]) -> None:
    """Raise InputError where a line that begins with a keyword has something else than numbers, or too few of them.

    kinds: for each a pattern of keywords, how many numbers there have to be, and what these are. What follows # is a
    comment; a line goes on behind a \\ at its end.
    """
    text = data.replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ") if b"\\" in data else data
    large = _LARGE.search(text) is not None
    for keywords, least, what in kinds:
        lines = rb"^" + _BLANKS + rb"*+(?:" + keywords + rb")" + _BLANKS + rb"++"
        more = rb"(?:" + _BLANKS + rb"++" + _NUMBER + rb"){%d,}+" % (least - 1)
        odd = re.compile(lines + rb"(?!" + _NUMBER + more + _BLANKS + rb"*+\r?(?:#|$))", re.MULTILINE)
        if found := odd.search(text):
            raise _error(path, data, text, found.end(), least=least, what=what)
        for line in re.finditer(lines + rb"([^#\r\n]*+)", text, re.MULTILINE) if large else ():
            if _too_large(line[1].split()):
                raise _error(path, data, text, line.start(1), least=least, what=what)


def check_stl_corners(path: Path, data: bytes) -> None:
    """Raise InputError where the corners of an STL file that is text are not three numbers each."""
    three = rb"\s++" + _NUMBER + rb"\s++" + _NUMBER + rb"\s++" + _NUMBER + rb"(?!\S)"
    if found := re.search(rb"\bvertex\b(?!" + three + rb")", data):
        raise _error(path, data, data, found.end(), least=3, what="coordinate")
    if _LARGE.search(data):
        for corner in re.finditer(rb"\bvertex\b\s++(\S++)\s++(\S++)\s++(\S++)", data):
            if _too_large(list(corner.groups())):
                raise _error(path, data, data, corner.start(1), least=3, what="coordinate")


def check_fbx_arrays(path: Path, data: bytes) -> None:
    """Raise InputError where a mesh's arrays in an FBX file that is text hold something else than numbers.

    NaN and what is too large are left to the importer, which keeps them.
    """
    for array in re.finditer(rb"\b(?:Vertices|PolygonVertexIndex|UV|UVIndex):[^{}\n:]*+\{\s*+a:([^}]*+)", data):
        if array[1].translate(None, _OF_NUMBERS):
            for word in re.finditer(rb"[^,\s]++", array[1]):
                if not re.fullmatch(_NUMBER + rb"|[-+]?(?:nan|inf)", word[0], re.IGNORECASE):
                    line = 1 + data.count(b"\n", 0, array.start(1) + word.start())
                    problem = f"{word[0][:40].decode('utf-8', 'replace')!r} is not a number"
                    raise InputError(path, problem, where=f"line {line}", remedy=DAMAGED)


def line_with_odd_number(data: bytes) -> int | None:
    """Return the first line of a text, from 1, with a number that float32 does not hold; None if there is none."""
    for found in re.finditer(rb"(?<![\w.\"/])(?:[-+]?(?:nan|inf)\b|" + _NUMBER + rb")", data, re.IGNORECASE):
        if not math.isfinite(_float32(found[0])):
            return 1 + data.count(b"\n", 0, found.start())
    return None


def _too_large(words: list[bytes]) -> bool:
    return any(not math.isfinite(_float32(word)) for word in words)


def _float32(word: bytes) -> float:
    with np.errstate(over="ignore"):
        return float(np.float32(float(word)))


def _error(path: Path, data: bytes, text: bytes, start: int, *, least: int, what: str) -> InputError:
    """Return the error of a line whose numbers begin at a place."""
    line = 1 + data.count(b"\n", 0, start)
    where = f"line {line}"
    end = text.find(b"\n", start)
    words = _WORD.findall(text[start : len(text) if end < 0 else end].split(b"#", 1)[0])
    words = words[:3] if data[start - 6 : start].strip() == b"vertex" else words
    for word in words:
        if _IS_NUMBER(word) and not _LARGE.search(word):
            continue
        shown = repr(word[:40].decode("utf-8", "replace"))
        if _IS_NO_FINITE(word):
            return InputError(path, f"a {what} is NaN or infinite", where=where, remedy=DAMAGED)
        if _HAS_COMMA(word):
            return InputError(path, f"{shown} is not a number", where=where, remedy="write a decimal point")
        if not _IS_NUMBER(word):
            return InputError(path, f"{shown} is not a number", where=where, remedy=DAMAGED)
        if _too_large([word]):
            return InputError(path, f"{shown} is too large for float32", where=where, remedy=DAMAGED)
    problem = f"has {len(words)} numbers, where a {what} takes {least}"
    return InputError(path, problem, where=where, remedy=DAMAGED)


# Checks of an OBJ file before it is imported: its material files and their textures.


_ARGUMENTS = {"-mm": 2, "-o": 3, "-s": 3, "-t": 3}  # of options before a texture's name; all others have one
_LEADING_NUMBER = re.compile(r"[-+]?(?:[0-9]++\.?[0-9]*+|\.[0-9]++)(?:[eE][-+]?[0-9]++)?$")
_MATERIAL = re.compile(rb"^[ \t]*+newmtl[ \t]++([^\n]++)", re.MULTILINE)
_LONGEST_NAME = 255  # bytes that Blender keeps of a material's name
_LIBRARY = re.compile(rb"^[ \t]*+mtllib[ \t]++([^\n]++)", re.MULTILINE)
_FACE = re.compile(rb"^[ \t]*+f[ \t]++\S", re.MULTILINE)
_MAP = re.compile(r"^[ \t]*+(?:map_\w++|bump|norm|disp|decal|refl)[ \t]++([^\n]++)", re.MULTILINE | re.IGNORECASE)


def check_obj(path: Path) -> None:
    """Raise InputError where an OBJ file has no faces, or files of its materials are outside its folder."""
    data = _bytes(path)
    if not _FACE.search(data):
        raise InputError(path, "holds no faces", remedy="export it as a polygon mesh")
    for library in _libraries(path, data):
        for name in _textures(library) if is_file(library) else ():
            for place in _places(library.parent, name):
                check_no_pipe(path, "texture", place)


def check_obj_numbers(path: Path) -> None:
    """Raise InputError where a coordinate or a colour of an OBJ file and its materials is no finite number."""
    data = _bytes(path)
    check_lines(path, data, ((b"v", 3, "coordinate"), (b"vt", 1, "texture coordinate")))
    for library in filter(is_file, _libraries(path, data)):
        check_lines(library, _bytes(library), ((rb"K[de]", 3, "colour"),))


def faces_of_obj(path: Path) -> int:
    """Return how many faces an OBJ file lists."""
    return sum(1 for _ in _FACE.finditer(_bytes(path)))


def files_of_obj(path: Path) -> list[Path]:
    """Return the files of an OBJ file's materials and of their textures, those that are there."""
    found: dict[Path, None] = {}
    for library in filter(is_file, _libraries(path, _bytes(path))):
        found[library] = None
        for name in _textures(library):
            places = [*_places(library.parent, name), path.parent / Path(name.replace("\\", "/")).name]
            there = (place for place in places if is_file(place) and is_inside(path.parent, place))
            found.update(dict.fromkeys(itertools.islice(there, 1)))
    return list(found)


def materials_of_obj(path: Path) -> set[str]:
    """Return the names of the materials that an OBJ file's own files define, as Blender names them."""
    libraries = filter(is_file, _libraries(path, _bytes(path)))
    return {_as_blender(name.strip()) for library in libraries for name in _MATERIAL.findall(_bytes(library))}


def missing_libraries(path: Path) -> list[Path]:
    """Return the files of materials that an OBJ file names and that are not there."""
    return [library for library in _libraries(path, _bytes(path)) if not is_file(library)]


def _as_blender(name: bytes) -> str:
    return name.decode(errors="ignore").encode()[:_LONGEST_NAME].decode(errors="ignore")


def _bytes(path: Path) -> bytes:
    try:
        with open_regular(path) as file:
            return file.read()
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error


def _libraries(path: Path, data: bytes) -> list[Path]:
    """Return the files of materials, which Blender looks for beside the mesh too, under its name."""
    found: dict[Path, None] = {}
    for each in dict.fromkeys(_LIBRARY.findall(data)):
        name = each.strip().decode(errors="surrogateescape").strip('"')
        place = place_inside(path.parent, name)
        if place is None:
            raise leads_out(path, "materials", name)
        check_no_pipe(path, "materials", place)
        found[place] = None
    own = path.with_suffix(".mtl")
    check_no_pipe(path, "materials", own)
    if is_file(own):
        found[own] = None
    return list(found)


def _textures(library: Path) -> list[str]:
    """Return the names of the textures in a file of materials."""
    text = _bytes(library).decode(errors="surrogateescape")
    return [name for line in dict.fromkeys(_MAP.findall(text)) if (name := _texture_name(line.strip(" \t\r")))]


def _texture_name(text: str) -> str:
    """Return a texture's name without the options before it."""
    words, at = text.split(" "), 0
    while at < len(words) - 1 and words[at].startswith("-"):
        most, taken = _ARGUMENTS.get(words[at], 1), 0
        at += 1
        while at < len(words) - 1 and taken < most and (taken == 0 or _LEADING_NUMBER.match(words[at])):
            at, taken = at + 1, taken + 1
    return " ".join(words[at:]).strip('"')


def _places(folder: Path, name: str) -> list[Path]:
    """Return where Blender looks for a texture: as the name says, or beside its materials."""
    slashes = name.replace("\\", "/")
    return [folder / name, folder / slashes, folder / Path(slashes).name]


_STL_HEAD, _STL_FACET_BYTES = struct.Struct("<80xI"), 50
_FACET_IN_TEXT = re.compile(rb"\bfacet\s++normal\b")
_TEXTS = (b"#usda", b"; FBX ")  # so files of USD and FBX begin that are text
_NAME_IN_FBX = re.compile(rb'(?:RelativeFilename|FileName|Filename)(?:S(....)|: *"([^"\r\n]*)")', re.DOTALL)


def imported_format(path: Path) -> MeshFormat | None:
    """Return the format of a mesh that Blender's importers read; None for a PLY file, which we read.

    Raises InputError where the file cannot be read, or is no mesh that can.
    """
    try:
        with open_regular(path) as file:
            start = file.read(FORMAT_BYTES)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error
    if start.split(b"\n", 1)[0].split() == [b"ply"]:
        return None
    found = format_of(path, start)
    if found is None or not found.blender:
        raise not_a_mesh(path, found)
    return found


def check_mesh(path: Path) -> None:
    """Look at what a file says of itself; raise InputError where it is missing, no mesh, or lacks files beside it."""
    found = imported_format(path)
    check_ply(path) if found is None else _CHECKS[found.name](path)


def referenced_files(path: Path) -> list[Path]:
    """Return the files beside a mesh that it is made of, as far as a look at it tells; those that are there.

    Of USD only the importer knows them. Raises InputError as check_mesh does, and where a name is not UTF-8.
    """
    found = imported_format(path)
    files = texture_files(path) if found is None else _REFERENCED[found.name](path)
    for file in files:
        utf8_name(file)
    return files


def check_numbers(path: Path) -> None:
    """Raise InputError where a coordinate or a colour that stands in a file as text is no finite number.

    Blender's importers take 0 for it. What else they make of a file, they are asked for in `blender.importing`.
    """
    found = imported_format(path)
    if found is not None and found.name == "OBJ":
        check_obj_numbers(path)
    elif found is not None and found.name == "STL" and _stl_is_text(path):
        check_stl_corners(path, _bytes(path))
    elif found is not None and found.name == "FBX" and _begins(path, _TEXTS):
        check_fbx_arrays(path, _bytes(path))


def declared_faces(path: Path) -> int | None:
    """Return how many faces a mesh file lists; None where it does not say."""
    found = imported_format(path)
    if found is not None and found.name == "OBJ":
        return faces_of_obj(path)
    if found is not None and found.name == "STL":
        text = _bytes(path) if _stl_is_text(path) else None
        return len(_FACET_IN_TEXT.findall(text)) if text is not None else _stl_facets(path)
    return None


def odd_number(path: Path, problem: str) -> InputError:
    """Return the error of a number that an importer found, with its line where the file is text."""
    line = line_with_odd_number(_bytes(path)) if _begins(path, _TEXTS) else None
    return InputError(path, problem, where="" if line is None else f"line {line}", remedy=DAMAGED)


def _begins(path: Path, starts: tuple[bytes, ...]) -> bool:
    with open_regular(path) as file:
        return file.read(FORMAT_BYTES).startswith(starts)


def _stl_facets(path: Path) -> int:
    """Return how many facets the header of a binary STL promises."""
    with open_regular(path) as file:
        start = file.read(_STL_HEAD.size)
    return _STL_HEAD.unpack(start)[0] if len(start) == _STL_HEAD.size else 0


def _stl_is_text(path: Path) -> bool:
    """Tell what Blender takes an STL file for: text, unless it has the size that its header as a binary one says."""
    return path.stat().st_size != _STL_HEAD.size + _STL_FACET_BYTES * _stl_facets(path)


def _check_stl(path: Path) -> None:
    size, facets = path.stat().st_size, _stl_facets(path)
    if _stl_is_text(path):
        with open_regular(path) as file:
            start = file.read(FORMAT_BYTES)
        if start.lstrip().startswith(b"solid") and b"facet" in start:
            return
        needed = _STL_HEAD.size + _STL_FACET_BYTES * facets
        if facets and size != needed:
            problem = "cut short" if size < needed else "longer than it says"
            raise InputError(path, f"{problem}: {size} bytes, but {facets} facets take {needed}", remedy=DAMAGED)
    if facets == 0:
        raise InputError(path, "holds no faces", remedy="export it as a polygon mesh")


def _check_size(path: Path) -> None:
    if path.stat().st_size == 0:
        raise InputError(path, "is empty", remedy="export it again")


def _check_fbx(path: Path) -> None:
    _check_size(path)
    for place in _places_of_fbx(path):
        check_no_pipe(path, "file", place)


def _files_of_fbx(path: Path) -> list[Path]:
    return [place for place in _places_of_fbx(path) if is_file(place) and is_inside(path.parent, place)]


def _places_of_fbx(path: Path) -> list[Path]:
    """Return where the files may be that an FBX file names: as it names them, or beside it."""
    data, found = _bytes(path), dict[Path, None]()
    for match in _NAME_IN_FBX.finditer(data):
        name = match[2]
        if match[1] is not None:
            (length,) = struct.unpack("<I", match[1])
            name = data[match.end() : match.end() + length] if length < FORMAT_BYTES else b""
        text = name.decode(errors="surrogateescape").replace("\\", "/")
        if text and "\0" not in text:
            found |= dict.fromkeys((path.parent / text, path.parent / Path(text).name))
    return list(found)


def _none(_path: Path) -> list[Path]:
    return []


def _files_of_gltf(path: Path) -> list[Path]:
    from .gltf import read_gltf_header

    return [file for file in read_gltf_header(path).files if is_file(file)]


def _check_gltf(path: Path) -> None:
    from .gltf import read_gltf_header

    read_gltf_header(path)


_CHECKS: dict[str, Callable[[Path], None]] = {
    "glTF": _check_gltf,
    "OBJ": check_obj,
    "STL": _check_stl,
    "FBX": _check_fbx,
    "USD": _check_size,
}
_REFERENCED: dict[str, Callable[[Path], list[Path]]] = {
    "glTF": _files_of_gltf,
    "OBJ": files_of_obj,
    "STL": _none,
    "FBX": _files_of_fbx,
    "USD": _none,
}
