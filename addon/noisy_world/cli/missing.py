# SPDX-License-Identifier: GPL-3.0-or-later
"""Finding what this Python or this machine lacks, and how to get it."""

from collections.abc import Iterable

from ..core.requirements import missing_packages, missing_sentence
from .entry import Entry
from .system_libraries import advice, missing_libraries


def missing_package(names: Iterable[str], entry: Entry) -> str:
    """Return which packages are missing and the command that installs them; "" where none is."""
    missing = missing_packages(names)
    return missing_sentence(missing, entry.whose_python, entry.remedy) if missing else ""


def blender_problem() -> str:
    """Import Blender; if that fails, return the problem, with the missing system libraries if they are the cause."""
    try:
        import bpy  # noqa: F401 - imported only to see whether it can be
    except ImportError as error:
        if names := missing_libraries():
            return advice(names)
        return f"bpy cannot be imported: {error}"
    return ""
