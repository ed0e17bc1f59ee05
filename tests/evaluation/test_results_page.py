# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of docs/results.md say what the analyses of the record in docs/data/six_rooms say, and all of it."""

import re

import numpy as np
import pytest
from worlds import ROOT

pd = pytest.importorskip("pandas", reason="the extra evaluate is not installed")
pytest.importorskip("scipy", reason="the extra evaluate is not installed")

from noisy_world.evaluation.analysis import analyse

RECORD = ROOT / "docs/data/six_rooms"
PAGE = (ROOT / "docs/results.md").read_text(encoding="utf-8")
FEWEST = 5
DASH = "\u2013"
NUMBER = r"\d+(?:\.\d+)?"
ROW = re.compile(
    r"^\| `(\w[\w.]*)` \| (\d) \| (\d+), (\d+) of (\d+) \| (.+?) \| (.+?) \| (.+?) \| (\d+) % \|$", re.MULTILINE
)


@pytest.fixture(scope="module")
def runs():
    return pd.read_csv(RECORD / "tables/runs.csv")


@pytest.fixture(scope="module")
def tables(runs):
    return analyse(runs, pd.read_csv(RECORD / "tables/sequences.csv"))


def said():
    """The page's rows by system and setting."""
    parts = re.split(r"^### `(\w+)`$", PAGE, flags=re.MULTILINE)[1:]
    return {
        (system, row[1]): row.groups()[1:]
        for system, part in zip(parts[::2], parts[1::2], strict=True)
        for row in ROW.finditer(part)
    }


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


def test_every_setting_that_was_run_is_on_the_page(runs):
    assert set(said()) == set(zip(runs["system"], runs["setting"], strict=True))


def test_rows_are_those_of_the_tables(runs, tables):
    spread = tables["spread"].set_index(["system", "setting", "measure"])
    differences = tables["differences"].set_index(["system", "setting", "measure"])
    for (system, setting), (rooms, failed, incomplete, count, ate, ratio, p, tracked) in said().items():
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
        assert shows(ratio, rooms, over["n_scenes"], over[["ratio", "ratio_low", "ratio_high"]]), (
            system,
            setting,
            ratio,
        )
        assert agrees(p, over["p_holm"] if over["n_scenes"] >= FEWEST else np.nan), (system, setting, p)


def test_numbers_are_compared_as_far_as_they_are_said():
    assert agrees("3.3 [2.6, 4.2]", 3.34, 2.55, 4.249)
    assert not agrees("3.3 [2.6, 4.2]", 3.36, 2.55, 4.2)
    assert not agrees("3.3", 3.3, 2.0, 4.0)
    assert agrees(DASH, float("nan"))
