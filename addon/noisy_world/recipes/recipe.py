# SPDX-License-Identifier: GPL-3.0-or-later
"""A recipe: what a dataset was made from, and digests of what came of it, in a file that can be handed on."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from ..core.datasets.dataset_state import identity_problem, is_inside
from ..core.datasets.json_text import read_json
from ..core.datasets.provenance import FORMAT as IDENTITY_FORMAT
from ..core.errors import InputError
from ..core.shipped import package_version
from .digests import BLOCK_FRAMES, DIGEST_BYTES, blocks_of, split_digests
from .frame_numbers import FrameNumbers

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
