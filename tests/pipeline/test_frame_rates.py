# SPDX-License-Identifier: GPL-3.0-or-later
"""What drifts by another rate than its frames' is told."""

import numpy as np
import pytest

from noisy_world.perturbations.parsing import parse_settings
from noisy_world.preset.keys import SettingSpec
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry
from noisy_world.dataset.making import other_rates


def notes(stamps_s, **values):
    spec = SettingSpec(name="storm", perturb=({"rain_depth": {"severity": 2, **values}}, {"fog": {"severity": 1}}))
    settings = parse_settings([spec], [ConfigPath("preset.yaml", "settings.0")], registry())
    return [str(note) for note in other_rates(iter(settings), np.asarray(stamps_s, np.float64))]


def test_what_drifts_at_another_rate_is_told_with_the_right_one():
    (note,) = notes(np.arange(5) / 24, temporal="drift")
    assert note.startswith("storm: rain_depth moves 1.2 times as fast as in the scene, whose frames are 24 a second")
    assert note.endswith("frame_rate_hz: 24")


@pytest.mark.parametrize(
    ("stamps_s", "values"),
    [
        (np.arange(5) / 24, {"temporal": "fixed"}),
        (np.arange(5) / 24, {"temporal": "drift", "frame_rate_hz": 24}),
        (np.arange(5) * 1001 / 24000, {"temporal": "drift", "frame_rate_hz": 24}),
        (np.arange(5) / 20, {"temporal": "drift"}),
        ([0.0], {"temporal": "drift"}),
        ([], {"temporal": "drift"}),
    ],
)
def test_what_moves_as_its_frames_do_or_not_at_all_is_not_told(stamps_s, values):
    assert notes(stamps_s, **values) == []
