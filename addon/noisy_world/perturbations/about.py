# SPDX-License-Identifier: GPL-3.0-or-later
"""What a perturbation is said to be: in menus, in the tables and pictures of the docs, and by a preset of its own."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Example:
    """A preset in the embedded room, where that is not clean and severities 1, 3 and 5.

    said: what it shows, after its label or in a sentence. settings: one line of YAML each; () for the severities.
    render: the preset's key, in YAML. frames, rate_hz: of the walk.
    """

    said: str = ""
    settings: Sequence[str] = ()
    render: str = ""
    frames: int = 6
    rate_hz: int = 1


STANDARD = Example()


@dataclass(frozen=True)
class About:
    """What is said of a perturbation to people; no pixel depends on it.

    sentence: what it does to what is seen, for menus. law: what it is, for the table of the docs. caption, picture:
    what the gallery's picture shows, below it and in its place; by default the sentence, and severities 1, 3 and 5.
    twin: the name of the physical one of the same cause. of_paper: it is one of the paper's taxonomy.
    """

    sentence: str = ""
    law: str = ""
    caption: str = ""
    picture: str = ""
    twin: str = ""
    of_paper: bool = False
    example: Example = STANDARD


UNSAID = About()
