# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawings of figures for pages of HTML: curves, intervals on a line and maps, as SVG without script."""

import math
from collections.abc import Iterator, Sequence
from html import escape
from itertools import pairwise

import numpy as np

from .figure import Figure
from .footage import Float64

COLOURS = {"a": "#0072b2", "b": "#d55e00"}  # told apart by the colour-blind: Okabe and Ito
WIDE, HIGH = 640, 320  # of a drawing, and its margins, in pixels
LEFT, RIGHT, TOP, BOTTOM = 78, 16, 14, 46
MOST = 1.6  # times the largest value: intervals that are wider are cut there
ROW, NAMES_PX = 24, 330  # of values with intervals: a row's height, and where the scale begins
SHADES, MAP_PX = 16, 310  # of maps
MANY = 100.0  # ratio of an axis of powers that has ticks at those of ten alone
BELOW = 0.3  # of the largest value: so far below 0 intervals are drawn
CURVES = {  # title, what is to the right, what is upwards
    "colour_noise": ("Photon transfer: noise of colour by intensity", "intensity, of 255", "deviation, of 255"),
    "depth_noise_m": ("Noise of depth by distance", "distance, m", "deviation, m"),
    "depth_correlation": ("Correlation of depth's noise between neighbours", "apart by, px", "correlation"),
    "depth_noise_over_head_on": ("Noise of depth by incidence", "incidence, degrees", "times that of surfaces head on"),
    "holes_at_deg": ("Void by incidence", "incidence, degrees", "share of pixels"),
    "holes_at_m": ("Void by distance", "distance, m", "share of pixels"),
    "holes_at_grey": ("Void by grey", "grey, of 255", "share of pixels"),
    "holes_at_contrast": ("Void by contrast", "deviation of grey over 7 x 7 pixels, of 255", "share of pixels"),
    "shake_turn_deg": ("How the camera shakes: turns by octaves", "frequency, Hz", "root mean square, deg"),
    "shake_shift_m": ("How the camera shakes: shifts by octaves", "frequency, Hz", "root mean square, m"),
    "gyro_spectrum": ("Spectrum of the gyroscope", "frequency, Hz", "rad/s/sqrt(Hz)"),
    "accel_spectrum": ("Spectrum of the accelerometer", "frequency, Hz", "m/s^2/sqrt(Hz)"),
}
ALWAYS = ("colour_noise", "depth_noise_m", "depth_correlation")  # spoken of where nobody tells them, too
SEQUENCE = ": "  # between the name of a sequence and that of its curve, where several are compared
IN_POWERS = ("gyro_spectrum", "accel_spectrum", "shake_turn_deg", "shake_shift_m")  # drawn with logarithmic axes
STYLE = """
body { font: 16px/1.45 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; color: #1d2b36; }
table { border-collapse: collapse; font-size: .9rem; } .scroll { overflow-x: auto; }
th, td { text-align: left; padding: .2rem .7rem; border-bottom: 1px solid #dde3e8; white-space: nowrap; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; } tr.place td:first-child { padding-left: 2rem; }
tr.same { color: #71808c; } svg { max-width: 100%; height: auto; } .a { color: #0072b2; } .b { color: #d55e00; }
td.why { white-space: normal; } .maps svg { border: 1px solid #9aa7b1; margin-right: 1rem; }
"""


def number(value: float | None) -> str:
    """Return a number for people; a dash for none."""
    return "-" if value is None else f"{value:.4g}"


def within(value: tuple[float, float | None, float | None] | None) -> str:
    """Return a value with its interval, as far as it has one; a dash for none."""
    if value is None:
        return "-"
    known = value[1] is not None and value[2] is not None and value[1] != value[2]
    return number(value[0]) + (f" ({number(value[1])} to {number(value[2])})" if known else "")


def safe(text: str) -> str:
    """Return text for HTML. Names of files may hold what neither XML nor UTF-8 has."""
    return escape("".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text))


