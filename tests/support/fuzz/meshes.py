# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes that are changed, by area.

`meshes`: PLY, whose header's words or bytes are changed; it is held against plyfile, where this is installed.
`mesh_headers`: other formats, changed by structure and looked at as it is done before Blender imports them.
`imported_meshes`: these, imported in this process. A damaged file may end it, which `sources.imported_meshes` would say
in a line; but each takes some milliseconds here, and more than a second in a process of its own.
"""

import functools
import itertools
import json
import logging
import struct
from types import SimpleNamespace
from unittest import mock

import cv2
import numpy as np
from fuzz.mutation import NUMBERS, mutate_bytes, mutate_text, pick
from fuzz.peers import plyfile_data
from fuzz.structure import PATHS, as_cell, as_json, as_table, beside, changed, kept, note, raws, whole
from ply_files import (
    BYTES, CODES, ENCODINGS, INDICES, MIXED, NORMAL, POINTS, QUADS, RGB, TRIANGLES, XYZ, ply, vertex
)  # fmt: skip
from rooms_in_formats import gltf, room_attributes, walls, write_picture, write_usda

from noisy_world.scenes.mesh_files import check_mesh, referenced_files, imported_format
from noisy_world.scenes.ply import read_ply
from noisy_world.sources import blender_process
from noisy_world.sources.rendered_mesh import forget_meshes, read_mesh

TASK = "task.json"
PLY_WORDS = (
    *NUMBERS, *CODES, *ENCODINGS, "list", "property", "element", "vertex", "face", "edge", "end_header", "format",
    "comment", "obj_info", "ply", "x", "y", "z", "nx", "red", "r", "alpha", "s", "t", "texture_u", "vertex_index",
    "vertex_indices", "texcoord", "texnumber", "multi_texture_face", "\n", "\r", "\r\n", " ", "1.0", "uint64", "quad",
    "comment TextureFile a.png\n", "comment TextureFile ../a.png\n", "property list uchar float texcoord\n",
    "TextureFile a.png", "property int texnumber\n", "property float s\n", "property uchar red\n", "gone.png",
    "C:\\a.png",
)  # fmt: skip
WORDS = (
    "x", "red", "f", "v", "vt",
    "mtllib", "usemtl", "POSITION", "VEC3", "data:,x", "http://x/y", "room.bin", "room.mtl", "walls.png", "-mm",
    "1/1/1",
)  # fmt: skip
TEXT_RAWS = raws(b"nan", b"inf", b"1e999", b"\xff\xfe", b"\x00", b"1e", b"9" * 5000, b"\\\n", b"#", b"\r")
RANGES = {"H": (0, 2**16 - 1), "I": (0, 2**32 - 1)}
POSITIONS = (XYZ, tuple(f"double {axis}" for axis in "xyz"), ("double x", "float y", "int16 z"))
COLOURS = ((), RGB, ("uchar r", "uchar g", "uchar b", "uchar alpha"), ("float red", "float green", "float blue"))
LISTS = (INDICES, ("list int uint vertex_index",), ("list uint8 int16 vertex_indices", "uchar flags"))
COLOUR_NAMES = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))


# --- PLY ---


def _file(rng):
    """Return the bytes of a sound file of a dialect."""
    encoding = pick(rng, ENCODINGS)
    places, colours, lists = pick(rng, POSITIONS), pick(rng, COLOURS), pick(rng, LISTS)
    normals = pick(rng, ((), NORMAL))
    rows = []
    for point, colour in zip(POINTS, BYTES, strict=True):
        position = [int(value) if name.startswith("int") else value for name, value in zip(places, point, strict=True)]
        shade = [value / 255 for value in colour] if colours[:1] == ("float red",) else [*colour, 255][: len(colours)]
        rows.append((*position, *((0.0, 0.0, 1.0) if normals else ()), *(shade if colours else ())))
    faces = [(indices, 7)[: len(lists)] for indices in pick(rng, (TRIANGLES, QUADS, MIXED))]
    elements = [("vertex", (*places, *normals, *colours), rows), ("face", lists, faces)]
    if rng.integers(4) == 0:
        elements.insert(int(rng.integers(3)), ("edge", ("int vertex1", "int vertex2"), [(0, 1), (1, 2)]))
    return ply(encoding, *elements, end=pick(rng, ("\n", "\n", "\r\n")), extra=pick(rng, ((), ("comment made here",))))


@functools.cache
def _textured():
    """Return sound files with textures, flags, lists and colours of faces."""
    files = []
    for encoding, faces in itertools.product(ENCODINGS, (TRIANGLES, QUADS, MIXED)):
        uv = [tuple(k / 8 for k in range(2 * len(f))) for f in faces]
        colours = [(k * 40, 255 - k, 7) for k in range(len(faces))]
        bare = vertex(XYZ, list(POINTS))
        files += [
            ply(encoding, bare, ("face", (*INDICES, *RGB), [(f, *c) for f, c in zip(faces, colours, strict=True)])),
            ply(
                encoding, vertex((*XYZ, *NORMAL, *RGB), [(*p, 0.0, 0.0, 1.0, 9, 8, 7) for p in POINTS]),
                ("face", (*INDICES, "list uchar float texcoord", "int texnumber"),
                 [(f, t, k % 3 - 1) for k, (f, t) in enumerate(zip(faces, uv, strict=True))]),
                extra=("comment TextureFile a.png", "comment TextureFile b.png"),
            ),
            ply(
                encoding, vertex((*XYZ, "float s", "float t"), [(*p, 0.25, 0.75) for p in POINTS]),
                ("face", ("uchar flags", *INDICES), [(1, f) for f in faces]), extra=("comment TextureFile a.png",),
            ),
            ply(
                encoding, ("edge", ("int vertex1", "int vertex2"), [(0, 1), (1, 2)]),
                vertex((*XYZ, "float red", "float green", "float blue", "list uchar short tags"),
                       [(*p, 0.25, 0.5, 1.0, (k,) * (k % 2)) for k, p in enumerate(POINTS)]),
                ("face", ("float red", "float green", "float blue", "list uchar int vertex_index"),
                 [(0.5, 0.25, 0.0, f) for f in faces]),
            ),
        ]  # fmt: skip
    return files


def write(folder, rng):
    """Write mesh.ply: its header changed word by word, its body, or any of its bytes."""
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(folder / name), np.arange(12, dtype=np.uint8).reshape(2, 2, 3))
    data = _file(rng) if rng.integers(2) else pick(rng, _textured())
    header, mark, body = data.partition(b"end_header")
    match int(rng.integers(4)):
        case 0:
            data = mutate_bytes(data, rng)
        case 1:
            data = header + mark + mutate_bytes(body, rng)
        case _:
            text = mutate_text((header + mark).decode(), rng, PLY_WORDS)
            data = text.encode("utf-8", "surrogatepass") + (body if rng.integers(4) else mutate_bytes(body, rng))
    (folder / "mesh.ply").write_bytes(data)


def read(folder):
    """Read mesh.ply, and see that it is whole."""
    mesh = read_ply(folder / "mesh.ply")
    _check(mesh)
    return mesh


def _check(mesh):
    """A mesh is whole: every number is finite and in range, every array as long as it should be."""
    corners, faces = len(mesh.corner_vertices), len(mesh.face_starts)
    assert np.isfinite(mesh.vertices_m).all()
    assert 0 <= mesh.corner_vertices.min() <= mesh.corner_vertices.max() < len(mesh.vertices_m)
    assert mesh.face_sizes.min() >= 3
    for rgb, count in ((mesh.rgb, len(mesh.vertices_m)), (mesh.corner_rgb, corners)):
        assert rgb is None or (rgb.shape == (count, 3) and rgb.min() >= 0 and rgb.max() <= 1)
    if mesh.texture is not None:
        assert mesh.texture.corner_uv.shape == (corners, 2)
        assert np.isfinite(mesh.texture.corner_uv).all()
        assert mesh.texture.face_pictures.shape == (faces,)
        assert -1 <= mesh.texture.face_pictures.min() <= mesh.texture.face_pictures.max() < len(mesh.texture.pictures)
    assert all("\n" not in note for note in mesh.notes)


def _without_repeats(indices):
    """The positions of a face's corners without those whose next one is the same."""
    return [k for k in range(len(indices)) if indices[k] != indices[(k + 1) % len(indices)]]


