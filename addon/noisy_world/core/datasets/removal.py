# SPDX-License-Identifier: GPL-3.0-or-later
"""Removing a dataset's files from a folder, and no others."""

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from .dataset_state import IDENTITY, JOURNALS, MANIFEST, MERGED, OVERVIEW, RUN
from .layouts import LAYOUTS, Layout
from .records import FRAMES
from .storage import UNFINISHED, link_on_the_way, storage_errors


def remove_dataset(out: Path, work: Path, sequences: Iterable[str]) -> None:
    """Remove the sequences, the dataset's own files and the journals of a folder. Raises StorageError."""
    with storage_errors(out):
        named = sorted(sequences)
        for folder in named:
            _remove_sequence(out, out / folder)
        for setting in sorted({folder.split("/")[0] for folder in named}):
            _remove_setting(out, out / setting)
        for name in (MANIFEST, RUN, OVERVIEW):
            (out / name).unlink(missing_ok=True)
        for journal in work.glob(f"*/*/{JOURNALS}"):
            if not link_on_the_way(out, journal.parent):
                journal.unlink()


def _remove_sequence(out: Path, folder: Path) -> None:
    """Remove the files that a sequence in any layout may have, and then its folders that are empty.

    The dataset in the folder may have another layout than this run's. A link that stands for a folder is not followed.
    What is there is listed once: a shard that is merged has empty folders alone, and there are many.
    """
    if link_on_the_way(out, folder):
        return
    there = list(os.walk(folder, topdown=False))
    if any(files for _, _, files in there):
        patterns = dict.fromkeys(pattern for layout in LAYOUTS.values() for pattern in layout.all_patterns)
        for path in [path for pattern in (*patterns, FRAMES) for path in folder.glob(pattern)]:
            if not link_on_the_way(out, path.parent):
                path.unlink(missing_ok=True)
    ours = {str(folder / inside) for layout in LAYOUTS.values() for inside in _folders_of(layout)}
    for place, _, _ in there:
        if place in ours:
            with contextlib.suppress(OSError):
                Path(place).rmdir()


def _folders_of(layout: Layout) -> set[str]:
    """Return the folders of a sequence in a layout, from its own on."""
    return {str(parent) for pattern in layout.all_patterns for parent in PurePosixPath(pattern).parents}


def _remove_setting(out: Path, folder: Path) -> None:
    """Remove the files of a setting, and its folder where it is empty then."""
    for name in {name for layout in LAYOUTS.values() for name in layout.setting_files}:
        if not link_on_the_way(out, folder):
            (folder / name).unlink(missing_ok=True)
    with contextlib.suppress(OSError):
        folder.rmdir()


def empty_scratch(scratch: Path) -> None:
    """Leave a folder for unfinished files without those of earlier runs. Raises StorageError."""
    with storage_errors(scratch):
        if scratch.is_symlink() or scratch.is_file():
            scratch.unlink()
        remove_unfinished(scratch)
        scratch.mkdir(parents=True, exist_ok=True)


def remove_unfinished(scratch: Path) -> None:
    """Remove the unfinished files of runs that ended, and the folder where nothing else is in it."""
    for path in scratch.glob("*-*-*"):
        if UNFINISHED.fullmatch(path.name) and (path.is_symlink() or path.is_file()):
            path.unlink(missing_ok=True)
    with contextlib.suppress(OSError):
        scratch.rmdir()


def remove_journals(work: Path, folder: str) -> None:
    """Remove the journals of a sequence, and the folders that are empty then. Raises StorageError."""
    place = work / folder
    with storage_errors(place):
        for journal in place.glob(JOURNALS) if not link_on_the_way(work, place) else ():
            journal.unlink()
    for empty in (place, place.parent):
        with contextlib.suppress(OSError):
            empty.rmdir()


def remove_work_folder(work: Path, scratch: Path) -> None:
    """Remove a working folder without journals; what is not ours stays in it. Raises StorageError."""
    with storage_errors(work):
        remove_unfinished(scratch)
        # The identity is removed last, with the lock: until then the run can be resumed.
        for path in (*work.glob("*/*"), *work.glob("*")):
            if path.is_dir() and not path.is_symlink():
                with contextlib.suppress(OSError):
                    path.rmdir()
        for path in work.glob(MERGED):
            path.unlink(missing_ok=True)
        (work / IDENTITY).unlink(missing_ok=True)
        (work / "lock").unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            work.rmdir()
