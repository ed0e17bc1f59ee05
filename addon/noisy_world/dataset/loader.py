# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset or a recipe that is open: sequences by name, frames by number, and lists of frames for training.

All of it can be pickled: another process opens the same again.
"""

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import accumulate, islice
from typing import Any, Self, TypedDict, overload

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS, COLOUR_AND_DEPTH, in_order
from ..channels.depth import CHANNEL as DEPTH
from ..channels.rgb import CHANNEL as RGB
from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.lens import DepthCamera, Distortion
from ..core.machine import end_opencv_threads_before_forks
from ..core.schema import ConfigPath, quoted
from ..preset.names import near_names, selected
from .recipe import FrameNumbers


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
