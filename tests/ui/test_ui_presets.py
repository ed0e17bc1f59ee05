# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets in the tab: taken in, saved and kept; what the panel cannot show is refused."""

import json
import math
from pathlib import Path

import bpy
import pytest
from refusals import refused
from cases import cases
from panel_tools import leave_one_sensor, open_document, settings, use_files

from noisy_world.panel import runs
from noisy_world.panel.document import open_preset, perturb_of, save_preset, steps_of, to_document
from noisy_world.panel.open_scene import output_folder
from noisy_world.panel.runs import saved_preset
from noisy_world.perturbations.parsing import parse_settings
from noisy_world.preset.keys import read_preset
from noisy_world.perturbations import registry
from noisy_world.sources import read_scenes

pytestmark = pytest.mark.usefixtures("add_on")

PRESETS = sorted((Path(__file__).resolve().parents[2] / "presets").rglob("*.yaml"))


def parsed(preset):
    return {item.name: item for item in parse_settings(
        preset.spec.settings, preset.setting_places, registry(), preset.spec.render.backend
    )}  # fmt: skip


def test_the_preset_that_is_shown_is_the_file_that_a_run_continues():
    for name in ("demo", "real_camera", "noisy_rooms", "study"):
        (path,) = [path for path in PRESETS if path.stem == name]
        open_preset(settings(), path)
        assert saved_preset(settings()) == path
        settings().seed += 1
        assert saved_preset(settings()) is None


def test_a_preset_without_a_camera_says_what_the_panel_then_shows(tmp_path):
    path = tmp_path / "short.yaml"
    path.write_text(json.dumps({key: value for key, value in to_document(settings()).items() if key != "camera"}))
    open_preset(settings(), path)
    assert saved_preset(settings()) == path
    settings().camera.width -= 1
    assert saved_preset(settings()) is None


def test_what_the_files_are_written_as_is_kept(tmp_path):
    document = {
        "scenes": [{"mesh": "embedded:room", "trajectory": {"handheld": {"frames": 3}}}],
        "output": {"layout": "euroc", "colour": "rgb", "depth_scale_per_m": 1000.1, "depth_beyond": "farthest"},
    }
    open_document(document, tmp_path / "p.yaml")
    assert to_document(settings())["output"] == document["output"]
    save_preset(settings(), tmp_path / "saved.yaml")
    settings().output.layout = "replica"
    open_preset(settings(), tmp_path / "saved.yaml", "clean")
    assert to_document(settings())["output"] == document["output"]
    # What a preset leaves to the layout is the layout's own, not what the panel showed before.
    open_document({**document, "output": {"layout": "tum"}}, tmp_path / "p.yaml")
    output = settings().output
    assert (output.colour, output.depth_scale_per_m, output.depth_beyond) == ("rgb", 5000.0, "void")
    assert to_document(settings())["output"] == {"layout": "tum"}


def test_a_layout_brings_what_its_readers_expect():
    from noisy_world.layouts import LAYOUTS

    made = settings().output
    assert (made.image, made.colour, made.depth_scale_per_m) == ("jpg", "rgb", 6553.5)
    made.layout = "euroc"
    assert (made.image, made.colour, made.depth_scale_per_m) == ("png", "grey", 5000.0)
    made.layout = "replica"
    assert (made.image, made.colour, made.depth_scale_per_m) == ("jpg", "rgb", 6553.5)
    items = made.bl_rna.properties["layout"].enum_items
    assert [item.identifier for item in items] == list(LAYOUTS)
    assert items["euroc"].name == "EuRoC ASL"
    assert items["replica"].description == "Of iMAP and NICE-SLAM; JPEG, PNG or EXR"


def test_what_cannot_be_read_leaves_the_panel_as_it_is(tmp_path):
    document = {"scenes": [{"mesh": "embedded:room", "trajectory": {"handheld": {"frames": 3}}}], "seed": 5}
    settings().seed = 77
    before = to_document(settings())
    steps = [{"name": "x", "perturb": [{"fog": {"severity": 9}}]}]
    refused(open_document, document | {"settings": steps}, tmp_path / "p.yaml", names="settings.0.perturb.0.fog")
    refused(open_document, document | {"scenes": [{"mesh": "a.ply"}]}, tmp_path / "p.yaml", names="trajectory")
    assert to_document(settings()) == before


