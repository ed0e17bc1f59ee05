# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m noisy_world.evaluation.odometry FRAMES OUT`: rgbd_odometry as a system is run."""

import argparse
import signal
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, TextIO, get_args

from ...core.errors import NoisyWorldError
from ...core.exit_statuses import INTERRUPTED
from ...core.requirements import missing_packages, missing_sentence
from .alignment import By

if TYPE_CHECKING:
    from .frames import FrameIndex
    from .tracking_history import Result

NAME = "rgbd_odometry"
NEEDED = ("numpy", "cv2")


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    options = _parser().parse_args(arguments)
    if missing := missing_packages(NEEDED):
        _say(sys.stderr, missing_sentence(missing, "", "install them with pip"))
        return 1
    from ...core.progress import PlainProgress
    from .frames import read_index
    from .running import Options, run
    from .written import write_results

    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        wanted = Options(options.smooth, options.loops, options.widest, options.by)
        progress = PlainProgress(sys.stderr)
        index = read_index(options.frames)
        result = run(index, wanted, progress=progress, stopped=stop.is_set)
        write_results(options.out, result.frames, result.keyframes)
        if options.map and not result.stopped:
            _map(index, result, options, stop)
    except NoisyWorldError as error:
        _say(sys.stderr, str(error))
        return 1
    _say(sys.stdout, result.summary)
    return INTERRUPTED if result.stopped else 0


def _map(index: "FrameIndex", result: "Result", options: argparse.Namespace, stop: threading.Event) -> None:
    from .mapping import MAP, fused_map, write_map

    mesh = fused_map(index, result.keyframes, smooth=options.smooth, stopped=stop.is_set)
    if mesh is None:
        _say(sys.stderr, f"there is no {MAP}, as the keyframes saw nothing")
    elif not stop.is_set():
        write_map(options.out, mesh)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=NAME,
        description="Follow an RGB-D camera through a sequence: OpenCV's odometry with keyframes, and "
        "loops that gtsam closes. Writes estimate.txt, frames.csv and keyframes.txt.",
    )
    parser.add_argument("frames", metavar="FRAMES", type=Path, help="JSON index of the frames and their camera")
    parser.add_argument("out", metavar="OUT", type=Path, help="folder for what is found")
    parser.add_argument(
        "--no-smoothing", dest="smooth", action="store_false", help="take depth as it is, however noisy"
    )
    parser.add_argument("--no-loops", dest="loops", action="store_false", help="do not close loops, which needs gtsam")
    parser.add_argument("--map", action="store_true", help="fuse the keyframes into map.ply, too")
    parser.add_argument(
        "--by",
        choices=get_args(By),
        default="both",
        help="what brings views over each other: colour and depth (both, the default), depth alone, which needs no "
        "colour, or colour alone, where depth only says how far points are",
    )
    parser.add_argument(
        "--widest", metavar="PX", type=_pixels, default=640, help="make images smaller that are wider (default: 640)"
    )
    return parser


def _say(stream: TextIO, text: str) -> None:
    stream.write(f"{NAME}: {text}\n")


def _pixels(text: str) -> int:
    if not text.isdecimal() or int(text) < 16:
        raise argparse.ArgumentTypeError("has to be a whole number of pixels, at least 16")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
