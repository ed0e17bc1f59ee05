# SPDX-License-Identifier: GPL-3.0-or-later
"""One run of rgbd_odometry: frames in, an estimate of the camera's path out."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from ...core.extras import install_command, unavailable
from ...core.progress import Progress
from .agreement import Agreement
from .alignment import Aligner, By
from .frames import FrameIndex
from .loops import find_loops
from .pictures import Pictures
from .places import Places
from .pose_graph import can_optimise, optimised
from .tracking import State, Tracker, believed
from .tracking_history import Result, TrackingHistory

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
            found = places.found(view, lambda seen: believed(seen, tracker.bounds))
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
