# SPDX-License-Identifier: GPL-3.0-or-later
"""What a folder holds of a dataset: its manifest, and the working folder of a run that did not come to its end."""

import contextlib
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

from ..core.atomic_files import UNFINISHED, link_on_the_way, sha256_of_regular_file, storage_errors
from ..core.errors import Action, StorageError
from ..core.file_access import read_json
from ..core.frame_table import FRAMES, JOURNALS, OUT_OF_RANGE, Journals, has_journal, read_records, remove_journals
from ..layouts import LAYOUTS
from .identity import BETWEEN, FORMAT, identity_problem, is_sequence, manifest_problem, version_problem

WORK_FOLDER = ".noisy_world"
IDENTITY = "identity.json"
MERGED = "merged*.jsonl"  # in the working folder: a line for each shard that was merged, a file of each process
MANIFEST = "manifest.json"
RUN = "run.json"
MANIFEST_SHA256 = "manifest_sha256"  # in run.json
UNCHECKED = f"{RUN} does not tell the SHA-256 of {MANIFEST}, which is not checked"
OVERVIEW = "overview.png"


@dataclass(frozen=True)
class DatasetState:
    """A dataset in a folder.

    identity: what it was made from, with all that a run which did not end was to make; None where that is unknown.
    manifest: None where no run has ended, or where it cannot be read. sequences: the folders of all its sequences.
    holds_frames: whether a frame is finished. problem: why nothing can be added. note: what the user should know.
    ended: whether the last run has come to its end.
    """

    identity: dict[str, Any] | None
    manifest: dict[str, Any] | None
    sequences: frozenset[str]
    holds_frames: bool
    problem: str = ""
    note: str = ""
    ended: bool = False

    @property
    def files(self) -> dict[str, Any]:
        """The files of the manifest: SHA-256 by name, and a level deeper those of each sequence."""
        return self.manifest["files"] if self.manifest and self.manifest["identity"]["format"] == FORMAT else {}

    @cached_property
    def finished(self) -> frozenset[str]:
        """The sequences in the manifest."""
        return frozenset(name for name, found in self.files.items() if isinstance(found, dict))


NOTHING = DatasetState(None, None, frozenset(), holds_frames=False)


def read_dataset_state(out: Path, only: Collection[str] | None = None) -> DatasetState | None:
    """Return what a folder holds of a dataset; None where it holds none of ours.

    only: the sequences whose frames are looked for, by default all: a dataset may have 100,000, each with folders.
    """
    opened, why_not_opened = _read(out / WORK_FOLDER / IDENTITY, identity_problem)
    manifest, why_no_manifest = _read(out / MANIFEST, manifest_problem)
    begun = has_journal(out / WORK_FOLDER, only)
    recorded = frozenset[str]() if manifest else _recorded_folders(out, only)
    if opened is None and manifest is None and not (begun or recorded or why_not_opened):
        return None  # a manifest.json that is not ours is somebody else's
    identity = opened or (manifest["identity"] if manifest else None)
    sequences = recorded | set(identity["sequences"] if identity else journal_folders(out / WORK_FOLDER))
    sequences |= set(manifest["identity"]["sequences"] if manifest else ())
    return DatasetState(
        identity,
        manifest,
        frozenset(sequences),
        bool(begun or recorded or manifest or why_no_manifest),
        _problem(identity, why_not_opened, why_no_manifest),
        ""
        if not why_not_opened
        else f"{WORK_FOLDER}/{IDENTITY} {why_not_opened}; frames that only it describes are made again",
        manifest is not None and not os.path.lexists(out / WORK_FOLDER / IDENTITY),
    )


def manifest_is_changed(out: Path) -> bool | None:
    """Tell whether the manifest of a dataset whose run has ended is another than the run wrote.

    None where run.json does not tell its SHA-256: it is not there, is damaged itself, or an earlier version wrote it.
    """
    try:
        known = manifest_sha256_in(read_json(out / RUN))
    except (FileNotFoundError, ValueError):
        return None
    return None if known is None else known != sha256_of_regular_file(out / MANIFEST)


