# SPDX-License-Identifier: GPL-3.0-or-later
"""A finished dataset, in a folder or packed: its manifest and its own records of its files."""

import io
import re
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS, in_order
from ..core.atomic_files import sha256_of_bytes
from ..core.errors import InputError
from ..core.frame_table import FRAMES, FrameRecord, files_in, read_records
from ..core.geometry import Intrinsics
from ..core.json_text import parse_json, read_json
from ..core.lens import DEPTH_CAMERA, DISTORTION, Optics
from ..core.trajectory import FrameStamps
from ..layouts import LAYOUTS, Layout, Modality
from ..layouts.cam_params import stated_optics
from .folder_state import IDENTITY, MANIFEST, OVERVIEW, WORK_FOLDER, DatasetState, check_no_links, read_dataset_state
from .identity import cameras_of, manifest_problem, optics_of, version_problem
from .store import FolderStore, Store, missing, open_store

# The files of a packed dataset, by their names.


TABLE = "manifest.parquet"
CROISSANT = "croissant.json"
CARD = "README.md"
FRAMES_FOLDER = "frames"  # in a tar
TAR_SUFFIX = ".tar"


@dataclass(frozen=True)
class PackedFile:
    """A file of a packed dataset. name: from its place on. size: bytes."""

    name: str
    size: int
    sha256: str


def tar_name(sequence: str) -> str:
    """Return the name of a sequence's tar, from the dataset's place on."""
    return f"{sequence}{TAR_SUFFIX}"


# Reading manifest.parquet: the rows of a sequence and the columns that are asked for, by ranges of the file.


AGAIN = "'noisy-world verify' tells what else is damaged; publish the dataset again, to another address"


class PackedTable:
    """The table of a packed dataset. Memory holds its index, and what is asked for; threads may share it."""

    def __init__(self, store: Store) -> None:
        """Read the table's index. Raises InputError where there is no table or it is damaged."""
        try:
            import pyarrow
            import pyarrow.parquet
        except ImportError as error:
            raise missing(store.text, "pyarrow") from error
        self._place = store.of(TABLE)
        # What pyarrow raises where a file is no Parquet, or its bytes are not what its index says.
        self._damage = (pyarrow.ArrowInvalid, pyarrow.ArrowNotImplementedError, pyarrow.ArrowKeyError)
        size = store.size(TABLE)
        if size is None:
            raise InputError(self._place, "is not there", remedy=AGAIN)
        self._lock = threading.Lock()
        try:
            file = pyarrow.PythonFile(_Ranges(store, TABLE, size), mode="r")
            self._file: Any = pyarrow.parquet.ParquetFile(file, pre_buffer=True)
            self._groups = self._groups_of_sequences()
        except (*self._damage, OSError) as error:
            raise self._damaged(error) from error

    def rows(self, sequence: str, columns: list[str]) -> Any:
        """Return some columns of a sequence's rows, in the order of its frames, as a table of pyarrow.

        Raises InputError where the table is damaged or has no such rows.
        """
        groups = self._groups.get(sequence)
        if groups is None:
            raise InputError(self._place, f"has no rows of {sequence}", remedy=AGAIN)
        try:
            with self._lock:
                return self._file.read_row_groups(groups, columns=columns, use_threads=False)
        except (*self._damage, OSError) as error:
            raise self._damaged(error) from error

    def _groups_of_sequences(self) -> dict[str, list[int]]:
        """Return the row groups of each sequence, which begin and end with it, by the statistics of their columns."""
        leaves = {self._file.schema.column(place).path: place for place in range(len(self._file.schema))}
        if not leaves.keys() >= {"setting", "scene"}:
            raise InputError(self._place, "says neither setting nor scene of its rows", remedy=AGAIN)
        about = self._file.metadata
        found: dict[str, list[int]] = {}
        for group in range(about.num_row_groups):
            lines = [about.row_group(group).column(leaves[name]).statistics for name in ("setting", "scene")]
            if not all(item is not None and item.has_min_max and item.min == item.max for item in lines):
                raise InputError(self._place, "its rows are not grouped by sequence", remedy=AGAIN)
            found.setdefault("/".join(str(item.min) for item in lines), []).append(group)
        return found

    def _damaged(self, error: Exception) -> InputError:
        problem = " ".join(str(error).split())
        return InputError(self._place, f"is damaged: {problem}", remedy=AGAIN)


