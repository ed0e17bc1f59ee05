# SPDX-License-Identifier: GPL-3.0-or-later
"""Hashing files, one by one or many ahead in several threads: reading and hashing free Python's lock."""

import hashlib
import os
import stat
import threading
from collections.abc import Generator, Iterable
from concurrent.futures import Future
from contextlib import closing
from pathlib import Path

from ..batches import batched
from ..machine import available_threads
from ..regular_files import open_regular
from ..working_ahead import done_ahead

BATCH = 32  # files that a thread takes at once: handing over a file by itself costs as much as hashing 50 kB of it
AHEAD = 2  # batches for each thread that are hashed ahead; only their digests are in memory
CHUNK_BYTES = 2**23  # read at once; most images are smaller


class Hasher:
    """Hashes files; one that has several names is read once. Threads may share it."""

    def __init__(self, *, links: bool = True) -> None:
        """Begin with none. links: whether a link counts as the file that it leads to, or has no hash."""
        self._stat = os.stat if links else os.lstat
        self._lock = threading.Lock()
        self._known: dict[tuple[int, int], Future[str | None]] = {}  # by device and number of the file

    def sha256(self, path: str | Path) -> str | None:
        """Return the SHA-256 of a file; None where there is none, where it is something else or cannot be read."""
        try:
            found = self._stat(path)
            if not stat.S_ISREG(found.st_mode):
                return None
            return read_sha256(path) if found.st_nlink == 1 else self._of_linked((found.st_dev, found.st_ino), path)
        except OSError:
            return None

    def _of_linked(self, number: tuple[int, int], path: str | Path) -> str | None:
        """Return the SHA-256 of a file that has other names, one of which another thread may be reading."""
        with self._lock:
            mine = Future[str | None]()
            there = self._known.setdefault(number, mine)
        if there is mine:
            try:
                mine.set_result(read_sha256(path))
            except OSError:
                mine.set_result(None)
        return there.result()

    def ahead(self, paths: Iterable[str], threads: int = 0) -> Generator[str | None]:
        """Yield the SHA-256 of files, in their order, as `sha256` does; they are hashed ahead in threads.

        threads: 0 for as many as the process may run. At most AHEAD * BATCH * threads files are read before their
        digests are asked for.
        """

        def digests_of(batch: Iterable[str]) -> list[str | None]:
            return [self.sha256(path) for path in batch]

        count = threads or available_threads()
        batches = batched(paths, BATCH)
        with closing(done_ahead(digests_of, batches, threads=count, ahead=AHEAD * count, name="hasher")) as hashed:
            for _, digests in hashed:
                yield from digests


def read_sha256(path: str | Path) -> str:
    """Return the SHA-256 of a file. Raises OSError."""
    digest = hashlib.sha256()
    with open_regular(path, buffering=0) as file:
        while data := file.read(CHUNK_BYTES):
            digest.update(data)
    return digest.hexdigest()
