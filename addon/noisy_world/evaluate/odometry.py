# SPDX-License-Identifier: GPL-3.0-or-later
"""rgbd_odometry: the SLAM system that comes with Noisy World, of OpenCV's RGB-D odometry with loop closure.

rgbd_odometry: the SLAM system that comes with Noisy World, of OpenCV's RGB-D odometry with keyframes.

It is given frames, never the true poses, and says of each frame whether it knows where it was.
"""

import argparse
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TextIO, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from ..core.errors import INTERRUPTED, NoisyWorldError
from ..core.geometry import Intrinsics, invert_pose, pose, rotation_angle_rad
from ..core.packages import install_command, missing_packages, missing_sentence, need, unavailable
from ..core.progress import Progress
from ..scenes.ply_writer import write_ply
from ..scenes.polygon_mesh import Mesh
from .cases import MAP
from .frame_tracking import (
    Agreement,
    Aligner,
    By,
    Depth,
    Edge,
    FrameResult,
    Pictures,
    Result,
    RgbdView,
    State,
    Tracker,
    TrackingHistory,
    agreement,
    believed,
    read_colour,
    read_depth,
    smoothed,
)
from .map_fusion import fuse
from .system_input import FrameEntry, FrameIndex

if TYPE_CHECKING:
    import cv2

    from .frame_tracking import Result
    from .system_input import FrameIndex


# Loop closure: keyframes found again by ORB features, loops between them, and the poses that fit all edges.


# Relocalisation by ORB features: a view's pose relative to an earlier one, without an initial guess.


Float64: TypeAlias = NDArray[np.float64]

FEATURES = 600  # a view; chosen: 4 ms at 320 x 240
FAST_THRESHOLD = 12  # OpenCV's 20 finds few corners in fog
RATIO = 0.8  # Lowe 2004: of the best match's distance to the second best's
FEWEST = 20  # inliers; chosen: by chance there are at most 8 among 600 in rooms that differ
RANSAC_ROUNDS = 300
ERROR_PX_SHARE = 0.006  # of the width: 2 px of 320


@dataclass(frozen=True)
class Landmarks:
    """A view's features: pixels (N, 2) float32, points (N, 3) in the camera's axes (NaN without depth), descriptors."""

    pixels: NDArray[np.float32]
    points_m: Float64
    descriptors: NDArray[np.uint8]


class Recogniser:
    """Finds the motion between views that may be far apart."""

    def __init__(self, camera: Intrinsics) -> None:
        import cv2

        self._camera = camera
        self._orb = cv2.ORB.create(FEATURES, fastThreshold=FAST_THRESHOLD)
        self._matcher = cv2.BFMatcher(cv2.NORM_HAMMING)

    def landmarks(self, view: RgbdView) -> Landmarks:
        """Find the features of a view."""
        keypoints, descriptors = self._orb.detectAndCompute(view.grey, None)
        if not keypoints or descriptors is None:
            return Landmarks(np.zeros((0, 2), np.float32), np.zeros((0, 3)), np.zeros((0, 32), np.uint8))
        pixels = np.array([feature.pt for feature in keypoints], np.float32)
        column, row = np.rint(pixels).astype(np.int64).T
        z = view.depth_m[row, column].astype(np.float64)
        camera = self._camera
        x, y = (pixels[:, 0] - camera.cx_px) / camera.fx_px * z, (pixels[:, 1] - camera.cy_px) / camera.fy_px * z
        return Landmarks(pixels, np.stack([x, y, z], axis=-1), np.asarray(descriptors, np.uint8))

    def motion(self, source: Landmarks, target: Landmarks) -> Float64 | None:
        """Return target_from_source (4, 4) by PnP and RANSAC; None where too few features tell the same."""
        import cv2

        if min(len(source.pixels), len(target.pixels)) < FEWEST:
            return None
        pairs = self._matcher.knnMatch(target.descriptors, source.descriptors, k=2)
        good = [(pair[0].trainIdx, pair[0].queryIdx) for pair in pairs if _distinct(pair)]
        of_source, of_target = np.array(good, np.int64).reshape(-1, 2).T
        known = np.isfinite(source.points_m[of_source, 2])
        if known.sum() < FEWEST:
            return None
        solved, turn, shift, inliers = cv2.solvePnPRansac(
            source.points_m[of_source][known],
            target.pixels[of_target][known].astype(np.float64),
            self._camera.matrix,
            None,
            iterationsCount=RANSAC_ROUNDS,
            reprojectionError=max(1.0, ERROR_PX_SHARE * self._camera.width_px),
            flags=cv2.SOLVEPNP_AP3P,
        )
        if not solved or inliers is None or len(inliers) < FEWEST or not np.isfinite(shift).all():
            return None
        return pose(np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(shift, np.float64)[:, 0])


