# SPDX-License-Identifier: GPL-3.0-or-later
"""What a finished dataset holds, by its manifest and its text files; its images may lie elsewhere."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.channels import CHANNELS, in_order
from ..core.datasets.dataset_state import IDENTITY, MANIFEST, OVERVIEW, WORK_FOLDER, read_dataset_state
from ..core.datasets.json_text import read_json
from ..core.datasets.layouts import LAYOUTS, Layout, Modality
from ..core.datasets.place import check_no_links
from ..core.datasets.provenance import cameras_of
from ..core.datasets.records import FRAMES, FrameRecord, read_records
from ..core.datasets.storage import sha256_of_bytes
from ..core.errors import StorageError
from ..core.geometry import Intrinsics
from ..core.regular_files import read_bytes
from ..core.trajectories.stamps import FrameStamps

ReadImage: TypeAlias = Callable[[str, str], bytes]
"""Returns the content of an image of a sequence: by its name inside the sequence's folder, and its SHA-256."""


@dataclass(frozen=True)
class FrameImages:
    """A frame of a sequence. c2w (4, 4): of the colour camera. images: by modality the file's name and its SHA-256."""

    record: FrameRecord
    c2w: NDArray[np.float64]
    images: dict[Modality, tuple[str, str]]

    @property
    def number(self) -> int:
        """The frame's number in its sequence."""
        return self.record.frame

    @property
    def depth_time_s(self) -> float:
        """When its depth was taken."""
        return self.record.time_s if self.record.depth_time_s is None else self.record.depth_time_s


@dataclass(frozen=True)
class Content:
    """A finished dataset. folder: holds its manifest and text files. manifest: as read."""

    folder: Path
    manifest: dict[str, Any]

    @property
    def identity(self) -> dict[str, Any]:
        """What the dataset was made from."""
        return self.manifest["identity"]

    @property
    def sequences(self) -> list[str]:
        """The folders of its sequences, sorted."""
        return sorted(self.manifest["frames"])

    @cached_property
    def layout(self) -> Layout:
        """How its files lie."""
        return LAYOUTS[self.identity["output"]["layout"]]

    @property
    def modalities(self) -> tuple[Modality, ...]:
        """The names of its channels, in the registry's order."""
        return in_order(self.identity["output"]["modalities"])

    def suffix(self, modality: Modality) -> str:
        """Return the end of the names of its images, such as "png"."""
        return CHANNELS[modality].suffix_told(self.identity["output"])

    @property
    def depth_scale_per_m(self) -> float:
        """Steps of the depth images per metre."""
        return float(self.manifest["depth_scale_per_m"])

    def camera(self, sequence: str) -> Intrinsics:
        """Return the intrinsics of a sequence."""
        return cameras_of(self.identity)[sequence.split("/")[1]]

    def texts(self, sequence: str) -> dict[str, str]:
        """Return the text files that belong to a sequence: SHA-256 by name from the dataset's folder on, sorted."""
        setting, _ = sequence.split("/")
        files = self.manifest["files"]
        own = {f"{sequence}/{name}": digest for name, digest in files[sequence].items()}
        beside = {
            name: digest
            for name, digest in files.items()
            if isinstance(digest, str) and name.rpartition("/")[0] == setting
        }
        return dict(sorted((own | beside).items()))

    def file(self, name: str, sha256: str) -> bytes:
        """Return a file. Raises StorageError where it is not as the manifest says."""
        path = self.folder / name
        try:
            data = read_bytes(path)
        except OSError as error:
            raise StorageError(f"{path}: cannot be read: {error.strerror}; generate makes such files again") from error
        if sha256_of_bytes(data) != sha256:
            raise StorageError(f"{path}: is not as it was written; generate makes such files again")
        return data

    def frames(self, sequence: str) -> list[FrameImages]:
        """Return a sequence's frames, in order. Raises StorageError, InputError where its text files are damaged."""
        self.file(f"{sequence}/{FRAMES}", self.manifest["files"][sequence][FRAMES])
        records = list(read_records(self.folder / sequence / FRAMES))
        time_s = np.array([record.time_s for record in records])
        poses = self.layout.written_poses(self.folder / sequence, time_s)
        return [FrameImages(record, c2w, self._images(record)) for record, c2w in zip(records, poses, strict=True)]

    def _images(self, record: FrameRecord) -> dict[Modality, tuple[str, str]]:
        """Return a frame's images by modality: a name is of one where it is like the layout's, digits aside."""
        found = {_like(name): (name, digest) for name, digest in record.files.items()}
        return {modality: found[like] for modality, like in self._alike.items()}

    @cached_property
    def _alike(self) -> dict[Modality, str]:
        """What the names of each channel's images are like."""
        stamps = FrameStamps.of([0.0])
        return {
            modality: _like(CHANNELS[modality].name_in(self.layout, 0, stamps, self.suffix(modality)))
            for modality in self.modalities
        }

    @property
    def overview(self) -> bytes | None:
        """The contact sheet, where the dataset has one."""
        digest = self.manifest["files"].get(OVERVIEW)
        return None if digest is None else self.file(OVERVIEW, digest)


class Images(Protocol):
    """Where the images of a dataset are."""

    def reader(self, sequence: str, frames: list[FrameImages]) -> ReadImage:
        """Return what reads a sequence's images, in the order of the frames; threads have one each.

        It raises StorageError for an image that is not as it was written.
        """
        ...


class FolderImages:
    """The images of a dataset in a folder."""

    def __init__(self, content: Content) -> None:
        self._content = content

    def reader(self, sequence: str, frames: list[FrameImages]) -> ReadImage:
        """Return what reads a sequence's images."""
        del frames
        return lambda name, sha256: self._content.file(f"{sequence}/{name}", sha256)


def read_written(folder: Path) -> Content:
    """Return what a dataset holds whose manifest was just written to a folder."""
    return Content(folder, read_json(folder / MANIFEST))


def _like(name: str) -> str:
    return re.sub(r"\d+", "#", name)


def read_content(folder: Path) -> Content:
    """Return what a finished dataset in a folder holds. Raises StorageError where there is none."""
    standing = read_dataset_state(folder) if folder.is_dir() else None
    if standing is None:
        raise StorageError(f"{folder}: holds no dataset of Noisy World; name the folder that generate wrote")
    if standing.problem:
        raise StorageError(f"{folder}: {standing.problem}")
    check_no_links(folder, standing.sequences)
    if standing.manifest is None or (folder / WORK_FOLDER / IDENTITY).exists():
        raise StorageError(f"{folder}: is not finished; run generate again, which goes on where it ended")
    return Content(folder, standing.manifest)
