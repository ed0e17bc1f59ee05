# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset on disk: which frames are finished, which are missing, and the text files that say how it was made.

During a run, `OUT/.noisy_world` holds the dataset's identity, a journal for each sequence with a line for each finished
frame, and unfinished files. At the end each journal becomes its sequence's frames.jsonl, and the folder is removed. A
frame counts as finished if the journal names it and its files have the hashes written there; everything else is made
again. So a killed run, a torn line, a truncated image or a power cut costs time and nothing else.
"""

import contextlib
import errno
import json
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import StorageError
from ..presets.preset import canonical
from .differences import ANOTHER_FOLDER, first_difference
from .layouts import FrameNames, OutputFormat
from .merging import merged_identity, merged_manifest
from .records import FRAMES, FrameRecord, joined_records, read_records
from .removal import empty_scratch, remove_dataset, remove_journals, remove_work_folder
from .standing import (
    IDENTITY,
    JOURNALS,
    MANIFEST,
    OVERVIEW,
    WORK_FOLDER,
    Standing,
    journal_folders,
    read_standing,
)
from .storage import (
    FolderLock,
    link_on_the_way,
    link_or_copy,
    sha256_of_bytes,
    sha256_of_regular_file,
    storage_errors,
    write_atomic,
)

NOTHING = Standing(None, None, frozenset(), holds_frames=False)


class Dataset:
    """The folder of a dataset while a run writes to it.

    identity: what it is made from, once it is open: what the run makes, and what stays beside that. notes: what the
    user should know of what was there.
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
        self.identity: dict[str, Any] = {}
        self.notes: list[str] = []

    def open(
        self, identity: dict[str, Any], why_not: Callable[[dict[str, Any]], str | None], *, overwrite: bool
    ) -> None:
        """Lock the folder for a run that makes what this `identity` says, beside what is there.

        why_not: says why a dataset of another identity cannot take this one in, or None where it can.

        Raises StorageError where the folder holds something else, or another run writes to it.
        """
        if self.out.exists() and not self.out.is_dir():
            raise StorageError(f"{self.out}: is a file, not a folder; choose another with --out")
        if self._work.is_symlink() or (self._work.exists() and not self._work.is_dir()):
            raise StorageError(f"{self._work}: is not the folder that a run works in; remove it")
        if read_standing(self.out) is None and self._holds_other_things():
            raise StorageError(
                f"{self.out}: is not empty and holds no dataset of Noisy World; choose another folder with --out"
            )
        self._lock = FolderLock(self._work / "lock")
        try:
            self._begin(identity, why_not, overwrite=overwrite)
        except BaseException:
            if not (self._work / IDENTITY).exists():
                remove_work_folder(self._work, self.scratch)
            self._lock.release()
            self._lock = None
            raise

    def _begin(
        self, identity: dict[str, Any], why_not: Callable[[dict[str, Any]], str | None], *, overwrite: bool
    ) -> None:
        self._check_folders(identity["sequences"])
        there = read_standing(self.out) or NOTHING
        problem = there.problem
        if not problem and there.identity is not None:
            problem = why_not(there.identity) or ""
        if problem and there.holds_frames and not overwrite:
            remedy = "" if "--overwrite" in problem else f"; {ANOTHER_FOLDER}"
            raise StorageError(f"{self.out}: holds another dataset: {problem}{remedy}")
        if problem or overwrite:
            remove_dataset(self.out, self._work, {*there.sequences, *identity["sequences"]})
            there = NOTHING
        self._there = there
        named = set(identity["sequences"])
        if there.note:
            self.notes.append(there.note)
            self._forget_undescribed()
        elif not (self._work / IDENTITY).exists():
            self._note_changed_records(sorted(there.finished & named))
        self._forget_finished(journal_folders(self._work) - named)
        begun = journal_folders(self._work) - named
        self._kept = sorted((there.finished | begun) - named)
        self._note_kept(begun)
        self._opened = merged_identity(there.identity or identity, identity, self._kept)
        self.identity = merged_identity(there.identity or identity, identity, there.finished - named)
        empty_scratch(self.scratch)
        self._write(self._work / IDENTITY, canonical(self._opened))

    def _check_folders(self, sequences: Iterable[str]) -> None:
        """Refuse links in place of folders: what is written or removed has to be the dataset's own."""
        for folder in sequences:
            for place in (self._work / folder, *(self.out / folder / name for name in self.format.folders)):
                if link := link_on_the_way(self.out, place):
                    raise StorageError(f"{link}: is a link, but the dataset's folders have to be its own; remove it")

    def _forget_undescribed(self) -> None:
        """Remove the records of frames that only an identity described which cannot be read."""
        for folder in journal_folders(self._work):
            remove_journals(self._work, folder)
        for folder in self._there.finished:
            path = self.out / folder / FRAMES
            if sha256_of_regular_file(path) != self._there.files[folder].get(FRAMES):
                with storage_errors(path):
                    path.unlink(missing_ok=True)

    def _note_changed_records(self, folders: Iterable[str]) -> None:
        """Say which records of finished sequences somebody changed. What they say of the files is checked, no more."""
        for folder in folders:
            name = f"{folder}/{FRAMES}"
            if sha256_of_regular_file(self.out / name) != self._there.files[folder].get(FRAMES):
                self.notes.append(f"{name} is not as it was written; frames that it does not describe are made again")

    def _forget_finished(self, folders: Iterable[str]) -> None:
        """Remove journals that say nothing but what is in their sequence's frames.jsonl."""
        for folder in folders:
            recorded = {(record.frame, *record.files.items()) for record in read_records(self.out / folder / FRAMES)}
            if {(record.frame, *record.files.items()) for record in self.records(folder).values()} <= recorded:
                remove_journals(self._work, folder)

    def _note_kept(self, begun: Iterable[str]) -> None:
        """Say which sequences stay as they are."""
        finished = [folder for folder in self._kept if folder not in begun]
        for folders, state in ((finished, "as it is"), (sorted(begun), "unfinished")):
            if folders:
                names = ", ".join(folders[:4]) + (f" and {len(folders) - 4} more" if len(folders) > 4 else "")
                self.notes.append(f"what this preset does not name stays {state}: {names}")

    def join(self, identity: dict[str, Any]) -> None:
        """Take part in a run that another process has opened with the same `identity`, but for the paths' hashes.

        Raises StorageError where no run is open, or where this process has another identity and would write other
        bytes.
        """
        there = read_standing(self.out) if self.scratch.is_dir() else None
        if there is None or there.identity is None or there.problem:
            raise StorageError(f"{self.out}: no run is open here")
        # Through JSON, as the file is: JSON turns tuples into lists, for instance.
        here = json.loads(canonical(identity))
        if difference := first_difference(_without_paths(_narrowed(there.identity, here)), _without_paths(here)):
            raise StorageError(
                f"{self.out}: the run was opened with another identity ({difference}); do not change its inputs "
                "while it runs, and start it again"
            )

    def close(self) -> None:
        """Unlock the folder. Finished frames stay for the next run; without any, the folder is removed."""
        if self._lock is None:
            return
        if self._opened and not self.holds_frames():
            remove_dataset(self.out, self._work, self._opened["sequences"])
            remove_work_folder(self._work, self.scratch)
            with contextlib.suppress(OSError):
                self.out.rmdir()
        self._lock.release()
        self._lock = None

    def holds_frames(self) -> bool:
        """Tell whether a run has finished a frame."""
        there = read_standing(self.out)
        return there is not None and there.holds_frames

    def _holds_other_things(self) -> bool:
        return self.out.is_dir() and any(item.name != WORK_FOLDER for item in self.out.iterdir())

    def _write(self, path: Path, text: str) -> str:
        """Write a text file, unless it has this content already; return its SHA-256."""
        data = text.encode()
        digest = sha256_of_bytes(data)
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            if not path.is_symlink() and sha256_of_regular_file(path) == digest:
                return digest
        write_atomic(path, data, self.scratch)
        return digest

    # --- frames ---

    @property
    def kept(self) -> dict[str, dict[str, str]]:
        """The files of the finished sequences that stay as they are, SHA-256 by name, by the sequence's folder."""
        return {folder: self._there.files[folder] for folder in self._kept if folder in self._there.finished}

    def take_stock(self, folder: str, names: FrameNames, count: int) -> dict[int, set[str]]:
        """Return by frame the files of a sequence that exist as they were written.

        names: of the frames' files. count: of the sequence's frames. Records of lost or damaged files are dropped, and
        those of frames that the sequence does not have; so from then on the journals alone say what is finished.
        """
        recorded = self.out / folder / FRAMES
        if recorded.is_dir():
            raise StorageError(f"{recorded}: is a folder where a file of the dataset belongs; move it away")
        found = joined_records(
            part for record in self._recorded(folder) if (part := _plausible(record, names, count)) is not None
        )
        intact = {frame: self._intact(folder, record) for frame, record in found.items()}
        intact = {frame: record for frame, record in intact.items() if record.files}
        kept = self._work / folder / "journal-kept.jsonl"
        with storage_errors(kept):
            if intact:
                self._write(kept, "".join(record.line() for record in intact.values()))
            for journal in (self._work / folder).glob(JOURNALS):
                if journal != kept or not intact:
                    journal.unlink()
        return {frame: set(record.files) for frame, record in intact.items()}

    def records(self, folder: str) -> dict[int, FrameRecord]:
        """Return the records of a sequence's finished frames by frame, in order."""
        return joined_records(self.journal_records(folder))

    def journal_records(self, folder: str) -> Iterator[FrameRecord]:
        """Yield the records of a sequence's journals; a frame may have several."""
        for path in self._journals(folder):
            yield from read_records(path)

    def _journals(self, folder: str) -> list[Path]:
        return sorted((self._work / folder).glob(JOURNALS))

    def _recorded(self, folder: str) -> Iterator[FrameRecord]:
        yield from read_records(self.out / folder / FRAMES)
        yield from self.journal_records(folder)

    def _intact(self, folder: str, record: FrameRecord) -> FrameRecord:
        """Return the record without the files whose hashes are others."""
        place = self.out / folder
        files = {
            name: digest for name, digest in record.files.items() if sha256_of_regular_file(place / name) == digest
        }
        return replace(record, files=files)

    def journal(self, folder: str, worker: int) -> "Journal":
        """Open a worker's journal of a sequence, and create the sequence's folders."""
        with storage_errors(self.out / folder):
            for name in self.format.folders:
                (self.out / folder / name).mkdir(parents=True, exist_ok=True)
        return Journal(self._work / folder / f"journal-{worker}.jsonl")

    def write_file(self, folder: str, name: str, data: bytes) -> str:
        """Write a file of a sequence and return its SHA-256."""
        write_atomic(self.out / folder / name, data, self.scratch)
        return sha256_of_bytes(data)

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
        return {name: self._write(self.out / folder / name, text) for name, text in sorted(contents.items())}

    def write_text(self, name: str, text: str) -> str:
        """Write a text file of the dataset; return its SHA-256."""
        return self._write(self.out / name, text)

    def write_bytes(self, name: str, data: bytes) -> str:
        """Write a binary file of the dataset; return its SHA-256."""
        write_atomic(self.out / name, data, self.scratch)
        return sha256_of_bytes(data)

    def write_manifest(self, content: dict[str, Any]) -> None:
        """Write the manifest, with what stays beside the run's part of the dataset."""
        drawn = self._there.files.get(OVERVIEW)
        merged = merged_manifest(self._there, content, self._kept)
        self.write_text(MANIFEST, canonical(merged))
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

    def seal(self) -> None:
        """End a run that has finished everything: remove the working folder, unless other sequences are unfinished."""
        for folder in self.identity["sequences"]:
            if folder not in self._kept:
                remove_journals(self._work, folder)
        if not journal_folders(self._work):
            remove_work_folder(self._work, self.scratch)
        self.close()


