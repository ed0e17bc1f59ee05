# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers and words of the tab: angles, labels, spelling, and errors in the words of its fields."""

import math
from dataclasses import fields

import bpy
import numpy as np
import pytest
from panel_tools import settings
from preview_tools import add

from noisy_world.core.labels import american, parameter_label
from noisy_world.core.node_graphs.groups import socket_name
from noisy_world.core.perturbing.kinds import ColourPerturbation
from noisy_world.perturbations import registry
from noisy_world.ui import older_files, tooltips
from noisy_world.ui.typed_numbers import property_name, set_value, value_of
from noisy_world.ui.wording import spoken

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
    assert settings().bl_rna.properties["handheld_speed_m_s"].unit == "VELOCITY"


def test_angles_that_older_files_hold_in_degrees_are_taken():
    step = add(scene(), "motion_blur")
    stored = scene().bl_system_properties_get()["noisy_world"]
    stored["deviation_rotation_deg"], stored["steps"][0]["motion_blur"] = 3.7, {"angle_deg": 25.0}
    older_files._on_load()
    assert value_of(settings(), "deviation_rotation_deg") == 3.7
    assert value_of(step.motion_blur, "angle_deg") == 25.0
    set_value(settings(), "deviation_rotation_deg", 1.0)
    older_files._on_load()  # only once
    assert value_of(settings(), "deviation_rotation_deg") == 1.0


def test_panel_socket_and_preset_use_the_same_word():
    step = add(scene(), "snow")
    for perturbation in registry().values():
        group = getattr(step, perturbation.name)
        for item in fields(perturbation.parameters):
            label = group.bl_rna.properties[property_name(item.name)].name
            assert label.partition(" (")[0] == parameter_label(item.name)
            if isinstance(perturbation, ColourPerturbation):
                assert socket_name(item.name) == parameter_label(item.name)
            assert tooltips.seen(perturbation.name, item.name), (perturbation.name, item.name)
    assert (parameter_label("std"), parameter_label("f_number")) == ("Std", "F-Stop")


def test_the_interface_is_spelt_as_blenders():
    from noisy_world import ui

    step = add(scene(), "snow")
    groups = (settings(), step, *(getattr(step, name) for name in registry()))
    texts = [text for group in groups for item in group.bl_rna.properties for text in (item.name, item.description)]
    classes = [cls for module in ui.modules() for cls in getattr(module, "CLASSES", ())]
    texts += [text for cls in classes for text in (cls.__doc__ or "", getattr(cls, "bl_label", ""))]
    assert len(texts) > 300
    assert [text for text in texts if american(text) != text] == []
    assert (
        american("Grey colours of /data/colour/grey.ply and grey_room")
        == "Gray colors of /data/colour/grey.ply and grey_room"
    )


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ("Noisy World panel: camera.far_m: is 1 m, not beyond near_m", "Camera > Far: is 1 m, not beyond Near"),
        ("Noisy World panel: scenes.0.mesh: is missing", "Scene: is missing"),
        ("Noisy World panel: perturbations.0.fog.severity: is 7", "Fog > Severity: is 7"),
        ("Noisy World panel: settings.1.perturb.2.snow.blur_radius_px: is -1", "Snow > Blur Radius: is -1"),
        (
            "/d: seed was 1, is 4; choose another folder with --out, or replace the dataset with --overwrite",
            "/d: seed was 1, is 4; choose another folder under Output, or Replace Dataset",
        ),
        ("/t/noisy_world.yaml: output.colour: is grey", "Render and Output > Channels: is gray"),
        ("/d: no space; make room there and run the same command again: finished frames are kept",
         "/d: no space; make room there and press Generate again: finished frames are kept"),
        ("/data/near_m/grey.ply: not there", "/data/near_m/grey.ply: not there"),
    ],
)  # fmt: skip
def test_errors_speak_of_fields_and_buttons(told, said):
    assert spoken(told, "/t/noisy_world.yaml") == said
