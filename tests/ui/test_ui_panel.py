# SPDX-License-Identifier: GPL-3.0-or-later
"""The tab's properties and operators: the list's order, the user's own file left alone, what registration leaves."""

import math
from dataclasses import fields
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from refusals import refused
from calls import calls_made
from keyed_poses import keyed_poses
from panel_tools import groups_of, own_classes, settings, use_files

import noisy_world
from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.perturbations.kinds import STAGES
from noisy_world.scenes.ply_writer import write_ply
from noisy_world import panel
from noisy_world.perturbations import registry
from noisy_world.panel.sidebar import width_of
from noisy_world.panel import fields as described, document, entries, sections, presets


# --- the list ---


pytestmark = pytest.mark.usefixtures("add_on")


def test_the_list_keeps_the_propagation_order():
    for name in reversed([item.name for item in registry().values() if item.stage != "motion"]):
        assert bpy.ops.noisy_world.add_step(perturbation=name) == {"FINISHED"}
    assert tuple(sections.STAGE_LABELS) == STAGES
    names = [step.perturbation for step in settings().steps]
    assert names == sorted(names, key=lambda name: (STAGES.index(registry()[name].stage), registry()[name].order))
    assert bpy.ops.noisy_world.add_step(perturbation="fog") == {"FINISHED"}
    assert names[:3] == ["rolling_shutter", "camera_motion_blur", "fog"]
    assert [step.perturbation for step in settings().steps][2:4] == ["fog", "fog"]
    assert settings().active_step == 3
    assert not bpy.ops.noisy_world.move_step_down.poll()
    settings().steps[3].severity = 5
    assert bpy.ops.noisy_world.move_step_up() == {"FINISHED"}
    assert (settings().steps[2].severity, settings().active_step) == (5, 2)
    refused(bpy.ops.noisy_world.add_step, perturbation="desync", names="once", error=RuntimeError)


def test_weather_drifts_when_it_is_added_and_the_preset_says_so():
    for name in ("fog", "frost", "snow_depth", "gaussian_noise", "contrast"):
        bpy.ops.noisy_world.add_step(perturbation=name)
    steps = {name: values for item in document.perturb_of(settings()) for name, values in item.items()}
    assert {name: values.get("temporal") for name, values in steps.items()} == {
        "fog": "drift",
        "frost": "drift",
        "snow_depth": "drift",
        "gaussian_noise": None,  # presets begin with fresh
        "contrast": None,
    }


def test_removing_all_leaves_nothing_selected():
    bpy.ops.noisy_world.add_step(perturbation="fog")
    assert bpy.ops.noisy_world.remove_step() == {"FINISHED"}
    assert not bpy.ops.noisy_world.remove_step.poll()
    assert not bpy.ops.noisy_world.move_step_up.poll()


def test_a_severity_is_one_that_presets_know():
    bpy.ops.noisy_world.add_step(perturbation="fog")
    step = settings().steps[0]
    step.severity = 0.3
    assert step.severity == 0
    step.severity = 2.4
    step.mode = "dynamic"
    assert step.severity == 2


def test_an_override_starts_at_the_severitys_value_and_what_is_off_is_left_out():
    from noisy_world.panel.document import steps_of

    bpy.ops.noisy_world.add_step(perturbation="fog")
    step = settings().steps[0]
    step.severity = 5
    step.fog.use_thickness = True
    assert step.fog.thickness == pytest.approx(registry()["fog"].at_severity(5).thickness)
    (done,) = steps_of(settings())
    assert done.given == {"thickness": 3.0}
    step.enabled = False
    assert steps_of(settings()) == ()