class Journal:
    """The lines of finished frames, appended one by one."""

    def __init__(self, path: Path) -> None:
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            _cut_torn_line(path)
            self._file = path.open("ab", buffering=0)
        self._path = path

    def append(self, record: FrameRecord) -> None:
        """Add a frame whose files are written."""
        line = record.line().encode()
        with storage_errors(self._path):
            if self._file.write(line) != len(line):  # an unbuffered write may write only a part when the disk is full
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _cut_torn_line(path: Path) -> None:
    """Remove what a killed process left after the last whole line, so that the next line is not appended to it."""
    with contextlib.suppress(FileNotFoundError):
        data = path.read_bytes()
        if data and not data.endswith(b"\n"):
            with path.open("r+b") as file:
                file.truncate(data.rfind(b"\n") + 1)


def _plausible(record: FrameRecord, names: FrameNames, count: int) -> FrameRecord | None:
    """Return a record with those of its files that the frame has; None for what is no record of the sequence."""
    if not 0 <= record.frame < count or (record.time_s, record.depth_time_s) != names.stamps.told(record.frame):
        return None
    own = names.of(record.frame)
    return replace(record, files={name: digest for name, digest in record.files.items() if name in own})


def _narrowed(there: dict[str, Any], here: dict[str, Any]) -> dict[str, Any]:
    """Return an identity without the scenes, settings, sequences and versions that another one does not name."""
    parts = ("scenes", "settings", "sequences", "versions")
    undecided = {key: None for key in ("near_m", "far_m", "rig", "render") if here[key] is None}
    return {**there, **undecided, **{key: {k: v for k, v in there[key].items() if k in here[key]} for key in parts}}


def _without_paths(identity: dict[str, Any]) -> dict[str, Any]:
    """Return an identity without the hashes of its paths, which a worker does not make again."""
    scenes = {name: {**scene, "path": scene["path"]["frames"]} for name, scene in identity["scenes"].items()}
    return {**identity, "scenes": scenes}
