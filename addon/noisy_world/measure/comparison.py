# SPDX-License-Identifier: GPL-3.0-or-later
"""Two recordings' figures side by side: how far apart each is, within what, the largest difference first.

Intervals of differences and of ratios are put together from those of both sides, each by its own half towards the
other: MOVER, by Zou and Donner, Statistics in Medicine 27 (2008). They hold where both recordings are independent.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from .figure import WITHIN, Figure

SAME, SAME_BY = 1e-6, 1e-9  # of numbers that were counted: relative, and in their unit; stamps have nanoseconds
ALIKE = 0.02  # relative distance of points of two curves that have no common stretch, but count as one place


@dataclass(frozen=True)
class Difference:
    """What two recordings say of one thing. a, b: the same figure of both, both told; on a curve at the same place."""

    a: Figure
    b: Figure

    @property
    def value(self) -> float:
        """B minus A, in the figure's unit."""
        return _number(self.b.value) - _number(self.a.value)

    @cached_property
    def interval(self) -> tuple[float, float] | None:
        """Its 95 % interval; None where either has none."""
        ends = (self.a.low, self.a.high, self.b.low, self.b.high)
        if any(end is None or not math.isfinite(end) for end in ends):
            return None
        a_low, a_high, b_low, b_high = map(_number, ends)
        return _mover((_number(self.a.value), a_low, a_high), (_number(self.b.value), b_low, b_high))

    @property
    def standard_errors(self) -> float | None:
        """B minus A in combined standard errors; None where both were counted, or an interval is missing."""
        if self.interval is None or self.interval[0] == self.interval[1]:
            return None
        low, high = self.interval
        toward = self.value - low if self.value > 0 else high - self.value
        return self.value * WITHIN / toward if toward > 0 else None

    @property
    def differs(self) -> bool:
        """Whether 0 is outside the interval; of what has no width, whether it is another number."""
        if self.standard_errors is None:
            return not math.isclose(_number(self.a.value), _number(self.b.value), rel_tol=SAME, abs_tol=SAME_BY)
        return self.interval is not None and (self.interval[0] > 0 or self.interval[1] < 0)

    @property
    def relative(self) -> float:
        """The distance over the larger of both, 0 to 2; 0 where they do not differ."""
        most = max(abs(_number(self.a.value)), abs(_number(self.b.value)))
        return abs(self.value) / most if self.differs else 0.0

    @cached_property
    def ratio(self) -> tuple[float, float | None, float | None] | None:
        """B over A with its 95 % interval; None unless both and their intervals are above 0."""
        numbers = (self.a.value, self.b.value, self.a.low, self.a.high, self.b.low, self.b.high)
        if any(number is not None and not 0 < number < math.inf for number in numbers):
            return None
        a, b, *ends = numbers
        if any(end is None for end in ends):
            return _number(b) / _number(a), None, None
        a, b, a_low, a_high, b_low, b_high = (math.log(_number(number)) for number in numbers)
        low, high = _mover((a, a_low, a_high), (b, b_low, b_high))
        return math.exp(b - a), math.exp(low), math.exp(high)

    def content(self) -> dict[str, Any]:
        """Return it as plain JSON values."""
        low, high = self.interval or (None, None)
        ratio, ratio_low, ratio_high = self.ratio or (None, None, None)
        return {
            "a": self.a.content(),
            "b": self.b.content(),
            "difference": {"value": self.value, "low": low, "high": high},
            "standard_errors": self.standard_errors,
            "ratio": {"value": ratio, "low": ratio_low, "high": ratio_high},
            "differs": self.differs,
        }


@dataclass(frozen=True)
class ComparedFigure:
    """What both tell of a figure, or of a curve at the places of `parts`, where both have points."""

    name: str
    parts: tuple[Difference, ...]
    curve: bool = False

    @property
    def standard_errors(self) -> float | None:
        """The distance in combined standard errors, on a curve the root of the mean square over its places."""
        known = [part.standard_errors for part in self.parts if part.standard_errors is not None]
        if not self.curve:
            return known[0] if known else None
        return math.sqrt(sum(value**2 for value in known) / len(known)) if known else None

    @property
    def differing(self) -> int:
        """At how many places both surely differ."""
        return sum(part.differs for part in self.parts)

    @property
    def ratio(self) -> tuple[float, float | None, float | None] | None:
        """B over A, the geometric mean over the places; the interval as if all had one error."""
        ratios = [part.ratio for part in self.parts if part.ratio is not None]
        if len(ratios) < len(self.parts):
            return None
        value, low, high = (_geometric_mean([ratio[place] for ratio in ratios]) for place in range(3))
        return (_number(value), low, high)

    @property
    def order(self) -> tuple[int, float, str]:
        """Where it comes: estimates first, by standard errors; then what has none, by relative distance."""
        if self.standard_errors is None:
            return 1, -max(part.relative for part in self.parts), self.name
        return 0, -abs(self.standard_errors), self.name

    def content(self) -> dict[str, Any]:
        """Return it as plain JSON values."""
        if not self.curve:
            return {"name": self.name, **self.parts[0].content()}
        ratio, low, high = self.ratio or (None, None, None)
        return {
            "name": self.name,
            "standard_errors": self.standard_errors,
            "ratio": {"value": ratio, "low": low, "high": high},
            "places": [{"at": part.a.at, **part.content()} for part in self.parts],
        }


@dataclass(frozen=True)
class OneSided:
    """What only one can tell. whose: "a" or "b". figure: its. why: what keeps the other from it."""

    whose: str
    figure: Figure
    why: str


