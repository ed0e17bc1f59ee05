# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh files of any format: how each is recognised, and where the file names in it may lead."""

import os
import posixpath
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import InputError
from ..core.file_access import check_regular

FORMAT_BYTES = 4096  # of a file's beginning: enough to tell the formats
_STL_HEAD_BYTES, _STL_FACET_BYTES = 84, 50  # of a binary STL: 80 of anything, the number of facets, and each of them


@dataclass(frozen=True)
class MeshFormat:
    """A format of mesh files.

    suffixes: of its files. begins: whether a file of this size that begins with these bytes is one. blender: whether
    Blender imports it. refers: whether it refers to other files in a way that only the importer knows.
    """

    name: str
    suffixes: tuple[str, ...]
    begins: Callable[[bytes, int], bool]
    blender: bool = True
    refers: bool = False


def format_of(path: Path, start: bytes) -> MeshFormat | None:
    """Return the format of a mesh file that is not a PLY, by what is in it or else by its name; None for another file.

    start: its first bytes, as many as FORMAT_BYTES or all.
    """
    size = path.stat().st_size
    content = next((item for item in _FORMATS if item.begins(start, size)), None)
    return content or next((item for item in _FORMATS if path.suffix.lower() in item.suffixes), None)


def not_a_ply(path: Path, start: bytes) -> InputError:
    """Return the error of a file that is not a PLY, where only a PLY is read. start: as for format_of."""
    found = format_of(path, start)
    if found is None:
        return InputError(path, "not a PLY file", remedy="the first line of a PLY file reads 'ply'")
    remedy = "'noisy-world export' writes it as PLY" if found.blender else "export it as PLY"
    return InputError(path, f"not a PLY file, but {found.name}", remedy=remedy)


def not_a_mesh(path: Path, found: MeshFormat | None) -> InputError:
    """Return the error of a file that is no mesh that is read; found: the format that it has."""
    if not path.stat().st_size:
        return InputError(path, "is empty", remedy="copy or export it again")
    if found is None:
        read = ", ".join(["PLY", *(item.name for item in _FORMATS if item.blender)])
        return InputError(path, f"no mesh file that is known: {read}", remedy="export it as one of these")
    return InputError(path, f"is {found.name}, which is not read", remedy="export it as PLY or glTF")


def _with_magic(*magics: bytes) -> Callable[[bytes, int], bool]:
    return lambda start, _size: start.startswith(magics)


def _is_gltf(start: bytes, _size: int) -> bool:
    as_text = start.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{") and b'"asset"' in start
    return start.startswith(b"glTF") or as_text


def _is_obj(start: bytes, _size: int) -> bool:
    """Tell whether all whole lines are statements of OBJ, and one of them more than a common word."""
    known = rb"(v|vt|vn|vp|f|l|p|o|g|s|usemtl|mtllib|cstype|deg|curv|curv2|surf|parm|end)\s"
    lines = [line.strip() for line in start.splitlines()]
    lines = [line for line in (lines[:-1] if len(start) >= FORMAT_BYTES else lines) if line and line[:1] != b"#"]
    telling = re.compile(rb"(v\s+\S+\s+\S+\s+\S+|mtllib\s|o\s|g\s|f\s)")
    return bool(lines) and all(re.match(known, line) for line in lines) and any(map(telling.match, lines))


def _is_stl(start: bytes, size: int) -> bool:
    if re.match(rb"\s*solid\b", start) and b"facet" in start:
        return True
    if len(start) < _STL_HEAD_BYTES:
        return False
    (facets,) = struct.unpack_from("<I", start, _STL_HEAD_BYTES - 4)
    return size == _STL_HEAD_BYTES + facets * _STL_FACET_BYTES


def _is_dae(start: bytes, _size: int) -> bool:
    return re.match(rb"(\xef\xbb\xbf)?\s*<", start) is not None and b"<COLLADA" in start


def _is_off(start: bytes, _size: int) -> bool:
    return re.match(rb"\s*(ST)?C?N?4?n?OFF\b", start) is not None


_FORMATS = (
    MeshFormat("glTF", (".gltf", ".glb"), _is_gltf),
    MeshFormat("FBX", (".fbx",), _with_magic(b"Kaydara FBX Binary", b"; FBX ")),
    MeshFormat("USD", (".usd", ".usda", ".usdc", ".usdz"), _with_magic(b"#usda", b"PXR-USDC"), refers=True),
    MeshFormat("COLLADA (DAE)", (".dae",), _is_dae, blender=False),
    MeshFormat("OFF", (".off",), _is_off, blender=False),
    MeshFormat("STL", (".stl",), _is_stl),
    MeshFormat("OBJ", (".obj",), _is_obj),
)

MESH_SUFFIXES = (".ply", *(suffix for item in _FORMATS if item.blender for suffix in item.suffixes))
"""The endings of mesh files that are read."""


# Resolves file names inside a mesh file, which may lead only into the mesh's folder or below it.


_SOMEWHERE_ELSE = re.compile(r"/|[A-Za-z]:|file:|[^/:]++://", re.IGNORECASE)  # absolute, of a drive, or an address


def place_inside(folder: Path, name: str, within: str = "") -> Path | None:
    """Return where a name in a mesh leads; None where that is not inside the mesh's folder.

    name: as it is written, a \\ for a / too, but without percent signs for letters. within: the folder of the file
    that gives the name, relative to the mesh's.
    """
    text = name.replace("\\", "/")
    inside = posixpath.normpath(posixpath.join(within, text))
    if _SOMEWHERE_ELSE.match(text) or inside == ".." or inside.startswith("../"):
        return None
    return folder / inside


def is_inside(folder: Path, file: Path) -> bool:
    """Tell whether a file's path leads into a folder, whatever the links on its way."""
    return _plain(file).is_relative_to(_plain(folder))


def is_file(path: Path) -> bool:
    """Tell whether there is such a file, and not a pipe or a device; names that no file can have are none."""
    return os.path.isfile(path)  # noqa: PTH113 - for a name that no file can have, Path.is_file raises


def check_no_pipe(mesh_path: Path, what: str, place: Path) -> None:
    """Raise InputError where a name of a mesh leads to a pipe or a device, which its importer would wait for."""
    try:
        there = os.path.exists(place) and not os.path.isdir(place)  # noqa: PTH110, PTH112 - as for is_file
        if there:
            check_regular(place)
    except OSError as error:
        raise InputError(mesh_path, f"its {what} {place.name[:200]!r}: {error.strerror or error}") from error


def leads_out(mesh_path: Path, what: str, name: str) -> InputError:
    """Return the error of a name that leads out of the mesh's folder. what: a buffer, for instance."""
    problem = f"its {what} {name[:200]!r} leads out of the mesh's folder"
    return InputError(mesh_path, problem, remedy="put it beside the mesh, and name it so")


def link_notes(mesh_path: Path, files: list[Path]) -> list[str]:
    """Return a note for the files in a mesh's folder that are links to files outside it, or lie behind such a link."""
    home = Path(os.path.realpath(mesh_path.parent))
    found = [(file, Path(os.path.realpath(file))) for file in files if is_inside(mesh_path.parent, file)]
    away = [(file, target) for file, target in found if not target.is_relative_to(home)]
    if not away:
        return []
    file, target = away[0]
    more = f", and {len(away) - 1} more of its files are such links" if len(away) > 1 else ""
    return [f"its file {file.name[:200]!r} is a link out of the mesh's folder, to {str(target)[:300]!r}{more}"]


def _plain(path: Path) -> Path:
    return Path(os.path.normpath(os.path.abspath(path)))  # noqa: PTH100 - Path keeps '..'
