# SPDX-License-Identifier: GPL-3.0-or-later
"""`view`: what a dataset holds, in Rerun's viewer or as a recording for it."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from .arguments import positive
from .ending import ended
from .entry import Entry, say
from .parser import Parser
from .places import path, place
from .video_command import add_part, check_free, chosen

if TYPE_CHECKING:
    from ..recipes.opened import Opened

RECORDING = ".rrd"


def main(arguments: list[str], entry: Entry) -> int:
    """Run the command line and return the exit status."""
    parser = Parser(
        prog=entry.name,
        description="Open Rerun's viewer with sequences of a dataset: colour and depth, true and planned paths, the "
        "rig's frames, the IMU's samples, and what was done to which frame.",
    )
    parser.add_argument(
        "dataset", metavar="DATASET", type=place, help="a dataset, a packed one, a sequence or a recipe"
    )
    add_part(parser)
    parser.add_argument("--every", metavar="N", type=positive, default=1, help="images of every n-th frame alone")
    parser.add_argument("--save", metavar="FILE.rrd", type=path, help="write a recording instead of opening the viewer")
    options = parser.parse_args(arguments)
    return ended(lambda: _view(options), entry, stopped="nothing was written", needs=["numpy", "cv2"])


def _view(options: argparse.Namespace) -> int:
    """Open the viewer, or write the recording beside its place and move it there when it is whole."""
    import tempfile

    from ..core.errors import StorageError
    from ..core.extras import need
    from ..recipes.opening import open_path

    need(("rerun",), "view")
    if options.save is not None:
        if options.save.suffix.lower() != RECORDING:
            raise StorageError("is no name of a recording", file=options.save, remedy=f"let it end in {RECORDING}")
        check_free(options.save, overwrite=options.overwrite)
    with open_path(options.dataset) as opened:
        parts = chosen(opened, options)
        if options.save is None:
            _record(opened, parts, options.every, None)
            print("opened the viewer")
            return 0
        options.save.absolute().parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=options.save.absolute().parent, prefix=".view-") as folder:
            made = Path(folder) / options.save.name
            _record(opened, parts, options.every, made)
            size = made.stat().st_size
            made.replace(options.save)
    print(f"wrote {options.save}: {', '.join(parts)}, {size / 1e6:.1f} MB; 'rerun {options.save}' opens it")
    return 0


def _record(opened: "Opened", parts: dict[str, list[int]], every: int, out: Path | None) -> None:
    """Send the sequences to a file, or to a viewer that is opened."""
    import rerun

    from .rerun_recording import Recorder, blueprint

    stream = rerun.RecordingStream("noisy_world")
    stream.send_recording_name(opened.place.rstrip("/").rsplit("/", 1)[-1])
    plan = blueprint(opened, list(parts))
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
