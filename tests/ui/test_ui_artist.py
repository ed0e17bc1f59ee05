# SPDX-License-Identifier: GPL-3.0-or-later
"""The tab as a technical artist tries it: keys, edits in the compositor, copies of scenes, ticks, units and words."""

import json

import bpy
import cv2
import numpy as np
import pytest
from refusals import refused
from panel_tools import settings, square, use_files
from preview_tools import add

from noisy_world.nodes.chain_scene import GROUP, shown_chain
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry
from noisy_world.panel import document, section_presets, step_list, own_objects, preview, loading, shots

pytestmark = pytest.mark.usefixtures("add_on")


def scene():
    return bpy.context.scene


# --- presets change only what they name ---


@pytest.mark.parametrize(
    ("part", "changed"),
    [("SCENE", {"scenes"}), ("PATH", {"scenes"}), ("CAMERA", {"camera"}), ("OUTPUT", {"render", "output"})],
)
def test_a_sections_preset_changes_that_section_alone(tmp_path, part, changed):
    use_files(tmp_path)
    item = settings()
    item.camera.width, item.render.samples, item.scene.trajectory.every, item.scene.name, item.output.overview = (
        320,
        4,
        2,
        "other",
        True,
    )
    add(scene(), "fog")
    document.save_preset(item, tmp_path / "other.yaml")
    kept = tmp_path / "other.yaml"
    item.camera.width, item.render.samples, item.scene.trajectory.every, item.scene.name, item.seed = (
        640,
        1,
        1,
        "mine",
        9,
    )
    item.of_mesh.mesh, item.output.overview = square(tmp_path / "mine.ply"), False
    item.steps[0].severity = 5
    before = document.to_document(item)
    assert bpy.ops.noisy_world.use_preset(filepath=str(kept), part=part) == {"FINISHED"}
    after = document.to_document(item)
    assert {name for name in before if before[name] != after[name]} == changed
    if changed == {"scenes"}:
        was, now = before["scenes"][0], after["scenes"][0]
        expected = {"SCENE": {"name", "mesh"}, "PATH": {"trajectory"}}[part]
        assert {name for name in was if was[name] != now[name]} == expected


def test_a_header_offers_only_what_its_section_can_take():
    offered = {part: {path.stem for path in section_presets.takeable(part)} for part in section_presets.LABELS}
    assert {"demo", "noisy_replica"} <= offered["CAMERA"]
    assert "noisy_replica" in offered["SCENE"]
    assert "fog" in offered["PERTURBATIONS"]


def test_the_camera_of_a_file(tmp_path):
    """Files written by hand: of NICE-SLAM's successors, Open3D (columns), nerfstudio (corners) and plain."""
    k = (500.0, 510.0, 319.5, 239.25)
    cam_params = {"w": 640, "h": 480, "fx": k[0], "fy": k[1], "cx": k[2], "cy": k[3], "scale": 5000}
    files = {
        "cam_params.json": {"camera": cam_params},
        "open3d.json": {"width": 640, "height": 480, "intrinsic_matrix": [k[0], 0, 0, 0, k[1], 0, k[2], k[3], 1]},
        "transforms.json": {"w": 640, "h": 480, "fl_x": k[0], "fl_y": k[1], "cx": k[2] + 0.5, "cy": k[3] + 0.5},
        "intrinsics.json": {"width": 640, "height": 480, "fx": k[0], "fy": k[1], "cx": k[2], "cy": k[3]},
    }
    for name, content in files.items():
        (tmp_path / name).write_text(json.dumps(content))
        settings().camera.width = 1
        assert bpy.ops.noisy_world.camera_from_file(filepath=str(tmp_path / name)) == {"FINISHED"}
        found = document.intrinsics_of(settings())
        assert (found.width_px, found.height_px, found.fx_px, found.fy_px, found.cx_px, found.cy_px) == (640, 480, *k)
    for content in ("[]", "{}", '{"width": 640, "height": 480, "intrinsic_matrix": [1]}', '{"camera": {"scale": 1}}'):
        (tmp_path / "bad.json").write_text(content)
        refused(section_presets.take_camera, settings(), tmp_path / "bad.json", names="bad.json")


# --- what is keyed ---


def key_severity(step, *keys, name="severity"):
    for frame, value in keys:
        setattr(step, name, value)
        assert step.keyframe_insert(name, frame=frame)
    for curve in step_list.fcurves_of(scene().animation_data):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
        curve.update()


