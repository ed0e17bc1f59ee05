# SPDX-License-Identifier: GPL-3.0-or-later
"""The result of comparing a dataset with a recipe, and its text."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from ..core.errors import one_line

NAMED = 4  # names that a line lists

# What can be wrong, with the words for it; the first three are faults of the dataset whatever made it.
MISSING, DAMAGED, EXTRA, OTHER, NOT_COMPARABLE = "missing", "damaged", "extra", "other", "not comparable"
MEANINGS = {
    MISSING: "missing",
    DAMAGED: "damaged (not as it was written)",
    EXTRA: "extra (neither the recipe nor the dataset's records name it)",
    OTHER: "not as the recipe says",
    NOT_COMPARABLE: "not comparable (made with other versions or on another processor)",
}


@dataclass
class FolderFindings:
    """What was found in one folder.

    problems: the names of files, or series with their frames, by kind. checked: how many images are as the recipe says.
    alone: images that are as they were written, but whose block is not whole here, so that no digest tells of them;
    cut: the frames of the recipe from which they are cut out. absent: the recipe's frames that were not made here.
    unknown: frames, or all, that the recipe does not know.
    """

    folder: str
    problems: dict[str, list[str]] = field(default_factory=dict)
    checked: int = 0
    alone: int = 0
    cut: str = ""
    absent: int = 0
    unknown: int = 0

    def add(self, kind: str, name: str) -> None:
        """Note a file that is not as it should be."""
        self.problems.setdefault(kind, []).append(name)

    def lines(self) -> list[str]:
        """Return a line for each kind of problem."""
        found = [f"{self.folder}: {_listed(names)}: {MEANINGS[kind]}" for kind, names in self.problems.items()]
        if self.unknown:
            found.append(f"{self.folder}: {_frames(self.unknown)} that the recipe does not know")
        return found


@dataclass
class Findings:
    """What was found in a whole dataset.

    made_otherwise: why its bytes may differ from the recipe's without a fault, or "". not_there: sequences of the
    recipe that the dataset was not made with. missing: those that it should have. unknown: those that the recipe does
    not know. rest: the folder itself.
    """

    made_otherwise: str = ""
    sequences: list[FolderFindings] = field(default_factory=list)
    not_there: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)
    rest: FolderFindings = field(default_factory=lambda: FolderFindings("."))

    @property
    def all_found(self) -> list[FolderFindings]:
        """The sequences and the rest."""
        return [*self.sequences, self.rest]

    def count(self, *kinds: str) -> int:
        """Return how many problems of some kinds there are."""
        return sum(len(found.problems.get(kind, ())) for found in self.all_found for kind in kinds)

    @property
    def sound(self) -> bool:
        """Whether nothing is missing, damaged or extra, whatever made it."""
        return not (self.missing or self.unknown or self.count(MISSING, DAMAGED, EXTRA, OTHER)) and not any(
            found.unknown for found in self.sequences
        )

    @property
    def as_the_recipe(self) -> bool:
        """Whether all that is there is as the recipe says."""
        return self.sound and not self.count(NOT_COMPARABLE)

    def lines(self) -> list[str]:
        """Return what is wrong, line by line."""
        lines = [line for found in self.all_found for line in found.lines()]
        lines += [f"{_listed(self.missing)}: missing"] if self.missing else []
        lines += [f"{_listed(self.unknown)}: not in the recipe"] if self.unknown else []
        return lines

    def summary_lines(self) -> list[str]:
        """Return what is there and what is not, line by line; the last one is the outcome."""
        there, absent = len(self.sequences), len(self.not_there)
        lines = []
        if absent:
            lines.append(f"a part of the recipe: {absent} of its {there + absent} sequences were not made here")
        if lacking := sum(found.absent for found in self.sequences):
            lines.append(f"a part of the recipe: {_frames(lacking)} of these sequences were not made here")
        alone = [found for found in self.sequences if found.alone]
        if alone:
            count = sum(found.alone for found in alone)
            problem = "could not be compared, only checked against the dataset's own records"
            lines.append(f"{count} images {problem}: their blocks need {alone[0].cut} whole")
        if self.made_otherwise:
            lines.append(self.made_otherwise)
        checked = sum(found.checked for found in self.sequences)
        lines.append(
            f"{there} sequence{'' if there == 1 else 's'}, {checked} images as the recipe says{self._outcome()}"
        )
        return lines

    def _outcome(self) -> str:
        kinds = {kind: self.count(kind) for kind in MEANINGS if self.count(kind)}
        parts = [f"{count} {kind}" for kind, count in kinds.items()]
        parts += [f"{len(self.missing)} sequences missing"] if self.missing else []
        parts += [f"{len(self.unknown)} sequences unknown"] if self.unknown else []
        return "; " + ", ".join(parts) if parts else ""


def _listed(names: Iterable[str]) -> str:
    listed = list(names)
    more = len(listed) - NAMED
    return one_line(", ".join(listed[:NAMED]) + (f" and {more} more" if more > 0 else ""))


def _frames(count: int) -> str:
    return f"{count} frame{'' if count == 1 else 's'}"
