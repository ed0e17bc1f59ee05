# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays against boxes that are aligned with the axes. Single precision: sums and products, so every processor agrees."""

import numpy as np
from numpy.typing import NDArray

from .surfaces import Array

_MARGIN_M = 1e-3  # far more than single precision rounds in a room


def first_hit(origins_m: Array, directions: Array, boxes_m: Array) -> Array:
    """(N,) distance in units of the directions, (N, 3) or (3,), to the nearest box (B, 2, 3) entered from outside.

    Infinite where there is none. Single precision: sums and products, so every processor agrees.
    """
    if not len(boxes_m):
        return np.full(len(origins_m), np.inf)
    enter = np.full((len(boxes_m), len(origins_m)), -np.inf, np.float32)
    leave = np.full_like(enter, np.inf)
    for k in range(3):
        d = directions[..., k]
        inverse = np.float32(1.0) / np.where(abs(d) < 1e-6, 1e-6, d).astype(np.float32)
        o = origins_m[:, k]
        a, b = (boxes_m[:, 0, k, None] - o) * inverse, (boxes_m[:, 1, k, None] - o) * inverse
        np.maximum(enter, np.minimum(a, b), out=enter)
        np.minimum(leave, np.maximum(a, b), out=leave)
    hit = np.where((enter < leave) & (enter > 0), enter, np.inf)
    return hit.min(0)


def first_hits(origins_m: Array, directions: Array, boxes_m: Array, reach_m: float) -> Array:
    """(D, N) distance along directions (D, 3) of length 1 to the nearest box that is entered from outside.

    Infinite where there is none within reach_m; beyond it some are left out.
    """
    which, box = _pairs(origins_m, reach_m * directions, boxes_m, towards=False)
    distance = np.full((len(directions), len(origins_m)), np.inf, np.float32)
    if len(which):
        inverse = _inverse(directions)[which]
        hit = _entered(origins_m, boxes_m[box], [inverse[:, k, None] for k in range(3)])
        starts = np.flatnonzero(np.diff(which, prepend=-1))
        distance[which[starts]] = np.minimum.reduceat(hit, starts, axis=0)
    return distance


def hidden(origins_m: Array, lights_m: Array, away: Array, boxes_m: Array) -> NDArray[np.bool_]:
    """(L, N) whether a box stands between points (N, 3) and lights (L, 3). away: the vectors (L, N, 3) to these."""
    which, box = _pairs(origins_m, lights_m, boxes_m, towards=True)
    found = np.zeros(away.shape[:2], bool)
    if len(which):
        inverse = _inverse(away)
        hit = _entered(origins_m, boxes_m[box], [inverse[which, :, k] for k in range(3)])
        starts = np.flatnonzero(np.diff(which, prepend=-1))
        found[which[starts]] = np.logical_or.reduceat(hit < 1.0, starts, axis=0)
    return found


def _inverse(directions: Array) -> Array:
    return np.float32(1.0) / np.where(abs(directions) < 1e-6, 1e-6, directions).astype(np.float32)


def _entered(origins_m: Array, boxes_m: Array, inverse: list[Array]) -> Array:
    """(P, N) distance from each point to the P boxes (P, 2, 3), infinite where a box is not entered from outside.

    inverse: of x, y and z of the directions, each (P, 1) or (P, N).
    """
    enter = leave = None
    for k in range(3):
        o = origins_m[:, k]
        a, b = (boxes_m[:, 0, k, None] - o) * inverse[k], (boxes_m[:, 1, k, None] - o) * inverse[k]
        near, far = np.minimum(a, b), np.maximum(a, b, out=a)
        enter = near if enter is None else np.maximum(enter, near, out=enter)
        leave = far if leave is None else np.minimum(leave, far, out=leave)
    assert enter is not None
    assert leave is not None
    enter[(enter >= leave) | (enter <= 0)] = np.inf
    return enter


def _pairs(
    origins_m: Array, ends_m: Array, boxes_m: Array, *, towards: bool
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return numbers of ends (E, 3) and of boxes that may stand in the way to these, sorted by end.

    towards: whether all ways end in a point, or each goes on by the same vector. While a share t of a way is gone, all
    are in a box whose sides move evenly; where these overlap the box, if anywhere, are six inequalities in t.
    """
    low, high = origins_m.min(axis=0).astype(np.float64), origins_m.max(axis=0).astype(np.float64)
    moved_low, moved_high = (ends_m - low, ends_m - high) if towards else (ends_m, ends_m)
    first, last = np.zeros((len(ends_m), len(boxes_m))), np.ones((len(ends_m), len(boxes_m)))
    for k in range(3):
        # low + t * moved <= the box's high side, and the other way round.
        for slack, rate in (
            (boxes_m[:, 1, k] + _MARGIN_M - low[k], moved_low[:, k, None]),
            (high[k] - boxes_m[:, 0, k] + _MARGIN_M, -moved_high[:, k, None]),
        ):
            with np.errstate(divide="ignore", invalid="ignore"):
                at = slack / rate
            last = np.where(rate > 0, np.minimum(last, at), last)
            first = np.where(rate < 0, np.maximum(first, at), first)
            last = np.where((rate == 0) & (slack < 0), -1.0, last)
    ends, boxes = np.nonzero(first <= last)
    return ends, boxes
