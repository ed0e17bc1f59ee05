# SPDX-License-Identifier: GPL-3.0-or-later
"""mode: keyed: a severity for each frame, one after another, of which the last one holds."""

import pytest
from refusals import refused

from noisy_world.dataset.folder_state import _step as difference
from noisy_world.dataset.identity import RecordedStep
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry


def step_of(name, **values):
    (step,) = parse_steps([{name: values}], ConfigPath("preset.yaml", "perturb"), registry())
    return step


def test_each_frame_has_its_own_and_the_last_one_holds():
    step = step_of("gaussian_noise", mode="keyed", levels=[0, 1, 2.5, 5], std=0.5)
    for setting in ("one", "another"):
        contexts = [step.context(FrameContext(index, (3, "room", setting))) for index in range(7)]
        assert [step.severity_of(context) for context in contexts] == [0, 1, 2.5, 5, 5, 5, 5]
    assert step.parameters(2.5).std == 0.5
    alone = step_of("fog", mode="keyed", levels=[4])
    assert alone.severity_of(alone.context(FrameContext(9, (0, "a", "b")))) == 4


@pytest.mark.parametrize(
    ("name", "values", "told"),
    [
        ("fog", {"mode": "keyed"}, ("mode: is keyed", "levels")),
        ("fog", {"mode": "keyed", "severity": 3}, ("mode: is keyed", "levels")),
        ("fog", {"mode": "keyed", "levels": []}, ("levels: is ",)),
        ("fog", {"mode": "keyed", "levels": [0.5]}, ("levels.0: is 0.5",)),
        ("fog", {"mode": "keyed", "levels": [1], "severity": 2}, ("levels: ", "severity")),
        ("fog", {"mode": "keys"}, ("mode: ", "static, dynamic or keyed")),
        ("fog", {"levels": [1]}, ("levels: ", "dynamic or keyed")),
    ],
)
def test_what_is_wrong_is_told_in_a_line(name, values, told):
    refused(step_of, name, **values, names=("preset", *told))


def test_a_dynamic_severity_draws_from_0_to_itself():
    assert step_of("fog", mode="dynamic", severity=3).levels == (0.0, 1.0, 2.0, 3.0)


def test_what_is_given_counts_before_what_it_implies():
    assert step_of("haze", severity=3, blueness=0.3).parameters(3).air == "grey"
    assert step_of("haze", severity=3, blueness=0.3, air="scene").parameters(3).air == "scene"


def test_a_dataset_knows_the_mode_and_the_severities():
    keyed, other, drawn = (
        RecordedStep.of(step_of("fog", mode=mode, levels=levels))
        for mode, levels in (("keyed", [1, 2]), ("keyed", [1, 3]), ("dynamic", [1, 2]))
    )
    assert "keyed" not in drawn.content()
    assert difference(drawn, keyed) == ("mode", "was dynamic, is keyed")
    assert difference(keyed, other)[0] == "levels"
