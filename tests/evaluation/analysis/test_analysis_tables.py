# SPDX-License-Identifier: GPL-3.0-or-later
"""All tables at once: numbers in one's head, and tables that lack something."""

import io
import statistics
import warnings

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from noisy_world.evaluate.analyses import CAPTIONS, analyse, robustness_table

SETTINGS = (
    ("clean", "clean", "", None),
    ("fog1", "fog", "static", 1),
    ("fog5", "fog", "static", 5),
    ("blur3", "gaussian_blur", "dynamic", 3),
    ("fast", "faster_motion", "", None),
)
SCENES = ("a", "b", "c")
ATE = {"clean": 0.01, "fog1": 0.02, "fog5": 0.4, "blur3": 0.05, "fast": 0.01}
FACTOR = {"a": 1.0, "b": 2.0, "c": 4.0}


def made(systems=("one", "two"), scenes=SCENES, settings=SETTINGS):
    """Runs whose ATE is a product of setting, scene and seed; system `two` fails once."""
    runs, sequences = [], []
    for scene in scenes:
        for setting, perturbation, mode, severity in settings:
            for seed in (1, 2) if setting != "clean" else (1,):
                key = {"scene": scene, "setting": setting, "perturbation": perturbation, "mode": mode}
                key |= {"severity": severity, "seed": seed}
                ate = ATE[setting] * FACTOR[scene] * (1.25 if seed == 2 else 1.0)
                sequences.append({**key, "frames": 50, "orb_tracked_mean": 10.0 / ate, "speed_mps_mean": 0.3})
                for system in systems:
                    failed = system == "two" and (setting, scene, seed) == ("fog5", "c", 2)
                    score = {"ate_rmse_m": None if failed else ate, "success_auc": None if failed else 1.0 - ate / 4.0}
                    score |= {"success_10cm": float(not failed and ate < 0.1), "frames": 50, "seconds": 1.0}
                    word = {"outcome": "crashed" if failed else "finished", "failure": "no_poses" if failed else ""}
                    runs.append({**key, "system": system, "repeat": 1, **word, **score})
    return pd.DataFrame(runs), pd.DataFrame(sequences)


@pytest.fixture(scope="module")
def tables():
    return analyse(*made())


def row_of(table, **key):
    found = table[np.logical_and.reduce([table[name] == value for name, value in key.items()])]
    assert len(found) == 1, found
    return found.iloc[0]


def test_every_table_has_a_caption_and_columns(tables):
    assert list(tables) == list(CAPTIONS)
    assert all("\n" not in caption and caption.endswith(".") for caption in CAPTIONS.values())
    empty = {name for name, table in tables.items() if not len(table)}
    # No depth is told, no two perturbations share a mode, and the model has no features.
    assert empty == {"depth", "perturbation_correlations", "prediction_coefficients"}


def test_spread_over_scenes_and_seeds(tables):
    row = row_of(tables["spread"], system="one", setting="fog1", measure="ate_rmse_m")
    assert (row["n_runs"], row["n_failed"], row["n"], row["n_scenes"]) == (6, 0, 6, 3)
    middle = 0.04 * np.sqrt(1.25)  # of scenes of 0.02, 0.04 and 0.08 times that of two seeds
    assert (row["average"], row["mean"]) == ("geometric", pytest.approx(middle))
    at_large = np.exp(stats.t.ppf(0.975, 2) * np.log(2.0) / np.sqrt(3.0))
    assert (row["low"], row["high"]) == pytest.approx((middle / at_large, middle * at_large))
    here = np.exp(stats.t.ppf(0.975, 3) * np.sqrt(3.0 * np.log(1.25) ** 2 / 4.0) / 3.0)
    assert (row["here_low"], row["here_high"]) == pytest.approx((middle / here, middle * here))
    assert (row["minimum"], row["maximum"], row["median"]) == pytest.approx((0.02, 0.1, 0.045))
    logs = np.log([0.02, 0.025, 0.04, 0.05, 0.08, 0.1])
    assert row["standard_deviation"] == pytest.approx(np.exp(statistics.stdev(logs)))
    score = row_of(tables["spread"], system="one", setting="fog1", measure="success_auc")
    assert (score["average"], score["mean"]) == ("arithmetic", pytest.approx(1.0 - 0.0525 / 4.0))
    clean = row_of(tables["spread"], system="one", setting="clean", measure="ate_rmse_m")
    assert np.isnan(clean["here_low"])  # one seed, one repeat: nothing is known of others


