# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of a mesh, of any format that is read: looked at before anything is loaded."""

import re
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..regular_files import open_regular, read_bytes
from .gltf_file import read_gltf_header
from .mesh_formats import FORMAT_BYTES, MeshFormat, format_of, not_a_mesh
from .obj_file import check_obj, files_of_obj
from .ply import check_ply, texture_files
from .ply_file import DAMAGED

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", 9), ("attribute", "<u2")])  # of a binary STL
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

    Of USD only the importer knows them. Raises InputError as check_mesh does.
    """
    found = imported_format(path)
    return texture_files(path) if found is None else _BESIDE[found.name](path)


def _check_stl(path: Path) -> None:
    size = path.stat().st_size
    with open_regular(path) as file:
        start = file.read(FORMAT_BYTES)
    if start.lstrip().startswith(b"solid") and b"facet" in start:
        return
    facets = struct.unpack_from("<I", start, 80)[0] if len(start) >= 84 else 0
    if facets == 0:
        raise InputError(path, "holds no faces", remedy="export it as a polygon mesh")
    if size < 84 + 50 * facets:
        problem = f"cut short: {size} bytes, but {facets} facets take {84 + 50 * facets}"
        raise InputError(path, problem, remedy=DAMAGED)
    with open_regular(path) as file:
        corners = np.memmap(file, _FACET, "r", 84, (facets,))["corners"]
    if not np.isfinite(corners).all():  # Blender takes zero for it
        raise InputError(path, "a coordinate is NaN or infinite", remedy=DAMAGED)


def _check_size(path: Path) -> None:
    if path.stat().st_size == 0:
        raise InputError(path, "is empty", remedy="export it again")


def _files_of_fbx(path: Path) -> list[Path]:
    """Return the files that an FBX file names, where they are found beside it or as it names them."""
    data, found = read_bytes(path, largest_bytes=None), {}
    for match in _NAME_IN_FBX.finditer(data):
        name = match[2]
        if match[1] is not None:
            (length,) = struct.unpack("<I", match[1])
            name = data[match.end() : match.end() + length] if length < FORMAT_BYTES else b""
        text = name.decode(errors="surrogateescape").replace("\\", "/")
        if text and "\0" not in text:
            places = (path.parent / text, path.parent / Path(text).name)
            found.update(dict.fromkeys(place for place in places if place.is_file()))
    return list(found)


def _none(_path: Path) -> list[Path]:
    return []


def _files_of_gltf(path: Path) -> list[Path]:
    return [file for file in read_gltf_header(path).files if file.is_file()]


def _check_gltf(path: Path) -> None:
    read_gltf_header(path)


_CHECKS: dict[str, Callable[[Path], None]] = {
    "glTF": _check_gltf,
    "OBJ": check_obj,
    "STL": _check_stl,
    "FBX": _check_size,
    "USD": _check_size,
}
_BESIDE: dict[str, Callable[[Path], list[Path]]] = {
    "glTF": _files_of_gltf,
    "OBJ": files_of_obj,
    "STL": _none,
    "FBX": _files_of_fbx,
    "USD": _none,
}
