# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing a frame that was rendered or read into the files of every sequence that shows it."""

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

from numpy.typing import NDArray

from ..core.channels import CHANNELS, in_order, pair_channels
from ..core.datasets.dataset import Dataset
from ..core.datasets.depth_range import OutOfRange
from ..core.datasets.journal import Journal
from ..core.datasets.layouts import Modality, OutputFormat
from ..core.datasets.records import FrameRecord
from ..core.datasets.storage import sha256_of_bytes
from ..core.errors import NoisyWorldError
from ..core.planning.plan import Render
from ..core.planning.sequence import PlannedSequence
from .clean_frame import CleanFrame
from .colour import FrameOf
from .completed_images import FinishedImages
from .made_frame import Frame
from .pairs import CleanPair
from .stage_timer import StageTimer

# Chosen: 3 waiting frames keep two encoders busy beside the rendering, and memory does not grow with frames.
WAITING_FRAMES = 3
ENCODERS = 2
Encoder: TypeAlias = Callable[[NDArray[Any], OutputFormat], bytes]
"""Makes the file of an image."""


@dataclass(frozen=True)
class WrittenImage:
    """An image's file in the dataset, and its SHA-256. out_of_range: the depth that it cannot hold, None for none."""

    path: Path
    sha256: str
    out_of_range: OutOfRange | None = None


@dataclass(frozen=True)
class Lost:
    """A frame of a sequence some of whose depth its image cannot hold."""

    sequence: PlannedSequence
    frame: int
    out_of_range: OutOfRange


class FrameWriter:
    """Perturbs, encodes and writes frames in threads beside the rendering, for every sequence that shows them.

    An image that several sequences share is written once and linked. finished: what is not to be written again.
    first_lost: the first frame that was written whose depth 16 bits do not hold, None while there is none.
    """

    def __init__(self, dataset: Dataset, render: Render, finished: FinishedImages, timer: StageTimer) -> None:
        """Open the journals. finished: what is not to be written again. timer: hears how long what took."""
        self._dataset = dataset
        self.timer = self._timer = timer
        self._stamps = render.scene.source.frame_stamps
        self._names = dataset.format.names(self._stamps)
        self._sequences = [sequence for sequence in render.sequences if sequence.frames]
        self.finished = finished
        self._journals: list[Journal] = []
        with contextlib.ExitStack() as opened:
            for sequence in self._sequences:
                self._journals.append(dataset.journal(sequence.folder))
                opened.callback(self._journals[-1].close)
            opened.pop_all()  # all of them could be opened
        self._pool = ThreadPoolExecutor(ENCODERS, thread_name_prefix="encoder")
        self._waiting: deque[tuple[Future[Lost | None], int]] = deque()  # and how many frames are finished with it
        self._lock = threading.Lock()
        self.first_lost: Lost | None = None

    def submit(self, clean: CleanFrame, frames: FrameOf) -> int:
        """Queue a clean frame; block while too many are queued. Return how many were finished meanwhile.

        frames: gives the frames that show it.

        Raises the error of an earlier frame, if there was one.
        """
        return self._queue(self._pool.submit(self._write, clean, frames), 1)

    def submit_pair(self, pair: CleanPair) -> int:
        """Queue what leads from a clean frame to another, as `submit`."""
        return self._queue(self._pool.submit(self._write_pair, pair), 0)

    def _queue(self, writing: Future[Lost | None], frames: int) -> int:
        self._waiting.append((writing, frames))
        finished = 0
        while len(self._waiting) > WAITING_FRAMES or (self._waiting and self._waiting[0][0].done()):
            finished += self._take_next()
        return finished

    def drain(self) -> int:
        """Wait for all queued frames; return how many were finished."""
        return sum(self._take_next() for _ in range(len(self._waiting)))

    def _take_next(self) -> int:
        # In the frames' order, so that the first to lose depth is the same in every run.
        writing, frames = self._waiting.popleft()
        lost = writing.result()
        self.first_lost = self.first_lost or lost
        return frames

    def _write(self, clean: CleanFrame, frames: FrameOf) -> Lost | None:
        """Write all that shows a clean frame; return the first frame whose image does not hold its depth."""
        lost = None
        files = FrameFiles(self._dataset, clean, self.finished, self._timer)
        for sequence, journal in zip(self._sequences, self._journals, strict=True):
            records = [
                record
                for modality in in_order(self._dataset.format.modalities)
                if not CHANNELS[modality].pairs
                for record in self._write_images(modality, sequence, clean, files, frames)
            ]
            self._append(journal, records)
            for record in records:
                if lost is None and record.out_of_range is not None:
                    lost = Lost(sequence, record.frame, record.out_of_range)
        return lost

    def _write_pair(self, pair: CleanPair) -> None:
        """Write all that leads from one clean frame to another."""
        files = FrameFiles(self._dataset, pair, self.finished, self._timer)
        for sequence, journal in zip(self._sequences, self._journals, strict=True):
            for channel in pair_channels(self._dataset.format.modalities):
                with self._timer.on(f"making {channel.spoken}"):
                    written = list(self._write_images(channel.name, sequence, pair, files, Frame))
                self._append(journal, written)

    def _append(self, journal: Journal, records: list[FrameRecord]) -> None:
        with self._lock, self._timer.on("journals"):
            for record in records:
                journal.append(record)

    def _write_images(
        self,
        modality: Modality,
        sequence: PlannedSequence,
        clean: CleanFrame | CleanPair,
        files: "FrameFiles",
        frames: FrameOf,
    ) -> Iterator[FrameRecord]:
        """Write the images of a channel that show a clean frame, or lead from one to another."""
        for index in self.finished.missing(sequence, modality, clean.shown[0]):
            if sequence.shows(modality, index) != clean.shown:
                continue
            frame, name = frames(sequence, index), self._names.image(modality, index)
            written = files.put(modality, frame, name)
            done = frame.record((modality,), self._dataset.format.modalities)
            yield self._record(index, {name: written.sha256}, done, written.out_of_range)

    def _record(
        self, frame: int, files: dict[str, str], done: dict[str, Any], lost: OutOfRange | None = None
    ) -> FrameRecord:
        time_s, depth_time_s = self._stamps.frame_times(frame)
        return FrameRecord(frame, time_s, files, done, lost, depth_time_s)

    def __enter__(self) -> "FrameWriter":
        return self

    def __exit__(self, *_: object) -> None:
        # After an error, queued frames are dropped; the next run makes them.
        self._pool.shutdown(wait=True, cancel_futures=True)
        for journal in self._journals:
            journal.close()


