# SPDX-License-Identifier: GPL-3.0-or-later
"""Rooms of any plan with right angles: walls one by one, floor and ceiling, and what stands before a wall.

A plan is the corners of a room as seen from above, clockwise. Each wall has a frame of its own: x runs along it to
the right as seen from inside, the wall is at y = 0, the room lies at lower y. Pieces built with their back at y = 0
are put before a wall by `before`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from . import surfaces as pt
from .light import Window
from .openings import CURTAIN_CODES, REVEAL_M, TRIM, Hole, Outlook, curtains, door, outdoors, window
from .surfaces import Array, Painter, Piece, Point, box, joined, placed, rect, shadeless, thing

WALL_CELL_M = 0.018  # distance of the walls' vertices, which carry the texture; chosen: detail against size
DOOR_M = (0.9, 2.06)  # width and height
_FRAME_M = 0.09  # around a door


@dataclass(frozen=True)
class Wall:
    """One wall: where it starts, its direction (x, y), one of which is 0 and the other 1 or -1, and its length."""

    start_m: tuple[float, float]
    direction: tuple[int, int]
    length_m: float
    height_m: float

    @property
    def yaw_deg(self) -> float:
        """The turn of the wall's own frame."""
        return {(1, 0): 0.0, (0, 1): 90.0, (-1, 0): 180.0, (0, -1): -90.0}[self.direction]

    def at(self, along_m: float, out_m: float = 0.0, z_m: float = 0.0) -> Point:
        """The world's coordinates of a point: along the wall, out into the room, up."""
        dx, dy = self.direction
        return self.start_m[0] + dx * along_m + dy * out_m, self.start_m[1] + dy * along_m - dx * out_m, z_m

    def before(self, piece: Piece, along_m: float, z_m: float = 0.0, out_m: float = 0.0) -> Piece:
        """A piece whose back is at y = 0, put before the wall."""
        return placed(piece, self.at(along_m, out_m, z_m), self.yaw_deg)

    def window(self, hole: Hole) -> Window:
        """The wall's hole as a source of light."""
        axis = 0 if self.direction[0] == 0 else 1
        side = self.direction[0] or -self.direction[1]
        ends = sorted(self.at(along)[1 - axis] for along in hole[:2])
        return Window(axis, side, self.start_m[axis], (ends[0], ends[1], hole[2], hole[3]))


def walls(corners_m: tuple[tuple[float, float], ...], height_m: float) -> list[Wall]:
    """The walls between corners that go clockwise, the first one from corner 0 to corner 1."""
    found = []
    for (x, y), (to_x, to_y) in pairwise([*corners_m, corners_m[0]]):
        length = abs(to_x - x) + abs(to_y - y)
        found.append(Wall((x, y), (round((to_x - x) / length), round((to_y - y) / length)), length, height_m))
    return found


@dataclass(frozen=True)
class Coat:
    """What a wall is covered with; columns_m and rows_m give the vertices' lines for a length, where they matter."""

    paint: Painter
    cell_m: float = WALL_CELL_M
    columns_m: Callable[[float], Array] | None = None
    rows_m: Callable[[float], Array] | None = None


def laid_bricks(paint: Painter) -> Coat:
    """A coat of bricks, whose edges the vertices follow."""
    return Coat(paint, WALL_CELL_M, lambda m: pt.brick_grid(m, 1.0)[0], lambda m: pt.brick_grid(1.0, m)[1])


def between(lines_m: Array, low: float, high: float) -> Array:
    """The lines from low to high, both ends included, measured from low."""
    inner = lines_m[(lines_m > low + 0.002) & (lines_m < high - 0.002)]
    return np.concatenate([[0.0], inner - low, [high - low]])


@thing("wall")
def surface(wall: Wall, coat: Coat, z_m: tuple[float, float], holes: tuple[Hole, ...] = ()) -> Piece:
    """A wall's surface from the lower to the upper height, without its holes."""
    low, high = z_m
    columns = None if coat.columns_m is None else coat.columns_m(wall.length_m)
    rows = None if coat.rows_m is None else coat.rows_m(wall.height_m)
    dx, dy = wall.direction
    parts: list[Piece] = []

    def part(a: float, b: float, c: float, d: float) -> None:
        if b - a < 1e-6 or d - c < 1e-6:
            return
        u_m = None if columns is None else between(columns, a, b)
        v_m = None if rows is None else between(rows, c, d)
        u_edge, v_edge = (dx * (b - a), dy * (b - a), 0.0), (0.0, 0.0, d - c)
        corner = wall.at(a, 0.0, c)
        parts.append(rect(corner, u_edge, v_edge, coat.cell_m, coat.paint, u_m=u_m, v_m=v_m, start_m=(a, c)))

    at = 0.0
    for a, b, c, d in sorted(holes):
        part(at, a, low, high)
        part(a, b, low, min(max(c, low), high))
        part(a, b, max(min(d, high), low), high)
        at = b
    part(at, wall.length_m, low, high)
    return joined(parts)


