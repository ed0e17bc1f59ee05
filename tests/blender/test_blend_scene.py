# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene of one's own as it is rendered: its depth, its colour, its camera, against what is calculated without it."""

from functools import partial

import bpy
import cv2
import numpy as np
import pytest

from bpy_extras.object_utils import world_to_camera_view
from mathutils import Matrix, Vector
from cases import cases
from own_scenes import LAST, cast, evaluated_triangles, key, new_scene, opened, relative_errors, save

from noisy_world.nodes.datablocks import muted_output
from noisy_world.render.own_view import camera_parameters, numbered_objects, sampled_camera
from noisy_world.render.scene_inspection import inspect_scene, open_file
from noisy_world.channels import CHANNELS
from noisy_world.channels.channel import View
from noisy_world.core.errors import InputError
from noisy_world.core.geometry import rotation_from_euler_deg
from noisy_world.core.schema import ConfigPath
from noisy_world.sources.lit_scene import rigid_c2w

CLOSE = 1e-5
PLACE = ConfigPath("preset.yaml", "scenes.0")


@pytest.fixture
def blurred(tmp_path):
    """A scene with depth of field, motion blur, and an odd part of its size in view of oblong pixels."""
    scene = new_scene(samples=4)
    scene.render.use_motion_blur = True
    scene.render.resolution_percentage = 91
    scene.render.pixel_aspect_y = 1.3
    data = scene.camera.data
    data.sensor_fit = "VERTICAL"
    data.dof.use_dof = True
    data.dof.focus_object = bpy.data.objects["Ball"]
    data.dof.aperture_fstop = 1.0
    scene.cycles.use_denoising = False
    return save(tmp_path, "blurred")


def test_depth_is_that_of_rays_while_object_and_camera_move(tmp_path):
    new_scene()
    with opened(save(tmp_path)) as (session, paths, camera):
        frames = {index: session.frame(paths.request(index)) for index in (4, 1)}
        for index, frame in frames.items():
            true_m = cast(evaluated_triangles(index + 1), paths.rgb.c2w[index], camera)
            assert relative_errors(frame.depth_m, true_m).max() < CLOSE
            assert frame.rgb.dtype == np.float32
            assert 0.1 < frame.rgb.mean() < 0.9
        assert np.abs(frames[4].depth_m - frames[1].depth_m).max() > 0.5


def test_normals_and_objects_are_those_of_the_triangles_that_rays_meet(tmp_path):
    scene = new_scene()
    scene.objects["Wall"].pass_index = 7
    key(scene.objects["Ball"], "pass_index", {1: 3, LAST: 9})
    numbered = partial(numbered_objects, list(scene.objects))
    lacking = CHANNELS["semantic"].problem_of
    assert "custom property `class`" in lacking(numbered)
    scene.objects["Ball"]["class"] = "toy"
    scene.collection.children.link(walls := bpy.data.collections.new("structure"))
    walls.objects.link(scene.objects["Wall"])
    assert lacking(numbered) == ""
    listed = [{"id": 1, "name": "structure"}, {"id": 2, "name": "toy"}]
    assert CHANNELS["semantic"].content_of(numbered()) == {"void": 0, "classes": listed}
    file = save(tmp_path)
    with opened(file) as (session, paths, camera):
        alone = [session.frame(paths.request(index)) for index in (4, 1)]
    assert not session._images.needs
    with opened(file, others={"normal", "instance"}) as (session, _, _):
        beside = [session.frame(paths.request(index)) for index in (4, 1)]
    classes = np.array([0, 2, 1])  # of nothing, the ball, the wall: numbered by the names of their classes
    with opened(file, rgb=False, depth=False, others={"semantic"}) as (session, _, _):
        assert np.array_equal(session.frame(paths.request(4)).image("semantic"), classes[beside[0].image("instance")])
    with opened(file, rgb=False, depth=False, others={"instance"}) as (session, _, _):
        assert np.array_equal(session.frame(paths.request(4)).image("instance"), beside[0].image("instance"))
    for index, before, frame in zip((4, 1), alone, beside, strict=True):
        assert np.array_equal(frame.rgb, before.rgb)
        assert np.array_equal(frame.depth_m, before.depth_m)
        c2w = paths.rgb.c2w[index]
        ball, wall = (evaluated_triangles(index + 1, {name}) for name in ("Wall", "Ball"))
        depths_m = [cast(triangles, c2w, camera) for triangles in (ball, wall)]
        nearest = np.argmin([np.where(item > 0, item, np.inf) for item in depths_m], axis=0) + 1  # by name
        assert np.array_equal(frame.image("instance"), np.where(np.max(depths_m, axis=0) > 0, nearest, 0))
        assert frame.image("instance").dtype == np.uint16
        points = c2w[:3, 3] + frame.depth_m[..., None] * (camera.ray_directions() @ c2w[:3, :3].T)
        across = np.cross(ball[:, 1] - ball[:, 0], ball[:, 2] - ball[:, 0])
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        for name, seen, normals in ((1, ball, across), (2, wall, np.array([[0.0, -1.0, 0.0]] * 2))):
            here = frame.image("instance") == name
            assert here.sum() > 30
            off = np.abs(np.einsum("pk,tk->pt", points[here], normals) - np.einsum("tk,tk->t", seen[:, 0], normals))
            told = frame.image("normal")[here] @ c2w[:3, :3].T
            among = np.where(off < 1e-4, np.abs(told @ normals.T), 0)  # of the planes that the point lies on
            assert np.abs(among.max(axis=-1) - 1).max() < 1e-4
            assert (np.einsum("pk,pk->p", told, points[here] - c2w[:3, 3]) < 0).all()  # on the side that is seen


