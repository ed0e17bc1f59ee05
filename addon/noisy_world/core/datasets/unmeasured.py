# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth that was not measured: completed for what acts on colour, never for what is written.

A sensor leaves void where it measured nothing: at edges, on dark, shiny or near surfaces, beside the projector's view.
Such a pixel shows a surface, not the sky, so it counts as far as what was measured around it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..messages import PresetKey
from ..schema import Choice

Void: TypeAlias = Literal["unmeasured", "sky"]
"""What void means: that nothing was measured there, or that nothing is there: infinitely far."""

MEDIAN_PX = 5  # side of the square; chosen

VOID_MEANING = (
    "what depth 0 means to perturbations of colour by depth: unmeasured counts as far as what was measured "
    "around it, and depth is written as it is; sky is infinitely far"
)
VOID_CHOICES = {
    "unmeasured": Choice("Unmeasured", "As far as what was measured around it; written depth stays as it is"),
    "sky": Choice("Sky", "Infinitely far"),
}


def completed_m(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return planar depth (H, W), metres, completed where it is 0; itself where none is 0, or all are.

    A pixel gets the farthest of the nearest four that were measured: left, right, above and below. So the shadow beside
    a near surface and what is out of range count as what is behind. A median over 5 x 5 pixels takes streaks out.
    """
    import cv2

    known = depth_m > 0
    if known.all() or not known.any():
        return depth_m
    filled = _filled(depth_m, known)
    if not (there := filled > 0).all():  # neither their row nor their column has any
        filled = _filled(filled, there)
    smooth = np.asarray(cv2.medianBlur(filled, MEDIAN_PX), np.float32)
    np.copyto(smooth, depth_m, where=known)
    return smooth


def _filled(depth_m: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return depth (H, W) with the farthest neighbour in its row and column where it is not known; 0 without any."""
    by_row, by_column = depth_m.copy(), np.zeros(depth_m.T.shape, np.float32)
    by_row[~known] = _farther_neighbours(depth_m, known)
    by_column[~known.T] = _farther_neighbours(depth_m.T, known.T)
    return np.maximum(by_row, by_column.T, out=by_row)


def _farther_neighbours(depth_m: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return (N,): for each pixel that is not known, row by row, the farther of the known ones before and after it.

    All of a run have the same neighbours; beside the image there is 0.
    """
    height, width = depth_m.shape
    beside = np.zeros((height, width + 2), np.float32)
    beside[:, 1:-1] = depth_m
    unknown = np.zeros((height, width + 2), np.bool_)
    np.logical_not(known, out=unknown[:, 1:-1])
    flat, is_unknown = beside.ravel(), unknown.ravel()
    changes = np.flatnonzero(is_unknown[1:] != is_unknown[:-1])
    before, after = changes[::2], changes[1::2] + 1
    return np.repeat(np.maximum(flat[before], flat[after]), after - before - 1)


@dataclass(frozen=True)
class MeasuredDepth:
    """How far the frames of a recording see, for those that measured nothing.

    place: for messages. count: of frames. read: a frame's number -> its planar depth (H, W), metres, 0 where nothing
    was measured.
    """

    place: Path
    count: int
    read: Callable[[int], NDArray[np.float32]]
    _medians_m: dict[int, float] = field(default_factory=dict[int, float], init=False, repr=False)

    def __call__(self, frame: int) -> float:
        """Return the median of what was measured in the nearest frame that measured anything, metres.

        Of two that are equally near it is the earlier one. Raises InputError where no frame measured anything.
        """
        for apart in range(self.count):
            for other in (frame - apart, frame + apart):
                if 0 <= other < self.count and (median_m := self._median_m(other)) > 0:
                    return median_m
        remedy = f"leave out what needs depth, or take it for sky with {PresetKey('void', 'sky')}"
        raise InputError(self.place, "no frame has any depth that was measured", remedy=remedy)

    def _median_m(self, frame: int) -> float:
        if frame not in self._medians_m:
            depth_m = self.read(frame)
            measured_m = depth_m[depth_m > 0]
            self._medians_m[frame] = float(np.median(measured_m)) if measured_m.size else 0.0
        return self._medians_m[frame]
