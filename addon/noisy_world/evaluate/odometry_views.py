# SPDX-License-Identifier: GPL-3.0-or-later
"""The views that rgbd_odometry works on: images at its size, depth smoothed, and two views brought over each other."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.file_access import read_bytes
from ..core.geometry import Intrinsics, invert_pose
from ..images.pixels import GREY_WEIGHTS_PER_MILLE
from .frame_index import FrameEntry, FrameIndex

if TYPE_CHECKING:
    import cv2


Grey: TypeAlias = NDArray[np.uint8]
Depth: TypeAlias = NDArray[np.float32]


def read_colour(entry: FrameEntry, camera: Intrinsics) -> NDArray[np.uint8]:
    """Read a frame's colour (H, W, 3), BGR as OpenCV has it; grey is in three equal channels.

    Raises InputError for an image that cannot be read, or where there is none.
    """
    import cv2

    if entry.colour is None:
        raise InputError(f"frame {entry.index}", "has no colour image", remedy="align by depth alone: --by depth")

    image = _read(Path(entry.colour), cv2.IMREAD_COLOR)
    _check_size(entry.colour, image, camera)
    return image.astype(np.uint8, copy=False)


def grey_of(bgr: NDArray[np.uint8]) -> Grey:
    """Return (H, W) grey of (H, W, 3) BGR, by the weights of BT.601."""
    import cv2

    assert GREY_WEIGHTS_PER_MILLE == (299, 587, 114)  # OpenCV's own
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY), np.uint8)


def read_depth(entry: FrameEntry, camera: Intrinsics, scale_per_m: float) -> Depth:
    """Read a frame's planar depth (H, W) in metres; NaN where it is void, which is everywhere without a depth image."""
    import cv2

    if entry.depth is None:
        return np.full((camera.height_px, camera.width_px), np.nan, np.float32)
    steps = _read(Path(entry.depth), cv2.IMREAD_UNCHANGED)
    if steps.ndim != 2:
        raise InputError(entry.depth, "is an image of several channels", remedy="a depth image has one")
    _check_size(entry.depth, steps, camera)
    depth_m = steps.astype(np.float32) / np.float32(scale_per_m)
    depth_m[~((depth_m > 0) & np.isfinite(depth_m))] = np.nan
    return depth_m


def _read(path: Path, flag: int) -> NDArray:
    """Decode an image. From memory, as OpenCV opens no file whose name Windows cannot spell in its code page."""
    import cv2

    try:
        data = read_bytes(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror}") from error
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flag) if data else None
    if image is None:
        raise InputError(path, "is no image that can be decoded")
    return image


def _check_size(path: str, image: NDArray, camera: Intrinsics) -> None:
    height, width = image.shape[:2]
    if (width, height) != (camera.width_px, camera.height_px):
        raise InputError(
            path,
            f"has {width} x {height} pixels, but the camera {camera.width_px} x {camera.height_px}",
            remedy="give the intrinsics of these images",
        )


# Smooths noisy depth, by as much as its noise was measured to be.


LITTLE_M = 0.005  # less noise than this is left alone; chosen: rounding to 16 bits is 0.1 mm, a real sensor's 1 to 5 mm
MEDIAN_PX = 5  # the largest that OpenCV has for float
REACH_PX = 3.0  # standard deviation of the bilateral filter; chosen among 0 to 4 on embedded rooms
OF_SECOND_DIFFERENCE = 1.4826 / np.sqrt(6.0)  # MAD of x - 2y + z to the standard deviation of x (normal distribution)


def depth_noise_m(depth_m: Depth) -> float:
    """Return the standard deviation of noise from pixel to pixel, in metres: robust, of second differences along rows.

    NaN is void; without three pixels in a row anywhere the noise is 0.
    """
    second = depth_m[::2, 2:] - 2.0 * depth_m[::2, 1:-1] + depth_m[::2, :-2]
    second = np.abs(second[np.isfinite(second)])
    return float(np.median(second) * OF_SECOND_DIFFERENCE) if len(second) else 0.0


def smoothed(depth_m: Depth) -> Depth:
    """Return depth with its noise averaged out, edges and voids kept; the same array where there is little noise."""
    import cv2

    noise_m = depth_noise_m(depth_m)
    if noise_m < LITTLE_M:
        return depth_m
    known = np.isfinite(depth_m)
    filled = np.where(known, depth_m, np.float32(0.0))
    middle = cv2.medianBlur(filled, MEDIAN_PX)
    out = np.asarray(cv2.bilateralFilter(middle, 0, noise_m, REACH_PX), np.float32)
    out[~known | (out <= 0.0)] = np.nan
    return out


# Two views of a scene brought over each other by OpenCV's RGB-D odometry: the rigid motion between them.
#
# What holds for OpenCV 5.0 and is nowhere in its documentation: counts of iterations are taken from the first column
# of a square matrix; frames have to be prepared; no first guess can be given.


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


# Images for the odometry: grey and depth in metres, scaled to a size that is fast.


T = TypeVar("T", bound=np.generic)


class Pictures:
    """Reads frames; images that are too wide are thinned out."""

    def __init__(self, index: FrameIndex, *, widest_px: int, smooth: bool, by: By = "both") -> None:
        self._index = index
        self._full = index.intrinsics
        self._smooth = smooth
        self._by = by
        self.step = max(1, -(-self._full.width_px // widest_px))
        self.camera = smaller(self._full, self.step)

    def read(self, entry: FrameEntry) -> tuple[Grey, Depth]:
        """Read a frame: grey (H, W), uniform where depth alone counts, and depth (H, W) in metres, NaN where void."""
        import cv2

        grey = self._grey(entry)
        depth_m = read_depth(entry, self._full, self._index.depth_scale_per_m)
        if self.step > 1:  # of both the same pixels are taken: depth is not averaged, or surfaces would appear between
            grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), self.step / 2.0), np.uint8)
            grey, depth_m = self._thinned(grey), self._thinned(depth_m)
        return grey, smoothed(depth_m) if self._smooth else depth_m

    def _grey(self, entry: FrameEntry) -> Grey:
        if self._by == "depth":
            return np.zeros((self._full.height_px, self._full.width_px), np.uint8)
        return grey_of(read_colour(entry, self._full))

    def _thinned(self, image: NDArray[T]) -> NDArray[T]:
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