class Towards:
    """A camera whose pixels look anywhere."""

    def __init__(self, directions):
        self.directions = directions
        self.height_px, self.width_px = directions.shape[:2]

    def ray_directions(self):
        return self.directions


@cases("between", [(1, 3), (4, 1), (0.5, 1.75)])
def test_flow_of_a_ball_that_moves(between, tmp_path):
    new_scene()
    first, second = between
    stamps_s = sorted(item / 25 for item in between)
    file = save(tmp_path / "-".join(map(str, between)).replace(".", "_"))
    whole = all(float(item).is_integer() for item in between)
    with opened(file, stamps_s=None if whole else stamps_s) as (session, paths, camera):
        requests = [paths.request(int(item) if whole else stamps_s.index(item / 25)) for item in between]
        frames = [session.frame(request) for request in requests]
        moves = session.motion(*requests)
        assert session.motion(requests[0], requests[0]) is None
        again = session.frame(requests[0])
    assert np.array_equal(again.depth_m, frames[0].depth_m)
    views = [
        View(frame.depth_m, request.rgb_c2w, camera, px)
        for frame, request, px in zip(frames, requests, moves, strict=True)
    ]
    flow = CHANNELS["flow"].of_views(*views)

    here, there = (request.rgb_c2w for request in requests)
    height, width = frames[0].depth_m.shape
    points = here[:3, 3] + frames[0].depth_m[..., None].astype(float) * (camera.ray_directions() @ here[:3, :3].T)
    speed = np.array([1.2 / (LAST - 1), 0.0, 0.0])  # of the ball, a frame
    on_ball = np.linalg.norm(points - [-0.5, 2.5, 0] - speed * first, axis=-1) < 0.51
    assert on_ball.sum() > 100
    local = (points + on_ball[..., None] * speed * (second - first) - there[:3, 3]) @ there[:3, :3]
    towards = local / local[..., 2:]
    x = towards[..., 0] * camera.fx_px + camera.cx_px
    y = towards[..., 1] * camera.fy_px + camera.cy_px
    v, u = np.mgrid[:height, :width]
    assert np.hypot(flow[..., 0] - (x - u), flow[..., 1] - (y - v)).max() < 2e-4
    inside = (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)
    assert np.array_equal(flow[..., 2] == 2, ~inside)

    triangles = evaluated_triangles(second + 1)
    hidden = inside & (cast(triangles, there, Towards(towards)) < local[..., 2] * (1 - 1e-3))
    assert hidden.sum() > 20
    beside = np.zeros_like(hidden)  # where a ray 1.5 pixels off meets the other object
    for angle in np.arange(0, 2 * np.pi, np.pi / 4):
        off = [1.5 * np.cos(angle) / camera.fx_px, 1.5 * np.sin(angle) / camera.fy_px, 0]
        met_m = cast(triangles, there, Towards(towards + np.array(off)))
        beside |= np.abs(met_m - local[..., 2]) < 0.3
    assert (hidden & ~beside).sum() > 10
    assert np.array_equal((flow[..., 2] == 1) & ~beside, hidden & ~beside)
    assert not (flow[..., 2] == 1)[inside & ~hidden].any()  # nothing that is seen is ever called hidden


