# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of every format, changed by structure and looked at as it is done before Blender imports them; PLY is read."""

import json
import struct

import numpy as np
from fuzz.mutation import pick
from fuzz.structure import as_cell, as_json, as_table, changed, note, raws, whole
from rooms_in_formats import gltf, room_attributes, walls

from noisy_world.core.scenes.mesh_files import check_mesh, files_beside, imported_format
from noisy_world.core.scenes.ply import read_ply

TASK = "task.json"
WORDS = (
    "vertex", "face", "uchar", "int", "float", "double", "list", "x", "red", "ascii", "binary_little_endian", "f",
    "v", "vt",
    "mtllib", "usemtl", "POSITION", "VEC3", "data:,x", "http://x/y", "room.bin", "room.mtl", "walls.png", "-mm",
    "1/1/1",
)  # fmt: skip
TYPES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d"}
RANGES = {"b": (-128, 127), "B": (0, 255), "h": (-(2**15), 2**15 - 1), "H": (0, 2**16 - 1)}
RANGES |= {"i": (-(2**31), 2**31 - 1), "I": (0, 2**32 - 1), "Q": (0, 2**64 - 1)}


# --- PLY ---


def ply(rng):
    """Return mesh.ply: its header and its values may disagree after a change."""
    corners, _ = walls()
    kind = pick(rng, ("float", "double"))
    properties = [["property", kind, axis] for axis in "xyz"]
    properties += [["property", "uchar", name] for name in ("red", "green", "blue")]
    rows = [[*point, 200, 100, k] for k, point in enumerate(corners.reshape(-1, 3).tolist())]
    tree = {
        "magic": "ply",
        "format": ["format", pick(rng, ("ascii", "binary_little_endian", "binary_big_endian")), "1.0"],
        "comments": [["comment", "made", "here"]],
        "vertex": {"element": ["element", "vertex", 24], "properties": properties, "rows": rows},
        "face": {
            "element": ["element", "face", 6],
            "properties": [["property", "list", "uchar", "int", "vertex_indices"]],
            "rows": [[4, 4 * k, 4 * k + 1, 4 * k + 2, 4 * k + 3] for k in range(6)],
        },
        "end": "end_header",
    }
    tree, told = changed(tree, rng, raws=(), words=WORDS)
    head, body = [], []
    order = {"ascii": "", "binary_big_endian": ">"}.get(_at(tree, "format", 1), "<")
    for name, part in tree.items() if isinstance(tree, dict) else [("", tree)]:
        if isinstance(part, dict) and "rows" in part:
            declared = part.get("properties")
            head.append(as_cell(part.get("element")))
            head += [as_cell(each) for each in (declared if isinstance(declared, list) else [declared])]
            body.append(_ply_rows(part["rows"], declared, order))
        elif name == "comments" and isinstance(part, list):
            head += [as_cell(each) for each in part]
        else:
            head.append(as_cell(part))
    end = pick(rng, (b"\n", b"\n", b"\r\n"))
    return {"mesh.ply": end.join([*head, b""]) + b"".join(body)}, told


def _at(tree, *keys):
    for key in keys:
        try:
            tree = tree[key]
        except (KeyError, IndexError, TypeError):
            return None
    return tree if isinstance(tree, str) else None


def _ply_rows(rows, declared, order):
    if order == "":
        return as_table(rows)
    kinds = []
    for each in declared if isinstance(declared, list) else []:
        words = [str(word) for word in each] if isinstance(each, list) else []
        if words[1:2] == ["list"]:
            kinds += [TYPES.get(word, "i") for word in (*words[2:3], *(words[3:4] * 4))]
        else:
            kinds.append(TYPES.get(words[1] if len(words) > 1 else "", "f"))
    found = b""
    for row in rows if isinstance(rows, list) else [rows]:
        cells = row if isinstance(row, list) else [row]
        for k, cell in enumerate(cells):
            found += _packed(cell, kinds[min(k, len(kinds) - 1)] if kinds else "i", order)
    return found


