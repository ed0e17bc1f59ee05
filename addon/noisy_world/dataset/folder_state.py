# SPDX-License-Identifier: GPL-3.0-or-later
"""What a folder holds of a dataset, and why it cannot grow by a plan: the first difference in the preset's words."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from ..channels import COLOUR_AND_DEPTH, in_order, pair_channels
from ..core.atomic_files import UNFINISHED, link_on_the_way, sha256_of_bytes, sha256_of_regular_file, storage_errors
from ..core.errors import Action, CommandLineOnly, Message, PresetKey, StorageError, either, offers
from ..core.file_access import canonical, read_json
from ..core.frame_request import SensorPaths
from ..core.frame_table import FRAMES, JOURNALS, OUT_OF_RANGE, Journals, has_journal, read_records, remove_journals
from ..core.trajectory import recentring_m
from ..layouts import LAYOUTS
from ..preset.names import format_same_folder
from .identity import (
    BETWEEN,
    CHANNELS,
    FORMAT,
    HUFFMAN,
    KEYS,
    RecordedSetting,
    RecordedStep,
    identity_problem,
    is_sequence,
    manifest_problem,
    path_sha256,
    same_version,
    version_problem,
)

if TYPE_CHECKING:
    from ..sources.scene_kinds import Scene
    from .plan import Plan
    from .sequence import PlannedSequence


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
    if (above := next((item for item in out.parents if item.exists()), None)) is not None and not above.is_dir():
        raise StorageError("is a file, so no folder can be made in it", file=above, remedy=Action.OTHER_FOLDER)
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
    settings = sorted({folder.split("/")[0] for folder in sequences})
    top = (WORK_FOLDER, MANIFEST, RUN, OVERVIEW, *settings)
    yield from (path for path in (out / name for name in top) if path.is_symlink())
    for folder in work:
        yield from (link for link in (link_on_the_way(out, folder),) if link is not None)
        yield from _links_below(folder)
    for setting in settings:
        yield from (
            link
            for link in _links_and_folders(out / setting)[0]
            if f"{setting}/{link.name}" in sequences or link.name in _setting_files()
        )
    for folder in sequences:
        yield from (path for path in _links_below(out / folder) if _is_ours(path.relative_to(out / folder)))


def _setting_files() -> set[str]:
    """Return the files that may stand beside the sequences of a setting, in any layout."""
    return {name for layout in LAYOUTS.values() for name in layout.setting_files}


def _links_below(folder: Path | str) -> Iterator[Path]:
    """Yield the links in a folder and in those below it."""
    links, inside = _links_and_folders(folder)
    yield from links
    for path in inside:
        yield from _links_below(path)


def _links_and_folders(folder: Path | str) -> tuple[list[Path], list[str]]:
    """Return the links in a folder, and its folders. What kind an entry is comes with its name, without asking."""
    links: list[Path] = []
    inside: list[str] = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:  # it may not be there, or just be removed
        for entry in entries:
            if entry.is_symlink():
                links.append(Path(entry.path))
            elif entry.is_dir(follow_symlinks=False):
                inside.append(entry.path)
    return links, inside


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
        beside = _setting_files()
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


# Why a dataset cannot grow by a plan, as the first difference in the preset's words.
#
# A dataset grows where what is common to all frames is equal, and each scene and setting that both name.


ELSEWHERE = (Action.OTHER_FOLDER, Action.OVERWRITE)
ANOTHER_FOLDER = either(*ELSEWHERE)
ANOTHER_NAME = either(Action.OTHER_NAME, *ELSEWHERE)
PROCESSORS = Message(
    "set ", PresetKey("render.processors", "any"),
    " where frames of unlike processors, within 1/255 of each other, are good enough",
)  # fmt: skip
COMMON = ("seed", "near_m", "far_m", "rig", "render", "output")
IN_PRESET = {"near_m": "camera.near_m", "far_m": "camera.far_m"}  # where they stand there
DECIDE_OTHERS = ("layout", "file")  # keys whose values decide what others mean or default to
PATH_INPUTS = ("trajectory", "trajectory_sha256")  # the poses are compared instead


def why_not(there: dict[str, Any], here: dict[str, Any], plan: Plan) -> str | None:
    """Return why a dataset with the identity `there` cannot take what a plan with the identity `here` makes, or None.

    The text is the first difference that tells most, and the remedy.
    """
    any_processor = plan.preset.spec.render.processors == "any"
    for key in COMMON:
        if None not in (there[key], here[key]) and there[key] != here[key]:
            return Message(_common(key, there[key], here[key]), ANOTHER_FOLDER)
    if problem := _keys(there, here):
        return Message(problem, ANOTHER_FOLDER)
    for kind, names in (("settings", plan.settings), ("scenes", plan.scenes)):
        if problem := _one_folder(there[kind], [item.name for item in names]):
            return Message(f"{kind}: {problem}", ANOTHER_NAME)
    for setting in plan.settings:
        if setting.name in there["settings"]:
            before, now = there["settings"][setting.name], here["settings"][setting.name]
            if before != now:
                return Message(f"settings: {setting.name} {_setting(before, now)}", ANOTHER_NAME)
    for scene in plan.scenes:
        if scene.name in there["scenes"]:
            before, now = there["scenes"][scene.name], here["scenes"][scene.name]
            problem = _scene(scene, before, now) or _path(scene, before, now, any_processor=any_processor)
            if problem := problem or _longer(scene, there["sequences"], plan):
                return problem
    return _made_with(there, here, any_processor=any_processor)


def _keys(there: dict[str, Any], here: dict[str, Any], where: str = "") -> str | None:
    """Return which key that decides bytes by its own value differs, with both values, or None."""
    return first_difference(there.get(KEYS, {}), here.get(KEYS, {}), where)


def _one_folder(there: Iterable[str], here: Iterable[str]) -> str | None:
    """Return in words which names are one folder's where case is not told apart, or None."""
    known = {name.casefold(): name for name in there}
    taken = ((name, known.get(name.casefold(), name)) for name in here)
    return next((format_same_folder(name, other) for name, other in taken if name != other), None)


