# SPDX-License-Identifier: GPL-3.0-or-later
"""The recipe of a finished dataset: from its manifest and its frames.jsonl or its table, without reading an image."""

from pathlib import Path

from ..core.datasets.dataset_state import MANIFEST, OVERVIEW
from ..core.progress import Progress
from ..storage.finished import Content, Packed, open_finished
from .digests import block_digests, series_of, short_of_hex
from .frame_numbers import FrameNumbers
from .recipe import Recipe, SequenceDigests


def recipe_of(dataset: Path | str, progress: Progress) -> Recipe:
    """Return the recipe of a dataset. The images are taken to be as they were written: `verify` hashes them.

    dataset: a folder, or the address of a packed dataset. Raises InputError where no finished dataset is there,
    InputError or StorageError where its records are not as they were written or a store refuses.
    """
    content = open_finished(dataset)
    if isinstance(content, Packed):
        content.check_table()
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


def _digests(content: Content | Packed, sequence: str) -> SequenceDigests:
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
