# SPDX-License-Identifier: GPL-3.0-or-later
"""Sequences on disk, opened: of a dataset of Noisy World, or in a plain layout."""

import json
import re
from collections.abc import Collection
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.channels import CHANNELS, COLOUR_AND_DEPTH
from ..core.datasets.dataset_state import MANIFEST, DatasetState, read_dataset_state
from ..core.datasets.images import as_bytes
from ..core.datasets.layouts import LAYOUTS, file_of, find_sequence
from ..core.datasets.records import FRAMES
from ..core.datasets.storage import sha256_of_bytes
from ..core.datasets.stored import StoredFrame, StoredSequence
from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.optics import DepthCamera, Distortion
from ..core.regular_files import open_regular, read_bytes
from .digests import series_of
from .frame_numbers import FrameNumbers
from .opened import Frame, Opened, OpenedSequence, decoded

KEPT = 64  # sequences whose files and poses stay in memory, a megabyte or two each
MEND = "'noisy-world verify' tells what else is damaged; the command that made the dataset mends it"
_RECORD = re.compile(rb'\{"frame": ([0-9]{1,18}), "time_s": ')


class OpenedFolder(Opened):
    """A folder that holds sequences, or is one."""

    def __init__(self, folder: Path) -> None:
        """Find the sequences. Raises InputError where there is none."""
        super().__init__(str(folder))
        self._folder = folder
        state = read_dataset_state(folder)
        self._identity: dict[str, Any] = {} if state is None else (state.manifest or {}).get("identity", {})
        if state is None:
            self._places, self._whole = _plain_sequences(folder), dict[str, int]()
        else:
            self._places, self._whole = _finished(folder, state)
        self._opened = lru_cache(maxsize=KEPT)(self._open)

    def __reduce__(self) -> tuple[Any, ...]:
        return OpenedFolder, (self._folder,)

    @property
    def identity(self) -> dict[str, Any]:
        """As its manifest has it."""
        return self._identity

    @property
    def _names(self) -> Collection[str]:
        return self._places.keys()

    def _numbers(self, name: str) -> FrameNumbers:
        """Return the numbers without opening the sequence, where the manifest says that it is whole."""
        return FrameNumbers([range(self._whole[name])]) if name in self._whole else self._opened(name).frames

    def _sequence(self, name: str) -> "SequenceOfFiles":
        return self._opened(name)

    def _open(self, name: str) -> "SequenceOfFiles":
        written = self._identity.get("output", {}).get("modalities", COLOUR_AND_DEPTH)
        if lacking := [CHANNELS[channel].spoken for channel in COLOUR_AND_DEPTH if channel not in written]:
            problem = f"has no {lacking[0]}, and frames of a folder are opened by colour and depth"
            remedy = "open its recipe instead, which 'noisy-world recipe' writes"
            raise InputError(self._places[name], problem, remedy=remedy)
        return SequenceOfFiles(name, self._places[name])


def _finished(folder: Path, state: DatasetState) -> tuple[dict[str, Path], dict[str, int]]:
    """Return the folders of a dataset's sequences by name, and the number of frames of those that have all of them."""
    if state.problem and (folder / MANIFEST).exists():
        raise InputError(folder, state.problem)  # without one, somebody copied sequences, which say enough
    there = {name: folder / name for name in sorted(state.sequences) if (folder / name / FRAMES).is_file()}
    if not there:
        problem = "holds no finished sequence"
        raise InputError(folder, problem, remedy="run the command that makes it again; it goes on where it stopped")
    if state.manifest is None:
        return there, {}
    frames, paths = state.manifest["frames"], state.manifest["identity"]["sequences"]
    whole = {name: frames[name] for name in there if name in frames and frames[name] == paths.get(name)}
    return there, whole


def _plain_sequences(folder: Path) -> dict[str, Path]:
    """Return the sequences of a folder without a manifest: itself, or those one or two folders deeper, by name."""
    if _recognised(folder):
        return {folder.resolve().name: folder}
    for depth in ("*", "*/*"):
        found = {path.relative_to(folder).as_posix(): path for path in sorted(folder.glob(depth)) if _recognised(path)}
        if found:
            return found
    known = " or ".join(layout.label for layout in LAYOUTS.values())
    problem = "holds no sequence" if folder.is_dir() else "no such folder"
    raise InputError(folder, problem, remedy=f"name a recipe, a dataset, or a folder with files as {known} has them")


def _recognised(folder: Path) -> bool:
    return folder.is_dir() and any(layout.recognises(folder) for layout in LAYOUTS.values())


class SequenceOfFiles(OpenedSequence):
    """A sequence on disk."""

    def __init__(self, name: str, folder: Path) -> None:
        """Find its files. Raises InputError where they are missing or do not match."""
        self.name = name
        self.stored = find_sequence(folder)
        self._records = _Records.of(folder / FRAMES, self.stored)

    @property
    def frames(self) -> FrameNumbers:
        """The numbers in frames.jsonl; without one, frames are counted from 0."""
        return self._records.numbers

    @property
    def camera(self) -> Intrinsics | None:
        """What its files say."""
        return self.stored.known_camera

    @property
    def distortion(self) -> Distortion | None:
        """What its files say."""
        return self.stored.optics.distortion

    @property
    def depth_camera(self) -> DepthCamera | None:
        """What its files say."""
        return self.stored.optics.depth

    def text(self, name: str) -> bytes | None:
        """Return a text file beside its images."""
        path = self.stored.folder / name
        return _content(path) if path.exists() else None

    def _frame(self, index: int) -> "FrameOfFiles":
        place = self._records.place(index)
        return FrameOfFiles(self.name, index, place, self.stored, self._records)


