# SPDX-License-Identifier: GPL-3.0-or-later
"""Journals: the records of finished frames, a line for each, which a process appends while it works."""

import contextlib
import errno
import os
import threading
from collections import OrderedDict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, cast

from ..batches import batched
from ..regular_files import open_regular, read_bytes, read_text
from .json_text import parse_json
from .records import FrameRecord
from .storage import storage_errors

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
