"""How often an interval holds the truth: many data sets are drawn whose truth is known. Run as a program, a table."""

import sys
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "addon"))

from noisy_world.evaluate.spread import (
    SceneValues,
    bootstrap_interval,
    exponential,
    here_interval,
    mean_interval,
    share_interval,
)

SEEDS = 3


def drawn(kind, scenes, sets, rng):
    """(sets, scenes, SEEDS) values with an effect of the scene, and the mean over all scenes that there could be."""
    scene, seed = rng.standard_normal((sets, scenes, 1)), rng.standard_normal((sets, scenes, SEEDS))
    many = np.random.default_rng(0).standard_normal(4_000_000)
    if kind == "normal":
        return 2.0 + scene + seed, 2.0
    if kind == "long tail":  # an ATE: its scenes differ by a factor of 2, its seeds by 1.6
        return np.exp(0.7 * scene + 0.5 * seed), float(np.exp((0.7**2 + 0.5**2) / 2.0))
    if kind == "score":
        return expit(1.5 + 0.8 * scene + 0.8 * seed), float(np.mean(expit(1.5 + np.hypot(0.8, 0.8) * many)))
    middle = {"success often": 2.5, "success at times": 0.0}[kind]
    chance = expit(middle + scene)
    return (rng.random(seed.shape) < chance).astype(float), float(np.mean(expit(middle + many)))


def expit(x):
    return 1.0 / (1.0 + np.exp(-x))


def held(low, high, truth):
    return (low <= truth) & (truth <= high)


def coverage(kind, scenes, sets, rng):
    """The share of the data sets whose interval, the one of the tables, holds the truth."""
    values, truth = drawn(kind, scenes, sets, rng)
    found = []
    for one in values:
        of_scenes = one.mean(axis=1)
        if kind == "score":
            interval = share_interval(of_scenes)
        elif kind.startswith("success"):
            interval = share_interval(of_scenes, one.size)
        else:
            interval = mean_interval(of_scenes)
        found.append(held(*interval, truth))
    return float(np.mean(found))


def geometric_coverage(scenes, sets, rng):
    """The same of the geometric mean of what has a long tail, whose truth is 1."""
    values, _ = drawn("long tail", scenes, sets, rng)
    return float(np.mean([held(*exponential(mean_interval(np.log(one).mean(axis=1))), 1.0) for one in values]))


def here_coverage(scenes, sets, rng, *, errors=False, seeds=SEEDS):
    """The same over other seeds in the same scenes, each with a spread of its own.

    errors: log-normal ones whose logarithms spread by 1 in every scene, and their geometric mean.
    """
    means = 3.0 * rng.standard_normal((sets, scenes, 1))
    spread = 1.0 if errors else np.exp(0.5 * rng.standard_normal((sets, scenes, 1)))
    values = means + spread * rng.standard_normal((sets, scenes, seeds))
    interval, truth = here_interval(scene_values(values)), means.mean(axis=(1, 2))
    low, high = exponential(interval) if errors else interval
    truth = np.exp(truth) if errors else truth
    return float(np.mean((low <= truth) & (truth <= high)))


def scene_values(groups):
    """What scenes say whose values of each seed are on the last axis, or lists of unlike length."""
    groups = [np.asarray(group, dtype=float) for group in groups]
    count = np.array([group.shape[-1] for group in groups], dtype=float)
    if groups and groups[0].ndim == 2:  # sets of scenes
        stacked = np.array(groups)
        count = np.full(stacked.shape[:-1], stacked.shape[-1], dtype=float)
        return SceneValues(stacked.mean(axis=-1), stacked.var(axis=-1, ddof=1) / count, count - 1.0)
    variances = [group.var(ddof=1) / len(group) if len(group) > 1 else np.nan for group in groups]
    return SceneValues(np.array([group.mean() for group in groups]), np.array(variances), count - 1.0)


def ratio_coverage(scenes, sets, rng, resamples=400):
    """The same of a ratio of two means, as mRR and mCE are, by the bootstrap of scenes; the truth is 0.7."""
    scene = rng.standard_normal((sets, scenes))
    below = 0.9 + 0.05 * scene
    above = 0.63 + 0.035 * scene + 0.1 * rng.standard_normal((sets, scenes))
    found = []
    for place in range(sets):
        statistic = lambda taken, at=place: (taken @ above[at]) / (taken @ below[at])  # noqa: E731
        found.append(held(*bootstrap_interval(statistic, scenes, "simulated", place, resamples=resamples), 0.7))
    return float(np.mean(found))


def quantile_coverage(kind, scenes, sets, rng, *, both, resamples=1000):
    """The same of the plain bootstrap's quantiles: of scenes, or of scenes and then of seeds in each."""
    values, truth = drawn(kind, scenes, sets, rng)
    found = []
    for one in values:
        taken = rng.integers(0, scenes, (resamples, scenes, 1))
        seeds = rng.integers(0, SEEDS, (resamples, scenes, SEEDS)) if both else np.arange(SEEDS)
        found.append(held(*np.quantile(one[taken, seeds].mean(axis=(1, 2)), (0.025, 0.975)), truth))
    return float(np.mean(found))


def main(sets=20_000):
    counts = (2, 3, 5, 8)
    rng = np.random.default_rng(15)
    print("scenes".ljust(42), *(f"{count:>6}" for count in counts))
    lines = {kind: lambda n, k=kind: coverage(k, n, sets, rng) for kind in ("normal", "long tail", "score")}
    lines |= {kind: lambda n, k=kind: coverage(k, n, sets, rng) for kind in ("success often", "success at times")}
    lines["long tail, geometric mean"] = lambda n: geometric_coverage(n, sets, rng)
    lines["these scenes, other seeds"] = lambda n: here_coverage(n, sets, rng)
    lines["these scenes, other seeds: errors"] = lambda n: here_coverage(n, sets, rng, errors=True)
    lines["these scenes, two seeds: errors"] = lambda n: here_coverage(n, sets, rng, errors=True, seeds=2)
    lines["ratio (bootstrap)"] = lambda n: ratio_coverage(n, sets // 4, rng)
    for both, name in ((False, "scenes"), (True, "scenes, then seeds")):
        for kind in ("normal", "long tail"):
            name_of = f"plain bootstrap of {name}: {kind}"
            lines[name_of] = lambda n, k=kind, b=both: quantile_coverage(k, n, sets // 10, rng, both=b)
    for name, line in lines.items():
        print(name.ljust(42), *(f"{100.0 * line(count):6.1f}" for count in counts), flush=True)


if __name__ == "__main__":
    main()
