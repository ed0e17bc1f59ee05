# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset's folder while a run writes to it: which images are finished, which are missing.

During a run, `OUT/.noisy_world` holds the dataset's identity, journals with a line for each finished frame, and
unfinished files. At the end the lines of a sequence become its frames.jsonl, and the folder is removed. A frame counts
as finished if a journal names it and its files have the hashes written there; everything else is made again. So a
killed run, a torn line, a truncated image or a power cut costs time and nothing else.
"""

import contextlib
import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from stat import S_ISREG
from typing import Any, TypeAlias
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS, COLOUR_AND_DEPTH
from ..core.atomic_files import (
    FolderLock,
    Hasher,
    link_or_copy,
    sha256_of_bytes,
    sha256_of_regular_file,
    storage_errors,
    write_atomic,
)
from ..core.depth_range import OutOfRange
from ..core.errors import StorageError
from ..core.file_access import canonical
from ..core.frame_table import (
    COMPLETED,
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
from ..layouts import FrameNames, Modality, OutputFormat
from .estimate import image_bytes, parts_made
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
    other_dataset,
    read_dataset_state,
    recorded,
    remove_dataset,
    remove_work_folder,
)
from .frame import PlannedFrame
from .plan import Plan, Render
from .sequence import PlannedSequence, ShownSources
from .shards import (
    Gathered,
    Shard,
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

    def keep_intact(self, folder: str, names: FrameNames, count: int, as_planned: AsPlanned) -> dict[int, FrameRecord]:
        """Check which files of a sequence exist as they were written; return the records of these, by frame.

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
        return intact

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

    def begin(self, folder: str) -> None:
        """Open the journal of a sequence that this run writes, and create the sequence's folders."""
        self.make_folders(folder)
        self._journal_of(folder, "0")

    def append(self, folder: str, records: Iterable[FrameRecord]) -> None:
        """Record frames of a sequence that was begun, whose files are written. Threads may share it."""
        self._journal_of(folder, "0").append_all((folder, record) for record in records)

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
            self.append(folder, self.finished_records(folder))
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


# Which images of a render's sequences are complete, and what is still missing.


TOLD_OTHERWISE = ("motion", "exposure", "camera", COMPLETED)
"""Parts of a record that follow from paths, renders and images, so from a dataset's identity."""


@dataclass(frozen=True)
class Missing:
    """What is missing of a render: the source frames that its sequences need, and roughly the bytes of its files."""

    sources: list[int]
    bytes_to_write: int


def find_missing(plan: Plan, render: Render, completed: "CompletedImages") -> Missing:
    """Return what is missing of a render. completed: what is there of it."""
    needed: set[int] = set()
    size = 0
    for modality in plan.format.modalities:
        missing, shared, held = dict[str, int](), set[ShownSources](), set[ShownSources]()
        for sequence in render.sequences:
            clean = not sequence.setting.on(modality)
            for frame in sequence.frames:
                shown = sequence.shows(modality, frame)
                if completed.has(sequence, modality, frame):
                    held |= {shown} if clean else set()
                    continue
                needed.add(shown[0])
                shared |= {shown} if clean else set()
                missing[sequence.folder] = missing.get(sequence.folder, 0) + 1
        made = parts_made((item for item in render.sequences if item.folder in missing), modality)
        alone = sum(part * missing[folder] for folder, part in made.items())
        size += int(image_bytes(plan, render, modality) * (alone + len(shared - held)))
    return Missing(sorted(needed), size)


def is_as_planned(sequence: PlannedSequence, names: FrameNames, record: FrameRecord) -> bool:
    """Tell whether a record says that to its images was done what the sequence does to them.

    That is known without the images: severities are drawn from the frame's own streams.
    """
    if not 0 <= record.frame < len(sequence.source_frames) or sequence.leaves_out(record.frame):
        return False
    there = [name for name in COLOUR_AND_DEPTH if names.image(name, record.frame) in record.files]
    done = PlannedFrame(sequence, record.frame).record(there, there)
    recorded = {name: part for name, part in record.perturbed.items() if name not in TOLD_OTHERWISE}
    return recorded == json.loads(json.dumps(done))  # tuples are lists there


Flags: TypeAlias = dict[str, dict[Modality, NDArray[np.bool_]]]
"""By a sequence's folder and modality, whether each frame's image is there: however much was done to it, one byte."""


