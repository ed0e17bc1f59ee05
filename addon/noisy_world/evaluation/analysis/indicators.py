# SPDX-License-Identifier: GPL-3.0-or-later
"""Indicators of a sequence: what its images and its motion are like, measured without running a system on it."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...recipes.opened import Frame, OpenedSequence
from ...recipes.opening import open_path
from . import picture
from .motion import MOTION, motion_of

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
    for place, found in _looked_at(frames, every, _CleanFrames(counterpart)):
        for name, value in found.items():
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
    kept: tuple[int, picture.Features] | None = None
    for place in range(0, len(frames), every):
        frame = frames[place]
        grey, depth_m = picture.grey_of(frame.rgb), frame.depth_m
        features = picture.features_of(grey)
        found = _of_images(grey, depth_m, features) | clean.compared(frame, grey, depth_m)
        if place:
            before = kept[1] if kept and kept[0] == place - 1 else _features_of(frames[place - 1])
            found["orb_tracked"] = float(picture.tracked_features(before, features))
        kept = (place, features)
        yield place, found


def _features_of(frame: Frame) -> picture.Features:
    return picture.features_of(picture.grey_of(frame.rgb))


def _of_images(grey: picture.Grey, depth_m: picture.Depth, features: picture.Features) -> dict[str, float]:
    brightness, contrast = picture.brightness_of(grey)
    return {
        "brightness": brightness,
        "contrast": contrast,
        "laplacian_variance": picture.laplacian_variance(grey),
        "image_noise": picture.image_noise(grey),
        "orb_found": float(len(features)),
        "depth_missing": picture.depth_missing(depth_m),
        "depth_median_m": picture.median_depth_m(depth_m),
        "depth_noise_m": picture.depth_noise_m(depth_m),
    }


class _CleanFrames:
    """The frames of a clean sequence by where they were seen from."""

    def __init__(self, clean: OpenedSequence | None) -> None:
        self._frames: dict[Any, Frame] = {} if clean is None else {_pose_key(frame): frame for frame in clean}

    def compared(self, frame: Frame, grey: picture.Grey, depth_m: picture.Depth) -> dict[str, float]:
        """Return what differs from the clean frame; nothing where there is none, or of another size."""
        clean = self._frames.get(_pose_key(frame))
        if clean is None:
            return {}
        clean_grey, clean_m = picture.grey_of(clean.rgb), clean.depth_m
        if clean_grey.shape != grey.shape or clean_m.shape != depth_m.shape:
            return {}
        error = picture.rmse(grey, clean_grey)
        return {
            "image_rmse": error,
            "psnr_db": 20.0 * float(np.log10(255.0 / error)) if error else float("nan"),
            "ssim": picture.ssim(grey, clean_grey),
            "depth_error_m": picture.depth_error_m(depth_m, clean_m),
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
