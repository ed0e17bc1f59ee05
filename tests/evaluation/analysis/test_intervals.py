# SPDX-License-Identifier: GPL-3.0-or-later
"""Intervals, against scipy, statsmodels, equations solved by hand, and draws whose truth is known."""

import numpy as np
import pytest
from interval_coverage import (
    coverage,
    geometric_coverage,
    here_coverage,
    quantile_coverage,
    ratio_coverage,
    scene_values,
)
from scipy import stats

from noisy_world.evaluate.spread import (
    Interval,
    bootstrap_interval,
    difference_here_interval,
    exponential,
    here_interval,
    mean_interval,
    mean_p,
    share_interval,
)


@pytest.mark.parametrize("scenes", [2, 3, 8])
def test_a_mean_has_students_interval(scenes):
    values = np.random.default_rng(1).normal(3.0, 2.0, scenes)
    expected = stats.t.interval(0.95, scenes - 1, values.mean(), stats.sem(values))
    assert mean_interval(values) == pytest.approx(expected, rel=1e-12)
    weightstats = pytest.importorskip("statsmodels.stats.weightstats")
    assert mean_interval(values) == pytest.approx(weightstats.DescrStatsW(values).tconfint_mean(), rel=1e-12)
    assert exponential(mean_interval(values)) == pytest.approx(np.exp(expected), rel=1e-12)
    assert min(exponential(Interval(-1e4, 1e4))) >= 0.0
    assert np.isfinite(exponential(Interval(-1e4, 1e4))).all()


@pytest.mark.parametrize("scenes", [2, 3, 6])
def test_a_means_p_is_that_of_a_t_test_and_below_5_percent_where_the_interval_has_no_0(scenes):
    draws = np.random.default_rng(scenes)
    said = []
    for _ in range(200):
        values = draws.normal(1.0, 1.0, scenes)
        assert mean_p(values) == pytest.approx(stats.ttest_1samp(values, 0.0).pvalue, rel=1e-9)
        low, high = mean_interval(values)
        assert (mean_p(values) < 0.05) == (not low <= 0.0 <= high)
        said.append(mean_p(values) < 0.05)
    assert 0 < sum(said) < 200


def test_no_spread_is_no_interval():
    for values in ([], [0.3], [0.1 + 0.2, 0.3, 0.3], [0.0, 0.0]):
        assert np.isnan(mean_interval(values)).all()
        assert np.isnan(mean_p(values))
    assert np.isnan(here_interval(scene_values([[1.0, 2.0], [3.0]]))).all()  # one seed in a scene
    assert np.isnan(here_interval(scene_values([[1.0, 1.0], [3.0, 3.0]]))).all()
    assert np.isnan(here_interval(scene_values([]))).all()
    assert np.isnan(share_interval([1.0])).all()
    assert np.isnan(bootstrap_interval(lambda taken: taken[:, 0], 1, "one")).all()
    assert np.isnan(bootstrap_interval(lambda taken: np.full(len(taken), np.nan), 4, "nothing")).all()


def test_a_share_solves_the_score_equation():
    # Its ends are where the distance to the share is t standard errors of the end itself, as Wilson's are.
    shares = np.array([1.0, 2.0 / 3.0, 1.0 / 3.0, 1.0])
    mean, variance = shares.mean(), shares.var(ddof=1) / 4
    independent = mean * (1.0 - mean) / variance
    assert 4 < independent < 12
    for end in share_interval(shares, 12):
        assert abs(mean - end) == pytest.approx(stats.t.ppf(0.975, 3) * np.sqrt(end * (1.0 - end) / independent))


def test_a_share_of_many_scenes_is_wilsons():
    proportion = pytest.importorskip("statsmodels.stats.proportion")
    shares = np.repeat([0.0, 1.0], [3000, 7000])  # one run a scene
    expected = proportion.proportion_confint(7000, 10_000, method="wilson")
    assert share_interval(shares, 10_000) == pytest.approx(expected, abs=3e-5)


