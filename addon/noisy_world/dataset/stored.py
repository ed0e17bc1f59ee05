# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset where it is stored: what it is, its records, and its files by their names in the layout.

It lies in a folder, or in tars, or is under way as shards at an address; who asks one does not ask which. Reading
changes nothing and takes no lock, so it may be done while a run writes.
"""

import contextlib
import os
import re
import threading
from collections import Counter, deque
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS, in_order
from ..core.atomic_files import Hasher, sha256_of_bytes
from ..core.errors import InputError, InterruptedRunError
from ..core.file_access import open_text, parse_json, read_json
from ..core.frame_table import FRAMES, FrameRecord, Journals, files_in, joined_records, read_records
from ..core.geometry import Intrinsics
from ..core.lens import DEPTH_CAMERA, DISTORTION, Optics
from ..core.trajectory import FrameStamps
from ..layouts import LAYOUTS, Layout, Modality
from ..layouts.cam_params import stated_optics
from .folder_state import (
    IDENTITY,
    MANIFEST,
    OVERVIEW,
    RUN,
    WORK_FOLDER,
    DatasetState,
    check_no_links,
    read_dataset_state,
)
from .identity import cameras_of, manifest_problem, optics_of, version_problem
from .store import FolderStore, Store, open_store
from .tar_files import (
    CARD,
    CROISSANT,
    TABLE,
    TAR_SUFFIX,
    PackedFile,
    PackedTable,
    TarContent,
    described_files,
    tar_contents,
    tar_name,
)

NOTHING = "holds no dataset of Noisy World"
UNFINISHED = "its run has not come to its end"
GO_ON = "run the same command again; it goes on"
MENDS = "run the command that made the dataset again: it mends what is not as it was written"
STOPPED = "stopped; nothing was written, and verify begins at the beginning"
RECENT = 200  # records of a journal, the last ones, of which it is asked when they were written

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


class ImageReaders(Protocol):
    """Where the images of a dataset are."""

    def reader(self, sequence: str, frames: list[FrameImages]) -> ReadImage:
        """Return what reads a sequence's images, in the order of the frames; threads have one each.

        It raises StorageError or InputError for an image that is not as it was written.
        """
        ...


# --- what there is of a sequence ---


Lines: TypeAlias = Iterable[tuple[int, dict[str, str]]]
"""The frame and the files, SHA-256 by name, of each record of a journal or a table."""

Recorded: TypeAlias = dict[str, tuple[int, str]]
"""The frame and the SHA-256 of each file that records name, by its name in the sequence."""

Digests: TypeAlias = Mapping[str, str | None]
"""The SHA-256 of files by name, None where one cannot be read; of what is not to be hashed the recorded one."""


@dataclass(frozen=True)
class JournalTimes:
    """When the newest records of a journal were written.

    times_s: of their files, since the epoch. frames_each: what part of a frame a record is: half where colour and depth
    have records of their own. cut: whether the journal goes back further.
    """

    times_s: tuple[float, ...]
    frames_each: float
    cut: bool


@dataclass(frozen=True)
class FileInventory:
    """A sequence as far as it is there.

    done: how many of its frames are finished. lost: files that a record names and that are not there. damaged: files
    whose content is another than was recorded, which only hashing finds. Names begin at the dataset. written: when the
    newest frames of each journal were written.
    """

    done: int
    lost: tuple[str, ...] = ()
    damaged: tuple[str, ...] = ()
    written: tuple[JournalTimes, ...] = ()


@dataclass(frozen=True)
class StoredPart:
    """What holds some of a sequence's files, such as its folder, its tar or a shard, and what tells of them.

    journals: returns what tells of them, one after another. there: returns those of some files that it holds; they are
    hashed where a hasher is given. written: returns when a run wrote the files of the newest records, None where it was
    none that did.
    """

    journals: Callable[[], Iterable[Lines]]
    there: Callable[[Recorded, Hasher | None], Digests]
    written: Callable[[int, Sequence[dict[str, str]], int], JournalTimes | None]

    def recorded(self, asked: Container[int] | None, images_each: int) -> tuple[Recorded, list[JournalTimes]]:
        """Return what is recorded of the frames that are asked for, and when the newest of each journal was written."""
        found: Recorded = {}
        times: list[JournalTimes] = []
        for place, lines in enumerate(self.journals()):
            newest: deque[dict[str, str]] = deque(maxlen=RECENT)
            for frame, files in lines:
                if asked is None or frame in asked:
                    found |= {name: (frame, digest) for name, digest in files.items()}
                newest.append(files)
            if newest and (lately := self.written(place, newest, images_each)):
                times.append(lately)
        return found, times


def inventory(
    folder: str,
    parts: Iterable[StoredPart],
    images_each: int,
    asked: Container[int] | None,
    hasher: Hasher | None = None,
) -> FileInventory:
    """Return what there is of a sequence.

    folder: the sequence's. parts: where its files may be; the dataset's own folder last, as files are moved there while
    this looks. images_each: how many images a frame has. asked: the frames that are asked for; None for all. hasher:
    hashes every file; None to see only whether each is there.
    """
    # All records before any file: files are written, and moved, before their records.
    recorded = [(part, *part.recorded(asked, images_each)) for part in parts]
    named: dict[str, int] = {}  # the frame of each file
    intact: set[str] = set()
    damaged: set[str] = set()
    for part, files, _ in recorded:
        named |= {name: frame for name, (frame, _) in files.items()}
        digests = part.there(files, hasher)
        wrong = {name for name, digest in digests.items() if digest != files[name][1]}
        damaged |= wrong
        intact |= digests.keys() - wrong
    images = Counter(named[name] for name in intact)
    return FileInventory(
        sum(count >= images_each for count in images.values()),
        tuple(f"{folder}/{name}" for name in sorted(named.keys() - intact - damaged)),
        tuple(f"{folder}/{name}" for name in sorted(damaged - intact)),
        tuple(item for *_, times in recorded for item in times),
    )


def folder_part(
    images: Path,
    name: str,
    journals: Journals | None = None,
    records: Sequence[FrameRecord] = (),
) -> StoredPart:
    """Return a folder with a sequence's images as what holds them: the dataset's, or a shard's.

    name: the sequence's folder. journals: of the working folder. records: of a finished shard, which has no journals.
    """

    def all_lines() -> Iterator[Lines]:
        yield _lines(images / FRAMES)
        yield from (files_in(lines) for _, lines in (journals.lines(name) if journals else ()))
        if records:
            yield [(record.frame, record.files) for record in records]

    def there(files: Recorded, hasher: Hasher | None) -> Digests:
        names = sorted(files.keys() & _listed(images, files))
        if hasher is None:
            return {name: files[name][1] for name in names}
        return dict(zip(names, hasher.ahead(f"{images}/{name}" for name in names), strict=True))

    def written(place: int, newest: Sequence[dict[str, str]], images_each: int) -> JournalTimes | None:
        return _written(images, newest, images_each) if place else None  # frames.jsonl is the first

    return StoredPart(all_lines, there, written)


def hashed_part(
    records: Iterable[FrameRecord], digests: Callable[[Recorded], Digests], time_s: float | None = None
) -> StoredPart:
    """Return what has been read as a whole, a tar or a shard at an address, as what holds files of a sequence.

    records: what it says of them. digests: returns those of some files that it holds. time_s: when all were written,
    where they are a run's.
    """
    lines = [(record.frame, record.files) for record in records]

    def written(_place: int, _newest: Sequence[dict[str, str]], images_each: int) -> JournalTimes | None:
        if time_s is None:
            return None
        return JournalTimes((time_s,), sum(len(files) for _, files in lines) / images_each, cut=False)

    return StoredPart(lambda: [lines], lambda files, _: digests(files), written)


def journals_of(work: Path) -> Journals:
    """Return the journals in a working folder."""
    journals = Journals(work)
    journals.read_on()
    return journals


def _lines(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the frame and the files of each record of a file, without torn lines; none where there is no such file."""
    if path.is_file():
        with contextlib.suppress(OSError), open_text(path, errors="replace") as file:
            yield from files_in(file)


