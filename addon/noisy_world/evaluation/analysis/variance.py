# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the spread of an error comes from: the scene, the seed, or the system's own chance on equal files.

Random effects, nested: repeats on the files of one seed, seeds in a scene, scenes in a setting, whose effect is fixed.
Components are estimated by the method of moments (Henderson's method 1, Biometrics 9, 1953; Searle, Casella and
McCulloch, Variance Components, 1992, 5.3), which needs no normal values, no equal numbers and no iteration.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..study.cases import CLEAN
from .columns import Columns, table_of
from .run_table import HEADLINE, SETTING, is_averaged_in_logs
from .spread import Cells, cells_of

if TYPE_CHECKING:
    from pandas import DataFrame

Float64: TypeAlias = NDArray[np.float64]

ALL = "all"
LEVELS = ("scene", "seed", "repeat")
VARIANCE = [
    *("system", "setting", "measure", "n", "n_scenes"),
    *(f"{level}_factor" for level in LEVELS),
    *(f"{level}_share" for level in LEVELS),
    *(f"{level}_freedom" for level in LEVELS),
]


@dataclass(frozen=True)
class Moments:
    """Sums of squares of nested groups, and how many times each component is in what they are expected to be.

    squares, freedom: (3,) between scenes, between seeds in a scene, between repeats of a seed. times: (3, 3), a row for
    each sum of squares, a column for each component.
    """

    squares: Float64
    freedom: Float64
    times: Float64

    def __add__(self, other: "Moments") -> "Moments":
        return Moments(self.squares + other.squares, self.freedom + other.freedom, self.times + other.times)


def moments_of(cells: Cells) -> Moments:
    """Return the moments of values by scene and seed, at least one."""
    runs = [[np.array(values) for values in seeds.values()] for seeds in cells.values()]
    of_seeds = [np.array([len(values) for values in seeds], dtype=np.float64) for seeds in runs]
    of_scenes = np.array([sizes.sum() for sizes in of_seeds])
    count = float(of_scenes.sum())
    means = [np.array([values.mean() for values in seeds]) for seeds in runs]
    scene_means = np.array([(m * sizes).sum() / sizes.sum() for m, sizes in zip(means, of_seeds, strict=True)])
    mean = float((scene_means * of_scenes).sum() / count)
    between_scenes = float((of_scenes * (scene_means - mean) ** 2).sum())
    between_seeds = sum(
        float((sizes * (m - at) ** 2).sum()) for m, sizes, at in zip(means, of_seeds, scene_means, strict=True)
    )
    between_repeats = sum(float(((values - values.mean()) ** 2).sum()) for seeds in runs for values in seeds)
    within = np.array([(sizes**2).sum() for sizes in of_seeds])
    per_scene = float((within / of_scenes).sum())
    scenes, seeds = len(runs), sum(map(len, runs))
    freedom = np.array([scenes - 1.0, seeds - scenes, count - seeds])
    times = np.zeros((3, 3))
    times[0] = count - float((of_scenes**2).sum()) / count, per_scene - float(within.sum()) / count, freedom[0]
    times[1, 1:] = count - per_scene, freedom[1]
    times[2, 2] = freedom[2]
    return Moments(np.array([between_scenes, between_seeds, between_repeats]), freedom, times)


def components_of(moments: Moments) -> dict[str, float]:
    """Return the variance of each of LEVELS; below 0 where chance made it so.

    NaN for one that nothing varied in: it is then a part of the one above it that is known, as seeds that were run once
    hold the system's own chance.
    """
    found: dict[str, float] = dict.fromkeys(LEVELS, float("nan"))
    known = [place for place in range(3) if moments.freedom[place] > 0.0]
    if known:
        chosen = np.ix_(known, known)
        solved = np.linalg.solve(moments.times[chosen], moments.squares[known])
        found |= {LEVELS[place]: float(value) for place, value in zip(known, solved, strict=True)}
    return found


def variance_table(runs: Columns) -> "DataFrame":
    """Return the components of the errors of each system: in each setting, and over all perturbed ones (ALL).

    Factors are exp of a component's standard deviation, shares those of the components that are known; a component
    below 0 counts as 0. ALL takes scenes and seeds from the settings that were run with several seeds, if some were,
    and the repeats of all.
    """
    rows = []
    measures = [name for name in HEADLINE if name in runs and is_averaged_in_logs(name)]
    for (system,), of_system in runs.groups(["system"]):
        for measure in measures:
            cells = {key: cells_of(group, measure) for key, group in of_system.groups(SETTING)}
            cells = {key: found for key, found in cells.items() if found}
            perturbed = [found for key, found in cells.items() if key[1] != CLEAN]
            named = {"system": system, "measure": measure}
            rows += [named | {"setting": key[0]} | _row([found], moments_of(found)) for key, found in cells.items()]
            if len(perturbed) > 1:
                rows.append(named | {"setting": ALL} | _row(perturbed, _pooled(perturbed)))
    return table_of([row for row in rows if any(row[f"{level}_freedom"] for level in LEVELS)], VARIANCE)


def _pooled(settings: Sequence[Cells]) -> Moments:
    every = list(map(moments_of, settings))
    seeded = [moments for moments in every if moments.freedom[1] > 0.0] or every
    total = sum(seeded[1:], seeded[0])
    others = [moments for moments in every if not any(moments is one for one in seeded)]
    for moments in others:  # their scenes hold no seed's effect, if no seed changes their files: their repeats alone
        repeats = np.array([0.0, 0.0, 1.0])
        total += Moments(moments.squares * repeats, moments.freedom * repeats, moments.times * np.diag(repeats))
    return total


def _row(settings: Sequence[Cells], moments: Moments) -> dict[str, Any]:
    values = components_of(moments)
    bounded = {level: max(value, 0.0) for level, value in values.items() if np.isfinite(value)}
    whole = sum(bounded.values())
    row: dict[str, Any] = {
        "n": sum(len(found) for cells in settings for seeds in cells.values() for found in seeds.values()),
        "n_scenes": len({scene for cells in settings for scene in cells}),
    }
    for level, freedom in zip(LEVELS, moments.freedom.tolist(), strict=True):
        known = level in bounded
        row[f"{level}_factor"] = float(np.exp(np.sqrt(bounded[level]))) if known else float("nan")
        row[f"{level}_share"] = bounded[level] / whole if known and whole > 0.0 else float("nan")
        row[f"{level}_freedom"] = int(freedom)
    return row
