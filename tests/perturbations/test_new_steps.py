# SPDX-License-Identifier: GPL-3.0-or-later
"""What a newly added step begins with, and what a chain clips: on scenes and numbers that nothing was tuned on."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from cases import cases
from srgb import linear

from noisy_world.core.schema import ConfigPath, key
from noisy_world.perturbations import registry
from noisy_world.perturbations.clipping import clipping
from noisy_world.perturbations.execution import ColourWork
from noisy_world.perturbations.kinds import ColourPerturbation, FrameContext
from noisy_world.perturbations.new_steps import is_overlay, new_step
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.perturbations.steps import Step, deciding

WHERE = FrameContext(0, (3, "scene", "setting"))


def steps(*items):
    return parse_steps(list(items), ConfigPath(None), registry())


@cases(
    "depth_m, outdoors",
    [
        ([1.0, 2.0, 3.0, 5.0, 0.0], False),
        ([2.0, 9.0, 14.0, 0.0], False),
        ([1.0, 4.0, 30.0, 60.0, 0.0], True),
        ([8.0, 90.0, 400.0, 0.0], True),
    ],
)
def test_fog_begins_by_how_far_one_sees_and_says_so(depth_m, outdoors):
    made = new_step(registry()["fog_depth"], (), np.repeat(np.float32([depth_m]), 4, axis=0))
    assert made.given["outdoors"] is outdoors
    assert ("streets" in made.says[0]) is outdoors
    (step,) = steps({"fog_depth": made.values})
    # Half of what is seen keeps at least 0.55 of its contrast, in a room as in a valley.
    seen = 0.05 ** (np.median([each for each in depth_m if each]) / step.parameters(3).visibility_m)
    assert seen == pytest.approx(0.55, abs=0.01)


def test_where_no_depth_is_known_fog_has_the_severities_of_rooms():
    made = new_step(registry()["fog_depth"], (), np.zeros((2, 2), np.float32))
    assert (made.given["outdoors"], "reach" in made.given) == (False, False)
    (step,) = steps({"fog_depth": made.values})
    assert step.parameters(3).visibility_m == 15


@cases(
    "given, visibility_m",
    [({}, 15), ({"reach": 2.0}, 30), ({"reach": 0.5, "severity": 5}, 3), ({"reach": 2.0, "visibility_m": 7.0}, 7)],
)
def test_the_reach_of_fog_is_that_of_its_severities(given, visibility_m):
    (step,) = steps({"fog_depth": given})
    assert step.parameters(step.severity).visibility_m == visibility_m


@cases(
    "depth_m, given, says",
    [
        ([2.0, 6.0, 0.0], {"air_around": True, "void_m": 6.0}, "Indoors"),
        ([2.0, 60.0, 0.0], {"air_around": False}, "Outdoors"),
        ([0.0], {"air_around": False}, "no depth is known"),
    ],
)
def test_air_indoors_is_lit_by_all_that_is_seen_and_lies_before_a_window_too(depth_m, given, says):
    made = new_step(registry()["haze"], (), np.float32([depth_m]))
    assert dict(made.given) == {"coarse": True} | given
    assert says in made.says[0]


def test_severities_of_what_has_none_cannot_be_stretched():
    with pytest.raises(ValueError, match="stretched"):
        replace(registry()["fog_depth"], stretched={"reach": "visibility_m"})


def test_nothing_is_chosen_by_a_depth_that_is_not_known():
    assert "outdoors" not in new_step(registry()["fog_depth"]).given


def test_the_first_overlay_begins_in_the_middle_and_those_on_top_at_1():
    benchmark = [registry()[name] for name in ("fog", "frost", "snow", "spatter")]
    assert all(map(is_overlay, benchmark))
    assert new_step(benchmark[1], [registry()["gaussian_noise"]]).severity == 3
    later = new_step(benchmark[1], benchmark[:1])
    assert later.severity == 1
    assert "fog" in later.says[0]
    assert not new_step(registry()["haze"], benchmark).says


def test_what_a_new_step_says_is_a_step_and_older_presets_keep_their_identity():
    """Each of them is read as a preset's; what came later stands in an identity only where it is given."""
    for perturbation in registry().values():
        made = new_step(perturbation)
        (step,) = steps({perturbation.name: made.values})
        assert set(perturbation.newly) <= set(deciding(step.parameters(step.severity)))
        older = steps({perturbation.name: {} if made.severity is None else {"severity": made.severity}})[0]
        known = perturbation.parameters.__dataclass_fields__
        came_later = {name for name in perturbation.newly if known[name].metadata["key"].later}
        assert not came_later & set(deciding(older.parameters(older.severity)))


