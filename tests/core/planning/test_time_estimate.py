# SPDX-License-Identifier: GPL-3.0-or-later
"""The time that a dry run gives: by images that are made on this machine, as a range, and what takes less."""

import time
from dataclasses import replace

import pytest
from worlds import ROOT, write_world

from noisy_world.cli.generate import quicker_hint
from noisy_world.cli.plan_text import print_plan
from noisy_world.dataset import machine_pace
from noisy_world.dataset.machine_pace import MachinePace, measured_pace
from noisy_world.dataset.estimate import (
    AS_MEASURED,
    SECONDS_OF_EEVEE,
    SECONDS_PER_SCENE,
    estimate,
    memory_bytes,
    quicker,
    usual_memory_bytes,
)
from noisy_world.dataset.plan import make_plan
from noisy_world.perturbations import registry
from noisy_world.preset.keys import read_preset

NOISY = [
    {"name": "clean"},
    {"name": "grainy", "perturb": [{"gaussian_noise": {"severity": 3}}, {"depth_gaussian_noise": {"severity": 2}}]},
    {"name": "varied", "perturb": [{"brightness": {"severity": 3, "mode": "dynamic"}}]},
]


@pytest.fixture
def world(tmp_path):
    return make_plan(read_preset(write_world(tmp_path / "world", size=(320, 240), settings=NOISY), []), None)


def test_each_setting_is_tried_in_each_of_its_channels(world):
    pace = measured_pace(world)
    assert set(pace.pixel_s) == {("grainy", "rgb"), ("grainy", "depth"), ("varied", "rgb")}
    assert pace.factor > 0
    assert 1e-10 < min(pace.pixel_s.values()) <= max(pace.pixel_s.values()) < 1e-4  # a varied one is not left as it was


def test_a_perturbation_that_takes_long_is_felt(world, monkeypatch):
    item = registry()["brightness"]

    def slow(rgb, parameters, context):
        time.sleep(0.04)
        return item.apply(rgb, parameters, context)

    steps = next(sequence.setting for sequence in world.renders[0].sequences if sequence.setting.name == "varied")
    (step,) = steps.rgb
    object.__setattr__(step, "perturbation", replace(item, apply=slow, apply_bytes=None))
    pace = measured_pace(world)
    assert pace.pixel_s["varied", "rgb"] >= 0.04 / (320 * 240) / machine_pace.THREADS
    usual, felt = estimate(world), estimate(world, MachinePace(1.0, pace.pixel_s))
    assert felt.seconds > usual.seconds


def test_no_time_to_try_leaves_the_usual(world):
    pace = measured_pace(world, longest_s=0.0)
    assert pace.pixel_s == {}
    assert pace.perturbed_s(world.renders[0].sequences[1], "rgb", 2.0) == pytest.approx(2.0 * pace.factor)
    assert MachinePace(1.0, {("other", "rgb"): 3.0, ("more", "rgb"): 5.0}).perturbed_s(
        world.renders[0].sequences[1], "rgb", 2.0
    ) == pytest.approx(4.0)  # the mean of what was tried


def test_a_slower_machine_takes_longer_in_proportion(tmp_path):
    clean = make_plan(read_preset(write_world(tmp_path / "world"), []), None)
    once, twice = estimate(clean), estimate(clean, MachinePace(2.0))
    assert once.seconds > SECONDS_PER_SCENE
    links_s = once.seconds * 2 - twice.seconds  # an image that is linked costs the same
    assert 0 <= links_s < 0.01
    assert twice.least_s < twice.seconds < twice.most_s


@pytest.mark.parametrize(
    ("name", "changed", "words"),
    [
        ("demo.yaml", [], "render.engine=embree render.backend=reference"),
        ("demo.yaml", ["render.engine=embree"], "render.backend=reference"),
        ("demo.yaml", ["render.backend=reference"], "render.engine=embree"),
        ("demo.yaml", ["render.engine=embree", "render.backend=reference"], None),
    ],
)
def test_what_takes_less_is_what_needs_no_blender(name, changed, words):
    plan = make_plan(read_preset(ROOT / "presets" / name, changed), None)
    found = quicker(plan, AS_MEASURED)
    assert (found and found[0]) == words
    if found:
        assert found[1] < estimate(plan).seconds
        other = make_plan(read_preset(ROOT / "presets" / name, changed + words.split()), None)
        assert found[1] == pytest.approx(estimate(other).seconds, rel=1e-6)


# Processor seconds that runs of so many first frames took on two cores: two thirds to all of it on the clock.
TAKEN_S = {
    ("mixed.yaml", 12): 41.0,
    ("lens.yaml", 12): 19.9,
    ("shutters.yaml", 4): 13.4,
    ("try_it.yaml", 20): 6.7,
    ("perturbations/rolling_shutter.yaml", 5): 9.2,
}


@pytest.mark.parametrize(("name", "frames"), TAKEN_S)
def test_what_was_taken_lies_in_the_range(name, frames):
    guess = estimate(make_plan(read_preset(ROOT / "presets" / name, []), slice(0, frames)))
    assert guess.least_s < 0.83 * TAKEN_S[name, frames] < guess.most_s


def test_shaders_and_a_file_of_ones_own_take_time_before_the_first_frame(tmp_path):
    preset = write_world(tmp_path / "world", size=(64, 48), settings=[{"name": "clean"}])
    seconds = {}
    for engine in ("embree", "cycles", "eevee"):
        plan = make_plan(read_preset(preset, [f"render.engine={engine}"]), None)
        seconds[engine] = estimate(plan).seconds
        assert usual_memory_bytes(plan) > memory_bytes(plan)
    assert seconds["embree"] < seconds["cycles"] < seconds["eevee"] - SECONDS_OF_EEVEE + 1


def test_a_run_tells_of_it_where_it_takes_long(tmp_path):
    demo = read_preset(ROOT / "presets/demo.yaml", [])
    assert "--set render.engine=embree render.backend=reference" in quicker_hint(make_plan(demo, None))
    assert quicker_hint(make_plan(demo, slice(0, 1))) == ""


def test_a_dry_run_prints_a_range(world, capsys):
    print_plan(world, "out")
    lines = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert " to " in lines["time"]
    assert lines["without"].startswith("Blender, with --set render.engine=embree: about ")
