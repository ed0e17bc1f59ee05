# SPDX-License-Identifier: GPL-3.0-or-later
"""Indicators of a sequence: what its images and its motion are like, measured without running a system on it."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.geometry import quat_wxyz_from_rotation, rotation_angle_rad
from ..dataset.loader import Frame, OpenedSequence
from ..dataset.opening import open_path

# What single images are like: colour, its features, and depth; without knowing how they were made.


Grey: TypeAlias = NDArray[np.uint8]
Depth: TypeAlias = NDArray[np.float32]

FEATURES = 500
"""ORB features that are looked for at most in a frame; OpenCV's other parameters are its defaults."""

NEAR_BITS = 50
"""Two descriptors of 256 bits are one feature's where at most so many differ, as ORB-SLAM's stricter threshold."""

# The difference of two Laplacians (Immerkaer 1996): 0 where an image is affine along rows or along columns; of
# independent noise of standard deviation s its response has 6 s.
_NOISE_KERNEL = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
_SIGMA_OF_MEDIAN = 1.4826022185056018 / 6.0  # of the median of absolute values, for normal noise


class Features(NamedTuple):
    """ORB features of a frame: (N, 256) float32 descriptors, a bit as -1 or 1."""

    signs: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.signs)


def grey_of(rgb: NDArray[np.uint8] | NDArray[np.float32]) -> Grey:
    """(H, W, 3) RGB, bytes -> (H, W): luma of ITU-R BT.601, as every feature-based system takes it."""
    import cv2

    assert rgb.dtype == np.uint8, "datasets of light, as EXR files hold it, are not evaluated"
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def brightness_of(grey: Grey) -> tuple[float, float]:
    """Return the mean and the standard deviation (contrast) of an image, of 255."""
    import cv2

    mean, deviation = cv2.meanStdDev(grey)
    return float(mean[0][0]), float(deviation[0][0])


def laplacian_variance(grey: Grey) -> float:
    """Return the variance of the Laplacian (Pech-Pacheco et al. 2000): small in a blurred image, large in noise."""
    import cv2

    _, deviation = cv2.meanStdDev(cv2.Laplacian(grey, cv2.CV_32F))
    return float(deviation[0][0]) ** 2


def image_noise(grey: Grey) -> float:
    """Return the standard deviation of an image's noise, of 255, by the median response to a noise kernel."""
    import cv2

    response = cv2.filter2D(grey, cv2.CV_32F, _NOISE_KERNEL)[1:-1, 1:-1]
    return _median(np.abs(response)) * _SIGMA_OF_MEDIAN if response.size else 0.0


def features_of(grey: Grey) -> Features:
    """Return an image's ORB features (Rublee et al. 2011)."""
    import cv2

    _, descriptors = cv2.ORB.create(nfeatures=FEATURES).detectAndCompute(grey, None)
    if descriptors is None:
        return Features(np.zeros((0, 256), dtype=np.float32))
    return Features(np.unpackbits(np.asarray(descriptors, dtype=np.uint8), axis=1).astype(np.float32) * 2.0 - 1.0)


def tracked_features(before: Features, after: Features) -> int:
    """Return how many features of a frame are found again: pairs nearest to each other, at most NEAR_BITS apart.

    Ties go to the feature that was found first.
    """
    if not len(before) or not len(after):
        return 0
    alike = before.signs @ after.signs.T  # 256 - 2 differing bits, whole numbers, exact in float32
    there, back = alike.argmax(axis=1), alike.argmax(axis=0)
    own = np.arange(len(before))
    return int(np.sum((back[there] == own) & (alike[own, there] >= 256.0 - 2.0 * NEAR_BITS)))


def rmse(grey: Grey, clean: Grey) -> float:
    """Return the root mean square difference of two images, of 255."""
    difference = grey.astype(np.float32) - clean.astype(np.float32)
    return float(np.sqrt(np.mean(difference * difference, dtype=np.float64)))


def ssim(grey: Grey, clean: Grey) -> float:
    """Return the structural similarity of two images (Wang et al. 2004): 11 x 11, sigma 1.5, K 0.01 and 0.03."""
    import cv2

    return float(cv2.quality.QualitySSIM.create(clean).compute(grey)[0])


def depth_missing(depth_m: Depth) -> float:
    """Return the share of pixels without depth."""
    return 1.0 - np.count_nonzero(depth_m > 0.0) / depth_m.size


