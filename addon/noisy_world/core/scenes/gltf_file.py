# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of a glTF file before it is imported: the files it refers to, and its compression.

The layout of a GLB file is that of the glTF 2.0 specification, section 4.
"""

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from ..errors import InputError
from ..regular_files import open_regular
from .beside import check_no_pipe, is_file, leads_out, place_inside
from .gltf_layout import LayoutError, check_layout
from .ply_file import DAMAGED

_HEADER, _CHUNK = struct.Struct("<4sII"), struct.Struct("<II")
_JSON_CHUNK = 0x4E4F534A
_COMPRESSIONS = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
_TEXTURES_BLENDER_LACKS = {
    "KHR_texture_basisu": "KTX2 (Basis Universal)",
    "MSFT_texture_dds": "DDS",
    "EXT_texture_avif": "AVIF",
}


@dataclass(frozen=True)
class GltfHeader:
    """What is known of a glTF file before it is imported.

    compression: what its meshes are compressed with, which takes a library that not every Blender has; empty if none.
    webp: whether its textures have to be read as WebP. files: those beside it that it is made of, as they should lie.
    """

    compression: str
    webp: bool
    files: tuple[Path, ...]


def read_gltf_header(path: Path) -> GltfHeader:
    """Read what a GLB or glTF file says of itself. Raises InputError where it is damaged or not to be read at all."""
    document = _document(path)
    version = str(_dict(document.get("asset")).get("version", ""))
    if version != "2.0":
        raise InputError(path, f"glTF of version {version[:20] or 'unknown'}", remedy="export it as glTF 2.0")
    used = set(map(str, _list(document.get("extensionsUsed"))))
    required = set(map(str, _list(document.get("extensionsRequired"))))
    for name, what in _TEXTURES_BLENDER_LACKS.items():
        if name in required:
            remedy = "save it with PNG or JPEG textures"
            raise InputError(path, f"its textures are {what}, which Blender cannot read", remedy=remedy)
    compression = next((what for name, what in _COMPRESSIONS.items() if name in used | required), "")
    buffers = _linked(path, document, "buffers")
    for file, declared in buffers:
        _check_buffer(path, file, declared)
    sizes = [path.stat().st_size, *(file.stat().st_size for file, _ in buffers)]
    try:
        check_layout(document, sum(sizes))
    except LayoutError as error:
        raise InputError(path, str(error), remedy=DAMAGED) from error
    images = [file for file, _ in _linked(path, document, "images")]
    files = dict.fromkeys([*(file for file, _ in buffers), *images])
    return GltfHeader(compression, "EXT_texture_webp" in required, tuple(files))


def _document(path: Path) -> dict[str, Any]:
    try:
        data = _json_of(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error
    try:
        document = json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InputError(path, f"its JSON cannot be read: {error}"[:200], remedy=DAMAGED) from error
    if not isinstance(document, dict):
        raise InputError(path, "its JSON is no object", remedy=DAMAGED)
    return document


def _json_of(path: Path) -> bytes:
    """Return the JSON of a GLB file; of a file that is none, all of it."""
    with open_regular(path) as file:
        start = file.read(_HEADER.size)
        if not start.startswith(b"glTF"):
            return start + file.read()
        size = path.stat().st_size
        if len(start) < _HEADER.size:
            raise InputError(path, "cut short: it has no header", remedy=DAMAGED)
        _, version, length = _HEADER.unpack(start)
        if version != 2:
            raise InputError(path, f"GLB of version {version}", remedy="export it as glTF 2.0")
        if length != size:
            problem = "cut short" if length > size else "longer than it says"
            raise InputError(path, f"{problem}: {size} bytes, of which its header says {length}", remedy=DAMAGED)
        chunk = file.read(_CHUNK.size)
        count, kind = _CHUNK.unpack(chunk) if len(chunk) == _CHUNK.size else (0, 0)
        data = file.read(count) if kind == _JSON_CHUNK and count <= size else b""
        if not data or len(data) < count:
            raise InputError(path, "does not begin with JSON", remedy=DAMAGED)
        return data


def _linked(path: Path, document: dict[str, Any], kind: str) -> list[tuple[Path, int]]:
    """Return the files that buffers or images lie in, and how many bytes each buffer declares."""
    found = []
    for number, item in enumerate(_list(document.get(kind))):
        uri = _dict(item).get("uri")
        if uri is None or (isinstance(uri, str) and uri.startswith("data:")):
            continue
        name = unquote(uri).replace("\\", "/") if isinstance(uri, str) else ""
        if not name or "://" in name or "\0" in name:
            problem = f"{kind[:-1]} {number} lies at {str(uri)[:100]!r}, which is no file's name"
            raise InputError(path, problem, remedy="save it as GLB, which holds all in one file")
        place = place_inside(path.parent, name)
        if place is None:
            raise leads_out(path, kind[:-1], name)
        check_no_pipe(path, kind[:-1], place)
        length = _dict(item).get("byteLength", 0)
        found.append((place, length if isinstance(length, int) else 0))
    return found


def _check_buffer(path: Path, file: Path, declared: int) -> None:
    if not is_file(file):
        problem = f"its buffer {file.name[:200]!r} is missing in {str(file.parent)[:300]}"
        raise InputError(path, problem, remedy="put it there")
    if file.stat().st_size < declared:
        problem = f"its buffer {file.name[:200]!r} is cut short: {file.stat().st_size} of {declared} bytes"
        raise InputError(path, problem, remedy="export it again")


def _dict(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