def test_a_curve_that_goes_on_is_followed_to_the_end_of_the_scene():
    step = add(scene(), "gaussian_noise")
    key_severity(step, (0, 1.0), (1, 2.0))
    step_list.curve_of(step).extrapolation, scene().frame_end = "LINEAR", 3
    assert document.values_of(step) == {"mode": "keyed", "levels": [1.0, 2.0, 3.0, 4.0]}


def test_a_keyed_severity_is_in_the_preset_frame_by_frame_and_comes_back(tmp_path):
    step = add(scene(), "gaussian_noise")
    key_severity(step, (0, 0.0), (10, 5.0))
    levels = [0.0, 1.0, *(k / 2 for k in range(2, 11))]  # 0.5 is none; half up is 1
    assert document.perturb_of(settings()) == [{"gaussian_noise": {"mode": "keyed", "levels": levels}}]
    (parsed,) = parse_steps(document.perturb_of(settings()), ConfigPath("test"), registry())
    drawn = [parsed.severity_of(FrameContext(k, (0, "a", "b"))) for k in range(14)]
    assert drawn == [*levels, 5.0, 5.0, 5.0]
    settings().speed_factor = 4
    sampled = document.perturb_of(settings())
    assert sampled[1] == {"gaussian_noise": {"mode": "keyed", "levels": [0.0, 2.0, 4.0, 5.0]}}
    document.save_preset(settings(), tmp_path / "keyed.yaml")
    settings().steps.clear()
    document.open_preset(settings(), tmp_path / "keyed.yaml")
    assert document.perturb_of(settings()) == sampled


def test_mix_and_mask_are_in_the_preset_and_the_mix_is_keyed_frame_by_frame(tmp_path):
    (tmp_path / "presets").mkdir()
    cv2.imwrite(str(tmp_path / "presets/mask.png"), np.zeros((4, 6), np.uint8))
    bloom = add(scene(), "bloom")
    bloom.share_colour = (1.0, 0.5, 0.25)
    assert document.values_of(bloom) == {"severity": 3.0, "colour": [1.0, 0.5, 0.25]}
    step = add(scene(), "gaussian_noise")
    assert document.values_of(step) == {"severity": 3.0}
    step.share_mix, step.share_mask = 0.3, str(tmp_path / "presets/mask.png")
    assert document.values_of(step) == {"severity": 3.0, "mix": 0.3, "mask": str(tmp_path / "presets/mask.png")}
    key_severity(step, (0, 0.0), (4, 1.0), name="share_mix")
    said = document.perturb_of(settings())
    assert said[1]["gaussian_noise"]["mix"] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert (step_list.without_effect(scene()), shots.kept_list(settings())) == ([], "")
    document.save_preset(settings(), tmp_path / "presets/keyed.yaml")
    text = (tmp_path / "presets/keyed.yaml").read_text()
    (tmp_path / "presets/keyed.yaml").write_text(text.replace(str(tmp_path / "presets/mask.png"), "mask.png"))
    bpy.ops.noisy_world.remove_step()
    document.open_preset(settings(), tmp_path / "presets/keyed.yaml")
    assert document.perturb_of(settings()) == said
    assert step_list.curve_of(settings().steps[1], "share_mix").evaluate(2) == 0.5


def test_what_no_preset_holds_cannot_be_keyed_and_old_keys_are_named():
    step = add(scene(), "snow")
    assert not any(item.is_animatable for item in settings().bl_rna.properties)
    assert not any(item.is_animatable for item in step.snow.bl_rna.properties)
    assert [item.identifier for item in step.bl_rna.properties if item.is_animatable] == ["severity", "share_mix"]
    key_severity(step, (0, 1.0), (5, 3.0))
    action = scene().animation_data.action
    action.fcurve_ensure_for_datablock(scene(), "noisy_world.camera.fx").keyframe_points.insert(1, 3.0)
    assert step_list.without_effect(scene()) == ["camera.fx"]