def test_three_parameters_that_are_a_colour_are_one_picker_which_sets_them():
    bpy.ops.noisy_world.add_step(perturbation="fog_depth")
    (step,) = settings().steps
    shown = []
    layout = SimpleNamespace(prop=lambda _, name, **__: shown.append(name))
    entries._draw_parameters(layout, step, registry()["fog_depth"], ("air", "air_red", "air_green", "air_blue"))
    assert shown == ["air", "air_colour"]
    step.fog_depth.air_red = 0.25
    assert tuple(step.fog_depth.air_colour) == (0.25, 0.800000011920929, 0.800000011920929)  # float32
    step.fog_depth.air_colour = (0.5, 0.25, 2.0)  # of lit scenes light is brighter than white
    ((_, values),) = document.perturb_of(settings())[0].items()
    assert {name: values[name] for name in values if name.startswith(("air_r", "air_g", "air_b"))} == {
        "air_red": 0.5,
        "air_green": 0.25,
        "air_blue": 2.0,
    }
    assert step.fog_depth.bl_rna.properties["air_colour"].subtype == "COLOR_GAMMA"


def test_properties_are_in_blenders_units_and_presets_in_their_own():
    # Blender shows angles of radians in degrees, lengths in metres, and a camera's in millimetres, as they are stored.
    units = {"deg": ("ROTATION", "ANGLE"), "m": ("LENGTH", "DISTANCE"), "mm": ("CAMERA", "DISTANCE_CAMERA")}
    in_units = {"deg": math.pi / 180}
    step, seen = settings().steps.add(), set()
    for name, perturbation in registry().items():
        shown = getattr(step, name).bl_rna.properties
        for item in fields(perturbation.parameters):
            unit = item.metadata["key"].unit
            if unit not in units or not isinstance(item.default, float):
                continue
            seen.add(unit)
            prop = shown[item.name.removesuffix("_deg")]
            assert (prop.unit, prop.subtype) == units[unit], (name, item.name)
            assert prop.default == pytest.approx(item.default * in_units.get(unit, 1.0)), (name, item.name)
            if (most := item.metadata["key"].maximum) is not None:
                assert prop.hard_max == pytest.approx(most * in_units.get(unit, 1.0)), (name, item.name)
    assert seen == set(units)
    settings().steps.clear()
    settings().deviation_rotation, settings().deviation_translation_m = math.pi / 6, 0.25
    (said,) = document.to_document(settings())["settings"][-1]["perturb"]
    assert said == {"motion_deviation": {"rotation_deg": 30.0, "translation_m": 0.25}}


BESIDE_PX = 94  # for a label beside its field, in a sidebar as it opens: photographed


def in_title_case(label):
    words = [word for word in label.split() if not word.startswith(("(", "/"))]
    small = ("by", "in", "of", "to", "and", "from", "the")
    return all(word[0].isupper() or (place and word in small) or len(label) == 2 for place, word in enumerate(words))


def test_every_property_and_choice_has_a_tooltip_and_a_label_in_title_case():
    step = settings().steps.add()
    parameters = [getattr(step, name) for name in registry() if hasattr(step, name)]
    assert len(parameters) == len(registry())
    for group in (*groups_of(settings()), step, *parameters):
        for item in group.bl_rna.properties:
            if item.is_hidden or item.identifier in ("rna_type", "name", "steps") or item.type == "POINTER":
                continue
            where = f"{group.bl_rna.identifier}.{item.identifier}"
            assert len(item.description) > 3, where
            assert not item.description.endswith("."), where
            assert in_title_case(item.name), (where, item.name)
            beside = not item.name.startswith("Override") and item.identifier != "active_step"  # which are not drawn
            assert not beside or width_of(item.name) <= BESIDE_PX, where
            for choice in getattr(item, "enum_items", ()):
                assert choice.description, (where, choice.identifier)
                assert in_title_case(choice.name), (where, choice.name)


def test_every_button_menu_and_section_has_a_tooltip_and_a_label_in_title_case():
    classes = own_classes(bpy.types.Operator, bpy.types.Menu, bpy.types.Panel, bpy.types.UIList)
    shown = [cls for cls in classes if issubclass(cls, (bpy.types.Operator, bpy.types.Menu, bpy.types.Panel))]
    assert len(shown) > 25
    for cls in shown:
        assert in_title_case(cls.bl_label), cls.bl_label
        assert cls.__doc__, cls
        assert not cls.__doc__.endswith("."), cls


# --- the user's file ---


