# SPDX-License-Identifier: GPL-3.0-or-later
"""The street and its example file: what a person finds in it, and that its chain changes what is rendered."""

import sys

import bpy
import numpy as np
import pytest
from worlds import ROOT

sys.path.append(str(ROOT / "headless"))
from noisy_world.nodes.datablocks import fcurves_of
from pictures import example
from pictures.lit_chain import CHAIN
from pictures.street import LitFrame, StreetCamera, read_frame, write_frame
from pictures.street import Street, intrinsics_of, path_c2w
from tools.assets import SIDE_PX, thumbnail

pytestmark = pytest.mark.long  # of the film set and of what is drawn once; rarely changed

SIZE = (48, 28)


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    path = tmp_path_factory.mktemp("example") / "street.blend"
    example.write_example(path, SIZE, frames=4)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return path


def test_the_example_is_ready_to_play(opened):
    scene = bpy.context.scene
    assert (scene.frame_start, scene.frame_end, scene.frame_current) == (0, 3, 0)
    assert scene.camera.animation_data.action is not None
    assert scene.view_settings.view_transform == "Standard"
    screen = bpy.context.window_manager.windows[0].screen
    (view,) = (area.spaces.active for area in screen.areas if area.type == "VIEW_3D")
    assert (view.shading.type, view.shading.use_compositor) == ("MATERIAL", "ALWAYS")
    assert view.shading.use_scene_lights
    assert view.shading.use_scene_world
    assert view.region_3d.view_perspective == "CAMERA"
    (editor,) = (area.spaces.active for area in screen.areas if area.type == "NODE_EDITOR")
    assert editor.tree_type == "CompositorNodeTree"
    assert editor.node_tree == scene.compositing_node_group
    assert opened.stat().st_size < 8e6


def test_its_compositing_is_a_chain_of_four_groups(opened):
    tree = bpy.context.scene.compositing_node_group
    node = next(item for item in tree.nodes if item.bl_idname == "NodeGroupOutput")
    chain = []
    while node.bl_idname != "CompositorNodeRLayers":
        if node.bl_idname == "CompositorNodeGroup":
            chain.append(node)
        node = node.inputs["Image"].links[0].from_node
    assert len(chain) == len(CHAIN) == 4
    for item, link in zip(chain[::-1], CHAIN, strict=True):
        for name, value in link.values.items():
            assert item.inputs[name].default_value == pytest.approx(value)
        if "Depth" in item.inputs:
            assert item.inputs["Depth"].links[0].from_node == node
        assert item.inputs["Reference Width"].default_value == SIZE[0]
        keyed = [curve for curve in fcurves_of(tree.animation_data) if f'"{item.name}"' in curve.data_path]
        assert len(keyed) == (12 if "Camera Location" in item.inputs else 0)
    assert bpy.context.scene.view_layers[0].use_pass_z


def test_nothing_in_it_asks_for_a_file_or_the_add_on(opened):
    assert not bpy.data.libraries
    assert not list(bpy.data.texts)
    assert all(image.packed_file for image in bpy.data.images if image.source == "FILE")


def test_a_frame_is_lit_and_has_its_depth(opened):
    """The road's depth is that of a plane below the camera; lamps are brighter than white; the sky is void."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.use_denoising = False
    for item in scene.objects:
        item.hide_render = item.name.startswith(("Tree", "Car", "Furniture"))
    with StreetCamera(Street(scene, scene.camera, path_c2w(1)), samples=1) as camera:
        frame = camera.frame(0)
    rays = intrinsics_of(SIZE).ray_directions()
    c2w = path_c2w(1)[0]
    down = (rays @ c2w[:3, :3].T)[..., 2]
    on_road = np.s_[SIZE[1] - 6 :, 12:24]
    assert np.allclose(frame.depth_m[on_road], (-c2w[2, 3] / down)[on_road], atol=0.03)  # paint is 4 mm high
    assert frame.depth_m[0, SIZE[0] // 2] == 0
    assert (frame.rgb >= 0).all()
    assert frame.depth_m.max() > 50
    assert frame.rgb.mean() > 0.02


def test_the_path_is_continuous_and_made_of_rotations():
    poses = path_c2w(72)
    turned = poses[:, :3, :3]
    assert np.allclose(turned @ turned.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(turned), 1.0)
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert steps.min() > 0.01
    assert steps.max() < 0.06


def test_a_frame_comes_back_from_its_file(tmp_path):
    rng = np.random.default_rng(0)
    rgb = (rng.random((5, 7, 3)) * 100).astype(np.float16).astype(np.float32)
    frame = LitFrame(rgb, rng.random((5, 7), dtype=np.float32) * 60)
    write_frame(tmp_path / "a.exr", frame)
    read = read_frame(tmp_path / "a.exr")
    assert np.array_equal(read.rgb, frame.rgb)
    assert np.array_equal(read.depth_m, frame.depth_m)


def test_the_frame_of_the_previews_has_lamps_sky_near_and_far():
    frame = thumbnail()
    assert frame.depth_m.shape == (SIDE_PX, SIDE_PX)
    assert frame.rgb.max() > 40
    assert (frame.depth_m == 0).any()
    assert frame.depth_m.max() > 50
    assert 2 < frame.depth_m[frame.depth_m > 0].min() < 8
