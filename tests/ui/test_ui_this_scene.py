# SPDX-License-Identifier: GPL-3.0-or-later
"""This Scene in the tab: the open scene and its own camera as the dataset, previewed as they are written."""

import math
from pathlib import Path

import bpy
import cv2
import numpy as np
import pytest
from refusals import refused
from panel_tools import Drawn, settings, straight, use_files

from noisy_world.nodes.chain_scene import shown_chain
from noisy_world.render.own_stills import read_frames
from noisy_world.preset.keys import RenderSpec
from noisy_world.panel import (
    document,
    frame_preview,
    exclusions,
    own_objects,
    preview,
    runs,
    open_scene,
    fields,
    drawn_paths,
    loading,
)
from noisy_world.panel.generating import run_of
from noisy_world.panel.source_views import shown

pytestmark = pytest.mark.usefixtures("add_on")


def names():
    kinds = ("scenes", "objects", "cameras", "images", "node_groups", "actions")
    return {kind: [item.name for item in getattr(bpy.data, kind) if item.name != "Render Result"] for kind in kinds}


def test_what_is_previewed_is_what_is_written_from_a_copy_that_is_kept(hall, tmp_path):
    item = settings()
    assert item.trajectory_source == "CAMERA"
    assert exclusions.excluded(hall) == ()
    item.deviation_translation_m = 0.05
    bpy.ops.noisy_world.add_step(perturbation="fog_depth")
    keys, before = own_objects.keys_state(hall.objects["Mine"]), (hall.frame_end, hall.frame_step, hall.render.fps)
    assert bpy.ops.noisy_world.load_trajectory() == {"FINISHED"}
    assert loading.path_summary(hall) == "3 poses keyed, 12 fps"
    assert hall.camera == hall.objects["Mine"]
    assert (own_objects.keys_state(hall.camera), (hall.frame_end, hall.frame_step, hall.render.fps)) == (keys, before)
    hall.frame_set(5)
    there = names()
    picture, about = frame_preview.draw_colour(hall)
    depth_m = frame_preview.rendered(hall, 2).depth_m
    assert about.startswith("Frame 2: ")
    assert names() == there
    background = runs.start_still(hall, frame_preview.request_of(hall, {2}))
    background.background.wait()
    (elsewhere,) = read_frames(background.folder).values()
    background.tidy()
    here = frame_preview.still_of(hall, 2)
    assert np.array_equal(elsewhere.rgb, here.rgb)
    assert np.array_equal(elsewhere.light.show(elsewhere.light.rgb), here.light.show(here.light.rgb))
    assert np.array_equal(elsewhere.depth_m, depth_m)
    assert bpy.ops.noisy_world.generate() == {"FINISHED"}
    run = run_of(hall)
    copy = tmp_path / "out_scene.blend"
    assert "has no file yet" in run.said
    assert str(copy) in run.said
    folder = tmp_path / "out/perturbed/hall/results"
    written = cv2.imread(str(folder / "frame000002.png"))[..., ::-1]
    assert np.abs(written.astype(int) - picture).max() <= 1
    stored_m = cv2.imread(str(folder / "depth000002.png"), cv2.IMREAD_UNCHANGED) / 1000.0
    assert np.abs(stored_m - depth_m).max() <= 0.5 / 1000 + 1e-6
    assert open_scene.blend_file(hall) == copy
    item.steps[0].severity = 5.0  # of the panel, not of the scene
    bpy.ops.object.select_all(action="SELECT")
    assert open_scene.ensure(hall) == ""
    document.save_preset(item, tmp_path / "hall.yaml")
    assert runs.saved_preset(item) == tmp_path / "hall.yaml"
    hall.objects["Cube"].location.z = 3.0
    bpy.context.view_layer.update()
    assert "copy was saved" in open_scene.ensure(hall)


