# SPDX-License-Identifier: GPL-3.0-or-later
"""`check` and `measure`: what recordings say of themselves, before anything is made of them, on a page."""

import argparse
import json
import shlex
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.atomic_files import write_atomic
from ..core.errors import InputError, NoisyWorldError
from .arguments import ENDINGS, Parser, add_part_options, add_set_option, out_path, path, planned, settled
from .command import Command
from .entry import Entry

if TYPE_CHECKING:
    from ..core.geometry import Intrinsics
    from ..measure.figure import Figure
    from ..measure.looking import RecordingFigures
    from ..render.source import Source

PAGES = (".html", ".htm")
VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v")


def _check_options(parser: Parser) -> None:
    named = "a recording's folder, a bag, a video, or a preset, whose recordings are looked at"
    parser.option("preset FOLDER|BAG|PRESET", named, type=path)
    camera = "width, height, fx, fy, cx, cy of colour in pixels, where no file says them: 640,480,525,525,319.5,239.5"
    parser.option("--camera W,H,FX,FY,CX,CY", camera, type=camera_numbers)
    parser.option("--rate_hz HZ", "frames a second, where no file has time stamps", type=float)
    parser.flag("--json", "print one JSON object instead of a page")
    add_set_option(parser)
    add_part_options(parser, ("scenes",))
    parser.set_defaults(settings=[], frames=None)


def camera_numbers(text: str) -> dict[str, float]:
    """Parse W,H,FX,FY,CX,CY, all in pixels."""
    names = ("width", "height", "fx", "fy", "cx", "cy")
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) != len(names) or not all(value > 0 for value in values[:4]):
        raise argparse.ArgumentTypeError(f"{text!r} has to be six numbers: {', '.join(names)}")
    return {name: int(value) if name in names[:2] else value for name, value in zip(names, values, strict=True)}


def _measure_options(parser: Parser) -> None:
    _check_options(parser)
    device = "write what was measured as a device, which 'camera: {device: FILE}' and 'sensor: FILE' of a preset take"
    parser.option("--device FILE", device, type=path)
    preset = "write a preset whose setting makes clean frames into such ones"
    parser.option("--preset FILE", preset, type=path, dest="twin")
    html = "write a page too: what was measured beside what the device draws that was made of it"
    parser.option("--html PAGE.html", html, type=out_path)


def _check(options: argparse.Namespace, _: Entry) -> int:
    """Look, print the page, and return 0 where nothing is wrong."""
    from ..measure.looking import look_at

    return _printed(options, look_at)


def _measure(options: argparse.Namespace, _: Entry) -> int:
    """Measure, print the page, write what is asked for, and return 0 where nothing is wrong."""
    from ..measure.looking import measured
    from ..measure.severities import places
    from ..measure.twin import device_text, preset_text, twin_of

    files = [(file, text) for file, text in ((options.device, device_text), (options.twin, preset_text)) if file]
    for file, _text in files:
        if file.exists():
            raise InputError(file, "is there already", remedy="name another file, or remove it")
    for file in (options.device, options.twin, options.html):
        if file and not file.absolute().parent.is_dir():
            raise InputError(file.absolute().parent, "is no folder", remedy="make it, or name another file")
    if options.html is not None:
        check_page(options.html)
    texts: list[dict[Path, str]] = []

    def look(name: str, source: "Source", camera: "Intrinsics") -> "RecordingFigures":
        if texts and (files or options.html):
            raise NoisyWorldError("several recordings would be one device", remedy="choose one: --scenes NAME")
        found = measured(name, source, camera)
        twin = twin_of(found, camera, source.optics(camera).distortion)
        found = replace(found, places=tuple(places(found)))
        texts.append({file: text(twin, found) for file, text in files})
        if options.html is not None:
            from ..measure.measure_page import page
            from ..measure.model_draw import model_draw

            texts[-1][options.html] = page(
                str(options.preset), found, twin, model_draw(name, source, camera, found, twin)
            )
        return found

    status = _printed(options, look)
    if not texts and (files or options.html):
        raise NoisyWorldError("nothing is recorded there, so there is no device", remedy="name a recording")
    for file, text in texts[0].items() if texts else ():
        write_atomic(file, text.encode(), file.absolute().parent)
        if not options.json:
            print(f"written    {file}")
    return status


def check_page(page: Path) -> None:
    """Refuse a page that cannot be written under its name. Raises NoisyWorldError."""
    if page.suffix.lower() not in PAGES:
        raise NoisyWorldError(f"--html {page} has to end in .html", remedy="name it so")
    if page.is_dir():
        raise NoisyWorldError(f"{page}: is a folder", remedy="name a file to write with --html")


def _printed(options: argparse.Namespace, look: "Callable[[str, Source, Intrinsics], RecordingFigures]") -> int:
    found: list[RecordingFigures] = []
    rendered: list[str] = []
    for name, source, camera in scenes_of(options):
        if source.capabilities.recorded:
            found.append(look(name, source, camera))
        else:
            rendered.append(name)
    if options.json:
        print(
            json.dumps(
                {"scenes": [_content(findings) for findings in found], "rendered": rendered}, indent=1, allow_nan=False
            )
        )
    else:
        print("\n\n".join("\n".join(_page(findings)) for findings in found))
        if rendered:
            print(f"{'' if not found else chr(10)}rendered   {', '.join(rendered)}: nothing is recorded there")
        print(f"next       {_next(options, faults=any(findings.faults for findings in found))}")
    return 1 if any(findings.faults for findings in found) else 0


