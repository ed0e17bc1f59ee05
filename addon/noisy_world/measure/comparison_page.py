# SPDX-License-Identifier: GPL-3.0-or-later
"""A comparison as one page of HTML, without script, that fetches nothing: a table, and both sides' curves drawn."""

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape

from .comparison import Comparison, Difference, Row, points_of
from .figure import Figure

COLOURS = {"a": "#0072b2", "b": "#d55e00"}  # told apart by the colour-blind: Okabe and Ito
WIDE, HIGH = 640, 320  # of a drawing, and its margins, in pixels
LEFT, RIGHT, TOP, BOTTOM = 78, 16, 14, 46
MOST = 1.6  # times the largest value: intervals that are wider are cut there
BELOW = 0.3  # of the largest value: so far below 0 intervals are drawn
CURVES = {  # title, what is to the right, what is upwards
    "colour_noise": ("Photon transfer: noise of colour by intensity", "intensity, of 255", "deviation, of 255"),
    "depth_noise_m": ("Noise of depth by distance", "distance, m", "deviation, m"),
    "depth_correlation": ("Correlation of depth's noise between neighbours", "apart by, px", "correlation"),
}
STYLE = """
body { font: 16px/1.45 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; color: #1d2b36; }
table { border-collapse: collapse; font-size: .9rem; } .scroll { overflow-x: auto; }
th, td { text-align: left; padding: .2rem .7rem; border-bottom: 1px solid #dde3e8; white-space: nowrap; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; } tr.place td:first-child { padding-left: 2rem; }
tr.same { color: #71808c; } svg { max-width: 100%; height: auto; } .a { color: #0072b2; } .b { color: #d55e00; }
"""


def page(names: tuple[str, str], a: Mapping[str, Figure], b: Mapping[str, Figure], found: Comparison) -> str:
    """Return the page. names: what A and B are called. a, b: the figures that were compared."""
    curves = dict.fromkeys([*CURVES, *(figure.curve for figure in (*a.values(), *b.values()) if figure.curve)])
    parts = [
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{_safe(names[0])} and {_safe(names[1])} compared</title>\n<style>{STYLE}</style>\n</head>\n<body>",
        "<h1>Two recordings' noise</h1>",
        f'<p><b class="a">A</b> {_safe(names[0])}<br><b class="b">B</b> {_safe(names[1])}</p>',
        "<p>Figures that both tell, the largest difference first, in combined standard errors; in brackets intervals "
        "of 95 %, outside of which one in twenty lies by chance.</p>",
        *_table(found.rows),
        *(part for curve in curves for part in _curve(curve, points_of(a, curve), points_of(b, curve))),
        *_others(found),
        "</body>\n</html>\n",
    ]
    return "\n".join(parts)


def number(value: float | None) -> str:
    """Return a number for people; a dash for none."""
    return "-" if value is None else f"{value:.4g}"


def within(value: tuple[float, float | None, float | None] | None) -> str:
    """Return a value with its interval, as far as it has one; a dash for none."""
    if value is None:
        return "-"
    known = value[1] is not None and value[2] is not None and value[1] != value[2]
    return number(value[0]) + (f" ({number(value[1])} to {number(value[2])})" if known else "")


def difference(part: Difference) -> tuple[float, float | None, float | None]:
    """Return B minus A with its interval, as far as it has one."""
    low, high = part.interval or (None, None)
    return part.value, low, high


def _safe(text: str) -> str:
    """Return text for HTML. Names of files may hold what neither XML nor UTF-8 has."""
    return escape("".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text))


# --- tables ---


def _table(rows: Sequence[Row]) -> Iterator[str]:
    if not rows:
        yield "<p>There is no figure that both tell.</p>"
        return
    yield '<div class="scroll"><table>\n<thead><tr><th>figure</th>'
    for heading in ("A", "B", "standard errors", "B - A", "B / A"):
        yield f'<th class="n">{heading}</th>'
    yield "</tr></thead>\n<tbody>"
    for row in rows:
        if row.curve:
            told = f"{row.name}, {row.differing} of {len(row.parts)} places differ"
            yield _row(told, "", "", number(row.standard_errors), "", within(row.ratio), same=not row.differing)
        for part in row.parts:
            kind = "place" if row.curve else ""
            told = f"at {number(part.a.at)}" if row.curve else row.name
            values = (within((_value(side), side.low, side.high)) for side in (part.a, part.b))
            apart = "counted" if part.standard_errors is None else number(part.standard_errors)
            cells = (told, *values, apart, within(difference(part)), within(part.ratio))
            yield _row(*cells, kind=kind, same=not part.differs)
    yield "</tbody></table></div>"


def _row(*cells: str, kind: str = "", same: bool = False) -> str:
    first, *others = cells
    names = " ".join(name for name in (kind, "same" if same else "") if name)
    return f'<tr class="{names}"><td>{_safe(first)}</td>' + "".join(f'<td class="n">{_safe(x)}</td>' for x in others)


