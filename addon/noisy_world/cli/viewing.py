# SPDX-License-Identifier: GPL-3.0-or-later
"""`view`, `video`: a dataset in a viewer, as a page or as videos to look at."""

import argparse
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import InputError, NoisyWorldError, StorageError
from ..core.packages import need
from ..core.progress import counted
from ..core.schema import ConfigPath
from .arguments import Parser, frame_slice, out_path, place, positive
from .command import Command
from .entry import Entry, say
from .look_page import PAGE_FRAMES

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..dataset.loader import Opened


CODECS = {"mp4v": "MPEG-4 part 2", "MJPG": "Motion JPEG"}
SHEET = ".png"
TILE_PX = 180  # the height of a sheet's tiles; chosen
USUAL_HZ = 30.0


def _video_options(parser: Parser) -> None:
    parser.option("dataset DATASET", "a dataset, a packed one, a sequence or a recipe", type=place)
    parser.option(
        "out OUT",
        "walk.mp4, .avi or .mkv; of several sequences, one each with its name; with --sheet a .png",
        type=out_path,
    )
    add_part(parser)
    parser.option("--sheet N", "write one sheet with N frames of each sequence", type=positive)


def add_part(parser: Parser) -> None:
    """Add what says which sequences and frames are meant, and what may be replaced."""
    parser.option(
        "--only NAME",
        "only the sequences of this name, SETTING/SCENE in a dataset, * allowed; may be repeated",
        action="append",
    )
    parser.option("--frames A:B", "only frames A to B-1 of each", type=frame_slice, default=slice(None))
    parser.flag("--overwrite", "replace what is there")


def chosen(opened: "Opened", options: argparse.Namespace) -> dict[str, list[int]]:
    """Return the numbers of the frames that are meant, by sequence. Raises ConfigError, InputError for none."""
    from ..preset.names import selected

    names = selected(list(opened), options.only, ConfigPath(opened.place).at("sequences"))
    found = {name: list(opened[name].frames.within(options.frames)) for name in names}
    if not any(found.values()):
        raise InputError(opened.place, "has no such frames", remedy="'noisy-world status' says which there are")
    return {name: numbers for name, numbers in found.items() if numbers}


def check_free(out: Path, *, overwrite: bool) -> None:
    """Raise StorageError where a file is there that may not be replaced, or a folder."""
    if out.is_dir():
        raise StorageError("is a folder", file=out, remedy="name a file in it")
    if out.exists() and not overwrite:
        raise StorageError("is there already", file=out, remedy="--overwrite replaces it")


def _write_videos(options: argparse.Namespace, _: Entry) -> int:
    from ..dataset.opening import open_path
    from ..images.video_files import WRITTEN
    from .frame_views import colour_and_depth_of

    suffix = options.out.suffix.lower()
    kinds = [SHEET] if options.sheet else list(WRITTEN)
    if suffix not in kinds:
        raise StorageError(
            f"ends in {suffix or 'nothing'}", file=options.out, remedy=f"name a file that ends in {' or '.join(kinds)}"
        )
    with open_path(options.dataset) as opened:
        if not colour_and_depth_of(opened):
            raise StorageError("holds neither colour nor depth", file=opened.place)
        parts = chosen(opened, options)
        outs = [options.out] if options.sheet or len(parts) == 1 else [_named(options.out, name) for name in parts]
        for out in outs:
            check_free(out, overwrite=options.overwrite)
        if options.sheet:
            _write_sheet(opened, parts, options.sheet, options.out)
        else:
            for out, (name, numbers) in zip(outs, parts.items(), strict=True):
                _write_one(opened, name, numbers, out)
    return 0


def _named(out: Path, name: str) -> Path:
    return out.with_name(f"{out.stem}-{name.replace('/', '-')}{out.suffix}")


def _write_one(opened: "Opened", name: str, numbers: list[int], out: Path) -> None:
    """Write the video of a sequence beside its place, and move it there when it is whole."""
    import numpy as np

    from ..core.atomic_files import made_beside
    from ..images.video_files import WRITTEN, write_video

    sequence = opened[name]
    gaps_s = np.diff([sequence[number].stamp_s for number in numbers])
    rate_hz = 1 / float(np.median(gaps_s)) if gaps_s.size and (gaps_s > 0).all() else USUAL_HZ
    with made_beside(out) as made:
        count = write_video(made, _pictures(opened, name, numbers), rate_hz)
    code = WRITTEN[out.suffix.lower()]
    print(f"wrote {out}: {counted(count, 'frame')} of {name}, {rate_hz:.4g} Hz, {CODECS[code]} ({code})")


