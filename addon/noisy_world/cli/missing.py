# SPDX-License-Identifier: GPL-3.0-or-later
"""What this Python or this machine lacks, and how to get it."""

from collections.abc import Iterable

from ..core.requirements import missing_packages, missing_sentence
from .entry import Entry
from .system_libraries import advice, missing_libraries


def missing_package(names: Iterable[str], entry: Entry) -> str:
    """Say which packages cannot be had and the command that gets them; nothing where all are there."""
    missing = missing_packages(names)
    return missing_sentence(missing, entry.whose_python, entry.remedy) if missing else ""


def blender_problem() -> str:
    """Import Blender; say which system libraries it lacks, if that is why it cannot be."""
    try:
        import bpy  # noqa: F401 - the first to need it
    except ImportError as error:
        if names := missing_libraries():
            return advice(names)
        return f"bpy cannot be imported: {error}"
    return ""