def first_difference(there: Any, here: Any, where: str = "") -> str | None:
    """Return the keys of the first difference of two JSON values, with both values as text, or None."""
    if isinstance(there, dict) and isinstance(here, dict):
        parts = [(name, there.get(name), here.get(name)) for name in sorted({*there, *here}, key=_telling)]
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        parts = [(str(index), left, right) for index, (left, right) in enumerate(zip(there, here, strict=True))]
    else:
        return None if there == here else Message(PresetKey(where), " ", was_is(there, here))
    inside = (first_difference(left, right, f"{where}.{name}" if where else name) for name, left, right in parts)
    return next((found for found in inside if found), None)


def was_is(there: Any, here: Any) -> str:
    """Return both values in words."""
    return f"was {_short(there)}, is {_short(here)}"


def _telling(name: str) -> tuple[bool, str]:
    return name not in DECIDE_OTHERS, name


def _short(value: object) -> str:
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        value = int(value)
    text = value if isinstance(value, str) and value.isprintable() and value else json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _common(key: str, there: Any, here: Any) -> str:
    name = IN_PRESET.get(key, key)
    if key == "rig" and (there or {}).get("imu") != (here or {}).get("imu"):
        before, now = (content.get("imu") for content in (there or {}, here or {}))
        return first_difference(before, now, f"{name}.imu") or f"{name}.imu"
    if key == "rig":
        return f"{name}: the sensors have other poses on the robot than in the dataset"
    if key == "output":
        tables = "made before noisy JPEG images had Huffman tables of their own, so bytes of equal images would differ"
        return first_difference({**there, HUFFMAN: None}, {**here, HUFFMAN: None}, name) or tables
    return first_difference(there, here, name) or name


# --- settings ---


