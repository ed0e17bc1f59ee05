# SPDX-License-Identifier: GPL-3.0-or-later
"""What the report says, part by part, whatever it is written as."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from .figures.drawing import Picture
from .run_pictures import FramePicture
from .tables import Table


@dataclass(frozen=True)
class Section:
    """A part of the report. name: of its anchor."""

    name: str
    title: str
    paragraphs: Sequence[str] = ()
    pictures: Sequence[Picture] = ()
    frames: Sequence[FramePicture] = ()
    tables: Sequence[Table] = ()


@dataclass(frozen=True)
class Contents:
    """The report. findings: what it found, the first sentence before all. ranking: their picture.

    opening: how many runs there are. facts: what was evaluated, label and text. missing: what it has to do without.

    again: how to get it again, in sentences, and a command; "" where none is known.
    """

    title: str
    findings: Sequence[str]
    ranking: Picture | None
    opening: str
    facts: Sequence[tuple[str, str]]
    sections: Sequence[Section]
    missing: Sequence[str] = field(default=())
    again: Sequence[str] = field(default=())
    command: str = ""

    @property
    def tables(self) -> list[Table]:
        """All tables, in order."""
        return [table for section in self.sections for table in section.tables]