class _Ranges(io.RawIOBase):
    """A file in a store that is read by ranges, and only where it is asked for."""

    def __init__(self, store: Store, name: str, size: int) -> None:
        super().__init__()
        self._store = store
        self._name = name
        self._size = size
        self._at = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self._at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def size(self) -> int:
        """The file's size, as pyarrow asks for it."""
        return self._size

    def read(self, size: int = -1) -> bytes:
        stop = self._size if size is None or size < 0 else min(self._size, self._at + size)
        data = b"" if stop <= self._at else self._store.read_range(self._name, self._at, stop)
        self._at += len(data)
        return data


NOTHING = "holds no dataset of Noisy World"
UNFINISHED = "its run has not come to its end"
GO_ON = "run the same command again; it goes on"
MENDS = "run the command that made the dataset again: it mends what is not as it was written"

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
class FinishedDataset:
    """A finished dataset. store: holds its files. manifest: as read."""

    store: Store
    manifest: dict[str, Any]

    @property
    def identity(self) -> dict[str, Any]:
        """What the dataset was made from."""
        return self.manifest["identity"]

    @property
    def state(self) -> DatasetState:
        """What is there, as of a dataset in a folder."""
        return _state(self.manifest)

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

    @property
    def depth_scale_per_m(self) -> float:
        """Steps of the depth images per metre."""
        return float(self.manifest["depth_scale_per_m"])

    def camera(self, sequence: str) -> Intrinsics:
        """Return the intrinsics of a sequence."""
        return self._cameras[sequence.split("/")[1]]

    def optics(self, sequence: str) -> Optics:
        """Return what the cameras of a sequence have beyond one pinhole."""
        return stated_optics(Path("manifest.json"), self._optics[sequence.split("/")[1]])

    @cached_property
    def _optics(self) -> dict[str, dict[str, Any]]:
        return optics_of(self.identity)

    @cached_property
    def distorts(self) -> bool:
        """Whether the lens of any scene does."""
        return any(DISTORTION in content for content in self._optics.values())

    @cached_property
    def seen_apart(self) -> bool:
        """Whether the depth of any scene has a camera of its own."""
        return any(DEPTH_CAMERA in content for content in self._optics.values())

    @cached_property
    def _cameras(self) -> dict[str, Intrinsics]:
        return cameras_of(self.identity)


@dataclass(frozen=True)
class Content(FinishedDataset):
    """A finished dataset whose text files lie in a folder; its images may lie elsewhere."""

    store: FolderStore

    def suffix(self, modality: Modality) -> str:
        """Return the end of the names of its images, such as "png"."""
        return CHANNELS[modality].recorded_suffix(self.identity["output"])

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
        """Return a file. Raises InputError where it is not as it was written, StorageError where it cannot be read."""
        data = self.store.read(name)
        if data is None or sha256_of_bytes(data) != sha256:
            problem = "is not there" if data is None else "is not as it was written"
            raise InputError(self.store.of(name), problem, remedy=MENDS)
        return data

    def files(self, sequence: str) -> Iterator[tuple[int, dict[str, str]]]:
        """Yield the frames of a sequence, each with the SHA-256 of its images by name."""
        data = self.file(f"{sequence}/{FRAMES}", self.manifest["files"][sequence][FRAMES])
        yield from files_in(data.decode().splitlines(keepends=True))

    def frames(self, sequence: str) -> list[FrameImages]:
        """Return a sequence's frames, in order. Raises StorageError, InputError where its text files are damaged."""
        self.file(f"{sequence}/{FRAMES}", self.manifest["files"][sequence][FRAMES])
        records = list(read_records(self.store.folder / sequence / FRAMES))
        time_s = np.array([record.time_s for record in records])
        poses = self.layout.written_poses(self.store.folder / sequence, time_s)
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

    def reader(self, sequence: str, frames: list[FrameImages]) -> ReadImage:
        """Return what reads a sequence's images, where they lie in the folder too; see `ImageReaders`."""
        del frames
        return lambda name, sha256: self.file(f"{sequence}/{name}", sha256)


class ImageReaders(Protocol):
    """Where the images of a dataset are."""

    def reader(self, sequence: str, frames: list[FrameImages]) -> ReadImage:
        """Return what reads a sequence's images, in the order of the frames; threads have one each.

        It raises StorageError or InputError for an image that is not as it was written.
        """
        ...


