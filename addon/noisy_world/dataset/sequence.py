# SPDX-License-Identifier: GPL-3.0-or-later
"""A sequence of a dataset, and which source frames its frames show. Only this module decides that.

Frames are counted in two ways. A *frame* is one of the sequence, as it is written; a *source frame* is one of the path
that is rendered or recorded. Motion twice as fast shows every second source frame; desynchronisation pairs the colour
of one frame with the depth of another.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS
from ..core.frame_request import SensorPaths
from ..layouts import Modality
from ..perturbations.execution import chosen_poses, paired_depth, split_motion, take_poses
from ..perturbations.kinds import Identifiers
from ..perturbations.steps import Setting

# Sequences of whole numbers, kept as a range where they are one.
#
# A plan has a thousand sequences of up to a million frames, and in most of them each frame shows its own source
# frame. A range says that in a few bytes; only what a perturbation chooses or pairs otherwise is kept number by
# number.


BLOCK = 65536  # numbers that are made Python's own at once


class ListedNumbers(Sequence[int]):
    """Numbers that no range gives, in 32 bits each."""

    def __init__(self, values: NDArray[np.integer]) -> None:
        """Take (N,) numbers, each of at most 31 bits."""
        self.values = values.astype(np.int32)
        self.values.flags.writeable = False

    def __len__(self) -> int:
        return len(self.values)

    def __iter__(self) -> Iterator[int]:
        for start in range(0, len(self.values), BLOCK):
            yield from self.values[start : start + BLOCK].tolist()

    def __contains__(self, number: object) -> bool:
        return bool((self.values == number).any())

    @overload
    def __getitem__(self, at: int) -> int: ...

    @overload
    def __getitem__(self, at: slice) -> "Numbers": ...

    def __getitem__(self, at: int | slice) -> "int | Numbers":
        return numbers_of(self.values[at]) if isinstance(at, slice) else int(self.values[at])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ListedNumbers) and np.array_equal(self.values, other.values)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash(self.values.tobytes())

    def __repr__(self) -> str:
        return f"ListedNumbers({np.array2string(self.values, threshold=8, separator=', ')})"


Numbers: TypeAlias = range | ListedNumbers


def numbers_of(values: NDArray[np.integer]) -> Numbers:
    """Return (N,) numbers: as a range where they rise evenly."""
    if len(values) < 2:
        return range(int(values[0]), int(values[0]) + 1) if len(values) else range(0)
    first, step = int(values[0]), int(values[1]) - int(values[0])
    if step > 0 and bool((np.diff(values) == step).all()):
        return range(first, int(values[-1]) + 1, step)
    return ListedNumbers(values)


def array_of(numbers: Sequence[int]) -> NDArray[np.int64]:
    """Return numbers as an array (N,)."""
    if isinstance(numbers, range):
        return np.arange(numbers.start, numbers.stop, numbers.step, dtype=np.int64)
    return np.asarray(numbers.values if isinstance(numbers, ListedNumbers) else numbers, dtype=np.int64)


def taken(numbers: Numbers, places: Numbers) -> Numbers:
    """Return the numbers at some places, which are counted from 0; the same object where all stay."""
    if places == range(len(numbers)):
        return numbers
    if isinstance(numbers, range) and numbers[:1] == range(1) and numbers.step == 1:
        return places
    if isinstance(places, range):
        return numbers[places.start : places.stop : places.step]
    return numbers_of(array_of(numbers)[places.values])


def spread(numbers: Sequence[int], count: int) -> list[int]:
    """Return so many of the numbers, evenly apart, the first and the last among them; all where there are fewer."""
    chosen = np.unique(np.linspace(0, len(numbers) - 1, min(count, len(numbers))).round().astype(int))
    return [numbers[index] for index in chosen]


def union(several: Sequence[Numbers]) -> Numbers:
    """Return the numbers that are in any of several, increasing; none of them is negative."""
    distinct = list(dict.fromkeys(several))
    if len(distinct) == 1 and isinstance(distinct[0], range):
        return distinct[0]
    there = np.zeros(max((_largest(numbers) for numbers in distinct), default=-1) + 1, dtype=bool)
    for numbers in distinct:
        if isinstance(numbers, range):
            there[numbers.start : numbers.stop : numbers.step] = True
        else:
            there[numbers.values] = True
    return numbers_of(np.flatnonzero(there))


def _largest(numbers: Numbers) -> int:
    if not numbers:
        return -1
    return numbers[-1] if isinstance(numbers, range) else int(numbers.values.max())


ShownSources: TypeAlias = tuple[int, int | None]
"""What a clean image is made of: a source frame and, where its channel leads to the sequence's next frame, the source
frame of that; None for other channels, and after the last frame."""


@dataclass(frozen=True)
class Shown:
    """What a frame of a sequence shows.

    rgb_source: the source frame of its colour. depth_source: that of its depth. depth_frame: the frame of the sequence
    that the depth belongs to, whose random streams the depth uses; under desynchronisation it is another frame.
    """

    rgb_source: int
    depth_source: int
    depth_frame: int


@dataclass(frozen=True)
class PlannedSequence:
    """One setting of one scene: a folder of the dataset.

    identifiers: of its random streams. source_frames: the source frame of each of its frames, as if none were left out.
    depth_frames: for each of its frames the one whose depth is paired with it, -1 where the frame is left out; None
    where each has its own depth. frames: those that are to be made.
    """

    setting: Setting
    scene: str
    identifiers: Identifiers
    source_frames: Numbers
    depth_frames: Numbers | None
    frames: Numbers

    @property
    def folder(self) -> str:
        """The sequence's folder inside the dataset, with forward slashes."""
        return f"{self.setting.name}/{self.scene}"

    @property
    def skips(self) -> bool:
        """Whether its frames show source frames of other numbers than their own."""
        return self.source_frames != range(len(self.source_frames))

    @property
    def paired(self) -> bool:
        """Whether colour may be paired with the depth of another frame."""
        return self.depth_frames is not None

    def frame_at(self, source: int) -> int:
        """Return the first frame that shows a source frame or, if none does, the nearest source frame before it."""
        sources, frames = self._first_shown
        before = int(np.searchsorted(sources, source, side="right")) - 1
        return int(frames[before]) if before >= 0 else 0

    @cached_property
    def _first_shown(self) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
        """The source frames that are shown, sorted, and the first frame that shows each."""
        return np.unique(array_of(self.source_frames), return_index=True)

    def leaves_out(self, frame: int) -> bool:
        """Tell whether a frame is not made because no depth is paired with it."""
        return self.depth_frames is not None and self.depth_frames[frame] < 0

    def shown(self, frame: int) -> Shown:
        """Return what a frame shows. Raises ValueError where it is left out."""
        if self.leaves_out(frame):
            raise ValueError(f"{self.folder}: frame {frame} is left out")
        depth_frame = frame if self.depth_frames is None else self.depth_frames[frame]
        return Shown(self.source_frames[frame], self.source_frames[depth_frame], depth_frame)

    def sources_shown(self, modality: Modality) -> Numbers:
        """Return the source frame (N,) whose image of a channel each of its frames to be made shows."""
        frames = self.frames
        if CHANNELS[modality].paired and self.depth_frames is not None:
            frames = taken(self.depth_frames, frames)
        return taken(self.source_frames, frames)

    def source_of(self, modality: Modality, frame: int) -> int:
        """Return the source frame whose image of a channel a frame shows. Raises ValueError where it is left out."""
        shown = self.shown(frame)
        return shown.depth_source if CHANNELS[modality].paired else shown.rgb_source

    def shows(self, modality: Modality, frame: int) -> ShownSources:
        """Return what a frame's clean image of a channel is made of. Raises ValueError where the frame is left out."""
        source = self.source_of(modality, frame)
        if not CHANNELS[modality].pairs:
            return source, None
        later = range(frame + 1, len(self.source_frames))
        following = next((number for number in later if not self.leaves_out(number)), None)
        return source, None if following is None else self.source_frames[following]

    @cached_property
    def _shown(self) -> dict[bool, tuple[Numbers, Numbers]]:
        """The source frames whose images are shown, sorted, and the frames that show them, in order.

        By whether the channel is paired: all of one sensor show the same.
        """
        found: dict[bool, tuple[Numbers, Numbers]] = {}
        for modality, channel in CHANNELS.items():
            if channel.paired in found:
                continue
            sources = self.sources_shown(modality)
            if isinstance(sources, range):
                found[channel.paired] = sources, self.frames
                continue
            order = np.argsort(sources.values, kind="stable")
            found[channel.paired] = ListedNumbers(sources.values[order]), ListedNumbers(array_of(self.frames)[order])
        return found

    def showing(self, modality: Modality, source: int) -> list[int]:
        """Return the frames to be made that show a source frame's image of a channel."""
        sources, frames = self._shown[CHANNELS[modality].paired]
        if isinstance(sources, range):
            return [frames[sources.index(source)]] if source in sources else []
        first, last = np.searchsorted(sources.values, (source, source + 1))
        return list(frames[int(first) : int(last)])

    def sources(self, modalities: Sequence[Modality]) -> Numbers:
        """Return the source frames that its frames to be made need, increasing."""
        return union([self.sources_shown(modality) for modality in modalities])


