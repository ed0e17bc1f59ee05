# SPDX-License-Identifier: GPL-3.0-or-later
"""Clean frames come first, and a system that errs more on them than is expected of it is told at once."""

import json
from pathlib import Path

import pytest
from study_tools import SETTINGS, evaluate, small_world, told, write_systems

from noisy_world.evaluate.study_results import ResultsFolder
from noisy_world.evaluate.study_sequences import PresetOrigin
from noisy_world.preset.keys import read_preset

pytest.importorskip("embreex", reason="embreex comes with an extra")
pytest.importorskip("tabulate", reason="tabulate comes with an extra")

CLEAN_LAST = [*SETTINGS[1:], SETTINGS[0]]
EXPECTED = "expects_clean: {ate_m: 1.0, scale_off: 0.01}\n"


def test_the_clean_setting_is_the_first_of_each_scene(tmp_path):
    preset = small_world(tmp_path / "world", settings=CLEAN_LAST)
    origin = PresetOrigin(read_preset(preset), (3, 8), ResultsFolder(tmp_path / "results"))
    assert [case.setting for case in origin.frames] == ["clean", "noise", "bright", "fast", "noise"]


def test_a_scale_that_is_not_expected_is_told_and_may_be_expected_later(tmp_path, capfd):
    preset = small_world(tmp_path / "world", settings=[CLEAN_LAST[0], CLEAN_LAST[-1]])
    definition = Path(write_systems(tmp_path / "systems", "long"))
    without = definition.read_text()
    definition.write_text(without + EXPECTED)
    words = (preset, "--systems", definition, "--out", tmp_path / "out", "--jobs", 1)
    assert evaluate(*words) == 0
    (line,) = (line for line in capfd.readouterr().err.splitlines() if "on clean frames" in line)
    # The true path over one that is 1.05 times as long.
    assert "long on box/clean/seed-3: scale 0.952 on clean frames; expected: ATE at most 1 m, scale within 1 %" in line

    def said():
        return json.loads((tmp_path / "out" / "study.json").read_text())["study"]["systems"]["long"]

    assert said()["expects_clean"] == {"ate_m": 1.0, "scale_off": 0.01}
    runs = {name: content for name, content in told(tmp_path / "out").items() if name != "study.json"}
    definition.write_text(without)
    assert evaluate(*words) == 0  # the digest is the same, and nothing is run anew
    assert "expects_clean" not in said()
    assert {name: content for name, content in told(tmp_path / "out").items() if name != "study.json"} == runs


@pytest.mark.parametrize("said", ["{ate_m: 0}", "{scale_off: 0.01}", "{ate_m: 0.01, scale: 0.01}"])
def test_what_is_no_expectation_is_a_line(tmp_path, said, capfd):
    preset = small_world(tmp_path / "world", settings=SETTINGS[:1])
    definition = Path(write_systems(tmp_path / "systems", "long"))
    definition.write_text(definition.read_text() + f"expects_clean: {said}\n")
    assert evaluate(preset, "--systems", definition, "--out", tmp_path / "out") == 1
    (line,) = capfd.readouterr().err.splitlines()
    assert f"{definition}: expects_clean" in line
