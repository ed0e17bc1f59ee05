# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes put together from quads, boxes, tubes and balls, each face with a material and a glow of its own."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

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


# --- houses: a front with recessed windows, a shop or doors at the ground, a cornice and a roof ---


GROUND_FLOOR_M, FLOOR_M = 3.7, 3.1
RECESS_M = 0.16
DEEP_M = 9.0  # of a house
SHOP_M = 2.6  # how deep a shop can be looked into
LIT_SHARE = 0.34  # of the windows
Hole: TypeAlias = tuple[float, float, float, float]
"""Of a front: from, to along it; from, to above the ground."""


@dataclass(frozen=True)
class House:
    """What a house looks like. wall, trim: materials; awning: the shop's, none without a shop."""

    width_m: float
    floors: int
    wall: str
    trim: str
    columns: int
    awning: str = ""
    gable: bool = False


@dataclass(frozen=True)
class Front:
    """Where a front stands: its corner, and the directions along it and out of it, in the ground plane."""

    corner: tuple[float, float]
    along: tuple[float, float]
    out: tuple[float, float]

    def at(self, along_m: float, up_m: float, out_m: float = 0.0) -> Point:
        """Return a place in the world."""
        x = self.corner[0] + self.along[0] * along_m + self.out[0] * out_m
        y = self.corner[1] + self.along[1] * along_m + self.out[1] * out_m
        return (x, y, up_m)

    def box(self, solid: Solid, low: Point, high: Point, material: str, glow: float = 0.0) -> None:
        """Add a box; its corners are (along, up, out)."""
        first, second = self.at(low[0], low[1], low[2]), self.at(high[0], high[1], high[2])
        ends = [(min(a, b), max(a, b)) for a, b in zip(first, second, strict=True)]
        (x0, x1), (y0, y1), (z0, z1) = ends
        solid.box((x0, y0, z0), (x1, y1, z1), material, glow)


def add_house(solid: Solid, front: Front, house: House, draw: random.Random) -> None:
    """Add a house; `draw` decides which windows are lit."""
    top_m = GROUND_FLOOR_M + house.floors * FLOOR_M + 0.5
    windows = _windows(house)
    openings = _openings(house)
    _wall(solid, front, house, top_m, windows + openings)
    for hole in windows:
        lit = draw.random() < LIT_SHARE
        _window(solid, front, hole, house.trim, draw.uniform(0.9, 3.2) if lit else 0.0)
    _ground(solid, front, house, openings, draw)
    for up_m in (GROUND_FLOOR_M - 0.05, top_m - 0.35):
        front.box(solid, (0.0, up_m, 0.0), (house.width_m, up_m + 0.16, 0.12), house.trim)
    front.box(solid, (0.0, top_m - 0.18, 0.0), (house.width_m, top_m, 0.3), house.trim)
    front.box(solid, (0.0, 0.0, -DEEP_M), (house.width_m, top_m, -SHOP_M - 0.4), house.wall)
    front.box(solid, (0.0, 0.15, 0.0), (house.width_m, 0.55, 0.05), "stone") if not house.awning else None
    _roof(solid, front, house, top_m)
    _pipe(solid, front, house.width_m - 0.18, top_m)


def _windows(house: House) -> list[Hole]:
    pitch_m = house.width_m / house.columns
    wide_m, high_m = min(1.25, pitch_m * 0.55), 1.75
    lefts = [(column + 0.5) * pitch_m - wide_m / 2 for column in range(house.columns)]
    sills = [GROUND_FLOOR_M + floor * FLOOR_M + 0.8 for floor in range(house.floors)]
    return [(left, left + wide_m, sill, sill + high_m) for sill in sills for left in lefts]


def _openings(house: House) -> list[Hole]:
    """Return a shop's window and door, or doors and windows of a house to live in."""
    if house.awning:
        return [(0.5, house.width_m - 1.9, 0.55, 2.75), (house.width_m - 1.5, house.width_m - 0.5, 0.15, 2.75)]
    pitch_m = house.width_m / house.columns
    holes = []
    for column in range(house.columns):
        middle_m = (column + 0.5) * pitch_m
        holes.append((middle_m - 0.55, middle_m + 0.55, 0.15 if column == 1 else 1.05, 2.75))
    return holes