@dataclass(frozen=True)
class Comparison:
    """Two recordings compared. rows: the largest difference first. one_sided: what only one tells.

    untold: names of what neither tells, with the reasons of A and of B.
    """

    rows: tuple[ComparedFigure, ...]
    one_sided: tuple[OneSided, ...]
    untold: tuple[tuple[str, str, str], ...]

    def content(self) -> dict[str, Any]:
        """Return it as plain JSON values."""
        return {
            "differences": [row.content() for row in self.rows],
            "only_one_tells": [
                {"whose": item.whose, **item.figure.content(), "other_cannot_because": item.why}
                for item in self.one_sided
            ],
            "neither_tells": [
                {"name": name, "a_cannot_because": why_a, "b_cannot_because": why_b}
                for name, why_a, why_b in self.untold
            ],
        }


def compared(a: Mapping[str, Figure], b: Mapping[str, Figure]) -> Comparison:
    """Compare the figures of two recordings, by name; points of curves where both have some, by interpolation."""
    rows: list[ComparedFigure] = []
    one_sided: list[OneSided] = []
    untold: list[tuple[str, str, str]] = []
    for name in dict.fromkeys([*a, *b]):
        here, there = a.get(name, Figure.none(name, "not measured")), b.get(name, Figure.none(name, "not measured"))
        if here.curve or there.curve:
            continue
        if here.value is not None and there.value is not None:
            rows.append(ComparedFigure(name, (Difference(here, there),)))
        elif here.value is None and there.value is None:
            untold.append((name, here.untold, there.untold))
        else:
            one_sided.append(
                OneSided("b", there, here.untold) if here.value is None else OneSided("a", here, there.untold)
            )
    for curve in dict.fromkeys(figure.curve for figure in (*a.values(), *b.values()) if figure.curve):
        points, others = points_of(a, curve), points_of(b, curve)
        pairs = list(_places(points, others))
        if pairs:
            parts = tuple(Difference(_at(points, one, place), _at(others, two, place)) for one, two, place in pairs)
            rows.append(ComparedFigure(curve, parts, curve=True))
        one_sided += _unmet("a", points, [one for one, _, _ in pairs], b)
        one_sided += _unmet("b", others, [two for _, two, _ in pairs], a)
    return Comparison(tuple(sorted(rows, key=lambda row: row.order)), tuple(one_sided), tuple(untold))


def _unmet(
    whose: str, points: Sequence[Figure], met: Sequence[Figure], others: Mapping[str, Figure]
) -> Iterator[OneSided]:
    for figure in points:
        if figure not in met:
            other = others.get(figure.name)
            yield OneSided(whose, figure, other.untold if other and other.untold else "it has no figure near there")


def points_of(figures: Mapping[str, Figure], curve: str) -> list[Figure]:
    """Return the points of a curve that are told, in the order of their places."""
    found = [figure for figure in figures.values() if figure.curve == curve and figure.value is not None]
    return sorted(found, key=_place)


def _places(points: Sequence[Figure], others: Sequence[Figure]) -> Iterator[tuple[Figure, Figure, float]]:
    """Yield points of two curves that are each other's nearest, and a place between them where both curves are."""
    if not points or not others:
        return
    first = max(_place(points[0]), _place(others[0]))
    last = min(_place(points[-1]), _place(others[-1]))
    for one in points:
        two = min(others, key=lambda point: abs(_place(point) - _place(one)))
        if min(points, key=lambda point: abs(_place(point) - _place(two))) is not one:
            continue
        middle = (_place(one) + _place(two)) / 2
        if first <= last:
            yield one, two, min(max(middle, first), last)
        elif abs(_place(one) - _place(two)) <= ALIKE * abs(middle):
            yield one, two, middle


def _at(points: Sequence[Figure], nearest: Figure, place: float) -> Figure:
    """Return a curve's figure at a place, between the points beside it; beyond its ends that of the nearest point."""
    moved = replace(nearest, at=place)
    before = [point for point in points if _place(point) <= place]
    after = [point for point in points if _place(point) >= place]
    if not before or not after or before[-1] is after[0]:
        return moved
    left, right = before[-1], after[0]
    x = (_place(left), place, _place(right))
    values = (_number(left.value), _number(right.value))
    powers = min(x) > 0 and min(values) > 0  # laws of noise are near powers
    x = tuple(map(math.log, x)) if powers else x
    part = (x[1] - x[0]) / (x[2] - x[0])

    def between(one: float, two: float) -> float:
        return one + (two - one) * part

    value = math.exp(between(*map(math.log, values))) if powers else between(*values)
    samples = min(left.samples, right.samples)
    if left.low is None or left.high is None or right.low is None or right.high is None:
        return replace(moved, value=value, low=None, high=None, samples=samples)
    down, up = (
        between(values[0] - left.low, values[1] - right.low),
        between(left.high - values[0], right.high - values[1]),
    )
    return replace(moved, value=value, low=value - down, high=value + up, samples=samples)


def _mover(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float]:
    """Return the interval of b - a, each a value with the ends of its own."""
    value = b[0] - a[0]
    return value - math.hypot(b[0] - b[1], a[2] - a[0]), value + math.hypot(b[2] - b[0], a[0] - a[1])


def _geometric_mean(values: Sequence[float | None]) -> float | None:
    known = [math.log(value) for value in values if value is not None]
    return math.exp(sum(known) / len(known)) if known and len(known) == len(values) else None


def _place(point: Figure) -> float:
    return _number(point.at)


def _number(value: float | None) -> float:
    assert value is not None, "a figure that is told"
    return value