def test_depth_between_two_frames_and_beside_blurred_colour_is_sharp(blurred):
    with opened(blurred, stamps_s=[0.0, 0.05, 0.11], rgb=False) as (session, paths, camera):
        depth_m = session.frame(paths.request(2)).depth_m
        assert (camera.width_px, camera.height_px) == (43, 32)
        assert relative_errors(depth_m, cast(evaluated_triangles(3.75), paths.rgb.c2w[2], camera)).max() < CLOSE


def test_colour_is_what_blender_writes_with_its_blur(blurred, tmp_path):
    open_file(str(blurred))
    scene = bpy.context.scene
    scene.cycles.use_animated_seed = False
    scene.render.dither_intensity = 0.0
    scene.view_settings.look = "AgX - Punchy"
    scene.view_settings.exposure = 0.5
    scene.view_settings.use_curve_mapping = True
    scene.view_settings.curve_mapping.curves[3].points.new(0.5, 0.6)
    path = save(tmp_path, "as_shown")
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.filepath = str(tmp_path / "own.png")
    scene.frame_set(4)
    with muted_output():
        bpy.ops.render.render(write_still=True)
    shown = cv2.imread(str(tmp_path / "own.png"))[..., ::-1].astype(int)
    with opened(path, depth=False) as (session, paths, _):
        differences = np.abs(np.rint(session.frame(paths.request(3)).rgb * 255).astype(int) - shown)
    assert differences.max() <= 1
    assert (differences > 0).mean() < 0.01


@pytest.mark.parametrize(("alpha", "depth_alpha", "stops"), [(0.3, 0.5, False), (0.7, 0.5, True), (0.3, 0.2, True)])
def test_depth_goes_through_what_is_less_opaque_than_the_key_says_everywhere(tmp_path, alpha, depth_alpha, stops):
    scene = new_scene()
    material = bpy.data.materials.new("veil")
    material.node_tree.nodes["Principled BSDF"].inputs["Alpha"].default_value = alpha
    bpy.data.objects["Ball"].data.materials.append(material)
    smoke = bpy.data.materials.new("smoke")
    smoke.node_tree.nodes.remove(smoke.node_tree.nodes["Principled BSDF"])
    scatter = smoke.node_tree.nodes.new("ShaderNodeVolumePrincipled")
    smoke.node_tree.links.new(scatter.outputs[0], smoke.node_tree.nodes["Material Output"].inputs["Volume"])
    bpy.ops.mesh.primitive_cube_add(size=0.8, location=(0.9, 3, 0.5))
    bpy.context.object.name = "Smoke"
    bpy.context.object.data.materials.append(smoke)
    assert scene.camera is not None
    with opened(save(tmp_path), depth_alpha=depth_alpha) as (session, paths, camera):
        frame = session.frame(paths.request(2))
        seen = evaluated_triangles(3, leave_out=("Smoke",) if stops else ("Smoke", "Ball"))
        assert np.array_equal(session.frame(paths.request(2)).rgb, frame.rgb)  # the smoke is there again
        assert relative_errors(frame.depth_m, cast(seen, paths.rgb.c2w[2], camera)).max() < CLOSE


def test_poses_follow_parents_drivers_and_markers():
    scene = new_scene()
    camera = scene.camera
    camera.driver_add("location", 2).driver.expression = "frame * 0.01"
    other = camera.copy()
    other.animation_data_clear()
    other.parent = None
    other.name = "Other"
    other.matrix_world = Matrix([[1, 0, 0, 0.5], [0, 0, -1, -1], [0, 1, 0, 0.2], [0, 0, 0, 1]])
    scene.collection.objects.link(other)
    for frame, bound in ((1, camera), (5, other)):
        scene.timeline_markers.new("cut", frame=frame).camera = bound
    scene.frame_set(2)
    sampled = sampled_camera(scene, None, range(1, LAST + 1))
    assert (scene.frame_current, scene.camera) == (2, camera)
    assert [camera.camera for camera in sampled.parameters] == ["Camera"] * 4 + ["Other"] * 2
    c2w = rigid_c2w(sampled.matrices, PLACE)
    flip = np.diag([1.0, -1.0, -1.0])
    for frame in range(1, 5):
        along = (frame - 1) / (LAST - 1)
        turned = rotation_from_euler_deg(*np.rad2deg([0.05 * along, 0.1 * along, 0.2 * along]))
        place = turned @ (2 * np.array([0.1, 0.2, frame * 0.01])) + along * np.array([0.3, -0.2, 0.1])
        assert np.abs(c2w[frame - 1, :3, 3] - place).max() < 1e-6
        assert np.abs(c2w[frame - 1, :3, :3] - turned @ rotation_from_euler_deg(90, 0, 0) @ flip).max() < 1e-6
    assert np.abs(c2w[4] - [[1, 0, 0, 0.5], [0, 0, 1, -1], [0, -1, 0, 0.2], [0, 0, 0, 1]]).max() < 1e-6


