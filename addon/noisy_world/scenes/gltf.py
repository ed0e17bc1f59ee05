# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of a glTF file before it is imported: its buffers, the files it refers to, its compression.

Checks of a glTF file before it is imported: the files it refers to, and its compression.

The layout of a GLB file is that of the glTF 2.0 specification, section 4.
"""

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from ..core.errors import InputError
from ..core.file_access import open_regular
from .mesh_formats import check_no_pipe, is_file, leads_out, place_inside
from .ply import DAMAGED

# Checks that a glTF document's buffers, views and accessors lie inside one another (glTF 2.0, section 5).
#
# Blender's importer believes a document: with a stride below zero it reads memory that is none of the file's, and
# with a count it takes memory for as many.


_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}  # by a component's type
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_STRIDES = range(4, 253)
_REFERENCES = (
    ("nodes", "mesh", "meshes"),
    ("textures", "source", "images"),
    ("textures", "sampler", "samplers"),
    ("images", "bufferView", "bufferViews"),
)
_ZEROS_FOR_EACH_BYTE = 64  # chosen: what no part of the file holds is 0, or unpacked from what is compressed


class LayoutError(ValueError):
    """A part that does not lie where it can; the message says which."""


def check_layout(document: dict[str, Any], size_bytes: int) -> None:
    """Raise LayoutError where a view, an accessor or a node cannot be as it says.

    size_bytes: of all files of the mesh.
    """
    buffers, views = (_dicts(document, name) for name in ("buffers", "bufferViews"))
    for number, view in enumerate(views):
        _check_view(f"bufferView {number}", view, buffers)
    for number, accessor in enumerate(_dicts(document, "accessors")):
        _check_accessor(f"accessor {number}", accessor, views, size_bytes)
    _check_tree(_dicts(document, "nodes"))
    _check_references(document)


def _check_references(document: dict[str, Any]) -> None:
    """Raise LayoutError where a number leads to nothing; the importer takes one below zero as counted from the end."""
    for name, key, target in _REFERENCES:
        for number, item in enumerate(_dicts(document, name)):
            if key in item:
                _of(_dicts(document, target), item[key], f"{name}.{number}.{key}")
    for number, mesh in enumerate(_dicts(document, "meshes")):
        for each, primitive in enumerate(_dicts(mesh, "primitives")):
            place = f"meshes.{number}.primitives.{each}"
            found = {**_dict(primitive.get("attributes", {}), f"{place}.attributes")}
            found |= {"indices": primitive["indices"]} if "indices" in primitive else {}
            for key, accessor in found.items():
                _of(_dicts(document, "accessors"), accessor, f"{place}.{key[:40]}")
            if "material" in primitive:
                _of(_dicts(document, "materials"), primitive["material"], f"{place}.material")


def _check_view(name: str, view: dict[str, Any], buffers: list[dict[str, Any]]) -> None:
    extensions = _dict(view.get("extensions", {}), f"{name}.extensions")
    for extension in ("EXT_meshopt_compression", "KHR_meshopt_compression"):
        if (inner := extensions.get(extension)) is not None:
            _check_view(f"{name}.{extension}", {**_dict(inner, name), "byteStride": None}, buffers)
            return  # its own buffer is a stand-in
    buffer = _of(buffers, view.get("buffer"), f"{name}: buffer")
    start, length = _whole(view, "byteOffset", name, 0), _whole(view, "byteLength", name)
    if start + length > _whole(buffer, "byteLength", f"{name}: its buffer"):
        raise LayoutError(f"{name} ends behind its buffer")
    stride = _whole(view, "byteStride", name, 0)
    if stride and stride not in _STRIDES:
        raise LayoutError(f"{name}: byteStride {_shown(stride)} is not between {_STRIDES[0]} and {_STRIDES[-1]}")


def _check_accessor(name: str, accessor: dict[str, Any], views: list[dict[str, Any]], size_bytes: int) -> None:
    count, size = _whole(accessor, "count", name), _size(name, accessor)
    if accessor.get("bufferView") is None:
        if count > _ZEROS_FOR_EACH_BYTE * size_bytes:
            raise LayoutError(f"{name} is {_shown(count)} zeros, in files of {size_bytes} bytes")
    else:
        view = _of(views, accessor["bufferView"], f"{name}: bufferView")
        _check_fits(name, accessor, view, count, size)
    if accessor.get("sparse") is not None:
        _check_sparse(f"{name}.sparse", _dict(accessor["sparse"], f"{name}.sparse"), views, count, size)


def _check_sparse(name: str, sparse: dict[str, Any], views: list[dict[str, Any]], count: int, size: int) -> None:
    """Raise LayoutError where the changed elements of an accessor do not lie in their views.

    count: the accessor's elements, of size bytes each.
    """
    changed = _whole(sparse, "count", name)
    if changed > count:
        raise LayoutError(f"{name} changes {_shown(changed)} of {_shown(count)}")
    indices, values = (_dict(sparse.get(part), f"{name}.{part}") for part in ("indices", "values"))
    for part, inner, each in (("indices", indices, _component(f"{name}.indices", indices)), ("values", values, size)):
        view = _of(views, inner.get("bufferView"), f"{name}.{part}: bufferView")
        _check_fits(f"{name}.{part}", inner, view, changed, each)


def _check_fits(name: str, part: dict[str, Any], view: dict[str, Any], count: int, size: int) -> None:
    stride = view.get("byteStride") or size
    start = _whole(part, "byteOffset", name, 0)
    if count and start + (count - 1) * stride + size > _whole(view, "byteLength", name):
        raise LayoutError(f"{name} ends behind its bufferView")
    if count > 1 and stride < size:
        raise LayoutError(f"{name} has elements of {size} bytes, {stride} apart")


def _size(name: str, accessor: dict[str, Any]) -> int:
    """Return how many bytes an element has; columns of matrices begin at multiples of four."""
    kind, each = accessor.get("type"), _component(name, accessor)
    if not isinstance(kind, str) or kind not in _COMPONENTS:
        raise LayoutError(f"{name}: type is none that is known")
    rows = {"MAT2": 2, "MAT3": 3, "MAT4": 4}.get(kind)
    return _COMPONENTS[kind] * each if rows is None else rows * -(-rows * each // 4) * 4


def _component(name: str, part: dict[str, Any]) -> int:
    """Return how many bytes a component of its type has."""
    component = part.get("componentType")
    if not isinstance(component, int) or component not in _BYTES:
        raise LayoutError(f"{name}: componentType is none that is known")
    return _BYTES[component]


def _check_tree(nodes: list[dict[str, Any]]) -> None:
    """Raise LayoutError where a node has two parents, or is below itself."""
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        children = node.get("children", [])
        for child in children if isinstance(children, list) else [children]:
            _of(nodes, child, f"node {number}: child")
            if child in parents:
                raise LayoutError(f"node {child} is a child twice")
            parents[child] = number
    above: dict[int, bool] = {}
    for number in range(len(nodes)):
        way: list[int] = []
        at: int | None = number
        while at is not None and at not in above:
            above[at] = True
            way.append(at)
            at = parents.get(at)
        if at is not None and at in way:
            raise LayoutError(f"node {at} is below itself")


def _dicts(document: dict[str, Any], name: str) -> list[dict[str, Any]]:
    value = document.get(name)
    if value is None:
        return []
    if not isinstance(value, list):
        raise LayoutError(f"{name} is no list")
    return [_dict(item, f"{name}.{number}") for number, item in enumerate(value)]


def _dict(value: Any, name: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise LayoutError(f"{name} is no object")
    return value


def _of(items: list[dict[str, Any]], number: Any, name: str) -> dict[str, Any]:
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < len(items):
        raise LayoutError(f"{name} {_shown(number)} is not there")
    return items[number]


def _whole(part: dict[str, Any], key: str, name: str, without: int | None = None) -> int:
    value = part.get(key)
    if value is None and without is not None:
        return without
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise LayoutError(f"{name}: {key} is {_shown(value)}, and no whole number from 0")
    return value


def _shown(value: Any) -> str:
    if isinstance(value, int) and value.bit_length() > 64:
        return "beyond 2^64"
    return repr(value)[:40] if isinstance(value, (int, float, str, type(None))) else f"a {type(value).__name__}"


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
    version = str(_dict_or_none(document.get("asset")).get("version", ""))
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
        uri = _dict_or_none(item).get("uri")
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
        length = _dict_or_none(item).get("byteLength", 0)
        found.append((place, length if isinstance(length, int) else 0))
    return found


def _check_buffer(path: Path, file: Path, declared: int) -> None:
    if not is_file(file):
        problem = f"its buffer {file.name[:200]!r} is missing in {str(file.parent)[:300]}"
        raise InputError(path, problem, remedy="put it there")
    if file.stat().st_size < declared:
        problem = f"its buffer {file.name[:200]!r} is cut short: {file.stat().st_size} of {declared} bytes"
        raise InputError(path, problem, remedy="export it again")


def _dict_or_none(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