class Packed(FinishedDataset):
    """A finished packed dataset."""

    @cached_property
    def described(self) -> dict[str, PackedFile]:
        """Its table and tars with their sizes and hashes, by name, as croissant.json says; {} without a usable one."""
        data = self.store.read(CROISSANT)
        try:
            items = () if data is None else parse_json(data.decode())["distribution"]
            return {file.name: file for item in items if (file := _file_of(item)) is not None}
        except (ValueError, KeyError, TypeError, AttributeError):
            return {}

    @cached_property
    def table(self) -> PackedTable:
        """Its table. Raises InputError where there is none or it is damaged."""
        return PackedTable(self.store)

    def check_table(self) -> None:
        """Hash the table. Raises InputError where it is not as croissant.json says."""
        note, size = self.described.get(TABLE), self.store.size(TABLE)
        if note is None:
            raise InputError(self.store.of(CROISSANT), "is missing or damaged", remedy=MENDS)
        if size is None or size != note.size or self.store.sha256(TABLE, size) != note.sha256:
            raise InputError(self.store.of(TABLE), "is not as it was written", remedy=MENDS)

    def files(self, sequence: str) -> Iterator[tuple[int, dict[str, str]]]:
        """Yield the frames of a sequence, each with the SHA-256 of its images by name, as the table has them."""
        kinds = [f"{modality}_{what}" for modality in self.modalities for what in ("file", "sha256")]
        rows = self.table.rows(sequence, ["frame", *kinds])
        names, digests = ([rows.column(kind).to_pylist() for kind in kinds[at::2]] for at in (0, 1))
        for place, frame in enumerate(rows.column("frame").to_pylist()):
            yield frame, {name[place]: digest[place] for name, digest in zip(names, digests, strict=True)}


def _file_of(item: Any) -> PackedFile | None:
    """Return a file of croissant.json's distribution; None for what is no file."""
    if item["@type"] != "cr:FileObject":
        return None
    return PackedFile(str(item["@id"]), int(item["contentSize"].removesuffix(" B")), str(item["sha256"]))


def _like(name: str) -> str:
    return re.sub(r"\d+", "#", name)


# --- finding one ---


def is_packed(place: Path | str) -> bool:
    """Tell whether a place has a packed dataset, finished or begun, and not one of files in folders.

    At an address there are no others.
    """
    if isinstance(place, str):
        return True
    if any(path.is_file() for path in place.glob(f"*/*/{FRAMES}")):
        return False
    if (place / TABLE).is_file():
        return True
    try:
        begun = read_json(place / WORK_FOLDER / IDENTITY)
    except (FileNotFoundError, ValueError):
        return False
    return isinstance(begun, dict) and begun.keys() == {"identity", "chosen"}


def open_finished(place: Path | str) -> Content | Packed:
    """Return the finished dataset in a folder or at an address.

    Raises InputError where there is none, or one that is not finished, StorageError where the store refuses,
    MissingDependencyError where a package that reaches it is missing.
    """
    if isinstance(place, Path) and not is_packed(place):
        return read_content(place)
    return open_packed(place)


def read_content(folder: Path) -> Content:
    """Return the finished dataset in a folder. Raises InputError where there is none."""
    state = read_dataset_state(folder) if folder.is_dir() else None
    if state is None:
        raise InputError(folder, NOTHING, remedy="name the folder that generate wrote")
    if state.problem:
        raise InputError(folder, state.problem)
    check_no_links(folder, state.sequences)
    if state.manifest is None or (folder / WORK_FOLDER / IDENTITY).exists():
        raise InputError(folder, UNFINISHED, remedy=GO_ON)
    return Content(FolderStore(folder), state.manifest)


def read_written(folder: Path) -> Content:
    """Return what a dataset holds whose manifest was just written to a folder."""
    return Content(FolderStore(folder), read_json(folder / MANIFEST))


def open_packed(place: Path | str) -> Packed:
    """Return the finished packed dataset at a place; see `open_finished`."""
    store = open_store(place)
    state = sealed_state(store)
    if state is None and store.read(f"{WORK_FOLDER}/{IDENTITY}") is not None:
        raise InputError(store.text, UNFINISHED, remedy=GO_ON)
    if state is None:
        raise InputError(store.text, NOTHING, remedy="name the place that generate or publish wrote")
    if state.problem or state.manifest is None:
        raise InputError(store.text, state.problem)
    return Packed(store, state.manifest)


def sealed_state(store: Store) -> DatasetState | None:
    """Return what the manifest of a packed dataset says; None where there is none."""
    data = store.read(MANIFEST)
    if data is None:
        return None
    value: Any = None
    try:
        value = parse_json(data.decode())
        problem = manifest_problem(value) or version_problem(value["identity"])
    except ValueError as error:
        problem = str(error)
    if problem:
        return DatasetState(None, None, frozenset(), holds_frames=True, problem=f"{MANIFEST} {problem}")
    return _state(value)


def _state(manifest: dict[str, Any]) -> DatasetState:
    identity = manifest["identity"]
    return DatasetState(identity, manifest, frozenset(identity["sequences"]), holds_frames=True, ended=True)
