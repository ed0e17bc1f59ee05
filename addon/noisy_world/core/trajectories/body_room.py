# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a body has room along its path: what of the mesh comes nearer to it than its radius."""

from dataclasses import dataclass

import numpy as np

from ..scenes.mesh import Mesh
from .bodies import CarryingBody
from .room_map import HEAD_M, Float64, columns, distance_m, floor_of
from .trajectory import Trajectory

STEP_M = 0.02  # between the places that are looked at: a tenth of the smallest radius
AT_ONCE = 256  # places, and all points of the mesh beside each


@dataclass(frozen=True)
class Narrow:
    """Where a body has no room: at which second, at which place (x, y, z), and how near the mesh is."""

    time_s: float
    place_m: tuple[float, float, float]
    gap_m: float


def first_narrow(mesh: Mesh, path: Trajectory, body: CarryingBody) -> Narrow | None:
    """Return where a path first leaves a body less than its radius, None where it has room everywhere.

    A body that stands needs the floor free, from what it can step on to its head; another one what is around it.
    Points of the mesh are at most some 5 cm apart. Raises NoisyWorldError where the mesh is too large to be looked at.
    """
    times_s, places_m = _places(path)
    bounds = np.stack([places_m[:, :2].min(axis=0), places_m[:, :2].max(axis=0)])
    points_m, grid = columns(mesh, bounds, body.radius_m)
    low_m, high_m = places_m[:, 2] - body.radius_m, places_m[:, 2] + body.radius_m
    if body.stands:
        cell = np.ravel_multi_index(grid.cells(points_m[:, :2]), grid.shape)
        floor_m, _ = floor_of(cell, points_m[:, 2], np.ones(grid.shape, np.bool_))
        low_m, high_m = np.full_like(low_m, floor_m + body.step_m), places_m[:, 2] + HEAD_M
    beside_m = points_m[(points_m[:, 2] >= low_m.min()) & (points_m[:, 2] <= high_m.max())]
    occupied = np.zeros(grid.shape, np.bool_)
    occupied[grid.cells(beside_m[:, :2])] = True
    near_m = body.radius_m + 2.0 * grid.cell_m
    near = np.flatnonzero(distance_m(occupied, near_m, grid.cell_m)[grid.cells(places_m[:, :2])] < near_m)
    for first in range(0, len(near), AT_ONCE):
        rows = near[first : first + AT_ONCE]
        gaps_m = _gaps_m(places_m[rows], low_m[rows], high_m[rows], beside_m)
        if (narrow := np.flatnonzero(gaps_m < body.radius_m)).size:
            row = rows[narrow[0]]
            x, y, z = places_m[row].tolist()
            return Narrow(float(times_s[row]), (x, y, z), float(gaps_m[narrow[0]]))
    return None


def _places(path: Trajectory) -> tuple[Float64, Float64]:
    """Return times (N,) and places (N, 3) along a path, at most STEP_M apart."""
    at_s, place_m = path.stamps_s, path.c2w[:, :3, 3]
    gaps_m = np.linalg.norm(np.diff(place_m, axis=0), axis=1)
    counts = np.maximum(np.ceil(2.0 * gaps_m / STEP_M).astype(np.int64), 1)  # a curve is longer than its chords
    parts = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(at_s[:-1], at_s[1:], counts, strict=True)]
    times_s = np.concatenate([*parts, at_s[-1:]])
    return times_s, path.continuous.pose_at(times_s)[:, :3, 3]


def _gaps_m(places_m: Float64, low_m: Float64, high_m: Float64, points_m: Float64) -> Float64:
    """Return (N,): how far the nearest point between two heights is from each place, level; inf where there is none."""
    around = np.all(
        np.abs(points_m[:, :2] - places_m[:, :2].mean(axis=0)) <= np.ptp(places_m[:, :2], axis=0) + 1.0, axis=1
    )
    points_m = points_m[around]
    found = np.full(len(places_m), np.inf)
    for row, place_m in enumerate(places_m):
        level = points_m[(points_m[:, 2] >= low_m[row]) & (points_m[:, 2] <= high_m[row]), :2]
        if len(level):
            found[row] = np.sqrt(np.min(np.sum(np.square(level - place_m[:2]), axis=1)))
    return found
