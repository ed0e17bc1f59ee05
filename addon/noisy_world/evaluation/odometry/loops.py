# SPDX-License-Identifier: GPL-3.0-or-later
"""Loop closure: views where the path returns are found and aligned."""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import invert_pose, rotation_angle_rad
from .agreement import Agreement
from .places import Places
from .tracking_history import Edge

Float64: TypeAlias = NDArray[np.float64]

APART = 10  # keyframes between the two at least; nearer ones hang together anyway
NEAR_M, NEAR_DEG = 1.0, 40.0  # how near the two seem to be, before drift
DRIFT_SHARE = 0.02  # of the way between them: so much farther apart they may seem
TRIED = 2  # a keyframe


def find_loops(
    places: Places, c2w: Sequence[Float64], usual: Agreement, *, stopped: Callable[[], bool] = lambda: False
) -> list[Edge]:
    """Return loops: for each keyframe at most one other, long before it, that it fits as well as its neighbours do.

    c2w: the keyframes' poses as far as they are known. usual: how well neighbours agree.
    """
    loops: list[Edge] = []
    for target in range(APART, len(c2w)):
        if stopped():
            break
        loop = _loop(places, c2w, target, lambda seen: fits(seen, usual))
        if loop is not None:
            loops.append(loop)
    return loops


def fits(seen: Agreement, usual: Agreement) -> bool:
    """Tell whether two views agree about as well as neighbours do, so that noise is no reason to refuse a loop."""
    return (
        seen.overlap >= 0.4
        and seen.seen >= 0.3 * usual.seen
        and seen.depth >= usual.depth - 0.15
        and seen.grey >= usual.grey - 0.15
        and seen.error <= 3.0 * usual.error + 1e-3
    )


def _loop(places: Places, c2w: Sequence[Float64], target: int, good: Callable[[Agreement], bool]) -> Edge | None:
    candidates = near_keyframes(c2w, target)[:TRIED]
    if not candidates:
        return None
    view = places.view(target)
    for source in candidates:
        seen_by_features = places.recognised(source, target)
        by_path = invert_pose(c2w[target]) @ c2w[source]
        for guess in (by_path, seen_by_features):
            placed = None if guess is None else places.placed(places.view(source), view, guess, good)
            if placed is not None:
                return Edge(source, target, placed[0])
    return None


def near_keyframes(c2w: Sequence[Float64], target: int) -> list[int]:
    """Return earlier keyframes that seem near and look the same way, the nearest first."""
    poses = np.stack(c2w[: target + 1])
    steps_m = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    way_m = np.concatenate([np.cumsum(steps_m[::-1])[::-1], [0.0]])[: target - APART + 1]
    earlier = poses[: target - APART + 1]
    apart_m = np.linalg.norm(earlier[:, :3, 3] - poses[target, :3, 3], axis=1)
    apart_deg = np.degrees(rotation_angle_rad(earlier[:, :3, :3], poses[target, :3, :3]))
    near = (apart_m < NEAR_M + DRIFT_SHARE * way_m) & (apart_deg < NEAR_DEG)
    order = np.argsort(apart_m / NEAR_M + apart_deg / NEAR_DEG, kind="stable")
    return [int(number) for number in order if near[number]]