def test_through_a_lens_the_preview_is_what_is_written_and_its_preset_comes_back(hall, tmp_path):
    item = settings()
    item.use_camera, item.camera.use_distortion, item.camera.distortion.k1 = True, True, -0.25
    item.camera.width, item.camera.height, item.camera.fx, item.camera.fy, item.camera.cx, item.camera.cy = (
        32,
        24,
        30.0,
        30.0,
        15.5,
        11.5,
    )
    assert bpy.ops.noisy_world.load_trajectory() == {"FINISHED"}
    hall.frame_set(3)
    there = names()
    frame_preview.forget(hall)
    picture, _ = frame_preview.draw_colour(hall)
    depth_m = frame_preview.rendered(hall, 1).depth_m
    assert names() == there
    background = runs.start_still(hall, frame_preview.request_of(hall, {1}))
    background.background.wait()
    (elsewhere,) = read_frames(background.folder).values()
    background.tidy()
    assert np.array_equal(elsewhere.rgb, frame_preview.still_of(hall, 1).rgb)
    assert np.array_equal(elsewhere.depth_m, depth_m)
    item.camera.use_distortion = False
    assert not np.array_equal(frame_preview.rendered(hall, 1).rgb, elsewhere.rgb)
    item.camera.use_distortion = True
    assert bpy.ops.noisy_world.generate() == {"FINISHED"}
    run_of(hall)
    folder = tmp_path / "out/clean/hall/results"
    written = cv2.imread(str(folder / "frame000001.png"))[..., ::-1]
    np.testing.assert_array_equal(written, picture)
    stored_m = cv2.imread(str(folder / "depth000001.png"), cv2.IMREAD_UNCHANGED) / 1000.0
    assert np.abs(stored_m - depth_m).max() <= 0.5 / 1000 + 1e-6
    said = document.to_document(item)["camera"]["distortion"]
    assert said == {"model": "radial-tangential", "k1": -0.25}


def test_a_saved_file_is_itself_the_source_and_its_preset_comes_back(hall, tmp_path):
    item = settings()
    item.use_camera = item.render.use_engine = item.render.use_samples = True
    item.compositing, item.scene.trajectory.every = "keep", 2
    hall.compositing_node_group = darkened()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hall.blend"))
    item = settings()
    said = document.to_document(item)
    assert said["scenes"][0] == {
        "name": "hall", "blend": str(tmp_path / "hall.blend"), "scene": "Scene", "camera": "Mine", "frames": "1:5:4",
        "compositor": "keep",
    }  # fmt: skip
    assert {"camera", "render"} <= set(said)
    assert said["render"]["samples"] == 1
    assert document.save_preset(item, tmp_path / "hall.yaml") == ""
    item.mesh_source, item.compositing, item.scene.trajectory.every = "ROOM", "off", 1
    assert item.trajectory_source == "HANDHELD"
    document.open_preset(item, tmp_path / "hall.yaml")
    assert document.to_document(item) == said
    item.render.use_engine = item.render.use_samples = item.use_camera = False
    said = document.to_document(item)
    assert "camera" not in said
    assert "render" not in said


def test_air_softens_the_sun_of_the_scene_in_its_preset_and_preview_alone(hall, tmp_path):
    item, (lamp,) = settings(), bpy.data.lights
    item.of_blend.air.soften_sun, item.of_blend.air.visibility_m = True, 50.0
    lamp.type = "POINT"
    refused(lambda: open_scene.check(hall), names=("This Scene: ", "no sun lamp"))
    lamp.type = "SUN"
    bpy.context.view_layer.update()
    assert bpy.ops.noisy_world.load_trajectory() == {"FINISHED"}
    assert "copy was saved" in open_scene.ensure(hall)
    own = bpy.data.lights[0].angle
    softened = frame_preview.still_of(hall, 0).rgb
    bpy.context.view_layer.update()
    assert bpy.data.lights[0].angle == own
    assert open_scene.ensure(hall) == ""  # nothing has changed that a render shows
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hall.blend"))
    said = document.to_document(item := settings())
    assert said["scenes"][0]["air"] == {"soften_sun": True, "visibility_m": 50.0}
    assert document.save_preset(item, tmp_path / "hall.yaml") == ""
    item.mesh_source = "ROOM"
    document.open_preset(item, tmp_path / "hall.yaml")
    assert item.mesh_source == "SCENE"
    assert document.to_document(item) == said
    shown(item).draw(layout := Drawn(), item)
    assert layout.names[-4:] == ["soften_sun", "visibility_m", "path_m", "reflections"]
    item.of_blend.air.soften_sun, item.of_blend.air.reflections = False, True
    still = frame_preview.still_of(scene := bpy.context.scene, 0)
    assert not np.array_equal(still.rgb, softened)
    assert frame_preview._halved(still).light.mirrored.sky.shape == frame_preview._halved(still).depth_m.shape
    scene.render.engine = "BLENDER_EEVEE"
    refused(lambda: frame_preview.own_still(scene, 0), names=("Air in Reflections: ", "not eevee"))