def test_a_stretched_camera_keeps_its_axes_and_a_sheared_or_flat_one_is_refused():
    turned = np.eye(4)
    turned[:3, :3] = rotation_from_euler_deg(10, 20, 30)
    stretched = turned @ np.diag([3.0, 0.5, 2.0, 1.0])
    flip = np.diag([1.0, -1.0, -1.0])
    assert np.abs(rigid_c2w(stretched[None], PLACE)[0, :3, :3] - turned[:3, :3] @ flip).max() < 1e-12
    for scale in (np.diag([3.0, 0.5, 2.0, 1.0]) @ turned, turned @ np.diag([-1.0, 1, 1, 1]), np.diag([0.0, 1, 1, 1])):
        with pytest.raises(InputError, match=r"scenes\.0\.camera: "):
            rigid_c2w(scale[None], PLACE)


def test_intrinsics_are_those_of_blenders_own_projection():
    rng = np.random.default_rng(5)
    scene = new_scene()
    camera = scene.camera
    camera.parent = None
    camera.location, camera.rotation_euler = (0, 0, 0), (0, 0, 0)
    for fit in ("AUTO", "HORIZONTAL", "VERTICAL") * 8:
        data, render = camera.data, scene.render
        data.sensor_fit, data.lens = fit, rng.uniform(10, 100)
        data.sensor_width, data.sensor_height = rng.uniform(10, 60, 2)
        data.shift_x, data.shift_y = rng.uniform(-1, 1, 2)
        render.resolution_x, render.resolution_y = (int(size) for size in rng.integers(4, 1500, 2))
        render.pixel_aspect_x, render.pixel_aspect_y = rng.choice([1.0, 1.7], 2)
        bpy.context.view_layer.update()
        seen = camera_parameters(scene, camera)
        x, y, z = rng.uniform([-1, -1, 1], [1, 1, 9])  # OpenCV's axes
        right, up, _ = world_to_camera_view(scene, camera, Vector((x, -y, -z)))
        expected = np.array([right * seen.width_px - 0.5, (1 - up) * seen.height_px - 0.5])
        found = seen.intrinsics.matrix @ [x / z, y / z, 1]
        assert np.abs(found[:2] - expected).max() < 1e-5 * max(1.0, np.abs(expected).max())


def test_what_cannot_be_a_source_is_said_in_words():
    scene = new_scene()
    camera = scene.camera
    ball = bpy.data.objects["Ball"]

    def said(camera_name=None, **given):
        return {item.problem for item in inspect_scene(scene, camera_name, None, **given).problems}

    assert said() == set()
    assert said("Ball") == {"'Ball' is no camera in the scene Scene"}
    ball.modifiers.new("Cloth", "CLOTH")
    ball.driver_add("location", 1).driver.expression = "print(frame)"
    scene.render.use_multiview = True
    key(camera.data, "lens", {1: 50.0, LAST: 80.0})
    told = " / ".join(sorted(said()))
    for part in ("run Python or are broken, and scripts are never run: Ball location", "not baked", "Ball Cloth"):
        assert part in told
    assert "in stereo" in told
    assert "Camera's lens or clipping changes along the path (fx 66.6667 at frame 1, 74.6667 at frame 2)" in told
    assert "lens" not in " ".join(said(lens_given=True))
    camera.data.type = "ORTHO"
    assert "Camera is orthographic, not perspective" in said()
    scene.camera = None
    assert "the scene Scene has no camera of its own" in said()
    (missing,) = (item for item in inspect_scene(scene, None, None).problems if "no camera" in item.problem)
    assert "name one of its cameras: Camera" in str(missing.remedy)
    bpy.data.objects.remove(camera)
    (missing,) = (item for item in inspect_scene(scene, None, None).problems if "no camera" in item.problem)
    assert str(missing.remedy) == "add one to it"


def test_a_compositor_that_is_not_there_cannot_be_kept(tmp_path):
    scene = new_scene()
    scene.compositing_node_group = None
    path = save(tmp_path)
    told = r"compositor: keep: the scene .* has no compositor; leave the key out"
    with pytest.raises(InputError, match=told), opened(path, keep=True):
        pass