def test_differences_to_clean_are_scene_by_scene(tables):
    row = row_of(tables["differences"], system="one", setting="fog1", measure="ate_rmse_m")
    assert np.isnan(row["difference"])  # of errors ratios alone
    assert row["ratio"] == pytest.approx(2.0 * np.sqrt(1.25))
    here = np.exp(stats.t.ppf(0.975, 3) * np.sqrt(3.0 * np.log(1.25) ** 2 / 4.0) / 3.0)  # clean is exact
    assert row["here_high"] == pytest.approx(row["ratio"] * here)
    score = row_of(tables["differences"], system="one", setting="fog1", measure="success_auc")
    assert score["difference"] == pytest.approx(-np.mean([0.0125, 0.025, 0.05]) / 4.0)
    assert np.isnan(row["ratio_low"])  # the same in every scene
    assert set(tables["differences"]["setting"]) == {"fog1", "fog5", "blur3", "fast"}


def test_ps_of_differences_are_paired_t_tests_of_logarithms_corrected_over_settings():
    runs, sequences = made()
    runs["ate_rmse_m"] *= np.random.default_rng(5).lognormal(0.0, 0.7, len(runs))
    table = analyse(runs, sequences)["differences"]
    logs = runs.assign(log=np.log(runs["ate_rmse_m"])).groupby(["system", "setting", "scene"])["log"].mean()
    mine = table[(table["system"] == "one") & (table["measure"] == "ate_rmse_m")].set_index("setting")
    expected = {
        setting: stats.ttest_rel(logs["one", setting].to_numpy(), logs["one", "clean"].to_numpy()).pvalue
        for setting in mine.index
    }
    assert mine["p"].to_dict() == pytest.approx(expected, rel=1e-9)
    inside = (mine["ratio_low"] <= 1.0) & (mine["ratio_high"] >= 1.0)
    assert ((mine["p"] < 0.05) == ~inside).all()
    assert mine["p_holm"].min() == pytest.approx(min(1.0, len(mine) * min(expected.values())))
    assert (mine["p_holm"] >= mine["p"]).all()


def test_a_failed_run_is_counted_and_not_averaged(tables):
    ate = row_of(tables["spread"], system="two", setting="fog5", measure="ate_rmse_m")
    assert (ate["n_runs"], ate["n_failed"], ate["n"]) == (6, 1, 5)
    assert ate["maximum"] == pytest.approx(1.6)
    failed = row_of(tables["spread"], system="two", setting="fog5", measure="failed")
    assert failed["mean"] == pytest.approx(1.0 / 6.0)
    score = row_of(tables["spread"], system="two", setting="fog5", measure="success_auc")
    assert (score["n"], score["minimum"]) == (6, 0.0)


def test_curves_begin_at_clean(tables):
    curve = tables["curves"]
    fog = curve[(curve["system"] == "one") & (curve["perturbation"] == "fog") & (curve["measure"] == "ate_rmse_m")]
    assert fog["severity"].tolist() == [0.0, 1.0, 5.0]
    assert fog["mean"].to_numpy() == pytest.approx(2.0 * np.array([0.01, 0.02 * np.sqrt(1.25), 0.4 * np.sqrt(1.25)]))
    assert set(curve["perturbation"]) == {"fog", "gaussian_blur"}  # what has severities


def test_groups_weigh_settings_alike(tables):
    row = row_of(tables["by_perturbation"], system="one", perturbation="fog", measure="ate_rmse_m")
    assert (row["n_settings"], row["n_runs"]) == (2, 12)
    assert row["mean"] == pytest.approx(2.0 * np.sqrt(0.02 * 0.4 * 1.25))
    assert set(tables["by_mode"]["mode"]) == {"", "static", "dynamic"}
    assert tables["by_severity"]["severity"].dropna().unique().tolist() == [1.0, 3.0, 5.0]


def scored(system, clean, **scores):
    """Runs in one scene: scores of perturbations, a list over their severities."""
    listed = [("clean", "clean", clean)]
    listed += [(f"{name}{k}", name, score) for name, several in scores.items() for k, score in enumerate(several)]
    names = ("setting", "perturbation", "success_auc")
    return [dict(zip(names, row, strict=True)) | {"system": system, "scene": "a"} for row in listed]


