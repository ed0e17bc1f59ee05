# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a folder can be a dataset's: nobody's but ours, and without links where its own folders have to be."""

from collections.abc import Collection
from pathlib import Path

from ..errors import StorageError
from .standing import WORK_FOLDER, read_standing
from .storage import link_on_the_way


def check_place(out: Path) -> None:
    """Raise StorageError where a folder is somebody else's."""
    work = out / WORK_FOLDER
    if out.exists() and not out.is_dir():
        raise StorageError(f"{out}: is a file, not a folder; choose another with --out")
    if work.is_symlink() or (work.exists() and not work.is_dir()):
        raise StorageError(f"{work}: is not the folder that a run works in; remove it")
    others = out.is_dir() and any(item.name != WORK_FOLDER for item in out.iterdir())
    if others and read_standing(out) is None:
        raise StorageError(f"{out}: is not empty and holds no dataset of Noisy World; choose another folder with --out")


def check_folders(out: Path, sequences: Collection[str], images: Collection[str]) -> None:
    """Refuse links in place of folders: what is written or removed has to be the dataset's own.

    sequences: the sequences' folders. images: the folders in each that hold its images.
    """
    for folder in sequences:
        for place in (out / WORK_FOLDER / folder, *(out / folder / name for name in images)):
            if link := link_on_the_way(out, place):
                raise StorageError(f"{link}: is a link, but the dataset's folders have to be its own; remove it")
