# SPDX-License-Identifier: GPL-3.0-or-later
"""Holding a dataset against a recipe: every file is hashed.

A file that is not as the dataset's own record says is damaged; one that is, in a block whose digest differs, was made
otherwise. A sequence or a frame that the dataset's manifest does not name is not missing: somebody made a part.
"""

import os
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from ..core.datasets.records import FRAMES, FrameRecord, joined_records, read_records
from ..core.datasets.standing import MANIFEST, OVERVIEW, RUN, WORK_FOLDER, Standing, read_standing
from ..core.datasets.storage import sha256_of_regular_file
from ..core.errors import InputError, InterruptedRunError
from ..core.machine import available_threads
from ..core.progress import Progress
from .digests import block_digests, block_slice, blocks_of, series_of, short_of_hex
from .findings import DAMAGED, EXTRA, MISSING, NOT_COMPARABLE, OTHER, Findings, Found
from .frame_numbers import FrameNumbers
from .made_with import made_otherwise
from .recipe import Digests, Recipe, SequenceDigests

TOP = (MANIFEST, RUN, OVERVIEW)
WAITING = 256  # files that are hashed ahead; more would only take memory


def verify(recipe: Recipe, folder: Path, progress: Progress, stop: threading.Event) -> Findings:
    """Hash every file of a dataset and compare it with a recipe.

    stop: when set, InterruptedRunError is raised after the current sequence. Raises InputError where there is no
    dataset.
    """
    standing = read_standing(folder)
    if standing is None:
        raise InputError(folder, "holds no dataset of Noisy World", remedy="name the folder that has a manifest.json")
    here = standing.identity
    findings = Findings("" if here is None else made_otherwise(recipe.identity, here))
    known = standing.finished if standing.manifest is not None else standing.sequences
    there = {name for name in recipe.sequences if (folder / name).is_dir()}
    findings.missing = sorted(known & set(recipe.sequences) - there)
    findings.not_there = sorted(set(recipe.sequences) - known - there)
    findings.unknown = sorted((_on_disk(folder) | known) - set(recipe.sequences))
    progress.start("verifying", sum(len(recipe.sequences[name].frames) for name in there))
    with ThreadPoolExecutor(available_threads()) as pool:
        hashing = _Hashing(folder, pool)
        for name in sorted(there):
            if stop.is_set():
                raise InterruptedRunError("stopped; nothing was written, and verify begins at the beginning")
            found = _Sequence(name, recipe.sequences[name], folder, standing, bool(findings.made_otherwise))
            findings.sequences.append(found.compared(hashing))
            progress.advance(len(recipe.sequences[name].frames))
    progress.finish()
    _compare_rest(recipe, folder, standing, findings)
    return findings


def _on_disk(folder: Path) -> set[str]:
    """Return the sequences whose frames.jsonl is there."""
    return {path.parent.relative_to(folder).as_posix() for path in folder.glob(f"*/*/{FRAMES}")}


class _Hashing:
    """Hashes files in threads; a file with several names once."""

    def __init__(self, folder: Path, pool: ThreadPoolExecutor) -> None:
        self._folder = folder
        self._pool = pool
        self._linked: dict[tuple[int, int], str | None] = {}

    def of(self, names: list[str]) -> Iterator[str | None]:
        """Yield the SHA-256 of files by their names in the dataset, None for one that is not there."""
        for at in range(0, len(names), WAITING):
            yield from self._pool.map(self._one, names[at : at + WAITING])

    def _one(self, name: str) -> str | None:
        path = self._folder / name
        try:
            status = path.stat()
        except OSError:
            return None
        key = (status.st_dev, status.st_ino)
        if status.st_nlink == 1:
            return sha256_of_regular_file(path)
        if key not in self._linked:
            self._linked[key] = sha256_of_regular_file(path)
        return self._linked[key]


