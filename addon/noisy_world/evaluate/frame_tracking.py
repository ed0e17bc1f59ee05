# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracking by rgbd_odometry: its views, the camera's pose frame after frame, and whether it is lost.

Tracking: the camera's pose frame after frame, and whether it is lost.

A frame is aligned with the keyframe, which does not drift. Where it does not fit as the frame before did, it is aligned
with the last frame, too, which hardly ever fails, and what fits the keyframe better is taken.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.atomic_files import storage_errors
from ..core.errors import InputError
from ..core.file_access import read_bytes
from ..core.geometry import Intrinsics, invert_pose, rotation_angle_rad
from ..images.pixels import GREY_WEIGHTS_PER_MILLE
from .cases import ESTIMATE, FRAMES, KEYFRAMES, estimate_text
from .estimates import Estimate
from .system_input import FrameEntry, FrameIndex

if TYPE_CHECKING:
    import cv2


# The views that rgbd_odometry works on: images at its size, depth smoothed, and two views brought over each other.


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
        converged, motion = self._odometry.compute(source.prepared, target.prepared)
        if not converged or not np.isfinite(motion).all():
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


# How well two views agree under an estimated motion between them, on a grid of pixels.
#
# OpenCV's odometry never admits to being lost: it returns the motion with the least error, however large that is.


ACROSS = 64  # points of the grid in a row; chosen: 3,000 points take half a millisecond
NEAR_M, NEAR_SHARE = 0.03, 0.02  # depths agree within 3 cm and 2 % of the depth


@dataclass(frozen=True)
class Agreement:
    """How well two views agree.

    overlap: share of the grid's pixels with depth in the target that are inside the source's image. seen: share of the
    grid's pixels that have depth in both.
    depth: share of these at whose place the source has the depth that is expected.
    grey: correlation of the grey values there, -1 to 1; 0 where one of them is uniform. moved: how far the points move
    in the image, their mean, as a share of its width. error: median difference of the depths, as a share of the depth.
    """

    overlap: float
    seen: float
    depth: float
    grey: float
    moved: float
    error: float


NONE = Agreement(0.0, 0.0, 0.0, 0.0, 1.0, np.inf)
WHOLE = Agreement(1.0, 1.0, 1.0, 1.0, 0.0, 0.0)  # of a view with itself


