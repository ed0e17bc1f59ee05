# SPDX-License-Identifier: GPL-3.0-or-later
"""What the embedded SLAM system made of a sequence: its path beside the true one, cut into pieces of one colour.

It does not use Blender, and loads the evaluation only when a path is read.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.layouts import find_sequence

if TYPE_CHECKING:
    from ..evaluation.metrics.score import Score

Float64: TypeAlias = NDArray[np.float64]
Part: TypeAlias = Literal["true", "lost", "near", "off", "far"]
"""A part of what is drawn: the true path, where the camera was lost on it, and the estimate by its error."""

NEAR_M, FAR_M = 0.01, 0.05  # errors below the first are near, above the second far; chosen: a good, and a useless map
BY_ERROR: tuple[Part, ...] = ("near", "off", "far")


@dataclass(frozen=True, eq=False)
class TrackedPath:
    """A sequence as it was tracked: its name, SETTING/SCENE, a sentence on it, and the pieces of each part (N, 3).

    Pieces are positions in metres in the dataset's world; one of a single position is a frame between lost ones.
    """

    name: str
    sentence: str
    pieces: Mapping[Part, list[Float64]]


def read_tracked(dataset: Path, found: Path, name: str) -> TrackedPath:
    """Compare what the tracker found of a sequence with its true path. Raises InputError for files that are damaged."""
    from ..evaluation.metrics.score import score_trajectory
    from ..evaluation.systems.estimate_file import ESTIMATE, read_estimate_file

    truth = find_sequence(dataset / name).trajectory
    score = score_trajectory(read_estimate_file(found / name / ESTIMATE), truth, frames_s=truth.stamps_s)
    frames = score.frame_errors
    return TrackedPath(
        name,
        f"{name.partition('/')[0]}: {spoken(score)}",
        true_pieces(truth.c2w[:, :3, 3], frames.tracked) | estimated_pieces(frames.position_m, frames.error_m),
    )


def spoken(score: "Score") -> str:
    """Return a score in a few words: its error, how much was tracked, and how often the camera was lost."""
    from ..evaluation.metrics.score import FAILURES

    tracked = f"{int(score.frame_errors.tracked.sum())} of {score.frames} frames tracked"
    error_m = score.values["ate_rmse_m"]
    if score.failure or error_m is None:
        return f"{tracked}, no error: {FAILURES[score.failure]}"
    losses = int(score.values["losses"] or 0)
    lost = f", lost {'once' if losses == 1 else f'{losses} times'}" if losses else ""
    return f"ATE {length(error_m)}, {tracked}{lost}"


def length(metres: float) -> str:
    """Return a length with the unit that fits it, to two or three digits."""
    for unit, size_m in (("m", 1.0), ("cm", 0.01), ("mm", 0.001)):
        if metres >= size_m:
            return f"{metres / size_m:.3g} {unit}"
    return f"{metres * 1000:.2g} mm"


def true_pieces(positions_m: Float64, tracked: NDArray[np.bool_]) -> dict[Part, list[Float64]]:
    """(N, 3), (N,) -> the true path, in pieces between frames that were both tracked, and pieces that were lost."""
    return _cut(positions_m, np.where(tracked, 0, 1), ("true", "lost"))


def estimated_pieces(positions_m: Float64, error_m: Float64) -> dict[Part, list[Float64]]:
    """(N, 3), (N,), NaN where a frame was lost -> the estimated path by its error, with gaps where it was lost."""
    known = np.isfinite(error_m)
    classes = np.digitize(np.where(known, error_m, 0.0), (NEAR_M, FAR_M))
    pieces: dict[Part, list[Float64]] = {}
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(int), [0]])))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        for part, found in _cut(positions_m[first:end], classes[first:end], BY_ERROR).items():
            pieces.setdefault(part, []).extend(found)
    return pieces


def _cut(positions_m: Float64, classes: NDArray[np.int64], parts: tuple[Part, ...]) -> dict[Part, list[Float64]]:
    """Cut a path where its class changes; what lies between two frames is of the higher class of both."""
    pieces: dict[Part, list[Float64]] = {}
    if len(positions_m) == 1:
        return {parts[classes[0]]: [positions_m]}
    between = np.maximum(classes[:-1], classes[1:])
    starts = [0, *(np.flatnonzero(np.diff(between)) + 1).tolist(), len(between)]
    for first, end in pairwise(starts):
        if end > first:
            pieces.setdefault(parts[between[first]], []).append(positions_m[first : end + 1])
    return pieces
