# SPDX-License-Identifier: GPL-3.0-or-later
"""What a folder holds of a dataset: its manifest, and the working folder of a run that did not come to its end."""

import os
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property
from glob import iglob
from pathlib import Path
from typing import Any

from ..schema import shown
from .json_text import read_json
from .layouts import LAYOUTS
from .provenance import FORMAT, cameras_of
from .recorded_setting import setting_problem
from .records import FRAMES, OUT_OF_RANGE, read_records
from .storage import sha256_of_regular_file

WORK_FOLDER = ".noisy_world"
IDENTITY = "identity.json"
MERGED = "merged*.jsonl"  # in the working folder: a line for each shard that was merged, a file of each process
MANIFEST = "manifest.json"
RUN = "run.json"
MANIFEST_SHA256 = "manifest_sha256"  # in run.json
MOST_FRAMES = 10**7  # chosen: of a path; four days at 30 Hz, and gigabytes of poses as text
UNCHECKED = f"{RUN} does not tell the SHA-256 of {MANIFEST}, which is not checked"
OVERVIEW = "overview.png"
JOURNALS = "journal-*.jsonl"


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
    begun = journal_folders(out / WORK_FOLDER, only)
    recorded = frozenset[str]() if manifest else _recorded_folders(out, only)
    if opened is None and manifest is None and not (begun or recorded or why_not_opened):
        return None  # a manifest.json that is not ours is somebody else's
    identity = opened or (manifest["identity"] if manifest else None)
    sequences = begun | recorded | set(identity["sequences"] if identity else ())
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


def version_problem(identity: dict[str, Any]) -> str:
    """Return why a dataset of this identity cannot be understood by this version, or ""."""
    if identity["format"] == FORMAT:
        return ""
    by = "a later" if identity["format"] > FORMAT else "an earlier"
    return f"made by {by} version of Noisy World, and cannot be continued by this one"


def _problem(identity: dict[str, Any] | None, why_not_opened: str, why_no_manifest: str) -> str:
    if why_no_manifest:
        return f"{MANIFEST} {why_no_manifest}"
    if identity is None:
        name, why = (f"{WORK_FOLDER}/{IDENTITY}", why_not_opened) if why_not_opened else (MANIFEST, "is missing")
        return f"{name} {why}, so what the frames were made from is not known"
    return version_problem(identity)


def journal_folders(work: Path, only: Collection[str] | None = None) -> frozenset[str]:
    """Return the sequences of which a run has finished a frame, by the journals in its working folder.

    only: those that are looked for, if not all.
    """
    # Path.glob of Python 3.11 and 3.12 fails where another process has just removed a folder.
    patterns = [f"{folder}/{JOURNALS}" for folder in (("*/*",) if only is None else only)]
    names = (name for pattern in patterns for name in iglob(pattern, root_dir=work, include_hidden=True))  # noqa: PTH207
    return _folders(path for path in map(work.joinpath, names) if path.is_file() and path.stat().st_size)


def _recorded_folders(out: Path, only: Collection[str] | None) -> frozenset[str]:
    """Return the sequences that a run has completed, by their frames.jsonl."""
    paths = out.glob(f"*/*/{FRAMES}") if only is None else (out / folder / FRAMES for folder in only)
    return _folders(path for path in paths if next(read_records(path), None))


def _folders(paths: Any) -> frozenset[str]:
    names = (f"{path.parent.parent.name}/{path.parent.name}" for path in paths)
    return frozenset(name for name in names if _is_sequence(name))


_SEQUENCE = re.compile("[A-Za-z0-9][A-Za-z0-9._-]*/[A-Za-z0-9][A-Za-z0-9._-]*")


def _is_sequence(name: Any) -> bool:
    """Tell whether this is the folder of a sequence: two plain names, which lead nowhere else."""
    return isinstance(name, str) and _SEQUENCE.fullmatch(name) is not None


# --- what may be in the files ---


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


NUMBER = (int, float, type(None))
TEXT = (str, type(None))


@dataclass(frozen=True)
class _Each:
    """A mapping of any names to values of one shape, or a list of these."""

    kind: type
    shape: Any