def enclosed(walls_: list[Wall], coats: list[Coat], holes: dict[int, tuple[Hole, ...]]) -> Piece:
    """All walls from floor to ceiling, each with its coat; holes by the wall's number."""
    return joined(
        surface(wall, coat, (0.0, wall.height_m), holes.get(k, ()))
        for k, (wall, coat) in enumerate(zip(walls_, coats, strict=True))
    )


_BEHIND_M = 0.002  # of the lining behind walls, floor and ceiling
_LINING = Coat(pt.plain("#8a8478", 1000), 0.4)


@thing("wall")
def lining(corners_m: tuple[tuple[float, float], ...], walls_: list[Wall], holes: dict[int, tuple[Hole, ...]]) -> Piece:
    """A coarse second shell just behind the first one, with the same holes.

    Where two surfaces meet, rounding to float32 leaves a gap of a tenth of a micrometre, through which one ray in some
    ten million sees the void; behind it is the lining.
    """
    over = 5 * _BEHIND_M
    parts = []
    for k, wall in enumerate(walls_):
        before, after = walls_[k - 1].direction, walls_[(k + 1) % len(walls_)].direction
        # Past a corner that points outwards; short of one that points into the room, where it would be seen.
        first = over if _turns_right(before, wall.direction) else -_BEHIND_M / 2
        last = over if _turns_right(wall.direction, after) else -_BEHIND_M / 2
        start = wall.at(-first, -_BEHIND_M)
        shifted = Wall((start[0], start[1]), wall.direction, wall.length_m + first + last, wall.height_m)
        moved = tuple((a + first, b + first, low, high) for a, b, low, high in holes.get(k, ()))
        parts.append(surface(shifted, _LINING, (-over, wall.height_m + over), moved))
    height_m = walls_[0].height_m
    for level, z in ((ground(corners_m, _LINING), -_BEHIND_M), (ceiling(corners_m, height_m, _LINING), _BEHIND_M)):
        parts.append(placed(level, (0.0, 0.0, z)))
    return joined(parts)


def _turns_right(first: tuple[int, int], second: tuple[int, int]) -> bool:
    return first[0] * second[1] - first[1] * second[0] < 0


@thing("wall")
def strip(wall: Wall, z_m: tuple[float, float], out_m: float, paint: Painter, gaps: tuple[Hole, ...] = ()) -> Piece:
    """A bar along the wall, left out where holes are: skirting board, dado rail, cornice."""
    low, high = z_m
    parts: list[Piece] = []
    at = 0.0
    for a, b, c, d in (*sorted(gaps), (wall.length_m, wall.length_m, 0.0, 9.0)):
        if not (c < high and d > low):
            continue
        if a - at > 0.02:
            bar = box((at, -out_m, low), (a, 0.0, high), 0.03, paint, skip="Y")
            parts.append(placed(bar, wall.at(0.0), wall.yaw_deg))
        at = b
    return shadeless(joined(parts))


def skirting(wall: Wall, code: str, doors: tuple[Hole, ...] = (), height_m: float = 0.1) -> Piece:
    """A painted skirting board, left out at the doors and their frames."""
    gaps = tuple((a - _FRAME_M, b + _FRAME_M, low, high) for a, b, low, high in doors)
    return strip(wall, (0.0, height_m), 0.016, pt.plain(code, 320, grain=0.08, grain_m=0.03, patch=0.05), gaps)


def slabs(corners_m: tuple[tuple[float, float], ...]) -> list[tuple[float, float, float, float]]:
    """A plan cut into rectangles (x low, y low, x high, y high) at each of its corners' x."""
    found = []
    for a, b in pairwise(sorted({x for x, _ in corners_m})):
        middle = (a + b) / 2
        crossed = sorted(
            y for (x, y), (to_x, _) in pairwise([*corners_m, corners_m[0]]) if min(x, to_x) < middle < max(x, to_x)
        )
        found += [(a, low, b, high) for low, high in zip(crossed[::2], crossed[1::2], strict=True)]
    return found


@thing("floor")
def ground(corners_m: tuple[tuple[float, float], ...], coat: Coat, *, turned: bool = False) -> Piece:
    """The floor of a plan at z = 0; u runs along x, or along y where it is turned."""
    return _level(corners_m, 0.0, coat, turned=turned)


