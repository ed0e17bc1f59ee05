# SPDX-License-Identifier: GPL-3.0-or-later
"""Names in a preset: what they may be, as they become folders, and choosing scenes, settings and frames by them."""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from ..core.progress import counted
from ..core.schema import ConfigPath, key, quoted

LONGEST_NAME = 200  # of a folder; file systems hold 255 bytes
PLACEHOLDER = re.compile(r"\{([A-Za-z_][A-Za-z0-9_]*)\}")


def safe_name(name: str) -> str:
    """Return why a name cannot be a folder's, or ""."""
    if len(name) > LONGEST_NAME:
        return f"has {len(name)} characters, but it names a folder: at most {LONGEST_NAME}"
    if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", name):
        return ""
    return (
        f"is {quoted(name)}, but it names a folder: letters, digits, dot, dash and underscore, a letter or digit first"
    )


def scene_name(name: str) -> str:
    """Return why a name cannot be a scene's, or ""; * stands for what wildcards matched."""
    return "" if "*" in name else safe_name(name)


def stream_name(name: str) -> str:
    """Return why a text cannot name a random stream, or ""."""
    if not name.strip() or not name.isprintable():
        return f"is {quoted(name)}, but has to be a name"
    return f"has {len(name)} characters: at most {LONGEST_NAME}" if len(name) > LONGEST_NAME else ""


def template(name: str) -> str:
    """Return why a text with {placeholders} cannot become folders' names, or ""."""
    return safe_name(PLACEHOLDER.sub("x", name))


def format_same_folder(name: str, other: str) -> str:
    """Return in words that names are one folder's on disks that do not tell case apart, where a dataset may come to."""
    return f"{quoted(name)} and {quoted(other)} differ in case only, so they are one folder on macOS and Windows"


# Choosing a part of a preset's scenes and settings by names and globs.


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
            kind = place.path.rpartition(".")[2].removesuffix("s")
            problem = f"{quoted(glob)} matches none of {counted(len(names), kind)}"
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


# Frames of a Blender scene as a preset names them: FIRST:LAST or FIRST:LAST:STEP, first and last with them.


LAST_POSSIBLE = 1_048_574
"""The last frame that Blender knows (MAXFRAME); its frames begin at minus that."""


@dataclass(frozen=True)
class FrameRange:
    """The frames first, first + step, ... up to last."""

    first: int
    last: int
    step: int = 1

    @property
    def frames(self) -> tuple[int, ...]:
        """Every frame in order."""
        return tuple(range(self.first, self.last + 1, self.step))

    @classmethod
    def parse(cls, text: str) -> "FrameRange":
        """Return the range of a text in which `frame_range_problem` finds nothing wrong."""
        return cls(*map(int, text.split(":")))


def frame_range_problem(text: str) -> str:
    """Return what is wrong with a text that names frames, or ""."""
    if re.fullmatch(r"-?\d{1,8}:-?\d{1,8}(:\d{1,8})?", text, re.ASCII) is None:
        return f"{text!r} is no range of frames; write FIRST:LAST or FIRST:LAST:STEP, such as 1:250"
    chosen = FrameRange.parse(text)
    if chosen.step < 1:
        return f"{text!r} has the step 0; the least is 1"
    if chosen.last < chosen.first:
        return f"{text!r} ends before it begins"
    if max(-chosen.first, chosen.last) > LAST_POSSIBLE:
        return f"{text!r} has frames beyond {LAST_POSSIBLE}, Blender's last"
    return ""
