# SPDX-License-Identifier: GPL-3.0-or-later
"""A lens that distorts in the tab: of meshes and of recordings, and as a preset has it."""

import pytest
from refusals import refused
from cases import cases
from panel_tools import Drawn, open_document, settings

from noisy_world.preset.keys import check_document

pytestmark = pytest.mark.usefixtures("add_on")

CAMERA = {"width": 64, "height": 48, "fx": 40.0, "fy": 40.0, "cx": 31.5, "cy": 23.5}


def document(distortion):
    scene = {"name": "room", "mesh": "embedded:room", "trajectory": {"handheld": {"frames": 3}}}
    camera = CAMERA if distortion is None else CAMERA | {"distortion": distortion}
    return {"scenes": [scene], "camera": camera, "settings": [{"name": "clean"}]}


@cases(
    "distortion",
    [
        {"k1": -0.28340811, "k2": 0.07395907, "p1": 0.00019359, "p2": 1.76187114e-05},
        {"k1": 0.5, "k4": 0.6, "k5": 0.1, "undistort": True},
        {"model": "equidistant", "k1": -0.02, "k4": 0.001},
        None,
    ],
)
def test_a_meshs_lens_comes_back_as_it_was(tmp_path, distortion):
    from noisy_world.panel.document import to_document

    open_document(document(distortion), tmp_path / "given.yaml")
    again = check_document(to_document(settings()), tmp_path / "again.yaml")
    given = check_document(document(distortion), tmp_path / "given.yaml")
    assert again.spec.mesh_camera.distortion == given.spec.mesh_camera.distortion


def test_a_recordings_lens_is_said_of_its_scene(tmp_path):
    from noisy_world.panel.source_views import PANEL_SOURCES

    panel = settings()
    panel.mesh_source, panel.of_sequence.sequence = "RECORDING", str(tmp_path)
    lens = panel.of_sequence.distortion
    lens.model, lens.k1 = "equidistant", 0.25  # which lays one over it
    said = PANEL_SOURCES["RECORDING"].entry(panel, str)
    assert said["distortion"] == {"model": "equidistant", "k1": 0.25}
    panel.of_sequence.use_distortion = False
    assert "distortion" not in PANEL_SOURCES["RECORDING"].entry(panel, str)


def test_a_lens_without_coefficients_is_refused_in_the_tabs_words(tmp_path):
    from noisy_world.panel.document import to_document

    panel = settings()
    panel.mesh_source, panel.camera.use_distortion = "ROOM", True
    refused(check_document, to_document(panel), tmp_path / "panel.yaml", names="coefficient")


@cases(("model", "count"), [("radial-tangential", 8), ("equidistant", 4)])
def test_the_fields_drawn_are_those_of_the_model(model, count):
    from noisy_world.panel.drawing import draw_distortion

    panel = settings()
    panel.camera.use_distortion, panel.camera.distortion.model = True, model
    draw_distortion(layout := Drawn(), panel.camera, rendered=True)
    assert sum(name[0] in "kp" and len(name) == 2 for name in layout.names) == count
    assert layout.names[-1] == "undistort"