def curve_chart(curve: str, a: Sequence[Figure], b: Sequence[Figure]) -> Iterator[str]:
    """Yield a heading and a drawing of a curve as A and B have it: points that are told, in the order of places."""
    sequence, _, curve = curve.rpartition(SEQUENCE)
    title, right, up = CURVES.get(curve, (curve.replace("_", " "), "at", "value"))
    title = f"{sequence}{SEQUENCE if sequence else ''}{title}"
    yield f"<h2>{safe(title)}</h2>"
    if not a and not b:
        yield "<p>It cannot be told.</p>"
        return
    for whose, points in (("A", a), ("B", b)):
        if not points:
            yield f"<p>{whose} does not tell it.</p>"
    drawing = _axes((*a, *b), powers=curve in IN_POWERS)
    yield f'<svg viewBox="0 0 {WIDE} {HIGH}" width="{WIDE}" height="{HIGH}" role="img" aria-label="{safe(title)}">'
    yield from drawing.frame(right, up)
    for whose, points in (("a", a), ("b", b)):
        yield from drawing.curve(whose, points)
    yield "</svg>"


def _axes(points: Sequence[Figure], *, powers: bool) -> "_Axes":
    values, places = [value_of(point) for point in points], [float(point.at or 0) for point in points]
    if powers and min(*values, *places, 1.0) > 0:
        return _Axes((min(places) / 1.1, max(places) * 1.1), (min(values) / 1.5, max(values) * 1.5), powers=True)
    ends = [end for point in points for end in (point.low, point.high) if end is not None]
    most, least = MOST * max(*values, 0.0), min(-BELOW * max(*values, 0.0), MOST * min(values))
    top, bottom = min(max([*values, *ends]), most) or 1.0, max(min([0.0, *values, *ends]), least)
    spare = 0.05 * (top - bottom)
    upwards = bottom - (spare if bottom < 0 else 0), top + spare
    return _Axes((min(0.0, *places), 1.04 * max(places) or 1.0), upwards)


def lines_chart(
    title: str, most: float, unit: str, rows: Sequence[tuple[str, float, float | None, float | None]]
) -> str:
    """Return a drawing of values with intervals, a row each. most: where the scale ends; below 0 it begins at -most."""
    least = 0.0 if all(min(value, value if low is None else low) >= 0 for _, value, low, _ in rows) else -most
    high = ROW * len(rows) + 34

    def x(value: float) -> float:
        return NAMES_PX + (WIDE - NAMES_PX - RIGHT) * (min(max(value, least), most) - least) / (most - least)

    foot = high - 30
    parts = [f'<svg viewBox="0 0 {WIDE} {high}" width="{WIDE}" height="{high}" role="img" aria-label="{safe(title)}">']
    parts.append('<g stroke="#dde3e8" font-size="12" fill="#1d2b36">')
    parts += [
        f'<path d="M{x(tick):.1f} 4V{foot}"/>{_text(x(tick), foot + 14, number(tick), "middle")}'
        for tick in _ticks(least, most)
    ]
    parts.append(_text((NAMES_PX + WIDE - RIGHT) / 2, high - 3, unit, "middle"))
    parts.append(f'</g><g stroke="{COLOURS["a"]}" fill="{COLOURS["a"]}" stroke-width="2" font-size="12">')
    for place, (name, value, low, up) in enumerate(rows):
        y = ROW * (place + 0.5) + 4
        parts.append(f'<g fill="#1d2b36">{_text(NAMES_PX - 8, y + 4, name, "end")}</g>')
        if low is not None and up is not None:
            parts.append(f'<path d="M{x(low):.1f} {y:.1f}H{x(up):.1f}"/>')
        told = safe(f"{name}: {within((value, low, up))}")
        parts.append(f'<circle cx="{x(value):.1f}" cy="{y:.1f}" r="4"><title>{told}</title></circle>')
    return "".join([*parts, "</g></svg>"])


def map_chart(title: str, shares: Float64) -> str:
    """Return a map (rows, columns) of shares from 0 (white) to 1 (black), a rectangle for each run of equal cells."""
    rows, columns = shares.shape
    levels = np.rint(np.clip(shares, 0, 1) * SHADES).astype(int)
    parts = [
        f'<svg viewBox="0 0 {columns} {rows}" width="{MAP_PX}" height="{MAP_PX * rows // columns}" role="img" '
        f'aria-label="{safe(title)}" shape-rendering="crispEdges">'
        f'<path fill="#fff" d="M0 0h{columns}v{rows}h-{columns}z"/>'
    ]
    for y, row in enumerate(levels.tolist()):
        starts = [0, *(x for x in range(1, columns) if row[x] != row[x - 1]), columns]
        for start, end in pairwise(starts):
            if row[start]:
                grey = round(255 * (1 - row[start] / SHADES))
                parts.append(
                    f'<path fill="#{grey:02x}{grey:02x}{grey:02x}" d="M{start} {y}h{end - start}v1h-{end - start}z"/>'
                )
    return "".join([*parts, "</svg>"])