def manifest_sha256_in(run: Any) -> str | None:
    """Return the SHA-256 of the manifest that the content of run.json tells; None where it tells none."""
    known = run.get(MANIFEST_SHA256) if isinstance(run, dict) else None
    return known if isinstance(known, str) else None


def _problem(identity: dict[str, Any] | None, why_not_opened: str, why_no_manifest: str) -> str:
    if why_no_manifest:
        return f"{MANIFEST} {why_no_manifest}"
    if identity is None:
        name, why = (f"{WORK_FOLDER}/{IDENTITY}", why_not_opened) if why_not_opened else (MANIFEST, "is missing")
        return f"{name} {why}, so what the frames were made from is not known"
    return version_problem(identity)


def journal_folders(work: Path) -> frozenset[str]:
    """Return the sequences of which a run has finished a frame, by the journals in its working folder."""
    journals = Journals(work)
    journals.read_on()
    return journals.sequences


def _recorded_folders(out: Path, only: Collection[str] | None) -> frozenset[str]:
    """Return the sequences that a run has completed, by their frames.jsonl."""
    paths = out.glob(f"*/*/{FRAMES}") if only is None else (out / folder / FRAMES for folder in only)
    return _folders(path for path in paths if next(read_records(path), None))


def recorded(out: Path) -> bool:
    """Tell whether a run has completed a sequence."""
    return any(next(read_records(path), None) is not None for path in out.glob(f"*/*/{FRAMES}"))


def _folders(paths: Any) -> frozenset[str]:
    names = (f"{path.parent.parent.name}/{path.parent.name}" for path in paths)
    return frozenset(name for name in names if is_sequence(name))


def _read(path: Path, problem: Callable[[Any], str]) -> tuple[dict[str, Any] | None, str]:
    """Return the content of a file, or why it cannot be used; (None, "") where there is none."""
    if path.is_symlink() or (path.parent.is_symlink() and path.parent.name == WORK_FOLDER):
        return None, "is a link, but what is in a dataset has to be its own"
    try:
        value = read_json(path)
    except FileNotFoundError:
        return None, ""
    except ValueError as error:
        return None, str(error)
    found = problem(value)
    return (None, found) if found else (value, "")


# Checks that a folder can hold a dataset: it has no other owner, and nothing in it is a link.


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
        work = [shard, *(out / WORK_FOLDER).glob(JOURNALS), *(out / WORK_FOLDER / folder for folder in sequences)]
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
    there = [folder for folder in sequences if (out / folder).parent.is_dir()]
    beside = {name for layout in LAYOUTS.values() for name in layout.setting_files} if there else set[str]()
    for folder in there:
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


# Removing a dataset's files from a folder, and no others.


def remove_dataset(out: Path, work: Path, sequences: Iterable[str]) -> None:
    """Remove the sequences, the dataset's own files and the journals of a folder. Raises StorageError."""
    with storage_errors(out):
        named = sorted(sequences)
        ours = _folders_in_sequences()
        for folder in named:
            _remove_sequence(out, out / folder, ours)
        beside = {name for layout in LAYOUTS.values() for name in layout.setting_files}
        for setting in sorted({folder.split("/")[0] for folder in named}):
            _remove_setting(out, out / setting, beside)
        for name in (MANIFEST, RUN, OVERVIEW):
            (out / name).unlink(missing_ok=True)
        if not link_on_the_way(out, work):
            remove_journals(work)


def _remove_sequence(out: Path, folder: Path, ours: Collection[str]) -> None:
    """Remove the files that a sequence in any layout may have, and then those of its folders, `ours`, that are empty.

    The dataset in the folder may have another layout than this run's. A link that stands for a folder is not followed.
    """
    if link_on_the_way(out, folder):
        return
    there = list(os.walk(folder, topdown=False))
    if any(files for _, _, files in there):
        patterns = dict.fromkeys(pattern for layout in LAYOUTS.values() for pattern in layout.all_patterns)
        for path in [path for pattern in (*patterns, FRAMES) for path in folder.glob(pattern)]:
            if not link_on_the_way(out, path.parent):
                path.unlink(missing_ok=True)
    for place, _, _ in there:
        if os.path.relpath(place, folder) in ours:
            with contextlib.suppress(OSError):
                os.rmdir(place)  # noqa: PTH106 - of thousands, one by one


