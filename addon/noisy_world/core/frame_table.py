# SPDX-License-Identifier: GPL-3.0-or-later
"""The records of finished frames: the lines of a sequence's journals during a run, and of its frames.jsonl after it."""

import contextlib
import errno
import json
import os
import threading
from collections import OrderedDict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, cast

from .atomic_files import storage_errors
from .depth_range import OutOfRange
from .file_access import open_regular, open_text, read_bytes, read_text
from .json_text import finite_number, parse_json
from .machine import batched

LARGEST_S = 1e15  # far beyond any time stamp; a whole number of JSON may be too large for a float
FRAMES = "frames.jsonl"
COMPLETED = "depth_completed"  # the key in what was done to a frame
OUT_OF_RANGE = "depth_out_of_range"  # the key in a record, and in the manifest
_LINES = json.JSONEncoder(separators=(", ", ": "))  # one for all lines: json.dumps makes one for each


@dataclass(frozen=True)
class FrameRecord:
    """The finished part of a frame: its number, its time stamp, and the SHA-256 of each file by name in the sequence.

    perturbed: what was done to it: for colour and depth a list of steps with name, stream, severity and parameters; for
    pairing and motion what the frame shows. out_of_range: the depth that its image cannot hold, None if it holds all.
    depth_time_s: the time stamp of its depth, where it is another.
    """

    frame: int
    time_s: float
    files: dict[str, str]
    perturbed: dict[str, Any] = field(default_factory=dict)
    out_of_range: OutOfRange | None = None
    depth_time_s: float | None = None

    def content(self) -> dict[str, Any]:
        """The record as plain JSON values."""
        record: dict[str, Any] = {"frame": self.frame, "time_s": self.time_s}
        if self.depth_time_s is not None:
            record["depth_time_s"] = self.depth_time_s
        record["sha256"] = self.files
        if self.out_of_range is not None:
            record[OUT_OF_RANGE] = self.out_of_range.content()
        if self.perturbed:
            record["perturbed"] = self.perturbed
        return record

    def line(self) -> str:
        """The record as a line of JSON."""
        return _LINES.encode(self.content()) + "\n"

    def with_motion(self, motion: dict[str, Any]) -> "FrameRecord":
        """Return the record with what motion did to the frame."""
        perturbed = {**self.perturbed, "motion": motion}
        return replace(self, perturbed={name: perturbed[name] for name in sorted(perturbed)})

    def joined(self, other: "FrameRecord") -> "FrameRecord":
        """Return both records as one: colour and depth of a frame may be finished at different times."""
        files = {**self.files, **other.files}
        perturbed = {**self.perturbed, **other.perturbed}
        return FrameRecord(
            self.frame,
            self.time_s,
            {name: files[name] for name in sorted(files, reverse=True)},
            {name: perturbed[name] for name in sorted(perturbed)},
            other.out_of_range or self.out_of_range,
            self.depth_time_s,
        )


def read_records(path: Path) -> Iterator[FrameRecord]:
    """Yield the records of a journal or a frames.jsonl, without torn lines; none where there is no such file.

    Of a file that cannot be read on, the lines before that count.
    """
    if not path.is_file():
        return
    with contextlib.suppress(OSError), open_text(path, errors="replace") as file:
        for line in file:
            if record := read_record(line):
                yield record


def read_record(line: str) -> FrameRecord | None:
    """Read a line of a journal; None for a torn line and for what no run wrote."""
    try:
        return record_of(parse_json(line))
    except ValueError:
        return None


def record_of(record: Any) -> FrameRecord | None:
    """Return the record of plain JSON values; None for what no run wrote."""
    try:
        lost = OutOfRange.of_content(record[OUT_OF_RANGE]) if OUT_OF_RANGE in record else None
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        return None
    match record:
        case {"frame": int(frame), "time_s": int() | float() as time_s, "sha256": dict(files)}:
            done = record.get("perturbed", {})
            depth_time_s = finite_number(record.get("depth_time_s"))
        case _:
            return None
    valid = isinstance(done, dict) and all(isinstance(digest, str) for digest in files.values())
    if not valid or isinstance(frame, bool) or isinstance(time_s, bool) or abs(time_s) > LARGEST_S:
        return None
    return FrameRecord(frame, float(time_s), files, done, lost, depth_time_s)


def joined_records(records: Iterable[FrameRecord]) -> dict[int, FrameRecord]:
    """Return one record for each frame, by frame, in order."""
    found: dict[int, FrameRecord] = {}
    for record in records:
        there = found.get(record.frame)
        found[record.frame] = there.joined(record) if there else record
    return {frame: found[frame] for frame in sorted(found)}


# Journals: the records of finished frames, a line for each, which a process appends while it works.


AT_ONCE = 500  # records that are written together, when many are there: some 200 kB
MOST_OPEN = 100  # journals at once; chosen: of the 256 files that a process may have open on some systems


class Journal:
    """The lines of finished frames, appended one by one.

    Of all journals of a process the MOST_OPEN last used are open: a scene may have more settings than a process may
    have open files.
    """

    _open: ClassVar[OrderedDict["Journal", BinaryIO]] = OrderedDict()
    _lock: ClassVar[threading.Lock] = threading.Lock()

    def __init__(self, path: Path) -> None:
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            _cut_torn_line(path)
            path.open("ab", buffering=0).close()
        self._path = path

    def append(self, record: FrameRecord) -> None:
        """Add a frame whose files are written."""
        self.append_line(record.line())

    def append_all(self, records: Iterable[FrameRecord]) -> None:
        """Add frames whose files are written, some hundred lines at once."""
        for lines in batched(records, AT_ONCE):
            self.append_line("".join(record.line() for record in lines))

    def append_line(self, text: str) -> None:
        """Add a line, or several, each of which ends with a line feed."""
        line = text.encode()
        with storage_errors(self._path), self._lock:  # another thread's journal may take this one's place
            if self._opened().write(line) != len(line):  # a full disk takes a part of an unbuffered write
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _opened(self) -> BinaryIO:
        if self not in self._open:
            if len(self._open) >= MOST_OPEN:
                self._open.popitem(last=False)[1].close()
            self._open[self] = cast("BinaryIO", self._path.open("ab", buffering=0))
        self._open.move_to_end(self)
        return self._open[self]

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            if (file := self._open.pop(self, None)) is not None:
                file.close()


def _cut_torn_line(path: Path) -> None:
    """Remove what a killed process left after the last whole line, so that the next line is not appended to it."""
    with contextlib.suppress(FileNotFoundError):
        with open_regular(path, buffering=0) as file:
            if not file.seek(0, os.SEEK_END) or _last_byte(file) == b"\n":
                return  # nearly always: what a journal of megabytes says is not read each time it is opened
        data = read_bytes(path, largest_bytes=None)
        with path.open("r+b") as torn:
            torn.truncate(data.rfind(b"\n") + 1)


def _last_byte(file: BinaryIO) -> bytes:
    file.seek(-1, os.SEEK_END)
    return file.read(1)


def append_line(path: Path, text: str) -> None:
    """Append a line to a file of lines. Raises StorageError."""
    journal = Journal(path)
    try:
        journal.append_line(text)
    finally:
        journal.close()


def read_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the mappings in a file of JSON lines, without torn lines; none where there is no such file."""
    with contextlib.suppress(FileNotFoundError):
        for line in read_text(path, errors="replace").splitlines():
            with contextlib.suppress(ValueError):
                if isinstance(value := parse_json(line), dict):
                    yield value