def _packed(value, kind, order="<"):
    """Return a value as a number of a kind of struct's, whatever it is."""
    if kind in "fd":
        try:
            number = float(value)
            return struct.pack(order + kind, number)
        except (TypeError, ValueError, OverflowError):
            return struct.pack(order + kind, float("nan"))
    return struct.pack(order + kind, whole(value, *RANGES[kind]))


# --- OBJ, STL, USD, FBX ---


def obj(rng):
    """Return mesh.obj and its materials."""
    corners, uv = walls()
    lines = [["mtllib", "room.mtl"], ["o", "room"], ["usemtl", "walls"]]
    lines += [["v", *point] for point in corners.reshape(-1, 3).tolist()]
    lines += [["vt", *point] for point in uv.reshape(-1, 2).tolist()]
    lines += [["f", *(f"{n}/{n}" for n in range(4 * wall + 1, 4 * wall + 5))] for wall in range(6)]
    material = [["newmtl", "walls"], ["Kd", 0.5, 0.5, 0.5], ["map_Kd", "-s", 1, 1, 1, "walls.png"]]
    tree, told = changed({"mesh.obj": lines, "room.mtl": material}, rng, raws=TEXT_RAWS, words=WORDS)
    return _texts(tree), told


TEXT_RAWS = raws(b"nan", b"inf", b"1e999", b"\xff\xfe", b"\x00", b"1e", b"9" * 5000, b"\\\n", b"#", b"\r")


def _texts(tree):
    """Return the files of a tree: each a table by its name, if it is still there."""
    files = {"mesh.obj": b"", "room.mtl": b""}
    for name, rows in tree.items() if isinstance(tree, dict) else []:
        if name in files:
            files[name] += as_table(rows)
    return files


def stl(rng):
    """Return mesh.stl, as text or binary."""
    corners, _ = walls()
    triangles = corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 3).tolist()
    if rng.integers(2):
        facets = []
        for triangle in triangles:
            facets += [["facet", "normal", 0, 0, 1], ["outer", "loop"], *(["vertex", *point] for point in triangle)]
            facets += [["endloop"], ["endfacet"]]
        tree, told = changed([["solid", "room"], *facets, ["endsolid", "room"]], rng, raws=TEXT_RAWS, words=WORDS)
        return {"mesh.stl": as_table(tree)}, told
    tree = {"head": "by hand", "count": len(triangles), "facets": [[[0, 0, 1], *each, 0] for each in triangles]}
    tree, told = changed(tree, rng, raws=(), words=WORDS)
    data = as_cell(_get(tree, "head"))[:80].ljust(80) + _packed(_get(tree, "count"), "I")
    facets = _get(tree, "facets")
    for facet in facets if isinstance(facets, list) else [facets]:
        numbers = list(_numbers(facet))
        data += b"".join(_packed(number, "f") for number in numbers[:-1]) + _packed(numbers[-1] if numbers else 0, "H")
    return {"mesh.stl": data}, told


def _get(tree, name):
    return tree.get(name) if isinstance(tree, dict) else tree


def _numbers(value):
    if isinstance(value, list):
        for each in value:
            yield from _numbers(each)
    else:
        yield value


def usd(rng):
    """Return mesh.usda; what is in it, only Blender reads."""
    tree = [["#usda", "1.0"], ["(", "upAxis", "=", '"Z"', ")"], ["def", "Mesh", '"Room"', "{"], ["}"]]
    tree, told = changed(tree, rng, raws=TEXT_RAWS, words=WORDS)
    return {"mesh.usda": as_table(tree)}, told