def test_loading_replaces_our_own_objects_only(tmp_path):
    use_files(tmp_path)
    scene = bpy.context.scene
    scene.unit_settings.scale_length = 0.5
    before = set(scene.objects)
    for _ in range(2):
        assert bpy.ops.noisy_world.load_scene() == {"FINISHED"}
        assert bpy.ops.noisy_world.load_trajectory() == {"FINISHED"}
    assert before < set(scene.objects)
    assert len(set(scene.objects) - before) == 2
    assert (scene.frame_start, scene.frame_end) == (0, 9)
    assert scene.unit_settings.scale_length == 0.5
    assert len(bpy.data.actions) == 1
    assert len([item for item in bpy.data.meshes if item.users]) == 2  # the cube's and ours
    assert (scene.render.resolution_x, scene.render.resolution_y) == (1200, 680)


def test_solid_shading_gets_its_own_colours_and_the_render_keeps_its(tmp_path):
    use_files(tmp_path)
    bpy.ops.noisy_world.load_scene()
    (mesh,) = (item.data for item in bpy.context.scene.objects if item.get("noisy_world") == "mesh")
    colours = mesh.color_attributes
    assert colours[colours.render_color_index].name == "Col"
    shown = np.empty(16, dtype=np.float32)
    colours[colours.active_color_name].data.foreach_get("color_srgb", shown)
    assert np.abs(shown.reshape(4, 4)[1, :3] * 255 - [128, 0, 0]).max() < 0.6


def test_the_camera_is_keyed_as_the_generator_renders_and_follows_the_sliders(tmp_path):
    from noisy_world.dataset.rendering import source_paths
    from noisy_world.dataset.plan import make_plan
    from noisy_world.panel.document import preset_of

    poses = use_files(tmp_path)
    bpy.ops.noisy_world.load_trajectory()
    scene = bpy.context.scene
    frames = np.arange(10)
    assert np.abs(keyed_poses(scene, scene.camera, frames) - poses).max() < 1e-6
    settings().deviation_rotation = np.radians(4.0)
    settings().deviation_translation_m = 0.05
    plan = make_plan(preset_of(settings()))
    render = plan.renders[-1]
    rendered = source_paths(plan, render).rgb.c2w
    assert np.abs(rendered - poses).max() > 0.01
    assert np.abs(keyed_poses(scene, scene.camera, frames) - rendered).max() < 1e-6
    settings().camera.fx = 300
    assert scene.camera.data.lens == pytest.approx(300 * 36 / 1200)


def test_errors_are_reports_and_nothing_is_finished(tmp_path):
    use_files(tmp_path)
    settings().of_mesh.mesh = str(tmp_path / "absent.ply")
    refused(bpy.ops.noisy_world.load_scene, names="absent.ply", error=RuntimeError)
    settings().of_mesh.mesh = ""
    assert not bpy.ops.noisy_world.load_scene.poll()
    (tmp_path / "bad.txt").write_text("1 2 3\n")
    use_files(tmp_path)
    settings().scene.trajectory.file = str(tmp_path / "bad.txt")
    refused(bpy.ops.noisy_world.load_trajectory, names="bad.txt", error=RuntimeError)
    assert all("noisy_world" not in item for item in bpy.context.scene.objects)


def test_two_scenes_do_not_disturb_each_other(tmp_path):
    use_files(tmp_path)
    bpy.ops.noisy_world.load_scene()
    first = bpy.context.scene
    second = bpy.data.scenes.new("Second")
    with bpy.context.temp_override(scene=second):
        use_files(tmp_path, count=4)
        bpy.ops.noisy_world.load_scene()
        bpy.ops.noisy_world.load_trajectory()
        bpy.ops.noisy_world.add_step(perturbation="fog")
    assert len(first.noisy_world.steps) == 0
    assert sum(item.get("noisy_world") == "mesh" for item in first.objects) == 1
    assert first.frame_end == 250
    assert second.frame_end == 3