def _distinct(pair: Sequence["cv2.DMatch"]) -> bool:
    return len(pair) == 2 and pair[0].distance < RATIO * pair[1].distance


# Place recognition: keyframes in which views are found again, after tracking was lost and for loops.


THUMBNAIL_PX = (16, 12)
ALIKE = 10  # keyframes that look most alike, which a lost view is compared with


class Places:
    """The keyframes so far: their features and a thumbnail each. Their images are read again when they are needed."""

    def __init__(self, aligner: Aligner, pictures: Pictures) -> None:
        self.aligner = aligner
        self._pictures = pictures
        self._recogniser = Recogniser(aligner.camera)
        self.entries: list[FrameEntry] = []
        self.landmarks: list[Landmarks] = []
        self._thumbnails: list[Float64] = []

    def forget(self) -> None:
        """Begin anew."""
        self.entries, self.landmarks, self._thumbnails = [], [], []

    def remember(self, entry: FrameEntry, view: RgbdView) -> None:
        """Take in the next keyframe."""
        self.entries.append(entry)
        self.landmarks.append(self._recogniser.landmarks(view))
        self._thumbnails.append(_thumbnail(view))

    def view(self, number: int) -> RgbdView:
        """Read a keyframe's images again."""
        return self.aligner.view(*self._pictures.read(self.entries[number]))

    def relocated(self, view: RgbdView, fits: Callable[[Agreement], bool]) -> tuple[int, Float64, Agreement] | None:
        """Return a keyframe that a lost view fits, the view's place in it (4, 4), and how well they agree."""
        landmarks = self._recogniser.landmarks(view)
        for number in self._alike(view):
            guess = self._recogniser.motion(self.landmarks[number], landmarks)
            if guess is None:
                continue
            placed = self.placed(self.view(number), view, guess, fits)
            if placed is not None:
                return number, *placed
        return None

    def recognised(self, source: int, target: int) -> Float64 | None:
        """Return target_from_source (4, 4) of two keyframes by their features, None where these do not tell."""
        return self._recogniser.motion(self.landmarks[source], self.landmarks[target])

    def placed(
        self, source: RgbdView, target: RgbdView, guess: Float64, fits: Callable[[Agreement], bool]
    ) -> tuple[Float64, Agreement] | None:
        """Return source_from_target (4, 4), found from a guess of its inverse, if the two views fit."""
        motion = self.aligner.refined(source, target, guess)
        if motion is None:
            return None
        seen = agreement(self.aligner.camera, source, target, motion)
        return (invert_pose(motion), seen) if fits(seen) else None

    def _alike(self, view: RgbdView) -> Iterable[int]:
        """Return the keyframes that look most like a view, by the correlation of their thumbnails, the best first."""
        if not self._thumbnails:
            return []
        likeness = np.stack(self._thumbnails) @ _thumbnail(view)
        return np.argsort(-likeness, kind="stable")[:ALIKE].tolist()


def _thumbnail(view: RgbdView) -> Float64:
    """Return a small picture as a vector of mean 0 and length 1 (0 if it is uniform)."""
    import cv2

    small = np.asarray(cv2.resize(view.grey, THUMBNAIL_PX, interpolation=cv2.INTER_AREA), np.float64).ravel()
    small -= small.mean()
    length = float(np.linalg.norm(small))
    return small / length if length > 0.0 else small


APART = 10  # keyframes between the two at least; nearer ones hang together anyway
NEAR_M, NEAR_DEG = 1.0, 40.0  # how near the two seem to be, before drift
DRIFT_SHARE = 0.02  # of the way between them: so much farther apart they may seem
TRIED = 2  # a keyframe


def find_loops(
    places: Places, c2w: Sequence[Float64], usual: Agreement, *, stopped: Callable[[], bool] = lambda: False
) -> list[Edge]:
    """Return loops: for each keyframe at most one other, long before it, that it fits as well as its neighbours do.

    c2w: the keyframes' poses as far as they are known. usual: how well neighbours agree.
    """
    loops: list[Edge] = []
    for target in range(APART, len(c2w)):
        if stopped():
            break
        loop = _loop(places, c2w, target, lambda seen: fits(seen, usual))
        if loop is not None:
            loops.append(loop)
    return loops


def fits(seen: Agreement, usual: Agreement) -> bool:
    """Tell whether two views agree about as well as neighbours do, so that noise is no reason to refuse a loop."""
    return (
        seen.overlap >= 0.4
        and seen.seen >= 0.3 * usual.seen
        and seen.depth >= usual.depth - 0.15
        and seen.grey >= usual.grey - 0.15
        and seen.error <= 3.0 * usual.error + 1e-3
    )