def test_keys_go_with_their_entry_of_the_list():
    bpy.ops.noisy_world.add_step(perturbation="snow")
    bpy.ops.noisy_world.add_step(perturbation="gaussian_noise")
    key_severity(settings().steps[1], (0, 1.0), (3, 2.0))
    bpy.ops.noisy_world.add_step(perturbation="fog")  # comes first
    assert [step_list.curve_of(step) is not None for step in settings().steps] == [False, False, True]
    settings().active_step = 0
    bpy.ops.noisy_world.remove_step()
    assert [step_list.curve_of(step) is not None for step in settings().steps] == [False, True]
    settings().active_step = 1
    bpy.ops.noisy_world.remove_step()
    assert step_list.fcurves_of(scene().animation_data) == []


def test_the_preview_shows_the_keyed_severity():
    scene().frame_start, scene().frame_end = 0, 9
    step = add(scene(), "gaussian_noise")
    key_severity(step, (0, 1.0), (4, 5.0))
    settings().preview = True
    preview.flush()
    severity = shown_chain(scene()).nodes["Gaussian Noise"].inputs["Severity"]
    for frame in (0, 2, 4, 7):
        scene().frame_set(frame)
        assert severity.default_value == min(frame, 4) + 1


# --- the user's own hand in the chain ---


def test_edits_in_the_chain_survive_a_slider():
    fog, noise = add(scene(), "fog"), add(scene(), "gaussian_noise")
    settings().preview = True
    preview.flush()
    chain = shown_chain(scene())
    first, second = chain.nodes["Fog"], chain.nodes["Gaussian Noise"]
    assert not preview.is_chain_edited(scene())
    first.inputs["Override Severity"].default_value = second.inputs["Override Severity"].default_value = True
    first.inputs["Thickness"].default_value = 7.5
    second.inputs["Std"].default_value = 0.25
    second.inputs["Std"].keyframe_insert("default_value", frame=3)
    value = chain.nodes.new("ShaderNodeValue")
    chain.links.new(value.outputs[0], first.inputs["Smoothness"])
    settings().preview_split = 0.5
    noise.severity, noise.mode = 5.0, "dynamic"
    preview.flush()
    assert shown_chain(scene()) == chain
    assert first.inputs["Thickness"].default_value == 7.5
    assert first.inputs["Smoothness"].is_linked
    paths = {curve.data_path for curve in step_list.fcurves_of(chain.animation_data)}
    assert second.inputs["Std"].path_from_id("default_value") in paths
    assert second.inputs["Std"].default_value == 0.25
    assert preview.is_chain_edited(scene())
    noise.mode = "static"
    fog.severity = 5.0
    preview.flush()
    assert first.inputs["Severity"].default_value == 5.0
    assert first.inputs["Override Severity"].default_value  # so the user's thickness stays in effect
    assert first.inputs["Thickness"].default_value == 7.5
    settings().steps[0].use_severity = False
    settings().steps[0].fog.thickness = 1.25  # which sets the thickness
    preview.flush()
    assert first.inputs["Thickness"].default_value == 1.25
    assert bpy.ops.noisy_world.reset_chain() == {"FINISHED"}
    assert not preview.is_chain_edited(scene())


def test_a_chain_that_a_user_has_broken_is_no_error():
    fog = add(scene(), "fog")
    settings().preview = True
    preview.flush()
    tree = scene().compositing_node_group
    for link in list(tree.links):
        tree.links.remove(link)
    shown_chain(scene()).nodes.remove(shown_chain(scene()).nodes["Fog"])
    fog.severity, settings().preview_split = 1.0, 0.5
    preview.flush()
    tree.nodes.remove(tree.nodes[GROUP])
    fog.severity = 2.0
    preview.flush()
    assert shown_chain(scene()).nodes["Fog"]


def test_the_split_moves_alone(monkeypatch):
    add(scene(), "fog")
    settings().preview = True
    preview.flush()
    calls = []
    for module, name in ((preview, "apply"), (preview.frame_preview, "sequence_of"), (preview, "refresh_chain")):
        monkeypatch.setattr(module, name, lambda *_, **__: calls.append(1))
    for split in np.linspace(0.0, 1.0, 11):
        settings().preview_split = split
    assert not calls
    node = scene().compositing_node_group.nodes["Before and after"]
    assert node.inputs["Position"].default_value[0] == 1.0


# --- the user's file ---


def counts():
    kinds = ("objects", "meshes", "materials", "images", "actions", "cameras", "collections", "worlds", "scenes")
    return {kind: len(getattr(bpy.data, kind)) for kind in kinds}


