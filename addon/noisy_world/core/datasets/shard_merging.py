# SPDX-License-Identifier: GPL-3.0-or-later
"""Merging shards into the dataset: their files are moved, not copied, and every one is hashed on the way.

Files first, then records, then the shard's folder goes: a process that ends in between leaves what the next one merges
again, and a file that is in its place already, as the record says, counts.
"""

import contextlib
import time
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from ..errors import BusyError
from ..presets.preset import canonical
from .dataset_state import IDENTITY, JOURNALS, MERGED, WORK_FOLDER, journal_folders, read_dataset_state
from .hashing import Hasher
from .identity_mismatch import identity_mismatch
from .journal import read_lines
from .layouts import OutputFormat
from .records import FrameRecord, joined_records, read_records
from .removal import remove_dataset, remove_journals, remove_work_folder
from .shard_record import SHARD, ShardRecord, read_shard, shard_folders
from .storage import FolderLock, Mover, storage_errors, write_atomic

PATIENCE_S = 2.0  # how long the lock of a process is waited for that may have been killed; chosen

Frames: TypeAlias = dict[str, tuple[FrameRecord, ...]]
"""Records of frames by the sequence's folder."""


class Receiver(Protocol):
    """A dataset that shards are merged into, and which is open."""

    out: Path
    scratch: Path
    format: OutputFormat

    def make_folders(self, folder: str) -> None:
        """Create the folders of a sequence."""
        ...

    def append_merged(self, folder: str, records: Iterable[FrameRecord]) -> None:
        """Record frames of a sequence whose files were moved here from a shard."""
        ...

    def append_summary(self, summary: dict[str, Any]) -> None:
        """Record a shard that was merged."""
        ...


@dataclass(frozen=True)
class Merged:
    """What merging a shard did.

    frames: how many records went to the dataset. damaged: the files that are not as their records say, by their names
    in the dataset; they were not merged, so their frames are missing. record: of the shard; None where it was not
    finished.
    """

    frames: int
    damaged: tuple[str, ...]
    record: ShardRecord | None


@dataclass(frozen=True)
class ShardRules:
    """Which shards are merged.

    unfinished: also the finished frames of those that are unfinished, where nobody is making them. any_processor: also
    those of another kind of processor than the dataset's.
    """

    unfinished: bool
    any_processor: bool


@dataclass(frozen=True)
class Gathered:
    """What became of all the shards of a dataset.

    merged: those that were merged. refused: by folder, why a shard does not belong to the dataset. left: those that are
    unfinished, or under way.
    """

    merged: list[Merged]
    refused: dict[Path, str]
    left: list[Path]


def merge_shard(dataset: Receiver, folder: Path, record: ShardRecord | None = None) -> Merged:
    """Move what is finished of a shard into a dataset, which is open, and remove the shard's folder.

    folder: on any file system. record: of the shard, where it has been read. A file that is not as its record says is
    not merged. Raises BusyError where the shard is being made, ValueError where its record cannot be used, StorageError
    where the disk refuses.
    """
    lock = FolderLock(folder / WORK_FOLDER / "lock")
    try:
        record = record or read_shard(folder)
        frames = _recorded(folder) if record is None else record.frames
        merged, damaged = _move(dataset, folder, frames)
        for sequence, records in merged.items():
            dataset.append_merged(sequence, records)
        if record is not None:
            dataset.append_summary(record.summary())
        _remove(folder)
    finally:
        lock.release()
    return Merged(sum(map(len, merged.values())), tuple(damaged), record)


def merge_shards(dataset: Receiver, identity: dict[str, Any], rules: ShardRules) -> Gathered:
    """Merge the shards in a dataset's own folder that were made from what an identity says."""
    found = Gathered([], {}, [])
    for folder in shard_folders(dataset.out):
        record, made_from, reason = _made_from(folder)
        if made_from is not None and not reason:
            reason = identity_mismatch(identity, made_from, any_processor=rules.any_processor)
        if reason:
            found.refused[folder] = reason
        elif rules.unfinished or record is not None:
            merged = _merge_when_free(dataset, folder, record)
            if merged is None:
                found.left.append(folder)
            else:
                found.merged.append(merged)
        else:
            found.left.append(folder)
    return found


def take_up(folder: Path, record: ShardRecord) -> None:
    """Make a finished shard, whose lock is held, an unfinished one again: its records become journals."""
    work = folder / WORK_FOLDER
    unfinished = work / "unfinished"
    with storage_errors(folder):
        unfinished.mkdir(parents=True, exist_ok=True)
    for sequence, records in record.frames.items():
        with storage_errors(work / sequence):
            (work / sequence).mkdir(parents=True, exist_ok=True)
        lines = "".join(item.line() for item in records)
        write_atomic(work / sequence / "journal-kept.jsonl", lines.encode(), unfinished)
    write_atomic(work / IDENTITY, canonical(record.identity).encode(), unfinished)
    with storage_errors(folder):
        (folder / SHARD).unlink()


def finish_shard(folder: Path, record: ShardRecord) -> None:
    """Write the record of a shard, whose lock is held, and remove what was needed while it was made."""
    work = folder / WORK_FOLDER
    write_atomic(folder / SHARD, record.text(), work / "unfinished")
    tidy(folder)


