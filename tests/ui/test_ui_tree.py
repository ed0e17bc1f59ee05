# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel is the preset: whatever one holds is taken and given back equal."""

import math
import random
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Literal, get_args, get_origin

import bpy
import pytest
import yaml
from cases import cases
from panel_tools import Drawn, open_document, own_classes, settings
from refusals import refused

from noisy_world.perturbations.parsing import parse_settings
from noisy_world.preset.keys import PresetSpec, check_document, read_preset
from noisy_world.scenes.polygon_mesh import ROOMS
from noisy_world.panel.tree import draw_distortion
from noisy_world.panel.tree import hint_of, set_value, to_document as said_by, to_line, value_of
from noisy_world.perturbations import registry
from noisy_world.sources import SOURCES, read_scenes
from noisy_world.panel import document, sections

pytestmark = pytest.mark.usefixtures("add_on")

PRESETS = sorted((Path(__file__).resolve().parents[2] / "presets").rglob("*.yaml"))
ROOM = {"name": "room", "mesh": "embedded:room", "trajectory": {"handheld": {"frames": 3}}}
BESIDE = {"only", "data", "include", "sweep", "perturb", "device", "sensor"}
"""Keys whose values are no plain ones, or stand for others: each has a case of its own."""


def meant(preset):
    """All that a preset says, checked, whatever the way in which it says it."""
    spec = preset.spec
    done = parse_settings(spec.settings, preset.setting_places, registry(), spec.render.backend)
    return replace(spec, scenes=(), settings=()), [item.keys for item in read_scenes(preset)], done


@cases("path", PRESETS)
def test_every_shipped_preset_is_taken_and_given_back_equal(path):
    shipped = read_preset(path)
    document.open_preset(settings(), path)
    given = document.preset_of(settings(), path)
    assert meant(given) == meant(shipped)
    for name in {*shipped.document} - {"settings"}:
        assert given.document[name] == shipped.document[name], name
    shown = {item.name: item.steps for item in meant(shipped)[2]}.get(document.setting_name(settings()), ())
    assert document.steps_of(settings()) == shown
    assert bool(shown) == any(item.steps for item in meant(shipped)[2])


def plain(rng, cls, name):
    """Return a value that a key may have, None where there is no plain one."""
    info = next(item for item in fields(cls) if item.name == name).metadata["key"]
    hint = hint_of(cls, name)
    if hint is bool:
        return rng.random() < 0.5
    if get_origin(hint) is Literal or (hint is str and info.choices):
        return rng.choice(list(info.choices or get_args(hint)))
    low = info.minimum if info.minimum is not None else info.above if info.above is not None else -1e3
    high = info.maximum if info.maximum is not None else 1e6
    if hint is int:
        return rng.randint(int(low) + (info.above is not None), int(high))
    if hint is float:
        return rng.uniform(low, high)
    if get_origin(hint) is tuple and set(get_args(hint)) == {float}:
        return [rng.uniform(low, high) for _ in get_args(hint)]
    return None


def keys_of(rng, cls):
    """Return a document of a dataclass with a random value for every plain key, in the dataclasses inside it too."""
    said = {}
    for item in fields(cls):
        if item.name in BESIDE or item.name in ("scenes", "settings"):
            continue
        hint = hint_of(cls, item.name)
        value = keys_of(rng, hint) if is_dataclass(hint) else plain(rng, cls, item.name)
        if value is not None:
            said[item.name] = value
    return said


def test_random_values_of_every_key_come_back_exactly():
    rng, panel, counted = random.Random(5), settings(), 0
    panel.steps.add()

    def every(group, cls):
        nonlocal counted
        for item in fields(cls):
            hint = hint_of(cls, item.name)
            if is_dataclass(hint) and hasattr(group, item.name):
                every(getattr(group, item.name), hint)
            elif (value := plain(rng, cls, item.name)) is not None and hasattr(group, f"use_{item.name}"):
                set_value(group, item.name, value)
                assert value_of(group, item.name) == value, (cls, item.name, value)
                counted += 1

    for _ in range(27):
        every(panel, PresetSpec)
        for name, kind in SOURCES.items():
            every(getattr(panel, f"of_{name}"), kind.keys)
        for name, perturbation in registry().items():
            every(getattr(panel.steps[0], name), perturbation.parameters)
    assert counted > 10_000


def test_without_a_perturbation_the_clean_setting_is_made_whether_it_is_ticked_or_not():
    settings().use_clean = False
    assert document.to_document(settings())["settings"] == [{"name": "clean"}]