def agreement(camera: Intrinsics, source: RgbdView, target: RgbdView, target_from_source: Float64) -> Agreement:
    """Compare the target with what the source shows at the same places."""
    step = max(1, camera.width_px // ACROSS)
    rows = np.arange(step // 2, camera.height_px, step)
    columns = np.arange(step // 2, camera.width_px, step)
    depth_m = target.depth_m[np.ix_(rows, columns)].astype(np.float64)
    known = np.isfinite(depth_m)
    if not known.any():
        return NONE
    row, column = (np.broadcast_to(axis, known.shape)[known] for axis in (rows[:, None], columns[None, :]))
    z = depth_m[known]
    points = np.stack([(column - camera.cx_px) / camera.fx_px * z, (row - camera.cy_px) / camera.fy_px * z, z])
    source_from_target = invert_pose(target_from_source)
    x, y, expected_m = source_from_target[:3, :3] @ points + source_from_target[:3, 3:]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = x / expected_m * camera.fx_px + camera.cx_px
        v = y / expected_m * camera.fy_px + camera.cy_px
    inside = (expected_m > 0) & (u >= 0) & (u <= camera.width_px - 1) & (v >= 0) & (v <= camera.height_px - 1)
    if not inside.any():
        return NONE
    u, v, row, column, expected_m = u[inside], v[inside], row[inside], column[inside], expected_m[inside]
    found_m = _at(source.depth_m, u, v).astype(np.float64)
    both = np.isfinite(found_m)
    if not both.any():
        return NONE
    apart_m, expected_m = np.abs(found_m[both] - expected_m[both]), expected_m[both]
    return Agreement(
        float(inside.mean()),
        float(both.sum() / known.size),
        float((apart_m <= NEAR_M + NEAR_SHARE * expected_m).mean()),
        _correlation(_at(source.grey, u, v)[both], target.grey[row, column][both]),
        float(np.hypot(u - column, v - row).mean()) / camera.width_px,
        float(np.median(apart_m / expected_m)),
    )


def _at(image: NDArray, u: Float64, v: Float64) -> NDArray:
    """Return the image's values (N,) at pixels between the grid's, linearly interpolated; next to NaN they are NaN."""
    import cv2

    columns, rows = u.astype(np.float32)[None], v.astype(np.float32)[None]
    return np.asarray(cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))[0]


def _correlation(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """Return Pearson's correlation, 0 where there are few values or one of the sides is uniform."""
    if len(a) < 2:
        return 0.0
    of_a, of_b = a - a.mean(), b - b.mean()
    norm = float(np.sqrt((of_a * of_a).sum() * (of_b * of_b).sum()))
    return float((of_a * of_b).sum()) / norm if norm > 0.0 else 0.0


class State(StrEnum):
    """What is known of a frame."""

    TRACKED = "tracked"
    RELOCALISED = "relocalised"  # found again among the keyframes after frames that were lost
    LOST = "lost"
    NOT_INITIALISED = "not_initialised"  # no frame before it had enough depth to begin with


@dataclass(frozen=True)
class Bounds:
    """What is not believed. Chosen on embedded rooms, clean and perturbed; see docs/rgbd_odometry.md."""

    seen: float = 0.05  # share of pixels with depth, in both views: less is nothing to align
    overlap: float = 0.3  # share of these that are inside the other image
    depth: float = 0.4  # share of those whose depth is the expected one
    blind_depth: float = 0.8  # the same where the grey values do not support the motion
    clear_depth: float = 0.25  # the same where they clearly do
    clear_grey: float = 0.7
    grey: float = 0.2  # correlation from which grey values support a motion
    speed_m_s: float = 6.0  # a person runs
    turn_deg_s: float = 400.0  # a fast turn of a head
    worse_error: float = 0.1  # how much worse the keyframe's own alignment may fit than that by way of the last frame
    unusual_error: float = 0.3  # and than that of the frame before, or the last frame is asked, too
    least_error: float = 1e-4
    worse_grey: float = 0.02
    slip: float = 0.1  # fall of the share of agreeing depths from one frame to the next that asks for a second opinion
    fall: float = 0.2  # and that which is a loss
    clear: float = 0.05  # by how much a guess has to be better than what was aligned without one
    moved: float = 0.06  # mean motion in the image since the keyframe, of its width: then there is a new one
    kept: float = 0.75  # overlap with the keyframe: with less there is a new one


@dataclass(frozen=True)
class Tracked:
    """What became of a frame.

    keyframe: number of the keyframe that it hangs on, keyframe_from_camera (4, 4) its place there; None where it is
    lost. agreement: with the view it was aligned with. new_keyframe: whether it is the keyframe from now on. begins:
    whether nothing before it is known.
    """

    state: State
    keyframe: int
    keyframe_from_camera: Float64 | None
    agreement: Agreement
    new_keyframe: bool = False
    begins: bool = False


@dataclass(frozen=True)
class _Anchor:
    """A view whose place is known: of a frame, in coordinates of the keyframe."""

    view: RgbdView
    keyframe_from_camera: Float64
    stamp_s: float


_Found: TypeAlias = tuple[Float64, Agreement]  # a view's place in the keyframe's coordinates, and how well it fits


# How a view fits when nothing is known yet of how views fit.
ANYTHING = Agreement(0.0, 0.0, 0.0, -1.0, 0.0, np.inf)


class Tracker:
    """Follows the camera through the views of a sequence, in order of time."""

    def __init__(self, aligner: Aligner, bounds: Bounds | None = None) -> None:
        self.aligner = aligner
        self.bounds = bounds or Bounds()
        self.keyframes = 0  # how many there have been; the last one is their number less one
        self._keyframe: _Anchor | None = None
        self._last: _Anchor | None = None
        self._lost = False
        self._usual = ANYTHING
        self._step = np.eye(4)  # from the frame before the last to the last

    def track(self, view: RgbdView, stamp_s: float) -> Tracked:
        """Find the place of the next view."""
        if self._keyframe is None or self._last is None:
            return self._begin(view, stamp_s)
        direct = self._aligned(self._keyframe, view, stamp_s)
        if direct is not None and self._as_usual(direct[1]):
            return self._accept(view, stamp_s, *direct)
        motion_found, renew = self._second_opinion(direct, view, stamp_s)
        if motion_found is None or self._unlikely(motion_found[1]):
            return self._miss(view, stamp_s)
        return self._accept(view, stamp_s, *motion_found, renew=renew)

    def _second_opinion(self, direct: _Found | None, view: RgbdView, stamp_s: float) -> tuple[_Found | None, bool]:
        """Return where a view is that does not fit as usual, and whether it had better be the new keyframe.

        Asked are the alignment with the keyframe, that with the last frame, and where neither does, one that begins
        where the camera would be if it went on as it did.
        """
        assert self._keyframe is not None
        assert self._last is not None
        best, renew = direct, False
        if self._last is not self._keyframe:
            near = self._aligned(self._last, view, stamp_s)
            if near is not None:
                by_last = (near[0], self._compared(near[0], view))
                if direct is None or not self._no_worse(direct[1], by_last[1]):
                    best, renew = by_last, True
        if best is None or best[1].depth < self._usual.depth - self.bounds.slip:
            guessed = self._from_guess(view, stamp_s)
            if guessed is not None and (best is None or _score(guessed[1]) > _score(best[1]) + self.bounds.clear):
                return guessed, True
        return best, renew

    def _from_guess(self, view: RgbdView, stamp_s: float) -> _Found | None:
        """Return where a view is, from where it would be at the speed of the last frame."""
        assert self._keyframe is not None
        assert self._last is not None
        seconds = stamp_s - self._last.stamp_s
        guess = self._last.keyframe_from_camera @ self._step
        motion = self.aligner.refined(self._keyframe.view, view, invert_pose(guess))
        if motion is None or self._too_fast(motion @ self._last.keyframe_from_camera, seconds):
            return None
        seen = agreement(self.aligner.camera, self._keyframe.view, view, motion)
        return (invert_pose(motion), seen) if believed(seen, self.bounds) else None

    def resume(self, view: RgbdView, stamp_s: float, keyframe: int, place: Float64, seen: Agreement) -> Tracked:
        """Go on from a view that was found again at a place in an earlier keyframe; it is the keyframe from now on."""
        self._renew(view, stamp_s)
        self._lost, self._usual, self._step = False, seen, np.eye(4)
        return Tracked(State.RELOCALISED, keyframe, place, seen, new_keyframe=True)

    def _begin(self, view: RgbdView, stamp_s: float) -> Tracked:
        if float(np.isfinite(view.depth_m).mean()) < self.bounds.seen:
            return Tracked(State.NOT_INITIALISED, -1, None, NONE)
        self.keyframes = 0
        self._renew(view, stamp_s)
        self._usual = ANYTHING
        return Tracked(State.TRACKED, 0, np.eye(4), WHOLE, new_keyframe=True, begins=True)

    def _miss(self, view: RgbdView, stamp_s: float) -> Tracked:
        if self.keyframes == 1 and self._last is self._keyframe:  # nothing could ever be aligned with the first view
            return self._begin(view, stamp_s)
        self._lost = True
        return Tracked(State.LOST, self.keyframes - 1, None, NONE)

    def _accept(
        self, view: RgbdView, stamp_s: float, place: Float64, seen: Agreement, *, renew: bool = False
    ) -> Tracked:
        state = State.RELOCALISED if self._lost else State.TRACKED
        self._lost = False
        number = self.keyframes - 1
        renew = renew or seen.moved > self.bounds.moved or seen.overlap < self.bounds.kept
        if self._last is not None:
            self._step = invert_pose(self._last.keyframe_from_camera) @ place
        if renew:
            self._renew(view, stamp_s)
        else:
            self._last = _Anchor(view, place, stamp_s)
        self._usual = seen
        return Tracked(state, number, place, seen, renew)

    def _renew(self, view: RgbdView, stamp_s: float) -> None:
        self._keyframe = self._last = _Anchor(view, np.eye(4), stamp_s)
        self.keyframes += 1

    def _aligned(self, anchor: _Anchor, view: RgbdView, stamp_s: float) -> _Found | None:
        """Return the view's place in the keyframe's coordinates, by way of an anchor, if it can be believed."""
        motion = self.aligner.align(anchor.view, view)
        if motion is None or self._too_fast(motion, stamp_s - anchor.stamp_s):
            return None
        seen = agreement(self.aligner.camera, anchor.view, view, motion)
        if not believed(seen, self.bounds):
            return None
        return anchor.keyframe_from_camera @ invert_pose(motion), seen

    def _too_fast(self, motion: Float64, seconds: float) -> bool:
        """Tell whether nothing moves like this in so much time."""
        turn_deg = float(np.degrees(rotation_angle_rad(motion[:3, :3], np.eye(3))))
        step_m = float(np.linalg.norm(motion[:3, 3]))
        return step_m > self.bounds.speed_m_s * seconds or turn_deg > self.bounds.turn_deg_s * seconds

    def _unlikely(self, seen: Agreement) -> bool:
        """Tell whether a view fits so much worse than those before that its place is rather wrong."""
        bounds, usual = self.bounds, self._usual
        # While the camera is followed, a flash or fog may blind it; where it was lost, that is no way to find it again.
        blind = self._lost and seen.grey < bounds.grey <= usual.grey / 2.0
        return blind or seen.depth < usual.depth - bounds.fall

    def _as_usual(self, direct: Agreement) -> bool:
        """Tell whether a view fits the keyframe about as well as the view before it did."""
        bounds, usual = self.bounds, self._usual
        within = direct.error <= usual.error * (1.0 + bounds.unusual_error) + bounds.least_error
        as_deep = direct.depth >= usual.depth - bounds.slip
        return within and as_deep and direct.grey >= usual.grey - bounds.worse_grey

    def _compared(self, place: Float64, view: RgbdView) -> Agreement:
        assert self._keyframe is not None
        return agreement(self.aligner.camera, self._keyframe.view, view, invert_pose(place))

    def _no_worse(self, direct: Agreement, near: Agreement) -> bool:
        """Tell whether a view fits the keyframe where it was found directly as well as by way of the last frame."""
        bounds = self.bounds
        within = direct.error <= near.error * (1.0 + bounds.worse_error) + bounds.least_error
        return within and direct.grey >= near.grey - bounds.worse_grey


def believed(seen: Agreement, bounds: Bounds) -> bool:
    """Tell whether two views agree well enough for the motion between them to be believed."""
    if seen.seen < bounds.seen or seen.overlap < bounds.overlap:
        return False
    if seen.grey < bounds.grey:
        return seen.depth >= bounds.blind_depth
    return seen.depth >= (bounds.clear_depth if seen.grey >= bounds.clear_grey else bounds.depth)


def _score(seen: Agreement) -> float:
    return seen.depth + seen.grey


# The files that a run leaves: estimate.txt, frames.csv and keyframes.txt.


HEADER = "index,stamp_s,state,keyframe,overlap,seen,depth,grey"


@dataclass(frozen=True)
class FrameResult:
    """What is known of a frame in the end: c2w (4, 4), None where it was lost."""

    index: int
    stamp_s: float
    state: State
    keyframe: int
    agreement: Agreement
    c2w: NDArray[np.float64] | None


def frame_lines(frames: Sequence[FrameResult]) -> str:
    """Return a line a frame: its state, the keyframe that it hangs on, and how well it agreed with what was known."""
    lines = [HEADER]
    for frame in frames:
        seen = frame.agreement
        shares = ",".join(f"{share:.4f}" for share in (seen.overlap, seen.seen, seen.depth, seen.grey))
        keyframe = "" if frame.c2w is None else str(frame.keyframe)
        lines.append(f"{frame.index},{frame.stamp_s:.9f},{frame.state},{keyframe},{shares}")
    return "\n".join(lines) + "\n"


def write_results(folder: Path, frames: Sequence[FrameResult], keyframes: Sequence[FrameResult]) -> None:
    """Write the files of a run into its folder, which is made. Raises StorageError where that cannot be."""
    texts = {ESTIMATE: _poses_text(frames), FRAMES: frame_lines(frames), KEYFRAMES: _poses_text(keyframes)}
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8", newline="\n")


def _poses_text(frames: Sequence[FrameResult]) -> str:
    known = [frame for frame in frames if frame.c2w is not None]
    c2w = np.array([frame.c2w for frame in known]).reshape(-1, 4, 4)
    return estimate_text(Estimate(np.array([frame.stamp_s for frame in known]), c2w))


# The history of a run of the odometry: each frame's tracking state and pose, and the edges between keyframes.


@dataclass(frozen=True)
class Result:
    """What came out: every frame's state and pose, and the keyframes.

    loops: how many were closed. stopped: whether it ended before the last frame.
    """

    frames: tuple[FrameResult, ...]
    keyframes: tuple[FrameResult, ...]
    loops: int = 0
    stopped: bool = False

    @property
    def summary(self) -> str:
        """Return a line on how it went."""
        known = sum(frame.c2w is not None for frame in self.frames)
        return f"{known} of {len(self.frames)} frames tracked, {len(self.keyframes)} keyframes, {self.loops} loops"


@dataclass(frozen=True)
class Edge:
    """A measured place of a keyframe in another one: first_from_second (4, 4)."""

    first: int
    second: int
    first_from_second: Float64


class TrackingHistory:
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

    def result(self, places: list[Float64] | None = None, *, loops: int = 0, stopped: bool = False) -> Result:
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
        return Result(tuple(frames), tuple(frame for frame in frames if frame.index in indices), loops, stopped)
