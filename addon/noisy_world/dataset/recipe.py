# SPDX-License-Identifier: GPL-3.0-or-later
"""A recipe: what a dataset was made from, and digests of what came of it, in a file that can be handed on."""

import base64
import hashlib
import json
import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, groupby
from pathlib import Path
from typing import Any, TypeAlias, overload

from ..core.errors import InputError
from ..core.file_access import read_json
from ..core.packages import package_version
from ..core.progress import Progress
from .folder_state import MANIFEST, OVERVIEW
from .identity import FORMAT as IDENTITY_FORMAT
from .identity import identity_problem, is_inside
from .stored import StoredDataset, finished_dataset

# The numbers of a sequence's frames, however many: ranges in place of lists.


class FrameNumbers(Sequence[int]):
    """The numbers of frames, increasing; what is not there was left out, or was not chosen."""

    def __init__(self, ranges: Iterable[range]) -> None:
        """Take ranges of neighbours, in order, with gaps between them."""
        self.ranges = tuple(ranges)

    @classmethod
    def of(cls, numbers: Iterable[int]) -> "FrameNumbers":
        """Return the numbers as ranges. numbers: increasing."""
        found: list[range] = []
        for number in numbers:
            if found and found[-1].stop == number:
                found[-1] = range(found[-1].start, number + 1)
            else:
                found.append(range(number, number + 1))
        return cls(found)

    def within(self, chosen: slice) -> "FrameNumbers":
        """Return those from `chosen.start` to `chosen.stop` - 1, by the frames' own numbers."""
        low = chosen.start or 0
        cut = (range(max(part.start, low), _least(part.stop, chosen.stop)) for part in self.ranges)
        return FrameNumbers(part for part in cut if part)

    def least_blocks(self, size: int) -> int:
        """Return how many blocks of `size` numbers hold some of these, at least: each neighbour may share one."""
        held = sum((part.stop - 1) // size - part.start // size + 1 for part in self.ranges)
        return held - max(0, len(self.ranges) - 1)

    @cached_property
    def _ends(self) -> list[int]:
        """How many numbers there are up to each range's end."""
        return list(accumulate(len(part) for part in self.ranges))

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    def __iter__(self) -> Iterator[int]:
        for part in self.ranges:
            yield from part

    def __contains__(self, number: object) -> bool:
        return any(number in part for part in self.ranges)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FrameNumbers) and self.ranges == other.ranges

    def __hash__(self) -> int:
        return hash(self.ranges)

    @overload
    def __getitem__(self, place: int) -> int: ...

    @overload
    def __getitem__(self, place: slice) -> Sequence[int]: ...

    def __getitem__(self, place: int | slice) -> int | Sequence[int]:
        if isinstance(place, slice):
            return [self[index] for index in range(len(self))[place]]
        index = range(len(self))[place]
        part = bisect_right(self._ends, index)
        before = self._ends[part - 1] if part else 0
        return self.ranges[part][index - before]

    def __str__(self) -> str:
        """Tell the numbers, as in "0 to 3, 7"; of many ranges the first ones."""
        lines = [str(part.start) if len(part) == 1 else f"{part.start} to {part.stop - 1}" for part in self.ranges[:4]]
        more = len(self.ranges) - len(lines)
        return ", ".join(lines) + (f" and {more} more ranges" if more else "")


def _least(stop: int, asked: int | None) -> int:
    return stop if asked is None else min(stop, asked)


# Digests of a sequence's files in a few bytes a frame: one for a block of frames of a series of images.
#
# A series is what the images of one kind are called in a sequence, with * for the frame: `results/frame*.jpg`. A
# block is BLOCK_FRAMES frames by their numbers. Its digest is that of a list with a line for each of its frames, in
# order: the file's SHA-256 and its name. So a file that is damaged is found to the block, and a dataset's own
# frames.jsonl, whose hashes the block's digest confirms, names the file.


# Chosen: 1,000 sequences of 2,000 frames take some 600 kB; a block of 10 would take ten times that.
BLOCK_FRAMES = 100
DIGEST_BYTES = 15  # 120 bits: 20 letters without padding; nobody finds another file for one, nor does chance
DIGEST_LETTERS = DIGEST_BYTES * 4 // 3


def short_digest(data: bytes) -> str:
    """Return the first bytes of the SHA-256 of some bytes, as URL-safe base64 (RFC 4648)."""
    return short_of_hex(hashlib.sha256(data).hexdigest())


