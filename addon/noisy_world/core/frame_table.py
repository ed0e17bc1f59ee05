# SPDX-License-Identifier: GPL-3.0-or-later
"""The records of finished frames: the lines of a sequence's journals during a run, and of its frames.jsonl after it."""

import contextlib
import errno
import json
import os
import re
import threading
from array import array
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

from .atomic_files import link_on_the_way, storage_errors, write_atomic
from .depth_range import OutOfRange
from .errors import InputError
from .file_access import finite_number, open_regular, open_text, parse_json, parse_json_file, read_bytes, read_text
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
        yield from records_in(file)


def records_in(lines: Iterable[str]) -> Iterator[FrameRecord]:
    """Yield the records of lines, without torn ones."""
    yield from filter(None, map(read_record, lines))


# A line as it is written, up to its files. A dataset may have millions, and to read one as JSON takes ten times longer.
_LINE = re.compile(
    r'\{(?:"sequence": "[^"]+", )?"frame": (\d{1,9}), "time_s": [^{"]+(?:"depth_time_s": [^{"]+)?'
    r'"sha256": \{([^{}\\]*)\}[,}]'
)
_FILE = re.compile(r'"([^"]+)": "([0-9a-f]{64})"')


def files_in(lines: Iterable[str]) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the frame and the files of each record of lines, without torn ones."""
    for line in lines:
        if (found := _LINE.match(line)) and line.endswith("}\n"):
            yield int(found[1]), dict(_FILE.findall(found[2]))
        elif record := read_record(line):
            yield record.frame, record.files


def given_lines(path: Path, remedy: str) -> Iterator[tuple[str, Any]]:
    """Yield the lines of a frames.jsonl beside a recording, which a user may have changed, as JSON values.

    Each comes with its place for messages. Raises InputError where the file cannot be read, or a line is no JSON.
    """
    try:
        lines = read_text(path, encoding="utf-8-sig").split("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"cannot be read: {error}") from error
    for number, line in enumerate(lines, 1):
        if line.strip():
            where = f"line {number}"
            yield where, parse_json_file(line, path, where=where, remedy=remedy)


class FrameLines:
    """The frames.jsonl of a finished sequence; a line is read when it is asked for: parsed, thousands take megabytes.

    frames: their numbers, in order.
    """

    def __init__(self, path: Path) -> None:
        """Find the lines. Raises OSError."""
        self.path = path
        found: list[tuple[int, int]] = []
        at = 0
        for line in read_bytes(path, largest_bytes=None).splitlines(keepends=True):
            if match := _BEGIN.match(line):
                found.append((int(match[1]), at))
            at += len(line)
        found.sort()
        self.frames = array("q", (frame for frame, _ in found))
        self._at = array("q", (at for _, at in found))

    def record(self, place: int, remedy: str) -> FrameRecord:
        """Return the record of the frame at a place in order. Raises InputError where its line is damaged."""
        with open_regular(self.path) as file:
            file.seek(self._at[place])
            record = read_record(file.readline().decode(errors="replace"))
        if record is None:
            raise InputError(self.path, "its line is damaged", where=f"frame {self.frames[place]}", remedy=remedy)
        return record


_BEGIN = re.compile(rb'\{"frame": ([0-9]{1,18}), "time_s": ')


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
#
# A process has one for each scene, `journal-NAME.SCENE.jsonl` in the working folder of a dataset; a line begins with
# the sequence that it is of. Earlier versions had one for each sequence, `SETTING/SCENE/journal-NAME.jsonl`, which is
# read.


JOURNALS = "journal-*.jsonl"
KEPT = "kept"  # the name of the journal of what was left of others
AT_ONCE = 500  # records that are written together, when many are there: some 200 kB
SEQUENCE = re.compile("[A-Za-z0-9][A-Za-z0-9._-]*/[A-Za-z0-9][A-Za-z0-9._-]*")
"""The folder of a sequence: two plain names, which lead nowhere else."""
_OF = re.compile(rb'\{"sequence": "([^"\\]+)"(, "instead": true\})?')


def journal_path(work: Path, name: str, scene: str) -> Path:
    """Return the journal of a process for a scene. name: the process's, without dots."""
    return work / f"journal-{name}.{scene}.jsonl"


def journal_line(sequence: str, record: FrameRecord) -> str:
    """Return the line of a record in a journal."""
    return f'{{"sequence": "{sequence}", {record.line()[1:]}'


class Journal:
    """A file of lines, appended one by one. Threads may share it."""

    def __init__(self, path: Path) -> None:
        """Open it. Raises StorageError."""
        self._path = path
        self._lock = threading.Lock()
        with storage_errors(path):
            try:
                _cut_torn_line(path)
                self._file = path.open("ab", buffering=0)
            except FileNotFoundError:
                path.parent.mkdir(parents=True, exist_ok=True)
                self._file = path.open("ab", buffering=0)

    def append_all(self, records: Iterable[tuple[str, FrameRecord]]) -> None:
        """Add frames whose files are written, with their sequences, some hundred lines at once."""
        for lines in batched(records, AT_ONCE):
            self.append_line("".join(journal_line(*line) for line in lines))

    def append_line(self, text: str) -> None:
        """Add a line, or several, each of which ends with a line feed. Raises StorageError."""
        line = text.encode()
        with storage_errors(self._path), self._lock:
            if self._file.write(line) != len(line):  # a full disk takes a part of an unbuffered write
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _cut_torn_line(path: Path) -> None:
    """Remove what a killed process left after the last whole line, so that the next line is not appended to it."""
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


# --- all journals of a working folder ---


def has_journal(work: Path, only: Collection[str] | None = None) -> bool:
    """Tell whether a run has begun to record frames. only: of the scenes of these sequences, if not of all."""
    scenes = None if only is None else {folder.split("/")[-1] for folder in only}
    return any(size for path, size in _journal_files(work) if scenes is None or _scene_of(path) in scenes)


