# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors over clean, in numbers that one works out in one's head."""

import numpy as np
import pandas as pd
import pytest

from noisy_world.evaluate.study_tables import (
    SETTING,
    metric_of,
    over_clean_table,
    tidy_runs,
    with_over_clean,
    with_results,
)

# scene, setting, seed, repeat, ATE in metres, tracked share, failure
CLEAN = (("a", "clean", 1, 1, 0.001, 1.0, ""), ("b", "clean", 1, 1, 0.004, 1.0, ""))


def table(*rows, systems=("mine",)):
    names = ("scene", "setting", "seed", "repeat", "ate_rmse_m", "tracked_share", "failure")
    runs = pd.DataFrame([{**dict(zip(names, row, strict=True)), "system": name} for name in systems for row in rows])
    runs["perturbation"] = runs["setting"].str.split("_").str[0]
    return runs.assign(mode="static", severity=np.nan, outcome="finished")


def found_in(runs, *names):
    return with_over_clean(with_results(runs))[list(names)].to_numpy().tolist()


def test_a_run_is_compared_with_its_own_scene_s_clean_run():
    runs = table(*CLEAN, ("a", "fog", 1, 1, 0.0079, 1.0, ""), ("b", "fog", 2, 1, 0.0079, 1.0, ""))
    assert found_in(runs, "ate_over_clean") == [[1.0], [1.0], [pytest.approx(7.9)], [pytest.approx(1.975)]]
    successes = found_in(runs, "success_2x_clean", "success_5x_clean", "success_10x_clean")
    assert successes == [[1, 1, 1], [1, 1, 1], [0, 0, 1], [1, 1, 1]]


def test_a_seed_is_compared_with_the_clean_run_of_its_own():
    # Where clean frames differ from seed to seed, another seed's are no reference.
    clean = (*CLEAN[:1], ("a", "clean", 2, 1, 0.002, 1.0, ""))
    runs = table(*clean, *(("a", "fog", seed, 1, 0.01, 1.0, "") for seed in (1, 2, 3)))
    assert [row[0] for row in found_in(runs, "ate_over_clean")[2:4]] == pytest.approx([10.0, 5.0])
    assert np.isnan(found_in(runs, "ate_over_clean", "success_10x_clean")[4]).all()


def test_repeats_of_clean_are_their_median():
    clean = [("a", "clean", 1, k, ate_m, 1.0, "") for k, ate_m in enumerate((0.001, 0.002, 0.5), start=1)]
    assert found_in(table(*clean, ("a", "fog", 1, 1, 0.02, 1.0, "")), "ate_over_clean")[3] == [pytest.approx(10.0)]


@pytest.mark.parametrize(
    ("broken", "name"),
    [(("a", "fog", 1, 1, np.nan, 0.0, "no_poses"), "n_failed"), (("a", "fog", 1, 1, 1e-4, 0.79, ""), "n_incomplete")],
)
def test_a_run_that_failed_or_is_incomplete_is_counted_and_has_no_ratio(broken, name):
    runs = table(*CLEAN, broken, ("b", "fog", 1, 1, 0.012, 0.8, ""))
    assert np.isnan(found_in(runs, "ate_over_clean")[2][0])
    assert found_in(runs, "success_10x_clean") == [[1.0], [1.0], [0.0], [1.0]]
    (row,) = over_clean_table(tidy_runs(runs), ["system", *SETTING]).to_dict("records")
    assert (row["n_runs"], row["n"], row[name], row["n_failed"] + row["n_incomplete"]) == (2, 1, 1, 1)
    assert row["over_clean"] == pytest.approx(3.0)


@pytest.mark.parametrize("clean", [("a", "clean", 1, 1, np.nan, 0.0, "no_poses"), ("a", "clean", 1, 1, 0.1, 0.5, "")])
def test_without_a_clean_run_that_holds_nothing_is_said(clean):
    runs = table(clean, ("a", "fog", 1, 1, 0.02, 1.0, ""), ("a", "frost", 1, 1, np.nan, 0.0, "no_poses"))
    assert np.isnan(found_in(runs, "ate_over_clean", "success_10x_clean")).all()
    rows = over_clean_table(tidy_runs(runs), ["system", "setting"]).to_dict("records")
    assert [(row["n_runs"], row["n_failed"], row["n"]) for row in rows] == [(1, 0, 0), (1, 1, 0)]
    assert np.isnan(tidy_runs(runs)["success_10x_clean"]).all()


def test_a_system_is_compared_with_itself_alone():
    runs = pd.concat([table(*CLEAN, systems=("other",)), table(("a", "fog", 1, 1, 0.02, 1.0, ""))])
    assert np.isnan(found_in(runs, "ate_over_clean")[2][0])


def test_scenes_weigh_alike_in_geometric_means():
    fog = [("a", "fog", seed, 1, ate_m, 1.0, "") for seed, ate_m in ((1, 0.01), (2, 0.01), (3, 0.01))]
    runs = table(*CLEAN, *fog, ("b", "fog", 1, 1, 0.64, 1.0, ""))
    (row,) = over_clean_table(tidy_runs(runs), ["system", "setting"]).to_dict("records")
    assert row["over_clean"] == pytest.approx(40.0)  # of 10 and 160
    assert (row["ate_m"], row["clean_ate_m"]) == pytest.approx((0.08, 0.002))
    assert (row["least"], row["most"], row["n_scenes"]) == (pytest.approx(10.0), pytest.approx(160.0), 2)


def test_columns_have_their_meaning():
    assert metric_of("success_10x_clean").label == "success at 10 \u00d7 clean"
    assert metric_of("ate_over_clean").better == "lower"


def test_a_table_of_protocol_paper_stays_as_it_is():
    runs = with_results(table(*CLEAN).rename(columns={"ate_rmse_m": "ate_m"}))
    assert with_over_clean(runs) is runs
    assert over_clean_table(tidy_runs(runs), ["system"]).empty