def test_numbers_are_as_they_were_typed():
    panel = settings()
    set_value(panel.camera, "fx", 50)
    assert repr(value_of(panel.camera, "fx")) == "50"
    panel.steps.add().motion_deviation.rotation = math.radians(12.3456)  # by hand: Blender holds it in radians
    assert value_of(panel.steps[0].motion_deviation, "rotation_deg") == 12.3456


@cases("seed", [0, 2**31 - 1, 2**31, 2**53 + 1, 2**63 - 1])
def test_seeds_of_63_bits_are_exact(seed, tmp_path):
    open_document({"seed": seed, "scenes": [ROOM]}, tmp_path / "p.yaml")
    assert document.to_document(settings())["seed"] == seed
    assert document.identifiers_of(settings())[0] == seed
    settings().seed = 7  # by hand: what was typed counts
    assert document.to_document(settings())["seed"] == 7


LENS = {"width": 64, "height": 48, "fx": 52.123456789012, "fy": 1 / 3, "cx": 31.5, "cy": 23.5}
BODY = {"handheld": {"frames": 3}, "body": {"kind": "rover", "motion": 4.0}}
LEVELS = [{"fog": {"mode": "dynamic", "levels": [1, 5]}}]


@cases(
    "change",
    [
        {"scenes": [{"mesh": "a.ply", "trajectory": "t.txt"}, {"mesh": "b.ply", "up": "y", "trajectory": "u.txt"}]},
        {"scenes": [{"sequence": "room*", "distortion": {"k1": 0.1}, "depth_scale_per_m": 5000}]},
        {"scenes": [{"mesh": "*.ply", "light": "scene", "trajectory": {"file": "t.txt", "start": 2, "stop": 9}}]},
        {"scenes": [{"mesh": "embedded:room?seed=*", "trajectory": {"handheld": {"frames": 3, "wander_m": 0.5}}}]},
        {"scenes": [{"blend": "other.blend", "frames": "1:9", "camera": "Mine"}]},
        {"scenes": [{"replica": "room*"}]},
        {"scenes": [{"video": "a.mp4", "depth": "depths", "depth_scale_per_m": 5000.5, "void": "sky"}]},
        {"rig": {"imu": {"device": "bmi055", "time_offset_s": 0.0123, "translation_m": [0.05, -0.012, 0.3]}}},
        {"camera": LENS | {"distortion": {"k1": -0.28340811, "k2": 0.07395907, "p1": 0.00019359, "p2": 1.76e-05}}},
        {"camera": LENS | {"distortion": {"model": "equidistant", "k1": -0.02, "k4": 0.001, "undistort": True}}},
        {"scenes": [ROOM | {"mesh": "embedded:room?seed=3", "trajectory": BODY}]},
        {"rig": {"rgb": {"translation_m": [0, 0, 1]}, "imu": {"gyro_noise_density": 1e-3}}},
        {"rig": {"imu": {}, "depth": {"sensor": {"stereo": {"noise": 0.5}}, "rotation_euler_deg": [0, 0, 90]}}},
        {"render": {"device": "gpu", "allow_empty": True, "processors": "any"}},
        {"output": {"formats": {"normal": "exr"}, "licence": "cc-by-4.0", "modalities": ["depth", "rgb", "flow"]}},
        {"only": {"scenes": ["room"]}, "data": "."},
        {"settings": [{"name": "x", "stream": "y", "backend": "reference", "perturb": LEVELS}]},
        {"settings": [{"name": "x", "perturb": LEVELS}, {"name": "clean"}, {"sweep": {"perturb": ["fog"]}}]},
        {"camera": {"device": "phone", "width": 480}},
    ],
)
def test_what_has_no_slider_is_held_too(change, tmp_path):
    given = {"scenes": [ROOM]} | change
    open_document(given, path := tmp_path / "p.yaml")
    assert meant(document.preset_of(settings(), path)) == meant(check_document(given, path))


def test_a_setting_of_a_sweep_is_shown_and_written_once_it_is_changed(tmp_path):
    sweep = {"sweep": {"perturb": ["fog"], "severities": [1, 3], "stream": "{perturb}"}}
    path = tmp_path / "p.yaml"
    path.write_text(yaml.safe_dump({"scenes": [ROOM], "settings": [{"name": "clean"}, sweep]}))
    document.open_preset(settings(), path, "fog_s3")
    assert document.identifiers_of(settings()) == (0, "room", "fog_s3")
    assert document.steps_of(settings())[0].stream == "fog"
    assert document.to_document(settings())["settings"] == [{"name": "clean"}, sweep]
    settings().steps[0].severity = 5
    (_, kept, own) = document.to_document(settings())["settings"]
    assert (kept, own["name"], own["perturb"]) == (sweep, "fog_s3_changed", [{"fog": {"severity": 5.0}}])
    assert document.identifiers_of(settings())[-1] == "fog_s3_changed"
    assert bpy.ops.noisy_world.remove_line(of="other_settings", place=0) == {"FINISHED"}
    assert document.to_document(settings())["settings"] == [{"name": "clean"}, own | {"name": "fog_s3"}]


