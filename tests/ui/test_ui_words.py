# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers and words of the tab: angles, labels, spelling, and errors in the words of its fields."""

import math
from dataclasses import fields
from pathlib import Path
from typing import Literal, get_args, get_origin, get_type_hints

import bpy
import numpy as np
import pytest
from panel_tools import groups_of, own_classes, settings
from preview_tools import add

from noisy_world.core.depth_range import DepthRange
from noisy_world.dataset.folder_state import ELSEWHERE, PROCESSORS, other_dataset
from noisy_world.layouts.replica import ReplicaLayout
from noisy_world.core.errors import InputError, StorageError
from noisy_world.core.errors import american, parameter_label
from noisy_world.core.errors import Action, CommandLineOnly, Message, PresetKey, either
from noisy_world.perturbations.groups import socket_name
from noisy_world.perturbations.kinds import ColourPerturbation
from noisy_world.core.schema import label_of, tooltip_of
from noisy_world.perturbations import registry
from noisy_world.sources import preset_leaves
from noisy_world.perturbations.shipped.defocus_depth import DefocusDepth
from noisy_world.nodes.datablocks import fcurves_of
from noisy_world.panel import gallery, older_files, sections
from noisy_world.panel.fields import SECTIONS, SHOWN
from noisy_world.panel.document import PANEL, to_document
from noisy_world.panel.generating import NoisyWorldGenerate, NoisyWorldGenerateAnew
from noisy_world.panel.entries import LONG, parts_of
from noisy_world.panel.tree import property_name, set_value, value_of
from noisy_world.panel.wording import ACTIONS, field_of, noted, spoken

pytestmark = pytest.mark.usefixtures("add_on")


def scene():
    return bpy.context.scene


def test_angles_are_radians_in_blender_and_come_back_as_typed():
    rng = np.random.default_rng(5)
    step = add(scene(), "motion_blur")
    for digits in (0, 1, 2, 3, 5):
        for typed in [0.0, 90.0, 0.1, 7.0, *np.round(rng.uniform(0, 180, 40), digits).tolist()]:
            set_value(settings(), "deviation_rotation_deg", typed)
            assert settings().deviation_rotation == np.float32(math.radians(typed))
            assert value_of(settings(), "deviation_rotation_deg") == typed
            settings().exact = ""
            if digits < 4:  # as typed into the field
                assert value_of(settings(), "deviation_rotation_deg") == typed
    assert step.motion_blur.bl_rna.properties["angle"].subtype == "ANGLE"
    assert settings().scene.trajectory.handheld.bl_rna.properties["speed_m_s"].unit == "VELOCITY"


def test_angles_that_older_files_hold_in_degrees_are_taken():
    add(scene(), "motion_blur")
    stored = scene().bl_system_properties_get()["noisy_world"]
    stored["deviation_rotation_deg"], stored["steps"][0]["motion_blur"] = 3.7, {"angle_deg": 25.0}
    older_files._on_load()
    assert value_of(settings(), "deviation_rotation_deg") == 3.7
    assert [step.perturbation for step in settings().steps] == ["motion_deviation", "motion_blur"]
    assert value_of(settings().steps[1].motion_blur, "angle_deg") == 25.0
    set_value(settings(), "deviation_rotation_deg", 1.0)
    older_files._on_load()  # only once
    assert value_of(settings(), "deviation_rotation_deg") == 1.0


