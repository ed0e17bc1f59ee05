# SPDX-License-Identifier: GPL-3.0-or-later
"""Which images of a render's sequences are complete, and what is still missing."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS, COLOUR_AND_DEPTH
from ..core.atomic_files import Hasher, sha256_of_regular_file
from ..core.depth_range import OutOfRange
from ..core.frame_table import COMPLETED, FrameRecord
from ..layouts import FrameNames, Modality
from .dataset_folder import Dataset
from .estimate import image_bytes
from .frame import PlannedFrame
from .plan import Plan, Render
from .sequence import PlannedSequence, ShownSources, parts_made
from .shards import Shard

TOLD_OTHERWISE = ("motion", "exposure", "camera", COMPLETED)
"""Parts of a record that follow from paths, renders and images, so from a dataset's identity."""


@dataclass(frozen=True)
class Missing:
    """What is missing of a render: the source frames that its sequences need, and roughly the bytes of its files."""

    sources: list[int]
    bytes_to_write: int


def find_missing(plan: Plan, render: Render, completed: "CompletedImages") -> Missing:
    """Return what is missing of a render. completed: what is there of it."""
    needed: set[int] = set()
    size = 0
    for modality in plan.format.modalities:
        missing, shared, held = dict[str, int](), set[ShownSources](), set[ShownSources]()
        for sequence in render.sequences:
            clean = not sequence.setting.on(modality)
            for frame in sequence.frames:
                shown = sequence.shows(modality, frame)
                if completed.has(sequence, modality, frame):
                    held |= {shown} if clean else set()
                    continue
                needed.add(shown[0])
                shared |= {shown} if clean else set()
                missing[sequence.folder] = missing.get(sequence.folder, 0) + 1
        made = parts_made((item for item in render.sequences if item.folder in missing), modality)
        alone = sum(part * missing[folder] for folder, part in made.items())
        size += int(image_bytes(plan, render, modality) * (alone + len(shared - held)))
    return Missing(sorted(needed), size)


def keep_intact(dataset: Dataset, sequence: PlannedSequence, names: FrameNames) -> None:
    """Check the files of a sequence: from then on its journals name those alone that exist as they were written."""
    dataset.keep_intact(sequence.folder, names, len(sequence.source_frames), partial(is_as_planned, sequence, names))


def is_as_planned(sequence: PlannedSequence, names: FrameNames, record: FrameRecord) -> bool:
    """Tell whether a record says that to its images was done what the sequence does to them.

    That is known without the images: severities are drawn from the frame's own streams.
    """
    if not 0 <= record.frame < len(sequence.source_frames) or sequence.leaves_out(record.frame):
        return False
    there = [name for name in COLOUR_AND_DEPTH if names.image(name, record.frame) in record.files]
    done = PlannedFrame(sequence, record.frame).record(there, there)
    recorded = {name: part for name, part in record.perturbed.items() if name not in TOLD_OTHERWISE}
    return recorded == json.loads(json.dumps(done))  # tuples are lists there


Flags: TypeAlias = dict[str, dict[Modality, NDArray[np.bool_]]]
"""By a sequence's folder and modality, whether each frame's image is there: however much was done to it, one byte."""