def darkened():
    """Compositing of an artist's: a quarter of the light."""
    own = bpy.data.node_groups.new("Own", "CompositorNodeTree")
    own.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    layers, exposure, end = (
        own.nodes.new(name) for name in ("CompositorNodeRLayers", "CompositorNodeExposure", "NodeGroupOutput")
    )
    exposure.inputs["Exposure"].default_value = -2.0
    own.links.new(layers.outputs["Image"], exposure.inputs["Image"])
    own.links.new(exposure.outputs[0], end.inputs[0])
    return own


def test_one_rule_says_whether_compositing_is_in_the_view_in_preview_frame_and_in_the_dataset(hall, tmp_path):
    own = darkened()
    item = settings()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hall.blend"))
    item = settings()
    bright = frame_preview.rendered(hall, 1).rgb.mean()
    item.preview = True
    rows = [("auto", True, True), ("auto", False, False), ("off", True, False), ("keep", False, True)]
    for chosen, composites, kept in [("auto", None, False), *rows]:
        if composites is not None:
            preview.hide(hall)
            hall.compositing_node_group, hall.render.use_compositing = own, composites
        item.compositing = chosen
        preview.apply(hall)
        assert ("Own compositing" in hall.compositing_node_group.nodes) == kept, (chosen, composites)
        assert (document.to_document(item)["scenes"][0].get("compositor") == "keep") == kept, (
            chosen,
            composites,
        )
        assert (frame_preview.own_still(hall, 1).keep_compositor) == kept, (chosen, composites)
    assert frame_preview.rendered(hall, 1).rgb.mean() < 0.7 * bright


def test_another_files_scene_is_held_by_its_keys(hall, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "other.blend"))
    document.save_preset(settings(), tmp_path / "other.yaml")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mine.blend"))
    known = document.to_document(settings(), tmp_path)["scenes"][0] | {"blend": "other.blend"}
    bpy.ops.noisy_world.use_preset(filepath=str(tmp_path / "other.yaml"))
    assert settings().mesh_source == "blend"
    assert document.to_document(settings(), tmp_path)["scenes"] == [known]
    refused(bpy.ops.noisy_world.preview_frame, names="Generate", error=RuntimeError)


def test_frames_of_a_file_s_path_and_the_live_chain_follow_the_scenes_frames(hall, tmp_path):
    bpy.ops.noisy_world.add_step(perturbation="gaussian_noise")
    step = settings().steps[0]
    step.severity = 1.0
    step.keyframe_insert("severity", frame=1)
    step.severity = 5.0
    step.keyframe_insert("severity", frame=5)
    assert document.perturb_of(settings()) == [
        {"gaussian_noise": {"mode": "keyed", "levels": [1.0, 3.0, 5.0], "coarse": True}}
    ]
    settings().preview = True
    preview.flush()
    node = shown_chain(hall).nodes["Gaussian Noise"]
    for frame, index in ((1, 0), (3, 1), (5, 2)):
        hall.frame_set(frame)
        assert node.inputs["Frame Offset"].default_value + frame == index
    settings().trajectory_source = "FILE"
    settings().scene.trajectory.file, _ = straight(tmp_path / "path.txt", 3)
    settings().scene.trajectory.rate_hz = 24.0
    bpy.ops.noisy_world.load_trajectory()
    assert frame_preview.path_frames(hall).tolist() == [1.0, 2.0, 3.0]
    assert hall.camera == hall.objects["Mine"]


