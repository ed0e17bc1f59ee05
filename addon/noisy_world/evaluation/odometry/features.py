# SPDX-License-Identifier: GPL-3.0-or-later
"""Relocalisation by ORB features: a view's pose relative to an earlier one, without an initial guess."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics, pose
from .alignment import RgbdView

if TYPE_CHECKING:
    import cv2

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
