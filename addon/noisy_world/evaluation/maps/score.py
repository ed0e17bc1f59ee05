# SPDX-License-Identifier: GPL-3.0-or-later
"""The numbers of a map: how far it is from the truth, how much of the truth it holds, and how it looks."""

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.geometry import rotation_angle_rad
from ...core.scenes.mesh import Mesh
from .culling import MARGIN_M, Culling
from .distances import to_points, tree_of
from .icp import lay
from .names import GEOMETRY, PAPER, RENDERS
from .renders import Compare, render_metrics
from .samples import Points
from .truth import Origin, SeenSurface, TrueMap, seen_surface

NEAR_ENOUGH_M = 0.05
"""At most so far from the map a point of the truth is complete: the paper's 5 cm."""
ICP_SAMPLES = 20_000

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
    values: Values = dict.fromkeys(wanted_names(paper=paper, renders=renders))
    if mesh is not None and truth_from_map is not None:
        mesh = moved(mesh, np.asarray(truth_from_map, dtype=np.float64))
    part = None if mesh is None else seen_surface(mesh, truth.seen, MARGIN_M, truth.sample_count, "map", truth.seed)
    values |= _geometry(part, truth)
    if part is not None and truth.part is not None and paper:
        values |= _as_the_paper(part.samples.points_m, truth.points_m)
    if mesh is not None and len(mesh.face_starts) and renders:
        values |= render_metrics(mesh, truth.views, lpips=lpips)
    return MapScore(values, truth.seen.culling, truth.origin, truth.sample_count)


def wanted_names(*, paper: bool, renders: bool) -> list[str]:
    """Return the names of the numbers that a score has."""

    return [item.name for item in (*GEOMETRY, *(RENDERS if renders else ()), *(PAPER if paper else ()))]


def moved(mesh: Mesh, by: NDArray[np.float64]) -> Mesh:
    """Return a mesh in other axes, (4, 4). Raises ValueError where that is no finite affine transformation."""
    if by.shape != (4, 4) or not np.isfinite(by).all() or np.any(by[3] != (0, 0, 0, 1)):
        raise ValueError("a map is moved by a finite (4, 4) matrix whose last row is 0 0 0 1")
    return replace(mesh, vertices_m=mesh.vertices_m @ by[:3, :3].T + by[:3, 3])


def _geometry(part: SeenSurface | None, truth: TrueMap) -> Values:
    values: Values = {"seen_share": None if part is None else part.share}
    values["truth_seen_share"] = None if truth.part is None else truth.part.share
    if truth.part is None:
        return values
    if part is None:
        return values | {"completion_ratio_5cm": 0.0, "f_score_5cm": 0.0}
    accuracy_m = truth.part.surface.distances_m(part.samples.points_m)
    completion_m = part.surface.distances_m(truth.points_m)
    precision, recall = (float((distances < NEAR_ENOUGH_M).mean()) for distances in (accuracy_m, completion_m))
    return values | {
        "accuracy_m": float(accuracy_m.mean()),
        "accuracy_median_m": float(np.median(accuracy_m)),
        "completion_m": float(completion_m.mean()),
        "completion_median_m": float(np.median(completion_m)),
        "completion_ratio_5cm": recall,
        "accuracy_ratio_5cm": precision,
        "f_score_5cm": 2 * precision * recall / (precision + recall) if precision + recall else 0.0,
    }


def _as_the_paper(points_m: Points, truth_m: Points) -> Values:
    """Return what the paper's code calculates, after ICP, and what its table of definitions prints: squares."""
    if min(len(points_m), len(truth_m)) < 3:
        return {}
    laid = lay(points_m[:ICP_SAMPLES], truth_m)
    moved_m = points_m @ laid.truth_from_map[:3, :3].T + laid.truth_from_map[:3, 3]
    accuracy_m = to_points(moved_m, tree_of(truth_m))[0]
    completion_m = to_points(truth_m, tree_of(moved_m))[0]
    middle_m = points_m.mean(axis=0)
    shift_m = laid.truth_from_map[:3, :3] @ middle_m + laid.truth_from_map[:3, 3] - middle_m
    return {
        "paper_accuracy_m": float(accuracy_m.mean()),
        "paper_completion_m": float(completion_m.mean()),
        "paper_completion_ratio": float((completion_m < NEAR_ENOUGH_M).mean()),
        "paper_accuracy_m2": float((accuracy_m**2).mean()),
        "paper_completion_m2": float((completion_m**2).mean()),
        "paper_completion_ratio_squared": float((completion_m**2 <= NEAR_ENOUGH_M).mean()),
        "paper_icp_shift_m": float(np.linalg.norm(shift_m)),
        "paper_icp_turn_deg": float(np.degrees(rotation_angle_rad(np.eye(3), laid.truth_from_map[:3, :3]))),
    }
