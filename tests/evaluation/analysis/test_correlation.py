# SPDX-License-Identifier: GPL-3.0-or-later
"""Correlations, against scipy, statsmodels and numbers in one's head."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from noisy_world.evaluate.analyses import (
    indicator_correlations,
    pearson,
    perturbation_correlations,
    spearman,
    system_correlations,
)
from noisy_world.evaluate.study_tables import tidy_runs, tidy_sequences


def runs_of(rows):
    names = ("system", "scene", "setting", "perturbation", "mode", "severity", "ate_rmse_m", "failure")
    table = pd.DataFrame(rows, columns=names)
    return tidy_runs(table.assign(seed=1, repeat=1, outcome="finished"))


def test_pearson_agrees_with_numpy_and_fisher():
    rng = np.random.default_rng(8)
    x = rng.normal(size=30)
    y = 0.5 * x + rng.normal(size=30)
    r, low, high, p = pearson(x, y)
    assert r == pytest.approx(np.corrcoef(x, y)[0, 1])
    assert (np.arctanh(low), np.arctanh(high)) == pytest.approx(
        (np.arctanh(r) - 1.959963985 / np.sqrt(27), np.arctanh(r) + 1.959963985 / np.sqrt(27))
    )
    assert p == pytest.approx(2.0 * stats.t.sf(abs(r) * np.sqrt(28.0 / (1.0 - r**2)), 28))


def test_what_does_not_vary_has_no_correlation():
    for x, y in (([1.0, 1.0, 1.0, 1.0], [1.0, 2.0, 3.0, 4.0]), ([1.0, 2.0, 3.0], [1.0, 2.0, 4.0]), ([], [])):
        assert np.isnan(pearson(x, y)).all()
        assert np.isnan(spearman(x, y)).all()


def test_spearman_of_failed_runs():
    x, y = [0.1, 0.5, np.inf, np.inf, 0.2], [0.3, 0.4, 7.0, np.inf, 0.1]
    expected = stats.spearmanr([0.1, 0.5, 9.0, 9.0, 0.2], [0.3, 0.4, 7.0, 99.0, 0.1])
    assert spearman(x, y) == pytest.approx((expected.statistic, expected.pvalue))


def test_perturbations_are_compared_within_a_mode_over_systems_scenes_and_severities():
    rows = [("s", "a", "clean", "clean", "", None, 0.01, "")]
    fog, blur = {}, {}
    rng = np.random.default_rng(9)
    for scene in ("a", "b"):
        for severity in (1, 3, 5):
            fog[scene, severity], blur[scene, severity] = rng.random(2)
            rows.append(("s", scene, f"fog{severity}", "fog", "static", severity, fog[scene, severity], ""))
            rows.append(("s", scene, f"blur{severity}", "blur", "static", severity, blur[scene, severity], ""))
            rows.append(("s", scene, f"fogd{severity}", "fog", "dynamic", severity, 1.0 / severity, ""))
    rows[2] = (*rows[2][:6], None, "no_poses")
    blur["a", 1] = np.inf
    table = perturbation_correlations(runs_of(rows))
    assert table[["mode", "a", "b", "n", "n_scenes"]].to_numpy().tolist() == [["static", "blur", "fog", 6, 2]]
    expected = stats.spearmanr(np.nan_to_num(list(blur.values()), posinf=9.0), list(fog.values()))
    assert table.loc[0, ["spearman", "p"]].to_list() == pytest.approx([expected.statistic, expected.pvalue])


def test_systems_are_compared_over_scenes_and_settings():
    rows = []
    for place, scene in enumerate("abcde"):
        rows.append(("one", scene, "fog", "fog", "static", 3, float(place), ""))
        rows.append(("two", scene, "fog", "fog", "static", 3, float(-place), ""))
        rows.append(("one", scene, "fast", "faster_motion", "", None, 10.0 + place, ""))
    rows.append(("two", "a", "fast", "faster_motion", "", None, 100.0, ""))
    table = system_correlations(runs_of(rows)).set_index("mode")
    assert list(table.index) == ["all", "", "static"]
    assert table.loc["static", ["a", "b", "n", "spearman"]].to_list() == ["one", "two", 5, pytest.approx(-1.0)]
    assert table.loc["all", "n"] == 6
    assert np.isnan(table.loc["", "spearman"])  # a single cell


def test_indicators_go_with_the_error_of_their_sequence():
    rows, sequences = [], []
    errors = {"clean": 0.01, "n1": 0.1, "n2": 1.0, "n3": None, "n4": 10.0}
    for severity, (setting, error) in enumerate(errors.items()):
        perturbation = "clean" if setting == "clean" else "noise"
        failure = "no_poses" if error is None else ""
        rows.append(("s", "a", setting, perturbation, "", severity or None, error, failure))
        sequences.append({"scene": "a", "setting": setting, "seed": 1, "image_noise_mean": float(severity)})
    table = indicator_correlations(runs_of(rows), tidy_sequences(pd.DataFrame(sequences)))
    assert table[["perturbation", "indicator"]].to_numpy().tolist() == [
        ["all", "image_noise"],
        ["noise", "image_noise"],
    ]
    row = table.iloc[0]
    assert (row["n"], row["n_ranked"], row["n_scenes"]) == (4, 5, 1)
    assert row["pearson"] == pytest.approx(np.corrcoef([0, 1, 2, 4], [0.01, 0.1, 1.0, 10.0])[0, 1])
    assert row["pearson_log10"] == pytest.approx(np.corrcoef([0, 1, 2, 4], [-2, -1, 0, 1])[0, 1])
    assert row["spearman"] == pytest.approx(stats.spearmanr([0, 1, 2, 3, 4], [1, 2, 3, 5, 4]).statistic)
