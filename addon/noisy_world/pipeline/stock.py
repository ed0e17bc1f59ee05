# SPDX-License-Identifier: GPL-3.0-or-later
"""What is finished of a render's sequences: what has to be rendered again, and what is not to be written again."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.dataset import Dataset
from ..core.datasets.depth_range import OutOfRange
from ..core.datasets.layouts import FrameNames, Modality
from ..core.planning.estimate import image_bytes
from ..core.planning.plan import Plan, Render
from ..core.planning.sequence import Sequence


@dataclass(frozen=True)
class Lacking:
    """What is missing of a render: the source frames that its sequences need, and roughly the bytes of its files."""

    sources: list[int]
    bytes_to_write: int


def take_stock(dataset: Dataset, plan: Plan, render: Render) -> Lacking:
    """Check the files of a render's sequences, and return what is missing."""
    names = dataset.format.names(render.scene.source.frame_stamps)
    needed: set[int] = set()
    size = 0
    there = {
        sequence.folder: dataset.take_stock(sequence.folder, names, len(sequence.source_frames))
        for sequence in render.sequences
    }
    for modality in dataset.format.modalities:
        alone, shared, held = 0, set[int](), set[int]()
        for sequence in render.sequences:
            clean = not getattr(sequence.setting, modality)
            finished = there[sequence.folder]
            for frame in sequence.frames:
                name, source = _image(sequence, names, modality, frame)
                if name in finished.get(frame, ()):
                    held |= {source} if clean else set()
                    continue
                needed.add(source)
                shared |= {source} if clean else set()
                alone += not clean
        size += image_bytes(plan, render, modality) * (alone + len(shared - held))
    return Lacking(sorted(needed), size)


def _image(sequence: Sequence, names: FrameNames, modality: Modality, frame: int) -> tuple[str, int]:
    """Return the name of a frame's image and the source frame that it shows."""
    shown = sequence.shown(frame)
    return (names.rgb(frame), shown.rgb_source) if modality == "rgb" else (names.depth(frame), shown.depth_source)


class Finished:
    """The images of a render's sequences that are finished, by the journals, when a process begins to write."""

    def __init__(self, dataset: Dataset, sequences: Iterable[Sequence], names: FrameNames) -> None:
        """Read the journals. Which frames are finished is held in two bits for each, however much was done to them."""
        self._dataset = dataset
        self._names = names
        self._sequences = list(sequences)
        self._lost: dict[int, OutOfRange] = {}  # by source frame
        self._flags = {sequence.folder: self._flags_of(sequence) for sequence in self._sequences}

    def _flags_of(self, sequence: Sequence) -> dict[Modality, NDArray[np.bool_]]:
        flags: dict[Modality, NDArray[np.bool_]] = {
            modality: np.zeros(len(sequence.source_frames), dtype=np.bool_)
            for modality in self._dataset.format.modalities
        }
        for record in self._dataset.journal_records(sequence.folder):
            for modality, finished in flags.items():
                name = self._names.rgb(record.frame) if modality == "rgb" else self._names.depth(record.frame)
                finished[record.frame] |= name in record.files
            if record.out_of_range is not None and not sequence.setting.depth:
                self._lost[sequence.shown(record.frame).depth_source] = record.out_of_range
        return flags

    def missing(self, sequence: Sequence, modality: Modality, source: int) -> list[int]:
        """Return the frames to be made that show an image of a source frame and lack it."""
        finished = self._flags[sequence.folder].get(modality)
        return [] if finished is None else [k for k in sequence.showing(modality, source) if not finished[k]]

    def lacks(self, sequence: Sequence, modality: Modality, sources: Iterable[int]) -> bool:
        """Tell whether a sequence lacks an image of some source frames."""
        return any(self.missing(sequence, modality, source) for source in sources)

    def out_of_range(self, source: int) -> OutOfRange | None:
        """Return what of a source frame's depth its finished clean image does not hold."""
        return self._lost.get(source)

    def clean_files(self, modality: Modality, source: int) -> Iterator[Path]:
        """Yield finished files that hold the clean image of a source frame."""
        for sequence in self._sequences:
            finished = self._flags[sequence.folder].get(modality)
            if finished is None or getattr(sequence.setting, modality):
                continue
            for frame in sequence.showing(modality, source):
                if finished[frame]:
                    name = self._names.rgb(frame) if modality == "rgb" else self._names.depth(frame)
                    yield self._dataset.out / sequence.folder / name
