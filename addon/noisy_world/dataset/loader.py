# SPDX-License-Identifier: GPL-3.0-or-later
"""What is open, a dataset, a recipe or a folder in a plain layout: its sequences by name, its frames by number.

Frames come in lists for training too. All of it can be pickled: another process opens the same again.
"""

import json
import os
import tarfile
import threading
from abc import ABC, abstractmethod
from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import accumulate, islice
from pathlib import Path
from typing import Any, Self, TypedDict, overload

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS, COLOUR_AND_DEPTH, in_order
from ..channels.depth import CHANNEL as DEPTH
from ..channels.rgb import CHANNEL as RGB
from ..core.atomic_files import sha256_of_bytes
from ..core.errors import InputError
from ..core.file_access import read_bytes
from ..core.frame_table import FRAMES, FrameLines, FrameRecord
from ..core.geometry import Intrinsics
from ..core.lens import DepthCamera, Distortion
from ..core.machine import end_opencv_threads_before_forks
from ..core.schema import ConfigPath, quoted
from ..images.image_files import damage
from ..images.pixels import as_bytes
from ..layouts import LAYOUTS, Modality, file_of, find_sequence
from ..layouts.stored_recording import StoredFrame, StoredSequence
from ..preset.names import near_names, selected
from .folder_state import MANIFEST, DatasetState, read_dataset_state
from .recipe import FrameNumbers, series_of
from .stored import PackedDataset, packed_dataset
from .tar_files import AGAIN, texts_of


