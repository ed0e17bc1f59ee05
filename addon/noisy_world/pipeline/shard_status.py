# SPDX-License-Identifier: GPL-3.0-or-later
"""The shards in a dataset's folder, and what they hold of its sequences, as `status` shows it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..core.datasets.dataset_state import WORK_FOLDER, journal_folders, read_dataset_state
from ..core.datasets.file_inventory import ImageLocation, journals_of
from ..core.datasets.shard_merging import merged_shards
from ..core.datasets.shard_record import ShardRecord, read_shard, shard_folders


@dataclass(frozen=True)
class Shards:
    """The shards of a dataset.

    merged: the names of those that were merged since the dataset was last complete. finished: those that wait for that.
    unfinished: when each of the others was last written to, seconds since the epoch, by the folder's name. places:
    where files of sequences are, by the sequence's folder. identities: what they are made from. notes: what cannot be
    read of them.
    """

    merged: tuple[str, ...] = ()
    finished: list[str] = field(default_factory=list)
    unfinished: dict[str, float] = field(default_factory=dict)
    places: dict[str, list[ImageLocation]] = field(default_factory=dict)
    identities: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


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
        found.places.setdefault(sequence, []).append(ImageLocation(folder / sequence, records=records))


def _add_unfinished(found: Shards, folder: Path) -> None:
    work = folder / WORK_FOLDER
    times_s: list[float] = []
    for sequence in journal_folders(work):
        place = ImageLocation(folder / sequence, journals_of(work / sequence))
        found.places.setdefault(sequence, []).append(place)
        times_s += [journal.stat().st_mtime for journal in place.journals if journal.exists()]
    standing = read_dataset_state(folder)
    if standing is not None and standing.identity is not None and not standing.problem:
        found.identities.append(standing.identity)
    if work.is_dir():
        found.unfinished[folder.name] = max(times_s, default=work.stat().st_mtime)
