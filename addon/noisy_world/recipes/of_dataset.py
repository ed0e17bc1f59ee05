# SPDX-License-Identifier: GPL-3.0-or-later
"""The recipe of a finished dataset: from its manifest and its frames.jsonl, without reading an image."""

import json
from pathlib import Path
from typing import Any

from ..core.datasets.records import FRAMES
from ..core.datasets.standing import MANIFEST, OVERVIEW, WORK_FOLDER, journal_folders, read_standing
from ..core.datasets.storage import sha256_of_bytes
from ..core.errors import InputError
from ..core.progress import Progress
from .digests import block_digests, series_of, short_of_hex
from .frame_numbers import FrameNumbers
from .recipe import Recipe, SequenceDigests

AGAIN = "run the command that made the dataset again: it mends what is not as it was written"


def recipe_of(folder: Path, progress: Progress) -> Recipe:
    """Return the recipe of a dataset. The images are taken to be as they were written: `verify` hashes them.

    Raises InputError where the folder holds no finished dataset, or its records are not as they were written.
    """
    standing = read_standing(folder)
    if standing is None:
        raise InputError(folder, "holds no dataset of Noisy World", remedy="name the folder that has a manifest.json")
    if standing.problem:
        raise InputError(folder, standing.problem)
    if standing.manifest is None or journal_folders(folder / WORK_FOLDER):
        raise InputError(folder, "its run has not come to its end", remedy="run the same command again; it goes on")
    progress.start("reading records", sum(standing.manifest["frames"].values()))
    sequences: dict[str, SequenceDigests] = {}
    for name in sorted(standing.finished):
        sequences[name] = _digests(folder / name, standing.files[name])
        progress.advance(len(sequences[name].frames))
    progress.finish()
    loose = {name: digest for name, digest in standing.files.items() if isinstance(digest, str) and name != OVERVIEW}
    texts = {name: short_of_hex(digest) for name, digest in loose.items()}
    return Recipe(folder / MANIFEST, standing.manifest["identity"], sequences, texts)


def _digests(folder: Path, texts: dict[str, str]) -> SequenceDigests:
    """Return the digests of a sequence. texts: SHA-256 by name of its text files, as the manifest has them."""
    path = folder / FRAMES
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}", remedy=AGAIN) from error
    if sha256_of_bytes(data) != texts.get(FRAMES):
        raise InputError(path, "is not as it was written", remedy=AGAIN)
    files: dict[str, dict[int, tuple[str, str]]] = {}
    frames: list[int] = []
    for line in data.decode().splitlines():
        record: dict[str, Any] = json.loads(line)
        frames.append(record["frame"])
        for name, digest in record["sha256"].items():
            files.setdefault(series_of(name), {})[record["frame"]] = (name, digest)
    return SequenceDigests(
        FrameNumbers.of(frames),
        {series: block_digests(files[series]) for series in sorted(files)},
        {name: short_of_hex(digest) for name, digest in sorted(texts.items())},
    )
