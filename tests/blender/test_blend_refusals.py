# SPDX-License-Identifier: GPL-3.0-or-later
"""What a .blend may refer to or hold that Blender would never end reading, has no memory for, or ends over."""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

import bpy
from own_scenes import new_scene

from noisy_world.render.scene_inspection import inspect_scene, open_file
from noisy_world.render.scene_inspection import MOST_NESTED
from noisy_world.core.errors import InputError
from noisy_world.core.schema import ConfigPath
from noisy_world.sources import blender_process
from noisy_world.sources.blender_process import inspect_blend
from noisy_world.sources.blender_process import run_blender


def show_picture(path, **values):
    """Give the ball of a new scene a texture that is said to lie at a path; return the scene."""
    scene = new_scene()
    image = bpy.data.images.new("Paint", 4, 4)
    image.source, image.filepath = "FILE", str(path)
    for name, value in values.items():
        setattr(image, name, value)
    material = bpy.data.materials.new("painted")
    material.node_tree.nodes.new("ShaderNodeTexImage").image = image
    bpy.data.objects["Ball"].data.materials.append(material)
    return scene


def said_of(scene, **asked):
    return " / ".join(item.problem for item in inspect_scene(scene, None, None, **asked).problems)


def png_header(width_px, height_px):
    """The start of a PNG of ISO/IEC 15948, whose pixels are not there."""
    header = b"IHDR" + struct.pack(">IIBBBBB", width_px, height_px, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))


# --- files ---


def folder(path):
    path.mkdir()
    (path / "letter.txt").write_text("of somebody")


def pipe(path):
    os.mkfifo(path)


def device(path):
    path.symlink_to("/dev/zero")


def large(path):
    path.write_bytes(png_header(60_000, 60_000))


@pytest.mark.skipif(sys.platform == "win32", reason="it has other pipes and devices")
@pytest.mark.parametrize(
    ("make", "told"), [(folder, "a folder"), (pipe, "a pipe"), (device, "a device"), (large, "60000 x 60000")]
)
def test_a_texture_that_is_no_picture_is_neither_read_nor_in_the_identity(make, told, tmp_path):
    path = tmp_path / "paint.png"
    make(path)
    scene = show_picture(path)
    assert "Paint" in said_of(scene)
    assert told in said_of(scene)
    files = inspect_scene(scene, None, None).files
    assert not any("letter" in file for file in files)


def test_pixels_that_take_more_memory_than_textures_may_are_refused_wherever_they_are(tmp_path):
    (tmp_path / "paint.png").write_bytes(png_header(40_000, 40_000))
    scene = show_picture(tmp_path / "paint.png")
    bpy.data.images["Paint"].pack()
    (tmp_path / "paint.png").unlink()
    assert "40000 x 40000" in said_of(scene)
    made = show_picture("", source="GENERATED", generated_width=40_000, generated_height=40_000)
    assert "40000 x 40000" in said_of(made)
    assert said_of(show_picture("", source="GENERATED", generated_width=64, generated_height=64)) == ""


