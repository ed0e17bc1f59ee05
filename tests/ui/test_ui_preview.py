# SPDX-License-Identifier: GPL-3.0-or-later
"""The live preview, without a window: what it shows is what the generator writes, and it leaves nothing behind."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from calls import calls_made
from group_tools import picture
from preview_tools import IDENTIFIERS, SIZE, add, cycles_scene, steps_of
from refusals import refused
from shown import evaluate_scene, image_of

from noisy_world.nodes.chain_scene import (
    PREVIOUS,
    GROUP,
    OWN,
    SPLIT,
    action_bag,
    hide_chain,
    own_compositing,
    refresh_chain,
    show_chain,
    shown_chain,
)
from noisy_world.nodes.chain_scene import is_edited
from noisy_world.nodes.compositor import Compositor
from noisy_world.perturbations.execution import move
from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.trajectory import Trajectory
from noisy_world.panel import drawn_paths, fields, frame_preview, preview, properties, views
from noisy_world.panel.fields import notify_once


pytestmark = pytest.mark.usefixtures("registered")


def shown(scene, rgb, folder):
    """What the scene's chain makes of an image at the scene's frame."""
    show_chain(scene, shown_chain(scene), image=image_of(rgb), encoded=True, reference_width_px=SIZE[0])
    return evaluate_scene(scene, folder)


def written(rgb, steps, index, identifiers=IDENTIFIERS):
    with Compositor(SIZE, {"x": steps}, SIZE[0]) as compositor:
        made = compositor.evaluate(rgb, {"x": (index, identifiers)})[0]["x"]
    return rgb if made is None else made


# --- the chain ---


def test_the_panels_preview_is_what_the_generator_writes(scene, tmp_path):
    rgb = picture(SIZE[1], SIZE[0])
    fog = add(scene, "fog", severity=2.0, mode="dynamic", temporal="drift")
    add(scene, "gaussian_noise", severity=3.0)
    scene.noisy_world.preview = True
    preview.flush()
    fog.severity = 5.0
    preview.flush()
    steps = steps_of({"fog": {"severity": 5, "mode": "dynamic", "temporal": "drift"}}, {"gaussian_noise": {}})
    for k in (6, 0, 9):
        scene.frame_set(k)
        assert np.array_equal(shown(scene, rgb, tmp_path), written(rgb, steps, k))


def test_faster_motion_keeps_the_numbers_of_its_own_frames(scene, tmp_path):
    rgb = picture(SIZE[1], SIZE[0])
    add(scene, "gaussian_noise")
    scene.noisy_world.speed_factor = 3
    scene.noisy_world.preview = True
    preview.flush()
    for k in (6, 3):
        scene.frame_set(k)
        assert np.array_equal(shown(scene, rgb, tmp_path), written(rgb, steps_of({"gaussian_noise": {}}), k // 3))


def test_a_slider_changes_sockets_alone_and_a_step_the_chain(scene):
    fog = add(scene, "fog")
    scene.noisy_world.preview = True
    preview.flush()
    chain = shown_chain(scene)
    tree, sockets = scene.compositing_node_group, chain.nodes["Fog"].inputs
    assert (sockets["Severity"].default_value, sockets["Override Severity"].default_value) == (3.0, False)
    groups = len(bpy.data.node_groups)
    fog.severity = 4.5
    preview.flush()
    assert scene.compositing_node_group == tree
    assert shown_chain(scene) == chain
    # Between levels by the parameters, which are then those of the generator to the bit; at levels by the severity.
    assert sockets["Thickness"].default_value == 2.75
    assert sockets["Override Severity"].default_value
    fog.severity = 5.0
    preview.flush()
    assert (sockets["Severity"].default_value, sockets["Override Severity"].default_value) == (5.0, False)
    noise = add(scene, "gaussian_noise")
    preview.flush()
    assert [node.name for node in shown_chain(scene).nodes if node.bl_idname == "CompositorNodeGroup"] == [
        "Fog",
        "Gaussian Noise",
    ]
    noise.enabled = False
    preview.flush()
    assert len(bpy.data.node_groups) == groups


def test_a_chain_of_an_earlier_version_is_made_anew_and_nothing_of_it_is_left(scene):
    steps = steps_of({"jpeg_compression": {"severity": 3}}, {"pixelate": {"severity": 3}})
    refresh_chain(scene, steps, IDENTIFIERS)
    names = {tree.name for tree in bpy.data.node_groups}
    for tree in bpy.data.node_groups:  # as if its groups had been described otherwise
        tree["noisy_world_stamp"] = "earlier"
        if tree.name.startswith("Per"):
            del tree["noisy_world_made_as"]
        if not tree.name.startswith(("Per", "Pre", "JPEG Comp", "Pix")):
            tree.name = f"NW {tree.name}"
    refresh_chain(scene, steps, IDENTIFIERS)
    assert {tree.name for tree in bpy.data.node_groups} == names
    chain = shown_chain(scene)
    chain.name = "Mine"  # a user may call it as he likes
    refresh_chain(scene, steps, IDENTIFIERS)
    assert shown_chain(scene) == chain
    hide_chain(scene)
    assert len(bpy.data.node_groups) == 0


@pytest.mark.parametrize("deleted", ["Motion Blur", "Motion Blur Step", "Dirt on a lens"])
def test_what_a_user_deletes_of_a_chain_is_made_again(scene, deleted):
    steps = steps_of({"motion_blur": {"severity": 3}}, {"lens_dirt": {"severity": 3}})
    refresh_chain(scene, steps, IDENTIFIERS)
    (item,) = (each for each in (*bpy.data.node_groups, *bpy.data.images) if each.name == deleted)
    bpy.data.batch_remove([item])
    chain = refresh_chain(scene, steps, IDENTIFIERS)
    used = [node.node_tree for node in chain.nodes if node.bl_idname == "CompositorNodeGroup"]
    while used:
        tree = used.pop()
        assert tree is not None
        for node in tree.nodes:
            if node.bl_idname == "CompositorNodeGroup":
                used.append(node.node_tree)
            assert node.bl_idname != "CompositorNodeImage" or node.image is not None


def test_a_group_that_takes_the_camera_follows_a_slider(scene):
    for severity in (2, 3):
        chain = refresh_chain(scene, steps_of({"rain_depth": {"severity": severity}}), IDENTIFIERS)
        assert not is_edited(chain)
    (node,) = (node for node in chain.nodes if node.bl_idname == "CompositorNodeGroup")
    assert node.inputs["Severity"].default_value == 3
    assert tuple(node.inputs["Camera Location"].default_value) == (0, 0, 0)


def test_following_in_place_costs_little(scene):
    steps = [steps_of({"fog": {"severity": s, "mode": "dynamic"}}, {"gaussian_noise": {"severity": s}}) for s in (3, 4)]
    costs, actions = {}, set()
    for scene.frame_end in (99, 399):
        refresh_chain(scene, steps[0], IDENTIFIERS)
        costs[scene.frame_end] = calls_made(refresh_chain, scene, steps[1], IDENTIFIERS)
        assert len(bpy.data.actions) == 1
        actions.add(bpy.data.actions[0].session_uid)  # replaced, undo would find what points to one that is gone
    assert len(actions) == 1
    assert (costs[399] - costs[99]) / 300 < 60  # the keys of a frame more
    hide_chain(scene)
    assert costs[399] < calls_made(refresh_chain, scene, steps[1], IDENTIFIERS)  # the groups are read again


def test_switching_off_gives_everything_back(scene):
    before = {tree.name for tree in bpy.data.node_groups}
    add(scene, "fog_depth")
    scene.noisy_world.preview = True
    preview.flush()
    assert scene.view_layers[0].use_pass_z
    scene.noisy_world.preview = False
    preview.flush()
    assert scene.compositing_node_group is None
    assert not scene.view_layers[0].use_pass_z
    assert {tree.name for tree in bpy.data.node_groups} == before
    assert len(bpy.data.actions) == 0
    assert {key for key in scene.keys() if key != "noisy_world"} == set()  # noqa: SIM118


def test_what_a_user_chose_meanwhile_stays(scene):
    add(scene, "fog")
    scene.noisy_world.preview = True
    preview.flush()
    own = bpy.data.node_groups.new("Own", "CompositorNodeTree")
    scene.compositing_node_group = own
    scene.noisy_world.preview = False
    preview.flush()
    assert scene.compositing_node_group == own
    assert [tree.name for tree in bpy.data.node_groups] == ["Own"]


@pytest.mark.parametrize("entry", ["render layers", "group input"])
def test_a_users_own_compositing_stays_in_effect_before_the_chain(scene, tmp_path, entry):
    cycles_scene((0.1, 0.2, 0.05))
    own = bpy.data.node_groups.new("Own", "CompositorNodeTree")
    own.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    if entry == "group input":
        own.interface.new_socket("Image", in_out="INPUT", socket_type="NodeSocketColor")
    source = own.nodes.new("CompositorNodeRLayers" if entry == "render layers" else "NodeGroupInput")
    exposure, end = own.nodes.new("CompositorNodeExposure"), own.nodes.new("NodeGroupOutput")
    exposure.inputs["Exposure"].default_value = 1.0
    own.links.new(source.outputs[0], exposure.inputs["Image"])
    own.links.new(exposure.outputs[0], end.inputs[0])
    scene.compositing_node_group = own
    for after_own, seen in ((True, (0.2, 0.4, 0.1)), (False, (0.1, 0.2, 0.05)), (True, (0.2, 0.4, 0.1))):
        refresh_chain(scene, steps_of({"contrast": {"severity": 0}}), IDENTIFIERS, after_own=after_own)
        assert own_compositing(scene) == own
        assert np.allclose(evaluate_scene(scene, tmp_path)[5, 5], seen, atol=2e-3)
    hide_chain(scene)
    assert scene.compositing_node_group == own


def test_the_split_shows_the_left_as_it_was(scene, tmp_path):
    cycles_scene((0.1, 0.2, 0.05))
    steps = steps_of({"gaussian_noise": {"severity": 5}})
    refresh_chain(scene, steps, IDENTIFIERS)
    whole = evaluate_scene(scene, tmp_path)
    chain = refresh_chain(scene, steps, IDENTIFIERS, split=0.25)
    half = evaluate_scene(scene, tmp_path)
    edge = SIZE[0] // 4
    assert np.allclose(half[:, : edge - 1], (0.1, 0.2, 0.05), atol=1e-3)
    assert np.array_equal(half[:, edge + 2 :], whole[:, edge + 2 :])
    refresh_chain(scene, steps, IDENTIFIERS, split=0.0)
    assert SPLIT not in scene.compositing_node_group.nodes
    assert shown_chain(scene) == chain


def test_two_scenes_do_not_disturb_each_other(scene):
    other = bpy.data.scenes.new("Other")
    other.frame_start, other.frame_end = 0, 3
    for item, name in ((scene, "fog"), (other, "frost")):
        add(item, name)
        item.noisy_world.preview = True
    preview.flush()
    assert "Fog" in shown_chain(scene).nodes
    assert "Frost" in shown_chain(other).nodes
    other.noisy_world.preview = False
    preview.flush()
    assert other.compositing_node_group is None
    assert "Fog" in shown_chain(scene).nodes


def test_a_copied_scene_gets_a_chain_of_its_own(scene):
    add(scene, "fog")
    scene.noisy_world.preview = True
    preview.flush()
    copy = scene.copy()
    assert shown_chain(copy) is None
    preview.apply(copy)
    assert shown_chain(copy) not in (None, shown_chain(scene))
    assert OWN not in copy.compositing_node_group.nodes
    copy.noisy_world.preview = False
    preview.flush()
    preview.apply(copy)
    assert copy.compositing_node_group is None
    assert shown_chain(scene) is not None


def test_wrong_settings_are_kept_for_the_panel(scene):
    add(scene, "fog")
    scene.noisy_world.preview = True
    preview.flush()
    chain = shown_chain(scene)
    add(scene, "desync")
    add(scene, "desync")
    preview.flush()
    assert "twice" in preview._errors[scene.session_uid]
    assert shown_chain(scene) == chain


def test_changes_that_come_together_are_shown_once(scene, monkeypatch):
    """As of a preset that is opened, which sets a hundred values."""
    add(scene, "fog")
    scene.noisy_world.preview = True
    shown, show = [], preview.show
    monkeypatch.setattr(preview, "show", lambda *given, **options: shown.append(given) or show(*given, **options))
    with notify_once():
        scene.noisy_world.seed = 3
        scene.noisy_world.setting.name = "other"
        scene.noisy_world.camera.width = 320
    assert len(shown) == 1
    assert scene.compositing_node_group.nodes[GROUP].inputs["Reference Width"].default_value == 320


def test_reference_width_follows_the_camera(scene):
    add(scene, "gaussian_blur")
    scene.noisy_world.preview = True
    preview.flush()
    scene.noisy_world.camera.width = 640
    preview.flush()
    assert scene.compositing_node_group.nodes[GROUP].inputs["Reference Width"].default_value == 640


# --- the views, the transform, what stays behind ---


def test_views_get_their_compositor_back():
    bpy.ops.wm.read_factory_settings()
    scene = bpy.context.scene
    space = next(area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D").spaces.active
    space.shading.use_compositor = "CAMERA"
    scene.noisy_world.preview = True
    preview.flush()
    assert space.shading.use_compositor == "ALWAYS"
    space.shading.use_compositor = "DISABLED"  # by hand: left alone
    scene.noisy_world.preview_split = 0.5
    preview.flush()
    assert space.shading.use_compositor == "DISABLED"
    scene.noisy_world.preview = False
    preview.flush()
    assert space.shading.use_compositor == "CAMERA"
    assert views.FORMER not in bpy.context.window.screen


def test_without_a_graphics_card_the_processor_composites_while_it_is_on(scene, monkeypatch):
    for software, expected in ((True, "CPU"), (False, "GPU")):
        monkeypatch.setattr(frame_preview, "is_software_gl", lambda software=software: software)
        scene.render.compositor_device = "GPU"
        scene.noisy_world.preview = True
        preview.flush()
        assert scene.render.compositor_device == expected
        scene.noisy_world.preview = False
        preview.flush()
        assert scene.render.compositor_device == "GPU"
    monkeypatch.setattr(frame_preview, "is_software_gl", lambda: True)
    scene.noisy_world.preview = True
    preview.flush()
    with pytest.raises(NoisyWorldError, match="there is none here: choose Processor"):
        frame_preview.compositor_device(SimpleNamespace(render=SimpleNamespace(compositor_device="gpu")))
    scene.render.compositor_device = "GPU"  # by hand: left alone
    scene.noisy_world.preview_split = 0.5
    preview.flush()
    assert scene.render.compositor_device == "GPU"


def test_what_falsifies_a_preview_is_said_and_mended(scene):
    view = scene.view_settings
    view.view_transform = "AgX"
    view.exposure, view.gamma, view.use_curve_mapping = 0.5, 1.2, True
    assert len(preview.falsified_by(scene)) == 4
    assert bpy.ops.noisy_world.use_standard_view() == {"FINISHED"}
    assert preview.falsified_by(scene) == []
    assert not bpy.ops.noisy_world.use_standard_view.poll()


def test_the_chain_follows_before_blender_draws(scene):
    fog = add(scene, "fog")
    scene.noisy_world.preview = True
    preview.flush()
    before = shown_chain(scene).nodes["Fog"].inputs["Severity"].default_value
    fog.severity = 5.0
    assert shown_chain(scene).nodes["Fog"].inputs["Severity"].default_value != before
    preview.flush()
    assert preview._follow() is None


def test_a_copied_scene_has_a_chain_of_its_own_which_undo_leaves_alone(scene):
    add(scene, "fog")
    scene.noisy_world.preview = True
    bpy.ops.scene.new(type="LINK_COPY")
    copy = bpy.context.scene
    assert copy != scene
    assert shown_chain(copy) == shown_chain(scene)
    add(copy, "gaussian_noise")
    chains = [shown_chain(item) for item in (scene, copy)]
    assert ["Gaussian Noise" in chain.nodes for chain in chains] == [False, True]
    preview._touch_all()
    preview.flush()
    assert [shown_chain(item) for item in (scene, copy)] == chains


def _copied(scene):
    scene.copy()


def _group_deleted(scene):
    bpy.data.batch_remove([next(tree for tree in bpy.data.node_groups if tree.name == "Fog")])


def _action_deleted(scene):
    bpy.data.batch_remove([shown_chain(scene).animation_data.action])


def _step_added_unseen(scene):
    with notify_once():
        add(scene, "contrast")
        fields._collected[-1].clear()


def _switched_off_unseen(scene):
    with notify_once():
        scene.noisy_world.preview = False
        fields._collected[-1].clear()


@pytest.mark.parametrize("damage", [_copied, _group_deleted, _action_deleted, _step_added_unseen, _switched_off_unseen])
def test_after_undo_no_data_block_is_made_or_removed_but_by_the_button(scene, damage):
    """Blender crashes at the next undo where what is made outside its steps is pointed to by what looks the same."""
    add(scene, "fog")
    scene.noisy_world.preview = True
    preview.flush()
    assert not bpy.ops.noisy_world.update_preview.poll()
    damage(scene)
    before = data_blocks()
    preview._touch_all()
    preview.flush()
    assert data_blocks() == before
    wrong = [item for item in bpy.data.scenes if item.session_uid in preview._unmade]
    assert len(wrong) == 1
    with bpy.context.temp_override(scene=wrong[0], view_layer=wrong[0].view_layers[0]):
        assert bpy.ops.noisy_world.update_preview() == {"FINISHED"}
        assert not bpy.ops.noisy_world.update_preview.poll()
    assert [shown_chain(item) is not None for item in bpy.data.scenes] == [
        item.noisy_world.preview for item in bpy.data.scenes
    ]


def data_blocks():
    """What is in the file, by numbers that Blender gives once."""
    kinds = (bpy.data.node_groups, bpy.data.actions, bpy.data.images, bpy.data.scenes)
    return {item.session_uid for kind in kinds for item in kind}


def test_a_severity_that_is_keyed_changes_values_alone(scene):
    fog = add(scene, "fog")
    scene.noisy_world.preview = True
    preview.flush()
    before = data_blocks()
    for frame, severity in ((0, 1.0), (4, 5.0)):
        fog.severity = severity
        scene.keyframe_insert("noisy_world.steps[0].severity", frame=frame)
    preview._touch_later(scene)
    preview.flush()
    chain = shown_chain(scene)
    assert {item.session_uid for item in bpy.data.actions} - before == {scene.animation_data.action.session_uid}
    path = chain.nodes["Fog"].inputs["Severity"].path_from_id("default_value")
    (curve,) = (curve for curve in action_bag(chain).fcurves if curve.data_path == path)
    assert [curve.evaluate(frame) for frame in (0, 4)] == [1.0, 5.0]


def test_nothing_runs_while_it_is_off_and_nothing_stays_behind(scene):
    preview._resume()
    preview._follow()
    bpy.app.timers.unregister(preview._follow)
    add(scene, "fog").severity = 4.0
    assert not bpy.app.timers.is_registered(preview._follow)
    scene.noisy_world.preview = True
    assert shown_chain(scene) is not None  # at once: made later, it were in no step of undo
    assert bpy.app.timers.is_registered(preview._follow)
    preview.flush()
    preview.unregister()
    try:
        assert not bpy.app.timers.is_registered(preview._follow)
        assert not bpy.app.timers.is_registered(preview._resume)
        assert scene.compositing_node_group is None
        assert PREVIOUS not in scene
        assert properties.LISTENERS == []
        assert preview._touch_all not in bpy.app.handlers.undo_post[:]
    finally:
        preview.register()


# --- paths ---


def test_paths_are_those_that_are_rendered(scene):
    cycles_scene((0, 0, 0))
    assert drawn_paths.clean_poses(scene) is None
    c2w = np.repeat(np.eye(4)[None], 30, axis=0)
    c2w[:, 0, 3] = np.linspace(0, 3, 30)
    scene.camera[drawn_paths.CLEAN_C2W] = c2w.ravel().tolist()
    assert np.array_equal(drawn_paths.clean_poses(scene), c2w)
    assert drawn_paths.deviated_poses(scene, c2w) is None
    scene.noisy_world.deviation_translation_m = 0.05
    step = steps_of({"motion_deviation": {"rotation_deg": 0.0, "translation_m": 0.05}})[0]
    expected = move([step], Trajectory(c2w, np.arange(30.0)), IDENTIFIERS).c2w
    assert np.abs(drawn_paths.deviated_poses(scene, c2w) - expected).max() < 3e-9  # what is rendered is rounded


def test_a_recording_that_cannot_be_read_leaves_the_path_that_was_loaded_before(scene):
    drawn = drawn_paths.Drawn((), None, None, np.repeat(np.eye(4)[None], 3, axis=0))
    scene.noisy_world.mesh_source = "RECORDING"
    refused(drawn_paths.current_row, scene, 3, names="folder")
    assert drawn_paths._carried(scene, drawn, None) == []


def test_lines_go_along_the_path_and_where_the_camera_looks():
    c2w = np.repeat(np.eye(4)[None], 3, axis=0)
    c2w[:, 0, 3] = (0, 1, 2)
    lines = drawn_paths.path_lines(c2w, np.array([0.0, 0.0, 1.0]))
    assert lines[:4, 0].tolist() == [0, 1, 1, 2]
    assert lines[4:, 2].tolist() == pytest.approx([-1, -0.95] * 3)
    assert len(drawn_paths.path_lines(c2w[:1], np.zeros(3))) == 2