def _written(images: Path, newest: Sequence[dict[str, str]], images_each: int) -> JournalTimes | None:
    times_s: list[float] = []
    count = 0
    for files in newest:
        name = next(iter(files), None)
        try:
            times_s += [] if name is None else [(images / name).stat().st_mtime]
        except OSError:
            continue  # lost, or moved on while this looks
        count += len(files)
    cut = len(newest) == RECENT
    return JournalTimes(tuple(times_s), count / images_each / len(times_s), cut) if times_s else None


def _folders(names: Iterable[str]) -> set[str]:
    return {name.rpartition("/")[0] for name in names}


def _entries(folder: Path) -> list[str]:
    """Return the names in a folder; none where there is no such folder."""
    try:
        return os.listdir(folder)  # noqa: PTH208 - names alone, of thousands
    except OSError:
        return []


def _listed(images: Path, names: Iterable[str]) -> frozenset[str]:
    """Return the names of the files that there are in the folders of some files, relative to `images`."""
    folders = _folders(names)
    return frozenset(f"{name}/{entry}" if name else entry for name in folders for entry in _entries(images / name))


# --- the dataset ---


@dataclass(frozen=True)
class SequenceFiles:
    """The files of a sequence as they are, by their names in its folder.

    records: what its frames.jsonl says, by frame. digests: yields the SHA-256 of files; None for one that is not there.
    names: returns those of all files. damaged_whole: the tar that holds them where it is not as it was written, or "".
    """

    records: dict[int, FrameRecord]
    digests: Callable[[Sequence[str]], Iterator[str | None]]
    names: Callable[[], set[str]]
    damaged_whole: str = ""


