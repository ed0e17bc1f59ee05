# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a metric of maps keeps its contract."""

from dataclasses import replace

import numpy as np

from ..core.errors import NoisyWorldError
from ..core.scenes.mesh import Mesh
from ..evaluation.maps.compared import ComparedMap
from ..evaluation.maps.names import MAP_METRICS, MapMetric
from ..evaluation.maps.truth import TrueMap, true_map_of_mesh
from ..evaluation.metrics.names import checked_value
from .metrics import check_words
from .rules import CAMERA, require

SAMPLES = 2000
FARTHER_M = 0.05
EQUAL = 1e-9


def check_map_metric(metric: MapMetric) -> None:
    """Check a metric of maps. Raises AssertionError with the rule that it breaks. It needs the extra evaluate.

    Its name ends with its unit where that is m, s, deg or rad, and its meaning is a sentence. It gives a finite number
    or None, the same twice, whatever a map is like: none at all, half of the truth, all of it, or elsewhere. The truth
    itself is not worse than half of it, nor than the truth elsewhere, unless it is of the paper's: ICP moves that back.
    """
    require(isinstance(metric, MapMetric), str(metric), f"is a {type(metric).__name__}, no MapMetric")
    check_words(metric)
    wall = _wall(4.0)
    elsewhere = replace(wall, vertices_m=wall.vertices_m + np.array([0.0, 0.0, FARTHER_M]))
    with true_map_of_mesh(wall, CAMERA, np.eye(4)[None], samples=SAMPLES) as truth:
        best = _value(metric, wall, truth)
        for what, map_ in (("no map", None), ("half of the truth", _wall(0.0)), ("the truth elsewhere", elsewhere)):
            found = _value(metric, map_, truth)
            if found is None or best is None or not metric.better or metric.group == "paper":  # ICP undoes what we do
                continue
            worse = found < best - EQUAL if metric.better == "lower" else found > best + EQUAL
            message = f"is {found:g} for {what}, better than {best:g} for the truth itself: {metric.better} is better"
            require(not worse, metric.name, message)


def _wall(right_m: float) -> Mesh:
    """Return a wall across z, of several colours, from 4 m on the left."""
    x, y = np.meshgrid(np.linspace(-4.0, right_m, 9), np.linspace(-4.0, 4.0, 9), indexing="ij")
    at = np.arange(x.size).reshape(x.shape)
    corners = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1).astype(np.int32)
    vertices_m = np.stack([x.ravel(), y.ravel(), np.full(x.size, 2.0)], axis=1)
    rgb = (0.5 + 0.4 * np.sin(vertices_m)).astype(np.float32)
    return Mesh(vertices_m, rgb, corners, np.arange(0, len(corners), 4, dtype=np.int32))


def _value(metric: MapMetric, map_: Mesh | None, truth: TrueMap) -> float | None:
    def made() -> float | None:
        return checked_value(metric, metric.compute(ComparedMap(map_, truth)), MAP_METRICS)

    try:
        first, second = made(), made()
    except NoisyWorldError as error:
        raise AssertionError(str(error)) from error
    require(first == second, metric.name, f"gives {first} and then {second} for the same map")
    return first
