# SPDX-License-Identifier: GPL-3.0-or-later
"""One room in every format is the same room: files written by hand, and by Blender's own exporters."""

import bpy
import numpy as np
import pytest

pytest.importorskip("embreex", reason="embreex is not installed")

import rooms_in_formats as rooms
from analytic import look_at
from cases import cases
from importing import import_here
from ray_tools import cast

from noisy_world.images.pixels import rgb_bytes
from noisy_world.core.geometry import Intrinsics
from noisy_world.sources.rendered_mesh import files_of_mesh, read_mesh

CAMERA = Intrinsics(80, 60, 40.0, 40.0, 39.5, 29.5)
EYES = [look_at([0.3, 0.2, 1.1], [2.0, 1.0, 0.7]), look_at([0.1, -0.4, 1.5], [-2.0, -0.2, 0.2])]
HAND = {
    "glb": rooms.write_glb,
    "gltf": rooms.write_gltf,
    "gltf with its buffer inside": lambda folder: rooms.write_gltf(folder, embedded=True),
    "obj": rooms.write_obj,
    "usda": rooms.write_usda,
    "usda, Y up, in centimetres": lambda folder: rooms.write_usda(folder, rooms.TO_Y_UP, "Y", 0.01),
}


@pytest.fixture(autouse=True)
def _imports_here(monkeypatch, capfd):
    import_here(monkeypatch, capfd)


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What is seen of the PLY file: colour and depth from each pose."""
    mesh = read_mesh(rooms.write_ply(tmp_path_factory.mktemp("ply")))
    return [cast(mesh, eye, CAMERA) for eye in EYES]


def compare(mesh, seen, *, colour=True):
    for eye, there in zip(EYES, seen, strict=True):
        here = cast(mesh, eye, CAMERA)
        assert np.allclose(here.depth_m, there.depth_m, rtol=0, atol=1e-6)
        if colour:
            flat = np.isin(rgb_bytes(there.rgb).reshape(-1, 3), rooms.TILES.reshape(-1, 3)).all(axis=1)
            assert flat.mean() > 0.75
            difference = np.abs(rgb_bytes(here.rgb).astype(int) - rgb_bytes(there.rgb)).reshape(-1, 3)
            assert difference[flat].max() <= 1


@cases("name", list(HAND))
def test_a_room_written_by_hand(tmp_path, seen, name):
    mesh = read_mesh(HAND[name](tmp_path / name))
    assert mesh.notes == ()
    compare(mesh, seen)


def test_a_room_of_triangles_alone(tmp_path, seen):
    mesh = read_mesh(rooms.write_stl(tmp_path))
    assert mesh.notes == ("no colours: shown in neutral grey",)
    compare(mesh, seen, colour=False)


def test_what_stands_in_the_files_frame_fits_poses_of_that_frame(tmp_path, seen):
    # Of a file without a declared axis nothing is turned; y says that Y is up in it.
    compare(read_mesh(rooms.write_obj(tmp_path / "stored")), seen)
    compare(read_mesh(rooms.write_obj(tmp_path / "turned", rooms.TO_Y_UP), "y"), seen)
    # A glTF file declares Y up; z leaves it as it is stored.
    stored = read_mesh(rooms.write_glb(tmp_path / "glb"), "z")
    corners, _ = rooms.walls()
    expected = corners.reshape(-1, 3) @ rooms.TO_Y_UP.T
    for side in (np.min, np.max):
        assert np.allclose(side(stored.vertices_m, axis=0), side(expected, axis=0), rtol=0, atol=1e-6)


def blender_room(folder):
    """The room in the file that is open: a wall each of three objects under parents, one of them mirrored."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    image = bpy.data.images.load(str(rooms.write_picture(folder)))
    material = bpy.data.materials.new("walls")
    picture = material.node_tree.nodes.new("ShaderNodeTexImage")
    picture.image = image
    material.node_tree.links.new(picture.outputs[0], material.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
    corners, uv = rooms.walls()
    parent = bpy.data.objects.new("parent", None)
    parent.scale, parent.location = (-2.0, 0.5, 1.0), (1.0, 0.25, 0.5)  # mirrored
    scene.collection.objects.link(parent)
    for number in range(3):
        own = corners[2 * number : 2 * number + 2].reshape(-1, 3)
        local = (own - parent.location) / parent.scale
        data = bpy.data.meshes.new(f"walls{number}")
        data.from_pydata(local.tolist(), [], [[0, 1, 2, 3], [4, 5, 6, 7]])
        layer = data.uv_layers.new(name="UVMap")
        layer.uv.foreach_set("vector", uv[2 * number : 2 * number + 2].ravel().astype(np.float32))
        data.materials.append(material)
        item = bpy.data.objects.new(f"walls{number}", data)
        item.parent = parent
        scene.collection.objects.link(item)
    bpy.context.view_layer.update()


def test_rooms_that_blender_exports(tmp_path, seen):
    blender_room(tmp_path)
    bpy.ops.export_scene.fbx(filepath=str(tmp_path / "room.fbx"))
    bpy.ops.wm.usd_export(filepath=str(tmp_path / "room.usdc"))
    bpy.ops.wm.usd_export(filepath=str(tmp_path / "room.usdz"))
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "room.glb"))
    for name in ("room.fbx", "room.usdc", "room.usdz", "room.glb"):
        compare(read_mesh(tmp_path / name), seen)


def test_all_files_of_a_mesh_are_told(tmp_path):
    def names(path):
        return sorted(file.name for file in files_of_mesh(path))

    assert names(rooms.write_glb(tmp_path)) == []
    assert names(rooms.write_gltf(tmp_path)) == ["the room.bin", "walls.png"]
    assert names(rooms.write_obj(tmp_path)) == ["room.mtl", "walls.png"]
    assert names(rooms.write_stl(tmp_path)) == []
    room = rooms.write_usda(tmp_path)
    assert names(room) == ["walls.png"]
    (tmp_path / "whole.usda").write_text('#usda 1.0\n( upAxis = "Z"\n subLayers = [@./room.usda@] )\n')
    assert names(tmp_path / "whole.usda") == ["room.usda", "walls.png"]
    assert len(read_mesh(tmp_path / "whole.usda").face_starts) == 6
