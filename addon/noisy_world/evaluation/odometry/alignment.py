# SPDX-License-Identifier: GPL-3.0-or-later
"""Two views of a scene brought over each other by OpenCV's RGB-D odometry: the rigid motion between them.

What holds for OpenCV 5.0 and is nowhere in its documentation: counts of iterations are taken from the first column of a
square matrix; frames have to be prepared; no first guess can be given.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import Intrinsics, invert_pose
from .frames import Depth, Grey

if TYPE_CHECKING:
    import cv2

Float64: TypeAlias = NDArray[np.float64]
By: TypeAlias = Literal["both", "depth", "colour"]
"""What brings two views over each other; by colour alone, depth still says where its points are."""

# Finest level first; chosen: half the time of OpenCV's own counts (7, 7, 7, 10), and found from twice as far, as it is
# the coarsest levels that bring views together. In a textured box of 160 x 120 pixels 1 of 27 motions over three frames
# is missed by 2 mm; with OpenCV's own 3 by 20 to 370 mm.
ITERATIONS = (3, 5, 10, 20)
COARSEST_PX = 40  # width of the coarsest level; 5 pixels there are a turn of some 8 degrees
FARTHEST_M = 50.0  # chosen: farther than 16-bit depth of any layout reaches
DEPTH_DIFFERENCE_M = 0.07  # OpenCV's own: points whose depths differ by more do not correspond
LARGEST_STEP_M = 1.0  # OpenCV refuses larger motions between two views; bounds of speed are the tracker's
LARGEST_TURN_DEG = 60.0
REFINEMENTS = 4  # at most; two are enough where the guess is within some pixels
SETTLED = 1e-3  # of a correction, its largest entry less the identity's: then there is no further one
TEXTURE = 10.0  # OpenCV's own: least gradient of grey, a pixel


@dataclass(frozen=True)
class RgbdView:
    """What is seen at one moment: grey (H, W), depth (H, W) in metres with NaN for void, and both as OpenCV needs."""

    grey: Grey
    depth_m: Depth
    prepared: "cv2.OdometryFrame"


class Aligner:
    """Finds the motion between two views of one camera."""

    def __init__(self, camera: Intrinsics, by: By = "both") -> None:
        import cv2

        self.camera = camera
        self._matrix = camera.matrix.astype(np.float32)
        levels = max(1, 1 + round(np.log2(max(1.0, camera.width_px / COARSEST_PX))))
        counts = [ITERATIONS[min(level, len(ITERATIONS) - 1)] for level in range(levels)]
        settings = cv2.OdometrySettings()
        settings.setCameraMatrix(self._matrix)
        settings.setIterCounts(_first_column(counts, np.int32))
        settings.setMinGradientMagnitudes(_first_column([TEXTURE] * levels, np.float32))
        settings.setMaxDepth(FARTHEST_M)
        settings.setMaxDepthDiff(DEPTH_DIFFERENCE_M)
        settings.setMaxTranslation(LARGEST_STEP_M)
        settings.setMaxRotation(LARGEST_TURN_DEG)
        settings.setNormalMethod(cv2.RgbdNormals_RGBD_NORMALS_METHOD_CROSS_PRODUCT)
        kinds = {"both": cv2.OdometryType_RGB_DEPTH, "depth": cv2.OdometryType_DEPTH, "colour": cv2.OdometryType_RGB}
        self._odometry = cv2.Odometry(kinds[by], settings, cv2.OdometryAlgoType_COMMON)

    def view(self, grey: Grey, depth_m: Depth) -> RgbdView:
        """Prepare a view: its pyramids, gradients and normals."""
        import cv2

        frame = cv2.OdometryFrame(depth_m, grey)
        self._odometry.prepareFrame(frame)
        return RgbdView(grey, depth_m, frame)

    def align(self, source: RgbdView, target: RgbdView) -> Float64 | None:
        """Return target_from_source (4, 4); None where OpenCV finds none."""
        found, motion = self._odometry.compute(source.prepared, target.prepared)
        if not found or not np.isfinite(motion).all():
            return None
        return np.asarray(motion, np.float64)

    def refined(self, source: RgbdView, target: RgbdView, guess: Float64) -> Float64 | None:
        """Return target_from_source near a guess of it, from however far apart the two were taken."""
        motion = guess
        for _ in range(REFINEMENTS):
            correction = self.align(self.seen_from(source, target, motion), target)
            if correction is None:
                return None
            motion = correction @ motion
            if np.abs(correction - np.eye(4)).max() < SETTLED:
                break
        return motion

    def seen_from(self, source: RgbdView, target: RgbdView, target_from_source: Float64) -> RgbdView:
        """Return the source as the target's camera would see it; void where the target is, or what it sees is outside.

        Each pixel of the target is looked up in the source by its own depth, between the source's pixels, so there are
        no holes, and at the true motion no rounding either. cv2.warpFrame is off by half a pixel.
        """
        import cv2

        camera = self.camera
        points = camera.ray_directions() * target.depth_m[..., None]
        back = invert_pose(target_from_source)
        x, y, z = np.moveaxis(points @ back[:3, :3].T + back[:3, 3], -1, 0)
        z = np.where(z > 0.0, z, np.nan)
        with np.errstate(invalid="ignore"):
            u = x / z * camera.fx_px + camera.cx_px
            v = y / z * camera.fy_px + camera.cy_px
        known = np.isfinite(u)
        u, v = (np.where(known, places, -2.0).astype(np.float32) for places in (u, v))
        grey = cv2.remap(source.grey, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        found_m = cv2.remap(
            source.depth_m, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(float("nan"),) * 4
        )
        forward = target_from_source
        across = [
            (places - centre) / focal
            for places, centre, focal in ((u, camera.cx_px, camera.fx_px), (v, camera.cy_px, camera.fy_px))
        ]
        depth_m = found_m * (forward[2, 0] * across[0] + forward[2, 1] * across[1] + forward[2, 2]) + forward[2, 3]
        depth_m = np.where(known & (depth_m > 0.0), depth_m, np.nan).astype(np.float32)
        return self.view(np.asarray(grey, np.uint8), depth_m)


def _first_column(values: list, kind: type) -> NDArray:
    """Return a square matrix with the values in each column, which is how OpenCV 5.0 reads a list of them."""
    return np.ascontiguousarray(np.repeat(np.array(values, kind)[:, None], len(values), axis=1))