def _journal_files(work: Path) -> list[tuple[Path, int]]:
    """Return the journals, in order, with their sizes in bytes; what a link stands for is none."""
    found: list[tuple[Path, int]] = []
    for path in sorted((*work.glob(JOURNALS), *work.glob(f"*/*/{JOURNALS}"))):
        if not path.is_symlink() and link_on_the_way(work, path.parent) is None and path.is_file():
            with contextlib.suppress(FileNotFoundError):  # a run has just ended
                found.append((path, path.stat().st_size))
    return found


def _scene_of(path: Path) -> str:
    name = path.name.removeprefix("journal-").removesuffix(".jsonl")
    return name.partition(".")[2] or path.parent.name


@dataclass
class _Lines:
    """Where the lines of a sequence are in one journal: offsets and lengths in bytes."""

    at: "array[int]" = field(default_factory=lambda: array("q"))
    length: "array[int]" = field(default_factory=lambda: array("i"))


class Journals:
    """What the journals of a working folder say, by sequence. Memory holds where lines are: 12 bytes each."""

    def __init__(self, work: Path) -> None:
        self._work = work
        self._read_to: dict[Path, int] = {}
        self._lines: dict[str, dict[Path, _Lines]] = {}
        self._instead: set[str] = set()

    def read_on(self) -> None:
        """Find the lines that were written since the last time."""
        there = dict(_journal_files(self._work))
        if any(there.get(path, -1) < size for path, size in self._read_to.items()):
            self.forget_lines()
        for path, size in there.items():
            if size > self._read_to.get(path, 0):
                self._read(path)

    def forget_lines(self) -> None:
        """Begin anew: journals were written again."""
        self._read_to, self._lines, self._instead = {}, {}, set()

    def _read(self, path: Path) -> None:
        at = self._read_to.get(path, 0)
        own = f"{path.parent.parent.name}/{path.parent.name}" if path.parent != self._work else ""
        with contextlib.suppress(OSError), open_regular(path) as file:
            file.seek(at)
            for line in file:
                if not line.endswith(b"\n"):
                    break
                found = _OF.match(line)
                sequence = found[1].decode(errors="replace") if found else own
                if found and found[2]:
                    self._instead.add(sequence)
                elif sequence in self._lines or SEQUENCE.fullmatch(sequence):
                    lines = self._lines.setdefault(sequence, {}).setdefault(path, _Lines())
                    lines.at.append(at)
                    lines.length.append(len(line))
                at += len(line)
        self._read_to[path] = at

    @property
    def sequences(self) -> frozenset[str]:
        """The sequences of which they record a frame."""
        return frozenset(self._lines)

    @property
    def files(self) -> tuple[Path, ...]:
        """The journals that were read."""
        return tuple(self._read_to)

    def instead(self, sequence: str) -> bool:
        """Tell whether they say all of a sequence, so that its frames.jsonl counts no more."""
        return sequence in self._instead

    def lines(self, sequence: str) -> Iterator[tuple[Path, list[str]]]:
        """Yield the journals that have lines of a sequence, each with these."""
        for path, lines in list(self._lines.get(sequence, {}).items()):
            with contextlib.suppress(FileNotFoundError):
                yield path, list(_texts(path, lines))

    def records(self, sequence: str) -> Iterator[FrameRecord]:
        """Yield the records of a sequence; a frame may have several."""
        for _, lines in self.lines(sequence):
            yield from records_in(lines)

    def rewrite(self, changed: Mapping[str, Iterable[FrameRecord] | None], scratch: Path) -> None:
        """Write the journals of some scenes again.

        changed: by sequence, the records that are left of it, which count instead of its frames.jsonl too; None to
        forget it. scratch: see `write_atomic`. Raises StorageError.
        """
        known: dict[str, list[str]] = {}
        for sequence in sorted({*self._lines, *self._instead, *changed}):
            known.setdefault(sequence.split("/")[1], []).append(sequence)
        for scene in sorted({sequence.split("/")[1] for sequence in changed}):
            text = "".join(line for sequence in known[scene] for line in self._left(sequence, changed))
            kept = journal_path(self._work, KEPT, scene)
            if text:
                write_atomic(kept, text.encode(), scratch)
            for path in [path for path in self._read_to if _scene_of(path) == scene]:
                if path != kept or not text:
                    remove_journal(self._work, path)
        self.forget_lines()
        self.read_on()

    def _left(self, sequence: str, changed: Mapping[str, Iterable[FrameRecord] | None]) -> Iterator[str]:
        """Yield the lines of a sequence that are left."""
        records = changed.get(sequence, self.records(sequence))
        if records is not None:
            if sequence in changed or self.instead(sequence):
                yield f'{{"sequence": "{sequence}", "instead": true}}\n'
            yield from (journal_line(sequence, record) for record in records)


def remove_journal(work: Path, path: Path) -> None:
    """Remove a journal, and the folders that are empty then. Raises StorageError."""
    with storage_errors(path):
        path.unlink(missing_ok=True)
    for empty in (path.parent, path.parent.parent) if path.parent != work else ():
        with contextlib.suppress(OSError):
            empty.rmdir()


def remove_journals(work: Path) -> None:
    """Remove all journals of a working folder. Raises StorageError."""
    for path, _ in _journal_files(work):
        remove_journal(work, path)


def _texts(path: Path, lines: _Lines) -> Iterator[str]:
    with open_regular(path) as file:
        end = -1
        for at, length in zip(lines.at, lines.length, strict=True):
            if at != end:
                file.seek(at)
            yield file.read(length).decode(errors="replace")
            end = at + length