def _loop(places: Places, c2w: Sequence[Float64], target: int, good: Callable[[Agreement], bool]) -> Edge | None:
    candidates = near_keyframes(c2w, target)[:TRIED]
    if not candidates:
        return None
    view = places.view(target)
    for source in candidates:
        seen_by_features = places.recognised(source, target)
        by_path = invert_pose(c2w[target]) @ c2w[source]
        for guess in (by_path, seen_by_features):
            placed = None if guess is None else places.placed(places.view(source), view, guess, good)
            if placed is not None:
                return Edge(source, target, placed[0])
    return None


def near_keyframes(c2w: Sequence[Float64], target: int) -> list[int]:
    """Return earlier keyframes that seem near and look the same way, the nearest first."""
    poses = np.stack(c2w[: target + 1])
    steps_m = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    way_m = np.concatenate([np.cumsum(steps_m[::-1])[::-1], [0.0]])[: target - APART + 1]
    earlier = poses[: target - APART + 1]
    apart_m = np.linalg.norm(earlier[:, :3, 3] - poses[target, :3, 3], axis=1)
    apart_deg = np.degrees(rotation_angle_rad(earlier[:, :3, :3], poses[target, :3, :3]))
    near = (apart_m < NEAR_M + DRIFT_SHARE * way_m) & (apart_deg < NEAR_DEG)
    order = np.argsort(apart_m / NEAR_M + apart_deg / NEAR_DEG, kind="stable")
    return [int(number) for number in order if near[number]]


# The keyframes' poses that fit all measured edges best, by gtsam.


# Of an alignment's error, each axis; only the ratios count. Chosen: a radian does as much as a metre, as rooms are some
# metres large; loops are aligned from farther apart.
EDGE_SIGMA, LOOP_SIGMA, FIXED_SIGMA = 1.0, 2.0, 1e-3
UNIT = 1e-3  # a millimetre, a milliradian
# Where Cauchy's weight lets go of a loop: so many sigmas, or so many times the loops' median gap, which is the drift.
TOLERATED = 3.0


def can_optimise() -> bool:
    """Tell whether gtsam is installed."""
    return not missing_packages(["gtsam"])


def optimised(c2w: Sequence[Float64], edges: Sequence[Edge], loops: Sequence[Edge]) -> list[Float64]:
    """Return the keyframes' c2w, the first as it was. Raises MissingDependencyError without gtsam."""
    need(["gtsam"], "evaluate", for_what="closing loops")
    import gtsam

    plain = gtsam.noiseModel.Isotropic.Sigma(6, EDGE_SIGMA * UNIT)
    robust = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Cauchy.Create(TOLERATED * max(1.0, _median_gap(c2w, loops))),
        gtsam.noiseModel.Isotropic.Sigma(6, LOOP_SIGMA * UNIT),
    )
    graph, first = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(c2w[0]), gtsam.noiseModel.Isotropic.Sigma(6, FIXED_SIGMA * UNIT)))
    for number, pose_c2w in enumerate(c2w):
        first.insert(number, gtsam.Pose3(pose_c2w))
    for group, noise in ((edges, plain), (loops, robust)):
        for edge in group:
            graph.add(gtsam.BetweenFactorPose3(edge.first, edge.second, gtsam.Pose3(edge.first_from_second), noise))
    values = gtsam.LevenbergMarquardtOptimizer(graph, first).optimize()
    return [np.asarray(values.atPose3(number).matrix(), np.float64) for number in range(len(c2w))]


def _median_gap(c2w: Sequence[Float64], loops: Sequence[Edge]) -> float:
    """Return how far loops are from closing, in sigmas of theirs: the median."""
    gaps = []
    for loop in loops:
        gap = invert_pose(loop.first_from_second) @ invert_pose(c2w[loop.first]) @ c2w[loop.second]
        turn = float(rotation_angle_rad(gap[:3, :3], np.eye(3)))
        gaps.append(np.hypot(turn, np.linalg.norm(gap[:3, 3])) / (LOOP_SIGMA * UNIT))
    return float(np.median(gaps)) if gaps else 0.0


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
            relocation = places.relocated(view, lambda seen: believed(seen, tracker.bounds))
            if relocation is not None:
                tracked = tracker.resume(view, entry.stamp_s, *relocation)
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
    stopped: Callable[[], bool] = lambda: False,
) -> Mesh | None:
    """Return the surface that the keyframes saw, None where they saw nothing."""
    entries = {entry.index: entry for entry in index.frames}
    camera = index.intrinsics
    kept = [frame for frame in keyframes if frame.c2w is not None]

    def frames() -> Iterator[MapFrame]:
        for frame in kept:
            yield MapFrame(entries[frame.index], camera, index.depth_scale_per_m, smooth)

    return fuse(frames(), [frame.c2w for frame in kept], camera, stopped=stopped).mesh


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
    from .frame_tracking import write_results
    from .system_input import read_index

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
