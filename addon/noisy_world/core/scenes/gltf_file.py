# SPDX-License-Identifier: GPL-3.0-or-later
"""What a glTF file says of itself before it is imported: which files it is made of, and what it is packed with.

The layout of a GLB file is that of the glTF 2.0 specification, section 4.
"""

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..regular_files import open_regular, read_bytes
from .ply_file import DAMAGED

_HEADER, _CHUNK = struct.Struct("<4sII"), struct.Struct("<II")
_FLOAT = 5126  # a component's type
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
        raise InputError(path, f"glTF of version {version or 'unknown'}", remedy="export it as glTF 2.0")
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
    _check_positions(path, document)
    images = [file for file, _ in _linked(path, document, "images")]
    files = dict.fromkeys([*(file for file, _ in buffers), *images])
    return GltfHeader(compression, "EXT_texture_webp" in required, tuple(files))


def _document(path: Path) -> dict[str, Any]:
    try:
        data = read_bytes(path) if path.suffix.lower() != ".glb" else _json_of_glb(path)
        if data.startswith(b"glTF"):
            data = _json_of_glb(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error
    try:
        document = json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InputError(path, f"its JSON cannot be read: {error}"[:200], remedy=DAMAGED) from error
    if not isinstance(document, dict):
        raise InputError(path, "its JSON is no object", remedy=DAMAGED)
    return document


def _json_of_glb(path: Path) -> bytes:
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
        if not isinstance(uri, str) or "://" in uri or "\0" in uri:
            problem = f"{kind[:-1]} {number} lies at {str(uri)[:100]!r}, which is no file's name"
            raise InputError(path, problem, remedy="save it as GLB, which holds all in one file")
        length = _dict(item).get("byteLength", 0)
        found.append((path.parent / unquote(uri), length if isinstance(length, int) else 0))
    return found


def _check_buffer(path: Path, file: Path, declared: int) -> None:
    if not file.is_file():
        raise InputError(path, f"its buffer {file.name[:200]!r} is missing in {file.parent}", remedy="put it there")
    if file.stat().st_size < declared:
        problem = f"its buffer {file.name[:200]!r} is cut short: {file.stat().st_size} of {declared} bytes"
        raise InputError(path, problem, remedy="export it again")


def _check_positions(path: Path, document: dict[str, Any]) -> None:
    """Raise InputError where a position is not finite, for which Blender takes zero."""
    primitives = [item for mesh in _list(document.get("meshes")) for item in _list(_dict(mesh).get("primitives"))]
    numbers = {_dict(_dict(item).get("attributes")).get("POSITION") for item in primitives}
    accessors, views = _list(document.get("accessors")), _list(document.get("bufferViews"))
    for number in sorted(item for item in numbers if isinstance(item, int) and 0 <= item < len(accessors)):
        accessor = _dict(accessors[number])
        place = accessor.get("bufferView")
        if accessor.get("componentType") != _FLOAT or not isinstance(place, int) or not 0 <= place < len(views):
            continue
        view, count = _dict(views[place]), _whole(accessor.get("count"))
        stored = _buffer(path, document, view.get("buffer"))
        start = _whole(view.get("byteOffset")) + _whole(accessor.get("byteOffset"))
        stride = _whole(view.get("byteStride")) or 12
        if stored is None or count == 0 or start + (count - 1) * stride + 12 > len(stored):
            continue  # which the importer says
        if not np.isfinite(np.ndarray((count, 3), "<f4", stored, start, (stride, 4))).all():
            raise InputError(path, "a coordinate is NaN or infinite", remedy=DAMAGED)


def _buffer(path: Path, document: dict[str, Any], number: Any) -> NDArray[np.uint8] | None:
    """Return the bytes of a buffer that lies in a file; None of one that is written as text."""
    buffers = _list(document.get("buffers"))
    if not isinstance(number, int) or not 0 <= number < len(buffers):
        return None
    uri = _dict(buffers[number]).get("uri")
    if isinstance(uri, str) and not uri.startswith("data:"):
        return _mapped(path.parent / unquote(uri))
    if uri is not None:
        return None
    data = _mapped(path)
    if bytes(data[:4]) != b"glTF":
        return None
    (length,) = struct.unpack_from("<I", data, _HEADER.size)
    return data[_HEADER.size + _CHUNK.size + length + _CHUNK.size :]


def _mapped(path: Path) -> NDArray[np.uint8]:
    with open_regular(path) as file:
        return np.memmap(file, np.uint8, "r")


def _dict(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _whole(value: Any) -> int:
    return value if isinstance(value, int) and value > 0 else 0


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