class _Records:
    """What frames.jsonl says, a line read when it is asked for: parsed, thousands would take megabytes."""

    def __init__(self, path: Path, numbers: FrameNumbers, order: NDArray[np.int64], offsets: NDArray[np.int64]) -> None:
        """Take the frames' numbers in order. offsets: of their lines; none where there is no file."""
        self.path = path
        self.numbers = numbers
        self._order = order
        self._offsets = offsets

    @classmethod
    def of(cls, path: Path, stored: StoredSequence) -> "_Records":
        """Find the lines. Raises InputError where they are not those of the images."""
        count = len(stored.rgb_files)
        if not path.is_file():
            nothing = np.zeros(0, np.int64)
            return cls(path, FrameNumbers([range(count)]), np.arange(count), nothing)
        data = read_bytes(path)
        starts = [0, *(match.end() for match in re.finditer(rb"\n", data))]
        found = [(int(match[1]), start) for start in starts if (match := _RECORD.match(data, start))]
        frames = sorted(found)
        if len({frame for frame, _ in frames}) != count:
            raise InputError(path, f"tells of {len(frames)} frames, and there are {count} images", remedy=MEND)
        order, offsets = (np.array(values, dtype=np.int64) for values in zip(*frames, strict=True))
        return cls(path, FrameNumbers.of(order.tolist()), order, offsets)

    def place(self, frame: int) -> int:
        """Return the place of a frame among the images."""
        return int(np.searchsorted(self._order, frame))

    def record(self, place: int) -> dict[str, Any]:
        """Return the line of the frame at a place; {} where there is none. Raises InputError where it is damaged."""
        if not self._offsets.size:
            return {}
        with open_regular(self.path) as file:
            file.seek(self._offsets[place])
            line = file.readline()
        try:
            record: dict[str, Any] = json.loads(line)
            _ = (float(record["time_s"]), float(record.get("depth_time_s", 0)), dict(record["sha256"]))
            _ = {**record.get("perturbed", {})}  # an object, too
        except (ValueError, KeyError, TypeError) as error:
            where = f"frame {self._order[place]}"
            raise InputError(self.path, "its line is damaged", where=where, remedy=MEND) from error
        return record


class FrameOfFiles(Frame):
    """A frame on disk."""

    def __init__(self, sequence: str, index: int, place: int, stored: StoredSequence, records: _Records) -> None:
        """Read its record. place: among the images."""
        self.sequence = sequence
        self.index = index
        record = records.record(place)
        self._done: dict[str, Any] = record.get("perturbed", {})
        stamps = stored.stamps
        self.stamp_s = float(record.get("time_s", stamps.rgb.seconds[place]))
        depth_s = self.stamp_s if record else stamps.depth.seconds[place]
        self.depth_stamp_s = float(record.get("depth_time_s", depth_s))
        self.c2w = stored.trajectory.c2w[place].copy()
        self._files = _files(stored, place, record, records.path)
        self._digests: dict[str, str] = record.get("sha256", {})
        self._folder = stored.folder

    @property
    def rgb(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB; light of an EXR. Raises InputError where the file is no image."""
        if self._files.rgb_file.suffix == ".exr":
            return self._files.light
        return as_bytes(self._files.rgb)

    @property
    def rgb_uncompressed(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB. Raises InputError where the file is a JPEG."""
        path = self._files.rgb_file
        if path.suffix not in (".png", ".exr"):
            remedy = "open the recipe for what it was before, or take rgb"
            raise InputError(path, "is compressed with loss", remedy=remedy)
        return self.rgb

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void. Raises InputError where the file is no 16-bit image."""
        return self._files.depth_m

    def image_bytes(self, channel: str) -> bytes:
        """Return the content of the file of a channel's image."""
        if channel in COLOUR_AND_DEPTH:
            file = self._files.depth_file if CHANNELS[channel].paired else self._files.rgb_file
            assert file is not None, "there is no depth"
            return _content(file)
        data = _content(self._other_file(channel))
        if sha256_of_bytes(data) not in self._digests.values():
            raise InputError(self._other_file(channel), "is not as it was written", remedy=MEND)
        return data

    def _other(self, channel: str) -> NDArray[Any]:
        path = self._other_file(channel)
        return decoded(channel, path.name, self.image_bytes(channel), str(path))

    def _other_file(self, channel: str) -> Path:
        name = file_of(channel, self._digests)
        if name is None:
            raise InputError(self._folder / FRAMES, f"names no {CHANNELS[channel].spoken}", where=f"frame {self.index}")
        return self._folder / name

    @property
    def done(self) -> dict[str, Any]:
        """What frames.jsonl says was done to it; {} where there is none."""
        return self._done


def _files(stored: StoredSequence, place: int, record: dict[str, Any], path: Path) -> StoredFrame:
    """Return the images of a frame: those that its record names, which pairs them."""
    frame = stored.frame(place)
    names = {series_of(name): name for name in record.get("sha256", ())}
    if not names or frame.depth_file is None:
        return frame
    rgb, depth = (
        names.get(series_of(file.relative_to(stored.folder).as_posix())) for file in (frame.rgb_file, frame.depth_file)
    )
    if rgb is None or depth is None or stored.folder / rgb != frame.rgb_file:
        where = f"frame {record['frame']}"
        raise InputError(path, f"does not name {frame.rgb_file.name} and its depth", where=where, remedy=MEND)
    return replace(frame, depth_file=stored.folder / depth, depth_sha256=record["sha256"][depth])


def _content(path: Path) -> bytes:
    try:
        return read_bytes(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}", remedy=MEND) from error