_SCENE = {"entry": dict, "inputs": dict, "camera": dict, "path": {"frames": int, "sha256": str}}
_OUTPUT = {"layout": str, "image": TEXT, "modalities": _Each(list, str)}
_RENDER = {"engine": str, "samples": int}
_COMMON = {"preset": dict, "preset_sha256": str, "seed": int, "near_m": NUMBER, "far_m": NUMBER, "output": _OUTPUT}
_PROCESSOR = {"machine": str, "byte_order": str, "features": _Each(list, str)}
_MIXED = {"rig": (dict, type(None)), "render": (dict, type(None)), "processor": _PROCESSOR}
_LAYERS = {"sequences": _Each(dict, int), "scenes": _Each(dict, _SCENE), "settings": _Each(dict, dict)}
_IDENTITY = {**_COMMON, **_MIXED, **_LAYERS, "versions": _Each(dict, str)}
_MANIFEST = {OUT_OF_RANGE: _Each(dict, dict), "frames": _Each(dict, int), "files": _Each(dict, (str, dict))}
_DIGEST = re.compile("[0-9a-f]{64}")
_INSIDE = re.compile(r"(?!\.\.?(/|$))[^/\0\\]+(/(?!\.\.?(/|$))[^/\0\\]+)*")  # a name that leads nowhere else


def _fits(value: Any, shape: Any) -> bool:
    """Tell whether a JSON value has a shape: a mapping with at least these keys, or one of some types."""
    if isinstance(shape, dict):
        return isinstance(value, dict) and all(name in value and _fits(value[name], shape[name]) for name in shape)
    if isinstance(shape, _Each):
        inside = value.values() if isinstance(value, dict) else value
        return isinstance(value, shape.kind) and all(_fits(item, shape.shape) for item in inside)
    return isinstance(value, shape) and (not isinstance(value, bool) or shape is object)


def identity_problem(value: Any) -> str:
    """Return why a JSON value cannot be used as the identity of a dataset, or ""."""
    if not _fits(value, {"format": int, "sequences": (list, dict)}) or not all(map(_is_sequence, value["sequences"])):
        return "is not the identity of a dataset"
    if value["format"] != FORMAT:
        return ""
    whole = _fits(value, _IDENTITY) and _has_cameras(value)
    if whole and value["output"]["layout"] not in LAYOUTS:
        layout = shown(value["output"]["layout"])
        return f"is in the layout {layout}, which is not known here: install the package that brings it"
    whole = whole and all(0 < scene["path"]["frames"] <= MOST_FRAMES for scene in value["scenes"].values())
    if not whole or not (value["render"] is None or _fits(value["render"], _RENDER)):
        return "lacks what an identity holds, or holds something else"
    if wrong := next(filter(None, map(setting_problem, value["settings"], value["settings"].values())), ""):
        return f"lacks what an identity holds, or holds something else: {wrong}"
    parts = [name.split("/") for name in value["sequences"]]
    known = all(setting in value["settings"] and scene in value["scenes"] for setting, scene in parts)
    return "" if known else "does not say what all its sequences are made from"


def _is_file(name: str, digest: object) -> bool:
    """Tell whether these are the name of a file in a folder and a SHA-256."""
    return is_inside(name) and isinstance(digest, str) and bool(_DIGEST.fullmatch(digest))


def is_inside(name: str) -> bool:
    """Tell whether a name, with forward slashes, is one of a file in a folder, which leads nowhere else."""
    return bool(_INSIDE.fullmatch(name))


def _has_cameras(identity: dict[str, Any]) -> bool:
    """Tell whether each scene has the intrinsics of a camera."""
    try:
        cameras_of(identity)
    except (KeyError, TypeError, ValueError, OverflowError):
        return False
    return True


def manifest_problem(value: Any) -> str:
    """Return why a JSON value cannot be used as the manifest of a dataset, or ""."""
    identity: Any = value.get("identity") if isinstance(value, dict) else None
    if (problem := identity_problem(identity)) or identity["format"] != FORMAT:
        return problem
    if not _fits(value, _MANIFEST):
        return "lacks what a manifest holds, or holds something else"
    finished = {name for name, found in value["files"].items() if isinstance(found, dict)}
    digests = {name: found for name, found in value["files"].items() if name not in finished}
    if any(FRAMES not in value["files"][name] for name in finished):
        return f"does not name the {FRAMES} of each sequence"
    for files in (digests, *(value["files"][name] for name in finished)):
        if wrong := next((name for name, digest in files.items() if not _is_file(name, digest)), None):
            return f"does not tell a name inside the dataset and its SHA-256 of {wrong[:80]!r}"
    agree = finished == set(value["frames"]) and finished <= set(identity["sequences"])
    return "" if agree else "contradicts itself"
