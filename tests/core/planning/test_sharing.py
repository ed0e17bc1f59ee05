# SPDX-License-Identifier: GPL-3.0-or-later
"""Which part of the images is made by what frames are asked: against every possible draw of the severities."""

from itertools import product

import pytest
from worlds import write_world

from noisy_world.perturbations.parsing import parse_settings
from noisy_world.dataset import estimate
from noisy_world.dataset.estimate import described_sequences, parts_made
from noisy_world.dataset.identity import plain_identity
from noisy_world.dataset.plan import make_plan
from noisy_world.dataset.sequence import lay_out
from noisy_world.preset.keys import SettingSpec, SweepSpec, read_preset
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry


FRAMES = 800
NEAR = 0.06  # three times the deviation of a share of so many draws


@pytest.fixture(autouse=True)
def every_frame_is_asked(monkeypatch):
    monkeypatch.setattr(estimate, "ASKED", FRAMES)


def sequences_of(*items, frames=FRAMES):
    settings = parse_settings(items, [ConfigPath("test")] * len(items), registry())
    return [lay_out(setting, "room", frames, (1, "room", setting.name)) for setting in settings]


def sweep(name, **other):
    return SettingSpec(sweep=SweepSpec(perturb=(name,), severities=(1.0, 3.0), modes=("static", "dynamic"), **other))


@pytest.mark.parametrize("name", ["gaussian_noise", "brightness"])
def test_the_part_is_the_mean_over_all_draws(name):
    """In order: static 1, dynamic 0 to 1, static 3, dynamic 0 to 3."""
    new = [0, 0, 0, 0]
    draws = list(product([1], range(2), [3], range(4)))
    for levels in draws:
        made = {0}
        for place, level in enumerate(levels):
            new[place] += level not in made
            made.add(level)
    stream = None if name == "brightness" else "{perturb}"
    found = parts_made(sequences_of(SettingSpec(name="clean"), sweep(name, stream=stream)), "rgb")
    assert list(found.values()) == pytest.approx([count / len(draws) for count in new], abs=NEAR)


def test_own_streams_share_nothing_but_clean_frames():
    found = parts_made(sequences_of(sweep("gaussian_noise")), "rgb")
    assert list(found.values()) == pytest.approx([1, 1 / 2, 1, 3 / 4], abs=NEAR)
    assert parts_made(sequences_of(sweep("gaussian_noise")), "depth") == {}


def test_chains_share_where_all_steps_are_equal():
    chain = ({"fog": {"severity": 2}}, {"gaussian_noise": {"levels": [0, 0, 0, 1], "mode": "dynamic"}})
    fast = SettingSpec(name="fast", stream="s", perturb=({"fog": {"severity": 2}}, {"faster_motion": {"factor": 2}}))
    fog = SettingSpec(name="fog", stream="s", perturb=({"fog": {"severity": 2}},))
    found = parts_made(sequences_of(fog, fast, SettingSpec(name="chain", stream="s", perturb=chain)), "rgb")
    assert found == pytest.approx({"fog/room": 1, "fast/room": 1, "chain/room": 1 / 4}, abs=NEAR)


def test_a_setting_that_moves_pays_for_its_own_render(tmp_path):
    moved = {"name": "moved", "perturb": [{"motion_deviation": {"rotation_deg": 3, "translation_m": 0.05}}]}

    def costs_s(*settings):
        plan = make_plan(read_preset(write_world(tmp_path / settings[-1]["name"], frames=2, settings=list(settings))))
        found = described_sequences(plain_identity(plan, {}), registry())
        return {sequence.setting: sequence.seconds_each for sequence in found}

    (alone_s,) = costs_s({"name": "one"}).values()
    link_s = estimate.SECONDS_PER_LINK
    late = {"name": "late", "perturb": [{"desync": {"offset": 1}}]}
    found = costs_s({"name": "clean"}, moved, late)
    shared_s = (alone_s - link_s) / 2 + link_s  # of two that show one render
    assert found == pytest.approx({"clean": shared_s, "late": shared_s, "moved": alone_s})
    assert costs_s(moved) == pytest.approx({"moved": alone_s})
