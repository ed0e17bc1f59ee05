# SPDX-License-Identifier: GPL-3.0-or-later
"""How one begins: a scene of Noisy World's own, Try It, dropped files, and sentences that are nowhere cut."""

import itertools

import bpy
import pytest
import yaml
from cases import cases
from panel_tools import Drawn, own_classes, settings, square, straight
from refusals import refused

from noisy_world.panel import beginning, document, exclusions, made_scene, presets, preview, sidebar, views
from noisy_world.panel.fields import notify_once

pytestmark = pytest.mark.usefixtures("add_on")


def view():
    (area,) = (area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D")
    return area.spaces.active


def state(scene):
    """All of a scene that a user would miss, and how the view shows it."""
    settings, display = scene.view_settings, scene.display.shading
    held = [[item.name for item in scene.objects], scene.camera, scene.world, scene.render.engine, scene.frame_end]
    held += [settings.view_transform, display.light, scene.compositing_node_group, sorted(scene.keys())]
    return held, document.to_document(scene.noisy_world), view().shading.type, view().region_3d.view_perspective


def small_preset(tmp_path, **more):
    path, _ = straight(tmp_path / "traj.txt", 3)
    scene = {"name": "small", "mesh": square(tmp_path / "square.ply"), "trajectory": {"file": path}}
    fog = {"name": "fog", "perturb": [{"fog": {"severity": 2, "temporal": "drift"}}]}
    (tmp_path / "small.yaml").write_text(
        yaml.safe_dump({"scenes": [scene], "settings": [{"name": "clean"}, fog], **more})
    )
    return tmp_path / "small.yaml"


def test_try_it_shows_a_preset_in_a_scene_of_its_own_and_the_users_stays(tmp_path, monkeypatch):
    small_preset(tmp_path)
    monkeypatch.setattr(beginning, "shipped_folder", lambda: tmp_path)
    monkeypatch.setattr(beginning, "TRIED", "small.yaml")
    own = bpy.context.scene
    before = state(own)
    assert beginning.is_unused(own)
    assert bpy.ops.noisy_world.try_it() == {"FINISHED"}
    made = bpy.context.scene
    assert made != own
    assert sorted(item.name for item in made.objects) == ["Noisy World Camera", "small"]
    assert views.falsified_by(made) == []
    assert exclusions.excluded(made) == ()
    assert exclusions.shows_dataset(made)
    preview.flush()
    assert (settings().preview, made.compositing_node_group is not None) == (True, True)
    assert (view().shading.type, view().region_3d.view_perspective) == ("RENDERED", "CAMERA")
    assert not any(item.select_get() for item in made.objects)
    assert not beginning.is_unused(made)
    assert bpy.ops.noisy_world.back() == {"FINISHED"}
    assert (bpy.context.scene, state(own)) == (own, before)
    refused(bpy.ops.noisy_world.back, names="your own", error=RuntimeError)


def test_what_is_tried_first_is_a_preset_that_is_shipped_and_moves():
    document.open_preset(settings(), beginning.shipped_folder() / beginning.TRIED)
    (step,) = settings().steps
    assert (settings().mesh_source, step.perturbation, step.temporal) == ("ROOM", "fog", "drift")


def test_what_is_loaded_by_a_button_stands_alone_and_again_in_the_same_scene(tmp_path):
    document.open_preset(settings(), small_preset(tmp_path))
    own = bpy.context.scene
    assert not made_scene.is_clear(own)
    assert bpy.ops.noisy_world.load_all(apart=True) == {"FINISHED"}
    made = bpy.context.scene
    made.noisy_world.steps[0].severity = 5  # of a panel of its own
    assert own.noisy_world.steps[0].severity == 2
    bpy.ops.noisy_world.back()
    own.noisy_world.steps[0].severity = 4
    assert bpy.ops.noisy_world.load_scene(apart=True) == {"FINISHED"}
    assert (bpy.context.scene, settings().steps[0].severity, len(bpy.data.scenes)) == (made, 4, 2)
    assert document.to_document(settings()) == document.to_document(own.noisy_world)
    assert made_scene.is_clear(made)
    bpy.data.scenes.remove(own)
    assert made_scene.origin_of(made) is None


def test_severities_stay_keyed_in_a_scene_of_ones_own_and_what_is_made_of_the_users_is_not_taken(tmp_path):
    document.open_preset(settings(), small_preset(tmp_path))
    own = bpy.context.scene
    step = settings().steps[0]
    for frame, severity in ((0, 1.0), (2, 3.0)):
        step.severity = severity
        step.keyframe_insert("severity", frame=frame)
    settings().preview = True
    bpy.ops.noisy_world.load_all(apart=True)
    made = bpy.context.scene
    assert document.perturb_of(made.noisy_world)[0]["fog"]["levels"] == [1.0, 2.0, 3.0]
    assert made.animation_data.action != own.animation_data.action
    preview.flush()
    assert (settings().preview, made.compositing_node_group) == (False, None)
    assert own.noisy_world.preview


def test_what_cannot_be_loaded_leaves_the_users_scene_and_makes_none(tmp_path):
    own, scenes = bpy.context.scene, len(bpy.data.scenes)
    before = state(own)
    refused(bpy.ops.noisy_world.drop_mesh, filepath=str(tmp_path / "none.ply"), names="none.ply", error=RuntimeError)
    assert (bpy.context.scene, len(bpy.data.scenes), state(own)) == (own, scenes, before)


def test_what_fails_after_a_change_can_be_undone_and_the_camera_keeps_its_action(tmp_path):
    # An undone file that points to an action which was removed between two steps ends Blender.
    document.open_preset(settings(), small_preset(tmp_path))
    bpy.ops.noisy_world.load_trajectory()
    bpy.ops.ed.undo_push(message="Load Trajectory")
    (action,), mesh, none = bpy.data.actions, settings().of_mesh.mesh, str(tmp_path / "none.ply")
    left = action.session_uid
    refused(bpy.ops.noisy_world.drop_mesh, filepath=none, names="none.ply", error=RuntimeError)
    for step, shown in ((None, none), (bpy.ops.ed.undo, mesh), (bpy.ops.ed.redo, none)):
        assert step is None or step() == {"FINISHED"}
        assert settings().of_mesh.mesh == shown
        (action,) = bpy.data.actions
        assert (action.session_uid, action.users) == (left, 1)
        assert bpy.context.scene.camera.animation_data.action == action


def test_files_that_are_dropped_on_a_view_are_loaded(tmp_path):
    mesh, path = square(tmp_path / "dropped.ply", size_m=4.0), small_preset(tmp_path, seed=3)
    handlers = {cls.bl_label: cls for cls in own_classes(bpy.types.FileHandler)}
    for handler, suffix, file in (("Mesh", ".ply", mesh), ("Preset", ".yaml", str(path))):
        cls = handlers[f"Noisy World {handler}"]
        assert suffix in cls.bl_file_extensions.split(";")
        bpy.ops.wm.read_factory_settings(use_empty=False)
        for area in bpy.context.window.screen.areas:
            with bpy.context.temp_override(area=area):
                assert cls.poll_drop(bpy.context) == (area.type == "VIEW_3D")
        name = cls.bl_import_operator.partition(".")[2]
        if handler == "Mesh":  # too small to walk in
            settings().trajectory_source, settings().scene.trajectory.file = "FILE", str(tmp_path / "traj.txt")
        assert getattr(bpy.ops.noisy_world, name)(filepath=file) == {"FINISHED"}
        assert made_scene.is_apart(bpy.context.scene)
    assert (settings().seed, settings().preview) == (3, True)
    one = presets.shipped_folder() / "perturbations/snow.yaml"
    assert bpy.ops.noisy_world.drop_preset(filepath=str(one)) == {"FINISHED"}
    assert [step.perturbation for step in settings().steps] == ["fog", "snow"]


CAMERA = {"width": 320, "height": 240, "fx": 250.0, "fy": 251.0, "cx": 159.5, "cy": 119.5, "distortion": {"k1": 0.1}}
DEVICE = {
    "camera": CAMERA,
    "depth": {"axial_noise": {"offset_m": 0.001}},
    "perturb": [{"gaussian_noise": {"std": 0.03}}],
}


@cases(
    ("parts", "names"),
    [
        ({"CAMERA", "DEPTH", "NOISE"}, {"camera", "rig", "settings"}),
        ({"DEPTH"}, {"rig"}),
    ],
)
def test_a_measured_devices_file_says_the_same_as_in_a_preset(tmp_path, parts, names):
    bpy.ops.wm.read_factory_settings(use_empty=False)
    (tmp_path / "measured.yaml").write_text(yaml.safe_dump(DEVICE))
    noisy = {"name": "perturbed", "perturb": [{"device": "measured.yaml"}]}
    named = {
        "camera": {"device": "measured.yaml"},
        "rig": {"depth": {"sensor": "measured.yaml"}},
        "settings": [{"name": "clean"}, noisy],
    }
    room = {"name": "room", "mesh": "embedded:room", "trajectory": {"handheld": {"frames": 40}}}
    (tmp_path / "preset.yaml").write_text(yaml.safe_dump({"scenes": [room]} | {name: named[name] for name in names}))
    assert bpy.ops.noisy_world.use_device_file(filepath=str(tmp_path / "measured.yaml"), parts=parts) == {"FINISHED"}
    taken = document.preset_of(settings()).spec
    document.open_preset(settings(), tmp_path / "preset.yaml")
    told = document.preset_of(settings()).spec
    assert (taken.mesh_camera, taken.rig, taken.settings[1:]) == (told.mesh_camera, told.rig, told.settings[1:])


@cases(
    ("content", "said"),
    [("[1", "is not valid YAML"), ("{width: 4}", "nothing of what is to be taken"), ("{depth: 3}", "depth")],
)
def test_a_file_of_no_device_is_refused_and_nothing_is_taken(tmp_path, content, said):
    (tmp_path / "other.yaml").write_text(content)
    before = document.to_document(settings())
    refused(bpy.ops.noisy_world.use_device_file, filepath=str(tmp_path / "other.yaml"), names=said, error=RuntimeError)
    assert document.to_document(settings()) == before


# --- sentences ---


@cases("width", [90.0, 140.0, 300.0])
def test_no_line_is_wider_than_its_place_and_nothing_is_lost(width):
    text = "Not in the dataset: Cube, WWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWWW and iiiiiiiiiiii; choose another"
    lines = sidebar.wrapped(text, width)
    assert max(map(sidebar.width_of, lines)) <= width
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")
    # As few lines as that takes: no first word of a line would have stood on the one before.
    for line, following in itertools.pairwise(lines):
        assert sidebar.width_of(f"{line} {following.split()[0]}") > width or len(following.split()[0]) > 30
    assert sidebar.wrapped("", width) == []


def test_the_next_step_is_one_button(tmp_path):
    class Buttons(Drawn):
        def operator(self, name, **_):
            self.names.append(name)
            return super().operator(name)

    def drawn():
        beginning.draw(layout := Buttons(), bpy.context)
        beginning.draw_missing(layout, bpy.context)
        return layout.names

    assert drawn() == ["noisy_world.try_it", "noisy_world.load_all"]
    document.open_preset(settings(), small_preset(tmp_path))
    assert drawn() == ["noisy_world.load_all"]
    bpy.ops.noisy_world.load_all(apart=True)
    assert drawn() == ["noisy_world.back"]
    with notify_once():
        settings().of_mesh.mesh = "another.ply"
    assert drawn() == ["noisy_world.back", "noisy_world.load_all"]
    settings().mesh_source = "SCENE"
    assert drawn() == ["noisy_world.back"]
