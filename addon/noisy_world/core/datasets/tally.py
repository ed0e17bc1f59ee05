# SPDX-License-Identifier: GPL-3.0-or-later
"""What is on disk of a sequence, by its records: frames that are finished, files that are lost or damaged.

Reading changes nothing and takes no lock, so it may be done while a run writes.
"""

import os
from collections import Counter, deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ..machine import available_threads
from .records import FRAMES, FrameRecord, joined_records, read_records
from .standing import JOURNALS
from .storage import sha256_of_regular_file

type Digest = Callable[[Path], str | None]
"""A function that returns a file's SHA-256; None where it is missing or cannot be read."""

RECENT = 200  # records of a journal, the last ones, of which it is asked when they were written


@dataclass(frozen=True)
class Tally:
    """A sequence as it is on disk.

    done: how many of its frames are finished. lost: files that a record names and that are not there. damaged: files
    whose content is another than was recorded, which only hashing finds. Names are relative to the sequence's folder.
    """

    done: int
    lost: tuple[str, ...] = ()
    damaged: tuple[str, ...] = ()


@dataclass(frozen=True)
class Place:
    """A folder with a sequence's images, and the journals that tell of them: the dataset's, or a shard's."""

    images: Path
    journals: tuple[Path, ...]


@dataclass(frozen=True)
class Written:
    """When the newest records of a journal were written.

    folder: the sequence's. times_s: of their files, since the epoch. frames_each: what part of a frame a record is:
    half where colour and depth have records of their own. cut: whether the journal goes back further.
    """

    folder: str
    times_s: tuple[float, ...]
    frames_each: float
    cut: bool


class Digests:
    """The SHA-256 of files; one that has several names is read once."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, int], str | None] = {}

    def __call__(self, path: Path) -> str | None:
        """Return the SHA-256 of a file; None where it is missing or cannot be read."""
        try:
            found = path.stat()
        except OSError:
            return None
        if found.st_nlink == 1:
            return sha256_of_regular_file(path)
        key = (found.st_dev, found.st_ino)
        if key not in self._known:
            self._known[key] = sha256_of_regular_file(path)
        return self._known[key]


def journals_of(folder: Path) -> tuple[Path, ...]:
    """Return the journals in a sequence's part of a working folder."""
    return tuple(sorted(folder.glob(JOURNALS)))


def tally(
    places: Iterable[Place], images_each: int, frames: frozenset[int] | None, digest: Digest | None = None
) -> Tally:
    """Return what there is of a sequence.

    places: where its files may be; the dataset's own folder last, as files are moved there while this looks.
    images_each: how many images a frame has. frames: those that are asked for; None for all. digest: hashes every file;
    None to see only whether each is there.
    """
    recorded = [(place, _records(place, frames)) for place in places]  # all of them first: files come before records
    named: dict[str, int] = {}  # the frame of each file
    intact: set[str] = set()
    damaged: set[str] = set()
    for place, records in recorded:
        named |= {name: record.frame for record in records for name in record.files}
        there = _listed(place.images, (name for record in records for name in record.files))
        wrong = _wrong(place.images, records, there, digest) if digest else frozenset[str]()
        damaged |= wrong
        intact |= {name for record in records for name in record.files if name in there} - wrong
    images = Counter(named[name] for name in intact)
    return Tally(
        sum(count >= images_each for count in images.values()),
        tuple(sorted(named.keys() - intact - damaged)),
        tuple(sorted(damaged - intact)),
    )


def counted(images: Path, frames: int, images_each: int) -> Tally | None:
    """Return what there is of a sequence that a run has completed, if its folders hold as many files as it has images.

    None where they hold fewer: then only the records tell what is lost.
    """
    first = next(read_records(images / FRAMES), None)
    if first is None:
        return None
    there = sum(_entries(images / folder) for folder in _folders(first.files))
    return Tally(frames) if there >= frames * images_each else None


def written_lately(folder: str, place: Place, images_each: int) -> list[Written]:
    """Return when the newest frames of each journal of a sequence were written.

    folder: the sequence's. images_each: how many images a frame has.
    """
    found: list[Written] = []
    for journal in place.journals:
        newest = deque(read_records(journal), RECENT)
        times_s, images = [], 0
        for record in newest:
            name = next(iter(record.files), None)
            try:
                times_s += [] if name is None else [(place.images / name).stat().st_mtime]
            except OSError:
                continue  # lost, or moved on while this looks
            images += len(record.files)
        if times_s:
            found.append(Written(folder, tuple(times_s), images / images_each / len(times_s), len(newest) == RECENT))
    return found


def _records(place: Place, frames: frozenset[int] | None) -> list[FrameRecord]:
    found = joined_records(record for path in (place.images / FRAMES, *place.journals) for record in read_records(path))
    return [record for frame, record in found.items() if frames is None or frame in frames]


def _folders(names: Iterable[str]) -> set[str]:
    return {str(PurePosixPath(name).parent) for name in names}


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
        prefix = "" if folder == "." else f"{folder}/"
        try:
            with os.scandir(images / folder) as entries:
                found |= {prefix + entry.name for entry in entries}
        except OSError:
            continue
    return frozenset(found)


def _wrong(images: Path, records: list[FrameRecord], there: frozenset[str], digest: Digest) -> frozenset[str]:
    """Return the files whose content is another than was recorded. Hashing frees Python's lock, so threads share it."""
    expected = [(name, value) for record in records for name, value in record.files.items() if name in there]
    with ThreadPoolExecutor(available_threads()) as pool:
        found = pool.map(lambda item: digest(images / item[0]) == item[1], expected)
        return frozenset(name for (name, _), right in zip(expected, found, strict=True) if not right)
