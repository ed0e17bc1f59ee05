# SPDX-License-Identifier: GPL-3.0-or-later
"""A clean frame on its way to the files: its images, decoded once, and the context that perturbations get."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.image_files import WholeFile
from ..core.datasets.images import as_bytes, as_float
from ..core.datasets.layouts import Modality, OutputFormat
from ..core.geometry import Intrinsics
from ..core.perturbing.kinds import FrameContext
from ..core.planning.sequence import Sequence
from ..core.planning.source import SourceFrame


class CleanFrame:
    """The images of a source frame, each read when it is first needed."""

    def __init__(self, source: int, image: SourceFrame) -> None:
        """Hold a frame. source: its number on the path."""
        self.source = source
        self._image = image

    @cached_property
    def rgb(self) -> NDArray[np.float32] | NDArray[np.uint8]:
        """Colour (H, W, 3), float32 in [0, 1] or uint8."""
        rgb = self._image.rgb
        assert rgb is not None, "colour was not asked for"
        return rgb

    @cached_property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres; 0 = void."""
        depth_m = self._image.depth_m
        assert depth_m is not None, "depth was not asked for"
        return depth_m

    def float_rgb(self) -> NDArray[np.float32]:
        """Return colour (H, W, 3) as float32 in [0, 1]."""
        return as_float(self.rgb)

    def byte_rgb(self) -> NDArray[np.uint8]:
        """Return colour (H, W, 3) as uint8, rounded if it is float."""
        return as_bytes(self.rgb)

    def read_depth_m(self) -> NDArray[np.float32]:
        """Return the depth; a function that contexts can hand on."""
        return self.depth_m

    def file_as(self, modality: Modality, format_: OutputFormat) -> WholeFile | None:
        """Return an existing file that holds an image exactly as a dataset would write it, or None."""
        return self._image.file_as(modality, format_)


@dataclass(frozen=True)
class Camera:
    """What is known about the camera beside its images.

    intrinsics: None where unknown. stamps_s: (N,) time stamps of the images of the path's frames, colour or depth,
    seconds; frame i of a sequence has the i-th.
    """

    intrinsics: Intrinsics | None
    stamps_s: NDArray[np.float64]

    def context(self, sequence: Sequence, frame: int, clean: CleanFrame) -> FrameContext:
        """Return the context of a frame of a sequence.

        frame: the number that decides its random streams: the frame's own or, for depth, that of the frame with which
        the depth was taken.
        """
        setting = sequence.setting
        return FrameContext(
            index=frame,
            identifiers=sequence.identifiers,
            stamp_s=float(self.stamps_s[frame]),
            intrinsics=self.intrinsics,
            read_rgb=clean.float_rgb if setting.needs_rgb else None,
            read_depth_m=clean.read_depth_m if setting.needs_depth else None,
        )
