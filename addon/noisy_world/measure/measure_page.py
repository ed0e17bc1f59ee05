# SPDX-License-Identifier: GPL-3.0-or-later
"""A measured recording as one page of HTML, without script, that fetches nothing: beside it what its model draws."""

from collections.abc import Iterator, Mapping, Sequence

from .charts import ALWAYS, STYLE, curve_chart, lines_chart, map_chart, number, safe, within
from .comparison import points_of
from .figure import Figure, Place
from .looking import RecordingFigures
from .model_draw import ModelDraw
from .twin import Twin

OFFSETS = (  # name, what it is, its unit, times
    ("depth_late_frames", "depth is late, frames", 1.0),
    ("imu_clock_s", "IMU's clock by images, ms", 1e3),
    ("imu_clock_by_poses_s", "IMU's clock by poses, ms", 1e3),
    ("readout_down_ms", "readout of rows, ms", 1.0),
    ("jitter_s", "jitter of stamps, ms", 1e3),
)
LEAST_SCALE = 1.0  # of offsets, in frames or milliseconds
INTERESTING = ("depth_4x4_mean_over_pixel_std", "depth_correlation_1_frame", "void_share")


def page(name: str, found: RecordingFigures, twin: Twin, draw: ModelDraw) -> str:
    """Return the page. name: what the recording is called."""
    name = safe(name)
    wide, high = found.size_px
    curves = dict.fromkeys(
        [*ALWAYS, *(figure.curve for figure in (*draw.measured.values(), *draw.drawn.values()) if figure.curve)]
    )
    parts = [
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{name} measured</title>\n<style>{STYLE}</style>\n</head>\n<body>",
        f"<h1>{name}</h1>",
        f"<p>{found.frames} frames of {wide} x {high}, {found.seconds:.2f} s. Intervals are of 95 %.</p>",
        '<p><b class="a">A</b> what was measured<br><b class="b">B</b> what the model draws that was made of it, '
        "measured in the same way: noise on plain surfaces, holes in the recording's own depth, an IMU at rest</p>",
        *_told("fault", found.faults),
        *_told("note", found.remarks),
        *_severities(found.places),
        *(part for curve in curves for part in _curve(curve, draw)),
        *_numbers(draw),
        *_holes(draw),
        *_offsets(found.figures),
        *_all(found.figures),
        "<h2>What the model lacks</h2>\n<ul>",
        *(f"<li>{safe(line)}</li>" for line in twin.untold),
        "</ul>\n</body>\n</html>\n",
    ]
    return "\n".join(parts)


def _told(kind: str, texts: Sequence[str]) -> Iterator[str]:
    yield from (f"<p><b>{kind}</b> {safe(text)}</p>" for text in texts)


def _severities(places: Sequence[Place]) -> Iterator[str]:
    yield "<h2>On the benchmark's severities</h2>"
    if not places:
        yield "<p>Nothing that was measured has a place there.</p>"
        return
    yield "<p>5 is the strongest of the benchmark; below 1 a place is the strength over severity 1's.</p>"
    rows = [
        (f"{place.perturbation}{', ' + place.whose if place.whose else ''}", place.severity, place.low, place.high)
        for place in places
    ]
    yield lines_chart("Severities", 5.0, "severity", rows)
    beyond = [str(place) for place in places if place.times > 1]
    yield from _told("beyond", beyond)


def _curve(curve: str, draw: ModelDraw) -> Iterator[str]:
    a, b = points_of(draw.measured, curve), points_of(draw.drawn, curve)
    if curve in ALWAYS or a or b:
        yield from curve_chart(curve, a, b)
        if curve.endswith("_spectrum") and a:
            yield "<p>A moves as the sensors did; B is noise alone, so they meet where motion ends.</p>"


def _numbers(draw: ModelDraw) -> Iterator[str]:
    rows = [
        (name, draw.measured[name], draw.drawn[name])
        for name in INTERESTING
        if _is_told(draw.measured.get(name)) and _is_told(draw.drawn.get(name))
    ]
    if not rows:
        return
    yield '<h2>Beside the curves</h2>\n<table>\n<thead><tr><th>figure</th><th class="n">A</th><th class="n">B</th></tr>'
    yield "</thead>\n<tbody>"
    for name, a, b in rows:
        yield f'<tr><td>{safe(name)}</td><td class="n">{_shown(a)}</td><td class="n">{_shown(b)}</td></tr>'
    yield "</tbody></table>"


def _is_told(figure: Figure | None) -> bool:
    return figure is not None and figure.value is not None


def _holes(draw: ModelDraw) -> Iterator[str]:
    yield "<h2>Where depth is missing</h2>"
    if draw.holes is None:
        yield "<p>There is no depth.</p>"
        return
    yield "<p>From never (white) to in every frame (black): left A, right B.</p>"
    maps = (map_chart(whose, each) for whose, each in zip("AB", draw.holes, strict=True))
    yield f'<div class="maps">{"".join(maps)}</div>'


def _offsets(figures: Mapping[str, Figure]) -> Iterator[str]:
    yield "<h2>Offsets</h2>"
    rows: list[tuple[str, float, float | None, float | None]] = []
    for name, told, times in OFFSETS:
        figure = figures.get(name)
        if figure is not None and figure.value is not None:
            low, high = (None if end is None else times * end for end in (figure.low, figure.high))
            rows.append((told, times * figure.value, low, high))
    if not rows:
        yield "<p>None can be told.</p>"
        return
    most = max(LEAST_SCALE, *(1.1 * abs(value) for _, value, _, _ in rows))
    yield lines_chart("Offsets", most, "frames, or milliseconds", rows)


def _all(figures: Mapping[str, Figure]) -> Iterator[str]:
    yield '<h2>All figures</h2>\n<div class="scroll"><table>\n<thead><tr><th>figure</th><th class="n">value</th>'
    yield '<th class="n">of</th></tr></thead>\n<tbody>'
    for name, figure in figures.items():
        if figure.value is None:
            why = safe(f"cannot be told here, because {figure.untold}")
            yield f'<tr class="same"><td>{safe(name)}</td><td class="why" colspan="2">{why}</td></tr>'
            continue
        of = f"{number(figure.samples)} {safe(figure.of)}"
        yield f'<tr><td>{safe(name)}</td><td class="n">{_shown(figure)}</td><td class="n">{of}</td></tr>'
    yield "</tbody></table></div>"


def _shown(figure: Figure) -> str:
    return safe(within(None if figure.value is None else (figure.value, figure.low, figure.high)))