def test_a_change_by_hand_is_given_with_the_groups_that_it_is_in():
    panel = settings()
    assert said_by(panel, PresetSpec, leave=("scenes", "settings", "camera")) == {}
    panel.rig.imu.rate_hz = 400
    panel.render.samples = 4
    assert said_by(panel, PresetSpec, leave=("scenes", "settings", "camera")) == {
        "rig": {"imu": {"device": "ideal", "rate_hz": 400.0}},
        "render": {"samples": 4},
    }
    panel.rig.use_imu = False
    assert "rig" not in document.to_document(panel)


def test_a_line_that_is_no_yaml_is_an_error_that_names_its_key():
    panel = settings()
    panel.rig.imu.matrix = "[1, 0"
    refused(document.to_document, panel, names=["matrix", "[1, 0"])
    assert to_line([1, {"a": "b"}]) == '[1, {"a": "b"}]'


@cases("room", range(ROOMS))
def test_each_embedded_room_is_chosen_by_its_number(room):
    settings().room_seed = room
    assert document.to_document(settings())["scenes"][0]["mesh"].partition("?")[0] == "embedded:room"


@cases("name", ["demo", "noisy_replica", "benchmark", "imu", "lens", "real_camera"])
def test_every_section_is_drawn_with_what_the_preset_gives(name):
    (path,) = [path for path in PRESETS if path.stem == name]
    document.open_preset(settings(), path)
    layout = Drawn()
    for cls in own_classes(bpy.types.Panel):
        if issubclass(cls, sections.PanelSection):
            section = SimpleNamespace(layout=layout, fields=lambda _: layout, bl_label=cls.bl_label)
            cls.draw(section, bpy.context)
    given = {"scene.name", "mesh_source", "seed", "layout", "modalities"}
    assert {name.rpartition(".")[2] for name in given} <= {*layout.names}
    lines = len(settings().other_settings) + len(settings().other_scenes)
    assert layout.names.count("line") == lines


def test_a_recordings_lens_is_said_of_its_scene_and_it_carries_no_imu(tmp_path):
    panel = settings()
    panel.rig.imu.rate_hz = 400
    panel.mesh_source, panel.of_sequence.sequence.folder = "RECORDING", str(tmp_path)
    panel.of_sequence.distortion.model, panel.of_sequence.distortion.k1 = "equidistant", 0.25
    said = document.to_document(panel)
    assert said["scenes"][0]["distortion"] == {"model": "equidistant", "k1": 0.25}
    assert "rig" not in said
    panel.of_sequence.use_distortion = False
    assert "distortion" not in document.scene_of(panel)


@cases(("model", "count"), [("radial-tangential", 8), ("equidistant", 4)])
def test_the_coefficients_drawn_are_those_of_the_model(model, count):
    camera = settings().camera
    draw_distortion(without := Drawn(), camera, rendered=True)
    camera.distortion.model = model
    draw_distortion(layout := Drawn(), camera, rendered=True)
    assert sum(name[0] in "kp" and len(name) == 2 for name in layout.names) == count
    assert layout.names[-1] == "undistort"
    assert without.names == ["use_distortion"]
    camera.use_distortion = False


def test_undo_redo_and_copies_of_a_scene_keep_all_that_is_held():
    (path,) = [path for path in PRESETS if path.stem == "lens"]
    bpy.ops.ed.undo_push(message="before")
    said = [document.to_document(settings())]
    document.open_preset(settings(), path)
    settings().deviation_rotation = 0.1
    bpy.ops.ed.undo_push(message="opened")
    said.append(document.to_document(settings()))
    settings().camera.fx, settings().steps[0].enabled = 77.7, False
    bpy.ops.ed.undo_push(message="changed")
    for step, wanted in ((bpy.ops.ed.undo, said[1]), (bpy.ops.ed.undo, said[0]), (bpy.ops.ed.redo, said[1])):
        assert step() == {"FINISHED"}
        assert document.to_document(settings()) == wanted
    assert document.to_document(bpy.context.scene.copy().noisy_world) == said[1]
