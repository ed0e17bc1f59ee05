# SPDX-License-Identifier: GPL-3.0-or-later
"""Earlier frames of a sequence, small, for steps of colour that look back: kept while they may be asked for again."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core.perturbing.by_frame import MID_GREY
from ..core.perturbing.earlier_frames import EarlierFrame, ReadEarlier, earlier_than
from ..core.planning.sequence import PlannedSequence

KEPT = 4096  # small images: 36 MiB at most, more than any frame of 60 Hz looks back; chosen


class EarlierFrames:
    """What the frames of one render's sequences have before them.

    stamps_s: (N,) of the sequence's frames. read: returns what a meter sees of a source frame that is not kept.
    """

    def __init__(self, stamps_s: NDArray[np.float64], read: Callable[[int], NDArray[np.float32]]) -> None:
        self._stamps_s = stamps_s
        self._read = read
        self._kept: OrderedDict[int, EarlierFrame] = OrderedDict()
        self._lock = threading.Lock()

    def before(self, sequence: PlannedSequence, frame: int) -> tuple[ReadEarlier, Hashable]:
        """Return what reads the frames before one of a sequence, and what is equal where these are.

        They are looked up at once, so that later it may be called in any thread.
        """
        numbers = earlier_than(self._stamps_s, frame, sequence.setting.looks_back_s)
        sources = tuple(int(sequence.source_frames[number]) for number in numbers)
        stamps_s = self._stamps_s
        seen = tuple(
            replace(self._frame(source), stamp_s=float(stamps_s[number]))
            for number, source in zip(numbers, sources, strict=True)
        )

        def read(span_s: float) -> tuple[EarlierFrame, ...]:
            return seen[-len(earlier_than(stamps_s, frame, span_s)) :]

        return read, (frame, sources)

    def prepare(self, sequence: PlannedSequence, frame: int) -> None:
        """Read what is before a frame of a sequence and is not kept, but for what the frame itself shows."""
        own = sequence.source_frames[frame]
        for number in earlier_than(self._stamps_s, frame, sequence.setting.looks_back_s):
            if (source := int(sequence.source_frames[number])) != own:
                self._frame(source)

    def keep(self, source: int, light: NDArray[np.float32]) -> None:
        """Keep what a meter sees of a source frame."""
        with self._lock:
            self._kept[source] = EarlierFrame(0.0, light)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)

    def _frame(self, source: int) -> EarlierFrame:
        if (frame := self._kept.get(source)) is None:
            light = self._read(source)
            self.keep(source, light)
            frame = self._kept.get(source) or EarlierFrame(0.0, light)
        return frame


class GreyFrames(EarlierFrames):
    """What frames have before them where none are known, as in a live preview: mid-grey."""

    def __init__(self) -> None:
        super().__init__(np.zeros(0), lambda _source: MID_GREY.light)

    def before(self, sequence: PlannedSequence, frame: int) -> tuple[ReadEarlier, Hashable]:
        """Return what reads a mid-grey frame."""
        del sequence, frame
        return lambda _span_s: (MID_GREY,), None