class StoredDataset:
    """A dataset where it is stored. store: the place. state: what it is.

    One that is under way at an address is known by its shards alone: no file is there under its name yet.
    """

    def __init__(self, store: Store, state: DatasetState, parts: Mapping[str, list[StoredPart]] | None = None) -> None:
        """Take the place. parts: what shards hold of its sequences, by the sequence's folder."""
        self.store = store
        self.state = state
        self._parts = parts or {}

    # --- what it is ---

    @property
    def manifest(self) -> dict[str, Any]:
        """Its manifest, as read, where its run has come to its end."""
        assert self.state.manifest is not None, "it is finished"
        return self.state.manifest

    @property
    def identity(self) -> dict[str, Any]:
        """What the dataset was made from."""
        assert self.state.identity is not None, "it is known"
        return self.state.identity

    @property
    def sequences(self) -> list[str]:
        """The folders of its finished sequences, sorted."""
        return sorted(self.manifest["frames"])

    @cached_property
    def layout(self) -> Layout:
        """How its files lie."""
        return LAYOUTS[self.identity["output"]["layout"]]

    @property
    def modalities(self) -> tuple[Modality, ...]:
        """The names of its channels, in the registry's order."""
        return in_order(self.identity["output"]["modalities"])

    @cached_property
    def images_each(self) -> int:
        """How many images a frame has."""
        return len(self.identity["output"].get("modalities") or ("rgb", "depth"))

    @property
    def depth_scale_per_m(self) -> float:
        """Steps of the depth images per metre."""
        return float(self.manifest["depth_scale_per_m"])

    def camera(self, sequence: str) -> Intrinsics:
        """Return the intrinsics of a sequence."""
        return self._cameras[sequence.split("/")[1]]

    def optics(self, sequence: str) -> Optics:
        """Return what the cameras of a sequence have beyond one pinhole."""
        return stated_optics(Path(MANIFEST), self._optics[sequence.split("/")[1]])

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

    @property
    def text_files(self) -> dict[str, str]:
        """The files that the manifest names, SHA-256 by name from the dataset on; none of another version's."""
        named: dict[str, str] = {}
        for name, found in self.state.files.items():
            named |= {name: found} if isinstance(found, str) else {f"{name}/{key}": found[key] for key in found}
        return named

    # --- its files; names begin at the dataset ---

    def recorded(self) -> set[str]:
        """Return the sequences whose records are there."""
        return set(self._parts)

    def has(self, sequence: str) -> bool:
        """Tell whether there is anything of a sequence."""
        return sequence in self._parts

    def each(self, sequences: Sequence[str], stop: threading.Event) -> Iterator[tuple[str, SequenceFiles]]:
        """Yield some sequences with their files, to be hashed. Raises InterruptedRunError where `stop` is set."""
        del sequences, stop
        yield from ()

    def holds(self, name: str) -> bool:
        """Tell whether a text file is there, as far as that is known without reading a tar."""
        del name
        return False

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a text file, "" where it cannot be read, None where it is not there; after `each`."""
        del name
        return None

    def beside(self, sequences: set[str]) -> set[str]:
        """Return the files that belong to none of these sequences, and not to the dataset itself."""
        del sequences
        return set()

    def own_problems(self, *, check: bool) -> tuple[list[str], list[str]]:
        """Return which files that only describe the others are lost and which damaged. check: whether to hash them."""
        del check
        return [], []

    def inventories(
        self, wanted: Sequence[tuple[str, Container[int] | None]], *, check: bool
    ) -> Iterator[FileInventory]:
        """Yield what there is of some sequences, each with the frames that are asked for, None for all.

        check: whether to hash every file.
        """
        for sequence, asked in wanted:
            yield self._inventory(sequence, asked, check=check)

    def _inventory(self, sequence: str, asked: Container[int] | None, *, check: bool) -> FileInventory:
        del check
        return inventory(sequence, self._parts.get(sequence, ()), self.images_each, asked)

    def files(self, sequence: str) -> Lines:
        """Yield the frames of a finished sequence, each with the SHA-256 of its images by name.

        Raises InputError where its records are not as they were written.
        """
        raise InputError(self.store.text, UNFINISHED, where=sequence, remedy=GO_ON)

    def check_records(self) -> None:
        """Raise InputError where what holds the records of all sequences is not as it was written."""


class FolderDataset(StoredDataset):
    """A dataset in a folder, finished or under way; its images may lie elsewhere. A file with names is hashed once."""

    store: FolderStore

    def __init__(self, folder: Path, state: DatasetState, parts: Mapping[str, list[StoredPart]] | None = None) -> None:
        """Take the folder. parts: as of `StoredDataset`."""
        super().__init__(FolderStore(folder), state, parts)
        self._folder = folder
        self._hasher = Hasher()

    def recorded(self) -> set[str]:
        """Return the sequences whose frames.jsonl is there."""
        return {path.parent.relative_to(self._folder).as_posix() for path in self._folder.glob(f"*/*/{FRAMES}")}

    def has(self, sequence: str) -> bool:
        """Tell whether there is a folder of a sequence."""
        return (self._folder / sequence).is_dir()

    def each(self, sequences: Sequence[str], stop: threading.Event) -> Iterator[tuple[str, SequenceFiles]]:
        """Yield some sequences with their files, which are hashed in threads."""
        for name in sequences:
            if stop.is_set():
                raise InterruptedRunError(STOPPED)
            folder = self._folder / name
            records = joined_records(read_records(folder / FRAMES))
            yield name, SequenceFiles(records, partial(self._digests, folder), partial(_all_below, folder))

    def _digests(self, folder: Path, names: Sequence[str]) -> Iterator[str | None]:
        return self._hasher.ahead(f"{folder}/{name}" for name in names)

    def holds(self, name: str) -> bool:
        """Tell whether a file is there."""
        return (self._folder / name).is_file()

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a file, "" where it cannot be read, None where it is not there."""
        return (self._hasher.sha256(self._folder / name) or "") if self.holds(name) else None

    def beside(self, sequences: set[str]) -> set[str]:
        """Return the files that lie in no sequence of these and not in a run's working folder."""
        found: set[str] = set()
        for base, folders, names in os.walk(self._folder):
            here = Path(base).relative_to(self._folder)
            inside = [name for name in folders if (here / name).as_posix() not in sequences]
            folders[:] = [name for name in inside if (here / name).as_posix() != WORK_FOLDER]
            found |= {(here / name).as_posix() for name in names}
        return found - {MANIFEST, RUN, OVERVIEW}

    @cached_property
    def _journals(self) -> Journals:
        return journals_of(self._folder / WORK_FOLDER)

    def _inventory(self, sequence: str, asked: Container[int] | None, *, check: bool) -> FileInventory:
        made = self.state.manifest["frames"].get(sequence) if self.state.manifest else None
        of_shards = self._parts.get(sequence, [])
        images = self._folder / sequence
        alone = not (check or of_shards or sequence in self._journals.sequences)
        if made is not None and alone and asked is None and self._holds_images(images, made):
            return FileInventory(made)
        own = folder_part(images, sequence, self._journals)
        hasher = self._hasher if check else None
        return inventory(sequence, (*of_shards, own), self.images_each, asked, hasher)

    def _holds_images(self, images: Path, frames: int) -> bool:
        """Tell whether a sequence's folders hold as many files as it has images: else its records tell what is lost."""
        first = next(_lines(images / FRAMES), None)
        there = 0 if first is None else sum(len(_entries(images / folder)) for folder in _folders(first[1]))
        return first is not None and there >= frames * self.images_each

    # --- a finished one ---

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

    def files(self, sequence: str) -> Lines:
        """Yield the frames of a sequence, each with the SHA-256 of its images by name, as frames.jsonl has them."""
        data = self.file(f"{sequence}/{FRAMES}", self.manifest["files"][sequence][FRAMES])
        yield from files_in(data.decode().splitlines(keepends=True))

    def frames(self, sequence: str) -> list[FrameImages]:
        """Return a sequence's frames, in order. Raises StorageError, InputError where its text files are damaged."""
        self.file(f"{sequence}/{FRAMES}", self.manifest["files"][sequence][FRAMES])
        records = list(read_records(self._folder / sequence / FRAMES))
        time_s = np.array([record.time_s for record in records])
        poses = self.layout.written_poses(self._folder / sequence, time_s)
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


