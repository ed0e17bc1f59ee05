# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh as a source: its first frame is held against the mesh, seen from where the depth sensor is; its textures."""

import hashlib
import os
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from refusals import refused
from analytic import box_depth, dense_box, look_at
from worlds import write_world

from noisy_world.core.geometry import Intrinsics
from noisy_world.preset.keys import read_preset
from noisy_world.core.frame_request import FrameRequest
from noisy_world.dataset.plan import make_plan
from noisy_world.sources.rendered_mesh import OpenMesh, forget_rooms_and_meshes, load_mesh

CAMERA = Intrinsics(160, 120, 90.0, 80.0, 79.5, 59.5)
LOW, HIGH = np.array([-2.0, -1.5, 0.0]), np.array([2.5, 1.5, 2.5])
COLOUR_EYE = look_at([0.4, 0.2, 1.1], [2.0, 1.0, 0.7])
DEPTH_EYE = look_at([-0.9, -0.4, 1.5], [-2.0, -0.2, 1.2])


def notes_of_the_first_frame(depth_c2w):
    """What is noted of a frame whose depth was rendered from this pose."""
    depth_m, _ = box_depth(CAMERA, depth_c2w, LOW, HIGH)
    session = SimpleNamespace(frame=lambda request: SimpleNamespace(rgb=None, depth_m=depth_m.astype(np.float32)))
    notes = []
    opened = OpenMesh(session, [dense_box(LOW, HIGH)], CAMERA, notes.append)
    opened.frame(FrameRequest(3, 0.15, rgb_c2w=COLOUR_EYE, depth_c2w=DEPTH_EYE))
    return notes


def test_a_rigs_depth_is_checked_from_where_the_depth_sensor_is():
    assert notes_of_the_first_frame(DEPTH_EYE) == []
    (note,) = notes_of_the_first_frame(COLOUR_EYE)  # as if depth came from the colour sensor's place
    assert note.startswith("frame 3: ")
    assert "went wrong" in note


def write_textured_world(folder):
    """A world whose mesh is a textured triangle; return its preset."""
    path = write_world(folder, frames=2, size=(8, 6))
    header = ["ply", "format ascii 1.0", "comment TextureFile /home/somebody/wall.png", "element vertex 3"]
    header += [f"property float {axis}" for axis in "xyz"] + ["element face 1"]
    header += ["property list uchar int vertex_indices", "property list uchar float texcoord", "end_header"]
    rows = ["0 0 0", "1 0 0", "0 1 0", "3 0 1 2 6 0 0 1 0 0 1", ""]
    (folder / "mesh.ply").write_text("\n".join([*header, *rows]))
    cv2.imwrite(str(folder / "wall.png"), np.zeros((2, 2, 3), np.uint8))
    return path


def source_of(preset):
    (scene,) = make_plan(read_preset(preset)).scenes
    return scene.source


def test_a_texture_is_an_input(tmp_path):
    preset = write_textured_world(tmp_path)
    hashes = source_of(preset).hashes()
    digest = hashlib.sha256((tmp_path / "wall.png").read_bytes()).hexdigest()
    assert hashes["mesh_textures"] == "wall.png"
    assert hashes["mesh_textures_sha256"] == hashlib.sha256(digest.encode()).hexdigest()
    cv2.imwrite(str(tmp_path / "wall.png"), np.ones((2, 2, 3), np.uint8))
    changed = source_of(preset).hashes()
    assert {name for name in hashes if hashes[name] != changed[name]} == {"mesh_textures_sha256"}


def test_without_a_texture_there_is_no_such_input(tmp_path):
    assert "mesh_textures" not in source_of(write_world(tmp_path, frames=2, size=(8, 6))).hashes()


def test_a_missing_texture_is_told_before_anything_is_made(tmp_path):
    preset = write_textured_world(tmp_path)
    (tmp_path / "wall.png").unlink()
    refused(lambda: make_plan(read_preset(preset)), names=("mesh.ply: ", "'/home/somebody/wall.png'"))


