# SPDX-License-Identifier: GPL-3.0-or-later
"""Verification of a dataset against a recipe: every file is hashed.

A file that is not as the dataset's own record says is damaged; one that is, in a block whose digest differs, was made
otherwise. A sequence or a frame that the dataset's manifest does not name is not missing: somebody made a part.
"""

import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..core.errors import one_line
from ..core.frame_table import FRAMES, FrameRecord
from ..core.progress import Progress
from .folder_state import MANIFEST, DatasetState
from .recipe import (
    Digests,
    FrameNumbers,
    Recipe,
    SequenceDigests,
    block_digests,
    block_slice,
    blocks_of,
    series_of,
    short_of_hex,
)
from .remaking import written_otherwise
from .stored import SequenceFiles, StoredDataset, stored_dataset

# The result of comparing a dataset with a recipe, and its text.


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


def verify(recipe: Recipe, dataset: Path | str, progress: Progress, stop: threading.Event) -> Findings:
    """Hash every file of a dataset and compare it with a recipe.

    dataset: a folder, or the address of a packed dataset. stop: when set, InterruptedRunError is raised after the
    current sequence. Raises InputError where there is no dataset, StorageError where a store refuses.
    """
    files = stored_dataset(dataset)
    state = files.state
    here = state.identity
    findings = Findings("" if here is None else written_otherwise(recipe.identity, here))
    known = state.finished if state.manifest is not None else state.sequences
    there = {name for name in recipe.sequences if files.has(name)}
    findings.missing = sorted(known & set(recipe.sequences) - there)
    findings.not_there = sorted(set(recipe.sequences) - known - there)
    findings.unknown = sorted((files.recorded() | known) - set(recipe.sequences))
    progress.start("verifying", sum(len(recipe.sequences[name].frames) for name in there))
    for name, own in files.each(sorted(there), stop):
        found = _Sequence(name, recipe.sequences[name], own, state, bool(findings.made_otherwise)).compared()
        findings.sequences.append(found)
        if not found.problems and own.damaged_whole:
            findings.rest.add(
                DAMAGED, own.damaged_whole
            )  # in what no file of the dataset is: headers, samples' descriptions
        progress.advance(len(recipe.sequences[name].frames))
    progress.finish()
    _compare_rest(recipe, files, findings)
    return findings


@dataclass
class _Sequence:
    """A sequence of the recipe that has files."""

    name: str
    wanted: SequenceDigests
    files: SequenceFiles
    state: DatasetState
    made_otherwise: bool

    def compared(self) -> FolderFindings:
        """Hash its files, and return what was found."""
        found = FolderFindings(self.name)
        written: Mapping[str, str] = self.state.files.get(self.name, {})
        records = self.files.records
        (recorded,) = self.files.digests([FRAMES])
        intact = recorded is not None and written.get(FRAMES) in (None, recorded)
        frames = FrameNumbers.of(frame for frame in records if frame in self.wanted.frames)
        lacking = len(self.wanted.frames) - len(frames)
        if intact:
            found.absent = lacking  # the dataset's own records do not name them
        elif lacking:
            found.add(MISSING, f"{lacking} frames that {FRAMES} should name")
        found.unknown = len(records) - len(frames)
        self._compare_images(found, frames, records)
        whole = frames == self.wanted.frames and not found.unknown
        texts = {**dict.fromkeys(self.wanted.texts), **written}
        for text, digest in zip(sorted(texts), self.files.digests(sorted(texts)), strict=True):
            kind = self._text_problem(digest, written.get(text), self.wanted.texts.get(text) if whole else None)
            if kind:
                found.add(kind, text)
        named = {*texts, FRAMES} | {name for record in records.values() for name in record.files}
        for name in sorted(self.files.names() - named):
            found.add(EXTRA, name)
        return found

    def _compare_images(self, found: FolderFindings, frames: FrameNumbers, records: Mapping[int, FrameRecord]) -> None:
        wrong: dict[str, set[int]] = {series: set() for series in self.wanted.images}
        named = [(frame, name) for frame in frames for name in records[frame].files]
        digests = self.files.digests([name for _, name in named])
        for (frame, name), digest in zip(named, digests, strict=True):
            if digest == records[frame].files[name]:
                continue
            found.add(MISSING if digest is None else DAMAGED, name)
            wrong.setdefault(series_of(name), set()).add(frame)
        for series, wanted in self.wanted.images.items():
            files = {
                frame: (name, digest)
                for frame in frames
                for name, digest in records[frame].files.items()
                if series_of(name) == series
            }
            self._compare_blocks(found, series, wanted, files, wrong[series])

    def _compare_blocks(
        self, found: FolderFindings, series: str, wanted: Digests, files: Mapping[int, tuple[str, str]], wrong: set[int]
    ) -> None:
        """Compare a series block by block; what is missing or damaged has been told."""
        there = FrameNumbers.of(sorted(files))
        made = block_digests(files)
        for block in blocks_of(there):
            part, whole = there.within(block_slice(block)), self.wanted.frames.within(block_slice(block))
            damaged = sum(frame in wrong for frame in part)
            if part != whole:
                found.alone += len(part) - damaged
                found.cut = found.cut or f"frames {whole}"
            elif made[block] == wanted[block]:
                found.checked += len(part) - damaged
            else:
                found.add(NOT_COMPARABLE if self.made_otherwise else OTHER, f"{series} {whole}")

    def _text_problem(self, digest: str | None, written: str | None, wanted: str | None) -> str:
        """Return what is wrong with a text file. wanted: the recipe's digest, None where that is of other frames."""
        if digest is None:
            return MISSING
        if written is not None and digest != written:
            return DAMAGED
        if wanted is not None and short_of_hex(digest) != wanted:
            return NOT_COMPARABLE if self.made_otherwise else OTHER
        return ""


def _compare_rest(recipe: Recipe, files: StoredDataset, findings: Findings) -> None:
    """Compare the files beside the sequences, and look for what belongs to nothing."""
    state = files.state
    settings = {name.split("/")[0] for name in state.sequences}
    loose = {name: digest for name, digest in state.files.items() if isinstance(digest, str)}
    wanted = {name: digest for name, digest in recipe.texts.items() if name.split("/")[0] in settings}
    for name in sorted({*loose, *wanted}):
        digest = files.digest(name)
        if digest is None:
            findings.rest.add(MISSING, name)
        elif loose.get(name, digest) != digest:
            findings.rest.add(DAMAGED, name)
        elif name in wanted and short_of_hex(digest) != wanted[name]:
            findings.rest.add(NOT_COMPARABLE if findings.made_otherwise else OTHER, name)
    if state.manifest is None:
        findings.rest.add(MISSING, MANIFEST)
    for kind, names in zip((MISSING, DAMAGED), files.own_problems(check=True), strict=True):
        for name in names:
            findings.rest.add(kind, name)
    sequences = {*recipe.sequences, *state.sequences, *findings.unknown}
    for name in sorted(files.beside(sequences) - {*loose, *wanted}):
        findings.rest.add(EXTRA, name)
