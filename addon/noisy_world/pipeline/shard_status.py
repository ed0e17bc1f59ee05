# SPDX-License-Identifier: GPL-3.0-or-later
"""The shards of a dataset, in its folder or at its address, and what they hold of its sequences."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from ..core.datasets.dataset_state import WORK_FOLDER, journal_folders, read_dataset_state
from ..core.datasets.file_inventory import FolderPart, HashedPart, Part, journals_of
from ..core.datasets.shard_merging import merged_shards
from ..core.datasets.shard_record import ShardRecord, read_shard, shard_folders
from ..core.progress import Progress
from ..storage.shard_objects import PLACE, StoredShard, damaged_contents, get_shard, shard_records
from ..storage.store import Store

READERS = 8  # records of shards at an address that are read at once: stores answer late


@dataclass(frozen=True)
class Shards:
    """The shards of a dataset.

    merged: the names of those that were merged since the dataset was last complete. finished: those that wait for that.
    unfinished: when each of the others was last written to, seconds since the epoch, by the folder's name. parts: what
    they hold of sequences, by the sequence's folder. identities: what they are made from. notes: what cannot be read of
    them.
    """

    merged: tuple[str, ...] = ()
    finished: list[str] = field(default_factory=list)
    unfinished: dict[str, float] = field(default_factory=dict)
    parts: dict[str, list[Part]] = field(default_factory=dict)
    identities: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, sequence: str, part: Part) -> None:
        """Add what a shard holds of a sequence."""
        self.parts.setdefault(sequence, []).append(part)


# --- in a folder ---


def read_shards(out: Path) -> Shards:
    """Return the shards in a dataset's folder. Nothing is locked, so they may be made and merged meanwhile."""
    found = Shards(tuple(summary["shard"] for summary in merged_shards(out)))
    for folder in shard_folders(out):
        try:
            record = read_shard(folder)
        except ValueError as error:
            found.notes.append(f"shard {folder.name}: its record {error}; it will be made again")
            continue
        if record is None:
            _add_unfinished(found, folder)
        else:
            _add_finished(found, folder, record)
    return found


def _add_finished(found: Shards, folder: Path, record: ShardRecord) -> None:
    found.finished.append(record.shard.name)
    found.identities.append(record.identity)
    for sequence, records in record.frames.items():
        found.add(sequence, FolderPart(folder / sequence, records=records))


def _add_unfinished(found: Shards, folder: Path) -> None:
    work = folder / WORK_FOLDER
    times_s: list[float] = []
    for sequence in journal_folders(work):
        part = FolderPart(folder / sequence, journals_of(work / sequence))
        found.add(sequence, part)
        times_s += [journal.stat().st_mtime for journal in part.journals if journal.exists()]
    state = read_dataset_state(folder)
    if state is not None and state.identity is not None and not state.problem:
        found.identities.append(state.identity)
    if work.is_dir():
        found.unfinished[folder.name] = max(times_s, default=work.stat().st_mtime)


# --- at an address ---


def read_shards_at(store: Store, progress: Progress, *, check: bool) -> Shards:
    """Return the shards at an address. check: whether to hash what is in their tars."""
    found, times_s, names = Shards(), store.times_s(PLACE), shard_records(store)
    progress.start("reading shards", len(names))
    for name, stored in _stored(store, names):
        if stored is None:
            found.notes.append(f"{name}: cannot be used, or its tar is not whole; the shard will be made again")
        else:
            found.finished.append(stored.record.shard.name)
            damaged = damaged_contents(store, stored) if check else frozenset[str]()
            digest = partial(_digest, damaged)
            for sequence, records in stored.record.frames.items():
                found.add(sequence, HashedPart(records, digest, times_s.get(name)))
        progress.advance()
    progress.finish()
    return found


def _digest(damaged: frozenset[str], name: str, wanted: str) -> str:
    """Return the SHA-256 of a content of a tar that is whole. damaged: those that have another, which is not known."""
    del name
    return "" if wanted in damaged else wanted


def _stored(store: Store, names: list[str]) -> Iterator[tuple[str, StoredShard | None]]:
    with ThreadPoolExecutor(READERS, thread_name_prefix="shard-reader") as pool:
        for at in range(0, len(names), READERS):  # a record has megabytes
            part = names[at : at + READERS]
            yield from zip(part, pool.map(lambda name: get_shard(store, name), part), strict=True)
