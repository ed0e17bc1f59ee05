# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's own numbers against plain arithmetic, and the paper's figures against a few read off its pages."""

import csv
import math
import statistics

import numpy as np
import pytest
from results_made import SCENES, SETTINGS, make_results

pytest.importorskip("pandas", reason="the extra evaluate is not installed")

from noisy_world.evaluate.analyses import analyse
from noisy_world.evaluate.findings import endings, settings_table
from noisy_world.evaluate.paper_comparison import (
    paper_comparison,
    paper_condition,
    paper_conditions,
    paper_tables,
    published,
)
from noisy_world.evaluate.report_tables import (
    cell_text,
    latex,
    markdown,
    picked_runs,
    picked_sequences,
    read_results,
    records,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_results(tmp_path_factory.mktemp("results"))


@pytest.fixture(scope="module")
def results(folder):
    return read_results(folder)


def plain_rows(folder):
    with (folder / "tables" / "runs.csv").open() as file:
        return list(csv.DictReader(file))


def find(system, perturbation, mode="", metric="ate", **parameters):
    return published().find(system, paper_condition(perturbation, mode, parameters), metric)


# --- the paper's figures ---


MIXTURE = "snow+motion_blur+gaussian_noise+jpeg_compression+depth_gaussian_noise"
TURNED = {"rotation_deg": 5, "translation_m": 0}


@pytest.mark.parametrize(
    ("number", "value", "spread"),
    [
        (find("go_slam_mono", "frost", "static"), 0.7207, None),
        (find("go_slam", "frost", "dynamic"), 0.2213, None),
        (find("imap", "contrast", "static"), 0.3831, None),
        (find("nice_slam", "clean"), 0.0147, None),
        (find("orb_slam3", "clean"), 0.082, 0.179),
        (find("orb_slam3", "snow", "dynamic", "sr"), 0.0, 0.0),
        (find("orb_slam3_mono", "impulse_noise", "static", "rpe"), 0.1, 0.0),
        (find("orb_slam3", "depth_range_clipping"), 0.994, 0.283),
        (find("orb_slam3_mono", "faster_motion", metric="sr", factor=4), 0.909, 0.049),
        (find("orb_slam3", "motion_deviation", metric="rpe", **TURNED), 0.417, 0.239),
        (find("go_slam", "desync", "dynamic", offset=20), 0.065, None),
        (find("orb_slam3", "desync", "static", "sr", offset=20), 0.954, 0.030),
        (find("splatam_s", MIXTURE), 0.132, None),
    ],
)
def test_printed_number(number, value, spread):
    assert (number.value, number.spread, number.mark) == (value, spread, "")


def test_marks():
    crossed = find("nice_slam", "motion_deviation", rotation_deg=3.0, translation_m=0.05)
    assert (crossed.value, crossed.mark) == (None, "x")
    with_failures = find("splatam_s", "motion_deviation", rotation_deg=1, translation_m=0)
    assert (with_failures.value, with_failures.mark) == (0.297, "F")
    assert find("orb_slam3", "motion_deviation", rotation_deg=2, translation_m=0) is None
    assert find("rgbd_odometry", "clean") is None


# Mean and largest over the sixteen colour perturbations, as they are printed beside the cells; the two of SplaTAM-S
# that do not follow from the cells are in the notes.
PRINTED_MEANS = {
    "static": {"go_slam_mono": (0.0903, 0.7207), "imap": (0.1568, 0.3831), "co_slam": (0.0104, 0.0125)},
    "dynamic": {"go_slam_mono": (0.0933, 0.7395), "nice_slam": (0.0214, 0.0409), "go_slam": (0.0363, 0.2213)},
}


@pytest.mark.parametrize("mode", PRINTED_MEANS)
def test_cells_agree_with_the_means_that_are_printed(mode):
    for system, (mean, largest) in PRINTED_MEANS[mode].items():
        cells = [
            number.value
            for number in published().numbers
            if number.system == system and number.paper_condition.mode == mode and number.severities == (1, 3, 5)
        ]
        assert len(cells) == 16
        assert statistics.mean(cells) == pytest.approx(mean, abs=1.01e-4)
        assert max(cells) == largest


def test_all_numbers_are_there():
    numbers = published().numbers
    assert sum(1 + (number.spread is not None) for number in numbers) == 1129
    assert {label for label, _, _ in published().notes} <= {number.label for number in numbers}


# --- ours ---


def scene_mean(rows):
    """The geometric mean of a scene: of its seeds' geometric means."""
    seeds = [
        [float(row["ate_rmse_m"]) for row in rows if row["seed"] == seed] for seed in {row["seed"] for row in rows}
    ]
    return statistics.geometric_mean([statistics.geometric_mean(seed) for seed in seeds])


def test_settings_table_is_plain_arithmetic(folder, results):
    rows = plain_rows(folder)
    analyses = analyse(results.runs, results.sequences)
    found = list(records(settings_table(results, analyses["spread"]).frame))
    assert len(found) == len(SETTINGS) * 3
    for row in found:
        mine = [item for item in rows if (item["setting"], item["system"]) == (row["setting"], row["system"])]
        ate = [float(item["ate_rmse_m"]) for item in mine if item["ate_rmse_m"]]
        failed = [item for item in mine if item["outcome"] != "finished" or item["failure"]]
        assert (row["runs"], row["failed"], row["ate_rmse_m.n"]) == (len(mine), len(failed), len(ate))
        if ate:
            of_scenes = [scene_mean([item for item in mine if item["scene"] == scene]) for scene in SCENES]
            assert row["ate_rmse_m.mean"] == pytest.approx(statistics.geometric_mean(of_scenes), rel=1e-12)
            assert (row["ate_rmse_m.min"], row["ate_rmse_m.max"]) == (min(ate), max(ate))
        else:
            assert math.isnan(row["ate_rmse_m.mean"])
    assert [row["setting"] for row in found[:3]] == ["clean"] * 3


def test_endings_tell_failures_apart():
    given = [("finished", "", "complete"), ("crashed", "no_poses", "failed"), ("finished", "stands_still", "failed")]
    given += [("finished", "", "incomplete"), ("finished", "", "complete")]
    assert endings(given) == "2 complete, 1 crashed, 1 incomplete, 1 stands_still"


def test_beside_the_paper(folder, results):
    table = paper_comparison(results, published())
    row = next(row for row in records(table.frame) if (row["treatment"], row["mode"]) == ("gaussian_noise", "static"))
    mine = [
        float(item["paper.ate_m"])
        for item in plain_rows(folder)
        if (item["system"], item["perturbation"], item["mode"]) == ("orb_slam3", "gaussian_noise", "static")
    ]
    assert (row["system"], row["runs"], row["severities"]) == ("orb_slam3", len(mine), "1, 3, 5")
    assert row["ate.ours"] == pytest.approx(statistics.mean(mine))
    assert row["ate.ours_std"] == pytest.approx(statistics.stdev(mine))
    assert (row["ate.printed"], row["ate.printed_std"], row["sr.printed"]) == (0.470, 0.498, 0.388)
    assert set(table.frame["system"]) == {"orb_slam3"}
    faster = next(row for row in records(table.frame) if row["treatment"].startswith("faster_motion"))
    assert (faster["treatment"], faster["ate.printed"]) == ("faster_motion (factor 2)", 0.019)


def test_setting_whose_parameters_are_not_known_has_no_counterpart(results):
    known = paper_conditions(results)
    assert known["speed_x2"] == paper_condition("faster_motion", "", {"factor": 2})
    assert find("orb_slam3", "faster_motion") is None


def test_latex_tables_have_the_paper_s_shape(results):
    sources = {source.name: source.text for source in paper_tables(results, published())}
    text = sources["paper_colour_static_paper_ate_m"]
    body = text.split("\\midrule")[1].split("\\bottomrule")[0].strip().splitlines()
    assert [line.split(" & ")[0] for line in body] == [
        "my\\_system",
        "orb\\_slam3",
        "\\quad printed",
        "rgbd\\_odometry",
    ]
    assert {line.count(" & ") for line in body} == {3}  # clean, gaussian noise, frost
    assert r"\multicolumn{1}{c}{Noise} & \multicolumn{1}{c}{Environment}" in text
    assert r"0.47 $\pm$ 0.5" in text
    assert "(12 F of 18)" in text  # two of three severities fail, in three scenes with two seeds
    assert text.count("{") == text.count("}")


def test_picked_runs_are_clean_median_worst_and_failed(results):
    picks = [(pick.run["system"], pick.why) for pick in picked_runs(results)]
    assert ("orb_slam3", "failed") in picks
    assert ("rgbd_odometry", "failed") not in picks
    worst = next(
        pick.run for pick in picked_runs(results) if (pick.run["system"], pick.why) == ("my_system", "worst complete")
    )
    mine = results.runs[results.runs["system"] == "my_system"]
    assert worst["ate_rmse_m"] == mine["ate_rmse_m"].max()
    settings = [rows[0]["setting"] for rows in picked_sequences(results)]
    assert settings[0] == "clean"
    assert len(settings) == len(set(settings))


# --- how numbers and texts are shown ---


@pytest.mark.parametrize(
    ("value", "text"),
    [
        *((None, "\u2013"), (float("nan"), "\u2013"), ("", "\u2013"), (np.nan, "\u2013"), (0.0, "0"), (True, "yes")),
        *((3, "3"), (12.0, "12"), (0.123456, "0.1235"), (123456.0, "123456"), (1.5e-7, "1.5e-7"), (1e20, "1e+20")),
        *((float("inf"), "\u221e"), (-0.00012345, "-0.0001234"), (np.int64(7), "7"), (np.float64(0.5), "0.5")),
    ],
)
def test_shown(value, text):
    assert cell_text(value) == text


def test_line_ends_and_control_characters_stay_in_a_cell():
    assert "\n" not in markdown("a\nb|c")
    assert markdown("a|b") == "a\\|b"
    assert (markdown("1\u00a0mm\u2028"), latex("1\u00a0mm")) == ("1\u00a0mm\\\\u2028", "1~mm")
    assert "\n" not in latex("a\nb")
    assert latex("50 % of $x_1$ \\ {é}") == r"50 \% of \$x\_1\$ \textbackslash{} \{é\}"
