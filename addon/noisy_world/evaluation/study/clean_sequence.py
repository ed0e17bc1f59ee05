# SPDX-License-Identifier: GPL-3.0-or-later
"""A sequence without what was done to its colour, its depth and their pairing: the clean frames on the same path."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.datasets.layouts import OutputFormat
from ...core.errors import InputError
from ...core.geometry import Intrinsics
from ...core.optics import Distortion
from ...core.planning.sequence import PlannedSequence
from ...pipeline.clean_frame import CleanFrame
from ...recipes.frame_numbers import FrameNumbers
from ...recipes.opened import Frame, OpenedSequence


class CleanSequence(OpenedSequence):
    """The clean counterpart of a sequence: frame i shows what that of the sequence shows."""

    def __init__(
        self, noisy: OpenedSequence, laid: PlannedSequence, read: Callable[[int], CleanFrame], format_: OutputFormat
    ) -> None:
        """Take the sequence and how it was laid out. read: returns the frame on the path with a number, kept or made.

        format_: in whose steps depth is.
        """
        self.name = f"{noisy.name} without noise"
        self._noisy = noisy
        self._laid = laid
        self.read = lru_cache(maxsize=1)(read)  # colour and depth of a frame are asked for one after another
        self.format = format_

    @property
    def frames(self) -> FrameNumbers:
        """Those of the sequence."""
        return self._noisy.frames

    @property
    def camera(self) -> Intrinsics | None:
        """The sequence's."""
        return self._noisy.camera

    @property
    def distortion(self) -> Distortion | None:
        """The sequence's."""
        return self._noisy.distortion

    def _frame(self, index: int) -> "CleanCounterpart":
        return CleanCounterpart(self, self._noisy[index], self._laid.source_frames[index])


class CleanCounterpart(Frame):
    """A clean frame: colour, and the depth of the same moment."""

    def __init__(self, made_in: CleanSequence, noisy: Frame, source: int) -> None:
        """Take the frame as it is in the sequence. source: the frame on the path that it shows."""
        self.sequence = made_in.name
        self.index = noisy.index
        self.stamp_s = self.depth_stamp_s = noisy.stamp_s
        self.c2w = noisy.c2w
        self._in = made_in
        self._source = source

    @property
    def _clean(self) -> CleanFrame:
        return self._in.read(self._source)

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), RGB, not encoded."""
        return self._clean.byte_rgb

    @property
    def rgb_uncompressed(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), RGB."""
        return self.rgb

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void, in the steps of the dataset's files."""
        return self._in.format.stored_depth_m(self._clean.depth_m)

    def _other(self, channel: str) -> NDArray[Any]:
        return self._clean.image(channel)

    @property
    def done(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def image_bytes(self, channel: str) -> bytes:
        """Raise InputError: it is in no dataset."""
        problem = f"its {channel} is in no file of a dataset"
        raise InputError(self._in.name, problem, remedy="take the image itself")
