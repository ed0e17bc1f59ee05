# SPDX-License-Identifier: GPL-3.0-or-later
"""An IMU in the tab: as a preset has it, and which presets the tab cannot show."""

import pytest
from refusals import refused
from cases import cases
from panel_tools import open_document, settings

from noisy_world.preset.keys import check_document

pytestmark = pytest.mark.usefixtures("add_on")


def document(rig):
    scene = {"name": "room", "mesh": "embedded:room", "trajectory": {"handheld": {"frames": 3}}}
    return {"scenes": [scene], "settings": [{"name": "clean"}], **({} if rig is None else {"rig": rig})}


@cases(
    "imu",
    [
        {},
        {"device": "adis16448", "rate_hz": 400.0, "translation_m": [0.05, -0.012, 0.3]},
        {"device": "bmi055", "time_offset_s": 0.0123, "clock_drift_ppm": -20.0, "gravity_m_s2": 9.80665},
        None,
    ],
)
def test_an_imu_comes_back_as_it_was(tmp_path, imu):
    from noisy_world.panel.document import to_document

    given = document(None if imu is None else {"imu": imu})
    open_document(given, tmp_path / "given.yaml")
    assert settings().has_imu == (imu is not None)
    again = check_document(to_document(settings()), tmp_path / "again.yaml")
    assert again.spec.rig == check_document(given, tmp_path / "given.yaml").spec.rig


@cases(
    ("rig", "where"),
    [
        ({"imu": {"gyro_noise_density": 1e-3}}, "gyro_noise_density"),
        ({"imu": {"rotation_euler_deg": [0, 0, 90]}}, "rotation_euler_deg"),
        ({"imu": {}, "rgb": {"translation_m": [0, 0, 1]}}, "places sensors on a robot"),
        ({"imu": {}, "depth": {}}, "places sensors on a robot"),
    ],
)
def test_what_the_tab_cannot_show_is_refused(tmp_path, rig, where):
    refused(open_document, document(rig), tmp_path / "given.yaml", names=[where, "panel"])


def test_rendered_scenes_carry_one_and_recordings_none():
    from noisy_world.panel.document import PANEL_SOURCES

    assert {name for name, source in PANEL_SOURCES.items() if source.carries} == {"FILE", "ROOM", "SCENE"}


def test_its_fields_are_drawn_where_it_is_on():
    from noisy_world.panel.properties import draw_imu

    class Layout:
        def __init__(self):
            self.drawn = []

        def prop(self, _panel, name):
            self.drawn.append(name)

        def column(self, **_):
            return self

    panel, off, on = settings(), Layout(), Layout()
    panel.has_imu = False
    draw_imu(off, panel)
    panel.has_imu = True
    draw_imu(on, panel)
    assert off.drawn == ["has_imu"]
    assert len(on.drawn) == 9
    assert all(name in panel.bl_rna.properties for name in on.drawn)
