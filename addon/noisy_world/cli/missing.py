# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks for packages and libraries that this Python or machine lacks, and says how to install them."""

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from ..core.extras import blender_missing
from ..core.opencv import old_opencv
from ..core.requirements import missing_packages, missing_sentence
from .entry import Entry
from .system_libraries import advice, missing_libraries

# What Blender warns of on standard output when it is imported, which is of use only to its windows: that /etc/mtab is
# missing, from which its file browser lists the disks, and that the locale that LANG names is not installed.
OF_NO_USE_HERE = (b"Could not get a list of mounted file-systems", b"Falling back to standard locale")


def missing_package(names: Iterable[str], entry: Entry) -> str:
    """Return which packages are missing or too old and the command that installs them; "" where none is."""
    names = list(names)
    missing = missing_packages(names)
    if missing:
        return missing_sentence(missing, entry.whose_python, entry.remedy)
    return old_opencv() if "cv2" in names else ""


def blender_problem(entry: Entry) -> str:
    """Import Blender; if that fails, return the problem and, of a missing package or system library, what to do."""
    if problem := blender_missing(remedy=entry.blender_remedy):
        return problem
    try:
        with _relevant_output():
            import bpy  # noqa: F401 - imported only to see whether it can be
    except ImportError as error:
        if names := missing_libraries():
            return advice(names)
        return f"bpy cannot be imported: {error}"
    return ""


def blender_lacks(entry: Entry) -> str:
    """Return what is missing for Blender to be imported, without importing it: its package, or system libraries."""
    if problem := blender_missing(remedy=entry.blender_remedy):
        return problem
    names = missing_libraries()
    return advice(names) if names else ""


@contextmanager
def _relevant_output() -> Iterator[None]:
    """Hold back what is printed to standard output, by C code too, and then print it without what is OF_NO_USE_HERE."""
    if sys.platform != "linux":
        yield
        return
    sys.stdout.flush()
    kept = os.dup(1)
    with os.fdopen(os.memfd_create("standard output"), "w+b") as held:
        os.dup2(held.fileno(), 1)
        try:
            yield
        finally:
            sys.stdout.flush()
            os.dup2(kept, 1)
            os.close(kept)
            held.seek(0)
            os.write(1, b"".join(line for line in held if not any(text in line for text in OF_NO_USE_HERE)))