def test_own_presets_are_kept_where_blender_keeps_them(tmp_path, monkeypatch):
    monkeypatch.setattr(bpy.utils, "user_resource", lambda *_, **words: str(tmp_path / words["path"]))
    settings().seed = 12
    assert bpy.ops.noisy_world.add_preset(name="Mine") == {"FINISHED"}
    path = tmp_path / "presets/noisy_world/Mine.yaml"
    assert settings().preset_path == str(path)
    refused(bpy.ops.noisy_world.add_preset, name="Mine", names="name", error=RuntimeError)
    refused(bpy.ops.noisy_world.add_preset, name="../Mine", names="../Mine", error=RuntimeError)
    settings().seed = 3
    assert bpy.ops.noisy_world.use_preset(filepath=str(path)) == {"FINISHED"}
    assert settings().seed == 12
    assert bpy.ops.noisy_world.remove_preset() == {"FINISHED"}
    assert not path.exists()
    assert not bpy.ops.noisy_world.remove_preset.poll()


def test_paths_beside_a_preset_are_relative_in_it(tmp_path):
    use_files(tmp_path)
    save_preset(settings(), tmp_path / "kitchen.yaml")
    (scene,) = read_scenes(read_preset(tmp_path / "kitchen.yaml"))
    assert (scene.keys.mesh, scene.keys.trajectory.file) == ("square.ply", "traj.txt")
    settings().of_mesh.mesh = ""
    open_preset(settings(), tmp_path / "kitchen.yaml")
    assert Path(settings().of_mesh.mesh) == tmp_path / "square.ply"


# --- perturbations alone ---

SINGLE = [path for path in PRESETS if path.parent.name == "perturbations"]


def use(path, **options):
    return bpy.ops.noisy_world.use_preset(filepath=str(path), **options)


def described():
    """What the panel holds but for what is done to a sequence, and the list apart."""
    rest = to_document(settings())
    rest.pop("settings")
    kept = [settings().preset_path, settings().preset_settings, settings().setting.name]
    return (rest, kept), {name: values for item in perturb_of(settings()) for name, values in item.items()}


@pytest.fixture
def of_ones_own(tmp_path):
    """A scene, a path, a camera and perturbations of one's own in the panel."""
    use_files(tmp_path)
    item = settings()
    item.scene.name, item.seed, item.camera.width, item.output.layout = "kitchen", 12, 333, "tum"
    item.preset_path, item.setting.name = str(tmp_path / "mine.yaml"), "rough"
    item.deviation_rotation, item.speed_factor = math.radians(1.5), 3
    for name, severity in (("contrast", 2.0), ("spatter", 4.0), ("depth_gaussian_noise", 1.0)):
        bpy.ops.noisy_world.add_step(perturbation=name)
        item.steps[item.active_step].severity = severity
    return item


@cases("path", SINGLE)
def test_a_shipped_perturbation_leaves_everything_else_alone(of_ones_own, path):
    leave_one_sensor(of_ones_own, name := path.stem)
    rest, before = described()
    assert use(path) == {"FINISHED"}
    again, after = described()
    assert again == rest
    assert set(after) == {*before, name}
    assert {other: values for other, values in after.items() if other != name} == {
        other: values for other, values in before.items() if other != name
    }
    (first,) = [setting for setting in parsed(read_preset(path)).values() if setting.steps][:1]
    (step,) = first.steps
    wanted = step.parameters(step.severity)
    (made,) = [item for item in steps_of_panel() if item.perturbation.name == name]
    assert made.parameters(made.severity) == wanted
    order = [item.perturbation.name for item in steps_of_panel()]
    assert order == sorted(order, key=list(registry()).index)


def steps_of_panel():
    return steps_of(settings())


def test_a_perturbation_that_is_there_is_set_and_nothing_of_it_is_left(of_ones_own):
    bpy.ops.noisy_world.add_step(perturbation="fog")
    fog = of_ones_own.steps[of_ones_own.active_step]
    fog.severity, fog.enabled, fog.temporal, fog.fog.use_thickness, fog.fog.uniform = 5, False, "drift", True, True
    (path,) = [path for path in SINGLE if path.stem == "fog"]
    assert use(path, setting="fog_s3") == {"FINISHED"}
    (made,) = [item for item in of_ones_own.steps if item.perturbation == "fog"]
    assert described()[1]["fog"] == {"severity": 3.0}
    assert made.enabled
    assert of_ones_own.steps[of_ones_own.active_step] == made


def test_of_two_of_one_name_the_first_is_set(of_ones_own):
    bpy.ops.noisy_world.add_step(perturbation="spatter")
    of_ones_own.steps[of_ones_own.active_step].severity = 5.0
    (path,) = [path for path in SINGLE if path.stem == "spatter"]
    assert use(path) == {"FINISHED"}
    found = [(item.perturbation, item.severity) for item in of_ones_own.steps if item.perturbation == "spatter"]
    assert found == [("spatter", 1.0), ("spatter", 5.0)]