def test_what_older_files_hold_in_a_list_of_fields_is_taken_over():
    """The values as a panel of one list of fields stored them: numbers of choices, radians, 1 for what is on."""
    step = add(scene(), "fog")
    step.keyframe_insert("severity", frame=1)
    stored = scene().bl_system_properties_get()["noisy_world"]
    held = {
        "seed": 99, "mesh_source": 1, "mesh_path": "/a/b.ply", "scene_name": "kitchen", "trajectory_source": 1,
        "trajectory_path": "/a/t.txt", "trajectory_axes": 2, "body": 4, "body_motion": 2.5, "every": 3,
        "deviation_rotation": math.radians(3.0), "speed_factor": 2, "width_px": 320, "fx_px": 123.4, "distorts": 1,
        "distortion_k1": -0.25, "has_imu": 1, "imu_device": 2, "imu_y_m": 0.3, "engine": 1, "samples": 4, "layout": 1,
        "use_normal": 1, "setting_name": "mine", "lens_source": 0,
    }  # fmt: skip
    for name, value in held.items():
        stored[name] = value
    for name in [name for name in stored if name.startswith("use_") and name != "use_normal"]:
        del stored[name]
    stored["steps"][0]["fog"] = {"override_thickness": 1, "thickness": 1.25, "uniform": 1}
    older_files._on_load()
    said = to_document(settings())
    (path,) = [item["trajectory"] for item in said["scenes"] if (item["name"], item["mesh"]) == ("kitchen", "/a/b.ply")]
    assert path == {"file": "/a/t.txt", "axes": "opengl", "body": {"kind": "rover", "motion": 2.5}, "every": 3}
    assert (said["seed"], said["camera"]["width"], said["camera"]["fx"]) == (99, 320, 123.4)
    assert said["camera"]["distortion"] == {"model": "radial-tangential", "k1": -0.25}
    assert said["rig"] == {"imu": {"device": "bmi055", "translation_m": [0.0, 0.3, 0.0]}}
    assert said["render"] == {"engine": "eevee", "samples": 4}
    assert said["output"] == {"layout": "tum", "modalities": ["rgb", "depth", "normal"]}
    (clean, own) = said["settings"]
    assert (clean, own["name"]) == ({"name": "clean"}, "mine")
    moved, faster, fog = own["perturb"]
    assert moved == {"motion_deviation": {"rotation_deg": 3.0, "translation_m": 0.0}}
    assert faster == {"faster_motion": {"factor": 2}}
    assert fog["fog"] == {"severity": 3.0, "thickness": 1.25, "uniform": True}
    assert keyed_curves(scene()) == ["noisy_world.steps[2].severity"], "which follows its entry"


def keyed_curves(scene):
    return [curve.data_path for curve in fcurves_of(scene.animation_data)]


def test_panel_socket_and_preset_use_the_same_word():
    step = add(scene(), "snow")
    for perturbation in registry().values():
        group = getattr(step, perturbation.name)
        for item in fields(perturbation.parameters):
            label = group.bl_rna.properties[property_name(item.name)].name
            label = label.partition(" (")[0]
            assert label == label_of(perturbation.parameters, item.name)
            if isinstance(perturbation, ColourPerturbation) and perturbation.nodes:
                assert socket_name(perturbation, item.name) == label
            assert tooltip_of(perturbation.parameters, item.name) != item.metadata["key"].meaning
    assert (parameter_label("std"), label_of(DefocusDepth, "f_number")) == ("Std", "F-Stop")


def test_the_interface_is_spelt_as_blenders():
    step = add(scene(), "snow")
    groups = (settings(), step, *(getattr(step, name) for name in registry()))
    texts = [text for group in groups for item in group.bl_rna.properties for text in (item.name, item.description)]
    classes = own_classes(bpy.types.Operator, bpy.types.Menu, bpy.types.Panel, bpy.types.UIList)
    texts += [text for cls in classes for text in (cls.__doc__ or "", getattr(cls, "bl_label", ""))]
    assert len(texts) > 300
    assert [text for text in texts if american(text) != text] == []
    assert (
        american("Grey colours of /data/colour/grey.ply and grey_room")
        == "Gray colors of /data/colour/grey.ply and grey_room"
    )


FILE = "/t/noisy_world.yaml"


def wrong(where, *problem, remedy="", file=PANEL):
    return InputError(file, Message(*problem), where=where, remedy=remedy)


