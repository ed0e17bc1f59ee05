# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets in the tab: taken in, saved and kept; what the panel cannot show is refused."""

from pathlib import Path

import bpy
import pytest
from cases import cases
from panel_tools import settings, use_files

from noisy_world.core.errors import InputError
from noisy_world.core.perturbing.reading import parse_settings
from noisy_world.core.presets.preset import read_preset
from noisy_world.perturbations import registry

pytestmark = pytest.mark.usefixtures("add_on")

PRESETS = sorted((Path(__file__).resolve().parents[2] / "presets").rglob("*.yaml"))


def parsed(preset):
    return {item.name: item for item in parse_settings(
        preset.spec.settings, preset.place("settings"), registry(), preset.spec.render.backend
    )}  # fmt: skip


@cases("path", PRESETS)
def test_a_shipped_preset_comes_back_as_the_same_plan(path, tmp_path):
    from noisy_world.ui.document import open_preset, save_preset

    shipped = read_preset(path)
    for name, setting in parsed(shipped).items():
        open_preset(settings(), path, name)
        save_preset(settings(), tmp_path / "saved.yaml")
        saved = read_preset(tmp_path / "saved.yaml")
        for part in ("mesh_camera", "render", "seed", "scenes", "rig"):
            assert getattr(saved.spec, part) == getattr(shipped.spec, part), part
        assert saved.spec.output.layout == shipped.spec.output.layout
        assert saved.spec.output.overview == shipped.spec.output.overview
        again = parsed(saved)
        assert list(again) == (["clean", name] if setting.steps else ["clean"])
        for one, other in zip(again[name].steps, setting.steps, strict=True):
            for member in ("perturbation", "occurrence", "severity", "levels", "temporal"):
                assert getattr(one, member) == getattr(other, member), (name, member)
            level = one.severity or None
            assert one.parameters(level) == other.parameters(level), name


def test_what_the_files_are_written_as_is_kept(tmp_path):
    from noisy_world.ui.document import from_document, open_preset, save_preset, to_document

    document = {
        "scenes": [{"mesh": "embedded:room", "trajectory": {"handheld": {"frames": 3}}}],
        "output": {"layout": "euroc", "colour": "rgb", "depth_scale_per_m": 1000.1, "depth_beyond": "farthest"},
    }
    from_document(document, settings(), path=tmp_path / "p.yaml")
    wanted = {**document["output"], "image": "png", "modalities": ["rgb", "depth"], "overview": False}
    assert to_document(settings())["output"] == wanted
    save_preset(settings(), tmp_path / "saved.yaml")
    settings().layout = "replica"
    open_preset(settings(), tmp_path / "saved.yaml", "clean")
    assert to_document(settings())["output"] == wanted
    # What a preset leaves to the layout is the layout's own, not what the panel showed before.
    from_document({**document, "output": {"layout": "tum"}}, settings(), path=tmp_path / "p.yaml")
    output = to_document(settings())["output"]
    assert (output["colour"], output["depth_scale_per_m"], output["depth_beyond"]) == ("rgb", 5000.0, "void")


def test_a_layout_brings_what_its_readers_expect():
    from noisy_world.core.datasets.layouts import LAYOUTS

    made = settings()
    assert (made.layout, made.image, made.colour, made.depth_scale_per_m) == ("replica", "jpg", "rgb", 6553.5)
    made.layout = "euroc"
    assert (made.image, made.colour, made.depth_scale_per_m) == ("png", "grey", 5000.0)
    made.layout = "replica"
    assert (made.image, made.colour, made.depth_scale_per_m) == ("png", "rgb", 6553.5)  # png is one of its images
    items = made.bl_rna.properties["layout"].enum_items
    assert [item.identifier for item in items] == list(LAYOUTS)
    assert items["euroc"].name == "EuRoC ASL"
    assert items["replica"].description == "Of iMAP and NICE-SLAM; JPEG or PNG"