def _pictures(opened: "Opened", name: str, numbers: list[int]) -> Iterator["NDArray[np.uint8]"]:
    """Yield a picture for each frame: clean colour if there is any, colour, depth, and words under them."""
    from .frame_views import (
        DepthScale,
        clean_beside,
        colour_and_depth_of,
        lettered,
        panes,
        shown_colour,
        side_by_side,
        source_frame,
        stacked,
        words_of,
    )

    held, clean = colour_and_depth_of(opened), clean_beside(opened, name)
    sequence = opened[name]
    scale = DepthScale.of(sequence, numbers) if "depth" in held else DepthScale(0.0, 1.0)
    beside = clean if clean is not None and "rgb" in held else None
    if beside is not None and any(source_frame(sequence[number]) not in beside for number in numbers):
        say(f"{name}: the clean sequence lacks frames that it shows, so it is not beside it")
        beside = None
    for frame in (sequence[number] for number in numbers):
        tiles = [] if beside is None else [shown_colour(beside[source_frame(frame)])]
        row = side_by_side([*tiles, *panes(frame, held, scale)])
        said = "   ".join([name, f"frame {frame.index}", f"{frame.stamp_s:.3f} s", *words_of(frame.done)])
        yield stacked([row, lettered(said, row.shape[1])])


def _write_sheet(opened: "Opened", parts: dict[str, list[int]], count: int, out: Path) -> None:
    """Write a sheet: for each sequence a line, and a row of its frames' colour and one of their depth."""
    import cv2
    import numpy as np

    from ..core.atomic_files import made_beside
    from ..dataset.sequence import spread
    from .frame_views import DepthScale, colour_and_depth_of, fitted, lettered, panes, stacked, words_of

    held = colour_and_depth_of(opened)
    rows: list[NDArray[np.uint8]] = []
    for name, numbers in parts.items():
        few = [opened[name][number] for number in spread(numbers, count)]
        scale = DepthScale.of(opened[name], spread(numbers, count)) if "depth" in held else DepthScale(0.0, 1.0)
        columns = [[fitted(tile, TILE_PX) for tile in panes(frame, held, scale)] for frame in few]
        bands = [np.concatenate(band, axis=1) for band in zip(*columns, strict=True)]
        shown = ", ".join(str(frame.index) for frame in few)
        done = ", ".join(words_of(few[0].done)) or "nothing was done"
        depths = f"   depth {scale.near_m:.2f} to {scale.far_m:.2f} m" if "depth" in held else ""
        rows += [lettered(f"{name}   frames {shown}   {done}{depths}", bands[0].shape[1]), *bands]
    _, data = cv2.imencode(SHEET, np.ascontiguousarray(stacked(rows)[..., ::-1]))
    with made_beside(out) as made:
        made.write_bytes(data.tobytes())
    print(f"wrote {out}: {counted(len(parts), 'sequence')}")


VIDEO = Command(
    name="video",
    order=80,
    group="look at what there is",
    help="write a dataset's sequences as videos to look at, or as one sheet",
    description="Write sequences of a dataset as videos to look at: colour beside depth, behind the clean colour "
    "where the dataset has a clean setting, and under them what was done to each frame; or as a sheet.",
    options=_video_options,
    run=_write_videos,
    needs=("numpy", "cv2"),
    stopped="finished videos stay",
)


# --- `view` ---


RECORDING = ".rrd"
PAGES = (".html", ".htm")
ELSE = ", or write a recording by --save FILE.rrd, to open where there is one"


def _view_options(parser: Parser) -> None:
    parser.option("dataset DATASET", "a dataset, a packed one, a sequence or a recipe", type=place)
    add_part(parser)
    parser.option(
        "--every N", f"images of every n-th frame alone; in a page else {PAGE_FRAMES} of each sequence", type=positive
    )
    instead = parser.add_mutually_exclusive_group()
    instead.add_argument(
        "--save", metavar="FILE.rrd", type=out_path, help="write a recording instead of opening the viewer"
    )
    instead.add_argument(
        "--html",
        metavar="FILE.html",
        type=out_path,
        help="write one page that opens offline instead: a slider over frames, settings side by side; without Rerun",
    )