def _wall(solid: Solid, front: Front, house: House, top_m: float, holes: list[Hole]) -> None:
    """Add the front as a grid of cells, without those that a hole takes."""
    along = sorted({0.0, house.width_m, *(edge for hole in holes for edge in hole[:2])})
    up = sorted({0.0, top_m, *(edge for hole in holes for edge in hole[2:])})
    for left, right in pairwise(along):
        for low, high in pairwise(up):
            middle = ((left + right) / 2, (low + high) / 2)
            if not any(h[0] < middle[0] < h[1] and h[2] < middle[1] < h[3] for h in holes):
                corners = [front.at(left, low), front.at(right, low), front.at(right, high), front.at(left, high)]
                solid.face(corners, house.wall)
    for left, right, low, high in holes:
        ring = [(left, low), (right, low), (right, high), (left, high)]
        for (a, b), (c, d) in zip(ring, [*ring[1:], ring[0]], strict=True):
            corners = [front.at(a, b), front.at(c, d), front.at(c, d, -RECESS_M), front.at(a, b, -RECESS_M)]
            solid.face(corners, house.trim)


def _window(solid: Solid, front: Front, hole: Hole, trim: str, glow: float) -> None:
    left, right, low, high = hole
    _pane(solid, front, hole, glow)
    bar_m, depth = 0.06, (-RECESS_M, -RECESS_M + 0.06)
    middle_m = (left + right) / 2
    for a, b in ((left, left + bar_m), (middle_m - bar_m / 2, middle_m + bar_m / 2), (right - bar_m, right)):
        front.box(solid, (a, low, depth[0]), (b, high, depth[1]), "white paint")
    for a in (low, low + 0.66 * (high - low), high - bar_m):
        front.box(solid, (left, a, depth[0]), (right, a + bar_m, depth[1]), "white paint")
    front.box(solid, (left - 0.12, low - 0.1, -RECESS_M), (right + 0.12, low, 0.1), trim)
    front.box(solid, (left - 0.12, high, 0.0), (right + 0.12, high + 0.14, 0.06), trim)


def _pane(solid: Solid, front: Front, hole: Hole, glow: float) -> None:
    left, right, low, high = hole
    corners = [front.at(a, b, -RECESS_M) for a, b in ((left, low), (right, low), (right, high), (left, high))]
    solid.face(corners, "panes", glow)


def _ground(solid: Solid, front: Front, house: House, openings: list[Hole], draw: random.Random) -> None:
    if house.awning:
        _shop(solid, front, house, openings, draw)
        return
    for hole in openings:
        if hole[2] < 0.5:
            _door(solid, front, hole)
        else:
            _window(solid, front, hole, house.trim, draw.uniform(0.8, 2.0) if draw.random() < 0.3 else 0.0)


def _door(solid: Solid, front: Front, hole: Hole) -> None:
    left, right, low, high = hole
    front.box(solid, (left, low, -RECESS_M), (right, high - 0.5, -RECESS_M + 0.05), "dark green")
    for a in (low + 0.2, low + 1.15):
        front.box(solid, (left + 0.15, a, -RECESS_M), (right - 0.15, a + 0.75, -RECESS_M + 0.08), "dark green")
    _pane(solid, front, (left, right, high - 0.5, high), 1.6)
    front.box(solid, (left - 0.2, 0.0, -0.1), (right + 0.2, low + 0.02, 0.45), "stone")


