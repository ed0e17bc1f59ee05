# SPDX-License-Identifier: GPL-3.0-or-later
"""Components of variance against textbooks' equations, REML by statsmodels, and draws whose components are known."""

import numpy as np
import pandas as pd
import pytest

from noisy_world.evaluate.spread import components_of, moments_of, variance_table
from noisy_world.evaluate.study_tables import tidy_runs

KNOWN = {"scene": 0.7, "seed": 0.5, "repeat": 0.3}  # standard deviations


def drawn(rng, sizes):
    """Values by scene and seed. sizes: of each scene, the repeats of each seed."""
    cells = {}
    for number, repeats in enumerate(sizes):
        scene = KNOWN["scene"] * rng.standard_normal()
        seeds = [scene + KNOWN["seed"] * rng.standard_normal() for _ in repeats]
        pairs = enumerate(zip(seeds, repeats, strict=True))
        cells[str(number)] = {k: list(seed + KNOWN["repeat"] * rng.standard_normal(n)) for k, (seed, n) in pairs}
    return cells


def test_equal_numbers_have_the_textbook_s_mean_squares():
    # Scenes 2, seeds 2, repeats 2: means of squares over what they are expected to be multiples of.
    cells = {"a": {1: [1.0, 3.0], 2: [5.0, 7.0]}, "b": {1: [10.0, 12.0], 2: [20.0, 22.0]}}
    repeat = 2.0  # each pair: (1 + 1) / 1
    seed = (2 * 2 * 2.0**2 + 2 * 2 * 5.0**2) / 2.0  # means 2, 6 about 4 and 11, 21 about 16
    scene = 2 * 4 * 6.0**2 / 1.0  # means 4 and 16 about 10
    expected = {"scene": (scene - seed) / 4.0, "seed": (seed - repeat) / 2.0, "repeat": repeat}
    assert components_of(moments_of(cells)) == pytest.approx(expected)


def test_unequal_numbers_are_estimated_without_bias():
    rng = np.random.default_rng(1)
    sizes = [(3, 1, 2), (2, 2), (1, 1, 1, 3), (4,), (2, 1)]
    found = [list(components_of(moments_of(drawn(rng, sizes))).values()) for _ in range(2000)]
    error = np.std(found, axis=0) / np.sqrt(len(found))
    assert np.all(np.abs(np.mean(found, axis=0) - np.square(list(KNOWN.values()))) < 3.5 * error)


@pytest.mark.filterwarnings("ignore")
def test_equal_numbers_agree_with_reml():
    mixed = pytest.importorskip("statsmodels.regression.mixed_linear_model", reason="statsmodels is not installed")
    cells = drawn(np.random.default_rng(4), [(3, 3, 3)] * 8)
    rows = [(s, f"{s}/{k}", v) for s, seeds in cells.items() for k, values in seeds.items() for v in values]
    table = pd.DataFrame(rows, columns=["scene", "seed", "value"])
    parts = {"seed": "0 + C(seed)"}
    fit = mixed.MixedLM.from_formula("value ~ 1", table, groups="scene", re_formula="1", vc_formula=parts).fit()
    expected = {"scene": float(fit.cov_re.iloc[0, 0]), "seed": float(fit.vcomp[0]), "repeat": float(fit.scale)}
    assert components_of(moments_of(cells)) == pytest.approx(expected, rel=2e-3)


def test_what_nothing_varied_in_is_not_known():
    once = components_of(moments_of({"a": {1: [1.0], 2: [3.0]}, "b": {1: [5.0], 2: [7.0]}}))
    assert np.isnan(once["repeat"])
    assert once["seed"] == pytest.approx(2.0)  # with the system's chance in it
    again = components_of(moments_of({"a": {1: [1.0, 3.0]}}))
    assert (again["repeat"], np.isnan(again["seed"]), np.isnan(again["scene"])) == (pytest.approx(2.0), True, True)
    assert all(np.isnan(list(components_of(moments_of({"a": {1: [1.0]}})).values())))


def study(rng, settings=40):
    """A study's runs: of a half of the settings three seeds, of the others, which no seed changes, three repeats."""
    rows = []
    for number in range(settings):
        several = number % 2 == 0
        cells = drawn(rng, [(1, 1, 1) if several else (3,)] * 6)
        if not several:  # no seed, so none of its effect
            cells = {scene: {1: list(KNOWN["repeat"] * rng.standard_normal(3))} for scene in cells}
        for scene, seeds in cells.items():
            for seed, values in seeds.items():
                rows += [(f"fog{number}", scene, seed, repeat, np.exp(v) / 100) for repeat, v in enumerate(values, 1)]
    runs = pd.DataFrame(rows, columns=["setting", "scene", "seed", "repeat", "ate_rmse_m"])
    return runs.assign(perturbation="fog", mode="", severity=3, system="s", outcome="finished", failure="")


def test_a_study_s_table_tells_its_components():
    table = variance_table(tidy_runs(study(np.random.default_rng(2))))
    whole = table[table["setting"] == "all"].iloc[0]
    within = {"scene": 0.3, "seed": 0.11, "repeat": 0.03}  # three and a half standard errors of a variance
    for level, deviation in KNOWN.items():
        assert np.log(whole[f"{level}_factor"]) ** 2 == pytest.approx(deviation**2, abs=within[level]), level
    assert whole[[f"{level}_share" for level in KNOWN]].sum() == pytest.approx(1.0)
    assert (whole["scene_freedom"], whole["seed_freedom"], whole["repeat_freedom"]) == (100, 240, 240)
    one = table[table["setting"] == "fog0"].iloc[0]
    assert np.isnan(one["repeat_factor"])
    assert (one["n"], one["n_scenes"], one["seed_freedom"], one["repeat_freedom"]) == (18, 6, 12, 0)