def _setting(there: dict[str, Any], here: dict[str, Any]) -> str:
    """Return in which step and value two settings differ, in words."""
    before, now = RecordedSetting.read(there).steps, RecordedSetting.read(here).steps
    names = [[step.name for step in steps] for steps in (before, now)]
    if names[0] != names[1]:
        return was_is(*(", ".join(item) or "clean" for item in names))
    for number, (left, right) in enumerate(zip(before, now, strict=True)):
        if found := _step(left, right):
            alone = len(names[0]) == 1
            key, values = found
            nth = f" {names[0][: number + 1].count(left.name)}" if names[0].count(left.name) > 1 else ""
            return f"({key if alone else left.name + nth + '.' + key}) {values}"
    if problem := _keys(there, here):
        return problem
    for key, absent in (("backend", None), ("stream", "its own name")):
        if there.get(key, absent) != here.get(key, absent):
            return f"({key}) {was_is(there.get(key, absent), here.get(key, absent))}"
    return first_difference(there, here) or was_is(there, here)


def _step(there: RecordedStep, here: RecordedStep) -> tuple[str, str] | None:
    """Return the key in which two steps of the same perturbation differ, and both values."""
    if there.version != here.version:
        return "version", was_is(there.version, here.version)
    if there.mode != here.mode:
        return "mode", was_is(there.mode, here.mode)
    if (there.severity, there.levels) != (here.severity, here.levels):
        key = "severity" if there.mode == "static" else "levels"
        return key, was_is(getattr(there, key), getattr(here, key))
    if there.temporal != here.temporal:
        return "temporal", was_is(there.temporal, here.temporal)
    for name in sorted({*there.share, *here.share}):
        if there.share.get(name) != here.share.get(name):
            return name, was_is(there.share.get(name), here.share.get(name))
    for left, right in zip(there.parameters, here.parameters, strict=True):
        before, now = left or {}, right or {}
        for name in sorted({*before, *now}):
            if before.get(name) != now.get(name):
                return name, was_is(before.get(name), now.get(name))
    return None if there == here else ("parameters", was_is(there.parameters, here.parameters))


# --- scenes ---


def _scene(scene: Scene, there: dict[str, Any], here: dict[str, Any]) -> str | None:
    """Return how the files or the camera of a scene differ, but for its path."""
    from ..render.source import DRAWN, PERTURBED

    before, now, place = there["inputs"], here["inputs"], scene.place.path
    for name in sorted({*before, *now} - set(PATH_INPUTS)):
        hashed = f"{name}_sha256"
        if before.get(name) == now.get(name) or (before.get(hashed) and now.get(hashed)):
            continue  # a file may be called otherwise
        if name == PERTURBED:
            how = "environment and lens act on its light before the view transform, but after it in the dataset"
            return Message(PresetKey(place), f": {how}, which an earlier version made", ANOTHER_NAME)
        if name == DRAWN:
            how = "weather and dirt are drawn otherwise on its light than in the dataset"
            return Message(PresetKey(place), f": {how}, which another version made", ANOTHER_NAME)
        if name.endswith("_sha256") and before.get(name) and now.get(name):
            key = name.removesuffix("_sha256")
            own = Message(PresetKey(f"{place}.{key}"), f": {_short(now[key])} is") if key in now else ""
            what = own or Message(PresetKey(place), f": its {key} are")
            return Message(what, " not what the dataset was made from", ANOTHER_NAME)
        changed = PresetKey(f"{place}.{name.removesuffix('_sha256')}")
        return Message(changed, f" {was_is(before.get(name), now.get(name))}", ANOTHER_NAME)
    if problem := _keys(there, here, place):
        return Message(problem, ANOTHER_NAME)
    if there.get(CHANNELS) != here.get(CHANNELS):
        message = ": the file of its objects' names is not what the dataset was made from"
        return Message(PresetKey(place), message, ANOTHER_NAME)
    if there["camera"] != here["camera"]:
        return Message(first_difference(there["camera"], here["camera"], "camera") or "camera", ANOTHER_FOLDER)
    return None


