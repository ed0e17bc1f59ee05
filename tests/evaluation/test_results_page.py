# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of docs/results.md say what the analyses of the records in docs/data say, and all of them."""

import re

import numpy as np
import pytest
from worlds import ROOT

pd = pytest.importorskip("pandas", reason="the extra evaluate is not installed")
pytest.importorskip("scipy", reason="the extra evaluate is not installed")

from scipy.stats import spearmanr

from noisy_world.evaluation.analysis import analyse

RECORD = ROOT / "docs/data/six_rooms"
D435 = ROOT / "docs/data/six_rooms_d435"
RETURNING = ROOT / "docs/data/returning"
PAGE = (ROOT / "docs/results.md").read_text(encoding="utf-8")
FEWEST = 5
PAIR = "orb_slam3", "orb_slam2"
WORDS = ["none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]
DASH = "\u2013"
NUMBER = r"\d+(?:\.\d+)?"
ROW = re.compile(
    r"^\| `(\w[\w.]*)` \| (\d) \| (\d+), (\d+) of (\d+) \| (.+?) \| (.+?) \| (.+?) \| (\d+) % \|$", re.MULTILINE
)


def read(record):
    """The runs of a record, and its analyses."""
    runs = pd.read_csv(record / "tables/runs.csv")
    return runs, analyse(runs, pd.read_csv(record / "tables/sequences.csv"))


@pytest.fixture(scope="module")
def perfect():
    return read(RECORD)


@pytest.fixture(scope="module")
def sensed():
    return read(D435)


def said():
    """The page's rows of the six rooms by system and setting."""
    parts = re.split(r"^### `(\w+)`$", PAGE, flags=re.MULTILINE)[1:]
    return {
        (system, row[1]): row.groups()[1:]
        for system, part in zip(parts[::2], parts[1::2], strict=True)
        for row in ROW.finditer(part)
    }


def section(title):
    """The text of one of the page's sections."""
    return PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


def said_of_the_sensor():
    """The page's rows of what a D435 sees, by system and setting."""
    return {("orb_slam3", row[1]): row.groups()[1:] for row in ROW.finditer(section("What a D435 sees"))}


def agrees(text, *values):
    """Whether the numbers in a text are the values, each as far as it is said; a dash for what there is none of."""
    known = [value for value in values if np.isfinite(value)]
    numbers = re.findall(NUMBER, text)
    half = [0.5 * 10.0 ** -len(number.partition(".")[2]) for number in numbers]
    return len(numbers) == len(known) and all(
        abs(float(number) - value) <= 1.001 * most for number, value, most in zip(numbers, known, half, strict=True)
    )


def shows(text, rooms, n_scenes, values):
    """Whether a cell is a mean, with its interval where FEWEST rooms have a value, and says of how many if not all."""
    shown, _, of_rooms = text.partition(", of ")
    mean, *ends = values
    agree = agrees(shown, mean, *(ends if n_scenes >= FEWEST else ()))
    return agree and int(of_rooms or rooms) == n_scenes


def check_rows(rows, runs, tables):
    """Each row is that of the analyses, and each system and setting of the runs has one."""
    assert set(rows) == set(zip(runs["system"], runs["setting"], strict=True))
    spread = tables["spread"].set_index(["system", "setting", "measure"])
    differences = tables["differences"].set_index(["system", "setting", "measure"])
    for (system, setting), (rooms, failed, incomplete, count, ate, ratio, p, tracked) in rows.items():
        of_cell = runs[(runs["system"] == system) & (runs["setting"] == setting)]
        row = spread.loc[system, setting, "ate_rmse_m"]
        assert int(rooms) == of_cell["scene"].nunique()
        assert [int(failed), int(incomplete), int(count)] == [*row[["n_failed", "n_incomplete", "n_runs"]]]
        assert shows(ate, rooms, row["n_scenes"], 1e3 * row[["mean", "low", "high"]]), (system, setting, ate)
        share = 100.0 * spread.loc[system, setting, "tracked_share"]["mean"]
        assert agrees(tracked, share), (system, setting, tracked)
        if setting == "clean":
            assert ratio == p == DASH
            continue
        over = differences.loc[system, setting, "ate_rmse_m"]
        ends = over[["ratio", "ratio_low", "ratio_high"]]
        assert shows(ratio, rooms, over["n_scenes"], ends), (system, setting, ratio)
        assert agrees(p, over["p_holm"] if over["n_scenes"] >= FEWEST else np.nan), (system, setting, p)


def test_rows_of_perfect_depth_are_those_of_the_tables(perfect):
    check_rows(said(), *perfect)


def test_rows_of_the_sensor_are_those_of_the_tables(sensed):
    check_rows(said_of_the_sensor(), *sensed)


def test_the_sensor_beside_perfect_depth(perfect, sensed):
    """A D435's clean frames are compared as a setting beside perfect depth would be, without Holm's correction."""
    mine = perfect[0][(perfect[0]["system"] == "orb_slam3") & (perfect[0]["setting"] == "clean")]
    others = sensed[0][sensed[0]["setting"] == "clean"].assign(setting="d435", perturbation="d435", mode="static")
    both = pd.concat([mine, others], ignore_index=True)
    tables = analyse(both, pd.read_csv(RECORD / "tables/sequences.csv"))
    over = tables["differences"].set_index(["setting", "measure"]).loc["d435", "ate_rmse_m"]
    text = re.search(r"\*\*([^*]+)\*\* times that of perfect depth \(p ([\d.]+)\)", section("What a D435 sees"))
    assert agrees(text[1], over["ratio"], over["ratio_low"], over["ratio_high"]), text[1]
    assert agrees(text[2], over["p"])


def judged(runs, system):
    """The runs of a system on clean frames and on the settings that were run in all rooms, and their differences."""
    mine = runs[runs["system"] == system]
    rooms = mine.groupby("setting")["scene"].nunique()
    mine = mine[mine["setting"].isin(rooms[rooms == mine["scene"].nunique()].index)]
    return mine, analyse(mine, pd.read_csv(RECORD / "tables/sequences.csv"))["differences"]


def verdict(row):
    """The plan's answer to questions 1 and 2 for a setting: a row of the table of differences."""
    if row["n_scenes"] < FEWEST:
        return "none"
    if row["ratio_low"] > 1.0 and row["p_holm"] < 0.05:
        return "worse"
    return "as it was" if row["ratio_low"] >= 0.67 and row["ratio_high"] <= 1.5 else "cannot tell"


def verdicts(runs, system="orb_slam3"):
    """The verdict and the ratio of each judged setting of a system."""
    table = judged(runs, system)[1]
    rows = table[table["measure"] == "ate_rmse_m"].set_index("setting")
    return {setting: (verdict(row), row) for setting, row in rows.iterrows()}


def check_verdicts(title, *known):
    """Each setting of the last column's verdicts has a row in a section, with its ratio and verdict in each column."""
    rows = re.findall(r"^\| `(\w+)` \| (.+?): ([a-z ]+) \| (.+?): ([a-z ]+) \|$", section(title), re.MULTILINE)
    assert sorted(row[0] for row in rows) == sorted(known[-1])
    for setting, *cells in rows:
        for text, said_verdict, column in zip(cells[::2], cells[1::2], known, strict=True):
            found, row = column[setting]
            ends = row[["ratio", "ratio_low", "ratio_high"]]
            assert (said_verdict, shows(text, 6, row["n_scenes"], ends)) == (found, True), (setting, text)


def test_what_changes_with_the_sensor(perfect, sensed):
    """Each setting that the D435 was given in all rooms has a row, with its verdict over either clean."""
    check_verdicts("What a D435 sees", verdicts(perfect[0]), verdicts(sensed[0]))


def test_two_implementations_stand_beside_each_other(perfect):
    """Each setting that ORB-SLAM2 was given in all rooms has a row, with each system's verdict."""
    check_verdicts("Two implementations of one method", *(verdicts(perfect[0], system) for system in PAIR))


def test_how_both_fail_under_frost(perfect):
    """The errors over tracked frames, and what ORB-SLAM2 tracked of the rooms that it gave up, as they are said."""
    text = " ".join(section("Two implementations of one method").split())
    frost = perfect[0][perfect[0]["setting"] == "frost_s3"].set_index("system")
    errors = {system: frost.loc[system, "ate_rmse_m"].agg(["min", "max"]) for system in PAIR}
    said_errors = re.search(r"ORB-SLAM2 errs by (\d+ to \d+) mm and ORB-SLAM3 by (\d+) mm to ([\d.]+) m\.", text)
    assert agrees(said_errors[1], *1e3 * errors["orb_slam2"])
    assert agrees(said_errors[2], 1e3 * errors["orb_slam3"]["min"])
    assert agrees(said_errors[3], errors["orb_slam3"]["max"])
    given_up = frost.loc["orb_slam2"].query("result == 'incomplete'")
    said_share = re.search(r"gives up (\d) of 6 rooms, with (\d+ to \d+) %", text)
    assert int(said_share[1]) == len(given_up)
    assert agrees(said_share[2], *100.0 * given_up["tracked_share"].agg(["min", "max"]))


def log_ratios(runs):
    """Two (settings, rooms) tables of the log ratios of PAIR, NaN where a run of either, clean or not, is not complete.

    The settings are those that both were given in all rooms, and that have a ratio in any.
    """
    mine = runs[runs["system"].isin(PAIR)]
    mine = mine.assign(log=np.log(mine["ate_rmse_m"].where(mine["result"] == "complete")))
    cells = mine.groupby(["system", "setting", "scene"])["log"]
    logs = cells.agg(lambda run_logs: run_logs.mean(skipna=False)).unstack("scene")
    rooms = cells.size().unstack("scene").notna().all(axis=1).unstack("system")
    both = [setting for setting in rooms.index[rooms.eq(True).all(axis=1)] if setting != "clean"]
    ratios = [logs.loc[system].loc[both] - logs.loc[(system, "clean")] for system in PAIR]
    known = ratios[0].notna() & ratios[1].notna()
    return [table.where(known).dropna(how="all") for table in ratios]


def means_over(ratios, rooms):
    """The mean log ratio of each setting over the rooms, an index, by system; settings without any are left out."""
    counts = np.isfinite(ratios[0][:, rooms]).sum(axis=1)
    return [np.nansum(table[:, rooms], axis=1)[counts > 0] / counts[counts > 0] for table in ratios]


def test_two_implementations_agree_as_far_as_is_said(perfect):
    """Question 5: the correlation over settings, also by its sum over ranks, and its bootstrap interval over rooms."""
    tables = log_ratios(perfect[0])
    ratios = [table.to_numpy() for table in tables]
    means = means_over(ratios, np.arange(6))
    middle, n = spearmanr(*means).statistic, len(means[0])
    ranks = [values.argsort().argsort() for values in means]
    assert middle == pytest.approx(1.0 - 6.0 * np.sum((ranks[0] - ranks[1]) ** 2) / (n * (n**2 - 1)), abs=1e-12)
    drawn = np.random.default_rng(1).integers(0, 6, (4000, 6))
    found = np.array([spearmanr(*means_over(ratios, rooms)).statistic for rooms in drawn])
    low, high = np.quantile(found, [0.025, 0.975])
    row = re.search(r"^\| 5 \|.*$", PAGE, re.MULTILINE)[0]
    text, settings = re.search(r"(\d\.\d+ \[[^]]+\]) over the (\w+) that have a ratio", row).groups()
    assert agrees(text, middle, low, high), (middle, low, high)
    assert n == WORDS.index(settings) >= 10
    assert "frost_s3" not in tables[0].index  # so it is the same with it and without it, as the row says
    assert row.split(" | ")[2].startswith("yes: " if middle > 0.7 and low > 0.4 else "no: ")
    text = " ".join(section("Two implementations of one method").split())
    assert agrees(re.search(r"the least of its 4,000 draws is ([\d.]+)\.", text)[1], found.min())


def test_what_is_said_of_two_implementations(perfect):
    """How many settings have which verdict, and how far the ratios are apart."""
    text = " ".join(section("Two implementations of one method").split())
    mine, others = (verdicts(perfect[0], system) for system in PAIR)
    assert [mine[setting][0] for setting in others] == [found for found, _ in others.values()]
    counts = re.search(
        r"All (\w+) have the same answer in both: (\w+) make them worse, (\w+) leave them", text
    ).groups()
    answers = [found for found, _ in others.values()]
    assert [WORDS.index(word) for word in counts] == [len(answers), answers.count("worse"), answers.count("as it was")]
    logs = [
        np.log(others[setting][1]["ratio"] / mine[setting][1]["ratio"]) for setting in others if setting != "frost_s3"
    ]
    assert agrees(re.search(r"at most ([\d.]+) times the other's", text)[1], np.exp(np.abs(logs).max()))
    assert f"ORB-SLAM2 was run on {WORDS[len(others)]} of the 17" in PAGE


def test_the_path_that_returns():
    runs = pd.read_csv(RETURNING / "tables/runs.csv").set_index(["setting", "system"])
    rows = re.findall(r"^\| `(\w+)` \| `(\w+)` \| (.+) \|$", section("A path that returns"), re.MULTILINE)
    assert {row[:2] for row in rows} == set(runs.index)
    for setting, system, cells in rows:
        run = runs.loc[setting, system]
        values = 1e3 * run["ate_rmse_m"], 1e3 * run["ate_max_m"], run["ate_rotation_rmse_deg"], run["scale"]
        for cell, value in zip(cells.split(" | "), values, strict=True):
            assert agrees(cell, value), (setting, system, cell)


def test_numbers_are_compared_as_far_as_they_are_said():
    assert agrees("3.3 [2.6, 4.2]", 3.34, 2.55, 4.249)
    assert not agrees("3.3 [2.6, 4.2]", 3.36, 2.55, 4.2)
    assert not agrees("3.3", 3.3, 2.0, 4.0)
    assert agrees(DASH, float("nan"))
