# SPDX-License-Identifier: GPL-3.0-or-later
"""Bare trees: branches that fork, as curves with a thickness."""

import random
from dataclasses import dataclass
from typing import TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

Vector: TypeAlias = NDArray[np.float64]

LEVELS = 6  # of branches, the trunk among them; chosen
STEPS = 4  # points of a branch, beyond its first
FORKS = ((STEPS, 0.35), (STEPS, 0.5), (STEPS - 1, 0.85), (STEPS - 2, 0.9))  # the point, and how far the new one turns
TRUNK_M, TRUNK_RADIUS_M = 2.3, 0.13


@dataclass(frozen=True)
class Branch:
    """A branch as it begins. level: 1 for the trunk."""

    foot: Vector
    along: Vector
    long_m: float
    radius_m: float
    level: int


def new_tree_curve(name: str, seed: int, material: bpy.types.Material) -> bpy.types.Curve:
    """Return a tree of its own shape, its foot at the origin."""
    curve = bpy.data.curves.new(name, "CURVE")
    curve.dimensions = "3D"
    curve.bevel_depth = 1.0
    curve.bevel_resolution = 1
    curve.resolution_u = 1
    curve.materials.append(material)
    draw = random.Random(seed)  # noqa: S311  the shape of a tree
    waiting = [Branch(np.zeros(3), np.array([0.0, 0.0, 1.0]), TRUNK_M, TRUNK_RADIUS_M, 1)]
    while waiting:
        waiting.extend(_grow(curve, waiting.pop(), draw))
    return curve


def _grow(curve: bpy.types.Curve, branch: Branch, draw: random.Random) -> list[Branch]:
    """Add a branch; return those that grow from it."""
    points, directions = [branch.foot], [branch.along]
    for _ in range(STEPS):
        drawn = np.array([draw.gauss(0, 1), draw.gauss(0, 1), draw.gauss(0.25, 0.7)])
        directions.append(_unit(directions[-1] + 0.13 * branch.level**0.5 * drawn))
        points.append(points[-1] + directions[-1] * branch.long_m / STEPS)
    radii_m = np.linspace(branch.radius_m, branch.radius_m * 0.66, len(points))
    spline = curve.splines.new("POLY")
    spline.points.add(len(points) - 1)
    for point, place, radius_m in zip(spline.points, points, radii_m, strict=True):
        point.co = (*place, 1.0)
        point.radius = radius_m
    if branch.level == LEVELS:
        return []
    grown = []
    for place, turn in FORKS:
        trunk_is_bare = branch.level == 1 and place < STEPS - 1
        if trunk_is_bare or (place < STEPS and draw.random() < 0.25):
            continue
        sideways = _unit(np.cross(directions[place], [draw.gauss(0, 1), draw.gauss(0, 1), draw.gauss(0, 1)]))
        away = directions[place] + turn * draw.uniform(0.7, 1.4) * sideways
        away[2] += 0.12
        long_m = branch.long_m * draw.uniform(0.62, 0.84)
        grown.append(Branch(points[place], _unit(away), long_m, radii_m[place] * 0.72, branch.level + 1))
    return grown


def _unit(vector: Vector) -> Vector:
    return vector / np.linalg.norm(vector)
