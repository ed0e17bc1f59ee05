# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that a folder can hold a dataset: it has no other owner, and nothing in it is a link."""

import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath

from ..errors import StorageError
from ..messages import Action
from .dataset_state import IDENTITY, MANIFEST, OVERVIEW, RUN, WORK_FOLDER, read_dataset_state
from .layouts import LAYOUTS
from .records import FRAMES
from .storage import link_on_the_way


def check_place(out: Path) -> None:
    """Raise StorageError where a folder is somebody else's."""
    work = out / WORK_FOLDER
    if out.exists() and not out.is_dir():
        raise StorageError("is a file, not a folder", file=out, remedy=Action.OTHER_FOLDER)
    if work.is_symlink() or (work.exists() and not work.is_dir()):
        raise StorageError("is not the folder that a run works in", file=work, remedy="remove it")
    others = out.is_dir() and any(item.name != WORK_FOLDER for item in out.iterdir())
    if others and not os.path.lexists(work / IDENTITY) and read_dataset_state(out) is None:
        problem = "is not empty and holds no dataset of Noisy World"
        raise StorageError(problem, file=out, remedy=Action.OTHER_FOLDER)


def check_no_links(
    out: Path, sequences: Collection[str], *, folders_alone: bool = False, shard: Path | None = None
) -> None:
    """Refuse a link in place of any folder or file of a dataset: what is read, written or removed is the dataset's own.

    The folder itself may be reached through links, and other things in it may be links. sequences: the sequences'
    folders. folders_alone: links in place of files are to be removed, so they do not matter. shard: the folder of the
    only shard that matters; by default all that the working folder holds is looked at. Raises StorageError.
    """
    work = [out / WORK_FOLDER]
    if shard is not None:
        work = [shard, *(out / WORK_FOLDER / folder for folder in sequences)]
    for link in _links(out, sequences, work):
        if not folders_alone or link.is_dir():
            remedy = "remove it, or put what it leads to in its place"
            raise StorageError("is a link, but what is in a dataset has to be its own", file=link, remedy=remedy)


def _links(out: Path, sequences: Collection[str], work: Iterable[Path]) -> Iterator[Path]:
    """Yield the links that stand for folders or files of a dataset, a folder before what is in it.

    work: the working folder, or those in it that matter.
    """
    top = (WORK_FOLDER, MANIFEST, RUN, OVERVIEW, *sorted({folder.split("/")[0] for folder in sequences}))
    yield from (path for path in (out / name for name in top) if path.is_symlink())
    for folder in work:
        yield from (link for link in (link_on_the_way(out, folder),) if link is not None)
        yield from _links_below(folder)
    beside = {name for layout in LAYOUTS.values() for name in layout.setting_files}
    for folder in sequences:
        yield from (
            path for path in (out / folder, *((out / folder).parent / name for name in beside)) if path.is_symlink()
        )
        yield from (path for path in _links_below(out / folder) if _is_ours(path.relative_to(out / folder)))


def _links_below(folder: Path | str) -> Iterator[Path]:
    """Yield the links in a folder and in those below it. What kind an entry is comes with its name, without asking."""
    try:
        with os.scandir(folder) as entries:
            inside: list[str] = []
            for entry in entries:
                if entry.is_symlink():
                    yield Path(entry.path)
                elif entry.is_dir(follow_symlinks=False):
                    inside.append(entry.path)
    except OSError:  # there is no such folder, or a run that goes on has just removed it
        return
    for path in inside:
        yield from _links_below(path)


def _is_ours(name: Path) -> bool:
    """Tell whether a sequence may have a file or a folder of this name, in any layout."""
    inside = PurePosixPath(name.as_posix())
    patterns = [FRAMES, *(pattern for layout in LAYOUTS.values() for pattern in layout.all_patterns)]
    return any(
        _matches(inside.parts, PurePosixPath(pattern).parts) or inside in PurePosixPath(pattern).parents
        for pattern in patterns
    )


def _matches(parts: Sequence[str], pattern: Sequence[str]) -> bool:
    """Tell whether a path's parts are those of a pattern, where ** stands for any number, at the end not for none."""
    if not pattern:
        return not parts
    if pattern[0] == "**" and len(pattern) == 1:
        return bool(parts)
    if pattern[0] == "**":
        return any(_matches(parts[count:], pattern[1:]) for count in range(len(parts) + 1))
    return bool(parts) and fnmatchcase(parts[0], pattern[0]) and _matches(parts[1:], pattern[1:])
