# SPDX-License-Identifier: GPL-3.0-or-later
"""What is on disk of a sequence, by its records: frames that are finished, files that are lost or damaged.

Reading changes nothing and takes no lock, so it may be done while a run writes.
"""

import contextlib
import os
import re
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from ..machine import available_threads
from ..regular_files import open_text
from .dataset_state import JOURNALS
from .records import FRAMES, FrameRecord, read_record
from .storage import sha256_of_regular_file

Digest: TypeAlias = Callable[[Path], str | None]
"""A function that returns a file's SHA-256; None where it is missing or cannot be read."""

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
    """A sequence as it is on disk.

    done: how many of its frames are finished. lost: files that a record names and that are not there. damaged: files
    whose content is another than was recorded, which only hashing finds. Names are relative to the sequence's folder.
    written: when the newest frames of each journal were written.
    """

    done: int
    lost: tuple[str, ...] = ()
    damaged: tuple[str, ...] = ()
    written: tuple[JournalTimes, ...] = ()


@dataclass(frozen=True)
class ImageLocation:
    """A folder with a sequence's images, and what tells of them: the dataset's, or a shard's.

    journals: files of records. records: those of a finished shard, which has no journals.
    """

    images: Path
    journals: tuple[Path, ...] = ()
    records: tuple[FrameRecord, ...] = ()


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
    places: Iterable[ImageLocation], images_each: int, frames: frozenset[int] | None, digest: Digest | None = None
) -> FileInventory:
    """Return what there is of a sequence.

    places: where its files may be; the dataset's own folder last, as files are moved there while this looks.
    images_each: how many images a frame has. frames: those that are asked for; None for all. digest: hashes every file;
    None to see only whether each is there.
    """
    written: list[JournalTimes] = []
    # All records before any file: files are written, and moved, before their records.
    recorded = [(place, _recorded(place, frames, images_each, written)) for place in places]
    named: dict[str, int] = {}  # the frame of each file
    intact: set[str] = set()
    damaged: set[str] = set()
    for place, files in recorded:
        named |= {name: frame for name, (frame, _) in files.items()}
        there = files.keys() & _listed(place.images, files)
        wrong = _wrong(place.images, {name: files[name][1] for name in there}, digest) if digest else frozenset[str]()
        damaged |= wrong
        intact |= there - wrong
    images = Counter(named[name] for name in intact)
    return FileInventory(
        sum(count >= images_each for count in images.values()),
        tuple(sorted(named.keys() - intact - damaged)),
        tuple(sorted(damaged - intact)),
        tuple(written),
    )


def counted(images: Path, frames: int, images_each: int) -> FileInventory | None:
    """Return what there is of a sequence that a run has completed, if its folders hold as many files as it has images.

    None where they hold fewer: then only the records tell what is lost.
    """
    first = next(_lines(images / FRAMES), None)
    if first is None:
        return None
    there = sum(_entries(images / folder) for folder in _folders(first[1]))
    return FileInventory(frames) if there >= frames * images_each else None


def _recorded(
    place: ImageLocation, frames: frozenset[int] | None, images_each: int, written: list[JournalTimes]
) -> dict[str, tuple[int, str]]:
    """Return the frame and the SHA-256 of each file that a place's records name, by name.

    Add to `written` when the newest of each journal were written.
    """
    found: dict[str, tuple[int, str]] = {}
    sources = [(_lines(path), path.name != FRAMES) for path in (place.images / FRAMES, *place.journals)]
    sources += [(((record.frame, record.files) for record in place.records), True)] if place.records else []
    for lines, by_run in sources:
        newest: deque[dict[str, str]] = deque(maxlen=RECENT)
        for frame, files in lines:
            newest.append(files)
            if frames is None or frame in frames:
                found |= {name: (frame, digest) for name, digest in files.items()}
        if by_run and (lately := _written(place.images, newest, images_each)):
            written.append(lately)
    return found


# A line as it is written, up to its files. A dataset may have millions, and to read one as JSON takes ten times longer.
_LINE = re.compile(r'\{"frame": (\d{1,9}), "time_s": [^{"]+(?:"depth_time_s": [^{"]+)?"sha256": \{([^{}\\]*)\}[,}]')
_FILE = re.compile(r'"([^"]+)": "([0-9a-f]{64})"')


def _lines(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the frame and the files of each record of a file, without torn lines; none where there is no such file."""
    if not path.is_file():
        return
    with contextlib.suppress(OSError), open_text(path, errors="replace") as file:
        for line in file:
            if (found := _LINE.match(line)) and line.endswith("}\n"):
                yield int(found[1]), dict(_FILE.findall(found[2]))
            elif record := read_record(line):
                yield record.frame, record.files


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


def _wrong(images: Path, expected: Mapping[str, str], digest: Digest) -> frozenset[str]:
    """Return the files whose content is another than was recorded. Hashing frees Python's lock, so threads share it."""
    with ThreadPoolExecutor(available_threads()) as pool:
        found = pool.map(lambda item: digest(images / item[0]) == item[1], expected.items())
        return frozenset(name for name, right in zip(expected, found, strict=True) if not right)