def test_a_texture_that_changes_is_read_again(tmp_path):
    path = write_textured_world(tmp_path).parent / "mesh.ply"
    forget_rooms_and_meshes()
    assert (load_mesh(path).texture.pictures[0] == 0).all()
    cv2.imwrite(str(tmp_path / "wall.png"), np.full((2, 2, 3), 9, np.uint8))
    os.utime(tmp_path / "wall.png", ns=(1, 1))
    assert (load_mesh(path).texture.pictures[0] == 9).all()
    forget_rooms_and_meshes()


def scene_with(folder, render, **keys):
    """A preset whose mesh has other keys too."""
    scene = {"name": "box", "mesh": "mesh.ply", "trajectory": "traj.txt", **keys}
    return write_world(folder, frames=2, size=(8, 6), scenes=[scene], render=render)


def test_a_mesh_that_holds_no_lights_or_an_engine_that_knows_none(tmp_path):
    def refusal(names, render=None, **keys):
        preset = scene_with(tmp_path, render or {"engine": "cycles"}, **keys)
        refused(lambda: make_plan(read_preset(preset)), names=names)

    refusal(("light: ", "a PLY file holds no lights", "leave it out"), light="scene")
    (tmp_path / "bare.gltf").write_text('{"asset": {"version": "2.0"}}')
    refusal(("render.engine: is embree", "no lights"), {"engine": "embree"}, mesh="bare.gltf", light="scene")
    refusal(("light: ", "goes with the file of a mesh"), mesh="embedded:room", light="scene")
    refusal(("up: ", "goes with the file of a mesh"), mesh="embedded:room", up="y")


def test_up_turns_a_mesh_and_is_an_input(tmp_path):
    as_stored = source_of(scene_with(tmp_path / "stored", {"engine": "cycles"}, up="z"))
    turned = source_of(scene_with(tmp_path / "turned", {"engine": "cycles"}, up="y"))
    x, y, z = as_stored.mesh().vertices_m.T
    assert np.array_equal(turned.mesh().vertices_m, np.stack([x, -z, y], axis=1))
    assert [source.hashes()["mesh_up"] for source in (as_stored, turned)] == ["z", "y"]


def path_in_room(folder, ahead_m, **keys):
    """A camera in the embedded room that goes straight ahead by so much from where a hand-held path begins."""
    mesh = {"mesh": "embedded:room", "trajectory": {"handheld": {"frames": 1}, "body": "walker"}}
    start = source_of(scene_with(folder, {"engine": "embree"}, **mesh)).trajectory().c2w[0]
    poses = np.repeat(start[None], 21, axis=0)
    level = start[:2, 2] / np.linalg.norm(start[:2, 2])
    poses[:, :2, 3] += np.outer(np.linspace(0, ahead_m, 21), level)
    np.savetxt(folder / "ahead.txt", poses.reshape(-1, 16))
    return scene_with(folder, {"engine": "embree"}, mesh="embedded:room", trajectory={"file": "ahead.txt", **keys})


@pytest.mark.one_python
def test_a_body_is_carried_along_a_file_unless_there_is_a_wall(tmp_path):
    source = source_of(path_in_room(tmp_path, 0.1, body="walker"))
    plain = source_of(path_in_room(tmp_path, 0.1)).trajectory()
    carried = source.trajectory()
    np.testing.assert_array_equal(carried.stamps_s, plain.stamps_s)
    away_m = np.linalg.norm((carried.c2w - plain.c2w)[:, :3, 3], axis=1)
    assert 1e-5 < away_m.max() < 0.05
    still = source_of(path_in_room(tmp_path, 0.1, body={"kind": "walker", "motion": 0})).trajectory()
    np.testing.assert_allclose(still.c2w, plain.c2w, atol=1e-9)
    narrow = source_of(path_in_room(tmp_path, 9.0, body="drone"))
    refused(narrow.trajectory, names=("trajectory.body: ", "drone", "m away", "needs 0.2 m", "or another body"))
    assert len(source_of(path_in_room(tmp_path, 9.0)).trajectory()) == 21  # without a body it may
