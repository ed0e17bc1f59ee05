# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/results.md, the records that it speaks of, and how its numbers are held against their tables."""

import re

import numpy as np
import pandas as pd
from worlds import ROOT

from noisy_world.evaluation.analysis import analyse

RECORD = ROOT / "docs/data/six_rooms"
D435 = ROOT / "docs/data/six_rooms_d435"
PAGE = (ROOT / "docs/results.md").read_text(encoding="utf-8")
FEWEST = 5
PAIR = "orb_slam3", "orb_slam2"
WORDS = ["none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]
DASH = "\u2013"
NUMBER = r"\d+(?:\.\d+)?"


def read(record):
    """The runs of a record, and its analyses."""
    runs = pd.read_csv(record / "tables/runs.csv")
    return runs, analyse(runs, pd.read_csv(record / "tables/sequences.csv"))


def section(title):
    """The text of one of the page's sections."""
    return PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


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
