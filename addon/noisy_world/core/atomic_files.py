# SPDX-License-Identifier: GPL-3.0-or-later
"""Atomic files, which are written completely or not at all, and a lock that is released even by a killed process."""

import contextlib
import errno
import hashlib
import itertools
import os
import platform
import re
import stat
import sys
import tempfile
import threading
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Future
from contextlib import closing
from pathlib import Path

from .errors import Action, BusyError, Message, StorageError, either
from .file_access import open_regular, read_bytes
from .machine import available_threads, batched, done_ahead

# Hashing files, one by one or many ahead in several threads: reading and hashing free Python's lock.


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


_UNFINISHED = itertools.count()
ELSEWHERE = "mend that, or name another place"
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


@contextlib.contextmanager
def storage_errors(path: Path, remedy: str = "") -> Iterator[None]:
    """Turn an operating system's refusal to write into one line that names the file and the remedy.

    remedy: what to do, where the file is not of a dataset in the folder that --out names.
    """
    try:
        yield
    except OSError as error:
        if error.errno in FULL:
            problem = f"no space left to write it ({error.strerror})"
            again = Message("make room there and ", Action.RUN_AGAIN, ": finished frames are kept")
            raise StorageError(problem, file=path, remedy=remedy or again) from error
        problem = f"cannot be written: {error.strerror or error}"
        other = either("mend that", Action.OTHER_FOLDER)
        raise StorageError(problem, file=path, remedy=remedy or other) from error


def write_atomic(path: Path, data: bytes, scratch: Path) -> None:
    """Write a file atomically: under its name is either the whole new content or what was there before.

    scratch: a folder on the same file system for the unfinished file. A power cut can still lose what the system had
    not yet written to the disk; the hashes, which are checked when a run is resumed, reveal that.

    Raises StorageError; the unfinished file is removed.
    """
    unfinished = unfinished_name(scratch, path)
    with storage_errors(path):
        try:
            unfinished.write_bytes(data)
            unfinished.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)
            raise


@contextlib.contextmanager
def made_beside(out: Path) -> Iterator[Path]:
    """Yield where to make a file or folder, which is moved to `out` when it is whole; what is left else is removed.

    Folders above it are made. Raises StorageError where it cannot be written.
    """
    parent = out.absolute().parent
    with storage_errors(out, ELSEWHERE):
        parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=parent, prefix=".unfinished-") as folder:
            made = Path(folder) / out.name
            yield made
            made.replace(out)


def own_scratch(folder: Path) -> Path:
    """Return a folder for this process's unfinished files: others, on other machines too, write beside it."""
    own = folder / "unfinished" / f"{platform.node()}-{os.getpid()}"
    with storage_errors(own):
        own.mkdir(parents=True, exist_ok=True)
    return own


def link_or_copy(source: Path, target: Path, scratch: Path) -> None:
    """Give a finished file a second name, atomically; where the file system has no hard links, copy it."""
    unfinished = unfinished_name(scratch, target)
    with storage_errors(target):
        try:
            unfinished.hardlink_to(source)
        except OSError as error:
            if error.errno in FULL:
                raise
            write_atomic(target, read_bytes(source), scratch)
            return
        unfinished.replace(target)
        # Renaming one name of a file to another name of the same file does nothing, so both would stay.
        unfinished.unlink(missing_ok=True)


class Mover:
    """Moves finished files from one folder to another; names of one file stay names of one file."""

    def __init__(self, scratch: Path) -> None:
        """Take a folder for unfinished files on the file system that files are moved to."""
        self._scratch = scratch
        self._copied: dict[tuple[int, int], Path] = {}  # by device and number of the file: only across file systems

    def move(self, source: Path, target: Path) -> None:
        """Move a file, atomically: under its new name it is whole. Raises StorageError."""
        with storage_errors(target):
            linked = source.lstat().st_nlink > 1
            try:
                source.replace(target)
            except OSError as error:
                if error.errno != errno.EXDEV:
                    raise
                self._copy(source, target)
                linked = True
            if linked:  # renaming one name of a file to another name of the same file does nothing: both would stay
                source.unlink(missing_ok=True)

    def _copy(self, source: Path, target: Path) -> None:
        found = source.stat()
        number = found.st_dev, found.st_ino
        if number in self._copied:
            link_or_copy(self._copied[number], target, self._scratch)
            return
        write_atomic(target, read_bytes(source), self._scratch)
        if found.st_nlink > 1:
            self._copied[number] = target


UNFINISHED = re.compile(r"[0-9]+-[0-9]+-.+")
"""What the names of unfinished files are like."""


def unfinished_name(scratch: Path, path: Path) -> Path:
    """Return a unique name in the scratch folder: threads write files of equal names for different folders."""
    return scratch / f"{os.getpid()}-{next(_UNFINISHED)}-{path.name}"


def sha256_of_bytes(data: bytes) -> str:
    """Return the SHA-256 of the bytes, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def sha256_of_file(path: Path) -> str | None:
    """Return the SHA-256 of a file, in hexadecimal; None where there is no such file."""
    try:
        return read_sha256(path)
    except FileNotFoundError:
        return None


def sha256_of_regular_file(path: Path) -> str | None:
    """Return the SHA-256 of a file; None where there is no such file, where it is something else or cannot be read."""
    try:
        return sha256_of_file(path) if path.is_file() else None
    except OSError:
        return None


def link_on_the_way(root: Path, folder: Path) -> Path | None:
    """Return the first of the folders from `root`, exclusive, to `folder` that is a link; None where none is."""
    inside = [folder, *folder.parents][: len(folder.parts) - len(root.parts)]
    return next((path for path in reversed(inside) if path.is_symlink()), None)


class FolderLock:
    """Keeps a second run out of a dataset. The system releases the lock however the process ends."""

    def __init__(self, path: Path) -> None:
        """Take the lock or raise StorageError at once."""
        self._path = path
        while True:
            with storage_errors(path):
                path.parent.mkdir(parents=True, exist_ok=True)
                self._file = path.open("a+b")
            if not _try_lock(self._file.fileno()):
                self._file.close()
                raise BusyError(
                    "another run is writing here", file=path.parent.parent, remedy="wait for it, or stop it"
                )
            # An earlier run may have removed the file between our opening and our locking it; then try again.
            with contextlib.suppress(FileNotFoundError):
                if path.stat().st_ino == os.fstat(self._file.fileno()).st_ino:
                    return
            self._file.close()

    def release(self) -> None:
        """Release the lock; the file itself stays until its folder is removed."""
        self._file.close()


def _try_lock(descriptor: int) -> bool:
    try:
        if sys.platform == "win32":
            import msvcrt  # on Windows only

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl  # not on Windows

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
            return False
        raise
    return True