def _path(scene: Scene, there: dict[str, Any], here: dict[str, Any], *, any_processor: bool) -> str | None:
    """Return how the path of a scene differs in the frames that the dataset's path has; None where it goes on.

    any_processor: whether last bits are allowed to differ, where everything that a path is made from is equal.
    """
    before, now = there["path"], here["path"]
    where = scene.place.path
    between = {item[BETWEEN] for item in (before, now) if BETWEEN in item}
    if before["frames"] == now["frames"] and len(between) > 1:
        message = ": its path goes another way between the poses than the dataset's"
        return Message(PresetKey(where), message, ANOTHER_NAME)
    if {**before, BETWEEN: None} == {**now, BETWEEN: None}:
        return None
    where = scene.path_place.path
    key = where.rpartition(".")[2]
    changed = first_difference(there["entry"].get(key), here["entry"].get(key), where)
    if any_processor and changed is None and there["inputs"] == here["inputs"] and before["frames"] == now["frames"]:
        return None
    if now["frames"] >= before["frames"]:
        if before["sha256"] == path_sha256(scene.path, scene.source.stamps_s, before["frames"]):
            return None
    elif changed is None or changed.startswith(
        (f"{where}.stop ", f"{where}.handheld.frames ", f"{scene.place.path}.frames ")
    ):
        message = f": the path was {before['frames']} frames long, is {now['frames']}"
        cause = changed or Message(PresetKey(where), message)
        shorter = f"keep the path, and choose its first frames with --frames 0:{now['frames']}"
        return Message(cause, either(CommandLineOnly(shorter), Action.OTHER_NAME, *ELSEWHERE))
    name = here["inputs"].get("trajectory")
    if changed:
        return Message(changed, ", which makes another path", ANOTHER_NAME)
    if _was_unrounded(scene, before):
        how = "its poses were not rounded yet when the dataset was begun, and are now, to the nanometre"
        return Message(PresetKey(where), f": {how}", ANOTHER_NAME)
    return Message(PresetKey(where), f": {_short(name)} has other poses or stamps", ANOTHER_NAME)


def _was_unrounded(scene: Scene, path: dict[str, Any]) -> bool:
    """Tell whether a dataset's path is the scene's as earlier versions had it, with all digits of its poses."""
    source = scene.source
    return path["sha256"] == path_sha256(source.trajectory(), source.stamps_s, path["frames"])


def _longer(scene: Scene, counts: dict[str, int], plan: Plan) -> str | None:
    """Return what looks different in the dataset's frames now that the path of a scene is longer.

    counts: how long the path was that each sequence of the dataset was made from.
    """
    from .rendering import source_paths

    path = PresetKey(scene.path_place.path)
    for render in plan.renders:
        for sequence in render.sequences if render.scene.name == scene.name else ():
            count = counts.get(sequence.folder, scene.frame_count)
            if not 0 < count < scene.frame_count:
                continue
            if led_on := pair_channels(plan.format.modalities):
                message = f"the {led_on[0].spoken} of what was the last frame leads on, now that it is longer"
                return Message(path, f": {message}", ANOTHER_NAME)
            before, after = source_paths(plan, render, count), source_paths(plan, render)
            clocked = render.unit is not None and render.unit.clock is not None
            if render.exposure or clocked:
                looks = "a setting" if render.exposure else "rig.depth"
                message = f"which {looks} looks at, lies otherwise now that the path is longer"
                return Message(path, f": what is between the poses of {scene.name}, {message}", ANOTHER_NAME)
            capabilities = scene.source.capabilities
            moved = capabilities.rendered and capabilities.own is None  # others stay where they are
            if moved and not np.array_equal(recentring_m(before.rgb), recentring_m(after.rgb)):
                far = "so far from the origin, a longer path is rendered around another point"
                return Message(path, f": {far}, and float32's rounding shows", ANOTHER_NAME)
            if not _goes_on(sequence, count, before, after):
                setting, steps = sequence.setting, sequence.setting.steps
                named = f" ({', '.join(step.perturbation.name for step in steps)})" if steps else ""
                problem = f"changes frames that are there, now that the path of {scene.name} is longer"
                return Message(f"settings: {setting.name}{named} {problem}", ANOTHER_NAME)
    return None


