# SPDX-License-Identifier: GPL-3.0-or-later
"""An IMU in the tab: as a preset has it, and its fields."""

import pytest
from cases import cases
from panel_tools import Drawn, open_document, settings

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
    assert settings().rig.use_imu == (imu is not None)
    again = check_document(to_document(settings()), tmp_path / "again.yaml")
    assert again.spec.rig == check_document(given, tmp_path / "given.yaml").spec.rig


def test_rendered_scenes_carry_one_and_recordings_none():
    from noisy_world.panel.source_views import PANEL_SOURCES

    assert {name for name, source in PANEL_SOURCES.items() if source.carries} == {"FILE", "ROOM", "SCENE"}


def test_its_fields_are_drawn_where_it_is_on():
    from noisy_world.panel.drawing import draw_imu

    panel, off, on = settings(), Drawn(), Drawn()
    panel.rig.use_imu = False
    draw_imu(off, panel.rig)
    panel.rig.use_imu = True
    draw_imu(on, panel.rig)
    assert off.names == ["use_imu"]
    assert len(on.names) == 7
