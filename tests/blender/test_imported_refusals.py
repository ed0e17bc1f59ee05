# SPDX-License-Identifier: GPL-3.0-or-later
"""What is wrong with a mesh file is one line that names it and says what to do."""

import os
import struct

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed")

import rooms_in_formats as rooms
from cases import cases
from importing import import_here

from noisy_world.core.errors import InputError, MissingDependencyError
from noisy_world.blender.importing import program, usd_layers
from noisy_world.sources import imported_meshes
from noisy_world.sources.mesh_reading import files_of_mesh, forget_meshes, read_mesh

REAL = imported_meshes._asked


@pytest.fixture(autouse=True)
def _imports_here(monkeypatch, capfd):
    import_here(monkeypatch, capfd)


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(f"{path}: ")
    return text.removeprefix(f"{path}: ")


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
    assert refusal(changed(tmp_path, bufferViews=3 * [{"buffer": 3, "byteLength": 4}])).startswith(
        "Blender's importer fails on it: "
    )


def test_values_that_are_not_finite(tmp_path):
    damaged = "a coordinate is NaN or infinite; the file is damaged: export it again"
    for value in (np.nan, -np.inf):
        attributes = rooms.room_attributes()
        attributes["POSITION"][7, 1] = value
        document, blob = rooms.gltf(attributes)
        for accessor in document["accessors"]:  # NaN is no JSON
            accessor.pop("min", None), accessor.pop("max", None)
        (tmp_path / "nan.glb").write_bytes(rooms.glb(document, blob))
        assert refusal(tmp_path / "nan.glb") == damaged
    room = rooms.write_stl(tmp_path)
    data = bytearray(room.read_bytes())
    struct.pack_into("<f", data, 84 + 50 + 12, np.inf)
    room.write_bytes(data)
    assert refusal(room) == damaged
    room = rooms.write_obj(tmp_path)
    room.write_text(room.read_text().replace("v -2.0 ", "v nan ", 1))
    assert refusal(room) == damaged


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
    (tmp_path / "room.mtl").unlink()
    assert refusal(room).startswith(f"its materials 'room.mtl' are missing in {tmp_path}; ")
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
    monkeypatch.setattr(imported_meshes, "_asked", REAL)
    room = rooms.write_glb(tmp_path)
    assert len(read_mesh(room).face_starts) == 12
    forget_meshes()
    monkeypatch.setattr(imported_meshes, "_command", lambda _: ["/bin/sh", "-c", "kill -SEGV $$"])
    expected = "Blender's importer of glTF was ended by SIGSEGV; the file is damaged: export it again"
    assert refusal(room) == expected


def test_a_python_without_blender(tmp_path, monkeypatch):
    monkeypatch.setattr(imported_meshes, "_asked", REAL)
    monkeypatch.setitem(os.sys.modules, "bpy", None)
    with pytest.raises(MissingDependencyError, match=r"^bpy: missing, and Blender's importers with it; "):
        read_mesh(rooms.write_glb(tmp_path))


def test_a_blender_without_an_importer_or_without_pixars_library(tmp_path, monkeypatch):
    room = rooms.write_usda(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(usd_layers.importlib.util, "find_spec", lambda _name: None)
        (note,) = read_mesh(room).notes
        assert note.startswith("this Blender lacks the module pxr: ")
        assert [file.name for file in files_of_mesh(room)] == ["walls.png"]
    monkeypatch.setitem(program._OPERATORS, "USD", ("wm", "no_such_import"))
    forget_meshes()
    said = "this Blender is built without an importer of USD; export the mesh as PLY or glTF"
    assert refusal(room) == said