@pytest.mark.parametrize(
    ("error", "told", "said"),
    [
        (wrong("camera.far_m", "is 1 m, not beyond ", PresetKey("near_m")),
         f"{PANEL}: camera.far_m: is 1 m, not beyond near_m", "Camera > Far: is 1 m, not beyond Near"),
        (wrong("scenes.0.mesh", "is missing", file=FILE),
         f"{FILE}: scenes.0.mesh: is missing", "Scene > Mesh File: is missing"),
        (wrong("perturbations.0.fog.severity", "is 7"), ": is 7", "Fog > Severity: is 7"),
        (wrong("settings.1.perturb.2.snow.blur_radius_px", "is -1"), ": is -1", "Snow > Blur Radius: is -1"),
        (wrong("output.colour", "is grey"), "output.colour: is grey", "Render and Output > Channels: is gray"),
        (wrong("scenes.0.blend", "is gone", remedy=CommandLineOnly("see --list keys")),
         "is gone; see --list keys", "This Scene: is gone"),
        (wrong("rig.depth", "is none", remedy=Action.OTHER_NAME), "rig.depth: is none; give it another name",
         "Rig and Sensors > Depth: is none; give Scene > Name or Generate > Setting another name"),
        (wrong("", "its lens distorts", remedy=Message("set ", PresetKey("undistort", "true"))),
         "; set undistort: true", "its lens distorts; set Scene > Undistort: On"),
        (StorageError("no space", file="/d", remedy=Message("make room and ", Action.RUN_AGAIN, ": all is kept")),
         "/d: no space; make room and run the same command again: all is kept",
         "/d: no space; make room and press Generate again: all is kept"),
        (StorageError("is no folder", file="/d", remedy=Action.OTHER_FOLDER), "choose another folder with --out",
         "/d: is no folder; choose another folder under Output"),
        (other_dataset(Path("/d"), Message(PresetKey("seed"), " was 1", either(PROCESSORS, *ELSEWHERE))),
         "set render.processors: any where frames of unlike processors, within 1/255 of each other, are good enough, "
         "choose another folder with --out, or replace the dataset with --overwrite",
         "/d: holds another dataset: Seed was 1; set Render and Output > Processors: Any where frames of unlike "
         "processors, within 1/255 of each other, are good enough, choose another folder under Output, or press "
         "Replace Dataset"),
        (wrong("line 3, column 1", "is no YAML; near_m", file="/data/near_m/grey.ply"),
         "/data/near_m/grey.ply: line 3, column 1: ", "/data/near_m/grey.ply: line 3, column 1: is no YAML; near_m"),
    ],
)  # fmt: skip
def test_errors_speak_of_fields_and_buttons(error, told, said):
    assert told in str(error)
    assert spoken(error.message, FILE) == said


def test_the_buttons_that_messages_name_are_there():
    assert set(ACTIONS) == set(Action)
    assert NoisyWorldGenerateAnew.bl_label in ACTIONS[Action.OVERWRITE]
    assert NoisyWorldGenerate.bl_label in ACTIONS[Action.RUN_AGAIN]
    assert settings().bl_rna.properties["output_folder"].name in ACTIONS[Action.OTHER_FOLDER]
    for key in ("scenes.0.name", "settings.1.name"):
        assert field_of(key) in ACTIONS[Action.OTHER_NAME]


def test_fields_are_called_as_the_tab_shows_them():
    titles = {cls.bl_label for cls in sections.CLASSES if issubclass(cls, bpy.types.Panel)}
    labels = {item.name.partition(" (")[0] for group in groups_of(settings()) for item in group.bl_rna.properties}
    shown = [shown.label.split(" > ") for (cls, _), shown in SHOWN.items() if cls in SECTIONS and " > " in shown.label]
    assert {section for section, _ in shown} <= titles
    assert {label for _, label in shown} <= labels
    assert len(shown) > 40


