# SPDX-License-Identifier: GPL-3.0-or-later
"""The button that links groups of weather in an artist's compositor to the camera and the scene's frame rate."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed")


@pytest.fixture
def node(add_on):
    """Snow by depth inside a group of the artist's own, in a scene of 24 frames a second whose camera drives."""
    from noisy_world.blender.nodes import ensure_group
    from noisy_world.core.node_graphs.groups import build_group
    from noisy_world.perturbations import registry

    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 24, 1, 5
    camera = scene.camera
    camera.rotation_mode, camera.rotation_euler, camera.location = "XYZ", (1.2, 0.0, 0.5), (1.0, 2.0, 3.0)
    camera.keyframe_insert("location", frame=1)
    camera.location.y += 0.5  # 3 m/s
    camera.keyframe_insert("location", frame=5)
    for curve in camera.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    tree, own = (bpy.data.node_groups.new(name, "CompositorNodeTree") for name in ("Compositing", "Own"))
    scene.compositing_node_group = tree
    tree.nodes.new("CompositorNodeGroup").node_tree = own
    made = own.nodes.new("CompositorNodeGroup")
    made.node_tree = ensure_group(build_group(registry()["snow_depth"]))
    return made


def test_groups_follow_the_camera_and_the_scene_s_frame_rate(node):
    scene = bpy.context.scene
    for _ in range(2):  # pressed again, it does the same
        assert bpy.ops.noisy_world.link_camera() == {"FINISHED"}
    for frame, y_m, velocity in ((1, 2.0, 0.0), (3, 2.25, 3.0), (5, 2.5, 3.0)):
        scene.frame_set(frame)
        seen = node.id_data.evaluated_get(bpy.context.evaluated_depsgraph_get()).nodes[node.name]
        values = {socket.name: socket.default_value for socket in seen.inputs if hasattr(socket, "default_value")}
        assert tuple(values["Camera Location"]) == pytest.approx((1.0, y_m, 3.0), abs=1e-5)
        assert tuple(values["Camera Rotation"]) == pytest.approx((1.2, 0.0, 0.5), abs=1e-5)
        assert tuple(values["Camera Velocity"]) == pytest.approx((0.0, velocity, 0.0), abs=1e-3)
        assert tuple(values["Camera Turning"]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
        assert values["Frame Rate"] == pytest.approx(24)
        assert values["View"] == pytest.approx(2 * np.arctan(36 / 2 / 50), abs=1e-4)
    scene.render.fps, scene.camera.data.lens = 30, 35.0
    scene.frame_set(2)
    seen = node.id_data.evaluated_get(bpy.context.evaluated_depsgraph_get()).nodes[node.name]
    assert seen.inputs["Frame Rate"].default_value == pytest.approx(30)
    assert seen.inputs["View"].default_value == pytest.approx(2 * np.arctan(36 / 2 / 35), abs=1e-4)
    drivers = node.id_data.animation_data.drivers
    assert all(item.driver.type != "SCRIPTED" or item.driver.is_simple_expression for item in drivers)


def test_without_a_group_or_a_camera_the_button_says_why(add_on):
    assert not bpy.ops.noisy_world.link_camera.poll()
    with pytest.raises(RuntimeError, match="no group that asks for camera"):
        bpy.ops.noisy_world.link_camera()
    bpy.context.scene.camera = None
    with pytest.raises(RuntimeError, match="has no camera"):
        bpy.ops.noisy_world.link_camera()


def test_what_is_added_to_this_scene_has_its_frame_rate(add_on):
    """A mesh along a path has the rate of the path, which nobody knows yet, so there the default stays."""
    from noisy_world.ui.properties import panel_of, parameters_of

    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = 30, 1.001
    panel = panel_of(scene)
    for source, wanted_hz in (("SCENE", 30 / 1.001), ("ROOM", 20)):
        panel.mesh_source = source
        panel.steps.clear()
        for name in ("snow_depth", "contrast"):
            assert bpy.ops.noisy_world.add_step(perturbation=name) == {"FINISHED"}
        (snow,) = (item for item in panel.steps if item.perturbation == "snow_depth")
        assert parameters_of(snow).frame_rate_hz == pytest.approx(wanted_hz)


def second_camera(scene, frame):
    """Let a camera that stands elsewhere take over at a frame, by markers, as an artist binds them."""
    other = bpy.data.objects.new("Other", scene.camera.data.copy())
    scene.collection.objects.link(other)
    other.location, other.rotation_euler, other.data.lens = (5.0, 0.0, 4.0), (1.4, 0.0, -0.3), 30.0
    for at, bound in ((scene.frame_start, scene.camera), (frame, other)):
        scene.timeline_markers.new("Cut", frame=at).camera = bound
    return other


def test_groups_follow_each_camera_that_a_marker_binds_and_none_flies_between_them(node):
    scene = bpy.context.scene
    second_camera(scene, 4)
    for _ in range(2):
        assert bpy.ops.noisy_world.link_camera() == {"FINISHED"}
    rows = ((3, (1.0, 2.25, 3.0), (1.2, 0.0, 0.5), 3.0, 50), (4, (5.0, 0.0, 4.0), (1.4, 0.0, -0.3), 0.0, 30))
    for frame, place, angles, velocity, lens_mm in (*rows, (5, *rows[1][1:])):
        scene.frame_set(frame)
        seen = node.id_data.evaluated_get(bpy.context.evaluated_depsgraph_get()).nodes[node.name]
        values = {socket.name: socket.default_value for socket in seen.inputs if hasattr(socket, "default_value")}
        assert tuple(values["Camera Location"]) == pytest.approx(place, abs=1e-5), frame
        assert tuple(values["Camera Rotation"]) == pytest.approx(angles, abs=1e-5), frame
        assert tuple(values["Camera Velocity"]) == pytest.approx((0.0, velocity, 0.0), abs=1e-3), frame
        assert tuple(values["Camera Turning"]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6), frame
        assert values["View"] == pytest.approx(2 * np.arctan(36 / 2 / lens_mm), abs=1e-4), frame


def test_a_camera_without_perspective_is_refused_in_a_line(node):
    bpy.context.scene.camera.data.type = "ORTHO"
    with pytest.raises(RuntimeError, match="Camera is not perspective, as these groups expect: change its type"):
        bpy.ops.noisy_world.link_camera()
