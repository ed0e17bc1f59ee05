# SPDX-License-Identifier: GPL-3.0-or-later
"""The prediction of failure, against statsmodels, brute force and data whose answer is known."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from noisy_world.core.streams import stream
from noisy_world.evaluate.analyses import auc, auc_interval, fit_failure_model, held_out_predictions, prediction_tables
from noisy_world.evaluate.study_tables import tidy_runs, tidy_sequences


def data(count=200, seed=10):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(count, 3)) * (1.0, 5.0, 0.1) + (0.0, 10.0, 1.0)
    chance = 1.0 / (1.0 + np.exp(-(1.5 * x[:, 0] - 0.3 * (x[:, 1] - 10.0) - 0.5)))
    return x, (rng.random(count) < chance).astype(float)


def test_without_a_penalty_it_is_plain_logistic_regression():
    discrete = pytest.importorskip("statsmodels.discrete.discrete_model")
    x, failed = data()
    expected = discrete.Logit(failed, np.column_stack([np.ones(len(x)), x])).fit(disp=0)
    model = fit_failure_model(x, failed, penalty=0.0)
    assert model.coefficients / model.deviation == pytest.approx(expected.params[1:], rel=1e-4, abs=1e-5)
    assert model.probability(x) == pytest.approx(expected.predict(), abs=1e-5)


def test_with_a_penalty_no_direction_is_better():
    x, failed = data(60)
    model = fit_failure_model(x, failed, penalty=2.0)
    scaled = (x - x.mean(axis=0)) / x.std(axis=0)

    def cost(intercept, coefficients):
        p = 1.0 / (1.0 + np.exp(-(intercept + scaled @ coefficients)))
        return -np.sum(failed * np.log(p) + (1.0 - failed) * np.log(1.0 - p)) + np.sum(coefficients**2)

    best = cost(model.intercept, model.coefficients)
    for step in np.random.default_rng(11).normal(size=(50, 4)) * 0.01:
        assert cost(model.intercept + step[0], model.coefficients + step[1:]) > best


def test_hard_data_gives_finite_numbers():
    x = np.array([[0.0, 1.0], [1.0, 1.0], [2.0, 1.0], [3.0, 1.0]])
    apart = fit_failure_model(x, [0.0, 0.0, 1.0, 1.0])  # separable, and a feature that does not vary
    assert np.isfinite(apart.coefficients).all()
    assert apart.coefficients[1] == 0.0
    assert auc([0, 0, 1, 1], apart.probability(x)) == 1.0
    one_kind = fit_failure_model(x, np.ones(4))
    assert 0.5 < one_kind.probability(x).min() <= one_kind.probability(x).max() < 1.0
    gaps = fit_failure_model([[np.nan], [0.0], [1.0], [np.nan]], [1.0, 0.0, 1.0, 0.0])
    assert np.isfinite(gaps.probability([[np.nan], [5.0]])).all()
    assert fit_failure_model(np.zeros((3, 0)), [0.0, 1.0, 1.0]).probability(np.zeros((1, 0))) == pytest.approx(2 / 3)


def test_auc_is_the_share_of_pairs_in_order():
    rng = np.random.default_rng(12)
    failed, score = rng.random(40) < 0.3, np.round(rng.random(40), 1)
    pairs = [(a > b) + 0.5 * (a == b) for a in score[failed] for b in score[~failed]]
    assert auc(failed, score) == pytest.approx(np.mean(pairs))
    assert np.isnan(auc([1, 1], [0.1, 0.2]))
    assert np.isnan(auc([], []))


def test_a_scene_is_predicted_without_its_own_results():
    x, failed = data(90)
    scenes = np.array(list("abc") * 30)
    chance, base = held_out_predictions(x, failed, scenes)
    turned = np.where(scenes == "b", 1.0 - failed, failed)
    again, again_base = held_out_predictions(x, turned, scenes)
    assert np.array_equal(chance[scenes == "b"], again[scenes == "b"])
    assert not np.array_equal(chance[scenes == "a"], again[scenes == "a"])
    assert base[scenes == "b"] == pytest.approx(failed[scenes != "b"].mean())
    assert np.array_equal(base[scenes == "b"], again_base[scenes == "b"])
    alone, _ = held_out_predictions(x, failed, np.full(90, "a"))
    assert np.isnan(alone).all()


def test_the_interval_of_an_auc_is_that_of_whole_scenes_drawn_again():
    rng = np.random.default_rng(14)
    scenes = np.array(list("abcdef") * 12)
    failed = (rng.random(72) < 0.4).astype(float)
    score = np.round(failed + rng.normal(scale=1.2, size=72), 1)
    found = []
    for taken in stream("analysis", "auc", "s").multinomial(6, np.full(6, 1 / 6), size=2000):
        often = np.repeat(np.arange(72), taken[np.searchsorted(list("abcdef"), scenes)])
        found.append(auc(failed[often], score[often]))
    half = stats.t.ppf(0.975, 5) * np.std(found) * np.sqrt(6 / 5)
    expected = np.clip([auc(failed, score) - half, auc(failed, score) + half], 0.0, 1.0)
    assert auc_interval(failed, score, scenes, "s") == pytest.approx(expected, rel=1e-9)
    for scores, of in ((np.full(72, np.nan), failed), (score, np.zeros(72))):
        assert np.isnan(auc_interval(of, scores, scenes, "s")).all()
    assert np.isnan(auc_interval(failed, score, np.full(72, "a"), "s")).all()


def test_an_error_above_twice_the_clean_one_is_an_outcome_of_its_own():
    rng = np.random.default_rng(15)
    runs, sequences = [], []
    for scene, clean_m in (("a", 0.001), ("b", 0.02), ("c", 0.2)):
        for number in range(30):
            contrast = rng.uniform(0.1, 0.9)
            over = 1.0 if number == 0 else 3.0 if contrast < 0.4 else 1.5
            key = {"scene": scene, "setting": f"s{number}", "seed": 1, "perturbation": "fog" if number else "clean"}
            sequences.append({**key, "contrast_mean": contrast})
            ate_m = over * clean_m
            runs.append({**key, "system": "s", "repeat": 1, "ate_rmse_m": ate_m, "success_10cm": float(ate_m < 0.1)})
    table = pd.DataFrame(runs).assign(outcome="finished", failure="", tracked_share=1.0)
    folds, _, predicted = prediction_tables(tidy_runs(table), tidy_sequences(pd.DataFrame(sequences)))
    whole = folds[folds["held_out"] == "all"].set_index("outcome")
    assert list(whole["n"]) == [90, 87]  # a clean run is not held against itself
    assert whole.loc["success_10cm", "n_without_success"] == 30  # all of scene c, whatever was done
    worse = predicted[predicted["outcome"] == "success_2x_clean"].set_index(["scene", "setting"])["without_success"]
    over = table.assign(over=table["ate_rmse_m"] / table["scene"].map({"a": 0.001, "b": 0.02, "c": 0.2}))
    expected = (over.set_index(["scene", "setting"])["over"] > 2.0).astype(float)
    assert worse.to_dict() == {key: value for key, value in expected.to_dict().items() if key[1] != "s0"}
    assert whole.loc["success_2x_clean", "auc"] > 0.98


def tables(noise):
    rng = np.random.default_rng(13)
    runs, sequences = [], []
    for scene in "abcd":
        for number in range(30):
            tracked = rng.uniform(5.0, 300.0)
            failed = rng.random() < 0.5 if noise else tracked < 60.0
            key = {"scene": scene, "setting": f"s{number}", "seed": 1, "perturbation": "fog"}
            sequences.append({**key, "orb_tracked_low": tracked, "image_noise_mean": rng.random()})
            success = None if failed else 1.0
            runs += [{**key, "system": "s", "repeat": k, "success_10cm": success} for k in (1, 2)]
    table = pd.DataFrame(runs).assign(outcome="finished", failure="", ate_rmse_m=0.1)
    table.loc[table["success_10cm"].isna(), "failure"] = "no_poses"
    return prediction_tables(tidy_runs(table), tidy_sequences(pd.DataFrame(sequences)))


def test_what_the_images_tell_is_found_and_what_they_do_not_tell_is_not():
    folds, coefficients, predicted = tables(noise=False)
    whole = folds.set_index("held_out").loc["all"]
    assert list(folds["held_out"]) == ["a", "b", "c", "d", "all"]
    assert (whole["n"], folds["n_without_success"].iloc[:4].sum()) == (120, whole["n_without_success"])
    assert whole["auc"] > 0.98
    assert whole["skill"] > 0.5
    assert coefficients.set_index("feature")["coefficient"]["orb_tracked_low"] < -1.0
    y, p = predicted["without_success"], predicted["predicted"]
    assert whole["brier"] == pytest.approx(np.mean((y - p) ** 2))
    blind = tables(noise=True)[0].set_index("held_out").loc["all"]
    assert blind["auc"] == pytest.approx(0.5, abs=0.15)
    assert blind["skill"] < 0.1