class FrameFiles:
    """The images of one frame that several sequences may show, each written when it is first needed and linked later.

    A clean one that a sequence of the dataset has already is linked too.
    """

    def __init__(
        self, dataset: Dataset, clean: CleanFrame | CleanPair, finished: FinishedImages, timer: StageTimer
    ) -> None:
        self._dataset = dataset
        self._timer = timer
        self._clean = clean
        self._finished = finished
        self._written: dict[Modality, WrittenImage] = {}
        self._perturbed: dict[Hashable, WrittenImage] = {}  # by the key of the frame's image

    def put(self, modality: Modality, frame: Frame, name: str) -> WrittenImage:
        """Put a frame's image under a name into its sequence; return the file that it was first written to."""
        folder, steps = frame.sequence.folder, frame.sequence.setting.on(modality)
        if not steps:
            return self._put_clean(modality, folder, name)
        key = frame.key(modality)
        if (there := self._perturbed.get(key)) is not None:
            return self._linked(there, folder, name)
        with self._timer.on(f"perturbing: {' + '.join(step.perturbation.name for step in steps)}"):
            pixels = frame.changed(modality)
        if pixels is None:
            return self._put_clean(modality, folder, name)
        written = self._put_image(modality, pixels, CHANNELS[modality].encode, folder, name)
        self._perturbed[key] = written
        return written

    def _put_clean(self, modality: Modality, folder: str, name: str) -> WrittenImage:
        """Put the clean image under a name into a sequence; return the file that it was first written to."""
        if modality not in self._written and (there := self._existing(modality)) is not None:
            self._linked(there, folder, name)
            # From now on this name is linked: where the existing file is on another disk, it is copied once.
            self._written[modality] = replace(there, path=self._dataset.out / folder / name)
        elif modality in self._written:
            self._linked(self._written[modality], folder, name)
        else:
            pixels, encode = self._clean.image(modality), CHANNELS[modality].encode_clean
            self._written[modality] = self._put_image(modality, pixels, encode, folder, name)
        return self._written[modality]

    def _existing(self, modality: Modality) -> WrittenImage | None:
        """Return the source's own file that holds the image, or one that is finished; None where there is none."""
        if whole := self._clean.file_as(modality, self._dataset.format):
            return WrittenImage(whole.path, whole.sha256)
        found = self._finished.clean_image(modality, self._clean.shown)
        return None if found is None else WrittenImage(found[0], found[1], out_of_range=found[2])

    def _put_image(
        self, modality: Modality, pixels: NDArray[Any], encode: Encoder, folder: str, name: str
    ) -> WrittenImage:
        """Write an image of a channel under a name into a sequence."""
        channel, format_ = CHANNELS[modality], self._dataset.format
        with self._timer.on(f"encoding {channel.spoken}"):
            try:
                data = encode(pixels, format_)
            except NoisyWorldError as error:
                raise NoisyWorldError(f"{folder}/{name}: {error}") from error
            lost = channel.lost(pixels, format_)
        return replace(self._put(folder, name, data), out_of_range=lost)

    def _put(self, folder: str, name: str, data: bytes) -> WrittenImage:
        with self._timer.on("hashing"):
            digest = sha256_of_bytes(data)
        with self._timer.on("writing"):
            self._dataset.write_file(folder, name, data)
        return WrittenImage(self._dataset.out / folder / name, digest)

    def _linked(self, there: WrittenImage, folder: str, name: str) -> WrittenImage:
        """Give a file that is written a name in a sequence; return the file."""
        with self._timer.on("linking"):
            self._dataset.link_file(there.path, folder, name)
        return there
