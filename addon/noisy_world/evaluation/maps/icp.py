# SPDX-License-Identifier: GPL-3.0-or-later
"""Alignment of a map to the truth by iterative closest points (Besl and McKay 1992)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import nearest_rotation, pose
from .distances import to_points, tree_of
from .samples import Points

LARGEST_M = 0.1  # pairs that are farther apart are left out: the paper's code
ITERATIONS = 30  # Open3D's default, which the paper's code takes
_ENOUGH = 1e-6  # of the share of pairs and of their RMSE, both Open3D's defaults


@dataclass(frozen=True)
class Laid:
    """What ICP found: truth_from_map (4, 4), rigid, the share of the points that have a pair, and the pairs' RMSE."""

    truth_from_map: NDArray[np.float64]
    share: float
    rmse_m: float


def lay(points_m: Points, truth_m: Points, *, largest_m: float = LARGEST_M) -> Laid:
    """Move points (N, 3) onto others (M, 3), each at least three; where too few have pairs, they stay."""
    tree = tree_of(truth_m)
    middle_m = truth_m.mean(axis=0)
    whole = np.eye(4)
    share, rmse_m = 0.0, np.inf
    for left in range(ITERATIONS, -1, -1):
        moved = points_m @ whole[:3, :3].T + whole[:3, 3]
        apart_m, which = to_points(moved, tree, largest_m=largest_m)
        paired = np.isfinite(apart_m)
        before = share, rmse_m
        share = float(paired.mean())
        if paired.sum() < 3:
            return Laid(whole, share, np.nan)
        rmse_m = float(np.sqrt(np.mean(apart_m[paired] ** 2)))
        if not left or (abs(share - before[0]) < _ENOUGH and abs(rmse_m - before[1]) < _ENOUGH):
            break
        whole = _moving(moved[paired] - middle_m, truth_m[which[paired]] - middle_m, middle_m) @ whole
    return Laid(whole, share, rmse_m)


def _moving(points: Points, onto: Points, middle_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rigid motion (4, 4) that brings points nearest to their pairs; both are relative to a middle."""
    centre, other = points.mean(axis=0), onto.mean(axis=0)
    rotation = nearest_rotation((onto - other).T @ (points - centre))
    return pose(rotation, middle_m + other - rotation @ (middle_m + centre))