def _shop(solid: Solid, front: Front, house: House, openings: list[Hole], draw: random.Random) -> None:
    """Add a room behind the front, with shelves, a lit ceiling, a sign and an awning."""
    wide_m, window, door = house.width_m, openings[0], openings[1]
    inner = (0.15, wide_m - 0.15)
    front.box(solid, (inner[0], 0.1, -SHOP_M), (inner[1], 0.15, -RECESS_M), "wood")
    front.box(solid, (inner[0], 3.0, -SHOP_M), (inner[1], 3.1, -RECESS_M), "white paint")
    front.box(solid, (inner[0], 0.1, -SHOP_M - 0.1), (inner[1], 3.1, -SHOP_M), "ochre")
    for a in inner:
        front.box(solid, (a - 0.05, 0.1, -SHOP_M), (a + 0.05, 3.1, -RECESS_M), "cream")
    for share in (0.25, 0.5, 0.75):
        middle_m = share * wide_m
        front.box(solid, (middle_m - 0.5, 2.92, -1.8), (middle_m + 0.5, 2.98, -0.9), "shop light", 9.0)
    for shelf_m in (0.75, 1.2, 1.65, 2.1):
        front.box(solid, (0.4, shelf_m, -SHOP_M), (wide_m - 0.4, shelf_m + 0.04, -SHOP_M + 0.35), "wood")
        here_m = 0.5
        while here_m < wide_m - 0.7:
            size_m = draw.uniform(0.08, 0.3)
            kind = draw.choice(("goods", "books", "porcelain", "dark green", "car red", "wood"))
            high_m = shelf_m + 0.04 + draw.uniform(0.12, 0.34)
            front.box(solid, (here_m, shelf_m + 0.04, -SHOP_M + 0.05), (here_m + size_m, high_m, -SHOP_M + 0.3), kind)
            here_m += size_m + draw.uniform(0.02, 0.25)
    front.box(solid, (window[0] + 0.2, 0.15, -0.9), (window[1] - 0.2, 0.75, -0.35), "wood")
    for a in (window[0], (window[0] + window[1]) / 2, window[1] - 0.08, door[0], door[1] - 0.08):
        front.box(solid, (a, window[2], -RECESS_M), (a + 0.08, window[3], -RECESS_M + 0.08), "dark green")
    front.box(solid, (0.3, 2.85, 0.0), (wide_m - 0.3, 3.4, 0.1), "dark green")
    front.box(solid, (0.8, 3.02, 0.1), (wide_m - 0.8, 3.05, 0.13), "shop light", 5.0)
    low, high = (
        [front.at(a, 2.45, 1.35) for a in (0.4, wide_m - 1.7)],
        [front.at(a, 2.95, 0.1) for a in (0.4, wide_m - 1.7)],
    )
    solid.face([low[0], low[1], high[1], high[0]], house.awning)
    hem = [front.at(a, 2.25, 1.35) for a in (0.4, wide_m - 1.7)]
    solid.face([hem[0], hem[1], low[1], low[0]], house.awning)


def _roof(solid: Solid, front: Front, house: House, top_m: float) -> None:
    wide_m, ridge_m = house.width_m, top_m + 2.6
    if house.gable:
        a, b, c = front.at(0, top_m, 0), front.at(wide_m, top_m, 0), front.at(wide_m / 2, ridge_m + 0.6, 0)
        d, e, f = (front.at(x, z, -DEEP_M) for x, z in ((0, top_m), (wide_m, top_m), (wide_m / 2, ridge_m + 0.6)))
        solid.face([a, b, c], house.wall)
        for corners in ([a, c, f, d], [b, e, f, c]):
            solid.face(corners, "roof")
    else:
        a, b = front.at(0, top_m, 0.3), front.at(wide_m, top_m, 0.3)
        c, d = front.at(wide_m, ridge_m, -3.5), front.at(0, ridge_m, -3.5)
        e, f = front.at(wide_m, ridge_m, -DEEP_M), front.at(0, ridge_m, -DEEP_M)
        solid.face([a, b, c, d], "roof")
        solid.face([d, c, e, f], "roof")
        for end in (0.0, wide_m):
            side = [front.at(end, top_m, 0.3), front.at(end, ridge_m, -3.5), front.at(end, top_m, -3.5)]
            solid.face(side, house.wall)
    left_m = 0.22 * wide_m
    front.box(solid, (left_m, top_m, -3.4), (left_m + 0.9, ridge_m + 1.0, -2.7), "red brick")
    for pot in (0.15, 0.55):
        front.box(solid, (left_m + pot, ridge_m + 1.0, -3.2), (left_m + pot + 0.2, ridge_m + 1.4, -2.95), "goods")


