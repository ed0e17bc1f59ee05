# SPDX-License-Identifier: GPL-3.0-or-later
"""`view`: what a dataset holds, in Rerun's viewer or as a recording for it."""

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from .arguments import positive
from .command import Command
from .entry import Entry, say
from .parser import Parser
from .places import out_path, place
from .video_command import add_part, check_free, chosen

if TYPE_CHECKING:
    from ..recipes.opened import Opened

RECORDING = ".rrd"
ELSE = ", or write a recording by --save FILE.rrd, to open where there is one"


def _view_options(parser: Parser) -> None:
    parser.add_argument(
        "dataset", metavar="DATASET", type=place, help="a dataset, a packed one, a sequence or a recipe"
    )
    add_part(parser)
    parser.add_argument("--every", metavar="N", type=positive, default=1, help="images of every n-th frame alone")
    instead = "write a recording instead of opening the viewer"
    parser.add_argument("--save", metavar="FILE.rrd", type=out_path, help=instead)


def _view(options: argparse.Namespace, _: Entry) -> int:
    """Open the viewer, or write the recording beside its place and move it there when it is whole."""
    from ..core.datasets.storage import made_beside
    from ..core.errors import StorageError
    from ..core.extras import need
    from ..recipes.opening import open_path

    need(("rerun",), "view")
    if options.save is None:
        _prepare_viewer()
    else:
        if options.save.suffix.lower() != RECORDING:
            raise StorageError("is no name of a recording", file=options.save, remedy=f"let it end in {RECORDING}")
        check_free(options.save, overwrite=options.overwrite)
    with open_path(options.dataset) as opened:
        parts = chosen(opened, options)
        if options.save is None:
            _record(opened, parts, options.every, None)
            print("opened the viewer")
            return 0
        with made_beside(options.save) as made:
            _record(opened, parts, options.every, made)
            size = made.stat().st_size
    print(f"wrote {options.save}: {', '.join(parts)}, {size / 1e6:.1f} MB; 'rerun {options.save}' opens it")
    return 0


def _record(opened: "Opened", parts: dict[str, list[int]], every: int, out: Path | None) -> None:
    """Send the sequences to a file, or to a viewer that is opened. Raises NoisyWorldError where there is none."""
    import rerun

    from ..core.errors import NoisyWorldError
    from .rerun_recording import Recorder, blueprint

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
    from ..core.errors import NoisyWorldError

    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise NoisyWorldError("the viewer needs a display, and there is none here", remedy=f"set DISPLAY{ELSE}")
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])


VIEW = Command(
    name="view",
    group="look at what there is",
    help="open a dataset's images, paths, IMU and perturbations in Rerun's viewer",
    description="Open Rerun's viewer with sequences of a dataset: colour and depth, true and planned paths, the "
    "rig's frames, the IMU's samples, and what was done to which frame.",
    options=_view_options,
    run=_view,
    needs=("numpy", "cv2"),
    stopped="nothing was written",
)