def test_numbers_that_float32_cannot_hold_are_kept(tmp_path):
    from noisy_world.ui.document import from_document, to_document

    document = {
        "scenes": [{"mesh": "embedded:room", "trajectory": {"handheld": {"frames": 3}}}],
        "camera": {"width": 64, "height": 48, "fx": 52.123456789012, "fy": 1 / 3, "cx": 31.5, "cy": 23.5},
        "settings": [{"name": "fog", "perturb": [{"fog": {"severity": 2.123456789, "thickness": 1.23456789012}}]}],
    }
    from_document(document, settings(), path=tmp_path / "p.yaml")
    said = to_document(settings())
    assert said["camera"]["fx"] == 52.123456789012
    assert said["camera"]["fy"] == 1 / 3
    assert said["settings"][1]["perturb"] == [{"fog": {"severity": 2.123456789, "thickness": 1.23456789012}}]
    settings().fx_px = 50.1  # by hand: what was typed counts
    assert to_document(settings())["camera"]["fx"] == 50.1


@cases(
    ("change", "key"),
    [
        ({"scenes": [{"mesh": "a.ply", "trajectory": "t.txt"}, {"mesh": "b.ply", "trajectory": "t.txt"}]}, "scenes"),
        ({"scenes": [{"sequence": "room0"}]}, "scenes.0.sequence"),
        ({"scenes": [{"mesh": "*.ply", "trajectory": "t.txt"}]}, "scenes.0.mesh"),
        ({"scenes": [{"mesh": "a.ply", "trajectory": {"file": "t.txt", "start": 2}}]}, "scenes.0.trajectory.start"),
        ({"rig": {"rgb": {}}}, "rig"),
        ({"render": {"device": "gpu"}}, "render.device"),
        ({"seed": 2**40}, "seed"),
        ({"settings": [{"name": "x", "perturb": [{"fog": {"mode": "dynamic", "levels": [1, 5]}}]}]}, "settings"),
    ],
)
def test_what_the_panel_cannot_show_is_refused_in_a_line(change, key, tmp_path):
    from noisy_world.ui.document import from_document, to_document

    document = {"scenes": [{"mesh": "embedded:room", "trajectory": {"handheld": {"frames": 3}}}]} | change
    settings().seed = 77
    before = to_document(settings())
    with pytest.raises(InputError) as raised:
        from_document(document, settings(), path=tmp_path / "p.yaml")
    assert f"p.yaml: {key}: " in str(raised.value)
    assert "\n" not in str(raised.value)
    assert to_document(settings()) == before


def test_own_presets_are_kept_where_blender_keeps_them(tmp_path, monkeypatch):
    monkeypatch.setattr(bpy.utils, "user_resource", lambda *_, **words: str(tmp_path / words["path"]))
    settings().seed = 12
    assert bpy.ops.noisy_world.add_preset(name="Mine") == {"FINISHED"}
    path = tmp_path / "presets/noisy_world/Mine.yaml"
    assert settings().preset_path == str(path)
    with pytest.raises(RuntimeError, match="there is a preset of this name"):
        bpy.ops.noisy_world.add_preset(name="Mine")
    with pytest.raises(RuntimeError, match="cannot name a file"):
        bpy.ops.noisy_world.add_preset(name="../Mine")
    settings().seed = 3
    assert bpy.ops.noisy_world.use_preset(filepath=str(path)) == {"FINISHED"}
    assert settings().seed == 12
    assert bpy.ops.noisy_world.remove_preset() == {"FINISHED"}
    assert not path.exists()
    assert not bpy.ops.noisy_world.remove_preset.poll()


def test_paths_beside_a_preset_are_relative_in_it(tmp_path):
    from noisy_world.ui.document import open_preset, save_preset

    use_files(tmp_path)
    save_preset(settings(), tmp_path / "kitchen.yaml")
    (scene,) = read_preset(tmp_path / "kitchen.yaml").spec.scenes
    assert (scene.mesh, scene.trajectory.file) == ("square.ply", "traj.txt")
    settings().mesh_path = ""
    open_preset(settings(), tmp_path / "kitchen.yaml")
    assert Path(settings().mesh_path) == tmp_path / "square.ply"
