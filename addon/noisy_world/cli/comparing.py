# SPDX-License-Identifier: GPL-3.0-or-later
"""`compare`: two recordings' figures side by side, the largest difference first, on a page or as HTML."""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import NoisyWorldError
from .arguments import ENDINGS, Parser, found_preset, out_path, path
from .checking import camera_numbers, scenes_of
from .command import Command
from .entry import Entry

if TYPE_CHECKING:
    from ..core.geometry import Intrinsics
    from ..measure.comparison import Comparison, Row
    from ..measure.looking import RecordingFigures
    from ..render.source import Source

PAGES = (".html", ".htm")
LARGEST_PAGE_BYTES = 1_000_000


def _options(parser: Parser) -> None:
    named = "a recording's folder, a sequence of a dataset, a bag, a video, or a preset with one recording"
    parser.option("a A", named, type=path)
    parser.option("b B", "the other, of the same kinds: the twin of A for instance", type=path)
    camera = "of folders: width, height, fx, fy, cx, cy of colour in pixels, where no file says them"
    parser.option("--camera W,H,FX,FY,CX,CY", camera, type=camera_numbers)
    parser.option("--rate_hz HZ", "of folders: frames a second, where no file has time stamps", type=float)
    parser.flag("--json", "print one JSON object instead of a page")
    parser.option("--html PAGE.html", "write a page too, with the curves of both drawn", type=out_path)


def _settled(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    if options.html is not None and options.html.suffix.lower() not in PAGES:
        parser.error(f"--html {options.html} has to end in .html")
    options.a, options.b = found_preset(options.a), found_preset(options.b)
    return options


def _compare(options: argparse.Namespace, _: Entry) -> int:
    """Measure both, and print how they differ."""
    if options.html is not None and options.html.is_dir():
        raise NoisyWorldError(f"{options.html}: is a folder", remedy="name a file to write with --html")
    from ..measure.comparison import compared
    from ..measure.looking import measured

    recordings = [_recording(what, options) for what in (options.a, options.b)]
    a, b = (measured(*recording) for recording in recordings)
    found = compared(a.figures, b.figures)
    if options.html is not None:
        _write(options, a, b, found)
    if options.json:
        sides = {"a": _side(options.a, a), "b": _side(options.b, b)}
        print(json.dumps({**sides, **found.content()}, indent=1, allow_nan=False))
        return 0
    for letter, what, one in (("A", options.a, a), ("B", options.b, b)):
        print(
            f"{letter}          {what}: {one.frames} frames of {one.size_px[0]} x {one.size_px[1]}, {one.seconds:.2f} s"
        )
        for kind, texts in (("note", one.remarks), ("fault", one.faults)):
            for text in texts:
                print(f"{kind:<9}  {letter}: {text}")
    print("\n".join(_page(found)))
    if options.html is not None:
        print(f"page       {options.html}")
    return 0


def _recording(what: Path, options: argparse.Namespace) -> "tuple[str, Source, Intrinsics]":
    """Return the one recording that a path leads to. Raises NoisyWorldError where there is none, or are several."""
    preset = what.suffix.lower() in ENDINGS and not what.is_dir()
    asked = argparse.Namespace(preset=what, overrides=[], scenes=[], settings=[], data=None, frames=None)
    asked.camera, asked.rate_hz = (None, None) if preset else (options.camera, options.rate_hz)
    recorded = [scene for scene in scenes_of(asked) if scene[1].capabilities.recorded]
    if not recorded:
        raise NoisyWorldError(f"{what}: nothing is recorded there", remedy="make it, and name one of its sequences")
    if len(recorded) > 1:
        names = ", ".join(name for name, _, _ in recorded)
        inside = "a preset with one of them" if preset else "the folder of one"
        raise NoisyWorldError(f"{what}: holds {len(recorded)} recordings ({names})", remedy=f"name {inside}")
    return recorded[0]


def _write(options: argparse.Namespace, a: "RecordingFigures", b: "RecordingFigures", found: "Comparison") -> None:
    from ..core.atomic_files import made_beside
    from ..measure.comparison_page import page

    data = page((str(options.a), str(options.b)), a.figures, b.figures, found).encode()
    assert len(data) < LARGEST_PAGE_BYTES, "a table and three drawings"
    with made_beside(options.html) as unfinished:
        unfinished.write_bytes(data)


def _side(what: Path, found: "RecordingFigures") -> dict[str, Any]:
    return {
        "name": str(what),
        "frames": found.frames,
        "size_px": list(found.size_px),
        "seconds": found.seconds,
        "remarks": list(found.remarks),
        "faults": [{"about": told, "text": str(text)} for told, text in zip(found.told, found.faults, strict=True)],
    }


# --- the page ---


def _page(found: "Comparison") -> Iterator[str]:
    from ..measure.charts import number

    estimated = [row for row in found.rows if row.standard_errors is not None]
    counted = [row for row in found.rows if row.standard_errors is None]
    if estimated:
        yield f"{'estimated':<34}{'A':>12}{'B':>12}  {'apart by':<15} B - A and B / A, each with 95 %"
        for row in estimated:
            yield from _lines(row)
    if counted:
        yield f"{'counted, or without interval':<34}{'A':>12}{'B':>12}"
        for row in counted:
            yield from _lines(row)
    for item in found.one_sided:
        other = "B" if item.whose == "a" else "A"
        told = f"{item.figure.name} is {number(item.figure.value)}; {other} cannot tell it, because {item.why}"
        yield f"only {item.whose.upper()}     {told}"
    if found.untold:
        yield f"neither    {', '.join(name for name, _, _ in found.untold)}"
    differing = sum(row.differing > 0 for row in found.rows)
    yield f"found      {differing} of {len(found.rows)} figures differ" if differing else "found      nothing differs"


def _lines(row: "Row") -> Iterator[str]:
    from ..measure.charts import number, within
    from ..measure.comparison_page import difference

    if row.curve:
        told = f"{row.name}, {row.differing} of {len(row.parts)} differ"
        ratio = f"B / A {within(row.ratio)}" if row.ratio else ""
        yield f"  {told:<56}  {_apart(row.standard_errors):<15} {ratio}".rstrip()
    for part in row.parts:
        told = f"    at {number(part.a.at)}" if row.curve else f"  {row.name}"
        ratio = f", {within(part.ratio)}" if part.ratio else ""
        sides = f"{number(part.a.value):>12}{number(part.b.value):>12}"
        yield f"{told:<34}{sides}  {_apart(part.standard_errors):<15} {within(difference(part))}{ratio}"


def _apart(standard_errors: float | None) -> str:
    return "" if standard_errors is None else f"{standard_errors:.1f} st. errors"


COMMAND = Command(
    name="compare",
    order=197,
    group="prepare and convert",
    help="compare two recordings' noise, or a recording and its twin, the largest difference first",
    description="Measure two recordings as 'measure' does, and put their figures side by side: B - A and B / A with "
    "their 95 % intervals, the largest difference in combined standard errors first; curves where both have points.",
    options=_options,
    settle=_settled,
    run=_compare,
    needs=("numpy", "cv2"),
    stopped="nothing was written",
)
