# SPDX-License-Identifier: GPL-3.0-or-later
"""The numbers of a map: how far it is from the truth, how much of the truth it holds, and how it looks."""

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.scenes.mesh import Mesh
from ..metrics.names import checked_value
from .compared import ComparedMap
from .culling import Culling
from .names import MAP_METRICS
from .renders import Compare
from .truth import Origin, TrueMap

Values: TypeAlias = dict[str, float | None]


@dataclass(frozen=True)
class MapScore:
    """What is said of a map. values: by the names of MAP_METRICS, None where a metric has no value.

    culling: which parts were compared. truth: what it was held against. samples: points on each of both.
    """

    values: Values
    culling: Culling
    truth: Origin
    samples: int


def score_map(
    mesh: Mesh | None,
    truth: TrueMap,
    *,
    truth_from_map: ArrayLike | None = None,
    paper: bool = True,
    renders: bool = True,
    lpips: Compare | None = None,
) -> MapScore:
    """Hold a map against the truth.

    mesh: None where there is none. truth_from_map: (4, 4), with a scale or without one: the alignment of the
    trajectory that the map was made along; None where the map lies in the true world already. paper: also the numbers
    as the paper's code makes them. renders: also those of renders. lpips: how alike two images are, where it is given.
    Raises ValueError for a transformation that is none.
    """
    if mesh is not None and truth_from_map is not None:
        mesh = moved(mesh, np.asarray(truth_from_map, dtype=np.float64))
    compared = ComparedMap(mesh, truth, lpips)
    wanted = {"geometry", *(["renders"] if renders else []), *(["paper"] if paper else [])}
    values = {
        name: checked_value(metric, metric.compute(compared), MAP_METRICS)
        for name, metric in MAP_METRICS.items()
        if metric.group in wanted
    }
    return MapScore(values, truth.seen.culling, truth.origin, truth.sample_count)


def moved(mesh: Mesh, by: NDArray[np.float64]) -> Mesh:
    """Return a mesh in other axes, (4, 4). Raises ValueError where that is no finite affine transformation."""
    if by.shape != (4, 4) or not np.isfinite(by).all() or np.any(by[3] != (0, 0, 0, 1)):
        raise ValueError("a map is moved by a finite (4, 4) matrix whose last row is 0 0 0 1")
    return replace(mesh, vertices_m=mesh.vertices_m @ by[:3, :3].T + by[:3, 3])
