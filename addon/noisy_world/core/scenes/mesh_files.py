# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of a mesh, of any format that is read: looked at before anything is loaded."""

import re
import struct
from collections.abc import Callable
from pathlib import Path

from ..errors import InputError
from ..regular_files import open_regular
from ..utf8_names import utf8_name
from .beside import check_no_pipe, is_file, is_inside
from .mesh_formats import FORMAT_BYTES, MeshFormat, format_of, not_a_mesh
from .obj_file import check_obj, check_obj_numbers, faces_of_obj, files_of_obj
from .ply import check_ply, texture_files
from .ply_file import DAMAGED
from .text_numbers import check_fbx_arrays, check_stl_corners, line_with_odd_number

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


def files_beside(path: Path) -> list[Path]:
    """Return the files beside a mesh that it is made of, as far as a look at it tells; those that are there.

    Of USD only the importer knows them. Raises InputError as check_mesh does, and where a name is not UTF-8.
    """
    found = imported_format(path)
    files = texture_files(path) if found is None else _BESIDE[found.name](path)
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


def _bytes(path: Path) -> bytes:
    try:
        with open_regular(path) as file:
            return file.read()
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error


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
    from .gltf_file import read_gltf_header

    return [file for file in read_gltf_header(path).files if is_file(file)]


def _check_gltf(path: Path) -> None:
    from .gltf_file import read_gltf_header

    read_gltf_header(path)


_CHECKS: dict[str, Callable[[Path], None]] = {
    "glTF": _check_gltf,
    "OBJ": check_obj,
    "STL": _check_stl,
    "FBX": _check_fbx,
    "USD": _check_size,
}
_BESIDE: dict[str, Callable[[Path], list[Path]]] = {
    "glTF": _files_of_gltf,
    "OBJ": files_of_obj,
    "STL": _none,
    "FBX": _files_of_fbx,
    "USD": _none,
}