def _folders_in_sequences() -> set[str]:
    """Return the folders of a sequence in any layout, from its own on."""
    return {
        str(parent)
        for layout in LAYOUTS.values()
        for pattern in layout.all_patterns
        for parent in PurePosixPath(pattern).parents
    }


def _remove_setting(out: Path, folder: Path, beside: Collection[str]) -> None:
    """Remove the files of a setting, `beside` its sequences, and its folder where it is empty then."""
    if link_on_the_way(out, folder) or not folder.is_dir():
        return
    there = set(os.listdir(folder))  # noqa: PTH208 - names alone, of thousands of settings
    for name in there.intersection(beside):
        (folder / name).unlink(missing_ok=True)
    if there.issubset(beside):
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


# The identity and the manifest of a dataset that has grown: what the preset names, and what stays beside it.


def merged_identity(there: dict[str, Any], here: dict[str, Any], kept: Iterable[str]) -> dict[str, Any]:
    """Return an identity with the sequences of another one that are kept, their scenes and settings.

    there: an identity that agrees with `here` wherever both name the same. kept: folders of sequences that `here` does
    not name.
    """
    folders = [folder for folder in kept if folder in there["sequences"]]
    if not folders:
        return here
    settings, scenes = ({folder.split("/")[place] for folder in folders} for place in (0, 1))
    undecided = {key: there[key] for key in ("near_m", "far_m", "rig", "render") if here[key] is None}
    return {
        **here,
        **undecided,
        "scenes": {name: there["scenes"][name] for name in scenes}
        | {name: _with_between(there["scenes"].get(name), scene) for name, scene in here["scenes"].items()},
        "settings": {name: there["settings"][name] for name in settings} | here["settings"],
        "sequences": {folder: there["sequences"][folder] for folder in folders} | here["sequences"],
        "versions": there["versions"] | here["versions"],
    }


def _with_between(there: dict[str, Any] | None, here: dict[str, Any]) -> dict[str, Any]:
    """Return what belongs to a scene, with what settings that are kept look at between its poses."""
    if there is None or BETWEEN not in there["path"] or there["path"]["frames"] != here["path"]["frames"]:
        return here
    return {**here, "path": {**here["path"], BETWEEN: there["path"][BETWEEN]}}


def merged_manifest(there: DatasetState, here: dict[str, Any], kept: Iterable[str]) -> dict[str, Any]:
    """Return a manifest with the finished sequences that are kept. there: what the folder held when the run began."""
    folders = [folder for folder in kept if folder in there.finished]
    # Where cameras differ, each sequence has its own file instead of the setting's.
    settings = {folder.split("/")[0] for folder in folders} if "cameras" not in here else set[str]()
    beside = {
        name: digest
        for name, digest in there.files.items()
        if isinstance(digest, str) and "/" in name and name.split("/")[0] in settings
    }
    assert there.manifest is not None or not folders
    frames = there.manifest["frames"] if there.manifest and folders else {}
    lost = there.manifest[OUT_OF_RANGE] if there.manifest and folders else {}
    return {
        **here,
        OUT_OF_RANGE: {folder: lost[folder] for folder in folders if folder in lost} | here[OUT_OF_RANGE],
        "frames": {folder: frames[folder] for folder in folders} | here["frames"],
        "files": {folder: there.files[folder] for folder in folders} | beside | here["files"],
    }


def kept_notes(kept: Collection[str], begun: Collection[str]) -> Iterator[str]:
    """Yield what the user should know of the sequences that stay. begun: those that are unfinished."""
    finished = [folder for folder in kept if folder not in begun]
    for folders, state in ((finished, "as it is"), (sorted(begun), "unfinished")):
        if folders:
            names = ", ".join(folders[:4]) + (f" and {len(folders) - 4} more" if len(folders) > 4 else "")
            yield f"what this preset does not name stays {state}: {names}"
