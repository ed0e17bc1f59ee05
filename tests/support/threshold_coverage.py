# SPDX-License-Identifier: GPL-3.0-or-later
"""How often a threshold's interval holds the truth: outcomes are drawn from known curves. Run as a program, a table.

In the first rows slopes, thresholds and lapses lie between those of the search's grid. What the search does not assume
are curves of another shape (the normal distribution's, and Gumbel's, which is not symmetric), scenes that differ,
thresholds at the ends of the range, and more lapses than are on the grid.
"""

import sys
import time
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "addon"))

from scipy import optimize, stats

from noisy_world.evaluate.thresholds import Axis
from noisy_world.evaluate.thresholds import Trial, search

AXIS = Axis("fog", "visibility_m", "m", 50.0, 0.5, logarithmic=True, whole=False)
SCENES = [f"scene{number}" for number in range(6)]
RISES = (0.04, 0.08, 0.15, 0.3, 0.6)
"""How far it is from a tenth to nine tenths, as a share of the range, without lapses."""
LAPSES = ((0.0, 0.0), (0.05, 0.0), (0.0, 0.05), (0.05, 0.05))
"""The share that fails whatever is done, and the share that succeeds."""
MORE_LAPSES = ((0.1, 0.0), (0.0, 0.1), (0.1, 0.1), (0.07, 0.02))
SHAPES = {"logistic": stats.logistic, "normal": stats.norm, "Gumbel": stats.gumbel_r}
WITHIN = (0.2, 0.8)
AT_AN_END = (0.03, 0.12)


def curve(rise, lapses, rng, *, shape, spread, within=WITHIN):
    """The chance of a failure in each scene at a place, and the place where that of all scenes is one half."""
    of_shape = SHAPES[shape]
    width = rise / (of_shape.ppf(0.9) - of_shape.ppf(0.1))
    middles = dict(zip(SCENES, rng.uniform(*within) + spread * rise * rng.standard_normal(len(SCENES)), strict=True))
    fails, holds = lapses

    def chance(scene, place):
        return fails + (1.0 - fails - holds) * of_shape.cdf((place - middles[scene]) / width)

    truth = optimize.brentq(lambda place: np.mean([chance(scene, place) for scene in SCENES]) - 0.5, -2.0, 3.0)
    return chance, truth


def searched(rise, lapses, rng, *, shape="logistic", spread=0.0, within=WITHIN, width=0.15, most=80):
    """Whether the interval of a search held the truth, how many runs it took, and how wide the interval is."""
    chance, truth = curve(rise, lapses, rng, shape=shape, spread=spread, within=within)

    def carry_out(planned):
        place = np.log(planned.value / AXIS.mild) / np.log(AXIS.worst / AXIS.mild)
        failed = bool(rng.random() < chance(planned.scene, place))
        return Trial(planned.number, planned.scene, planned.seed, planned.value, "finished", 0.0, 1.0, not failed)

    found = search(AXIS, SCENES, int(rng.integers(2**31)), [], carry_out, width=width, most=most)
    ends = [1.0 if value is None else np.log(value / 50.0) / np.log(0.01) for value in (found.mild, found.worst)]
    low, high = (0.0 if found.mild is None else ends[0]), ends[1]
    inside = (found.mild is None or low <= truth) and (found.worst is None or truth <= high)
    return inside, found.runs, high - low


def coverage(searches, rng, *, lapses=LAPSES, **how):
    """(rises, 3): the share of intervals that hold the truth, the mean number of runs and the mean width."""
    rows = []
    for rise in RISES:
        found = [searched(rise, lapses[number % len(lapses)], rng, **how) for number in range(searches)]
        rows.append(np.mean(np.array(found, dtype=float), axis=0))
    return np.array(rows)


UNSEEN = {
    "logistic": {},
    "normal": {"shape": "normal"},
    "Gumbel": {"shape": "Gumbel"},
    "scenes differ": {"spread": 0.3},
    "normal, scenes differ": {"shape": "normal", "spread": 0.3},
    "at an end": {"within": AT_AN_END},
    "lapses to a tenth": {"lapses": MORE_LAPSES},
}


def main(searches=300, seed=17):
    rng = np.random.default_rng(seed)
    print("curve, rise".ljust(40), "held    runs   width")
    for label, how in UNSEEN.items():
        begun = time.process_time()
        found = coverage(searches, rng, **how)
        for rise, row in zip(RISES, found, strict=True):
            print(f"{label}, {rise:g}".ljust(40), *(f"{value:.3f}".rjust(7) for value in row), flush=True)
        all_of_it = f"all, {searches * len(RISES)} searches, {time.process_time() - begun:.0f} s"
        print(all_of_it.ljust(40), *(f"{value:.3f}".rjust(7) for value in found.mean(axis=0)), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
