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
from .core.datasets.existing import StoredFrame
from .core.datasets.images import encode_depth, encode_rgb, quantise_depth, rgb_bytes
from .core.datasets.storage import sha256_of_file
from .core.errors import InputError
from .core.geometry import Intrinsics
from .core.perturbing.execution import perturb_depth, perturb_rgb
from .core.perturbing.kinds import FrameContext
from .core.planning.plan import Sequence

# Frames that may wait to be encoded: enough to overlap with rendering, few enough that memory stays flat.
WAITING_FRAMES = 3
ENCODERS = 2


type Composited = Mapping[tuple[str, int], tuple[NDArray[np.uint8] | None, list[dict[str, Any]]]]
"""By the sequence's folder and its frame: perturbed colour (H, W, 3), None where it stays clean; and what was done."""


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
        self,
        dataset: Dataset,
        sequences: tuple[Sequence, ...],
        worker: int,
        stamps_s: NDArray[np.float64],
        intrinsics: Intrinsics,
    ) -> None:
        """Open the journals.

        stamps_s: time stamps of the sequences' frames, whose i-th is the same in all. intrinsics: of all sensors.
        """
        self._intrinsics = intrinsics
        self._dataset = dataset
        self._sequences = [sequence for sequence in sequences if sequence.frames]
        self._stamps_s = stamps_s
        self._journals = [dataset.journal(sequence.folder, worker) for sequence in self._sequences]
        self._pool = ThreadPoolExecutor(ENCODERS, thread_name_prefix="encoder")
        self._waiting: deque[Future[None]] = deque()
        self._lock = threading.Lock()

    def submit(self, source: int, image: SourceFrame, composited: Composited | None = None) -> int:
        """Hand over a frame of the render; wait while too many wait. Return how many were finished meanwhile.

        composited: what the compositor has perturbed already.

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
        layout = self._dataset.layout
        if "rgb" not in layout.modalities:
            return
        for frame in sequence.rgb_shown_by.get(source, ()):
            pixels, notes = None, []
            if sequence.setting.composited:
                pixels, notes = composited[sequence.folder, frame]
            elif sequence.setting.rgb:
                pixels, notes = perturb_rgb(sequence.setting.rgb, clean.rgb, self._context(sequence, frame, clean))
            name = layout.rgb_name(frame)
            if pixels is None:
                digest = clean.give("rgb", sequence.folder, name)
            else:
                digest = self._dataset.write_file(sequence.folder, name, encode_rgb(pixels, layout.image))
            yield FrameRecord(frame, float(self._stamps_s[frame]), {name: digest}, {"rgb": notes} if notes else {})

    def _write_depth(self, sequence: Sequence, source: int, clean: "CleanFiles") -> Iterator[FrameRecord]:
        layout = self._dataset.layout
        if "depth" not in layout.modalities:
            return
        made: dict[int, tuple[Path | None, str, list[dict[str, Any]]]] = {}  # by the frame that the depth belongs to
        for frame in sequence.depth_shown_by.get(source, ()):
            name = layout.depth_name(frame)
            taken = sequence.depth_frame(frame)
            if taken not in made:
                made[taken] = self._perturbed_depth(sequence, taken, clean, name)
            elif made[taken][0] is not None:
                self._dataset.link_file(made[taken][0], sequence.folder, name)
            path, digest, notes = made[taken]
            if path is None:
                digest = clean.give("depth", sequence.folder, name)
            done: dict[str, object] = {"depth": notes} if notes else {}
            if sequence.depth_of is not None:
                done["pairing"] = {"depth_of_frame": taken}
            yield FrameRecord(frame, float(self._stamps_s[frame]), {name: digest}, done)

    def _perturbed_depth(
        self, sequence: Sequence, taken: int, clean: "CleanFiles", name: str
    ) -> tuple[Path | None, str, list[dict[str, Any]]]:
        """Write a frame's depth; return the file, None where depth stays clean, its SHA-256, and what was done."""
        if not sequence.setting.depth:
            return None, "", []
        where = self._context(sequence, taken, clean)
        depth_m, notes = perturb_depth(sequence.setting.depth, clean.depth_m, where)
        if depth_m is None:
            return None, "", notes
        data = encode_depth(quantise_depth(depth_m, self._dataset.layout.depth_scale_per_m))
        digest = self._dataset.write_file(sequence.folder, name, data)
        return self._dataset.out / sequence.folder / name, digest, notes

    def _context(self, sequence: Sequence, frame: int, clean: "CleanFiles") -> FrameContext:
        return FrameContext(
            frame,
            sequence.identifiers,
            stamp_s=float(self._stamps_s[frame]),
            intrinsics=self._intrinsics,
            read_rgb=lambda: clean.float_rgb,
            read_depth_m=lambda: clean.depth_m,
        )

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
    def float_rgb(self) -> NDArray[np.float32]:
        """Colour (H, W, 3), float32 in [0, 1]."""
        return self.rgb / np.float32(255) if self.rgb.dtype == np.uint8 else self.rgb

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
        layout = self._dataset.layout
        if modality == "rgb":
            pixels = self.rgb if self.rgb.dtype == np.uint8 else rgb_bytes(self.rgb)
            return encode_rgb(pixels, layout.image)
        return encode_depth(quantise_depth(self.depth_m, layout.depth_scale_per_m))

    def _take_stored(self, modality: str, image: StoredFrame) -> None:
        """Use the file of an existing sequence as it is, where the dataset's are of the same kind."""
        layout = self._dataset.layout
        if modality == "rgb":
            path, same = image.rgb_file, image.rgb_file.suffix == f".{layout.image}"
        else:
            path = image.depth_file
            same = image.depth_scale_per_m == layout.depth_scale_per_m and path.suffix == ".png"
        if not same:
            return
        digest = sha256_of_file(path)
        if digest is None:
            raise InputError(path, "is gone")
        self._written[modality] = (path, digest)
