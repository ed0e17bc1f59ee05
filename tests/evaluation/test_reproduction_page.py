# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of docs/reproduction.md say what the record in docs/data/paper_code says of each run."""

import re

import numpy as np
import pytest
from worlds import ROOT

pd = pytest.importorskip("pandas", reason="the extra evaluate is not installed")

PAGE = (ROOT / "docs/reproduction.md").read_text(encoding="utf-8")
SYSTEMS = {"misread": "orb_slam3_misread", "rightly": "orb_slam3", "not at all (mono)": "orb_slam3_mono"}
SETTINGS = {
    "clean": "clean",
    "5 frames late": "desync_5",
    "20 frames late": "desync_20",
    "depth: noise": "depth_noise",
    "depth: missing": "depth_missing",
    "depth: range": "depth_range",
    "depth: edges": "depth_edges",
}
NUMBER = re.compile(r"\d+(?:\.\d+)?")


@pytest.fixture(scope="module")
def runs():
    return pd.read_csv(ROOT / "docs/data/paper_code/tables/runs.csv").set_index(["system", "setting"]).sort_index()


def rows(columns):
    """The rows of the page that begin with one of SETTINGS and have so many columns."""
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in PAGE.splitlines() if line[:1] == "|"]
    return [row for row in cells if row[0] in SETTINGS and len(row) == columns]


def compared():
    """System, setting and the cells for the protocols paper and strict, the scale and the share that was tracked."""
    beside_the_paper = [(SYSTEMS[row[1]], SETTINGS[row[0]], *row[3:7]) for row in rows(8)]
    return beside_the_paper + [("orb_slam3", SETTINGS[row[0]], *row[1:5]) for row in rows(5)]


def said_as(text, values):
    """Whether the numbers of a cell are the values, each as far as it is said."""
    numbers = NUMBER.findall(text)
    return len(numbers) == len(values) and all(
        abs(float(number) - value) <= 0.5001 * 10.0 ** -len(number.partition(".")[2])
        for number, value in zip(numbers, values, strict=True)
    )


def test_every_run_is_on_the_page(runs):
    assert len(compared()) == 11
    assert {row[:2] for row in compared()} == set(runs.index)


@pytest.mark.parametrize("row", compared(), ids=lambda row: f"{row[0]}-{row[1]}")
def test_rows_are_those_of_the_record(runs, row):
    of_cell = runs.loc[[row[:2]]].sort_values("repeat")
    paper_m, strict_m, scale, tracked = row[2:]
    assert said_as(paper_m, [*of_cell["paper.ate_m"]]), paper_m
    assert said_as(strict_m, [*of_cell["ate_rmse_m"]]), strict_m
    scales = sorted(of_cell["scale"])
    assert said_as(scale, scales if len(scales) == 1 else [scales[0], scales[-1]]), scale
    assert said_as(tracked.removesuffix(" %"), [100.0 * of_cell["tracked_share"].mean()]), tracked


def test_success_is_as_the_page_says(runs):
    ours = runs.loc["orb_slam3"].loc[["clean", "depth_noise", "depth_missing", "depth_range", "depth_edges"]]
    assert ours["paper.sr"].round(2).between(0.99, 1.0).all()


def test_what_late_depth_costs_where_it_is_misread(runs):
    stats = pytest.importorskip("scipy.stats", reason="the extra evaluate is not installed")
    misread = runs.loc["orb_slam3_misread"]
    logs = {setting: np.log(of_it["paper.ate_m"]) for setting, of_it in misread.groupby("setting")}
    text = re.search(r"5 frames late are (.+?) times clean, 20 frames (.+?)\n", PAGE)
    for said, setting in zip(text.groups(), ("desync_5", "desync_20"), strict=True):
        found = stats.ttest_ind(logs[setting], logs["clean"], equal_var=False)
        ends = found.confidence_interval(0.95)
        assert said_as(said, np.exp([logs[setting].mean() - logs["clean"].mean(), ends.low, ends.high])), said


def test_a_number_agrees_as_far_as_it_is_said():
    assert said_as("0.16, 0.10", [0.1599, 0.1039])
    assert not said_as("0.16", [0.1699])
    assert not said_as("0.16", [0.16, 0.10])