@pytest.mark.parametrize("wrong", ["no camera", "orthographic", "missing texture"])
def test_what_cannot_be_rendered_elsewhere_is_said_before_anything_runs(hall, wrong):
    if wrong == "no camera":
        hall.camera = None
    elif wrong == "orthographic":
        hall.camera.data.type = "ORTHO"
    else:
        image = bpy.data.images.load(str(Path(__file__)), check_existing=False)
        image.filepath = "//absent.png"
        material = bpy.data.materials.new("Wall")
        material.node_tree.nodes.new("ShaderNodeTexImage").image = image
        hall.objects["Cube"].data.materials.append(material)
    names = {"no camera": "no camera", "orthographic": "not perspective", "missing texture": "absent.png"}
    refused(bpy.ops.noisy_world.generate, names=names[wrong], error=RuntimeError)
    assert run_of(hall) is None


@pytest.mark.parametrize(
    ("wrong", "names"),
    [("ORTHO", ["Mine ", "change its type"]), ("zoom", ["along the path", "Camera > Give Intrinsics"])],
)
def test_a_camera_that_no_dataset_has_is_refused_when_its_path_is_loaded(hall, wrong, names):
    data = hall.camera.data
    if wrong == "zoom":
        data.keyframe_insert("lens", frame=1)
        data.lens = 80.0
        data.keyframe_insert("lens", frame=5)
    else:
        data.type = wrong
    refused(bpy.ops.noisy_world.load_trajectory, names=names, error=RuntimeError)
    assert own_objects.own_object(hall, "camera") is None


def test_frames_that_change_after_the_path_was_loaded_are_said_and_break_nothing(hall):
    settings().deviation_translation_m = 0.05
    bpy.ops.noisy_world.add_step(perturbation="snow_depth")
    assert bpy.ops.noisy_world.load_trajectory() == {"FINISHED"}
    loaded = drawn_paths.deviated_poses(hall, drawn_paths.clean_poses(hall))
    hall.frame_end = 9
    settings().preview = True
    preview.flush()
    assert np.array_equal(drawn_paths.deviated_poses(hall, drawn_paths.clean_poses(hall)), loaded)
    assert hall.session_uid in preview._at_rest
    assert not preview._errors
    assert loading.path_summary(hall) == ""
    refused(bpy.ops.noisy_world.preview_frame, names="Load Trajectory", error=RuntimeError)
    assert bpy.ops.noisy_world.load_trajectory() == {"FINISHED"}
    assert len(drawn_paths.deviated_poses(hall, drawn_paths.clean_poses(hall))) == 5


def test_cameras_that_markers_bind_take_turns_on_one_path_and_none_flies_between_them(hall):
    hall.frame_end, hall.frame_step = 4, 1
    mine, other = hall.camera, bpy.data.objects.new("Other", hall.camera.data)
    hall.collection.objects.link(other)
    other.location = (2.0, -6.0, 1.0)
    other.rotation_euler.x = math.radians(90)
    for frame, bound in ((1, mine), (3, other)):
        hall.timeline_markers.new("Cut", frame=frame).camera = bound
    bpy.ops.noisy_world.add_step(perturbation="rain_depth")
    settings().deviation_translation_m = 0.05
    assert bpy.ops.noisy_world.load_trajectory() == {"FINISHED"}
    for frame, seen in ((1, mine), (4, other), (2, mine)):
        hall.frame_set(frame)
        assert hall.camera == seen
        assert loading.path_summary(hall) == "4 poses keyed, 24 fps"
        frame_preview.draw_colour(hall)  # which asks for a path that is loaded
    settings().deviation_translation_m = 0.0
    sequence, _ = frame_preview.sequence_of(hall)
    state_at = frame_preview.camera_states(hall, sequence)
    speeds_m_s = [np.linalg.norm(state_at(frame).velocity_m_s) for frame in range(4)]
    turning_rad_s = [np.linalg.norm(state_at(frame).turning_rad_s) for frame in range(4)]
    # The rig turns 0.4 rad in 4 frames, more slowly at its ends; the other camera stands still.
    assert 0.3 < turning_rad_s[1] < 2.4
    assert 0.3 * 5 < speeds_m_s[1] < 2.4 * 5
    assert speeds_m_s[2:] == turning_rad_s[2:] == [0.0, 0.0]
    moved = state_at(2).position_m - state_at(0).position_m
    assert np.linalg.norm(moved) == pytest.approx(np.sqrt(2.0**2 + 1.0**2 + 1.0**2), abs=1e-5)
    hall.timeline_markers[1].frame = 4
    assert loading.path_summary(hall) == ""