class CompletedImages:
    """The images of a render's sequences that a folder holds, a dataset or a part of one, when a process begins."""

    def __init__(self, dataset: Dataset, render: Render, checked: Shard | None = None) -> None:
        """Read the journals, which say what a run that is open has finished.

        checked: look at a dataset that no run has opened for this process: its records count where the files that show
        this shard's source frames have their hashes.
        """
        self._dataset = dataset
        self._names = dataset.format.names(render.scene.source.frame_stamps)
        self._sequences = {sequence.folder: sequence for sequence in render.sequences if sequence.frames}
        self._lost: dict[int, OutOfRange] = {}  # by source frame
        self._checked = checked
        self._first = render.frames[:1]  # is looked at by whoever makes the others, unless it is there
        self._hasher = Hasher()
        dataset.read_on()
        self._flags: Flags = {folder: self._flags_of(sequence) for folder, sequence in self._sequences.items()}

    def _flags_of(self, sequence: PlannedSequence) -> dict[Modality, NDArray[np.bool_]]:
        count = len(sequence.source_frames)
        flags: dict[Modality, NDArray[np.bool_]] = {
            modality: np.zeros(count, dtype=np.bool_) for modality in self._dataset.format.modalities
        }
        for record in self._records(sequence):
            if not 0 <= record.frame < count or sequence.leaves_out(record.frame):
                continue
            for modality, finished in flags.items():
                name, source = self._names.image(modality, record.frame), sequence.source_of(modality, record.frame)
                finished[record.frame] |= name in record.files and self._counts(sequence, name, source, record)
            if record.out_of_range is not None and not sequence.setting.depth:
                self._lost[sequence.shown(record.frame).depth_source] = record.out_of_range
        return flags

    def _records(self, sequence: PlannedSequence) -> Iterator[FrameRecord]:
        journals = self._dataset.journal_records(sequence.folder)
        if self._checked is not None:
            journals = (record for record in journals if is_as_planned(sequence, self._names, record))
        return chain(self._dataset.finished_records(sequence.folder), journals)

    def _counts(self, sequence: PlannedSequence, name: str, source: int, record: FrameRecord) -> bool:
        if self._checked is None or source in self._first:
            return True
        path = self._dataset.out / sequence.folder / name
        return source in self._checked and self._hasher.sha256(path) == record.files[name]

    def has(self, sequence: PlannedSequence, modality: Modality, frame: int) -> bool:
        """Tell whether a frame's image is there."""
        finished = self._flags[sequence.folder].get(modality)
        return finished is None or bool(finished[frame])

    def out_of_range(self, source: int) -> OutOfRange | None:
        """Return what of a source frame's depth its finished clean image does not hold."""
        return self._lost.get(source)

    def clean_files(self, modality: Modality, shown: ShownSources) -> Iterator[Path]:
        """Yield finished files that hold the clean image of a source frame, or of one and the next."""
        for folder, sequence in self._sequences.items():
            finished = self._flags[folder].get(modality)
            if finished is None or sequence.setting.on(modality):
                continue
            for frame in sequence.showing(modality, shown[0]):
                if finished[frame] and sequence.shows(modality, frame) == shown:
                    yield self._dataset.out / folder / self._names.image(modality, frame)


class FinishedImages:
    """The images of a render's sequences that are finished, in any of several folders."""

    def __init__(self, completed: Iterable[CompletedImages]) -> None:
        """Take what the folders hold; the first one first, where several hold the same."""
        self._completed = tuple(completed)

    def missing(self, sequence: PlannedSequence, modality: Modality, source: int) -> list[int]:
        """Return the frames to be made that show an image of a source frame and lack it."""
        return [
            frame
            for frame in sequence.showing(modality, source)
            if not any(completed.has(sequence, modality, frame) for completed in self._completed)
        ]

    def lacks(self, sequence: PlannedSequence, modality: Modality, sources: Iterable[int]) -> bool:
        """Tell whether a sequence lacks an image of some source frames."""
        return any(self.missing(sequence, modality, source) for source in sources)

    def sources_missing(self, render: Render, modalities: Iterable[Modality], sources: Iterable[int]) -> list[int]:
        """Return those of some source frames that a sequence of a render needs for a missing image."""
        pairs: list[tuple[PlannedSequence, Modality]] = [
            (sequence, modality) for sequence in render.sequences if sequence.frames for modality in modalities
        ]
        return [source for source in sources if any(self.missing(item, kind, source) for item, kind in pairs)]

    def pairs(
        self, sequences: Iterable[PlannedSequence], modalities: Iterable[Modality], source: int
    ) -> set[ShownSources]:
        """Return the source frames, each with the next, of which images that lead on are missing."""
        return {
            sequence.shows(modality, frame)
            for sequence in sequences
            for modality in modalities
            for frame in self.missing(sequence, modality, source)
        }

    def clean_image(self, modality: Modality, shown: ShownSources) -> tuple[Path, str, OutOfRange | None] | None:
        """Return a finished file with the clean image of a source frame, its SHA-256 and the depth that it lacks.

        shown: the source frame or, for a channel that leads on, that and the next.
        """
        for completed in self._completed:
            for path in completed.clean_files(modality, shown):
                if digest := sha256_of_regular_file(path):
                    return path, digest, completed.out_of_range(shown[0]) if CHANNELS[modality].paired else None
        return None