def tidy(folder: Path) -> None:
    """Remove from a finished shard, whose lock is held, what was needed while it was made."""
    work = folder / WORK_FOLDER
    for sequence in journal_folders(work):
        remove_journals(work, sequence)
    remove_work_folder(work, work / "unfinished")


def _merge_when_free(dataset: Receiver, folder: Path, record: ShardRecord | None) -> Merged | None:
    """Merge a shard; None where another process is making it. A process that was just killed is waited for."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return merge_shard(dataset, folder, record)
        except BusyError:
            if time.monotonic() > end_s:
                return None
            time.sleep(0.05)


def drop_unfinished(folders: Iterable[Path]) -> None:
    """Remove shards that are unfinished and that nobody is making, when all their frames are in the dataset."""
    for folder in folders:
        with contextlib.suppress(BusyError):
            if not (folder / SHARD).exists():
                remove_shard(folder)


def merged_shards(out: Path) -> list[dict[str, Any]]:
    """Return the summaries of the shards that were merged since the dataset was last complete, each shard's once."""
    summaries = (summary for path in sorted((out / WORK_FOLDER).glob(MERGED)) for summary in read_lines(path))
    by_shard = {summary["shard"]: summary for summary in summaries}
    return [by_shard[name] for name in sorted(by_shard)]


def remove_shard(folder: Path) -> None:
    """Remove a shard. Raises BusyError where it is being made, StorageError where the disk refuses."""
    lock = FolderLock(folder / WORK_FOLDER / "lock")
    try:
        _remove(folder)
    finally:
        lock.release()


def remove_shards(out: Path) -> None:
    """Remove the shards of a dataset that nobody is making, finished or not. Raises StorageError."""
    for folder in shard_folders(out):
        with contextlib.suppress(BusyError):
            remove_shard(folder)


def shards_hold_frames(out: Path) -> bool:
    """Tell whether a shard of a dataset has finished a frame."""
    return any((path / SHARD).is_file() or journal_folders(path / WORK_FOLDER) for path in shard_folders(out))


def _made_from(folder: Path) -> tuple[ShardRecord | None, dict[str, Any] | None, str]:
    """Return a shard's record, if it is finished; what it was made from, if it has a frame; why that is unknown."""
    try:
        record = read_shard(folder)
    except ValueError as error:
        return None, None, f"{SHARD} {error}"
    if record is not None:
        return record, record.identity, ""
    state = read_dataset_state(folder)
    if state is None or not state.holds_frames:
        return None, None, ""
    return None, state.identity, state.problem or state.note


def _recorded(folder: Path) -> Frames:
    """Return what the journals of an unfinished shard say."""
    work = folder / WORK_FOLDER
    return {
        sequence: tuple(
            joined_records(
                record for path in sorted((work / sequence).glob(JOURNALS)) for record in read_records(path)
            ).values()
        )
        for sequence in sorted(journal_folders(work))
    }


def _move(dataset: Receiver, folder: Path, frames: Frames) -> tuple[dict[str, list[FrameRecord]], list[str]]:
    """Move the files that are as the records say; return the records of these, and the names of the others.

    Files are hashed ahead, in threads; they are moved one after another.
    """
    hasher, mover = Hasher(), Mover(dataset.scratch)
    merged: dict[str, list[FrameRecord]] = {}
    damaged: list[str] = []
    places = frozenset(dataset.format.folders)
    names = (f"{folder}/{sequence}/{name}" for sequence, name in _names(frames, places))

    with contextlib.closing(Hasher(links=False).ahead(names)) as digests:
        for sequence, records in frames.items():
            dataset.make_folders(sequence)
            source, target = f"{folder}/{sequence}", f"{dataset.out}/{sequence}"
            for record in records:
                there: dict[str, str] = {}
                for name, digest in record.files.items():
                    if not _is_image(name, places):
                        continue
                    found, path = next(digests), Path(f"{target}/{name}")
                    if hasher.sha256(path) == digest:  # moved by a process that was killed then, or made twice
                        there[name] = digest
                    elif found == digest:
                        mover.move(Path(f"{source}/{name}"), path)
                        there[name] = digest
                damaged += [f"{sequence}/{name}" for name in record.files if name not in there]
                if there:
                    whole = len(there) == len(record.files)
                    merged.setdefault(sequence, []).append(record if whole else replace(record, files=there))
    return merged, damaged


def _names(frames: Frames, places: Collection[str]) -> Iterator[tuple[str, str]]:
    """Yield the sequence and the name of each image that records name. places: the folders of images."""
    for sequence, records in frames.items():
        yield from ((sequence, name) for record in records for name in record.files if _is_image(name, places))


def _is_image(name: str, places: Collection[str]) -> bool:
    return name.rpartition("/")[0] in places


def _remove(folder: Path) -> None:
    """Remove the folder of a shard, whose lock is held; what is not ours stays in it."""
    with storage_errors(folder):
        (folder / SHARD).unlink(missing_ok=True)  # first: what a kill leaves is no finished shard
    work = folder / WORK_FOLDER
    inside = [path for path in folder.glob("*/*") if WORK_FOLDER not in path.parts[-2:]]
    remove_dataset(folder, work, [path.relative_to(folder).as_posix() for path in inside if path.is_dir()])
    remove_work_folder(work, work / "unfinished")
    with contextlib.suppress(OSError):
        folder.rmdir()