@dataclass
class _Sequence:
    """A sequence of the recipe that has a folder."""

    name: str
    wanted: SequenceDigests
    folder: Path
    standing: Standing
    made_otherwise: bool

    def compared(self, hashing: _Hashing) -> Found:
        """Hash its files, and return what was found."""
        found = Found(self.name)
        written: Mapping[str, str] = self.standing.files.get(self.name, {})
        own = self.folder / self.name / FRAMES
        records = joined_records(read_records(own))
        recorded = sha256_of_regular_file(own)
        intact = recorded is not None and written.get(FRAMES) in (None, recorded)
        frames = FrameNumbers.of(frame for frame in records if frame in self.wanted.frames)
        lacking = len(self.wanted.frames) - len(frames)
        if intact:
            found.absent = lacking  # the dataset's own records do not name them
        elif lacking:
            found.add(MISSING, f"{lacking} frames that {FRAMES} should name")
        found.unknown = len(records) - len(frames)
        self._compare_images(found, frames, records, hashing)
        whole = frames == self.wanted.frames and not found.unknown
        texts = {**dict.fromkeys(self.wanted.texts), **written}
        for text in sorted(texts):
            digest = recorded if text == FRAMES else sha256_of_regular_file(self.folder / self.name / text)
            kind = self._text_problem(digest, written.get(text), self.wanted.texts.get(text) if whole else None)
            if kind:
                found.add(kind, text)
        named = {*texts, FRAMES} | {name for record in records.values() for name in record.files}
        for name in sorted(_files_in(self.folder / self.name) - named):
            found.add(EXTRA, name)
        return found

    def _compare_images(
        self, found: Found, frames: FrameNumbers, records: Mapping[int, FrameRecord], hashing: _Hashing
    ) -> None:
        wrong: dict[str, set[int]] = {series: set() for series in self.wanted.images}
        named = [(frame, name) for frame in frames for name in records[frame].files]
        digests = hashing.of([f"{self.name}/{name}" for _, name in named])
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
        self, found: Found, series: str, wanted: Digests, files: Mapping[int, tuple[str, str]], wrong: set[int]
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


def _compare_rest(recipe: Recipe, folder: Path, standing: Standing, findings: Findings) -> None:
    """Compare the files beside the sequences, and look for what belongs to nothing."""
    settings = {name.split("/")[0] for name in standing.sequences}
    loose = {name: digest for name, digest in standing.files.items() if isinstance(digest, str)}
    wanted = {name: digest for name, digest in recipe.texts.items() if name.split("/")[0] in settings}
    for name in sorted({*loose, *wanted}):
        digest = sha256_of_regular_file(folder / name)
        if digest is None:
            findings.rest.add(MISSING, name)
        elif loose.get(name, digest) != digest:
            findings.rest.add(DAMAGED, name)
        elif name in wanted and short_of_hex(digest) != wanted[name]:
            findings.rest.add(NOT_COMPARABLE if findings.made_otherwise else OTHER, name)
    if standing.manifest is None:
        findings.rest.add(MISSING, MANIFEST)
    known = {*TOP, *loose, *wanted}
    sequences = {*recipe.sequences, *standing.sequences, *findings.unknown}
    for name in sorted(_beside(folder, sequences) - known):
        findings.rest.add(EXTRA, name)


def _beside(folder: Path, sequences: set[str]) -> set[str]:
    """Return the files that lie in no sequence and not in a run's working folder."""
    found: set[str] = set()
    for base, folders, names in os.walk(folder):
        here = Path(base).relative_to(folder)
        inside = [name for name in folders if (here / name).as_posix() not in sequences]
        folders[:] = [name for name in inside if (here / name).as_posix() != WORK_FOLDER]
        found |= {(here / name).as_posix() for name in names}
    return found


def _files_in(folder: Path) -> set[str]:
    """Return the files of a folder and of those inside it, by their names in it."""
    return {(Path(base) / name).relative_to(folder).as_posix() for base, _, names in os.walk(folder) for name in names}