def _pipe(solid: Solid, front: Front, along_m: float, top_m: float) -> None:
    solid.tube([front.at(along_m, 0.1, 0.1), front.at(along_m, top_m, 0.1)], [0.05, 0.05], "iron")


# --- what stands in the street: lamps, cars, benches, a cafe's table, bulbs on a wire ---


LANTERN_GLOW, BULB_GLOW, CANDLE_GLOW, TAIL_GLOW = 60.0, 40.0, 20.0, 8.0  # scene-linear; chosen
LANTERN_M = 4.3  # above the ground


def add_lamp(solid: Solid, x_m: float, y_m: float) -> None:
    """Add an iron lamp with a glowing lantern."""
    solid.tube([(x_m, y_m, z) for z in (0.0, 0.5, 0.55, 0.9, 4.0)], [0.13, 0.12, 0.08, 0.055, 0.045], "iron", sides=10)
    solid.tube([(x_m, y_m, z) for z in (3.95, 4.05, 4.1)], [0.05, 0.17, 0.17], "iron", sides=6)
    solid.tube([(x_m, y_m, z) for z in (4.1, 4.5)], [0.13, 0.2], "lantern", sides=6, glow=LANTERN_GLOW)
    for k in range(6):
        angle = 2 * math.pi * k / 6
        low = (x_m + 0.14 * math.cos(angle), y_m + 0.14 * math.sin(angle), 4.1)
        high = (x_m + 0.21 * math.cos(angle), y_m + 0.21 * math.sin(angle), 4.5)
        solid.tube([low, high], [0.012, 0.012], "iron", sides=4)
    solid.tube([(x_m, y_m, z) for z in (4.5, 4.53, 4.72, 4.85)], [0.25, 0.24, 0.05, 0.02], "iron", sides=6)


def add_bulbs(solid: Solid, first: Point, last: Point, sag_m: float, count: int) -> list[Point]:
    """Hang bulbs on a wire between two points; return where they are."""
    steps = 24
    wire = [_hanging(first, last, sag_m, k / steps) for k in range(steps + 1)]
    solid.tube(wire, [0.012] * len(wire), "rubber", sides=4)
    places = [_hanging(first, last, sag_m, (k + 0.5) / count) for k in range(count)]
    for x, y, z in places:
        solid.tube([(x, y, z), (x, y, z - 0.08)], [0.02, 0.02], "rubber", sides=5)
        solid.ball((x, y, z - 0.12), 0.05, "bulb", sides=8, glow=BULB_GLOW)
    return places


def _hanging(first: Point, last: Point, sag_m: float, share: float) -> Point:
    x, y, z = ((1 - share) * a + share * b for a, b in zip(first, last, strict=True))
    return (x, y, z - 4 * sag_m * share * (1 - share))


# Stations of a car along its length, from the back: place, half width, lowest, belt and top.
CAR = (
    (0.00, 0.66, 0.42, 0.74, 0.80),
    (0.06, 0.78, 0.30, 0.84, 0.92),
    (0.35, 0.84, 0.24, 0.92, 1.02),
    (0.62, 0.86, 0.22, 0.93, 1.12),
    (1.05, 0.87, 0.22, 0.92, 1.44),
    (1.75, 0.87, 0.22, 0.91, 1.50),
    (2.35, 0.87, 0.22, 0.90, 1.45),
    (3.02, 0.86, 0.22, 0.89, 1.02),
    (3.30, 0.85, 0.23, 0.86, 0.96),
    (3.80, 0.82, 0.26, 0.78, 0.86),
    (4.02, 0.76, 0.32, 0.68, 0.74),
    (4.10, 0.64, 0.42, 0.60, 0.64),
)
CABIN = (3, 7)  # stations between which there is glass
WHEELS_M = (0.72, 3.28)