class CompletedImages:
    """The images of a render's sequences that a folder holds, a dataset or a part of one, when a process begins."""

    def __init__(self, dataset: Dataset, render: Render, checked: Shard | None = None, *, hashed: bool = False) -> None:
        """Read the journals, which say what a run that is open has finished.

        checked: look at a dataset that no run has opened for this process: its records count where the files that show
        this shard's source frames have their hashes. hashed: hash all files first; from then on journals name those
        alone that exist as they were written.
        """
        self._dataset = dataset
        self._names = dataset.format.names(render.scene.source.frame_stamps)
        self._sequences = {sequence.folder: sequence for sequence in render.sequences if sequence.frames}
        self._lost: dict[int, OutOfRange] = {}  # by source frame
        self._checked = checked
        self._first = render.frames[:1]  # is looked at by whoever makes the others, unless it is there
        self._hasher = Hasher()
        dataset.read_on()
        records = self._intact if hashed else self._records
        every = render.sequences if hashed else self._sequences.values()
        self._flags: Flags = {sequence.folder: self._flags_of(sequence, records(sequence)) for sequence in every}
        if hashed:
            dataset.settle()

    def _intact(self, sequence: PlannedSequence) -> Iterable[FrameRecord]:
        planned = partial(is_as_planned, sequence, self._names)
        return self._dataset.keep_intact(sequence.folder, self._names, len(sequence.source_frames), planned).values()

    def _flags_of(self, sequence: PlannedSequence, records: Iterable[FrameRecord]) -> dict[Modality, NDArray[np.bool_]]:
        count = len(sequence.source_frames)
        flags: dict[Modality, NDArray[np.bool_]] = {
            modality: np.zeros(count, dtype=np.bool_) for modality in self._dataset.format.modalities
        }
        for record in records:
            if not 0 <= record.frame < count or sequence.leaves_out(record.frame):
                continue
            for modality, finished in flags.items():
                name, source = self._names.image(modality, record.frame), sequence.source_of(modality, record.frame)
                finished[record.frame] |= name in record.files and self._counts(sequence, name, source, record)
            if record.out_of_range is not None and not sequence.setting.depth:
                self._lost[sequence.shown(record.frame).depth_source] = record.out_of_range
        return flags

    def _records(self, sequence: PlannedSequence) -> Iterable[FrameRecord]:
        journals = self._dataset.journal_records(sequence.folder)
        if self._checked is not None:
            journals = (record for record in journals if is_as_planned(sequence, self._names, record))
        return chain(self._dataset.finished_records(sequence.folder), journals)

    def _counts(self, sequence: PlannedSequence, name: str, source: int, record: FrameRecord) -> bool:
        if self._checked is None or source in self._first:
            return True
        path = self._dataset.out / sequence.folder / name
        return source in self._checked and self._hasher.sha256(path) == record.files[name]

    def has(self, sequence: PlannedSequence, modality: Modality, frame: int) -> bool:
        """Tell whether a frame's image is there."""
        finished = self._flags[sequence.folder].get(modality)
        return finished is None or bool(finished[frame])

    def out_of_range(self, source: int) -> OutOfRange | None:
        """Return what of a source frame's depth its finished clean image does not hold."""
        return self._lost.get(source)

    def clean_files(self, modality: Modality, shown: ShownSources) -> Iterator[Path]:
        """Yield finished files that hold the clean image of a source frame, or of one and the next."""
        for folder, sequence in self._sequences.items():
            finished = self._flags[folder].get(modality)
            if finished is None or sequence.setting.on(modality):
                continue
            for frame in sequence.showing(modality, shown[0]):
                if finished[frame] and sequence.shows(modality, frame) == shown:
                    yield self._dataset.out / folder / self._names.image(modality, frame)


class FinishedImages:
    """The images of a render's sequences that are finished, in any of several folders."""

    def __init__(self, completed: Iterable[CompletedImages]) -> None:
        """Take what the folders hold; the first one first, where several hold the same."""
        self._completed = tuple(completed)

    def missing(self, sequence: PlannedSequence, modality: Modality, source: int) -> list[int]:
        """Return the frames to be made that show an image of a source frame and lack it."""
        return [
            frame
            for frame in sequence.showing(modality, source)
            if not any(completed.has(sequence, modality, frame) for completed in self._completed)
        ]

    def lacks(self, sequence: PlannedSequence, modality: Modality, sources: Iterable[int]) -> bool:
        """Tell whether a sequence lacks an image of some source frames."""
        return any(self.missing(sequence, modality, source) for source in sources)

    def sources_missing(self, render: Render, modalities: Iterable[Modality], sources: Iterable[int]) -> list[int]:
        """Return those of some source frames that a sequence of a render needs for a missing image."""
        pairs: list[tuple[PlannedSequence, Modality]] = [
            (sequence, modality) for sequence in render.sequences if sequence.frames for modality in modalities
        ]
        return [source for source in sources if any(self.missing(item, kind, source) for item, kind in pairs)]

    def pairs(
        self, sequences: Iterable[PlannedSequence], modalities: Iterable[Modality], source: int
    ) -> set[ShownSources]:
        """Return the source frames, each with the next, of which images that lead on are missing."""
        return {
            sequence.shows(modality, frame)
            for sequence in sequences
            for modality in modalities
            for frame in self.missing(sequence, modality, source)
        }

    def clean_image(self, modality: Modality, shown: ShownSources) -> tuple[Path, str, OutOfRange | None] | None:
        """Return a finished file with the clean image of a source frame, its SHA-256 and the depth that it lacks.

        shown: the source frame or, for a channel that leads on, that and the next.
        """
        for completed in self._completed:
            for path in completed.clean_files(modality, shown):
                if digest := sha256_of_regular_file(path):
                    return path, digest, completed.out_of_range(shown[0]) if CHANNELS[modality].paired else None
        return None
