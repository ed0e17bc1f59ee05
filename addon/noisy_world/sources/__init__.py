# SPDX-License-Identifier: GPL-3.0-or-later
"""Sources of clean frames, an object in a file of its own each, and the scenes of a preset, which come from them.

`scene_kinds` says what such an object is, `render.source` what it opens.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import fields
from typing import Any, TypeVar

from ..core.packages import Door, Registry
from ..core.schema import ConfigPath, KeyInfo, describe, list_keys, list_leaves, parse, unknown_name
from ..preset.keys import Preset, PresetSpec
from ..preset.names import selected
from ..preset.scene_keys import SceneKeys
from .scene_kinds import FoundScene, Scene, SceneEntry, SourceKind

__all__ = ["SOURCES", "find_scenes", "preset_keys", "preset_leaves", "read_scenes"]

T = TypeVar("T")

SHARED = {item.name for item in fields(SceneKeys)}
SCENES = "scenes[]"


def _problem(kind: SourceKind[Any]) -> str:
    """Return what is wrong with the source of a package, in a sentence, or ""."""
    if lacking := [item for item in ("name", "label", "meaning", "keys") if not getattr(kind, item, None)]:
        return f"its source {type(kind).__name__} lacks {', '.join(lacking)}"
    if not re.fullmatch(r"[a-z][a-z0-9_]*", kind.name):
        return f"{kind.name!r} is no name of a source: small letters, digits and underscores, a letter first"
    own = {item.name for item in fields(kind.keys)} - SHARED
    if own != {kind.name} or not issubclass(kind.keys, SceneKeys):
        return (
            f"the keys of its source {kind.name} have to be a SceneKeys with {kind.name} alone: put others inside that"
        )
    return ""


DOOR = Door[SourceKind[Any]]("noisy_world.sources", "source", "SOURCE", (SourceKind,), _problem)

SOURCES = Registry[SourceKind[Any]](DOOR, __name__)
"""Every source by the key that names it in a preset's scene, ours and those of installed packages."""


# --- keys ---


def preset_keys() -> Iterator[tuple[str, str]]:
    """Yield (key, meaning) for all that a preset may say, with the keys of each source's scenes; each key once."""
    for name, meaning in list_keys(PresetSpec):
        yield name, meaning
        if name == SCENES:
            for key, description in _of_each(list_keys):  # the key that names a source is there in its own scenes alone
                yield (
                    key,
                    description.removesuffix("; required")
                    if key.removeprefix(f"{SCENES}.") in SOURCES
                    else description,
                )


def preset_leaves() -> Iterator[tuple[str, KeyInfo]]:
    """Yield (key, what it means) for all keys of a preset that hold values themselves; each once."""
    for name, info in list_leaves(PresetSpec):
        yield from _of_each(list_leaves) if name == SCENES else [(name, info)]


def _of_each(listed: Callable[[type[SceneKeys], str], Iterable[tuple[str, T]]]) -> Iterable[tuple[str, T]]:
    """Return the rows of the keys of every source; of a key that several have, that of the first."""
    found: dict[str, T] = {}
    for kind in SOURCES.values():
        found = {**dict(listed(kind.keys, f"{SCENES}.")), **found}
    return found.items()


# --- scenes ---


def read_scenes(preset: Preset) -> list[SceneEntry[Any]]:
    """Return the entries of a preset's scenes, checked. Raises InputError naming the key."""
    place = preset.place("scenes")
    return [_entry(preset, given, place.at(index)) for index, given in enumerate(preset.spec.scenes)]


def _entry(preset: Preset, given: Any, place: ConfigPath) -> SceneEntry[Any]:
    said = given if isinstance(given, Mapping) else {}
    kinds = [SOURCES[name] for name in said if said[name] is not None and name in SOURCES]
    own = {item.name for kind in kinds for item in fields(kind.keys)}
    if len(kinds) != 1 or not own.issuperset(said):
        _check_keys(given, place)
    (kind,) = kinds
    keys = parse(kind.keys, {name: value for name, value in said.items() if name in own}, place)
    kind.check(keys, place)
    return SceneEntry(preset, place, kind, keys, SOURCES.distribution(kind.name))


def _check_keys(given: Any, place: ConfigPath) -> None:
    """Check an entry against the keys of all sources. Raises InputError where it does not name one, or has others'."""
    owners: dict[str, list[SourceKind[Any]]] = {}
    for kind in SOURCES.values():
        for item in fields(kind.keys):
            owners.setdefault(item.name, []).append(kind)
    if not isinstance(given, Mapping):
        raise place.error(f"is {describe(given)}, but has to be a mapping of {', '.join(owners)}")
    for name in given:
        if name not in owners:
            raise unknown_name(place.at(str(name)), "key", str(name), list(owners))
    kinds = [kind for name, kind in SOURCES.items() if given.get(name) is not None]
    if len(kinds) != 1:
        message = f"names {' and '.join(kind.name for kind in kinds)}, but" if kinds else ""
        raise place.error(f"{message} needs one of {', '.join(SOURCES)}".lstrip(), "name where its frames come from")
    (kind,) = kinds
    own = {item.name for item in fields(kind.keys)}
    for name in given:
        if name not in own and not _says_nothing(owners[name][0], name, given[name]):
            whose = " or ".join(item.name for item in owners[name])
            raise place.at(name).error(f"goes with {whose}", kind.instead.get(name, "leave it out"))


def _says_nothing(owner: SourceKind[Any], name: str, value: Any) -> bool:
    """Tell whether a key of another source is empty, or as it would be if nobody gave it."""
    return value is None or any(value == item.default for item in fields(owner.keys) if item.name == name)


def find_scenes(preset: Preset, names: Collection[str] = ()) -> list[Scene]:
    """Return the scenes of a preset that are wanted; an entry is one scene, or as many as its wildcards match.

    names: with some that the preset has, these scenes alone: no file of the others is looked at.

    Raises InputError for files that are missing or wrong.
    """
    found = [scene for entry in read_scenes(preset) for scene in entry.kind.scenes(entry)]
    wanted = set(selected([item.name for item in found], preset.spec.only.scenes, preset.place("only.scenes")))
    chosen = [item for item in found if item.name in wanted]
    chosen = [item for item in chosen if item.name in names] or chosen
    for kind in {id(item.entry.kind): item.entry.kind for item in chosen}.values():
        kind.check_found([item for item in chosen if item.entry.kind is kind])
    return [_opened(item) for item in chosen]


def _opened(item: FoundScene) -> Scene:
    place = item.entry.place
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", item.name):
        raise place.at("name").error(f"{item.name!r} cannot name a folder", "give a name")
    return Scene(item.name, place, item.source(), item.entry)