class _Axes:
    """Where numbers are on a drawing. across, upwards: their ranges. powers: whether axes are logarithmic."""

    def __init__(self, across: tuple[float, float], upwards: tuple[float, float], *, powers: bool = False) -> None:
        self.across, self.upwards, self.powers = across, upwards, powers

    def x(self, value: float) -> float:
        return LEFT + (WIDE - LEFT - RIGHT) * self._share(value, self.across)

    def y(self, value: float) -> float:
        low, high = self.upwards
        return HIGH - BOTTOM - (HIGH - TOP - BOTTOM) * self._share(min(max(value, low), high), self.upwards)

    def _share(self, value: float, ends: tuple[float, float]) -> float:
        low, high = ends
        return math.log(value / low) / math.log(high / low) if self.powers else (value - low) / (high - low)

    def frame(self, right: str, up: str) -> Iterator[str]:
        foot, side = HIGH - BOTTOM, WIDE - RIGHT
        yield '<g stroke="#dde3e8" font-size="12" fill="#1d2b36">'
        for tick in _ticks(*self.across, powers=self.powers):
            at = self.x(tick)
            yield f'<path d="M{at:.1f} {TOP}V{foot}"/>{_text(at, foot + 17, number(tick), "middle")}'
        for tick in _ticks(*self.upwards, powers=self.powers):
            at = self.y(tick)
            yield f'<path d="M{LEFT} {at:.1f}H{side}"/>{_text(LEFT - 7, at + 4, number(tick), "end")}'
        yield f"{_text((LEFT + side) / 2, HIGH - 8, right, 'middle')}"
        middle = (TOP + foot) / 2
        yield f'<g transform="rotate(-90 16 {middle:.0f})">{_text(16, middle, up, "middle")}</g></g>'

    def curve(self, whose: str, points: Sequence[Figure]) -> Iterator[str]:
        at = [(self.x(float(point.at or 0)), self.y(value_of(point))) for point in points]
        yield f'<g stroke="{COLOURS[whose]}" fill="{COLOURS[whose]}" stroke-width="1.6">'
        if len(at) > 1:
            line = "L".join(f"{x:.1f} {y:.1f}" for x, y in at)
            yield f'<path fill="none" d="M{line}"/>'
        for (x, y), point in zip(at, points, strict=True):
            if point.low is not None and point.high is not None:
                low, high = self.y(point.low), self.y(point.high)
                yield f'<path d="M{x:.1f} {low:.1f}V{high:.1f}M{x - 4:.1f} {low:.1f}h8M{x - 4:.1f} {high:.1f}h8"/>'
            told = within((value_of(point), point.low, point.high))
            title = f"<title>{whose.upper()} {safe(point.name)}: {told}</title>"
            if whose == "a":
                yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5">{title}</circle>'
            else:
                yield f'<path d="M{x - 3.5:.1f} {y - 3.5:.1f}h7v7h-7z">{title}</path>'
        yield "</g>"


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text stroke="none" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{safe(text)}</text>'


def _ticks(low: float, high: float, *, powers: bool = False) -> list[float]:
    """Return some four to nine round numbers from low to high; of powers 1, 2 and 5 times those of ten."""
    if powers:
        tens = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        times = (1,) if high / low > MANY else (1, 2, 5)
        return [tick for ten in tens for by in times if low <= (tick := by * 10.0**ten) <= high]
    rough = (high - low) / 6
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(times * power for times in (1, 2, 5, 10) if times * power >= rough)
    first = math.ceil(low / step - 1e-9)
    return [step * place for place in range(first, math.floor(high / step + 1e-9) + 1)]


def value_of(figure: Figure) -> float:
    """Return the value of a figure that is told."""
    assert figure.value is not None, "a figure that is told"
    return figure.value