def _others(found: Comparison) -> Iterator[str]:
    if found.one_sided:
        yield "<h2>What only one tells</h2>\n<ul>"
        for item in found.one_sided:
            other = "b" if item.whose == "a" else "a"
            told = within((_value(item.figure), item.figure.low, item.figure.high))
            told = f"{item.figure.name} is {told}; {other.upper()} cannot tell it, because {item.why}"
            yield f'<li><b class="{item.whose}">{item.whose.upper()}</b> {_safe(told)}</li>'
        yield "</ul>"
    if found.untold:
        yield "<h2>What neither tells</h2>\n<ul>"
        for name, why_a, why_b in found.untold:
            yield f"<li>{_safe(f'{name}: {why_a}' + (f'; {why_b}' if why_b != why_a else ''))}</li>"
        yield "</ul>"


# --- drawings ---


def _curve(curve: str, a: Sequence[Figure], b: Sequence[Figure]) -> Iterator[str]:
    title, right, up = CURVES.get(curve, (curve.replace("_", " "), "at", "value"))
    yield f"<h2>{_safe(title)}</h2>"
    if not a and not b:
        yield "<p>Neither recording tells it.</p>"
        return
    for whose, points in (("A", a), ("B", b)):
        if not points:
            yield f"<p>{whose} does not tell it.</p>"
    values = [_value(point) for point in (*a, *b)]
    ends = [end for point in (*a, *b) for end in (point.low, point.high) if end is not None]
    places = [float(point.at or 0) for point in (*a, *b)]
    most, least = MOST * max(*values, 0.0), min(-BELOW * max(*values, 0.0), MOST * min(values))
    top, bottom = min(max([*values, *ends]), most) or 1.0, max(min([0.0, *values, *ends]), least)
    spare = 0.05 * (top - bottom)
    drawing = _Axes(
        (min(0.0, *places), 1.04 * max(places) or 1.0), (bottom - (spare if bottom < 0 else 0), top + spare)
    )
    yield f'<svg viewBox="0 0 {WIDE} {HIGH}" width="{WIDE}" height="{HIGH}" role="img" aria-label="{_safe(title)}">'
    yield from drawing.frame(right, up)
    for whose, points in (("a", a), ("b", b)):
        yield from drawing.curve(whose, points)
    yield "</svg>"


class _Axes:
    """Where numbers are on a drawing. across, upwards: their ranges."""

    def __init__(self, across: tuple[float, float], upwards: tuple[float, float]) -> None:
        self.across, self.upwards = across, upwards

    def x(self, value: float) -> float:
        low, high = self.across
        return LEFT + (WIDE - LEFT - RIGHT) * (value - low) / (high - low)

    def y(self, value: float) -> float:
        low, high = self.upwards
        return HIGH - BOTTOM - (HIGH - TOP - BOTTOM) * (min(max(value, low), high) - low) / (high - low)

    def frame(self, right: str, up: str) -> Iterator[str]:
        foot, side = HIGH - BOTTOM, WIDE - RIGHT
        yield '<g stroke="#dde3e8" font-size="12" fill="#1d2b36">'
        for tick in _ticks(*self.across):
            at = self.x(tick)
            yield f'<path d="M{at:.1f} {TOP}V{foot}"/>{_text(at, foot + 17, number(tick), "middle")}'
        for tick in _ticks(*self.upwards):
            at = self.y(tick)
            yield f'<path d="M{LEFT} {at:.1f}H{side}"/>{_text(LEFT - 7, at + 4, number(tick), "end")}'
        yield f"{_text((LEFT + side) / 2, HIGH - 8, right, 'middle')}"
        middle = (TOP + foot) / 2
        yield f'<g transform="rotate(-90 16 {middle:.0f})">{_text(16, middle, up, "middle")}</g></g>'

    def curve(self, whose: str, points: Sequence[Figure]) -> Iterator[str]:
        at = [(self.x(float(point.at or 0)), self.y(_value(point))) for point in points]
        yield f'<g stroke="{COLOURS[whose]}" fill="{COLOURS[whose]}" stroke-width="1.6">'
        if len(at) > 1:
            line = "L".join(f"{x:.1f} {y:.1f}" for x, y in at)
            yield f'<path fill="none" d="M{line}"/>'
        for (x, y), point in zip(at, points, strict=True):
            if point.low is not None and point.high is not None:
                low, high = self.y(point.low), self.y(point.high)
                yield f'<path d="M{x:.1f} {low:.1f}V{high:.1f}M{x - 4:.1f} {low:.1f}h8M{x - 4:.1f} {high:.1f}h8"/>'
            told = within((_value(point), point.low, point.high))
            title = f"<title>{whose.upper()} {_safe(point.name)}: {told}</title>"
            if whose == "a":
                yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5">{title}</circle>'
            else:
                yield f'<path d="M{x - 3.5:.1f} {y - 3.5:.1f}h7v7h-7z">{title}</path>'
        yield "</g>"


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text stroke="none" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{_safe(text)}</text>'


def _ticks(low: float, high: float) -> list[float]:
    """Return some four to nine round numbers from low to high."""
    rough = (high - low) / 6
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(times * power for times in (1, 2, 5, 10) if times * power >= rough)
    first = math.ceil(low / step - 1e-9)
    return [step * place for place in range(first, math.floor(high / step + 1e-9) + 1)]


def _value(figure: Figure) -> float:
    assert figure.value is not None, "a figure that is told"
    return figure.value