def _compare(mesh, data):
    """The mesh holds what plyfile reads from the file: points, faces, and colours and coordinates in their places."""
    vertex, face = data["vertex"], data["face"]
    points = np.stack([vertex[name].astype(float) for name in "xyz"], axis=1)
    np.testing.assert_allclose(mesh.vertices_m, points, rtol=1e-6 if data.text else 0)  # it rounds text to float32
    names = {item.name for item in face.properties}
    lists = [list(map(int, f)) for f in face["vertex_indices" if "vertex_indices" in names else "vertex_index"]]
    kept = [(k, _without_repeats(f)) for k, f in enumerate(lists) if len(_without_repeats(f)) >= 3]
    expected = [[lists[k][c] for c in places] for k, places in kept]
    assert mesh.corner_vertices.tolist() == [corner for corners in expected for corner in corners]
    assert mesh.face_sizes.tolist() == list(map(len, expected))
    scale = next((note for note in mesh.notes if "read as 0..255" in note), None)
    for rgb, element, rows in (
        (mesh.rgb, vertex, slice(None)),
        (mesh.corner_rgb, face, [k for k, places in kept for _ in places]),
    ):
        if rgb is not None:
            here = {item.name for item in element.properties}
            columns = [element[name] for name in next(names for names in COLOUR_NAMES if here.issuperset(names))]
            kind = columns[0].dtype
            full = 255 if scale else {"u1": 255, "u2": 65535}.get(kind.str[1:], 1)
            stored = np.stack([column.astype(np.float64) for column in columns], axis=1)[rows]
            np.testing.assert_allclose(rgb, np.clip(stored / full, 0, 1), atol=1e-6)
    if mesh.texture is not None and "texcoord" in names:
        shown = np.repeat(mesh.texture.face_pictures >= 0, mesh.face_sizes)
        stored = [face["texcoord"][k] for k, _ in kept]
        uv = [
            t[2 * c : 2 * c + 2] if len(t) else (0, 0)
            for t, (_, places) in zip(stored, kept, strict=True)
            for c in places
        ]
        np.testing.assert_allclose(mesh.texture.corner_uv[shown], np.array(uv, np.float64)[shown], rtol=1e-6)