def add_car(body: Solid, parts: Solid, x_m: float, y_m: float, paint: str) -> None:
    """Add a car that stands with its back at y_m. body: what will be smoothed; parts: what is not."""
    rows: list[list[Point]] = []
    for along, half, low, belt, top in CAR:
        y = y_m + along
        roof = half * (0.80 if top > 1.2 else 0.9)
        half_row = [(0.0, low), (half * 0.86, low), (half, low + 0.18), (half, belt - 0.06), (half * 0.98, belt)]
        half_row += [(roof, top - 0.04), (roof * 0.6, top), (0.0, top + 0.01)]
        mirrored = [(-x, z) for x, z in half_row[1:-1][::-1]]
        rows.append([(x_m + x, y, z) for x, z in [*half_row, *mirrored]])
    first, across = len(body.points), len(rows[0])
    body.grid(rows, paint, closed=True)
    made = len(body.faces) - (len(rows) - 1) * across
    for k in range(*CABIN):
        for j in (4, across - 5):
            body.materials[made + k * across + j] = "car glass"
    for k in (CABIN[0], CABIN[1] - 1):  # the windows behind and in front
        for j in (5, 6, 7, across - 8 + 2):
            body.materials[made + k * across + j % across] = "car glass"
    for ends in (range(first, first + across), range(first + (len(rows) - 1) * across, first + len(rows) * across)):
        corners = tuple(ends)
        body.faces.append(corners if ends.start != first else corners[::-1])
        body.materials.append(paint)
        body.glows.append(0.0)
        body.smooth.append(True)
    _car_parts(parts, x_m, y_m)


def _car_parts(parts: Solid, x_m: float, y_m: float) -> None:
    for along in WHEELS_M:
        for side in (-1, 1):
            inner, outer = x_m + side * 0.62, x_m + side * 0.885
            y = y_m + along
            parts.tube([(inner, y, 0.32), (outer, y, 0.32)], [0.32, 0.32], "rubber", sides=20)
            parts.tube([(outer, y, 0.32), (outer + side * 0.015, y, 0.32)], [0.2, 0.16], "chrome", sides=12)
    for side in (-1, 1):
        x = x_m + side * 0.6
        parts.box((x - 0.13, y_m - 0.01, 0.66), (x + 0.13, y_m + 0.1, 0.8), "red light", TAIL_GLOW)
        parts.box((x - 0.14, y_m + 3.98, 0.5), (x + 0.14, y_m + 4.07, 0.62), "porcelain")
    parts.box((x_m - 0.26, y_m - 0.015, 0.46), (x_m + 0.26, y_m + 0.05, 0.57), "porcelain")
    parts.box((x_m - 0.75, y_m - 0.04, 0.34), (x_m + 0.75, y_m + 0.1, 0.42), "rubber")


def add_bench(solid: Solid, x_m: float, y_m: float) -> None:
    """Add a bench of slats along the street, whose back is at the side of x_m's sign."""
    side = 1.0 if x_m > 0 else -1.0
    for k in range(4):
        near = x_m - side * (0.05 + 0.11 * k)
        solid.box((min(near, near - side * 0.09), y_m, 0.59), (max(near, near - side * 0.09), y_m + 1.7, 0.62), "wood")
    for k in range(3):
        solid.box((x_m - 0.02, y_m, 0.72 + 0.12 * k), (x_m + 0.02, y_m + 1.7, 0.81 + 0.12 * k), "wood")
    for y in (y_m + 0.15, y_m + 1.5):
        for x in (x_m, x_m - side * 0.42):
            solid.box((x - 0.025, y - 0.03, 0.15), (x + 0.025, y + 0.03, 1.05 if x == x_m else 0.59), "iron")


