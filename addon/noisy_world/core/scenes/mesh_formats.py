# SPDX-License-Identifier: GPL-3.0-or-later
"""Recognises the format of a mesh file other than PLY."""

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError

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