def test_loading_again_and_again_leaves_no_data_behind(tmp_path):
    use_files(tmp_path)
    found = []
    for _ in range(3):
        bpy.ops.noisy_world.load_scene()
        bpy.ops.noisy_world.load_trajectory()
        found.append(counts())
    assert found[0] == found[1] == found[2]


def test_what_is_ours_is_selected_and_in_a_collection_of_its_own(tmp_path):
    use_files(tmp_path)
    space = next(area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D").spaces.active
    shading = (space.shading.color_type, space.shading.light)
    bpy.ops.noisy_world.load_scene()
    mesh = loading.own_object(scene(), "mesh")
    assert bpy.context.selected_objects == [mesh] == [bpy.context.view_layer.objects.active]
    bpy.ops.noisy_world.load_trajectory()
    camera = loading.own_object(scene(), "camera")
    assert bpy.context.selected_objects == [camera]
    for item in (mesh, camera):
        assert [collection.name for collection in item.users_collection] == ["Noisy World"]
    assert (space.shading.color_type, space.shading.light) == shading


def test_the_mode_that_a_user_is_in_stays(tmp_path):
    use_files(tmp_path)
    cube = bpy.data.objects["Cube"]
    bpy.context.view_layer.objects.active = cube
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.noisy_world.load_scene()
    assert cube.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.objects.active = loading.own_object(scene(), "mesh")
    bpy.ops.object.mode_set(mode="EDIT")
    refused(bpy.ops.noisy_world.load_scene, names="leave that mode", error=RuntimeError)
    assert bpy.context.view_layer.objects.active.mode == "EDIT"


def test_a_linked_copy_of_the_scene_is_left_alone(tmp_path):
    use_files(tmp_path)
    bpy.ops.noisy_world.load_scene()
    bpy.ops.noisy_world.load_trajectory()
    first, copy = scene(), scene().copy()
    mesh, camera = loading.own_object(first, "mesh"), loading.own_object(first, "camera")
    lens, keys = camera.data.lens, own_objects.keys_state(camera)
    copy.noisy_world.camera.fx = 300
    copy.noisy_world.deviation_translation_m = 0.5
    with bpy.context.temp_override(scene=copy):
        bpy.ops.noisy_world.load_scene()
        bpy.ops.noisy_world.load_trajectory()
    assert (loading.own_object(first, "mesh"), loading.own_object(first, "camera")) == (mesh, camera)
    assert first.camera == camera
    assert (camera.data.lens, own_objects.keys_state(camera)) == (lens, keys)
    own = [loading.own_object(copy, kind) for kind in ("mesh", "camera")]
    assert all(item is not None and item not in set(first.objects) for item in own)
    assert mesh not in set(copy.objects)
    assert copy.camera == own[1]


def test_the_timeline_is_the_paths_and_its_change_is_said(tmp_path):
    use_files(tmp_path)
    scene().frame_set(37)
    stamps = np.arange(10) / 29.97
    np.savetxt(tmp_path / "path.txt", np.column_stack([stamps, np.zeros((10, 6)), np.ones(10)]), fmt="%.6f")
    settings().scene.trajectory.file = str(tmp_path / "path.txt")
    count, notes = loading.load_path(scene())
    assert count == 10
    assert (
        notes[0]
        == "timeline: frames 0 to 9 (was frames 1 to 250), 29.97 fps (was 24 fps), at frame 0 (was at frame 37)"
    )
    assert (scene().render.fps, scene().frame_current) == (30, 0)
    assert loading.frames_per_s(scene()) == pytest.approx(29.97, rel=1e-4)
    scene().frame_end = 4  # the user's own choice: a slider leaves it
    settings().deviation_translation_m = 0.1
    assert scene().frame_end == 4


def test_ticks_tell_the_truth(tmp_path):
    use_files(tmp_path)
    bpy.ops.noisy_world.load_scene()
    bpy.ops.noisy_world.load_trajectory()
    assert loading.summary(scene()) == ("4 vertices", "1 faces")
    assert loading.path_summary(scene()) == "10 poses keyed, 20 fps"
    for group, name in ((settings().scene.trajectory, "file"), (settings().of_mesh, "mesh")):
        known = getattr(group, name)
        setattr(group, name, known + "x")
        assert (loading.path_summary(scene()) == "") == (name == "file")
        assert (loading.summary(scene()) == ()) == (name == "mesh")
        setattr(group, name, known)
    assert loading.path_summary(scene())
