# SPDX-License-Identifier: GPL-3.0-or-later
"""A comparison as one page of HTML, without script, that fetches nothing: a table, and both sides' curves drawn."""

from collections.abc import Iterator, Mapping, Sequence

from .charts import ALWAYS, SEQUENCE, STYLE, curve_chart, number, safe, value_of, within
from .comparison import ComparedFigure, Comparison, Difference, points_of
from .figure import Figure


def page(names: tuple[str, str], a: Mapping[str, Figure], b: Mapping[str, Figure], found: Comparison) -> str:
    """Return the page. names: what A and B are called. a, b: the figures that were compared."""
    told = [figure.curve for figure in (*a.values(), *b.values()) if figure.curve]
    curves = dict.fromkeys([*(() if any(SEQUENCE in curve for curve in told) else ALWAYS), *told])
    parts = [
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{safe(names[0])} and {safe(names[1])} compared</title>\n<style>{STYLE}</style>\n</head>\n<body>",
        "<h1>Two recordings' noise</h1>",
        f'<p><b class="a">A</b> {safe(names[0])}<br><b class="b">B</b> {safe(names[1])}</p>',
        "<p>Figures that both tell, the largest difference first, in combined standard errors; in brackets intervals "
        "of 95 %, outside of which one in twenty lies by chance.</p>",
        *_table(found.rows),
        *(part for curve in curves for part in curve_chart(curve, points_of(a, curve), points_of(b, curve))),
        *_others(found),
        "</body>\n</html>\n",
    ]
    return "\n".join(parts)


def difference(part: Difference) -> tuple[float, float | None, float | None]:
    """Return B minus A with its interval, as far as it has one."""
    low, high = part.interval or (None, None)
    return part.value, low, high


# --- tables ---


def _table(rows: Sequence[ComparedFigure]) -> Iterator[str]:
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
            values = (within((value_of(side), side.low, side.high)) for side in (part.a, part.b))
            apart = "counted" if part.standard_errors is None else number(part.standard_errors)
            cells = (told, *values, apart, within(difference(part)), within(part.ratio))
            yield _row(*cells, kind=kind, same=not part.differs)
    yield "</tbody></table></div>"


def _row(*cells: str, kind: str = "", same: bool = False) -> str:
    first, *others = cells
    names = " ".join(name for name in (kind, "same" if same else "") if name)
    return f'<tr class="{names}"><td>{safe(first)}</td>' + "".join(f'<td class="n">{safe(x)}</td>' for x in others)


def _others(found: Comparison) -> Iterator[str]:
    if found.one_sided:
        yield "<h2>What only one tells</h2>\n<ul>"
        for item in found.one_sided:
            other = "b" if item.whose == "a" else "a"
            told = within((value_of(item.figure), item.figure.low, item.figure.high))
            told = f"{item.figure.name} is {told}; {other.upper()} cannot tell it, because {item.why}"
            yield f'<li><b class="{item.whose}">{item.whose.upper()}</b> {safe(told)}</li>'
        yield "</ul>"
    if found.untold:
        yield "<h2>What neither tells</h2>\n<ul>"
        for name, why_a, why_b in found.untold:
            yield f"<li>{safe(f'{name}: {why_a}' + (f'; {why_b}' if why_b != why_a else ''))}</li>"
        yield "</ul>"