def short_of_hex(sha256: str) -> str:
    """Return a SHA-256 in hexadecimal as a short digest."""
    return base64.urlsafe_b64encode(bytes.fromhex(sha256)[:DIGEST_BYTES]).decode()


def series_of(name: str) -> str:
    """Return the series of an image, with * for its number or stamp: "results/frame*.jpg"."""
    stem, _, suffix = name.rpartition(".")
    number = stem[len(stem.rstrip("0123456789.")) :].lstrip(".")
    if not number or not re.fullmatch("[a-z]+", suffix):
        return name
    return f"{stem.removesuffix(number)}*.{suffix}"


def block_digests(files: Mapping[int, tuple[str, str]]) -> dict[int, str]:
    """Return a digest by the number of the block. files: name and SHA-256 by frame, of one series."""
    found: dict[int, str] = {}
    for block, frames in groupby(sorted(files), key=lambda frame: frame // BLOCK_FRAMES):
        lines = (f"{files[frame][1]} {files[frame][0]}\n" for frame in frames)
        found[block] = short_digest("".join(lines).encode())
    return found


def split_digests(text: str) -> list[str]:
    """Return the digests that stand in a text without anything between them. Raises ValueError."""
    if len(text) % DIGEST_LETTERS or not re.fullmatch("[A-Za-z0-9_-]*", text):
        raise ValueError("is no text of digests")
    return [text[at : at + DIGEST_LETTERS] for at in range(0, len(text), DIGEST_LETTERS)]


def blocks_of(frames: FrameNumbers) -> list[int]:
    """Return the numbers of the blocks that hold some of the frames, in order."""
    held = (range(part.start // BLOCK_FRAMES, (part.stop - 1) // BLOCK_FRAMES + 1) for part in frames.ranges if part)
    return sorted({block for blocks in held for block in blocks})


def block_slice(block: int) -> slice:
    """Return the frames of a block."""
    return slice(block * BLOCK_FRAMES, (block + 1) * BLOCK_FRAMES)


FORMAT = 1  # version of the file; raised when its keys or its digests change
KIND = "recipe of Noisy World"
DIGESTS = f"the first {DIGEST_BYTES} bytes of SHA-256 in URL-safe base64"

Digests: TypeAlias = Mapping[int, str]
"""A digest by the number of the block."""


@dataclass(frozen=True)
class SequenceDigests:
    """What a recipe knows of a sequence's files.

    frames: those that there are. images: the digests of each series. texts: the digest of each text file by name.
    """

    frames: FrameNumbers
    images: Mapping[str, Digests]
    texts: Mapping[str, str]


@dataclass(frozen=True)
class Recipe:
    """What makes a dataset, and how it is known.

    path: of the file. identity: as in the manifest: the preset, the inputs' hashes, versions and processor. sequences:
    by their folders. texts: digests of the text files of settings, by name.
    """

    path: Path
    identity: Mapping[str, Any]
    sequences: Mapping[str, SequenceDigests]
    texts: Mapping[str, str]

    def text(self) -> str:
        """Return the content of the file, with a line for each sequence; equal recipes have equal text."""
        head = {"kind": KIND, "format": FORMAT, "digests": DIGESTS, "block_frames": BLOCK_FRAMES}
        parts = [f"{_compact(name)}: {_compact(value)}" for name, value in head.items()]
        parts += [f'"identity": {_compact(self.identity)}', f'"texts": {_compact(self.texts)}']
        known: dict[tuple[str, str], str] = {}
        rows = [f"{_compact(folder)}: {_compact(_row(folder, self.sequences[folder], known))}" for folder in self.names]
        return "{\n" + ",\n".join([*parts, '"sequences": {\n' + ",\n".join(rows) + "\n}"]) + "\n}\n"

    @property
    def names(self) -> list[str]:
        """The folders of the sequences, sorted."""
        return sorted(self.sequences)


def _row(folder: str, digests: SequenceDigests, known: dict[tuple[str, str], str]) -> dict[str, Any]:
    """Return a sequence as JSON. known: the folder that had the same digests of a series first; added to."""
    images = {}
    for series, blocks in digests.images.items():
        text = "".join(blocks[block] for block in sorted(blocks))
        first = known.setdefault((series, text), folder)
        images[series] = text if first == folder else first
    frames = [[part.start, part.stop] for part in digests.frames.ranges]
    return {"frames": frames, "images": images, "texts": digests.texts}


def _compact(value: object) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


# --- reading ---


def read_recipe(path: Path) -> Recipe:
    """Read a recipe. Raises InputError where the file is none, is damaged, or is one of another version."""
    try:
        content = read_json(path)
    except FileNotFoundError as error:
        raise InputError(path, "no such recipe", remedy="noisy-world recipe DATASET writes one") from error
    except ValueError as error:
        raise InputError(path, str(error), remedy="a recipe is what 'noisy-world recipe DATASET' writes") from error
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise InputError(path, "is no recipe", remedy="a recipe is what 'noisy-world recipe DATASET' writes")
    identity: Any = content.get("identity")
    formats = (content.get("format"), identity.get("format") if isinstance(identity, dict) else None)
    if formats != (FORMAT, IDENTITY_FORMAT):
        problem = f"was written by another version of Noisy World; this one is {package_version()}"
        raise InputError(path, problem, remedy="use the version that its identity names")
    if problem := identity_problem(identity):
        raise InputError(path, problem, where="identity", remedy="it is damaged; get it again")
    try:
        return Recipe(path, content["identity"], _sequences(content["sequences"], identity), _texts(content["texts"]))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(path, "is damaged: it lacks what a recipe holds", remedy="get it again") from error


def _sequences(content: Any, identity: Mapping[str, Any]) -> dict[str, SequenceDigests]:
    """Raises KeyError, TypeError, ValueError or AttributeError where this is not what `text` writes."""
    found: dict[str, SequenceDigests] = {}
    for folder, row in sorted(content.items()):
        if folder not in identity["sequences"]:
            raise ValueError("a sequence is one of its identity")
        frames = _frames(row["frames"])
        least = frames.least_blocks(BLOCK_FRAMES)
        images: dict[str, Digests] = {}
        if not row["images"]:
            raise ValueError("has no images")
        for series, text in row["images"].items():
            if "/" in text:  # the digests are those of an earlier sequence
                images[series] = found[text].images[series]
            else:
                digests = split_digests(text)
                if least > len(digests):  # before a list is made of as many blocks as somebody wrote
                    raise ValueError("has fewer digests than blocks")
                images[series] = dict(zip(blocks_of(frames), digests, strict=True))
            if least > len(images[series]):
                raise ValueError("has fewer digests than blocks")
        found[folder] = SequenceDigests(frames, images, _texts(row["texts"]))
    return found


def _frames(content: list[list[int]]) -> FrameNumbers:
    """Raises TypeError or ValueError where this is no list of ranges in order."""
    end = 0
    for start, stop in content:
        if type(start) is not int or type(stop) is not int:
            raise TypeError("a frame's number is whole")
        if not end <= start < stop:
            raise ValueError("the ranges are not in order")
        end = stop
    return FrameNumbers(range(start, stop) for start, stop in content)


def _texts(content: Any) -> dict[str, str]:
    if not all(is_inside(name) and len(split_digests(digest)) == 1 for name, digest in content.items()):
        raise TypeError("a digest is a text, of a file in the dataset")
    return dict(content)


# The recipe of a finished dataset: from its manifest and its frames.jsonl or its table, without reading an image.


def recipe_of(dataset: Path | str, progress: Progress) -> Recipe:
    """Return the recipe of a dataset. The images are taken to be as they were written: `verify` hashes them.

    dataset: a folder, or the address of a packed dataset. Raises InputError where no finished dataset is there,
    InputError or StorageError where its records are not as they were written or a store refuses.
    """
    content = finished_dataset(dataset)
    content.check_records()
    progress.start("reading records", sum(content.manifest["frames"].values()))
    sequences: dict[str, SequenceDigests] = {}
    for name in content.sequences:
        sequences[name] = _digests(content, name)
        progress.advance(len(sequences[name].frames))
    progress.finish()
    recorded = content.manifest["files"].items()
    loose = {name: digest for name, digest in recorded if isinstance(digest, str) and name != OVERVIEW}
    texts = {name: short_of_hex(digest) for name, digest in loose.items()}
    return Recipe(Path(content.store.of(MANIFEST)), content.identity, sequences, texts)


def _digests(content: StoredDataset, sequence: str) -> SequenceDigests:
    """Return the digests of a sequence."""
    images: dict[str, dict[int, tuple[str, str]]] = {}  # name and SHA-256 by series and frame
    frames: list[int] = []
    for frame, files in content.files(sequence):
        frames.append(frame)
        for name, digest in files.items():
            images.setdefault(series_of(name), {})[frame] = (name, digest)
    texts: dict[str, str] = content.manifest["files"][sequence]
    return SequenceDigests(
        FrameNumbers.of(frames),
        {series: block_digests(images[series]) for series in sorted(images)},
        {name: short_of_hex(digest) for name, digest in sorted(texts.items())},
    )
