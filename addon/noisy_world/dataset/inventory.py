# SPDX-License-Identifier: GPL-3.0-or-later
"""An inventory of a sequence by its records: finished frames, lost files, damaged files.

Reading changes nothing and takes no lock, so it may be done while a run writes.
"""

import contextlib
import os
import threading
from collections import Counter, deque
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Set
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from ..core.atomic_files import Hasher
from ..core.errors import InputError, InterruptedRunError
from ..core.file_access import open_text
from ..core.frame_table import FRAMES, FrameRecord, Journals, files_in, joined_records, read_records
from .finished import CARD, CROISSANT, NOTHING, TABLE, TAR_SUFFIX, Packed, is_packed, open_packed, tar_name
from .folder_state import MANIFEST, OVERVIEW, RUN, WORK_FOLDER, read_dataset_state
from .tar_files import TarContent, tar_contents

RECENT = 200  # records of a journal, the last ones, of which it is asked when they were written


@dataclass(frozen=True)
class JournalTimes:
    """When the newest records of a journal were written.

    times_s: of their files, since the epoch. frames_each: what part of a frame a record is:
    half where colour and depth have records of their own. cut: whether the journal goes back further.
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


Recorded: TypeAlias = dict[str, tuple[int, str]]
"""The frame and the SHA-256 of each file that records name, by its name in the sequence."""


def inventory(
    folder: str, parts: Iterable["Part"], images_each: int, asked: Container[int] | None, hasher: Hasher | None = None
) -> FileInventory:
    """Return what there is of a sequence.

    folder: the sequence's. parts: where its files may be; the dataset's own folder last, as files are moved there while
    this looks. images_each: how many images a frame has. asked: the frames that are asked for; None for all. hasher:
    hashes every file; None to see only whether each is there.
    """
    # All records before any file: files are written, and moved, before their records.
    lines = [(part, part.recorded(asked, images_each)) for part in parts]
    named: dict[str, int] = {}  # the frame of each file
    intact: set[str] = set()
    damaged: set[str] = set()
    for part, (files, _) in lines:
        named |= {name: frame for name, (frame, _) in files.items()}
        there, wrong = part.present(files, hasher)
        damaged |= wrong
        intact |= there - wrong
    images = Counter(named[name] for name in intact)
    return FileInventory(
        sum(count >= images_each for count in images.values()),
        tuple(f"{folder}/{name}" for name in sorted(named.keys() - intact - damaged)),
        tuple(f"{folder}/{name}" for name in sorted(damaged - intact)),
        tuple(times for _, (_, written) in lines for times in written),
    )


@dataclass(frozen=True)
class FolderPart:
    """A folder with a sequence's images, and what tells of them: the dataset's, or a shard's.

    name: the sequence's folder. journals: of the working folder. records: of a finished shard, which has no journals.
    """

    images: Path
    name: str
    journals: Journals | None = None
    records: tuple[FrameRecord, ...] = ()

    def recorded(self, asked: Container[int] | None, images_each: int) -> tuple[Recorded, list[JournalTimes]]:
        """Return what frames.jsonl, journals and records say, and when the newest of the last two were written."""
        found: Recorded = {}
        written: list[JournalTimes] = []
        sources = [(_lines(self.images / FRAMES), False)]
        sources += [(files_in(lines), True) for _, lines in (self.journals.lines(self.name) if self.journals else ())]
        sources += [(((record.frame, record.files) for record in self.records), True)] if self.records else []
        for lines, by_run in sources:
            newest: deque[dict[str, str]] = deque(maxlen=RECENT)
            for frame, files in lines:
                newest.append(files)
                if asked is None or frame in asked:
                    found |= {name: (frame, digest) for name, digest in files.items()}
            if by_run and (lately := _written(self.images, newest, images_each)):
                written.append(lately)
        return found, written

    def present(self, files: Recorded, hasher: Hasher | None) -> tuple[Set[str], Set[str]]:
        """Return which files are there, and which of these have another hash than was recorded."""
        there = files.keys() & _listed(self.images, files)
        if hasher is None:
            return there, frozenset()
        names = sorted(there)
        digests = zip(names, hasher.ahead(f"{self.images}/{name}" for name in names), strict=True)
        return there, {name for name, digest in digests if digest != files[name][1]}


@dataclass(frozen=True)
class HashedPart:
    """What holds files of a sequence and has been read as a whole: a tar, or a shard at an address.

    records: what it says of them. digest: returns the SHA-256 of a file by its name and the one that was recorded; None
    where it is not there. time_s: when all were written, where they are a run's.
    """

    records: Iterable[FrameRecord]
    digest: Callable[[str, str], str | None]
    time_s: float | None = None

    def recorded(self, asked: Container[int] | None, images_each: int) -> tuple[Recorded, list[JournalTimes]]:
        """Return what the records say."""
        records = [record for record in self.records if asked is None or record.frame in asked]
        found = {name: (record.frame, digest) for record in records for name, digest in record.files.items()}
        if not found or self.time_s is None:
            return found, []
        return found, [JournalTimes((self.time_s,), len(found) / images_each, cut=False)]

    def present(self, files: Recorded, hasher: Hasher | None) -> tuple[Set[str], Set[str]]:
        """Return which files it holds, and which of these have another hash."""
        del hasher
        digests = {name: self.digest(name, wanted) for name, (_, wanted) in files.items()}
        there = {name for name, digest in digests.items() if digest is not None}
        return there, {name for name in there if digests[name] != files[name][1]}


Part: TypeAlias = FolderPart | HashedPart
"""Where some of a sequence's images may be, and what tells of them."""


