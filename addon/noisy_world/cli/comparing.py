# SPDX-License-Identifier: GPL-3.0-or-later
"""`compare`: two recordings' figures side by side, the largest difference first, on a page or as HTML."""

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import NoisyWorldError
from .arguments import ENDINGS, Parser, found_preset, out_path, path
from .checking import PAGES, camera_numbers, scenes_of
from .command import Command
from .entry import Entry

if TYPE_CHECKING:
    from ..core.geometry import Intrinsics
    from ..measure.comparison import ComparedFigure, Comparison
    from ..measure.figure import Figure
    from ..measure.looking import RecordingFigures
    from ..render.source import Source

MANIFEST = "manifest.json"
TWIN = "twin"  # the setting that `measure --preset` writes
MOST_NAMES = 6  # that a message says


def _options(parser: Parser) -> None:
    named = "a recording's folder, a dataset or a sequence of one, a bag, a video, or a preset with recordings"
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

    sides = [_recordings(what, options) for what in (options.a, options.b)]
    pairs = _pairs((options.a, options.b), *sides)
    measured_sides = [
        {name: measured(*side[names[place]]) for name, *names in pairs} for place, side in enumerate(sides)
    ]
    a, b = (_figures(each) for each in measured_sides)
    found = compared(a, b)
    if options.html is not None:
        _write(options, a, b, found)
    if options.json:
        told = {
            letter: _side(what, each)
            for letter, what, each in zip("ab", (options.a, options.b), measured_sides, strict=True)
        }
        print(json.dumps({**told, **found.content()}, indent=1, allow_nan=False))
        return 0
    for letter, what, each in zip("AB", (options.a, options.b), measured_sides, strict=True):
        for name, one in each.items():
            about = f"{what}{': ' if name else ''}{name}"
            seconds = f"{one.frames} frames of {one.size_px[0]} x {one.size_px[1]}, {one.seconds:.2f} s"
            print(f"{letter}          {about}: {seconds}")
            for kind, texts in (("note", one.remarks), ("fault", one.faults)):
                for text in texts:
                    print(f"{kind:<9}  {letter}: {text}")
    for letter, other, side, place in (("A", "B", sides[0], 1), ("B", "A", sides[1], 2)):
        if left := [name for name in side if name not in {pair[place] for pair in pairs}]:
            print(f"only {letter}     {', '.join(left)}: {other} has no such sequence")
    print("\n".join(_page(found)))
    if options.html is not None:
        print(f"page       {options.html}")
    return 0


def _recordings(what: Path, options: argparse.Namespace) -> "dict[str, tuple[str, Source, Intrinsics]]":
    """Return the recordings that a path leads to, by name. Raises NoisyWorldError where there is none."""
    preset = what.suffix.lower() in ENDINGS and not what.is_dir()
    folders = {"": what}
    if (what / MANIFEST).is_file():
        from ..dataset.opening import open_path

        folders = {name: what / name for name in open_path(what)}
    found: dict[str, tuple[str, Source, Intrinsics]] = {}
    for name, folder in folders.items():
        asked = argparse.Namespace(preset=folder, overrides=[], scenes=[], settings=[], data=None, frames=None)
        asked.camera, asked.rate_hz = (None, None) if preset else (options.camera, options.rate_hz)
        for scene, source, camera in scenes_of(asked):
            if source.capabilities.recorded:
                found[scene if preset else name] = scene, source, camera
    if not found:
        raise NoisyWorldError(f"{what}: nothing is recorded there", remedy="make it, and name one of its sequences")
    return found


def _pairs(
    paths: tuple[Path, Path], a: "Mapping[str, object]", b: "Mapping[str, object]"
) -> list[tuple[str, str, str]]:
    """Return what is compared with what: a name ("" of a single pair), and both names.

    Sequences of one name belong together; a single one goes with the only other, or with that of a setting `twin`.
    Raises NoisyWorldError where that leaves it open.
    """
    singles = [next(iter(each)) if len(each) == 1 else _twin(each) for each in (a, b)]
    if (len(a) == 1 or len(b) == 1) and None not in singles:
        return [("", str(singles[0]), str(singles[1]))]
    if len(a) > 1 and len(b) > 1 and (common := [name for name in a if name in b]):
        return [(name, name, name) for name in common]
    path, several = (paths[0], a) if len(a) > 1 else (paths[1], b)
    shown = ", ".join([*several][:MOST_NAMES]) + (", ..." if len(several) > MOST_NAMES else "")
    problem = f"{path}: holds {len(several)} recordings ({shown})"
    raise NoisyWorldError(problem, remedy="name the folder of one, or two datasets with sequences of the same names")


def _twin(several: "Mapping[str, object]") -> str | None:
    """Return the only sequence whose setting is a twin's; None where there is none, or are several."""
    twins = [name for name in several if name.split("/")[0] == TWIN]
    return twins[0] if len(twins) == 1 else None


def _figures(found: "Mapping[str, RecordingFigures]") -> "dict[str, Figure]":
    """Return all figures by name, behind that of their sequence where there are several."""
    made: dict[str, Figure] = {}
    for name, one in found.items():
        for figure in one.figures.values():
            curve = f"{name}: {figure.curve}" if name and figure.curve else figure.curve
            shown = replace(figure, name=f"{name}: {figure.name}" if name else figure.name, curve=curve)
            made[shown.name] = shown
    return made


def _write(
    options: argparse.Namespace, a: "Mapping[str, Figure]", b: "Mapping[str, Figure]", found: "Comparison"
) -> None:
    from ..core.atomic_files import made_beside
    from ..measure.comparison_page import page

    data = page((str(options.a), str(options.b)), a, b, found).encode()
    with made_beside(options.html) as unfinished:
        unfinished.write_bytes(data)


def _side(what: Path, found: "Mapping[str, RecordingFigures]") -> dict[str, Any]:
    sides = {name: _content(str(what), one) for name, one in found.items()}
    return sides[""] if "" in sides else {"name": str(what), "sequences": {name: sides[name] for name in sides}}


def _content(name: str, found: "RecordingFigures") -> dict[str, Any]:
    return {
        "name": name,
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


def _lines(row: "ComparedFigure") -> Iterator[str]:
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
    help="compare two recordings' noise, two datasets', or a recording and its twin, the largest difference first",
    description="Measure two recordings as 'measure' does, and put their figures side by side: B - A and B / A with "
    "their 95 % intervals, the largest difference in combined standard errors first; curves where both have points. Of "
    "two datasets sequences of one name are compared; of a recording and a dataset, that of the setting twin.",
    options=_options,
    settle=_settled,
    run=_compare,
    needs=("numpy", "cv2"),
    stopped="nothing was written",
)
