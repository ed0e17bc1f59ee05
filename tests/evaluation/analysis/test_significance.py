# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests against clean, against scipy and statsmodels."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from noisy_world.evaluate.spread import against_clean_table, holm, welch, wilcoxon
from noisy_world.evaluate.study_tables import tidy_runs


def test_welch_agrees_with_scipy_and_statsmodels():
    rng = np.random.default_rng(5)
    weightstats = pytest.importorskip("statsmodels.stats.weightstats")
    for _ in range(20):
        first, second = rng.normal(1.0, 2.0, rng.integers(2, 9)), rng.normal(0.0, 0.5, rng.integers(2, 9))
        found, expected = welch(first, second), stats.ttest_ind(first, second, equal_var=False)
        assert found["welch_t"] == pytest.approx(expected.statistic, rel=1e-10)
        assert found["welch_p"] == pytest.approx(expected.pvalue, rel=1e-9)
        t, p, freedom = weightstats.ttest_ind(first, second, usevar="unequal")
        assert (found["welch_t"], found["welch_p"]) == pytest.approx((t, p), rel=1e-9)
        assert found["welch_freedom"] == pytest.approx(freedom, rel=1e-9)


def test_hedges_g_of_numbers_in_ones_head():
    # Means 3 and 1, both variances 1, so the difference is 2 deviations; 1 - 3 / (4 * 4 - 1) = 0.8.
    assert welch([2.0, 3.0, 4.0], [0.0, 1.0, 2.0])["hedges_g"] == pytest.approx(1.6)


def test_welch_says_nothing_of_what_does_not_vary_or_is_too_little():
    for first, second in (([1.0], [1.0, 2.0]), ([], []), ([1.0, 1.0], [2.0, 2.0]), ([0.3, 0.1 + 0.2], [0.3, 0.3])):
        assert np.isnan(welch(first, second)["welch_p"])
    assert welch([1.0, 1.0], [2.0, 3.0])["welch_p"] == pytest.approx(
        stats.ttest_1samp([2.0, 3.0], 1.0).pvalue
    )  # one side does not vary


def test_wilcoxon_agrees_with_scipy_and_with_all_signs():
    from itertools import product

    rng = np.random.default_rng(6)
    first, second = rng.normal(0.5, 1.0, 7), rng.normal(0.0, 1.0, 7)
    found, expected = wilcoxon(first, second), stats.wilcoxon(first, second)
    assert (found["wilcoxon_w"], found["wilcoxon_p"]) == pytest.approx((expected.statistic, expected.pvalue))
    ranks = stats.rankdata(np.abs(first - second))
    sums = np.array([np.dot(ranks, signs) for signs in product((0, 1), repeat=7)])
    p = 2.0 * np.mean(sums <= found["wilcoxon_w"])
    assert found["wilcoxon_p"] == pytest.approx(p)
    up = ranks[first > second].sum()
    assert found["rank_biserial"] == pytest.approx((up - (28 - up)) / 28)


def test_a_failed_run_is_the_worst_and_two_are_equal():
    inf = np.inf
    assert wilcoxon([inf, 2.0, 3.0], [1.0, 1.0, 1.0])["rank_biserial"] == 1.0
    both = wilcoxon([inf, inf, 3.0, 5.0], [inf, 1.0, 1.0, 9.0])
    # Differences: none, infinite, 2, -4: ranks 3, 1, 2.
    assert (both["n_pairs"], both["wilcoxon_w"], both["rank_biserial"]) == (4, 2.0, pytest.approx(1.0 / 3.0))
    assert np.isnan(wilcoxon([inf, 1.0], [inf, 1.0])["wilcoxon_p"])
    assert wilcoxon([1.0], [inf])["rank_biserial"] == -1.0


def test_holm_agrees_with_statsmodels():
    multitest = pytest.importorskip("statsmodels.stats.multitest")
    rng = np.random.default_rng(7)
    for count in (1, 2, 13):
        p = rng.random(count) ** 3
        assert holm(p) == pytest.approx(multitest.multipletests(p, method="holm")[1])
    given = np.array([0.04, np.nan, 0.01, 0.03])
    assert holm(given) == pytest.approx([0.06, np.nan, 0.03, 0.06], nan_ok=True)
    assert len(holm([])) == 0


def test_the_table_pairs_by_scene_and_by_seed():
    rows = [
        {"scene": scene, "setting": setting, "perturbation": perturbation, "seed": seed, "ate_rmse_m": ate}
        for scene, setting, perturbation, seed, ate in (
            ("a", "clean", "clean", 1, 0.1),
            ("b", "clean", "clean", 1, 0.3),
            ("a", "fog", "fog", 1, 0.2),
            ("a", "fog", "fog", 2, 0.4),
            ("b", "fog", "fog", 1, 0.8),
            ("b", "fog", "fog", 2, 1.0),
        )
    ]
    runs = tidy_runs(pd.DataFrame(rows).assign(system="s", outcome="finished", failure="", mode="", severity=3))
    table = against_clean_table(runs, ["ate_rmse_m"]).set_index("unit")
    assert list(table.index) == ["scene", "scene and seed"]
    of_scenes, of_seeds = table.loc["scene"], table.loc["scene and seed"]
    assert (of_scenes["n"], of_scenes["n_clean"], of_scenes["mean"]) == (2, 2, pytest.approx((0.2 * 0.4 * 0.8) ** 0.25))
    fog = np.log([0.2 * 0.4, 0.8 * 1.0]) / 2.0  # of each scene's seeds; errors are tested by their logarithms
    expected = stats.ttest_ind(fog, np.log([0.1, 0.3]), equal_var=False)
    assert (of_scenes["welch_t"], of_scenes["welch_p"]) == pytest.approx((expected.statistic, expected.pvalue))
    assert (of_seeds["n"], of_seeds["n_pairs"]) == (4, 4)  # seed 2 has no clean run, so that of its scene stands in
    assert of_seeds["wilcoxon_p"] == pytest.approx(stats.wilcoxon([0.1, 0.3, 0.5, 0.7]).pvalue)
    assert of_seeds["wilcoxon_p_holm"] == of_seeds["wilcoxon_p"]  # a family of one
