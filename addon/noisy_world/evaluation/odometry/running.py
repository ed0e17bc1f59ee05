# SPDX-License-Identifier: GPL-3.0-or-later
"""One run of rgbd_odometry: frames in, an estimate of the camera's path out."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics
from ...core.progress import Progress
from .agreement import NONE
from .alignment import Aligner
from .frames import FrameEntry, FrameIndex, Grey, grey_of, read_colour, read_depth
from .smoothing import smoothed
from .tracking import State, Tracked, Tracker
from .written import FrameResult

type Float64 = NDArray[np.float64]

WIDEST_PX = 640  # wider images are made smaller: chosen for time, as accuracy does not gain
SEED = 1  # of OpenCV's own random numbers


@dataclass(frozen=True)
class Options:
    """How to run. smooth: whether noisy depth is smoothed. widest_px: wider images are thinned out."""

    smooth: bool = True
    widest_px: int = WIDEST_PX


@dataclass(frozen=True)
class Result:
    """What came out: every frame's state and pose, and the keyframes. stopped: whether it ended before the last."""

    frames: tuple[FrameResult, ...]
    keyframes: tuple[FrameResult, ...]
    stopped: bool

    @property
    def summary(self) -> str:
        """Return a line on how it went."""
        known = sum(frame.c2w is not None for frame in self.frames)
        return f"{known} of {len(self.frames)} frames tracked, {len(self.keyframes)} keyframes"


class Pictures:
    """The images of a sequence as the odometry wants them: grey and depth in metres, of a size that is fast."""

    def __init__(self, index: FrameIndex, options: Options) -> None:
        self._index = index
        self._full = index.intrinsics
        self._options = options
        self.step = max(1, -(-self._full.width_px // options.widest_px))
        self.camera = smaller(self._full, self.step)

    def read(self, entry: FrameEntry) -> tuple[Grey, NDArray[np.float32]]:
        """Read a frame: grey (H, W) and depth (H, W) in metres, NaN where void."""
        import cv2

        grey = grey_of(read_colour(entry, self._full))
        depth_m = read_depth(entry, self._full, self._index.depth_scale_per_m)
        if self.step > 1:  # of both the same pixels are taken: depth is not averaged, or surfaces would appear between
            grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), self.step / 2.0), np.uint8)
            grey, depth_m = (self._thinned(image) for image in (grey, depth_m))
        return grey, smoothed(depth_m) if self._options.smooth else depth_m

    def _thinned[T: np.generic](self, image: NDArray[T]) -> NDArray[T]:
        first = self.step // 2
        thinned = image[first :: self.step, first :: self.step]
        return np.ascontiguousarray(thinned[: self.camera.height_px, : self.camera.width_px])


def smaller(camera: Intrinsics, step: int) -> Intrinsics:
    """Return the camera of an image of every `step`-th pixel, the first being the (step // 2)-th."""
    first = step // 2
    return Intrinsics(
        max(1, (camera.width_px - first + step - 1) // step),
        max(1, (camera.height_px - first + step - 1) // step),
        camera.fx_px / step,
        camera.fy_px / step,
        (camera.cx_px - first) / step,
        (camera.cy_px - first) / step,
    )


@dataclass(frozen=True)
class Edge:
    """A measured place of a keyframe in another one: first_from_second (4, 4)."""

    first: int
    second: int
    first_from_second: Float64


class Story:
    """What became of the frames so far, and the keyframes with their places in one another."""

    def __init__(self) -> None:
        self.frames: list[tuple[FrameEntry, Tracked]] = []
        self.keyframes: list[FrameEntry] = []
        self.edges: list[Edge] = []

    def add(self, entry: FrameEntry, tracked: Tracked) -> None:
        """Take in the next frame. A first keyframe that no frame could be aligned with is given up for a new one."""
        place = tracked.keyframe_from_camera
        if place is not None and tracked.new_keyframe:
            if tracked.begins:
                nothing = Tracked(State.NOT_INITIALISED, -1, None, NONE)
                self.frames = [(earlier, nothing) for earlier, _ in self.frames]
                self.keyframes = []
            else:
                self.edges.append(Edge(tracked.keyframe, len(self.keyframes), place))
                tracked = replace(tracked, keyframe=len(self.keyframes), keyframe_from_camera=np.eye(4))
            self.keyframes.append(entry)
        self.frames.append((entry, tracked))

    def chained(self) -> list[Float64]:
        """Return each keyframe's c2w by the edge that it was made with; the first is at the origin."""
        places = [np.eye(4)] if self.keyframes else []
        places.extend(places[edge.first] @ edge.first_from_second for edge in self.edges)
        return places

    def result(self, places: list[Float64] | None = None, *, stopped: bool = False) -> "Result":
        """Return every frame's pose. places: the keyframes' c2w, by default as they were chained."""
        places = self.chained() if places is None else places
        frames: list[FrameResult] = []
        for entry, tracked in self.frames:
            place = tracked.keyframe_from_camera
            c2w = None if place is None else places[tracked.keyframe] @ place
            frames.append(
                FrameResult(entry.index, entry.stamp_s, tracked.state, tracked.keyframe, tracked.agreement, c2w)
            )
        indices = {entry.index for entry in self.keyframes}
        return Result(tuple(frames), tuple(frame for frame in frames if frame.index in indices), stopped)


def run(
    index: FrameIndex,
    options: Options | None = None,
    *,
    progress: Progress | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Result:
    """Follow the camera through all frames. The same frames give the same result, bit by bit.

    Raises InputError for an image that cannot be read or has another size than the camera.
    """
    options = options or Options()
    with _repeatable():
        pictures = Pictures(index, options)
        tracker = Tracker(Aligner(pictures.camera))
        story = Story()
        if progress:
            progress.start("tracking", len(index.frames))
        for entry in index.frames:
            if stopped():
                break
            view = tracker.aligner.view(*pictures.read(entry))
            story.add(entry, tracker.track(view, entry.stamp_s))
            if progress:
                progress.advance()
        if progress:
            progress.finish()
    return story.result(stopped=len(story.frames) < len(index.frames))


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
