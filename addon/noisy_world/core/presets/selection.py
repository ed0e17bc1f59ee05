# SPDX-License-Identifier: GPL-3.0-or-later
"""Choosing a part of a preset's scenes and settings by names and globs."""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from ..schema import ConfigPath, key, shown

NAMED = 4  # names that a message lists


@dataclass(frozen=True)
class OnlySpec:
    """The scenes and settings that are made; the dataset can grow by the others."""

    scenes: tuple[str, ...] | None = key("names of scenes, * allowed; default all", default=None, identity="nothing")
    settings: tuple[str, ...] | None = key(
        "names of settings, * allowed; default all", default=None, identity="nothing"
    )


def chosen_part(scenes: Sequence[str], settings: Sequence[str]) -> dict[str, Any]:
    """Return `only` as a preset has it; empty where nothing is chosen. A text may hold several, with commas between."""
    parts = {"scenes": scenes, "settings": settings}
    listed = {name: [glob.strip() for text in texts for glob in text.split(",")] for name, texts in parts.items()}
    return {name: globs for name, globs in listed.items() if globs}


def selected(names: Sequence[str], globs: Sequence[str] | None, place: ConfigPath) -> list[str]:
    """Return the names that any glob matches, in their order; all where there are no globs.

    place: of the globs, `only.settings` for instance. Raises InputError where one matches nothing.
    """
    if globs is None:
        return list(names)
    if not globs:
        raise place.error("is empty", "name one, or leave it out")
    for glob in globs:
        if not any(fnmatchcase(name, glob) for name in names):
            problem = f"{shown(glob)} matches none of {len(names)} {place.path.rpartition('.')[2]}"
            raise place.error(problem, f"near it: {', '.join(near_names(glob, names))}")
    return [name for name in names if any(fnmatchcase(name, glob) for glob in globs)]


def near_names(glob: str, names: Sequence[str]) -> list[str]:
    """Return the names that begin most like a glob, one for each first word, or else the first ones."""
    text = re.sub(r"[*?\[\]!]", "", glob)[:100]

    def likeness(name: str) -> float:
        return max(difflib.SequenceMatcher(None, text, part).ratio() for part in (name, name[: len(text)]))

    ranked = sorted({name: likeness(name) for name in names}.items(), key=lambda item: -item[1])
    alike: dict[str, str] = {}
    for name, ratio in ranked:
        if ratio >= 0.6:
            alike.setdefault(name.partition("_")[0], name)
    return [*(alike.values() or names)][:NAMED]
