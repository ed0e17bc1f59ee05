# SPDX-License-Identifier: GPL-3.0-or-later
"""A packed dataset, opened: frames are read by ranges of the tars, which the dataset's table gives."""

import json
import os
import tarfile
import threading
from collections.abc import Collection
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.channels import CHANNELS
from ..core.channels.rgb import CHANNEL as RGB
from ..core.datasets.image_files import damage
from ..core.datasets.layouts import Modality
from ..core.datasets.storage import sha256_of_bytes
from ..core.errors import InputError
from ..core.geometry import Intrinsics
from ..core.optics import DepthCamera, Distortion
from ..storage.finished import Packed, open_packed
from ..storage.packed_table import AGAIN
from ..storage.packed_tar import texts_of
from .frame_numbers import FrameNumbers
from .opened import Frame, Opened, OpenedSequence, decoded

KEPT = 64  # sequences whose rows stay in memory, a megabyte each for some thousand frames


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
        self._packed = open_packed(self._place)
        _ = self._packed.table
        self._opened = lru_cache(maxsize=KEPT)(self._read)

    def __reduce__(self) -> tuple[Any, ...]:
        return OpenedPacked, (self._place,)

    @property
    def packed(self) -> Packed:
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


class PackedFrame(Frame):
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
        if self._row.get("rgb_file", "").endswith(".exr"):
            return self._other(RGB.name)
        import cv2

        return self._decoded("rgb", cv2.IMREAD_COLOR_RGB)

    @property
    def rgb_uncompressed(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Colour (H, W, 3), RGB. Raises InputError where the file is a JPEG."""
        if not self._row.get("rgb_file", ".png").endswith((".png", ".exr")):
            remedy = "open the recipe for what it was before, or take rgb"
            raise InputError(self._place("rgb"), "is compressed with loss", remedy=remedy)
        return self.rgb

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void. Raises InputError where the file is damaged."""
        import cv2

        steps = self._decoded("depth", cv2.IMREAD_UNCHANGED)
        return (steps / self._opened.packed.depth_scale_per_m).astype(np.float32)

    def _other(self, channel: str) -> NDArray[Any]:
        return decoded(channel, self._row.get(f"{channel}_file", ""), self.image_bytes(channel), self._place(channel))

    def image_bytes(self, channel: str) -> bytes:
        """Return the file of a channel's image. Raises InputError where it is not there, or not as it was written."""
        packed, row = self._opened.packed, self._row
        if f"{channel}_offset" not in row:
            raise InputError(packed.store.text, f"holds no {CHANNELS[channel].spoken}")
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

    def _place(self, modality: Modality) -> str:
        packed = self._opened.packed
        return f"{packed.store.of(self._row['tar'])}: {self._row.get(f'{modality}_file', CHANNELS[modality].spoken)}"
