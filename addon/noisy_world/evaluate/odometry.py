# SPDX-License-Identifier: GPL-3.0-or-later
"""rgbd_odometry: the SLAM system that comes with Noisy World, of OpenCV's RGB-D odometry with keyframes.

It is given frames, never the true poses, and says of each frame whether it knows where it was.
"""

import argparse
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TextIO, get_args

import numpy as np
from numpy.typing import NDArray

from ..core.dependencies import install_command, missing_packages, missing_sentence, unavailable
from ..core.errors import INTERRUPTED, NoisyWorldError
from ..core.geometry import Intrinsics
from ..core.progress import Progress
from ..scenes.ply_writer import write_ply
from ..scenes.polygon_mesh import Mesh
from .frame_index import FrameEntry, FrameIndex
from .frame_tracking import Agreement, FrameResult, Result, State, Tracker, TrackingHistory, believed
from .loop_closure import Places, can_optimise, find_loops, optimised
from .map_fusion import VOXEL_M, fuse
from .odometry_views import Aligner, By, Depth, Pictures, read_colour, read_depth, smoothed
from .run_files import MAP

if TYPE_CHECKING:
    from .frame_index import FrameIndex
    from .frame_tracking import Result


# One run of rgbd_odometry: frames in, an estimate of the camera's path out.


WIDEST_PX = 640  # wider images are made smaller: chosen for time, as accuracy does not gain
SEED = 1  # of OpenCV's own random numbers
NO_LOOPS = "loops are not closed, as gtsam is missing, a Python package of the extra evaluate"


@dataclass(frozen=True)
class Options:
    """How to run. smooth: whether noisy depth is smoothed. loops: whether loops are closed, which needs gtsam.

    widest_px: wider images are thinned out. by: what brings views over each other.
    """

    smooth: bool = True
    loops: bool = True
    widest_px: int = WIDEST_PX
    by: By = "both"


def run(
    index: FrameIndex,
    options: Options | None = None,
    *,
    progress: Progress | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Result:
    """Follow the camera through all frames. The same frames give the same result, bit by bit.

    Without gtsam loops are not closed, and the progress is told so. Raises InputError for an image that cannot be read
    or has another size than the camera.
    """
    options = options or Options()
    with _repeatable():
        pictures = Pictures(index, widest_px=options.widest_px, smooth=options.smooth, by=options.by)
        places = Places(Aligner(pictures.camera, options.by), pictures)
        history = _followed(index, pictures, places, progress, stopped)
        ended = len(history.frames) == len(index.frames)
        if not (ended and options.loops and history.keyframes):
            return history.result(stopped=not ended)
        if not can_optimise():
            if progress:
                where = unavailable("gtsam")
                remedy = f"no package brings it to {where}" if where else f"run: {install_command('evaluate')}"
                progress.note(f"{NO_LOOPS}; {remedy}")
            return history.result()
        c2w = history.chained()
        loops = find_loops(places, c2w, _usual(history), stopped=stopped)
        return history.result(optimised(c2w, history.edges, loops) if loops else c2w, loops=len(loops))


def _followed(
    index: FrameIndex, pictures: Pictures, places: Places, progress: Progress | None, stopped: Callable[[], bool]
) -> TrackingHistory:
    """Track frame after frame; a frame that is lost is looked for among all keyframes."""
    tracker, history = Tracker(places.aligner), TrackingHistory()
    if progress:
        progress.start("tracking", len(index.frames))
    for entry in index.frames:
        if stopped():
            break
        view = places.aligner.view(*pictures.read(entry))
        tracked = tracker.track(view, entry.stamp_s)
        if tracked.state is State.LOST:
            found = places.relocated(view, lambda seen: believed(seen, tracker.bounds))
            if found is not None:
                tracked = tracker.resume(view, entry.stamp_s, *found)
        if tracked.begins:
            places.forget()
        if tracked.new_keyframe:
            places.remember(entry, view)
        history.add(entry, tracked)
        if progress:
            progress.advance()
    if progress:
        progress.finish()
    return history


def _usual(history: TrackingHistory) -> Agreement:
    """Return how well tracked views agree: the median of each number."""
    seen = [tracked.agreement for _, tracked in history.frames if tracked.keyframe_from_camera is not None]
    numbers = np.array([(a.overlap, a.seen, a.depth, a.grey, a.moved, a.error) for a in seen])
    return Agreement(*np.median(numbers, axis=0).tolist())


@contextmanager
def _repeatable() -> Iterator[None]:
    """Let OpenCV calculate in one thread, with random numbers from a seed; the threads are given back afterwards."""
    import cv2

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    cv2.setRNGSeed(SEED)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


# The map of a run: the keyframes' colour and depth, fused along their poses.


@dataclass(frozen=True)
class MapFrame:
    """A keyframe as a map is fused from: its images are read when they are asked for."""

    entry: FrameEntry
    camera: Intrinsics
    scale_per_m: float
    smooth: bool

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), RGB."""
        return np.ascontiguousarray(read_colour(self.entry, self.camera)[..., ::-1])

    @property
    def depth_m(self) -> Depth:
        """Depth (H, W) in metres, 0 where void, smoothed as it is for tracking."""
        depth_m = read_depth(self.entry, self.camera, self.scale_per_m)
        return np.nan_to_num(smoothed(depth_m) if self.smooth else depth_m)


def fused_map(
    index: FrameIndex,
    keyframes: Sequence[FrameResult],
    *,
    smooth: bool = True,
    voxel_m: float = VOXEL_M,
    stopped: Callable[[], bool] = lambda: False,
) -> Mesh | None:
    """Return the surface that the keyframes saw, None where they saw nothing."""
    entries = {entry.index: entry for entry in index.frames}
    camera = index.intrinsics
    kept = [frame for frame in keyframes if frame.c2w is not None]

    def frames() -> Iterator[MapFrame]:
        for frame in kept:
            yield MapFrame(entries[frame.index], camera, index.depth_scale_per_m, smooth)

    return fuse(frames(), [frame.c2w for frame in kept], camera, voxel_m=voxel_m, stopped=stopped).mesh


def write_map(folder: Path, mesh: Mesh) -> None:
    """Write the map into a run's folder. Raises StorageError where that cannot be."""
    write_ply(folder / MAP, mesh, triangulate=True)


# `python -m noisy_world.evaluate.odometry FRAMES OUT`: rgbd_odometry as a system is run.


NAME = "rgbd_odometry"
NEEDED = ("numpy", "cv2")


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    options = _parser().parse_args(arguments)
    if missing := missing_packages(NEEDED):
        _say(sys.stderr, missing_sentence(missing, "", "install them with pip"))
        return 1
    from ..core.progress import PlainProgress
    from .frame_index import read_index
    from .frame_tracking import write_results

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
