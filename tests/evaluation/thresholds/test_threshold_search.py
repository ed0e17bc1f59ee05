# SPDX-License-Identifier: GPL-3.0-or-later
"""The search for a threshold on outcomes whose truth is known: its interval, its verdicts, and taking it up again."""

import math

import numpy as np
import pytest
from refusals import refused

from noisy_world.core.errors import NoisyWorldError
from noisy_world.evaluate.thresholds import Axis, Trial, Verdict, axis_of, chance_of_failure, scene_of, search
from noisy_world.perturbations import registry

pytest.importorskip("scipy", reason="scipy comes with the extra evaluate")
from threshold_coverage import coverage

FOG = Axis("fog_depth", "visibility_m", "m", 50.0, 0.5, logarithmic=True, whole=False)
OFFSET = Axis("desync", "offset", "frames", 1, 12, logarithmic=True, whole=True)
SCENES = ["a", "b", "c"]


def outcomes(succeeds):
    """What carries trials out: a success is what `succeeds` says of a value."""

    def carry_out(planned):
        return Trial(
            planned.number, planned.scene, planned.seed, planned.value, "finished", 0.01, 1.0, succeeds(planned.value)
        )

    return carry_out


def find(axis, succeeds, *, made=(), width=0.15, most=80):
    return search(axis, SCENES, 7, made, outcomes(succeeds), width=width, most=most)


def test_intervals_hold_the_truth_as_often_as_they_say():
    # 100 searches over five slopes, four kinds of lapses and thresholds, whose share has a standard error of 2.2 %.
    held, runs, width = coverage(20, np.random.default_rng(3)).mean(axis=0)
    assert held >= 0.95 - 2 * 0.022
    assert 25 <= runs < 50
    assert width < 0.17


def test_the_curve_is_one_half_at_the_threshold():
    for fails, holds in ((0.0, 0.0), (0.05, 0.0), (0.02, 0.08)):
        at = chance_of_failure(np.array([-9.0, 0.3, 9.0]), 0.3, 0.2, fails, holds)
        assert at == pytest.approx([fails, 0.5, 1.0 - holds], abs=1e-9)
    tenth, nine = chance_of_failure(np.array([0.2, 0.4]), 0.3, 0.2, 0.0, 0.0)
    assert (tenth, nine) == pytest.approx((0.1, 0.9))


def test_a_sharp_limit_is_found_between_what_held_and_what_failed():
    found = find(FOG, lambda value: value > 3.0)
    assert found.verdict is Verdict.FOUND
    assert None not in (found.mild, found.threshold, found.worst)
    assert found.mild > 3.0 > found.worst
    assert found.threshold == pytest.approx(3.0, rel=0.25)
    assert math.log(found.mild / found.worst) <= 0.15 * math.log(100)
    assert "m (95 %: " in found.text()


def test_whole_numbers_are_tried_and_nothing_between():
    tried = set()
    found = find(OFFSET, lambda value: (tried.add(value), value <= 5)[1])
    assert all(value == int(value) for value in tried)
    assert 5 <= found.threshold <= 6


@pytest.mark.parametrize(("holds", "verdict", "end"), [(True, Verdict.HOLDS, "0.5 m"), (False, Verdict.FAILS, "50 m")])
def test_without_a_limit_no_threshold_is_named(holds, verdict, end):
    found = find(FOG, lambda _: holds)
    assert found.verdict is verdict
    assert (found.threshold, found.runs < 30) == (None, True)
    assert end in found.text()
    assert "no threshold" in found.text()


def test_a_search_ends_at_the_most_runs_and_says_so():
    found = find(FOG, lambda value: value > 3.0, most=4)
    assert (found.verdict, found.runs) == (Verdict.ENDED, 4)
    assert "wider than asked for" in found.text()


def test_a_threshold_is_found_once_the_slope_can_be_told_or_no_more_runs_are_allowed():
    # 14 runs make this interval narrow enough; how abrupt it is they do not tell.
    assert find(FOG, lambda value: value > 3.0).runs == 25
    found = find(FOG, lambda value: value > 3.0, most=20)
    assert (found.verdict, found.runs) == (Verdict.FOUND, 20)


def test_a_search_that_is_taken_up_again_is_the_same():
    chance = np.random.default_rng(2).random(80)

    def noisy(number, value):
        return bool(chance[number] < (0.9 if value > 3.0 else 0.2))

    made = []

    def carry_out(planned):
        trial = Trial(*vars(planned).values(), "finished", 0.01, 1.0, noisy(planned.number, planned.value))
        made.append(trial)
        return trial

    whole = search(FOG, SCENES, 7, [], carry_out, width=0.15, most=80)
    trials = list(made)
    for count in (1, 7, len(trials)):
        made.clear()
        assert search(FOG, SCENES, 7, trials[:count], carry_out, width=0.15, most=80) == whole
        assert made == trials[count:]
    refused(search, FOG, SCENES, 8, trials, carry_out, width=0.15, most=80, names="search", error=NoisyWorldError)


def test_scenes_come_as_often_as_each_other_in_another_order():
    order = [scene_of(number, SCENES, 7) for number in range(30)]
    rounds = [tuple(order[start : start + 3]) for start in range(0, 30, 3)]
    assert all(sorted(each) == SCENES for each in rounds)
    assert len(set(rounds)) > 2


def axis(name, parameter=None, mild=None, worst=None):
    return axis_of(registry()[name], parameter, mild, worst)


def test_severities_say_which_way_is_worse():
    # The tables: visibility 50 to 6 m, standard deviation .08 to .38.
    fog, noise = axis("fog_depth", "visibility_m"), axis("gaussian_noise", "std")
    assert (fog.mild, fog.worst, fog.unit) == (200.0, 1.5, "m")
    assert (noise.mild, noise.worst) == (0.02, 1.52)
    severity = axis("fog_depth")
    assert (severity.name, severity.mild, severity.worst, severity.logarithmic) == ("fog_depth.severity", 1, 5, False)
    assert axis("motion_deviation", "rotation_deg", 0, 20).logarithmic is False
    assert axis("depth_random_missing", "missing_percent").worst == 90  # the largest that the parameter takes


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("desync",), "no severities say which values of desync.offset are mild"),
        (("motion_deviation",), "name one of rotation_deg, translation_m with --parameter"),
        (("fog_depth", "visibility"), "did you mean 'visibility_m'"),
        (("fog_depth", "visibility_m", 2.0, 30.0), "worse the smaller it is; give the milder value with --from"),
        (("gaussian_noise", "std", 0.1, 3.0), "--to: 3 is no value of gaussian_noise.std; allowed: 0 to 2"),
        (("fog_depth", "visibility_m", 9.0, 9.0), "--from and --to are both 9"),
        (("gaussian_noise", "std", float("nan"), 1.0), "--from: nan is no value"),
        (("desync", None, 1.0, 2.5), "--to: 2.5 is no value of desync.offset; give a whole number"),
    ],
)
def test_bad_input_is_one_line(given, message):
    refused(axis, *given, names=message, error=NoisyWorldError)
