# SPDX-License-Identifier: GPL-3.0-or-later
"""Locks between the processes that share the tests."""

import sys
from contextlib import contextmanager


@contextmanager
def locked(path):
    """Hold the lock of a file; whoever else wants it waits."""
    with path.open("w") as file:
        if sys.platform != "win32":
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        yield
