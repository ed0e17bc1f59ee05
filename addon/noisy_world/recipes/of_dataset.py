# SPDX-License-Identifier: GPL-3.0-or-later
"""The recipe of a finished dataset: from its manifest and its frames.jsonl or its table, without reading an image."""

import json
from pathlib import Path
from typing import Any

from ..core.datasets.dataset_state import MANIFEST, OVERVIEW, WORK_FOLDER, journal_folders, read_dataset_state
from ..core.datasets.place import check_no_links
from ..core.datasets.records import FRAMES
from ..core.datasets.storage import sha256_of_bytes
from ..core.errors import InputError
from ..core.progress import Progress
from ..core.regular_files import read_bytes
from ..storage.address import address_of
from ..storage.croissant import CROISSANT
from ..storage.frame_table import TABLE
from ..storage.packed import Packed, file_sha256, is_packed, open_packed
from ..storage.packed_table import PackedTable
from .digests import block_digests, series_of, short_of_hex
from .frame_numbers import FrameNumbers
from .recipe import Recipe, SequenceDigests

AGAIN = "run the command that made the dataset again: it mends what is not as it was written"


def recipe_of(dataset: Path | str, progress: Progress) -> Recipe:
    """Return the recipe of a dataset. The images are taken to be as they were written: `verify` hashes them.

    dataset: a folder, or the address of a packed dataset. Raises InputError where no finished dataset is there, or its
    records are not as they were written; StorageError where a store refuses.
    """
    if isinstance(dataset, Path) and not is_packed(dataset):
        return _recipe_of_folder(dataset, progress)
    return _recipe_of_packed(open_packed(dataset if isinstance(dataset, str) else address_of(dataset)), progress)


def _recipe_of_folder(folder: Path, progress: Progress) -> Recipe:
    standing = read_dataset_state(folder)
    if standing is None:
        raise InputError(folder, "holds no dataset of Noisy World", remedy="name the folder that has a manifest.json")
    if standing.problem:
        raise InputError(folder, standing.problem)
    if standing.manifest is None or journal_folders(folder / WORK_FOLDER):
        raise InputError(folder, "its run has not come to its end", remedy="run the same command again; it goes on")
    check_no_links(folder, standing.sequences)
    progress.start("reading records", sum(standing.manifest["frames"].values()))
    sequences: dict[str, SequenceDigests] = {}
    for name in sorted(standing.finished):
        sequences[name] = _digests(folder / name, standing.files[name])
        progress.advance(len(sequences[name].frames))
    progress.finish()
    return _recipe(folder / MANIFEST, standing.manifest, sequences)


def _recipe_of_packed(packed: Packed, progress: Progress) -> Recipe:
    """Return the recipe by the dataset's table, which is hashed first."""
    place = packed.address.of(TABLE)
    told, size = packed.described.get(TABLE), packed.address.size(TABLE)
    if told is None:
        raise InputError(packed.address.of(CROISSANT), "is missing or damaged", remedy=AGAIN)
    if size is None or size != told.size or file_sha256(packed.address, TABLE, size) != told.sha256:
        raise InputError(place, "is not as it was written", remedy=AGAIN)
    table = PackedTable(packed.address)
    progress.start("reading records", sum(packed.manifest["frames"].values()))
    sequences: dict[str, SequenceDigests] = {}
    for name in packed.sequences:
        sequences[name] = _digests_of_rows(packed, table, name)
        progress.advance(len(sequences[name].frames))
    progress.finish()
    return _recipe(packed.address.of(MANIFEST), packed.manifest, sequences)


def _recipe(place: Path | str, manifest: dict[str, Any], sequences: dict[str, SequenceDigests]) -> Recipe:
    loose = {name: digest for name, digest in manifest["files"].items() if isinstance(digest, str) and name != OVERVIEW}
    texts = {name: short_of_hex(digest) for name, digest in loose.items()}
    return Recipe(Path(place), manifest["identity"], sequences, texts)


def _digests_of_rows(packed: Packed, table: PackedTable, sequence: str) -> SequenceDigests:
    """Return the digests of a sequence by its rows in the table."""
    wanted = [f"{modality}_{what}" for modality in packed.modalities for what in ("file", "sha256")]
    rows = table.rows(sequence, ["frame", *wanted])
    frames: list[int] = rows.column("frame").to_pylist()
    files: dict[str, dict[int, tuple[str, str]]] = {}
    for modality in packed.modalities:
        columns = (rows.column(f"{modality}_{what}").to_pylist() for what in ("file", "sha256"))
        for frame, name, digest in zip(frames, *columns, strict=True):
            files.setdefault(series_of(name), {})[frame] = (name, digest)
    return _sequence_digests(frames, files, packed.manifest["files"][sequence])


def _digests(folder: Path, texts: dict[str, str]) -> SequenceDigests:
    """Return the digests of a sequence. texts: SHA-256 by name of its text files, as the manifest has them."""
    path = folder / FRAMES
    try:
        data = read_bytes(path)
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
    return _sequence_digests(frames, files, texts)


def _sequence_digests(
    frames: list[int], files: dict[str, dict[int, tuple[str, str]]], texts: dict[str, str]
) -> SequenceDigests:
    """Return the digests of a sequence. files: name and SHA-256 of its images by series and frame. texts: by name."""
    return SequenceDigests(
        FrameNumbers.of(frames),
        {series: block_digests(files[series]) for series in sorted(files)},
        {name: short_of_hex(digest) for name, digest in sorted(texts.items())},
    )
