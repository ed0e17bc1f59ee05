# SPDX-License-Identifier: GPL-3.0-or-later
"""How often a threshold's interval holds the truth: outcomes are drawn from known curves. Run as a program, a table.

Slopes, thresholds and lapses lie between those of the search's grid. What it does not assume are curves of another
shape (the normal distribution's) and scenes that differ.
"""

import sys
import time
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "addon"))

from scipy import optimize, stats

from noisy_world.evaluation.thresholds.axis import Axis
from noisy_world.evaluation.thresholds.search import Trial, search

AXIS = Axis("fog", "visibility_m", "m", 50.0, 0.5, logarithmic=True, whole=False)
SCENES = [f"scene{number}" for number in range(6)]
RISES = (0.04, 0.08, 0.15, 0.3, 0.6)
"""How far it is from a tenth to nine tenths, as a share of the range, without lapses."""
LAPSES = ((0.0, 0.0), (0.05, 0.0), (0.0, 0.05), (0.05, 0.05))
"""The share that fails whatever is done, and the share that succeeds."""


def curve(rise, lapses, rng, *, shape, spread):
    """The chance of a failure in each scene at a place, and the place where that of all scenes is one half."""
    shapes = {"logistic": stats.logistic, "normal": stats.norm}
    width = rise / (2.0 * shapes[shape].ppf(0.9))
    middles = dict(zip(SCENES, rng.uniform(0.2, 0.8) + spread * rise * rng.standard_normal(len(SCENES)), strict=True))
    fails, holds = lapses

    def chance(scene, place):
        return fails + (1.0 - fails - holds) * shapes[shape].cdf((place - middles[scene]) / width)

    truth = optimize.brentq(lambda place: np.mean([chance(scene, place) for scene in SCENES]) - 0.5, -2.0, 3.0)
    return chance, truth


def searched(rise, lapses, rng, *, shape="logistic", spread=0.0, width=0.15, most=80):
    """Whether the interval of a search held the truth, how many runs it took, and how wide the interval is."""
    chance, truth = curve(rise, lapses, rng, shape=shape, spread=spread)

    def carry_out(planned):
        place = np.log(planned.value / AXIS.mild) / np.log(AXIS.worst / AXIS.mild)
        failed = bool(rng.random() < chance(planned.scene, place))
        return Trial(planned.number, planned.scene, planned.seed, planned.value, "finished", 0.0, 1.0, not failed)

    found = search(AXIS, SCENES, int(rng.integers(2**31)), [], carry_out, width=width, most=most)
    ends = [1.0 if value is None else np.log(value / 50.0) / np.log(0.01) for value in (found.mild, found.worst)]
    low, high = (0.0 if found.mild is None else ends[0]), ends[1]
    inside = (found.mild is None or low <= truth) and (found.worst is None or truth <= high)
    return inside, found.runs, high - low


def coverage(searches, rng, **how):
    """(rises, 3): the share of intervals that hold the truth, the mean number of runs and the mean width."""
    rows = []
    for rise in RISES:
        found = [searched(rise, LAPSES[number % len(LAPSES)], rng, **how) for number in range(searches)]
        rows.append(np.mean(np.array(found, dtype=float), axis=0))
    return np.array(rows)


def main(searches=300):
    rng = np.random.default_rng(17)
    print("curve, rise".ljust(40), "held    runs   width")
    for how in ({}, {"shape": "normal"}, {"spread": 0.3}):
        begun = time.process_time()
        found = coverage(searches, rng, **how)
        for rise, row in zip(RISES, found, strict=True):
            print(f"{how or 'logistic'}, {rise:g}".ljust(40), *(f"{value:.3f}".rjust(7) for value in row), flush=True)
        label = f"all, {searches * len(RISES)} searches, {time.process_time() - begun:.0f} s"
        print(label.ljust(40), *(f"{value:.3f}".rjust(7) for value in found.mean(axis=0)), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
