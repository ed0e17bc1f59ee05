# SPDX-License-Identifier: GPL-3.0-or-later
"""A recipe: what a dataset was made from, and digests of what came of it, in a file that can be handed on."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.datasets.json_text import read_json
from ..core.datasets.provenance import FORMAT as IDENTITY_FORMAT
from ..core.datasets.provenance import package_version
from ..core.datasets.standing import identity_problem
from ..core.errors import InputError
from .digests import BLOCK_FRAMES, DIGEST_BYTES, blocks_of, split_digests
from .frame_numbers import FrameNumbers

FORMAT = 1  # version of the file; raised when its keys or its digests change
KIND = "recipe of Noisy World"
DIGESTS = f"the first {DIGEST_BYTES} bytes of SHA-256 in URL-safe base64"

type Digests = Mapping[int, str]
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
        frames = FrameNumbers(_ranges(row["frames"]))
        images: dict[str, Digests] = {}
        for series, text in row["images"].items():
            # In place of its own digests a sequence may name an earlier one that has the same.
            digests = list(found[text].images[series].values()) if "/" in text else split_digests(text)
            if _fewest_blocks(frames) > len(digests):  # before a number for each is made
                raise ValueError("has fewer digests than blocks of frames")
            images[series] = dict(zip(blocks_of(frames), digests, strict=True))
        found[folder] = SequenceDigests(frames, images, _texts(row["texts"]))
    return found


def _ranges(rows: Any) -> list[range]:
    """Return ranges of frames, in order. Raises TypeError or ValueError."""
    ranges = []
    for start, stop in rows:
        if type(start) is not int or type(stop) is not int:
            raise TypeError("a frame is a whole number")
        if not (ranges[-1].stop if ranges else 0) <= start < stop:
            raise ValueError("frames are in order")
        ranges.append(range(start, stop))
    return ranges


def _fewest_blocks(frames: FrameNumbers) -> int:
    """Return how many blocks frames have at least, where neighbouring ranges share one."""
    parts = frames.ranges
    return sum((part.stop - 1) // BLOCK_FRAMES - part.start // BLOCK_FRAMES for part in parts) + bool(parts)


def _texts(content: Any) -> dict[str, str]:
    if not all(isinstance(digest, str) for digest in content.values()):
        raise TypeError("a digest is a text")
    return dict(content)