def lay_out(
    setting: Setting,
    scene: str,
    source_count: int,
    identifiers: Identifiers,
    chosen: slice | None = None,
    *,
    clocked: bool = False,
    repeats: NDArray[np.int64] | None = None,
) -> PlannedSequence:
    """Return the sequence that a setting makes of a scene.

    identifiers: the preset's seed, the scene, the setting. chosen: the sequence's frames to make, start and stop only.
    clocked: whether depth is of other moments than colour. repeats: (source_count,) the first frame that shows the
    exposure of depth which each shows, where some show one that another shows.
    """
    moving, choosing = split_motion(setting.motion, exposed=clocked or bool(setting.exposure))
    before = chosen_poses(moving, source_count, identifiers)
    source_count = source_count if before is None else len(before)
    poses = chosen_poses(choosing, source_count, identifiers)
    source_frames = range(source_count) if poses is None else numbers_of(poses)
    pairs = paired_depth(setting.pairing, len(source_frames), identifiers)
    if repeats is not None:
        shown = repeats[: len(source_frames)]
        pairs = shown if pairs is None else np.where(pairs >= 0, shown[pairs], -1)
    depth_frames = None if pairs is None else numbers_of(pairs)
    frames: Numbers = range(len(source_frames))[chosen or slice(None)]
    if pairs is not None:
        frames = taken(frames, numbers_of(np.flatnonzero(pairs[frames.start : frames.stop] >= 0)))
    return PlannedSequence(setting, scene, identifiers, source_frames, depth_frames, frames)


def written_paths(sequence: PlannedSequence, paths: SensorPaths) -> SensorPaths:
    """Return the paths of a sequence's frames, given the source frames' paths.

    The camera's rate does not change: frame i has the path's i-th stamp.
    """
    rows = array_of(sequence.source_frames)
    return paths.each(lambda path: take_poses(path, rows))