def test_where_all_scenes_agree_the_share_is_not_certain():
    low, high = share_interval([1.0, 1.0, 1.0], 9)
    assert high == 1.0
    assert low == pytest.approx(1.0 / (1.0 + stats.t.ppf(0.975, 2) ** 2 / 3.0))  # Wilson's at a share of 1
    assert share_interval([0.0, 0.0, 0.0], 9) == pytest.approx((0.0, 1.0 - low))


def test_two_groups_of_one_scene_have_welchs_interval():
    rng = np.random.default_rng(2)
    first, second = rng.normal(5.0, 3.0, 4), rng.normal(2.0, 1.0, 7)
    expected = stats.ttest_ind(first, second, equal_var=False).confidence_interval(0.95)
    assert difference_here_interval(scene_values([first]), scene_values([second])) == pytest.approx(
        tuple(expected), rel=1e-9
    )
    assert here_interval(scene_values([first])) == pytest.approx(mean_interval(first), rel=1e-12)
    exact = difference_here_interval(scene_values([first]), scene_values([[2.0]]))
    assert exact == pytest.approx(np.array(mean_interval(first)) - 2.0, rel=1e-12)


def test_the_mean_of_these_scenes_has_welchs_degrees_of_freedom():
    # By hand: variances 1/2 and 9/2 of two values each, so 1/16 and 9/16 of the mean's, with f + 2 = 3 for each.
    freedom = 0.625**2 / ((0.0625**2 + 0.5625**2) / 3.0) - 2.0
    assert 1.6 < freedom < 1.7
    low, high = here_interval(scene_values([[0.0, 1.0], [5.0, 8.0]]))
    assert (low + high) / 2.0 == pytest.approx(3.5)
    assert high - 3.5 == pytest.approx(stats.t.ppf(0.975, freedom) * np.sqrt(0.625), rel=1e-9)


def test_a_bootstrap_of_scenes_agrees_with_the_closed_form_of_a_mean():
    values = np.array([1.0, 4.0, 2.0, 8.0, 3.0])

    def mean(taken):
        return taken @ values / taken.sum(axis=1)

    found = bootstrap_interval(mean, 5, "mean", resamples=100_000)
    assert found == pytest.approx(mean_interval(values), abs=0.02 * np.ptp(mean_interval(values)))
    assert bootstrap_interval(mean, 5, "a") == bootstrap_interval(mean, 5, "a")
    assert bootstrap_interval(mean, 5, "a") != bootstrap_interval(mean, 5, "b")


SETS = 700
WITHIN = (
    0.02 + 3.0 * np.sqrt(0.95 * 0.05 / SETS) / 2.0
)  # what is allowed, and half of three standard errors of the draw


def test_intervals_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(3)
    for scenes in (2, 3, 8):
        assert coverage("normal", scenes, SETS, rng) == pytest.approx(0.95, abs=WITHIN), scenes
        assert geometric_coverage(scenes, SETS, rng) == pytest.approx(0.95, abs=WITHIN), scenes
        assert here_coverage(scenes, SETS, rng) == pytest.approx(0.95, abs=WITHIN), scenes
        for seeds in (2, 3):
            held = here_coverage(scenes, SETS, rng, errors=True, seeds=seeds)
            assert held == pytest.approx(0.95, abs=WITHIN), (scenes, seeds)
    for kind in ("success often", "success at times"):
        assert coverage(kind, 3, 200, rng) >= 0.95 - WITHIN
    assert ratio_coverage(5, 250, rng, resamples=200) == pytest.approx(0.95, abs=0.04)


def test_quantiles_of_a_bootstrap_would_not():
    rng = np.random.default_rng(4)
    assert quantile_coverage("normal", 3, 200, rng, both=False, resamples=400) < 0.85
    assert quantile_coverage("normal", 3, 200, rng, both=True, resamples=400) < 0.92