class Frame(ABC):
    """A frame of a sequence; each image is read or made when it is first asked for.

    sequence: the name of its sequence. index: its number there. stamp_s, depth_stamp_s: when its colour and its depth
    were taken, seconds. c2w: (4, 4) float64 camera-to-world of its colour, OpenCV axes, metres. done: what was done to
    it, as in frames.jsonl: for colour and depth a list of steps, for pairing and motion what it shows; {} if nothing
    was.
    """

    sequence: str
    index: int
    stamp_s: float
    depth_stamp_s: float
    c2w: NDArray[np.float64]

    def __repr__(self) -> str:
        """Tell which frame it is; no image is read for that."""
        return f"<frame {self.index} of {self.sequence!r} at {self.stamp_s:.6f} s>"

    @property
    @abstractmethod
    def rgb(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB, as the file decodes: uint8, grey in three equal channels; of an EXR light, float32."""

    @property
    @abstractmethod
    def rgb_uncompressed(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB, as it is before it is encoded as JPEG, which costs more time than most perturbations.

        Raises InputError where only a JPEG is there.
        """

    @property
    @abstractmethod
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void, as the file decodes."""

    def image(self, channel: str) -> NDArray[Any]:
        """Return the image of a channel as its file decodes: (H, W) or (H, W, components), as docs/channels.md says.

        Those of rgb and depth are `rgb` and `depth_m`. Raises InputError where there is none, or its file is damaged.
        """
        if channel in COLOUR_AND_DEPTH:
            return self.depth_m if CHANNELS[channel].paired else self.rgb
        in_order([channel])
        return self._other(channel)

    @abstractmethod
    def _other(self, channel: str) -> NDArray[Any]:
        """Return the image of another channel than colour and depth."""

    @property
    @abstractmethod
    def done(self) -> dict[str, Any]:
        """What was done to it."""

    @abstractmethod
    def image_bytes(self, channel: str) -> bytes:
        """Return the file of a channel's image. Raises InputError where there is none, or it is damaged."""

    def rgb_bytes(self) -> bytes:
        """Return the colour image's file."""
        return self.image_bytes(RGB.name)

    def depth_bytes(self) -> bytes:
        """Return the depth image's file."""
        return self.image_bytes(DEPTH.name)


class OpenedSequence(ABC):
    """A sequence: its frames by their numbers, in any order.

    name: its name. frames: the numbers of its frames. camera: the intrinsics of its frames, None where unknown.
    distortion: of their lens, None for a pinhole's.
    """

    name: str

    @property
    @abstractmethod
    def frames(self) -> FrameNumbers:
        """The numbers of its frames, increasing."""

    @property
    @abstractmethod
    def camera(self) -> Intrinsics | None:
        """The intrinsics of its frames; None where no file says them."""

    @property
    @abstractmethod
    def distortion(self) -> Distortion | None:
        """The lens that its colour, and depth seen through it, distort by; None for a pinhole's frames."""

    @property
    def depth_camera(self) -> DepthCamera | None:
        """The camera of its depth and where it sits beside colour's; None where depth lies in colour's pixels."""
        return None

    def text(self, name: str) -> bytes | None:
        """Return a text file beside its images, by its name in the sequence's folder; None where there is none.

        A recipe's frames have none. Raises InputError where it cannot be read.
        """
        del name
        return None

    @abstractmethod
    def _frame(self, index: int) -> Frame:
        """Return a frame that there is."""

    def __len__(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[Frame]:
        return map(self._frame, self.frames)

    def __contains__(self, index: object) -> bool:
        return index in self.frames

    def __repr__(self) -> str:
        return f"<sequence {self.name!r}: {len(self):,} frames, {self.frames}>"

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...

    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        """Return the frame of a number, or those of a slice of numbers; their images are read when they are asked for.

        Numbers are the frames' own, as in --frames; negative ones count back from the end, so -1 is the last frame and
        [-5:] the last five numbers. Frames that were left out leave gaps in a slice.

        Raises IndexError where there is no frame of a number.
        """
        end = self.frames[-1] + 1 if len(self.frames) else 0
        if isinstance(index, slice):
            return [self._frame(number) for number in range(end)[index] if number in self.frames]
        number = _whole_number(index)
        number = number + end if number < 0 else number
        if number not in self.frames:
            raise IndexError(f"{self.name} has no frame {index}; its frames are {self.frames}")
        return self._frame(number)


class Opened(Mapping[str, OpenedSequence]):
    """A dataset or a recipe that is open: its sequences by name, such as "fog_s3_static/room0"."""

    def __init__(self, place: str) -> None:
        """Keep the place, the file or folder that messages name. Loops that are fed from here fork their workers."""
        end_opencv_threads_before_forks()
        self.place = place

    @property
    def identity(self) -> dict[str, Any]:
        """All that decides its bytes, as its manifest or recipe has it; {} where none is there."""
        return {}

    @property
    @abstractmethod
    def _names(self) -> Collection[str]:
        """The names of its sequences, in order."""

    @abstractmethod
    def _numbers(self, name: str) -> FrameNumbers:
        """Return the numbers of the frames of a sequence that there is."""

    @abstractmethod
    def _sequence(self, name: str) -> OpenedSequence:
        """Return a sequence that there is."""

    def __repr__(self) -> str:
        """Tell the place and how many sequences it holds, with the first ones' names."""
        first = ", ".join(map(repr, islice(self, 3))) + (", ..." if len(self) > 3 else "")
        return f"<{self.place}: {len(self):,} {'sequence' if len(self) == 1 else 'sequences'}, {first}>"

    def __len__(self) -> int:
        return len(self._names)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __getitem__(self, name: str) -> OpenedSequence:
        """Return a sequence. Raises InputError, with the names that are near, where there is no such sequence."""
        if name not in self._names:
            raise self._unknown(name)
        return self._sequence(name)

    def load(self, name: str, index: int) -> None:
        """Load what a frame of a sequence is made from; nothing where it is read from a file."""

    def close(self) -> None:
        """Let go of what is in memory; a `with` does it too."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def get(self, name: str, default: Any = None) -> Any:
        """Return a sequence, or the default where there is no such sequence."""
        try:
            return self[name]
        except InputError:
            return default

    @property
    def settings(self) -> list[str]:
        """The names of the settings."""
        return list(dict.fromkeys(name.split("/")[0] for name in self))

    @property
    def scenes(self) -> list[str]:
        """The names of the scenes."""
        return list(dict.fromkeys(name.split("/")[-1] for name in self))

    def frames(
        self,
        settings: str | Sequence[str] = "*",
        scenes: str | Sequence[str] = "*",
        frames: slice = slice(None),
        *,
        compressed: bool = True,
        channels: Sequence[str] = (),
    ) -> "FrameList":
        """Return all frames of some sequences as one list, in order, as a map-style dataset of PyTorch.

        settings, scenes: names or globs. frames: start and stop of their numbers, if not all. compressed: whether
        colour is as the file decodes; False spares the time of encoding and decoding a JPEG. channels: those
        beside colour and depth that each sample has, under their names.

        Raises InputError where a name or glob matches nothing.
        """
        place = ConfigPath(self.place)
        of_settings = set(selected(self.settings, _globs(settings), place.at("settings")))
        of_scenes = set(selected(self.scenes, _globs(scenes), place.at("scenes")))
        if frames.step not in (None, 1):
            raise TypeError("frames is a slice with a step; choose every n-th from the list")
        parts = [
            (name, self._numbers(name).within(frames))
            for name in self._names
            if name.split("/")[0] in of_settings and name.split("/")[-1] in of_scenes
        ]
        return FrameList(self, [part for part in parts if part[1]], compressed=compressed, channels=in_order(channels))

    def _unknown(self, name: object) -> InputError:
        near = ", ".join(near_names(str(name), list(self._names)))
        return InputError(self.place, f"holds no sequence {quoted(str(name))}", remedy=f"near it: {near}")


class Sample(TypedDict):
    """A frame as PyTorch's default collation takes it: arrays, numbers and texts.

    rgb: (H, W, 3) uint8, or float32 light of EXR files. depth_m: (H, W) float32, 0 = void. c2w: (4, 4) float64.
    stamp_s, depth_stamp_s: seconds. sequence, index: which frame it is.
    """

    rgb: NDArray[np.uint8] | NDArray[np.float32]
    depth_m: NDArray[np.float32]
    c2w: NDArray[np.float64]
    stamp_s: float
    depth_stamp_s: float
    sequence: str
    index: int


class FrameList(Sequence[Sample]):
    """Frames of several sequences in a row: a map-style dataset, for PyTorch's DataLoader and any number of workers."""

    def __init__(
        self,
        opened: Opened,
        parts: list[tuple[str, FrameNumbers]],
        *,
        compressed: bool = True,
        channels: tuple[str, ...] = (),
    ) -> None:
        """Take sequences with the numbers of their frames, at least one each."""
        self._opened = opened
        self._parts = parts
        self._compressed = compressed
        self._channels = channels

    @cached_property
    def _ends(self) -> list[int]:
        return list(accumulate(len(numbers) for _, numbers in self._parts))

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    def __repr__(self) -> str:
        return f"<{len(self):,} frames of {len(self._parts):,} sequences of {self._opened.place}>"

    def load(self) -> Self:
        """Load what the frames of each scene are made from, meshes above all; return the list.

        Workers that are forked from this process later share it. Those that are spawned load it themselves, each for
        itself, when they first need it.
        """
        of_scenes = {name.split("/")[-1]: (name, numbers) for name, numbers in reversed(self._parts)}
        for name, numbers in of_scenes.values():
            self._opened.load(name, numbers[0])
        return self

    def where(self, place: int) -> tuple[str, int]:
        """Return the sequence and the number of a frame in the list. Raises IndexError."""
        count, asked = len(self), _whole_number(place)
        if not -count <= asked < count:
            raise IndexError(f"the list has {count} frames, counted from 0; {asked} is none of them")
        asked %= count
        part = bisect_right(self._ends, asked)
        name, numbers = self._parts[part]
        return name, numbers[asked - (self._ends[part - 1] if part else 0)]

    def __getitem__(self, place: Any) -> Any:
        """Return a frame, or a list of those of a slice."""
        if isinstance(place, slice):
            return [self[index] for index in range(len(self))[place]]
        name, index = self.where(place)
        return self._sample(self._opened[name][index])

    def __iter__(self) -> Iterator[Sample]:
        for name, numbers in self._parts:
            sequence = self._opened[name]
            for index in numbers:
                yield self._sample(sequence[index])

    def _sample(self, frame: Frame) -> Sample:
        sample: Sample = {
            "rgb": frame.rgb if self._compressed else frame.rgb_uncompressed,
            "depth_m": frame.depth_m,
            "c2w": frame.c2w,
            "stamp_s": frame.stamp_s,
            "depth_stamp_s": frame.depth_stamp_s,
            "sequence": frame.sequence,
            "index": frame.index,
        }
        more: Any = {name: frame.image(name) for name in self._channels}
        return sample | more


def decoded(channel: str, name: str, data: bytes, place: str) -> NDArray[Any]:
    """Return the image of a channel in a file. place: of the file, for messages. Raises InputError."""
    try:
        return CHANNELS[channel].decode(data, name.rpartition(".")[2])
    except ValueError as error:
        raise InputError(place, str(error), remedy="make that dataset anew") from error


def _whole_number(value: Any) -> int:
    """Return a whole number of any type. Raises TypeError."""
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise TypeError(f"frames are counted by whole numbers, not by {type(value).__name__}")
    return value.__index__()


def _globs(given: str | Sequence[str]) -> list[str]:
    return [given] if isinstance(given, str) else list(given)


# Sequences opened where they are stored: in a folder, in tars, or in a plain layout.


KEPT = 64  # sequences whose files and poses stay in memory, a megabyte or two each
MEND = "'noisy-world verify' tells what else is damaged; the command that made the dataset mends it"


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
        self._records = _Records(folder / FRAMES, len(self.stored.rgb_files))

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
    """What frames.jsonl says of the images of a sequence; nothing where there is none."""

    def __init__(self, path: Path, count: int) -> None:
        """Find the lines. count: of the images. Raises InputError where they are not those of the images."""
        self.path = path
        self._table = FrameLines(path) if path.is_file() else None
        frames = range(count) if self._table is None else self._table.frames
        if len(set(frames)) != count:
            raise InputError(path, f"tells of {len(frames)} frames, and there are {count} images", remedy=MEND)
        self.numbers = FrameNumbers.of(list(frames))
        self._order = frames

    def place(self, frame: int) -> int:
        """Return the place of a frame among the images."""
        return bisect_left(self._order, frame)

    def record(self, place: int) -> FrameRecord | None:
        """Return the record of the frame at a place; None without any. Raises InputError where its line is damaged."""
        return None if self._table is None else self._table.record(place, MEND)


class FrameInFile(Frame):
    """A frame whose images are files, in a folder or in a tar."""

    @abstractmethod
    def _file(self, channel: str) -> str:
        """Return the name of a channel's file. Raises InputError where there is none."""

    @abstractmethod
    def _place(self, channel: str) -> str:
        """Return where a channel's file is, for messages."""

    @property
    def rgb_uncompressed(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB. Raises InputError where the file is a JPEG."""
        if not self._file(RGB.name).endswith((".png", ".exr")):
            remedy = "open the recipe for what it was before, or take rgb"
            raise InputError(self._place(RGB.name), "is compressed with loss", remedy=remedy)
        return self.rgb

    def _other(self, channel: str) -> NDArray[Any]:
        return decoded(channel, self._file(channel), self.image_bytes(channel), self._place(channel))


class FrameOfFiles(FrameInFile):
    """A frame in a folder."""

    def __init__(self, sequence: str, index: int, place: int, stored: StoredSequence, records: _Records) -> None:
        """Read its record. place: among the images."""
        self.sequence = sequence
        self.index = index
        record = records.record(place)
        self._done: dict[str, Any] = {} if record is None else record.perturbed
        if record is None:
            self.stamp_s = float(stored.stamps.rgb.seconds[place])
            self.depth_stamp_s = float(stored.stamps.depth.seconds[place])
        else:
            self.stamp_s = record.time_s
            self.depth_stamp_s = record.time_s if record.depth_time_s is None else record.depth_time_s
        self.c2w = stored.trajectory.c2w[place].copy()
        self._files = _files(stored, place, record, records.path)
        self._digests: dict[str, str] = {} if record is None else record.files
        self._folder = stored.folder

    @property
    def rgb(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB; light of an EXR. Raises InputError where the file is no image."""
        if self._files.rgb_file.suffix == ".exr":
            return self._files.light
        return as_bytes(self._files.rgb)

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void. Raises InputError where the file is no 16-bit image."""
        return self._files.depth_m

    def image_bytes(self, channel: str) -> bytes:
        """Return the content of the file of a channel's image."""
        data = _content(self._path(channel))
        if channel not in COLOUR_AND_DEPTH and sha256_of_bytes(data) not in self._digests.values():
            raise InputError(self._path(channel), "is not as it was written", remedy=MEND)
        return data

    def _file(self, channel: str) -> str:
        return self._path(channel).name

    def _place(self, channel: str) -> str:
        return str(self._path(channel))

    def _path(self, channel: str) -> Path:
        if channel in COLOUR_AND_DEPTH:
            file = self._files.depth_file if CHANNELS[channel].paired else self._files.rgb_file
            assert file is not None, "there is no depth"
            return file
        name = file_of(channel, self._digests)
        if name is None:
            raise InputError(self._folder / FRAMES, f"names no {CHANNELS[channel].spoken}", where=f"frame {self.index}")
        return self._folder / name

    @property
    def done(self) -> dict[str, Any]:
        """What frames.jsonl says was done to it; {} where there is none."""
        return self._done


def _files(stored: StoredSequence, place: int, record: FrameRecord | None, path: Path) -> StoredFrame:
    """Return the images of a frame: those that its record names, which pairs them."""
    frame = stored.frame(place)
    names = {} if record is None else {series_of(name): name for name in record.files}
    if record is None or not names or frame.depth_file is None:
        return frame
    rgb, depth = (
        names.get(series_of(file.relative_to(stored.folder).as_posix())) for file in (frame.rgb_file, frame.depth_file)
    )
    if rgb is None or depth is None or stored.folder / rgb != frame.rgb_file:
        where = f"frame {record.frame}"
        raise InputError(path, f"does not name {frame.rgb_file.name} and its depth", where=where, remedy=MEND)
    return replace(frame, depth_file=stored.folder / depth, depth_sha256=record.files[depth])


def _content(path: Path) -> bytes:
    try:
        return read_bytes(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}", remedy=MEND) from error


# A packed dataset, opened: frames are read by ranges of the tars, which the dataset's table gives.


class OpenedPacked(Opened):
    """A packed dataset. It can be pickled, and used in a process that was forked: each opens the address itself."""

    def __init__(self, place: Path | str) -> None:
        """Read the manifest and the table's index. Raises InputError where no finished packed dataset is there."""
        super().__init__(str(place))
        self._place = place
        self._lock = threading.Lock()
        self._open()

    def _open(self) -> None:
        self._process = os.getpid()
        self._packed = packed_dataset(self._place)
        _ = self._packed.table
        self._opened = lru_cache(maxsize=KEPT)(self._read)

    def __reduce__(self) -> tuple[Any, ...]:
        return OpenedPacked, (self._place,)

    @property
    def packed(self) -> PackedDataset:
        """The dataset, as this process has opened it: connections do not outlive a fork."""
        if self._process != os.getpid():
            self._lock = threading.Lock()  # a thread that is not here may have held the other one
            with self._lock:
                self._open()
        return self._packed

    @property
    def identity(self) -> dict[str, Any]:
        """As its manifest has it."""
        return self._packed.manifest["identity"]

    @property
    def _names(self) -> Collection[str]:
        return self._packed.sequences

    def _numbers(self, name: str) -> FrameNumbers:
        """Return the numbers without the table, where the manifest says that the sequence is whole."""
        made, planned = self._packed.manifest["frames"][name], self._packed.manifest["identity"]["sequences"].get(name)
        return FrameNumbers([range(made)]) if made == planned else self._sequence(name).frames

    def _sequence(self, name: str) -> "PackedSequence":
        _ = self.packed
        return self._opened(name)

    def _read(self, name: str) -> "PackedSequence":
        return PackedSequence(self, name)

    def rows(self, name: str, columns: list[str]) -> Any:
        """Return columns of a sequence's rows."""
        return self.packed.table.rows(name, columns)


class PackedSequence(OpenedSequence):
    """A sequence in a tar."""

    def __init__(self, opened: OpenedPacked, name: str) -> None:
        """Read its rows. Raises InputError where the table is damaged."""
        self.name = name
        self._opened = opened
        columns = ["frame", "time_s", "depth_time_s", "c2w", "perturbed", "tar"]
        for modality in opened.packed.modalities:
            columns += [f"{modality}_{what}" for what in ("file", "sha256", "offset", "size")]
        self._rows = opened.rows(name, columns)
        self._order: NDArray[np.int64] = self._rows.column("frame").to_numpy().astype(np.int64)
        if self._order.size != opened.packed.manifest["frames"][name] or (np.diff(self._order) <= 0).any():
            count = opened.packed.manifest["frames"][name]
            problem = f"{name}: its table has {self._order.size} rows, and its manifest says {count} frames, in order"
            raise InputError(opened.place, problem, remedy=AGAIN)
        self._numbers = FrameNumbers.of(self._order.tolist())

    def __reduce__(self) -> tuple[Any, ...]:
        return _sequence_of, (self._opened, self.name)

    @property
    def frames(self) -> FrameNumbers:
        """The numbers of its frames, as the table has them."""
        return self._numbers

    @property
    def camera(self) -> Intrinsics:
        """The intrinsics of its frames."""
        return self._opened.packed.camera(self.name)

    @property
    def distortion(self) -> Distortion | None:
        """The lens of its frames."""
        return self._opened.packed.optics(self.name).distortion

    @property
    def depth_camera(self) -> DepthCamera | None:
        """The camera of its depth."""
        return self._opened.packed.optics(self.name).depth

    def text(self, name: str) -> bytes | None:
        """Return a text file beside its images: they stand behind these in the tar."""
        if name not in self._opened.packed.manifest["files"].get(self.name, {}):
            return None
        texts = self._texts
        if name not in texts:
            raise InputError(self._opened.place, f"{self.name}: its tar holds no {name}", remedy=AGAIN)
        return texts[name]

    @cached_property
    def _texts(self) -> dict[str, bytes]:
        """The text files of its folder, by name; they are read with what lies behind the last image."""
        packed = self._opened.packed
        last = self._rows.slice(len(self._order) - 1, 1).to_pylist()[0]
        ends = [last[f"{modality}_offset"] + last[f"{modality}_size"] for modality in packed.modalities]
        start = -(-max(ends) // tarfile.BLOCKSIZE) * tarfile.BLOCKSIZE
        data = packed.store.read_range(last["tar"], start, packed.store.size(last["tar"]) or start)
        return texts_of(data, self.name)

    def _frame(self, index: int) -> "PackedFrame":
        (row,) = self._rows.slice(int(np.searchsorted(self._order, index)), 1).to_pylist()
        return PackedFrame(self._opened, self.name, row)


def _sequence_of(opened: Opened, name: str) -> OpenedSequence:
    return opened[name]


class PackedFrame(FrameInFile):
    """A frame in a tar. It can be pickled: it keeps its row and where the dataset is."""

    def __init__(self, opened: OpenedPacked, sequence: str, row: dict[str, Any]) -> None:
        """Take a row of the table."""
        self.sequence = sequence
        self.index = row["frame"]
        self.stamp_s = row["time_s"]
        self.depth_stamp_s = row["depth_time_s"]
        self.c2w = np.array(row["c2w"], dtype=np.float64).reshape(4, 4)
        self._opened = opened
        self._row = row

    @property
    def done(self) -> dict[str, Any]:
        """What frames.jsonl says was done to it."""
        return json.loads(self._row["perturbed"])

    @property
    def rgb(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB; light of an EXR. Raises InputError where the file is damaged."""
        if self._file(RGB.name).endswith(".exr"):
            return self._other(RGB.name)
        import cv2

        return self._decoded("rgb", cv2.IMREAD_COLOR_RGB)

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void. Raises InputError where the file is damaged."""
        import cv2

        steps = self._decoded("depth", cv2.IMREAD_UNCHANGED)
        return (steps / self._opened.packed.depth_scale_per_m).astype(np.float32)

    def image_bytes(self, channel: str) -> bytes:
        """Return the file of a channel's image. Raises InputError where it is not there, or not as it was written."""
        self._file(channel)
        packed, row = self._opened.packed, self._row
        start = row[f"{channel}_offset"]
        data = packed.store.read_range(row["tar"], start, start + row[f"{channel}_size"])
        if sha256_of_bytes(data) != row[f"{channel}_sha256"]:
            raise InputError(self._place(channel), "is not as it was written", remedy=AGAIN)
        return data

    def _decoded(self, modality: Modality, mode: int) -> NDArray[Any]:
        import cv2

        data = self.image_bytes(modality)
        image = None if damage(data) else cv2.imdecode(np.frombuffer(data, np.uint8), mode)
        if image is None:
            raise InputError(self._place(modality), "is no image", remedy=AGAIN)
        return image

    def _file(self, channel: str) -> str:
        if f"{channel}_file" not in self._row:
            raise InputError(self._opened.packed.store.text, f"holds no {CHANNELS[channel].spoken}")
        return self._row[f"{channel}_file"]

    def _place(self, channel: str) -> str:
        return f"{self._opened.packed.store.of(self._row['tar'])}: {self._file(channel)}"