def test_rates_worked_out_by_hand():
    # mRR: fog (.9 + .6 + .3) / (3 * .9) = 2/3, frost .45 / .9 = 1/2. mCE: fog (.1 + .4 + .7) / (.2 + .3 + .5), frost 2.
    runs = scored("mine", 0.9, fog=[0.9, 0.6, 0.3], frost=[0.45], snow=[0.5])
    runs += scored("rgbd_odometry", 0.9, fog=[0.8, 0.7, 0.5], frost=[0.725], snow=[1.0])
    runs += scored("broken", 0.0, fog=[0.5])
    rates = robustness_table(pd.DataFrame(runs)).set_index(["system", "perturbation"])
    expected = {"fog": (2 / 3, 1.2), "frost": (1 / 2, 2.0), "snow": (5 / 9, np.nan)}  # whose baseline has no error
    for name, of_name in expected.items():
        assert rates.loc[("mine", name), ["mrr", "mce"]].tolist() == pytest.approx(of_name, nan_ok=True)
    assert rates.loc[("mine", "all"), ["mrr", "mce"]].tolist() == pytest.approx([(2 / 3 + 1 / 2 + 5 / 9) / 3, 1.6])
    assert np.isnan(rates.loc[("broken", "all"), "mrr"])


def test_robustness_is_over_scenes(tables):
    auc = {
        name: [1.0 - ATE[s] * FACTOR[scene] * 1.125 / 4.0 for scene in SCENES for s, p, *_ in SETTINGS if p == name]
        for name in ("fog", "gaussian_blur", "faster_motion")
    }
    clean = np.mean([1.0 - 0.01 * factor / 4.0 for factor in FACTOR.values()])
    rates = {name: np.mean(scores) / clean for name, scores in auc.items()}
    expected = np.mean(list(rates.values()))
    one = tables["robustness"][tables["robustness"]["system"] == "one"].set_index("perturbation")
    assert one.loc["all", "mrr"] == pytest.approx(expected)
    assert one.loc["fog", "mrr"] == pytest.approx(rates["fog"])
    assert one.loc["all", "mrr_low"] < expected < one.loc["all", "mrr_high"]
    assert one["baseline"].eq("").all()  # it is the baseline, and is not compared with itself
    assert one[["mce", "mce_low", "mce_high"]].isna().all(axis=None)
    two = tables["robustness"][tables["robustness"]["system"] == "two"].set_index("perturbation")
    assert two.loc["gaussian_blur", ["baseline", "mce"]].to_list() == ["one", pytest.approx(1.0)]
    two = tables["robustness"][tables["robustness"]["system"] == "two"].set_index("perturbation")
    assert two.loc["fog", "mce"] > 1.0
    assert (two.loc["all", "n_perturbations"], two.loc["all", "n_cells"]) == (3, 12)


def test_motion_is_of_the_sequences(tables):
    row = row_of(tables["motion"], setting="fog1", indicator="speed_mps")
    assert (row["n"], row["n_scenes"], row["mean"]) == (6, 3, pytest.approx(0.3))


def test_order_and_a_file_in_between_change_nothing(tables):
    runs, sequences = (
        pd.read_csv(io.StringIO(table.sample(frac=1.0, random_state=3).to_csv(index=False))) for table in made()
    )
    again = analyse(runs, sequences)
    for name, table in tables.items():
        assert again[name].to_csv() == table.to_csv(), name


RUNS, SEQUENCES = made()
LACKING = {
    "no run": (RUNS.iloc[:0], SEQUENCES.iloc[:0]),
    "one run": (RUNS.iloc[:1], SEQUENCES.iloc[:1]),
    "one scene": (RUNS[RUNS["scene"] == "a"], SEQUENCES),
    "one system": (RUNS[RUNS["system"] == "two"], SEQUENCES),
    "no clean": (RUNS[RUNS["setting"] != "clean"], SEQUENCES),
    "only clean": (RUNS[RUNS["setting"] == "clean"], SEQUENCES),
    "no sequences": (RUNS, SEQUENCES.iloc[:0]),
    "no indicators": (RUNS, SEQUENCES[["scene", "setting", "seed", "frames"]]),
    "no metrics": (RUNS.drop(columns=["ate_rmse_m", "success_auc", "success_10cm"]), SEQUENCES),
    "all failed": (RUNS.assign(failure="no_poses", ate_rmse_m=np.nan, success_auc=np.nan), SEQUENCES),
}


@pytest.mark.parametrize("lacking", LACKING)
def test_what_is_not_there_leaves_gaps(lacking):
    runs, sequences = LACKING[lacking]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tables = analyse(runs, sequences)
    assert list(tables) == list(CAPTIONS)
    assert all(len(table.columns) for table in tables.values())
    if lacking == "one scene":
        spread = row_of(tables["spread"], system="one", setting="fog1", measure="ate_rmse_m")
        assert np.isnan(spread["low"])
        assert spread["here_low"] < spread["mean"] < spread["here_high"]
        assert tables["prediction"]["auc"].isna().all()
    if lacking == "no clean":
        assert tables["robustness"]["mrr"].isna().all()
        assert tables["robustness"]["mce"].notna().any()
