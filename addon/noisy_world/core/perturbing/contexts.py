# SPDX-License-Identifier: GPL-3.0-or-later
"""What a perturbation is given beside what it acts on."""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..datasets.images import read_only
from ..geometry import Intrinsics
from ..streams import Identifiers as Identifiers  # noqa: PLC0414 - is found here too
from ..streams import integers_of_frames, stream
from ..trajectories.frame_request import Shutter
from ..trajectories.motion import CameraMotion
from .earlier_frames import EarlierFrame, ReadEarlier

Temporal: TypeAlias = Literal["fresh", "fixed", "drift"]
"""How a random pattern changes from frame to frame: drawn anew, kept, or moved smoothly."""


@dataclass(frozen=True)
class SequenceContext:
    """What a perturbation of motion or pairing is given: its own random streams in a sequence."""

    identifiers: Identifiers

    def stream(self, *purpose: str, frame: int | None = None) -> np.random.Generator:
        """Return the generator of a frame or, without one, of the whole sequence."""
        if frame is None:
            return stream(*self.identifiers, *purpose, "sequence")
        return stream(*self.identifiers, *purpose, frame=frame)

    def integers(self, count: int, low: int, high: int) -> NDArray[np.int64]:
        """Return (count,): the first `stream(frame=k).integers(low, high)` of each frame k, all at once."""
        return integers_of_frames(*self.identifiers, count=count, low=low, high=high)


@dataclass(frozen=True)
class FrameContext:
    """What a perturbation of colour or depth is given beside its image.

    index: the frame's number in its sequence. identifiers: of its random streams; a frame made alone draws the same
    numbers as in the whole sequence. temporal: how patterns change from frame to frame. stamp_s: the frame's time
    stamp, seconds. intrinsics: of the camera that took the image. Both are None only where a caller of the library did
    not give them. motion: of the camera, for perturbations that say uses_motion, None where its path is unknown.
    read_rgb, read_depth_m: read the other clean image of the same moment, as `rgb` and `depth_m` say.
    chosen_by: the identifiers of the stream that chooses the frame's severity, where they are not `identifiers`. lit:
    whether the image is light of any brightness, as of a lit scene, and was not clipped to [0, 1]. read_earlier: as
    `earlier` says. earlier_key: equal where that is. read_decided: as `decided` says. shutter: when the lines of the
    frame are exposed, as steps of exposure say; None where there are none.

    Two contexts are equal if their index, identifiers and temporal are, since these decide the random numbers.
    """

    index: int
    identifiers: Identifiers
    temporal: Temporal = "fresh"
    stamp_s: float | None = field(default=None, compare=False)
    intrinsics: Intrinsics | None = field(default=None, compare=False)
    motion: CameraMotion | None = field(default=None, compare=False, repr=False)
    read_rgb: Callable[[], NDArray[np.float32]] | None = field(default=None, compare=False, repr=False)
    read_depth_m: Callable[[], NDArray[np.float32]] | None = field(default=None, compare=False, repr=False)
    chosen_by: Identifiers | None = field(default=None, compare=False)
    lit: bool = field(default=False, compare=False)
    read_earlier: ReadEarlier | None = field(default=None, compare=False, repr=False)
    earlier_key: Hashable = field(default=None, compare=False, repr=False)
    read_decided: Callable[[], Mapping[str, float]] | None = field(default=None, compare=False, repr=False)
    shutter: Shutter | None = field(default=None, compare=False)

    def stream(self, *purpose: str) -> np.random.Generator:
        """Return the generator of this frame."""
        return stream(*self.identifiers, *purpose, frame=self.index)

    def pattern_stream(self, *purpose: str) -> np.random.Generator:
        """Return the generator of a pattern: this frame's where patterns are fresh, else the sequence's."""
        if self.temporal == "fresh":
            return self.stream(*purpose)
        return stream(*self.identifiers, *purpose, "sequence")

    @property
    def drift_frames(self) -> int:
        """By how many frames a kept pattern has moved on: 0 unless it drifts."""
        return self.index if self.temporal == "drift" else 0

    @property
    def rgb(self) -> NDArray[np.float32]:
        """Clean colour (H, W, 3), sRGB-encoded in [0, 1], read-only.

        Raises TypeError for a perturbation that does not say needs_rgb.
        """
        if self.read_rgb is None:
            raise TypeError("the context holds no colour: it is given to perturbations of depth that say needs_rgb")
        return read_only(self.read_rgb())

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Clean planar depth (H, W), metres, 0 = void, read-only.

        Raises TypeError for a perturbation that does not say needs_depth.
        """
        if self.read_depth_m is None:
            raise TypeError("the context holds no depth: it is given to perturbations of colour that say needs_depth")
        return read_only(self.read_depth_m())

    def earlier(self, span_s: float) -> tuple[EarlierFrame, ...]:
        """Return the clean frames that the sequence showed up to some seconds before this one, the oldest first.

        There is one at least: before its first frame a sequence showed that one. Raises TypeError for a perturbation
        that does not say looks_back_s.
        """
        if self.read_earlier is None:
            raise TypeError(
                "the context holds no earlier frames: they are given to perturbations that say looks_back_s"
            )
        return self.read_earlier(span_s)

    @property
    def decided(self) -> Mapping[str, float]:
        """What the camera's automatics decided for this frame, by name: this step's own and those before it."""
        return {} if self.read_decided is None else self.read_decided()

    def for_sequence(self) -> "FrameContext":
        """Return this context without what belongs to one frame: to keep what is drawn once for a sequence."""
        return FrameContext(0, self.identifiers, self.temporal, chosen_by=self.chosen_by, lit=self.lit)
