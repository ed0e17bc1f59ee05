# SPDX-License-Identifier: GPL-3.0-or-later
"""Houses: a front with recessed windows, a shop or doors at the ground, a cornice and a roof."""

import random
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

from .solids import Point, Solid

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
