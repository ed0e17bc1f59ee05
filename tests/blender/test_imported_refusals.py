# SPDX-License-Identifier: GPL-3.0-or-later
"""What is wrong with a mesh file is one line that names it and says what to do."""

import base64
import json
import os
import struct
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import refusals
import rooms_in_formats as rooms
from cases import cases
from fuzz.limits import Meter
from importing import import_here

from noisy_world.core.errors import MissingDependencyError
from noisy_world.render import scene_dependencies
from noisy_world.render import import_program
from noisy_world.sources import blender_process
from noisy_world.sources.rendered_mesh import files_of_mesh, forget_meshes, read_mesh

BUSY = "while :; do :; done"
REAL = blender_process._asked


@pytest.fixture(autouse=True)
def _imports_here(monkeypatch, capfd):
    import_here(monkeypatch, capfd)


refusal = partial(refusals.refusal, read_mesh)


def changed(folder, **keys):
    """The room's GLB with other keys in its document."""
    document, blob = rooms.gltf(rooms.room_attributes(), rooms.MATERIAL, images=[rooms.png(rooms.PICTURE)], **keys)
    path = folder / "changed.glb"
    path.write_bytes(rooms.glb(document, blob))
    return path


def test_gltf_that_is_packed_in_a_way_that_blender_cannot_read(tmp_path):
    draco = ["KHR_draco_mesh_compression"]
    said = refusal(changed(tmp_path, extensionsUsed=draco, extensionsRequired=draco))
    assert said.startswith("its meshes are compressed with Draco, which this Blender cannot read; ")
    assert "without compression" in said
    meshopt = ["EXT_meshopt_compression"]
    assert "meshopt" in refusal(changed(tmp_path, extensionsUsed=meshopt, extensionsRequired=meshopt))
    basis = ["KHR_texture_basisu"]
    said = refusal(changed(tmp_path, extensionsUsed=basis, extensionsRequired=basis))
    assert (
        said == "its textures are KTX2 (Basis Universal), which Blender cannot read; save it with PNG or JPEG textures"
    )
    unknown = ["EXT_no_such_thing"]
    assert "EXT_no_such_thing" in refusal(changed(tmp_path, extensionsUsed=unknown, extensionsRequired=unknown))


