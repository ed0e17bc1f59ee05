# SPDX-License-Identifier: GPL-3.0-or-later
"""Loop closure: keyframes found again by ORB features, loops between them, and the poses that fit all edges."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.dependencies import missing_packages, need
from ..core.geometry import Intrinsics, invert_pose, pose, rotation_angle_rad
from .frame_index import FrameEntry
from .frame_tracking import Agreement, Edge, agreement
from .odometry_views import Aligner, Pictures, RgbdView

if TYPE_CHECKING:
    import cv2


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
        found, descriptors = self._orb.detectAndCompute(view.grey, None)
        if not found or descriptors is None:
            return Landmarks(np.zeros((0, 2), np.float32), np.zeros((0, 3)), np.zeros((0, 32), np.uint8))
        pixels = np.array([feature.pt for feature in found], np.float32)
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
        found, turn, shift, inliers = cv2.solvePnPRansac(
            source.points_m[of_source][known],
            target.pixels[of_target][known].astype(np.float64),
            self._camera.matrix,
            None,
            iterationsCount=RANSAC_ROUNDS,
            reprojectionError=max(1.0, ERROR_PX_SHARE * self._camera.width_px),
            flags=cv2.SOLVEPNP_AP3P,
        )
        if not found or inliers is None or len(inliers) < FEWEST or not np.isfinite(shift).all():
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
    found = gtsam.LevenbergMarquardtOptimizer(graph, first).optimize()
    return [np.asarray(found.atPose3(number).matrix(), np.float64) for number in range(len(c2w))]


def _median_gap(c2w: Sequence[Float64], loops: Sequence[Edge]) -> float:
    """Return how far loops are from closing, in sigmas of theirs: the median."""
    gaps = []
    for loop in loops:
        gap = invert_pose(loop.first_from_second) @ invert_pose(c2w[loop.first]) @ c2w[loop.second]
        turn = float(rotation_angle_rad(gap[:3, :3], np.eye(3)))
        gaps.append(np.hypot(turn, np.linalg.norm(gap[:3, 3])) / (LOOP_SIGMA * UNIT))
    return float(np.median(gaps)) if gaps else 0.0
