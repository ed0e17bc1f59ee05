# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes put together from quads, boxes, tubes and balls, each face with a material and a glow of its own."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import bpy
import numpy as np

GLOW = "glow"  # of a face: how much light it gives, in scene-linear units, for materials that ask
Point: TypeAlias = tuple[float, float, float]


@dataclass
class Solid:
    """A mesh that grows; lengths in metres."""

    points: list[Point] = field(default_factory=list)
    faces: list[tuple[int, ...]] = field(default_factory=list)
    materials: list[str] = field(default_factory=list)
    glows: list[float] = field(default_factory=list)
    smooth: list[bool] = field(default_factory=list)

    def face(self, corners: Sequence[Point], material: str, glow: float = 0.0) -> None:
        """Add a flat face; its front is where the corners go counter-clockwise."""
        first = len(self.points)
        self.points.extend(corners)
        self._add(tuple(range(first, first + len(corners))), material, glow, smooth=False)

    def _add(self, corners: tuple[int, ...], material: str, glow: float, *, smooth: bool) -> None:
        self.faces.append(corners)
        self.materials.append(material)
        self.glows.append(glow)
        self.smooth.append(smooth)

    def box(self, low: Point, high: Point, material: str, glow: float = 0.0) -> None:
        """Add a box along the axes between two corners."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        a, b, c, d = (x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0)
        e, f, g, h = (x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)
        for corners in ((d, c, b, a), (e, f, g, h), (a, b, f, e), (b, c, g, f), (c, d, h, g), (d, a, e, h)):
            self.face(corners, material, glow)

    def tube(
        self, path: Sequence[Point], radii_m: Sequence[float], material: str, *, sides: int = 8, glow: float = 0.0
    ) -> None:
        """Add a round tube along points, closed at both ends, with a radius at each."""
        rings = [self._ring(path, k, radius_m, sides) for k, radius_m in enumerate(radii_m)]
        self.grid(rings, material, closed=True, glow=glow)
        for ring in (rings[0][::-1], rings[-1]):
            self.face(ring, material, glow)

    @staticmethod
    def _ring(path: Sequence[Point], k: int, radius_m: float, sides: int) -> list[Point]:
        here = np.array(path[k])
        along = np.array(path[min(k + 1, len(path) - 1)]) - np.array(path[max(k - 1, 0)])
        along = along / np.linalg.norm(along)
        helper = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        side = np.cross(along, helper)
        side = side / np.linalg.norm(side)
        up = np.cross(side, along)
        angles = np.arange(sides) * 2 * math.pi / sides
        around = here + radius_m * (np.cos(angles)[:, None] * side - np.sin(angles)[:, None] * up)
        return [(float(x), float(y), float(z)) for x, y, z in around]

    def ball(self, centre: Point, radius_m: float, material: str, *, sides: int = 12, glow: float = 0.0) -> None:
        """Add a ball of quads."""
        rings = []
        for k in range(1, sides // 2):
            angle = math.pi * k / (sides // 2)
            height, wide = -math.cos(angle) * radius_m, math.sin(angle) * radius_m
            rings.append(circle((centre[0], centre[1], centre[2] + height), wide, sides))
        self.grid(rings, material, closed=True, glow=glow)
        self.face(rings[0][::-1], material, glow)
        self.face(rings[-1], material, glow)

    def grid(self, rows: Sequence[Sequence[Point]], material: str, *, closed: bool = False, glow: float = 0.0) -> None:
        """Add a smooth surface through rows of points; closed: each row's last point is joined to its first."""
        first, across = len(self.points), len(rows[0])
        for row in rows:
            self.points.extend(row)
        for k in range(len(rows) - 1):
            for j in range(across if closed else across - 1):
                here, there = first + k * across, first + (k + 1) * across
                following = (j + 1) % across
                self._add((here + j, here + following, there + following, there + j), material, glow, smooth=True)

    def to_object(self, name: str, materials: dict[str, bpy.types.Material]) -> bpy.types.Object:
        """Return an object of this shape, in no scene yet."""
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(self.points, [], self.faces)
        used = list(dict.fromkeys(self.materials))
        for item in used:
            mesh.materials.append(materials[item])
        mesh.polygons.foreach_set("material_index", [used.index(item) for item in self.materials])
        mesh.polygons.foreach_set("use_smooth", self.smooth)
        glow = mesh.attributes.new(GLOW, "FLOAT", "FACE")
        assert isinstance(glow, bpy.types.FloatAttribute)
        glow.data.foreach_set("value", self.glows)
        mesh.update()
        return bpy.data.objects.new(name, mesh)


def circle(centre: Point, radius_m: float, sides: int) -> list[Point]:
    """Return points around a vertical axis, counter-clockwise as seen from above."""
    angles = [2 * math.pi * k / sides for k in range(sides)]
    return [
        (centre[0] + radius_m * math.cos(angle), centre[1] + radius_m * math.sin(angle), centre[2]) for angle in angles
    ]