def test_gltf_that_is_damaged(tmp_path):
    whole = rooms.write_glb(tmp_path).read_bytes()
    path = tmp_path / "room.glb"
    path.write_bytes(whole[:-40])
    assert refusal(path).startswith(f"cut short: {len(whole) - 40} bytes, of which its header says {len(whole)}; ")
    path.write_bytes(whole[:7])
    assert refusal(path).startswith("cut short: it has no header")
    path.write_bytes(b"")
    assert refusal(path).startswith("its JSON cannot be read")
    path.write_bytes(whole.replace(b'{"asset"', b'{"asset}', 1))
    assert refusal(path).startswith("its JSON cannot be read")
    path.write_bytes(struct.pack("<4sII", b"glTF", 1, len(whole)) + whole[12:])
    assert refusal(path) == "GLB of version 1; export it as glTF 2.0"
    assert refusal(changed(tmp_path, asset={"version": "1.0"})) == "glTF of version 1.0; export it as glTF 2.0"
    assert refusal(changed(tmp_path, nodes=[{"name": "nothing"}])).startswith("holds no faces")
    assert refusal(changed(tmp_path, bufferViews=3 * [{"buffer": 3, "byteLength": 4}])) == (
        "bufferView 0: buffer 3 is not there; the file is damaged: export it again"
    )
    document, blob = rooms.gltf(rooms.room_attributes())
    document["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 1  # which are texture coordinates
    path.write_bytes(rooms.glb(document, blob))
    assert refusal(path).startswith("Blender's importer fails on it: ")


def test_values_that_are_not_finite(tmp_path):
    for value in (np.nan, -np.inf):
        attributes = rooms.room_attributes()
        attributes["POSITION"][7, 1] = value
        for path in documents(tmp_path, *rooms.gltf(attributes)):
            assert refusal(path) == DAMAGED
    attributes = rooms.room_attributes()
    attributes["TEXCOORD_0"][7, 1] = np.inf
    for path in documents(tmp_path, *rooms.gltf(attributes)):
        assert refusal(path) == DAMAGED.replace("coordinate", "texture coordinate")
    document, blob = rooms.gltf(rooms.room_attributes())
    blob += struct.pack("<H2x3f", 3, np.inf, 0, 0)
    document["bufferViews"] += [{"buffer": 0, "byteOffset": len(blob) - back, "byteLength": 12} for back in (16, 12)]
    document["buffers"][0]["byteLength"] = len(blob)
    document["accessors"][0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": 2, "componentType": 5123},
        "values": {"bufferView": 3},
    }
    for path in documents(tmp_path, document, blob):
        assert refusal(path) == DAMAGED
    room = rooms.write_stl(tmp_path)
    data = bytearray(room.read_bytes())
    struct.pack_into("<f", data, 84 + 50 + 12, np.inf)
    room.write_bytes(b"solid of facets".ljust(80) + data[80:])  # as some programs begin binary files
    assert refusal(room) == DAMAGED
    room = rooms.write_obj(tmp_path)
    room.write_text(room.read_text().replace("v -2.0 ", "v 1e999 ", 1))
    assert refusal(room) == "line 4: '1e999' is too large for float32; the file is damaged: export it again"


def test_a_texture_transformed_beyond_measure(tmp_path):
    room = rooms.write_obj(tmp_path)
    for option in ("-s inf 1 1", "-o nan 0 0"):
        (tmp_path / "room.mtl").write_text(f"newmtl walls\nmap_Kd {option} walls.png\n")
        forget_meshes()
        assert refusal(room) == "a texture's place is NaN or infinite; the file is damaged: export it again"


DAMAGED = "a coordinate is NaN or infinite; the file is damaged: export it again"


def documents(folder, document, blob):
    """Write a document with its buffer behind it, and within it."""
    for accessor in document["accessors"]:  # NaN is no JSON
        accessor.pop("min", None), accessor.pop("max", None)
    (folder / "a.glb").write_bytes(rooms.glb(document, blob))
    uri = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    buffers = [{"uri": uri, "byteLength": len(blob)}]
    (folder / "a.gltf").write_text(json.dumps({**document, "buffers": buffers}))
    return folder / "a.glb", folder / "a.gltf"


@cases("word", ["nan", "-inf", "1e999", "1e39"])
def test_usd_that_is_not_finite(tmp_path, word):
    room = rooms.write_usda(tmp_path)
    room.write_text(room.read_text().replace("points = [(-2.0,", f"points = [({word},"))
    assert refusal(room) == f"line 8: {DAMAGED}"
    scene_dependencies.add_library_folders()
    from pxr import Sdf

    assert Sdf.Layer.FindOrOpen(str(room)).Export(str(tmp_path / "binary.usdc"))
    assert refusal(tmp_path / "binary.usdc") == DAMAGED


FBX = """; FBX 7.4.0 project file
FBXHeaderExtension: {
  FBXVersion: 7400
}
Objects: {
  Geometry: 1, "Geometry::m", "Mesh" {
    Vertices: *9 {
      a: 0,0,0,1,0,0,
        0,WORD,0
    }
    PolygonVertexIndex: *3 {
      a: 0,1,-3
    }
    GeometryVersion: 124
  }
  Model: 2, "Model::m", "Mesh" {
    Version: 232
  }
}
Connections: {
  C: "OO",2,0
  C: "OO",1,2
}
"""


def test_fbx_that_is_not_finite(tmp_path):
    room = tmp_path / "a.fbx"
    for word in ("nan", "inf", "1e999", "1e39"):
        room.write_text(FBX.replace("WORD", word))
        assert refusal(room) == f"line 9: {DAMAGED}"
    room.write_text(FBX.replace("WORD", "abc"))
    assert refusal(room) == "line 9: 'abc' is not a number; the file is damaged: export it again"
    room.write_text(FBX.replace("WORD", "1"))
    assert len(read_mesh(room).face_starts) == 1


@cases("write", [rooms.write_obj, rooms.write_usda, rooms.write_gltf, rooms.write_ply])
def test_pictures_outside_the_meshs_folder(tmp_path, write):
    folder = tmp_path / write.__name__
    room = write(folder)
    whole = {path: path.read_text() for path in (room, folder / "room.mtl") if path.is_file()}
    (folder / "walls.png").rename(tmp_path / "walls.png")
    for name in ("../walls.png", str(tmp_path / "walls.png")):
        for path, text in whole.items():
            path.write_text(text.replace("walls.png", name))
        forget_meshes()
        said = refusal(room)
        assert "leads out of the mesh's folder; put it beside the mesh" in said or "; put it there, beside" in said
    if write is rooms.write_gltf:  # whose names are relative, so one that leads away is nobody's accident
        return
    (tmp_path / "walls.png").rename(folder / "walls.png")
    (tmp_path / "walls.png").write_bytes(b"another picture")
    forget_meshes()
    mesh = read_mesh(room)
    np.testing.assert_array_equal(mesh.texture.pictures[0], rooms.PICTURE)
    assert any("walls.png beside the mesh was taken" in note for note in mesh.notes)
    assert folder / "walls.png" in files_of_mesh(room)
    assert tmp_path / "walls.png" not in files_of_mesh(room)


@cases(("limit", "most"), [("MOST_COPIES", 2), ("MOST_CORNERS", 107)])
def test_copies_beyond_measure(tmp_path, monkeypatch, limit, most):
    room = changed(tmp_path, scenes=[{"nodes": [0, 1, 2]}], nodes=[{"mesh": 0}] * 3)  # of 36 corners each
    forget_meshes()
    assert len(read_mesh(room).corner_vertices) == 108
    with monkeypatch.context() as patched:
        patched.setattr(import_program, limit, most)
        forget_meshes()
        assert refusal(room).startswith("holds more than ")


def test_usd_layers_outside_its_folder(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    rooms.write_usda(tmp_path)
    for kind in ("subLayers = [@{}@]", "references = @{}@", "payload = @{}@"):
        for name in ("../room.usda", str(tmp_path / "room.usda"), f"file:{tmp_path}/room.usda", "a.usda"):
            text = kind.format(name)
            root = f"( {text} )" if "sub" in kind else f'def "W" ( prepend {text} ) {{}}'
            (inner / "whole.usda").write_text(f"#usda 1.0\n{root}\n")
            (inner / "a.usda").write_text("#usda 1.0\n( subLayers = [@../room.usda@] )\n")
            said = refusal(inner / "whole.usda")
            shown = "../room.usda" if name == "a.usda" else name
            assert said == f"its layer {shown!r} leads out of the mesh's folder; put it beside the mesh, and name it so"
    os.mkfifo(inner / "pipe.usda")
    (inner / "whole.usda").write_text("#usda 1.0\n( subLayers = [@./pipe.usda@] )\n")
    assert refusal(inner / "whole.usda").startswith("its layer 'pipe.usda': it is a pipe, not a file; ")
    (inner / "link.usda").symlink_to(tmp_path / "room.usda")
    (inner / "walls.png").symlink_to(tmp_path / "walls.png")
    (inner / "whole.usda").write_text("#usda 1.0\n( subLayers = [@./link.usda@] )\n")
    forget_meshes()
    (note,) = read_mesh(inner / "whole.usda").notes
    assert note.startswith("its file 'link.usda' is a link out of the mesh's folder, to ")
    assert {path.name for path in files_of_mesh(inner / "whole.usda")} >= {"link.usda"}


@cases("write", [rooms.write_obj, rooms.write_usda, rooms.write_gltf])
def test_pictures_of_too_many_pixels_are_not_decoded(tmp_path, write):
    room = write(tmp_path)
    (tmp_path / "walls.png").write_bytes(rooms.black_png(32_000, 32_000))
    meter = Meter()  # of a gigabyte: the pixels alone take 3
    assert "walls.png" in (said := refusal(room))
    assert "says that it is 32000 x 32000 pixels; at most 268435456 pixels (16384 x 16384) are read" in said
    assert meter.told() == ""


def test_kinds_of_pictures_that_blender_alone_reads(tmp_path):
    room = rooms.write_obj(tmp_path)
    (tmp_path / "room.mtl").write_text("newmtl walls\nmap_Kd walls.tga\n")
    header = struct.pack("<BBBHHBHHHHBB", 0, 0, 2, 0, 0, 0, 0, 0, 24, 16, 24, 32)
    (tmp_path / "walls.tga").write_bytes(header + rooms.PICTURE[..., ::-1].tobytes())
    np.testing.assert_array_equal(read_mesh(room).texture.pictures[0], rooms.PICTURE)
    large = struct.pack("<BBBHHBHHHHBB", 0, 0, 10, 0, 0, 0, 0, 0, 32_000, 32_000, 24, 32)
    (tmp_path / "walls.tga").write_bytes(large + b"\xff\0\0\0" * 100)
    assert "its texture 'walls.tga' says that it is 32000 x 32000 pixels; " in refusal(room)


def test_files_beside_it_that_are_missing_or_damaged(tmp_path):
    room = rooms.write_gltf(tmp_path)
    picture = tmp_path / "walls.png"
    data = picture.read_bytes()
    picture.write_bytes(data[: len(data) // 2])
    assert refusal(room).startswith("its texture 'walls.png' cut short")
    picture.unlink()
    assert "walls.png" in refusal(room)
    assert "missing" in refusal(room)
    (tmp_path / "the room.bin").write_bytes(b"short")
    assert refusal(room).startswith("its buffer 'the room.bin' is cut short: 5 of ")
    (tmp_path / "the room.bin").unlink()
    assert refusal(room) == f"its buffer 'the room.bin' is missing in {tmp_path}; put it there"
    room = rooms.write_obj(tmp_path)
    (tmp_path / "walls.png").unlink()
    assert "walls.png" in refusal(room)
    room = rooms.write_usda(tmp_path)
    room.write_bytes(room.read_bytes().replace(b"subdivision", b"sub\xa5ivision"))
    assert refusal(room) == "USD's library cannot open it; the file is damaged: export it again"
    (tmp_path / "whole.usda").write_text("#usda 1.0\n( subLayers = [@./elsewhere.usda@] )\n")
    assert refusal(tmp_path / "whole.usda").startswith("refers to ")


@cases("suffix", ["obj", "stl", "fbx", "usda", "usdc", "gltf"])
def test_files_without_a_mesh(tmp_path, suffix):
    beginnings = {"fbx": b"Kaydara FBX Binary  \0\x1a\0", "usda": b"#usda 1.0\n", "usdc": b"PXR-USDC"}
    path = tmp_path / f"mesh.{suffix}"
    for data in (b"", beginnings.get(suffix, b"v 0 0 0\n"), beginnings.get(suffix, b"") + b"\0" * 200):
        path.write_bytes(data)
        assert refusal(path)


def test_an_import_in_a_process_of_its_own_that_is_killed(tmp_path, monkeypatch):
    monkeypatch.setattr(blender_process, "_asked", REAL)
    room = rooms.write_glb(tmp_path)
    assert len(read_mesh(room).face_starts) == 12
    forget_meshes()
    monkeypatch.setattr(blender_process, "_command", lambda *_: ["/bin/sh", "-c", "kill -SEGV $$"])
    assert refusal(room).startswith("Blender's importer of glTF was ended by SIGSEGV; ")
    monkeypatch.setattr(
        blender_process, "_command", lambda _, limit_s: ["/bin/sh", "-c", f"ulimit -S -t {limit_s}; {BUSY}"]
    )
    monkeypatch.setattr(blender_process, "LIMIT_S", 1)
    forget_meshes()
    assert refusal(room).startswith("Blender's importer of glTF takes more than 1 s of a processor for it; ")


def test_a_python_without_blender(tmp_path, monkeypatch):
    monkeypatch.setattr(blender_process, "_asked", REAL)
    monkeypatch.setitem(os.sys.modules, "bpy", None)
    with pytest.raises(MissingDependencyError, match=r"^a mesh that Blender's importers read: bpy: missing"):
        read_mesh(rooms.write_glb(tmp_path))


def test_a_blender_without_an_importer_or_without_pixars_library(tmp_path, monkeypatch):
    room = rooms.write_usda(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(import_program.importlib.util, "find_spec", lambda _name: None)
        (note,) = read_mesh(room).notes
        assert note.startswith("this Blender lacks the module pxr: ")
        assert [file.name for file in files_of_mesh(room)] == ["walls.png"]
    without = replace(import_program._FORMATS["USD"], operator="wm.no_such_import")
    monkeypatch.setitem(import_program._FORMATS, "USD", without)
    forget_meshes()
    said = "this Blender is built without an importer of USD; export the mesh as PLY or glTF"
    assert refusal(room) == said