def test_a_linked_scene_is_left_alone(tmp_path):
    path = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (there, here):
        here.scenes = there.scenes
    (linked,) = (scene for scene in bpy.data.scenes if scene.library is not None)
    with bpy.context.temp_override(scene=linked):
        for name in ("load_scene", "load_trajectory", "set_camera", "add_step", "remove_step", "use_preset"):
            assert not getattr(bpy.ops.noisy_world, name).poll(), name


def test_a_large_mesh_is_loaded_all_at_once(tmp_path):
    def load(side):
        y, x = np.mgrid[:side, :side].reshape(2, -1)
        corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
        faces = np.stack([corner, corner + 1, corner + side + 1, corner + side], axis=1).astype(np.int32)
        rgb = np.stack([x, y, (x * y) % side], axis=1).astype(np.float32) / side
        vertices_m = np.stack([x, y, np.sin(x / 50)], axis=1) / 100
        starts = np.arange(0, faces.size, 4, dtype=np.int32)
        write_ply(tmp_path / "large.ply", Mesh(vertices_m, rgb, faces.ravel(), starts))
        settings().mesh_source, settings().of_mesh.mesh = "FILE", str(tmp_path / "large.ply")
        cost = calls_made(bpy.ops.noisy_world.load_scene, "EXEC_DEFAULT", True)
        (mesh,) = (item.data for item in bpy.context.scene.objects if item.get("noisy_world") == "mesh")
        assert (len(mesh.vertices), len(mesh.polygons)) == (side**2, (side - 1) ** 2)
        assert list(mesh.polygons[-1].vertices) == faces[-1].tolist()
        assert np.allclose(mesh.vertices[-1].co, vertices_m[-1], atol=1e-6)
        return cost

    load(20)  # imports what it needs
    assert load(300) < 2 * load(20)


# --- files and registration ---


def test_what_is_saved_comes_back_and_opens_without_the_add_on(tmp_path):
    use_files(tmp_path)
    bpy.ops.noisy_world.load_scene()
    bpy.ops.noisy_world.load_trajectory()
    bpy.ops.noisy_world.add_step(perturbation="snow")
    settings().steps[0].snow.use_mean = True
    settings().steps[0].snow.mean = 0.25
    path = str(tmp_path / "file.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    noisy_world.unregister()
    try:
        bpy.ops.wm.open_mainfile(filepath=path)
        assert bpy.context.scene.camera.animation_data.action is not None
    finally:
        noisy_world.register()
    bpy.ops.wm.open_mainfile(filepath=path)
    assert settings().steps[0].snow.mean == 0.25


def traces():
    """All that an add-on could leave behind."""
    kinds = ("Operator", "Panel", "Menu", "UIList", "PropertyGroup", "Header")
    types = {f"{kind}.{cls.__name__}" for kind in kinds for cls in getattr(bpy.types, kind).__subclasses__()
             if cls.is_registered}  # fmt: skip
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    handlers = {name: len(functions) for name, functions in lists.items() if isinstance(functions, list)}
    named = {name for name in dir(bpy.types) if "noisy" in name.lower()}
    return types, handlers, named, hasattr(bpy.types.Scene, "noisy_world")


def test_twenty_times_on_and_off_leaves_nothing():
    from noisy_world.panel import drawn_paths, preview, properties

    noisy_world.unregister()
    before = traces()
    assert not before[3]
    for _ in range(20):
        noisy_world.register()
        noisy_world.unregister()
    assert traces() == before
    assert properties.LISTENERS == []
    assert drawn_paths._handles == []
    assert not any(bpy.app.timers.is_registered(item) for item in (preview._follow, preview._resume))
    noisy_world.register()


def test_a_registration_that_fails_leaves_nothing(monkeypatch):
    noisy_world.unregister()
    before = set(dir(bpy.types))

    def fail():
        raise RuntimeError("no room")

    try:
        with monkeypatch.context() as patched:
            patched.setattr(presets, "register", fail)  # the last
            with pytest.raises(RuntimeError, match="no room"):
                panel.register()
        assert set(dir(bpy.types)) == before
        assert not hasattr(bpy.types.Scene, "noisy_world")
        assert described.LISTENERS == []
    finally:
        noisy_world.register()
