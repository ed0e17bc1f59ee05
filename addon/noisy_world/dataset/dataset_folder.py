# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset on disk: which frames are finished, which are missing, and the text files that say how it was made.

During a run, `OUT/.noisy_world` holds the dataset's identity, journals with a line for each finished frame, and
unfinished files. At the end the lines of a sequence become its frames.jsonl, and the folder is removed. A frame counts
as finished if a journal names it and its files have the hashes written there; everything else is made again. So a
killed run, a torn line, a truncated image or a power cut costs time and nothing else.
"""

import contextlib
import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from stat import S_ISREG
from typing import Any, TypeAlias
from uuid import uuid4

from ..core.atomic_files import (
    FolderLock,
    Hasher,
    link_or_copy,
    sha256_of_bytes,
    sha256_of_regular_file,
    storage_errors,
    write_atomic,
)
from ..core.errors import StorageError
from ..core.file_access import canonical
from ..core.frame_table import (
    FRAMES,
    FrameRecord,
    Journal,
    Journals,
    append_line,
    has_journal,
    joined_records,
    journal_path,
    read_records,
    records_in,
)
from ..layouts import FrameNames, OutputFormat
from .differences import other_dataset
from .folder_state import (
    IDENTITY,
    MANIFEST,
    NOTHING,
    OVERVIEW,
    WORK_FOLDER,
    DatasetState,
    check_no_links,
    check_place,
    empty_scratch,
    kept_notes,
    manifest_is_changed,
    merged_identity,
    merged_manifest,
    read_dataset_state,
    recorded,
    remove_dataset,
    remove_work_folder,
)
from .shard_folders import (
    Gathered,
    ShardRecord,
    ShardRules,
    finish_shard,
    merge_shards,
    remove_shards,
    shards_hold_frames,
)

# Drops records that cannot belong to a sequence; a disk, a tool or a person may have changed a journal.


AsPlanned: TypeAlias = Callable[[FrameRecord], bool]
"""Tells whether a record says that to its files was done what is planned."""


def plausible_records(records: Iterable[FrameRecord], names: FrameNames, count: int) -> dict[int, FrameRecord]:
    """Return by frame what records say of a sequence's frames and of files that these have; the rest is no record.

    names: of the frames' files. count: of the sequence's frames.
    """
    return joined_records(_plausible(records, names, count))


def planned_records(
    records: Iterable[FrameRecord], names: FrameNames, count: int, as_planned: AsPlanned
) -> tuple[dict[int, FrameRecord], str]:
    """Return what `plausible_records` does, without records of what is not planned, and a note on these, or ""."""
    planned: list[FrameRecord] = []
    changed: list[int] = []
    for record in _plausible(records, names, count):
        planned.append(record) if as_planned(record) else changed.append(record.frame)
    if not changed:
        return joined_records(planned), ""
    message = f"{len(changed)} records of its journals, of frame {changed[0]} the first, do not say what is planned"
    return joined_records(planned), f"{message}; what they tell of is made again"


def _plausible(records: Iterable[FrameRecord], names: FrameNames, count: int) -> Iterator[FrameRecord]:
    for record in records:
        if 0 <= record.frame < count and (record.time_s, record.depth_time_s) == names.stamps.frame_times(record.frame):
            own = names.of(record.frame)
            yield replace(record, files={name: digest for name, digest in record.files.items() if name in own})


class SequenceJournal:
    """The journal of a scene, for one of its sequences."""

    def __init__(self, journal: Journal, folder: str) -> None:
        self._journal = journal
        self._folder = folder

    def append(self, record: FrameRecord) -> None:
        """Add a frame whose files are written."""
        self._journal.append(self._folder, record)

    def close(self) -> None:
        """Do nothing: the dataset closes its journals."""


class Dataset:
    """The folder of a dataset while a run writes to it.

    identity: what it is made from, once it is open: what the run makes, and what stays beside that. shards_left:
    the folders of shards that are unfinished or under way. notes: what the user should know of what was there.
    """

    def __init__(self, out: Path, output: OutputFormat) -> None:
        self.out = out
        self.format = output
        self._work = out / WORK_FOLDER
        self.scratch = self._work / "unfinished"
        self._lock: FolderLock | None = None
        self._there = NOTHING
        self._kept: list[str] = []
        self._opened: dict[str, Any] = {}
        self._fresh = f"merged-{uuid4().hex}"  # in a name: many processes, on many machines, merge what they have made
        self._hasher = Hasher()
        self._journals = Journals(self._work)
        self._open_journals: dict[Path, Journal] = {}
        self._changed: dict[str, tuple[FrameRecord, ...]] = {}  # what is left of sequences; not written yet
        self._standing: dict[str, bool] = {}  # whether the frames.jsonl of a finished sequence is as the manifest says
        self.identity: dict[str, Any] = {}
        self.shards_left: list[Path] = []
        self.notes: list[str] = []

    def open(
        self,
        identity: dict[str, Any],
        why_not: Callable[[dict[str, Any]], str | None],
        *,
        overwrite: bool,
        shards: ShardRules | None = None,
    ) -> None:
        """Lock the folder for a run that makes what this `identity` says, beside what is there.

        why_not: says why a dataset of another identity cannot take this one in, or None where it can. shards: which
        shards are merged at once; without it none is.

        Raises StorageError where the folder holds something else, or another run writes to it.
        """
        check_place(self.out)
        self._lock = FolderLock(self._work / "lock")
        try:
            self._begin(identity, why_not, shards, overwrite=overwrite)
        except BaseException:
            if not (self._work / IDENTITY).exists():
                remove_work_folder(self._work, self.scratch)
            self._lock.release()
            self._lock = None
            raise

    def check(self, why_not: Callable[[dict[str, Any]], str | None], sequences: Collection[str], shard: Path) -> None:
        """See whether the folder could be opened, as far as that can be told while others may be writing to it.

        sequences: the only ones that matter, and shard the folder of the only shard: each of thousands of processes may
        ask. Raises StorageError where it could not, because it holds something else.
        """
        check_place(self.out)
        there = read_dataset_state(self.out, sequences) or NOTHING
        check_no_links(self.out, sequences, shard=shard)
        problem = there.problem or (why_not(there.identity) if there.identity is not None else "")
        if problem and there.holds_frames:
            raise other_dataset(self.out, problem)

    def _begin(
        self,
        identity: dict[str, Any],
        why_not: Callable[[dict[str, Any]], str | None],
        shards: ShardRules | None,
        *,
        overwrite: bool,
    ) -> None:
        there = read_dataset_state(self.out) or NOTHING
        check_no_links(self.out, {*there.sequences, *identity["sequences"]}, folders_alone=overwrite)
        problem = there.problem or (why_not(there.identity) if there.identity is not None else "") or ""
        if problem and (there.holds_frames or shards_hold_frames(self.out)) and not overwrite:
            raise other_dataset(self.out, problem)
        if problem or overwrite:
            remove_dataset(self.out, self._work, {*there.sequences, *identity["sequences"]})
            remove_shards(self.out)
            there = NOTHING
        self._there = there
        empty_scratch(self.scratch)
        if shards is not None and there.identity is not None:
            self._gather(shards, there.identity)  # now, while the working folder's identity is what they were made from
        named = set(identity["sequences"])
        if there.note:
            self.notes.append(there.note)
            self._forget_undescribed()
        if there.ended and manifest_is_changed(self.out):
            self.notes.append(f"{MANIFEST} is not as it was written; it is written again")
        self._note_changed_records(sorted(there.finished & named))
        self._journals.read_on()
        self._forget_finished(self._journals.sequences - named)
        begun = self._journals.sequences - named
        self._kept = sorted((there.finished | begun) - named)
        self.notes += kept_notes(self._kept, begun)
        self._opened = merged_identity(there.identity or identity, identity, self._kept)
        self.identity = merged_identity(there.identity or identity, identity, there.finished - named)
        self._write(self._work / IDENTITY, canonical(self._opened))
        if shards is not None:
            self._refuse(self._gather(shards, self._opened).refused)

    def _refuse(self, shards: dict[Path, str]) -> None:
        """Refuse shards that do not belong to the dataset. shards: why, by folder."""
        for folder, reason in shards.items():
            if not (self._there.holds_frames or has_journal(self._work)):
                (self._work / IDENTITY).unlink()  # nothing here was made from it
            also = f" (and {len(shards) - 1} more)" if len(shards) > 1 else ""
            remedy = "remove its folder, and make the shard again"
            raise StorageError(f"this shard{also} does not belong to the dataset: {reason}", file=folder, remedy=remedy)

    def _gather(self, shards: ShardRules, identity: dict[str, Any]) -> Gathered:
        """Merge the shards in the folder that were made from what an identity says."""
        found = merge_shards(self, identity, shards)
        self.shards_left = found.left
        for merged in found.merged:
            if merged.damaged:
                count, first = len(merged.damaged), merged.damaged[0]
                self.notes.append(f"{count} files of a shard are not as they were made, {first} the first; not merged")
        return found

    def _forget_undescribed(self) -> None:
        """Remove the records of frames that only an identity described which cannot be read."""
        self._journals.read_on()
        self._journals.rewrite(dict.fromkeys(self._journals.sequences), self.scratch)
        for folder in self._there.finished:
            if not self._stand(folder):
                with storage_errors(path := self.out / folder / FRAMES):
                    path.unlink(missing_ok=True)

    def _note_changed_records(self, folders: Iterable[str]) -> None:
        """Say which finished sequences have records that somebody changed: nothing in them is believed."""
        for folder in folders:
            # Where a run was killed when it ended, they are newer than the manifest, and its journals are there.
            if not (self._stand(folder) or folder in self._journals.sequences):
                self.notes.append(f"{folder}/{FRAMES} is not as it was written; its frames are made again")

    def _stand(self, folder: str) -> bool:
        """Tell whether the records of a finished sequence are as the manifest says."""
        if folder not in self._standing:
            there = self._seen if self._lock is None else self._there
            known = there.files[folder].get(FRAMES) if folder in there.finished else None
            self._standing[folder] = known is not None and sha256_of_regular_file(self.out / folder / FRAMES) == known
        return self._standing[folder]

    @cached_property
    def _seen(self) -> DatasetState:
        """What the folder holds, for a process that does not open it."""
        return read_dataset_state(self.out, ()) or NOTHING

    def _forget_finished(self, folders: Iterable[str]) -> None:
        """Remove journals that say nothing but what is in their sequence's frames.jsonl."""
        known: list[str] = []
        for folder in folders:
            recorded = {(record.frame, *record.files.items()) for record in read_records(self.out / folder / FRAMES)}
            begun = joined_records(self._journals.records(folder)).values()
            known += [folder] if {(record.frame, *record.files.items()) for record in begun} <= recorded else []
        if known:
            self._journals.rewrite(dict.fromkeys(known), self.scratch)

    def close(self) -> None:
        """Unlock the folder. Finished frames stay for the next run; without any, the folder is removed."""
        for journal in self._open_journals.values():
            journal.close()
        self._open_journals.clear()
        if self._lock is None:
            return
        if self._opened and not self.holds_frames():
            remove_dataset(self.out, self._work, self._opened["sequences"])
            remove_shards(self.out)
            remove_work_folder(self._work, self.scratch)
            with contextlib.suppress(OSError):
                self.out.rmdir()
        self._lock.release()
        self._lock = None

    def holds_frames(self) -> bool:
        """Tell whether a run has finished a frame."""
        path = self.out / MANIFEST
        return path.exists() or has_journal(self._work) or recorded(self.out) or shards_hold_frames(self.out)

    def _write(self, path: Path, text: str) -> str:
        """Write a text file, unless it has this content already; return its SHA-256."""
        data = text.encode()
        digest = sha256_of_bytes(data)
        try:
            found = path.lstat()
        except OSError:
            with storage_errors(path):
                path.parent.mkdir(parents=True, exist_ok=True)
        else:
            if S_ISREG(found.st_mode) and found.st_size == len(data) and sha256_of_regular_file(path) == digest:
                return digest
        write_atomic(path, data, self.scratch)
        return digest

    # --- frames ---

    @property
    def kept(self) -> dict[str, dict[str, str]]:
        """The files of the finished sequences that stay as they are, SHA-256 by name, by the sequence's folder."""
        return {folder: self._there.files[folder] for folder in self._kept if folder in self._there.finished}

    def keep_intact(self, folder: str, names: FrameNames, count: int, as_planned: AsPlanned) -> None:
        """Check which files of a sequence exist as they were written.

        names: of the frames' files. count: of the sequence's frames. as_planned: of records in journals, whose own
        hash nothing tells. Records of lost or damaged files are dropped, those of frames that the sequence does not
        have, and those of what is not planned; so from then on the journals alone say what is finished. What this
        process has merged was hashed then.
        """
        recorded = self.out / folder / FRAMES
        if recorded.is_dir():
            raise StorageError("is a folder where a file of the dataset belongs", file=recorded, remedy="move it away")
        fresh = journal_path(self._work, self._fresh, folder.split("/")[1])
        finished = list(self.finished_records(folder))
        journals = {path: list(records_in(lines)) for path, lines in self._journals.lines(folder)}
        before = chain.from_iterable(records for path, records in journals.items() if path != fresh)
        written = plausible_records(finished, names, count)
        begun, note = planned_records(before, names, count, as_planned)
        self.notes += [f"{folder}: {note}"] if note else []
        found = joined_records((*written.values(), *begun.values()))
        checked = (self._intact(folder, record) for record in found.values())
        merged = plausible_records(journals.get(fresh, ()), names, count).values()  # hashed when merged
        intact = joined_records((*(record for record in checked if record.files), *merged))
        if intact != joined_records((*finished, *chain.from_iterable(journals.values()))):
            self._changed[folder] = tuple(intact.values())

    def settle(self) -> None:
        """Record what `keep_intact` has found: where it is not what was recorded, journals are written again."""
        if self._changed:
            self._journals.rewrite(self._changed, self.scratch)
            self._changed = {}

    def read_on(self) -> None:
        """Read what others have recorded since this process read the journals."""
        self._journals.read_on()

    def records(self, folder: str) -> dict[int, FrameRecord]:
        """Return the records of a sequence's finished frames by frame, in order."""
        return joined_records((*self.finished_records(folder), *self.journal_records(folder)))

    def journal_records(self, folder: str) -> Iterator[FrameRecord]:
        """Yield the records of a sequence in journals, as far as they were read; a frame may have several."""
        yield from self._journals.records(folder)

    def finished_records(self, folder: str) -> Iterator[FrameRecord]:
        """Yield the records of a finished sequence, where they are as they were written and count."""
        if self._stand(folder) and not self._journals.instead(folder):
            yield from read_records(self.out / folder / FRAMES)

    def _intact(self, folder: str, record: FrameRecord) -> FrameRecord:
        """Return the record without the files whose hashes are others."""
        place = self.out / folder
        files = {name: digest for name, digest in record.files.items() if self._hasher.sha256(place / name) == digest}
        return replace(record, files=files)

    def make_folders(self, folder: str) -> None:
        """Create the folders of a sequence. Raises StorageError."""
        with storage_errors(self.out / folder):
            for name in self.format.folders:
                (self.out / folder / name).mkdir(parents=True, exist_ok=True)

    def journal(self, folder: str) -> "SequenceJournal":
        """Open the journal of a sequence that this run writes, and create the sequence's folders."""
        self.make_folders(folder)
        return SequenceJournal(self._journal_of(folder, "0"), folder)

    def append_merged(self, frames: Mapping[str, Iterable[FrameRecord]]) -> None:
        """Record frames whose files were moved here from a shard, by the sequence's folder."""
        for folder, records in frames.items():
            self._journal_of(folder, self._fresh).append_all((folder, record) for record in records)

    def append_summary(self, summary: dict[str, Any]) -> None:
        """Record a shard that was merged."""
        append_line(self._work / f"{self._fresh}.jsonl", json.dumps(summary) + "\n")

    def _journal_of(self, folder: str, name: str) -> Journal:
        """Return this process's journal of a sequence's scene."""
        path = journal_path(self._work, name, folder.split("/")[1])
        if path not in self._open_journals:
            self._open_journals[path] = Journal(path)
        return self._open_journals[path]

    def write_file(self, folder: str, name: str, data: bytes) -> None:
        """Write a file of a sequence."""
        write_atomic(self.out / folder / name, data, self.scratch)

    def link_file(self, source: Path, folder: str, name: str) -> None:
        """Link an existing file, of this dataset or another, into a sequence."""
        link_or_copy(source, self.out / folder / name, self.scratch)

    def drop_frames(self, folder: str, records: Iterable[FrameRecord]) -> None:
        """Remove the files of incomplete frames, which a run with other --frames left."""
        for record in records:
            for name in record.files:
                with storage_errors(self.out / folder / name):
                    (self.out / folder / name).unlink(missing_ok=True)

    # --- text files ---

    def finish_sequence(self, folder: str, texts: dict[str, str], records: Iterable[FrameRecord]) -> dict[str, str]:
        """Write a sequence's text files and its frames.jsonl; return their SHA-256 by name."""
        contents = {**texts, FRAMES: "".join(record.line() for record in records)}
        self._keep_finished(folder, sha256_of_bytes(contents[FRAMES].encode()))
        return {name: self._write(self.out / folder / name, text) for name, text in sorted(contents.items())}

    def _keep_finished(self, folder: str, digest: str) -> None:
        """Record in a journal what is finished, where frames.jsonl becomes another before the manifest does."""
        if self._stand(folder) and self._there.files[folder][FRAMES] != digest:
            self._journal_of(folder, "0").append_all((folder, record) for record in self.finished_records(folder))
        self._standing[folder] = False

    def write_text(self, name: str, text: str) -> str:
        """Write a text file of the dataset; return its SHA-256."""
        return self._write(self.out / name, text)

    def write_bytes(self, name: str, data: bytes) -> str:
        """Write a binary file of the dataset; return its SHA-256."""
        write_atomic(self.out / name, data, self.scratch)
        return sha256_of_bytes(data)

    def write_manifest(self, content: dict[str, Any]) -> str:
        """Write the manifest, with what stays beside the run's part of the dataset; return its SHA-256."""
        drawn = self._there.files.get(OVERVIEW)
        merged = merged_manifest(self._there, content, self._kept)
        written = self.write_text(MANIFEST, canonical(merged))
        settings = {folder.split("/")[0] for folder in self._there.finished}
        for name in (f"{setting}/{file}" for setting in settings for file in self.format.layout.setting_files):
            digest = self._there.files.get(name)  # of a setting whose sequences have files of their own now
            if name not in merged["files"] and digest and sha256_of_regular_file(self.out / name) == digest:
                with storage_errors(self.out / name):
                    (self.out / name).unlink()
        path = self.out / OVERVIEW
        if OVERVIEW not in content["files"] and drawn is not None and sha256_of_regular_file(path) == drawn:
            with storage_errors(path):
                path.unlink()
        return written

    def seal(self) -> None:
        """End a run that has finished everything: remove the working folder, unless other sequences are unfinished."""
        for journal in self._open_journals.values():
            journal.close()
        self._open_journals.clear()
        self._journals.read_on()
        self._journals.rewrite(dict.fromkeys(self.identity["sequences"].keys() - set(self._kept)), self.scratch)
        if not has_journal(self._work):
            remove_work_folder(self._work, self.scratch)
        self.close()

    def finish_as_shard(self, record: ShardRecord) -> None:
        """End the making of a shard whose folder this is."""
        finish_shard(self.out, record)
        self._opened = {}  # what is here is no dataset, and stays
        self.close()