def test_of_a_folder_of_caches_only_caches_are_hashed(tmp_path):
    scene = new_scene()
    modifier = bpy.data.objects["Ball"].modifiers.new("Fluid", "FLUID")
    modifier.fluid_type = "DOMAIN"
    modifier.domain_settings.cache_directory = str(tmp_path)
    bpy.data.objects["Wall"].modifiers.new("Ocean", "OCEAN").filepath = str(tmp_path)
    baked = {
        "data/fluid_data_0001.vdb",
        "disp_0001.exr",
        "foam_0001.exr",
        "Nodes/42/meta/1.json",
        "Nodes/42/blobs/1.blob",
    }
    for name in (*baked, "letter.txt", "letters/1.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("of somebody")
    found = {Path(file).relative_to(tmp_path).as_posix() for file in inspect_scene(scene, None, None).files}
    assert found == baked


# --- values ---


def test_images_of_no_pixels_are_refused_unless_the_preset_gives_the_camera():
    scene = new_scene()
    scene.render.resolution_x = scene.render.resolution_y = 50
    scene.render.resolution_percentage = 1
    assert "0 x 0 pixels" in said_of(scene)
    assert said_of(scene, lens_given=True) == ""


@pytest.mark.parametrize(
    ("owner", "name", "value", "told"),
    [
        ("render", "fps_base", 1.2345678, "frame rate of inf"),
        ("camera", "sensor_width", 31.2345678, "lens that no pinhole has"),
        ("render", "pixel_aspect_x", 1.2345678, "lens that no pinhole has"),
    ],
)
def test_zeros_that_no_field_takes_are_refused(owner, name, value, told, tmp_path):
    scene = new_scene()
    setattr(scene.camera.data if owner == "camera" else scene.render, name, value)
    path = tmp_path / "hall.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=False)
    data = path.read_bytes()
    held = struct.pack("<f", value)
    assert data.count(held) == 1
    path.write_bytes(data.replace(held, struct.pack("<f", 0.0)))
    open_file(str(path))
    assert told in said_of(bpy.context.scene)


def test_groups_in_groups_are_followed_only_so_deep():
    scene = new_scene()
    inner = None
    for number in range(MOST_NESTED + 1):
        assert said_of(scene) == "" if number in (1, MOST_NESTED) else True
        tree = bpy.data.node_groups.new(f"Level {number}", "GeometryNodeTree")
        if inner is not None:
            tree.nodes.new("GeometryNodeGroup").node_tree = inner
        inner = tree
        if number in (0, MOST_NESTED - 1):
            (bpy.data.objects["Ball"].modifiers.new("Nodes", "NODES")).node_group = tree
    bpy.data.objects["Ball"].modifiers[0].node_group = inner
    assert "deep" in said_of(scene)


def test_a_compositor_that_gives_no_image_cannot_be_kept():
    scene = new_scene()
    scene.compositing_node_group = tree = bpy.data.node_groups.new("Look", "CompositorNodeTree")
    assert "no image" in said_of(scene, composited=True)
    assert said_of(scene) == ""
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    layers, end = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("NodeGroupOutput")
    assert "no image" in said_of(scene, composited=True)
    tree.links.new(layers.outputs[0], end.inputs[0])
    assert said_of(scene, composited=True) == ""


# --- the process ---


@pytest.mark.parametrize(
    ("ending", "told"), [("kill -SEGV $$", "SIGSEGV"), ("kill -KILL $$", "SIGKILL"), ("exit 139", "SIGSEGV")]
)
@pytest.mark.skipif(sys.platform == "win32", reason="it has no signals")
def test_a_look_that_a_signal_ends_names_the_file(ending, told, tmp_path, monkeypatch):
    path = tmp_path / "hall.blend"
    path.write_bytes(b"BLENDER")
    monkeypatch.setattr(blender_process, "inspection_command", lambda: ["/bin/sh", "-c", ending])
    with pytest.raises(InputError) as raised:
        inspect_blend(
            path,
            ConfigPath(tmp_path / "p.yaml"),
            scene=None,
            camera=None,
            frames=None,
            needs_path=True,
            lens_given=False,
        )
    assert str(path) in str(raised.value)
    assert told in str(raised.value)


@pytest.mark.skipif(sys.platform == "win32", reason="it has no signals")
@pytest.mark.parametrize(("ending", "lines"), [("os.kill(os.getpid(), 11)", 1), ("pass", 0), ("sys.exit(3)", 0)])
def test_a_render_that_a_signal_ends_names_the_file(ending, lines):
    code = f"""
import os, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from noisy_world.sources.blender_process import last_words
with last_words(Path("hall.blend"), "rendered it"):
    {ending}
"""
    command = [sys.executable, "-c", code, str(blender_process.PACKAGE.parent)]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stderr
    assert said.count("\n") == lines
    assert ("hall.blend: " in said) == bool(lines)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what a process has spent")
def test_a_process_that_waits_for_ever_is_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(blender_process, "IDLE_S", 0.2)
    monkeypatch.setattr(blender_process, "_LOOK_S", 0.1)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="waits"):
        run_blender(["/bin/cat", str(tmp_path / "pipe")], tmp_path / "hall.blend", who="Blender", limit_s=1)
    told = run_blender(["/bin/cat"], tmp_path / "hall.blend", who="Blender", limit_s=1, order="the order")
    assert told.stdout == "the order"


@pytest.mark.skipif(sys.platform == "win32", reason="it has no such limits")
def test_a_limited_process_gets_no_more_memory_and_time_than_it_may(tmp_path):
    code = """
import sys
sys.path.insert(0, sys.argv[1])
from noisy_world.core.machine import limit_process
limit_process(1)
try:
    bytearray(2**46)  # which Linux promises to whoever has no limit
except MemoryError:
    while True:
        pass
"""
    command = [sys.executable, "-c", code, str(blender_process.PACKAGE.parent)]
    with pytest.raises(InputError, match="more than 1 s of a processor"):
        run_blender(command, tmp_path / "hall.blend", who="Blender", limit_s=1)