def test_sensor_noise_grows_by_equal_steps():
    """The deviation of a grey field of light, which grew to ten times; severities 1 and 3 stay as they were."""
    perturbation = registry()["sensor_noise"]
    grey = np.full((64, 64, 3), 0.5, np.float32)
    where = FrameContext(0, (3, "scene", "setting", "sensor_noise", 0))
    found = {}
    for even in (False, True):
        of = [perturbation.apply(grey, perturbation.at_severity(k, even_steps=even), where) for k in range(1, 6)]
        found[even] = np.array([linear(image).std() for image in of])
    assert found[True][[0, 2]] == pytest.approx(found[False][[0, 2]], rel=1e-6)
    assert np.diff(found[True]) == pytest.approx(np.full(4, np.diff(found[True]).mean()), rel=0.08)
    assert np.diff(found[False])[-1] > 3 * np.diff(found[False])[0]


def test_a_lens_keeps_its_dirt_over_a_sweep_and_another_one_has_other_dirt():
    """On a picture with a lamp, each severity changes more than the one before, whatever the setting is called."""
    perturbation = registry()["lens_dirt"]
    rng = np.random.default_rng(8)
    rgb = np.clip(rng.random((90, 160, 3), np.float32) * 0.5, 0, 1)
    rgb[20:26, 60:66] = 1

    def change(severity, lens, setting):
        where = FrameContext(0, (3, "scene", setting, "lens_dirt", 0), temporal="fixed")
        return perturbation.apply(rgb, perturbation.at_severity(severity, lens=lens), where) - rgb

    sizes = [np.abs(change(severity, 4, f"dirt_{severity}")).mean() for severity in range(1, 6)]
    assert np.all(np.diff(sizes) > 0)
    assert np.array_equal(change(3, 4, "a"), change(3, 4, "b"))
    assert not np.array_equal(change(3, 4, "a"), change(3, 5, "a"))
    assert not np.array_equal(change(3, 0, "a"), change(3, 0, "b"))


@dataclass(frozen=True)
class Above:
    """Values above a level become white or, below one, black."""

    level: float = key("the level", default=1.0)
    black: bool = key("what is below becomes black instead", default=False)


def ends(rgb, parameters, _):
    if parameters.black:
        return np.where(rgb < np.float32(parameters.level), np.float32(-0.2), rgb)
    return np.where(rgb > np.float32(parameters.level), np.float32(1.2), rgb)


def clipper(number, **given):
    kind = {"label": "Clips", "stage": "post", "order": 99, "parameters": Above, "severities": {}, "source": "a test"}
    return Step(ColourPerturbation(name=f"clips{number}", apply=ends, **kind), 0, None, None, "fresh", given)


@cases(
    "given, told",
    [
        ([{"level": 0.8}, {"level": 0.65}], None),
        ([{"level": 0.9}, {"level": 0.3}], ("clips1", 0.6, True)),
        ([{"level": 0.3}, {"level": 0.25}], ("clips0", 0.7, True)),
        ([{"level": 0.7, "black": True}, {"level": 0.9}], ("clips0", 0.7, False)),
    ],
)
def test_a_chain_that_clips_much_is_told_with_the_step_that_does_most_of_it(given, told):
    """Of an even ramp as much ends as the levels say, so the shares are known."""
    ramp = np.repeat(np.arange(1, 255, dtype=np.uint8)[None, :, None], 3, axis=2)
    work = ColourWork.of([clipper(number, **values) for number, values in enumerate(given)], WHERE)
    found = clipping(work.active, ramp, work.on(ramp))
    if told is None:
        assert found is None
        return
    assert (found.step, found.white) == (told[0], told[2])
    assert found.own == pytest.approx(told[1], abs=0.01)
    assert ("white" if told[2] else "black") in found.note("a setting")


def test_what_was_white_before_is_not_blamed_on_the_steps():
    white = np.full((4, 4, 3), 255, np.uint8)
    work = ColourWork.of(steps({"brightness": {"severity": 5}}), WHERE)
    assert clipping(work.active, white, work.on(white)) is None
