# SPDX-License-Identifier: GPL-3.0-or-later
"""Splitting an outline into triangles by cutting off its ears, in the order in which Blender cuts them.

An ear is a corner whose triangle with its two neighbours holds no other corner. Blender (BLI_polyfill_2d) goes around
an outline, cuts off every other ear so that convex outlines do not become fans, and turns back at corners that bend
inwards.
"""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

_OUT, _STRAIGHT, _IN = 1, 0, -1  # how a corner bends


def clip_ears(points: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return the triangles (n - 2, 3) int32 of an outline (n, 2) float32 that runs clockwise."""
    return _Outline(points).triangles()


Point: TypeAlias = tuple[Any, Any]
"""x and y."""


class _Outline:
    """What is left of an outline: a ring of corners, each with its neighbours and the way it bends."""

    def __init__(self, points: NDArray[np.float32]) -> None:
        count = len(points)
        self._points: list[Point] = [(x, y) for x, y in points]  # numpy's float32: double decides otherwise where
        self._places = points.T.tolist()  # corners lie on a line
        self._left = count
        self._after = [*range(1, count), 0]
        self._before = [count - 1, *range(count - 1)]
        self._first = 0
        self._bends = [self._bend(corner) for corner in range(count)]
        self._inner = {corner for corner, bend in enumerate(self._bends) if bend != _OUT}

    def triangles(self) -> NDArray[np.int32]:
        """Cut off all ears."""
        cut: list[tuple[int, int, int]] = []
        start, backward = 0, False
        while self._left > 3:
            ear = self._next_ear(start, backward=backward)
            before, after = self._before[ear], self._after[ear]
            cut.append((before, ear, after))
            self._remove(ear)
            for corner in (before, after):
                if self._bends[corner] != _OUT:
                    self._bends[corner] = self._bend(corner)
                    if self._bends[corner] == _OUT:
                        self._inner.discard(corner)
            start = self._before[before] if backward else self._after[after]
            if self._bends[start] != _OUT:  # not a good place for an ear
                start = self._before[start] if backward else self._after[start]
                backward = not backward
        second = self._after[self._first]
        cut.append((self._first, second, self._after[second]))
        return np.array(cut, dtype=np.int32)

    def _next_ear(self, start: int, *, backward: bool) -> int:
        """Return the first ear from a corner on; where there is none, a corner that does not bend inwards."""
        step = self._before if backward else self._after
        for wanted in (_OUT, _STRAIGHT):  # an ear without area only where there is no other
            corner = start
            for _ in range(self._left):
                if not self._inner or (self._bends[corner] == wanted and not self._holds_another(corner)):
                    return corner
                corner = step[corner]
        corner = start
        for _ in range(self._left):
            if self._bends[corner] != _IN:
                return corner
            corner = self._after[corner]
        return corner

    def _holds_another(self, ear: int) -> bool:
        """Tell whether the triangle of an ear holds another corner; only those that do not bend outwards can be."""
        own = (ear, self._after[ear], self._before[ear])
        (x, y), first, second, third = self._places, *(self._points[corner] for corner in own)
        left, right = min(x[corner] for corner in own), max(x[corner] for corner in own)
        low, high = min(y[corner] for corner in own), max(y[corner] for corner in own)
        return any(
            turn(first, second, point) >= 0 and turn(second, third, point) >= 0 and turn(third, first, point) >= 0
            for point in (
                self._points[corner]
                for corner in self._inner
                if left <= x[corner] <= right and low <= y[corner] <= high and corner not in own
            )
        )

    def _remove(self, corner: int) -> None:
        before, after = self._before[corner], self._after[corner]
        self._after[before], self._before[after] = after, before
        self._first = after if self._first == corner else self._first
        self._inner.discard(corner)
        self._left -= 1

    def _bend(self, corner: int) -> int:
        before, after = self._points[self._before[corner]], self._points[self._after[corner]]
        return int(np.sign(turn(before, self._points[corner], after)))


def turn(before: Point, at: Point, after: Point) -> Any:
    """Return twice the area of a triangle, positive where a clockwise outline bends outwards at its second corner.

    Numbers, or arrays for many triangles at once, in the precision that they have.
    """
    (x, y), (a, b), (c, d) = after, at, before
    return (a - x) * (d - y) - (c - x) * (b - y)