@thing("ceiling")
def ceiling(corners_m: tuple[tuple[float, float], ...], height_m: float, coat: Coat, *, turned: bool = False) -> Piece:
    """The ceiling of a plan."""
    return _level(corners_m, height_m, coat, turned=turned)


def _level(corners_m: tuple[tuple[float, float], ...], z_m: float, coat: Coat, *, turned: bool) -> Piece:
    west, south = (min(c[k] for c in corners_m) for k in (0, 1))
    east, north = (max(c[k] for c in corners_m) for k in (0, 1))
    parts = []
    for x0, y0, x1, y1 in slabs(corners_m):
        # Each line of vertices is one of the whole plan, so that boards and tiles go on from one slab to the next.
        spans = ((x0 - west, x1 - west, east - west), (y0 - south, y1 - south, north - south))
        edges: tuple[Point, Point] = ((x1 - x0, 0.0, 0.0), (0.0, y1 - y0, 0.0))
        lines = [coat.columns_m, coat.rows_m]
        paint = coat.paint
        # The normal is u x v: up for the floor, down for the ceiling.
        if turned == (z_m == 0.0):
            paint = _swapped(paint)
        if z_m > 0.0:
            spans, edges = spans[::-1], (edges[1], edges[0])
        if turned != (z_m > 0.0):
            lines.reverse()
        u_m, v_m = (
            None if steps is None else between(steps(whole), low, high)
            for steps, (low, high, whole) in zip(lines, spans, strict=True)
        )
        start = (spans[0][0], spans[1][0])
        parts.append(rect((x0, y0, z_m), *edges, coat.cell_m, paint, u_m=u_m, v_m=v_m, start_m=start))
    return joined(parts)


def _swapped(paint: Painter) -> Painter:
    def painted(u: Array, v: Array) -> Array:
        return paint(v, u)

    return painted


def glazed(
    wall: Wall, hole: Hole, view: Outlook, seed: int, *, hung: list[str] | None = CURTAIN_CODES, eye_out_m: float = 2.0
) -> Piece:
    """A window with what is seen through it and, if curtains are wanted, their six colours."""
    a, b, low, high = hole
    behind = outdoors((a - 0.7, REVEAL_M, low - 1.5), (b + 0.7, 1.3, high + 0.9), ((a + b) / 2, -eye_out_m, 1.55), view)
    parts = [window(hole, 0.0, seed), behind]
    if hung is not None:
        parts.append(curtains(a, b, 0.0, seed + 10, hung))
    return placed(joined(parts), wall.at(0.0), wall.yaw_deg)


def door_hole(middle_m: float) -> Hole:
    """The hole of a door with its middle there along a wall."""
    return middle_m - DOOR_M[0] / 2, middle_m + DOOR_M[0] / 2, 0.0, DOOR_M[1]


def closed_door(wall: Wall, hole: Hole, code: str) -> Piece:
    """A door in its hole."""
    half = (hole[1] - hole[0]) / 2
    leaf = door((-half, half, 0.0, hole[3]), 0.0, code)
    return placed(placed(leaf, (0.0, 0.0, 0.0), 180.0), wall.at((hole[0] + hole[1]) / 2), wall.yaw_deg)


@thing("door")
def passage(wall: Wall, hole: Hole, thick_m: float, floor: Painter) -> Piece:
    """The inside of a hole through a wall of that thickness: jambs, lintel, threshold, and a frame on both sides."""
    a, b, _, top = hole
    w, t = b - a, thick_m
    parts = [
        rect((a, 0.0, 0.0), (0, t, 0), (0, 0, top), 0.02, TRIM),
        rect((b, t, 0.0), (0, -t, 0), (0, 0, top), 0.02, TRIM),
        rect((a, t, top), (w, 0, 0), (0, -t, 0), 0.02, TRIM),
        rect((a, 0.0, 0.0), (w, 0, 0), (0, t, 0), 0.02, floor),
    ]
    for y0, y1 in ((-0.02, 0.0), (t, t + 0.02)):
        for low, high in (
            ((a - _FRAME_M, y0, 0.0), (a, y1, top + _FRAME_M)),
            ((b, y0, 0.0), (b + _FRAME_M, y1, top + _FRAME_M)),
            ((a, y0, top), (b, y1, top + _FRAME_M)),
        ):
            parts.append(box(low, high, 0.024, TRIM))
    under = -_BEHIND_M
    parts.append(rect((a - 0.05, -0.05, under), (w + 0.1, 0, 0), (0, t + 0.1, 0), 0.4, _LINING.paint))
    return placed(shadeless(joined(parts)), wall.at(0.0), wall.yaw_deg)


def solid(low_m: Point, high_m: Point) -> Piece:
    """What keeps light out where no room is."""
    return Piece((), ((low_m, high_m),))