def fbx(rng):
    """Return mesh.fbx: its head and the names of its textures, as nodes that begin with where they end."""
    tree = {
        "magic": "Kaydara FBX Binary  \x00\x1a\x00",
        "version": 7400,
        "nodes": [{"name": "RelativeFilename", "kind": "S", "length": 9, "text": "walls.png"} for _ in range(2)],
    }
    tree, told = changed(tree, rng, raws=(), words=WORDS)
    data = as_cell(_get(tree, "magic")) + _packed(_get(tree, "version"), "I")
    nodes = _get(tree, "nodes")
    for node in nodes if isinstance(nodes, list) else [nodes]:
        text = as_cell(_get(node, "text"))
        name = as_cell(_get(node, "name"))
        data += struct.pack("<IIIB", 0, 1, len(text) + 5, len(name) % 256) + name
        data += as_cell(_get(node, "kind")) + _packed(_get(node, "length"), "I") + text
    return {"mesh.fbx": data}, told


# --- glTF ---


def gltf_text(rng):
    """Return mesh.gltf with its buffer in a file."""
    document, blob = gltf(room_attributes(), {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    document["buffers"][0]["uri"] = "room.bin"
    document |= {"images": [{"uri": "walls.png"}], "textures": [{"source": 0}], "extensionsUsed": ["KHR_x"]}
    blob = _damaged_numbers(blob, rng)
    tree, told = changed(document, rng, words=WORDS)
    return {"mesh.gltf": as_json(tree, indent=1), "room.bin": blob}, told


def glb(rng):
    """Return mesh.glb; its header and its chunks may disagree after a change."""
    document, blob = gltf(room_attributes())
    chunks = [
        {"length": None, "kind": 0x4E4F534A, "json": document},
        {"length": None, "kind": 0x004E4942, "data": None},
    ]
    tree = {"magic": "glTF", "version": 2, "length": None, "chunks": chunks}
    tree, told = changed(tree, rng, words=WORDS)
    body = b""
    listed = _get(tree, "chunks")
    for chunk in listed if isinstance(listed, list) else [listed]:
        inside = blob
        if isinstance(chunk, dict) and "json" in chunk:
            inside = as_json(chunk["json"])
            inside += b" " * (-len(inside) % 4)
        length = _get(chunk, "length")
        body += _packed(len(inside) if length is None else length, "I") + _packed(_get(chunk, "kind"), "I") + inside
    length = _get(tree, "length")
    head = as_cell(_get(tree, "magic"))[:4].ljust(4) + _packed(_get(tree, "version"), "I")
    return {"mesh.glb": head + _packed(12 + len(body) if length is None else length, "I") + body}, told


def _damaged_numbers(blob, rng):
    """Return a buffer, in some cases one that is cut short."""
    return blob if rng.integers(5) else blob[: int(rng.integers(len(blob)))]


KINDS = (ply, ply, obj, stl, usd, fbx, gltf_text, glb)


def write(folder, rng):
    """Write a mesh and the files that it is made of."""
    (folder / "outside").mkdir()
    (folder / "outside/kept.txt").write_text("somebody's")
    inside = folder / "in"
    inside.mkdir()
    (inside / "walls.png").write_bytes(b"a picture")
    files, told = pick(rng, KINDS)(rng)
    for name, data in files.items():
        (inside / name).write_bytes(data)
    buffers = len(files.get("room.bin", b"")) % 20  # a buffer that is cut short is no whole number of vertices
    note(folder, [*told, *(["a short buffer"] if buffers else [])])
    (folder / TASK).write_text(json.dumps(next(iter(files))))


def read(folder):
    """Look at the mesh as it is done before it is read; read it where it is a PLY."""
    path = folder / "in" / json.loads((folder / TASK).read_text())
    check_mesh(path)
    beside = files_beside(path)
    assert all(file.is_file() for file in beside), "files beside a mesh are those that are there"
    if imported_format(path) is not None:
        return None
    mesh = read_ply(path)
    assert np.isfinite(mesh.vertices_m).all()
    assert mesh.corner_vertices.min() >= 0
    assert mesh.corner_vertices.max() < len(mesh.vertices_m)
    return mesh


def differs(folder, meaning, peer=None):
    """Say nothing: what a changed mesh means, `meshes` compares with another reader's."""
    del folder, meaning, peer
    return ""
