# SPDX-License-Identifier: GPL-3.0-or-later
"""The keyframes' poses that fit all measured edges best, by gtsam."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.extras import need
from ...core.geometry import invert_pose, rotation_angle_rad
from ...core.requirements import missing_packages
from .tracking_history import Edge

Float64: TypeAlias = NDArray[np.float64]

# Of an alignment's error, each axis; only the ratios count. Chosen: a radian does as much as a metre, as rooms are some
# metres large; loops are aligned from farther apart.
EDGE_SIGMA, LOOP_SIGMA, FIXED_SIGMA = 1.0, 2.0, 1e-3
UNIT = 1e-3  # a millimetre, a milliradian
# Where Cauchy's weight lets go of a loop: so many sigmas, or so many times the loops' median gap, which is the drift.
TOLERATED = 3.0


def can_optimise() -> bool:
    """Tell whether gtsam is installed."""
    return not missing_packages(["gtsam"])


def optimised(c2w: Sequence[Float64], edges: Sequence[Edge], loops: Sequence[Edge]) -> list[Float64]:
    """Return the keyframes' c2w, the first as it was. Raises MissingDependencyError without gtsam."""
    need(["gtsam"], "evaluate", for_what="closing loops")
    import gtsam

    plain = gtsam.noiseModel.Isotropic.Sigma(6, EDGE_SIGMA * UNIT)
    robust = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Cauchy.Create(TOLERATED * max(1.0, _median_gap(c2w, loops))),
        gtsam.noiseModel.Isotropic.Sigma(6, LOOP_SIGMA * UNIT),
    )
    graph, first = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(c2w[0]), gtsam.noiseModel.Isotropic.Sigma(6, FIXED_SIGMA * UNIT)))
    for number, pose in enumerate(c2w):
        first.insert(number, gtsam.Pose3(pose))
    for group, noise in ((edges, plain), (loops, robust)):
        for edge in group:
            graph.add(gtsam.BetweenFactorPose3(edge.first, edge.second, gtsam.Pose3(edge.first_from_second), noise))
    found = gtsam.LevenbergMarquardtOptimizer(graph, first).optimize()
    return [np.asarray(found.atPose3(number).matrix(), np.float64) for number in range(len(c2w))]


def _median_gap(c2w: Sequence[Float64], loops: Sequence[Edge]) -> float:
    """Return how far loops are from closing, in sigmas of theirs: the median."""
    gaps = []
    for loop in loops:
        gap = invert_pose(loop.first_from_second) @ invert_pose(c2w[loop.first]) @ c2w[loop.second]
        turn = float(rotation_angle_rad(gap[:3, :3], np.eye(3)))
        gaps.append(np.hypot(turn, np.linalg.norm(gap[:3, 3])) / (LOOP_SIGMA * UNIT))
    return float(np.median(gaps)) if gaps else 0.0