def test_two_of_one_name_set_the_two_of_that_name(of_ones_own, tmp_path):
    bpy.ops.noisy_world.add_step(perturbation="spatter")
    own = tmp_path / "own.yaml"
    own.write_text(
        "scenes: [{mesh: 'embedded:room', trajectory: {handheld: {frames: 3}}}]\n"
        "settings: [{name: x, perturb: [{spatter: {severity: 1}}, {spatter: {severity: 2}}]}]\n"
    )
    assert use(own, part="PERTURBATIONS") == {"FINISHED"}
    assert [item.severity for item in of_ones_own.steps if item.perturbation == "spatter"] == [1.0, 2.0]


def test_what_of_a_file_is_taken_can_be_chosen(of_ones_own, tmp_path, capfd):
    rest, before = described()
    own = tmp_path / "own.yaml"
    own.write_text(
        "scenes: [{mesh: 'embedded:room', trajectory: {handheld: {frames: 3}}}]\n"
        "settings:\n"
        "  - {name: x, perturb: [{fog: {severity: 2}}, {contrast: {severity: 5}}, {faster_motion: {factor: 2}}]}\n"
    )
    assert use(own, part="PERTURBATIONS") == {"FINISHED"}
    assert "Added Fog (severity 2); set Faster Motion, Contrast (severity 5); scene, path" in capfd.readouterr().out
    assert described() == (
        rest,
        before | {"fog": {"severity": 2.0}, "contrast": {"severity": 5.0}, "faster_motion": {"factor": 2}},
    )
    (fog,) = [path for path in SINGLE if path.stem == "fog"]
    assert use(fog, part="ALL") == {"FINISHED"}
    assert settings().mesh_source == "ROOM"
    assert "scene, path, camera, perturbations and output are the preset's" in capfd.readouterr().out
    assert list(described()[1]) == ["fog"]


def test_a_copy_of_a_shipped_perturbation_is_ones_own_and_whole(of_ones_own, tmp_path):
    (fog,) = [path for path in SINGLE if path.stem == "fog"]
    copy = tmp_path / "perturbations" / "fog.yaml"
    copy.parent.mkdir()
    copy.write_bytes(fog.read_bytes())
    assert use(copy) == {"FINISHED"}
    assert settings().mesh_source == "ROOM"


# --- home folders ---


def test_home_folders_in_the_panels_fields(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    use_files(tmp_path)
    item = settings()
    item.of_mesh.mesh, item.scene.trajectory.file, item.output_folder = "~/square.ply", "~/traj.txt", "~/sets/one"
    assert output_folder(item) == tmp_path / "sets/one"
    (scene,) = to_document(item)["scenes"]
    assert (scene["mesh"], scene["trajectory"]["file"]) == (str(tmp_path / "square.ply"), str(tmp_path / "traj.txt"))
    assert bpy.ops.noisy_world.load_scene() == {"FINISHED"}
    assert bpy.ops.noisy_world.save_preset(filepath="~/mine.yaml") == {"FINISHED"}
    assert item.preset_path == str(tmp_path / "mine.yaml")
    text = (tmp_path / "mine.yaml").read_text().replace("mesh: square.ply", "mesh: ~/square.ply")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "theirs.yaml").write_text(text.replace("file: traj.txt", "file: ~/traj.txt"))
    item.of_mesh.mesh = item.scene.trajectory.file = ""
    assert use("~/sub/theirs.yaml") == {"FINISHED"}
    assert (item.of_mesh.mesh, item.scene.trajectory.file) == (str(tmp_path / "square.ply"), str(tmp_path / "traj.txt"))
    open_preset(item, tmp_path / "sub" / "theirs.yaml")
    assert runs.saved_preset(item) == tmp_path / "sub" / "theirs.yaml"


def test_a_user_who_is_not_there_is_a_line(tmp_path):
    use_files(tmp_path)
    item = settings()
    item.output_folder = "~nobody-of-this-name/x"
    refused(bpy.ops.noisy_world.generate, names=["Output: ", "'nobody-of-this-name'"], error=RuntimeError)
    named = {"names": "'nobody-of-this-name'", "error": RuntimeError}
    refused(bpy.ops.noisy_world.save_preset, filepath="~nobody-of-this-name/x.yaml", **named)
    item.of_mesh.mesh = "~nobody-of-this-name/x.ply"
    refused(bpy.ops.noisy_world.load_scene, names=["Mesh File: ", "'nobody-of-this-name'"], error=RuntimeError)
