# SPDX-License-Identifier: GPL-3.0-or-later
"""Real cameras in the tab: each has a picture, and fills in its lens, with its electronics where they are asked for."""

import pytest
import yaml
from refusals import refused
from cases import cases
from panel_tools import settings

from noisy_world.preset.camera_devices import CAMERA_DEVICES
from noisy_world.preset.keys import check_document

pytestmark = pytest.mark.usefixtures("add_on")


@cases("name", list(CAMERA_DEVICES))
def test_a_cameras_button_fills_in_its_lens(tmp_path, name):
    import bpy

    from noisy_world.panel.document import to_document

    panel = settings()
    panel.mesh_source = "ROOM"
    assert bpy.ops.noisy_world.use_camera(device=name, electronics=False) == {"FINISHED"}
    again = check_document(to_document(panel), tmp_path / "panel.yaml").spec.camera
    given = {"scenes": [{"name": "a", "mesh": "a.ply"}], "camera": {"device": name}}
    whole = check_document(given, tmp_path / "given.yaml").spec.camera
    assert (again.width, again.fx, again.cy, again.distortion) == (whole.width, whole.fx, whole.cy, whole.distortion)
    assert not list(panel.steps)


def test_electronics_are_added_and_rows_only_where_they_are_read(tmp_path):
    import bpy

    from noisy_world.panel.document import perturb_of
    from noisy_world.panel.section_presets import use_camera

    panel = settings()
    panel.mesh_source, panel.render.engine = "ROOM", "cycles"
    said = use_camera(panel, "webcam", electronics=True)
    assert said.endswith("rows are read one by one with Embree alone, so that was left out")
    own = CAMERA_DEVICES["webcam"].steps
    given = {name: values for item in perturb_of(panel) for name, values in item.items()}
    assert set(given) == set(own) - {"rolling_shutter"}
    assert given["sensor_noise"]["gain_db"] == own["sensor_noise"]["gain_db"]
    assert bpy.ops.noisy_world.use_camera(device="webcam", electronics=True) == {"FINISHED"}
    assert len(panel.steps) == len(given)


def test_each_camera_has_a_picture():
    from noisy_world.panel.section_presets import PICTURES

    assert sorted(path.stem for path in PICTURES.glob("*.jpg")) == sorted(CAMERA_DEVICES)


def test_a_measured_devices_file_is_taken_with_its_preset(tmp_path):
    from noisy_world.panel import document

    camera = {"width": 320, "height": 240, "fx": 250.0, "fy": 251.0, "cx": 159.5, "cy": 119.5}
    depth, noise = {"axial_noise": {"offset_m": 0.001}}, [{"gaussian_noise": {"std": 0.03}}]
    (tmp_path / "measured.yaml").write_text(yaml.safe_dump({"camera": camera, "depth": depth, "perturb": noise}))
    preset = {
        "scenes": [{"name": "room", "mesh": "embedded:room", "trajectory": {"handheld": {"frames": 3}}}],
        "camera": {"device": "measured.yaml"},
        "rig": {"depth": {"sensor": "measured.yaml"}},
        "settings": [{"name": "seen", "perturb": [{"device": "measured.yaml"}, {"pixelate": {"severity": 1}}]}],
    }
    (tmp_path / "preset.yaml").write_text(yaml.safe_dump(preset))
    document.open_preset(settings(), tmp_path / "preset.yaml")
    given = document.preset_of(settings(), tmp_path / "preset.yaml")
    assert (given.spec.camera.fx, given.spec.camera.fy, given.spec.rig.depth.sensor) == (250.0, 251.0, depth)
    assert [step.perturbation.name for step in document.steps_of(settings())] == ["gaussian_noise", "pixelate"]


def test_a_scenes_own_camera_is_kept():
    import bpy

    panel = settings()
    panel.mesh_source = "SCENE"
    panel.use_camera = False
    refused(bpy.ops.noisy_world.use_camera, device="phone", names="own camera", error=RuntimeError)
