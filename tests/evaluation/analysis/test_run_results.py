# SPDX-License-Identifier: GPL-3.0-or-later
"""Incomplete runs: counted, worst in ranks, 0 in success, and in no mean of an error; exact zeros in means."""

import numpy as np
import pandas as pd
import pytest

from noisy_world.evaluate.analyses import analyse
from noisy_world.evaluate.study_tables import (
    complete_runs,
    errors_of,
    geometric_deviation,
    geometric_mean,
    tidy_runs,
    with_results,
)

# The estimate of room a holds 15 % of the frames, so its error is small.
RUNS = [
    ("a", "clean", 0.001, 1.0, ""),
    ("b", "clean", 0.001, 1.0, ""),
    ("a", "frost", 0.0001, 0.15, ""),
    ("b", "frost", 0.04, 0.8, ""),
    ("c", "frost", 0.09, 1.0, ""),
    ("d", "frost", np.nan, 0.0, "no_poses"),
]


def table(rows=RUNS):
    runs = pd.DataFrame(rows, columns=["scene", "setting", "ate_rmse_m", "tracked_share", "failure"])
    runs = runs.assign(perturbation=runs["setting"], mode="static", severity=3, seed=1, repeat=1, system="mine")
    tracks = (runs["tracked_share"] >= 0.8) & runs["ate_rmse_m"].notna()
    runs = runs.assign(outcome="finished", success_auc=(1.0 - runs["ate_rmse_m"]).clip(0.0).where(tracks, 0.0))
    return runs.assign(**{"paper.ate_m": runs["ate_rmse_m"].fillna(1.0)})


def test_a_run_is_failed_incomplete_or_complete():
    runs = with_results(table())
    assert runs["result"].tolist() == ["complete", "complete", "incomplete", "complete", "complete", "failed"]
    assert runs["incomplete"].tolist() == [False, False, True, False, False, False]
    assert complete_runs(runs)["scene"].tolist() == ["a", "b", "b", "c"]
    by_paper = with_results(table().rename(columns={"tracked_share": "strict.tracked_share"}))
    assert by_paper["result"].tolist() == runs["result"].tolist()
    assert not with_results(table().drop(columns="tracked_share"))["incomplete"].any()


def test_an_incomplete_run_is_counted_and_in_no_mean_of_an_error():
    tables = analyse(table(), table()[["scene", "setting", "seed"]])
    rows = tables["spread"].set_index(["setting", "measure"])
    ate = rows.loc[("frost", "ate_rmse_m")]
    assert (ate["n_runs"], ate["n_failed"], ate["n_incomplete"], ate["n"]) == (4, 1, 1, 2)
    assert (ate["mean"], ate["minimum"]) == pytest.approx((0.06, 0.04))  # of 4 and 9 cm
    assert rows.loc[("frost", "incomplete"), "mean"] == 0.25
    assert rows.loc[("frost", "success_auc"), "minimum"] == 0.0
    assert rows.loc[("frost", "paper.ate_m"), "minimum"] == 0.0001  # the paper knows no incomplete runs
    assert rows.loc[("frost", "paper.ate_m"), "average"] == "arithmetic"


def test_an_incomplete_run_ranks_with_the_failed():
    runs = tidy_runs(table())
    errors = dict(zip(runs[["scene", "setting"]].itertuples(index=False, name=None), errors_of(runs), strict=True))
    assert errors[("a", "frost")] == errors[("d", "frost")] == np.inf
    assert errors[("c", "frost")] == 0.09


def test_an_exact_zero_counts_as_a_billionth():
    assert geometric_mean([0.0, 1.0]) == pytest.approx(1e-9**0.5)
    assert geometric_mean([1e-17, 0.0]) == pytest.approx(1e-9)
    assert np.isnan(geometric_mean([]))
    assert geometric_deviation([0.01, 0.1]) == pytest.approx(np.exp(np.log(10.0) / 2.0**0.5))
    runs = table([("a", "clean", 0.0, 1.0, ""), ("a", "frost", 0.01, 1.0, ""), ("b", "frost", 0.0, 1.0, "")])
    tables = analyse(runs, runs[["scene", "setting", "seed"]])
    spread = tables["spread"].set_index(["setting", "measure"])
    assert spread.loc[("frost", "ate_rmse_m"), "mean"] == pytest.approx((0.01 * 1e-9) ** 0.5)
    assert spread.loc[("frost", "ate_rmse_m"), "minimum"] == 0.0
    differences = tables["differences"].set_index("measure")
    assert np.isnan(differences.loc["ate_rmse_m", "ratio"])  # nothing is so many times an error of 0


def test_no_lower_end_of_an_error_is_below_zero():
    runs = table([(scene, "frost", ate_m, 1.0, "") for scene, ate_m in (("a", 1e-6), ("b", 30.0))])
    spread = analyse(runs, runs[["scene", "setting", "seed"]])["spread"]
    ends = spread[spread["measure"].isin(["ate_rmse_m", "paper.ate_m"])]
    assert (ends["low"] >= 0.0).all()
    assert (ends["low"] < ends["mean"]).all()
