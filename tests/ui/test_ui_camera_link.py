# SPDX-License-Identifier: GPL-3.0-or-later
"""The button that keys how the camera moves in groups of weather of an artist's compositor."""

import pytest
from refusals import refused

bpy = pytest.importorskip("bpy", reason="bpy is not installed")


@pytest.fixture
def node(add_on):
    """Snow by depth inside a group of the artist's own, in a scene of 24 frames a second whose camera drives."""
    from noisy_world.nodes.node_trees import ensure_group
    from noisy_world.perturbations.groups import build_group
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


def seen_at(node, frame):
    """The values of a node's sockets at a frame, as they are evaluated."""
    bpy.context.scene.frame_set(frame)
    seen = node.id_data.evaluated_get(bpy.context.evaluated_depsgraph_get()).nodes[node.name]
    return {socket.name: socket.default_value for socket in seen.inputs if hasattr(socket, "default_value")}


def test_velocity_and_turning_are_keyed_and_what_a_user_drives_stays(node):
    for _ in range(2):  # pressed again, it does the same
        assert bpy.ops.noisy_world.key_camera_motion() == {"FINISHED"}
    for frame, velocity in ((1, 0.0), (3, 3.0), (5, 3.0)):
        values = seen_at(node, frame)
        assert tuple(values["Camera Velocity"]) == pytest.approx((0.0, velocity, 0.0), abs=1e-3)
        assert tuple(values["Camera Turning"]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
        assert not values["Override Camera"]
    for part in range(3):
        node.inputs["Camera Turning"].driver_add("default_value", part).driver.expression = "frame * 0.5"
    assert bpy.ops.noisy_world.key_camera_motion() == {"FINISHED"}
    assert tuple(seen_at(node, 4)["Camera Turning"]) == pytest.approx((2.0, 2.0, 2.0))


def test_without_a_group_or_a_camera_the_button_says_why(add_on):
    assert not bpy.ops.noisy_world.key_camera_motion.poll()
    refused(bpy.ops.noisy_world.key_camera_motion, names="group", error=RuntimeError)
    bpy.context.scene.camera = None
    refused(bpy.ops.noisy_world.key_camera_motion, names="has no camera", error=RuntimeError)


def test_what_is_added_to_this_scene_has_its_frame_rate(add_on):
    """A mesh along a path has the rate of the path, which nobody knows yet, so there the default stays."""
    from noisy_world.panel.properties import panel_of, parameters_of

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


def test_none_flies_between_cameras_that_markers_bind(node):
    second_camera(bpy.context.scene, 4)
    for _ in range(2):
        assert bpy.ops.noisy_world.key_camera_motion() == {"FINISHED"}
    for frame, velocity in ((3, 3.0), (4, 0.0), (5, 0.0)):
        values = seen_at(node, frame)
        assert tuple(values["Camera Velocity"]) == pytest.approx((0.0, velocity, 0.0), abs=1e-3), frame
        assert tuple(values["Camera Turning"]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6), frame


def test_a_camera_without_perspective_is_refused_in_a_line(node):
    bpy.context.scene.camera.data.type = "ORTHO"
    refused(bpy.ops.noisy_world.key_camera_motion, names=["Camera ", "change its type"], error=RuntimeError)