def scenes_of(options: argparse.Namespace) -> "Iterator[tuple[str, Source, Intrinsics]]":
    """Yield name, source and camera of what is to be looked at."""
    if options.preset.suffix.lower() in ENDINGS and not options.preset.is_dir():
        for name in ("camera", "rate_hz"):
            if getattr(options, name) is not None:
                raise NoisyWorldError(f"--{name} is for a folder", remedy="a preset has a key of this name: use --set")
        plan = planned(options)
        for scene in plan.scenes:
            yield scene.name, scene.source, plan.cameras[scene.name]
        return
    if not options.preset.exists():
        raise InputError(options.preset, "is not there", remedy="name a recording's folder, a bag, a video or a preset")
    for given in ("overrides", "scenes", "data"):
        if getattr(options, given):
            word = {"overrides": "--set"}.get(given, f"--{given}")
            raise NoisyWorldError(f"{word} is for a preset", remedy="leave it out")
    from ..preset.keys import check_document
    from ..sources import find_scenes

    document = {"scenes": [_scene(options)], "settings": [{"name": "clean"}]}
    if options.camera is not None:
        document["camera"] = options.camera
    preset = check_document(document, options.preset)
    asked = None if preset.spec.camera is None else preset.spec.camera.intrinsics
    for scene in find_scenes(preset):
        try:
            camera = scene.source.camera(asked)
        except InputError as error:
            if asked is not None:
                raise
            remedy = "give them in pixels: --camera WIDTH,HEIGHT,FX,FY,CX,CY"
            raise InputError(options.preset, error.problem, remedy=remedy) from error
        assert camera is not None, "a recording has a camera"
        yield scene.name, scene.source, camera


def _scene(options: argparse.Namespace) -> dict[str, Any]:
    """Return what a preset would say of a folder, a bag or a video."""
    what, suffix = options.preset.absolute(), options.preset.suffix.lower()
    rate = {} if options.rate_hz is None else {"rate_hz": options.rate_hz}
    if suffix in VIDEOS and what.is_file():
        return {"name": "recording", "video": str(what)}
    from ..layouts import recognising
    from ..sources.recording import holds_images

    if holds_images(what) and not recognising(what):
        return {"name": "recording", "sequence": str(what), "layout": "images", **rate}
    return {"name": "recording", "sequence": str(what), "poses": "keep", **rate}


# --- the page ---


def _page(found: "RecordingFigures") -> Iterator[str]:
    wide, high = found.size_px
    yield f"recording  {found.name}: {found.frames} frames of {wide} x {high}, {found.seconds:.2f} s"
    yield f"looked at  {found.read} frames"
    for name, figure in found.figures.items():
        yield f"  {name:<32}{_shown(figure)}"
    yield from (f"severity   {place}" for place in found.places)
    yield from (f"note       {text}" for text in found.remarks)
    yield from (f"fault      {text}" for text in found.faults)
    if not found.faults:
        yield "found      nothing wrong"


def _shown(figure: "Figure") -> str:
    if figure.value is None:
        return f"cannot be told here, because {figure.untold}"
    number = f"{figure.value:.4g}"
    known = figure.low is not None and figure.high is not None and figure.low != figure.high
    within = f" (95 %: {figure.low:.4g} to {figure.high:.4g})" if known else ""
    return f"{number}{within} of {figure.samples} {figure.of}"


def _content(found: "RecordingFigures") -> dict[str, Any]:
    return {
        "name": found.name,
        "frames": found.frames,
        "size_px": list(found.size_px),
        "seconds": found.seconds,
        "looked_at": found.read,
        "figures": [figure.content() for figure in found.figures.values()],
        **({"severities": [place.content() for place in found.places]} if found.places else {}),
        "remarks": list(found.remarks),
        "faults": [{"about": told, "text": str(text)} for told, text in zip(found.told, found.faults, strict=True)],
    }


def _next(options: argparse.Namespace, *, faults: bool) -> str:
    """Return what to type next."""
    what = shlex.quote(str(options.preset))
    if faults:
        return f"mend that, and look again: noisy-world check {what}"
    if options.preset.suffix.lower() in ENDINGS and not options.preset.is_dir():
        return f"noisy-world generate {what}"
    (key, value), *_ = [item for item in _scene(options).items() if item[0] in ("sequence", "video")]
    shown = f"{{{', '.join(f'{k}: {v}' for k, v in value.items())}}}" if isinstance(value, dict) else value
    return (
        f"put '- {{{key}: {shown}}}' under scenes of a preset, such as presets/real_camera.yaml, "
        "and type noisy-world generate PRESET"
    )


CHECK = Command(
    name="check",
    order=195,
    group="prepare and convert",
    help="look at a recording, and say what is wrong with it: scale, axes, clocks, doubles",
    description="Look at a recording before anything is made of it: rates, gaps and doubled frames, scale and axes of "
    "poses by parallax, how depth lies on colour, how late depth and an IMU are. What is wrong is named with its "
    "figure, and the exit status is 1 where something is.",
    options=_check_options,
    settle=settled,
    run=_check,
    needs=("numpy", "cv2"),
    stopped="nothing was written",
)


MEASURE = Command(
    name="measure",
    order=196,
    group="prepare and convert",
    help="measure a recording's noise: of colour, of depth, of an IMU, and how late they are",
    description="Measure what a recording says of its own noise, without ground truth: colour noise against intensity, "
    "depth noise by distance, its steps, correlation and holes, white noise of an IMU, and all that 'check' says. Each "
    "figure has its 95 % interval and the number of samples, or says why it cannot be told here.",
    options=_measure_options,
    settle=settled,
    run=_measure,
    needs=("numpy", "cv2"),
    stopped="nothing was written",
)

COMMAND = CHECK, MEASURE
