# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that a preset takes from another one: `- {include: other.yaml}` stands for all settings of that file."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from ..home import path_in
from ..schema import ConfigPath, describe, parse
from .settings import SettingSpec

Load: TypeAlias = Callable[[Path], dict[str, Any]]
"""A function that reads a preset's file as a document; it raises InputError."""


def included(document: dict[str, Any], path: Path, load: Load) -> tuple[dict[str, Any], tuple[ConfigPath, ...]]:
    """Return a document with the settings that it includes written out, and the place of each.

    The document then stands for itself, wherever it is recorded. Without includes it is returned as it is, without
    places. Raises InputError.
    """
    items = document.get("settings")
    if not isinstance(items, list) or not any(_includes(item) for item in items):
        return document, ()
    found = _settings(items, ConfigPath(path, "settings"), (path.resolve(),), load)
    return {**document, "settings": [item for item, _ in found]}, tuple(place for _, place in found)


def _includes(item: object) -> bool:
    return isinstance(item, Mapping) and item.get("include") is not None


def _settings(items: list[Any], place: ConfigPath, files: tuple[Path, ...], load: Load) -> list[tuple[Any, ConfigPath]]:
    """Return settings with their places. files: those that are being read, the last one with these settings."""
    found: list[tuple[Any, ConfigPath]] = []
    for index, item in enumerate(items):
        where = place.at(index)
        parsed = parse(SettingSpec, item, where)
        if parsed.include is None:
            found.append((item, where))
            continue
        if len(item) > 1:
            others = ", ".join(name for name in item if name != "include")
            raise where.error(f"has {others} beside include", "write that into a setting of its own")
        file = path_in(files[-1].parent, parsed.include, where.at("include"))
        if file.resolve() in files:
            raise where.at("include").error(f"{file.name} includes itself", "name another preset")
        others = load(file).get("settings")
        if not isinstance(others, list):
            raise where.at("include").error(f"{file} has no settings to take: they are {describe(others)}")
        found += _settings(others, ConfigPath(file, "settings"), (*files, file.resolve()), load)
    return found