def _like(name: str) -> str:
    return re.sub(r"\d+", "#", name)


def _all_below(folder: Path) -> set[str]:
    """Return the names of all files in a folder and below, from it on."""
    return {(Path(base) / name).relative_to(folder).as_posix() for base, _, names in os.walk(folder) for name in names}


class PackedDataset(StoredDataset):
    """A finished packed dataset. Its files have the names that unpacking gives; each tar is hashed as a whole, once."""

    def __init__(self, store: Store, state: DatasetState) -> None:
        super().__init__(store, state)
        self._own: dict[str, str] = {}  # the text files of sequences, as the tars that were read hold them
        self._beside: dict[str, str] = {}  # those of settings, which several tars hold

    @cached_property
    def _sizes(self) -> dict[str, int]:
        return self.store.sizes("")

    @cached_property
    def described(self) -> dict[str, PackedFile]:
        """Its table and tars with their sizes and hashes, by name, as croissant.json says; {} without a usable one."""
        return described_files(self.store.read(CROISSANT))

    @cached_property
    def table(self) -> PackedTable:
        """Its table. Raises InputError where there is none or it is damaged."""
        return PackedTable(self.store)

    def check_records(self) -> None:
        """Hash the table. Raises InputError where it is not as croissant.json says."""
        note, size = self.described.get(TABLE), self.store.size(TABLE)
        if note is None:
            raise InputError(self.store.of(CROISSANT), "is missing or damaged", remedy=MENDS)
        if size is None or size != note.size or self.store.sha256(TABLE, size) != note.sha256:
            raise InputError(self.store.of(TABLE), "is not as it was written", remedy=MENDS)

    def files(self, sequence: str) -> Lines:
        """Yield the frames of a sequence, each with the SHA-256 of its images by name, as the table has them."""
        kinds = [f"{modality}_{what}" for modality in self.modalities for what in ("file", "sha256")]
        rows = self.table.rows(sequence, ["frame", *kinds])
        names, digests = ([rows.column(kind).to_pylist() for kind in kinds[at::2]] for at in (0, 1))
        for place, frame in enumerate(rows.column("frame").to_pylist()):
            yield frame, {name[place]: digest[place] for name, digest in zip(names, digests, strict=True)}

    def recorded(self) -> set[str]:
        """Return the sequences whose tar is there."""
        tars = (name for name in self._sizes if name.endswith(TAR_SUFFIX) and not name.startswith(f"{WORK_FOLDER}/"))
        return {name.removesuffix(TAR_SUFFIX) for name in tars if name.count("/") == 1}

    def has(self, sequence: str) -> bool:
        """Tell whether there is a tar of a sequence."""
        return tar_name(sequence) in self._sizes

    def each(self, sequences: Sequence[str], stop: threading.Event) -> Iterator[tuple[str, SequenceFiles]]:
        """Yield some sequences with what their tars hold, several of which are read ahead."""
        for name, content in tar_contents(self.store, sequences, self._sizes, stop):
            own = content.of_layout(name)
            self._keep_texts(name, content, own)
            tar, known = tar_name(name), self.described.get(tar_name(name))
            damaged = tar if known is not None and known.sha256 != content.sha256 else ""
            yield name, SequenceFiles(content.records, partial(map, own.get), partial(set, own), damaged)

    def _keep_texts(self, sequence: str, content: TarContent, own: Mapping[str, str]) -> None:
        known = self.state.files.get(sequence, {})
        self._own |= {f"{sequence}/{name}": own[name] for name in known if name in own}
        for text, digest in content.beside(sequence).items():
            if self._beside.get(text) in (None, self.state.files.get(text)):
                self._beside[text] = digest  # of several, one that is not as it was written stays

    def holds(self, name: str) -> bool:
        """Tell whether a file is there: those of sequences and settings are in tars."""
        return "/" in name or name in self._sizes

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a text file as the tars hold it; of a tar that is not there, the tar is lost alone."""
        if name == OVERVIEW and name in self._sizes:
            return self.store.sha256(name, self._sizes[name])
        setting, _, rest = name.partition("/")
        sequence = f"{setting}/{rest.partition('/')[0]}"
        if sequence == name or not rest:
            return self._beside.get(name)
        return self._own.get(name) if self.has(sequence) else self.text_files[name]

    def own_problems(self, *, check: bool) -> tuple[list[str], list[str]]:
        """Return what is lost or damaged of the table, the metadata and the card."""
        lost = [name for name in (TABLE, CROISSANT, CARD) if name not in self._sizes]
        damaged = [CROISSANT] if CROISSANT in self._sizes and not self.described else []
        table = self.described.get(TABLE)
        if table is not None and TABLE in self._sizes:
            whole = self._sizes[TABLE] == table.size
            if not whole or (check and self.store.sha256(TABLE, table.size) != table.sha256):
                damaged.append(TABLE)
        return lost, damaged

    def beside(self, sequences: set[str]) -> set[str]:
        """Return the files that are no tars of these sequences, and what else tars hold beside them."""
        known = {MANIFEST, RUN, OVERVIEW, TABLE, CROISSANT, CARD, *map(tar_name, sequences)}
        files = {name for name in self._sizes if not name.startswith(f"{WORK_FOLDER}/")}
        return (files - known) | self._beside.keys()

    def inventories(
        self, wanted: Sequence[tuple[str, Container[int] | None]], *, check: bool
    ) -> Iterator[FileInventory]:
        """Yield what there is of some sequences; with check each tar is read."""
        if not check:
            yield from super().inventories(wanted, check=check)
            return
        there = [sequence for sequence, _ in wanted if sequence in self.manifest["frames"] and self.has(sequence)]
        tars = self.each(there, threading.Event())
        for sequence, asked in wanted:
            if sequence not in there:
                yield self._inventory(sequence, asked, check=check)
                continue
            _, own = next(tars)
            part = hashed_part(own.records.values(), partial(_there, own))
            found = inventory(sequence, [part], self.images_each, asked)
            texts: dict[str, str] = self.manifest["files"][sequence]
            sound = not (found.lost or found.damaged) and list(own.digests(list(texts))) == list(texts.values())
            if sound and own.damaged_whole:
                found = FileInventory(found.done, damaged=(own.damaged_whole,))  # headers, or samples' descriptions
            yield found

    def _inventory(self, sequence: str, asked: Container[int] | None, *, check: bool) -> FileInventory:
        del check
        tar, named = tar_name(sequence), sequence in self.manifest["frames"]
        if not named or not self.has(sequence):
            return FileInventory(0, lost=(tar,) if named else ())
        description = self.described.get(tar)
        if description is not None and description.size != self._sizes[tar]:
            return FileInventory(0, damaged=(tar,))
        if asked is None:
            return FileInventory(self.manifest["frames"][sequence])
        return FileInventory(sum(frame in asked for frame, _ in self.files(sequence)))


def _there(own: SequenceFiles, files: Recorded) -> Digests:
    digests = zip(files, own.digests(list(files)), strict=True)
    return {name: digest for name, digest in digests if digest is not None}


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


def stored_dataset(place: Path | str) -> StoredDataset:
    """Return the dataset in a folder, or the finished one that is packed there or at an address.

    Raises InputError where there is none, StorageError where a store refuses, MissingDependencyError where a package
    that reaches it is missing.
    """
    if is_packed(place):
        return packed_dataset(place)
    folder = Path(place)
    state = read_dataset_state(folder) if folder.is_dir() else None
    if state is None:
        raise InputError(folder, NOTHING, remedy="name the folder that generate wrote")
    return FolderDataset(folder, state)


def finished_dataset(place: Path | str) -> StoredDataset:
    """Return the finished dataset in a folder or at an address; see `stored_dataset`."""
    return packed_dataset(place) if is_packed(place) else finished_folder(Path(place))


def finished_folder(folder: Path) -> FolderDataset:
    """Return the finished dataset in a folder. Raises InputError where there is none."""
    found = stored_dataset(folder)
    if found.state.problem:
        raise InputError(folder, found.state.problem)
    check_no_links(folder, found.state.sequences)
    if found.state.manifest is None or (folder / WORK_FOLDER / IDENTITY).exists():
        raise InputError(folder, UNFINISHED, remedy=GO_ON)
    assert isinstance(found, FolderDataset)
    return found


def written_dataset(folder: Path) -> FolderDataset:
    """Return the dataset whose manifest was just written to a folder."""
    return FolderDataset(folder, _state(read_json(folder / MANIFEST)))


def packed_dataset(place: Path | str) -> PackedDataset:
    """Return the finished packed dataset at a place; see `stored_dataset`."""
    store = open_store(place)
    state = sealed_state(store)
    if state is None and store.read(f"{WORK_FOLDER}/{IDENTITY}") is not None:
        raise InputError(store.text, UNFINISHED, remedy=GO_ON)
    if state is None:
        raise InputError(store.text, NOTHING, remedy="name the place that generate or publish wrote")
    if state.problem or state.manifest is None:
        raise InputError(store.text, state.problem)
    return PackedDataset(store, state)


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
