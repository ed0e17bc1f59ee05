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
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

from ..errors import StorageError
from ..presets.preset import canonical
from .layouts import LAYOUTS, Layout, OutputFormat
from .records import FRAMES, FrameRecord, joined_records, read_records
from .storage import (
    FolderLock,
    link_or_copy,
    sha256_of_bytes,
    sha256_of_file,
    storage_errors,
    write_atomic,
)

WORK_FOLDER = ".noisy_world"
MANIFEST = "manifest.json"
RUN = "run.json"
OVERVIEW = "overview.png"


class Dataset:
    """The folder of a dataset while a run writes to it."""

    def __init__(self, out: Path, output: OutputFormat) -> None:
        self.out = out
        self.format = output
        self._work = out / WORK_FOLDER
        self.scratch = self._work / "unfinished"
        self._lock: FolderLock | None = None
        self._identity: dict[str, Any] = {}

    def open(self, identity: dict[str, Any], *, overwrite: bool) -> None:
        """Lock the folder for a run that writes the dataset with this `identity`.

        Raises StorageError where the folder holds something else, or another run writes to it.
        """
        if self.out.exists() and not self.out.is_dir():
            raise StorageError(f"{self.out}: is a file, not a folder; choose another with --out")
        there = self._identity_there()
        if there is None and self._holds_other_things():
            raise StorageError(
                f"{self.out}: is not empty and holds no dataset of Noisy World; choose another folder with --out"
            )
        self._lock = FolderLock(self._work / "lock")
        there = self._identity_there()
        difference = None if there is None else first_difference(there, identity)
        if difference and not overwrite and self.holds_frames():
            self._lock.release()
            raise StorageError(
                f"{self.out}: holds a different dataset ({difference}); choose another folder with --out, or "
                "replace it with --overwrite"
            )
        if there is not None and (overwrite or difference):
            self._remove_dataset(there)
        self._identity = identity
        with storage_errors(self.scratch):
            shutil.rmtree(self.scratch, ignore_errors=True)
            self.scratch.mkdir(parents=True, exist_ok=True)
        self._write(self._work / "identity.json", canonical(identity))

    def join(self, identity: dict[str, Any]) -> None:
        """Take part in a run that another process has opened with the same `identity`.

        Raises StorageError where no run is open, or where this process has another identity and would write other
        bytes.
        """
        opened = self._identity_there() if self.scratch.is_dir() else None
        if opened is None:
            raise StorageError(f"{self.out}: no run is open here")
        # Through JSON, as the file is: JSON turns tuples into lists, for instance.
        if difference := first_difference(opened, json.loads(canonical(identity))):
            raise StorageError(
                f"{self.out}: the run was opened with another identity ({difference}); do not change its inputs "
                "while it runs, and start it again"
            )

    def close(self) -> None:
        """Unlock the folder. Finished frames stay for the next run; without any, the folder is removed."""
        if self._lock is None:
            return
        if self._identity and not self.holds_frames():
            self._remove_dataset(self._identity)
            shutil.rmtree(self._work, ignore_errors=True)
            with contextlib.suppress(OSError):
                self.out.rmdir()
        self._lock.release()
        self._lock = None

    def holds_frames(self) -> bool:
        """Tell whether an earlier run has finished a frame."""
        journals = self._work.glob("*/*/journal-*.jsonl")
        return (self.out / MANIFEST).exists() or any(journal.stat().st_size for journal in journals)

    def _holds_other_things(self) -> bool:
        return self.out.is_dir() and any(item.name != WORK_FOLDER for item in self.out.iterdir())

    def _identity_there(self) -> dict[str, Any] | None:
        for path in (self._work / "identity.json", self.out / MANIFEST):
            with contextlib.suppress(FileNotFoundError):
                try:
                    content = json.loads(path.read_text(encoding="utf-8"))
                    return content if path.name == "identity.json" else content["identity"]
                except (ValueError, KeyError, TypeError):
                    return {"unreadable": path.name}
        return None

    def _remove_dataset(self, identity: dict[str, Any]) -> None:
        """Remove the files of the dataset in the folder, and no other file."""
        with storage_errors(self.out):
            for folder in identity.get("sequences", []):
                sequence = self.out / folder
                for layout in LAYOUTS.values():  # the dataset in the folder may have another layout than this run's
                    _remove_sequence(sequence, layout)
                for empty in (sequence, sequence.parent):
                    with contextlib.suppress(OSError):
                        empty.rmdir()
            for name in (MANIFEST, RUN, OVERVIEW):
                (self.out / name).unlink(missing_ok=True)
            for journal in self._work.glob("*/**/journal-*.jsonl"):
                journal.unlink()

    def _write(self, path: Path, text: str) -> str:
        data = text.encode()
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, data, self.scratch)
        return sha256_of_bytes(data)

    # --- frames ---

    def take_stock(self, folder: str) -> dict[int, set[str]]:
        """Return by frame the files of a sequence that exist as they were written.

        Records of lost or damaged files are dropped, so that from then on the journals alone say what is finished.
        """
        intact = {
            frame: self._intact(folder, record) for frame, record in joined_records(self._recorded(folder)).items()
        }
        intact = {frame: record for frame, record in intact.items() if record.files}
        kept = self._work / folder / "journal-kept.jsonl"
        if intact:
            self._write(kept, "".join(record.line() for record in intact.values()))
        for journal in (self._work / folder).glob("journal-*.jsonl"):
            if journal != kept or not intact:
                journal.unlink()
        return {frame: set(record.files) for frame, record in intact.items()}

    def records(self, folder: str) -> dict[int, FrameRecord]:
        """Return the records of a sequence's finished frames by frame, in order."""
        return joined_records(record for path in self._journals(folder) for record in read_records(path))

    def _journals(self, folder: str) -> list[Path]:
        return sorted((self._work / folder).glob("journal-*.jsonl"))

    def _recorded(self, folder: str) -> Iterator[FrameRecord]:
        for path in (self.out / folder / FRAMES, *self._journals(folder)):
            yield from read_records(path)

    def _intact(self, folder: str, record: FrameRecord) -> FrameRecord:
        """Return the record without the files whose hashes are others."""
        files = {
            name: digest for name, digest in record.files.items() if sha256_of_file(self.out / folder / name) == digest
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

    def seal(self) -> None:
        """End a run that has finished everything: remove the working folder."""
        # The identity is removed last, with the lock: until then the run can be resumed.
        with storage_errors(self._work):
            for path in sorted(self._work.iterdir()):
                if path.name not in ("identity.json", "lock"):
                    shutil.rmtree(path)
            shutil.rmtree(self._work)
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


def _remove_sequence(folder: Path, layout: Layout) -> None:
    """Remove the files that a sequence in this layout may have, and the folders inside it that are empty then."""
    for pattern in (*layout.patterns, FRAMES):
        for path in folder.glob(pattern):
            path.unlink()
    for name in layout.setting_files:
        (folder.parent / name).unlink(missing_ok=True)
    inside = {parent for pattern in layout.patterns for parent in PurePosixPath(pattern).parents}
    for name in sorted(inside, key=lambda path: len(path.parts), reverse=True):
        if name.parts:
            with contextlib.suppress(OSError):
                (folder / name).rmdir()


def _cut_torn_line(path: Path) -> None:
    """Remove what a killed process left after the last whole line, so that the next line is not appended to it."""
    with contextlib.suppress(FileNotFoundError):
        data = path.read_bytes()
        if data and not data.endswith(b"\n"):
            with path.open("r+b") as file:
                file.truncate(data.rfind(b"\n") + 1)


def first_difference(there: Any, here: Any, where: str = "") -> str | None:
    """Return the keys of the first difference of two JSON values, with both values as text, or None."""
    if isinstance(there, dict) and isinstance(here, dict):
        parts = [(name, there.get(name), here.get(name)) for name in sorted({*there, *here})]
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        parts = [(str(index), left, right) for index, (left, right) in enumerate(zip(there, here, strict=True))]
    else:
        return None if there == here else f"{where} was {_short(there)}, is {_short(here)}"
    inside = (first_difference(left, right, f"{where}.{name}" if where else name) for name, left, right in parts)
    return next((found for found in inside if found), None)


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