def journals_of(work: Path) -> Journals:
    """Return the journals in a working folder."""
    journals = Journals(work)
    journals.read_on()
    return journals


def counted(images: Path, frames: int, images_each: int) -> FileInventory | None:
    """Return what there is of a sequence that a run has completed, if its folders hold as many files as it has images.

    None where they hold fewer: then only the records tell what is lost.
    """
    first = next(_lines(images / FRAMES), None)
    if first is None:
        return None
    there = sum(_entries(images / folder) for folder in _folders(first[1]))
    return FileInventory(frames) if there >= frames * images_each else None


def _lines(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the frame and the files of each record of a file, without torn lines; none where there is no such file."""
    if path.is_file():
        with contextlib.suppress(OSError), open_text(path, errors="replace") as file:
            yield from files_in(file)


def _written(images: Path, newest: Iterable[dict[str, str]], images_each: int) -> JournalTimes | None:
    times_s: list[float] = []
    count = records = 0
    for files in newest:
        records += 1
        name = next(iter(files), None)
        try:
            times_s += [] if name is None else [(images / name).stat().st_mtime]
        except OSError:
            continue  # lost, or moved on while this looks
        count += len(files)
    return JournalTimes(tuple(times_s), count / images_each / len(times_s), records == RECENT) if times_s else None


def _folders(names: Iterable[str]) -> set[str]:
    return {name.rpartition("/")[0] for name in names}


def _entries(folder: Path) -> int:
    try:
        with os.scandir(folder) as entries:
            return sum(1 for _ in entries)
    except OSError:
        return 0


def _listed(images: Path, names: Iterable[str]) -> frozenset[str]:
    """Return the names of the files that there are in the folders of some files, relative to `images`."""
    found: set[str] = set()
    for folder in _folders(names):
        prefix = f"{folder}/" if folder else ""
        try:
            with os.scandir(images / folder) as entries:
                found |= {prefix + entry.name for entry in entries}
        except OSError:
            continue
    return frozenset(found)


# The files of a dataset, hashed: in a folder, or in the tars of a packed dataset.


# --- in a folder ---


class FolderFiles:
    """The files of a dataset in a folder. state: what it is. A file with several names is hashed once."""

    def __init__(self, folder: Path) -> None:
        """Look at the folder. Raises InputError where it holds no dataset."""
        state = read_dataset_state(folder)
        if state is None:
            raise InputError(folder, NOTHING, remedy="name the folder that has a manifest.json")
        self.state = state
        self._folder = folder
        self._hasher = Hasher()

    def has(self, sequence: str) -> bool:
        """Tell whether there is a folder of a sequence."""
        return (self._folder / sequence).is_dir()

    def recorded(self) -> set[str]:
        """Return the sequences whose frames.jsonl is there."""
        return {path.parent.relative_to(self._folder).as_posix() for path in self._folder.glob(f"*/*/{FRAMES}")}

    def each(self, sequences: list[str], stop: threading.Event) -> Iterator[tuple[str, "SequenceInFolder"]]:
        """Yield some sequences with their files, which are hashed in threads."""
        for name in sequences:
            if stop.is_set():
                raise InterruptedRunError("stopped; nothing was written, and verify begins at the beginning")
            yield name, SequenceInFolder(self._folder / name, self._hasher)

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a file, None where it is not there."""
        return self._hasher.sha256(self._folder / name)

    def own_problems(self) -> tuple[list[str], list[str]]:
        """Return the manifest, where it is missing."""
        return [MANIFEST] if self.state.manifest is None else [], []

    def beside(self, sequences: set[str]) -> set[str]:
        """Return the files that lie in no sequence of these and not in a run's working folder."""
        found: set[str] = set()
        for base, folders, names in os.walk(self._folder):
            here = Path(base).relative_to(self._folder)
            inside = [name for name in folders if (here / name).as_posix() not in sequences]
            folders[:] = [name for name in inside if (here / name).as_posix() != WORK_FOLDER]
            found |= {(here / name).as_posix() for name in names}
        return found - {MANIFEST, RUN, OVERVIEW}


class SequenceInFolder:
    """The files of a sequence in a folder. Their names are relative to it."""

    def __init__(self, folder: Path, hasher: Hasher) -> None:
        self._folder = folder
        self._hasher = hasher

    def records(self) -> dict[int, FrameRecord]:
        """Return what its frames.jsonl says, by frame."""
        return joined_records(read_records(self._folder / FRAMES))

    def digests(self, names: list[str]) -> Iterator[str | None]:
        """Yield the SHA-256 of files; None for one that is not there."""
        return self._hasher.ahead(f"{self._folder}/{name}" for name in names)

    def names(self) -> set[str]:
        """Return the names of all files."""
        walked = ((Path(base), names) for base, _, names in os.walk(self._folder))
        return {(base / name).relative_to(self._folder).as_posix() for base, names in walked for name in names}

    def damaged_whole(self) -> str:
        """Return "": nothing holds the files."""
        return ""


# --- packed ---


class PackedFiles:
    """The files of a packed dataset. state: what it is. Each tar is read once, from its beginning to its end."""

    def __init__(self, packed: Packed, *, check: bool = True) -> None:
        """List the files. check: whether to hash the table; else its size is compared."""
        self.state = packed.state
        self._packed = packed
        self._check = check
        self._sizes = packed.store.sizes("")
        self._beside: dict[str, str] = {}  # of the text files beside the sequences, which several tars hold

    def has(self, sequence: str) -> bool:
        """Tell whether there is a tar of a sequence."""
        return tar_name(sequence) in self._sizes

    def recorded(self) -> set[str]:
        """Return the sequences whose tar is there."""
        tars = (name for name in self._sizes if name.endswith(TAR_SUFFIX) and not name.startswith(f"{WORK_FOLDER}/"))
        return {name.removesuffix(TAR_SUFFIX) for name in tars if name.count("/") == 1}

    def each(self, sequences: list[str], stop: threading.Event) -> Iterator[tuple[str, "SequenceInTar"]]:
        """Yield some sequences with what their tars hold."""
        for name, content in tar_contents(self._packed.store, sequences, self._sizes, stop):
            for text, digest in content.beside(name).items():
                if self._beside.get(text) in (None, self.state.files.get(text)):
                    self._beside[text] = digest  # of several, one that is not as it was written stays
            yield name, SequenceInTar(name, content, self._packed)

    def beside_has(self, name: str) -> bool:
        """Tell whether there is a file beside the tars."""
        return name in self._sizes

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a file beside the sequences, as the tars hold it; None where none does."""
        if name == OVERVIEW and name in self._sizes:
            return self._packed.store.sha256(name, self._sizes[name])
        return self._beside.get(name)

    def own_problems(self) -> tuple[list[str], list[str]]:
        """Return what is missing or damaged of the table, the metadata and the card."""
        lost = [name for name in (TABLE, CROISSANT, CARD) if name not in self._sizes]
        damaged = [CROISSANT] if CROISSANT in self._sizes and not self._packed.described else []
        table = self._packed.described.get(TABLE)
        if table is not None and TABLE in self._sizes:
            whole = self._sizes[TABLE] == table.size
            if not whole or (self._check and self._packed.store.sha256(TABLE, table.size) != table.sha256):
                damaged.append(TABLE)
        return lost, damaged

    def beside(self, sequences: set[str]) -> set[str]:
        """Return the files that are no tars of these sequences, and what else tars hold beside them."""
        known = {MANIFEST, RUN, OVERVIEW, TABLE, CROISSANT, CARD, *map(tar_name, sequences)}
        files = {name for name in self._sizes if not name.startswith(f"{WORK_FOLDER}/")}
        return (files - known) | self._beside.keys()


class SequenceInTar:
    """The files of a sequence in its tar, by the names that they have when it is unpacked."""

    def __init__(self, name: str, content: TarContent, packed: Packed) -> None:
        self._name = name
        self._content = content
        self._files: Mapping[str, str] = content.of_layout(name)
        self._packed = packed

    def records(self) -> dict[int, FrameRecord]:
        """Return what its frames.jsonl says, by frame."""
        return self._content.records

    def digest(self, name: str, wanted: str = "") -> str | None:
        """Return the SHA-256 of a file, whatever it was to be; None where it is not there."""
        del wanted
        return self._files.get(name)

    def digests(self, names: list[str]) -> Iterator[str | None]:
        """Yield the SHA-256 of files; None for one that is not there."""
        return map(self._files.get, names)

    def names(self) -> set[str]:
        """Return the names of all files."""
        return set(self._files)

    def damaged_whole(self) -> str:
        """Return the name of the tar where it is not as it was written, else ""."""
        tar = tar_name(self._name)
        description = self._packed.described.get(tar)
        return tar if description is not None and description.sha256 != self._content.sha256 else ""


DatasetFiles: TypeAlias = FolderFiles | PackedFiles
"""The files of a dataset: which sequences there are, and after `each`, the SHA-256 of all that lies beside them."""

SequenceFiles: TypeAlias = SequenceInFolder | SequenceInTar
"""The files of a sequence."""


def files_of(place: Path | str) -> DatasetFiles:
    """Return the files of the dataset in a folder or at an address. Raises InputError where there is none."""
    return PackedFiles(open_packed(place)) if is_packed(place) else FolderFiles(Path(place))