def _goes_on(sequence: PlannedSequence, count: int, before: SensorPaths, after: SensorPaths) -> bool:
    """Tell whether a sequence shows in each frame of a path's first `count` poses the same as on the longer path.

    before, after: the sensors' paths, of the first poses and of all.
    """
    from .sequence import array_of, lay_out

    shorter = lay_out(sequence.setting, sequence.scene, count, sequence.identifiers)
    for frame in shorter.frames:
        if sequence.leaves_out(frame) or shorter.shown(frame) != sequence.shown(frame):
            return False
    rows = array_of(shorter.sources(in_order(COLOUR_AND_DEPTH)))
    return all(
        np.array_equal(left.c2w[rows], right.c2w[rows])
        for left, right in zip(before.named().values(), after.named().values(), strict=True)
    )


# --- what it is made with ---


def _made_with(there: dict[str, Any], here: dict[str, Any], *, any_processor: bool) -> str | None:
    if "deflate" not in there["versions"]:
        return Message(
            "made before deflate compressed PNG files, so bytes of equal images would differ", ANOTHER_FOLDER
        )
    for name in sorted({*there["versions"]} & {*here["versions"]}):
        before, now = there["versions"][name], here["versions"][name]
        if not same_version(name, before, now):
            return Message(f"made with {name} {_short(before)}, this is {_short(now)}", ANOTHER_FOLDER)
    if not any_processor and (found := first_difference(there["processor"], here["processor"])):
        return Message("made on another processor: ", found, either(PROCESSORS, *ELSEWHERE))
    return None


def other_dataset(out: Path, problem: str) -> StorageError:
    """Return the error that says why a folder cannot take a dataset in, and what to do about it."""
    remedy = "" if offers(problem, Action.OVERWRITE) else ANOTHER_FOLDER
    return StorageError(Message("holds another dataset: ", problem), file=out, remedy=remedy)


# Compares identities: whether one process may add frames to a dataset that another has begun.


def decisive(identity: dict[str, Any]) -> dict[str, Any]:
    """Return what of an identity decides the bytes that a given processor makes.

    Without the preset's text, which is there for people; without the hashes of paths, whose making may take seconds and
    whose poses follow from the rest; without the processor.
    """
    texts = ("preset", "preset_sha256", "processor")
    scenes = {
        name: {**{key: part for key, part in scene.items() if key != "entry"}, "path": scene["path"]["frames"]}
        for name, scene in identity["scenes"].items()
    }
    return {**{key: part for key, part in identity.items() if key not in texts}, "scenes": scenes}


def identity_sha256(identity: dict[str, Any]) -> str:
    """Return the SHA-256 of what of an identity is decisive."""
    return sha256_of_bytes(canonical(decisive(identity)).encode())


def clean_identity(identity: Mapping[str, Any], scene: str, setting: str) -> dict[str, Any]:
    """Return what of an identity decides the clean frames of a render.

    setting: whose steps move or expose the frames; "" for those of the scene as it is.
    """
    others = ("preset", "preset_sha256", "output", "sequences")
    known = {key: part for key, part in identity["scenes"][scene].items() if key not in ("entry", "robot_axes")}
    steps = {setting: identity["settings"].get(setting)} if setting else {}
    made_from = {key: part for key, part in identity.items() if key not in others}
    return {**made_from, "scenes": {scene: known}, "settings": steps}


def identity_mismatch(there: dict[str, Any], here: dict[str, Any], *, any_processor: bool) -> str:
    """Return why frames of the identity `here` are not those of `there`, which may say more than that; "" if they are.

    any_processor: whether another kind of processor is none.
    """
    if difference := first_difference(decisive(_narrowed(there, here)), decisive(here)):
        return difference
    if not any_processor and (difference := first_difference(there["processor"], here["processor"], "processor")):
        return Message("made on another processor: ", difference, either(PROCESSORS))
    return ""


def _narrowed(there: dict[str, Any], here: dict[str, Any]) -> dict[str, Any]:
    """Return an identity without the scenes, settings, sequences and versions that another one does not name."""
    parts = ("scenes", "settings", "sequences", "versions")
    undecided = {key: None for key in ("near_m", "far_m", "rig", "render") if here[key] is None}
    # Asked by the names of the other: a shard has one scene of a dataset's hundreds.
    return {**there, **undecided, **{key: {k: there[key][k] for k in here[key] if k in there[key]} for key in parts}}