def test_stereo_is_refused_in_a_line_for_this_scene_and_left_out_of_a_mesh(hall, tmp_path):
    hall.render.use_multiview = True
    refused(bpy.ops.noisy_world.preview_frame, names="turn Stereoscopy off", error=RuntimeError)
    use_files(tmp_path)
    item = settings()
    item.camera.width = item.camera.height = 16
    assert bpy.ops.noisy_world.load_scene() == bpy.ops.noisy_world.load_trajectory() == {"FINISHED"}
    assert frame_preview.rendered(hall, 0).rgb.shape == (16, 16, 3)
    assert hall.render.use_multiview


def test_a_scene_whose_unit_is_no_metre_is_told_when_its_path_is_loaded(hall):
    assert loading.load_path(hall)[1] == ()
    hall.unit_settings.scale_length = 0.01
    (note,) = loading.load_path(hall)[1]
    assert note == (
        "This Scene: its unit is 0.01 m (Unit Scale), and counts as 1 m here: path, depth and weather see all of it "
        "100 times as large; scale it by 0.01, and set Unit Scale to 1"
    )


def test_embree_is_marked_where_it_is_missing(hall, monkeypatch):
    item = settings()
    item.render.use_engine = item.render.use_samples = True
    item.render.engine = "embree"
    refused(bpy.ops.noisy_world.preview_frame, names=["Engine: ", "Embree"], error=RuntimeError)
    assert fields.is_offered("embree")
    monkeypatch.setattr(fields, "find_spec", lambda _: None)
    property_ = fields.described(RenderSpec, "engine")
    assert property_.keywords["items"][-1][:2] == ("embree", "Embree (Missing)")
    refused(document.engine_of, item, names=["render.engine: ", "embreex"])


def test_a_cube_beside_a_loaded_mesh_is_named_and_may_become_the_dataset(tmp_path):
    use_files(tmp_path)
    bpy.data.objects.remove(bpy.data.objects["Light"])
    bpy.ops.noisy_world.load_scene()
    assert "Cube" in exclusions.sentence(bpy.context.scene)
    settings().mesh_source = "SCENE"
    assert exclusions.sentence(bpy.context.scene) == ""
    assert exclusions.shows_dataset(bpy.context.scene)


def test_a_file_of_ones_own_begins_with_this_scene_and_a_panel_in_use_stays(tmp_path):
    scene = bpy.context.scene  # Blender's default scene
    exclusions.begin(scene)
    assert not exclusions.is_used(scene)
    assert settings().mesh_source == "ROOM"
    bpy.ops.mesh.primitive_plane_add()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "plane.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "plane.blend"))
    assert (settings().mesh_source, settings().trajectory_source, settings().use_clean) == ("SCENE", "CAMERA", False)
    assert settings().scene.name == "plane"
    bpy.ops.wm.read_factory_settings()
    bpy.ops.mesh.primitive_plane_add()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a hall.blend"))  # which names no folder of a dataset
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a hall.blend"))
    assert (settings().mesh_source, settings().scene.name) == ("SCENE", "room")
    bpy.ops.wm.read_factory_settings()
    settings().seed = 4  # a panel that was used for the embedded room, which it names by default
    bpy.ops.mesh.primitive_plane_add()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "used.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "used.blend"))
    assert (settings().mesh_source, settings().scene.name) == ("ROOM", "room")


def test_clean_frames_are_asked_for(hall):
    bpy.ops.noisy_world.add_step(perturbation="fog")
    assert [item["name"] for item in document.to_document(settings())["settings"]] == ["perturbed"]
    settings().use_clean = True
    assert [item["name"] for item in document.to_document(settings())["settings"]] == ["clean", "perturbed"]
    settings().use_clean = False
    settings().steps[0].enabled = False
    assert [item["name"] for item in document.to_document(settings())["settings"]] == ["clean"]