def _view(options: argparse.Namespace, _: Entry) -> int:
    """Open the viewer, or write the recording beside its place and move it there when it is whole."""
    from ..core.atomic_files import made_beside
    from ..dataset.opening import open_path

    if options.html is not None:
        return _write_page(options)
    need(("rerun",), "view", otherwise="write a page by --html FILE.html")
    if options.save is None:
        _prepare_viewer()
    else:
        if options.save.suffix.lower() != RECORDING:
            raise StorageError("is no name of a recording", file=options.save, remedy=f"let it end in {RECORDING}")
        check_free(options.save, overwrite=options.overwrite)
    with open_path(options.dataset) as opened:
        parts = chosen(opened, options)
        if options.save is None:
            _record(opened, parts, options.every or 1, None)
            print("opened the viewer")
            return 0
        with made_beside(options.save) as made:
            _record(opened, parts, options.every or 1, made)
            size = made.stat().st_size
    print(f"wrote {options.save}: {', '.join(parts)}, {size / 1e6:.1f} MB; 'rerun {options.save}' opens it")
    return 0


def _write_page(options: argparse.Namespace) -> int:
    from ..core.atomic_files import made_beside
    from ..dataset.opening import open_path
    from .frame_views import colour_and_depth_of
    from .look_page import look_page

    if options.html.suffix.lower() not in PAGES:
        raise StorageError("is no name of a page", file=options.html, remedy=f"let it end in {PAGES[0]}")
    check_free(options.html, overwrite=options.overwrite)
    with open_path(options.dataset) as opened:
        if not colour_and_depth_of(opened):
            raise StorageError("holds neither colour nor depth", file=opened.place)
        parts = chosen(opened, options)
        text = look_page(opened, parts, options.every)
        with made_beside(options.html) as made:
            made.write_text(text, encoding="utf-8")
    print(f"wrote {options.html}: {counted(len(parts), 'sequence')}, {len(text) / 1e6:.1f} MB; any browser opens it")
    return 0


def _record(opened: "Opened", parts: dict[str, list[int]], every: int, out: Path | None) -> None:
    """Send the sequences to a file, or to a viewer that is opened. Raises NoisyWorldError where there is none."""
    import rerun

    from .frame_views import Recorder, blueprint

    stream = rerun.RecordingStream("noisy_world")
    stream.send_recording_name(opened.place.rstrip("/").rsplit("/", 1)[-1])
    plan = blueprint(opened, list(parts))
    try:
        if out is None:
            stream.spawn(default_blueprint=plan)
        else:
            stream.save(out, default_blueprint=plan)
        try:
            for name, numbers in parts.items():
                for note in Recorder(stream, opened, name).record(numbers, every):
                    say(f"{name}: {note}")
        finally:
            stream.flush()
            stream.disconnect()
    except RuntimeError as error:  # Rerun's own
        problem = (str(error).strip() or "no answer").splitlines()[0]
        doing = "open its viewer" if out is None else f"write {out.name}"
        raise NoisyWorldError(f"Rerun cannot {doing}: {problem}", remedy="mend that" + ELSE * (out is None)) from error


def _prepare_viewer() -> None:
    """Raise NoisyWorldError where no window can be opened; let Rerun find the viewer that pip put beside this Python.

    Rerun looks it up in PATH, where it is only while the Python's environment is activated.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise NoisyWorldError("the viewer needs a display, and there is none here", remedy=f"set DISPLAY{ELSE}")
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])


VIEW = Command(
    name="view",
    order=70,
    group="look at what there is",
    help="open a dataset's images, paths, IMU and perturbations in Rerun's viewer, or write a page",
    description="Open Rerun's viewer with sequences of a dataset: colour and depth, true and planned paths, the "
    "rig's frames, the IMU's samples, and what was done to which frame. With --html write one page for any browser.",
    options=_view_options,
    run=_view,
    needs=("numpy", "cv2"),
    stopped="nothing was written",
)

COMMAND = VIEW, VIDEO