def depth_noise_m(depth_m: Depth) -> float:
    """Return the standard deviation of depth's noise, metres, by the median over the pixels; NaN without depth.

    The inverse depth of a plane is affine in the pixel, so the noise kernel answers 0 on any plane; its response, times
    the square of the depth, is that of the depth's own noise. Pixels next to one without depth are left out.
    """
    import cv2

    known = depth_m > 0.0
    inverse = np.divide(1.0, depth_m, out=np.zeros_like(depth_m), where=known)
    response = np.abs(cv2.filter2D(inverse, cv2.CV_32F, _NOISE_KERNEL)) * depth_m * depth_m
    whole = cv2.erode(known.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    inside = response[whole.view(bool)]
    return _median(inside) * _SIGMA_OF_MEDIAN if inside.size else float("nan")


def depth_error_m(depth_m: Depth, clean_m: Depth) -> float:
    """Return the mean absolute difference of two depths, metres, over pixels where both are; NaN where none is."""
    both = (depth_m > 0.0) & (clean_m > 0.0)
    return float(np.mean(np.abs(depth_m[both] - clean_m[both]), dtype=np.float64)) if both.any() else float("nan")


def median_depth_m(depth_m: Depth) -> float:
    """Return the median of the depth, metres, over pixels that have one; NaN without."""
    known = depth_m[depth_m > 0.0]
    return _median(known) if known.size else float("nan")


def _median(values: NDArray[np.float32]) -> float:
    """Return the lower median of values, at least one: several times as fast as numpy's."""
    middle = (values.size - 1) // 2
    return float(np.partition(values, middle, axis=None)[middle])


# How fast a camera moves and turns, from its poses.


Float64: TypeAlias = NDArray[np.float64]

MOTION = ("speed_mps", "acceleration_mps2", "rotation_speed_degps", "rotation_acceleration_degps2")


def motion_of(c2w: ArrayLike, stamps_s: ArrayLike) -> dict[str, Float64]:
    """(N, 4, 4) c2w and (N,) stamps, increasing -> the columns MOTION, (N,) each.

    Speeds are those from the frame before to this one, NaN in the first; accelerations the change of the velocity
    around this frame, over the time from the middle of the step before to the middle of the step after, NaN in the
    first and the last. All are lengths of vectors, so they are not negative. The angular velocity is that of the
    constant rotation from pose to pose; between poses half a turn apart its direction, and so the acceleration there,
    is ambiguous.
    """
    c2w, stamps_s = np.asarray(c2w, dtype=np.float64), np.asarray(stamps_s, dtype=np.float64)
    count = len(stamps_s)
    step_s = np.diff(stamps_s)
    velocity = np.diff(c2w[:, :3, 3], axis=0) / step_s[:, None]
    rotation = c2w[:, :3, :3]
    turn_deg = np.degrees(rotation_angle_rad(rotation[:-1], rotation[1:]))
    angular = _axes(rotation) * (turn_deg / step_s)[:, None]
    between_s = ((step_s[1:] + step_s[:-1]) / 2.0)[:, None]
    columns = (
        (1, np.linalg.norm(velocity, axis=1)),
        (1, np.linalg.norm(np.diff(velocity, axis=0) / between_s, axis=1)),
        (1, turn_deg / step_s),
        (1, np.linalg.norm(np.diff(angular, axis=0) / between_s, axis=1)),
    )
    return {name: _placed(values, first, count) for name, (first, values) in zip(MOTION, columns, strict=True)}


def _axes(rotation: Float64) -> Float64:
    """(N, 3, 3) c2w -> (N - 1, 3): in the world, the unit axis of the turn from each to the next; 0 without a turn."""
    turns = rotation[1:] @ np.swapaxes(rotation[:-1], -1, -2)
    vector = quat_wxyz_from_rotation(turns)[:, 1:]
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    return np.divide(vector, length, out=np.zeros_like(vector), where=length > 0.0)


def _placed(values: Float64, first: int, count: int) -> Float64:
    """Return (count,) with values from place `first` on, NaN elsewhere."""
    column = np.full(count, np.nan)
    column[first : first + len(values)] = values
    return column


EVERY = 10
"""Images of every tenth frame are looked at, and of the one before it for its features: 4 ms a frame at 320 x 240."""

LEAST = 20
"""Of a short sequence more frames are looked at, so that there are as many as this, or all."""

IMAGES = (
    *("brightness", "contrast", "laplacian_variance", "image_noise", "orb_found", "orb_tracked"),
    *("depth_missing", "depth_median_m", "depth_noise_m"),
)
AGAINST_CLEAN = ("image_rmse", "psnr_db", "ssim", "depth_error_m")
INDICATORS = (*IMAGES, *AGAINST_CLEAN, *MOTION)

Column: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Indicators:
    """Indicators of a sequence.

    per_frame: by name, a row for each frame: index, stamp_s and INDICATORS; NaN where a frame was not looked at or has
    no value. values: of the sequence: frames, frames_looked_at, and of each indicator the mean, NAME_low and NAME_high
    (5 % and 95 % quantiles of its frames) under NAME_mean, ...; None without a value.
    """

    per_frame: dict[str, Column]
    values: dict[str, float | None]


def indicators_of(
    sequence: OpenedSequence | Path | str, clean: OpenedSequence | Path | str | None = None, *, every: int | None = None
) -> Indicators:
    """Return the indicators of a sequence: opened, or the folder of one in a layout.

    clean: the same scene without perturbations; a frame is compared with the clean frame that was seen from its pose
    (within a micrometre), so under motion deviations there are none. every: images of every so many frames are looked
    at, beginning with the first; None: EVERY, or fewer in a short sequence (LEAST).

    Raises InputError where a folder holds no sequence or several, or a file is damaged; ValueError for every < 1.
    """
    opened, counterpart = _opened(sequence), None if clean is None else _opened(clean)
    frames = list(opened)
    if every is None:
        every = max(1, min(EVERY, len(frames) // LEAST))
    if every < 1:
        raise ValueError(f"every is 1 or more, not {every}")
    columns = {name: np.full(len(frames), np.nan) for name in ("index", "stamp_s", *INDICATORS)}
    for place, values in _looked_at(frames, every, _CleanFrames(counterpart)):
        for name, value in values.items():
            columns[name][place] = value
    stamps_s = np.array([frame.stamp_s for frame in frames])
    columns["index"], columns["stamp_s"] = np.array([float(frame.index) for frame in frames]), stamps_s
    if frames:
        columns |= motion_of(np.stack([frame.c2w for frame in frames]), stamps_s)
    return Indicators(columns, _summary(columns))


def _summary(columns: dict[str, Column]) -> dict[str, float | None]:
    looked_at = int(np.sum(np.isfinite(columns["brightness"])))
    values: dict[str, float | None] = {"frames": len(columns["index"]), "frames_looked_at": looked_at}
    for name in INDICATORS:
        known = columns[name][np.isfinite(columns[name])]
        low, high = np.quantile(known, (0.05, 0.95)) if known.size else (None, None)
        values[f"{name}_mean"] = float(np.mean(known)) if known.size else None
        values[f"{name}_low"] = None if low is None else float(low)
        values[f"{name}_high"] = None if high is None else float(high)
    return values


def _looked_at(frames: list[Frame], every: int, clean: "_CleanFrames") -> Iterator[tuple[int, dict[str, float]]]:
    """Yield the places of the frames whose images are looked at, with what is found there."""
    kept: tuple[int, Features] | None = None
    for place in range(0, len(frames), every):
        frame = frames[place]
        grey, depth_m = grey_of(frame.rgb), frame.depth_m
        features = features_of(grey)
        values = _of_images(grey, depth_m, features) | clean.compared(frame, grey, depth_m)
        if place:
            before = kept[1] if kept and kept[0] == place - 1 else _features_of(frames[place - 1])
            values["orb_tracked"] = float(tracked_features(before, features))
        kept = (place, features)
        yield place, values


def _features_of(frame: Frame) -> Features:
    return features_of(grey_of(frame.rgb))


def _of_images(grey: Grey, depth_m: Depth, features: Features) -> dict[str, float]:
    brightness, contrast = brightness_of(grey)
    return {
        "brightness": brightness,
        "contrast": contrast,
        "laplacian_variance": laplacian_variance(grey),
        "image_noise": image_noise(grey),
        "orb_found": float(len(features)),
        "depth_missing": depth_missing(depth_m),
        "depth_median_m": median_depth_m(depth_m),
        "depth_noise_m": depth_noise_m(depth_m),
    }


class _CleanFrames:
    """The frames of a clean sequence by where they were seen from."""

    def __init__(self, clean: OpenedSequence | None) -> None:
        self._frames: dict[Any, Frame] = {} if clean is None else {_pose_key(frame): frame for frame in clean}

    def compared(self, frame: Frame, grey: Grey, depth_m: Depth) -> dict[str, float]:
        """Return what differs from the clean frame; nothing where there is none, or of another size."""
        clean = self._frames.get(_pose_key(frame))
        if clean is None:
            return {}
        clean_grey, clean_m = grey_of(clean.rgb), clean.depth_m
        if clean_grey.shape != grey.shape or clean_m.shape != depth_m.shape:
            return {}
        error = rmse(grey, clean_grey)
        return {
            "image_rmse": error,
            "psnr_db": 20.0 * float(np.log10(255.0 / error)) if error else float("nan"),
            "ssim": ssim(grey, clean_grey),
            "depth_error_m": depth_error_m(depth_m, clean_m),
        }


def _pose_key(frame: Frame) -> tuple[float, ...]:
    """Return the pose, rounded to micrometres and millionths; negative zeros as zeros."""
    return tuple((np.round(frame.c2w[:3].ravel(), 6) + 0.0).tolist())


def _opened(sequence: OpenedSequence | Path | str) -> OpenedSequence:
    if isinstance(sequence, OpenedSequence):
        return sequence
    opened = open_path(sequence)
    names = list(opened)
    if len(names) != 1:
        raise InputError(sequence, f"holds {len(names)} sequences", remedy="name the folder of one")
    return opened[names[0]]
