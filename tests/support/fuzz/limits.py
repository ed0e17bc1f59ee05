# SPDX-License-Identifier: GPL-3.0-or-later
"""What reading an input may take and touch: seconds of the processor, memory, and its own folder alone."""

import contextlib
import os
import sys
import time
from pathlib import Path

PROCESSOR_S = 10.0
MEMORY_BYTES = 2**30

_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
# Audit events of Python that change a file, with the places of the paths among their arguments.
_CHANGES = {
    "os.remove": (0,), "os.rename": (0, 1), "os.link": (1,), "os.symlink": (1,), "os.mkdir": (0,), "os.rmdir": (0,),
    "os.truncate": (0,), "os.chmod": (0,), "os.chown": (0,), "os.utime": (0,), "os.setxattr": (0,),
}  # fmt: skip
# What multiprocessing and others open everywhere; folders of dead processes are swept away.
_SHARED = ("/dev/null", "/dev/shm/sem.", "/dev/shm/noisy-world-scratch-")


class _Watch:
    """Notes what is changed outside of a folder while it watches. Audit hooks stay, so there is one."""

    def __init__(self):
        self.folder = None
        self.own = []
        self.outside = []
        sys.addaudithook(self._hear)

    def _hear(self, event, arguments):
        if self.folder is None:
            return
        if event == "open":
            path, _, flags = arguments
            if isinstance(path, (str, bytes, os.PathLike)) and isinstance(flags, int) and flags & _WRITES:
                self._check(event, path)
        elif event in ("tempfile.mkdtemp", "tempfile.mkstemp"):
            self.own.append(os.path.realpath(os.fsdecode(arguments[0])))
        elif event in _CHANGES:
            for place in _CHANGES[event]:
                if isinstance(arguments[place], (str, bytes, os.PathLike)):
                    self._check(event, arguments[place])

    def _check(self, event, path):
        given = Path(os.fsdecode(path))
        if not given.is_absolute() and event != "open":  # relative to the descriptor of a folder: rmtree's
            return
        place = os.path.realpath(given.parent) + os.sep + given.name
        inside = any(place == each or place.startswith(each + os.sep) for each in (self.folder, *self.own))
        if not inside and not place.startswith(_SHARED) and not place.endswith(".pyc") and "__pycache__" not in place:
            self.outside.append(f"{event} {place[:200]}")


_WATCHES = []


@contextlib.contextmanager
def watched(folder):
    """Note what is changed outside of a folder, except in the temporary folders that are made meanwhile."""
    if not _WATCHES:
        _WATCHES.append(_Watch())
    watch = _WATCHES[0]
    watch.own, watch.outside = [], []
    watch.folder = os.path.realpath(folder)
    try:
        yield watch.outside
    finally:
        watch.folder = None


class Meter:
    """Measures the seconds of the processor and the memory of what is done after it is made."""

    def __init__(self):
        self._began_s = time.process_time()
        _forget_peak()
        self._before = _status("VmRSS")

    def told(self):
        """Return what was taken beyond the limits, in words, or ""."""
        taken_s = time.process_time() - self._began_s
        if taken_s > PROCESSOR_S:
            return f"slow: {taken_s:.0f} s of the processor"
        taken = _status("VmHWM") - self._before
        return f"memory: {taken / 2**20:.0f} MiB" if taken > MEMORY_BYTES else ""


def _forget_peak():
    """Let the peak of this process's memory be what it has now, on Linux."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _status(name):
    """Return a number of this process's status, in bytes; 0 where the system has none."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith(name)), 0)