def differs(folder, mesh):
    """Return how the mesh differs from plyfile's; "" where it does not, or this is not here or refuses the file."""
    data = plyfile_data(folder / "mesh.ply")
    if data is None or "face" not in data:
        return ""
    try:
        _compare(mesh, data)
    except AssertionError as error:
        return " ".join(str(error).split())[:300]
    return ""


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


def _packed(value, kind, order="<"):
    """Return a value as a number of a kind of struct's, whatever it is."""
    if kind in "fd":
        try:
            number = float(value)
            return struct.pack(order + kind, number)
        except (TypeError, ValueError, OverflowError):
            return struct.pack(order + kind, float("nan"))
    return struct.pack(order + kind, whole(value, *RANGES[kind]))


HEADER_KINDS = (obj, stl, usd, fbx, gltf_text, glb)


def write_header(folder, rng):
    """Write a mesh and the files that it is made of."""
    beside(folder)
    inside = folder / "in"
    inside.mkdir()
    (inside / "walls.png").write_bytes(b"a picture")
    files, told = _written(folder, rng, HEADER_KINDS)
    buffers = len(files.get("room.bin", b"")) % 20  # a buffer that is cut short is no whole number of vertices
    note(folder, [*told, *(["a short buffer"] if buffers else [])])


def _written(folder, rng, kinds):
    files, told = pick(rng, kinds)(rng)
    for name, data in files.items():
        (folder / "in" / name).write_bytes(data)
    (folder / TASK).write_text(json.dumps(next(iter(files))))
    return files, told


def read_header(folder):
    """Look at the mesh as it is done before it is imported."""
    path = folder / "in" / json.loads((folder / TASK).read_text())
    check_mesh(path)
    assert all(file.is_file() for file in referenced_files(path)), "files beside a mesh are those that are there"
    assert imported_format(path) is not None


# --- imported ---

NODES = {
    "Vertices": "0,0,0,1,0,0,0,1,0,1,1,0", "PolygonVertexIndex": "0,1,-3,1,3,-3", "GeometryVersion": "124",
    "Materials": "0,0",
}  # fmt: skip


@functools.cache
def _room():
    return write_usda(kept("usda")).read_text()


def whole_usd(rng):
    """Return mesh.usda: the room with its picture, whose words are changed."""
    rows = [line.split(" ") for line in _room().splitlines()]
    tree, told = changed(rows, rng, raws=TEXT_RAWS, words=(*WORDS, *NUMBERS, *(f"@{path}@" for path in PATHS)))
    return {"mesh.usda": as_table(tree)}, told


def fbx_text(rng):
    """Return mesh.fbx, as text: arrays whose numbers and counts are changed."""
    tree = {name: [values.split(",")] for name, values in NODES.items()}
    tree, told = changed(tree, rng, raws=TEXT_RAWS, words=(*WORDS, *NUMBERS))
    arrays = []
    for name in NODES:
        cells = as_table(tree.get(name, []) if isinstance(tree, dict) else tree).strip().replace(b" ", b",")
        count = pick(rng, (cells.count(b",") + 1,) * 6 + (0, 2**31, 10**30))
        arrays.append(b"  %s: *%d {\n   a: %s\n  }\n" % (name.encode(), count, cells))
    head = (
        b'; FBX 7.4.0\nFBXHeaderExtension: {\n FBXVersion: 7400\n}\nObjects: {\n Geometry: 1, "Geometry::m", "Mesh" {\n'
    )
    tail = b' }\n Model: 2, "Model::m", "Mesh" {\n }\n}\nConnections: {\n C: "OO",2,0\n C: "OO",1,2\n}\n'
    return {"mesh.fbx": head + b"".join(arrays) + tail}, told


def write_imported(folder, rng):
    """Write a mesh and the files that it is made of."""
    write_picture(folder / "in")
    _, told = _written(folder, rng, (obj, stl, whole_usd, fbx_text, gltf_text, glb))
    note(folder, [*told, "as it may be"])  # Blender knows more than the headers say, so none has to be accepted


def read_imported(folder):
    """Import the mesh."""
    forget_meshes()
    logging.getLogger("glTFImporter").setLevel(logging.CRITICAL)
    with mock.patch.object(blender_process, "_asked", _asked_here):
        mesh = read_mesh(folder / "in" / json.loads((folder / TASK).read_text()))
    _check(mesh)
    return mesh


def _asked_here(order):
    from noisy_world.render import import_program

    return SimpleNamespace(
        returncode=import_program.main(order if isinstance(order, str) else json.dumps(order)), stdout=""
    )
