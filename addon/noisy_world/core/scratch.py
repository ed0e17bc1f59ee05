# SPDX-License-Identifier: GPL-3.0-or-later
"""Scratch folders in memory, each locked by the process that uses it; those of processes that ended are removed.

The lock is the system's own, on the folder: it is released however a process ends, and holds for every process of the
machine, whatever it takes for its number, as in a container. Where there are no such locks, on Windows, nothing is
swept.
"""

import contextlib
import errno
import os
import shutil
import sys
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import StorageError
from .utf8_names import NOT_UTF8, is_utf8

SCRATCH_PREFIX = "noisy-world-scratch-"
SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - a folder of our own is made in it


class ScratchFolder:
    """A folder for files that need not outlive the process."""

    def __init__(self, bytes_needed: int) -> None:
        """Make the folder in memory or, if that is too small, on the disk; remove those that killed processes left.

        Raises StorageError where no folder can be made.
        """
        try:
            disk = _temporary_folder()
            in_memory = SHARED_MEMORY.is_dir() and os.access(SHARED_MEMORY, os.W_OK)
            for folder in {disk, SHARED_MEMORY} if in_memory else {disk}:
                sweep(folder)
            roomy = in_memory and shutil.disk_usage(SHARED_MEMORY).free > 2 * bytes_needed
            self.path, lock = _make(SHARED_MEMORY if roomy else disk)
        except OSError as error:
            problem = f"no folder for scratch files can be made: {error.strerror or error}"
            raise StorageError(f"{problem}; name one with room in the environment variable TMPDIR") from error
        self._remove = weakref.finalize(self, _remove, self.path, lock)

    def remove(self) -> None:
        """Remove the folder with all that is in it."""
        self._remove()


def _temporary_folder() -> Path:
    """Return the system's folder of temporary files. Raises OSError where Blender could not be given its name."""
    folder = Path(tempfile.gettempdir())
    if not is_utf8(folder):
        raise OSError(errno.EILSEQ, f"{folder} {NOT_UTF8}")
    return folder


def sweep(parent: Path) -> None:
    """Remove this user's scratch folders that no living process holds."""
    if sys.platform == "win32":
        return
    for left in parent.glob(f"{SCRATCH_PREFIX}*"):
        with contextlib.suppress(OSError):  # it is gone, held, no folder, or another user's
            descriptor = os.open(left, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                _lock(descriptor, wait=False)
                if os.fstat(descriptor).st_uid == os.geteuid():
                    shutil.rmtree(left, ignore_errors=True)
            finally:
                os.close(descriptor)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Wait until no other process is alone in a folder, and then be it, where there are such locks."""
    descriptor = None if sys.platform == "win32" else os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        if descriptor is not None:
            with contextlib.suppress(OSError):  # the file system has no locks
                _lock(descriptor, wait=True)
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _make(parent: Path) -> tuple[Path, int | None]:
    """Make a folder; return it, and the descriptor that holds its lock, if the file system has such locks."""
    while True:
        path = Path(tempfile.mkdtemp(prefix=SCRATCH_PREFIX, dir=parent))
        if sys.platform == "win32":
            return path, None
        with contextlib.suppress(FileNotFoundError):
            descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
            try:
                _lock(descriptor, wait=True)
            except OSError:  # then no other process can lock it either, and none removes it
                os.close(descriptor)
                return path, None
            # Another process may have swept it between our making it and our locking it; then try again.
            if path.exists() and path.stat().st_ino == os.fstat(descriptor).st_ino:
                return path, descriptor
            os.close(descriptor)


def _lock(descriptor: int, *, wait: bool) -> None:
    """Take the lock of a folder. Raises OSError where another process holds it, unless this one waits."""
    if sys.platform != "win32":
        import fcntl  # noqa: PLC0415 - not on Windows

        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))


def _remove(path: Path, descriptor: int | None) -> None:
    shutil.rmtree(path, ignore_errors=True)
    if descriptor is not None:
        os.close(descriptor)
