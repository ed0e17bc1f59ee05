# SPDX-License-Identifier: GPL-3.0-or-later
"""From a frame that was rendered or read to the files of every sequence that shows it."""

import threading
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .core.datasets.dataset import Dataset, FrameRecord
from .core.datasets.storage import sha256_of_file
from .core.datasets.stored import StoredFrame
from .core.errors import InputError
from .core.perturbing.mixture import perturb_depth, perturb_rgb
from .core.planning.plan import Sequence

# Frames that may wait to be encoded: enough to overlap with rendering, few enough that memory stays flat.
WAITING_FRAMES = 3
ENCODERS = 2


type Composited = Mapping[str, tuple[NDArray[np.uint8] | None, list[dict[str, Any]]]]
"""By the sequence's folder: (H, W, 3) perturbed colour, None where nothing changes it; and what was done."""


class SourceFrame(Protocol):
    """A clean frame; None is what is not there."""

    @property
    def rgb(self) -> NDArray[Any] | None:
        """Colour (H, W, 3), float32 in [0, 1] or uint8; RGB, sRGB-encoded."""

    @property
    def depth_m(self) -> NDArray[np.float32] | None:
        """Planar depth (H, W) in metres; 0 = void."""


class FrameWriter:
    """Perturbs, encodes and writes frames in threads beside the rendering, for every sequence that shows them.

    What several sequences show alike is written once and linked.
    """

    def __init__(
        self, dataset: Dataset, sequences: tuple[Sequence, ...], worker: int, stamps_s: NDArray[np.float64]
    ) -> None:
        """Open the journals.

        stamps_s: time stamps of the sequences' frames, whose i-th is the same in all.
        """
        self._dataset = dataset
        self._sequences = [sequence for sequence in sequences if sequence.frames]
        self._stamps_s = stamps_s
        self._names = dataset.format.names(stamps_s)
        self._journals = [dataset.journal(sequence.folder, worker) for sequence in self._sequences]
        self._pool = ThreadPoolExecutor(ENCODERS, thread_name_prefix="encoder")
        self._waiting: deque[Future[None]] = deque()
        self._lock = threading.Lock()

    def submit(self, source: int, image: SourceFrame, composited: Composited | None = None) -> int:
        """Hand over a frame of the render; wait while too many wait. Return how many were finished meanwhile.

        composited: by the sequence's folder, colour that the compositor has perturbed already, and what was done.

        Raises what went wrong with an earlier frame.
        """
        self._waiting.append(self._pool.submit(self._write, source, image, composited or {}))
        finished = 0
        while len(self._waiting) > WAITING_FRAMES or (self._waiting and self._waiting[0].done()):
            self._waiting.popleft().result()
            finished += 1
        return finished

    def drain(self) -> int:
        """Wait for all; return how many were finished."""
        finished = len(self._waiting)
        while self._waiting:
            self._waiting.popleft().result()
        return finished

    def _write(self, source: int, image: SourceFrame, composited: Composited) -> None:
        clean = CleanFiles(self._dataset, image)
        for sequence, journal in zip(self._sequences, self._journals, strict=True):
            records = [
                *self._write_rgb(sequence, source, clean, composited),
                *self._write_depth(sequence, source, clean),
            ]
            with self._lock:
                for record in records:
                    journal.append(record)

    def _write_rgb(
        self, sequence: Sequence, source: int, clean: "CleanFiles", composited: Composited
    ) -> Iterator[FrameRecord]:
        output = self._dataset.format
        frame = sequence.rgb_shown_by.get(source)
        if frame is None or "rgb" not in output.modalities:
            return
        pixels, notes = None, []
        if sequence.setting.composited:
            pixels, notes = composited[sequence.folder]
        elif sequence.setting.rgb:
            depth_m = clean.depth_m if sequence.setting.needs_depth else None
            pixels, notes = perturb_rgb(sequence.setting.rgb, clean.rgb, frame, sequence.identifiers, depth_m)
        name = self._names.rgb(frame)
        if pixels is None:
            digest = clean.give("rgb", sequence.folder, name)
        else:
            digest = self._dataset.write_file(sequence.folder, name, output.encode_rgb(pixels))
        yield FrameRecord(frame, float(self._stamps_s[frame]), {name: digest}, {"rgb": notes} if notes else {})

    def _write_depth(self, sequence: Sequence, source: int, clean: "CleanFiles") -> Iterator[FrameRecord]:
        output = self._dataset.format
        shown_by = sequence.depth_shown_by.get(source, [])
        if not shown_by or "depth" not in output.modalities:
            return
        depth_m, notes = None, []
        taken = source // sequence.every  # the frame that the depth belongs to, and its randomness with it
        if sequence.setting.depth:
            depth_m, notes = perturb_depth(sequence.setting.depth, clean.depth_m, taken, sequence.identifiers)
        first = None
        digest = ""
        for frame in shown_by:
            name = self._names.depth(frame)
            if depth_m is None:
                digest = clean.give("depth", sequence.folder, name)
            elif first is None:
                digest = self._dataset.write_file(sequence.folder, name, output.encode_depth(depth_m))
                first = self._dataset.out / sequence.folder / name
            else:
                self._dataset.link_file(first, sequence.folder, name)
            done: dict[str, object] = {"depth": notes} if notes else {}
            if sequence.depth_of is not None:
                done["sync"] = {"depth_of_frame": taken}
            yield FrameRecord(frame, float(self._stamps_s[frame]), {name: digest}, done)

    def __enter__(self) -> "FrameWriter":
        return self

    def __exit__(self, *_: object) -> None:
        # What waits is let go where an error ends the run: the next run makes it again.
        self._pool.shutdown(wait=True, cancel_futures=True)
        for journal in self._journals:
            journal.close()


class CleanFiles:
    """The clean images of one frame, each encoded when it is first needed, and from then on linked."""

    def __init__(self, dataset: Dataset, image: SourceFrame) -> None:
        self._dataset = dataset
        self._image = image
        self._written: dict[str, tuple[Path, str]] = {}

    @cached_property
    def rgb(self) -> NDArray[Any]:
        """Colour (H, W, 3), float32 in [0, 1] or uint8."""
        assert self._image.rgb is not None
        return self._image.rgb

    @cached_property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres; 0 = void."""
        assert self._image.depth_m is not None
        return self._image.depth_m

    def give(self, modality: str, folder: str, name: str) -> str:
        """Put the clean image under a name into a sequence; return its SHA-256."""
        if modality not in self._written and isinstance(self._image, StoredFrame):
            self._take_stored(modality, self._image)
        if modality in self._written:
            path, digest = self._written[modality]
            self._dataset.link_file(path, folder, name)
            return digest
        digest = self._dataset.write_file(folder, name, self._encoded(modality))
        self._written[modality] = (self._dataset.out / folder / name, digest)
        return digest

    def _encoded(self, modality: str) -> bytes:
        output = self._dataset.format
        return output.encode_rgb(self.rgb) if modality == "rgb" else output.encode_depth(self.depth_m)

    def _take_stored(self, modality: str, image: StoredFrame) -> None:
        """Use the file of an existing sequence as it is, where the dataset's are of the same kind."""
        output = self._dataset.format
        if modality == "rgb":
            path = image.rgb_file
            same = path.suffix == f".{output.image}" and image.colour == output.colour
        else:
            path = image.depth_file
            same = image.depth_scale_per_m == output.depth_scale_per_m and path.suffix == ".png"
        if not same:
            return
        digest = sha256_of_file(path)
        if digest is None:
            raise InputError(path, "is gone")
        self._written[modality] = (path, digest)