def add_table(solid: Solid, x_m: float, y_m: float) -> None:
    """Add a round table with two cups and a candle in a glass, and two chairs."""
    ground = 0.15
    top = ground + 0.74
    solid.tube([(x_m, y_m, z) for z in (ground, ground + 0.03, ground + 0.06)], [0.24, 0.22, 0.03], "iron", sides=20)
    solid.tube([(x_m, y_m, z) for z in (ground + 0.05, top)], [0.03, 0.03], "iron", sides=10)
    solid.tube([(x_m, y_m, z) for z in (top - 0.025, top)], [0.36, 0.36], "wood", sides=32)
    for dx, dy in ((0.17, -0.08), (-0.16, 0.1)):
        x, y = x_m + dx, y_m + dy
        solid.tube([(x, y, top + z) for z in (0.0, 0.008, 0.014)], [0.05, 0.075, 0.08], "porcelain", sides=20)
        solid.tube([(x, y, top + z) for z in (0.014, 0.03, 0.085)], [0.026, 0.038, 0.046], "porcelain", sides=20)
        handle = [(x + 0.045 + 0.025 * math.sin(a), y, top + 0.055 + 0.022 * math.cos(a)) for a in (0.1, 1.0, 2.1, 3.0)]
        solid.tube(handle, [0.006] * 4, "porcelain", sides=6)
    solid.tube([(x_m, y_m, top + z) for z in (0.0, 0.06)], [0.03, 0.034], "car glass", sides=16)
    solid.tube([(x_m, y_m, top + z) for z in (0.06, 0.075, 0.1)], [0.006, 0.01, 0.002], "bulb", glow=CANDLE_GLOW)
    for side in (-1, 1):
        _chair(solid, x_m + 0.1 * side, y_m + 0.78 * side, ground, side)


def _chair(solid: Solid, x_m: float, y_m: float, ground: float, side: int) -> None:
    seat = ground + 0.45
    solid.tube([(x_m, y_m, seat - 0.02), (x_m, y_m, seat + 0.01)], [0.21, 0.21], "wood", sides=20)
    for dx, dy in ((-0.16, -0.14), (0.16, -0.14), (-0.16, 0.14), (0.16, 0.14)):
        foot = (x_m + dx * 1.15, y_m + dy * 1.15, ground)
        solid.tube([foot, (x_m + dx, y_m + dy, seat)], [0.013, 0.013], "iron", sides=6)
    back = [(x_m + 0.2 * math.cos(a), y_m + side * (0.14 + 0.07 * math.sin(a)), 0.0) for a in _half_turn(9)]
    turns = _half_turn(9)
    for k, height in enumerate((0.22, 0.42)):
        arched = zip(back, turns, strict=True)
        hoop = [(x, y + side * 0.03 * k, seat + height + 0.04 * math.sin(a)) for (x, y, _), a in arched]
        solid.tube(hoop, [0.013] * len(hoop), "iron", sides=6)
    for x, y, _ in (back[0], back[2], back[4], back[6], back[8]):
        solid.tube([(x, y, seat), (x, y + side * 0.03, seat + 0.43)], [0.009, 0.009], "iron", sides=5)


def _half_turn(count: int) -> list[float]:
    return [math.pi * k / (count - 1) for k in range(count)]


def add_board(solid: Solid, x_m: float, y_m: float) -> None:
    """Add a menu board that leans."""
    for side in (-1, 1):
        low = [(x_m - 0.3, y_m + 0.28 * side, 0.15), (x_m + 0.3, y_m + 0.28 * side, 0.15)]
        high = [(x_m + 0.3, y_m + 0.02 * side, 1.15), (x_m - 0.3, y_m + 0.02 * side, 1.15)]
        solid.face([*low, *high], "chalkboard")
        for a, b in ((low[0], high[1]), (low[1], high[0]), (low[0], low[1]), (high[0], high[1])):
            solid.tube([a, b], [0.022, 0.022], "wood", sides=4)
    for k, width_m in enumerate((0.34, 0.22, 0.28, 0.2)):
        share = 0.78 - 0.16 * k
        y, z = y_m - 0.28 + 0.26 * share - 0.004, 0.15 + share
        solid.box((x_m - width_m / 2, y - 0.004, z), (x_m + width_m / 2, y, z + 0.025), "porcelain")


def add_bollard(solid: Solid, x_m: float, y_m: float) -> None:
    """Add a bollard at the kerb."""
    solid.tube([(x_m, y_m, z) for z in (0.1, 0.9, 0.93, 1.0)], [0.06, 0.05, 0.075, 0.03], "iron", sides=12)


def add_pot(solid: Solid, x_m: float, y_m: float) -> None:
    """Add a pot with a clipped bush."""
    solid.tube([(x_m, y_m, z) for z in (0.15, 0.62)], [0.2, 0.27], "goods", sides=16)
    solid.ball((x_m, y_m, 0.95), 0.36, "leaves", sides=14)


# --- bare trees: branches that fork, as curves with a thickness ---


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
