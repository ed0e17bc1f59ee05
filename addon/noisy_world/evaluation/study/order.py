# SPDX-License-Identifier: GPL-3.0-or-later
"""The order for a study as plain values, which is sent to worker processes here and elsewhere."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class StudyOrder:
    """What a study is to do.

    subject: the preset's file, or the folder of sequences. document: the preset's content, overrides included; None for
    a folder. out: the folder of results. systems: names, or files that define them. seeds: of the cases; () for the
    preset's own. repeats: of systems that do not repeat themselves. protocol: whose values and errors come first.
    scenes, settings: names or globs of those that are wanted of a folder; a preset's document says its own. keep:
    whether sequences stay. keep_clean: whether clean frames are kept while a scene is evaluated. maps: whether maps are
    scored too. isolate: what keeps systems apart whose definition says nothing of it; "none" for nothing. elsewhere:
    names of runs that are not done, as a record of the study has them.
    """

    subject: str
    document: dict[str, Any] | None
    out: str
    systems: tuple[str, ...]
    seeds: tuple[int, ...] = ()
    repeats: int = 3
    protocol: str = "strict"
    scenes: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    keep: bool = False
    keep_clean: bool = True
    maps: bool = False
    isolate: str = "none"
    elsewhere: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        """The folder of results."""
        return Path(self.out)

    def text(self) -> str:
        """Return it as a line of JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def parse(cls, text: str) -> "StudyOrder":
        """Return the order in a line of JSON."""
        values = json.loads(text)
        listed = {name: tuple(values[name]) for name in ("systems", "seeds", "scenes", "settings", "elsewhere")}
        return cls(**{**values, **listed})