def test_each_choice_of_the_tab_has_the_words_of_its_own_field():
    shown = [(cls, name) for cls, name in SHOWN if _values(cls, name)]
    assert len(shown) > 25
    for cls, name in shown:
        info = next(item for item in fields(cls) if item.name == name).metadata["key"]
        assert tuple(info.choices or ()) == _values(cls, name), (cls, name)
        assert all(item.label and item.meaning for item in info.choices.values()), (cls, name)
    step, panel = add(scene(), "fog_depth"), settings()
    air, camera = _tooltips(step.fog_depth, "air"), _tooltips(panel.output, "colour")
    assert "airlight" in air["grey"].lower()
    assert "channel" in camera["grey"].lower()
    assert "lit" in air["auto"].lower().split()
    assert "opencv" in _tooltips(panel.scene.trajectory, "axes")["auto"].lower()
    assert "lit" not in _tooltips(panel.scene.trajectory, "axes")["auto"].lower().split()


def _values(cls, name):
    hint = get_type_hints(cls)[name]
    return next((get_args(item) for item in (hint, *get_args(hint)) if get_origin(item) is Literal), ())


def _tooltips(group, name):
    """The tooltip that Blender shows for each value of a property."""
    return {item.identifier: item.description for item in group.bl_rna.properties[name].enum_items}


def test_every_key_of_a_preset_is_told_as_a_field_or_a_section():
    titles = {cls.bl_label for cls in own_classes(bpy.types.Panel)} | {"This Scene"}
    for key, _ in preset_leaves():
        label = field_of(key.replace("[]", ".0"))
        assert label.partition(" > ")[0] in titles, (key, label)


def test_keys_in_notes_are_named_as_fields():
    note = Message("room: no file says time stamps: 30 frames a second, or ", PresetKey("rate_hz"))
    assert noted(note) == "Room: no file says time stamps: 30 frames a second, or Frame Rate"
    assert noted(ReplicaLayout().image_note("png")).endswith("set Render and Output > Images: JPEG for them")
    told = DepthRange(6553.5, "void").with_remedy("far", 100.0)
    held = "500 holds 131 m in steps of 2 mm"
    assert told == f"far; output.depth_scale_per_m: {held}, or output.depth_beyond: farthest makes them 10 m"
    output = "Render and Output >"
    assert noted(told) == f"Far; {output} Depth Scale: {held}, or {output} Beyond Range: Farthest makes them 10 m"


def test_every_perturbation_is_offered_once_and_said_in_a_sentence():
    lists = [gallery.offered(chosen) for chosen in (gallery.PHYSICAL, gallery.BENCHMARK, gallery.PACKAGES)]
    names = [item.name for found in lists for item in found]
    assert sorted(names) == sorted(registry())
    physical = {item.name for item in lists[0]}
    twins = {item.name: item.about.twin for item in lists[1] if item.about.twin}
    assert set(twins.values()) <= physical
    assert {"fog", "snow", "frost", "spatter"} <= set(twins)
    for item in registry().values():
        assert not set("*=^()").intersection(item.about.sentence), item.name
    assert gallery.line_on(registry()["fog"]).endswith("Its physical twin is Fog by Depth")


def test_long_lists_of_parameters_have_sub_panels_and_nothing_is_left_out():
    for perturbation in registry().values():
        first, rest = parts_of(perturbation)
        names = [item.name for item in fields(perturbation.parameters)]
        assert sorted([*first, *(name for found in rest.values() for name in found)]) == sorted(names)
        assert bool(rest) == (len(names) > LONG)
        assert set(perturbation.severities) <= set(first)
    first, rest = parts_of(registry()["snow_depth"])
    assert (first, list(rest)) == (["rate_mm_h"], ["Look", "Motion", "Camera"])
    assert {"wind_m_s", "shutter_ms"} <= set(rest["Motion"])
    assert {"aperture_mm", "view_deg"} <= set(rest["Camera"])
