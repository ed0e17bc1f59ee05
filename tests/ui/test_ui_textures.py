# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel's Load Scene shows textures and colours of faces, and takes them away again with the mesh."""

import bpy
import cv2
import numpy as np
import pytest
from refusals import refused
from panel_tools import settings, square
from ply_files import INDICES, POINTS, QUADS, RGB, XYZ, ply, vertex

from noisy_world.panel import loading

pytestmark = pytest.mark.usefixtures("add_on")
PIXELS = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3) * 10


def write_mesh(folder, declarations, values, *comments):
    rows = [(face, *value) for face, value in zip(QUADS, values, strict=True)]
    elements = vertex(XYZ, list(POINTS)), ("face", (*INDICES, *declarations), rows)
    (folder / "mesh.ply").write_bytes(ply("binary_little_endian", *elements, extra=comments))
    return str(folder / "mesh.ply")


def load(path):
    settings().mesh_source, settings().of_mesh.mesh = "FILE", path
    assert bpy.ops.noisy_world.load_scene() == {"FINISHED"}
    (item,) = (item for item in bpy.context.scene.objects if item.get("noisy_world") == "mesh")
    return item


def shown_pixels(image):
    rgba = np.empty(4 * image.size[0] * image.size[1], np.float32)
    image.pixels.foreach_get(rgba)
    return np.rint(rgba.reshape(image.size[1], image.size[0], 4)[::-1, :, :3] * 255)


def test_a_texture_is_shown_saved_and_replaced(tmp_path):
    cv2.imwrite(str(tmp_path / "wall.png"), PIXELS[..., ::-1])
    path = write_mesh(tmp_path, ["list uchar float texcoord"], [[(0.25,) * 8]] * 2, "comment TextureFile wall.png")
    item = load(path)
    assert loading.is_textured(item)
    (image,) = (image for image in bpy.data.images if image.name == "wall.png")
    np.testing.assert_array_equal(shown_pixels(image), PIXELS)
    assert image.packed_file is not None
    assert [polygon.material_index for polygon in item.data.polygons] == [1, 1]
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    (tmp_path / "wall.png").unlink()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    np.testing.assert_array_equal(shown_pixels(bpy.data.images["wall.png"]), PIXELS)
    item = load(square(tmp_path / "square.ply"))
    assert not loading.is_textured(item)
    assert "wall.png" not in bpy.data.images
    assert not any("texture" in material.name for material in bpy.data.materials)


def test_a_missing_texture_leaves_the_scene_as_it_was(tmp_path):
    item = load(square(tmp_path / "square.ply"))
    name = item.name
    settings().of_mesh.mesh = write_mesh(
        tmp_path, ["list uchar float texcoord"], [[(0.25,) * 8]] * 2, "comment TextureFile wall.png"
    )
    refused(bpy.ops.noisy_world.load_scene, names="'wall.png'", error=RuntimeError)
    assert bpy.data.objects[name].get("noisy_world") == "mesh"


def test_colours_of_faces_are_shown_in_every_shading(tmp_path):
    item = load(write_mesh(tmp_path, RGB, [(10, 20, 30), (200, 100, 0)]))
    for name in ("Col", "Display"):
        attribute = item.data.color_attributes[name]
        assert attribute.domain == "CORNER"
        field = "color" if name == "Col" else "color_srgb"
        rgba = np.array([list(getattr(value, field)) for value in attribute.data])
        assert np.rint(rgba[:, :3] * 255).tolist() == [[10, 20, 30]] * 4 + [[200, 100, 0]] * 4
