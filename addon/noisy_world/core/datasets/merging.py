# SPDX-License-Identifier: GPL-3.0-or-later
"""The identity and the manifest of a dataset that has grown: what the preset names, and what stays beside it."""

from collections.abc import Collection, Iterable, Iterator
from typing import Any

from .dataset_state import DatasetState
from .provenance import BETWEEN
from .records import OUT_OF_RANGE


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
