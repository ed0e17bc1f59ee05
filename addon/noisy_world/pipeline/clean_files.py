# SPDX-License-Identifier: GPL-3.0-or-later
"""A cache of a render's clean frames on disk, unrounded, for all sequences that show them.

A folder holds `rgb/000012.npy` and `depth/000012.npy`, float32, one file a source frame and channel. After the array,
where numpy does not look, a file has the SHA-256 of what stands before. Uncompressed, since reading counts: 2 ms for
the colour of 1200 x 680 pixels, where OpenEXR's fastest compression takes 18 ms, longer than most perturbations, for
0.6 of the bytes.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.channels import CHANNELS
from ..core.datasets.float_files import encode_npy
from ..core.datasets.json_text import read_json
from ..core.datasets.layouts import Modality, OutputFormat
from ..core.datasets.storage import own_scratch, storage_errors, write_atomic
from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.planning.source import ColourAndDepth, Motion, OpenSource, SourceFrame, motion_between
from ..core.regular_files import read_array, read_bytes
from ..core.trajectories.frame_request import FrameRequest

DIGEST_BYTES = hashlib.sha256().digest_size
AGAIN = "run 'noisy-world render-clean', or the study, again: it makes what is missing or damaged"


@dataclass(frozen=True)
class CleanFiles:
    """A folder of clean frames of one render. scratch: for unfinished files, on the same disk.

    Several processes may write there: a file is under its name when it is whole, and whoever makes it makes the same.
    """

    folder: Path
    scratch: Path
    _whole: set[tuple[Modality, int]] = field(default_factory=set[tuple[Modality, int]], compare=False)

    def path(self, modality: Modality, number: int) -> Path:
        """Return the file of an image."""
        return self.folder / modality / f"{number:06d}.npy"

    def exposure_path(self, number: int) -> Path:
        """Return the file of what the exposure of a frame did; there is none where nothing was exposed."""
        return self.folder / "exposure" / f"{number:06d}.json"

    def kept(self, number: int) -> "KeptFrame":
        """Return a frame that is there, its images read when they are asked for. Raises InputError."""
        path = self.exposure_path(number)
        try:
            return KeptFrame(self, number, read_json(path))
        except FileNotFoundError:
            return KeptFrame(self, number)
        except ValueError as error:
            raise InputError(path, "is damaged", remedy=AGAIN) from error

    def lacking(self, frames: Iterable[int], wanted: Sequence[Modality]) -> list[int]:
        """Return the frames of which an image is not there as it was written. Each file is read once."""
        return [number for number in frames if not all(self._is_whole(name, number) for name in wanted)]

    def keep(self, number: int, frame: SourceFrame, wanted: Iterable[Modality]) -> None:
        """Write the images of a frame, and before them what its exposure did. Raises StorageError."""
        if notes := frame.exposure:
            path = self.exposure_path(number)
            with storage_errors(path):
                path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, json.dumps(notes).encode(), own_scratch(self.scratch))
        for name in wanted:
            if (pixels := frame.image(name)) is not None:
                path = self.path(name, number)
                with storage_errors(path):
                    path.parent.mkdir(parents=True, exist_ok=True)
                data = encode_npy(pixels)
                write_atomic(path, data + hashlib.sha256(data).digest(), own_scratch(self.scratch))
                self._whole.add((name, number))

    def through(
        self, wanted: Sequence[Modality], opening: Callable[[], OpenSource], *, again: bool = False
    ) -> OpenSource:
        """Return what gives the render's frames: those that are here are read, the others are rendered and kept.

        opening: opens the render, when that is needed. again: those that are here are rendered again, as their light
        before a view transform is needed, which no file has.
        """
        return _Through(self, wanted, opening, again)

    def _is_whole(self, modality: Modality, number: int) -> bool:
        if (modality, number) not in self._whole:
            try:
                data = memoryview(read_bytes(self.path(modality, number)))
            except FileNotFoundError:
                return False
            if hashlib.sha256(data[:-DIGEST_BYTES]).digest() != data[-DIGEST_BYTES:]:
                return False
            self._whole.add((modality, number))
        return True


class _Through:
    """Frames of a render: read, or else rendered and kept."""

    def __init__(
        self, files: CleanFiles, wanted: Sequence[Modality], opening: Callable[[], OpenSource], again: bool
    ) -> None:
        self._files = files
        self._wanted = wanted
        self._opening = opening
        self._again = again
        self._opened: OpenSource | None = None

    def frame(self, request: FrameRequest) -> SourceFrame:
        """Return the frame of a request."""
        number = request.index
        here = number is not None and not self._files.lacking([number], self._wanted)
        if number is not None and here and not self._again:
            return self._files.kept(number)
        frame = self._source().frame(request)
        if number is not None and not here:  # what is between frames is asked for once
            self._files.keep(number, frame, self._wanted)
        return frame

    def motion(self, here: FrameRequest, there: FrameRequest) -> Motion | None:
        """Return what the source says: that is asked for once."""
        return motion_between(self._source(), here, there)

    def _source(self) -> OpenSource:
        if self._opened is None:
            self._opened = self._opening()
        return self._opened


@dataclass(frozen=True)
class KeptFrame(ColourAndDepth):
    """A clean frame on the disk, by the number of the source frame. An image that is not whole raises InputError."""

    files: CleanFiles
    number: int
    exposure: Sequence[Mapping[str, Any]] = ()

    @property
    def rgb(self) -> NDArray[np.float32]:
        """Colour (H, W, 3), float32 in [0, 1]."""
        return self.image("rgb")

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres; 0 = void."""
        return self.image("depth")

    def image(self, modality: Modality) -> NDArray[Any]:
        """Return the image of any channel."""
        path, channel = self.files.path(modality, self.number), CHANNELS[modality]
        image = array_in(path)
        if image.dtype != channel.dtype or image.ndim != (2 if channel.components == 1 else 3):
            raise InputError(path, f"is {image.dtype} {image.shape}, no clean image", remedy=AGAIN)
        return image

    def file_as(self, modality: Modality, written: OutputFormat) -> None:
        """Return None: no file here is a dataset's."""
        del modality, written


def array_in(path: Path) -> NDArray[Any]:
    """Return the array in a file of clean frames. Raises InputError."""
    try:
        return read_array(path)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(path, "is damaged or cannot be read", remedy=AGAIN) from error


def frames_bytes(camera: Intrinsics, frames: int, wanted: Iterable[Modality]) -> int:
    """Return how many bytes clean frames of a camera take."""
    each = sum(CHANNELS[name].components * np.dtype(CHANNELS[name].dtype).itemsize for name in wanted)
    return frames * camera.width_px * camera.height_px * each
